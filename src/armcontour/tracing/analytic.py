"""Exact knots for an arm with closed-form inverse kinematics."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import PlanarTwoLink
from armcontour.errors import InvalidInput, Unreachable
from armcontour.geometry import Path
from armcontour.tracing.knots import Knots
from armcontour.tracing.solver import Ends, Solver


class Analytic(Solver[PlanarTwoLink]):
    """Exact joint positions and derivatives at knots, by (3)-(4), (28) and (27).

    Args:
        path: The tool path.
        arm: The arm.
        branch: One of `arm.branches`; the first by default.
        tolerance: Largest distance of the tool from the path between knots [m].

    Raises:
        InvalidInput: The path and the arm's workspace differ in dimension.
    """

    def __init__(
        self, path: Path, arm: PlanarTwoLink, branch: str | None, tolerance: float
    ) -> None:
        if path.dimension != arm.dimension:
            raise InvalidInput(
                f"The path has {path.dimension} coordinates, but the tool of the arm {arm.name} "
                f"moves in {arm.dimension}."
            )
        super().__init__(path, arm)
        self.branch, self.tolerance = branch, tolerance

    def first_ends(self, knots: Knots) -> tuple[Ends, Ends]:
        """q, dq_ds and d2q_ds2 at the starts and at the ends of the first intervals, at once."""
        n = len(knots)
        both = knots.part(np.tile(np.arange(n), 2))
        q, dq_ds, d2q_ds2 = self.ends(both, np.concatenate([knots.u0, knots.u1]), None)
        return (q[:n], dq_ds[:n], d2q_ds2[:n]), (q[n:], dq_ds[n:], d2q_ds2[n:])

    def ends(self, knots: Knots, u: FloatArray, guess: FloatArray | None) -> Ends:
        """q, dq_ds and d2q_ds2 at distances `u` along the segments of the knots."""
        try:
            q = self.arm.inverse(self.path.on_segment(knots.segment, u), self.branch)
        except Unreachable as error:
            index = error.index or 0
            s = float(knots.at(u)[index])
            raise Unreachable(
                f"At {s:.6g} m along the path: {error}",
                point=error.point,
                index=int(knots.segment[index]),
                s=s,
                limit=error.limit,
                needed=error.needed,
                allowed=error.allowed,
            ) from None
        dq_ds = self.arm.joint_velocity(q, self.path.on_segment(knots.segment, u, 1))
        curvature = self.path.on_segment(knots.segment, u, 2)
        return q, dq_ds, self.arm.joint_acceleration(q, dq_ds, curvature)

    def guess(self, knots: Knots, u: FloatArray, middle: FloatArray, halfway: FloatArray) -> None:
        """None, as a closed form needs none."""

    def continuous(self, start: Ends, end: Ends) -> tuple[Ends, Ends]:
        """The same starts and ends, with jumps by whole turns removed from the joint positions."""
        q = np.stack([start[0], end[0]], axis=1).reshape(-1, start[0].shape[1])
        unwrapped = np.unwrap(q, axis=0).reshape(len(start[0]), 2, -1)
        return (unwrapped[:, 0], *start[1:]), (unwrapped[:, 1], *end[1:])

    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """Distances of the tool from its position on the path, over the tolerance, (n,)."""
        off = self.arm.forward(q) - self.path.on_segment(knots.segment, u)
        return np.asarray(np.linalg.norm(off, axis=1) / self.tolerance)
