"""Limits of an arm, its tool and the process."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from operator import methodcaller
from typing import Annotated, Any, get_type_hints

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import Checked, checked, declared, parts_of
from armcontour.core.guesses import suggest
from armcontour.core.quantities import (
    AccelerationLimit,
    AngularAccelerationLimit,
    AngularSpeedLimit,
    AtLeast,
    Choice,
    JointAccelerations,
    JointJerks,
    JointRanges,
    JointTorques,
    JointVelocities,
    Quantity,
    SpeedLimit,
    list_values,
    shared_unit,
)
from armcontour.core.text import digits, format_table, short_repr

JOINT_RANGE = ("joint_lower", "joint_upper")
# Limits that no constraint of the planner serves: tracing keeps the joint ranges, and
# `planning/jerk` keeps the jerk of the joints.
WITHOUT_CONSTRAINT = (*JOINT_RANGE, "joint_jerk")
# Orders of the limits that a constraint of the planner can keep: it bounds the path speed and the
# path acceleration.
CONSTRAINT_ORDERS = (1, 2)


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit's record, in the annotation of a field of `Limits`.

    Planner, stops, check, certificate, explanation, player and reports read the record. The
    planner's constraint names the field (`planning/constraints.py`), so the order must be 1 or 2.
    Limits of position or jerk are refused, except those with their own planner,
    `WITHOUT_CONSTRAINT`.

    Args:
        order: Number of joint-position derivatives that the quantity requires. Without `rate`, the
            limited quantity is this derivative of the joint positions, or its norm for the tool's
            position or orientation.
        label: Name in messages and explanations; by default made from the name of the field.
        power: Exponent of the speed factor in the limit; by default `order`.
        rate: Function of `limit_use.States` that returns the values of the quantity and bounds on
            their errors; None for the derivative `order`.
        needs_bodies: True if the quantity requires the arm's masses.
        reserved: True if a plan's reserve reduces the limit.
        reserved_for_play: True if the reserve of plans for `play` also reduces it, because changes
            of the override need it.
        name: Name of the field, set from it.
        kind: "joint" with one value per joint, "rotation", or "tool", set from the field's prefix
            "joint_" or "angular_".
        quantity: Quantity of the field, set from its annotation.
    """

    order: int
    label: str = ""
    _: KW_ONLY
    power: int | None = None
    rate: Callable[[Any], tuple[FloatArray, FloatArray]] | None = None
    needs_bodies: bool = False
    reserved: bool = False
    reserved_for_play: bool = False
    name: str = ""
    kind: str = "tool"
    quantity: Quantity = Quantity("")

    @property
    def unit(self) -> str:
        """Unit for messages."""
        return self.quantity.words


@declared(eq=False)
class Limits(Checked):
    """Limits of an arm's joints and tool.

    Limits replace those of an arm value by value: None keeps the arm's limit, infinity removes it,
    also for single joints. A removed limit also has the value None, and its name is in `removed`.
    Values of prismatic joints are numbers in m, m/s, m/s², m/s³ and N.

    >>> limits.replace(speed=0.05).speed
    0.05
    >>> ac.Limits.only(joint_velocity=1.5).joint_velocity
    array(1.5)

    Args:
        joint_acceleration: Largest absolute acceleration of each joint [rad/s²], (dof,); or
            negative lower bounds and upper bounds, (dof, 2).
        joint_velocity: Largest absolute velocity of each joint [rad/s], (dof,), or bounds, (dof,
            2).
        joint_torque: Largest absolute torque of each joint's drive [N m], (dof,).
        joint_jerk: Largest absolute jerk of each joint [rad/s³], (dof,); infinite without a limit.
        joint_lower, joint_upper: Range of each joint [rad], (dof,); infinite without a limit.
        speed: Assigned velocity: requested tool speed, which is not exceeded [m/s].
        tool_acceleration: Largest norm of the tool acceleration [m/s²].
        centripetal_acceleration: Largest tool acceleration normal to the motion [m/s²].
        angular_speed: Largest angular speed of the tool [rad/s].
        angular_acceleration: Largest norm of the tool's angular acceleration [rad/s²].

    Attributes:
        removed: Names of the limits that are removed.
        prismatic: Whether each joint of the arm is prismatic; empty for limits without an arm.

    Raises:
        InvalidInput: A limit is not positive, bounds do not include zero, or a range is empty.
    """

    joint_acceleration: Annotated[JointAccelerations | None, Limit(2, reserved=True)] = None
    joint_velocity: Annotated[JointVelocities | None, Limit(1)] = None
    joint_torque: Annotated[
        JointTorques | None,
        Limit(2, power=0, rate=methodcaller("torque"), needs_bodies=True, reserved=True),
    ] = None
    joint_jerk: Annotated[JointJerks | None, Limit(3, reserved_for_play=True)] = None
    joint_lower: Annotated[JointRanges | None, Limit(0)] = None
    joint_upper: Annotated[JointRanges | None, Limit(0)] = None
    speed: Annotated[SpeedLimit | None, Limit(1, "assigned velocity")] = None
    tool_acceleration: Annotated[AccelerationLimit | None, Limit(2, reserved_for_play=True)] = None
    centripetal_acceleration: Annotated[
        AccelerationLimit | None, Limit(2, rate=methodcaller("centripetal"))
    ] = None
    angular_speed: Annotated[AngularSpeedLimit | None, Limit(1)] = None
    angular_acceleration: Annotated[
        AngularAccelerationLimit | None, Limit(2, reserved_for_play=True)
    ] = None
    removed: frozenset[str] = field(default=frozenset(), init=False)
    prismatic: tuple[bool, ...] = field(default=(), init=False)

    def _check_together(self) -> None:
        """Move infinite limits to `removed`, and check the ranges of the joints."""
        removed = []
        for name in UNITS:
            values = getattr(self, name)
            if values is not None and _is_unlimited(values):
                removed.append(name)
        if removed:
            for name in removed:
                object.__setattr__(self, name, None)
            object.__setattr__(self, "removed", frozenset(removed))
        # Infinity of either sign means that the range has no end.
        for name, end in (("joint_lower", -np.inf), ("joint_upper", np.inf)):
            values = getattr(self, name)
            if values is not None and np.isinf(values).any():
                array = np.where(np.isinf(values), end, values)
                object.__setattr__(self, name, checks.frozen_array(array))
        self._check_range()

    def __str__(self) -> str:
        """Write the limits that are specified or removed, with their units."""
        rows = []
        for name in UNITS:
            values = getattr(self, name)
            if values is not None:
                rows.append((name, self._list_values(name, values)))
            elif name in self.removed:
                rows.append((name, "none"))
        return format_table("Limits" if rows else "Limits: none", rows)

    __repr__ = short_repr

    def _list_values(self, name: str, values: npt.ArrayLike) -> str:
        """Return the values of all joints with their units; one value if they are equal."""
        texts = [" to ".join(map(digits, np.atleast_1d(x))) for x in np.atleast_1d(values)]
        return list_values(texts, UNITS[name], self.prismatic if name in JOINT_VALUES else ())

    def _check_range(self) -> None:
        """Raise InvalidInput if a joint range is empty, or if its ends have different shapes."""
        lower, upper = self.joint_lower, self.joint_upper
        if lower is None or upper is None:
            return
        if len({x.size for x in (lower, upper)} - {1}) > 1:
            raise InvalidInput(
                f"joint_lower has {lower.size} values, but joint_upper has {upper.size}. Specify "
                "one value for all joints or one per joint."
            )
        empty = np.atleast_1d(lower >= upper)
        if empty.any():
            j = int(np.argmax(empty))
            low, high = (float(np.broadcast_to(x, empty.shape)[j]) for x in (lower, upper))
            unit = shared_unit("rad", self.prismatic[j : j + 1])
            raise InvalidInput(
                f"The range of joint {j + 1} is empty. joint_lower ({low:g} {unit}) must be less "
                f"than joint_upper ({high:g} {unit})."
            )

    def replace(self, **changes: Any) -> Limits:
        """Return the limits with some of them changed.

        Args:
            changes: New values by the names of the limits. Infinity removes a limit; None means the
                limit of the arm with which the limits are used.

        Raises:
            InvalidInput: An unknown name, or a value that is not a limit.
        """
        for name in changes:
            if name not in UNITS:
                hint = suggest(name, UNITS, "")
                meant = f" ({hint})" if hint else ""
                raise InvalidInput(
                    f"Unknown limit {name!r}{meant}. The limits are {', '.join(UNITS)}."
                )
        new = dataclasses.replace(self, **(dict.fromkeys(self.removed, math.inf) | changes))
        return new.of_chain(self.prismatic)

    @classmethod
    def only(cls, **values: Any) -> Limits:
        """Make limits with the specified values, and all other limits removed.

        Args:
            values: Values by the names of the limits.

        Raises:
            InvalidInput: An unknown name, or a value that is not a limit.
        """
        specified = cls().replace(**values)
        return specified._without(x for x in UNITS if getattr(specified, x) is None)

    @checked
    def over(self, others: Limits) -> Limits:
        """Complete these limits: values that are missing and not removed are taken from others.

        >>> ac.Limits(speed=0.05).over(arm.limits).speed
        0.05

        Args:
            others: The other limits, such as those of an arm.

        Raises:
            InvalidInput: A joint range is empty.
        """
        missing = [x for x in UNITS if getattr(self, x) is None and x not in self.removed]
        added = {x: y for x in missing if (y := getattr(others, x)) is not None}
        removed = others.removed.intersection(missing)
        prismatic = self.prismatic or others.prismatic
        if not added and not removed and prismatic == self.prismatic:
            return self
        merged = self._with(added | {"prismatic": prismatic}, self.removed | removed)
        if not added.keys().isdisjoint(JOINT_RANGE):
            merged._check_range()
        return merged

    def _with(self, changes: Mapping[str, Any], removed: frozenset[str]) -> Limits:
        """Return a copy with changed values, which are not checked, and removed limits."""
        return checks.copy_unchecked(self, **changes, removed=removed)

    def _without(self, names: Iterable[str]) -> Limits:
        """Return a copy with additional removed limits."""
        names = tuple(names)
        removed = self.removed.union(names)
        return self if removed == self.removed else self._with(dict.fromkeys(names), removed)

    @property
    def of_joints(self) -> Limits:
        """The limits and ranges of the joints; the limits of the tool are removed."""
        return self._without(TOOL_LIMITS)

    @property
    def limits_jerk(self) -> bool:
        """True if the jerk of any joint is limited; only the method `optimal` supports this."""
        return self.joint_jerk is not None and bool(np.isfinite(self.joint_jerk).any())

    @property
    def without_jerk(self) -> Limits:
        """The limits with the jerk limit removed."""
        return self._without(("joint_jerk",))

    @property
    def of_tool(self) -> Limits:
        """The limits of the tool; the limits and ranges of the joints are removed."""
        return self._without(JOINT_VALUES)

    def for_joints(self, dof: int) -> Limits:
        """Return the limits with one value per joint.

        Args:
            dof: Number of joints.

        Raises:
            InvalidInput: A wrong number of values.
        """
        dof = checks.check_int("dof", dof, 1, checks.MAX_JOINTS)
        changes: dict[str, FloatArray | None] = {}
        for name, unit in JOINT_VALUES.items():
            values = getattr(self, name)
            if values is None or values.shape in ((dof,), (dof, 2)):
                continue
            if values.shape == (1, 2):
                changes[name] = checks.frozen_array(np.repeat(values, dof, axis=0))
                continue
            if values.ndim == 2:
                raise ArmMismatch(
                    f"{name} has bounds for {len(values)} joints, but the arm has {dof} joints. "
                    f"Specify one pair for all joints or {dof} pairs."
                )
            if values.ndim:
                # Check the number of values. Infinite values are valid, but the check rejects them.
                checks.per_joint(name, np.where(np.isinf(values), 0.0, values), dof, unit)
            one_each = changes[name] = np.full(dof, values)
            one_each.setflags(write=False)
        return self._with(changes, self.removed) if changes else self

    def of_chain(self, prismatic: tuple[bool, ...]) -> Limits:
        """Return the limits with the units of a chain.

        Args:
            prismatic: Whether each joint is prismatic.
        """
        known = prismatic if any(prismatic) else ()
        return self if known == self.prismatic else checks.copy_unchecked(self, prismatic=known)

    def acceleration_bounds(self, dof: int) -> tuple[FloatArray, FloatArray]:
        """Return lower (negative) and upper bounds of joint accelerations [rad/s²], (dof,) each.

        Bounds are infinite without a limit.

        Args:
            dof: Number of joints.
        """
        return self._bounds("joint_acceleration", checks.check_int("dof", dof, 1))

    def velocity_bounds(self, dof: int) -> tuple[FloatArray, FloatArray]:
        """Return lower (negative) and upper bounds of joint velocities [rad/s], (dof,) each.

        Bounds are infinite without a limit.

        Args:
            dof: Number of joints.
        """
        return self._bounds("joint_velocity", checks.check_int("dof", dof, 1))

    @checked
    def bounds(
        self, name: Annotated[str, Choice(JOINT_LIMITS)], dof: Annotated[int, AtLeast(1)]
    ) -> tuple[FloatArray, FloatArray]:
        """Return lower (negative) and upper bounds of a joint limit, (dof,) each.

        Bounds are infinite without a limit.

        Args:
            name: "joint_velocity", "joint_acceleration", "joint_torque" or "joint_jerk".
            dof: Number of joints.
        """
        return self._bounds(name, dof)

    def _bounds(self, name: str, dof: int) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper bounds of a joint limit by name, (dof,) each."""
        values = getattr(self, name)
        try:
            if values is not None and values.ndim == 2:
                low, high = np.array(np.broadcast_to(values, (dof, 2)).T, order="C")
                return low, high
            upper = np.full(dof, np.inf if values is None else values)
        except (TypeError, ValueError):
            self.for_joints(dof)
            raise
        return -upper, upper

    def joint_range(self, dof: int) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper ends of the joint ranges [rad], (dof,) each; infinite if none.

        Args:
            dof: Number of joints.
        """
        try:
            ends = np.empty((2, dof))
            ends[0] = -np.inf if self.joint_lower is None else self.joint_lower
            ends[1] = np.inf if self.joint_upper is None else self.joint_upper
        except (TypeError, ValueError):
            self.for_joints(dof)
            raise
        return ends[0], ends[1]

    def middle(self, dof: int) -> FloatArray:
        """Return the middle of each joint range [rad]; the position nearest to 0 if unbounded.

        Args:
            dof: Number of joints.
        """
        low, high = self.joint_range(dof)
        both = np.isfinite(low) & np.isfinite(high)
        middle = (np.where(both, low, 0.0) + np.where(both, high, 0.0)) / 2
        return np.asarray(np.where(both, middle, np.clip(0.0, low, high)))

    def same_both_ways(self) -> bool:
        """Return whether the acceleration limits of all joints are symmetric."""
        values = self.joint_acceleration
        return values is None or values.ndim < 2 or bool((values[:, 0] == -values[:, 1]).all())


def _read_records() -> dict[str, Limit]:
    """Read the records of all limits, by name, from the annotations of `Limits`.

    Raises:
        InvalidInput: A limit that no planner can keep.
    """
    records = {}
    kinds = {"joint": "joint", "angular": "rotation"}
    for name, hint in get_type_hints(Limits, include_extras=True).items():
        parts = list(parts_of(hint))
        for limit in (x for x in parts if isinstance(x, Limit)):
            if limit.order not in CONSTRAINT_ORDERS and name not in WITHOUT_CONSTRAINT:
                raise InvalidInput(
                    f"The limit {name} has order {limit.order}, but the planner keeps only limits "
                    "of order 1 and 2, and joint_jerk. Declare the limit with order 1 or 2."
                )
            records[name] = dataclasses.replace(
                limit,
                name=name,
                kind=kinds.get(name.partition("_")[0], "tool"),
                label=limit.label or name.removeprefix("joint_").replace("_", " "),
                power=limit.order if limit.power is None else limit.power,
                quantity=next(x for x in parts if isinstance(x, Quantity)),
            )
    return records


# Records of all limits. Units of all limits, and of limits with values per joint. Names of the tool
# limits, of the joint limits without the ranges, and of those with two directions.
LIMITS = _read_records()
UNITS = {name: x.unit for name, x in LIMITS.items()}
JOINT_VALUES = {name: x.unit for name, x in LIMITS.items() if x.kind == "joint"}
TOOL_LIMITS = tuple(x for x in UNITS if x not in JOINT_VALUES)
JOINT_LIMITS = tuple(x for x in JOINT_VALUES if x not in JOINT_RANGE)
DIRECTED = tuple(x for x in JOINT_LIMITS if LIMITS[x].quantity.bounds)


def _is_unlimited(values: float | FloatArray) -> bool:
    """Return whether a limit is infinite for every joint, in both directions."""
    if isinstance(values, float):
        return values == math.inf
    # Fast path: one finite value is enough to decide.
    if math.isfinite(values.item(0)):
        return False
    return bool((values == ((-math.inf, math.inf) if values.ndim == 2 else math.inf)).all())


def or_unlimited(values: npt.ArrayLike | None, dof: int) -> FloatArray:
    """Return joint limits as an array, (dof,); infinity for every joint if `values` is None."""
    return np.full(dof, np.inf) if values is None else np.array(values, dtype=np.float64)


def reduce_limits(limits: Limits, reserve: float, *, for_play: bool = False) -> Limits:
    """Reduce the joint acceleration and torque limits by the fraction `reserve`, 0 to below 1.

    `for_play`: whether to reduce also the limits of jerk, tool and angular acceleration.
    """
    if not reserve:
        return limits
    reduced = {}
    for name, limit in LIMITS.items():
        value = getattr(limits, name)
        is_reserved = limit.reserved or (for_play and limit.reserved_for_play)
        if is_reserved and value is not None:
            reduced[name] = (1 - reserve) * value
    return limits.replace(**reduced) if reduced else limits


def select_joints(limits: Limits, joints: IntArray) -> Limits:
    """Return the limits of some joints, by index, from limits with one value per joint."""
    rows = {name: getattr(limits, name) for name in JOINT_VALUES}
    return limits.replace(**{name: x[joints] for name, x in rows.items() if x is not None})
