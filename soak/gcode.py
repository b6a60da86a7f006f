"""Read random G-code programs, and interpret them a second time: `python -m soak.gcode [FILE ...]`.

Files that are specified are compared instead. The exit code is 1 if a program is refused although
it is valid by construction, or if a point, speed, tolerance or event differs.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections import Counter
from pathlib import Path
from types import ModuleType

from armcontour.core.errors import InvalidInput
from armcontour.files.drawings.path_reader import read_path
from armcontour.files.drawings.read_options import ReadOptions

ORACLES = Path(__file__).parents[1] / "tests" / "oracle"


def load(name: str) -> ModuleType:
    """Load a module of tests/oracle."""
    spec = importlib.util.spec_from_file_location(name, ORACLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def judge(text: str, judges: ModuleType) -> str:
    """Compare a random program: return "equal", or how it differs."""
    try:
        program = judges.read(text)
    except InvalidInput as error:
        return f"refused: {error}"
    return compare(program, text, judges)


def compare(program: object, text: str, judges: ModuleType) -> str:
    """Compare with what the second interpreter draws."""
    try:
        judges.compare(program, judges.oracle.interpret(text))
    except (AssertionError, ArithmeticError, LookupError, ValueError) as error:
        return f"differs: {type(error).__name__} {error}".splitlines()[0]
    return "equal"


def judge_file(file: Path, judges: ModuleType) -> str:
    """Read a file that may be anything; a refusal is not a fault."""
    try:
        program = read_path(file, ReadOptions(repair_vertices=0.0))
    except InvalidInput:
        return "refused"
    text = file.read_bytes().decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    return compare(program, text.removeprefix("\xef\xbb\xbf"), judges)


def main() -> int:
    """Judges programs or files; 1 if any is wrong."""
    parser = argparse.ArgumentParser(prog="python -m soak.gcode", description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="G-code files; default: random ones")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=20_000)
    options = parser.parse_args()
    judges = load("test_gcode")
    counts: Counter[str] = Counter()
    if options.files:
        verdicts = ((str(x), judge_file(x, judges)) for x in options.files)
        good = {"equal", "refused"}
    else:
        seeds = range(options.first_seed, options.first_seed + options.count)
        verdicts = ((f"seed {x}", judge(judges.Author(x).text(), judges)) for x in seeds)
        good = {"equal"}
    wrong = 0
    for name, verdict in verdicts:
        counts[verdict.split(":")[0]] += 1
        if verdict not in good:
            wrong += 1
            print(f"{name}: {verdict}")
    print(", ".join(f"{n} {verdict}" for verdict, n in sorted(counts.items())))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
