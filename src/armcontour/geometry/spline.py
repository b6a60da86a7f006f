"""Splines as tangent arcs: pairs of arcs that meet the spline's points and tangents."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.geometry.biarcs import Arcs, distance, in_turn, pairs, unit

# Places in an interval at which its arcs are compared with the spline.
PLACES = np.linspace(0, 1, 11)[1:-1]
# An interval of more arcs than 2 ** this means a spline that is no smooth curve.
MOST_HALVINGS = 30
# More intervals than this are a tolerance that does not fit the curve, as for any curve.
MOST_INTERVALS = 500_000


def arcs_along(points: FloatArray, tolerance: float, closed: bool) -> tuple[Arcs, IntArray]:
    """Arcs along the cubic spline through points, tangent to each other.

    The spline is C² over chord length, natural at its ends or periodic. Every interval gets two
    arcs through its ends with its tangents; intervals are halved until those are near enough.

    Args:
        points: (n, dimension), no two neighbours equal [m].
        tolerance: Largest distance between the arcs and the spline [m].
        closed: Whether it is periodic.

    Returns:
        The arcs, and which of their ends the points are, (n,).

    Raises:
        InvalidInput: A closed spline whose ends differ, one that turns back on the spot, points too
            far apart for their distances to be numbers, or a tolerance that needs too many arcs.
    """
    from scipy.interpolate import CubicSpline

    if closed and np.linalg.norm(points[-1] - points[0]) > 1e-9:
        raise InvalidInput("A closed spline must end at its first point: repeat it at the end.")
    if closed:
        points = np.concatenate([points[:-1], points[:1]])
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if not (np.diff(at) > 0).all():
        far = float(np.abs(points).max())
        raise InvalidInput(
            f"The points of a spline lie as far as {far:g} m apart, so that the distances between "
            "others are lost in rounding: look at their units."
        )
    curve = CubicSpline(at, points, bc_type="periodic" if closed else "natural")
    begin, end = at[:-1], at[1:]
    for _ in range(MOST_HALVINGS):
        # Where the spline turns back on the spot it has no tangent, and its arcs are not finite.
        with np.errstate(all="ignore"):
            t0, t1 = unit(curve(begin, 1)), unit(curve(end, 1))
            first, second = pairs(curve(begin), t0, curve(end), t1)
            between = curve(begin[:, None] + (end - begin)[:, None] * PLACES)
            missed = distance(between, first, second) > tolerance
        if not missed.any():
            return in_turn(first, second), 2 * np.searchsorted(begin, at)
        if len(begin) + int(missed.sum()) > MOST_INTERVALS:
            raise InvalidInput(
                f"A spline would need more than {2 * MOST_INTERVALS} arcs to be within "
                f"{tolerance:g} m: give it a larger tolerance."
            )
        middle = (begin[missed] + end[missed]) / 2
        order = np.argsort(np.concatenate([begin, middle]), kind="stable")
        end = np.concatenate([np.where(missed, (begin + end) / 2, end), end[missed]])[order]
        begin = np.concatenate([begin, middle])[order]
    s = float(begin[int(np.argmax(missed))])
    raise InvalidInput(
        f"The spline turns back on the spot near {tuple(np.round(curve(s), 6).tolist())} m: move "
        "the points apart, or split the spline there."
    )
