"""Lines, arcs and demands: what they refuse."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac


@pytest.mark.parametrize(
    ("demand", "words"),
    [
        ({"speed": 0.0}, ("segment speed", "above zero", "0 m/s")),
        ({"speed": -1.0}, ("segment speed", "above zero", "-1 m/s")),
        ({"speed": np.nan}, ("segment speed", "finite", "nan")),
        ({"speed": [1.0, 2.0]}, ("segment speed", "one number", "not an array of 2")),
        ({"tolerance": -1e-3}, ("segment tolerance", "negative", "-0.001 m")),
        ({"tolerance": np.inf}, ("segment tolerance", "finite", "inf")),
    ],
)
def test_demand_refuses(demand, words, refuses):
    refuses(lambda: ac.Demand(**demand), ac.InvalidInput, *words)


def test_zero_tolerance_is_a_demand():
    assert ac.Demand(tolerance=0.0).tolerance == 0.0


GOOD = ac.Line(start=(0, 0), end=(1, 0))
GOOD_3D = ac.Line(start=(0, 0, 0), end=(1, 0, 0))


@pytest.mark.parametrize(
    ("segments", "words", "data"),
    [
        (
            [GOOD, ac.Line(start=(1, 0), end=(1, 0))],
            ("Segment 2", "zero length", "leave it out"),
            {"index": 1, "point": (1, 0)},
        ),
        (
            [ac.Line(start=(0, np.nan), end=(1, 0))],
            ("start of segment 1", "finite", "nan at index 1"),
            {"index": 1},
        ),
        ([ac.Line(start=(0, 0), end=("a", 0))], ("end of segment 1", "numbers in m"), {}),
        (
            [GOOD, ac.Line(start=(1, 0), end=(1, 0, 0))],
            ("points of segment 2", "both have 2 or both have 3"),
            {"index": 1},
        ),
        ([ac.Line(start=(0,), end=(1,))], ("points of segment 1",), {"index": 0}),
        (
            [GOOD, ac.Arc(start=(1, 0), center=(1, 0), angle=1.0)],
            ("Segment 2", "radius 0 m"),
            {"index": 1},
        ),
        (
            [ac.Arc(start=(1, 0), center=(0, 0), angle=0.0)],
            ("Segment 1", "angle 0 rad"),
            {"index": 0},
        ),
        (
            [ac.Arc(start=(1, 0), center=(0, 0), angle=-6.3)],
            ("Segment 1", "between 0 and 2 pi", "-6.3 rad"),
            {"index": 0},
        ),
        (
            [ac.Arc(start=(1, 0), center=(0, 0), angle=np.inf)],
            ("angle of segment 1", "finite"),
            {},
        ),
        (
            [ac.Arc(start=(1, 0), center=(0, 0), angle=1.0, normal=(0, 0, 1))],
            ("Segment 1", "plane", "no normal"),
            {},
        ),
        (
            [GOOD_3D, ac.Arc(start=(1, 0, 0), center=(1, 1, 0), angle=1.0)],
            ("Segment 2", "needs its normal"),
            {"index": 1},
        ),
        (
            [ac.Arc(start=(1, 0, 0), center=(0, 0, 0), angle=1.0, normal=(1, 0, 1))],
            ("normal of segment 1", "right angles"),
            {"index": 0},
        ),
        (
            [ac.Arc(start=(1, 0, 0), center=(0, 0, 0), angle=1.0, normal=(0, 0, 0))],
            ("normal of segment 1",),
            {"index": 0},
        ),
        ([GOOD, GOOD_3D], ("same number of coordinates",), {}),
        ([], ("at least one segment",), {}),
        ([GOOD, ((1, 0), (2, 0))], ("Segment 2", "Line or an Arc", "tuple"), {"index": 1}),
    ],
)
def test_segments_refused(segments, words, data, refuses):
    refuses(lambda: ac.Path.from_segments(segments), ac.InvalidInput, *words, **data)
