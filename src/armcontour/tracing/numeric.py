"""Tracing on an arm in space, by Newton's method and exact derivatives."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm, _newton
from armcontour.errors import Unreachable
from armcontour.geometry import Path
from armcontour.tracing.configurations import Solution
from armcontour.tracing.knots import Knots
from armcontour.tracing.poses import (
    poses_at,
    rates_at,
    row_of_poses,
    turning_too_fast,
    what_helps,
)
from armcontour.tracing.redundancy import Guide, null_space
from armcontour.tracing.solver import Ends, Solver

# The tool may be turned from its orientation by this much between knots [rad].
ANGULAR_TOLERANCE = 1e-9
# A place is singular where elimination finds a pivot this small against the largest.
SINGULAR = 1e-9


class Numeric(Solver[SerialArm]):
    """Exact knots by Newton's method, from guesses next to them.

    Args:
        path: The path.
        arm: The arm.
        task: How much of each pose counts: 6, 5 or 3.
        knots: The first knots.
        way: Joint positions at them.
        tolerance: Largest distance of the tool from the path between knots [m].
    """

    def __init__(
        self,
        path: Path,
        arm: SerialArm,
        task: int,
        knots: Knots,
        way: Solution,
        tolerance: float,
    ) -> None:
        super().__init__(path, arm)
        self.task, self.tolerance = task, tolerance
        self._way = way
        self._guide: Guide | None = None
        if task < arm.dof:
            w = null_space(arm, row_of_poses(path, knots), task, way.q)
            s = np.append(knots.s0, path.length)
            self._guide = Guide.through(s, way.q, w, path.stops)

    def ends(
        self, knots: Knots, u: FloatArray, guess: FloatArray | None, *, at_end: bool = False
    ) -> Ends:
        """q, dq_ds and d2q_ds2 at places `u` on the knots' segments.

        Raises:
            Unreachable: A singular place, with its arc length.
        """
        if guess is None:
            guess = self._way.q[1:] if at_end else self._way.q[:-1]
        poses = poses_at(self.path, knots, u)
        w, g = self._rows(knots, u)
        q = np.array(guess, order="C")
        found, _ = _newton.newton(
            *self.arm.arrays,
            q,
            poses,
            self.task,
            np.ascontiguousarray(w[:, 0]),
            np.ascontiguousarray(g[:, 0]),
        )
        first, second, apart = _newton.path_derivatives(
            *self.arm.arrays, q, poses, rates_at(self.path, knots, u), self.task, w, g
        )
        bad = ~(found & (apart > SINGULAR) & np.isfinite(second).all(axis=1))
        if bad.any():
            self._refuse(knots, u, int(np.argmax(bad)))
        return q, first, second

    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """How far the tool is from its pose, in tolerances."""
        target = poses_at(self.path, knots, u)
        points, turned = self.arm.pose(q)
        off = np.linalg.norm(points - target[:, :, 3], axis=1) / self.tolerance
        if self.task == 3:
            return np.asarray(off)
        if self.task == 5:
            angle = np.linalg.norm(turned[:, :, 2] - target[:, :, 2], axis=1)
        else:
            angle = np.linalg.norm(turned - target[:, :, :3], axis=(1, 2)) / np.sqrt(2)
        return np.asarray(np.maximum(off, angle / ANGULAR_TOLERANCE))

    def _rows(self, knots: Knots, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The guide's rows, (n, 3, free, dof), and its joint positions, (n, 3, dof)."""
        n, dof = len(u), self.arm.dof
        if self._guide is None:
            return np.zeros((n, 3, 0, dof)), np.zeros((n, 3, dof))
        w, g = self._guide.at(knots.at(u), knots.at((knots.u0 + knots.u1) / 2))
        return np.ascontiguousarray(w), np.ascontiguousarray(g)

    def _refuse(self, knots: Knots, u: FloatArray, i: int) -> None:
        s = float(knots.at(u)[i])
        point = self.path(s).tolist()
        raise Unreachable(
            turning_too_fast(self.path, s)
            or f"At {s:.6g} m of {self.path.length:.6g} m along the path, at "
            f"{tuple(round(x, 6) for x in point)} m, the arm {self.arm.name} is singular: "
            f"{what_helps(self.path)}.",
            point=point,
            s=s,
            limit="singularity",
        )
