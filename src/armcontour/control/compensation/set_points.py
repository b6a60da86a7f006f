"""Times of set-points, their time advance, and the inverse of the servo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.motion import Trajectory
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import without_integral

# A set-point that is closer to a break of the trajectory than this [cycles] is moved to the break.
SNAP = 1e-9
# Time constants after the end of the motion for which set-points continue, so that the transient of
# the compensation decays.
SETTLING = 36.0
# The transient of set-points after a motion is truncated after LONGEST_TAIL [s] or after this share
# of the duration of the motion.
LONGEST_TAIL = 1.0
TAIL_SHARE = 0.2
# Factor k of the bias k T² x'' of interpolated set-points with the cycle T: a mean over a cycle
# contributes 1 / 24, linear interpolation 1 / 12, and held set-points 1 / 24.
BIAS = {"linear": 1 / 8, "step": 1 / 12, "cubic": 1 / 24}
# Largest half-width of the second differences that correct this bias [cycles]. A smaller half-width
# would increase the commanded acceleration at jumps of acceleration.
HALF_WIDTH = 12


@dataclass(frozen=True, slots=True)
class SetPointTimes:
    """Times of the plan for which set-points are computed."""

    before: int  # Number of set-points before the motion
    # inside: times of the set-points during the motion [s]; times near a break are at the break.
    inside: FloatArray
    after_end: float  # Time from the end of the motion to the first set-point after it [s]


def set_point_times(trajectory: Trajectory, cycle: float, offset: float = 0.0) -> SetPointTimes:
    """Times of set-points from `offset` (0 or before the motion) to the end of the motion."""
    duration = trajectory.duration
    count = int(np.ceil((duration - offset) / cycle * (1 - 1e-15) - SNAP))
    grid = offset + np.arange(max(count, 1), dtype=np.float64) * cycle
    breaks = trajectory.breaks
    near = np.clip(np.searchsorted(breaks, grid), 1, len(breaks) - 1)
    near -= grid - breaks[near - 1] < breaks[near] - grid
    close = np.abs(breaks[near] - grid) < SNAP * cycle
    grid[close] = breaks[near][close]
    return SetPointTimes(
        before=int((grid < 0).sum()),
        inside=grid[grid >= 0],
        after_end=max(offset + len(grid) * cycle - duration, SNAP * cycle),
    )


def time_advances(servo: ServoModel, cycle: float) -> FloatArray:
    """Time advance of each joint's set-points [s], (dof,)."""
    # Interpolation "step" delays the command by half a cycle on average.
    return servo.dead_time + (cycle / 2 if servo.interpolation == "step" else 0.0)


def advance_set_points(
    trajectory: Trajectory,
    lead: FloatArray,
    cycle: float,
    command: Callable[[SetPointTimes, IntArray], FloatArray],
    *,
    hold: FloatArray | None = None,
    from_rest: bool = False,
) -> tuple[float, FloatArray]:
    """Time of the first set-point [s], and set-points with time advances [rad], (n, dof)."""
    # lead: time advance of each joint [s], (dof,). The set-point at time t corresponds to the
    # plan's time t + lead. The set-points begin before time 0 by as many cycles as the largest time
    # advance requires. A joint with a smaller time advance first rests at the start of the plan.
    # command: function that computes the set-points of the joints with these indices, (k,), at
    # these times [rad], (n, k). hold: set-point with which the arm rests at the start of the plan
    # [rad], (dof,), by default the start. from_rest: if True, the first set-point of every joint is
    # at rest.
    whole = lead.max() / cycle
    early = int(np.floor(whole + SNAP)) + 1 if from_rest else int(np.ceil(whole - SNAP))
    start = trajectory(0.0) if hold is None else hold
    columns: dict[int, FloatArray] = {}
    for advance in np.unique(lead):
        joints = np.flatnonzero(lead == advance)
        times = set_point_times(trajectory, cycle, min(float(advance) - early * cycle, 0.0))
        still = np.tile(start[joints], (times.before, 1))
        column = np.concatenate([still, command(times, joints)])
        columns |= dict(zip(joints.tolist(), column.T, strict=True))
    length = max(len(x) for x in columns.values())
    # A joint whose command ends earlier repeats its last set-point.
    padded = [
        np.pad(columns[j], (0, length - len(columns[j])), mode="edge") for j in range(len(lead))
    ]
    return -early * cycle + 0.0, np.stack(padded, axis=1)


def inverse(trajectory: Trajectory, servo: ServoModel, cycle: float) -> tuple[float, FloatArray]:
    """Time of the first set-point [s], and set-points by the inverse servo [rad], (n, dof)."""
    # A set-point is the mean of the exact command over the cycle about its time. Because the servo
    # is linear, this mean is the command for the means of the plan. The means of velocity and
    # acceleration are differences of position and velocity. Therefore a jump of acceleration
    # between two set-points affects both set-points in proportion to their distances.
    final = trajectory([trajectory.duration], side="left")
    tail = np.zeros((integrator_tail(servo, trajectory.duration, cycle), trajectory.dof))

    def command(times: SetPointTimes, joints: IntArray) -> FloatArray:
        t = times.inside
        if len(t) and times.after_end < cycle / 2:
            # The cycle about the next set-point contains a part of the motion.
            t = np.append(t, trajectory.duration + times.after_end)
        # A drive holds its acceleration over a drive cycle, so it is taken at the middle of it.
        q, dq, ddq = _means(trajectory, t, cycle, servo.drive_cycle / 2)
        q, ends = np.concatenate([q, tail + final]), np.concatenate([dq, tail])
        ddq = without_integral(ends, np.concatenate([ddq, tail]), servo, cycle)
        commands = servo.command(q, ends, ddq)
        inside = commands[: len(t)]
        inside -= BIAS[servo.interpolation] * _second_differences(inside, trajectory, t, cycle)
        return np.concatenate([commands, final])[:, joints]

    return advance_set_points(
        trajectory, time_advances(servo, cycle), cycle, command, from_rest=True
    )


def integrator_tail(servo: ServoModel, duration: float, cycle: float) -> int:
    """Number of set-points after a motion until the integrators decay; 0 without integrators."""
    return int(longest_tail(duration) / cycle) + 2 if servo.ki.any() else 0


def longest_tail(duration: float) -> float:
    """Time after a motion at which the transient of its set-points is truncated [s]."""
    return min(LONGEST_TAIL, TAIL_SHARE * duration)


def _means(
    trajectory: Trajectory, t: FloatArray, cycle: float, ahead: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of q, dq and ddq over the cycles about times t, (n, dof) each."""
    # Before and after the motion, the joints rest. Means of q are computed by Simpson's rule, which
    # is exact up to third order. Means of ddq are for cycles that are shifted by `ahead` [s].
    shifts = cycle / 2 * np.arange(-1, 2)
    if ahead:
        shifts = np.append(shifts, ahead + shifts[::2])
    # All times are evaluated at once, because a program has thousands of motion laws.
    q, dq = trajectory.motion_with_rests((t[:, None] + shifts).ravel(), 1)
    count = len(shifts)
    first, middle, last = (q[k::count] for k in range(3))
    before, after = dq[count // 4 * 3 :: count], dq[count - 1 :: count]
    return (first + 4 * middle + last) / 6, (last - first) / cycle, (after - before) / cycle


def _second_differences(
    u: FloatArray, trajectory: Trajectory, t: FloatArray, cycle: float
) -> FloatArray:
    """Second differences of set-points with a half-width up to HALF_WIDTH intervals, (n, dof)."""
    # The differences are within one move. They decrease to 0 towards both ends of the move, because
    # set-points at rest have no bias.
    ends = trajectory.starts
    k = np.clip(np.searchsorted(ends, t, side="right"), 1, len(ends) - 1)
    inside = np.minimum(t - ends[k - 1], ends[k] - t) / cycle
    reach = np.clip(np.floor(inside + SNAP), 0, HALF_WIDTH).astype(np.intp)
    i = np.arange(len(t))
    weight = np.clip(inside / HALF_WIDTH, 0, 1) / np.maximum(reach, 1) ** 2
    return np.asarray(weight[:, None] * (u[i + reach] - 2 * u + u[i - reach]))
