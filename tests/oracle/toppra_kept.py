"""Durations by toppra, which are kept: it takes fifty times as long as the planner under test.

`python -m tests.oracle.toppra_kept` computes all of them again and compares, as the tests do with
some; its exit code is 1 if one has changed. With `--write` it writes them.
"""

import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

FILE = Path(__file__).with_name("toppra_durations.json")
# Versions of toppra and of its libraries may round differently; tests allow plans 1e-4 and more.
SAME = 1e-6

_KEPT: dict[str, dict[str, float]] = json.loads(FILE.read_text("utf-8"))


def recorded_duration(intervals, seed):
    """Duration of a problem by toppra on a number of intervals [s]."""
    return _KEPT[str(intervals)][str(seed)]


def _compute(case):
    """The duration by toppra itself."""
    from tests.oracle.test_torque_toppra import by_toppra

    intervals, seed = case
    return by_toppra(seed, intervals)


def main():
    """Compute all that the tests ask for, and compare or write."""
    from tests.oracle.test_torque_toppra import REFERENCES

    durations: dict[str, dict[str, float]] = {}
    largest = 0.0
    with ProcessPoolExecutor() as pool:
        for case, duration in zip(REFERENCES, pool.map(_compute, REFERENCES), strict=True):
            largest = max(largest, abs(duration / recorded_duration(*case) - 1))
            durations.setdefault(str(case[0]), {})[str(case[1])] = duration
    print(f"{len(REFERENCES)} durations; the largest change is {largest:.1e} of one")
    if "--write" in sys.argv[1:]:
        FILE.write_text(json.dumps(durations, indent=1) + "\n", encoding="utf-8")
    else:
        sys.exit(largest > SAME)


if __name__ == "__main__":
    main()
