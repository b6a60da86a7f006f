"""What a process adds around contours, against arithmetic of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.geometry import Arc, Demand, Line, Path
from armcontour.program import (
    Contour,
    Dwell,
    Event,
    Lead,
    Leads,
    Process,
    Program,
    Rapid,
    Switch,
    Weave,
    prepare,
    round_corners,
)

SQUARE = Path.polyline([[0.3, 0.1], [0.36, 0.1], [0.36, 0.14], [0.3, 0.14], [0.3, 0.1]])
BEND = Path.polyline([[0.3, 0.2], [0.35, 0.2], [0.35, 0.25]])
DRAWN = Process(begin="drawn")


def program(*contours: Contour | Path) -> Program:
    return Program(moves=tuple(Contour(path=x) if isinstance(x, Path) else x for x in contours))


def only(result: Program) -> Contour:
    (contour,) = result.contours
    return contour


def rapids(result: Program) -> list[Path]:
    return [x.path for x in result.moves if isinstance(x, Rapid) and x.path is not None]


# ---------------------------------------------------------------------------------------- leads


def test_leads_along_a_line_go_on_along_the_tangents() -> None:
    done = only(
        prepare(program(BEND), Process(lead_in=Lead(length=0.02), lead_out=Lead(length=0.01)))
    )
    ends = [[0.28, 0.2], [0.3, 0.2], [0.35, 0.2], [0.35, 0.25], [0.35, 0.26]]
    np.testing.assert_allclose(done.path.vertices, ends, atol=1e-15)
    assert done.work == pytest.approx((0.02, 0.12), abs=1e-15)
    assert done.path.tags[0] == "lead-in" and done.path.tags[-1] == "lead-out"
    np.testing.assert_allclose(done.path.turns, [0, np.pi / 2, 0], atol=1e-9)


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_leads_in_an_arc_are_quarters_of_circles_that_touch_the_contour(
    side: str, sign: float
) -> None:
    length = 0.02
    radius = length / (np.pi / 2)
    lead = Lead(length=length, shape="arc", side=side)
    path = only(prepare(program(BEND), Process(lead_in=lead, lead_out=lead))).path
    # Into [0.3, 0.2] along +x from a centre beside it; out of [0.35, 0.25] along +y likewise.
    np.testing.assert_allclose(path(0.0), [0.3 - radius, 0.2 + sign * radius], atol=1e-15)
    np.testing.assert_allclose(path(0.0, 1), [0, -sign], atol=1e-12)
    end = path.length
    np.testing.assert_allclose(path(end), [0.35 - sign * radius, 0.25 + radius], atol=1e-15)
    np.testing.assert_allclose(path(end, 1, side="left"), [-sign, 0], atol=1e-12)
    centre = np.array([0.3, 0.2 + sign * radius])
    off = np.linalg.norm(path(np.linspace(0, length, 9)) - centre, axis=1)
    np.testing.assert_allclose(off, radius, atol=1e-15)
    np.testing.assert_allclose(path.turns[[0, -1]], 0, atol=1e-9)


@given(
    st.floats(-3, 3),
    st.floats(-1.2, 1.2),
    st.sampled_from(["line", "arc"]),
    st.sampled_from(["left", "right"]),
    st.floats(1e-3, 0.1),
)
def test_leads_in_a_tilted_plane_are_tangent_and_stay_in_it(
    yaw: float, tilt: float, shape: str, side: str, length: float
) -> None:
    cy, sy, ct, st_ = np.cos(yaw), np.sin(yaw), np.cos(tilt), np.sin(tilt)
    turn = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ [
        [1, 0, 0],
        [0, ct, -st_],
        [0, st_, ct],
    ]
    flat = np.array([[0.0, 0, 0], [0.05, 0.01, 0], [0.05, 0.06, 0]])
    path = Path.polyline(flat @ turn.T + [0.4, 0, 0.3])
    up = turn[:, 2]
    lead = Lead(length=length, shape=shape, side=side)
    done = only(prepare(program(path), Process(lead_in=lead, lead_out=lead, up=7 * up))).path
    assert done.length == pytest.approx(path.length + 2 * length, abs=1e-12)
    np.testing.assert_allclose(done.turns[[0, -1]], 0, atol=1e-9)
    s = np.linspace(0, done.length, 50)
    np.testing.assert_allclose((done(s) - path(0.0)) @ up, 0, atol=1e-12)
    if shape == "arc":
        # To the left of the way that it comes in on is where up x tangent points.
        left = np.cross(up, path(0.0, 1))
        beside = (done(0.0) - path(0.0)) @ left
        assert beside == pytest.approx(
            (1 if side == "left" else -1) * length / (np.pi / 2), abs=1e-12
        )


def test_an_arc_beside_a_contour_that_goes_straight_up_is_refused(
    refuses: Callable[..., None],
) -> None:
    path = Path.polyline([[0.4, 0, 0.1], [0.4, 0, 0.2]])
    asked = Process(lead_in=Lead(length=0.01, shape="arc"))
    refuses(lambda: prepare(program(path), asked), InvalidInput, "straight up", "line")
    assert only(prepare(program(path), Process(lead_in=Lead(length=0.01)))).work == (0.01, 0.11)


def test_the_tool_is_held_along_leads_as_at_the_ends_and_follows_where_it_follows() -> None:
    path = Path.polyline([[0.4, 0, 0.1], [0.45, 0, 0.1], [0.45, 0.05, 0.1]])
    lead = Lead(length=0.02, shape="arc")
    ends = Process(lead_in=lead, lead_out=lead)
    held = only(prepare(program(path.pointing([0, 0, -1.0])), ends)).path
    assert held.orientation is not None
    axes = held.orientation(np.linspace(0, held.length, 40))[:, :, 2]
    np.testing.assert_allclose(axes, np.tile([0, 0, -1.0], (40, 1)), atol=1e-12)
    follows = only(prepare(program(path.following_tangent([0, 0, 1.0])), ends)).path
    assert follows.orientation is not None
    for s in (0.0, 0.01, 0.0199, follows.length - 0.015, follows.length):
        turned = follows.orientation(s, side="left" if s else "right")
        tangent = follows(s, 1, side="left" if s else "right")
        base = path.following_tangent([0, 0, 1.0])
        assert base.orientation is not None
        # The tool's coordinates of the tangent are what they are at the path's start.
        expected = base.orientation(0.0).T @ path(0.0, 1)
        np.testing.assert_allclose(turned.T @ tangent, expected, atol=1e-9)


def test_leads_take_the_demands_of_the_segments_they_touch() -> None:
    path = Path.from_segments(
        [
            Line(start=[0.3, 0], end=[0.4, 0], demand=Demand(speed=0.05, tolerance=1e-4)),
            Line(start=[0.4, 0], end=[0.5, 0], demand=Demand(speed=0.08)),
        ]
    )
    lead = Lead(length=0.01)
    done = only(prepare(program(path), Process(lead_in=lead, lead_out=lead))).path
    assert done.speeds.tolist() == [0.05, 0.05, 0.08, 0.08]
    assert done.tolerances[0] == 1e-4 and np.isnan(done.tolerances[-1])


def test_automatic_leads_take_the_lengths_that_are_given() -> None:
    asked = Process(lead_in=Lead(), lead_out=Lead(length=0.02))
    assert asked.automatic and not Process(lead_in=Lead(length=0.1)).automatic
    lengths = [Leads(before=0.03, after=0.5), Leads(before=0.0, after=0.5)]
    first, second = prepare(program(BEND, BEND), asked, lengths).contours
    assert first.work == pytest.approx((0.03, 0.13), abs=1e-15)
    assert first.path.length == pytest.approx(0.15, abs=1e-15)
    assert second.work == pytest.approx((0.0, 0.1), abs=1e-15)


@pytest.mark.parametrize("lengths", [None, [], [Leads(before=0.01)]])
def test_automatic_leads_without_a_length_for_every_contour_are_refused(
    lengths: list[Leads] | None, refuses: Callable[..., None]
) -> None:
    asked = Process(lead_in=Lead())
    given_ = 0 if lengths is None else len(lengths)
    refuses(
        lambda: prepare(program(BEND, BEND), asked, lengths),
        InvalidInput,
        "2 lengths",
        f"there are {given_}",
    )
    for value in (-0.01, float("nan")):
        refuses(lambda x=value: Leads(before=x), InvalidInput, "before")
        refuses(lambda x=value: Leads(after=x), InvalidInput, "after")


# ------------------------------------------------------------------------ beginnings and overlaps


def test_a_closed_contour_begins_off_its_corners_so_that_all_are_rounded() -> None:
    done = prepare(program(SQUARE), Process())
    np.testing.assert_allclose(only(done).path(0.0), [0.33, 0.1], atol=1e-15)
    assert only(done).path.length == pytest.approx(0.2, abs=1e-15)
    smooth = only(round_corners(done, tolerance=1e-3)).path
    assert smooth.stops.size == 0
    assert len(smooth.corners) == 4 and not smooth.corners.stopped.any()  # type: ignore[attr-defined]
    drawn = only(round_corners(prepare(program(SQUARE), DRAWN), tolerance=1e-3)).path
    assert len(drawn.corners) == 3  # type: ignore[attr-defined]


def test_a_smooth_closed_contour_stays_where_it_is_drawn() -> None:
    circle = Path.from_segments([Arc(start=[0.35, 0.1], center=[0.3, 0.1], angle=2 * np.pi)])
    np.testing.assert_allclose(only(prepare(program(circle), Process())).path(0.0), [0.35, 0.1])


@pytest.mark.parametrize(
    ("begin", "start"),
    [
        ("drawn", [0.3, 0.1]),
        (0.0, [0.3, 0.1]),
        (0.07, [0.36, 0.11]),
        (0.27, [0.36, 0.11]),  # once round
        (0.2, [0.3, 0.1]),
        ((0.5, 0.12), [0.36, 0.12]),
    ],
)
def test_a_closed_contour_begins_where_it_is_asked_to(
    begin: str | float | tuple[float, ...], start: list[float]
) -> None:
    path = only(prepare(program(SQUARE), Process(begin=begin))).path
    np.testing.assert_allclose(path(0.0), start, atol=1e-12)
    np.testing.assert_allclose(path(path.length), start, atol=1e-12)
    assert path.length == pytest.approx(0.2, abs=1e-12)


@pytest.mark.parametrize("overlap", [0.004, 0.03, 0.2, 0.45])
def test_overlap_goes_on_along_the_contour_by_its_length(overlap: float) -> None:
    path = only(prepare(program(SQUARE), Process(begin=0.07, overlap=overlap))).path
    assert path.length == pytest.approx(0.2 + overlap, abs=1e-12)
    s = np.linspace(0, overlap, 23)
    np.testing.assert_allclose(path(0.2 + s), SQUARE((0.07 + s) % 0.2), atol=1e-12)
    open_one = only(prepare(program(BEND), Process(overlap=overlap))).path
    assert open_one.length == BEND.length


def test_a_beginning_is_left_where_the_program_leads_to_it() -> None:
    corner = [0.3, 0.1]
    to = Rapid(path=Path.polyline([[0.35, 0.25], corner]))
    on, rest = Event(name="spindle"), Dwell(duration=0.1)
    for between in ((to,), (to, on), (to, on, rest), (on,), (rest,), (Rapid(),)):
        done = prepare(
            Program(moves=(Contour(path=BEND), *between, Contour(path=SQUARE))), Process()
        )
        np.testing.assert_allclose(done.contours[1].path(0.0), corner, atol=1e-15)
        assert len(done.moves) == 2 + len(between)
    with_event = program(Contour(path=SQUARE, events=(on,)))
    np.testing.assert_allclose(only(prepare(with_event, Process())).path(0.0), corner, atol=1e-15)
    # What comes before all contours leads nowhere.
    begun = prepare(Program(moves=(on, Contour(path=SQUARE))), Process())
    np.testing.assert_allclose(begun.contours[0].path(0.0), [0.33, 0.1], atol=1e-15)


# ----------------------------------------------------------------------------------------- events


@given(
    st.lists(st.floats(1e-6, 0.2 - 1e-6), max_size=4),
    st.floats(0, 0.3),
    st.floats(0, 0.25),
    st.floats(0, 0.05),
    st.sampled_from(["line", "arc"]),
    st.floats(0, 0.19),
    st.sampled_from([0.0, 1e-3]),
)
def test_events_keep_their_points_through_all_that_is_done_to_their_contour(
    places: list[float],
    begin: float,
    overlap: float,
    lead: float,
    shape: str,
    from_s: float,
    tolerance: float,
) -> None:
    events = tuple(Event(name=f"e{i}", s=s) for i, s in enumerate(places))
    ends = Lead(length=lead, shape=shape) if lead > 1e-6 else None
    process = Process(
        begin=begin, overlap=overlap, lead_in=ends, lead_out=ends, switch=Switch(), from_s=from_s
    )
    done = only(prepare(program(Contour(path=SQUARE, events=events)), process))
    assert done.work is not None
    on, off = (x for x in done.events if x.name == "tool")
    assert (on.value, off.value) == (True, False)
    assert (on.s, off.s) == pytest.approx(done.work, abs=1e-12)
    # A place to resume within 1e-9 m of the start is the start; the rest is rounding.
    length = 0.2 + overlap - from_s
    assert done.work[1] - done.work[0] == pytest.approx(length, abs=1e-9 + 1e-15)
    resumed_at = SQUARE((begin + from_s) % 0.2)
    found = {x.name: x for x in done.events if x.name != "tool"}
    for i, s in enumerate(places):
        event = found.pop(f"e{i}")
        # It was before the place to resume: then it is made up for there.
        passed = (s - begin) % 0.2 < from_s - 1e-9
        point = resumed_at if passed else SQUARE(s)
        if abs((s - begin) % 0.2 - from_s) > 1e-8:
            np.testing.assert_allclose(done.path(event.s), point, atol=1e-9)
    assert not found
    rounded = only(round_corners(program(done), tolerance=tolerance))
    for before, after in zip(done.events, rounded.events, strict=True):
        off_by = np.linalg.norm(rounded.path(after.s) - done.path(before.s))
        # On a corner's arc, by its share: the arc is off the corner by the tolerance, and along it
        # by less than as much again at right angles.
        assert off_by <= 2 * tolerance + 1e-9
    assert [x.name for x in rounded.events] == [x.name for x in done.events]


def test_events_at_the_ends_of_a_closed_contour_stay_at_its_ends() -> None:
    events = (Event(name="on", s=0.0), Event(name="off", s=0.2), Event(name="mid", s=0.06))
    contour = Contour(path=SQUARE, events=events)
    process = Process(begin=0.05, overlap=0.03, lead_in=Lead(length=0.01))
    done = only(prepare(program(contour), process))
    places = {x.name: x.s for x in done.events}
    assert places == pytest.approx({"on": 0.01, "mid": 0.02, "off": 0.24}, abs=1e-12)


def test_events_of_the_process_come_on_every_contour_by_its_own_arc_length(
    refuses: Callable[..., None],
) -> None:
    process = Process(lead_in=Lead(length=0.01), events=(Event(name="glue", s=0.05),))
    for contour in prepare(program(BEND, SQUARE), process).contours:
        (event,) = contour.events
        assert event.s == pytest.approx(0.06, abs=1e-15)
    far = Process(events=(Event(name="glue", s=0.15),))
    named = program(SQUARE, Contour(path=BEND, name="E7"))
    refuses(lambda: prepare(named, far), InvalidInput, "glue", "contour E7 is 0.1 m")
    unnamed = program(SQUARE, Contour(path=BEND))
    refuses(lambda: prepare(unnamed, far), InvalidInput, "contour 2 is 0.1 m")


# -------------------------------------------------------------------------------------- resumption


def test_resumes_on_a_later_contour_with_what_was_switched_before() -> None:
    moves = (
        Event(name="spindle", value="forward"),
        Contour(path=BEND, name="a", events=(Event(name="coolant", s=0.05),)),
        Event(name="spindle", value="reverse"),
        Rapid(path=Path.polyline([[0.35, 0.25], [0.3, 0.1]])),
        Dwell(duration=1.0),
        Contour(path=SQUARE, name="b", events=(Event(name="coolant", value=False, s=0.08),)),
        Contour(path=BEND, name="c"),
    )
    done = prepare(Program(moves=moves), Process(from_s=0.1 + 0.07))
    assert [type(x).__name__ for x in done.moves] == ["Event", "Event", "Contour", "Contour"]
    before = {x.name: x.value for x in done.moves if isinstance(x, Event)}
    assert before == {"spindle": "reverse", "coolant": True}
    b, c = done.contours
    np.testing.assert_allclose(b.path(0.0), [0.36, 0.11], atol=1e-12)
    assert b.path.length == pytest.approx(0.13, abs=1e-12)
    assert [(x.name, x.value) for x in b.events] == [("coolant", False)]
    assert b.events[0].s == pytest.approx(0.01, abs=1e-12)
    assert c.path is moves[-1].path  # type: ignore[union-attr]


def test_resumes_at_the_end_of_a_contour_with_the_next_one() -> None:
    done = prepare(program(BEND, Contour(path=SQUARE, name="b")), Process(from_s=BEND.length))
    assert only(done).name == "b"
    assert only(done).path.length == pytest.approx(0.2, abs=1e-15)


def test_resuming_runs_in_along_the_contour_itself_if_that_is_long_enough() -> None:
    lead = Lead(length=0.02)
    done = only(prepare(program(BEND), Process(lead_in=lead, from_s=0.06)))
    # Round the corner: the last centimetre before it and the first after it.
    ends = [[0.34, 0.2], [0.35, 0.2], [0.35, 0.21], [0.35, 0.25]]
    np.testing.assert_allclose(done.path.vertices, _without_joints(done.path, ends), atol=1e-12)
    assert done.work == pytest.approx((0.02, 0.06), abs=1e-12)
    short = only(prepare(program(BEND), Process(lead_in=lead, from_s=0.01)))
    np.testing.assert_allclose(short.path(0.0), [0.29, 0.2], atol=1e-12)


def _without_joints(path: Path, ends: list[list[float]]) -> list[list[float]]:
    """The ends, of which a path must have no other number."""
    assert len(path.vertices) == len(ends)
    return ends


@pytest.mark.parametrize("from_s", [0.3, 0.31, 5.0])
def test_resuming_beyond_the_end_is_refused(from_s: float, refuses: Callable[..., None]) -> None:
    refuses(
        lambda: prepare(program(BEND, SQUARE), Process(from_s=from_s)),
        InvalidInput,
        f"{from_s:g} m",
        "0.3 m long",
    )


# ------------------------------------------------------------------------------ rapids and heights


def test_rapids_of_the_program_go_where_leads_and_overlaps_have_moved_the_ends() -> None:
    up, over = [0.35, 0.25, 0.05], [0.3, 0.1, 0.05]
    bend, square = (Path.polyline(np.pad(x.vertices, ((0, 0), (0, 1)))) for x in (BEND, SQUARE))
    rapid = Rapid(path=Path.polyline([[0.35, 0.25, 0], up, over, [0.3, 0.1, 0]]))
    off = Event(name="spindle", value=False)
    moves = (Contour(path=bend), off, rapid, Event(name="spindle"), Contour(path=square))
    lead = Lead(length=0.01)
    process = Process(lead_in=lead, lead_out=lead, approach=0.1, retract=0.1)
    done = prepare(Program(moves=moves), process)
    kinds = [type(x).__name__ for x in done.moves]
    # Neither up nor down where the program's own rapid goes.
    assert kinds == ["Rapid", "Contour", "Event", "Rapid", "Event", "Contour", "Rapid"]
    down, across, last = rapids(done)
    a, b = done.contours
    np.testing.assert_allclose(down.vertices, [a.path(0.0) + [0, 0, 0.1], a.path(0.0)], atol=1e-15)
    ends = [a.path(a.path.length), up, over, b.path(0.0)]
    np.testing.assert_allclose(across.vertices, ends, atol=1e-15)
    end = b.path(b.path.length)
    np.testing.assert_allclose(last.vertices, [end, end + [0, 0, 0.1]], atol=1e-15)


def test_a_rapid_that_comes_from_elsewhere_keeps_its_beginning() -> None:
    rapid = Rapid(path=Path.polyline([[0.2, 0.2], [0.3, 0.1]]))
    moves = (Contour(path=BEND), rapid, Contour(path=SQUARE))
    done = prepare(Program(moves=moves), Process(lead_out=Lead(length=0.01)))
    np.testing.assert_allclose(rapids(done)[0].vertices, [[0.2, 0.2], [0.3, 0.1]], atol=1e-15)


def test_a_rapid_of_which_leads_leave_nothing_is_left_to_the_joints() -> None:
    first = Path.polyline([[0.3, 0.1], [0.35, 0.1]])
    second = Path.polyline([[0.37, 0.1], [0.4, 0.1]])
    moves = (
        Contour(path=first),
        Rapid(path=Path.polyline([[0.35, 0.1], [0.37, 0.1]])),
        Contour(path=second),
    )
    lead = Lead(length=0.01)
    done = prepare(Program(moves=moves), Process(lead_in=lead, lead_out=lead))
    assert not rapids(done)
    np.testing.assert_allclose(done.contours[1].path(0.0), [0.36, 0.1], atol=1e-15)


def test_goes_down_and_up_along_up_with_the_tool_held_as_at_the_ends() -> None:
    path = Path.polyline([[0.4, 0, 0.1], [0.45, 0, 0.1]]).pointing([[0, 0, -1.0], [0, 0.6, -0.8]])
    tilt = np.array([0.0, 0.6, 0.8])
    done = prepare(program(path), Process(approach=0.03, retract=0.02, up=tilt))
    down, up = rapids(done)
    np.testing.assert_allclose(down.vertices, [[0.4, 0.018, 0.124], [0.4, 0, 0.1]], atol=1e-15)
    np.testing.assert_allclose(up.vertices, [[0.45, 0, 0.1], [0.45, 0.012, 0.116]], atol=1e-15)
    assert down.orientation is not None and up.orientation is not None
    np.testing.assert_allclose(down.orientation(0.01)[:, 2], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(up.orientation(0.01)[:, 2], [0, 0.6, -0.8], atol=1e-12)


def test_goes_up_and_down_between_contours_that_no_rapid_of_the_program_links() -> None:
    path = Path.polyline([[0.4, 0, 0.1], [0.45, 0, 0.1]])
    other = Path.polyline([[0.4, 0.1, 0.1], [0.45, 0.1, 0.1]])
    for between in ((), (Rapid(),), (Event(name="x"),)):
        moves = (Contour(path=path), *between, Contour(path=other))
        done = prepare(Program(moves=moves), Process(approach=0.03, retract=0.02))
        ends = [[x.path(0.0), x.path(x.path.length)] for x in done.contours]
        expected = [
            [ends[0][0] + [0, 0, 0.03], ends[0][0]],
            [ends[0][1], ends[0][1] + [0, 0, 0.02]],
            [ends[1][0] + [0, 0, 0.03], ends[1][0]],
            [ends[1][1], ends[1][1] + [0, 0, 0.02]],
        ]
        assert len(rapids(done)) == 4
        for rapid, points in zip(rapids(done), expected, strict=True):
            np.testing.assert_allclose(rapid.vertices, points, atol=1e-15)


@pytest.mark.parametrize("heights", [{"approach": 0.01}, {"retract": 0.01}])
def test_heights_in_the_plane_are_refused(
    heights: dict[str, float], refuses: Callable[..., None]
) -> None:
    refuses(lambda: prepare(program(BEND), Process(**heights)), InvalidInput, "in the plane")


# --------------------------------------------------------------------------------- layers, orders


def test_layers_demand_where_segments_do_not(refuses: Callable[..., None]) -> None:
    path = Path.from_segments(
        [
            Line(start=[0.3, 0], end=[0.4, 0], demand=Demand(speed=0.05)),
            Line(start=[0.4, 0], end=[0.4, 0.1], demand=Demand(tolerance=1e-4)),
        ]
    )
    layers = {"cut": Demand(speed=0.02, tolerance=1e-3)}
    two = program(Contour(path=path, layer="cut"), Contour(path=path, layer="mark"))
    cut, mark = prepare(two, Process(layers=layers)).contours
    assert cut.path.speeds.tolist() == [0.05, 0.02]
    assert cut.path.tolerances.tolist() == [1e-3, 1e-4]
    assert mark.path.speeds[0] == 0.05 and np.isnan(mark.path.speeds[1])
    refuses(
        lambda: prepare(two, Process(layers={"engrave": Demand(speed=0.1)})),
        InvalidInput,
        "'engrave'",
        "'cut', 'mark'",
    )


@given(st.permutations(range(5)))
def test_the_nearest_order_is_that_of_a_search_by_hand(order: list[int]) -> None:
    starts = np.array([[0, 0], [1, 0], [2.2, 0.1], [0.1, 1.3], [3, 3]]) * 0.1
    contours = [
        Contour(path=Path.polyline([starts[i], starts[i] + [0.02, 0.01]]), name=str(i))
        for i in order
    ]
    done = prepare(program(*contours), Process(order="nearest"))
    names = [x.name for x in done.contours]
    assert sorted(names) == sorted(x.name for x in contours) and names[0] == str(order[0])
    here, left = starts[order[0]] + [0.02, 0.01], set(order[1:])
    for name in names[1:]:
        nearest = min(left, key=lambda i, at=here: float(np.hypot(*(starts[i] - at))))
        assert name == str(nearest)
        left.remove(nearest)
        here = starts[nearest] + [0.02, 0.01]


def test_the_nearest_order_is_refused_where_order_has_a_meaning(
    refuses: Callable[..., None],
) -> None:
    moves = (Contour(path=BEND), Event(name="x"), Contour(path=SQUARE))
    refuses(
        lambda: prepare(Program(moves=moves), Process(order="nearest")), InvalidInput, "nearest"
    )


def test_refuses_values_that_make_no_process(refuses: Callable[..., None]) -> None:
    for values, word in (
        ({"overlap": -1.0}, "overlap"),
        ({"from_s": float("nan")}, "from_s"),
        ({"begin": "corner"}, "begin"),
        ({"begin": float("nan")}, "begin"),
        ({"begin": (0.1, float("inf"))}, "begin"),
        ({"order": "longest"}, "order"),
        ({"up": [0.0, 0.0, 0.0]}, "up"),
        ({"up": [0.0, 1.0]}, "up"),
        ({"approach": float("inf")}, "approach"),
    ):
        refuses(lambda v=values: Process(**v), InvalidInput, word)
    for lead in ({"length": 0.0}, {"length": -0.01}, {"shape": "spiral"}, {"side": "top"}):
        refuses(lambda x=lead: Lead(**x), InvalidInput)
    refuses(
        lambda: prepare(program(SQUARE), Process(begin=(0.3, 0.1, 0.0))),
        InvalidInput,
        "begin",
        "3 coordinates",
        "have 2",
    )


# ---------------------------------------------------------------------------------------- rounding


def test_rounding_a_program_rounds_contours_and_leaves_rapids() -> None:
    bent = Path.polyline([[0.35, 0.25], [0.3, 0.2], [0.3, 0.1]])
    moves = (Contour(path=BEND, work=(0.02, 0.09)), Rapid(path=bent), Contour(path=SQUARE))
    done = round_corners(Program(moves=moves), tolerance=1e-3)
    first = done.contours[0]
    alone = ac.round_corners(BEND, tolerance=1e-3)
    np.testing.assert_array_equal(first.path.vertices, alone.vertices)
    (rapid,) = rapids(done)
    assert rapid is bent
    # After the corner the path is shorter by what the arc saves.
    saved = BEND.length - alone.length
    assert first.work == pytest.approx((0.02, 0.09 - saved), abs=1e-12)


def test_a_lead_that_ends_where_a_rapid_does_leaves_it_to_the_joints() -> None:
    moves = (
        Contour(path=Path.polyline([[0.3, 0.1], [0.35, 0.1]])),
        Rapid(path=Path.polyline([[0.35, 0.1], [0.36, 0.1]])),
        Contour(path=Path.polyline([[0.36, 0.1], [0.4, 0.1]])),
    )
    done = prepare(Program(moves=moves), Process(lead_out=Lead(length=0.01)))
    assert [type(x).__name__ for x in done.moves] == ["Contour", "Rapid", "Contour"]
    assert not rapids(done)


def test_a_closed_contour_whose_tool_ends_otherwise_stays_as_drawn(
    refuses: Callable[..., None],
) -> None:
    square = Path.polyline(np.pad(SQUARE.vertices, ((0, 0), (0, 1))))
    tilts = np.column_stack([np.linspace(0, 0.2, 5), np.zeros(5), -np.ones(5)])
    tilting, alike = square.pointing(tilts), square.pointing([*tilts[:4], tilts[0]])
    np.testing.assert_array_equal(only(prepare(program(tilting), Process())).path(0.0), square(0.0))
    assert not np.allclose(only(prepare(program(alike), Process())).path(0.0), square(0.0))
    for process in (Process(begin=0.03), Process(overlap=0.01)):
        refuses(
            lambda x=process: prepare(program(tilting), x), InvalidInput, "another tool orientation"
        )
        prepare(program(alike), process)


def test_a_closed_contour_along_which_the_tool_follows_begins_anywhere() -> None:
    square = Path.polyline(np.pad(SQUARE.vertices, ((0, 0), (0, 1)))).following_tangent([0, 0, 1])
    done = only(prepare(program(square), Process(begin=0.03, overlap=0.01))).path
    assert done.orientation is not None
    s = np.linspace(0.0, done.length, 77)
    axes = done.orientation(s)
    np.testing.assert_allclose(axes[:, :, 0], done(s, 1), atol=1e-12)


def test_an_overlap_of_thousands_of_turns_is_soon_there() -> None:
    tiny = Path.polyline([[0, 0], [1e-5, 0], [1e-5, 1e-5], [0, 0]])
    done = only(prepare(program(tiny), Process(overlap=1000 * tiny.length)))
    assert done.path.length == pytest.approx(1001 * tiny.length)


def test_a_place_to_begin_is_any_sequence_and_a_switch_is_checked_at_its_birth(
    refuses: Callable[..., None],
) -> None:
    for point in ([0.33, 0.1], np.array([0.33, 0.1]), (0.33, 0.1)):
        done = only(prepare(program(SQUARE), Process(begin=point)))
        np.testing.assert_allclose(done.path(0.0), [0.33, 0.1], atol=1e-15)
    refuses(lambda: Process(begin=[[0.1, 0.2]]), InvalidInput, "begin")  # type: ignore[list-item]
    refuses(lambda: Switch(name=""), InvalidInput, "name")
    refuses(lambda: Switch(on_lead=float("nan")), InvalidInput, "lead time")


@pytest.mark.parametrize(
    ("switched", "begin", "kept"),
    [
        ([(True, 0.02), (False, 0.15)], 0.05, False),
        ([(True, 0.02), (False, 0.04)], 0.05, True),
        ([(True, 0.07), (False, 0.15)], 0.05, True),
        ([(True, 0.02)], 0.05, True),
        ([(10.0, 0.0), (50.0, 0.04)], 0.05, False),
        ([(True, 0.0), (False, 0.2)], 0.05, True),
    ],
)
def test_a_contour_does_not_begin_where_something_would_not_be_switched_as_drawn(
    switched: list[tuple[bool | float, float]],
    begin: float,
    kept: bool,
    refuses: Callable[..., None],
) -> None:
    events = tuple(Event(name="laser", value=value, s=s) for value, s in switched)
    square = program(Contour(path=SQUARE, name="E7", events=events))
    if kept:
        prepare(square, Process(begin=begin))
    else:
        words = "contour E7", "laser", "0.05 m"
        refuses(lambda: prepare(square, Process(begin=begin)), InvalidInput, *words)


def test_a_rapid_in_arcs_keeps_them_where_leads_move_its_ends() -> None:
    arc = Path.from_segments([Arc(start=(0.35, 0.1), center=(0.4, 0.1), angle=-np.pi)])
    moves = (
        Contour(path=Path.polyline([[0.3, 0.1], [0.35, 0.1]])),
        Rapid(path=arc),
        Contour(path=Path.polyline([[0.45, 0.1], [0.5, 0.1]])),
    )
    lead = Lead(length=0.01)
    (rapid,) = rapids(prepare(Program(moves=moves), Process(lead_in=lead, lead_out=lead)))
    np.testing.assert_allclose(rapid([0.0, rapid.length]), [[0.36, 0.1], [0.44, 0.1]], atol=1e-15)
    assert rapid.length == pytest.approx(arc.length + 0.02)
    np.testing.assert_allclose(rapid(rapid.length / 2), [0.4, 0.15], atol=1e-15)


def test_resuming_where_something_is_switched_tells_its_last_state_only():
    path = ac.Path.polyline([(0, 0), (0.1, 0)])
    events = (
        ac.Event(name="spindle"),
        ac.Event(name="speed", value=200.0, s=0.02),
        ac.Event(name="speed", value=0.0, s=0.05),
    )
    program = ac.Program(moves=(ac.Contour(path=path, events=events),))
    (rest,) = ac.prepare(program, ac.Process(from_s=0.05)).contours
    assert [(x.name, x.value, x.s) for x in rest.events] == [
        ("spindle", True, 0.0),
        ("speed", 0.0, 0.0),
    ]
    (rest,) = ac.prepare(program, ac.Process(from_s=0.03)).contours
    assert [(x.value, pytest.approx(x.s)) for x in rest.events] == [
        (True, 0.0),
        (200.0, 0.0),
        (0.0, 0.02),
    ]


# --------------------------------------------------------------------------- passes and by layer


def test_closed_contours_are_run_in_laps_and_open_ones_again() -> None:
    inner = Event(name="mark", s=0.03)
    closed = Contour(path=SQUARE, name="part", events=(inner, Event(name="end", s=SQUARE.length)))
    bend = Contour(path=BEND, name="bend", events=(Event(name="mark", s=0.02),))
    process = Process(begin="drawn", passes=3, overlap=1e-3, switch=Switch(name="laser"))
    done = prepare(program(closed, bend), process).contours
    assert [x.name for x in done] == ["part", "bend", "bend (2)", "bend (3)"]
    lap = SQUARE.length
    assert done[0].path.length == pytest.approx(3 * lap + 1e-3, abs=1e-12)
    s = np.linspace(0, lap, 50)[:-1]
    for k in range(3):
        np.testing.assert_allclose(done[0].path(s + k * lap), SQUARE(s), atol=1e-12)
    marks = [x.s for x in done[0].events if x.name == "mark"]
    np.testing.assert_allclose(marks, [0.03 + k * lap for k in range(3)], atol=1e-12)
    ends = [(x.name, x.value) for x in done[0].events if x.s > 3 * lap]
    assert ends == [("end", True), ("laser", False)]
    for x in done[1:]:
        np.testing.assert_array_equal(x.path.vertices, BEND.vertices)
        assert [y.name for y in x.events] == ["laser", "mark", "laser"]


def test_contours_of_a_layer_have_values_of_their_own() -> None:
    lead = Lead(length=2e-3, shape="arc")
    process = Process(
        begin="drawn",
        overlap=1e-3,
        lead_in=lead,
        dwell=0.5,
        switch=Switch(name="laser"),
        by_layer={
            "MARK": {
                "lead_in": None,
                "overlap": 0.0,
                "dwell": 0.0,
                "switch": Switch(name="laser", value=0.2),
                "passes": 2,
            }
        },
    )
    moves = [Contour(path=SQUARE, name=x, layer=x) for x in ("CUT", "MARK")]
    done = prepare(program(*moves), process)
    cut, mark = done.contours
    assert cut.path.length == pytest.approx(SQUARE.length + 3e-3, abs=1e-12)
    assert mark.path.length == pytest.approx(2 * SQUARE.length, abs=1e-12)
    assert [x.value for x in cut.events] == [True, False]
    assert [x.value for x in mark.events] == [0.2, False]
    assert [type(x) for x in done.moves] == [Dwell, Contour, Contour]
    assert process.cuts and not process.of_layer("MARK").cuts
    assert process.of_layer("other") is process


def test_refuses_values_that_no_layer_has(refuses: Callable[..., None]) -> None:
    refuses(
        lambda: Process(by_layer={"M": {"order": "drawn"}}), InvalidInput, "by_layer.M", "order"
    )
    refuses(lambda: Process(by_layer={"M": {"passes": 0}}), InvalidInput, "by_layer.M", "passes")
    refuses(lambda: Process(by_layer={"M": {"dwell": None}}), InvalidInput, "by_layer.M", "dwell")
    refuses(lambda: Process(passes=1.5), InvalidInput, "passes")  # type: ignore[arg-type]
    unknown = Process(by_layer={"MARK": {"passes": 2}})
    refuses(lambda: prepare(program(BEND), unknown), InvalidInput, "'MARK'")
    refuses(lambda: Switch(value=False), InvalidInput, "tool", "off")
    many = Process(passes=1000)
    teeth = Path.polyline([*([0.001 * i, 0.001 * (i % 2)] for i in range(1200)), [0.0, 0.0]])
    refuses(lambda: prepare(program(teeth), many), InvalidInput, "fewer passes")


# ----------------------------------------------------------------------------------------- weave


def test_a_layer_is_woven_between_its_leads(refuses: Callable[..., None]) -> None:
    seam = Path.polyline([[0.3, 0.1], [0.4, 0.1]], demand=Demand(speed=0.01))
    lead = Lead(length=2e-3)
    process = Process(
        lead_in=lead,
        lead_out=lead,
        switch=Switch(name="arc"),
        events=(Event(name="pulse", s=0.05),),
        by_layer={"WELD": {"weave": Weave(width=4e-3, pitch=5e-3)}},
    )
    drawn = [Contour(path=seam, layer=x, name=x) for x in ("WELD", "TACK")]
    weld, tack = prepare(program(*drawn), process).contours
    assert tack.path.length == pytest.approx(0.104)
    start, end = weld.at_work
    np.testing.assert_allclose(weld.path([0.0, start]), [[0.298, 0.1], [0.3, 0.1]], atol=1e-12)
    # Half of the waves are before the middle of the seam.
    (pulse,) = [x for x in weld.events if x.name == "pulse"]
    np.testing.assert_allclose(weld.path(pulse.s), [0.35, 0.1], atol=1e-5)
    s = np.linspace(start, end, 4001)
    sides = weld.path(s)[:, 1] - 0.1
    assert sides.max() == pytest.approx(2e-3, abs=2e-5) == -sides.min()
    assert np.sum(np.diff(np.sign(sides[1:-1])) != 0) == 2 * 20 - 1
    rows = slice(*weld.path.locate([start + 1e-9, end + 1e-9]))
    seconds = weld.path.lengths[rows] / weld.path.speeds[rows]
    assert seconds.sum() == pytest.approx(0.1 / 0.01)
    wide = Process(weave=Weave(width=0.1, pitch=0.01))
    ring = Contour(path=Path.from_segments([Arc.circle((0.05, 0), (0, 0))]), name="ring")
    refuses(lambda: prepare(program(ring), wide), InvalidInput, "weave of contour ring", "50 mm")
    refuses(lambda: Weave(width=0.0, pitch=1.0), InvalidInput, "width")
    refuses(lambda: Weave(width=1.0, pitch=1.0, shape="moon"), InvalidInput, "shape", "zigzag")
