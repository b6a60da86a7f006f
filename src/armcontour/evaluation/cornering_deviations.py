"""Cornering deviations after ISO 9283, 8.5: how a sharp corner of the objective path was taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.geometry.segments import TANGENT_TOLERANCE


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerDeviation:
    """How the tool took one corner.

    Args:
        vertex: Index of the corner among the vertices of the objective path, from 0.
        point: The corner [m].
        rounding: Cornering round-off CR: smallest distance between corner and tool [m].
        overshoot: Cornering overshoot CO: how far the tool went beyond the line that leaves the
            corner, on the far side of it [m].
        contour: Of a program, the number of the corner's contour, from 1.
    """

    vertex: int
    point: tuple[float, ...]
    rounding: float
    overshoot: float
    contour: int | None = None


def corner_deviations(
    tool: FloatArray, objective: Path, s: FloatArray | None = None
) -> tuple[CornerDeviation, ...]:
    """The deviations at every corner of a path.

    Args:
        tool: Places of the tool, (n, dimension) [m].
        objective: The path with its corners.
        s: Their nearest places on it [m], if they are known, (n,).
    """
    corners = np.flatnonzero(objective.turns > TANGENT_TOLERANCE) + 1
    if not len(corners):
        return ()
    at = objective.project(tool).s if s is None else s
    order = np.argsort(at, kind="stable")
    at, tool = at[order], tool[order]
    # A corner's own region: from the middle of the segment before to the middle of the one after.
    low = objective.breaks[corners] - objective.lengths[corners - 1] / 2
    high = objective.breaks[corners] + objective.lengths[corners] / 2
    first, last = np.searchsorted(at, low), np.searchsorted(at, high, side="right")
    # Where no result falls into it, those before and after it are the nearest.
    empty = first == last
    first = np.where(empty, np.maximum(first - 1, 0), first)
    last = np.where(empty, np.minimum(last + 1, len(at)), last)
    near, of = _members(first, last)
    points, starts = objective.starts[corners], np.cumsum(last - first) - (last - first)
    off = tool[near] - points[of]
    across = _across(objective, corners)
    rounding = np.minimum.reduceat(np.linalg.norm(off, axis=1), starts)
    overshoot = np.maximum.reduceat(np.sum(off * across[of], axis=1), starts)
    return tuple(
        CornerDeviation(vertex=vertex, point=tuple(point), rounding=cr, overshoot=max(0.0, co))
        for vertex, point, cr, co in zip(
            corners.tolist(), points.tolist(), rounding.tolist(), overshoot.tolist(), strict=True
        )
    )


def _members(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """The members of ranges one after the other, and of which range each is."""
    count = last - first
    of = np.repeat(np.arange(len(first)), count)
    number = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    return first[of] + number, of


def _across(path: Path, corners: IntArray) -> FloatArray:
    """Beyond a corner: the arriving direction at right angles to the leaving one, (n, dim)."""
    before = path.segments.end_tangents[corners - 1]
    after = path.tangents[corners]
    across = before - np.sum(before * after, axis=1, keepdims=True) * after
    size = np.linalg.norm(across, axis=1, keepdims=True)
    turned = size > TANGENT_TOLERANCE
    return np.where(turned, across / np.where(turned, size, 1.0), before)
