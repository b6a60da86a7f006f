"""`python -m soak.jerk`: plans with limits of jerk, judged by formulas of their own.

Random joint paths are planned and judged, also with limits of the tool; some are planned again with
fewer iterations than the search needs, and in other units. Straight moves are compared with Ruckig,
splines and the paper's job with what an oracle found. Exit code 1 if anything goes wrong.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import armcontour as ac
from soak import jerk_oracle, jerk_tools, straight_moves
from soak.jerk_judge import MOST_ITERATIONS, Outcome, interrupted, judge, run, started
from soak.jerk_problems import draw

# Iterations after which searches are ended.
EARLY = (1, 2, 3, 5, 8, 12, 20, 30)
# One problem in so many is planned so, and in other units.
AGAIN = 10
UNITS = ({"q": 1e3}, {"q": 1e-3}, {"s": 1e3}, {"s": 1e-3}, {"t": 1e3}, {"t": 1e-3})
SAME = 1e-6
# Random starts of the search, and how much their durations may differ.
STARTS, SPREAD = 3, 1e-4
# Bars of the splines: against the oracle, and against the plan without limits of jerk.
NEAR = 1e-3
WITHOUT = {"10": 0.03, "50": 0.007}


def early(seed: int) -> list[str]:
    """What is wrong with the plans of a seed's problem when searches end early."""
    problem, notes = draw(seed), []
    for iterations in EARLY:
        with interrupted(iterations):
            planned = ac.plan(problem.path, limits=problem.limits)
        notes += [f"{iterations} iterations: {x}" for x in judge(planned, problem.limits)[0]]
    return notes


def units(seed: int) -> list[str]:
    """What is wrong with the plans of a seed's problem in other units."""
    problem, notes = draw(seed), []
    own = ac.plan(problem.path, limits=problem.limits).duration
    for unit in UNITS:
        try:
            other = problem.scaled(**unit)
        except ac.InvalidInput:
            continue  # Numbers that limits may not have.
        found = ac.plan(other.path, limits=other.limits).duration / unit.get("t", 1.0)
        if abs(found / own - 1) > SAME:
            notes.append(f"units {unit}: {found / own - 1:+.1e} of the duration")
    return notes


def starts(seed: int) -> list[str]:
    """What is wrong with the plans of a seed's problem from random starts."""
    problem, rng = draw(seed), np.random.default_rng(seed)
    own = ac.plan(problem.path, limits=problem.limits).duration
    notes = []
    for _ in range(STARTS):
        with started(rng):
            found = ac.plan(problem.path, limits=problem.limits).duration
        if abs(found / own - 1) > SPREAD:
            notes.append(f"from a random start {found / own - 1:+.1e} of the duration")
    return notes


def spline_gaps() -> dict[str, tuple[float, float]]:
    """By how much plans of the splines are longer than the oracle's, and than those without jerk.

    Shares of the durations.
    """
    kept = jerk_oracle.read_durations()
    found = {}
    for name, path, limits in jerk_oracle.splines():
        duration = ac.plan(path, limits=limits).duration
        plain = ac.plan(path, limits=limits.replace(joint_jerk=None)).duration
        found[name] = duration / kept[name] - 1, duration / plain - 1
    return found


def paper_gaps() -> dict[str, float]:
    """By how much plans of the paper's job are longer than the oracle's, as shares."""
    kept, arm = jerk_oracle.read_durations(), ac.load_arm("pmk3s")
    return {
        name: ac.plan(path, arm, limits).duration / kept[name] - 1
        for name, path, limits in jerk_oracle.paper()
    }


CHECKS = {"ended early": early, "in other units": units, "from random starts": starts}


def _random(pool: ProcessPoolExecutor, run: Callable[[int], Outcome], seeds: range) -> int:
    """Judge random problems; returns how many went wrong."""
    counts: Counter[str] = Counter()
    worst, iterations = 0.0, []
    for outcome in pool.map(run, seeds, chunksize=4):
        counts[outcome.result] += 1
        worst = max(worst, outcome.worst)
        iterations.append(outcome.iterations)
        if outcome.failed:
            _say(f"seed {outcome.seed} ({outcome.kind}) {outcome.result}", outcome.notes)
    print(
        f"{len(seeds)} problems: {dict(counts)}; largest ratio 1 {worst - 1:+.2e}; iterations "
        f"{np.median(iterations):.0f} median, {max(iterations)} at most ({MOST_ITERATIONS})"
    )
    return counts["wrong"] + counts["crash"]


def _again(pool: ProcessPoolExecutor, seeds: range) -> int:
    """Plan again in each of these ways; returns how many went wrong."""
    wrong = 0
    for name, check in CHECKS.items():
        for seed, notes in zip(seeds, pool.map(check, seeds), strict=True):
            wrong += bool(notes)
            _say(f"seed {seed} {name}", notes)
        print(f"{len(seeds)} problems {name}")
    return wrong


def _moves(pool: ProcessPoolExecutor, count: int) -> int:
    """Compare straight moves with Ruckig; returns how many are out of the bar."""
    gaps = np.array(list(pool.map(straight_moves.gap, range(count), chunksize=8)))
    out = (gaps > straight_moves.BAR) | (gaps < -straight_moves.ROUNDING)
    for k in np.flatnonzero(out):
        print(f"straight move {k}: {gaps[k]:+.2e}")
    print(f"{count} straight moves: median {np.median(gaps):+.1e}, worst {gaps.max():+.1e}")
    return int(out.sum())


def _compare() -> int:
    """Compare splines and the paper's job with the oracle; returns how many are out of the bars."""
    wrong = 0
    for name, (above, longer) in spline_gaps().items():
        wrong += above > NEAR or longer > WITHOUT[name.split()[-1]]
        print(f"{name}: {above:+.1e} of the oracle, {longer:+.2%} of that without jerk")
    for name, above in paper_gaps().items():
        wrong += above > NEAR
        print(f"{name}: {above:+.1e} of the oracle")
    return wrong


def _say(what: str, notes: list[str]) -> None:
    if notes:
        print(f"{what}: {'; '.join(notes)}", flush=True)


def main() -> int:
    """Run it; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak.jerk", description=__doc__)
    parser.add_argument("--count", type=int, default=600, help="how many random problems")
    parser.add_argument("--tools", type=int, default=200, help="how many with limits of the tool")
    parser.add_argument("--moves", type=int, default=1000, help="how many straight moves")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    given = parser.parse_args()
    with ProcessPoolExecutor(given.jobs) as pool:
        wrong = _random(pool, run, range(given.count))
        wrong += _random(pool, jerk_tools.run, range(given.tools))
        wrong += _again(pool, range(0, given.count, AGAIN))
        wrong += _moves(pool, given.moves)
    return int(wrong + _compare() > 0)


if __name__ == "__main__":
    sys.exit(main())
