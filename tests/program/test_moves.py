"""Programs: refusals, selection, placement and projection."""

import numpy as np
import pytest
from tests.geometry.tables import refused

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.geometry import RoundedPath
from armcontour.program import (
    Contour,
    Dwell,
    Event,
    Process,
    Program,
    Rapid,
    Switch,
    contour_called,
)

LINE = ac.Path.polyline([[0.0, 0.0], [0.1, 0.0]])
SPACE = ac.Path.polyline([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
DOWN = [[0.0, 0.0, 0.1], [0.0, 0.0, 0.0]]
BACK = ac.Path.polyline([[0.1, 0.1], [0.0, 0.1]])
OVER = ac.Path.polyline([[0.1, 0.0], [0.1, 0.1]])


def program(*moves, **values):
    return Program(moves=moves, **values)


def contour(path=LINE, **values):
    return Contour(path=path, **values)


def test_invalid_programs_are_refused():
    nan = float("nan")
    drawn = program(contour(name="1", layer="a"), contour(name="2", layer="b"), source="x.dxf")
    events_beyond = (Event(name="laser", s=0.2),)
    across = ac.Arc(start=(0, 0, 0), center=(0.1, 0, 0), angle=1.0, normal=(0, 1, 0))
    arcs = contour(ac.Path(segments=[across]), name="line 7")
    raised = program(contour(SPACE), arcs, source="x.ngc")
    rest = program(contour(), Rapid())
    refused(
        (lambda: program(), "no contour"),
        (lambda: program(Rapid(path=LINE), source="x.ngc"), "x.ngc"),
        (lambda: program(contour(), contour(SPACE)), "all be in the plane or all in space"),
        (lambda: program(contour(), LINE), "Path"),
        (lambda: program(contour(), Rapid(path=SPACE), contour()), "rapids"),
        (lambda: program(Event(name="a", s=0.1), contour()), "event a"),
        (lambda: program(Event(name="a", s=0.1), contour()), "event a"),
        (lambda: Program.from_path([1, 2]), "must be a Path or a Program", "[1, 2]"),
        (
            lambda: contour([[0, 0], [1, 1]]),
            "Path",
            "must be a Path, such as ac.Path.polyline(points), not [[",
        ),
        (
            lambda: Rapid(path=[[0, 0], [1, 1]]),
            "rapid",
            "must be a Path, such as ac.Path.polyline(points), not [[",
        ),
        (lambda: contour(name="c", events=events_beyond), "laser", "0.2", "0.1"),
        (lambda: Event(name=""), "name"),
        (lambda: Event(name=3), "text"),
        (lambda: Event(name="x", s=-0.1), "x", "-0.1"),
        (lambda: Event(name="x", lead_time=nan), "lead_time"),
        (lambda: drawn.selected(layers=["c"]), "x.dxf", "layer 'c'", "'a', 'b'"),
        (lambda: drawn.selected(names=["1"], layers=["b"]), "matches both"),
        (lambda: drawn.selected(layers=[]), "is selected"),
        (lambda: drawn.path, "2 contours"),
        (raised.without_z, "x.ngc: contour 2 (line 7): Segment 1", "not parallel to this plane"),
        (lambda: rest.repeated(columns=2), "column_spacing"),
        (lambda: rest.repeated(rows=2, row_spacing=0.0), "row_spacing", "0 m"),
        (lambda: rest.repeated(rows=0, row_spacing=1.0), "rows", "0"),
        (
            lambda: rest.repeated(columns=500, rows=101, column_spacing=1, row_spacing=1),
            *("50500 copies of 2 moves", "100000"),
        ),
    )
    works = (0.05, 0.01), (-0.01, 0.05), (0.05, 0.2), (nan, 0.1), (0.01,), 0.01, (0.01, 0.02, 0.03)
    refused(*((lambda x=x: contour(work=x), "work") for x in works))
    refused(*((lambda x=x: Dwell(duration=x), "dwell") for x in (0.0, -1.0, float("inf"))))
    refused(*((lambda x=x: Event(name="gas", value=x), "gas") for x in (None, nan, [1], 1j)))


def test_events_are_sorted_by_arc_length_and_stay_in_order_at_one_point():
    events = (Event(name="b", s=0.05), Event(name="a", s=0.01), Event(name="c", s=0.01))
    assert [x.name for x in contour(events=events).events] == ["a", "c", "b"]
    # They may come one by one.
    assert len(contour(events=iter(events)).events) == 3
    assert len(Process(events=iter(events)).events) == 3


def test_a_placed_program_moves_and_scales_its_rapids_and_events():
    first = contour(events=(Event(name="x", s=0.025),), work=(0.01, 0.09))
    drawn = program(first, Rapid(path=OVER), contour(BACK))
    frame = Frame(position=[0.2, 0.3, 0.0], rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    placed = drawn.placed(frame, scale=2.0)
    first = placed.contours[0]
    assert first.events[0].s == pytest.approx(0.05, abs=1e-15)
    assert first.work == pytest.approx((0.02, 0.18), abs=1e-15)
    np.testing.assert_allclose(first.path(first.events[0].s), [0.2, 0.35], atol=1e-15)
    rapid = placed.moves[1].path
    np.testing.assert_allclose(rapid.vertices, [[0.2, 0.5], [0.0, 0.5]], atol=1e-15)
    assert placed.breaks == pytest.approx([0.0, 0.2, 0.4], abs=1e-15)
    lifted = drawn.placed(Frame(position=[0.0, 0.0, 0.1]))
    assert lifted.dimension == 3
    np.testing.assert_allclose(lifted.contours[1].path(0.1), [0.0, 0.1, 0.1], atol=1e-15)


def test_projected_programs_keep_their_events_work_and_switches():
    ramp = ac.Path.polyline([*DOWN, [0.03, 0.0, 0.04], [0.13, 0.0, 0.04]])
    events = (Event(name="x", s=0.125), Event(name="y", s=0.17))
    rapid = Rapid(path=ac.Path.polyline(DOWN))
    (flat,) = program(rapid, contour(ramp, events=events)).without_z().moves  # it only went down
    np.testing.assert_allclose(flat.path.vertices, [[0, 0], [0.03, 0], [0.13, 0]], atol=1e-15)
    # Half of the ramp of 0.05 m runs 0.015 m; 0.02 m on the flat after it run themselves.
    assert [x.s for x in flat.events] == pytest.approx([0.015, 0.05], abs=1e-15)
    on = Event(name="laser", s=0.05, lead_time=0.1)
    down = contour(ac.Path.polyline(DOWN), events=(on,))
    level = [*DOWN, [0.1, 0.0, 0.0]]
    moves = (down, Dwell(duration=1), contour(ac.Path.polyline(level), work=(0.11, 0.2)))
    event, dwell, flat = program(*moves).without_z().moves
    assert event == Event(name="laser", lead_time=0.1) and dwell == Dwell(duration=1)
    assert flat.work == pytest.approx((0.01, 0.1), abs=1e-15)
    held = program(contour(SPACE.pointing([0, 0, -1.0]))).without_z()
    assert held.path.orientation is None and "the tool orientation" in held.notes[0]


def test_contours_are_selected_and_labelled_by_layer_and_name():
    first = contour(name="1", layer="a")
    second = contour(name="CUT", layer="b")
    drawn = program(first, second)
    assert drawn.selected(layers=["b"]).contours == (second,)
    assert drawn.selected(names="CUT").contours == (second,)
    assert drawn.selected(names=["1"]).path is LINE and drawn.selected() is drawn
    assert drawn.selected(layers="a").contours == (first,)
    names = ["", "E7", "contour 4", "line 12"]
    called = [contour_called(contour(name=x), i) for i, x in enumerate(names)]
    assert called == ["contour 1", "contour 2 (E7)", "contour 4", "contour 4 (line 12)"]


def test_names_are_one_line_of_at_most_80_printable_characters():
    escape = "a\x1b]52;c;cA==\x1b"
    odd = "a\nb", "a\rb", "a\x85b", "a\u202eb", "a\u2028b", "a\ud800b", "\0", escape
    for name in (*odd, "x" * 81):
        words = "81 characters, more than 80" if len(name) > 80 else "not printable"
        refused(
            (lambda x=name: Event(name=x), "name of an event", words),
            (lambda x=name: Event(name="a", value=x), "a: value of an event", words),
            (lambda x=name: contour(name=x), "name of a contour", words),
            (lambda x=name: contour(layer=x), "layer of a contour", words),
            (lambda x=name: Process(off_between=(x,)), "off_between", words),
            (lambda x=name: Switch(name=x), "name of a switch", words),
        )
    for name in ("x" * 80, "größer, 名前, naïve #1 (µ)", "a  b"):
        named = contour(name=name, layer=name, events=(Event(name=name, value=name),))
        assert named.name == named.layer == named.events[0].value == name
    notes = ("left out: \x1b]0;x\x07.", "x" * 1_000_000)
    named = program(contour(), source="a\u202eb.dxf", notes=notes)
    assert named.notes[0] == r"left out: \x1b]0;x\x07." and len(named.notes[1]) <= 2000
    assert named.source == r"a\u202eb.dxf"


def test_a_program_from_a_path_adds_nothing_to_the_path():
    copy = Program.from_path(LINE)
    assert copy.path is copy.single_path is LINE and len(copy.moves) == 1
    assert Program.from_path(copy) is copy
    ring = ac.Path.polyline([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.0]])
    prepared, drawn = (
        ac.prepare(x, Process()) for x in (Program.from_path(ring), program(contour(ring)))
    )
    assert prepared.single_path is ring
    assert np.linalg.norm(drawn.path(0.0) - ring(0.0)) > 0.01  # off the corner
    # Rounding gives back what it was given.
    rounded, by_program = (
        ac.round_corners(x, tolerance=1e-3) for x in (ring, Program.from_path(ring))
    )
    assert isinstance(rounded, RoundedPath) and isinstance(by_program, Program)
    np.testing.assert_array_equal(by_program.path.breaks, rounded.breaks)
    assert by_program.single_path is by_program.path
    for alone in (contour(name="c", layer="cut"), contour(work=(0.0, LINE.length))):
        assert program(alone, notes=("a note",)).single_path is LINE
        assert alone.at_work == (0.0, LINE.length)
    event = Event(name="tool")
    led = contour(work=(0.01, 0.1))
    assert led.at_work == (0.01, 0.1)
    for moves in (
        (contour(), contour()),
        (contour(), Dwell(duration=1.0)),
        (Rapid(), contour()),
        (event, contour()),
        (led,),
        (contour(work=(0.0, 0.09)),),
        (contour(events=(event,)),),
    ):
        assert program(*moves).single_path is None


# -------------------------------------------------------------------------------------- repeated


def test_a_repeated_program_has_every_move_in_rows_and_columns():
    hole = contour(name="hole", events=(Event(name="x", s=0.025),), work=(0.01, 0.09))
    moves = Event(name="vacuum"), hole, Rapid(path=OVER), Dwell(duration=0.5), contour(BACK)
    size = {"columns": 3, "rows": 2, "column_spacing": 0.2, "row_spacing": -0.3}
    done = program(*moves).repeated(**size)
    assert [type(x) for x in done.moves] == [type(x) for x in moves] * 6
    # Row and column; the second row runs back.
    order = ["[1,1]", "[1,2]", "[1,3]", "[2,3]", "[2,2]", "[2,1]"]
    assert [x.name for x in done.contours[::2]] == [f"hole {x}" for x in order]
    assert [x.name for x in done.contours[1::2]] == order
    for k, (column, row) in enumerate([(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)]):
        shift = np.array([column * 0.2, row * -0.3])
        for old, new in zip(moves, done.moves[5 * k : 5 * k + 5], strict=True):
            if isinstance(old, Contour | Rapid):
                np.testing.assert_allclose(new.path.vertices, old.path.vertices + shift, atol=1e-15)
            else:
                assert new == old
        first = done.contours[2 * k]
        assert first.work == pytest.approx((0.01, 0.09)) and first.events[0].s == 0.025
    (alone,) = done.selected(names=["hole [2,1]"]).contours
    np.testing.assert_allclose(alone.path(0.0), [0.0, -0.3], atol=1e-15)
    # Copies of long names keep their places.
    copies = program(contour(name="a" * 80)).repeated(columns=12, column_spacing=1.0).contours
    assert len({x.name for x in copies}) == 12 and copies[11].name.endswith(" [1,12]")
