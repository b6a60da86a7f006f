"""Times of set-points, and their time advance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.motion import Trajectory
from armcontour.servo import ServoModel

# Set-points closer than this to a break of the trajectory, in command intervals, are at the break.
SNAP = 1e-9
# Set-points continue after the motion for this many time constants, until the rest has decayed.
SETTLING = 36.0


@dataclass(frozen=True, slots=True)
class SetPointTimes:
    """Times of the plan for which set-points are computed.

    Args:
        before: Number of set-points before the motion.
        inside: Times of the set-points during the motion; times close to a break are at the break
            [s].
        after_end: Time from the end of the motion to the first set-point after it [s].
    """

    before: int
    inside: FloatArray
    after_end: float


def set_point_times(trajectory: Trajectory, period: float, offset: float = 0.0) -> SetPointTimes:
    """Times of set-points from `offset` to the end of the motion.

    Args:
        trajectory: The planned trajectory.
        period: Command interval [s].
        offset: Time of the first set-point, not above 0 [s].
    """
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


def time_advances(servo: ServoModel, period: float) -> FloatArray:
    """Time advance of each joint's set-points [s], (dof,).

    The time advance is the dead time, plus half a command interval for interpolation "step", which
    delays the command by that on average.
    """
    return servo.dead_time + (period / 2 if servo.interpolation == "step" else 0.0)


def advance_set_points(
    trajectory: Trajectory,
    lead: FloatArray,
    period: float,
    command: Callable[[SetPointTimes, IntArray], FloatArray],
    *,
    hold: FloatArray | None = None,
    from_rest: bool = False,
) -> tuple[float, FloatArray]:
    """Set-points with a time advance per joint.

    The set-point at time t belongs to the plan's time t + lead. The set-points start before time 0
    by as many intervals as the largest time advance needs; a joint with a smaller time advance
    stays where it holds at the start of the plan first.

    Args:
        trajectory: Trajectory that the joints should follow.
        lead: Time advance of each joint [s], (dof,).
        period: Command interval [s].
        command: Function that computes the set-points of the joints with given indices, (k,), at
            given times and after the end [rad], (n, k).
        hold: Set-point that holds the arm at the start of the plan [rad], (dof,); by default the
            start itself.
        from_rest: Whether every joint has a set-point that holds it before the plan's time 0.

    Returns:
        Time of the first set-point, not above 0 [s], and set-points [rad], (n, dof).
    """
    whole = lead.max() / period
    early = int(np.floor(whole + SNAP)) + 1 if from_rest else int(np.ceil(whole - SNAP))
    start = trajectory(0.0) if hold is None else hold
    columns: dict[int, FloatArray] = {}
    for own in np.unique(lead):
        joints = np.flatnonzero(lead == own)
        times = set_point_times(trajectory, period, min(float(own) - early * period, 0.0))
        still = np.tile(start[joints], (times.before, 1))
        found = np.concatenate([still, command(times, joints)])
        columns |= dict(zip(joints.tolist(), found.T, strict=True))
    length = max(len(x) for x in columns.values())
    # A joint whose command ends earlier keeps its last set-point.
    padded = [
        np.pad(columns[j], (0, length - len(columns[j])), mode="edge") for j in range(len(lead))
    ]
    return -early * period + 0.0, np.stack(padded, axis=1)
