"""Programs as values: what they refuse, and what selecting, placing and flattening keep."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.program import Contour, Dwell, Event, Program, Rapid, contour_called

LINE = ac.Path.polyline([[0.0, 0.0], [0.1, 0.0]])
SPACE = ac.Path.polyline([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])


def test_refuses_what_makes_no_program(refuses: Callable[..., None]) -> None:
    refuses(lambda: Program(moves=()), InvalidInput, "no contour")
    refuses(lambda: Program(moves=(Rapid(path=LINE),), source="x.ngc"), InvalidInput, "x.ngc")
    both = (Contour(path=LINE), Contour(path=SPACE))
    refuses(lambda: Program(moves=both), InvalidInput, "all be in the plane or all in space")
    refuses(lambda: Program(moves=(Contour(path=LINE), LINE)), InvalidInput, "Path")
    refuses(lambda: Contour(path=[[0, 0], [1, 1]]), InvalidInput, "Path", "list")  # type: ignore[arg-type]
    for work in ((0.05, 0.01), (-0.01, 0.05), (0.05, 0.2), (float("nan"), 0.1)):
        refuses(lambda w=work: Contour(path=LINE, work=w), InvalidInput, "work")
    late = (Event(name="laser", s=0.2),)
    refuses(lambda: Contour(path=LINE, name="c", events=late), InvalidInput, "laser", "0.2", "0.1")
    refuses(lambda: Event(name=""), InvalidInput, "name")
    refuses(lambda: Event(name="x", s=-0.1), InvalidInput, "x", "-0.1")
    refuses(lambda: Event(name="x", lead_time=float("nan")), InvalidInput, "lead time")
    for duration in (0.0, -1.0, float("inf")):
        refuses(lambda d=duration: Dwell(duration=d), InvalidInput, "dwell")


def test_events_stand_in_the_order_of_their_places_and_keep_their_order_at_one_place() -> None:
    events = (Event(name="b", s=0.05), Event(name="a", s=0.01), Event(name="c", s=0.01))
    assert [x.name for x in Contour(path=LINE, events=events).events] == ["a", "c", "b"]


def test_places_a_program_with_its_rapids_and_the_places_of_its_events() -> None:
    program = Program(
        moves=(
            Contour(path=LINE, events=(Event(name="x", s=0.025),), work=(0.01, 0.09)),
            Rapid(path=ac.Path.polyline([[0.1, 0.0], [0.1, 0.1]])),
            Contour(path=ac.Path.polyline([[0.1, 0.1], [0.0, 0.1]])),
        )
    )
    frame = Frame(position=[0.2, 0.3, 0.0], rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    placed = program.placed(frame, scale=2.0)
    first = placed.contours[0]
    assert first.events[0].s == pytest.approx(0.05, abs=1e-15)
    assert first.work == pytest.approx((0.02, 0.18), abs=1e-15)
    np.testing.assert_allclose(first.path(first.events[0].s), [0.2, 0.35], atol=1e-15)
    rapid = placed.moves[1]
    assert isinstance(rapid, Rapid) and rapid.path is not None
    np.testing.assert_allclose(rapid.path.vertices, [[0.2, 0.5], [0.0, 0.5]], atol=1e-15)
    assert placed.breaks == pytest.approx([0.0, 0.2, 0.4], abs=1e-15)
    lifted = program.placed(Frame(position=[0.0, 0.0, 0.1]))
    assert lifted.dimension == 3
    np.testing.assert_allclose(lifted.contours[1].path(0.1), [0.0, 0.1, 0.1], atol=1e-15)


def test_flattens_a_program_with_its_events() -> None:
    down = [[0.0, 0.0, 0.1], [0.0, 0.0, 0.0]]
    ramp = ac.Path.polyline([*down, [0.03, 0.0, 0.04], [0.13, 0.0, 0.04]])
    program = Program(
        moves=(
            Rapid(path=ac.Path.polyline(down)),
            Contour(path=ramp, events=(Event(name="x", s=0.125), Event(name="y", s=0.17))),
        )
    )
    (flat,) = program.without_z().moves  # the rapid only went down
    assert isinstance(flat, Contour)
    np.testing.assert_allclose(flat.path.vertices, [[0, 0], [0.03, 0], [0.13, 0]], atol=1e-15)
    # Half of the ramp of 0.05 m runs 0.015 m; 0.02 m on the flat after it run themselves.
    assert [x.s for x in flat.events] == pytest.approx([0.015, 0.05], abs=1e-15)


def test_selects_by_layer_and_name(refuses: Callable[..., None]) -> None:
    contours = [Contour(path=LINE, name=n, layer=y) for n, y in (("1", "a"), ("2", "b"))]
    program = Program(moves=tuple(contours), source="x.dxf")
    assert program.selected(layers=["b"]).contours == (contours[1],)
    assert program.selected(names=["1"]).path is LINE
    assert program.selected() is program
    refuses(lambda: program.selected(layers=["c"]), InvalidInput, "x.dxf", "layer 'c'", "'a', 'b'")
    refuses(lambda: program.selected(names=["1"], layers=["b"]), InvalidInput, "fits both")
    refuses(lambda: program.path, InvalidInput, "2 contours")


def test_contours_are_called_by_name_or_number() -> None:
    names = ["", "E7", "contour 4", "line 12"]
    called = [contour_called(Contour(path=LINE, name=x), i) for i, x in enumerate(names)]
    assert called == ["contour 1", "contour E7", "contour 4", "contour line 12"]


def test_flattening_keeps_the_work_and_what_is_switched_where_nothing_is_left() -> None:
    down = ac.Path.polyline([[0.0, 0.0, 0.05], [0.0, 0.0, 0.0]])
    ramp = ac.Path.polyline([[0.0, 0.0, 0.05], [0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    on = Event(name="laser", s=0.05, lead_time=0.1, lead_distance=0.01)
    moves = (
        Contour(path=down, events=(on,)),
        Dwell(duration=1),
        Contour(path=ramp, work=(0.06, 0.15)),
    )
    event, dwell, contour = Program(moves=moves).without_z().moves
    assert event == Event(name="laser", lead_time=0.1)
    assert dwell == Dwell(duration=1)
    assert isinstance(contour, Contour)
    assert contour.work == pytest.approx((0.01, 0.1), abs=1e-15)


def test_flattening_says_which_contour_cannot_be_and_that_the_tool_is_held_no_more(
    refuses: Callable[..., None],
) -> None:
    across = ac.Arc(start=(0, 0, 0), center=(0.1, 0, 0), angle=1.0, normal=(0, 1, 0))
    moves = (Contour(path=SPACE), Contour(path=ac.Path.from_segments([across]), name="line 7"))
    program = Program(moves=moves, source="x.ngc")
    refuses(program.without_z, InvalidInput, "x.ngc: contour line 7: Segment 1", "leaves the plane")
    held = Program(moves=(Contour(path=SPACE.pointing([0, 0, -1.0])),)).without_z()
    assert held.path.orientation is None
    assert "the tool orientation" in held.notes[0]


def test_refuses_rapids_of_another_dimension_and_places_where_the_tool_stands(
    refuses: Callable[..., None],
) -> None:
    moves = (Contour(path=LINE), Rapid(path=SPACE), Contour(path=LINE))
    refuses(lambda: Program(moves=moves), InvalidInput, "rapids", "in the plane or all in space")
    for event in (Event(name="a", s=0.1), Event(name="a", lead_distance=0.1)):
        refuses(lambda x=event: Program(moves=(x, Contour(path=LINE))), InvalidInput, "event a")


@pytest.mark.parametrize("value", [None, float("nan"), [1], 1j])
def test_refuses_events_of_no_value(refuses: Callable[..., None], value: object) -> None:
    refuses(lambda: Event(name="gas", value=value), InvalidInput, "gas")  # type: ignore[arg-type]
    refuses(lambda: Event(name=3), InvalidInput, "text")  # type: ignore[arg-type]


def test_one_name_need_not_be_a_list_and_an_empty_list_is_refused(
    refuses: Callable[..., None],
) -> None:
    program = Program(moves=(Contour(path=LINE, name="CUT", layer="L"), Contour(path=LINE)))
    assert program.selected(names="CUT").contours == program.contours[:1]
    assert program.selected(layers="L").contours == program.contours[:1]
    refuses(lambda: program.selected(layers=[]), InvalidInput, "is chosen")


def test_refuses_rapids_without_a_path_and_work_that_is_not_two_places(
    refuses: Callable[..., None],
) -> None:
    refuses(lambda: Rapid(path=[[0, 0], [1, 1]]), InvalidInput, "rapid", "list")  # type: ignore[arg-type]
    for work in ((0.01,), 0.01, (0.01, 0.02, 0.03)):
        refuses(lambda w=work: Contour(path=LINE, work=w), InvalidInput, "work", "two")


UNPRINTABLE = (
    "a\x1b]52;c;cA==\x1b",
    "a\nb",
    "a\rb",
    "a\x85b",
    "a\u202eb",
    "a\u2028b",
    "a\ud800b",
    "\0",
)
PLAIN = ac.Path.polyline([(0, 0), (1, 0)])


@pytest.mark.parametrize("name", [*UNPRINTABLE, "x" * 81])
def test_names_are_a_line_of_80_printable_characters(
    refuses: Callable[..., None], name: str
) -> None:
    words = "81 characters, more than 80" if len(name) > 80 else "not printable"
    refuses(lambda: Event(name=name), InvalidInput, "name of an event", words)
    refuses(lambda: Event(name="a", value=name), InvalidInput, "value of the event a", words)
    refuses(lambda: Contour(path=PLAIN, name=name), InvalidInput, "name of a contour", words)
    refuses(lambda: Contour(path=PLAIN, layer=name), InvalidInput, "layer of a contour", words)
    refuses(lambda: ac.Process(off_between=(name,)), InvalidInput, "off_between", words)
    refuses(lambda: ac.Switch(name=name), InvalidInput, "name of an event", words)


def test_the_longest_names_and_those_of_any_script_are_names() -> None:
    for name in ("x" * 80, "größer, 名前, naïve #1 (µ)", "a  b"):
        contour = Contour(path=PLAIN, name=name, layer=name, events=(Event(name=name, value=name),))
        assert contour.name == contour.layer == contour.events[0].value == name


def test_notes_of_a_program_are_printable_and_no_longer_than_a_sentence() -> None:
    notes = ("left out: \x1b]0;x\x07.", "x" * 1_000_000)
    program = Program(moves=(Contour(path=PLAIN),), source="a\u202eb.dxf", notes=notes)
    assert program.notes[0] == r"left out: \x1b]0;x\x07." and len(program.notes[1]) <= 2000
    assert program.source == r"a\u202eb.dxf"


def test_a_path_becomes_a_program_that_starts_where_it_does(refuses: Callable[..., None]) -> None:
    found = Program.of(LINE)
    assert found.path is found.single_path is LINE and len(found.moves) == 1
    assert Program.of(found) is found
    ring = ac.Path.polyline([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.0]])
    kept = ac.prepare(Program.of(ring), ac.Process())
    drawn = ac.prepare(Program(moves=(Contour(path=ring),)), ac.Process())
    assert kept.single_path is ring
    assert np.linalg.norm(drawn.path(0.0) - ring(0.0)) > 0.01  # off the corner
    refuses(lambda: Program.of([1, 2], "This needs a Path"), InvalidInput, "This needs", "list")  # type: ignore[arg-type]


def test_a_single_path_has_nothing_around_it() -> None:
    for contour in (
        Contour(path=LINE, name="c", layer="cut"),
        Contour(path=LINE, work=(0.0, LINE.length)),
    ):
        assert Program(moves=(contour,), notes=("a note",)).single_path is LINE
        assert contour.at_work == (0.0, LINE.length)
    plain, event = Contour(path=LINE), Event(name="tool")
    led = Contour(path=LINE, work=(0.01, 0.1))
    assert led.at_work == (0.01, 0.1)
    for moves in (
        (plain, plain),
        (plain, Dwell(duration=1.0)),
        (Rapid(), plain),
        (event, plain),
        (led,),
        (Contour(path=LINE, work=(0.0, 0.09)),),
        (Contour(path=LINE, events=(event,)),),
    ):
        assert Program(moves=moves).single_path is None


def test_rounding_gives_back_what_it_was_given() -> None:
    bend = ac.Path.polyline([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]])
    path = ac.round_corners(bend, tolerance=1e-3)
    program = ac.round_corners(Program.of(bend), tolerance=1e-3)
    assert isinstance(path, ac.RoundedPath) and isinstance(program, Program)
    np.testing.assert_array_equal(program.path.breaks, path.breaks)
    assert program.single_path is program.path


# -------------------------------------------------------------------------------------- repeated


def test_repeats_every_move_in_rows_and_columns() -> None:
    program = Program(
        moves=(
            Event(name="vacuum"),
            Contour(path=LINE, name="hole", events=(Event(name="x", s=0.025),), work=(0.01, 0.09)),
            Rapid(path=ac.Path.polyline([[0.1, 0.0], [0.1, 0.1]])),
            Dwell(duration=0.5),
            Contour(path=ac.Path.polyline([[0.1, 0.1], [0.0, 0.1]])),
        )
    )
    size = {"columns": 3, "rows": 2, "column_spacing": 0.2, "row_spacing": -0.3}
    done = program.repeated(**size)
    kinds = [type(x) for x in program.moves]
    assert [type(x) for x in done.moves] == kinds * 6
    # Row and column; the second row runs back.
    order = ["[1,1]", "[1,2]", "[1,3]", "[2,3]", "[2,2]", "[2,1]"]
    assert [x.name for x in done.contours[::2]] == [f"hole {x}" for x in order]
    assert [x.name for x in done.contours[1::2]] == order
    for k, (column, row) in enumerate([(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)]):
        shift = np.array([column * 0.2, row * -0.3])
        moves = done.moves[5 * k : 5 * k + 5]
        for old, new in zip(program.moves, moves, strict=True):
            if isinstance(old, Contour | Rapid):
                assert isinstance(new, Contour | Rapid) and old.path and new.path
                np.testing.assert_allclose(new.path.vertices, old.path.vertices + shift, atol=1e-15)
            else:
                assert new == old
        first = done.contours[2 * k]
        assert first.work == pytest.approx((0.01, 0.09)) and first.events[0].s == 0.025
    plain = program.repeated(**size, serpentine=False)
    assert [x.name for x in plain.contours[1::2]] == [*order[:3], *order[:2:-1]]
    (alone,) = done.selected(names=["hole [2,1]"]).contours
    np.testing.assert_allclose(alone.path(0.0), [0.0, -0.3], atol=1e-15)


def test_copies_of_long_names_keep_their_places() -> None:
    program = Program(moves=(Contour(path=LINE, name="a" * 80),))
    names = [x.name for x in program.repeated(columns=12, column_spacing=1.0).contours]
    assert len(set(names)) == 12 and names[11].endswith(" [1,12]")


def test_refuses_copies_that_cannot_be(refuses: Callable[..., None]) -> None:
    program = Program(moves=(Contour(path=LINE), Rapid()))
    refuses(lambda: program.repeated(columns=2), InvalidInput, "column_spacing", "left out")
    refuses(lambda: program.repeated(rows=2, row_spacing=0.0), InvalidInput, "row_spacing", "0 m")
    refuses(lambda: program.repeated(rows=0, row_spacing=1.0), InvalidInput, "rows", "0")
    refuses(
        lambda: program.repeated(columns=500, rows=101, column_spacing=1, row_spacing=1),
        InvalidInput,
        "50500 copies of 2 moves",
        "100000",
    )
