"""Override: the share of its speed with which a plan is executed, changed during the motion.

The joints move through q(tau(t)), where q is the plan and tau its time. The rate dtau/dt follows
the wanted override within the limits, so the tool stays on its path. Every motion ends at rest,
because it is continued again and again, each time with a stop at its end: see `Pace`.

A joint has the acceleration `q' tau'' + q'' tau'²`. A plan within its limits is within them at
every constant rate up to 1, so the rate may always stay as it is. Therefore the rule needs no look
ahead: in each cycle it changes the rate as far as the limits allow. Changes at full speed need the
reserve of the plan. They use half of it, the other half is left to the servo.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from armcontour.core.checks import FloatArray, IntArray, kernel_array
from armcontour.motion import JointPath, Trajectory, arm_of
from armcontour.motion.time_scaling import COEFFICIENTS, ScalingState, TimeScaling
from armcontour.planning.constraints import FROM_LIMITS, JointMotion, JointTorque, limits_on
from armcontour.planning.override_kernel import (
    DURATION,
    RATE,
    SLOPE,
    TIME,
    OverrideTable,
    follow_override,
)
from armcontour.planning.path_grid import Grid
from armcontour.planning.smooth_stop import path_over_time
from armcontour.planning.topp.sampled_joint_path import SampledJointPath
from armcontour.robot import Arm, Limits
from armcontour.robot.limits import reduce_limits

# Time at the wanted override before the stop at the end of a motion begins [s].
TIME_AT_TARGET = 0.3
# Share of the reserve that changes of the override use.
USED_RESERVE = 0.5
# A table of limits covers this time of the plan [s].
TABLE_TIME = 4.0
# A new table is made if less than this time of the plan is left in the last one [s].
LEAST_TABLE_TIME = 1.0
# A stop is computed in parts of this number of cycles.
STOP_CYCLES = 1000
# Times of a plan that differ by less than this are equal [s].
SAME_TIME = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pace:
    """A motion through a plan that ends at rest, on the path or at the end of the plan.

    Args:
        scaling: Time of the plan during the motion, with the stop at its end.
        brake_time: Time at which this stop begins [s]; the end of the motion if it reaches the end
            of the plan.
        is_complete: Whether the motion reaches the end of the plan.
    """

    scaling: TimeScaling
    brake_time: float
    is_complete: bool

    @property
    def end_of_plan(self) -> float:
        """Time at which the plan is where the motion ends [s]."""
        return float(self.scaling(self.scaling.end))

    def pausing_at(self, tau: float) -> Self:
        """Return the motion that rests at a time of the plan, if it reaches this time.

        The plan itself must rest there, so the motion ends at rest as well, within the limits.

        Args:
            tau: Time of the plan [s].
        """
        if self.end_of_plan <= tau + SAME_TIME:
            return self
        t = float(self.scaling.times_of(np.array([tau]))[0])
        return replace(
            self,
            scaling=self.scaling.until(t),
            brake_time=min(self.brake_time, t),
            is_complete=False,
        )


class Override(ABC):
    """A plan whose override changes during its motion.

    Args:
        plan: The plan, with arm and limits.
        cycle: The wanted override is constant in this time [s].
        for_play: Whether the plan was made with `PlanOptions.for_play`.
    """

    def __init__(self, plan: Trajectory, cycle: float, *, for_play: bool) -> None:
        self.plan = plan
        self.cycle = cycle
        self.arm: Arm = arm_of(plan)
        reserve = USED_RESERVE * plan.reserve
        self.limits: Limits = reduce_limits(plan.limits_for(None), reserve, for_play=for_play)

    @abstractmethod
    def begin(self, target: float, delay: float = 0.0) -> Pace:
        """Begin the motion from rest at the start of the plan.

        Args:
            target: The wanted override, 0 (pause) to 1.
            delay: The stop at the end begins later by this time [s].
        """

    @abstractmethod
    def change(self, pace: Pace, t: float, target: float) -> Pace:
        """Continue a motion from a time on with another override, and with a stop at its end.

        Args:
            pace: The motion, which stays as it is until t.
            t: Time from which on the motion may change [s].
            target: The wanted override, 0 (pause) to 1.
        """

    def _complete(self, tau: float) -> bool:
        """Return whether a time of the plan is its end [s]."""
        return tau >= self.plan.duration - SAME_TIME


class CycleOverride(Override):
    """Override of a plan without limits of jerk: the rate changes in each cycle."""

    def __init__(self, plan: Trajectory, cycle: float, *, for_play: bool) -> None:
        super().__init__(plan, cycle, for_play=for_play)
        self._table: OverrideTable | None = None

    def begin(self, target: float, delay: float = 0.0) -> Pace:
        """Begin the motion from rest, at which the rate can have any value."""
        return self._continue(None, ScalingState(0.0, target), target, delay)

    def change(self, pace: Pace, t: float, target: float) -> Pace:
        """Continue a motion from a time on."""
        if pace.is_complete and t >= pace.brake_time:
            return pace
        kept = pace.scaling.until(t)
        return self._continue(kept, kept.state_at(t), target)

    def _continue(
        self, kept: TimeScaling | None, state: ScalingState, target: float, delay: float = 0.0
    ) -> Pace:
        """Follow the target for some time, then stop.

        - `kept`: the motion before.
        - `delay`: additional time at the target [s].
        """
        t = 0.0 if kept is None else kept.end
        parts = list[FloatArray]()
        tau = state.tau
        rate = state.rate
        if target > 0.0 or rate > 0.0:
            count = round((TIME_AT_TARGET + delay) / self.cycle) if target > 0.0 else 0
            tau, rate = self._follow(parts, tau, rate, target, count)
        brake_time = t + sum(float(x[:, DURATION].sum()) for x in parts)
        while rate > 0.0 and not self._complete(tau):
            tau, rate = self._follow(parts, tau, rate, 0.0, STOP_CYCLES)
        scaling = kept
        if parts:
            scaling = _scaling_of(np.concatenate(parts), t)
            scaling = scaling if kept is None else kept.followed_by(scaling)
        if scaling is None:
            scaling = TimeScaling.at_rest(tau, t, t + self.cycle)
        return Pace(scaling=scaling, brake_time=brake_time, is_complete=self._complete(tau))

    def _follow(
        self, parts: list[FloatArray], tau: float, rate: float, target: float, count: int
    ) -> tuple[float, float]:
        """Append the motion in some cycles to `parts`; return the plan's time [s] and the rate."""
        while count > 0 and not self._complete(tau) and (rate or target):
            table = self._table_at(tau)
            result = np.empty((count, 4))
            done = follow_override(table, (tau, rate), target, self.cycle, result)
            if not done:
                break
            parts.append(result[:done])
            count -= done
            tau, rate = _state_after(result[done - 1], target)
            if abs(tau - float(table.tau[-1])) < SAME_TIME:
                tau = float(table.tau[-1])
        return tau, rate

    def _table_at(self, tau: float) -> OverrideTable:
        """Return a table of the limits that begins at or before a time of the plan [s]."""
        end = self.plan.duration
        table = self._table
        if table is not None and table.tau[0] <= tau:
            left = float(table.tau[-1]) - tau
            if left >= LEAST_TABLE_TIME or (table.tau[-1] >= end and left > 0.0):
                return table
        begin = min(tau, end - self.cycle)
        path = path_over_time(self.plan, begin, min(begin + TABLE_TIME, end))
        self._table = table_of(path, begin, self.arm, self.limits)
        return self._table


def _state_after(motion: FloatArray, target: float) -> tuple[float, float]:
    """Return the plan's time [s] and the rate after a cycle, (4,)."""
    duration = float(motion[DURATION])
    rate = float(motion[RATE] + duration * motion[SLOPE])
    tau = float(motion[TIME] + duration * (motion[RATE] + duration * motion[SLOPE] / 2))
    if abs(rate - target) < SAME_TIME:
        rate = target
    return tau, max(rate, 0.0)


def _scaling_of(motion: FloatArray, begin: float) -> TimeScaling:
    """Return the time scaling with the motion in each cycle, (n, 4), from a time on [s]."""
    breaks = begin + np.append(0.0, np.cumsum(motion[:, DURATION]))
    coefficients = np.zeros((len(motion), COEFFICIENTS))
    coefficients[:, 0] = motion[:, TIME]
    coefficients[:, 1] = motion[:, RATE]
    coefficients[:, 2] = motion[:, SLOPE] / 2
    return TimeScaling(breaks=breaks, coefficients=coefficients)


def table_of(path: JointPath, begin: float, arm: Arm, limits: Limits) -> OverrideTable:
    """Make the table of limits along a joint path over time.

    Limits of speeds are left out, because no speed exceeds that of the plan.

    - `begin`: time of the plan at which the path begins [s].
    """
    pieces: IntArray = np.arange(len(path.breaks) - 1)
    sampled = SampledJointPath(Grid(joint_path=path, s=path.breaks, piece=pieces))
    kinds = [x for x in FROM_LIMITS if x.brakes or x is JointTorque]
    active = [x for x in (kind.from_limits(path, arm, limits) for kind in kinds) if x is not None]
    found = limits_on(sampled, active)
    rows = [found.rows.ends]
    joints = JointMotion.from_limits(path, arm, limits)
    if joints is not None and len(joints.low):
        rows.append(joints.rows(sampled).ends)
    return OverrideTable(
        tau=kernel_array(begin + path.breaks),
        rows=kernel_array(np.concatenate(rows, axis=2)),
        viscous=kernel_array(found.friction.viscous),
        rounds=kernel_array(found.rounds.ends),
        radius=kernel_array(found.rounds.radius),
    )
