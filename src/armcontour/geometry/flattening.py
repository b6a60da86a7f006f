"""Paths in space without their z."""

from __future__ import annotations

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.geometry.path import REPEATED_POINT, Path

# An arc keeps to a plane of constant z if its vectors leave it by no more than this.
IN_PLANE = 1e-12


def flattened(path: Path) -> Path:
    """A path in space without its z, of lines and of arcs in planes of constant z.

    It has no orientation: a tool is oriented in space only.

    Raises:
        InvalidInput: An arc that stands across the plane, or nothing that is left.
    """
    if path.dimension == 2:
        return path
    across = (np.abs(path.tangents[:, 2]) + np.abs(path.inwards[:, 2]) > IN_PLANE) & (
        path.curvatures > 0
    )
    if across.any():
        i = int(np.argmax(across))
        raise InvalidInput(
            f"Segment {i + 1} is an arc that leaves the plane, which cannot be flattened.", index=i
        )
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    kept = run * path.lengths > REPEATED_POINT
    if not kept.any():
        raise InvalidInput("The path only goes up and down: nothing is left of it in the plane.")
    steep = run[kept][:, None]
    return Path(
        starts=path.starts[kept, :2],
        tangents=path.tangents[kept, :2] / steep,
        inwards=path.inwards[kept, :2],
        curvatures=path.curvatures[kept],
        lengths=path.lengths[kept] * steep[:, 0],
        speeds=path.speeds[kept],
        tolerances=path.tolerances[kept],
        tags=tuple(tag for tag, keep in zip(path.tags, kept, strict=True) if keep),
    )


def goes_along(path: Path) -> bool:
    """Whether something of a path is left without its z."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1) * path.lengths
    return bool(((run > REPEATED_POINT) | (path.curvatures > 0)).any())


def flat_place(path: Path, s: float) -> float:
    """Arc length without z of a place on a path."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    run = np.where(path.curvatures > 0, 1.0, run)
    run = np.where(run * path.lengths > REPEATED_POINT, run, 0.0)
    return float(np.sum(run * np.clip(s - path.breaks[:-1], 0.0, path.lengths)))
