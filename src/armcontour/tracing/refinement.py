"""Refinement: knots are added until the quintics between knots keep the tool on its path."""

from __future__ import annotations

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.errors import Unreachable
from armcontour.motion import JointPath
from armcontour.tracing.knots import Knots
from armcontour.tracing.poses import turning_too_fast, what_helps
from armcontour.tracing.solver import Ends, Solver

# If an interval this short still leaves the path, the cause is a singularity [m].
SMALLEST_INTERVAL = 1e-9


def refine(solver: Solver[Arm], knots: Knots, stops: FloatArray) -> JointPath:
    """The joint path through exact knots, refined until it meets the solver's tolerance.

    Args:
        solver: Computes joint positions and their derivatives.
        knots: The first knots.
        stops: Arc lengths at which the tool stops [m].

    Raises:
        Unreachable: The arm cannot reach a knot or is singular; with the arc length.
    """
    start, end = solver.first_ends(knots)
    settled = np.zeros(len(knots), dtype=bool)
    while True:
        start, end = solver.continuous(start, end)
        open_ = np.flatnonzero(~settled)
        if len(open_) == len(knots):
            errors, middle = solver.errors_between(knots, start, end)
        else:
            errors, middle = solver.errors_between(
                knots.part(open_), _select(start, open_), _select(end, open_)
            )
        leaves = ~(errors <= 1)
        missed = np.zeros(len(settled), dtype=bool)
        missed[open_[leaves]] = True
        if not missed.any():
            break
        coarse = knots.part(missed)
        _refuse_singularity(solver, coarse)
        u = (coarse.u0 + coarse.u1) / 2
        halfway = (start[0][missed] + end[0][missed]) / 2
        between = solver.ends(coarse, u, solver.guess(coarse, u, middle[leaves], halfway))
        knots, parent, second = knots.halve(missed, u)
        start, end = _select(start, parent), _select(end, parent)
        for k in range(3):
            start[k][second], end[k][second - 1] = between[k], between[k]
        settled = (~missed)[parent]
    path = solver.path
    breaks = np.append(knots.s0, path.length)
    return JointPath.hermite(breaks, start, end, stops=stops, tool_path=path)


def _select(ends: Ends, which: BoolArray | IntArray) -> Ends:
    """The joint positions and derivatives of the selected intervals."""
    q, dq_ds, d2q_ds2 = ends
    return q[which], dq_ds[which], d2q_ds2[which]


def _refuse_singularity(solver: Solver[Arm], knots: Knots) -> None:
    """Raise Unreachable if any of the intervals is too short to be split further."""
    small = np.flatnonzero(knots.u1 - knots.u0 < SMALLEST_INTERVAL)
    if len(small):
        s = float(knots.s0[small[0]])
        point = solver.path(s).tolist()
        raise Unreachable(
            turning_too_fast(solver.path, s)
            or f"At {s:.6g} m along the path, near {tuple(round(x, 6) for x in point)} m, the arm "
            f"{solver.arm.name} is singular or jumps between configurations: "
            f"{what_helps(solver.path)}.",
            point=point,
            s=s,
            limit="singularity",
        )
