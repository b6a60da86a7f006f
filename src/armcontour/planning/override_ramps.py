"""Override of plans with limits of jerk: the rate changes by smooth ramps.

With limits of jerk, the rate of a plan cannot be kept from a time on at which it changes. Therefore
a change is one ramp, which is checked as a whole: the shortest one within the limits is found by
bisection. A stop is that of `stop`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.motion import Trajectory
from armcontour.motion.time_scaling import COEFFICIENTS, TimeScaling, on_piece
from armcontour.planning.override import CycleOverride, Override, Pace
from armcontour.planning.stop_in_play import (
    REST_JOINT_SPEED,
    next_rest,
    path_over_time,
    smooth_stop,
)
from armcontour.robot import Limits
from armcontour.robot.limit_use import States

# Shortest and longest ramp that are tried [s].
SHORTEST_RAMP = 0.02
LONGEST_RAMP = 4.0
# Number of bisections of the duration of a ramp.
BISECTIONS = 5
# Number of times at which a ramp is checked first, and time between those of the second check [s].
FEW_CHECKS = 40
CHECK_INTERVAL = 2e-3
# A stop is searched on this time of the motion, and then until the next rest of the plan [s].
STOP_HORIZON = 3.0
# Between the times at which it is checked, the jerk may be larger by this fraction of its limit.
JERK_MARGIN = 3e-3
# Time at the wanted override before the stop at the end of a motion begins [s]. A stop takes more
# computing time than without limits of jerk.
RAMP_TIME_AT_TARGET = 0.4
# Delays of a stop that are tried if it is not possible at once [s].
STOP_DELAYS = (0.0, 0.05, 0.1, 0.2)
# Rates that differ by less are equal.
SAME_RATE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RampedPace(Pace):
    """A motion through a plan with ramps.

    Args:
        cruise: Time of the plan without the stop: after the last ramp the rate is constant until
            the end of the plan.
        steady_from: Time at which the last ramp ends [s].
    """

    cruise: TimeScaling
    steady_from: float


class RampOverride(Override):
    """Override of a plan with limits of jerk."""

    def __init__(self, plan: Trajectory, cycle: float, *, for_play: bool) -> None:
        super().__init__(plan, cycle, for_play=for_play)
        self._planned_breaks = plan.smooth_breaks
        jerk = self.limits.joint_jerk
        if jerk is not None:
            self.limits = self.limits.replace(joint_jerk=(1 - JERK_MARGIN) * jerk)

    def begin(self, target: float, delay: float = 0.0) -> Pace:
        """Begin the motion from rest at the start of the plan, with the override `target`."""
        if target == 0.0:
            rest = TimeScaling.at_rest(0.0, 0.0, self.cycle)
            return self._resting(rest)
        # At rest, the rate can have any value.
        cruise = self._steady(0.0, 0.0, target)
        return self._with_stop(cruise, 0.0, RAMP_TIME_AT_TARGET + delay)

    def change(self, pace: Pace, t: float, target: float) -> Pace:
        """Continue a motion from a time on, as `Override.change` does."""
        assert isinstance(pace, RampedPace)
        if pace.is_complete and t >= pace.brake_time:
            return pace
        cruise = pace.cruise
        steady_from = pace.steady_from
        if t > pace.brake_time:
            # The stop at the end has begun. Only at its end, the rate can change again.
            t = max(t, pace.scaling.end)
            cruise = pace.scaling.until(t)
            steady_from = t
        if target == 0.0:
            if cruise.state_at(t).rate < SAME_RATE:
                return self._resting(cruise.until(t))
            return self._with_stop(cruise, steady_from, t)
        begin = max(t, steady_from)
        # A ramp can end at the end of the plan, after which none can follow.
        if begin < cruise.end or steady_from == t:
            ramped = self._ramp(cruise.until(begin), target)
            if ramped is None and cruise.state_at(begin).rate < SAME_RATE:
                return self._resting(cruise.until(begin))
            if ramped is not None:
                cruise, steady_from = ramped
        return self._with_stop(cruise, steady_from, t + RAMP_TIME_AT_TARGET)

    def _resting(self, scaling: TimeScaling) -> RampedPace:
        """Return a motion that has ended at rest."""
        end = scaling.end
        return RampedPace(
            scaling=scaling,
            cruise=scaling,
            brake_time=end,
            steady_from=end,
            is_complete=self._complete(float(scaling(end))),
        )

    def _steady(self, t: float, tau: float, rate: float) -> TimeScaling:
        """Return the motion with a constant rate until the end of the plan."""
        coefficients = np.zeros((1, COEFFICIENTS))
        coefficients[0, :2] = (tau, rate)
        end = t + (self.plan.duration - tau) / rate
        return TimeScaling(breaks=np.array([t, end]), coefficients=coefficients)

    def _ramp(self, kept: TimeScaling, target: float) -> tuple[TimeScaling, float] | None:
        """Append the shortest ramp to a target, and the constant rate after it, to a motion.

        Returns the motion and the end of the ramp [s]; None if no ramp is within the limits.
        """
        state = kept.state_at(kept.end)
        if abs(state.rate - target) < SAME_RATE:
            return (kept.followed_by(self._steady(kept.end, state.tau, state.rate)), kept.end)
        if state.rate < SAME_RATE and self._plan_rests(state.tau):
            # After a pause at a rest of the plan, the rate can have any value, as at the start.
            return (kept.followed_by(self._steady(kept.end, state.tau, target)), kept.end)
        duration = SHORTEST_RAMP
        found = None
        while found is None and duration <= LONGEST_RAMP:
            found = self._ramp_in(kept, target, duration)
            duration = 2 * duration
        if found is None:
            return None
        high = duration / 2
        low = high / 2
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            shorter = self._ramp_in(kept, target, middle)
            if shorter is None:
                low = middle
            else:
                high = middle
                found = shorter
        return found

    def _plan_rests(self, tau: float) -> bool:
        """Return whether the plan is at rest at one of its times [s]."""
        return bool(np.abs(self.plan(tau, 1)).max() < REST_JOINT_SPEED)

    def _ramp_in(
        self, kept: TimeScaling, target: float, duration: float
    ) -> tuple[TimeScaling, float] | None:
        """Return the motion with a ramp of some duration [s]; None if a limit is exceeded."""
        state = kept.state_at(kept.end)
        change = target - state.rate
        ramp = np.zeros((1, COEFFICIENTS))
        ramp[0, :2] = (state.tau, state.rate)
        # The rate is that of the cubic with slope 0 at both ends.
        ramp[0, 3:5] = (change / duration**2, -change / (2 * duration**3))
        end = kept.end + duration
        piece = TimeScaling(breaks=np.array([kept.end, end]), coefficients=ramp)
        reached = float(piece(end))
        motion = kept.followed_by(piece)
        if reached < self.plan.duration:
            motion = motion.followed_by(self._steady(end, reached, target))
        else:
            end = float(motion.times_of(np.array([self.plan.duration]))[0])
            motion = motion.until(end)
        checked = motion.until(end).since(kept.end)
        return (motion, end) if self._is_within(checked) else None

    def _is_within(self, scaling: TimeScaling) -> bool:
        """Return whether a part of the motion is within the limits."""
        trajectory = scaling.trajectory(self.plan)
        end = trajectory.duration
        many = max(int(end / CHECK_INTERVAL), FEW_CHECKS)
        breaks = self._smooth_breaks(scaling)
        for times in (np.linspace(0.0, end, FEW_CHECKS), np.linspace(0.0, end, many), breaks):
            for side in ("right", "left"):
                states = States(self.arm, trajectory.motion(times, 3, side=side))
                if any((use.ratio > 1).any() for use in states.uses(self.limits)):
                    return False
        return True

    def _smooth_breaks(self, scaling: TimeScaling) -> FloatArray:
        """Return the times of a motion between which it is smooth [s]."""
        planned = self._planned_breaks
        begin, end = (float(scaling(x)) for x in (scaling.begin, scaling.end))
        passed = scaling.times_of(planned[(planned > begin) & (planned < end)])
        return np.unique(np.concatenate([scaling.breaks, passed]))

    def _with_stop(self, cruise: TimeScaling, steady_from: float, t: float) -> RampedPace:
        """Return a motion that stops from a time on [s], or at the end of the plan before."""
        if t >= cruise.end:
            return self._pace(cruise, cruise, steady_from, cruise.end)
        rest = next_rest(self.plan, float(cruise(t)))
        rest_time = float(cruise.times_of(np.array([rest]))[0])
        full = self.plan.limits_for(None)
        # Later, less of the reserve may be needed. The last attempts use all of it.
        attempts = [
            *((self.limits, t + delay, STOP_HORIZON) for delay in STOP_DELAYS),
            (full, t, STOP_HORIZON),
            (full, t, np.inf),
        ]
        for limits, begin, horizon in attempts:
            if begin >= rest_time:
                continue
            stopped = self._stop_within(cruise, begin, min(begin + horizon, rest_time), limits)
            if stopped is not None and stopped.end < rest_time:
                return self._pace(stopped, cruise, steady_from, begin)
        # The plan itself rests before any stop.
        return self._pace(cruise.until(rest_time), cruise, steady_from, rest_time)

    def _pace(
        self, scaling: TimeScaling, cruise: TimeScaling, steady_from: float, brake_time: float
    ) -> RampedPace:
        """Return the motion with a stop that begins at `brake_time` [s]."""
        is_complete = self._complete(float(scaling(scaling.end)))
        return RampedPace(
            scaling=scaling,
            cruise=cruise,
            brake_time=brake_time,
            steady_from=steady_from,
            is_complete=is_complete,
        )

    def _stop_within(
        self, cruise: TimeScaling, t: float, end: float, limits: Limits
    ) -> TimeScaling | None:
        """Stop a motion between two times [s]; None if that is impossible."""
        part = cruise.until(end).since(t)
        moving: Trajectory = part.trajectory(self.plan)
        breaks = self._smooth_breaks(part)
        path = path_over_time(moving, 0.0, moving.duration, breaks)
        inner = breaks[(breaks > 0) & (breaks < moving.duration)]
        found = smooth_stop(inner, path, self.arm, limits)
        if found is None or found.scaling is None:
            return None
        return cruise.until(t).followed_by(_composed(part, found.scaling, t))


def _composed(outer: TimeScaling, inner: TimeScaling, begin: float) -> TimeScaling:
    """Return the time scaling outer(inner(t - begin)), by its values at the breaks of `inner`."""
    pieces = np.arange(len(inner.coefficients))
    ends = []
    for elapsed in (np.zeros(len(pieces)), np.diff(inner.breaks)):
        s, rate, slope = (on_piece(inner.coefficients, elapsed, k) for k in range(3))
        tau, first, second = (outer(s, k) for k in range(3))
        ends.append((tau, first * rate, second * rate**2 + first * slope))
    return TimeScaling.hermite(begin + inner.breaks, *ends)


def override_of(plan: Trajectory, cycle: float, *, for_play: bool) -> Override:
    """Return the override of a plan: by ramps if its jerk is limited, otherwise cycle by cycle."""
    kind = RampOverride if plan.limits_for(None).limits_jerk else CycleOverride
    return kind(plan, cycle, for_play=for_play)
