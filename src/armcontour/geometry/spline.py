"""Splines as tangent arcs: pairs of arcs that meet the spline's points and tangents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput

# Places in an interval at which its arcs are compared with the spline.
PLACES = np.linspace(0, 1, 11)[1:-1]
# An interval of more arcs than 2 ** this means a spline that is no smooth curve.
MOST_HALVINGS = 30
# A chord that leaves its tangent by less than this angle [rad] is a line.
STRAIGHT = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Arcs:
    """Lines and arcs as a path holds them: see `Path`."""

    starts: FloatArray
    tangents: FloatArray
    inwards: FloatArray
    curvatures: FloatArray
    lengths: FloatArray


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
        InvalidInput: A closed spline whose ends differ, or one that turns back on the spot.
    """
    from scipy.interpolate import CubicSpline

    if closed and np.linalg.norm(points[-1] - points[0]) > 1e-9:
        raise InvalidInput("A closed spline must end at its first point: repeat it at the end.")
    if closed:
        points = np.concatenate([points[:-1], points[:1]])
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    curve = CubicSpline(at, points, bc_type="periodic" if closed else "natural")
    begin, end = at[:-1], at[1:]
    for _ in range(MOST_HALVINGS):
        # Where the spline turns back on the spot it has no tangent, and its arcs are not finite.
        with np.errstate(all="ignore"):
            first, second = _pair(curve, begin, end)
            missed = _distance(curve, begin, end, first, second) > tolerance
        if not missed.any():
            return _in_turn(first, second), 2 * np.searchsorted(begin, at)
        middle = (begin[missed] + end[missed]) / 2
        order = np.argsort(np.concatenate([begin, middle]), kind="stable")
        end = np.concatenate([np.where(missed, (begin + end) / 2, end), end[missed]])[order]
        begin = np.concatenate([begin, middle])[order]
    s = float(begin[int(np.argmax(missed))])
    raise InvalidInput(
        f"The spline turns back on the spot near {tuple(np.round(curve(s), 6).tolist())} m: move "
        "the points apart, or split the spline there."
    )


def _pair(curve: object, begin: FloatArray, end: FloatArray) -> tuple[Arcs, Arcs]:
    """Two arcs per interval, with equal tangent lengths."""
    p0, p1 = curve(begin), curve(end)  # type: ignore[operator]
    t0, t1 = (_unit(curve(x, 1)) for x in (begin, end))  # type: ignore[operator]
    chord = p1 - p0
    # |chord - d (t0 + t1)| = 2 d, solved for the positive d without cancellation.
    c, b = _dot(chord, chord), _dot(chord, t0 + t1)
    a = 2 * (1 - _dot(t0, t1))
    root = np.sqrt(b * b + a * c)
    d = np.where(b > 0, c / (b + root), (root - b) / a)
    q0, q1 = p0 + d[:, None] * t0, p1 - d[:, None] * t1
    along = _unit(q1 - q0)
    return _arc(p0, t0, along, d), _arc((q0 + q1) / 2, along, t1, d)


def _arc(start: FloatArray, tangent: FloatArray, onward: FloatArray, reach: FloatArray) -> Arcs:
    """Arcs from a point with a tangent to another tangent, by their tangent lengths.

    Made of tangents and not of points, so that the tangents are the same where two arcs meet,
    however short they are.
    """
    half = np.arctan2(_length(onward - tangent), _length(onward + tangent))
    bent = half > STRAIGHT
    across = onward - _dot(onward, tangent)[:, None] * tangent
    inward = np.where(bent[:, None], _unit(across), 0.0)
    # An inward vector must be at right angles to the tangent to the last digit.
    inward = inward - _dot(inward, tangent)[:, None] * tangent
    inward = np.where(bent[:, None], _unit(inward), 0.0)
    share = np.tan(half) / reach
    curvature = np.where(bent, share, 0.0)
    length = np.where(bent, 2 * half / share, 2 * reach)
    return Arcs(
        starts=start, tangents=tangent, inwards=inward, curvatures=curvature, lengths=length
    )


def _distance(
    curve: object, begin: FloatArray, end: FloatArray, first: Arcs, second: Arcs
) -> FloatArray:
    """Largest distance of the spline from the circles of its arcs, per interval."""
    at = begin[:, None] + (end - begin)[:, None] * PLACES
    points = curve(at)  # type: ignore[operator]
    behind = np.sum((points - second.starts[:, None]) * second.tangents[:, None], axis=2) > 0
    apart = np.where(behind, _from_circle(points, second), _from_circle(points, first))
    worst = np.asarray(apart.max(axis=1))
    for arcs in (first, second):
        for name in Arcs.__slots__:
            values = getattr(arcs, name).reshape(len(worst), -1)
            worst[~np.isfinite(values).all(axis=1)] = np.inf
    return np.where(np.isfinite(worst), worst, np.inf)


def _from_circle(points: FloatArray, arcs: Arcs) -> FloatArray:
    """Distance of points from the circles, or lines, of arcs."""
    v = points - arcs.starts[:, None]
    x = np.sum(v * arcs.tangents[:, None], axis=2)
    y = np.sum(v * arcs.inwards[:, None], axis=2)
    rest = np.sum(v * v, axis=2) - x * x - y * y
    k = arcs.curvatures[:, None]
    # (|p - c| - r) without the large numbers of flat arcs.
    power = k * (x * x + y * y) - 2 * y
    in_plane = power / (1 + np.sqrt(np.maximum(1 + k * power, 0.0)))
    line = np.where(k == 0, np.abs(y), np.abs(in_plane))
    return np.asarray(np.hypot(line, np.sqrt(np.maximum(rest, 0.0))))


def _in_turn(first: Arcs, second: Arcs) -> Arcs:
    """First and second arcs of all intervals in the order of the path."""

    def both(name: str) -> FloatArray:
        a, b = getattr(first, name), getattr(second, name)
        return np.stack([a, b], axis=1).reshape(2 * len(a), *a.shape[1:])

    return Arcs(**{name: both(name) for name in Arcs.__slots__})


def _unit(v: FloatArray) -> FloatArray:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def _length(v: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(v, axis=-1))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sum(a * b, axis=-1))
