"""The use of limits: the value that a limit applies to, the limit, and their ratio.

This is the only definition. Planner, check, evaluation and reports apply it to their own motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.robot.arm import Arm
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE, Limits
from armcontour.robot.serial import SerialArm

# Below this tool speed [m/s] the direction of motion is not defined, so the centripetal
# acceleration is not defined either.
SLOWEST = 1e-6
# Below this joint velocity [rad/s] dry friction may have any value up to Coulomb friction, in both
# directions.
STILL = 1e-6
# The middle of a range with one end only is this far from its end [rad].
ONE_SIDED = np.pi
ORDERS = ("q", "dq", "ddq", "dddq")

# A quantity of the motion: a function of q, of q and dq, and so on.
Quantity = Callable[..., FloatArray]
# Values, (n, dof) of joints or (n,) of the tool, and bounds on their errors.
Bounded = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Use:
    """The use of one limit at some times.

    Args:
        name: The limit, such as a field of `Limits`.
        value: Values in the unit of the limit, (..., dof) of joints or (n,) of the tool: positions
            of joints, or amounts.
        limit: Their limits, in a shape that broadcasts to that of the values.
        error: Bound on the error of the values, in such a shape.
        zero: Origin of values and limits, above a limit that is a lower one; None for 0.
    """

    name: str
    value: FloatArray
    limit: FloatArray | float
    error: npt.ArrayLike = 0.0
    zero: FloatArray | None = None

    @property
    def ratio(self) -> FloatArray:
        """Values over limits: 1 is the limit. NaN counts as infinite."""
        return self.ratios()[0]

    @property
    def largest(self) -> FloatArray:
        """Largest ratio of each joint, (dof,)."""
        return np.asarray(self.ratio.max(axis=0))

    def ratios(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values over limits; smallest ratios that the errors allow; largest effect of the errors.

        NaN counts as an infinite ratio, of which nothing is certain. The effect of exact values is
        one zero.
        """
        off, used, room = np.asarray(self.error), self.value, np.asarray(self.limit)
        if self.zero is not None:
            used = np.where(room < self.zero, self.zero - used, used - self.zero)
            room = np.abs(room - self.zero)
        # With a very small limit the ratio may overflow.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            ratio = np.asarray(used / room)
            if not off.any() and not np.isnan(ratio).any():
                return ratio, ratio, np.zeros(1)
            certain, slack = (used - off) / room, np.asarray(off / room)
            return (
                np.where(np.isnan(ratio), np.inf, ratio),
                np.where(np.isnan(certain), -np.inf, certain),
                np.where(np.isnan(slack), np.inf, slack),
            )


def use_of(name: str, limits: Limits, values: FloatArray, error: npt.ArrayLike = 0.0) -> Use:
    """The use of a limit by values of its quantity, whatever their source.

    Args:
        name: A field of `Limits`.
        limits: The limits; without this one, its use is 0.
        values: Values of joints, with or without a sign, (..., dof), or of the tool: amounts, (n,),
            or vectors, (n, dimension).
        error: Bound on the error of the values or of the vectors' lengths.
    """
    if name in JOINT_RANGE:
        lower, upper = limits.joint_range(values.shape[-1])
        both = np.isfinite(lower) & np.isfinite(upper)
        half = np.where(both, np.where(both, upper / 2 - lower / 2, 0.0), ONE_SIDED)
        end, middle = (lower, lower + half) if name == "joint_lower" else (upper, upper - half)
        known = np.isfinite(end)
        # A joint without this end has an infinite range, of which no part is used.
        value, limit = np.where(known, values, 0.0), np.where(known, end, np.inf)
        return Use(name, value, limit, error, np.where(known, middle, 0.0))
    if name in JOINT_LIMITS:
        low, high = limits.bounds(name, values.shape[-1])
        # Most limits are the same both ways.
        limit = high if np.array_equal(-low, high) else np.where(values < 0, -low, high)
    else:
        allowed = getattr(limits, name)
        limit = np.asarray(np.inf if allowed is None else allowed)
        values, error = length(values) if values.ndim > 1 else values, np.ravel(error)
    return Use(name, np.abs(values), limit, error)


@dataclass(frozen=True)
class States:
    """Joint states of an arm, with the motion of the tool that they cause.

    Args:
        arm: The arm.
        columns: Joint positions [rad], and their derivatives as far as they are known [rad/s,
            rad/s², rad/s³], (n, dof) each.
        errors: Bounds on the errors of the columns, (dof,) each; none for exact numbers.
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
    def _bound(self) -> dict[str, Bounded]:
        return {}

    def bound(self, name: str) -> Bounded:
        """The quantity that a limit applies to, in the unit of the limit, and its accuracy.

        Args:
            name: A field of `Limits`; of "path_jerk" states know nothing: it belongs to a law.

        Returns:
            Values of joints, (n, dof), or of the tool, (n,), and bounds on their errors. Values of
            joints, but for torques, have a sign.

        Raises:
            InvalidInput: There is no such limit, the arm has no masses for torques, the tool has no
                orientation for angular motion, or a derivative of the states is missing.
        """
        if name not in QUANTITIES:
            raise InvalidInput(
                f"The use of a limit {name!r} is not known: known are {', '.join(QUANTITIES)}."
            )
        order, measure = QUANTITIES[name]
        if order >= len(self.columns):
            raise InvalidInput(f"The use of {name} needs states with {ORDERS[order]}.")
        if name not in self._bound:
            self._bound[name] = measure(self)
        return self._bound[name]

    def use(self, name: str, limits: Limits) -> Use:
        """The use of a limit; arguments as of `use_of` and `bound`."""
        return use_of(name, limits, *self.bound(name))

    def uses(self, limits: Limits) -> Iterator[Use]:
        """The use of every limit that is given and that the states and the arm allow to judge.

        Args:
            limits: The limits, with one value per joint.
        """
        for name in JOINT_RANGE:
            use = use_of(name, limits, self.q, self.errors[0] if self.errors else 0.0)
            if np.isfinite(use.limit).any():
                yield use
        for name, (order, _) in QUANTITIES.items():
            if getattr(limits, name) is None or order >= len(self.columns):
                continue
            if name == "joint_torque" and not self.arm.has_bodies:
                continue
            if name.startswith("angular") and not isinstance(self.arm, SerialArm):
                continue
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
        """A vector of the tool, (n, columns), and a bound on the length of its error, (n,).

        Args:
            function: Gives the vector from q and its first derivatives.
            order: Number of these derivatives.
        """
        value = function(*self.columns[: order + 1])
        return value, self.spread(function, value, order)

    def spread(self, function: Quantity, value: FloatArray, order: int) -> FloatArray:
        """Bound on the length of the error of `bounded`, (n,), with the vector that it gives."""
        total = np.zeros(len(value))
        for change in self.changes(function, value, order):
            total += np.linalg.norm(change, axis=1)
        # The joint effect of two errors is less than the effect of one times the other's angle.
        return np.asarray(total * (1 + self.errors[0].sum())) if self.errors else total

    def changes(self, function: Quantity, value: FloatArray, order: int) -> Iterator[FloatArray]:
        """Changes of a value with the error of each number; arguments as of `spread`."""
        columns = self.columns[: order + 1]
        for k, errors in enumerate(self.errors[: order + 1]):
            for joint in np.flatnonzero(errors):
                moved = columns[k].copy()
                moved[:, joint] += errors[joint]
                yield function(*columns[:k], moved, *columns[k + 1 :]) - value


def require_orientation(arm: Arm) -> SerialArm:
    """Return the arm if its tool has an orientation.

    Raises:
        InvalidInput: The tool is a point without an orientation.
    """
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"The tool of the arm {arm.name} is a point without an orientation: lift its limits "
            "with limits.replace(angular_speed=math.inf, angular_acceleration=math.inf)."
        )
    return arm


def angular(twist: Quantity) -> Quantity:
    """The angular part of a twist."""
    return lambda *states: twist(*states)[:, 3:]


def across(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Lengths of tool accelerations at right angles to the motion, (n,); 0 below `SLOWEST`."""
    speed = length(velocity)
    direction = velocity / np.maximum(speed, SLOWEST)[:, None]
    along = np.einsum("ij,ij->i", acceleration, direction)
    return np.where(speed > SLOWEST, length(acceleration - along[:, None] * direction), 0.0)


def length(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors, (n,)."""
    return np.asarray(np.linalg.norm(vectors, axis=1))


def _joints(x: States, order: int) -> Bounded:
    """Positions of joints or their derivatives, with a sign."""
    return x.columns[order], x.errors[order] if order < len(x.errors) else np.zeros(1)


def _torque(x: States) -> Bounded:
    """Amounts of the joint torques [N m], with the dry friction at rest that helps most."""
    drive, chain = x.arm.torque(x.q, x.dq, x.ddq), x.arm.chain
    assert chain is not None and chain.coulomb is not None
    dry = chain.coulomb

    def without_dry(q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        return np.asarray(x.arm.torque(q, dq, ddq) - dry * np.sign(dq))

    others = drive - dry * np.sign(x.dq)
    error = np.zeros_like(drive)
    for change in x.changes(without_dry, others, 2):
        error += np.abs(change)
    helped = np.maximum(np.abs(others) - dry, 0.0)
    value = np.where(np.abs(x.dq) <= STILL, helped, np.abs(drive))
    if x.errors:
        # A joint that may be at rest may need as little as one at rest.
        still = np.abs(x.dq) <= STILL + x.errors[1]
        error += np.where(still, np.maximum(value - helped, 0.0), 0.0)
    return value, error


def _vector(x: States, function: Quantity, order: int) -> Bounded:
    """Lengths of vectors of the tool."""
    vectors, error = x.bounded(function, order)
    return length(vectors), error


def _tool_motion(x: States, order: int) -> Bounded:
    """Tool speeds or lengths of tool accelerations: both come from one evaluation."""
    vectors = x.tool_velocity if order == 1 else x.tool_acceleration
    function = x.arm.tool_velocity if order == 1 else x.arm.tool_acceleration
    return length(vectors), x.spread(function, vectors, order)


def _centripetal(x: States) -> Bounded:
    """Tool accelerations at right angles to the motion."""
    (speed, off), (size, error) = x.bound("speed"), x.bound("tool_acceleration")
    # An error of the direction of motion makes a normal part of tangential acceleration.
    turned = size * np.minimum(1.0, off / np.maximum(speed, SLOWEST))
    value = across(x.tool_velocity, x.tool_acceleration)
    return value, np.where(speed > SLOWEST, error + turned, 0.0)


def _angular_speed(x: States) -> Bounded:
    return _vector(x, angular(require_orientation(x.arm).tool_twist), 1)


def _angular_acceleration(x: States) -> Bounded:
    return _vector(x, angular(require_orientation(x.arm).tool_twist_rate), 2)


# The quantity of each limit, with the number of derivatives of q that it needs.
QUANTITIES: dict[str, tuple[int, Callable[[States], Bounded]]] = {
    "joint_torque": (2, _torque),
    "angular_speed": (1, _angular_speed),
    "angular_acceleration": (2, _angular_acceleration),
    "joint_jerk": (3, lambda x: _joints(x, 3)),
    "tool_jerk": (3, lambda x: _vector(x, x.arm.tool_jerk, 3)),
    "joint_velocity": (1, lambda x: _joints(x, 1)),
    "joint_acceleration": (2, lambda x: _joints(x, 2)),
    "speed": (1, lambda x: _tool_motion(x, 1)),
    "tool_acceleration": (2, lambda x: _tool_motion(x, 2)),
    "centripetal_acceleration": (2, _centripetal),
}
