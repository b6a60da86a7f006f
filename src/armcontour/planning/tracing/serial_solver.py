"""Inverse kinematics of serial arms along a path, by Newton's method at knots."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import Path
from armcontour.planning.tracing.knots import Knots, motion_at, poses_at
from armcontour.planning.tracing.redundancy import Guide
from armcontour.planning.tracing.solver import Ends, Solver, refuse_singular_pose
from armcontour.robot import SerialArm, newton

# Largest angle between the tool and its required orientation between knots [rad].
ANGULAR_TOLERANCE = 1e-9
# Ratio of pivots in elimination below which the Jacobian is singular.
SINGULAR = 1e-9


class NumericSolver(Solver[SerialArm]):
    """Exact joint positions and derivatives at knots, by Newton's method from nearby guesses."""

    def __init__(
        self,
        path: Path,
        arm: SerialArm,
        task: int,  # Task dimension: 6, 5 or 3, see `task_dimension`
        tolerance: float,  # Largest distance of the tool from the path between knots [m]
        guide: Guide | None,  # Guide of a redundant arm
    ) -> None:
        super().__init__(path, arm)
        self.task, self.tolerance, self._guide = task, tolerance, guide

    def ends(self, knots: Knots, u: FloatArray, guess: FloatArray | None) -> Ends:
        """q, dq_ds and d2q_ds2 at distances `u` [m] along the segments, (n, dof) each."""
        q, (poses, rates) = np.array(guess, order="C"), motion_at(self.path, knots, u)
        w, g = self._rows(knots, u)
        links = self.arm.link_table
        solved = newton.newton(links, self.task, q, poses, w, g)
        dq_ds, d2q_ds2, pivot_ratio = newton.path_derivatives(
            links, self.task, q, poses, rates, w, g
        )
        bad = ~(solved & (pivot_ratio > SINGULAR) & np.isfinite(d2q_ds2).all(axis=1))
        if bad.any():
            refuse_singular_pose(self, float(knots.arc_lengths(u)[np.argmax(bad)]), "is singular")
        return q, dq_ds, d2q_ds2

    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """Largest ratio of the tool's position and orientation errors to their tolerances, (n,)."""
        difference = self.arm.poses(q) - poses_at(self.path, knots, u)
        error: FloatArray = np.linalg.norm(difference[:, :, 3], axis=1) / self.tolerance
        if self.task == 3:
            return error
        turned = difference[:, :, 2]
        if self.task == 6:
            turned = difference[:, :, :3].reshape(-1, 9) / np.sqrt(2.0)
        return np.asarray(np.maximum(error, np.linalg.norm(turned, axis=1) / ANGULAR_TOLERANCE))

    def _rows(self, knots: Knots, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Null-space rows w, (n, 3, free, dof), and guide positions g, (n, 3, dof)."""
        # The second axis is the order of the derivative along s, see `redundancy`.
        n, dof = len(u), self.arm.dof
        if self._guide is None:
            return np.zeros((n, 3, 0, dof)), np.zeros((n, 3, dof))
        return self._guide.evaluate(
            knots.arc_lengths(u), knots.arc_lengths((knots.u0 + knots.u1) / 2)
        )
