"""The list of what compiled functions are called with, and compiling it ahead."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from inspect import signature
from pathlib import Path
from threading import Thread

import pytest

import armcontour
from armcontour._kernels import KERNELS
from armcontour._signatures import from_text, to_text
from armcontour._warming import LIST, Kernel, Order, read_list

PACKAGE = Path(armcontour.__file__).parent


@pytest.fixture(scope="module")
def kernels():
    """All compiled functions of the package, by module and name."""
    for file in PACKAGE.rglob("_*.py"):
        if "_kernels import" in file.read_text(encoding="utf-8"):
            place = file.relative_to(PACKAGE.parent).with_suffix("")
            import_module(".".join(place.parts))
    return {key: x for key, x in KERNELS.items() if key[0].startswith("armcontour.")}


def test_every_call_of_the_list_fits_its_function(kernels):
    for listed in read_list("all"):
        kernel = kernels[listed.key]
        for text in listed.arguments:
            kinds = from_text(text)
            assert to_text(kinds) == text
            assert len(kinds) == len(signature(kernel.py_func).parameters), listed


def test_every_function_that_python_calls_is_listed(kernels):
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
    first = order.take()
    assert first is not None
    taken = []

    def take_all():
        while (item := order.take()) is not None:
            taken.append(item)
            order.finish(item, 1)

    other = Thread(target=take_all)
    other.start()
    # Nothing that calls the first one comes before it is done.
    other.join(0.2)
    before = list(taken)
    order.finish(first, 0)
    other.join(10.0)
    assert not other.is_alive()
    assert len(taken) + 1 == len(listed) and order.compiled == len(taken)
    called = kernels[first.key].py_func.__name__
    for item in before:
        assert called not in kernels[item.key].py_func.__code__.co_names
    place = {item.key: k for k, item in enumerate([first, *taken])}
    for item in taken:
        function = kernels[item.key].py_func
        for name in function.__code__.co_names:
            callee = getattr(function.__globals__.get(name), "py_func", None)
            key = (getattr(callee, "__module__", None), name)
            assert place.get(key, -1) <= place[item.key]


def test_a_process_that_ends_ends_the_work():
    order = Order([Kernel("armcontour.program._inside", "winding", ("float64",))], lambda x: None)
    assert order.take() is not None
    order.give_up()
    assert order.take() is None


@pytest.mark.parametrize("ends", [True, False])
def test_what_somebody_waits_for_comes_next_and_is_waited_for(kernels, ends):
    steps = []
    order = Order(read_list("usual"), steps.append, always=False)
    first = order.take()
    order.finish(first, 1)
    assert not steps
    wanted = kernels["armcontour.evaluation._following", "follow"].py_func
    other = Thread(target=order.wait, args=(wanted,))
    other.start()
    while not order.waits:
        other.join(0.01)
    taken = [order.take()]
    if not ends:
        order.give_up()
    while ends and taken[-1].name != wanted.__name__:
        assert other.is_alive()
        order.finish(taken[-1], 1)
        taken.append(order.take())
    if ends:
        order.finish(taken[-1], 1)
        # Nothing else came before it but what it calls.
        assert {x.module for x in taken} <= {
            "armcontour.evaluation._following",
            "armcontour.geometry._nearest",
        }
        assert len(steps) == len(taken)
    other.join(10.0)
    assert not other.is_alive() and not order.waits
    # Nobody waits for others.
    order.wait(len)


WARM = """
import sys
from pathlib import Path
from armcontour import _warming
_warming.LIST = Path(sys.argv[1])
steps = []
found = _warming.warm("all", steps.append)
print(found.functions, found.compiled, found.folder, *map(str, steps), sep="|")
"""


def test_what_is_compiled_is_not_compiled_again(tmp_path):
    text = "- armcontour.program._inside.winding(float64, float64, float64[:, ::1])\n"
    gone = "- armcontour.program._inside.gone(float64)\n"
    (tmp_path / "list.txt").write_text(text + gone)
    own = {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": str(PACKAGE.parent)}

    def warm():
        command = [sys.executable, "-c", WARM, str(tmp_path / "list.txt")]
        done = subprocess.run(command, capture_output=True, text=True, env=os.environ | own)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip().split("|")

    functions, compiled, folder, *steps = warm()
    assert (functions, compiled) == ("2", "1") and folder.startswith(str(tmp_path / "kept"))
    assert steps[0].startswith("compiling, once: 2 functions in ")
    assert steps[-1].endswith(": program._inside.winding")
    # The second time it says nothing of its steps.
    assert warm() == ["2", "0", folder]
    for file in tmp_path.rglob("*.nbi"):
        file.unlink()
    assert warm()[1] == "1"


def test_the_list_is_sorted_and_says_what_runs_need_what():
    lines = LIST.read_text(encoding="utf-8").splitlines()
    calls = [x.split(" ", 1)[1] for x in lines]
    assert calls == sorted(set(calls))
    assert {x.split(" ", 1)[0] for x in lines} <= {
        ",".join(x)
        for x in (["-"], ["-", "plane"], ["-", "plane", "space"], ["-", "space"])
        + (["plane"], ["space"], ["plane", "space"])
    }
