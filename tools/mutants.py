"""Measure the fraction of random faults that the suite detects: `python -m tools.mutants`.

Each mutant is one small change of planning, geometry, servo or readers, chosen by the seed. The
tests of its package run first, then those of packages above it; the first failure kills the mutant.
`--tests` names the tests of another commit, and `--only` a list of mutants, such as survivors, to
compare two suites without running both on all mutants.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "src" / "armcontour"
LONGEST = 1200  # timeout for a mutant's tests; the mutant then counts as killed [s]
# Tests by package, the nearest first. Names are patterns.
TESTS = {
    "planning": (
        *("planning", "paper", "golden", "oracle/test_optimal_*.py", "oracle/test_jerk_*.py"),
        *("oracle/test_torque_*.py", "oracle/test_laps.py", "properties/test_*timing.py"),
    ),
    "geometry": (
        "geometry",
        "program",
        "planning/tracing",
        "golden",
        "properties/test_rounding*.py",
    ),
    "robot/servo": (
        *("robot/servo", "simulation", "control/compensation", "paper", "golden"),
        "oracle/test_servo*.py",
    ),
    "files/drawings": ("files/drawings", "oracle/test_gcode.py", "properties/test_broken_files.py"),
    "files/robots": ("files/robots", "robot", "properties/test_broken_files.py"),
}
SWAPS: dict[type[ast.AST], str] = {
    **{ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"},
    **{ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="},
    **{ast.And: "or", ast.Or: "and"},
}
NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all"}
NAMES |= {"sin": "cos", "cos": "sin", "floor": "ceil", "ceil": "floor", "all": "any"}


class Mutant(NamedTuple):
    """A change at one position of a file."""

    package: str
    file: str
    line: int
    begin: int
    end: int
    text: str


def mutants_of(package: str, file: Path) -> list[Mutant]:
    """Return all possible changes of a file."""
    source = file.read_text(encoding="utf-8")
    rows = source.splitlines()
    mutants = []

    def add(line: int, begin: int, end: int, text: str) -> None:
        name = str(file.relative_to(SOURCES))
        mutants.append(Mutant(package, name, line, begin, end, text))

    def between(first: ast.expr, second: ast.expr, operator: ast.AST) -> None:
        text = SWAPS.get(type(operator))
        if text and first.end_lineno == second.lineno and rows[second.lineno - 1].isascii():
            begin = first.end_col_offset or 0
            end = second.col_offset
            gap = rows[second.lineno - 1][begin:end]
            if not set(gap) & set("()#"):
                add(second.lineno, begin, end, f" {text} ")

    for node in _nodes_of_functions(source):
        if isinstance(node, ast.BinOp):
            between(node.left, node.right, node.op)
        elif isinstance(node, ast.Compare):
            between(node.left, node.comparators[0], node.ops[0])
        elif isinstance(node, ast.BoolOp):
            between(node.values[0], node.values[1], node.op)
        elif isinstance(node, ast.Call):
            name = node.func
            last = name.attr if isinstance(name, ast.Attribute) else getattr(name, "id", "")
            if last in NAMES and name.end_col_offset:
                end = name.end_col_offset
                add(name.end_lineno or 0, end - len(last), end, NAMES[last])
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            end = node.end_col_offset or 0
            if rows[node.lineno - 1][node.col_offset : end].replace(".", "").isdigit():
                add(node.lineno, node.col_offset, end, f"({node.value!r} + 1)")
    return sorted(set(mutants))


def _nodes_of_functions(source: str) -> Iterator[ast.AST]:
    """Yield all nodes in the bodies of functions; those of inner functions more than once."""
    for function in ast.walk(ast.parse(source)):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                yield from ast.walk(statement)


def draw(count: int, seed: int) -> list[Mutant]:
    """Draw random mutants, the same number for each package."""
    chance = random.Random(seed)
    drawn = []
    for package in TESTS:
        files = sorted((SOURCES / package).rglob("*.py"))
        all_of = [x for file in files for x in mutants_of(package, file)]
        drawn += chance.sample(all_of, count // len(TESTS))
    return drawn


def importers(file: str) -> set[str]:
    """Return the modules whose compiled functions may contain a file's code."""
    texts = {
        ".".join(["armcontour", *x.relative_to(SOURCES).with_suffix("").parts]): x.read_text(
            "utf-8"
        )
        for x in SOURCES.rglob("*.py")
    }
    texts = {name: text for name, text in texts.items() if "@compiled" in text}
    modules = {".".join(["armcontour", *Path(file).with_suffix("").parts])} & {*texts}
    while True:
        further = {
            name
            for name, text in texts.items()
            if name not in modules and any(f"from {x} import" in text for x in modules)
        }
        if not further:
            return modules
        modules |= further


class Slot:
    """Copy of the sources in which mutants are tried one after another.

    Args:
        place: Its folder, which must not change, because compiled functions depend on the path.
    """

    def __init__(self, folder: Path) -> None:
        self.sources, self.clean, self.cache = (folder / x for x in ("src", "clean", "cache"))
        shutil.rmtree(self.sources, ignore_errors=True)
        shutil.copytree(ROOT / "src", self.sources, ignore=shutil.ignore_patterns("__pycache__"))
        self.clean.mkdir(exist_ok=True)
        self._run([sys.executable, "-m", "armcontour", "compile"], ROOT, self.clean)

    def is_killed(self, mutant: Mutant, tests: Path) -> bool:
        """Return whether a test fails with the mutant."""
        shutil.rmtree(self.cache, ignore_errors=True)
        shutil.copytree(self.clean, self.cache)
        for module in importers(mutant.file):
            for cached in self.cache.rglob(f"{module.rpartition('.')[2]}.*"):
                cached.unlink()
        file = self.sources / "armcontour" / mutant.file
        text = file.read_text(encoding="utf-8")
        rows = text.splitlines(keepends=True)
        row = rows[mutant.line - 1]
        rows[mutant.line - 1] = row[: mutant.begin] + mutant.text + row[mutant.end :]
        file.write_text("".join(rows), encoding="utf-8")
        folders = [str(file) for x in TESTS[mutant.package] for file in sorted(tests.glob(x))]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *folders]
        try:
            return self._run(command, tests.parent, self.cache) != 0
        except subprocess.TimeoutExpired:
            return True
        finally:
            file.write_text(text, encoding="utf-8")

    def _run(self, command: list[str], folder: Path, cache: Path) -> int:
        path = os.pathsep.join([str(self.sources), str(folder)])
        environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(cache)}
        ended = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, timeout=LONGEST
        )
        return ended.returncode


def main() -> None:
    """Try the mutants, and print and write the survivors."""
    parser = argparse.ArgumentParser(prog="python -m tools.mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", type=Path, default=ROOT / "tests", help="the tests to judge")
    parser.add_argument("--only", type=Path, help="a file of mutants that --out has written")
    parser.add_argument("--out", type=Path, required=True, help="file for the survivors")
    parser.add_argument("--slots", type=int, default=2, help="number of parallel copies")
    options = parser.parse_args()
    if options.only:
        remaining = [Mutant(*x) for x in json.loads(options.only.read_text())]
    else:
        remaining = draw(options.count, options.seed)
    total = len(remaining)
    survivors = list[Mutant]()

    def work(k: int) -> None:
        slot = Slot(ROOT / ".armcontour" / "mutants" / str(k))
        while remaining:
            mutant = remaining.pop(0)
            killed = slot.is_killed(mutant, options.tests.resolve())
            if not killed:
                survivors.append(mutant)
            location = f"{mutant.file}:{mutant.line}: {mutant.text.strip()}"
            print("killed  " if killed else "survives", location, flush=True)

    with ThreadPoolExecutor(options.slots) as pool:
        list(pool.map(work, range(options.slots)))
    options.out.write_text(json.dumps(survivors))
    print(f"{total - len(survivors)} of {total} killed")


if __name__ == "__main__":
    main()
