"""What the compensators share: the times of the set-points, and the servo's inverse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.motion import Trajectory
from armcontour.servo import ServoModel

# A set-point this close to a break of the trajectory, in periods, is taken at the break.
SNAP = 1e-9
# The set-points end when what is left of the motion has decayed by this many time constants.
SETTLING = 36.0


@dataclass(frozen=True, slots=True)
class SetPointTimes:
    """Places on the plan that set-points are computed for.

    Args:
        before: Number of set-points that come before the motion.
        inside: Times of those within it, snapped to breaks next to them [s].
        after_end: From the end of the motion to the first set-point at or after it [s].
    """

    before: int
    inside: FloatArray
    after_end: float


def set_point_times(trajectory: Trajectory, period: float, offset: float = 0.0) -> SetPointTimes:
    """`offset`, not above 0, and every period after it, up to the end of the motion."""
    duration = trajectory.duration
    count = int(np.ceil((duration - offset) / period * (1 - 1e-15) - SNAP))
    grid = offset + np.arange(max(count, 1), dtype=np.float64) * period
    breaks = trajectory.breaks
    near = np.clip(np.searchsorted(breaks, grid), 1, len(breaks) - 1)
    near -= grid - breaks[near - 1] < breaks[near] - grid
    close = np.abs(breaks[near] - grid) < SNAP * period
    grid[close] = breaks[near][close]
    return SetPointTimes(
        before=int((grid < 0).sum()),
        inside=grid[grid >= 0],
        after_end=max(offset + len(grid) * period - duration, SNAP * period),
    )


def leads(servo: ServoModel, period: float) -> FloatArray:
    """How far ahead of the plan each joint's command must be, (dof,) [s].

    The dead time; a set-point that is held for an interval is late by another half of one on
    average.
    """
    return servo.dead_time + (period / 2 if servo.interpolation == "step" else 0.0)


def advance_set_points(
    trajectory: Trajectory,
    lead: FloatArray,
    period: float,
    command: Callable[[SetPointTimes, IntArray], FloatArray],
) -> tuple[float, FloatArray]:
    """Set-points of joints whose commands are ahead of the plan.

    The set-point at t is for the plan's time t + lead. There are as many intervals before 0 as the
    largest lead needs; there a joint keeps the position in which the plan begins, until its own
    lead is reached.

    Args:
        trajectory: What the joints shall do.
        lead: Of every joint, (dof,) [s].
        period: Command interval [s].
        command: Set-points of some joints at and after some places of the plan, (n, their number).

    Returns:
        Time of the first set-point, not above 0 [s]; set-points, (n, dof) [rad].
    """
    early = max(0, int(np.ceil(lead.max() / period - SNAP)))
    columns: dict[int, FloatArray] = {}
    for own in np.unique(lead):
        joints = np.flatnonzero(lead == own)
        times = set_point_times(trajectory, period, min(float(own) - early * period, 0.0))
        hold = np.tile(trajectory(0.0)[joints], (times.before, 1))
        found = np.concatenate([hold, command(times, joints)])
        columns |= dict(zip(joints.tolist(), found.T, strict=True))
    length = max(len(x) for x in columns.values())
    # A joint whose command ends earlier keeps its last set-point.
    padded = [
        np.pad(columns[j], (0, length - len(columns[j])), mode="edge") for j in range(len(lead))
    ]
    return -early * period + 0.0, np.stack(padded, axis=1)


def inverse_servo(
    servo: ServoModel, q: FloatArray, dq: FloatArray, ddq: FloatArray | None = None
) -> FloatArray:
    """The command that makes an unsaturated servo move like q, but for its dead time.

    Second order: `q + dq / K_p + ddq / (K_p K_v)`, from (6). First order: `q + dq / K_p`.
    """
    if servo.kv is None:
        return np.asarray(q + dq / servo.kp)
    assert ddq is not None
    return np.asarray(q + dq / servo.kp + ddq / (servo.kp * servo.kv))
