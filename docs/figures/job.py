"""The paper's contouring job, Sec. IV-A, as the figures show it; everything is computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

import armcontour as ac

FINE = 2e-4  # s: nearly a continuous command
PERIOD = 4e-3  # s: a usual command interval
KNOTS = 600
CONVENTIONAL_TIME = 12.06  # s, T_total of Table I

ARM = ac.load_arm("pmk3s")
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
HOLDING = ac.ServoModel(kp=25.0, kv=150.0, interpolation="step")
OBJECTIVE = ac.Path.polyline([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
LIMITS = ARM.limits.replace(speed=0.15, centripetal_acceleration=0.09)
ROUNDED = ac.round_corners(OBJECTIVE, tolerance=5e-3, acceleration=0.09)


@dataclass(frozen=True, kw_only=True)
class Result:
    """An execution, and what it was worth."""

    executed: ac.Execution
    evaluation: ac.Evaluation


@cache
def planned() -> ac.Trajectory:
    """The realizable trajectory."""
    return ac.plan(ROUNDED, ARM, LIMITS, method="mac", knots=KNOTS)


@cache
def conventional() -> Result:
    """Uniform speed along the objective path, no compensation."""
    limits = LIMITS.replace(speed=0.04)
    trajectory = ac.plan(OBJECTIVE, ARM, limits, method="conventional")
    taught = ac.compensate(trajectory, SERVO, method="none", period=FINE)
    executed = ac.execute(taught, ac.ServoPlant(ARM, SERVO, limits))
    return Result(
        executed=executed,
        evaluation=ac.evaluate(executed, OBJECTIVE, limits=limits, until=CONVENTIONAL_TIME),
    )


@cache
def proposed(
    compensation: str = "pole_placement", *, hold: bool = False, period: float = FINE
) -> Result:
    """The realizable trajectory, compensated, under a servo that interpolates or holds."""
    taught = ac.compensate(planned(), SERVO, method=compensation, period=period)
    executed = ac.execute(taught, ac.ServoPlant(ARM, HOLDING if hold else SERVO, LIMITS))
    return Result(
        executed=executed,
        evaluation=ac.evaluate(executed, ROUNDED, objective=OBJECTIVE, limits=LIMITS),
    )


def times(trajectory: ac.Trajectory, count: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Times that show every jump of a trajectory: both sides of its switching points.

    Returns:
        Times [s], and True where the left-hand value belongs.
    """
    points = trajectory.switching_points
    t, left = [], []
    for begin, end in zip(points[:-1], points[1:], strict=True):
        number = max(3, int(count * (end - begin) / trajectory.duration))
        t.append(np.linspace(begin, end, number))
        left.append(np.arange(number) == number - 1)
    return np.concatenate(t), np.concatenate(left)


def two_sided(trajectory: ac.Trajectory, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a trajectory that jumps at its switching points."""
    t, left = times(trajectory)
    values = np.where(left[:, None], trajectory(t, order, side="left"), trajectory(t, order))
    return t, values
