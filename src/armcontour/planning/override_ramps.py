"""Override of plans with limits of jerk: the rate changes by smooth ramps.

With limits of jerk, the rate of a plan cannot be kept from a time on at which it changes. Therefore
a change is a ramp, which is checked as a whole: the shortest one within the limits is found by
bisection. If the ramp to the target is long, ramps to rates between are compared with it. The next
change continues from there, also during a ramp or a stop. The speed of a stop in joint space is a
cubic polynomial (`smooth_stop`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.motion import Trajectory
from armcontour.motion.time_scaling import COEFFICIENTS, TimeScaling, on_piece
from armcontour.planning.override import CycleOverride, Override, Pace
from armcontour.planning.smooth_stop import (
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
# Rates that are tried if a ramp to the target takes longer than SHORT_RAMP [s], as shares of the
# change to the target.
RAMP_SHARES = (1.0, 0.95, 0.85, 0.7, 0.5, 0.35, 0.2, 0.1)
SHORT_RAMP = 0.1
# Ramps are compared over the way at the faster of both rates in this time [s].
COMPARED_TIME = 0.3
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
    """

    cruise: TimeScaling


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
        return self._with_stop(cruise, RAMP_TIME_AT_TARGET + delay)

    def change(self, pace: Pace, t: float, target: float) -> Pace:
        """Continue a motion from a time on, as `Override.change` does."""
        assert isinstance(pace, RampedPace)
        if pace.is_complete and t >= pace.brake_time:
            return pace
        if t > pace.brake_time:
            return self._after_stop(pace, t, target)
        cruise = pace.cruise
        if target > 0.0:
            cruise = self._ramp(cruise.until(t), target, cruise) or cruise
            t += RAMP_TIME_AT_TARGET
        return self._with_stop(cruise, t)

    def _after_stop(self, pace: RampedPace, t: float, target: float) -> RampedPace:
        """Continue a motion whose stop has begun: from a time on [s], or else from the rest."""
        end = pace.scaling.end
        for begin in (t, max(t, end)):
            cruise = self._ramp(pace.scaling.until(begin), target) if target > 0.0 else None
            if cruise is not None:
                return self._with_stop(cruise, begin + RAMP_TIME_AT_TARGET)
        return pace if t < end else self._resting(pace.scaling.until(t))

    def _resting(self, scaling: TimeScaling) -> RampedPace:
        """Return a motion that has ended at rest."""
        end = scaling.end
        return RampedPace(
            scaling=scaling,
            cruise=scaling,
            brake_time=end,
            is_complete=self._complete(float(scaling(end))),
        )

    def _steady(self, t: float, tau: float, rate: float) -> TimeScaling:
        """Return the motion with a constant rate until the end of the plan."""
        coefficients = np.zeros((1, COEFFICIENTS))
        coefficients[0, :2] = (tau, rate)
        end = t + (self.plan.duration - tau) / rate
        return TimeScaling(breaks=np.array([t, end]), coefficients=coefficients)

    def _ramp(
        self, kept: TimeScaling, target: float, cruise: TimeScaling | None = None
    ) -> TimeScaling | None:
        """Append the best ramp towards a target, and the constant rate after it, to a motion.

        If the target itself takes a long ramp, rates between are tried, too. The best ramp is
        nearest to the target on average: its motion comes earliest to a place of the plan if the
        rate increases, and latest if it decreases. None if no ramp is within the limits.

        - `cruise`: the motion so far, which is kept if no ramp is better.
        """
        state = kept.state_at(kept.end)
        slope = float(kept(kept.end, 2))
        if abs(state.rate - target) < SAME_RATE and abs(slope) < SAME_RATE:
            return kept.followed_by(self._steady(kept.end, state.tau, state.rate))
        if state.rate < SAME_RATE and self._plan_rests(state.tau):
            # After a pause at a rest of the plan, the rate can have any value, as at the start.
            return kept.followed_by(self._steady(kept.end, state.tau, target))
        way = COMPARED_TIME * max(state.rate, target)
        place = np.array([min(state.tau + way, self.plan.duration)])
        sign = 1.0 if target > state.rate else -1.0
        best = cruise
        arrival = math.inf if cruise is None else sign * float(cruise.times_of(place)[0])
        longest = LONGEST_RAMP
        rates = [_towards(state.rate, target, share) for share in RAMP_SHARES]
        if sign * slope < 0.0:
            # With a constant second derivative of the rate, its change ends soonest.
            rates.append(lambda duration: state.rate + slope * duration / 2)
        for rate_after in rates:
            found = self._shortest_ramp(kept, rate_after, longest)
            if found is None:
                continue
            motion, longest = found
            reached = sign * float(motion.times_of(place)[0])
            if reached < arrival:
                best = motion
                arrival = reached
            if longest < SHORT_RAMP:
                break
        return best

    def _shortest_ramp(
        self, kept: TimeScaling, rate_after: Callable[[float], float], longest: float
    ) -> tuple[TimeScaling, float] | None:
        """Append the shortest ramp that is found, and the constant rate after it, to a motion.

        Returns the motion and the duration of the ramp [s]; None if no ramp is within the limits.

        - `rate_after`: returns the rate at the end of a ramp of some duration [s].
        - `longest`: the longest duration that is tried [s].
        """
        high = SHORTEST_RAMP
        found = self._ramp_in(kept, rate_after(high), high)
        while found is None:
            high *= 2
            if high > longest:
                return None
            found = self._ramp_in(kept, rate_after(high), high)
        low = high / 2
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            shorter = self._ramp_in(kept, rate_after(middle), middle)
            if shorter is None:
                low = middle
            else:
                high = middle
                found = shorter
        return found, high

    def _plan_rests(self, tau: float) -> bool:
        """Return whether the plan is at rest at one of its times [s]."""
        return bool(np.abs(self.plan(tau, 1)).max() < REST_JOINT_SPEED)

    def _ramp_in(self, kept: TimeScaling, target: float, duration: float) -> TimeScaling | None:
        """Return the motion with a ramp of some duration [s]; None if a limit is exceeded.

        The rate is the cubic r + u t + a t² + b t³ with the rate r and the slope u at the end of
        `kept`, the rate `target` and the slope 0 at the end of the ramp.
        """
        state = kept.state_at(kept.end)
        slope = float(kept(kept.end, 2))
        change = target - state.rate
        square = (3 * change - 2 * slope * duration) / duration**2
        cube = (slope * duration - 2 * change) / duration**3
        ramp = np.array([[state.tau, state.rate, slope / 2, square / 3, cube / 4, 0.0]])
        end = kept.end + duration
        piece = TimeScaling(breaks=np.array([kept.end, end]), coefficients=ramp)
        rates = piece(np.linspace(kept.end, end, FEW_CHECKS), 1)
        if rates.min() < 0.0 or rates.max() > 1.0 + SAME_RATE:
            return None
        reached = float(piece(end))
        motion = kept.followed_by(piece)
        if reached < self.plan.duration:
            motion = motion.followed_by(self._steady(end, reached, target))
        else:
            end = float(motion.times_of(np.array([self.plan.duration]))[0])
            motion = motion.until(end)
        return motion if self._is_within(motion.until(end).since(kept.end)) else None

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

    def _with_stop(self, cruise: TimeScaling, t: float) -> RampedPace:
        """Return a motion that stops from a time on [s], or at the end of the plan before."""
        if t >= cruise.end:
            return self._pace(cruise, cruise, cruise.end)
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
                return self._pace(stopped, cruise, begin)
        # The plan itself rests before any stop.
        return self._pace(cruise.until(rest_time), cruise, rest_time)

    def _pace(self, scaling: TimeScaling, cruise: TimeScaling, brake_time: float) -> RampedPace:
        """Return the motion with a stop that begins at `brake_time` [s]."""
        is_complete = self._complete(float(scaling(scaling.end)))
        return RampedPace(
            scaling=scaling,
            cruise=cruise,
            brake_time=brake_time,
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
        if found is None:
            return None
        return cruise.until(t).followed_by(_composed(part, found, t))


def _towards(rate: float, target: float, share: float) -> Callable[[float], float]:
    """Return the rate after a share of the change to a target, for ramps of every duration."""
    return lambda duration: rate + share * (target - rate)


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
