"""The list of what compiled functions are called with, and compiling it ahead."""

from importlib import import_module
from inspect import signature
from pathlib import Path

import pytest

import armcontour
from armcontour._kernels import KERNELS
from armcontour._signatures import from_text, to_text
from armcontour._warming import Order, read_list

PACKAGE = Path(armcontour.__file__).parent


@pytest.fixture(scope="module")
def kernels():
    """All compiled functions of the package, by module and name."""
    for file in PACKAGE.rglob("_*.py"):
        if "_kernels import" in file.read_text(encoding="utf-8"):
            place = file.relative_to(PACKAGE.parent).with_suffix("")
            import_module(".".join(place.parts))
    return {key: x for key, x in KERNELS.items() if key[0].startswith("armcontour.")}


def test_calls_of_the_list_fit_their_functions_and_all_that_python_calls_are_listed(kernels):
    for listed in read_list("all"):
        kernel = kernels[listed.key]
        for text in listed.arguments:
            kinds = from_text(text)
            assert to_text(kinds) == text
            assert len(kinds) == len(signature(kernel.py_func).parameters), listed
    listed = {x.key for x in read_list("all")}
    called = {key for key, x in kernels.items() if not x.targetoptions["no_cpython_wrapper"]}
    assert called - listed == {("armcontour._warming", "_kept")}


def test_usual_runs_leave_out_what_they_do_not_need():
    usual, everything = read_list("usual"), read_list("all")
    assert 0 < len(usual) < len(everything)
    names = {x.module for x in usual}
    assert "armcontour.servo._simulation" in names
    assert not any(".jerk." in x or ".robustness." in x for x in names)
    assert all("_newton" not in x.module for x in read_list("plane"))
    assert any("_newton" in x.module for x in read_list("space"))


def test_a_function_comes_after_those_that_it_calls(kernels):
    listed = read_list("usual")
    order = Order(listed, lambda step: None)
    taken = []
    while (item := order.take()) is not None:
        taken.append(item)
        order.finish(item, 1)
    assert len(taken) == len(listed) == order.compiled
    place = {item.key: k for k, item in enumerate(taken)}
    for item in taken:
        function = kernels[item.key].py_func
        for name in function.__code__.co_names:
            callee = getattr(function.__globals__.get(name), "py_func", None)
            key = (getattr(callee, "__module__", None), name)
            assert place.get(key, -1) <= place[item.key]
