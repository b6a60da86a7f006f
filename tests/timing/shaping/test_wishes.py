"""What makes no shaped path, refused in one sentence with the value and what is allowed."""

import functools
import math

import numpy as np

import armcontour as ac

LINES = [(0.35, 0.10), (0.41, 0.15), (0.28, 0.30), (0.35, 0.35)]


def test_wrong_wishes_are_refused(arm, limits, refuses):
    line = {"line_tolerance": 2e-3, "zone": 0.02}
    small = {"line_tolerance": 1e-4, "zone": 5e-4}
    for wrong, data in (
        *(({"tolerance": x}, {}) for x in (-1e-3, math.nan)),
        ({"line_tolerance": 1e-4}, {}),
        ({"zone": 0.02}, {}),
        (line, {"needed": 2e-3, "allowed": 1e-3}),
        (small, {"needed": 1e-3, "allowed": 5e-4}),
        *(({"iterations": x}, {}) for x in (-1, 2.5)),
    ):
        options = {"tolerance": 1e-3, **wrong}
        for call in (ac.shape, functools.partial(ac.plan, method="shaped")):
            own = functools.partial(call, ac.Path.polyline(LINES), arm, limits, **options)
            refuses(own, ac.InvalidInput, **data)
    path = ac.Path.polyline(LINES)
    traced = ac.trace(path, arm)
    for given, options in (
        (traced, {"tolerance": 1e-3}),
        (path, {}),
        (path, {"tolerance": 1e-3, "duration": 9.0}),
    ):
        own = functools.partial(ac.plan, given, arm, limits, method="shaped", **options)
        refuses(own, ac.InvalidInput)


def test_a_stretch_that_is_too_short_bears_half_of_its_length(arm, limits):
    # A vertex that was drawn twice does not keep the rest from being shaped.
    for gap in (2e-6, 2e-4):
        twice = ac.Path.polyline([*LINES[:2], (LINES[1][0] + gap, LINES[1][1]), *LINES[2:]])
        found = ac.shape(twice, arm, limits, tolerance=1e-3, iterations=8)
        durations = dict(found.outcome.durations)
        assert durations.pop("shaped") < min(durations.values()), gap
        off = found.objective.project(found(np.linspace(0, found.length, 20_001))).distance
        assert off.max() < 1e-3 + 1e-9
        near = found.project(twice(twice.breaks[1:3])).distance
        assert (near <= gap / 2 + 1e-9).all(), gap


def test_each_contour_has_the_tolerance_that_its_lines_bear_whatever_chords_of_curves(arm, limits):
    short = ac.Path.polyline([(0.2, 0.2), (0.201, 0.2), (0.201, 0.21)])
    program = ac.Program(
        moves=(ac.Contour(path=ac.Path.polyline(LINES)), ac.Contour(path=short, name="notch"))
    )
    found = ac.shape(program, arm, limits, tolerance=2e-3, iterations=3)
    off = found.contours[1].path.project(short(short.breaks)).distance
    assert off[1] <= 0.5e-3 + 1e-9
    angle = np.linspace(0, np.pi, 200)
    chords = np.stack([0.3 + 0.02 * np.cos(angle), 0.2 + 0.02 * np.sin(angle)], axis=1)
    found = ac.shape(ac.Path.polyline(chords), arm, limits, tolerance=1e-3, iterations=0)
    assert found.outcome.durations["shaped"] <= min(found.outcome.durations.values())
