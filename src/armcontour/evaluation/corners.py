"""Cornering deviations after ISO 9283, 8.5: how a sharp corner of the objective path was taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path
from armcontour.geometry.path import TANGENT_TOLERANCE


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerDeviation:
    """How the tool took one corner.

    Args:
        joint: Index of the corner's joint between segments of the objective path, from 1.
        point: The corner [m].
        rounding: Cornering round-off CR: smallest distance between corner and tool [m].
        overshoot: Cornering overshoot CO: how far the tool went beyond the line that leaves the
            corner, on the far side of it [m].
    """

    joint: int
    point: tuple[float, ...]
    rounding: float
    overshoot: float


def corner_deviations(tool: FloatArray, objective: Path) -> tuple[CornerDeviation, ...]:
    """The deviations at every corner of a path.

    Args:
        tool: Places of the tool, (n, dimension) [m].
        objective: The path with its corners.
    """
    corners = np.flatnonzero(objective.turns > TANGENT_TOLERANCE) + 1
    if not len(corners):
        return ()
    s = objective.project(tool).s
    order = np.argsort(s)
    s, sorted_tool = s[order], tool[order]
    # A corner's own region: from the middle of the segment before to the middle of the one after.
    low = objective.breaks[corners] - objective.lengths[corners - 1] / 2
    high = objective.breaks[corners] + objective.lengths[corners] / 2
    first, last = np.searchsorted(s, low), np.searchsorted(s, high, side="right")
    arriving = objective.on_segment(corners - 1, objective.lengths[corners - 1], 1)
    return tuple(
        _deviation(sorted_tool[i:k] if i < k else tool, objective, joint, before)
        for i, k, joint, before in zip(
            first.tolist(), last.tolist(), corners.tolist(), arriving, strict=True
        )
    )


def _deviation(near: FloatArray, path: Path, joint: int, before: FloatArray) -> CornerDeviation:
    corner = path.starts[joint]
    after = path.tangents[joint]
    # Beyond: the part of the arriving direction that is at right angles to the leaving one.
    across = before - (before @ after) * after
    size = float(np.linalg.norm(across))
    across = across / size if size > TANGENT_TOLERANCE else before
    return CornerDeviation(
        joint=joint,
        point=tuple(corner.tolist()),
        rounding=float(np.linalg.norm(near - corner, axis=1).min()),
        overshoot=max(0.0, float(((near - corner) @ across).max())),
    )
