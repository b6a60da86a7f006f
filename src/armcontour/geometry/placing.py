"""Functions that project a path onto the plane."""

from __future__ import annotations

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.frames import IN_PLANE
from armcontour.geometry.path import Path
from armcontour.geometry.segments import REPEATED_POINT


def drop_z(path: Path) -> Path:
    """Projection of a path in space onto the x-y plane, without its orientation.

    Raises:
        InvalidInput: An arc does not lie in a plane of constant z, or the projection has no length.
    """
    if path.dimension == 2:
        return path
    across = (np.abs(path.tangents[:, 2]) + np.abs(path.normals[:, 2]) > IN_PLANE) & (
        path.curvatures > 0
    )
    quintics = path.segments.quintics
    if quintics.size:
        across |= np.abs(quintics[:, :, 2]).max(axis=1) > IN_PLANE
    if across.any():
        i = int(np.argmax(across))
        raise InvalidInput(
            f"Segment {i + 1} is a curve that leaves the plane, which cannot be flattened.", index=i
        )
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    kept = run * path.lengths > REPEATED_POINT
    if not kept.any():
        raise InvalidInput("The path only goes up and down: nothing is left of it in the plane.")
    rows, shortening = path.segments[kept], run[kept]
    return Path(
        segments=rows.replace(
            starts=rows.starts[:, :2],
            tangents=rows.tangents[:, :2] / shortening[:, None],
            normals=rows.normals[:, :2],
            lengths=rows.lengths * shortening,
            quintics=rows.quintics[:, :, :2],
        )
    )


def has_length_without_z(path: Path) -> bool:
    """Whether the projection of a path onto the x-y plane has any length."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1) * path.lengths
    return bool(((run > REPEATED_POINT) | (path.curvatures > 0)).any())


def arc_length_without_z(path: Path, s: float) -> float:
    """Arc length on the projected path of the point at arc length `s` on a path in space [m]."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    run = np.where(path.curvatures > 0, 1.0, run)
    run = np.where(run * path.lengths > REPEATED_POINT, run, 0.0)
    return float(np.sum(run * np.clip(s - path.breaks[:-1], 0.0, path.lengths)))
