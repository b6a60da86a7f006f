"""Tabs: where the process is off along closed contours, by geometry of their own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour.errors import InvalidInput
from armcontour.geometry import Arc, Path
from armcontour.program import Contour, Process, Program, Switch, Tabs, prepare

SQUARE = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06], [0, 0]])
CIRCLE = Path.from_segments([Arc.circle((0.05, 0.0), (0.0, 0.0))])
LASER = Switch(name="laser", on_lead=0.02, off_lead=0.01)


def cut(path: Path, tabs: Tabs, **more: object) -> Contour:
    process = Process(begin="drawn", switch=LASER, tabs=tabs, **more)  # type: ignore[arg-type]
    (contour,) = prepare(Program(moves=(Contour(path=path, name="part"),)), process).contours
    return contour


def gaps(contour: Contour) -> list[tuple[float, float]]:
    """Arc lengths between which the laser is off, by the events alone."""
    found, off = [], None
    for x in contour.events:
        if x.value is False:
            off = x.s
        elif off is not None:
            found.append((off, x.s))
            off = None
    return found


@pytest.mark.parametrize("count", [1, 3, 4])
def test_tabs_of_a_circle_are_evenly_spaced(count: int) -> None:
    contour = cut(CIRCLE, Tabs(count=count, width=1e-3))
    length = CIRCLE.length
    middles = [(a + b) / 2 for a, b in gaps(contour)]
    np.testing.assert_allclose(middles, (np.arange(count) + 0.5) * length / count, atol=1e-12)
    np.testing.assert_allclose(np.diff(gaps(contour)), 1e-3, atol=1e-12)
    leads = {(x.value, x.lead_time) for x in contour.events}
    assert leads == {(True, 0.02), (False, 0.01)}
    assert contour.events[0].value is True and contour.events[-1].value is False
    spaced = cut(CIRCLE, Tabs(spacing=length / count * 1.1, width=1e-3))
    assert gaps(spaced) == gaps(contour)


@given(st.integers(1, 12), st.floats(1e-4, 2e-3), st.booleans())
def test_tabs_keep_a_width_from_corners_starts_and_each_other(
    count: int, width: float, smooth: bool
) -> None:
    path = CIRCLE if smooth else SQUARE
    found = gaps(cut(path, Tabs(count=count, width=width)))
    assert len(found) == count
    corners = [0.0, path.length] if smooth else [0.0, 0.1, 0.16, 0.26, 0.32]
    for a, b in found:
        assert b - a == pytest.approx(width, abs=1e-12)
        assert all(s <= a - width + 1e-12 or s >= b + width - 1e-12 for s in corners)
    for (_, before), (after, _) in zip(found[:-1], found[1:], strict=True):
        assert after - before >= width - 1e-12


def test_tabs_are_at_the_same_places_of_every_lap_and_of_the_overlap() -> None:
    plain = gaps(cut(CIRCLE, Tabs(count=2, width=1e-3)))
    lap = CIRCLE.length
    # The overlap ends within the first tab of the fourth lap.
    done = cut(CIRCLE, Tabs(count=2, width=1e-3), passes=3, overlap=plain[0][0] + 5e-4)
    found = gaps(done)
    expected = [(a + k * lap, b + k * lap) for k in range(3) for a, b in plain]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    last = done.events[-2]
    assert last.value is False and last.s == pytest.approx(3 * lap + plain[0][0], abs=1e-12)


def test_tabs_lie_on_vertices_of_curves_that_are_drawn_as_polylines() -> None:
    angles = np.linspace(0, 2 * np.pi, 361)
    path = Path.polyline(0.05 * np.column_stack([np.cos(angles), np.sin(angles)]))
    found = gaps(cut(path, Tabs(count=4, width=2e-3)))
    middles = [(a + b) / 2 for a, b in found]
    np.testing.assert_allclose(middles, (np.arange(4) + 0.5) * path.length / 4, atol=1e-12)


def test_a_program_that_is_resumed_on_a_tab_goes_on_at_its_end() -> None:
    (a, b), *rest = gaps(cut(CIRCLE, Tabs(count=2, width=1e-3)))
    resumed = cut(CIRCLE, Tabs(count=2, width=1e-3), from_s=(a + b) / 2)
    assert gaps(resumed)[0] == pytest.approx((0.0, 5e-4), abs=1e-12)
    np.testing.assert_allclose(gaps(resumed)[1:], np.array(rest) - (a + b) / 2, atol=1e-12)


def test_open_contours_have_no_tabs_and_short_ones_no_room(refuses: Callable[..., None]) -> None:
    line = Path.polyline([[0, 0], [0.1, 0]])
    assert not gaps(cut(line, Tabs(count=2, width=1e-3)))
    tight = Tabs(count=30, width=5e-3)
    refuses(lambda: cut(SQUARE, tight), InvalidInput, "part", "30 tabs of 5 mm", "by_layer")
    wide = Tabs(count=1, width=0.05)
    refuses(lambda: cut(SQUARE, wide), InvalidInput, "1 tab of 50 mm")
    close = Tabs(spacing=1e-6, width=1e-7)
    refuses(lambda: cut(SQUARE, close), InvalidInput, "part", "3.2e+05 tabs", "1000")
    refuses(lambda: Tabs(width=1e-3), InvalidInput, "count or their spacing")
    refuses(lambda: Tabs(width=0.0, count=1), InvalidInput, "width")
    refuses(lambda: Tabs(width=1e-3, count=0), InvalidInput, "count")
    refuses(lambda: Tabs(width=1e-3, spacing=-1.0), InvalidInput, "spacing")
    refuses(lambda: Process(tabs=Tabs(width=1e-3, count=1)), InvalidInput, "switch")
