"""`python -m soak.shapes`: shapes and judges many random jobs; exit code 1 if one goes wrong.

With `--oracle` it plans the jobs whose durations `soak.shaped_oracle` has found, and compares.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import armcontour as ac
from soak import shape_judge, shaped_oracle

# Bars: the gap to the oracle, median and 95th percentile.
MEDIAN, MOST = 0.005, 0.03


def read_durations() -> dict[int, float]:
    """Durations that the oracle has found [s], by seed."""
    kept = json.loads(shaped_oracle.KEPT.read_text())
    return {int(seed): duration for seed, duration in kept["durations"].items()}


def gap(seed: int) -> float:
    """Share of the oracle's duration by which a shaped motion of its job is longer."""
    job = shaped_oracle.draw(seed)
    path, arm = ac.Path.polyline(job.points), ac.load_arm("pmk3s")
    planned = ac.plan(path, arm, job.limits, method="shaped", tolerance=job.tolerance)
    return planned.duration / read_durations()[seed] - 1


def compare(seeds: Iterable[int], jobs: int | None) -> int:
    """Print the gaps to the oracle; returns the exit code."""
    seeds = list(seeds)
    with ProcessPoolExecutor(jobs) as pool:
        gaps = np.array(list(pool.map(gap, seeds)))
    for k in np.argsort(gaps)[::-1][:10]:
        print(f"seed {seeds[k]}: {gaps[k]:+.2%}")
    for name, of in (("all", slice(None)), ("centripetal", 1), ("without", 0)):
        own = gaps if name == "all" else gaps[np.array(seeds) % 2 == of]
        median, most = np.median(own), np.quantile(own, 0.95)
        print(f"{name:12} {len(own)} jobs: median {median:+.2%}, 95th percentile {most:+.2%}")
    return int(np.median(gaps) > MEDIAN or np.quantile(gaps, 0.95) > MOST)


def judge_all(seeds: range, jobs: int | None) -> int:
    """Shape and judge the problems of seeds, print what is wrong; returns the exit code."""
    counts: Counter[tuple[str, str]] = Counter()
    corners, gains, slowest = 0, [], (0.0, -1)
    with ProcessPoolExecutor(jobs) as pool:
        for outcome in pool.map(shape_judge.run, seeds, chunksize=4):
            counts[outcome.kind, outcome.result] += 1
            corners += outcome.corners
            slowest = max(slowest, (outcome.seconds, outcome.seed))
            starts = [x for name, x in outcome.durations.items() if name != "shaped"]
            if starts:
                gains.append(1 - outcome.durations["shaped"] / min(starts))
            if outcome.result == "wrong":
                print(f"seed {outcome.seed} ({outcome.kind}): {'; '.join(outcome.notes)}")
                sys.stdout.flush()
    for (kind, result), count in sorted(counts.items()):
        print(f"  {kind:16} {result:8} {count:5d}")
    print(f"slowest: seed {slowest[1]}, {slowest[0]:.2f} s")
    print(f"saved of the fastest start: {np.mean(gains):.2%} in the mean, {max(gains):.2%} at most")
    wrong = sum(n for (_, result), n in counts.items() if result == "wrong")
    print(f"{len(seeds)} jobs with {corners} corners, {wrong} wrong")
    return int(wrong > 0)


def main() -> int:
    """Run it; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak.shapes", description=__doc__)
    parser.add_argument("--count", type=int, default=2_000, help="how many jobs")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first one")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--oracle", action="store_true", help="compare with the oracle instead")
    given = parser.parse_args()
    if given.oracle:
        return compare(read_durations(), given.jobs)
    last = given.first_seed + given.count
    return judge_all(range(given.first_seed, last), given.jobs)


if __name__ == "__main__":
    sys.exit(main())
