"""Leads, starts, overlaps and events of a process, compared with hand calculations."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.geometry.tables import arc, each, line, path_of, refused

import armcontour as ac
from armcontour.geometry import Arc, Path, SegmentLimits
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


def program(*moves):
    return Program(moves=tuple(Contour(path=x) if isinstance(x, Path) else x for x in moves))


def only(drawn, process):
    """The only contour of what becomes of a contour, a path or a program."""
    (contour,) = prepare(drawn if isinstance(drawn, Program) else program(drawn), process).contours
    return contour


def rapids(result):
    return [x.path for x in result.moves if isinstance(x, Rapid) and x.path is not None]


def kinds(result):
    return " ".join(type(x).__name__ for x in result.moves)


def ends_of(path):
    return path([0.0, path.length])


def in_space(path, z=0.0):
    return Path.polyline(np.pad(path.vertices, ((0, 0), (0, 1)), constant_values=z))


# ---------------------------------------------------------------------------------------- leads


def test_line_leads_continue_along_the_tangents():
    made = only(BEND, Process(lead_in=Lead(length=0.02), lead_out=Lead(length=0.01)))
    points = [[0.28, 0.2], [0.3, 0.2], [0.35, 0.2], [0.35, 0.25], [0.35, 0.26]]
    np.testing.assert_allclose(made.path.vertices, points, atol=1e-15)
    assert made.work == pytest.approx((0.02, 0.12), abs=1e-15)
    assert made.path.tags[0] == "lead-in" and made.path.tags[-1] == "lead-out"
    np.testing.assert_allclose(made.path.turns, [0, np.pi / 2, 0], atol=1e-9)


@given(
    st.floats(-3, 3),
    st.floats(-1.2, 1.2),
    st.sampled_from(["line", "arc"]),
    st.sampled_from(["left", "right"]),
    st.floats(1e-3, 0.1),
)
def test_leads_in_a_tilted_plane_are_tangent_and_stay_in_that_plane(yaw, tilt, shape, side, length):
    turn = ac.Frame.rpy((0, 0, 0), (tilt, 0, yaw)).rotation
    flat = np.array([[0.0, 0, 0], [0.05, 0.01, 0], [0.05, 0.06, 0]])
    path = Path.polyline(flat @ turn.T + [0.4, 0, 0.3])
    up = turn[:, 2]
    lead = Lead(length=length, shape=shape, side=side)
    path_made = only(path, Process(lead_in=lead, lead_out=lead, up=7 * up)).path
    assert path_made.length == pytest.approx(path.length + 2 * length, abs=1e-12)
    np.testing.assert_allclose(path_made.turns[[0, -1]], 0, atol=1e-9)
    s = np.linspace(0, path_made.length, 50)
    np.testing.assert_allclose((path_made(s) - path(0.0)) @ up, 0, atol=1e-12)
    if shape == "arc":
        # To the left of the way that it comes in on is where up x tangent points.
        beside = (path_made(0.0) - path(0.0)) @ np.cross(up, path(0.0, 1))
        sign = 1 if side == "left" else -1
        assert beside == pytest.approx(sign * length / (np.pi / 2), abs=1e-12)


def test_the_tool_has_the_orientation_of_the_ends_along_leads():
    path = Path.polyline([[0.4, 0, 0.1], [0.45, 0, 0.1], [0.45, 0.05, 0.1]])
    lead = Lead(length=0.02, shape="arc")
    ends = Process(lead_in=lead, lead_out=lead)
    held = only(path.pointing([0, 0, -1.0]), ends).path
    axes = held.orientation(np.linspace(0, held.length, 40))[:, :, 2]
    np.testing.assert_allclose(axes, np.tile([0, 0, -1.0], (40, 1)), atol=1e-12)
    base = path.following_tangent([0, 0, 1.0])
    follows = only(base, ends).path
    # The tool's coordinates of the tangent are what they are at the path's start.
    expected = base.orientation(0.0).T @ path(0.0, 1)
    for s in (0.0, 0.01, 0.0199, follows.length - 0.015, follows.length):
        side = "left" if s else "right"
        tangent = follows.orientation(s, side=side).T @ follows(s, 1, side=side)
        np.testing.assert_allclose(tangent, expected, atol=1e-9)


def test_leads_have_the_speed_and_tolerance_of_the_adjacent_segment():
    first = line([0.3, 0], [0.4, 0], speed=0.05, tolerance=1e-4)
    lead = Lead(length=0.01)
    drawn = path_of(first, line([0.4, 0], [0.5, 0], speed=0.08))
    path_made = only(drawn, Process(lead_in=lead, lead_out=lead)).path
    assert path_made.speeds.tolist() == [0.05, 0.05, 0.08, 0.08]
    assert path_made.tolerances[0] == 1e-4 and np.isnan(path_made.tolerances[-1])
    process = Process(lead_in=Lead(), lead_out=Lead(length=0.02))
    assert process.automatic and not Process(lead_in=Lead(length=0.1)).automatic
    lengths = [Leads(before=0.03, after=0.5), Leads(before=0.0, after=0.5)]
    first, second = prepare(program(BEND, BEND), process, lengths).contours
    assert first.work == pytest.approx((0.03, 0.13), abs=1e-15)
    assert first.path.length == pytest.approx(0.15, abs=1e-15)
    assert second.work == pytest.approx((0.0, 0.1), abs=1e-15)
    for few in (None, [], [Leads(before=0.01)]):
        message = f"got {len(few or [])}"
        refused((lambda x=few: prepare(program(BEND, BEND), process, x), "2 lengths", message))


# ------------------------------------------------------------------------ beginnings and overlaps


def test_a_closed_contour_begins_away_from_corners_so_that_all_are_rounded():
    done, drawn = (prepare(program(SQUARE), x) for x in (Process(), DRAWN))
    path = done.contours[0].path
    np.testing.assert_allclose(path(0.0), [0.33, 0.1], atol=1e-15)
    assert path.length == pytest.approx(0.2, abs=1e-15)
    smooth = round_corners(done, tolerance=1e-3).path
    assert smooth.stops.size == 0
    assert len(smooth.corners) == 4 and not smooth.corners.stopped.any()
    assert len(round_corners(drawn, tolerance=1e-3).path.corners) == 3
    # A smooth one stays where it is drawn.
    circle = path_of(arc([0.35, 0.1], [0.3, 0.1], 2 * np.pi))
    np.testing.assert_allclose(only(circle, Process()).path(0.0), [0.35, 0.1])


BEGINS = [
    ("drawn", [0.3, 0.1]),
    (0.0, [0.3, 0.1]),
    (0.07, [0.36, 0.11]),
    (0.27, [0.36, 0.11]),  # once round
    (0.2, [0.3, 0.1]),
    ((0.5, 0.12), [0.36, 0.12]),
    ([0.33, 0.1], [0.33, 0.1]),
    (np.array([0.33, 0.1]), [0.33, 0.1]),
]


@each("begin, start", BEGINS)
def test_a_closed_contour_begins_at_the_requested_point(begin, start):
    path = only(SQUARE, Process(begin=begin)).path
    np.testing.assert_allclose(ends_of(path), [start, start], atol=1e-12)
    assert path.length == pytest.approx(0.2, abs=1e-12)


@each("overlap", [0.004, 0.03, 0.2, 0.45])
def test_an_overlap_continues_along_the_contour_by_its_length(overlap):
    path = only(SQUARE, Process(begin=0.07, overlap=overlap)).path
    assert path.length == pytest.approx(0.2 + overlap, abs=1e-12)
    s = np.linspace(0, overlap, 23)
    np.testing.assert_allclose(path(0.2 + s), SQUARE((0.07 + s) % 0.2), atol=1e-12)
    assert only(BEND, Process(overlap=overlap)).path.length == BEND.length


TO_CORNER = Rapid(path=Path.polyline([[0.35, 0.25], [0.3, 0.1]]))
SPINDLE_ON = Event(name="spindle")
REST = Dwell(duration=0.1)


@each(
    "between",
    [
        (TO_CORNER,),
        (TO_CORNER, SPINDLE_ON),
        (TO_CORNER, SPINDLE_ON, REST),
        (SPINDLE_ON,),
        (REST,),
        (Rapid(),),
    ],
)
def test_the_start_of_a_contour_after_another_move_is_kept_by_prepare(between):
    """The moves before a contour lead to its drawn start, so its start must not move."""
    prepared = prepare(program(BEND, *between, SQUARE), Process())
    np.testing.assert_allclose(prepared.contours[1].path(0.0), SQUARE(0.0), atol=1e-15)
    assert len(prepared.moves) == 2 + len(between)


def test_the_start_of_a_contour_with_events_is_kept_by_prepare():
    with_event = Contour(path=SQUARE, events=(SPINDLE_ON,))
    np.testing.assert_allclose(only(with_event, Process()).path(0.0), SQUARE(0.0), atol=1e-15)


def test_an_event_before_all_contours_does_not_keep_the_drawn_start():
    prepared = only(program(SPINDLE_ON, SQUARE), Process())
    np.testing.assert_allclose(prepared.path(0.0), [0.33, 0.1], atol=1e-15)


def test_a_closed_contour_with_different_end_orientations_stays_as_drawn():
    square = in_space(SQUARE)
    tilts = np.column_stack([np.linspace(0, 0.2, 5), np.zeros(5), -np.ones(5)])
    tilting = square.pointing(tilts)
    alike = square.pointing([*tilts[:4], tilts[0]])
    np.testing.assert_array_equal(only(tilting, Process()).path(0.0), square(0.0))
    assert not np.allclose(only(alike, Process()).path(0.0), square(0.0))
    for process in (Process(begin=0.03), Process(overlap=0.01)):
        refused((lambda x=process: only(tilting, x), "another tool orientation"))
        only(alike, process)
    # One along which the tool follows begins anywhere.
    follows = square.following_tangent([0, 0, 1])
    path_made = only(follows, Process(begin=0.03, overlap=0.01)).path
    s = np.linspace(0.0, path_made.length, 77)
    np.testing.assert_allclose(path_made.orientation(s)[:, :, 0], path_made(s, 1), atol=1e-12)


SWITCHED = [
    ([(True, 0.02), (False, 0.15)], False),
    ([(True, 0.02), (False, 0.04)], True),
    ([(True, 0.07), (False, 0.15)], True),
    ([(True, 0.02)], False),
    ([(True, 0.07)], False),
    ([(False, 0.02)], False),
    ([(False, 0.02), (True, 0.04)], True),
    ([(10.0, 0.0), (50.0, 0.04)], False),
    ([(True, 0.0), (False, 0.2)], True),
]


@each("switched, is_unchanged", SWITCHED)
def test_moved_start_is_refused_if_it_would_change_switching(switched, is_unchanged):
    events = tuple(Event(name="laser", value=value, s=s) for value, s in switched)
    square = Contour(path=SQUARE, name="E7", events=events)
    process = Process(begin=0.05)
    if is_unchanged:
        only(square, process)
    else:
        refused((lambda: only(square, process), "contour 1 (E7)", "laser", "0.05 m"))


def test_a_moved_start_keeps_the_values_that_the_program_has_set_before():
    on, off, again = (Event("laser", x, s=s) for x, s in ((True, 0.0), (False, 0.06), (True, 0.1)))
    process = Process(begin=0.05)

    def start(before, *events):
        moves = (replace(before, s=0.0), Rapid(), Contour(path=SQUARE, name="E7", events=events))
        return only(program(*moves), process).events

    assert [x.s for x in start(on, off, again)] == pytest.approx([0.01, 0.05])
    assert [x.s for x in start(on, again)] == pytest.approx([0.05])
    for before, *events in ((on, off), (off, off, again), (Event("laser", 0.3), off, again)):
        refused((lambda x=before, y=events: start(x, *y), "E7", "laser", "Remove begin"))


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
def test_events_stay_at_their_points_if_the_contour_changes(
    places, begin, overlap, lead, shape, resume_at, tolerance
):
    events = tuple(Event(name=f"e{i}", s=s) for i, s in enumerate(places))
    lead = Lead(length=lead, shape=shape) if lead > 1e-6 else None
    ends = {"lead_in": lead, "lead_out": lead, "switch": Switch()}
    process = Process(begin=begin, overlap=overlap, resume_at=resume_at, **ends)
    # Outputs that are on already can be switched on from any start point.
    before = [replace(x, s=0.0) for x in events]
    made = only(program(*before, Contour(path=SQUARE, events=events)), process)
    on, switch_off = (x for x in made.events if x.name == "tool")
    assert (on.value, switch_off.value) == (True, False)
    assert (on.s, switch_off.s) == pytest.approx(made.work, abs=1e-12)
    # A place to resume within 1e-9 m of the start is the start; the rest is rounding.
    length = 0.2 + overlap - resume_at
    assert made.work[1] - made.work[0] == pytest.approx(length, abs=1e-9 + 1e-15)
    resumed_at = SQUARE((begin + resume_at) % 0.2)
    events_by_name = {x.name: x for x in made.events if x.name != "tool"}
    for i, s in enumerate(places):
        event = events_by_name.pop(f"e{i}")
        # It was before the place to resume: then it is made up for there.
        passed = (s - begin) % 0.2 < resume_at - 1e-9
        point = resumed_at if passed else SQUARE(s)
        if abs((s - begin) % 0.2 - resume_at) > 1e-8:
            np.testing.assert_allclose(made.path(event.s), point, atol=1e-9)
    assert not events_by_name
    (rounded,) = round_corners(program(made), tolerance=tolerance).contours
    for before, after in zip(made.events, rounded.events, strict=True):
        off_by = np.linalg.norm(rounded.path(after.s) - made.path(before.s))
        # On a corner's arc, by its share: the arc is off the corner by the tolerance, and along it
        # by less than as much again at right angles.
        assert off_by <= 2 * tolerance + 1e-9
    assert [x.name for x in rounded.events] == [x.name for x in made.events]


def test_events_of_the_process_keep_their_distance_from_the_ends():
    events = (Event(name="on", s=0.0), Event(name="off", s=0.2), Event(name="mid", s=0.06))
    process = Process(begin=0.05, overlap=0.03, lead_in=Lead(length=0.01))
    made = only(program(Event(name="mid"), Contour(path=SQUARE, events=events)), process)
    places = {x.name: x.s for x in made.events}
    assert places == pytest.approx({"on": 0.01, "mid": 0.02, "off": 0.24}, abs=1e-12)
    process = Process(lead_in=Lead(length=0.01), events=(Event(name="glue", s=0.05),))
    for contour in prepare(program(BEND, SQUARE), process).contours:
        (event,) = contour.events
        assert event.s == pytest.approx(0.06, abs=1e-15)
    far = Process(events=(Event(name="glue", s=0.15),))
    named = program(SQUARE, Contour(path=BEND, name="E7"))
    refused(
        (lambda: prepare(named, far), "glue", "contour 2 (E7) is only 0.1 m"),
        (lambda: prepare(program(SQUARE, BEND), far), "contour 2 is only 0.1 m"),
    )


# -------------------------------------------------------------------------------------- resumption


def test_a_program_resumed_on_a_later_contour_has_the_earlier_output_states():
    moves = (
        Event(name="spindle", value="forward"),
        Contour(path=BEND, name="a", events=(Event(name="coolant", s=0.05),)),
        Event(name="spindle", value="reverse"),
        Rapid(path=Path.polyline([[0.35, 0.25], [0.3, 0.1]])),
        Dwell(duration=1.0),
        Contour(path=SQUARE, name="b", events=(Event(name="coolant", value=False, s=0.08),)),
        Contour(path=BEND, name="c"),
    )
    prepared = prepare(Program(moves=moves), Process(resume_at=0.1 + 0.07))
    assert kinds(prepared) == "Event Event Contour Contour"
    before = {x.name: x.value for x in prepared.moves if isinstance(x, Event)}
    assert before == {"spindle": "reverse", "coolant": True}
    b, c = prepared.contours
    np.testing.assert_allclose(b.path(0.0), [0.36, 0.11], atol=1e-12)
    assert b.path.length == pytest.approx(0.13, abs=1e-12)
    assert [(x.name, x.value) for x in b.events] == [("coolant", False)]
    assert b.events[0].s == pytest.approx(0.01, abs=1e-12)
    assert c.path is BEND


@pytest.mark.parametrize(
    # Where the rest begins on the second contour: rejoin before the place, or its start [m].
    ("resume_at", "rejoin", "begin"),
    [(0.17, 0.0, 0.07), (0.17, 0.02, 0.05), (0.17, 0.07, 0.0), (0.17, 0.3, 0.0), (0.1, 0.02, 0.0)],
)
def test_a_resumed_program_processes_the_end_of_the_finished_part_again(resume_at, rejoin, begin):
    drawn = program(BEND, Contour(path=SQUARE, name="b"), Contour(path=BEND, name="c"))
    switch = Switch("laser")
    process = Process(begin="drawn", switch=switch, resume_at=resume_at, rejoin=rejoin)
    rest = prepare(drawn, process)
    b, c = rest.contours
    assert (b.name, c.name) == ("b", "c") and c.path.length == BEND.length
    np.testing.assert_allclose(b.path(0.0), SQUARE(begin), atol=1e-12)
    assert b.path.length == pytest.approx(SQUARE.length - begin, abs=1e-12)
    assert rest.work_starts == pytest.approx([0.1 + begin, 0.1 + SQUARE.length], abs=1e-12)
    # The process is on from the start of the overlap.
    assert [(x.value, x.s) for x in b.events] == [(True, 0.0), (False, b.path.length)]


def test_an_overlap_has_a_lead_in_on_the_finished_part():
    lead = Lead(length=0.02)
    made = only(BEND, Process(lead_in=lead, resume_at=0.06, rejoin=0.005))
    points = [[0.335, 0.2], [0.35, 0.2], [0.35, 0.205], [0.35, 0.25]]
    np.testing.assert_allclose(made.path.vertices, points, atol=1e-12)
    assert made.work == pytest.approx((0.02, 0.065), abs=1e-12)


def test_an_overlap_goes_back_into_the_lap_before():
    laps = Process(begin="drawn", passes=2, resume_at=0.21, rejoin=0.03)
    made = only(SQUARE, laps)
    np.testing.assert_allclose(made.path(0.0), SQUARE(0.18), atol=1e-12)
    assert made.path.length == pytest.approx(0.22, abs=1e-12)


def test_a_program_resumes_at_an_end_within_a_contour_and_at_an_event():
    drawn = program(BEND, Contour(path=SQUARE, name="b"))
    made = only(drawn, Process(resume_at=BEND.length))
    assert made.name == "b" and made.path.length == pytest.approx(0.2, abs=1e-15)
    for resume_at in (0.3, 0.31, 5.0):
        refused(
            (
                lambda s=resume_at: prepare(drawn, Process(resume_at=s)),
                f"{resume_at:g} m",
                "0.3 m",
            )
        )
    lead = Lead(length=0.02)
    made = only(BEND, Process(lead_in=lead, resume_at=0.06))
    # Round the corner: the last centimetre before it and the first after it.
    points = [[0.34, 0.2], [0.35, 0.2], [0.35, 0.21], [0.35, 0.25]]
    np.testing.assert_allclose(made.path.vertices, points, atol=1e-12)
    assert made.work == pytest.approx((0.02, 0.06), abs=1e-12)
    short = only(BEND, Process(lead_in=lead, resume_at=0.01))
    np.testing.assert_allclose(short.path(0.0), [0.29, 0.2], atol=1e-12)
    values = (("spindle", True, 0.0), ("speed", 200.0, 0.02), ("speed", 0.0, 0.05))
    events = tuple(Event(name=name, value=value, s=s) for name, value, s in values)
    drawn = Contour(path=Path.polyline([(0, 0), (0.1, 0)]), events=events)
    for resume_at, expected in (
        (0.05, [("spindle", True, 0.0), ("speed", 0.0, 0.0)]),
        (0.03, [("spindle", True, 0.0), ("speed", 200.0, 0.0), ("speed", 0.0, 0.02)]),
    ):
        prepared_events = only(drawn, Process(resume_at=resume_at)).events
        assert [(x.name, x.value, pytest.approx(x.s)) for x in prepared_events] == expected


# ------------------------------------------------------------------------------ rapids and heights


def test_rapids_of_the_program_end_at_the_leads_and_overlaps():
    up = [0.35, 0.25, 0.05]
    over = [0.3, 0.1, 0.05]
    rapid = Rapid(path=Path.polyline([[0.35, 0.25, 0], up, over, [0.3, 0.1, 0]]))
    spindle_off = Event(name="spindle", value=False)
    moves = in_space(BEND), spindle_off, rapid, Event(name="spindle"), in_space(SQUARE)
    lead = Lead(length=0.01)
    prepared = prepare(
        program(*moves), Process(lead_in=lead, lead_out=lead, approach=0.1, retract=0.1)
    )
    # Neither up nor down where the program's own rapid goes.
    assert kinds(prepared) == "Rapid Contour Event Rapid Event Contour Rapid"
    (start, a), (b, end) = (ends_of(x.path) for x in prepared.contours)
    expected = [start + [0, 0, 0.1], start], [a, up, over, b], [end, end + [0, 0, 0.1]]
    for rapid_path, points in zip(rapids(prepared), expected, strict=True):
        np.testing.assert_allclose(rapid_path.vertices, points, atol=1e-15)


def test_approach_and_retract_are_added_where_the_program_has_no_rapid():
    path = Path.polyline([[0.4, 0, 0.1], [0.45, 0, 0.1]]).pointing([[0, 0, -1.0], [0, 0.6, -0.8]])
    tilt = np.array([0.0, 0.6, 0.8])
    process = Process(approach=0.03, retract=0.02, up=tilt, approach_speed=0.1)
    # Along the tool axis, whatever is up.
    down, up = rapids(prepare(program(path), process))
    np.testing.assert_allclose(down.vertices, [[0.4, 0, 0.13], [0.4, 0, 0.1]], atol=1e-15)
    np.testing.assert_allclose(up.vertices, [[0.45, 0, 0.1], [0.45, -0.012, 0.116]], atol=1e-15)
    assert down.speeds.tolist() == up.speeds.tolist() == [0.1]
    np.testing.assert_allclose(down.orientation(0.01)[:, 2], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(up.orientation(0.01)[:, 2], [0, 0.6, -0.8], atol=1e-12)
    path, other = (Path.polyline([[0.4, y, 0.1], [0.45, y, 0.1]]) for y in (0, 0.1))
    for between in ((), (Rapid(),), (Event(name="x"),)):
        prepared = prepare(program(path, *between, other), Process(approach=0.03, retract=0.02))
        expected = []
        for begin, end in (ends_of(x.path) for x in prepared.contours):
            expected += [begin + [0, 0, 0.03], begin], [end, end + [0, 0, 0.02]]
        for rapid, points in zip(rapids(prepared), expected, strict=True):
            np.testing.assert_allclose(rapid.vertices, points, atol=1e-15)


def test_a_tool_change_is_a_stop_with_an_event_and_a_note():
    spindle_off, on = (Event(name="spindle", value=x) for x in (False, True))
    first, second = (Event(name="tool", value=x) for x in (1.0, 2.0))
    drawn = program(first, on, BEND, spindle_off, second, on, SQUARE, spindle_off)
    plain = prepare(drawn, Process())
    assert kinds(plain) == kinds(drawn) and ["1 tool change" in x for x in plain.notes] == [True]
    # The first tool is mounted already.
    assert not prepare(program(first, on, BEND), Process()).notes
    # A switch of the same name is another output than the tool.
    switched = prepare(drawn, Process(switch=Switch()))
    assert [x.value for x in switched.moves if isinstance(x, Event) and x.name == "tool"] == [1, 2]
    assert all([y.value for y in x.events] == [True, False] for x in switched.contours)


def test_rapids_without_a_speed_get_the_rapid_speed():
    path, other = (Path.polyline([[0.4, y, 0.1], [0.45, y, 0.1]]) for y in (0, 0.1))
    moves = path, Rapid(path=Path.polyline([[0.45, 0, 0.1], [0.4, 0.1, 0.1]])), other
    prepared = prepare(program(*moves), Process(retract=0.02, rapid_speed=0.5, approach_speed=0.1))
    assert [x.speeds.tolist() for x in rapids(prepared)] == [[0.5], [0.1]]
    assert prepared.rapid_speed == 0.5 and prepare(program(path), Process()).rapid_speed is None


# --------------------------------------------------------------------------------- layers, orders


def test_values_of_a_layer_apply_to_segments_without_their_own():
    first = line([0.3, 0], [0.4, 0], speed=0.05)
    path = path_of(first, line([0.4, 0], [0.4, 0.1], tolerance=1e-4))
    two = program(*(Contour(path=path, layer=x) for x in ("cut", "mark")))
    layers = {"cut": SegmentLimits(speed=0.02, tolerance=1e-3)}
    cut, mark = prepare(two, Process(layers=layers)).contours
    assert cut.path.speeds.tolist() == [0.05, 0.02]
    assert cut.path.tolerances.tolist() == [1e-3, 1e-4]
    assert mark.path.speeds[0] == 0.05 and np.isnan(mark.path.speeds[1])
    other = Process(layers={"engrave": SegmentLimits(speed=0.1)})
    refused((lambda: prepare(two, other), "'engrave'", "'cut', 'mark'"))


def test_invalid_values_of_a_process_are_refused():
    nan = float("nan")
    inf = float("inf")
    processes = [
        ({"overlap": -1.0}, "overlap"),
        ({"resume_at": nan}, "resume_at"),
        ({"begin": "corner"}, "begin"),
        ({"begin": nan}, "begin"),
        ({"begin": (0.1, inf)}, "begin"),
        ({"begin": [[0.1, 0.2]]}, "begin"),
        ({"order": "longest"}, "order"),
        ({"up": [0.0, 0.0, 0.0]}, "up"),
        ({"up": [0.0, 1.0]}, "up"),
        ({"approach": inf}, "approach"),
        ({"passes": 1.5}, "passes"),
        ({"by_layer": {"M": {"order": "drawn"}}}, "by_layer.M", "order"),
        ({"by_layer": {"M": {"passes": 0}}}, "by_layer.M", "passes"),
        ({"by_layer": {"M": {"passes": None}}}, "by_layer.M", "passes"),
        ({"by_layer": {"M": {"direction": "up"}}}, "by_layer.M", "direction"),
        ({"direction": "climb", "kerf_side": "right"}, "climb", "kerf_side"),
        *(({x: 0.0}, x) for x in ("rapid_speed", "approach_speed")),
    ]
    refused(*((lambda x=x: Process(**x), *words) for x, *words in processes))
    leads = {"length": 0.0}, {"length": -0.01}, {"shape": "spiral"}, {"side": "top"}
    refused(*((lambda x=x: Lead(**x),) for x in leads))
    lengths = [(y, x) for x in (-0.01, nan) for y in ("before", "after")]
    refused(*((lambda x=x, y=y: Leads(**{y: x}), y) for y, x in lengths))
    ring = Contour(path=path_of(Arc.circle((0.05, 0), (0, 0))), name="ring")
    upward = Path.polyline([[0.4, 0, 0.1], [0.4, 0, 0.2]])
    assert only(upward, Process(lead_in=Lead(length=0.01))).work == (0.01, 0.11)
    teeth = Path.polyline([*([0.001 * i, 0.001 * (i % 2)] for i in range(1200)), [0.0, 0.0]])
    preparations = [
        (SQUARE, {"begin": (0.3, 0.1, 0.0)}, "begin", "3 coordinates", "have 2"),
        (BEND, {"approach": 0.01}, "in the plane"),
        (BEND, {"retract": 0.01}, "in the plane"),
        (upward, {"lead_in": Lead(length=0.01, shape="arc")}, "parallel to the direction up"),
        (BEND, {"by_layer": {"MARK": {"passes": 2}}}, "'MARK'"),
        (teeth, {"passes": 1000}, "fewer passes"),
        (ring, {"weave": Weave(width=0.1, pitch=0.01)}, "weave of contour 1 (ring)", "50 mm"),
    ]
    refused(*((lambda x=x, y=y: only(x, Process(**y)), *words) for x, y, *words in preparations))
    refused(
        (lambda: Switch(name=""), "name"),
        (lambda: Switch(on_lead=nan), "on_lead"),
        (lambda: Switch(value=False), "tool", "off"),
        (lambda: Weave(width=0.0, pitch=1.0), "width"),
    )


# ---------------------------------------------------------------------------------------- rounding


# --------------------------------------------------------------------------- passes and by layer


def test_passes_are_laps_of_closed_and_repetitions_of_open_contours():
    lap = SQUARE.length
    events = (Event(name="mark", s=0.03), Event(name="end", s=lap))
    closed = Contour(path=SQUARE, name="part", events=events)
    bend = Contour(path=BEND, name="bend", events=(Event(name="mark", s=0.02),))
    process = Process(begin="drawn", passes=3, overlap=1e-3, switch=Switch(name="laser"))
    part, *bends = prepare(program(closed, bend), process).contours
    assert [x.name for x in (part, *bends)] == ["part", "bend", "bend (2)", "bend (3)"]
    assert part.path.length == pytest.approx(3 * lap + 1e-3, abs=1e-12)
    s = np.linspace(0, lap, 50)[:-1]
    for k in range(3):
        np.testing.assert_allclose(part.path(s + k * lap), SQUARE(s), atol=1e-12)
    marks = [x.s for x in part.events if x.name == "mark"]
    np.testing.assert_allclose(marks, [0.03 + k * lap for k in range(3)], atol=1e-12)
    ends = [(x.name, x.value) for x in part.events if x.s > 3 * lap]
    assert ends == [("end", True), ("laser", False)]
    for x in bends:
        np.testing.assert_array_equal(x.path.vertices, BEND.vertices)
        assert [y.name for y in x.events] == ["laser", "mark", "laser"]


def test_contours_of_a_layer_have_the_process_values_of_the_layer():
    layer_values = {"lead_in": None, "overlap": 0.0, "dwell": 0.0, "passes": 2}
    layer_values["switch"] = Switch(name="laser", value=0.2)
    process_values = {"overlap": 1e-3, "lead_in": Lead(length=2e-3, shape="arc"), "dwell": 0.5}
    process_values["switch"] = Switch(name="laser")
    process = Process(begin="drawn", **process_values, by_layer={"MARK": layer_values})
    prepared = prepare(program(*(Contour(path=SQUARE, layer=x) for x in ("CUT", "MARK"))), process)
    cut, mark = prepared.contours
    assert cut.path.length == pytest.approx(SQUARE.length + 3e-3, abs=1e-12)
    assert mark.path.length == pytest.approx(2 * SQUARE.length, abs=1e-12)
    assert [x.value for x in cut.events] == [True, False]
    assert [x.value for x in mark.events] == [0.2, False]
    assert kinds(prepared) == "Dwell Contour Contour"
    assert process.cuts and not process.of_contour(mark).cuts
    assert process.of_contour(Contour(path=SQUARE, layer="other")) is process


def test_the_contours_of_a_layer_are_woven_between_their_leads():
    seam = path_of(line([0.3, 0.1], [0.4, 0.1], speed=0.01))
    lead = Lead(length=2e-3)
    around = {"lead_in": lead, "lead_out": lead, "switch": Switch(name="arc")}
    by_layer = {"WELD": {"weave": Weave(width=4e-3, pitch=5e-3)}}
    process = Process(**around, events=(Event(name="pulse", s=0.05),), by_layer=by_layer)
    drawn = [Contour(path=seam, layer=x, name=x) for x in ("WELD", "TACK")]
    weld, tack = prepare(program(*drawn), process).contours
    assert tack.path.length == pytest.approx(0.104)
    start, end = weld.at_work
    np.testing.assert_allclose(weld.path([0.0, start]), [[0.298, 0.1], [0.3, 0.1]], atol=1e-12)
    # Half of the waves are before the middle of the seam.
    (pulse,) = [x for x in weld.events if x.name == "pulse"]
    np.testing.assert_allclose(weld.path(pulse.s), [0.35, 0.1], atol=1e-5)
    sides = weld.path(np.linspace(start, end, 4001))[:, 1] - 0.1
    assert sides.max() == pytest.approx(2e-3, abs=2e-5) == -sides.min()
    assert np.sum(np.diff(np.sign(sides[1:-1])) != 0) == 2 * 20 - 1
    rows = slice(*weld.path.locate([start + 1e-9, end + 1e-9]))
    seconds = weld.path.lengths[rows] / weld.path.speeds[rows]
    assert seconds.sum() == pytest.approx(0.1 / 0.01)
