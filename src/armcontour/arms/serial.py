"""Serial arms in space: the kinematics of a chain of any number of revolute joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms.arm import Arm
from armcontour.arms.chain import Chain, Payload
from armcontour.arms.limits import Limits
from armcontour.errors import InvalidInput
from armcontour.frames import Frame

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
        self.name = name
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

    def with_tool(self, tool: Frame, payload: Payload | None = None) -> SerialArm:
        """A copy of the arm with another tool.

        Args:
            tool: Tool frame in the frame of the tip. Its origin follows paths; its z axis is the
                tool axis.
            payload: Load at the tip; by default the load of this arm.
        """
        carried = self.chain.payload if payload is None else payload
        return self._with(self.chain.replace(tool=tool, payload=carried))

    def with_work(self, work: Frame) -> SerialArm:
        """A copy of the arm with its tool points in another work frame.

        Args:
            work: Work frame of the paths, in the frame of the base.
        """
        return self._with(self.chain.replace(base=work.inverse))

    def forward(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points [m], (n, 3)."""
        return self.pose(q)[0]

    def pose(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Tool points [m], (n, 3), and tool orientations as rotation matrices, (n, 3, 3).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        leading, (rows,) = self._rows(q)
        found = self._places(rows)[0].reshape(*leading, 3, 4)
        return found[..., 3].copy(), found[..., :3].copy()

    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Points of the base, all joints, the tip and the tool, (n, dof + 3, 3) [m]."""
        leading, (rows,) = self._rows(q)
        tools, origins, _ = self._places(rows)
        base = np.broadcast_to(self.chain.base.position, (len(rows), 1, 3))
        back = self.chain.tool.inverse.position
        ends = np.stack([tools[..., 3] + tools[..., :3] @ back, tools[..., 3]], axis=1)
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
        leading, (rows, rates) = self._rows(q, dq)
        pose, origins, directions = self._places(rows)
        found = _kernels().drifts(origins, directions, pose, rates)
        return np.asarray(found.reshape(*leading, 6))

    def tool_twist(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Twist of the tool: velocity [m/s] and angular velocity [rad/s], (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        leading, (rows, rates) = self._rows(q, dq)
        pose, origins, directions = self._places(rows)
        found = _kernels().twists(origins, directions, pose, rates)
        return np.asarray(found.reshape(*leading, 6))

    def tool_twist_rate(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Acceleration [m/s²] and angular acceleration [rad/s²] of the tool, (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        leading, (rows, rates, seconds) = self._rows(q, dq, ddq)
        pose, origins, directions = self._places(rows)
        drift = _kernels().drifts(origins, directions, pose, rates)
        found = drift + _kernels().twists(origins, directions, pose, seconds)
        return np.asarray(found.reshape(*leading, 6))

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
        leading, (rows, *rates) = self._rows(q, dq, ddq, dddq)
        pose, origins, directions = self._places(rows)
        found = _kernels().jerks(origins, directions, pose, *rates)
        return np.asarray(found.reshape(*leading, 3))

    def tool_motion(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Tool velocity [m/s] and acceleration [m/s²] from one evaluation of the kinematics."""
        leading, (rows, rates, seconds) = self._rows(q, dq, ddq)
        pose, origins, directions = self._places(rows)
        kernels = _kernels()
        velocity = kernels.twists(origins, directions, pose, rates)
        drift = kernels.drifts(origins, directions, pose, rates)
        acceleration = drift + kernels.twists(origins, directions, pose, seconds)
        first, second = (x[:, :3].reshape(*leading, 3) for x in (velocity, acceleration))
        return first, second

    def _with(self, chain: Chain) -> SerialArm:
        """A copy of the arm with another chain."""
        return SerialArm(
            name=self.name,
            chain=chain,
            limits=self.limits,
            source=self.source,
            limits_hint=self.limits_hint,
            notes=self.notes,
        )

    def _places(self, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Tool poses, (n, 3, 4), and origins and axes of all joints, (n, dof, 3) each."""
        tools, origins, directions = _kernels().poses(*self.arrays, rows)
        return tools, origins, directions

    def _rows(self, *states: npt.ArrayLike) -> tuple[tuple[int, ...], list[FloatArray]]:
        """Leading shape and rows of the given states, (rows, dof) each.

        The shapes are checked because compiled code would read past the end of a short row.

        Raises:
            InvalidInput: The number of columns is wrong or the shapes do not fit together.
        """
        arrays = [np.asarray(x, dtype=np.float64) for x in states]
        seen = ", ".join(str(x.shape) for x in arrays)
        if any(x.shape[-1:] != (self.dof,) for x in arrays):
            raise InvalidInput(
                f"The arm {self.name} has {self.dof} joints, so its states must be arrays with "
                f"{self.dof} columns, not {seen}."
            )
        try:
            shape = np.broadcast_shapes(*(x.shape for x in arrays))
        except ValueError:
            raise InvalidInput(f"States must have shapes that fit together, not {seen}.") from None
        # Copies, because numba would compile the kernels a second time for read-only arrays.
        rows = [
            np.array(np.broadcast_to(x, shape), order="C").reshape(-1, self.dof) for x in arrays
        ]
        return shape[:-1], rows


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
