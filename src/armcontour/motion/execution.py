"""Joint set-points with their check, and the executed motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Protocol

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, Frozen, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.pictures import Pictured
from armcontour.core.quantities import Axes, Quantity, Time
from armcontour.core.quintics import evaluate, quintic
from armcontour.core.render import number
from armcontour.core.text import short_repr
from armcontour.motion.cycle import check_cycle
from armcontour.motion.set_point_rule import SetPointExcess, SetPointRule, SetPointUse, make_rule
from armcontour.motion.trajectory import Trajectory
from armcontour.robot import Arm, Limits
from armcontour.robot.arm import unit_of
from armcontour.robot.limits import LIMITS

# Largest distance between the end of a plant's motion and the next sample [rad].
SAME_END_POSITION = 1e-9
# Largest distance of a time from a whole number of steps [steps].
WHOLE_STEPS = 1e-3
# The start of the plan coincides with a set-point if their times differ by less than this fraction
# of a cycle.
WHOLE_CYCLES = 1e-9
# Time between samples of an execution made from a plan [s]; longer for a plan of many samples.
PLANNED_STEP = 1e-3
# Largest number of samples in an execution made from a plan.
MAX_PLANNED_SAMPLES = 20_000
# A demand above the achieved value by more than this fraction means that a joint is saturated.
SATURATION_DIFFERENCE = 1e-9


class MotionSource(Protocol):
    """A plant that provides the motion between the samples of an execution."""

    def motion_between(self, executed: Execution, indices: IntArray) -> FineMotion | None:
        """Return the motion of `executed` from samples `indices` to the next; None if unknown."""

    def smooth_steps(self, executed: Execution) -> BoolArray:
        """Return whether `motion_between` is a quintic from each sample to the next, (n - 1,)."""


@declared(eq=False)
class Execution(Checked, Pictured):
    """The joint motion of a plant, from the first set-point until rest.

    >>> executed.q.shape == (len(executed.t), arm.dof)
    True

    Args:
        arm: The arm that moved.
        set_points: The set-points that the plant executed.
        t: Regular times [s], (n,).
        q, dq, ddq: Joint positions, velocities and accelerations [rad, rad/s, rad/s²], (n, dof).
        demand: Accelerations that the servos demand, before saturation [rad/s²], (n, dof).
        demand_range: Lowest and highest demand at any time, not only at `t` [rad/s²], (2, dof).
        saturated_time: Time in saturation of each joint [s], (dof,).
        torque: Torques of the drives [N m], (n, dof); None from a plant without torques.
        torque_demand: Torques before saturation [N m], (n, dof); None without `torque`.
        unsettled: Distances of the joints from the last set-point at the end [rad], (dof,); None if
            the joints are at rest there.
        model_error: Largest error of each joint that the servo model of the plant does not explain
            [rad], (dof,); None if unknown.
        plant: The plant, which provides the motion between the times `t`, so `evaluate` includes
            peaks there; None if only the samples are known, as from a log or changed arrays.

    Raises:
        InvalidInput: Only one of `torque` and `torque_demand` is given.
    """

    arm: Arm
    set_points: SetPoints
    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    demand: FloatArray
    demand_range: FloatArray
    saturated_time: FloatArray
    torque: FloatArray | None = None
    torque_demand: FloatArray | None = None
    unsettled: FloatArray | None = None
    model_error: FloatArray | None = None
    plant: MotionSource | None = None

    def _check_together(self) -> None:
        if (self.torque is None) != (self.torque_demand is None):
            raise InvalidInput("An execution must have both torque and torque_demand, or neither.")

    __repr__ = short_repr

    @classmethod
    @checked
    def from_plan(cls, trajectory: Trajectory, arm: Arm) -> Execution:
        """Return the execution by joints that follow a plan exactly.

        Args:
            trajectory: The plan.
            arm: The arm of the plan.
        """
        cycle = max(PLANNED_STEP, trajectory.duration / MAX_PLANNED_SAMPLES)
        samples = trajectory.sample(cycle)
        set_points = SetPoints(cycle=cycle, q=samples.q, trajectory=trajectory, method="none")
        return cls(
            arm=arm,
            set_points=set_points,
            t=samples.t,
            q=samples.q,
            dq=samples.dq,
            ddq=samples.ddq,
            demand=samples.ddq,
            demand_range=np.stack([samples.ddq.min(axis=0), samples.ddq.max(axis=0)]),
            saturated_time=np.zeros(arm.dof),
        )

    def between(self, indices: IntArray) -> FineMotion | None:
        """Return the motion from samples to the next samples; None if it is unknown.

        The plant's motion is used only if the samples are at its steps and the motion ends at the
        next samples, because a cut or changed execution may have other samples.

        Args:
            indices: Indices of the samples at which the motion starts, increasing, (m,).
        """
        if self.plant is None or not self._are_steps(indices).all():
            return None
        motion = self.plant.motion_between(self, indices)
        if motion is None:
            return None
        deviation = np.abs(motion(self.t[indices + 1]) - self.q[indices + 1])
        return motion if deviation.max(initial=0.0) < SAME_END_POSITION else None

    def smooth_steps(self) -> BoolArray:
        """Return the samples from which `between` is the quintic to the next one, as a mask.

        The quintic has the positions, velocities and accelerations of both samples. The mask has
        the shape (n - 1,) for n samples.
        """
        steps = self._are_steps(np.arange(len(self.t) - 1))
        if self.plant is None or not steps.any():
            return np.zeros(len(steps), dtype=np.bool_)
        return steps & self.plant.smooth_steps(self)

    def _are_steps(self, indices: IntArray) -> BoolArray:
        """Return whether samples are one step before the next, (m,).

        The cycle must be a whole number of steps.
        """
        step = float(self.t[1] - self.t[0])
        cycle = self.set_points.cycle
        if not 0 < step < cycle * (1 + WHOLE_STEPS):
            return np.zeros(len(indices), dtype=np.bool_)
        steps = cycle / step
        numbers = (self.t[np.stack([indices, indices + 1])] - self.set_points.start_time) / step
        whole = numbers.round()
        at_steps = (abs(numbers - whole) < WHOLE_STEPS).all(axis=0)
        is_whole = abs(steps - round(steps)) < WHOLE_STEPS
        return np.asarray(at_steps & (whole[1] - whole[0] == 1) & is_whole)

    @property
    def peak_demand(self) -> FloatArray:
        """Largest absolute demand of each joint at any time [rad/s²], (dof,)."""
        return np.asarray(np.abs(self.demand_range).max(axis=0))

    @property
    def tool(self) -> FloatArray:
        """Positions of the tool [m], (n, dimension)."""
        return self.arm.tool_position(self.q)

    @property
    def tool_speed(self) -> FloatArray:
        """Tool speed [m/s], (n,)."""
        return np.asarray(np.linalg.norm(self.arm.tool_velocity(self.q, self.dq), axis=1))

    @property
    def saturated(self) -> BoolArray:
        """Mask of the times at which a joint is saturated, (n, dof)."""
        demanded = self.demand
        achieved = self.ddq
        if self.torque is not None and self.torque_demand is not None:
            demanded = self.torque_demand
            achieved = self.torque
        return np.asarray(np.abs(demanded - achieved) > SATURATION_DIFFERENCE * np.abs(demanded))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FineMotion:
    """Joint motion as polynomials between nodes, with the velocities on both sides of each node.

    Args:
        t: Times of the nodes [s], (n,); the same time twice where one interval ends and another
            begins.
        q: Joint positions [rad], (n, dof).
        before: Joint velocities before each node [rad/s], (n, dof).
        after: Joint velocities after each node [rad/s], (n, dof).
        ddq: Joint accelerations, which do not jump [rad/s²], (n, dof), if the polynomials are
            quintics; None for cubics.
    """

    t: FloatArray
    q: FloatArray
    before: FloatArray
    after: FloatArray
    ddq: FloatArray | None = None

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return joint positions [rad], (len(t), dof), at times `t` between first and last node."""
        nodes = self.t
        i: Any = slice(0, 1)
        if len(nodes) > 2:
            i = np.minimum(nodes[1:-1].searchsorted(t, side="right"), len(nodes) - 2)
        widths = nodes[1:] - nodes[:-1]
        if self.ddq is not None:
            begin = self.q[:-1], self.after[:-1], self.ddq[:-1]
            end = self.q[1:], self.before[1:], self.ddq[1:]
            return evaluate(quintic(widths, begin, end)[i], widths[i], t - nodes[:-1][i], 0)
        width = widths[i, None]
        x = (t[:, None] - nodes[:-1][i, None]) / width
        rise = (self.q[1:] - self.q[:-1])[i]
        # Cubic c0 + c1 x + c2 x² + c3 x³ with positions and velocities at both ends.
        c1 = width * self.after[:-1][i]
        end_slope = width * self.before[1:][i]
        c3 = c1 + end_slope - 2 * rise
        remainder = x * (rise - c1 - c3 + x * c3)
        return np.asarray(self.q[:-1][i] + x * (c1 + remainder))

    @classmethod
    def through(
        cls, t: FloatArray, q: FloatArray, dq: FloatArray, ddq: FloatArray | None, indices: IntArray
    ) -> FineMotion:
        """Make the polynomial motion from each of the samples `indices` to the next sample.

        Args:
            t: Times of all samples [s], (n,).
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof), or None.
            indices: Increasing indices of the samples, (m,).
        """
        i = (indices[:, None] + np.arange(2)).ravel()
        velocities = dq[i]
        accelerations = None if ddq is None else ddq[i]
        return cls(t=t[i], q=q[i], before=velocities, after=velocities, ddq=accelerations)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitCost(Frozen):
    """Cost of command limits: the changes of the set-points that the limits require.

    Args:
        deviation: Largest change of the set-points of each joint [rad], (dof,).
        contour_rms: RMS contour error that the changes cause according to the servo model, if the
            set-points without limits cause none and no joint saturates [m]; None if the plan has no
            arm or no path.
        contour_max: Largest such contour error [m], or None.
        arm: The arm, for units; None if unknown.
    """

    deviation: FloatArray
    contour_rms: float | None = None
    contour_max: float | None = None
    arm: Arm | None = None

    def __str__(self) -> str:
        """Summary: largest change of a set-point, and largest contour error."""
        j = int(np.argmax(self.deviation))
        change = number(self.deviation[j], unit_of(self.arm, "rad", j))
        text = f"up to {change} at joint {j + 1}"
        largest = self.contour_max
        if largest is None:
            return text
        return f"{text}, contour error {number(largest, 'm')} if no joint saturates"


@declared(eq=False)
class SetPoints(Checked):
    """Joint set-points at regular times.

    >>> set_points.q.shape == (len(set_points.t), arm.dof), set_points.cycle
    (True, 0.004)

    Args:
        cycle: Cycle [s].
        q: Set-points [rad], (n, dof); set-point k is due k cycles after the first. Before the
            first and after the last set-point the command is constant.
        trajectory: The realizable trajectory that the joints should follow.
        method: Name of the compensation method that made the set-points.
        start_time: Time of the first set-point [s], not above 0. The planned motion starts at 0;
            set-points with a time advance start before.
        truncated: Bound of each joint's error after the planned motion because the transient of its
            set-points is cut off [rad], (dof,); None if it is complete.
        rule: Limits of the set-points, with which they were computed; by default those of the plan
            and the assumed ones, with which they are judged.
        limit_cost: Cost of these limits; None if they change no set-point.
        servo_text: The servo that the set-points compensate, such as "assumed servo: kp 25 1/s,
            kv 150 1/s"; empty without compensation.

    Raises:
        InvalidInput: The set-points are not finite numbers, (n, dof), the interval is outside
            INTERVALS, or the start time is above 0.
    """

    cycle: float
    q: Annotated[FloatArray, Quantity("rad"), Axes("n", "joints")]
    trajectory: Trajectory
    method: str
    start_time: Time = 0.0
    truncated: FloatArray | None = None
    rule: SetPointRule = None  # type: ignore[assignment]
    limit_cost: LimitCost | None = None
    servo_text: str = ""

    def __post_init__(self) -> None:
        """Complete the rule, then check the fields."""
        if self.rule is None and np.ndim(self.q) == 2 and isinstance(self.trajectory, Trajectory):
            dof = np.shape(self.q)[1]
            is_same_arm = self.trajectory.dof == dof
            limits = self.trajectory.limits_for(None) if is_same_arm else Limits()
            object.__setattr__(self, "rule", make_rule(limits, dof))
        Checked.__post_init__(self)

    def _check_together(self) -> None:
        check_cycle(self.cycle)
        if not len(self.q):
            raise InvalidInput("SetPoints need at least one row, with one set-point per joint.")
        if self.start_time > 0:
            raise InvalidInput(
                "start_time must not be above 0 s, the time at which the plan starts, but is "
                f"{self.start_time:g} s."
            )

    __repr__ = short_repr

    @property
    def use(self) -> SetPointUse:
        """How far the set-points use their limits, as a controller would judge them."""
        return self.rule.judge(self.q, self.cycle)

    def __len__(self) -> int:
        """Return the number of set-points."""
        return len(self.q)

    @property
    def t(self) -> FloatArray:
        """Times of the set-points [s], (n,); the planned motion starts at 0."""
        return self.times(len(self.q), self.cycle)

    def times(self, count: int, step: float) -> FloatArray:
        """Return regular times [s], (count,), that start at the first set-point.

        If the first time is a multiple of the step, so are all times, without rounding errors.

        Args:
            count: Number of times.
            step: Time between two times [s].
        """
        indices = np.arange(count, dtype=np.float64)
        first_index = self.start_time / step
        if abs(first_index - round(first_index)) < WHOLE_CYCLES:
            return np.asarray((indices + round(first_index)) * step)
        return self.start_time + indices * step


def describe_excess(excess: SetPointExcess, set_points: SetPoints) -> str:
    """Write which set-points exceed which limit, whose limit it is, and what to do.

    The first letter is small.
    """
    unit = unit_of(set_points.trajectory.arm, LIMITS[excess.limit].unit, excess.joint)
    found = excess.describe(f"joint {excess.joint + 1}", unit, float(set_points.t[0]))
    return f"the {found}. {excess.remedy}"
