"""The tool's path beside contours: against formulas, and the judge of the soak."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from soak import kerf as judge

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.geometry import Arc, Demand, Line, Path
from armcontour.geometry.cutting import reverse_path
from armcontour.program import Contour, Event, Lead, Process, Program, Rapid, prepare

SQUARE = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06], [0, 0]])
DUMBBELL = Path.polyline(
    [
        [0, 0],
        [0.04, 0],
        [0.04, 0.018],
        [0.06, 0.018],
        [0.06, 0],
        [0.1, 0],
        [0.1, 0.04],
        [0.06, 0.04],
        [0.06, 0.022],
        [0.04, 0.022],
        [0.04, 0.04],
        [0, 0.04],
        [0, 0],
    ]
)
BEND = Path.polyline([[0, 0], [0.05, 0], [0.05, 0.05]])


def circle(x: float, y: float, radius: float, **values: object) -> Contour:
    path = Path.from_segments([Arc.circle((x + radius, y), (x, y))])
    return Contour(path=path, **values)  # type: ignore[arg-type]


def cut(*contours: Contour | Path, kerf: float, **values: object) -> Program:
    moves = tuple(Contour(path=x) if isinstance(x, Path) else x for x in contours)
    return prepare(Program(moves=moves), Process(kerf=kerf, begin="drawn", **values))  # type: ignore[arg-type]


def area(path: Path) -> float:
    points = path(np.linspace(0, path.length, 20_001))
    x, y = points.T
    return abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))) / 2


@pytest.mark.parametrize("turned", [False, True])
def test_outside_lines_stay_lines_and_vertices_become_arcs(turned: bool) -> None:
    d = 1e-4
    (done,) = cut(reverse_path(SQUARE) if turned else SQUARE, kerf=2 * d).contours
    assert done.closed and len(done.path) == 8
    assert sorted(done.path.curvatures.tolist()) == pytest.approx([0] * 4 + [1 / d] * 4)
    assert done.path.length == pytest.approx(0.32 + 2 * np.pi * d, abs=1e-14)
    assert np.linalg.norm(done.path(0.0)) == pytest.approx(d, abs=1e-12)
    assert not (done.path.turns > 1e-9).any()


def test_inside_corners_stay_sharp_and_arcs_stay_arcs_around_their_centres() -> None:
    outline = circle(0, 0, 0.2)
    hole = Contour(path=SQUARE)
    ring = circle(-0.1, 0, 0.03)
    inner, small, outer = cut(hole, ring, outline, kerf=0.002).contours
    np.testing.assert_allclose(np.ptp(inner.path.vertices, axis=0), [0.098, 0.058], atol=1e-15)
    assert len(inner.path) == 4
    assert 1 / small.path.curvatures == pytest.approx([0.029], abs=1e-15)
    assert 1 / outer.path.curvatures == pytest.approx([0.201], abs=1e-15)
    center = outer.path.starts[0] + outer.path.normals[0] / outer.path.curvatures[0]
    np.testing.assert_allclose(center, [0, 0], atol=1e-15)


def test_what_a_kerf_parts_becomes_several_contours_with_names_of_their_own() -> None:
    outline = circle(0.05, 0.02, 0.2, name="outline")
    hole = Contour(path=DUMBBELL, name="slot")
    names = [x.name for x in cut(outline, hole, kerf=0.005).contours]
    assert names == ["slot/1", "slot/2", "outline"]
    two = cut(outline, hole, kerf=0.005).contours[:2]
    # A square, and what the tool reaches into the mouth, between circles around its vertices.
    d, half = 2.5e-3, 2e-3
    mouth = 2 * d * half - half * np.sqrt(d**2 - half**2) - d**2 * np.arcsin(half / d)
    assert [area(x.path) for x in two] == pytest.approx([0.035**2 + mouth] * 2, abs=1e-10)
    assert np.linalg.norm(two[0].path(0.0) - [0.0025, 0.0025]) < 1e-12
    assert [x.name for x in cut(outline, hole, kerf=0.003).contours] == ["slot", "outline"]


def test_what_vanishes_is_refused_with_the_largest_kerf_that_fits(
    refuses: Callable[..., None],
) -> None:
    outline, hole = circle(0, 0, 0.1), circle(0, 0, 0.01, name="hole 7")
    refuses(
        lambda: cut(outline, hole, kerf=0.03),
        InvalidInput,
        "contour hole 7: a kerf of 30 mm leaves nothing",
        "that fits is 20 mm",
    )
    assert len(cut(outline, hole, kerf=0.0199).contours) == 2


def test_a_kerf_is_inside_of_holes_and_refused_there_on_every_layer() -> None:
    outline = circle(0, 0, 0.05, layer="CUT")
    for layer in ("CUT", "HOLES"):
        hole = circle(0.01, 0, 0.0045, name="hole", layer=layer)
        inner, outer = cut(outline, hole, kerf=1.2e-3).contours
        assert 1 / inner.path.curvatures == pytest.approx([3.9e-3], abs=1e-15)
        assert 1 / outer.path.curvatures == pytest.approx([50.6e-3], abs=1e-15)
        with pytest.raises(InvalidInput) as caught:
            cut(outline, hole, kerf=12e-3)
        assert caught.value.allowed == pytest.approx(9e-3, rel=1e-3)
        near = circle(0.101, 0, 0.05, layer=layer)
        with pytest.raises(InvalidInput):
            cut(outline, near, kerf=1.2e-3)


def test_layers_may_have_a_kerf_of_their_own() -> None:
    outline, hole = circle(0, 0, 0.05, layer="A"), circle(0, 0, 0.02, layer="B")
    by_layer = {"B": {"kerf": 4e-3}}
    inner, outer = cut(outline, hole, kerf=1e-3, by_layer=by_layer).contours
    radii = [1 / x.path.curvatures[0] for x in (inner, outer)]
    assert radii == pytest.approx([0.018, 0.0505], abs=1e-15)
    other = circle(0.1025, 0, 0.05, layer="B")
    assert len(cut(outline, other, kerf=1e-3).contours) == 2
    with pytest.raises(InvalidInput):
        cut(outline, other, kerf=1e-3, by_layer=by_layer)


def test_contours_that_cross_themselves_or_are_too_near_are_refused(
    refuses: Callable[..., None],
) -> None:
    eight = Path.polyline([[0, 0], [0.1, 0.1], [0.1, 0], [0, 0.1], [0, 0]])
    refuses(lambda: cut(eight, kerf=1e-3), InvalidInput, "contour 1 crosses", "(50, 50) mm")
    a, b = circle(0, 0, 0.05, name="a"), circle(0.1001, 0, 0.05, name="b")
    words = "contour a and contour b cross, or are nearer to each other than the kerf of 0.2 mm"
    refuses(lambda: cut(a, b, kerf=2e-4), InvalidInput, words)
    assert len(cut(a, b, kerf=0.99e-4).contours) == 2
    across = circle(0.05, 0, 0.05, name="c")
    refuses(lambda: cut(a, across, kerf=2e-3), InvalidInput, "contour a and contour c cross")
    # An island that the cut of its hole goes around.
    rings = [circle(0, 0, r, name=str(r)) for r in (0.05, 0.02, 0.0199)]
    refuses(lambda: cut(*rings, kerf=2e-3), InvalidInput, "0.02", "0.0199", "nearer")
    assert len(cut(*rings, kerf=0.9e-4).contours) == 3
    led = Contour(path=SQUARE, work=(0.01, 0.1))
    refuses(lambda: cut(led, kerf=1e-3), InvalidInput, "leads already")
    refuses(lambda: Process(kerf=-1e-3), InvalidInput, "kerf")
    refuses(lambda: Process(kerf_side="top"), InvalidInput, "kerf_side")


def test_open_contours_have_no_waste_and_stay_unless_a_side_is_given() -> None:
    mark = Contour(path=BEND, name="mark")
    done = cut(mark, circle(0, 0, 0.2), kerf=2e-3)
    assert any(x.path is BEND for x in done.contours)
    assert done.notes == (
        "contour mark stays where drawn, because an open contour has no waste side: kerf_side left "
        "or right puts the cut beside open contours too.",
    )
    left = cut(mark, kerf=2e-3, kerf_side="left").path
    np.testing.assert_allclose(left.vertices, [[0, 1e-3], [0.049, 1e-3], [0.049, 0.05]], atol=1e-15)
    right = cut(mark, kerf=2e-3, kerf_side="right").path
    assert len(right) == 3 and right.curvatures[1] == pytest.approx(1e3)
    np.testing.assert_allclose(right([0, right.length]), [[0, -1e-3], [0.051, 0.05]], atol=1e-15)


def test_a_cut_beside_an_open_contour_keeps_clear_of_its_ends() -> None:
    hook = Path.polyline([(0, 0), (0.04, 0), (0.04, 0.02), (0.02, 0.02), (0.02, 0.003)])
    with pytest.raises(InvalidInput) as caught:
        cut(hook, kerf=8e-3, kerf_side="left")
    # Half the kerf on each side of the gap.
    assert caught.value.allowed == pytest.approx(3e-3, rel=1e-3)
    for kerf, side in ((2.99e-3, "left"), (2.99e-3, "right")):
        done = cut(hook, kerf=kerf, kerf_side=side).path
        away = hook.project(done(np.linspace(0, done.length, 999))).distance
        assert away.min() == pytest.approx(kerf / 2, abs=1e-12)


def test_random_cuts_beside_open_contours_keep_their_distance_or_are_refused() -> None:
    rng = np.random.default_rng(3)
    refused = 0
    for _ in range(150):
        points = np.cumsum(rng.uniform(-0.02, 0.02, (int(rng.integers(3, 7)), 2)), axis=0)
        kerf = float(rng.choice([1e-3, 4e-3, 8e-3]))
        try:
            done = cut(Path.polyline(points), kerf=kerf, kerf_side="left").path
        except InvalidInput:
            refused += 1
            continue
        found = done(np.linspace(0, done.length, 500))
        a, b = points[:-1], points[1:]
        share = ((found[:, None] - a) * (b - a)).sum(2) / ((b - a) ** 2).sum(1)
        foot = a + np.clip(share, 0, 1)[:, :, None] * (b - a)
        assert np.linalg.norm(found[:, None] - foot, axis=2).min() >= kerf / 2 - 1e-9
    assert 10 < refused < 120


@pytest.mark.parametrize("held", ["pointing", "following"])
def test_in_space_the_cut_lies_in_the_plane_of_the_contour_and_the_tool_keeps_its_way(
    held: str,
) -> None:
    frame = ac.Frame.rpy((0.4, 0.1, 0.2), (0.4, -0.3, 1.0))
    up = frame.rotation[:, 2]
    flat = cut(SQUARE, kerf=2e-3)
    lifted = SQUARE if held == "pointing" else SQUARE
    placed = Program(moves=(Contour(path=lifted),)).placed(frame).path
    placed = placed.pointing(-up) if held == "pointing" else placed.following_tangent(up)
    done = cut(placed, kerf=2e-3, up=up).path
    expected = flat.placed(frame).path
    apart = expected.project(done(np.linspace(0, done.length, 99))).distance
    assert apart.max() < 1e-12 and done.length == pytest.approx(expected.length, abs=1e-12)
    places = np.linspace(0.001, done.length - 1e-3, 50)
    axes = done.orientation(places)
    np.testing.assert_allclose(axes[:, :, 2], np.tile(-up, (50, 1)), atol=1e-12)
    if held == "following":
        np.testing.assert_allclose(axes[:, :, 0], done(places, 1), atol=1e-9)


def test_a_contour_that_is_not_flat_is_refused(refuses: Callable[..., None]) -> None:
    ramp = Path.polyline([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0.01], [0, 0, 0]])
    refuses(lambda: cut(ramp, kerf=1e-3), InvalidInput, "contour 1 leaves the plane")


def test_speeds_tolerances_events_and_rapids_come_along() -> None:
    demand = Demand(speed=0.02, tolerance=1e-3)
    corner = (0.1, 0.06)
    path = Path.from_segments(
        [
            Line(start=(0, 0), end=(0.1, 0), demand=demand),
            Line(start=(0.1, 0), end=corner),
            Line(start=corner, end=(0, 0)),
        ]
    )
    events = (Event(name="gas", s=0.05), Event(name="gas", value=False, s=path.length))
    away = Path.polyline([[0, 0], [-0.1, 0]])
    moves = (
        Rapid(path=Path.polyline([[-0.1, 0], [0, 0]])),
        Contour(path=path, events=events, keep_start=True),
        Rapid(path=away),
    )
    done = prepare(Program(moves=moves), Process(kerf=2e-3))
    before, contour, after = done.moves
    assert isinstance(before, Rapid) and isinstance(contour, Contour) and isinstance(after, Rapid)
    below = np.abs(contour.path(contour.path.breaks[:-1] + 1e-6)[:, 1] + 1e-3) < 1e-9
    assert (contour.path.speeds[below] == 0.02).all() and below.sum() >= 1
    on, off = contour.events
    np.testing.assert_allclose(contour.path(on.s), [0.05, -1e-3], atol=1e-12)
    assert off.s == contour.path.length
    np.testing.assert_array_equal(before.path(before.path.length), contour.path(0.0))
    np.testing.assert_allclose(after.path(0.0), contour.path(contour.path.length), atol=1e-9)


def test_a_kerf_of_zero_says_that_the_process_cuts() -> None:
    outline, hole = circle(0, 0, 0.05, name="outline"), circle(0, 0, 0.02, name="hole")
    done = cut(outline, hole, kerf=0.0)
    assert [x.name for x in done.contours] == ["hole", "outline"]
    assert done.contours[0].path is hole.path


def test_leads_lie_in_the_waste_beside_the_kerf() -> None:
    outline, hole = circle(0, 0, 0.05), circle(0, 0, 0.02)
    lead = Lead(length=4e-3, shape="arc")
    inner, outer = cut(outline, hole, kerf=1e-3, lead_in=lead).contours
    assert np.linalg.norm(inner.path(0.0)) < 0.0195 < 0.0505 < np.linalg.norm(outer.path(0.0))


@pytest.mark.parametrize("seed", range(30))
def test_random_contours_keep_the_distance_everywhere(seed: int) -> None:
    judge.run(seed)
