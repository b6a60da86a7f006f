"""Robustness: executions of the paper's job a second."""

from __future__ import annotations

from functools import partial

import armcontour as ac
from armcontour.control.compensation import METHODS
from armcontour.simulation.robustness.monte_carlo import Uncertainty, spread
from benchmarks import reference
from benchmarks.measured import Bar, Line, Pair, timed

SAMPLES = 4000
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))
CYCLE = 4e-3
# Executions a second, and on how many cores.
RATE, CORES = 4000, 2


def lines() -> list[Line]:
    """The paper's job, 5.33 s of two joints, unsaturated mostly and saturated mostly."""
    return [
        Line(
            f"spread/{method}",
            f"one of {SAMPLES} executions, {method}, {CORES} cores",
            reference.NAME,
            partial(_pair, method),
            Bar(seconds=1 / RATE, clock=True),
        )
        for method in ("none", "inverse")
    ]


def _pair(method: str) -> Pair:
    arm, servo = ac.load_arm("pmk3s"), ac.ServoModel(kp=25.0, kv=150.0)
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
    path = ac.round_corners(ac.Path.polyline(POINTS), tolerance=5e-3, acceleration=0.09)
    plan = ac.plan(path, arm, limits, ac.Paper(knots=600))
    set_points = ac.compensate(plan, servo, METHODS[method](), cycle=CYCLE)
    options = {"samples": SAMPLES, "threads": CORES}

    def ours() -> object:
        return spread(set_points, path, arm, servo, limits, Uncertainty(gains=0.1), **options)

    return Pair(timed(ours), timed(reference.work), parts=(SAMPLES, 1))
