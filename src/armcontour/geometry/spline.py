"""Cubic splines through points as chains of transitions, whose curvature is continuous."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quintics import rescale
from armcontour.geometry.biarcs import UNEVEN, join_by_quintics, length, tangent_and_curvature
from armcontour.geometry.segments import REPEATED_POINT, Segments

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Condition at both ends of an open spline, as in `fit_spline`.
Ends: TypeAlias = Literal["natural", "not-a-knot"] | tuple[FloatArray, FloatArray]
# Fractions of a piece at which its transition is compared with the spline; nodes and weights that
# integrate arc length between two neighbouring fractions.
SAMPLES = np.linspace(0, 1, 17)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
# Fraction of both limits, the tolerance and `UNEVEN`, that is allowed at these samples, because the
# errors are slightly larger between samples.
TOLERANCE_SHARE = 0.9
# Largest number of pieces. If a spline needs more, an error reports that its tolerance is too
# small.
MAX_PIECES = 500_000


def fit_spline(
    points: FloatArray,  # Points of the spline without equal neighbours [m], (n, dimension)
    tolerance: float,  # Largest distance between the transitions and the spline [m]
    closed: bool,  # True if the spline is periodic
    *,
    ends: Ends = "natural",
) -> tuple[Segments, IntArray]:
    """Draw the cubic spline through points as transitions.

    The spline is C² over chord length, periodic or with an end condition. Each transition has the
    points, tangents and curvatures of the spline at its ends; the spline is cut until all
    transitions are within the tolerance.

    Returns the transitions, and the index of the vertex at each point, (n,).

    `ends` is the end condition of an open spline: as in SciPy's `CubicSpline`, or the unit tangents
    at both ends, (dimension,) each.
    """
    curve = interpolate(points, closed, ends=ends)
    parameters = curve.x
    powers = np.diff(parameters)[:, None, None] ** np.arange(4)[:, None]
    with np.errstate(all="ignore"):
        cubics, lengths, begin = _split(curve.c[::-1].swapaxes(0, 1) * powers, tolerance)
        start = _contact(cubics, 0.0)
        last = _contact(cubics[:1], 0.0) if closed else _contact(cubics[-1:], 1.0)
    end = [np.concatenate([x[1:], y]) for x, y in zip(start, last, strict=True)]
    segments = join_by_quintics((cubics[:, 0], *start), (cubics[:, 1:].sum(axis=1), *end), lengths)
    return segments, np.append(np.flatnonzero(begin % 1 == 0), len(segments))


def interpolate(points: FloatArray, closed: bool, *, ends: Ends = "natural") -> CubicSpline:
    """Return the cubic spline through points over chord length; see `fit_spline`."""
    from scipy.interpolate import CubicSpline

    if closed and np.linalg.norm(points[-1] - points[0]) > REPEATED_POINT:
        raise InvalidInput(
            "A closed spline must end at its first point. Repeat the first point at the end."
        )
    if closed:
        points = np.concatenate([points[:-1], points[:1]])
    parameters = np.concatenate([[0.0], np.cumsum(length(np.diff(points, axis=0)))])
    if not (np.diff(parameters) > 0).all():
        raise InvalidInput(
            f"Points of a spline have coordinates up to {np.abs(points).max():g} m, so distances "
            "between neighbouring points are lost to rounding. Check the units of the points."
        )
    if closed:
        return CubicSpline(parameters, points, bc_type="periodic")
    if isinstance(ends, str):
        return CubicSpline(parameters, points, bc_type=ends)
    return CubicSpline(parameters, points, bc_type=((1, ends[0]), (1, ends[1])))


def _split(cubics: FloatArray, tolerance: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Halve cubics until a transition approximates each part within the tolerance.

    Returns the parts' coefficients and arc lengths [m], and where each part starts: the index of
    its cubic plus the fraction along it.
    """
    begin = np.arange(len(cubics), dtype=np.float64)
    size = 1.0
    done: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    count = 0
    while len(cubics):
        lengths, good = _test_transitions(cubics, tolerance)
        count += len(cubics)
        stuck = ~good & (lengths <= REPEATED_POINT)
        if stuck.any():
            point = tuple(np.round(cubics[stuck, 0][0], 6).tolist())
            raise InvalidInput(
                f"The spline reverses its direction near {point} m. Move the points apart, or "
                "split the spline there."
            )
        if count > MAX_PIECES:
            raise InvalidInput(
                f"A spline would need more than {MAX_PIECES} segments for its tolerance of "
                f"{tolerance:g} m. Specify a larger tolerance."
            )
        done.append((cubics[good], lengths[good], begin[good]))
        halved = np.repeat(cubics[~good], 2, axis=0)
        begin = begin[~good]
        size = size / 2
        half = np.tile([0.0, 0.5], len(begin))
        cubics = rescale(halved, half, np.full(len(halved), 0.5))
        begin = (begin[:, None] + [0.0, size]).ravel()
    cubics, lengths, begin = (np.concatenate(x) for x in zip(*done, strict=True))
    order = np.argsort(begin)
    return cubics[order], lengths[order], begin[order]


def _test_transitions(cubics: FloatArray, tolerance: float) -> tuple[FloatArray, BoolArray]:
    """Return the arc lengths of cubics [m], and the mask of those that one transition fits.

    - `cubics`: coefficients from 1 to x³ [m], (n, 4, dimension).
    - `tolerance`: largest distance between transition and cubic [m].
    """
    # Arc lengths at the samples.
    x = (SAMPLES[:-1, None] + np.diff(SAMPLES)[:, None] * (NODES + 1) / 2).ravel()
    speed = length(_evaluate(cubics, x, 1)).reshape(len(cubics), -1, len(NODES))
    steps = speed @ WEIGHTS / 2 * np.diff(SAMPLES)
    s = np.concatenate([np.zeros((len(cubics), 1)), np.cumsum(steps, axis=1)], axis=1)
    lengths = s[:, -1]
    start, end = _contact(cubics, 0.0), _contact(cubics, 1.0)
    rise = cubics[:, 1:].sum(axis=1)
    quintics = join_by_quintics((0 * rise, *start), (rise, *end), lengths).quintics
    powers = (s / lengths[:, None])[..., None] ** np.arange(6)
    points = _evaluate(cubics, SAMPLES, 0) - cubics[:, :1]
    deviations = length(powers @ quintics - points)
    derivatives = powers[..., :-1] @ (quintics[:, 1:] * np.arange(1, 6)[:, None])
    unevenness = np.abs(length(derivatives / lengths[:, None, None]) - 1)
    ratios = np.maximum(deviations / tolerance, unevenness / UNEVEN).max(axis=1)
    return lengths, ratios <= TOLERANCE_SHARE


def _contact(cubics: FloatArray, x: float) -> tuple[FloatArray, FloatArray]:
    """Return unit tangents and curvature vectors [1/m] of cubics at a parameter."""
    return tangent_and_curvature(
        *(_evaluate(cubics, np.array([x]), order)[:, 0] for order in (1, 2))
    )


def _evaluate(cubics: FloatArray, x: FloatArray, order: int) -> FloatArray:
    """Return values or derivatives of cubics at parameters, (n, parameters, dimension)."""
    from numpy.polynomial.polynomial import polyder, polyval

    values = polyval(x, polyder(np.moveaxis(cubics, 1, 0), order))
    return np.asarray(np.moveaxis(values, -1, 1))
