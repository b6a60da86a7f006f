"""Approximation of a cubic spline through points by tangent arcs."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.frames import angle_between
from armcontour.geometry.fit import fit_through
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE, Segments


def fit_spline(points: FloatArray, tolerance: float, closed: bool) -> tuple[Segments, IntArray]:
    """Tangent arcs along the cubic spline through points.

    The spline is C² over chord length, natural at its ends or periodic.

    Args:
        points: Points of the spline without equal neighbours [m], (n, dimension).
        tolerance: Largest distance between the arcs and the spline [m].
        closed: Whether the spline is periodic.

    Returns:
        The arcs, and the index of the vertex at each point, (n,).

    Raises:
        InvalidInput: The ends of a closed spline differ, the spline turns back on the spot, the
            points are so far apart that rounding loses distances, or the tolerance needs too many
            arcs.
    """
    from scipy.interpolate import CubicSpline

    if closed and np.linalg.norm(points[-1] - points[0]) > REPEATED_POINT:
        raise InvalidInput("A closed spline must end at its first point: repeat it at the end.")
    if closed:
        points = np.concatenate([points[:-1], points[:1]])
    at = _chord_length(points)
    curve = CubicSpline(at, points, bc_type="periodic" if closed else "natural")
    segments, vertices = fit_through(curve, at, tolerance)
    turns = angle_between(segments.end_tangents[:-1], segments.tangents[1:])
    if (turns > TANGENT_TOLERANCE).any():
        point = segments.starts[1 + int(np.argmax(turns))]
        raise InvalidInput(
            f"The spline turns back on the spot near {tuple(np.round(point, 6).tolist())} m: move "
            "the points apart, or split the spline there."
        )
    return segments, vertices


def _chord_length(points: FloatArray) -> FloatArray:
    """Chord length from the first point to each point [m], (n,).

    Raises:
        InvalidInput: The points are so far apart that rounding loses distances between others.
    """
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if not (np.diff(at) > 0).all():
        far = float(np.abs(points).max())
        raise InvalidInput(
            f"The points of a spline lie as far as {far:g} m apart, so that the distances between "
            "others are lost in rounding: check their units."
        )
    return at
