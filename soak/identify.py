"""`python -m soak.identify`: identify simulated joints, and judge the estimates by their bound.

The logs come from a simulation of its own (`soak.joint`), and so does the Cramér-Rao bound, by
differences of that simulation. The noise is white, 0.1 mrad; every seed counts.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np

from armcontour import identification
from soak.joint import move

NOISE = 1e-4
INTERVAL = 1e-3
LIMIT = 20.0
NAMES = ("kp", "kv", "dead_time", "acceleration")
# Gains, dead times: a grid with its corners.
GRID = tuple(product((10.0, 25.0, 60.0), (60.0, 150.0, 300.0), (0.0, 12.3e-3, 100e-3)))
COVERED = (
    (25.0, 150.0, 12.3e-3),
    (10.0, 60.0, 0.0),
    (60.0, 300.0, 100e-3),
    (60.0, 60.0, 50.4e-3),
    (10.0, 300.0, 4e-3),
)


def multisine(t, highest, seed, lowest=0.5):
    """Equal lines every 0.5 Hz, random phases, largest value about 1."""
    rng = np.random.default_rng(seed)
    lines = np.arange(lowest, highest + 0.25, 0.5)
    u = np.zeros_like(t)
    for f, phase in zip(lines, rng.uniform(0, 2 * np.pi, len(lines)), strict=True):
        u += np.sin(2 * np.pi * f * t + phase)
    return u / np.abs(u).max()


def demand(t, u, kp, kv, delay):
    """Largest acceleration demand of a joint without a limit [rad/s²]."""
    q = move(t, u, kp=kp, kv=kv, delay=delay, steps=2)
    step = t[1] - t[0]
    return float(np.abs(np.diff(q, 2)).max() / step**2)


def commands(kind, kp, kv, delay, seed):
    """Times and set-points of a kind of log."""
    if kind in ("multisine", "saturating"):
        t = np.arange(60_000 if kind == "multisine" else 10_000) * INTERVAL
        u = multisine(t, 25.0, seed)
        share = 0.85 if kind == "multisine" else 2.0
        return t, u * share * LIMIT / demand(t, u, kp, kv, delay)
    t = np.arange(4000) * INTERVAL
    if kind == "step":
        return t, np.where(t >= 0.3, 0.85 * LIMIT / (kp * kv), 0.0)
    if kind == "large step":
        return t, np.where(t >= 0.3, 0.5, 0.0)
    if kind == "ramp":
        return t, np.clip(t - 0.3, 0.0, 2.0) * 0.3
    raise ValueError(kind)


def simulated(t, u, kp, kv, delay, limit):
    """What the joint does; with finer steps where it starts with a jolt."""
    return move(t, u, kp=kp, kv=kv, delay=delay, limit=limit, steps=10 if len(t) > 5000 else 400)


def bound(t, u, kp, kv, delay, limit):
    """Standard deviations of the Cramér-Rao bound; the limit's is infinite if it is not reached."""
    limit = min(limit, 1e9)  # differences need a number
    truth = np.array([kp, kv, delay, limit])
    steps = (1e-4 * kp, 1e-4 * kv, 1e-5, 1e-4 * limit)
    columns = []
    for i, step in enumerate(steps):
        ends = []
        for sign in (1, -1):
            p = truth.copy()
            p[i] += sign * step
            # Set-points are of the log; a dead time below zero takes the next one early.
            ends.append(simulated(t, u, *p))
        columns.append((ends[0] - ends[1]) / (2 * step))
    jacobian = np.array(columns)
    seen = np.abs(jacobian).max(axis=1) > 0
    sd = np.full(4, math.inf)
    information = jacobian[seen] @ jacobian[seen].T
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    sd[seen] = NOISE * np.sqrt(np.diag(inverse)) / scale
    return sd


def case(kind, kp, kv, delay, seeds, samples=None):
    """Estimates and 95 % intervals for every seed, and the bound of the log."""
    t, u = (x[:samples] for x in commands(kind, kp, kv, delay, seed=1))
    q = simulated(t, u, kp, kv, delay, LIMIT)
    sd = bound(t, u, kp, kv, delay, LIMIT)
    found = []
    for seed in seeds:
        noise = np.random.default_rng([seed, int(kp), int(kv), int(delay * 1e4)]).normal(
            size=len(t)
        )
        log = identification.Log(t=t, command=u, measured=q + NOISE * noise, set_points=True)
        joint = identification.identify(log).joints[0]
        found.append(
            [(x.value, x.low, x.high, x.determined, x.sd) for x in joint.estimates]
            + [(joint.order, joint.whiteness)]
        )
    return {"kind": kind, "truth": (kp, kv, delay, LIMIT), "bound": sd.tolist(), "found": found}


def judge(result):
    """Per parameter: bound in parts of the value, spread by bound, coverage, largest error."""
    rows = []
    for i, name in enumerate(NAMES):
        truth, sd = result["truth"][i], result["bound"][i]
        values = np.array([x[i][:3] for x in result["found"]])
        told = np.array([x[i][3] for x in result["found"]])
        error = values[:, 0] - truth
        rows.append(
            {
                "name": name,
                "bound": sd,
                "spread": float(np.sqrt(np.mean(error**2)) / sd) if sd < math.inf else math.nan,
                "errors": (error / sd).tolist(),
                "cover": float(np.mean((values[:, 1] <= truth) & (truth <= values[:, 2]))),
                "worst": float(np.abs(error).max()),
                "determined": float(np.mean(told)),
            }
        )
    return rows


def _one(task):
    return case(*task)


def main() -> int:
    """Run it; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak.identify", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="seeds for each of the grid")
    parser.add_argument("--covered", type=int, default=200, help="seeds for the coverage")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, help="file for all estimates (JSON)")
    given = parser.parse_args()
    # Threads of the linear algebra would only wait for each other.
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    tasks = [("multisine", *x, range(given.seeds)) for x in GRID if given.seeds]
    if given.covered:
        tasks += [("multisine", *x, range(given.covered)) for x in COVERED]
        tasks += [("saturating", 25.0, 150.0, 12.3e-3, range(given.covered))]
        tasks += [("large step", 25.0, 150.0, 12.3e-3, range(given.covered))]
        tasks += [("step", *x, range(given.covered)) for x in (COVERED[0], COVERED[2])]
        tasks += [("ramp", *COVERED[0], range(given.covered))]
    parts = [(*x[:-1], x[-1][i : i + 10]) for x in tasks for i in range(0, len(x[-1]), 10)]
    merged: dict[tuple, dict] = {}
    with ProcessPoolExecutor(given.jobs) as pool:
        for task, result in zip(parts, pool.map(_one, parts), strict=True):
            key = (task[:4], task[4].stop > 0 and len(merged))
            same = [k for k in merged if k[0] == task[:4] and len(merged[k]["found"]) == task[4][0]]
            if same and task[4][0] > 0:
                merged[same[-1]]["found"] += result["found"]
            else:
                merged[key] = result
    if given.out:
        given.out.write_text(json.dumps([x for x in merged.values()]))
    bad = report(list(merged.values()))
    return 1 if bad else 0


def report(results) -> int:
    """Print the figures; returns how many miss the bar."""
    bad = 0
    pooled: dict[str, list[float]] = {x: [] for x in NAMES}
    print(f"{'log':11}{'kp':>4}{'kv':>5}{'dead':>7} seeds | " + " | ".join(
        f"{x[:9]:9} bound spread cover deter" for x in NAMES
    ))  # fmt: skip
    for result in results:
        n = len(result["found"])
        kp, kv, delay, _ = result["truth"]
        cells = []
        for row, truth in zip(judge(result), result["truth"], strict=True):
            relative = row["bound"] / truth if row["name"] != "dead_time" else row["bound"] * 1e3
            wide = row["bound"] > 0.1 * truth if row["name"] != "dead_time" else False
            if row["bound"] < math.inf and not wide:
                if result["kind"] == "multisine":
                    pooled[row["name"]] += row["errors"]
                # The spread of n seeds is itself uncertain, by 1 / sqrt(2 n).
                bad += row["spread"] > 1.25 * (1 + 2 / math.sqrt(2 * n) if n < 100 else 1)
                bad += n >= 100 and not 0.90 <= row["cover"] <= 0.99
                allowed = 0.02 * truth if row["name"] != "dead_time" else 1e-3
                if 2 * row["bound"] <= allowed and n < 100:
                    bad += row["worst"] > max(allowed, 4.5 * row["bound"])
            shown = f"{relative:7.2e}" if row["name"] == "dead_time" else f"{relative * 100:6.3f}%"
            cells.append(
                f"{shown:>14} {row['spread']:6.2f} {row['cover']:5.2f} {row['determined']:5.2f}"
            )
        print(
            f"{result['kind']:11}{kp:4.0f}{kv:5.0f}{delay * 1e3:7.1f} {n:5d} | " + " | ".join(cells)
        )
    for name, errors in pooled.items():
        if errors:
            e = np.array(errors)
            print(f"multisines, {name}: {len(e)} estimates, {math.sqrt(np.mean(e**2)):.3f} bounds")
    print(f"{bad} miss the bar")
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
