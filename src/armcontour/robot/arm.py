"""The base class of all arms: kinematics of joint chains, limits and joint torques."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, Immutable
from armcontour.core.errors import InvalidInput, Unreachable
from armcontour.core.fields import checked
from armcontour.core.frames import Pose, read_poses, transforms
from armcontour.core.lazy import load_method
from armcontour.robot.bodies import Payload
from armcontour.robot.chain import Chain, link_table, state_rows
from armcontour.robot.limits import JOINT_RANGE, TOOL_LIMITS, UNITS, Limits
from armcontour.robot.preferred_chain import narrow_ranges

if TYPE_CHECKING:
    from armcontour.robot.closed_form_kinematics import ClosedForm
    from armcontour.robot.dynamics import Dynamics
    from armcontour.robot.scene import ArmShapes
    from armcontour.robot.tool_turning import ToolTurning

# A limit counts as equal to the arm's limit if it exceeds it by at most this fraction (for ends of
# joint ranges between -1 and 1 rad: by this angle [rad]), because files contain rounded values.
SAME_LIMIT = 1e-3
# A pose is reached if position and orientation are closer than this [m, rad].
MET = 1e-8
# A point farther out of reach than this [m] probably has a wrong unit. Arms reach 0.5 to 4 m;
# coordinates in mm that are read as m are hundreds of metres away.
FAR_OUT = 20.0


def unit_hint(gap: float) -> str:
    """Return the suffix "a unit may be missing" for a point `gap` [m] out of reach, or ""."""
    if gap < FAR_OUT:
        return ""
    return (
        ". Lengths without a unit are metres, so a unit may be missing (for drawings: --units mm)"
    )


def load_named(arm: Any) -> Any:
    """Load an arm that is given by its name or file; return anything else unchanged."""
    return load_method(Arm.loaded_by)(arm) if isinstance(arm, str | PathLike) else arm


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
        The limits with one value per joint, with joint ranges inside those of the arm's
        preferences. A limit is None only if it is removed or the arm has none.

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
    chain = getattr(arm, "chain", None)
    return resolved if chain is None else narrow_ranges(resolved, chain)


def unit_of(arm: Arm | None, unit: str, joint: int | None = None) -> str:
    """Return `Chain.unit` of an arm for `joint`; if the arm is None, that of revolute joints."""
    chain: Chain | None = getattr(arm, "chain", None)
    return unit if chain is None else chain.unit(unit, joint)


def compare_limits(limits: Limits, arm: Arm) -> str:
    """Return a warning about limits (one value per joint) above the arm's, or ""."""
    # Removed limits are None and are skipped.
    above = []
    for name, unit in UNITS.items():
        values = getattr(limits, name)
        arm_values = getattr(arm.limits, name)
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
            joint = "" if name in TOOL_LIMITS else f" of joint {j + 1}"
            unit = unit_of(arm, unit, int(j)) if joint else unit
            value, arm_value = (f"{sign * x[side, j]:.6g} {unit}" for x in (requested, has))
            above.append(f"{name}{joint} is {value}, the arm's {arm_value}")
    if not above:
        return ""
    called = getattr(arm, "name", "without a name")
    return (
        f"limits are above those of the arm {called}, so the real arm may not follow the plan: "
        f"{'; '.join(above)}."
    )


def _as_ceilings(name: str, limits: Limits, dof: int) -> FloatArray:
    """Return upper bounds, (1, 1) or (rows, dof); a second row has the negated lower bounds."""
    if name in TOOL_LIMITS:
        return np.reshape(getattr(limits, name), (1, 1))
    low, high = limits.joint_range(dof) if name in JOINT_RANGE else limits.bounds(name, dof)
    if name == "joint_lower":
        return -low[None]
    return high[None] if name == "joint_upper" else np.stack([high, -low])


class Arm(Immutable, ABC):
    """An arm whose tool moves by a chain of joints: in space, or with x and y in the plane z = 0.

    Methods take joint positions q [rad] and their time derivatives dq, ddq, dddq, (..., dof) each,
    and return tool vectors, (..., dimension). For a prismatic joint, m replaces rad and N replaces
    N m in all units. An arm is immutable; `with_limits` and similar methods return another one.

    >>> arm.name, arm.dof, arm.dimension
    ('PMK-3s', 2, 2)
    >>> arm.forward([0.0, 0.0])[:2, 3]
    array([0.135, 0.465])

    Attributes:
        name: Name of the arm, for messages and reports.
        joint_names: One name per joint.
        limits: Limits of the arm's joints and tool.
        dimension: Number of tool-point coordinates: 2 in the plane, 3 in space.
        branches: Names of the IK branches (solutions of the closed-form inverse kinematics), the
            default branch first; empty if the arm has no closed form.
        source: Where the arm's data come from.
        chain: The joints and links.
        link_table: Table of the links for the compiled kinematics, (rows + 1, 15).
        limits_hint: Advice on how to add the limits that the arm lacks, for messages.
        notes: Sentences on data that were ignored or chosen when the arm was read from a file.
        assumed_limits: Limits that are only assumed, because the robot description lacks them;
            None if there are none.
        unused_limits: Published limits of the robot's own joints that are not in `limits`, so plans
            keep them only if you specify them; None if there are none.
    """

    name: str
    joint_names: tuple[str, ...]
    limits: Limits
    dimension: int
    branches: tuple[str, ...]
    source: str
    chain: Chain
    link_table: FloatArray
    limits_hint: str = ""
    notes: tuple[str, ...] = ()
    assumed_limits: Limits | None = None
    unused_limits: Limits | None = None
    _read_shapes: Callable[[], ArmShapes] | None = None
    # Where an arm is an argument, this function loads it by its name or file.
    loaded_by: ClassVar[str] = "load_arm"
    _instead = "Use with_limits, with_tool, with_work or with_dynamics instead"

    def __repr__(self) -> str:
        """Write class, name and number of joints."""
        return f"{type(self).__name__}({self.name!r}, {self.dof} joints)"

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @checked
    def with_limits(self, limits: Limits) -> Self:
        """Return the arm with other limits.

        >>> arm.with_limits(ac.Limits(speed=0.1)).limits.speed
        0.1

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
        """Shapes of the links and the tool; None if they are not known.

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

        >>> loaded = ac.load_arm("ur5e").with_dynamics(payload=ac.Payload(mass=2.0))
        >>> loaded.chain.payload.mass
        2.0

        Args:
            payload: Load at the tip, instead of the arm's load.
            armature: Inertia of each drive, reflected to its joint [kg m²].
            viscous: Viscous friction of the joints [N m s/rad].
            coulomb: Coulomb friction of the joints [N m].

        Raises:
            InvalidInput: The arm has no bodies, a value is negative, or values are for another
                number of joints.
        """
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

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the dynamics, which are computed again."""
        return {k: x for k, x in vars(self).items() if k != "dynamics"}

    def _copy(self, **changes: Any) -> Self:
        """Return a copy with other attributes, without the cached values that depend on them."""
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        if "_read_shapes" in changes:
            vars(other).pop("shapes", None)
        if "limits" in changes:
            vars(other).pop("span", None)
        if "chain" in changes:
            # The cached dynamics belong to the previous chain.
            vars(other).pop("dynamics", None)
        if "limits" in changes or "chain" in changes:
            vars(other).pop("from_floor", None)
        vars(other).update(changes)
        return other

    @property
    def has_bodies(self) -> bool:
        """True if the masses of the links are known."""
        return self.chain.masses is not None

    @cached_property
    def dynamics(self) -> Dynamics:
        """The rigid-body model that computes the joint torques.

        Raises:
            InvalidInput: The masses of the links are not known.
        """
        from armcontour.robot.dynamics import Dynamics

        if not self.has_bodies:
            raise InvalidInput(
                f"The masses of the arm {self.name} are not known, so its torques cannot be "
                "computed. Load the arm from a file whose links have masses, centres of mass and "
                "inertias."
            )
        return Dynamics(self.chain)

    def _describe(
        self, name: str, chain: Chain, limits: Limits, source: str, limits_hint: str
    ) -> None:
        """Check and store the attributes of all arms that have a chain."""
        self.name = checks.check_name("name of an arm", name)
        self.chain = chain
        self.joint_names = chain.joints
        self.limits = limits.for_joints(len(chain)).of_chain(chain.prismatic or ())
        self.source = source
        self.limits_hint = limits_hint
        self.link_table = link_table(chain)

    @cached_property
    def closed_form(self) -> ClosedForm | None:
        """Closed-form inverse kinematics of the whole pose; None if it does not support the arm."""
        from armcontour.robot.closed_form_kinematics import ClosedForm

        return ClosedForm.from_chain(self.chain)

    @cached_property
    def tool_turning(self) -> ToolTurning | None:
        """Rotations of the tool if it turns about one direction or not at all, otherwise None."""
        from armcontour.robot.tool_turning import ToolTurning

        at_zero = np.zeros(self.dof)
        return ToolTurning.about(self.jacobian(at_zero)[3:].T, self.poses(at_zero)[:, :3])

    @cached_property
    def span(self) -> float:
        """Sum of the distances from joint to joint and from the last joint to the tool [m]."""
        end = self.chain.tip @ self.chain.tool
        followed = [x.place.position for x in self.chain.followers]
        parts = np.array([*self.chain.positions, *followed, end.position])
        return float(np.linalg.norm(parts, axis=1).sum()) + self.stroke

    @property
    def stroke(self) -> float:
        """Sum of the prismatic joints' largest distances from 0 [m]; 1 m without a range."""
        farthest = np.maximum(*map(np.abs, self.limits.joint_range(self.dof)))[self.chain.slides]
        return float(np.where(np.isfinite(farthest), farthest, 1.0).sum())

    @checked
    def forward(self, q: npt.ArrayLike) -> FloatArray:
        """Return tool poses in the work frame as homogeneous transforms, (..., 4, 4).

        Poses of a planar arm are in the plane z = 0.

        >>> arm.forward([0.0, 0.0])[:3, 3]
        array([0.135, 0.465, 0.   ])

        Args:
            q: Joint positions [rad], (..., dof).

        Raises:
            InvalidInput: The number of columns differs from the number of joints.
        """
        return transforms(self.poses(q))

    @checked
    def inverse(
        self,
        pose: Pose,
        near: npt.ArrayLike | None = None,
        all: bool = False,  # noqa: A002, FBT001, FBT002
    ) -> FloatArray:
        """Return joint positions [rad], (dof,), within the ranges at which the tool has a pose.

        Planar arms and most six-joint arms have a closed-form solution; for other arms it is
        searched.

        >>> arm.inverse((0.35, 0.2, 0.0)).round(3)
        array([0.024, 1.782])
        >>> arm.inverse((0.35, 0.2, 0.0), all=True).shape
        (2, 2)

        Args:
            pose: The pose in the work frame: a 4 by 4 transform, a pinocchio.SE3 or a Frame. If you
                specify a position only [m], the rotation is free. Poses of a planar arm need z = 0;
                their rotation is ignored. If you specify several poses, (n, 4, 4), the solution of
                each pose starts from the previous solution.
            near: Joint positions [rad], (dof,), to which the solution should be nearest; by default
                the middle of the joint ranges.
            all: Return all configurations for one pose, the nearest first, (k, dof). Configurations
                that differ by whole turns count once. If there are infinitely many, a sample is
                returned.

        Raises:
            Unreachable: No joint positions within the ranges reach the pose.
            InvalidInput: `pose` is not a pose, or `near` does not have one value per joint.
        """
        points, axes = read_poses("pose", pose)
        if all and points.ndim > 1:
            raise InvalidInput(f"all=True requires one pose, but there are {len(points)}.")
        rows = points.reshape(-1, points.shape[-1])
        start = None if near is None else checks.per_joint("near", near, self.dof, "rad")
        turned = [None] * len(rows) if axes is None else axes.reshape(-1, 3, 3)
        solutions: list[FloatArray] = []
        for i, (point, rotation) in enumerate(zip(rows, turned, strict=True)):
            try:
                inside = self._reach(point, rotation, start)
            except Unreachable as error:
                error.index = i
                raise
            if all:
                return inside
            start = inside[0]
            solutions.append(start)
        return np.reshape(solutions, (*points.shape[:-1], self.dof))

    @abstractmethod
    def _solutions(
        self, point: FloatArray, rotation: FloatArray | None, near: FloatArray | None
    ) -> tuple[FloatArray, float]:
        """Return joint positions for a pose, (k, dof), in or out of range, and a distance [m].

        Without joint positions, it is the tool's smallest distance from the pose; otherwise 0.
        """

    def _reach(
        self, point: FloatArray, rotation: FloatArray | None, near: FloatArray | None
    ) -> FloatArray:
        """Return the solutions within the joint ranges, (k, dof), the nearest to `near` first."""
        candidates, gap = self._solutions(point, rotation, near)
        turned = [shift_by_turns(self, q[None], near) for q in candidates]
        inside = np.array([q[0] for q, fits in turned if fits]).reshape(-1, self.dof)
        away = np.abs(inside - (_range_middle(self) if near is None else near)).max(axis=1)
        if len(inside):
            return np.asarray(inside[np.argsort(away, kind="stable")])
        if len(candidates):
            example = np.round(candidates[0], 4).tolist()
            reason = (
                f"within its joint ranges. A solution outside of the ranges is {example} "
                f"{self.chain.unit('rad')}"
            )
        elif gap > MET:
            reason = f"because the tool remains {gap:.3g} m away"
        else:
            reason = "with this orientation"
        raise Unreachable(
            f"The arm {self.name} does not reach the pose at {np.round(point, 6).tolist()} m "
            f"{reason}. Move or rotate the pose{unit_hint(gap)}.",
            point=point.tolist(),
            limit="range" if len(candidates) else "reach",
            needed=gap,
            allowed=0.0,
        )

    @checked
    def jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Return the geometric Jacobian: twist of the tool per joint velocity, (..., 6, dof).

        The first three rows are the velocity of the tool point [m/rad], the last three the angular
        velocity [rad/rad], along the axes of the work frame (`LOCAL_WORLD_ALIGNED` in pinocchio).

        >>> twist = arm.jacobian([0.1, 1.0]) @ [0.2, 0.0]
        >>> twist.round(3)
        array([ 0.069, -0.043,  0.   ,  0.   ,  0.   , -0.2  ])

        Args:
            q: Joint positions [rad], (..., dof).

        Raises:
            InvalidInput: The number of columns differs from the number of joints.
        """
        from armcontour.robot.kernels import jacobians

        leading, (rows,) = state_rows(self.dof, q)
        return np.asarray(jacobians(self.link_table, rows).reshape(*leading, 6, self.dof))

    def tool_position(self, q: npt.ArrayLike) -> FloatArray:
        """Return the tool points [m], (n, dimension); for a planar arm by eq. (1)-(2).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        return self.poses(q)[..., : self.dimension, 3].copy()

    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Return the points of the joints and the tool [m], (n, dof + 1, dimension).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        points = self._frames(q)[..., : self.dimension, 3].copy()
        points[..., -1, :] = self.tool_position(q)
        return points

    def tool_jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Return the tool velocity per joint velocity [m/rad], (n, dimension, dof).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        return self.jacobian(q)[..., : self.dimension, :]

    def tool_jacobian_rate(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Return the time derivative of `tool_jacobian` [m/(rad s)], (n, dimension, dof).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        from armcontour.robot.kernels import FACTOR, LEADER, SLIDES, frames_of

        leading, (rows, rates) = state_rows(self.dof, q, dq)
        table = self.link_table
        frames = frames_of(table, rows)
        slides = table[:-1, SLIDES] != 0.0
        # Joints that follow others have rows of their own.
        leaders = table[:-1, LEADER].astype(np.intp)
        factors = table[:-1, FACTOR]
        rates = rates[:, leaders] * factors
        points = frames[..., 3]
        directions = frames[:, :-1, :, 2]
        angular = np.cumsum(directions * (rates * ~slides)[..., None], axis=1)
        # Each link moves the origin of the next joint; the last link moves the tool.
        steps = _cross(angular, np.diff(points, axis=1))
        moving = np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)
        slid = np.cumsum(directions * (rates * slides)[..., None], axis=1)
        count = len(leaders)
        moving += slid[:, np.minimum(np.arange(count + 1), count - 1)]
        # A joint does not move its own axis, so the axis is constant in the frame of its link.
        turning = _cross(angular, directions)
        arms = points[:, -1:] - points[:, :-1]
        opening = moving[:, -1:] - moving[:, :-1]
        rate = _cross(turning, arms) + _cross(directions, opening)
        rate[:, slides] = turning[:, slides]
        if count > self.dof:
            along = np.zeros((self.dof, count))
            along[leaders, np.arange(count)] = factors
            rate = along @ rate
        rate = np.swapaxes(rate, -1, -2)[:, : self.dimension]
        return rate.reshape(*leading, self.dimension, self.dof)

    def tool_velocity(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Return the tool velocity `J(q) dq` [m/s], (n, dimension), eq. (22).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        return self._motion(q, dq)[..., : self.dimension]

    def tool_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Return the tool acceleration `J ddq + dJ/dt dq` [m/s²], (n, dimension).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        return self._motion(q, dq, ddq)[..., 6 : 6 + self.dimension]

    def tool_motion(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Return the tool velocity [m/s] and acceleration [m/s²] from one kinematics evaluation.

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        motion = self._motion(q, dq, ddq)
        return motion[..., : self.dimension], motion[..., 6 : 6 + self.dimension]

    def _motion(self, *states: npt.ArrayLike) -> FloatArray:
        """Return the tool pose; with dq, ... the tool twist and its derivatives."""
        # Numba is imported at first use, because it loads slowly and many arms are only listed.
        from armcontour.robot.kernels import tool_motion

        leading, rows = state_rows(self.dof, *states)
        # The kernel does not use derivatives above its order, so q is passed in their place.
        motion = tool_motion(self.link_table, len(rows) - 1, *(rows * 4)[:4])
        return np.asarray(motion.reshape(*leading, motion.shape[1]))

    def poses(self, q: npt.ArrayLike) -> FloatArray:
        """Return the rotations and positions of the tool in the work frame, (..., 3, 4).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        return self._motion(q).reshape(*np.shape(q)[:-1], 3, 4)

    def _frames(self, q: npt.ArrayLike) -> FloatArray:
        """Return the joint frames and the tool frame in the work frame, (..., dof + 1, 3, 4)."""
        from armcontour.robot.kernels import frames_of

        leading, (rows,) = state_rows(self.dof, q)
        frames = self.chain.without_followers(frames_of(self.link_table, rows))
        return np.asarray(frames.reshape(*leading, self.dof + 1, 3, 4))

    def torque(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> FloatArray:
        """Return each drive's torque [N m], `M(q) ddq + C(q, dq) dq + g(q) + friction(dq)`.

        The torque covers the inertia of links, drives and payload, gravity, and friction.

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.

        Raises:
            InvalidInput: The masses of the links are not known.
        """
        dynamics = self.dynamics
        torque = dynamics.torque(q, dq, ddq)
        return torque + dynamics.friction(dq) if dynamics.has_friction else torque


def shift_by_turns(
    arm: Arm, q: FloatArray, start: FloatArray | None = None
) -> tuple[FloatArray, bool]:
    """Shift joint positions by whole turns into the ranges; also return whether all are inside.

    The shift is one per joint. It brings the positions as near as possible to `start`, or to the
    middle of the ranges. A joint whose range has only one end is shifted into its range. An axis of
    a positioner that turns endlessly begins near 0. Prismatic joints are not shifted.

    Args:
        arm: The arm.
        q: Joint positions [rad], (n, dof).
        start: Joint positions [rad], (dof,), to which the first row should be near, or None.
    """
    lower, upper = arm.limits.joint_range(arm.dof)
    low = q.min(axis=0)
    high = q.max(axis=0)
    turn = 2 * np.pi
    both = np.isfinite(lower) & np.isfinite(upper)
    middle = _range_middle(arm)
    lowest = np.where(both, -np.inf, np.ceil((lower - low) / turn))
    highest = np.where(both, np.inf, np.floor((upper - high) / turn))
    turns = np.rint((middle - (low + high) / 2) / turn)
    endless = np.isinf(lower) & np.isinf(upper)
    endless[arm.chain.floor_link :] = False
    turns[endless] = np.rint(-q[0, endless] / turn)
    shift = turn * np.minimum(np.maximum(turns, lowest), highest)
    if start is not None:
        nearest = turn * np.rint((start - q[0]) / turn)
        shift = np.where((low + nearest >= lower) & (high + nearest <= upper), nearest, shift)
    shift = np.where(arm.chain.slides, 0.0, shift)
    return q + shift, bool(((low + shift >= lower) & (high + shift <= upper)).all())


def _range_middle(arm: Arm) -> FloatArray:
    """Return the middle of each joint range [rad], (dof,); 0 if either end is unbounded."""
    lower, upper = arm.limits.joint_range(arm.dof)
    both = np.isfinite(lower) & np.isfinite(upper)
    return np.where(both, lower, 0.0) / 2 + np.where(both, upper, 0.0) / 2


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the vector products, (..., 3), five times as fast as `np.cross` for few vectors."""
    products = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return products
