"""Plan with jerk limits: compare with IPOPT, and many grid cells with few.

The plan follows a spline of six joints, the first one that `tests.oracle.jerk_optimum` solves. The
plan with many cells follows a spline through many waypoints.
"""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
from tests.oracle import jerk_optimum as judge

import armcontour as ac
from benchmarks import reference
from benchmarks.measured import Bar, Line, Missing, Pair, timed

# Cells of the plan that is compared with the reference work and with IPOPT.
CELLS = 1000
# Cells of the two plans whose costs are compared: few, and four times as many.
FEW = 8_000
MANY = 32_000
# Waypoints of both splines.
WAYPOINTS = 640


def lines() -> list[Line]:
    """Return the line for one plan, and for the cost of many cells."""
    title = f"plan with limits of jerk, {CELLS} cells"
    more = f"plan with limits of jerk, {MANY:,} cells"
    return [
        Line("jerk/plan", title, reference.NAME, _plan, Bar(seconds=15e-3)),
        Line("jerk/ipopt", title, "IPOPT", _against_ipopt, full=True),
        Line("jerk/cells", more, f"{FEW:,} cells", _many, Bar(ratio=6)),
    ]


def _plan() -> Pair:
    _, path, limits = next(judge.splines())
    ours = timed(lambda: ac.plan(path, limits=limits, options=ac.Optimal(intervals=CELLS)))
    return Pair(ours, timed(reference.work))


def _against_ipopt() -> Pair:
    if find_spec("casadi") is None:
        raise Missing("casadi is not installed")
    _, path, limits = next(judge.splines())

    def ipopt() -> judge.Timing:
        bounds = judge.Bounds.of(limits, path.dof)
        return judge.solve(path, bounds, (judge.CELLS[0], CELLS))

    return Pair(
        timed(lambda: ac.plan(path, limits=limits, options=ac.Optimal(intervals=CELLS))),
        timed(ipopt),
    )


def _many() -> Pair:
    return Pair(timed(lambda: _long(MANY)), timed(lambda: _long(FEW)))


def _long(cells: int) -> ac.Trajectory:
    """Plan a spline through many waypoints."""
    way = np.random.default_rng(0).uniform(-1.5, 1.5, (WAYPOINTS, len(judge.VELOCITY)))
    path = ac.JointPath.spline(way, np.arange(WAYPOINTS))
    return ac.plan(path, limits=judge.limits_of(10.0), options=ac.Optimal(intervals=cells))
