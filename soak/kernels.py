"""`python -m soak.kernels`: write src/armcontour/_kernels.txt anew.

The list says what compiled functions are called with: by a run on a plane arm, by one on an arm in
space, and by the tests; and what these functions call others with. `armcontour warm` compiles it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from armcontour._signatures import from_text, to_text

ROOT = Path(__file__).parents[1]
LIST = ROOT / "src" / "armcontour" / "_kernels.txt"
RUNS = {
    "plane": ["demo"],
    "space": ["run", str(ROOT / "examples" / "drawings" / "gasket.dxf"), "--cell", "ur5e"],
}


def calls() -> set[str]:
    """Calls of compiled functions in this process: functions with the types of arguments."""
    from armcontour._kernels import KERNELS

    return {
        f"{module}.{name}({to_text(arguments)})"
        for (module, name), kernel in KERNELS.items()
        if not kernel.targetoptions["no_cpython_wrapper"]
        for arguments in kernel.overloads
    }


def unlisted() -> set[str]:
    """Calls in this process that the list does not have."""
    return calls() - {x.partition(" ")[2] for x in LIST.read_text(encoding="utf-8").splitlines()}


def compiled_for(wanted: Iterable[str]) -> Iterator[str]:
    """Compile calls where nothing is compiled yet, and give all calls that this compiles."""
    from numba.core import event

    found = []

    class Listener(event.Listener):
        """Notes what is compiled; what a function calls comes before it."""

        def on_start(self, event: Any) -> None:
            """Nothing."""

        def on_end(self, event: Any) -> None:
            """Note a function of this package."""
            function = event.data["dispatcher"].py_func
            if function.__module__.startswith("armcontour."):
                arguments = to_text(event.data["args"])
                found.append(f"{function.__module__}.{function.__name__}({arguments})")

    event.register("numba:compile", Listener())
    for call in wanted:
        function, _, arguments = call.partition("(")
        module, _, name = function.rpartition(".")
        kernel = getattr(import_module(module), name)
        kernel.compile(from_text(arguments.removesuffix(")")))
    return iter(dict.fromkeys(found))


def _in_process(task: str, folder: Path, lines: Iterable[str], *arguments: str) -> list[str]:
    """Do a task of this module in another process; gives the lines that it writes."""
    given, out = folder / "given.txt", folder / "found.txt"
    given.write_text("\n".join(lines), encoding="utf-8")
    command = [sys.executable, "-m", "soak.kernels", "--task", task, str(given), str(out)]
    own = {"NUMBA_CACHE_DIR": str(folder / "cold")} if task == "compile" else {}
    subprocess.run([*command, *arguments], check=True, cwd=ROOT, env=os.environ | own)
    return out.read_text(encoding="utf-8").splitlines()


def _run(arguments: list[str]) -> None:
    """Run a command of armcontour."""
    from armcontour.cli.commands import app

    app(arguments, standalone_mode=False)


def _test(arguments: list[str]) -> None:
    """Run the tests."""
    import pytest

    # The list is what is being made: it is not compared with.
    os.environ["ARMCONTOUR_RECORDING"] = "1"
    pytest.main(["-q", "-n", "0", *arguments])


def main() -> int:
    """Write the list."""
    parser = argparse.ArgumentParser(prog="python -m soak.kernels", description=__doc__)
    parser.add_argument("--tests", nargs="*", default=["tests"], help="tests to run; none: keep")
    parser.add_argument("--task", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("rest", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.task:
        task, before, out = given.task
        tasks: dict[str, Callable[[list[str]], None]] = {"run": _run, "test": _test}
        if task == "compile":
            found = compiled_for(Path(before).read_text(encoding="utf-8").splitlines())
        else:
            tasks[task](given.rest)
            found = iter(sorted(calls()))
        Path(out).write_text("\n".join(found), encoding="utf-8")
        return 0
    tags: dict[str, set[str]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        used = {
            run: _in_process("run", folder, [], *x, "--out", str(folder / run))
            for run, x in RUNS.items()
        }
        used["-"] = _in_process("test", folder, [], *given.tests) if given.tests else _before()
        for run, found in used.items():
            for call in _in_process("compile", folder, found):
                tags.setdefault(call, set()).add(run)
            shutil.rmtree(folder / "cold", ignore_errors=True)
    lines = [f"{','.join(sorted(runs))} {call}" for call, runs in sorted(tags.items())]
    LIST.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


def _before() -> list[str]:
    """Calls of the list as it is, of functions that are there still."""
    lines = LIST.read_text(encoding="utf-8").splitlines() if LIST.exists() else []
    return [x.partition(" ")[2] for x in lines]


if __name__ == "__main__":
    sys.exit(main())
