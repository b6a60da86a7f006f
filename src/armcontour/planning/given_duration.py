"""Plans with a given duration: the fastest plan, slowed down.

At each point of the path, a limit allows a convex set of pairs (u, x) of path acceleration and
squared path speed. The set contains (0, 0), because a plan is refused where gravity or dry friction
alone exceed a limit. Therefore the set contains (u, x) / factor² for every factor >= 1, and a
slowed motion satisfies the limits that the fastest one satisfies. Viscous friction is the
exception, because it is proportional to the root of x: where it assists braking, the slower motion
can need more torque. The slower motion is then checked.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.core.errors import NotRealizable
from armcontour.motion import JointPath, PathLaw, Rates, Trajectory
from armcontour.planning.law_checks import check_limits
from armcontour.planning.program_timing import JoinedMoves, Timing
from armcontour.planning.program_tracing import Tracing
from armcontour.robot.limits import LIMITS

# Durations that differ by less than this share are equal.
SAME_DURATION = 1e-9


def slow_down(
    fastest: Trajectory, duration: float, traced: Tracing | JointPath, timing: Timing
) -> Trajectory:
    """Slow the fastest motion down to a given duration.

    All contours are slowed down by one factor. Rapids and dwells keep their durations.

    - `duration`: duration from start to end [s].
    - `traced`: the tracing or joint path of the motion.
    - `timing`: arm, limits and options with which the fastest motion was planned; the options are
      `Optimal`.
    """
    if isinstance(traced, JointPath):
        factor = _slowing_factor(duration, fastest.duration, 0.0)
        return _slow_down(fastest, factor, timing)
    contours = sum(x.t[1] - x.t[0] for x in fastest.contour_spans)
    factor = _slowing_factor(duration, contours, fastest.duration - contours)
    move_trajectories = (x.trajectory for x in fastest.spans if x.trajectory is not None)
    joined = JoinedMoves(traced, timing.arm)
    for step in traced.steps:
        trajectory = None if step.joint_path is None else next(move_trajectories)
        if trajectory is not None and traced.is_contour(step):
            with step.named():
                trajectory = _slow_down(trajectory, factor, timing)
        joined.add(step, trajectory)
    return joined.trajectory()


def _slowing_factor(duration: float, contours: float, others: float) -> float:
    """Factor that slows contours down, from the durations of contours and other moves [s]."""
    shortest = contours + others
    if duration < shortest * (1 - SAME_DURATION):
        raise NotRealizable(
            f"The motion cannot take {duration:.9g} s, because the fastest motion takes "
            f"{shortest:.9g} s. Specify a longer duration, or raise the active limits.",
            limit="duration",
            needed=shortest,
            allowed=duration,
        )
    return max((duration - others) / contours, 1.0)


def _slow_down(fastest: Trajectory, factor: float, timing: Timing) -> Trajectory:
    """Motion along one path in `factor` times its shortest time."""
    if factor == 1.0:
        return fastest
    laws = tuple(_stretch(x, factor) for x in fastest.laws if isinstance(x, PathLaw))
    if timing.limits.joint_torque is not None and np.any(timing.arm.dynamics.chain.viscous):
        check_limits(
            laws,
            timing.arm,
            timing.limits,
            ignored=[x for x in LIMITS if x != "joint_torque"],
            location=f"Slowed down to {factor * fastest.duration:.6g} s",
            t=0.0,
            remedy="Viscous friction assists braking less in a slower motion. Specify another "
            "duration, or raise joint_torque",
        )
    return replace(fastest, laws=laws)


def _stretch(law: PathLaw, factor: float) -> PathLaw:
    ds, dds, slope, jerk = law.rates
    rates = Rates(
        ds=ds / factor, dds=dds / factor**2, slope=slope / factor**2, jerk=jerk / factor**3
    )
    return replace(law, breaks=law.breaks * factor, rates=rates)
