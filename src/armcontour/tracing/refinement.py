"""Knots are added until quintics between them keep the tool on its path."""

from __future__ import annotations

import numpy as np

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.errors import Unreachable
from armcontour.motion import JointPath, quintic
from armcontour.tracing.knots import Knots
from armcontour.tracing.poses import turning_too_fast, what_helps
from armcontour.tracing.solver import Ends, Solver

# An interval this small that still misses the path means a singularity, not a coarse grid.
SMALLEST_INTERVAL = 1e-9
# Where on an interval the tool is looked at.
PLACES = _checks.lock_floats([0.25, 0.5, 0.75])
MIDDLE = 1


def refine(solver: Solver[Arm], knots: Knots) -> JointPath:
    """The joint path through exact knots, as many as the solver's tolerance asks for.

    Args:
        solver: Tells joint positions and their derivatives.
        knots: The first knots.

    Raises:
        Unreachable: A place out of reach or singular, with its arc length.
    """
    begin = solver.ends(knots, knots.u0, None)
    end = solver.ends(knots, knots.u1, None, at_end=True)
    settled = np.zeros(len(knots), dtype=bool)
    while True:
        begin, end = solver.continuous(begin, end)
        open_ = np.flatnonzero(~settled)
        left, middle = _misses(solver, knots.part(open_), _part(begin, open_), _part(end, open_))
        missed = np.zeros(len(settled), dtype=bool)
        missed[open_[left]] = True
        if not missed.any():
            break
        coarse = knots.part(missed)
        _refuse_singularity(solver, coarse)
        u = (coarse.u0 + coarse.u1) / 2
        guess = middle[left]
        # Near a singularity a quintic between ends far apart swings out: halfway is nearer then.
        halfway = (begin[0][missed] + end[0][missed]) / 2
        nearer = solver.tool_errors(coarse, u, halfway) < solver.tool_errors(coarse, u, guess)
        guess = np.where(nearer[:, None], halfway, guess)
        between = solver.ends(coarse, u, guess)
        # An interval that misses gives its place to its two halves.
        knots, twice, second = knots.halve(missed, u)
        begin, end = _part(begin, twice), _part(end, twice)
        for k in range(3):
            begin[k][second], end[k][second - 1] = between[k], between[k]
        settled = (~missed)[twice]
    path = solver.path
    breaks = np.append(knots.s0, path.length)
    return JointPath.hermite(breaks, begin, end, stops=path.stops, tool_path=path)


def _part(ends: Ends, which: BoolArray | IntArray) -> Ends:
    q, dq_ds, d2q_ds2 = ends
    return q[which], dq_ds[which], d2q_ds2[which]


def _misses(
    solver: Solver[Arm], knots: Knots, begin: Ends, end: Ends
) -> tuple[BoolArray, FloatArray]:
    """Which intervals leave the path by more than the tolerance, and their middle positions."""
    n, width = len(knots), knots.u1 - knots.u0
    coefficients = quintic(width, begin, end)
    q = np.einsum("pk,ikj->pij", PLACES[:, None] ** np.arange(6), coefficients)
    u = knots.u0 + PLACES[:, None] * width
    thrice = knots.part(np.tile(np.arange(n), len(PLACES)))
    missed = solver.tool_errors(thrice, u.ravel(), q.reshape(-1, q.shape[2]))
    return np.asarray(~(missed.reshape(-1, n).max(axis=0) <= 1)), q[MIDDLE]


def _refuse_singularity(solver: Solver[Arm], knots: Knots) -> None:
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
