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

_KEPT: dict[str, dict[str, float]] = json.loads(FILE.read_text("utf-8")) if FILE.exists() else {}


def recorded_duration(kind, intervals, seed):
    """The duration that toppra found [s].

    Args:
        kind: "joint" or "torque", the limits of the problem.
        intervals: Those of toppra's grid.
        seed: That of the problem.
    """
    return _KEPT[f"{kind} limits, {intervals} intervals"][str(seed)]


def _compute(case):
    """The duration by toppra itself."""
    from tests.oracle import test_optimal_toppra, test_torque_toppra

    kind, intervals, seed = case
    by = {"joint": test_optimal_toppra.by_toppra, "torque": test_torque_toppra.by_toppra}
    return by[kind](seed, intervals)


def main():
    """Compute all that the tests ask for, and compare or write."""
    from tests.oracle import test_optimal_toppra, test_torque_toppra

    cases = [*test_optimal_toppra.REFERENCES, *test_torque_toppra.REFERENCES]
    durations: dict[str, dict[str, float]] = {}
    largest = 0.0
    with ProcessPoolExecutor() as pool:
        for case, duration in zip(cases, pool.map(_compute, cases), strict=True):
            kind, intervals, seed = case
            name = f"{kind} limits, {intervals} intervals"
            before = _KEPT.get(name, {}).get(str(seed), duration)
            largest = max(largest, abs(duration / before - 1))
            durations.setdefault(name, {})[str(seed)] = duration
    print(f"{len(cases)} durations; the largest change is {largest:.1e} of one")
    if "--write" in sys.argv[1:]:
        FILE.write_text(json.dumps(durations, indent=1) + "\n", encoding="utf-8")
    else:
        sys.exit(largest > SAME or durations.keys() != _KEPT.keys())


if __name__ == "__main__":
    main()
