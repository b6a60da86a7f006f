"""Functions that cut out a part of a path, and project a path onto the plane."""

from __future__ import annotations

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import IN_PLANE
from armcontour.geometry.path import Path
from armcontour.geometry.segments import REPEATED_POINT


def cut_path(path: Path, begin: float, end: float) -> Path:
    """The part of a path between two arc lengths, with speeds, tolerances and orientation.

    `begin`, `end`: arc lengths at which the part starts and ends [m].
    """
    for name, s in (("begin", begin), ("end", end)):
        value = checks.check_number(name, s, "m")
        if not -REPEATED_POINT <= value <= path.length + REPEATED_POINT:
            raise InvalidInput(
                f"{name} of a part must lie within the path of {path.length:.9g} m, but is "
                f"{value:.9g} m.",
                s=value,
                allowed=path.length,
            )
    begin, end = max(begin, 0.0), min(end, path.length)
    # Remainders of segments shorter than the resolution of a point are discarded.
    first = int(path.locate(begin + REPEATED_POINT))
    last = int(path.locate(end - REPEATED_POINT, side="left"))
    if end - begin <= REPEATED_POINT or first > last:
        raise InvalidInput(
            f"The part from {begin:.9g} to {end:.9g} m of the path has no length. The end must be "
            f"greater than the start by more than {REPEATED_POINT:g} m."
        )
    # The orientation is cut at the same arc lengths as the segments.
    begin = max(begin, float(path.breaks[first]))
    end = min(end, float(path.breaks[last + 1]))
    i = np.arange(first, last + 1)
    u0, u1 = np.zeros(len(i)), path.lengths[i].copy()
    u0[0] = begin - path.breaks[first]
    u1[-1] = min(end - path.breaks[last], u1[-1])
    orientation = path.orientation
    if orientation is not None:
        orientation = orientation.cut(begin, float((u1 - u0).sum()), REPEATED_POINT)
    cut = path.segments.cut(i, u0, u1).replace(checked=True)
    return Path(segments=cut, orientation=orientation)


def drop_z(path: Path) -> Path:
    """Projection of a path in space onto the x-y plane, without its orientation."""
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
            f"Segment {i + 1} cannot be projected onto the x-y plane, because it is an arc or a "
            "transition that is not parallel to this plane.",
            index=i,
        )
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    mask = run * path.lengths > REPEATED_POINT
    if not mask.any():
        raise InvalidInput(
            "The path is vertical, so its projection onto the x-y plane has no length."
        )
    rows, shortening = path.segments[mask], run[mask]
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
    """Return whether the projection of a path onto the x-y plane has any length."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1) * path.lengths
    return bool(((run > REPEATED_POINT) | (path.curvatures > 0)).any())


def arc_lengths_without_z(path: Path, s: FloatArray) -> FloatArray:
    """Arc length on the projected path for arc length `s` on a path in space [m]."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    run = np.where(path.curvatures > 0, 1.0, run) * path.lengths
    ends = np.cumsum(np.where(run > REPEATED_POINT, run, 0.0))
    return np.asarray(np.interp(s, path.breaks, np.append(0.0, ends)))
