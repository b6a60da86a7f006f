"""Plans with a given duration: the fastest plan, slowed down.

At each point of the path, a limit allows a convex set of pairs (u, x) of path acceleration and
squared path speed. The set contains (0, 0), because a plan is refused where gravity or dry friction
alone exceed a limit. Therefore the set contains (u, x) / factor² for every factor >= 1, and a
slowed motion satisfies the limits that the fastest one satisfies. Viscous friction is the
exception, because it is proportional to the root of x: where it assists braking, the slower motion
can need more torque. The contour is then planned again below a ceiling of the path speed, and the
remaining time is spent at rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.motion import JointPath, PathLaw, Rates, Trajectory
from armcontour.planning.constraints import Constraint, OnGrid
from armcontour.planning.optimal import plan_optimal
from armcontour.planning.options import Optimal
from armcontour.planning.program_timing import JoinedMoves, Timing
from armcontour.planning.program_tracing import Tracing
from armcontour.planning.topp.limit_forms import Ceiling, Form

# Durations that differ by less than this share are equal.
SAME_DURATION = 1e-9
# Largest share of a contour's duration that may be spent at rest at its end, if the contour is
# planned again.
MAX_WAIT = 1e-3
MAX_PLANS = 20


def slow_down(
    fastest: Trajectory, duration: float, traced: Tracing | JointPath, timing: Timing
) -> Trajectory:
    """Slow the fastest motion down to a given duration."""
    # All contours are slowed down by one factor. Rapids and dwells keep their durations.
    # `duration`: duration from start to end [s]; `traced`: the tracing or joint path of the motion;
    # `timing`: arm, limits and options with which the fastest motion was planned; the options are
    # `Optimal`.
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
            f"{shortest:.9g} s: give a longer duration, or raise the active limits.",
            limit="duration",
            needed=shortest,
            allowed=duration,
        )
    return max((duration - others) / contours, 1.0)


def _slow_down(fastest: Trajectory, factor: float, timing: Timing) -> Trajectory:
    """Motion along one path in `factor` times its shortest time."""
    if factor == 1.0:
        return fastest
    viscous = timing.limits.joint_torque is not None and np.any(timing.arm.dynamics.chain.viscous)
    if not viscous:
        return replace(fastest, laws=tuple(_stretch(x, factor) for x in _laws(fastest)))
    target = factor * fastest.duration
    slower = _plan_slower(fastest, target, timing)
    (law,) = _laws(slower)
    end, still = np.full(2, law.s[-1]), np.zeros(1)
    wait = PathLaw(
        joint_path=law.joint_path,
        breaks=np.array([0.0, target - slower.duration]),
        s=end,
        rates=Rates(still, still, still, still),
    )
    return replace(slower, laws=(law, wait))


def _laws(trajectory: Trajectory) -> tuple[PathLaw, ...]:
    return tuple(x for x in trajectory.laws if isinstance(x, PathLaw))


def _stretch(law: PathLaw, factor: float) -> PathLaw:
    ds, dds, slope, jerk = law.rates
    rates = Rates(
        ds=ds / factor, dds=dds / factor**2, slope=slope / factor**2, jerk=jerk / factor**3
    )
    return replace(law, breaks=law.breaks * factor, rates=rates)


def _plan_slower(fastest: Trajectory, target: float, timing: Timing) -> Trajectory:
    """Plan a motion whose duration is at most `target` [s] and close to it."""
    options = timing.options
    assert isinstance(options, Optimal)
    joint_path = _laws(fastest)[0].joint_path
    share = (fastest.duration / target) ** 2
    for _ in range(MAX_PLANS):
        slower = (*options.constraints, _ReducedSpeed(fastest, share))
        trajectory = plan_optimal(
            joint_path, timing.arm, timing.limits, replace(options, constraints=slower)
        )
        if target * (1 - MAX_WAIT) <= trajectory.duration < target:
            return trajectory
        share *= (trajectory.duration / (target * (1 - MAX_WAIT / 2))) ** 2
    raise NotRealizable(
        f"No motion that takes {target:.9g} s was found, because the limits of torque and viscous "
        f"friction allow no duration close to it. The last motion takes {trajectory.duration:.9g} "
        "s: give another duration.",
        limit="duration",
        needed=trajectory.duration,
        allowed=target,
    )


class _ReducedSpeed(Constraint):
    """Upper bound of ds²: a share of the ds² of another plan along the same joint path."""

    name = "given duration"

    def __init__(self, fastest: Trajectory, share: float) -> None:
        self.fastest, self.share = fastest, share

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        x: FloatArray = self.share * self.fastest.speed_at(path.grid.s) ** 2
        return (Ceiling(np.stack([x[:-1], x[1:]], axis=1)),)
