"""Shaped paths: the curve, corresponding arc lengths, and invalid shaped paths."""

import dataclasses

import numpy as np
import pytest
from tests.geometry.tables import refused

import armcontour as ac
from armcontour.core.quintics import quintic
from armcontour.geometry import ShapedPath, ShapingOutcome, SmoothCurve
from armcontour.geometry.biarcs import make_biarcs
from armcontour.geometry.segments import Segments

OUTCOME = ShapingOutcome(start="arcs", durations={"arcs": 2.0, "stops": 3.0, "shaped": 1.5})


def clothoid(n):
    """Arc lengths, points, tangents and bends of a curve whose curvature is 40 s."""
    s = np.linspace(0, 0.3, 3001)
    angle = 20 * s**2
    tangents = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middle = 20 * ((s[1:] + s[:-1]) / 2) ** 2
    # Simpson's rule.
    mean = np.stack([np.cos(middle), np.sin(middle)], axis=1)
    steps = (tangents[:-1] + 4 * mean + tangents[1:]) / 6 * np.diff(s)[:, None]
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    bends = 40 * s[:, None] * np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
    k = np.linspace(0, 3000, n + 1).astype(int)
    return s[k], points[k], tangents[k], bends[k]


@pytest.fixture(scope="module")
def shaped():
    _, points, tangents, bends = clothoid(30)
    first, second = make_biarcs(points[:-1], tangents[:-1], points[1:], tangents[1:])
    segments = Segments.join([first, second])[np.arange(60).reshape(2, 30).T.ravel()]
    breaks = segments.breaks[::2]
    coefficients = quintic(
        np.diff(breaks),
        (points[:-1], tangents[:-1], bends[:-1]),
        (points[1:], tangents[1:], bends[1:]),
    )
    objective = ac.Path.polyline(points[::10])
    places = np.stack([np.linspace(0, objective.length, 31), breaks], axis=1)
    return ShapedPath(
        segments=segments,
        objective=objective,
        places=places,
        tolerance=1e-3,
        outcome=OUTCOME,
        curve=SmoothCurve(breaks=breaks, coefficients=coefficients, spreads=np.zeros(30)),
    )


def test_the_curvature_is_that_of_the_curve_and_not_of_its_arcs(shaped):
    s = np.linspace(0, shaped.length, 701)
    bend = np.linalg.norm(shaped(s, 2), axis=1)
    # The lengths of the arcs are those of the curve up to the fourth power of their turn.
    np.testing.assert_allclose(bend, 40 * s, atol=2e-3)
    arcs = shaped.curvatures[shaped.locate(s)]
    assert np.abs(arcs - 40 * s).max() > 0.05
    # Points of the arcs and of the curve are less than a micrometre apart.
    distances = np.linalg.norm(shaped(s) - ac.Path(segments=shaped.segments)(s), axis=1)
    assert 0 < distances.max() < 1e-6


def test_places_map_arc_lengths_of_the_objective_to_the_shaped_path(shaped):
    places_on_path = shaped.place([0.0, shaped.objective.length / 2, shaped.objective.length])
    np.testing.assert_allclose(places_on_path, [0, shaped.breaks[30], shaped.length], atol=1e-12)
    scale = np.array([shaped.objective.length, shaped.length])
    back = [[0, 0], [0.1, 0.2], [0.05, 0.25], [1, 1]]
    for places in (scale * [[0, 0], [1, 0.1]], scale * back, [0, 1]):
        refused((lambda x=places: dataclasses.replace(shaped, places=x), "places"))
