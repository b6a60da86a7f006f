"""Serial arms in space: turning joints in a row, of any number and in any place."""

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

# Rotations, positions and axes of the chain; base and end as (3, 4).
Arrays = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


class SerialArm(Arm):
    """An arm in space; tool points and everything about the tool are in the work frame.

    Methods take states of any leading shape. A twist is the tool's velocity [m/s] above its angular
    velocity [rad/s], (n, 6), along the axes of the work frame.

    Args:
        name: For people.
        chain: Its joints and links.
        limits: The arm's own limits.
        source: Where the numbers come from.
        limits_hint: What would give the arm the limits that it lacks, for messages.

    Attributes:
        arrays: The chain as the compiled kinematics take it: its rotations, positions and axes;
            base and end (the tool in the frame of the last link) as rotation and position, (3, 4).
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
    ) -> None:
        self.name = name
        self.chain: Chain = chain
        self.joint_names = chain.joints
        self.limits = limits.for_joints(len(chain))
        self.source = source
        self.limits_hint = limits_hint
        self.arrays: Arrays = (
            chain.rotations,
            chain.positions,
            chain.axes,
            _stack(chain.base),
            _stack(chain.tip @ chain.tool),
        )

    def with_tool(self, tool: Frame, payload: Payload | None = None) -> SerialArm:
        """The same arm with another tool, given in the frame of the tip.

        Args:
            tool: Its origin follows paths, and its z axis is the tool axis.
            payload: What the tip carries; by default what it carried before.
        """
        carried = self.chain.payload if payload is None else payload
        return self._with(self.chain.replace(tool=tool, payload=carried))

    def with_work(self, work: Frame) -> SerialArm:
        """The same arm with its tool points in another frame, given in that of the base.

        Args:
            work: Frame of the path, in the frame of the base.
        """
        return self._with(self.chain.replace(base=work.inverse))

    def forward(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points [m]."""
        return self.pose(q)[0]

    def pose(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Tool points [m], (n, 3), and tool frames as rotation matrices, (n, 3, 3).

        Args:
            q: Joint positions [rad], (..., dof).
        """
        leading, (rows,) = self._rows(q)
        found = self._places(rows)[0].reshape(*leading, 3, 4)
        return found[..., 3].copy(), found[..., :3].copy()

    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Base, every joint, tip and tool, (n, dof + 3, 3)."""
        leading, (rows,) = self._rows(q)
        tools, origins, _ = self._places(rows)
        base = np.broadcast_to(self.chain.base.position, (len(rows), 1, 3))
        back = self.chain.tool.inverse.position
        ends = np.stack([tools[..., 3] + tools[..., :3] @ back, tools[..., 3]], axis=1)
        found = np.concatenate([base, origins, ends], axis=1)
        return found.reshape(*leading, self.dof + 3, 3)

    def twist_jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Twist per joint velocity, (n, 6, dof).

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
        """Time derivative of the Jacobian when the joints move at `dq`, (n, 3, dof)."""
        leading, (rows, rates) = self._rows(q, dq)
        pose, origins, directions = self._places(rows)
        points = np.concatenate([origins, pose[:, None, :, 3]], axis=1)
        angular = np.cumsum(directions * rates[..., None], axis=1)
        # Links carry the next joint's origin, and at the end the tool.
        steps = np.cross(angular, np.diff(points, axis=1))
        moving = np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)
        # An axis turns with its own link, as its own joint does not move it.
        turning = np.cross(angular, directions)
        arms, opening = points[:, -1:] - origins, moving[:, -1:] - moving[:, :-1]
        found = np.cross(turning, arms) + np.cross(directions, opening)
        return np.swapaxes(found, -1, -2).reshape(*leading, 3, self.dof)

    def twist_drift(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """`dJ/dt dq`: acceleration and angular acceleration of the tool at ddq = 0, (n, 6).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        leading, (rows, rates) = self._rows(q, dq)
        pose, origins, directions = self._places(rows)
        found = _kernels().drifts(origins, directions, pose, rates)
        return np.asarray(found.reshape(*leading, 6))

    def tool_twist(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Velocity and angular velocity of the tool, (n, 6).

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
        """Acceleration and angular acceleration of the tool, (n, 6).

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
        """Tool velocity (22) [m/s]."""
        return self.tool_twist(q, dq)[..., :3]

    def tool_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Tool acceleration [m/s²]."""
        return self.tool_twist_rate(q, dq, ddq)[..., :3]

    def tool_motion(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Tool velocity [m/s] and acceleration [m/s²], from the same places of the joints."""
        leading, (rows, rates, seconds) = self._rows(q, dq, ddq)
        pose, origins, directions = self._places(rows)
        kernels = _kernels()
        velocity = kernels.twists(origins, directions, pose, rates)
        drift = kernels.drifts(origins, directions, pose, rates)
        acceleration = drift + kernels.twists(origins, directions, pose, seconds)
        first, second = (x[:, :3].reshape(*leading, 3) for x in (velocity, acceleration))
        return first, second

    def _with(self, chain: Chain) -> SerialArm:
        return SerialArm(
            name=self.name,
            chain=chain,
            limits=self.limits,
            source=self.source,
            limits_hint=self.limits_hint,
        )

    def _places(self, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Tool poses, (n, 3, 4), and a point and the direction of every joint's axis."""
        tools, origins, directions = _kernels().poses(*self.arrays, rows)
        return tools, origins, directions

    def _rows(self, *states: npt.ArrayLike) -> tuple[tuple[int, ...], list[FloatArray]]:
        """Leading shape and rows of states, checked: compiled code would read past a short row."""
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
        # Fresh copies: locked arrays would have the kernels compiled once more.
        rows = [
            np.array(np.broadcast_to(x, shape), order="C").reshape(-1, self.dof) for x in arrays
        ]
        return shape[:-1], rows


def _kernels() -> Any:
    # At first use: numba is heavy, and an arm is also loaded to be listed or checked.
    from armcontour.arms import _chain

    return _chain


def _stack(frame: Frame) -> FloatArray:
    return _checks.lock_floats(np.column_stack([frame.rotation, frame.position]))
