"""Cornering deviations at the sharp corners of the objective path, after ISO 9283, 8.5."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._parts import number_parts
from armcontour.geometry import Path
from armcontour.geometry.biarcs import dot, length
from armcontour.geometry.segments import TANGENT_TOLERANCE


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerDeviation:
    """Deviations of the tool at one corner.

    Args:
        vertex: Index of the corner among the vertices of the objective path, from 0.
        point: The corner [m].
        rounding: Cornering round-off CR: smallest distance between corner and tool [m].
        overshoot: Cornering overshoot CO: largest distance of the tool beyond the line that leaves
            the corner, on the side away from the line that arrives [m].
        contour: Number of the contour in a program, from 1; None for a single path.
    """

    vertex: int
    point: tuple[float, ...]
    rounding: float
    overshoot: float
    contour: int | None = None


# The largest values beside some samples, (m,), given these samples, (m,), and a function of tool
# points, (m, n, dimension), that has a value for each of them, (m, n).
Largest = Callable[[IntArray, Callable[[FloatArray], FloatArray]], FloatArray]


def corner_deviations(
    tool: FloatArray, objective: Path, s: FloatArray | None = None, beside: Largest | None = None
) -> tuple[CornerDeviation, ...]:
    """Cornering deviations at every corner of a path.

    Args:
        tool: Tool points [m], (n, dimension).
        objective: The path with its corners.
        s: Arc lengths of the nearest points on the path [m], (n,); computed if None.
        beside: Finds what is larger between the points than at them; None if nothing is known.
    """
    corners = np.flatnonzero(objective.turns > TANGENT_TOLERANCE) + 1
    if not len(corners):
        return ()
    at = objective.project(tool).s if s is None else s
    order = np.argsort(at, kind="stable")
    at, tool = at[order], tool[order]
    # The region of a corner: from the middle of the segment before to the middle of the one after.
    low = objective.breaks[corners] - objective.lengths[corners - 1] / 2
    high = objective.breaks[corners] + objective.lengths[corners] / 2
    first, last = np.searchsorted(at, low), np.searchsorted(at, high, side="right")
    # If no sample is in the region, take the samples before and after it.
    empty = first == last
    first = np.where(empty, np.maximum(first - 1, 0), first)
    last = np.where(empty, np.minimum(last + 1, len(at)), last)
    of, number = number_parts(last - first)
    near = first[of] + number
    points, starts = objective.starts[corners], np.cumsum(last - first) - (last - first)
    off = tool[near] - points[of]
    across = _across(objective, corners)
    away, past = length(off), dot(off, across[of])
    rounding = np.minimum.reduceat(away, starts)
    overshoot = np.maximum.reduceat(past, starts)
    if beside is not None:
        # The first of the extreme samples of each corner.
        rows = [np.flatnonzero(x == y[of]) for x, y in ((away, rounding), (past, overshoot))]
        nearest, farthest = (x[np.unique(of[x], return_index=True)[1]] for x in rows)
        # What is largest where the tool comes and goes is not so between samples.
        inner = np.flatnonzero((farthest > starts) & (farthest < starts + last - first - 1))
        farthest, count = farthest[inner], len(corners)
        here, out = np.concatenate([points, points[inner]])[:, None], across[inner][:, None]

        # Squares are smooth, also where the tool passes through the corner.
        def both(x: FloatArray) -> FloatArray:
            gap = x - here
            return np.concatenate(
                [-dot(gap[:count], gap[:count]), np.sum(gap[count:] * out, axis=-1)]
            )

        found = beside(order[near[np.concatenate([nearest, farthest])]], both)
        rounding, overshoot[inner] = np.sqrt(-found[:count]), found[count:]
    return tuple(
        CornerDeviation(vertex=vertex, point=tuple(point), rounding=cr, overshoot=max(0.0, co))
        for vertex, point, cr, co in zip(
            corners.tolist(), points.tolist(), rounding.tolist(), overshoot.tolist(), strict=True
        )
    )


def _across(path: Path, corners: IntArray) -> FloatArray:
    """Unit vectors of overshoot, (n, dimension): arriving direction normal to the leaving one."""
    before = path.segments.end_tangents[corners - 1]
    after = path.tangents[corners]
    across = before - np.sum(before * after, axis=1, keepdims=True) * after
    size = np.linalg.norm(across, axis=1, keepdims=True)
    turned = size > TANGENT_TOLERANCE
    return np.where(turned, across / np.where(turned, size, 1.0), before)
