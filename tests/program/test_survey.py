"""Facts of contours: sizes, nesting, corners."""

from __future__ import annotations

import numpy as np
import pytest

from armcontour.geometry import Arc, Path
from armcontour.program import Contour, Program
from armcontour.program.survey import extent_of, survey

OUTER = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06], [0, 0]])
HOLE = Path.from_segments([Arc(start=[0.06, 0.03], center=[0.05, 0.03], angle=-2 * np.pi)])
MARK = Path.polyline([[0.045, 0.03], [0.055, 0.03]])
AWAY = Path.polyline([[0.2, 0.0], [0.2, 0.01], [0.2, 0.03]])


def test_what_a_drawing_consists_of() -> None:
    moves = (
        Contour(path=OUTER, name="outer", layer="CUT"),
        Contour(path=HOLE, name="hole", layer="CUT"),
        Contour(path=MARK, name="mark", layer="MARK"),
        Contour(path=AWAY),
    )
    outer, hole, mark, away = survey(Program(moves=moves))
    assert [x.number for x in (outer, hole, mark, away)] == [1, 2, 3, 4]
    assert [x.inside for x in (outer, hole, mark, away)] == [None, 1, 2, None]
    assert [x.closed for x in (outer, hole, mark, away)] == [True, True, False, False]
    assert [x.corners for x in (outer, hole, mark, away)] == [3, 0, 0, 0]
    assert (outer.lines, outer.arcs, hole.lines, hole.arcs) == (4, 0, 0, 1)
    assert outer.area == pytest.approx(0.006, rel=1e-12)
    assert hole.area == pytest.approx(-np.pi * 1e-4, rel=1e-9)
    np.testing.assert_allclose(hole.extent, [[0.04, 0.02], [0.06, 0.04]], atol=1e-15)
    np.testing.assert_allclose(extent_of((outer, away)), [[0, 0], [0.2, 0.06]], atol=1e-15)
    assert (outer.name, mark.layer, away.name) == ("outer", "MARK", "")
