"""The largest distance of one curve from another: closed forms, and dense sampling."""

from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.quintics import quintic
from armcontour.geometry import ShapedPath, ShapingOutcome, SmoothCurve
from armcontour.geometry.largest_distance import (
    MeasuredCurve,
    PieceBounds,
    largest_distance,
)

# Resolution, and rounding error of distances [m].
FINE = 1e-11
ROUNDING = 1e-15
SQUARE = ac.Path.polyline([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1], [0, 0]])


def distances(path, other, resolution=FINE):
    """Largest distances in both directions."""
    curves = MeasuredCurve.of_path(path), MeasuredCurve.of_path(other)
    return [largest_distance(*x, resolution) for x in (curves, curves[::-1])]


@pytest.mark.parametrize(
    ("path", "other", "there", "back"),
    [
        # Circles around one centre are at the same distance everywhere.
        (ac.Path.circle([0, 0], 0.026), ac.Path.circle([0, 0], 0.02575), 0.25e-3, 0.25e-3),
        (ac.Path.circle([0, 0], 0.03), ac.Path.circle([1e-3, 0], 0.03), 1e-3, 1e-3),
        # Points of a cut corner are nearer to the lines than the corner is to the cut.
        (
            ac.Path.polyline([[0, 0], [0.08, 0], [0.1, 0.02], [0.1, 0.1]]),
            ac.Path.polyline([[0, 0], [0.1, 0], [0.1, 0.1]]),
            0.01,
            0.01 * np.sqrt(2),
        ),
        # The nearest point jumps to the other side in the middle of the square.
        (ac.Path.polyline([[0.02, 0.05], [0.08, 0.05]]), SQUARE, 0.05, np.hypot(0.02, 0.05)),
    ],
)
def test_distances_are_those_of_closed_forms(path, other, there, back):
    for found, expected in zip(distances(path, other), (there, back), strict=True):
        assert found.measured <= expected + ROUNDING
        assert expected - ROUNDING <= found.bound <= expected + FINE + ROUNDING


def test_distance_of_equal_paths_is_zero_up_to_the_resolution():
    for found in distances(SQUARE, SQUARE):
        assert found.measured == 0.0
        assert found.bound <= FINE


def test_bounds_of_quintics_contain_their_derivatives():
    rng = np.random.default_rng(5)
    begin, end = ([rng.normal(size=(3, 2)) for _ in range(3)] for _ in range(2))
    breaks = np.array([0.0, 0.5, 0.8, 2.0])
    coefficients = quintic(np.diff(breaks), begin, end)
    bounds = PieceBounds.of_quintics(breaks, coefficients)
    x = np.linspace(0, 1, 2001)
    for i, width in enumerate(np.diff(breaks)):
        for k, bound in ((1, bounds.rate[i]), (2, bounds.bend[i])):
            polynomial = np.polynomial.Polynomial
            parts = [polynomial(c).deriv(k)(x) / width**k for c in coefficients[i].T]
            largest = np.linalg.norm(parts, axis=0).max()
            assert largest <= bound * (1 + 1e-12) < 10 * largest


def test_curve_at_its_tolerance_everywhere_is_within_it():
    """The curve of quintics and its arcs are 0.25 mm inside of a circle."""
    tolerance = 0.25e-3
    drawn = ac.Path.circle([0, 0], 0.026)
    inner = ac.Path.circle([0, 0], 0.026 - tolerance)
    breaks = np.linspace(0, inner.length, 65)
    ends = tuple(inner(breaks, k) for k in range(3))
    begin = [x[:-1] for x in ends]
    end = [x[1:] for x in ends]
    curve = SmoothCurve(
        breaks=breaks,
        coefficients=quintic(np.diff(breaks), begin, end),
        spreads=np.full(64, 2.5e-8),
    )
    arcs = inner.locate((breaks[:-1] + breaks[1:]) / 2)
    starts = inner.breaks[arcs]
    shaped = ShapedPath(
        segments=inner.segments.cut(arcs, breaks[:-1] - starts, breaks[1:] - starts),
        objective=drawn,
        places=[[0, 0], [drawn.length, inner.length]],
        tolerance=tolerance,
        outcome=ShapingOutcome(start="arcs", durations={"shaped": 1.0}),
        curve=curve,
    )
    assert shaped.deviation == pytest.approx(tolerance, rel=1e-7)
    # A curve that is not within its tolerance is not said to be.
    assert replace(shaped, tolerance=0.2e-3).deviation == pytest.approx(tolerance, rel=1e-7)
