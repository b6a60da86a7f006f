"""Tabs, at which the process is off along closed contours."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.geometry.tables import each, refused

from armcontour.geometry import Arc, Path
from armcontour.program import Contour, Process, Program, Switch, Tabs, prepare

SQUARE = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06], [0, 0]])
CIRCLE = Path(segments=[Arc.circle((0.05, 0.0), (0.0, 0.0))])
LASER = Switch(name="laser", on_lead=0.02, off_lead=0.01)
TWO = Tabs(count=2, width=1e-3)


def cut(path, tabs, **more):
    process = Process(begin="drawn", switch=LASER, tabs=tabs, **more)
    (contour,) = prepare(Program(moves=(Contour(path=path, name="part"),)), process).contours
    return contour


def gaps(contour):
    """Arc lengths between which the laser is off, by the events alone."""
    intervals = []
    gap_start = None
    for x in contour.events:
        if x.value is False:
            gap_start = x.s
        elif gap_start is not None:
            intervals.append((gap_start, x.s))
            gap_start = None
    return intervals


def check_even(path, tabs):
    middles = [(a + b) / 2 for a, b in gaps(cut(path, tabs))]
    expected = (np.arange(tabs.count) + 0.5) * path.length / tabs.count
    np.testing.assert_allclose(middles, expected, atol=1e-12)


@each("count", [1, 3, 4])
def test_tabs_on_a_circle_are_evenly_spaced(count):
    contour = cut(CIRCLE, tabs := Tabs(count=count, width=1e-3))
    check_even(CIRCLE, tabs)
    np.testing.assert_allclose(np.diff(gaps(contour)), 1e-3, atol=1e-12)
    assert {(x.value, x.lead_time) for x in contour.events} == {(True, 0.02), (False, 0.01)}
    assert contour.events[0].value is True and contour.events[-1].value is False
    spaced = cut(CIRCLE, Tabs(spacing=CIRCLE.length / count * 1.1, width=1e-3))
    assert gaps(spaced) == gaps(contour)


@given(st.integers(1, 12), st.floats(1e-4, 2e-3), st.booleans())
def test_tabs_keep_a_width_from_corners_starts_and_each_other(count, width, smooth):
    path = CIRCLE if smooth else SQUARE
    intervals = gaps(cut(path, Tabs(count=count, width=width)))
    assert len(intervals) == count
    corners = [0.0, path.length] if smooth else [0.0, 0.1, 0.16, 0.26, 0.32]
    for a, b in intervals:
        assert b - a == pytest.approx(width, abs=1e-12)
        assert all(s <= a - width + 1e-12 or s >= b + width - 1e-12 for s in corners)
    for (_, before), (after, _) in zip(intervals[:-1], intervals[1:], strict=True):
        assert after - before >= width - 1e-12


def test_every_lap_and_polyline_and_resumed_program_has_tabs():
    plain = gaps(cut(CIRCLE, TWO))
    lap = CIRCLE.length
    # The overlap ends within the first tab of the fourth lap.
    cut_contour = cut(CIRCLE, TWO, passes=3, overlap=plain[0][0] + 5e-4)
    expected = [(a + k * lap, b + k * lap) for k in range(3) for a, b in plain]
    np.testing.assert_allclose(gaps(cut_contour), expected, atol=1e-12)
    last = cut_contour.events[-2]
    assert last.value is False and last.s == pytest.approx(3 * lap + plain[0][0], abs=1e-12)
    angles = np.linspace(0, 2 * np.pi, 361)
    path = Path.polyline(0.05 * np.column_stack([np.cos(angles), np.sin(angles)]))
    check_even(path, Tabs(count=4, width=2e-3))
    (a, b), *rest = gaps(cut(CIRCLE, TWO))
    resumed = gaps(cut(CIRCLE, TWO, resume_at=(a + b) / 2))
    assert resumed[0] == pytest.approx((0.0, 5e-4), abs=1e-12)
    np.testing.assert_allclose(resumed[1:], np.array(rest) - (a + b) / 2, atol=1e-12)


def test_open_contours_have_no_tabs_and_too_short_contours_are_refused():
    assert not gaps(cut(Path.polyline([[0, 0], [0.1, 0]]), TWO))
    close = Tabs(spacing=1e-6, width=1e-7)
    refused(
        (lambda: cut(SQUARE, Tabs(count=30, width=5e-3)), "part", "30 tabs of 5 mm"),
        (lambda: cut(SQUARE, Tabs(count=1, width=0.05)), "1 tab of 50 mm"),
        (lambda: cut(SQUARE, close), "part", "3.2e+05 tabs", "1000"),
        (lambda: Tabs(width=1e-3), "exactly one of count and spacing"),
        (lambda: Tabs(width=0.0, count=1), "width"),
        (lambda: Tabs(width=1e-3, count=0), "count"),
        (lambda: Tabs(width=1e-3, spacing=-1.0), "spacing"),
        (lambda: Process(tabs=Tabs(width=1e-3, count=1)), "switch"),
    )
