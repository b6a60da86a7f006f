"""`python -m soak.sampled`: how often 95 % intervals hold the truth where logs are samples.

A controller has a set-point every 8 ms and goes on to the next in a straight line, in a smooth
curve or in a step. The log has one, two or four samples an interval, at set-points or between them.
Gains, dead times and motions are drawn anew for every case; the simulation is that of `soak.joint`.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline

from armcontour.identification import Log, identify
from soak.identify import multisine
from soak.joint import move

INTERVAL = 8e-3
SECONDS = 10.0
NOISE = 2e-5
# Steps of the simulation in an interval.
FINE = 40
BETWEEN = ("linear", "cubic", "step")
MOTIONS = ("path", "multisine")
GRID = tuple(product(MOTIONS, BETWEEN, (1, 2, 4), (0.0, 0.25, 0.5, 0.75)))
# Share of the stated intervals that must hold the truth.
COVERED = 0.93


def sampled(motion, between, ratio, phase, seed, *, set_points=False):
    """A log with `ratio` samples an interval, a part `phase` of a sample late, and the truth."""
    rng = np.random.default_rng([seed, ratio, int(4 * phase), BETWEEN.index(between)])
    kp, kv, delay = rng.uniform(12, 40), rng.uniform(90, 250), rng.uniform(2e-3, 30e-3)
    n = int(SECONDS / INTERVAL)
    t = np.arange(n) * INTERVAL
    if motion == "path":
        way = np.cumsum(rng.uniform(-0.15, 0.15, 12))
        p = np.interp(t, np.linspace(0.5, t[-1] - 0.5, 12), way)
        width = int(0.12 / INTERVAL)
        for _ in range(2):
            p = np.convolve(np.pad(p, width, "edge"), np.ones(width) / width, "same")[width:-width]
    else:
        p = 5e-3 * multisine(t, 10.0, seed)
    fine = np.arange((n - 1) * FINE) * (INTERVAL / FINE)
    u = {
        "linear": lambda: np.interp(fine, t, p),
        "cubic": lambda: CubicSpline(t, p)(fine),
        "step": lambda: p[np.arange(len(fine)) // FINE],
    }[between]()
    q = move(fine, u, kp=kp, kv=kv, delay=delay, linear=between != "step", steps=1)
    every = FINE // ratio
    i = np.arange(round(phase * every), len(fine), every)
    log = Log(
        t=fine[i], command=u[i], measured=q[i] + NOISE * rng.normal(size=len(i)),
        interpolation="step" if between == "step" else None, set_points=set_points,
    )  # fmt: skip
    return log, (kp, kv, delay)


def case(task):
    """Of kp, kv and dead time: whether the interval holds the truth, and whether it is stated."""
    log, truth = sampled(*task)
    found = identify(log).joints[0].estimates
    return [(x.low <= y <= x.high, x.determined) for x, y in zip(found, truth, strict=False)]


def main() -> int:
    """Run it; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak.sampled", description=__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="seeds for each of the grid")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    given = parser.parse_args()
    tasks = [(*x, seed) for x in GRID for seed in range(given.seeds)]
    with ProcessPoolExecutor(given.jobs) as pool:
        found = np.array(list(pool.map(case, tasks)))
    for between, ratio in product(BETWEEN, (1, 2, 4)):
        some = found[[x[1] == between and x[2] == ratio for x in tasks]]
        _tell(f"{between}, {ratio} samples an interval", some)
    return int(_tell("all", found) < COVERED)


def _tell(name, found) -> float:
    """Print the coverage of all intervals and of stated ones; returns the latter."""
    held, stated = found[..., 0], found[..., 1]
    share = float(held[stated].mean()) if stated.any() else 1.0
    print(
        f"{name:32} {held.mean() * 100:5.1f} % of {held.size} hold the truth, {share * 100:5.1f} % "
        f"of {stated.sum()} determined ones"
    )
    return share


if __name__ == "__main__":
    sys.exit(main())
