"""Compiled functions that only compiled functions may call."""

import ast
import importlib
import inspect
import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

import armcontour as ac
from armcontour._kernels import KERNELS, compiled


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
    for _ in range(2):
        with pytest.raises(TypeError, match="add is compiled to be called by compiled functions"):
            add(1.0, 2.0)
        assert total(np.arange(4.0)) == 6.0
    assert KERNELS[__name__, "add"] is add and KERNELS[__name__, "total"] is total


def test_a_number_in_a_call_is_no_type_of_its_own():
    @compiled(inner=True)
    def twice(i: int) -> int:
        return 2 * i

    @compiled()
    def both(i: int) -> int:
        return twice(3) + twice(i)

    for kernel in (twice, both):
        kernel._cache.disable()
    assert both(4) == 14
    assert len(twice.overloads) == 1


MAKES_ARRAYS = re.compile(
    r"np\.(empty|zeros|ones|full|arange|array|concatenate|copy|linspace|argsort|sort|stack|append"
    r"|diff|cumsum)\(|\.copy\("
)


def test_inner_functions_that_make_or_return_arrays_count_references():
    # Without references counted, arrays that they make would never be freed, and those that they
    # return freed too early.
    for file in Path(ac.__file__).parent.rglob("_*.py"):
        if "@compiled(" in file.read_text(encoding="utf-8"):
            place = file.relative_to(Path(ac.__file__).parents[1]).with_suffix("")
            importlib.import_module(".".join(place.parts))
    judged = 0
    for (module, name), kernel in KERNELS.items():
        options, function = kernel.targetoptions, kernel.py_func
        if not module.startswith("armcontour.") or options.get("_nrt", True):
            continue
        judged += 1
        (text,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
        body = "\n".join(ast.unparse(x) for x in text.body)
        callees = [function.__globals__.get(x) for x in function.__code__.co_names]
        given = [x.py_func for x in callees if hasattr(x, "py_func")]
        assert not MAKES_ARRAYS.search(body), f"{module}.{name} makes arrays"
        # What a function calls is compiled as the function itself is, unless it was before.
        makers = [x.py_func.__name__ for x in callees if _says_that_it_makes_arrays(x)]
        assert not makers, f"{module}.{name} calls {', '.join(makers)}"
        for x in (function, *given):
            assert "Array" not in x.__annotations__["return"], f"{module}.{name}: {x.__name__}"
    assert judged > 100


def _says_that_it_makes_arrays(callee):
    options = getattr(callee, "targetoptions", {})
    return bool(options.get("no_cpython_wrapper")) and options.get("_nrt", True)


def test_a_function_from_disk_is_compiled_into_others():
    assert total(np.arange(4.0)) == 6.0
    loaded = compiled()(total.py_func)
    assert loaded(np.arange(5.0)) == 10.0
    assert sum(loaded.stats.cache_hits.values()) == 1
    assert not sum(loaded.stats.cache_misses.values())

    @compiled()
    def twice(values: np.ndarray) -> float:
        return 2.0 * loaded(values)

    twice._cache.disable()
    assert twice(np.arange(5.0)) == 20.0
    assert sum(loaded.stats.cache_hits.values()) == 1
