"""`python -m soak.encoders`: how often 95 % intervals hold the truth, on encoders of few bits.

Gains, dead times, encoder zeros and noise are drawn anew for every seed. The logs come from a
simulation of its own (`soak.joint`), with the excitation that the guide recommends, or with an
older one that repeats every 2 s, so that the error of the encoder repeats too.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np

from armcontour import identification
from soak.identify import demand, multisine
from soak.joint import move

SECONDS = 20.0
INTERVAL = 2e-3
LIMIT = 20.0
HIGHEST = 25.0
BITS = (12, 14, 16, 19)
NOISES = (0.0, 5e-5)
EXCITATIONS = ("guide", "repeating")
NAMES = ("kp", "kv", "dead_time")
# Dry friction [rad/s²]: 7.5 % of the limit.
FRICTION = 1.5
# The bar for the recommended excitation, and what an older log may fall to.
COVERED = {"guide": (0.90, 0.99), "repeating": (0.85, 1.0)}


def excitation(t, highest, seed, lowest=0.5):
    """The excitation of the guide: lines one per duration apart, with low peaks."""
    n = len(t)
    f = np.fft.rfftfreq(n, t[1] - t[0])
    band = (f >= lowest) & (f <= highest)
    lines = band * np.exp(2j * np.pi * np.random.default_rng(seed).uniform(size=len(f)))
    for _ in range(50):
        u = np.fft.irfft(lines, n)
        top = 1.7 * np.std(u)
        lines = band * np.exp(1j * np.angle(np.fft.rfft(np.clip(u, -top, top))))
    u = np.fft.irfft(lines, n)
    return u / np.abs(u).max()


def simulate(kind, bits, noise, seed, friction=0.0):
    """A log of one joint, and its true gains and dead time."""
    rng = np.random.default_rng([seed, bits, int(noise * 1e6), EXCITATIONS.index(kind)])
    truth = (
        math.exp(rng.uniform(math.log(12), math.log(45))),
        math.exp(rng.uniform(math.log(80), math.log(250))),
        rng.uniform(2e-3, 20e-3),
    )
    t = np.arange(int(SECONDS / INTERVAL)) * INTERVAL
    make = excitation if kind == "guide" else multisine
    u = make(t, HIGHEST, seed)
    u = u * 0.85 * LIMIT / demand(t, u, *truth)
    kp, kv, delay = truth
    u = u - u[0]
    q = move(t, u, kp=kp, kv=kv, delay=delay, limit=LIMIT, friction=friction)
    step = 2 * math.pi / 2**bits
    zero = rng.uniform(0, step)
    y = step * np.round((q + noise * rng.normal(size=len(t)) + zero) / step) - zero
    return identification.Log(t=t, command=u, measured=y, set_points=True), truth


def estimate(task):
    """Per parameter: error, 95 % interval less the truth, determined; and the notes."""
    log, truth = simulate(*task)
    joint = identification.identify(log).joints[0]
    rows = [
        (x.value - y, x.low - y, x.high - y, x.determined, x.sd)
        for x, y in zip(joint.estimates, truth, strict=False)
    ]
    return rows, joint.notes


def main() -> int:
    """Run it; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak.encoders", description=__doc__)
    parser.add_argument("--seeds", type=int, default=100, help="logs of each kind")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--friction", action="store_true", help="look for friction instead")
    parser.add_argument("--excitation", choices=EXCITATIONS, help="only this one")
    given = parser.parse_args()
    bad = 0
    kinds = [x for x in product(EXCITATIONS, BITS, NOISES) if given.excitation in (None, x[0])]
    with ProcessPoolExecutor(given.jobs) as pool:
        if given.friction:
            return look_for_friction(pool, given.seeds)
        for kind in kinds:
            found = list(pool.map(estimate, [(*kind, s) for s in range(given.seeds)]))
            bad += report(kind, [x[0] for x in found])
    print(f"{bad} miss the bar")
    return 1 if bad else 0


def look_for_friction(pool, seeds) -> int:
    """Print how often friction is told, with and without it; returns the exit code."""
    bad = 0
    for size in (0.0, FRICTION):
        tasks = [("guide", BITS[s % len(BITS)], NOISES[1], s, size) for s in range(seeds)]
        found = list(pool.map(estimate, tasks))
        told = sum(any("friction" in x for x in notes) for _, notes in found)
        determined = sum(all(x[3] for x in rows) for rows, _ in found)
        print(f"friction {size:g} rad/s²: told in {told}, determined in {determined} of {seeds}")
        bad += determined > 0 or told < seeds if size else told > 0.02 * seeds
    return 1 if bad else 0


def report(kind, found) -> int:
    """Print coverage, and errors in standard deviations; returns how many miss the bar."""
    values = np.array(found, dtype=float)
    inside = (values[:, :, 1] <= 0) & (values[:, :, 2] >= 0)
    low, high = COVERED[kind[0]]
    # The share of few seeds is uncertain itself.
    slack = 2 * math.sqrt(0.05 * 0.95 / len(found))
    shares = inside.mean(axis=0)
    spread = np.sqrt(np.mean((values[:, :, 0] / values[:, :, 4]) ** 2, axis=0))
    cells = [f"{n} {c:.3f} {s:5.2f} sd" for n, c, s in zip(NAMES, shares, spread, strict=True)]
    determined = values[:, :, 3].all(axis=1).mean()
    print(f"{kind[0]:10}{kind[1]:3} bits, noise {kind[2]:g}: {' | '.join(cells)} | "
          f"determined {determined:.2f}", flush=True)  # fmt: skip
    return int(np.sum((shares < low - slack) | (shares > high + slack)))


if __name__ == "__main__":
    sys.exit(main())
