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
        tool: Places of the tool in the order of time, (n, dimension) [m].
        objective: The path with its corners.
    """
    corners = np.flatnonzero(objective.turns > TANGENT_TOLERANCE) + 1
    if not len(corners):
        return ()
    s = objective.project(tool).s
    return tuple(_deviation(tool, s, objective, int(joint)) for joint in corners)


def _deviation(tool: FloatArray, s: FloatArray, path: Path, joint: int) -> CornerDeviation:
    corner = path.starts[joint]
    # The corner's own region: from the middle of the segment before to the middle of the one after.
    low, high = (
        path.breaks[joint] - path.lengths[joint - 1] / 2,
        path.breaks[joint] + path.lengths[joint] / 2,
    )
    near = tool[(s >= low) & (s <= high)]
    if not len(near):
        near = tool
    before = path(path.breaks[joint], 1, side="left")
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
