"""Plans that take a given time: the fastest ones, slowed down.

At a place of the path a limit allows a convex set of pairs (u, x) of path acceleration and squared
path speed, and the set holds (0, 0): a plan is refused where gravity or dry friction alone exceed a
limit. So it holds every pair (u, x) / factor² between, and a motion that takes `factor` times as
long at every place keeps what the fastest keeps. Viscous friction is the exception, as it falls
with the root of x only: where braking leans on it, the slower motion can need more torque. There
the contour is planned again below a lower ceiling of the path speed, and waits for what is left.
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
from armcontour.planning.topp.limits import Ceiling, Form

# A duration shorter than the fastest one by this share differs from it by rounding.
SAME_DURATION = 1e-9
# A contour that is planned again arrives early by at most this share of its time, and waits.
LONGEST_WAIT = 1e-3
MOST_PLANS = 20


def slow_down(
    fastest: Trajectory, duration: float, traced: Tracing | JointPath, timing: Timing
) -> Trajectory:
    """Slow the fastest motion down, so that it takes a given time.

    All contours are slowed down by one factor. Rapids and dwells take the time that they take in
    the fastest motion.

    Args:
        fastest: The fastest motion.
        duration: The time from start to end [s].
        traced: What the joints follow.
        timing: The method of the fastest motion, "optimal".

    Raises:
        NotRealizable: The fastest motion takes longer.
    """
    if isinstance(traced, JointPath):
        factor = _factor(duration, fastest.duration, 0.0)
        return _slow_down(fastest, factor, timing)
    contours = sum(x.t[1] - x.t[0] for x in fastest.contour_spans)
    factor = _factor(duration, contours, fastest.duration - contours)
    done = (x.trajectory for x in fastest.spans if x.trajectory is not None)
    joined = JoinedMoves(traced, timing.arm)
    for step in traced.steps:
        found = None if step.joint_path is None else next(done)
        if found is not None and traced.is_contour(step):
            with step.named():
                found = _slow_down(found, factor, timing)
        joined.add(step, found)
    return joined.trajectory()


def _factor(duration: float, contours: float, others: float) -> float:
    """By how much contours are slowed down, from their time and that of everything else [s]."""
    shortest = contours + others
    if duration < shortest * (1 - SAME_DURATION):
        raise NotRealizable(
            f"The motion cannot take {duration:.9g} s: the fastest that keeps the limits takes "
            f"{shortest:.9g} s; give a longer duration, or raise the limits that bind.",
            limit="duration",
            needed=shortest,
            allowed=duration,
        )
    return max((duration - others) / contours, 1.0)


def _slow_down(fastest: Trajectory, factor: float, timing: Timing) -> Trajectory:
    """The motion along one path in `factor` times its shortest time."""
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
    """The laws of a plan of the method optimal."""
    return tuple(x for x in trajectory.laws if isinstance(x, PathLaw))


def _stretch(law: PathLaw, factor: float) -> PathLaw:
    """The same motion in `factor` times its time."""
    ds, dds, slope, jerk = law.rates
    rates = Rates(
        ds=ds / factor, dds=dds / factor**2, slope=slope / factor**2, jerk=jerk / factor**3
    )
    return replace(law, breaks=law.breaks * factor, rates=rates)


def _plan_slower(fastest: Trajectory, target: float, timing: Timing) -> Trajectory:
    """Plan a motion that takes at most `target` [s], and at least nearly that.

    Raises:
        NotRealizable: No such motion was found.
    """
    options = timing.options
    assert isinstance(options, Optimal)
    joint_path = _laws(fastest)[0].joint_path
    share = (fastest.duration / target) ** 2
    for _ in range(MOST_PLANS):
        slower = (*options.constraints, _Slower(fastest, share))
        found = plan_optimal(
            joint_path, timing.arm, timing.limits, replace(options, constraints=slower)
        )
        if target * (1 - LONGEST_WAIT) <= found.duration < target:
            return found
        share *= (found.duration / (target * (1 - LONGEST_WAIT / 2))) ** 2
    raise NotRealizable(
        f"No motion that takes {target:.9g} s was found: the limits of torque and viscous friction "
        f"leave none near it; the last one took {found.duration:.9g} s.",
        limit="duration",
        needed=found.duration,
        allowed=target,
    )


class _Slower(Constraint):
    """At most a share of the x of another plan along the same joint path.

    Args:
        fastest: The other plan.
        share: The share, not above 1.
    """

    name = "given duration"

    def __init__(self, fastest: Trajectory, share: float) -> None:
        self.fastest, self.share = fastest, share

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The share at grid points; between them nothing depends on it."""
        x: FloatArray = self.share * self.fastest.speed_at(path.grid.s) ** 2
        return (Ceiling(np.stack([x[:-1], x[1:]], axis=1)),)
