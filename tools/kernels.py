"""`python -m tools.kernels`: write src/armcontour/core/kernels.txt anew.

The list has the argument types with which compiled functions are called by a run on a plane arm, by
a run on an arm in space, and by the tests. `armcontour compile` compiles it. Each of the three runs
in a process without cached functions, which records the functions that it compiles.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numba import types

ROOT = Path(__file__).parents[1]
LIST = ROOT / "src" / "armcontour" / "core" / "kernels.txt"
RUNS = {
    "plane": ["run", str(ROOT / "src" / "armcontour" / "jobs" / "library" / "paper.yaml")],
    "space": ["run", str(ROOT / "examples" / "drawings" / "gasket.dxf"), "--cell", "ur5e"],
}
TESTS = "-"


def to_text(arguments: Sequence[Any]) -> str:
    """Types of arguments as text for `armcontour.core.compilation.from_text`.

    Raises:
        ValueError: A type that has no text.
    """
    return ", ".join(map(_text, arguments))


def _text(kind: Any) -> str:
    """One type as text."""
    if isinstance(kind, types.Array):
        axes = {
            "C": [":"] * (kind.ndim - 1) + ["::1"],
            "F": ["::1"] + [":"] * (kind.ndim - 1),
            "A": [":"] * kind.ndim,
        }[kind.layout]
        text = f"{_text(kind.dtype)}[{', '.join(axes)}]"
        return text if kind.mutable else f"const({text})"
    if isinstance(kind, types.BaseNamedTuple):
        parts = "".join(f", {_text(x)}" for x in kind)
        made = kind.instance_class
        return f'named("{made.__module__}", "{made.__qualname__}"{parts})'
    if isinstance(kind, types.BaseTuple):
        return f"Tuple(({''.join(f'{_text(x)}, ' for x in kind)}))"
    if isinstance(kind, types.Literal):
        return f"literal({kind.literal_value!r})"
    if isinstance(kind, types.Omitted):
        return f"Omitted({kind.value!r})"
    if kind == types.boolean:
        # Its own name differs between versions of numba.
        return "boolean"
    if str(kind) == "Vector" or getattr(types, str(kind), None) == kind:
        return str(kind)
    raise ValueError(f"The type {kind} of an argument has no text yet.")


def calls() -> set[str]:
    """Calls from Python to compiled functions of the package in this process."""
    from armcontour.core.kernel_cache import KERNELS, is_inner

    found = set()
    for (module, name), kernel in KERNELS.items():
        if not module.startswith("armcontour.") or is_inner(kernel):
            continue
        for arguments in kernel.overloads:
            found.add(f"{module}.{name}({to_text(arguments)})")
    return found


def unlisted() -> set[str]:
    """Calls in this process that the list lacks."""
    return calls() - {x.partition(" ")[2] for x in LIST.read_text(encoding="utf-8").splitlines()}


def record(run: str, arguments: list[str], out: Path) -> None:
    """Run a command of armcontour, or tests, and write the functions compiled meanwhile."""
    from numba.core import event

    from armcontour.core import compilation
    from armcontour.core.kernel_cache import is_inner

    # Disable ahead-of-time compilation.
    compilation.LIST = Path(os.devnull)
    recorded: dict[str, None] = {}

    class Listener(event.Listener):
        """Records functions of the package."""

        def on_start(self, event: Any) -> None:
            """Required by numba."""

        def on_end(self, event: Any) -> None:
            """Record a function, unless only its callers are compiled."""
            dispatcher = event.data["dispatcher"]
            function = dispatcher.py_func
            if function.__module__.startswith("armcontour.") and not is_inner(dispatcher):
                text = to_text(event.data["args"])
                recorded[f"{function.__module__}.{function.__name__}({text})"] = None

    event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]
    if run == TESTS:
        import pytest

        pytest.main(["-q", "-n", "0", "-p", "no:cacheprovider", *arguments])
    else:
        from armcontour.cli.commands import program_for

        program_for()(arguments, standalone_mode=False)
    out.write_text("\n".join(recorded), encoding="utf-8")


def main() -> int:
    """Write the list."""
    parser = argparse.ArgumentParser(prog="python -m tools.kernels", description=__doc__)
    parser.add_argument(
        "what", nargs="*", help="plane, space, or files of tests, whose calls are added; or all"
    )
    if sys.argv[1:2] == ["--record"]:
        run, out, *arguments = sys.argv[2:]
        record(run, arguments, Path(out))
        return 0
    options = parser.parse_args()
    requested = {x: RUNS[x] for x in options.what or RUNS if x in RUNS}
    tests = [x for x in options.what if x not in RUNS] if options.what else ["tests", "tests/slow"]
    if tests:
        requested[TESTS] = tests
    tags: dict[str, set[str]] = {}
    for line in LIST.read_text(encoding="utf-8").splitlines() if options.what else []:
        runs, _, call = line.partition(" ")
        if remaining := set(runs.split(",")) - set(requested) | ({TESTS} & set(runs.split(","))):
            tags[call] = remaining
    for run, arguments in requested.items():
        for call in _record_in_process(run, arguments):
            tags.setdefault(call, set()).add(run)
    lines = [f"{','.join(sorted(runs))} {call}" for call, runs in sorted(tags.items())]
    LIST.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


def _record_in_process(run: str, arguments: list[str]) -> list[str]:
    """Record a run in a separate process without cached functions; returns the calls."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "calls.txt"
        command = [sys.executable, "-m", "tools.kernels", "--record", run, str(out), *arguments]
        if run != TESTS:
            command += ["--out", str(Path(name) / "results")]
        cold = {"NUMBA_CACHE_DIR": str(Path(name) / "cold")}
        subprocess.run(command, check=True, cwd=ROOT, env=os.environ | cold)
        return out.read_text(encoding="utf-8").splitlines()


if __name__ == "__main__":
    sys.exit(main())
