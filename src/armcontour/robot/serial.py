"""Serial arms in space with any number of revolute and prismatic joints."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.frames import IDENTITY, Frame, Pose
from armcontour.robot.arm import Arm
from armcontour.robot.bodies import Payload
from armcontour.robot.chain import Chain
from armcontour.robot.external_axes import FIELDS, Positioner, PositionerAxis, Rail
from armcontour.robot.limits import JOINT_VALUES, Limits, select_joints
from armcontour.robot.preferences import JointPreference, Prefer
from armcontour.robot.preferred_chain import apply_preferences, narrow_ranges

if TYPE_CHECKING:
    from armcontour.robot.scene import ArmShapes

# Joint axes are parallel if the sine of their angle is below this, which allows for rounding
# errors.
PARALLEL_AXES = 1e-9


class SerialArm(Arm):
    """A serial arm in space.

    All positions, velocities and orientations of the tool are in the work frame. Methods take
    states of any leading shape. A twist is the tool's velocity [m/s] followed by its angular
    velocity [rad/s], (n, 6), along the axes of the work frame.

    >>> ur5e = ac.load_arm("ur5e")
    >>> ur5e.forward(np.zeros(6))[0].shape
    (4,)

    Args:
        name: Name of the arm, for messages and reports.
        chain: Joints and links of the arm.
        limits: Limits of the arm's joints and tool.
        source: Where the data of the arm come from.
        limits_hint: Advice on how to add the limits that the arm lacks, for messages.
        notes: Sentences on data that were ignored or chosen when the arm was read.
        assumed_limits: Those of the limits that are only assumed; None if there are none.
        unused_limits: Published limits of the robot's own joints that are not in `limits`; None if
            there are none.
    """

    dimension = 3
    branches = ()

    @checked
    def __init__(
        self,
        *,
        name: str,
        chain: Chain,
        limits: Limits,
        source: str = "",
        limits_hint: str = "",
        notes: tuple[str, ...] = (),
        assumed_limits: Limits | None = None,
        unused_limits: Limits | None = None,
    ) -> None:
        self._describe(name, chain, limits, source, limits_hint)
        self.notes = notes
        self.assumed_limits = assumed_limits
        self.unused_limits = unused_limits
        self._freeze()

    def _solutions(
        self, point: FloatArray, rotation: FloatArray | None, near: FloatArray | None
    ) -> tuple[FloatArray, float]:
        """Return joint positions for a pose, (k, dof), and a distance [m]; see `Arm._solutions`."""
        # Imported at first use, because compiled functions load slowly.
        from armcontour.robot import inverse_kinematics

        if len(point) != 3:
            raise InvalidInput(f"A position of the arm {self.name} must have x, y and z.")
        task = inverse_kinematics.POINT if rotation is None else inverse_kinematics.WHOLE
        target = np.column_stack([IDENTITY if rotation is None else rotation, point])
        candidates = inverse_kinematics.configurations(self, target, task)
        if near is not None and task < self.dof:
            # The sample of infinitely many solutions may include none near the start.
            nearest = inverse_kinematics.configurations(self, target, task, near)
            candidates = np.concatenate([nearest, candidates])
        if len(candidates):
            return candidates, 0.0
        starts = inverse_kinematics.seeds(self)[: inverse_kinematics.REACH_SEEDS]
        return candidates, float(
            inverse_kinematics.out_of_reach(self, target[None], task, starts)[0]
        )

    @cached_property
    def moves_in_a_plane(self) -> bool:
        """True if the joints move the tool in a plane only."""
        if self.chain.followers:
            # Linkages move the tool along circles, whose planes the axes do not tell.
            return False
        jacobian = self.jacobian(np.zeros(self.dof))
        slides = self.chain.slides
        # The angular part of the Jacobian has the revolute joint axes as columns.
        axes = jacobian[3:, ~slides]
        paths = jacobian[:3, slides]
        rank = np.linalg.matrix_rank(axes, tol=PARALLEL_AXES) if axes.size else 0
        if rank == 0:
            return bool(np.linalg.matrix_rank(paths, tol=PARALLEL_AXES) < 3)
        return bool(rank == 1 and (np.abs(axes[:, 0] @ paths) < PARALLEL_AXES).all())

    @checked
    def with_tool(self, tool: Pose, payload: Payload | None = None) -> SerialArm:
        """Return the arm with another tool.

        Args:
            tool: Tool frame in the frame of the tip: a Frame, a 4 by 4 transform, a pinocchio.SE3
                or a position [m]. Its origin follows paths; its z axis is the tool axis.
            payload: Load at the tip; by default the load of this arm.
        """
        carried = self.chain.payload if payload is None else payload
        return self._with(self.chain.replace(tool=Frame.from_pose(tool), payload=carried))

    @checked
    def with_work(self, work: Pose) -> SerialArm:
        """Return the arm with its tool points in another work frame.

        Args:
            work: Work frame of the paths in the base frame: a Frame, a 4 by 4 transform, a
                pinocchio.SE3 or a position [m].
        """
        return self._with(self.chain.replace(base=Frame.from_pose(work).inverse), "closed_form")

    @checked
    def with_base_moved(self, moved: Pose) -> SerialArm:
        """Return the arm with its base, and its rail, moved in the cell.

        The part and a positioner stay. The bodies on the floor move with the base.

        Args:
            moved: Displacement of the base in the work frame, with a positioner's axes at 0: a
                Frame, a 4 by 4 transform, a pinocchio.SE3 or a position [m].
        """
        frame = Frame.from_pose(moved)
        chain = self.chain.with_base_moved(frame)
        arm = self._with(chain, "closed_form")
        if chain.positioner is None or not self.knows_shapes:
            return arm
        base = self.chain.base
        seen = (base.inverse @ frame @ base).inverse
        return arm.with_shapes(partial(_seen_from_floor, self, chain.floor, seen))

    @checked
    def with_rail(self, rail: Rail) -> SerialArm:
        """Return the arm on a rail, which is its first joint.

        Args:
            rail: Direction, range and limits of the rail.
        """
        return self._with_first(self.chain.on_rail(rail), [rail])

    @checked
    def with_positioner(self, positioner: Positioner) -> SerialArm:
        """Return the arm with a positioner, whose axes are its first joints.

        The work frame is fixed to the table; the arm's work frame is that with the axes at 0.

        Args:
            positioner: The positioner.
        """
        return self._with_first(self.chain.on_positioner(positioner), positioner.axes[::-1])

    @checked
    def with_preferences(
        self, preferences: Mapping[str, JointPreference], *, prefer: Prefer | None = None
    ) -> SerialArm:
        """Return the arm with preferences for the motion of its joints.

        >>> from armcontour.robot import JointPreference
        >>> rail = ac.Rail(axis=(1.0, 0.0, 0.0), upper=3.0, velocity=1.0, acceleration=2.0)
        >>> arm = ac.load_arm("ur10e").with_rail(rail)
        >>> arm = arm.with_preferences({"rail": JointPreference(range=(0.5, 2.5))})
        >>> float(arm.limits.joint_upper[0])
        2.5

        Args:
            preferences: Preferences by the names of the joints, which are also those of a rail
                ("rail") and of the axes of a positioner. They replace earlier ones for the same
                joints, but a narrower range remains.
            prefer: What the planner prefers if a redundant arm can follow a path in several ways:
                "fastest" takes the shortest duration, "least motion" the least weighted motion of
                the joints. By default it takes the least motion among those that are almost as
                fast as the fastest one.

        Raises:
            InvalidInput: A joint does not exist, all joints are held, or a held position or a range
                is outside the joint's own range.
        """
        chain = apply_preferences(self.chain, self.limits, self.name, preferences, prefer)
        return self._copy(chain=chain, limits=narrow_ranges(self.limits, chain))

    def hold_still(self, q: FloatArray) -> SerialArm:
        """Return the arm whose still joints are held at their positions.

        Args:
            q: Positions of all joints [rad], (dof,).
        """
        still = self.chain.still
        return self.holding({k: float(q[k]) for k in still}) if still else self

    def holding(self, positions: Mapping[int, float]) -> SerialArm:
        """Return the arm with further joints held, and no joints that are still.

        Args:
            positions: Positions of the joints [rad], by index.
        """
        chain = self.chain.replace(held={**self.chain.held, **positions}, still=())
        return self._copy(chain=chain)

    def weighting(self, weights: FloatArray) -> SerialArm:
        """Return the arm with other weights of its joint motions.

        Args:
            weights: Positive weights, (dof,).
        """
        return self._copy(chain=self.chain.replace(weights=weights))

    def _with_first(self, chain: Chain, axes: Sequence[Rail | PositionerAxis]) -> SerialArm:
        """Return the arm with the chain that has external axes before its own joints."""
        changes = {}
        for limit in FIELDS:
            others = getattr(self.limits, limit)
            unlimited = -np.inf if limit == "joint_lower" else np.inf
            first = [getattr(x, x.fields[limit]) for x in axes]
            if others is None and first.count(None) == len(first):
                continue
            rest = np.full(self.dof, unlimited) if others is None else others
            values = np.array([unlimited if x is None else x for x in first], dtype=np.float64)
            values = np.column_stack([-values, values]) if rest.ndim == 2 else values
            changes[limit] = np.concatenate([values, rest])
        limits = self.limits.replace(**changes)
        assumed = self.assumed_limits
        if assumed is not None:
            names = [x for x in JOINT_VALUES if getattr(assumed, x) is not None]
            assumed = Limits(**{x: getattr(limits, x) for x in names})
        arm = self._with_chain(chain, limits, assumed)
        return arm.with_shapes(partial(_on_later_links, self, chain)) if self.knows_shapes else arm

    def without_held(self, released: Collection[int] = ()) -> SerialArm:
        """Return the arm for kinematics in which the held joints are rigid.

        Args:
            released: Indices of held joints that move in this arm.
        """
        held = {k: x for k, x in self.chain.held.items() if k not in released}
        moving = np.setdiff1d(np.arange(self.dof), list(held))
        limits = select_joints(self.limits, moving)
        return self._with_chain(self.chain.replace(held=held).without_held(), limits, None)

    @cached_property
    def from_floor(self) -> SerialArm:
        """The arm without the positioner, with its work frame on the floor, for kinematics."""
        rest = np.arange(self.chain.floor_link, self.dof)
        return self._with_chain(self.chain.arm_branch, select_joints(self.limits, rest), None)

    def pose(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return tool points [m], (n, 3), and tool orientations as rotation matrices, (n, 3, 3).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        poses = self.poses(q)
        return poses[..., 3].copy(), poses[..., :3].copy()

    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Return the points of base, joints, tip and tool [m], (n, dof + 3, 3).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        points = np.insert(super().links(q), [0, self.dof], 0.0, axis=-2)
        point, rotation = self.pose(q)
        points[..., 0, :] = self.chain.base.position
        points[..., -2, :] = point + rotation @ self.chain.tool.inverse.position
        return points

    def tool_twist(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Return the tool's twist: velocity [m/s] and angular velocity [rad/s], (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        return self._motion(q, dq)

    def tool_twist_rate(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Return the tool's acceleration [m/s²] and angular acceleration [rad/s²], (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        return self._motion(q, dq, ddq)[..., 6:]

    def _with_chain(self, chain: Chain, limits: Limits, assumed: Limits | None) -> SerialArm:
        """Return the arm with another chain and other limits, without shapes."""
        return SerialArm(
            name=self.name,
            chain=chain,
            limits=limits,
            source=self.source,
            limits_hint=self.limits_hint,
            notes=self.notes,
            assumed_limits=assumed,
            unused_limits=self.unused_limits,
        )

    def _with(self, chain: Chain, *cached: str) -> SerialArm:
        """Copy of the arm with another chain, with the cached values of some attributes."""
        arm = self._with_chain(chain, self.limits, self.assumed_limits)
        # The copy shares the shapes, even if they have not been read yet.
        cached = ("shapes", "_read_shapes", *cached)
        vars(arm).update({key: x for key, x in vars(self).items() if key in cached})
        return arm


def _seen_from_floor(arm: SerialArm, floor: Frame, seen: Frame) -> ArmShapes:
    """Return the shapes of an arm whose floor has moved against its positioner.

    - `floor`: the new frame of the floor in the frame of its link.
    - `seen`: the previous floor in the frame of the new one.
    """
    shapes = arm.shapes
    assert shapes is not None
    placed = []
    for shape in shapes.shapes:
        place = shape.place
        # The frames of the axes are parallel to the floor, and their origins do not move. Link 0 is
        # the table, whose frame is that of the floor with the axes at 0.
        if shape.link == 0:
            place = seen @ place
        elif shape.link < arm.chain.floor_link:
            place = Frame(rotation=seen.rotation) @ place
        elif shape.link == arm.chain.floor_link:
            place = floor @ arm.chain.floor.inverse @ place
        placed.append(replace(shape, place=place))
    return replace(shapes, shapes=tuple(placed))


def _on_later_links(arm: SerialArm, chain: Chain) -> ArmShapes:
    """Return the shapes of an arm for the chain with external axes before its joints."""
    shapes = arm.shapes
    first = len(chain) - arm.dof
    assert shapes is not None
    # The arm's base is at this position in the last link before its first joint: on a rail or,
    # with a positioner, on the floor.
    base = Frame(position=chain.positions[first] - arm.chain.positions[0])
    moved = [
        replace(x, link=x.link + first, place=x.place if x.link else base @ x.place)
        for x in shapes.shapes
    ]
    return replace(shapes, shapes=tuple(moved))
