"""Judge random problems: `python -m soak [TOPIC] [--count N]`; without a topic, of all topics.

Each wrong outcome is printed with its seed, which reproduces it. The exit code is then 1.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
import sys
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice

from soak import Outcome

# The function that judges the problem of a seed, and how many problems are usual.
TOPICS = {
    "timing": ("soak.timing:run", 100_000),
    "one-joint": ("soak.one_joint:run", 800),
    "many-points": ("soak.many_points:run", 9),
    "jerk": ("soak.jerk:run", 600),
    "jerk-tool": ("soak.jerk:run_tool", 200),
    "jerk-oracle": ("tests.oracle.jerk_optimum:run", 12),
    "jerk-moves": ("soak.jerk:run_move", 1000),
    "shaping": ("soak.shaping:run", 2000),
    "shaping-oracle": ("tests.oracle.shaped_optimum:run", 200),
    "corners": ("soak.corners:run", 10_000),
    "off-drawing": ("soak.off_drawing:run", 60),
    "kerf": ("soak.kerf:run", 2000),
    "outputs": ("soak.outputs:run", 600),
    "resuming": ("soak.resuming:run", 40),
    "clearance": ("soak.clearance:run", 10_000),
    "certificates": ("soak.certificates:run", 100),
    "boxes": ("soak.boxes:run", 24),
    "check": ("soak.check:run", 4000),
    "compensations": ("soak.compensations:run", 50),
    "learning": ("soak.learning:run", 600),
    "learning-servos": ("soak.learning:run_wrong_model", 200),
    "learning-loops": ("soak.loops:run", 24),
    "learning-exact": ("soak.loops:run_exact", 12),
    "expectations": ("soak.expectations:run", 24),
    "identification": ("soak.identification:run", 2000),
    "readers": ("soak.readers:run", 200_000),
    "interrupts": ("soak.interrupts:run", 400),
    "playing": ("soak.playing:run", 250),
    "failures": ("soak.failures:run", 420),
    "studio": ("soak.studio:run", 1),
    "calls": ("soak.calls:run", 60_000),
}
# Allowed shares of 95 % intervals that contain the true value.
COVERED = (0.90, 0.99)


def judge(task: tuple[str, int]) -> tuple[int, Outcome, float]:
    """Judge the problem of a seed; any exception or warning is wrong."""
    place, seed = task
    module, _, name = place.partition(":")
    run = getattr(importlib.import_module(module), name)
    begun = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Limits of jerk add")
        warnings.filterwarnings("ignore", "Limits are above those of the arm")
        try:
            outcome = run(seed)
        except Exception as error:  # noqa: BLE001 - every crash is a finding
            outcome = Outcome(result="crash", notes=[f"{type(error).__name__}: {error}"])
    return seed, outcome, time.perf_counter() - begun


def judge_all(
    place: str, seeds: range, jobs: int, seconds: float
) -> Iterator[tuple[int, Outcome, float]]:
    """Judge the problems of seeds in several processes, until the time is over."""
    begun = time.monotonic()
    tasks = iter((place, seed) for seed in seeds)
    if jobs == 1:
        yield from map(judge, tasks)
        return
    with ProcessPoolExecutor(jobs) as pool:
        while time.monotonic() - begun < seconds and (some := list(islice(tasks, 20 * jobs))):
            yield from pool.map(judge, some)


def uncovered(hits: dict[str, list[bool]]) -> int:
    """Print how many intervals hold the true value; returns how many names miss the bar."""
    missed = 0
    for name, held in sorted(hits.items()):
        share = sum(held) / len(held)
        slack = 2 * math.sqrt(0.05 * 0.95 / len(held))
        bad = not COVERED[0] - slack <= share <= COVERED[1] + slack
        missed += bad
        print(f"  {name:44} {share:6.1%} of {len(held)} held{', outside the bar' if bad else ''}")
    return missed


def soak(topic: str, options: argparse.Namespace) -> int:
    """Judge the problems of a topic; returns how many are wrong."""
    place, usual = TOPICS[topic]
    seeds = range(options.first_seed, options.first_seed + (options.count or usual))
    counts: Counter[tuple[str, str]] = Counter()
    hits: dict[str, list[bool]] = defaultdict(list)
    wrong = 0
    worst = 0.0
    slowest = (0.0, -1)
    for seed, outcome, seconds in judge_all(place, seeds, options.jobs, options.seconds):
        counts[outcome.kind, outcome.result] += 1
        wrong += bool(outcome.notes)
        worst = max(worst, outcome.worst)
        slowest = max(slowest, (seconds, seed))
        for name, held in outcome.covered.items():
            hits[name].append(held)
        for note in outcome.notes:
            print(f"seed {seed} ({outcome.kind}) {outcome.result}: {note}", flush=True)
    for (kind, result), count in sorted(counts.items()):
        print(f"  {kind:24} {result:16} {count:7d}")
    wrong += uncovered(hits)
    ratio = f", largest ratio 1 {worst - 1:+.2e}" if worst else ""
    print(
        f"{topic}: {sum(counts.values())} problems, {wrong} wrong{ratio}; "
        f"slowest: seed {slowest[1]}, {slowest[0]:.1f} s",
        flush=True,
    )
    return wrong


def main() -> int:
    """Judge the topics that are named, or all; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak", description=__doc__)
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help=", ".join(TOPICS))
    parser.add_argument("--count", type=int, help="how many problems")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first one")
    parser.add_argument("--seconds", type=float, default=math.inf, help="time per topic")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    options = parser.parse_args()
    unknown = sorted(set(options.topics) - set(TOPICS))
    if unknown:
        parser.error(f"there is no topic {unknown[0]}: they are {', '.join(TOPICS)}")
    # Linear algebra uses one thread, because several would only wait for each other.
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    return int(sum(soak(x, options) for x in options.topics or TOPICS) > 0)


if __name__ == "__main__":
    sys.exit(main())
