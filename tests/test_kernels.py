"""Compiled functions that only compiled functions may call."""

import numpy as np
import pytest

from armcontour._kernels import KERNELS, compiled
from armcontour._progress import hear_compiling


@compiled(inner=True)
def add(a: float, b: float) -> float:
    return a + b


@compiled()
def total(values: np.ndarray) -> float:
    found = 0.0
    for x in values:
        found = add(found, x)
    return found


def test_a_call_from_python_is_an_error_before_and_after_it_is_compiled():
    with pytest.raises(TypeError, match="add is compiled to be called by compiled functions only"):
        add(1.0, 2.0)
    assert total(np.arange(4.0)) == 6.0
    with pytest.raises(TypeError, match="add is compiled to be called by compiled functions only"):
        add(1.0, 2.0)


def test_all_are_known():
    assert KERNELS[__name__, "add"] is add and KERNELS[__name__, "total"] is total


def test_who_wants_to_hears_what_is_compiled(monkeypatch):
    from armcontour.program import _inside

    key = ("armcontour.program._inside", "winding")
    monkeypatch.setitem(KERNELS, key, KERNELS[key])
    again = compiled(inner=True)(_inside.winding.py_func)
    again._cache.disable()
    names = []
    with hear_compiling(names.append):
        again.compile("(float64, float64, float64[:, ::1])")
    again.compile("(float64, float64, float64[:, :])")
    assert names == ["armcontour.program._inside.winding"]
