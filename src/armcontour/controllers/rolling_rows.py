"""Rows of a motion whose override changes: computed chunk by chunk, each of which ends at rest.

A chunk replaces the rows from a cycle on. It leads on at the wanted override for some time and then
stops on the path. The next chunk replaces the stop before it begins. If no further chunk comes, for
whatever reason, the robot executes the stop.

The set-points of each chunk are compensated anew, because those of a slower motion differ from
slower set-points. Limits of set-points need no memory: what was sent stays, and the set-points of
the chunk are the nearest ones whose differences, also with the last sent ones, are within limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np

from armcontour.control.compensation import CompensationOptions
from armcontour.control.compensation.compensator import unchecked_set_points
from armcontour.control.compensation.nearest_set_points import extension_of
from armcontour.control.compensation.set_point_times import LONGEST_TAIL
from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import AtLeast, Axes, Quantity
from armcontour.core.sampled_data import interpolate
from armcontour.motion import SetPoints, Trajectory
from armcontour.motion.nearest_commands import nearest_commands
from armcontour.planning.override import Pace
from armcontour.planning.override_ramps import override_of
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.simulation import ServoSimulation, command_weights

# Duration of the rest that is appended to a motion: the joints settle and the last samples arrive
# [s].
FINAL_REST = 1.0
# Tolerance between the rows of a chunk and those before it, which stay [rad].
SAME_ROW = 1e-7
# First guess: the compensation looks ahead by this number of set-points. It is doubled until the
# rows before a chunk no longer change.
FORESIGHT = 16
# Maximum number of set-points by which the compensation may look ahead.
LONGEST_FORESIGHT = 256
# A local compensation is computed from this time before a chunk on [s], and from at least so many
# time constants of the servo: an earlier motion has no effect.
COMPENSATED_TIME = 5.5
MEMORY = 36.0
# Set-points of this order of differences, and of lower ones, have limits.
DIFFERENCES = 3
# First guess with limits: this share of the time by which limited set-points begin earlier.
LIMITED_FORESIGHT = 0.5
# Learned corrections fade out in this time if the override is not 100 %, and in if it is [s].
CORRECTION_FADING = 0.2
# Rates that differ less from 1 are 1.
FULL_RATE = 1e-9
# Rows of this time before a chunk are compared with those of the chunk before [s].
COMPARED_TIME = 0.3
# Rounding error of a number of cycles.
SAME_COUNT = 1e-9
# Times of a plan that differ by less than this [s] are equal.
SAME_PLAN_TIME = 1e-9
# Cycles that differ by less than this [s] are equal.
SAME_CYCLE = 1e-12


def commands_at(set_points: SetPoints, cycle: float, interpolation: str) -> FloatArray:
    """Sample set-points at a controller's cycles [rad], (n, dof), with a rest at the end.

    Args:
        set_points: The set-points.
        cycle: Cycle of the controller [s].
        interpolation: Interpolation between set-points, as in `ServoModel`.
    """
    q = set_points.q
    rest = np.repeat(q[-1:], round(FINAL_REST / cycle), axis=0)
    count = row_count(len(q), set_points.cycle, cycle)
    t = np.asarray(np.arange(count) * cycle, dtype=np.float64)
    return np.concatenate([sample_rows(q, set_points.cycle, interpolation, t), rest])


def row_count(set_points: int, set_point_cycle: float, cycle: float) -> int:
    """Return the number of a controller's cycles in which set-points are executed."""
    duration = (set_points - 1) * set_point_cycle
    return math.ceil(duration / cycle + 0.5 - SAME_COUNT)


def sample_rows(
    q: FloatArray, set_point_cycle: float, interpolation: str, t: FloatArray
) -> FloatArray:
    """Sample set-points at times since the first one [rad], (n, dof)."""
    phase = t / set_point_cycle
    nearest = np.rint(phase)
    if np.abs(phase - nearest).max(initial=0.0) < SAME_CYCLE / set_point_cycle:
        return np.asarray(q[np.minimum(nearest.astype(int), len(q) - 1)])
    index, weight = command_weights(len(q), set_point_cycle, interpolation, t)
    return np.asarray(np.einsum("nk,nkj->nj", weight, q[index]))


@declared(eq=False)
class Chunk(Checked):
    """Rows of a motion from a cycle on, which end at rest.

    Args:
        k: The first cycle, counted from 0.
        q: Joint positions [rad], (n, dof).
        predicted: Measured positions that are expected [rad], (n, dof).
        plan_time: Time of the plan [s], (n,).
        rate: Override with which the plan is executed, (n,).
        correction: Weight of learned corrections, (n,).
        brake: Cycle from which on the stop at the end can no longer be replaced.
        pace: The motion through the plan.
        ends: Whether the motion ends with these rows; otherwise another chunk can follow the rest.
        braked: Whether the stop of the chunk before had begun.
        pause_at: Time of the plan at which the motion pauses, at the end of a contour [s]; infinite
            without a pause.
        set_points: Set-points from which the rows are sampled [rad], (m, dof).
        first: Index of the first of them in the motion.
    """

    k: Annotated[int, AtLeast(0)]
    q: Annotated[FloatArray, Quantity("rad"), Axes("n", "joints")]
    predicted: Annotated[FloatArray, Quantity("rad"), Axes("n", "joints")]
    plan_time: Annotated[FloatArray, Quantity("s"), Axes("n")]
    rate: Annotated[FloatArray, Quantity("1"), Axes("n")]
    correction: Annotated[FloatArray, Quantity("1"), Axes("n")]
    brake: int
    pace: Pace
    ends: bool
    braked: bool = False
    pause_at: float = math.inf
    set_points: Annotated[FloatArray, Quantity("rad"), Axes("m", "joints")]
    first: Annotated[int, AtLeast(0)]

    @property
    def pauses(self) -> bool:
        """True if the rest at the end is the pause, so that no chunk is due before it is over."""
        pace = self.pace
        is_end = pace.end_of_plan >= self.pause_at - SAME_PLAN_TIME
        return is_end and pace.brake_time >= pace.scaling.end

    def rows_between(self, first: int, end: int) -> FloatArray:
        """Return the rows of some cycles [rad], (end - first, dof); after the chunk, its last row.

        Args:
            first: The first cycle.
            end: The cycle after the last one.
        """
        return np.asarray(self.q[np.clip(np.arange(first, end) - self.k, 0, len(self.q) - 1)])

    def set_points_between(self, first: int, end: int) -> FloatArray:
        """Return some set-points [rad], (end - first, dof); outside the chunk, the nearest one.

        Args:
            first: Index in the motion of the first one.
            end: Index of the one after the last one.
        """
        indices = np.clip(np.arange(first, end) - self.first, 0, len(self.set_points) - 1)
        return np.asarray(self.set_points[indices])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window:
    """Set-points near a chunk, from which the measured positions are predicted.

    Args:
        set_points: The set-points; their trajectory begins with the window.
        t: Times of the rows of the chunk since the first set-point [s], (n,).
        q: The rows [rad], (n, dof).
        plan_time: Time of the plan [s], (n,).
    """

    set_points: SetPoints
    t: FloatArray
    q: FloatArray
    plan_time: FloatArray


# Returns the expected measured positions of the rows of a window [rad], (n, dof).
Prediction = Callable[[Window], FloatArray]


def predict_commands(window: Window) -> FloatArray:
    """Predict that the joints are at their commands."""
    return window.q


def predict_plan(plan: Trajectory) -> Prediction:
    """Make the prediction that the joints follow a plan."""
    return lambda window: plan.with_rests(window.plan_time)


def predict_servo(
    servo: ServoModel, dof: int, t: FloatArray, differences: FloatArray
) -> Prediction:
    """Make the prediction by a simulation of the servos.

    - `t`, `differences`: differences of the predicted positions from this simulation [rad],
      (n, dof), at times of the plan [s], (n,).
    """
    model = servo.for_joints(dof)

    def predict(window: Window) -> FloatArray:
        set_points = window.set_points
        cycle = set_points.cycle
        missing = math.ceil(float(window.t[-1]) / cycle) + 3 - len(set_points.q)
        rest = np.repeat(set_points.q[-1:], max(missing, 0), axis=0)
        simulation = ServoSimulation(np.concatenate([set_points.q, rest]), cycle, model)
        # The joints start on the plan. The transient of this error has decayed at the chunk.
        start, speed = set_points.trajectory.motion_with_rests(np.zeros(1), 1)
        later = window.t[window.t > 0.0]
        states = simulation.run_at(np.append(0.0, later), (start[0], speed[0], np.zeros(dof)))
        at_start = np.repeat(start, len(window.t) - len(later), axis=0)
        measured = np.concatenate([at_start, states.states[:, :, 0].T])
        return np.asarray(measured + interpolate(window.plan_time, t, differences))

    return predict


class RollingRows:
    """Computes the chunks of a motion.

    Args:
        set_points: The set-points of the plan at full speed, as the compensation computes them, or
            learned ones. Where they bound joint accelerations, the difference from others that do
            not is a correction.
        servo: The servo model of the compensation.
        options: Options of the compensation.
        arm: The arm.
        cycle: Cycle of the controller [s].
        predict: Predicts the measured positions.
        computed: With learned set-points, those that the compensation computes. The differences are
            corrections, which fade out while the override is not 100 %.
        for_play: Whether the plan was made with `PlanOptions.for_play`.
    """

    @checks.explained
    def __init__(
        self,
        set_points: SetPoints,
        servo: ServoModel,
        options: CompensationOptions,
        arm: Arm,
        cycle: float,
        predict: Prediction = predict_commands,
        *,
        computed: SetPoints | None = None,
        for_play: bool = False,
    ) -> None:
        self.set_points = set_points
        self.servo = servo
        self.options = options
        self.arm = arm
        self.cycle = cycle
        self.predict = predict
        self.q = commands_at(set_points, cycle, servo.interpolation)
        plan = set_points.trajectory
        self._override = override_of(plan, cycle, for_play=for_play)
        self._start_time = set_points.start_time
        rule = replace(set_points.rule, cycle=min(set_points.rule.cycle or math.inf, cycle))
        bounds = rule.at_cycle(set_points.cycle)
        # Bounds of set-points, (4, 2, dof); None if the compensation changes none.
        self._bounds = bounds if options.compensates and np.isfinite(bounds).any() else None
        self._unlimited = rule.without_limits()
        # Limited set-points reach the end of a motion at most so many cycles after the others.
        extension = extension_of(servo.for_joints(plan.dof), bounds)
        self._tails = [math.ceil(x / set_points.cycle) for x in (extension, LONGEST_TAIL)]
        # Limits look ahead, too.
        self._foresight = FORESIGHT
        if self._bounds is not None:
            self._foresight = max(FORESIGHT, math.ceil(LIMITED_FORESIGHT * self._tails[0]))
        self._corrections: FloatArray | None = None
        # Set-points within limits are corrected, otherwise rows.
        self._correction_cycle = cycle if self._bounds is None else set_points.cycle
        if computed is not None:
            # If the robot has more dead time than its model, learned set-points start whole cycles
            # earlier than the computed set-points. Row k of the learned set-points corresponds to
            # row k of the computed set-points in any case.
            self._start_time = computed.start_time
            is_corrected = np.abs(self.q - self._rows_like(computed)).max() > SAME_ROW
        else:
            # A slower motion needs no bounds of the joints' own accelerations.
            cost = set_points.limit_cost
            is_corrected = cost is not None and cost.bounded is not None
        if is_corrected:
            # At full speed, the corrected set-points are those of the plan, within their limits.
            self._corrections = self._corrections_of(self._window_of(plan, 0).set_points)
        self._memory = COMPENSATED_TIME
        if options.is_local:
            slowest = servo.for_joints(plan.dof)
            self._memory += MEMORY * float(slowest.lead[0].max(initial=0.0))
            if slowest.ki.any():
                self._memory += MEMORY / float(slowest.ki[slowest.ki > 0].min())
        else:
            self._memory = math.inf

    def first(self, override: float, ahead: float = 0.0) -> Chunk:
        """Compute the first chunk, from rest at the start of the plan.

        Args:
            override: The wanted override, 0 to 1.
            ahead: Time until the first row that the next chunk can replace [s].

        Raises:
            InvalidInput: The override is not 0 to 1.
        """
        look_ahead = self._look_ahead(self._foresight)
        pace = self._override.begin(_checked(override), ahead + look_ahead)
        window = self._window(pace, 0.0)
        weight = 1.0 if override == 1.0 else 0.0
        if self._bounds is not None:
            limited = self._limit(window, pace, None, 0, weight=weight)
            assert limited is not None
            window = limited
        return self._chunk(pace, window, 0, weight, ends=False, braked=False)

    def next(
        self,
        before: Chunk,
        k: int,
        override: float,
        *,
        ends: bool = False,
        pause_after: bool = False,
    ) -> Chunk:
        """Compute the chunk that replaces the rows from a cycle on.

        Args:
            before: The chunk before, whose rows before k stay.
            k: The cycle, not before `before.k`.
            override: The wanted override, 0 to 1.
            ends: Whether the motion ends with the rest of this chunk.
            pause_after: Whether the motion pauses at the end of the contour that it executes in
                cycle k, or else of the next one.

        Raises:
            NotRealizable: Rows before k would have to change.
            InvalidInput: The override is not 0 to 1.
        """
        target = _checked(override)
        weight = float(before.correction[min(max(k - before.k - 1, 0), len(before.q) - 1)])
        foresight = self._foresight
        while foresight <= LONGEST_FORESIGHT:
            t = k * self.cycle + self._start_time + self._look_ahead(foresight)
            pause_at = self._pause_time(before, t) if pause_after else math.inf
            is_paused = before.pace.scaling(max(t, 0.0)) >= pause_at - SAME_PLAN_TIME
            pace = self._override.change(before.pace, max(t, 0.0), 0.0 if is_paused else target)
            pace = pace.pausing_at(pause_at)
            # A later change would come after the stop of the chunk before has begun.
            later = t + self._look_ahead(2 * foresight) - self._look_ahead(foresight)
            is_last_try = later > before.pace.brake_time or 2 * foresight > LONGEST_FORESIGHT
            window = self._changed(pace, t, before, k, is_last_try)
            if window is not None:
                # The rest at a pause, or at the end of the plan, is not a stop that came too early.
                is_due = before.rate.any() and not before.pauses and not before.pace.is_complete
                braked = bool(is_due and t > before.pace.brake_time)
                chunk = self._chunk(pace, window, k, weight, ends=ends, braked=braked)
                return replace(chunk, pause_at=pause_at)
            foresight *= 2
        raise NotRealizable(
            f"The set-points before cycle {k} depend on the motion after it, because the "
            f"compensation looks ahead by more than {LONGEST_FORESIGHT} set-points. Choose faster "
            "poles."
        )

    def _rows_like(self, set_points: SetPoints) -> FloatArray:
        """Return rows of set-points, as many as those of the plan; at rest after the last one."""
        rows = commands_at(set_points, self.cycle, self.servo.interpolation)
        return rows[np.minimum(np.arange(len(self.q)), len(rows) - 1)]

    def _corrections_of(self, computed: SetPoints) -> FloatArray:
        """Return corrections of computed set-points, or without limits of their rows, (n, dof)."""
        if self._bounds is None:
            return self.q - self._rows_like(computed)
        wanted = self.set_points.q
        numbers = np.arange(max(len(wanted), len(computed.q)))
        last = np.minimum(numbers, len(wanted) - 1)
        last_computed = np.minimum(numbers, len(computed.q) - 1)
        return np.asarray(wanted[last] - computed.q[last_computed])

    def _pause_time(self, before: Chunk, t: float) -> float:
        """Return the time of the plan at which a motion pauses [s]; infinite after all contours.

        It is the end of the contour that is executed at a time of the motion [s], at which the plan
        rests, or a pause that was chosen before.
        """
        if before.pause_at < math.inf:
            return before.pause_at
        ends = [x.t[1] for x in self.set_points.trajectory.contour_spans]
        reached = float(before.pace.scaling(max(t, 0.0)))
        return next((x for x in ends if x > reached + SAME_PLAN_TIME), math.inf)

    def _look_ahead(self, foresight: int) -> float:
        """Return how long before a change of the motion set-points change [s].

        - `foresight`: number of set-points by which the compensation looks ahead.
        """
        return float(np.max(self.servo.dead_time)) + foresight * self.set_points.cycle

    def _compensate(self, trajectory: Trajectory) -> SetPoints:
        """Compute the set-points of a trajectory with the plan's compensation, without limits."""
        return unchecked_set_points(
            trajectory,
            self.servo,
            self.options,
            cycle=self.set_points.cycle,
            arm=self.arm,
            rule=self._unlimited,
        )

    def _window(self, pace: Pace, t: float) -> _Compensated:
        """Compute the set-points of a motion that are needed from shortly before a time on [s]."""
        cycle = self.set_points.cycle
        first = max(math.floor((t - self._memory) / cycle), 0) if self._memory < math.inf else 0
        scaling = pace.scaling
        if not pace.is_complete:
            # Near the end of a motion the compensation differs. A long rest keeps the rows before
            # the rest and in its beginning independent of whether the motion goes on after it.
            scaling = scaling.until(max(scaling.end, t) + 2 * self._foresight * cycle)
        moving = scaling.since(first * cycle).trajectory(self.set_points.trajectory)
        return self._window_of(moving, first)

    def _window_of(self, moving: Trajectory, first: int) -> _Compensated:
        """Compute the set-points, without limits, of a motion that begins after `first` cycles."""
        cycle = self.set_points.cycle
        set_points = self._compensate(moving)
        # Limited set-points begin earlier.
        earlier = (set_points.start_time - self._start_time) / cycle
        extra = round(earlier)
        if abs(earlier - extra) > SAME_ROW or extra < 0:
            raise NotRealizable(
                "The set-points of a slower motion start at another time than those of the plan."
            )
        if not extra:
            return _Compensated(set_points, first)
        if first:
            return _Compensated(set_points, first + extra)
        q = np.pad(set_points.q, ((extra, 0), (0, 0)), mode="edge")
        return _Compensated(replace(set_points, q=q), 0)

    def _limit(
        self,
        window: _Compensated,
        pace: Pace,
        before: Chunk | None,
        k: int,
        *,
        weight: float = 0.0,
        is_last_try: bool = False,
    ) -> _Compensated | None:
        """Return the set-points within their limits; those of rows before a cycle stay.

        The sent set-points are hard conditions of the nearest ones. Only the last DIFFERENCES of
        them enter differences of later ones, so that the result depends on nothing before them.

        None if the set-points sent last would better have been others: the limits look ahead, so
        the change should come later.

        - `before`: the chunk before; None for the first chunk.
        - `k`: the cycle from which on rows can change.
        - `weight`: weight of learned corrections in the first row.
        - `is_last_try`: whether the change comes as late as possible, so that it is made anyway.
        """
        cycle = self.set_points.cycle
        fixed = 1
        if before is not None:
            # The line to this set-point is executed before cycle k.
            last = math.ceil((k - 1) * self.cycle / cycle - SAME_COUNT)
            fixed = last + 1 - window.first
            weight = float(before.correction[min(max(k - before.k - 1, 0), len(before.q) - 1)])
        q = window.set_points.q
        tail = max(self._tails[0], fixed + 1 - len(q))
        q = np.pad(q, ((0, tail), (0, 0)), mode="edge")
        if self._corrections is not None:
            numbers = np.arange(len(q), dtype=np.float64) + window.first
            t = np.asarray(numbers * cycle + self._start_time, dtype=np.float64)
            is_full = _rate(pace, t) >= 1 - FULL_RATE
            weights = np.empty(len(q))
            weights[fixed:] = _fade(is_full[fixed:], weight, cycle / CORRECTION_FADING)
            if before is not None:
                rows = np.rint(numbers[:fixed] * cycle / self.cycle) - before.k
                sent_rows = np.clip(rows, 0, len(before.q) - 1).astype(int)
                weights[:fixed] = before.correction[sent_rows]
            else:
                weights[:fixed] = weight
            q = q + self._correct(_plan_clock(pace, t), weights)
        if before is None:
            return _Compensated(replace(window.set_points, q=self._nearest(q, fixed, k)), 0)
        sent = before.set_points_between(window.first, window.first + fixed)
        compared = max(fixed - math.ceil(COMPARED_TIME / cycle), before.first - window.first, 1)
        if compared < fixed:
            better = self._nearest(np.concatenate([sent[:compared], q[compared:]]), compared, k)
            if not is_last_try and np.abs(better[:fixed] - sent).max() > SAME_ROW:
                return None
        nearest = self._nearest(np.concatenate([sent, q[fixed:]]), fixed, k)
        return _Compensated(replace(window.set_points, q=nearest), window.first)

    def _nearest(self, q: FloatArray, fixed: int, k: int) -> FloatArray:
        """Return the nearest set-points within the limits that end at rest, (m, dof).

        - `q`: set-points [rad], (n, dof).
        - `fixed`: number of set-points at the start that stay.
        - `k`: the cycle, for messages.
        """
        assert self._bounds is not None
        cycle = self.set_points.cycle
        start = max(fixed - DIFFERENCES, 0)
        joint = None
        for tail in (0, self._tails[1]):
            longer = np.pad(q[start:], ((0, tail), (0, 0)), mode="edge")
            nearest, joint = nearest_commands(longer, cycle, self._bounds, fixed=fixed - start)
            if joint is None:
                return np.concatenate([q[:start], nearest])
        assert joint is not None
        raise NotRealizable(
            f"No set-points of joint {joint + 1} from cycle {k} on are within their limits and "
            "reach the end of the motion. Increase timing.reserve."
        )

    def _sample(self, window: _Compensated, cycles: IntArray) -> FloatArray:
        """Sample set-points at cycles of the controller [rad], (n, dof)."""
        points = window.set_points
        t = np.asarray(cycles * self.cycle - window.begin, dtype=np.float64)
        return sample_rows(points.q, points.cycle, self.servo.interpolation, t)

    def _changed(
        self, pace: Pace, t: float, before: Chunk, k: int, is_last_try: bool
    ) -> _Compensated | None:
        """Compute the set-points of a motion that changes at a time [s].

        None if rows before cycle k would have to change.

        - `is_last_try`: whether the change comes as late as possible.
        """
        window = self._window(pace, t)
        if self._bounds is not None:
            return self._limit(window, pace, before, k, is_last_try=is_last_try)
        return window if self._keeps(window, before, k) else None

    def _keeps(self, window: _Compensated, before: Chunk, k: int) -> bool:
        """Return whether the rows before a cycle are those of the chunk before."""
        first = max(k - round(COMPARED_TIME / self.cycle), before.k)
        if first >= k:
            return True
        rows = self._sample(window, np.arange(first, k))
        learned = self._learned(before, first, k)
        return bool(np.abs(rows + learned - before.rows_between(first, k)).max() < SAME_ROW)

    def _learned(self, before: Chunk, first: int, end: int) -> FloatArray | float:
        """Return the learned corrections in rows of a chunk [rad], (end - first, dof)."""
        if self._corrections is None:
            return 0.0
        i = np.clip(np.arange(first, end) - before.k, 0, len(before.q) - 1)
        return self._correct(before.plan_time[i], before.correction[i])

    def _correct(self, plan_time: FloatArray, weight: FloatArray) -> FloatArray:
        """Return learned corrections [rad], (n, dof), by times of the plan [s] and weights."""
        assert self._corrections is not None
        indices = (plan_time - self._start_time) / self._correction_cycle
        number = np.arange(len(self._corrections), dtype=np.float64)
        smooth = weight**3 * (10 - weight * (15 - 6 * weight))
        return interpolate(indices, number, self._corrections) * smooth[:, None]

    def _chunk(
        self,
        pace: Pace,
        window: _Compensated,
        k: int,
        weight: float,
        *,
        ends: bool,
        braked: bool,
    ) -> Chunk:
        """Make the chunk of a motion from a cycle on.

        - `weight`: weight of learned corrections in the row before.
        """
        points = window.set_points
        ends = ends or pace.is_complete
        count = row_count(window.first + len(points.q), points.cycle, self.cycle)
        if ends:
            count = max(count, k) + round(FINAL_REST / self.cycle)
        cycles = np.arange(k, max(count, k + 1))
        t = np.asarray(cycles * self.cycle + self._start_time, dtype=np.float64)
        rate = _rate(pace, t)
        plan_time = _plan_clock(pace, t)
        q = self._sample(window, cycles)
        weights = np.ones(len(q))
        if self._corrections is not None:
            weights = _fade(rate >= 1 - FULL_RATE, weight, self.cycle / CORRECTION_FADING)
            if self._bounds is None:
                q = q + self._correct(plan_time, weights)
        times = np.asarray(cycles * self.cycle - window.begin, dtype=np.float64)
        predicted = self.predict(Window(set_points=points, t=times, q=q, plan_time=plan_time))
        return Chunk(
            k=k,
            q=q,
            predicted=predicted,
            plan_time=plan_time,
            rate=rate,
            correction=weights,
            brake=math.floor((pace.brake_time - self._start_time) / self.cycle),
            pace=pace,
            ends=ends,
            braked=braked,
            set_points=points.q,
            first=window.first,
        )


class _Compensated(NamedTuple):
    """Set-points of a part of a motion, which begins with the set-point `first` of the motion."""

    set_points: SetPoints
    first: int

    @property
    def begin(self) -> float:
        """Time of the part since the first set-point of the motion [s]."""
        return self.first * self.set_points.cycle


def _checked(override: float) -> float:
    """Refuse an override that is not 0 to 1."""
    value = float(override)
    if not 0.0 <= value <= 1.0:
        raise InvalidInput(f"The override must be 0 to 1 (100 %), but is {value:g}.")
    return value


def _plan_clock(pace: Pace, t: FloatArray) -> FloatArray:
    """Return the plan's time [s], which goes on before the start and after the end of the plan."""
    scaling = pace.scaling
    before = np.minimum(t - scaling.begin, 0.0)
    after = np.maximum(t - scaling.end, 0.0) if pace.is_complete else 0.0
    return np.asarray(scaling(t) + before + after)


def _rate(pace: Pace, t: FloatArray) -> FloatArray:
    """Return the override at times of a motion [s]; before and after it, that of its ends."""
    begin = pace.scaling.begin
    last = max(pace.scaling.end - SAME_PLAN_TIME, begin)
    return np.asarray(pace.scaling(np.clip(t, begin, last), 1))


def _fade(is_full: BoolArray, weight: float, step: float) -> FloatArray:
    """Return weights that change towards 1 in full rows and towards 0 in others, (n,).

    - `weight`: weight of the row before.
    - `step`: change per row.
    """
    weights = np.empty(len(is_full))
    for i, full in enumerate(is_full.tolist()):
        weight = min(weight + step, 1.0) if full else max(weight - step, 0.0)
        weights[i] = weight
    return weights
