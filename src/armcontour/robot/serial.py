"""Serial arms: the kinematics of a chain of any number of revolute joints."""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.fields import checked
from armcontour.core.frames import Frame, Pose, transforms
from armcontour.robot.arm import Arm
from armcontour.robot.chain import Chain, Payload, link_table
from armcontour.robot.limits import Limits

if TYPE_CHECKING:
    from armcontour.robot.closed_form import ClosedForm

# Joint axes are parallel if the sine of their angle is below this, which allows for rounding
# errors.
PARALLEL = 1e-9


class ChainArm(Arm):
    """An arm whose tool moves by a chain of joints: in space, or with x and y in the plane z = 0.

    Attributes:
        link_table: Table of the links for the compiled kinematics, (dof + 1, 12).
    """

    chain: Chain
    link_table: FloatArray

    def _describe(
        self, name: str, chain: Chain, limits: Limits, source: str, limits_hint: str
    ) -> None:
        """Check and store the attributes of all arms that have a chain."""
        self.name = checks.check_name("name of an arm", name)
        self.chain = chain
        self.joint_names = chain.joints
        self.limits = limits.for_joints(len(chain))
        self.source = source
        self.limits_hint = limits_hint
        self.link_table = link_table(chain)

    @cached_property
    def span(self) -> float:
        """Sum of the distances from joint to joint and from the last joint to the tool [m]."""
        end = self.chain.tip @ self.chain.tool
        parts = np.concatenate([self.chain.positions, end.position[None]])
        return float(np.linalg.norm(parts, axis=1).sum())

    @checked
    def forward(self, q: npt.ArrayLike) -> FloatArray:
        """Poses of the tool in the work frame as homogeneous transforms, (..., 4, 4).

        Poses of a planar arm are in the plane z = 0.

            arm = load_arm("ur5e")
            arm.forward(np.zeros(6))[:3, 3]  # the tool point [m]

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
        """Joint positions [rad], (dof,), at which the tool has a pose, within the joint ranges.

        The solution has a closed form for planar arms and most six-joint arms; else it is searched.

            q = arm.inverse(arm.forward(start), near=start)
            elbow_up_and_down = arm.inverse(Frame((0.4, 0.1, 0.3), flipped), all=True)

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
        # The import by name avoids a circular import, because the solvers import this module.
        solvers: Any = import_module("armcontour.robot.inverse")
        return np.asarray(solvers.solve(self, pose, near, every=all))

    @checked
    def jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Geometric Jacobian: twist of the tool per joint velocity, (..., 6, dof).

        The first three rows are the velocity of the tool point [m/rad], the last three the angular
        velocity [rad/rad], along the axes of the work frame (`LOCAL_WORLD_ALIGNED` in pinocchio).

            arm = load_arm("ur5e")
            twist = arm.jacobian(q) @ dq

        Args:
            q: Joint positions [rad], (..., dof).

        Raises:
            InvalidInput: The number of columns differs from the number of joints.
        """
        from armcontour.robot.kernels import jacobians

        leading, (rows,) = self._rows(q)
        return np.asarray(jacobians(self.link_table, rows).reshape(*leading, 6, self.dof))

    def tool_position(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points [m], (n, dimension); for a planar arm by eq. (1)-(2)."""
        return self.poses(q)[..., : self.dimension, 3].copy()

    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Points of all joints and of the tool, (n, dof + 1, dimension) [m]."""
        points = self._frames(q)[..., : self.dimension, 3].copy()
        points[..., -1, :] = self.tool_position(q)
        return points

    def tool_jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Tool velocity per joint velocity [m/rad], (n, dimension, dof)."""
        return self.jacobian(q)[..., : self.dimension, :]

    def tool_jacobian_rate(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Time derivative of `tool_jacobian` at the joint velocities `dq`, (n, dimension, dof)."""
        leading, (rows, rates) = self._rows(q, dq)
        frames = self._frames(rows)
        points, directions = frames[..., 3], frames[:, :-1, :, 2]
        angular = np.cumsum(directions * rates[..., None], axis=1)
        # Each link moves the origin of the next joint; the last link moves the tool.
        steps = _cross(angular, np.diff(points, axis=1))
        moving = np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)
        # A joint does not move its own axis, so the axis is constant in the frame of its link.
        turning = _cross(angular, directions)
        arms, opening = points[:, -1:] - points[:, :-1], moving[:, -1:] - moving[:, :-1]
        rate = _cross(turning, arms) + _cross(directions, opening)
        rate = np.swapaxes(rate, -1, -2)[:, : self.dimension]
        return rate.reshape(*leading, self.dimension, self.dof)

    def tool_velocity(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Tool velocity [m/s], eq. (22)."""
        return self._motion(q, dq)[..., : self.dimension]

    def tool_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Tool acceleration [m/s²]."""
        return self._motion(q, dq, ddq)[..., 6 : 6 + self.dimension]

    def tool_motion(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Tool velocity [m/s] and acceleration [m/s²] from one evaluation of the kinematics."""
        motion = self._motion(q, dq, ddq)
        return motion[..., : self.dimension], motion[..., 6 : 6 + self.dimension]

    def _motion(self, *states: npt.ArrayLike) -> FloatArray:
        """Pose of the tool, or its twist and the derivatives of the twist if dq, ... are given."""
        # Numba is imported at first use, because it loads slowly and many arms are only listed.
        from armcontour.robot.kernels import tool_motion

        leading, rows = self._rows(*states)
        # The kernel does not use derivatives above its order, so q is passed in their place.
        motion = tool_motion(self.link_table, len(rows) - 1, *(rows * 4)[:4])
        return np.asarray(motion.reshape(*leading, motion.shape[1]))

    def poses(self, q: npt.ArrayLike) -> FloatArray:
        """Rotations and positions of the tool in the work frame, (..., 3, 4).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        return self._motion(q).reshape(*np.shape(q)[:-1], 3, 4)

    def _frames(self, q: npt.ArrayLike) -> FloatArray:
        """Frames of all joints and of the tool in the work frame, (..., dof + 1, 3, 4)."""
        from armcontour.robot.kernels import frames_of

        leading, (rows,) = self._rows(q)
        return np.asarray(frames_of(self.link_table, rows).reshape(*leading, self.dof + 1, 3, 4))


class SerialArm(ChainArm):
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
    ) -> None:
        self._describe(name, chain, limits, source, limits_hint)
        self.notes = notes
        self.assumed_limits = assumed_limits

    @cached_property
    def closed_form(self) -> ClosedForm | None:
        """Closed-form inverse kinematics of the whole pose; None if it does not support the arm."""
        from armcontour.robot.closed_form import ClosedForm

        return ClosedForm.from_chain(self.chain)

    @cached_property
    def moves_in_a_plane(self) -> bool:
        """True if all joints are parallel, so that the tool stays in a plane."""
        # The columns of the angular part of the Jacobian are the joint axes.
        axes = self.jacobian(np.zeros(self.dof))[3:]
        return bool(np.linalg.matrix_rank(axes, tol=PARALLEL) < 2)

    @checked
    def with_tool(self, tool: Pose, payload: Payload | None = None) -> SerialArm:
        """A copy of the arm with another tool.

        Args:
            tool: Tool frame in the frame of the tip: a Frame, a 4 by 4 transform, a pinocchio.SE3
                or a position [m]. Its origin follows paths; its z axis is the tool axis.
            payload: Load at the tip; by default the load of this arm.
        """
        carried = self.chain.payload if payload is None else payload
        return self._with(self.chain.replace(tool=Frame.from_pose(tool), payload=carried))

    @checked
    def with_work(self, work: Pose) -> SerialArm:
        """A copy of the arm with its tool points in another work frame.

        Args:
            work: Work frame of the paths in the frame of the base, in one of the forms of `tool`.
        """
        return self._with(self.chain.replace(base=Frame.from_pose(work).inverse), "closed_form")

    def pose(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Tool points [m], (n, 3), and tool orientations as rotation matrices, (n, 3, 3).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        poses = self.poses(q)
        return poses[..., 3].copy(), poses[..., :3].copy()

    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Points of the base, all joints, the tip and the tool, (n, dof + 3, 3) [m]."""
        points = np.insert(super().links(q), [0, self.dof], 0.0, axis=-2)
        point, rotation = self.pose(q)
        points[..., 0, :] = self.chain.base.position
        points[..., -2, :] = point + rotation @ self.chain.tool.inverse.position
        return points

    def tool_twist(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Twist of the tool: velocity [m/s] and angular velocity [rad/s], (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        return self._motion(q, dq)

    def tool_twist_rate(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Acceleration [m/s²] and angular acceleration [rad/s²] of the tool, (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        return self._motion(q, dq, ddq)[..., 6:]

    def _with(self, chain: Chain, *cached: str) -> SerialArm:
        """Copy of the arm with another chain, with the cached values of some attributes."""
        arm = SerialArm(
            name=self.name,
            chain=chain,
            limits=self.limits,
            source=self.source,
            limits_hint=self.limits_hint,
            notes=self.notes,
        )
        # The copy shares the shapes, even if they have not been read yet.
        cached = ("shapes", "_read_shapes", *cached)
        vars(arm).update({key: x for key, x in vars(self).items() if key in cached})
        return arm


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector products, (..., 3), five times as fast as `np.cross` for few vectors."""
    products = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return products
