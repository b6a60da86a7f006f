"""Plans with limits of jerk: against plans without, against IPOPT, and many cells against few.

Six joints, the first of the splines that `soak.jerk_oracle` solves; for many cells a spline through
many waypoints.
"""

from __future__ import annotations

import numpy as np
from soak import jerk_oracle

import armcontour as ac
from benchmarks.measured import Measured, paired

CELLS, RUNS = 1000, 21
FEW, MANY, WAYPOINTS, LONG_RUNS = 8_000, 32_000, 640, 3


def measure() -> tuple[list[Measured], list[str]]:
    """Times, and notes on what could not be measured."""
    _, path, limits = next(jerk_oracle.splines())
    notes: list[str] = []

    def ours() -> ac.Trajectory:
        return ac.plan(path, limits=limits, intervals=CELLS)

    def without() -> ac.Trajectory:
        return ac.plan(path, limits=limits.replace(joint_jerk=None), intervals=CELLS)

    def ipopt() -> jerk_oracle.Timing:
        bounds = jerk_oracle.Bounds.of(limits, path.dof)
        return jerk_oracle.solve(path, bounds, (jerk_oracle.CELLS[0], CELLS))

    what = f"plan with limits of jerk, {CELLS} cells"
    rows = [Measured(what, *_in_order(paired(ours, without, RUNS), "without"), "<= 60 ms")]
    try:
        rows.append(Measured(what, *_in_order(paired(ours, ipopt, 1), "IPOPT"), "-"))
    except ImportError:
        notes.append("casadi is not installed: python -m pip install casadi.")
    times = paired(lambda: _long(MANY), lambda: _long(FEW), LONG_RUNS)
    what = f"plan with limits of jerk, {MANY:,} cells"
    return [*rows, Measured(what, *_in_order(times, f"{FEW:,}"), "<= 6")], notes


def _in_order(times: tuple[float, float], peer: str) -> tuple[float, str, float]:
    return times[0], peer, times[1]


def _long(cells: int) -> ac.Trajectory:
    """The plan of a spline through many waypoints."""
    way = np.random.default_rng(0).uniform(-1.5, 1.5, (WAYPOINTS, len(jerk_oracle.VELOCITY)))
    path = ac.JointPath.spline(way, np.arange(WAYPOINTS))
    return ac.plan(path, limits=jerk_oracle.limits(10.0), intervals=cells)


if __name__ == "__main__":
    measured, missing = measure()
    for row in measured:
        ratio = row.ours / row.peer_time
        print(f"{row.what}: {row.ours * 1e3:.1f} ms ({ratio:.3g} x {row.peer}; {row.bar})")
    print(*missing, sep="\n")
