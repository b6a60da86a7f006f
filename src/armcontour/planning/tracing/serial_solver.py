"""Inverse kinematics of serial arms along a path, by Newton's method at knots."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import Path
from armcontour.planning.tracing.configurations import Solution
from armcontour.planning.tracing.knots import (
    MIDDLE,
    FirstPoses,
    Knots,
    motion_at,
    poses_at,
    tool_errors,
)
from armcontour.planning.tracing.redundancy import Guide, null_space
from armcontour.planning.tracing.solver import (
    Ends,
    Solver,
    largest_errors,
    quintics_at_places,
    refuse_singular_pose,
)
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
        first: FirstPoses,  # Required motion at the first knots
        solution: Solution,  # Joint positions at the first knots
        tolerance: float,  # Largest distance of the tool from the path between knots [m]
    ) -> None:
        super().__init__(path, arm)
        self.task, self.tolerance = task, tolerance
        self._solution, self._first = solution, first
        self._guide: Guide | None = None
        if task < arm.dof:
            w = null_space(arm, first.row, task, solution.q)
            s = np.append(first.knots.s0, path.length)
            self._guide = Guide.through(s, solution.q, w, first.stops)

    def first_ends(self, knots: Knots) -> tuple[Ends, Ends]:
        """Same as `Solver.first_ends`; an end that is also a start is computed once."""
        first, q = self._first, self._solution.q
        alone = first.ends >= len(knots)
        guess = np.concatenate([q[:-1], q[1:][alone]])
        columns = self._solve(first.places, first.u, guess, first.poses, first.rates)
        q, dq_ds, d2q_ds2 = (x[: len(knots)] for x in columns)
        end_q, end_dq_ds, end_d2q_ds2 = (x[first.ends] for x in columns)
        return (q, dq_ds, d2q_ds2), (end_q, end_dq_ds, end_d2q_ds2)

    def ends(self, knots: Knots, u: FloatArray, guess: FloatArray | None) -> Ends:
        """q, dq_ds and d2q_ds2 at distances `u` [m] along the segments, (n, dof) each."""
        assert guess is not None
        return self._solve(knots, u, np.array(guess, order="C"), *motion_at(self.path, knots, u))

    def _solve(
        self, knots: Knots, u: FloatArray, q: FloatArray, poses: FloatArray, rates: FloatArray
    ) -> Ends:
        """Same as `ends`, for tool poses and their derivatives; the guesses q are overwritten."""
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

    def errors_between(self, knots: Knots, start: Ends, end: Ends) -> tuple[FloatArray, FloatArray]:
        """Same as `Solver.errors_between`; solutions share the poses between the first knots."""
        if knots is not self._first.knots:
            return super().errors_between(knots, start, end)
        q = quintics_at_places(knots, start, end)
        errors = self._errors(self._first.between, q.reshape(-1, self.arm.dof))
        return largest_errors(errors, len(knots)), q[MIDDLE]

    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """Largest ratio of the tool's position and orientation errors to their tolerances, (n,)."""
        return self._errors(poses_at(self.path, knots, u), q)

    def _errors(self, targets: FloatArray, q: FloatArray) -> FloatArray:
        return tool_errors(self.arm, q, targets, self.task, (self.tolerance, ANGULAR_TOLERANCE))

    def _rows(self, knots: Knots, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Null-space rows w, (n, 3, free, dof), and guide positions g, (n, 3, dof)."""
        # The second axis is the order of the derivative along s, see `redundancy`.
        n, dof = len(u), self.arm.dof
        if self._guide is None:
            return np.zeros((n, 3, 0, dof)), np.zeros((n, 3, dof))
        return self._guide.evaluate(
            knots.arc_lengths(u), knots.arc_lengths((knots.u0 + knots.u1) / 2)
        )
