"""Use of limits: the value that a limit applies to, the limit, and their ratio."""

# This is the only definition; planner, check, evaluation and reports apply it.

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
    """The use of one limit at some times."""

    name: str  # Name of the limit, such as a field of `Limits`
    # Values in the unit of the limit, (..., dof) of joints or (n,) of the tool; absolute values
    # except for joint positions.
    value: FloatArray
    limit: FloatArray | float  # Limits of the values, broadcast to their shape
    error: npt.ArrayLike = 0.0  # Bound on the errors of the values, broadcast to their shape
    zero: FloatArray | None = (
        None  # Origin of values and limits; a lower limit is below it; None for 0
    )

    @property
    def ratio(self) -> FloatArray:
        """Ratios of values to limits; NaN is replaced by infinity."""
        return self.ratios()[0]

    @property
    def largest(self) -> FloatArray:
        """Largest ratio of each joint, (dof,)."""
        return np.asarray(self.ratio.max(axis=0))

    def ratios(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the ratios to limits, lower bounds of the ratios, and bounds on their errors."""
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
    """Use of a limit (a field of `Limits`) by values of its quantity; 0 without a limit.

    - `values`: of joints (..., dof), of the tool (n,), or vectors of the tool (n, dimension).
    - `error`: bound on the error of the values or of the vectors' lengths.
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
    """Joint states of an arm, and the tool motion that follows from them."""

    arm: Arm
    # Joint positions [rad] and their known derivatives [rad/s, rad/s², rad/s³], (n, dof) each.
    columns: Sequence[FloatArray]
    # Bounds on the errors of the columns, (dof,) each; empty for exact numbers.
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
        """Values of the quantity that a limit applies to, and bounds on their errors."""
        # The values are in the unit of the limit, (n, dof) of joints or (n,) of the tool. Joint
        # values are signed, except for torques.
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
        """Use of a limit by these states, as by `use_of`."""
        return use_of(name, limits, *self.measure(name))

    def uses(self, limits: Limits) -> Iterator[Use]:
        """Yield the use of every specified limit that can be evaluated for these states and arm."""
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
        """A vector of the tool, (n, columns), and a bound on the norm of its error, (n,)."""
        value = function(*self.columns[: order + 1])
        return value, self.spread(function, value, order)

    def spread(self, function: Quantity, value: FloatArray, order: int) -> FloatArray:
        """Bound on the norm of the error of `value`, a tool vector from `function`, (n,)."""
        total = np.zeros(len(value))
        for change in self.changes(function, value, order):
            total += np.linalg.norm(change, axis=1)
        # The combined effect of two errors is smaller than the effect of one error times the angle
        # of the other error.
        return np.asarray(total * (1 + self.errors[0].sum())) if self.errors else total

    def changes(self, function: Quantity, value: FloatArray, order: int) -> Iterator[FloatArray]:
        """Yield the changes of a value due to the error of each joint state, (n, columns) each."""
        columns = self.columns[: order + 1]
        for k, errors in enumerate(self.errors[: order + 1]):
            for joint in np.flatnonzero(errors):
                moved = columns[k].copy()
                moved[:, joint] += errors[joint]
                yield function(*columns[:k], moved, *columns[k + 1 :]) - value

    def _derivative(self, limit: Limit) -> Bounded:
        """Derivatives of the joint positions, or norms of those of the tool pose."""
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
        """Absolute joint torques [N m]; at rest dry friction takes its most favourable value."""
        drive = self.arm.torque(self.q, self.dq, self.ddq)
        chain = self.arm.chain
        assert chain.coulomb is not None
        dry = chain.coulomb

        def without_dry(q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
            return np.asarray(self.arm.torque(q, dq, ddq) - dry * np.sign(dq))

        others = drive - dry * np.sign(self.dq)
        error = np.zeros_like(drive)
        for change in self.changes(without_dry, others, 2):
            error += np.abs(change)
        helped = np.maximum(np.abs(others) - dry, 0.0)
        value = np.where(np.abs(self.dq) <= STILL_JOINT, helped, np.abs(drive))
        if self.errors:
            # If a joint may be at rest, the required torque may be as small as the torque at rest.
            still = np.abs(self.dq) <= STILL_JOINT + self.errors[1]
            error += np.where(still, np.maximum(value - helped, 0.0), 0.0)
        return value, error

    def centripetal(self) -> Bounded:
        """Tool accelerations normal to the motion, (n,), and bounds on their errors."""
        speed, speed_error = self.measure("speed")
        size, error = self.measure("tool_acceleration")
        # An error of the direction of motion turns part of the tangential acceleration into normal
        # acceleration.
        turned = size * np.minimum(1.0, speed_error / np.maximum(speed, STILL_TOOL))
        value = across(self.tool_velocity, self.tool_acceleration)
        return value, np.where(speed > STILL_TOOL, error + turned, 0.0)


def require_orientation(arm: Arm) -> SerialArm:
    """Return the arm if its tool has an orientation; otherwise raise an error."""
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"The tool of the arm {arm.name} is a point without an orientation. Lift its angular "
            "limits with limits.replace(angular_speed=math.inf, angular_acceleration=math.inf)."
        )
    return arm


def angular(twist: Quantity) -> Quantity:
    """Function that returns the angular part of a twist, (n, 3)."""
    return lambda *states: twist(*states)[:, 3:]


def across(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Norm of the tool acceleration normal to the motion, (n,); 0 below `STILL_TOOL`."""
    speed = length(velocity)
    direction = velocity / np.maximum(speed, STILL_TOOL)[:, None]
    along = np.einsum("ij,ij->i", acceleration, direction)
    return np.where(speed > STILL_TOOL, length(acceleration - along[:, None] * direction), 0.0)


def length(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors, (n,)."""
    return np.asarray(np.linalg.norm(vectors, axis=1))
