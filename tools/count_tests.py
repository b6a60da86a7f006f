"""Write the table of docs/testing.md anew: how many tests judge what.

`python tools/count_tests.py` asks pytest for all tests, without running them, and needs what they
need (`armcontour[test]`). A test that runs on many inputs counts once for each of them.
"""

from __future__ import annotations

import datetime
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "testing.md"
BEGIN, END = "<!-- counts: python tools/count_tests.py -->", "<!-- end of counts -->"
# What is judged, and the places of its tests: folders, or files whose names begin so.
GROUPS = {
    "Geometry of paths, programs of contours": ("tests/geometry/", "tests/program/"),
    "Arms, tracing, motion": ("tests/arms/", "tests/tracing/", "tests/motion/"),
    "Timing": ("tests/timing/",),
    "Servo, compensation, execution, learning": (
        "tests/servo/",
        "tests/drives/",
        "tests/compensation/",
        "tests/execution/",
        "tests/learning/",
    ),
    "Evaluation and `check`": ("tests/evaluation/",),
    "Identification": ("tests/identification/",),
    "Certificates, robustness, clearance, placement": (
        "tests/certification/",
        "tests/robustness/",
        "tests/clearance/",
        "tests/placement/",
    ),
    "Files that are read and written": ("tests/io/",),
    "Jobs, batches, reports": ("tests/jobs/", "tests/batches/", "tests/report/"),
    "Command line": ("tests/cli/",),
    "Studio: server and its security": ("tests/studio/",),
    "The Studio in a real browser": ("tests/browser/",),
    "Oracles: second implementations": ("tests/oracle/",),
    "Published figures, and misprints": ("tests/golden/",),
    "Properties (Hypothesis), first cases of soaks": ("tests/properties/",),
    "Pages, examples, public names, errors, parts that all share": ("tests/test_",),
}


def count() -> Counter[str]:
    """Number of tests of every group."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-qq", "-p", "no:cacheprovider"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    files = re.findall(r"^(tests/\S+\.py): (\d+)$", done.stdout, re.MULTILINE)
    if done.returncode or not files:
        sys.exit(f"pytest could not collect the tests:\n{done.stdout[-2000:]}{done.stderr}")
    found: Counter[str] = Counter()
    for file, number in files:
        found[group_of(file)] += int(number)
    return found


def group_of(file: str) -> str:
    """The group of a file of tests."""
    found = [name for name, places in GROUPS.items() if file.startswith(places)]
    if len(found) != 1:
        sys.exit(f"{file} is in the groups {found}; GROUPS must have it once.")
    return found[0]


def table(counts: Mapping[str, int]) -> str:
    """The table, with where the tests are, and when they were counted."""
    rows = ["| what is judged | tests | in |", "|---|---|---|"]
    for name, places in GROUPS.items():
        where = ", ".join(f"`{x}`" for x in places if (ROOT / x).is_dir() or x.endswith("_"))
        rows.append(f"| {name} | {counts[name]:,} | {where} |")
    rows.append(f"| **together** | **{sum(counts.values()):,}** | |")
    said = f"Counted on {datetime.date.today()}, version {version('armcontour')}."
    return "\n".join([*rows, "", said])


def main() -> None:
    """Count, and write the table into the page."""
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n{table(count())}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
