"""Inverse kinematics of control points close to a known joint path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import Unreachable
from armcontour.geometry import Path
from armcontour.planning.tracing.knots import task_dimension
from armcontour.robot import Arm, PlanarTwoLink, SerialArm


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearPath:
    """Inverse kinematics at n points near a joint path."""

    arm: Arm
    configuration: str | None  # For an arm in the plane, the branch of its inverse kinematics
    q: FloatArray  # Joint positions at the points on the joint path [rad], (n, dof)
    # Tool poses at the points, (n, 3, 4); `solve` replaces their positions. None in the plane.
    poses: FloatArray | None = None
    task: int = 2  # Number of prescribed degrees of freedom of the tool
    # Null-space rows w of a redundant arm, (n, dof - task, dof); solutions have the same `w q` as
    # the joint path.
    free: FloatArray | None = None

    @classmethod
    def along(
        cls, q: FloatArray, arm: Arm, configuration: str | None, path: Path, s: FloatArray
    ) -> NearPath:
        """Prepare inverse kinematics near joint positions q [rad], (n, dof), at s of a path [m]."""
        if isinstance(arm, PlanarTwoLink):
            return cls(arm=arm, configuration=configuration, q=q)
        assert isinstance(arm, SerialArm)
        poses = np.zeros((len(s), 3, 4))
        poses[:, :, 3] = arm.tool_position(q)
        poses[:, :, :3] = np.eye(3) if path.orientation is None else path.orientation(s)
        task = task_dimension(path, arm)
        free = np.zeros((len(s), 0, arm.dof))
        if task < arm.dof:
            from armcontour.planning.tracing.redundancy import null_space

            free = null_space(arm, poses, task, q)
        return cls(arm=arm, configuration=configuration, q=q, poses=poses, task=task, free=free)

    def solve(self, points: FloatArray, guess: FloatArray) -> FloatArray:
        """Joint positions with the tool at `points` [m], near a guess [rad], (n, dof)."""
        if isinstance(self.arm, PlanarTwoLink):
            q = self.arm.joint_position(points, self.configuration)
            return np.asarray(q + 2 * np.pi * np.round((guess - q) / (2 * np.pi)))
        assert isinstance(self.arm, SerialArm) and self.poses is not None
        assert self.free is not None
        from armcontour.robot import newton

        poses = np.array(self.poses)
        poses[:, :, 3] = points
        q = np.array(guess, order="C")
        solved = newton.newton(
            self.arm.link_table, self.task, q, poses, self.free[:, None], self.q[:, None]
        )
        if not solved.all():
            i = int(np.argmin(solved))
            raise Unreachable("A control point is out of reach.", point=points[i].tolist())
        return q

    def steps(self, q: FloatArray, frames: FloatArray) -> FloatArray:
        """Derivatives of q for offsets along the columns of `frames` [rad/m], (n, dof, k)."""
        if self.poses is None:
            return np.asarray(np.linalg.solve(self.arm.tool_jacobian(q), frames))
        assert isinstance(self.arm, SerialArm) and self.free is not None
        n, dof, k = len(q), self.arm.dof, frames.shape[2]
        full = self.arm.jacobian(q)
        matrix = np.empty((n, dof, dof))
        matrix[:, :3] = full[:, :3]
        if self.task == 6:
            matrix[:, 3:6] = full[:, 3:]
        elif self.task == 5:
            axes = self.poses[:, :, :2]
            matrix[:, 3:5] = np.einsum("nij,nik->njk", axes, full[:, 3:])
        matrix[:, self.task :] = self.free
        right = np.zeros((n, dof, k))
        right[:, :3] = frames
        return np.asarray(np.linalg.solve(matrix, right))
