"""What makes no shaped path, refused in one sentence with the value and what is allowed."""

from __future__ import annotations

import math

import numpy as np
import pytest

import armcontour as ac

LINES = [(0.35, 0.10), (0.41, 0.15), (0.28, 0.30), (0.35, 0.35)]


@pytest.mark.parametrize(
    ("wrong", "words", "data"),
    [
        ({"tolerance": -1e-3}, ("tolerance must not be negative", "-0.001 m"), {}),
        ({"tolerance": math.nan}, ("tolerance must be finite",), {}),
        ({"line_tolerance": 1e-4}, ("line_tolerance", "without zone"), {}),
        ({"zone": 0.02}, ("zone", "without line_tolerance"), {}),
        (
            {"line_tolerance": 2e-3, "zone": 0.02},
            ("line_tolerance of 0.002 m", "above the tolerance of 0.001 m"),
            {"needed": 2e-3, "allowed": 1e-3},
        ),
        (
            {"line_tolerance": 1e-4, "zone": 5e-4},
            ("zone of 0.0005 m", "below the tolerance of 0.001 m"),
            {"needed": 1e-3, "allowed": 5e-4},
        ),
        ({"iterations": -1}, ("iterations",), {}),
        ({"iterations": 2.5}, ("iterations",), {}),
    ],
)
def test_wrong_wishes_are_refused(arm, limits, refuses, wrong, words, data):
    options = {"tolerance": 1e-3, **wrong}
    for call in (
        lambda: ac.shape(ac.Path.polyline(LINES), arm, limits, **options),
        lambda: ac.plan(ac.Path.polyline(LINES), arm, limits, method="shaped", **options),
    ):
        refuses(call, ac.InvalidInput, *words, **data)


@pytest.mark.parametrize("gap", [2e-6, 2e-4])
def test_a_stretch_that_is_too_short_bears_half_of_its_length(arm, limits, gap):
    # A vertex that was drawn twice does not keep the rest from being shaped.
    twice = ac.Path.polyline([*LINES[:2], (LINES[1][0] + gap, LINES[1][1]), *LINES[2:]])
    found = ac.shape(twice, arm, limits, tolerance=1e-3)
    assert found.outcome.durations["shaped"] < min(
        x for name, x in found.outcome.durations.items() if name != "shaped"
    )
    assert found.objective.project(found(np.linspace(0, found.length, 20_001))).distance.max() < (
        1e-3 + 1e-9
    )
    short = slice(*twice.breaks[1:3])
    near = found.project(twice(np.array([short.start, short.stop]))).distance
    assert (near <= gap / 2 + 1e-9).all()


def test_each_contour_has_the_tolerance_that_its_lines_bear(arm, limits):
    short = ac.Path.polyline([(0.2, 0.2), (0.201, 0.2), (0.201, 0.21)])
    program = ac.Program(
        moves=(ac.Contour(path=ac.Path.polyline(LINES)), ac.Contour(path=short, name="notch"))
    )
    found = ac.shape(program, arm, limits, tolerance=2e-3, iterations=3)
    off = found.contours[1].path.project(short(short.breaks)).distance
    assert off[1] <= 0.5e-3 + 1e-9


def test_short_chords_of_a_curve_do_not_bound_the_tolerance(arm, limits):
    angle = np.linspace(0, np.pi, 200)
    chords = np.stack([0.3 + 0.02 * np.cos(angle), 0.2 + 0.02 * np.sin(angle)], axis=1)
    found = ac.shape(ac.Path.polyline(chords), arm, limits, tolerance=1e-3, iterations=0)
    assert found.outcome.durations["shaped"] <= min(found.outcome.durations.values())


def test_traced_paths_and_missing_tolerances_are_refused(arm, limits, refuses):
    path = ac.Path.polyline(LINES)
    refuses(
        lambda: ac.plan(ac.trace(path, arm), arm, limits, method="shaped", tolerance=1e-3),
        ac.InvalidInput,
        "traced already",
    )
    refuses(
        lambda: ac.plan(path, arm, limits, method="shaped"), ac.InvalidInput, "needs a tolerance"
    )
    refuses(
        lambda: ac.plan(path, arm, limits, method="shaped", tolerance=1e-3, duration=9.0),
        ac.InvalidInput,
        "duration",
    )
