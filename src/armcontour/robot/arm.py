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
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.text import count_noun
from armcontour.robot.chain import Chain, Payload
from armcontour.robot.limits import JOINT_RANGE, TOOL_LIMITS, UNITS, Limits

if TYPE_CHECKING:
    from armcontour.robot.dynamics import Dynamics
    from armcontour.robot.scene import ArmShapes

# A limit counts as equal to the arm's limit if it exceeds it by at most this fraction (for ends of
# joint ranges between -1 and 1 rad: by this angle [rad]), because files contain rounded values.
SAME_LIMIT = 1e-3
# A point farther out of reach than this [m] probably has a wrong unit. Arms reach 0.5 to 4 m;
# coordinates in mm that are read as m are hundreds of metres away.
FAR_OUT = 20.0


def unit_hint(gap: float) -> str:
    """Message suffix that suggests a missing unit for a point `gap` [m] out of reach, or ""."""
    if gap < FAR_OUT:
        return ""
    return (
        "; lengths without a unit are metres, so a unit may be missing (for drawings: --units mm)"
    )


def resolve_limits(
    user: str, arm: Arm, limits: Limits | None, planned: Limits | None = None
) -> Limits:
    """Resolve limits value by value: explicit limits, then the plan's, then the arm's limits.

    Args:
        user: Name of the caller, which begins the error message.
        arm: The arm.
        limits: Explicit limits, or None.
        planned: The limits of the plan; None without a plan or limits.

    Returns:
        The limits with one value per joint. A limit is None only if it is lifted or the arm has
        none.

    Raises:
        InvalidInput: `limits` is not a Limits, has another number of joints or an empty joint
            range, or `arm` is not an arm.
    """
    # `arm` may be any object with `dof` and `limits`, because timing of a joint path needs nothing
    # else. A trajectory has both attributes but is callable, so it is refused here.
    if callable(arm) or not (hasattr(arm, "dof") and hasattr(arm, "limits")):
        checks.check_type("arm", arm, Arm)
    if limits is not None and not isinstance(limits, Limits):
        raise InvalidInput(
            f"{user} needs Limits, such as arm.limits.replace(speed=0.1), not "
            f"{type(limits).__name__}."
        )
    first, *others = (x for x in (limits, planned, arm.limits) if x is not None)
    resolved = first.for_joints(arm.dof)
    for base in others:
        resolved = resolved.over(base.for_joints(arm.dof))
    return resolved


def compare_limits(limits: Limits, arm: Arm) -> str:
    """Warning about limits (one value per joint) that exceed the arm's; empty if none does."""
    # Lifted limits are None and are skipped.
    above = []
    for name, unit in UNITS.items():
        values, arm_values = getattr(limits, name), getattr(arm.limits, name)
        if values is None or arm_values is None or values is arm_values:
            continue
        requested, has = (_as_ceilings(name, x, arm.dof) for x in (limits, arm.limits))
        scale = np.maximum(np.abs(has), 1.0 if name in JOINT_RANGE else 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            excess = np.where(
                np.isfinite(requested) & np.isfinite(has), (requested - has) / scale, 0.0
            )
        side, j = np.unravel_index(int(excess.argmax()), excess.shape)
        if excess[side, j] > SAME_LIMIT:
            sign = -1.0 if side or name == "joint_lower" else 1.0
            factor = 1e3 if name in TOOL_LIMITS and unit.startswith("m/") else 1.0
            joint = "" if name in TOOL_LIMITS else f" of joint {j + 1}"
            written = f"m{unit}" if factor > 1 else unit
            value, arm_value = (
                f"{sign * factor * x[side, j]:.6g} {written}" for x in (requested, has)
            )
            above.append(f"{name}{joint} is {value}, the arm's {arm_value}")
    if not above:
        return ""
    called = getattr(arm, "name", "without a name")
    return (
        f"limits are above those of the arm {called}, so the real arm may not follow the plan: "
        f"{'; '.join(above)}."
    )


def _as_ceilings(name: str, limits: Limits, dof: int) -> FloatArray:
    """Upper bounds, (1, 1) or (rows, dof); the second row has negated lower bounds of a limit."""
    if name in TOOL_LIMITS:
        return np.reshape(getattr(limits, name), (1, 1))
    low, high = limits.joint_range(dof) if name in JOINT_RANGE else limits.bounds(name, dof)
    if name == "joint_lower":
        return -low[None]
    return high[None] if name == "joint_upper" else np.stack([high, -low])


class Arm(Immutable, ABC):
    """An arm with its kinematics and limits.

    Methods take joint positions q [rad] and their time derivatives dq, ddq, dddq, (..., dof) each,
    and return tool vectors, (..., dimension). An arm is immutable; `with_limits` and similar
    methods return another one.

    >>> arm.name, arm.dof, arm.dimension
    ('PMK-3s', 2, 2)
    >>> arm.forward([0.0, 0.0])[:2, 3]
    array([0.135, 0.465])

    Attributes:
        name: Name of the arm, for messages and reports.
        joint_names: One name per joint.
        limits: Limits of the arm's joints and tool.
        dimension: Number of coordinates of a tool point: 2 in the plane, 3 in space.
        branches: Names of the solutions of the closed-form inverse kinematics, the default
            solution first; empty if the arm has no closed form.
        source: Where the data of the arm come from.
        chain: The joints and links as data; None if the arm has no such data.
        limits_hint: Advice on how to add the limits that the arm lacks, for messages.
        notes: Sentences on data that were ignored or chosen when the arm was read from a file.
        assumed_limits: Limits that are only assumed, because the robot description lacks them;
            None if there are none.
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
    assumed_limits: Limits | None = None
    _read_shapes: Callable[[], ArmShapes] | None = None
    _instead = "Use with_limits, with_tool, with_work or with_dynamics instead"

    def __str__(self) -> str:
        """Name and number of joints."""
        parts = [
            count_noun(self.dof, "joint"),
            "in the plane" if self.dimension == 2 else "in space",
        ]
        if self.has_bodies:
            parts.append("with masses")
        if self._read_shapes is not None:
            parts.append("with shapes")
        return f"{self.name}: {', '.join(parts)}"

    def __repr__(self) -> str:
        """Class, name and number of joints."""
        return f"{type(self).__name__}({self.name!r}, {self.dof} joints)"

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @checked
    def with_limits(self, limits: Limits) -> Self:
        """Return the arm with other limits.

        Args:
            limits: The new limits, one value for all joints or one per joint; None keeps the arm's
                limit.

        Raises:
            InvalidInput: The number of values differs from the number of joints.
        """
        resolved = resolve_limits("with_limits", self, limits)
        return self if resolved is self.limits else self._copy(limits=resolved)

    @cached_property
    def shapes(self) -> ArmShapes | None:
        """Shapes of the links and of the tool; None if they are not known.

        The files are read at the first access.

        Raises:
            InvalidInput: A file of a shape is missing or cannot be read.
        """
        shapes = None if self._read_shapes is None else self._read_shapes()
        self._check_shapes(shapes)
        return shapes

    @property
    def knows_shapes(self) -> bool:
        """True if shapes are known and their files can be read."""
        try:
            return self.shapes is not None
        except InvalidInput:
            return False

    def with_shapes(self, shapes: ArmShapes | Callable[[], ArmShapes] | None) -> Self:
        """Return the arm with other shapes of its links and tool.

        Args:
            shapes: The shapes, or a function that reads them at the first access; None if unknown.

        Raises:
            InvalidInput: A shape belongs to a link that the arm does not have.
        """
        if callable(shapes):
            return self._copy(_read_shapes=shapes)
        self._check_shapes(shapes)
        return self._copy(_read_shapes=None, shapes=shapes)

    def _check_shapes(self, shapes: ArmShapes | None) -> None:
        """Check that every shape belongs to a link of the arm."""
        if shapes is not None:
            from armcontour.robot.scene import ArmShapes

            checks.check_type("shapes", shapes, ArmShapes)
        for shape in () if shapes is None else shapes.shapes:
            if not 0 <= shape.link <= self.dof:
                raise InvalidInput(
                    f"The shape of {shape.name} belongs to link {shape.link}, but the links of the "
                    f"arm {self.name} are 0 (the base) to {self.dof}."
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
        """Return the arm with another load, or with other drive inertia or friction.

        Specify one value for all joints or one per joint; None keeps the arm's value.

        Args:
            payload: Load at the tip, instead of the arm's load.
            armature: Inertia of each drive, reflected to its joint [kg m²].
            viscous: Viscous friction of the joints [N m s/rad].
            coulomb: Coulomb friction of the joints [N m].

        Raises:
            InvalidInput: The arm has no bodies, a value is negative, or values are for another
                number of joints.
        """
        if self.chain is None:
            raise InvalidInput(
                f"with_dynamics requires a chain of bodies, but the arm {self.name} has none."
            )
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
        """State without the dynamics, which are computed again."""
        return checks.pack_state({k: x for k, x in vars(self).items() if k != "dynamics"})

    def _copy(self, **changes: Any) -> Self:
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        if "_read_shapes" in changes:
            vars(other).pop("shapes", None)
        if "chain" in changes:
            # The cached dynamics belong to the previous chain.
            vars(other).pop("dynamics", None)
        vars(other).update(changes)
        return other

    def _rows(self, *states: npt.ArrayLike) -> tuple[tuple[int, ...], list[FloatArray]]:
        """Common shape of the states without the last axis, and the states as rows, (n, dof)."""
        # The shapes are checked because compiled code would read past the end of a short row.
        arrays = [checks.floats("states of an arm", x) for x in states]
        shape = arrays[0].shape
        if shape[-1:] != (self.dof,) or any(x.shape != shape for x in arrays):
            shape = self._common_shape(arrays)
            arrays = [np.broadcast_to(x, shape) for x in arrays]
        # Numba would compile the kernels again for read-only arrays.
        rows = [checks.kernel_array(x.reshape(-1, self.dof)) for x in arrays]
        return shape[:-1], rows

    def _common_shape(self, states: list[FloatArray]) -> tuple[int, ...]:
        """Shape to which the states can be broadcast; raises an error if there is none."""
        observed = ", ".join(str(x.shape) for x in states)
        if any(x.shape[-1:] != (self.dof,) for x in states):
            raise InvalidInput(
                f"The arm {self.name} has {self.dof} joints, so its states must be arrays with "
                f"{self.dof} columns, not {observed}."
            )
        try:
            return np.broadcast_shapes(*(x.shape for x in states))
        except ValueError:
            raise InvalidInput(
                f"States must have shapes that can be broadcast together, not {observed}."
            ) from None

    @property
    def has_bodies(self) -> bool:
        """True if the masses of the links are known."""
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
                "computed. Load the arm from a file whose links have masses, centres of mass and "
                "inertias."
            )
        return Dynamics(self.chain)

    @abstractmethod
    def tool_position(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points [m] at joint positions [rad].

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
