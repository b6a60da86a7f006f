"""Serial arms in space: the kinematics of a chain of any number of revolute joints."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms.arm import Arm
from armcontour.arms.chain import Chain, Payload, joint_frames
from armcontour.arms.limits import Limits
from armcontour.frames import Frame

# Joint axes are parallel if the sine of their angle is below this, for rounding errors.
PARALLEL = 1e-9
# Rotations, positions and axes of the joints; base and end frame as (3, 4).
Arrays = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


class SerialArm(Arm):
    """A serial arm in space.

    All positions, velocities and orientations of the tool are in the work frame. Methods take
    states of any leading shape. A twist is the tool's velocity [m/s] followed by its angular
    velocity [rad/s], (n, 6), along the axes of the work frame.

    Args:
        name: Name of the arm, for messages and reports.
        chain: Joints and links of the arm.
        limits: Limits of the arm's joints and tool.
        source: Where the data of the arm come from.
        limits_hint: What the user can do to add the limits that the arm lacks, for messages.
        notes: Sentences on what was left out or chosen when the arm was read.

    Attributes:
        arrays: The chain as arrays for the compiled kinematics: rotations, positions and axes of
            the joints; the base in the work frame and the tool in the frame of the last link, each
            as rotation and position, (3, 4).
    """

    dimension = 3
    branches = ()

    def __init__(
        self,
        *,
        name: str,
        chain: Chain,
        limits: Limits,
        source: str = "",
        limits_hint: str = "",
        notes: tuple[str, ...] = (),
    ) -> None:
        _checks.refuse_other("A SerialArm", chain, Chain)
        _checks.refuse_other("A SerialArm", limits, Limits, "such as Limits(joint_velocity=1.0)")
        self.name = _checks.check_name("name of an arm", name)
        self.chain: Chain = chain
        self.joint_names = chain.joints
        self.limits = limits.for_joints(len(chain))
        self.source = source
        self.limits_hint = limits_hint
        self.notes = notes
        self.arrays: Arrays = (
            chain.rotations,
            chain.positions,
            chain.axes,
            _stack(chain.base),
            _stack(chain.tip @ chain.tool),
        )
        self._links = _links(chain)

    @cached_property
    def moves_in_a_plane(self) -> bool:
        """Whether all joints are parallel, so that the tool stays in a plane."""
        # The rows of the angular velocity are the axes of the joints.
        axes = self.twist_jacobian(np.zeros(self.dof))[3:]
        return bool(np.linalg.matrix_rank(axes, tol=PARALLEL) < 2)

    @cached_property
    def span(self) -> float:
        """Distances from joint to joint, and on to the tool, together [m]."""
        *_, end = self.arrays
        parts = np.concatenate([self.chain.positions, end[None, :, 3]])
        return float(np.linalg.norm(parts, axis=1).sum())

    def with_tool(self, tool: Frame, payload: Payload | None = None) -> SerialArm:
        """A copy of the arm with another tool.

        Args:
            tool: Tool frame in the frame of the tip. Its origin follows paths; its z axis is the
                tool axis.
            payload: Load at the tip; by default the load of this arm.
        """
        _checks.refuse_other("with_tool", tool, Frame, "such as Frame(position=(0, 0, 0.1))")
        if payload is not None:
            _checks.refuse_other("with_tool", payload, Payload, "such as Payload(mass=2.0)")
        carried = self.chain.payload if payload is None else payload
        return self._with(self.chain.replace(tool=tool, payload=carried))

    def with_work(self, work: Frame) -> SerialArm:
        """A copy of the arm with its tool points in another work frame.

        Args:
            work: Work frame of the paths, in the frame of the base.
        """
        _checks.refuse_other("with_work", work, Frame, "such as Frame(position=(0.4, 0, 0))")
        return self._with(self.chain.replace(base=work.inverse))

    def forward(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points [m], (n, 3)."""
        leading, states = self._rows(q)
        return self._motion(0, states)[0].reshape(*leading, 3, 4)[..., 3].copy()

    def pose(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Tool points [m], (n, 3), and tool orientations as rotation matrices, (n, 3, 3).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        leading, states = self._rows(q)
        found = self._motion(0, states)[0].reshape(*leading, 3, 4)
        return found[..., 3].copy(), found[..., :3].copy()

    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Points of the base, all joints, the tip and the tool, (n, dof + 3, 3) [m]."""
        leading, (rows,) = self._rows(q)
        _, origins, _ = self._places(rows)
        tool, rotation = self.pose(rows)
        base = np.broadcast_to(self.chain.base.position, (len(rows), 1, 3))
        back = self.chain.tool.inverse.position
        ends = np.stack([tool + rotation @ back, tool], axis=1)
        found = np.concatenate([base, origins, ends], axis=1)
        return found.reshape(*leading, self.dof + 3, 3)

    def twist_jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """The geometric Jacobian: twist of the tool per joint velocity, (n, 6, dof).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        leading, (rows,) = self._rows(q)
        pose, origins, directions = self._places(rows)
        found = _kernels().jacobians(origins, directions, pose)
        return np.asarray(found.reshape(*leading, 6, self.dof))

    def jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Tool velocity per joint velocity [m/rad], (n, 3, dof)."""
        return self.twist_jacobian(q)[..., :3, :]

    def jacobian_rate(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Time derivative of the Jacobian at the joint velocities `dq`, (n, 3, dof)."""
        leading, (rows, rates) = self._rows(q, dq)
        pose, origins, directions = self._places(rows)
        points = np.concatenate([origins, pose[:, None, :, 3]], axis=1)
        angular = np.cumsum(directions * rates[..., None], axis=1)
        # Each link moves the origin of the next joint; the last link moves the tool.
        steps = np.cross(angular, np.diff(points, axis=1))
        moving = np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)
        # A joint does not move its own axis, so the axis may be taken as fixed in its own link.
        turning = np.cross(angular, directions)
        arms, opening = points[:, -1:] - origins, moving[:, -1:] - moving[:, :-1]
        found = np.cross(turning, arms) + np.cross(directions, opening)
        return np.swapaxes(found, -1, -2).reshape(*leading, 3, self.dof)

    def twist_drift(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Bias acceleration `dJ/dt dq` of the tool: its twist rate at ddq = 0, (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        return self.tool_twist_rate(q, dq, np.zeros(np.shape(q)))

    def tool_twist(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Twist of the tool: velocity [m/s] and angular velocity [rad/s], (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        leading, states = self._rows(q, dq)
        return self._motion(1, states)[1].reshape(*leading, 6)

    def tool_twist_rate(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Acceleration [m/s²] and angular acceleration [rad/s²] of the tool, (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        leading, states = self._rows(q, dq, ddq)
        return self._motion(2, states)[1][:, 6:].reshape(*leading, 6)

    def tool_velocity(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Tool velocity [m/s], eq. (22)."""
        return self.tool_twist(q, dq)[..., :3]

    def tool_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Tool acceleration [m/s²]."""
        return self.tool_twist_rate(q, dq, ddq)[..., :3]

    def tool_jerk(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, dddq: npt.ArrayLike
    ) -> FloatArray:
        """Tool jerk [m/s³], (..., 3), from link to link; arguments as of every arm."""
        leading, states = self._rows(q, dq, ddq, dddq)
        return self._motion(3, states)[1][:, 12:15].reshape(*leading, 3)

    def tool_motion(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Tool velocity [m/s] and acceleration [m/s²] from one evaluation of the kinematics."""
        leading, states = self._rows(q, dq, ddq)
        _, found = self._motion(2, states)
        return found[:, :3].reshape(*leading, 3), found[:, 6:9].reshape(*leading, 3)

    def _with(self, chain: Chain) -> SerialArm:
        """A copy of the arm with another chain."""
        found = SerialArm(
            name=self.name,
            chain=chain,
            limits=self.limits,
            source=self.source,
            limits_hint=self.limits_hint,
            notes=self.notes,
        )
        # Shapes are those of this arm, read or not.
        kept = {key: x for key, x in vars(self).items() if key in ("shapes", "_read_shapes")}
        vars(found).update(kept)
        return found

    def _motion(self, order: int, states: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Tool poses, or the derivatives up to an order; as the compiled `tool_motion` has them."""
        from armcontour.arms._tool_motion import tool_motion

        # Derivatives above the order are not read.
        q, first, second, third = (states * 4)[:4]
        poses, found = tool_motion(self._links, order, q, first, second, third)
        return poses, found

    def _places(self, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Tool poses, (n, 3, 4), and origins and axes of all joints, (n, dof, 3) each."""
        tools, origins, directions = _kernels().poses(*self.arrays, rows)
        return tools, origins, directions


def _kernels() -> Any:
    """The module of compiled kinematics.

    The module is imported at first use: numba loads slowly, and an arm is also loaded only to be
    listed or checked.
    """
    from armcontour.arms import _chain

    return _chain


def _stack(frame: Frame) -> FloatArray:
    """Rotation and position of a frame side by side, (3, 4)."""
    return _checks.lock_floats(np.column_stack([frame.rotation, frame.position]))


def _links(chain: Chain) -> FloatArray:
    """Frames of all joints and of the tool, each in the one before, as `tool_motion` takes them."""
    found = np.empty((len(chain) + 1, 12))
    end = chain.tip @ chain.tool
    turns = [*joint_frames(chain), np.eye(3)]
    rotations = [*chain.rotations, end.rotation]
    positions = [*chain.positions, end.position]
    before, place = chain.base.rotation, chain.base.position
    for own, rotation, position, turn in zip(found, rotations, positions, turns, strict=True):
        own[:9] = (before @ rotation @ turn).ravel()
        own[9:] = place + before @ position
        before, place = turn.T, np.zeros(3)
    return found
