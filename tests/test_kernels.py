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


@compiled(inner=True)
def checked(a: float) -> float:
    if a < 0.0:
        raise ValueError("below zero")
    return a


def root_of(a: float) -> float:
    return np.sqrt(checked(a))


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


def test_an_inner_function_is_kept_as_code_to_link_and_raises_errors_in_its_callers():
    function = checked.py_func
    for _ in range(2):
        # The second decorator finds what the first one has left on disk, or both find it.
        again = compiled(inner=True)(function)
        again.compile("(float64,)")
        (made,) = again.overloads.values()
        assert not made.library.get_pointer_to_function(made.fndesc.llvm_func_name)
    assert sum(again.stats.cache_hits.values()) == 1
    root = compiled()(root_of)
    root._cache.disable()
    assert root(4.0) == 2.0
    with pytest.raises(ValueError, match="below zero"):
        root(-1.0)
