"""The base class of all arms: kinematics, limits and joint torques."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, Immutable
from armcontour.core.describing import count_noun
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.robot.chain import Chain, Payload
from armcontour.robot.limits import DIRECTED, JOINT_RANGE, TOOL_LIMITS, UNITS, Limits

if TYPE_CHECKING:
    from armcontour.robot.dynamics import Dynamics
    from armcontour.robot.scene import ArmShapes

# The step along the motion for the derivative of the rate of the Jacobian [rad]: truncation, its
# fourth power over 30, and rounding, 1e-16 over it, are about equal.
STEP = 1e-3
# A limit that exceeds the arm's by less than this share, or angle of a range [rad], is the arm's,
# rounded to the digits that people write.
SAME_LIMIT = 1e-3
# A point that is so far out of reach more probably has a wrong unit than a wrong place [m]: arms
# reach 0.5 to 4 m, and points in mm that are taken as m are hundreds of metres away.
FAR_OUT = 20.0


def hint_at_unit(gap: float) -> str:
    """The end of a sentence on a point that is `gap` [m] out of reach; "" for near ones."""
    if gap < FAR_OUT:
        return ""
    return "; lengths without a unit are metres: one may be missing (for drawings --units mm)"


def resolve_limits(
    user: str, arm: Arm, limits: Limits | None, planned: Limits | None = None
) -> Limits:
    """The limits that hold: the given ones, else those of a plan, else the arm's, value by value.

    Args:
        user: What needs them, the first words of the message.
        arm: The arm.
        limits: The given limits; None if none are given.
        planned: The limits of the plan that is used; None if there is none, or it has none.

    Returns:
        The limits with one value per joint; no limit is None that the arm has and nothing lifts.

    Raises:
        InvalidInput: They are no limits, are for another number of joints or leave a joint no
            range, or it is no arm.
    """
    # To time a joint path, an arm needs a number of joints and limits only.
    # A trajectory has both, too, and can be called.
    if callable(arm) or not (hasattr(arm, "dof") and hasattr(arm, "limits")):
        checks.check_type(user, arm, Arm)
    if limits is not None and not isinstance(limits, Limits):
        raise InvalidInput(
            f"{user} needs Limits, such as arm.limits.replace(speed=0.1), not "
            f"{type(limits).__name__}."
        )
    first, *others = (x for x in (limits, planned, arm.limits) if x is not None)
    resolved = first.for_joints(arm.dof)
    for x in others:
        resolved = resolved.over(x.for_joints(arm.dof))
    return resolved


def compare_limits(limits: Limits, arm: Arm) -> str:
    """A sentence on the limits that are above the arm's own; empty if there are none.

    Lifted limits do not count.

    Args:
        limits: The limits, with one value per joint.
        arm: The arm.
    """
    above = []
    for name, unit in UNITS.items():
        values, own = getattr(limits, name), getattr(arm.limits, name)
        if values is None or own is None or values is own:
            continue
        asked, has = (_as_ceilings(name, x, arm.dof) for x in (values, own))
        scale = np.maximum(np.abs(has), 1.0 if name in JOINT_RANGE else 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            excess = np.where(np.isfinite(asked) & np.isfinite(has), (asked - has) / scale, 0.0)
        side, j = np.unravel_index(int(excess.argmax()), excess.shape)
        if excess[side, j] > SAME_LIMIT:
            sign = -1.0 if side or name == "joint_lower" else 1.0
            factor = 1e3 if name in TOOL_LIMITS and unit.startswith("m/") else 1.0
            joint = "" if name in TOOL_LIMITS else f" of joint {j + 1}"
            written = f"m{unit}" if factor > 1 else unit
            here, there = (f"{sign * factor * x[side, j]:.6g} {written}" for x in (asked, has))
            above.append(f"{name}{joint} is {here}, the arm's {there}")
    if not above:
        return ""
    called = getattr(arm, "name", "without a name")
    return (
        f"limits are above those of the arm {called}, so a real one may not follow the plan: "
        f"{'; '.join(above)}."
    )


def _as_ceilings(name: str, values: npt.ArrayLike, dof: int) -> FloatArray:
    """Values of a limit that larger numbers widen: upward, and downward if there are two.

    Args:
        name: Name of the limit.
        values: Its values.
        dof: Number of joints.

    Returns:
        (1, 1), (1, dof) or (2, dof).
    """
    array = np.asarray(values, dtype=np.float64)
    if name in TOOL_LIMITS:
        return array.reshape(1, 1)
    if array.ndim == 2:
        return np.stack([array[:, 1], -array[:, 0]])
    sign = -1.0 if name == "joint_lower" else 1.0
    rows = 2 if name in DIRECTED else 1
    return sign * np.broadcast_to(array, (rows, dof))


class Arm(Immutable, ABC):
    """An arm with its kinematics and limits.

    Arrays have one row per state: (n, dof) for the joints, (n, dimension) for the tool.

    Once made, an arm does not change; `with_limits` and the like give another one.

    Attributes:
        name: Name of the arm, for messages and reports.
        joint_names: One name per joint.
        limits: Limits of the arm's joints and tool.
        dimension: Number of coordinates of a tool point: 2 in the plane, 3 in space.
        branches: Names of the solutions of the closed-form inverse kinematics, the default
            solution first; empty if the arm has no closed form.
        source: Where the data of the arm come from.
        chain: The joints and links as data; None if the arm has no such data.
        limits_hint: What the user can do to add the limits that the arm lacks, for messages.
        notes: Sentences on what was left out or chosen when the arm was read from a file.
    """

    name: str
    joint_names: tuple[str, ...]
    limits: Limits
    dimension: int
    branches: tuple[str, ...]
    source: str
    chain: Chain | None = None
    limits_hint: str = ""
    notes: tuple[str, ...] = ()
    _read_shapes: Callable[[], ArmShapes] | None = None
    _instead = "with_limits, with_name, with_tool, with_work and with_dynamics give another arm"

    def __str__(self) -> str:
        """Name and number of joints."""
        what = [
            count_noun(self.dof, "joint"),
            "in the plane" if self.dimension == 2 else "in space",
        ]
        if self.has_bodies:
            what.append("with masses")
        if self._read_shapes is not None:
            what.append("with shapes")
        return f"{self.name}: {', '.join(what)}"

    def __repr__(self) -> str:
        """Class, name and number of joints."""
        return f"{type(self).__name__}({self.name!r}, {self.dof} joints)"

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @checked
    def with_limits(self, limits: Limits) -> Self:
        """The arm with other limits.

        Args:
            limits: The new limits, one value for all joints or one per joint; limits that are not
                given stay.

        Raises:
            InvalidInput: The number of values differs from the number of joints.
        """
        own = resolve_limits("with_limits", self, limits)
        return self if own is self.limits else self._copy(limits=own)

    def with_name(self, name: str) -> Self:
        """The same arm under another name.

        Args:
            name: For people.

        Raises:
            InvalidInput: It is no short text.
        """
        return self._copy(name=checks.check_name("name of an arm", name))

    @cached_property
    def shapes(self) -> ArmShapes | None:
        """Shapes of the links and of the tool; None if they are not known.

        They are read from their files when they are first asked for.

        Raises:
            InvalidInput: A file of a shape is not there, or cannot be read.
        """
        found = None if self._read_shapes is None else self._read_shapes()
        self._refuse_shapes(found)
        return found

    @property
    def knows_shapes(self) -> bool:
        """Whether shapes are known, and their files are there and can be read."""
        try:
            return self.shapes is not None
        except InvalidInput:
            return False

    def with_shapes(self, shapes: ArmShapes | Callable[[], ArmShapes] | None) -> Self:
        """The same arm with other shapes of its links and tool.

        Args:
            shapes: The shapes, or what reads them when they are first asked for; None if they are
                not known.

        Raises:
            InvalidInput: A shape belongs to a link that the arm does not have.
        """
        if callable(shapes):
            return self._copy(_read_shapes=shapes)
        self._refuse_shapes(shapes)
        return self._copy(_read_shapes=None, shapes=shapes)

    def _refuse_shapes(self, shapes: ArmShapes | None) -> None:
        """Refuse shapes of links that the arm does not have."""
        if shapes is not None:
            from armcontour.robot.scene import ArmShapes

            checks.check_type("with_shapes", shapes, ArmShapes)
        for x in () if shapes is None else shapes.shapes:
            if not 0 <= x.link <= self.dof:
                raise InvalidInput(
                    f"The shape of {x.name} belongs to link {x.link}, but the links of the arm "
                    f"{self.name} are 0 (the base) to {self.dof}."
                )

    @checked
    def with_dynamics(
        self,
        *,
        payload: Payload | None = None,
        armature: npt.ArrayLike | None = None,
        viscous: npt.ArrayLike | None = None,
        coulomb: npt.ArrayLike | None = None,
    ) -> Self:
        """The same arm with another load, or with drives of another inertia or friction.

        Values are one for all joints or one per joint; what is None stays as it is.

        Args:
            payload: Load at the tip, in the place of the arm's own.
            armature: Inertia of each drive, reflected to its joint [kg m²].
            viscous: Viscous friction of the joints [N m s/rad].
            coulomb: Coulomb friction of the joints [N m].

        Raises:
            InvalidInput: The arm has no bodies, a value is negative, or values are for another
                number of joints.
        """
        if self.chain is None:
            raise InvalidInput(f"The arm {self.name} has no chain of bodies that could change.")
        per_joint = {
            "armature": (armature, "kg m²"),
            "viscous": (viscous, "N m s/rad"),
            "coulomb": (coulomb, "N m"),
        }
        changes: dict[str, object] = {
            name: checks.per_joint(name, values, self.dof, unit)
            for name, (values, unit) in per_joint.items()
            if values is not None
        }
        if payload is not None:
            changes["payload"] = payload
        return self._copy(chain=self.chain.replace(**changes)) if changes else self

    def __getstate__(self) -> checks.State:
        """Everything but the dynamics, which are a library's and computed anew."""
        return checks.pack_state({k: x for k, x in vars(self).items() if k != "dynamics"})

    def _copy(self, **changes: Any) -> Self:
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        if "_read_shapes" in changes:
            vars(other).pop("shapes", None)
        if "chain" in changes:
            # The dynamics of this arm may be computed already.
            vars(other).pop("dynamics", None)
        vars(other).update(changes)
        return other

    def _rows(self, *states: npt.ArrayLike) -> tuple[tuple[int, ...], list[FloatArray]]:
        """Leading shape and rows of the given states, (rows, dof) each.

        The shapes are checked because compiled code would read past the end of a short row.

        Raises:
            InvalidInput: The number of columns is wrong or the shapes do not fit together.
        """
        arrays = [checks.floats("states of an arm", x) for x in states]
        shape = arrays[0].shape
        if shape[-1:] != (self.dof,) or any(x.shape != shape for x in arrays):
            shape = self._common_shape(arrays)
            arrays = [np.broadcast_to(x, shape) for x in arrays]
        # Numba would compile the kernels a second time for read-only arrays.
        rows = [checks.kernel_array(x.reshape(-1, self.dof)) for x in arrays]
        return shape[:-1], rows

    def _common_shape(self, states: list[FloatArray]) -> tuple[int, ...]:
        """The shape to which the states are broadcast.

        Raises:
            InvalidInput: The number of columns is wrong or the shapes do not fit together.
        """
        seen = ", ".join(str(x.shape) for x in states)
        if any(x.shape[-1:] != (self.dof,) for x in states):
            raise InvalidInput(
                f"The arm {self.name} has {self.dof} joints, so its states must be arrays with "
                f"{self.dof} columns, not {seen}."
            )
        try:
            return np.broadcast_shapes(*(x.shape for x in states))
        except ValueError:
            raise InvalidInput(f"States must have shapes that fit together, not {seen}.") from None

    @property
    def has_bodies(self) -> bool:
        """Whether the masses of the links are known."""
        return self.chain is not None and self.chain.masses is not None

    @cached_property
    def dynamics(self) -> Dynamics:
        """The rigid-body model that computes the joint torques.

        Raises:
            InvalidInput: The masses of the links are not known.
        """
        from armcontour.robot.dynamics import Dynamics

        if self.chain is None or self.chain.masses is None:
            raise InvalidInput(
                f"The masses of the arm {self.name} are not known, so its torques cannot be "
                "computed: load it from a file whose links have masses, centres of mass and "
                "inertias."
            )
        return Dynamics(self.chain)

    @abstractmethod
    def tool_position(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points [m] of joint positions [rad].

        Args:
            q: Joint positions [rad], (..., dof).
        """

    @abstractmethod
    def tool_jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Tool velocity per joint velocity [m/rad], (n, dimension, dof).

        Args:
            q: Joint positions [rad], (..., dof).
        """

    @abstractmethod
    def tool_jacobian_rate(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Time derivative of `tool_jacobian` at the joint velocities `dq`, (n, dimension, dof).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """

    @abstractmethod
    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Points on the arm from the base to the tool, for drawings, (n, points, dimension) [m].

        Args:
            q: Joint positions [rad], (..., dof).
        """

    def tool_velocity(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Tool velocity [m/s], eq. (22).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        return np.asarray(np.einsum("...ij,...j->...i", self.tool_jacobian(q), np.asarray(dq)))

    def tool_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Tool acceleration [m/s²].

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        coupling = np.einsum("...ij,...j->...i", self.tool_jacobian_rate(q, dq), np.asarray(dq))
        return np.asarray(self.tool_velocity(q, ddq) + coupling)

    def tool_jerk(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, dddq: npt.ArrayLike
    ) -> FloatArray:
        """Tool jerk: the third derivative of the tool point [m/s³], (..., dimension).

        An arm of one's own has it without writing it: `J dddq + 3 dJ/dt ddq` and the derivative of
        `dJ/dt dq` along dq, by differences of the fourth order. Their error is about 1e-12 of the
        reach times the cube of the sum of all joint speeds.

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
            dddq: Joint jerks [rad/s³], same shape.
        """
        at, rate, second = (checks.floats("states of an arm", x) for x in (q, dq, ddq))
        total = np.abs(rate).sum(axis=-1, keepdims=True)
        way = rate / np.where(total > 0, total, 1.0)

        def bias(along: float) -> FloatArray:
            jacobian_rate = self.tool_jacobian_rate(at + along * STEP * way, way)
            return np.asarray(np.einsum("...ij,...j->...i", jacobian_rate, way))

        change = (8 * (bias(1) - bias(-1)) - (bias(2) - bias(-2))) / (12 * STEP)
        coupling = np.einsum("...ij,...j->...i", self.tool_jacobian_rate(at, rate), second)
        return np.asarray(self.tool_velocity(at, dddq) + 3 * coupling + change * total**3)

    def tool_motion(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Tool velocity [m/s] and tool acceleration [m/s²].

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        return self.tool_velocity(q, dq), self.tool_acceleration(q, dq, ddq)

    def torque(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> FloatArray:
        """Torque of each joint's drive [N m].

        The torque covers the inertia of links, drives and payload, gravity, and friction.

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.

        Raises:
            InvalidInput: The masses of the links are not known.
        """
        dynamics = self.dynamics
        return dynamics.torque(q, dq, ddq) + dynamics.friction(dq)
