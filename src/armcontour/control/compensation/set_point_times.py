"""Times of set-points, and their time advance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.motion import Trajectory
from armcontour.robot.servo import ServoModel

# A set-point that is closer to a break of the trajectory than this [cycles] is moved to the break.
SNAP = 1e-9
# Set-points continue after the motion for so many time constants, so that the compensation's
# transient decays.
SETTLING = 36.0
# The transient of set-points after a motion is truncated after this time at the latest [s].
LONGEST_TAIL = 1.0
# Number of motion laws whose breaks are compared with set-points at once.
LAWS_AT_ONCE = 512
# The transient is also truncated after this fraction of the motion's duration.
TAIL_SHARE = 0.2


@dataclass(frozen=True, slots=True)
class SetPointTimes:
    """Times of the plan for which set-points are computed."""

    before: int  # Number of set-points before the motion
    # inside: times of the set-points during the motion [s]; times near a break are at the break.
    inside: FloatArray
    after_end: float  # Time from the end of the motion to the first set-point after it [s]


def set_point_times(trajectory: Trajectory, cycle: float, offset: float = 0.0) -> SetPointTimes:
    """Return the times of set-points until the motion ends, one per cycle.

    - `offset`: first time, 0 or before the motion [s].
    """
    duration = trajectory.duration
    count = int(np.ceil((duration - offset) / cycle * (1 - 1e-15) - SNAP))
    grid = offset + np.arange(max(count, 1), dtype=np.float64) * cycle
    law_index = np.searchsorted(trajectory.starts, grid, side="right") - 1
    law_index = np.clip(law_index, 0, len(trajectory.laws) - 1)
    # The breaks of all laws of a long program would take much memory.
    for first in range(0, len(trajectory.laws), LAWS_AT_ONCE):
        last = min(first + LAWS_AT_ONCE, len(trajectory.laws))
        near = slice(*np.searchsorted(law_index, [first, last]))
        breaks = _breaks_of(trajectory, first, last)
        grid[near] = _move_to_breaks(grid[near], breaks, SNAP * cycle)
    return SetPointTimes(
        before=int((grid < 0).sum()),
        inside=grid[grid >= 0],
        after_end=max(offset + len(grid) * cycle - duration, SNAP * cycle),
    )


def _breaks_of(trajectory: Trajectory, first: int, last: int) -> FloatArray:
    """Return the breaks of the laws from `first` up to `last`, with the end of the last law [s]."""
    starts = trajectory.starts
    times = [starts[k] + trajectory.laws[k].breaks[:-1] for k in range(first, last)]
    return np.concatenate([*times, starts[last : last + 1]])


def _move_to_breaks(t: FloatArray, breaks: FloatArray, near: float) -> FloatArray:
    """Return times, of which those that are closer to a break than `near` are at the break [s]."""
    nearest = np.clip(np.searchsorted(breaks, t), 1, len(breaks) - 1)
    nearest -= t - breaks[nearest - 1] < breaks[nearest] - t
    return np.where(np.abs(breaks[nearest] - t) < near, breaks[nearest], t)


def time_advances(servo: ServoModel, cycle: float) -> FloatArray:
    """Return the time advance of each joint's set-points [s], (dof,)."""
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
    """Return the first set-point's time [s], and set-points with time advances [rad], (n, dof).

    - `lead`: time advance of each joint [s], (dof,). The set-point at time t corresponds to the
      plan's time t + lead. The set-points begin before time 0 by as many cycles as the largest time
      advance requires. A joint with a smaller time advance first rests at the start of the plan.
    - `command`: function that computes the set-points of the joints with these indices, (k,), at
      these times [rad], (n, k).
    - `hold`: set-point with which the arm rests at the start of the plan [rad], (dof,), by default
      the start.
    - `from_rest`: if True, the first set-point of every joint is at rest.
    """
    lead_cycles = lead.max() / cycle
    early = int(np.floor(lead_cycles + SNAP)) + 1 if from_rest else int(np.ceil(lead_cycles - SNAP))
    start = trajectory(0.0) if hold is None else hold
    groups = []
    for advance in np.unique(lead):
        joints = np.flatnonzero(lead == advance)
        times = set_point_times(trajectory, cycle, min(float(advance) - early * cycle, 0.0))
        groups.append((joints, times.before, command(times, joints)))
    length = max(before + len(commands) for _, before, commands in groups)
    q = np.empty((length, len(lead)))
    for joints, before, commands in groups:
        end = before + len(commands)
        q[:before, joints] = start[joints]
        q[before:end, joints] = commands
        # Joints whose command ends earlier repeat their last set-point.
        q[end:, joints] = commands[-1]
    # A long motion has many set-points, which become read-only without a copy.
    q.setflags(write=False)
    return -early * cycle + 0.0, q


def integrator_tail(servo: ServoModel, duration: float, cycle: float) -> int:
    """Return how many set-points after a motion the integrators need to decay; 0 without any."""
    return int(longest_tail(duration) / cycle) + 2 if servo.ki.any() else 0


def longest_tail(duration: float) -> float:
    """Return the time after a motion at which its set-points' transient is truncated [s]."""
    return min(LONGEST_TAIL, TAIL_SHARE * duration)
