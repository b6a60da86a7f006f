"""Use of limits: the value that a limit applies to, the limit, and their ratio."""

# This is the only definition; planner, check, evaluation and reports apply it.

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.robot.arm import Arm
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE, LIMITS, Limit, Limits
from armcontour.robot.serial import SerialArm

# Below this tool speed [m/s] the direction of motion is not defined, so the centripetal
# acceleration is not defined either.
STILL_TOOL = 1e-6
# Below this joint velocity [rad/s] dry friction may have any value up to Coulomb friction, in both
# directions.
STILL_JOINT = 1e-6
# Assumed distance from the only end of a one-sided range to its middle [rad].
ONE_SIDED = np.pi
ORDERS = ("q", "dq", "ddq", "dddq")

# A quantity of the motion as a function of the joint states (q, dq, ...) that it needs.
Quantity = Callable[..., FloatArray]
# Values, (n, dof) of joints or (n,) of the tool, and bounds on their errors.
Bounded = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Use:
    """The use of one limit at some times.

    Args:
        name: Name of the limit, such as a field of `Limits`.
        value: Values in the unit of the limit, (..., dof) for joints or (n,) for the tool; absolute
            values except for joint positions.
        limit: Limits of the values, broadcast to their shape.
        error: Bound on the errors of the values, broadcast to their shape; 0 for exact values.
        zero: Origin from which values and limits are counted, such as the middle of a joint range;
            None for 0. A lower limit is below it.
    """

    name: str
    value: FloatArray
    limit: FloatArray | float
    error: npt.ArrayLike = 0.0
    zero: FloatArray | None = None

    @property
    def ratio(self) -> FloatArray:
        """Ratios of values to limits; NaN is replaced by infinity."""
        return self.ratios()[0]

    @property
    def largest(self) -> FloatArray:
        """Largest ratio of each joint, (dof,); of a limit of the tool a single one, (1,)."""
        if not self.is_linear:
            return np.asarray(self.ratio.max(axis=0))
        # The ratio increases with the value, or decreases if the limit is a lower one. For few
        # columns, this is faster than a maximum along the rows.
        columns = self.value.T if self.value.ndim > 1 else [self.value]
        extreme = np.array([x.max() for x in columns])
        if self.zero is not None:
            lowest = np.array([x.min() for x in columns])
            extreme = np.where(self.limit < self.zero, lowest, extreme)
        return np.asarray(Use(self.name, extreme, self.limit, 0.0, self.zero).ratio)

    @property
    def is_linear(self) -> bool:
        """Whether the ratios are `(value - zero) / (limit - zero)` with one limit per column."""
        return np.ndim(self.limit) < self.value.ndim and not np.any(self.error)

    def ratios(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the ratios of values to limits, their lower bounds, and bounds on their errors."""
        error = np.asarray(self.error)
        used = self.value
        room = np.asarray(self.limit)
        if self.zero is not None:
            used = np.where(room < self.zero, self.zero - used, used - self.zero)
            room = np.abs(room - self.zero)
        # With a very small limit the ratio may overflow.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            ratio = np.asarray(used / room)
            if not error.any() and not np.isnan(ratio).any():
                # The error bound of exact values is [0.0].
                return ratio, ratio, np.zeros(1)
            certain = (used - error) / room
            slack = np.asarray(error / room)
            # NaN is replaced by an infinite ratio with an infinite error.
            return (
                np.where(np.isnan(ratio), np.inf, ratio),
                np.where(np.isnan(certain), -np.inf, certain),
                np.where(np.isnan(slack), np.inf, slack),
            )


def use_of(name: str, limits: Limits, values: FloatArray, error: npt.ArrayLike = 0.0) -> Use:
    """Compute how much of a limit the values of its quantity use; nothing without a limit.

    Args:
        name: Name of the limit, a field of `Limits`.
        limits: The limits.
        values: Joint values, (..., dof), tool values, (n,), or tool vectors, (n, dimension).
        error: Bound on the error of the values, or on that of vector lengths.
    """
    if name in JOINT_RANGE:
        lower, upper = limits.joint_range(values.shape[-1])
        both = np.isfinite(lower) & np.isfinite(upper)
        half = np.where(both, np.where(both, upper / 2 - lower / 2, 0.0), ONE_SIDED)
        end, middle = (lower, lower + half) if name == "joint_lower" else (upper, upper - half)
        bounded = np.isfinite(end)
        # If the range has no end on this side, the use of this limit is 0.
        value = np.where(bounded, values, 0.0)
        limit = np.where(bounded, end, np.inf)
        return Use(name, value, limit, error, np.where(bounded, middle, 0.0))
    if name in JOINT_LIMITS:
        low, high = limits.bounds(name, values.shape[-1])
        # Most limits are symmetric, so the selection by sign is rarely necessary.
        limit = high if np.array_equal(-low, high) else np.where(values < 0, -low, high)
    else:
        allowed = getattr(limits, name)
        limit = np.asarray(np.inf if allowed is None else allowed)
        values = length(values) if values.ndim > 1 else values
        error = np.ravel(error)
    return Use(name, np.abs(values), limit, error)


@dataclass(frozen=True)
class States:
    """Joint states of an arm, and the tool motion that follows from them.

    Args:
        arm: The arm.
        columns: Joint positions [rad] and their known derivatives [rad/s, rad/s², rad/s³], (n, dof)
            each.
        errors: Bounds on the errors of these columns, (dof,) each; empty for exact numbers.
    """

    arm: Arm
    columns: Sequence[FloatArray]
    errors: Sequence[FloatArray] = ()

    @property
    def q(self) -> FloatArray:
        """Joint positions [rad], (n, dof)."""
        return self.columns[0]

    @property
    def dq(self) -> FloatArray:
        """Joint velocities [rad/s], (n, dof)."""
        return self.columns[1]

    @property
    def ddq(self) -> FloatArray:
        """Joint accelerations [rad/s²], (n, dof)."""
        return self.columns[2]

    @cached_property
    def _measured(self) -> dict[str, Bounded]:
        return {}

    def measure(self, name: str) -> Bounded:
        """Return the values that the limit `name` bounds, and bounds on their errors.

        The values are in the unit of the limit, (n, dof) for joints or (n,) for the tool. Joint
        values are signed, except for torques.

        Raises:
            InvalidInput: The limit does not exist, or the states lack a derivative that it needs.
        """
        if name not in LIMITS:
            raise InvalidInput(
                f"There is no limit {name!r}. It must be one of {', '.join(LIMITS)}."
            )
        limit = LIMITS[name]
        if limit.order >= len(self.columns):
            raise InvalidInput(f"The use of {name} requires states with {ORDERS[limit.order]}.")
        if name not in self._measured:
            value = limit.rate(self) if limit.rate else self._derivative(limit)
            self._measured[name] = value
        return self._measured[name]

    def use(self, name: str, limits: Limits) -> Use:
        """Return value, limit and their ratio at these states for the limit `name` in `limits`."""
        return use_of(name, limits, *self.measure(name))

    def uses(self, limits: Limits) -> Iterator[Use]:
        """Yield the use of each specified limit in `limits` that these states determine."""
        for name, limit in LIMITS.items():
            if (
                getattr(limits, name) is not None
                and limit.order < len(self.columns)
                and (self.arm.has_bodies or not limit.needs_bodies)
                and (limit.kind != "rotation" or isinstance(self.arm, SerialArm))
            ):
                yield self.use(name, limits)

    @cached_property
    def _tool_motion(self) -> tuple[FloatArray, FloatArray]:
        return self.arm.tool_motion(*self.columns[:3])

    @property
    def tool_velocity(self) -> FloatArray:
        """Tool velocities [m/s], (n, dimension)."""
        if len(self.columns) > 2:
            return self._tool_motion[0]
        return self.arm.tool_velocity(*self.columns)

    @property
    def tool_acceleration(self) -> FloatArray:
        """Tool accelerations [m/s²], (n, dimension)."""
        return self._tool_motion[1]

    def bounded(self, function: Quantity, order: int) -> tuple[FloatArray, FloatArray]:
        """Return a tool vector, (n, columns), and a bound on its error, (n,).

        Args:
            function: Function that returns the vector from the joint states up to `order`.
            order: Number of joint-position derivatives that `function` takes.
        """
        value = function(*self.columns[: order + 1])
        return value, self.spread(function, value, order)

    def spread(self, function: Quantity, value: FloatArray, order: int) -> FloatArray:
        """Bound the error of `value`, a tool vector from `function` and `order`, (n,)."""
        total = np.zeros(len(value))
        for change in self.changes(function, value, order):
            total += np.linalg.norm(change, axis=1)
        # Two errors together have a smaller effect than one error times the other error's angle.
        return np.asarray(total * (1 + self.errors[0].sum())) if self.errors else total

    def changes(self, function: Quantity, value: FloatArray, order: int) -> Iterator[FloatArray]:
        """Yield how each joint state's error changes `value` from `function` and `order`."""
        columns = self.columns[: order + 1]
        for k, errors in enumerate(self.errors[: order + 1]):
            for joint in np.flatnonzero(errors):
                moved = columns[k].copy()
                moved[:, joint] += errors[joint]
                yield function(*columns[:k], moved, *columns[k + 1 :]) - value

    def _derivative(self, limit: Limit) -> Bounded:
        """Return the derivatives of the joint positions or, for the tool, their norms."""
        order = limit.order
        arm = self.arm
        if limit.kind == "joint":
            known = order < len(self.errors)
            return self.columns[order], self.errors[order] if known else np.zeros(1)
        if limit.kind == "rotation":
            tool = require_orientation(arm)
            function = angular(tool.tool_twist if order == 1 else tool.tool_twist_rate)
            vectors = function(*self.columns[: order + 1])
        else:
            # Both orders share one evaluation of the kinematics.
            function = arm.tool_velocity if order == 1 else arm.tool_acceleration
            vectors = self.tool_velocity if order == 1 else self.tool_acceleration
        return length(vectors), self.spread(function, vectors, order)

    def torque(self) -> Bounded:
        """Return absolute joint torques [N m]; at rest dry friction has its best possible value."""
        drive = self.arm.torque(self.q, self.dq, self.ddq)
        chain = self.arm.chain
        assert chain.coulomb is not None
        dry = chain.coulomb

        def without_dry(q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
            return np.asarray(self.arm.torque(q, dq, ddq) - dry * np.sign(dq))

        still = np.abs(self.dq) <= STILL_JOINT
        value = np.abs(drive)
        if not self.errors and not dry.any():
            return value, np.zeros(1)
        if not self.errors:
            # Few joints are at rest, so only their torques are computed again.
            rows, joints = np.nonzero(still)
            others = drive[rows, joints] - dry[joints] * np.sign(self.dq[rows, joints])
            value[rows, joints] = np.maximum(np.abs(others) - dry[joints], 0.0)
            return value, np.zeros(1)
        others = drive - dry * np.sign(self.dq)
        error = np.zeros_like(drive)
        for change in self.changes(without_dry, others, 2):
            error += np.abs(change)
        helped = np.maximum(np.abs(others) - dry, 0.0)
        value = np.where(still, helped, value)
        # If a joint may be at rest, the required torque may be as small as the torque at rest.
        may_rest = np.abs(self.dq) <= STILL_JOINT + self.errors[1]
        error += np.where(may_rest, np.maximum(value - helped, 0.0), 0.0)
        return value, error

    def centripetal(self) -> Bounded:
        """Return tool accelerations normal to the motion, (n,), and bounds on their errors."""
        speed, speed_error = self.measure("speed")
        size, error = self.measure("tool_acceleration")
        # If the direction of motion is wrong, a part of the tangential acceleration becomes normal.
        turned = size * np.minimum(1.0, speed_error / np.maximum(speed, STILL_TOOL))
        value = across(self.tool_velocity, self.tool_acceleration)
        return value, np.where(speed > STILL_TOOL, error + turned, 0.0)


def require_orientation(arm: Arm) -> SerialArm:
    """Return the arm if its tool has an orientation; otherwise raise an error."""
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"The tool of the arm {arm.name} is a point without an orientation. Remove its "
            "angular limits with "
            "limits.replace(angular_speed=math.inf, angular_acceleration=math.inf)."
        )
    return arm


def angular(twist: Quantity) -> Quantity:
    """Return a function that returns the angular part of a twist, (n, 3)."""
    return lambda *states: twist(*states)[:, 3:]


def across(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Return the acceleration's norm normal to `velocity`, (n,); 0 below the speed `STILL_TOOL`."""
    speed = length(velocity)
    divisor = np.maximum(speed, STILL_TOOL)
    directions = [x / divisor for x in velocity.T]
    along = _sum_products(acceleration.T, directions)
    normal = [x - along * y for x, y in zip(acceleration.T, directions, strict=True)]
    return np.where(speed > STILL_TOOL, np.sqrt(_sum_products(normal, normal)), 0.0)


def length(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors, (n,)."""
    return np.asarray(np.sqrt(_sum_products(vectors.T, vectors.T)))


def _sum_products(a: Iterable[FloatArray], b: Iterable[FloatArray]) -> FloatArray:
    """Return the scalar products of vectors whose components are given in turn, (n,) each."""
    # For two or three components, this is faster than a sum or a product along the rows.
    total = np.zeros(1)
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total
