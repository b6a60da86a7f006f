"""G-code: the corpus, points worked out by hand, refusals, and what becomes of every word."""

from __future__ import annotations

import math
import random
import re
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour.errors import InvalidInput
from armcontour.io.drawings.gcode import read_gcode
from armcontour.io.drawings.reading import Reading
from armcontour.program import Contour, Dwell, Event, Program, Rapid

CORPUS = Path(__file__).with_name("gcode")
FILES = sorted(CORPUS.rglob("*.ngc"))
REFUSED = re.compile(rb"; refused in line (\d+): (.*)")
# What reading the longest file may take, in times of what a program of 20,000 lines takes.
PATIENCE = 40


def read(text, **options):
    data = text if isinstance(text, bytes) else text.encode()
    return read_gcode(data, source="part.ngc", reading=Reading(**options))


def read_file(name):
    data = (CORPUS / f"{name}.ngc").read_bytes()
    unknown = "skip" if b"unknown: skip" in data else "refuse"
    reading = Reading(unknown=unknown, mend_vertices=0.0)
    return read_gcode(data, source=f"{name}.ngc", reading=reading)


def name_of(file):
    return f"{file.parent.name}/{file.stem}"


def in_mm(path):
    return (path.vertices * 1e3).round(6).tolist()


def test_corpus_is_large_and_cites_its_sources():
    assert len(FILES) >= 40
    for file in FILES:
        first = file.read_bytes().lstrip(b"\xef\xbb\xbf").splitlines()[0]
        assert re.match(rb"; (LinuxCNC|docs/guides/gcode.md)", first), file


@pytest.mark.parametrize("file", [x for x in FILES if REFUSED.search(x.read_bytes())], ids=name_of)
def test_corpus_is_refused_with_its_line(file, refuses):
    line, words = REFUSED.search(file.read_bytes()).groups()
    name = f"{file.parent.name}/{file.stem}"
    refuses(
        lambda: read_file(name),
        InvalidInput,
        f"{name}.ngc, line {int(line)}: ",
        words.decode(),
        index=int(line) - 1,
    )


# Vertices [mm] of every contour, worked out by hand.
GOLDEN = {
    "lines/square": [[[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]],
    "lines/modal_words": [
        [[0, 0, 0], [30.48, -76.2, 0], [30.48, -76.2, -58.42], [30.48, -76.2, 25.4]]
    ],
    "lines/repeated_points": [[[0, 0], [5, 0], [5, 2]]],
    "lines/from_the_origin": [[[0, 0], [3, 4]]],
    "lines/several_contours": [[[1, 1], [2, 1]], [[6, 6], [7, 6]]],
    "format/spaces_anywhere": [[[0.1234, 7], [1.5, 7], [1.5, -0.5]]],
    "format/numbers": [[[0, 0], [0.5, -0.25], [12.5, 3], [12.5, 0]]],
    "format/comments": [[[0, 0], [1, 0], [1, 1], [2, 1]]],
    "format/line_numbers": [[[0, 0], [1, 0], [2, 0], [3, 0], [4, 0]]],
    "format/block_delete": [[[0, 0], [1, 0], [2, 0]]],
    "format/word_order": [[[0, 0], [1, 0], [4, 2], [4, 2], [4, 2]]],
    "format/several_codes": [[[0, 0], [1, 0], [2, 0], [4, 0]]],
    "format/old_ends_of_line": [[[0, 0], [1, 0], [2, 0], [3, 0]]],
    "format/encodings": [[[0, 0], [1, 0], [2, 0], [3, 0]]],
    "frame/percent_signs": [[[0, 0], [1, 0], [2, 0]]],
    "frame/percent_and_end": [[[0, 0], [1, 0]]],
    "frame/nothing_after_the_end": [[[0, 0], [1, 0]]],
    "frame/no_end_at_all": [[[0, 0], [1, 0]]],
    "arcs/quarter": [[[0, 0], [1, 1]]],
    "arcs/there_and_back": [[[0, 0], [0, 1], [0, 0]]],
    "arcs/full_circles": [[[10, 0]] * 6],
    "arcs/turns": [[[10, 0], [10, 0], [-10, 0]]],
    "arcs/absolute_center": [[[10, 10], [0, 20], [-10, 10]]],
    "arcs/relative_end": [[[10, 0], [0, 10], [-10, 0]]],
    "arcs/radius": [[[0, 0], [10, 0], [20, 0], [20, 10]]],
    "arcs/rounded_center": [[[10, 0], [7.07, 7.07], [0, 9.99]]],
    "arcs/other_planes": [[[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0], [8, 10, 6], [8, 10, 0]]],
    "units/inches": [[[25.4, 0], [50.8, 0], [50.8, 25.4]]],
    "units/change_on_the_way": [[[0, 0], [25.4, 0], [50.8, 0], [76.2, 0]]],
    "distance/relative": [[[1, 1], [2, 1], [2, 2], [0, 2], [-0.5, 1.5]]],
    "events/dwell": [[[0, 0], [1, 0]], [[1, 0], [2, 0]], [[2, 0], [3, 0]]],
    "events/pause": [[[0, 0], [1, 0]], [[1, 0], [2, 0]], [[2, 0], [3, 0]]],
    "skipped/codes": [[[0, 0], [1, 0]], [[1, 0], [2, 0]]],
    "lines/safe_start": [[[0, 0], [1, 0], [2, 0]]],
    "parameters/formulas": [[[0, 0], [10, 0], [15, 0], [6, -3], [2, -1], [2, 6]]],
    "flow/subprograms": [[[0, 0], [1, 4], [1, 0], [2, 0], [4, 2], [40, 7]]],
    "flow/loops": [[[0, 0], [1, 0], [3, 0], [5, 0], [6, 0], [6, 1], [6, 2]]],
    "flow/numbered_subprograms": [[[0, 0], [1, 0], [1, 1], [1, 2], [2, 2]]],
    "offsets/systems": [[[0, 0], [101, 0], [200, 11], [106, 0], [107, 0], [101, 0]]],
    "offsets/where_the_tool_is": [[[5, 0], [6, 0], [7, 0]]],
    "offsets/only_one_system": [[[0, 0], [1, 0], [2, 0]]],
    "references/known": [[[1, 2], [3, 2]], [[3, 2], [4, 2]]],
    "references/unknown": [[[1, 2, 1], [3, 2, 1]], [[7, 7, 1], [8, 7, 1]]],
    "cycles/drilling": [[[x, 0, 2], [x, 0, -1]] for x in (1, 2, 3)],
    "cycles/pecks": [
        *[[[1, 0, 1], [1, 0, -1]], [[1, 0, -0.746], [1, 0, -2.5]]],
        *[[[2, 0, 1], [2, 0, -1]], [[2, 0, -0.746], [2, 0, -2.5]]],
        [[3, 0, 1], [3, 0, -1]],
    ],
    "cycles/repeats": [[[x, x, 2], [x, x, 1]] for x in (1, 2, 3)],
    "feeds/inverse_time": [[[0, 0], [1, 0], [2, 0], [5, 0], [6, 0], [7, 0]]],
    "events/tools_and_outputs": [[[0, 0], [1, 0], [2, 0], [3, 0]], [[3, 0], [4, 0]]],
    "events/extruder": [
        [[0, 0, 0], [0, 0, 1], [1, 0, 1], [2, 0, 1], [3, 0, 1]],
        [[3, 0, 1], [4, 0, 1]],
    ],
    "format/fanuc_and_printers": [[[0, 0], [1, 0]], [[1, 0], [2, 0]]],
    "skipped/printer": [[[0, 0], [10, 0], [10, 10]]],
}


@pytest.mark.parametrize("name", GOLDEN)
def test_corpus_has_the_points_worked_out_by_hand(name):
    program = read_file(name)
    found = [np.array(in_mm(x.path)) for x in program.contours]
    expected = [np.array(x, dtype=float) for x in GOLDEN[name]]
    assert len(found) == len(expected)
    for a, b in zip(found, expected, strict=True):
        d = b.shape[1]
        np.testing.assert_allclose(a[:, :d], b, atol=1e-6)
        assert np.abs(a[:, d:]).max(initial=0.0) <= 1e-6


def test_feed_rates_become_speeds_in_metres_per_second():
    (contour,) = read_file("units/change_on_the_way").contours
    assert contour.path.speeds == pytest.approx([0.01, 0.0254, 0.0254])


def test_path_control_becomes_corner_tolerances():
    (contour,) = read_file("control/path_control").contours
    expected = [np.nan, 5e-5, 0.0, 0.0, np.nan]
    np.testing.assert_allclose(contour.path.tolerances, expected, rtol=1e-12)


def test_inches_hold_for_path_control_and_feed():
    (contour,) = read_file("units/inches").contours
    assert contour.path.speeds == pytest.approx([0.0254, 0.0254])
    np.testing.assert_allclose(contour.path.tolerances, [np.nan, 2.54e-4], rtol=1e-12)


def test_quarter_circle_has_its_length_and_middle():
    (contour,) = read_file("arcs/quarter").contours
    path = contour.path
    assert path.length == pytest.approx(math.pi / 2 * 1e-3, rel=1e-12)
    # Clockwise from (0, 0) around (1, 0).
    middle = np.array([1 - math.sqrt(0.5), math.sqrt(0.5)]) * 1e-3
    np.testing.assert_allclose(path(path.length / 2), middle, atol=1e-15)


def test_full_circles_and_turns_have_their_lengths():
    circles = read_file("arcs/full_circles").contours[0].path
    assert circles.lengths == pytest.approx(2e-3 * math.pi * np.array([10, 5, 2, 2, 2]))
    turns = read_file("arcs/turns").contours[0].path
    assert turns.lengths == pytest.approx(math.pi * np.array([20e-3, 10e-3]))
    # From (10, 0) counter-clockwise around the origin.
    np.testing.assert_allclose(turns(math.pi * 5e-3), [0, 0.01], atol=1e-15)
    np.testing.assert_allclose(turns(math.pi * 25e-3), [0, 0.01], atol=1e-15)


def test_radius_says_which_of_the_two_arcs():
    path = read_file("arcs/radius").contours[0].path
    assert 1 / path.curvatures * 1e3 == pytest.approx([10, 10, 5])
    # A chord as long as the radius sees 60 degrees, the other way 300.
    assert np.degrees(path.lengths * path.curvatures) == pytest.approx([60, 300, 180])
    # G2 bends to the left of the chord, G3's long way round to the right.
    high = path(path.breaks[0] + path.lengths[0] / 2)[1]
    assert high * 1e3 == pytest.approx(10 - math.sqrt(75))
    low = path(path.breaks[1] + path.lengths[1] / 2)[1]
    assert low * 1e3 == pytest.approx(-10 - math.sqrt(75))


def test_radius_rounded_a_little_short_is_a_half_circle():
    path = read_file("arcs/radius_rounded_short").contours[0].path
    assert 1 / path.curvatures[0] == pytest.approx(5.001e-3, abs=1e-15)
    assert path.length == pytest.approx(math.pi * 5.001e-3)


def test_arcs_turn_as_seen_from_the_positive_end_of_the_third_axis():
    path = read_file("arcs/other_planes").contours[0].path
    middles = path((path.breaks[:-1] + path.breaks[1:]) / 2) * 1e3
    # G18 G3 from z towards x: over -z; G19 G2 against y towards z: over +z.
    np.testing.assert_allclose(middles[0], [5, 0, 5], atol=1e-9)
    np.testing.assert_allclose(middles[1], [10, 5, 5], atol=1e-9)
    np.testing.assert_allclose(middles[2], [5, 5, 0], atol=1e-9)


def test_an_arc_across_the_plane_makes_a_program_in_space():
    assert read("F60\nG18 G2 X10 R5\n").dimension == 3
    assert read("F60\nG17 G2 X10 R5\n").dimension == 2


def test_a_program_at_one_height_other_than_zero_is_in_space():
    assert read("G0 Z5\nG1 X1 F60\n").dimension == 3
    assert read("G0 Z5\nG0 Z0\nG1 X1 F60\n").dimension == 2


def test_rapids_with_height_put_all_moves_in_space():
    program = read("G1 X1 F60\nG0 Z5\nX9\nZ0\nG1 X10\n")
    assert {x.path.dimension for x in program.moves} == {3}
    assert in_mm(program.moves[1].path) == [[1, 0, 0], [1, 0, 5], [9, 0, 5], [9, 0, 0]]


def test_several_rapids_in_a_row_are_one_and_the_first_way_is_left_open():
    moves = read_file("lines/several_contours").moves
    assert [type(x) for x in moves] == [Contour, Rapid, Contour, Rapid]
    assert in_mm(moves[1].path) == [[2, 1], [5, 1], [5, 5], [6, 6]]
    assert in_mm(moves[3].path) == [[7, 6], [0, 0]]
    assert [x.name for x in moves if isinstance(x, Contour)] == ["line 3", "line 7"]


def test_a_rapid_to_where_the_tool_is_ends_no_contour():
    (contour,) = read("G1 X1 F60\nG0 X1\nG1 X2\n").moves
    assert len(contour.path) == 2


def test_spindle_and_coolant_are_events_where_they_are_switched():
    moves = read_file("events/spindle_and_coolant").moves
    assert [(x.name, x.value) for x in moves[:3]] == [
        ("spindle speed", 1000.0),
        ("spindle", True),
        ("coolant", "flood"),
    ]
    contour = moves[3]
    assert [(e.name, e.value, round(e.s * 1e3, 9)) for e in contour.events] == [
        ("spindle speed", 2000.0, 1),
        ("coolant", "mist and flood", 2),
        ("spindle", "reverse", 2),
        ("spindle", False, 3),
        ("coolant", False, 3),
    ]


def test_what_is_so_already_is_no_event_and_the_end_switches_off():
    moves = read_file("events/on_only_once").moves
    assert [(x.name, x.value) for x in moves[:2]] == [("spindle speed", 500.0), ("spindle", True)]
    assert [(e.name, e.value) for e in moves[2].events] == [
        ("spindle speed", 600.0),
        ("spindle", False),
    ]


def test_switching_off_at_the_start_is_an_event():
    first = read("M5\nG1 X1 F60\n").moves[0]
    assert isinstance(first, Event) and (first.name, first.value) == ("spindle", False)


def test_an_event_between_rapids_stands_between_them():
    moves = read("G1 X1 F60\nG0 X2\nM5\nG0 X3\nG1 X4\n").moves
    assert [type(x) for x in moves] == [Contour, Rapid, Event, Rapid, Contour]


def test_dwells_and_pauses_bring_the_tool_to_rest():
    assert [type(x) for x in read_file("events/dwell").moves] == [
        Contour,
        Dwell,
        Contour,
        Contour,
    ]
    assert read_file("events/dwell").moves[1].duration == 0.5
    pauses = [x for x in read_file("events/pause").moves if isinstance(x, Event)]
    assert [(x.name, x.value) for x in pauses] == [("pause", True), ("pause", "optional")]


def test_helix_keeps_within_the_chord_tolerance():
    text = "G0 X10 Y0 F60\nG3 I-10 Z4 P2\n"
    for tolerance in (1e-4, 1e-6):
        path = read(text, chord_tolerance=tolerance).contours[0].path
        points = path(np.linspace(0, path.length, 20_001))
        off = 0.01 - np.hypot(points[:, 0], points[:, 1])
        assert 0.9 * tolerance < off.max() <= tolerance * (1 + 1e-9)
        # Height goes evenly with the angle.
        turn = np.unwrap(np.arctan2(path.vertices[:, 1], path.vertices[:, 0]))
        np.testing.assert_allclose(path.vertices[:, 2], turn / (4 * np.pi) * 4e-3, atol=1e-12)
        np.testing.assert_array_equal(path.vertices[-1], [0.01, 0, 4e-3])


def test_nearly_full_circles_are_two_arcs_without_a_corner_near_the_programmed_circle():
    for contour in read_file("arcs/nearly_full").contours:
        path = contour.path
        assert len(path) == 2
        assert path.turns[0] < 1e-12
        radius = np.linalg.norm(path(np.linspace(0, path.length, 1000)), axis=1)
        assert np.abs(radius - 0.01).max() <= 1.1e-5
        assert path.length == pytest.approx(2 * np.pi * 0.01, rel=5e-3)
        np.testing.assert_allclose(path.vertices[-1][0], 10.01e-3, atol=1e-15)


@given(
    radius=st.floats(1e-3, 10),
    turn=st.floats(0, 6.3),
    sweep=st.floats(1e-3, 6.28),
    off=st.floats(-2.8e-5, 2.8e-5),
    way=st.sampled_from([2, 3]),
)
def test_arcs_with_rounded_centres_stay_near_them_and_meet_their_ends(
    radius, turn, sweep, off, way
):
    a, b = turn, turn + (sweep if way == 3 else -sweep)
    end = radius + off
    text = (
        f"G0 X{radius * math.cos(a):.12f} Y{radius * math.sin(a):.12f} F1\n"
        f"G90.1 G{way} X{end * math.cos(b):.12f} Y{end * math.sin(b):.12f} I0 J0\n"
    )
    path = read(text, unit=1.0).contours[0].path
    target = [end * math.cos(b), end * math.sin(b)]
    np.testing.assert_allclose(path.vertices[-1], target, atol=1.5e-9)
    distance = np.linalg.norm(path(np.linspace(0, path.length, 200)), axis=1)
    # Never farther off than twice what the centre is off.
    assert np.abs(distance - radius).max() <= 2 * abs(off) + 1e-9


def test_distances_that_differ_more_than_rounding_makes_them_are_refused(refuses):
    text = "G0 X{r} Y0 F60\nG3 X0 Y{end} I-{r}\n"
    for r, end, taken in (
        (10, 10.028, True),
        (10, 10.029, False),
        (100, 100.099, True),
        (100, 100.11, False),
        (1000, 1000.49, True),
        (1000, 1000.51, False),
    ):
        given = text.format(r=r, end=end)
        if taken:
            assert len(read(given).contours[0].path) == 1
        else:
            refuses(lambda given=given: read(given), InvalidInput, "part.ngc, line 2", "allowed")


def test_unit_of_the_reading_holds_until_the_file_says_another():
    (contour,) = read("G1 X2 F60\nG21\nX3000\n", unit=1.0).contours
    np.testing.assert_allclose(contour.path.vertices, [[0, 0], [2, 0], [3, 0]], atol=1e-15)
    assert contour.path.speeds == pytest.approx([1.0, 1.0])
    assert in_mm(read("G1 X2 F60\n").contours[0].path) == [[0, 0], [2, 0]]


def test_what_moves_nothing_is_left_out_with_one_note():
    program = read("M104 S200\nG1 X1 F60\nM106 S255\nM104 S0\nG43 H2\nX2 H3\nM2\n")
    assert in_mm(program.path) == [[0, 0], [1, 0], [2, 0]]
    assert program.notes == (
        "Left out, because it moves nothing: M104 (2 times, first in line 1), M106 (1 time, first "
        "in line 3), the word H (1 time, first in line 6).",
        "Tool length compensation, first in line 5, is read so that the programmed point is the "
        "tip of the tool: calibrate the robot's tool to its tip.",
    )


PRINT = "M83\nG1 X1 E1 F60\n"


def dwells(text):
    return [x.duration for x in read(text).moves if isinstance(x, Dwell)]


def test_a_dwell_of_a_printer_is_in_milliseconds():
    assert dwells("G4 P20\n" + PRINT + "G4 P20\nG4 S2\nX2\n") == [0.02, 0.02, 2.0]
    assert dwells("M104 S200\nG1 X1 F60\nG4 P20\nX2\n") == [0.02]
    assert dwells("G1 X1 F60\nM67 E1 Q2\nG4 P20\nX2 (M83)\n") == [20.0]
    (note,) = [x for x in read(PRINT + "G4 P20\nX2\n").notes if "milliseconds" in x]
    assert "line 3" in note


def test_a_dwell_without_a_time_is_a_stop():
    program = read("G1 X1 F60\nG4 ; wait\nX2\n")
    assert [in_mm(x.path) for x in program.contours] == [[[0, 0], [1, 0]], [[1, 0], [2, 0]]]
    assert len(program.moves) == 2
    (note,) = program.notes
    assert "G4 without a time" in note and "line 2" in note


def extruded(text):
    """Whether material is fed along each feed move of one contour."""
    (event, contour) = read(text).moves
    on = {x.s: x.value for x in contour.events if x.name == "extruder"}
    states, value = [], event.value
    for s in contour.path.breaks[:-1]:
        value = on.get(s, value)
        states.append(value)
    return states


def test_relative_extrusion_outlasts_g90():
    moves = "G1 X1 F60 E2.5\nX2\nX3 E2.5\n"
    program = read("M83\nG90\n" + moves)
    assert extruded("M83\nG90\n" + moves) == [True, False, True]
    (note,) = program.notes
    assert "line 3" in note and "M83" in note
    assert read("G90\nM83\n" + moves).notes == ()
    assert extruded("M83\nM82\nG90\n" + moves) == [True, False, False]
    assert extruded("G91\nG90\n" + moves) == [True, False, False]
    assert extruded("M83\nG91\nG90\n" + moves) == [True, False, True]


def layers(text):
    return [(x.name, x.layer) for x in read(text).contours]


def test_types_of_a_slicer_are_layers():
    for kind, layer in ((";TYPE:", ";LAYER_CHANGE"), ("; FEATURE: ", "; CHANGE_LAYER")):
        text = f"G1 X1 F60\n{layer}\n{kind}Perimeter\nX2\n{kind}Perimeter\nX3\n{layer}\nX4\n"
        assert layers(text + f"{kind}Solid infill\nX5\n;LAYER_COUNT:9\n;Z:.2\nX6\n") == [
            ("line 1", ""),
            ("line 4", "Perimeter"),
            ("line 8", "Perimeter"),
            ("line 10", "Solid infill"),
        ]


def test_layers_of_a_slicer_without_types_are_layers():
    text = "G1 X1 F60\n;LAYER:-1\nX2\n;LAYER:0\nX3\n; layer 2, Z = 0.4\nX4\n"
    numbers = ["", "layer -1", "layer 0", "layer 2"]
    assert [x for _, x in layers(text)] == numbers
    assert [x for _, x in layers("F60\n;LAYER_CHANGE\nG1 X1\n;LAYER_CHANGE\nX2\n")] == [
        "layer 1",
        "layer 2",
    ]


def test_priming_and_retraction_are_events_with_their_time():
    moves = read("M83\nG1 X1 E1 F600\nG1 E-.8 F2400\nG0 X5\nG1 E.8\nG1 X6 E1\n").moves
    found = [
        (x.name, x.value) if isinstance(x, Event) else getattr(x, "duration", type(x))
        for x in moves
    ]
    assert found == [
        ("extruder", True),
        Contour,
        ("extruder feed", -0.8),
        pytest.approx(0.02),
        Rapid,
        ("extruder feed", 0.8),
        pytest.approx(0.02),
        ("extruder", True),
        Contour,
    ]
    inch = read("G20\nM83\nG1 X1 E1 F60\nG1 E-1\n").moves
    assert [x.value for x in inch if isinstance(x, Event)][-1] == -25.4
    assert [x.duration for x in inch if isinstance(x, Dwell)] == [pytest.approx(1.0)]


def test_macros_of_printers_are_left_out_with_one_note():
    program = read(
        "START_PRINT BED_TEMP=60 X=1\nEXCLUDE_OBJECT_START NAME=cube\nstart PRINT_TEMP=3\nG29 G\n"
        "M486 AShape-Box\nM486 S0\nG1 X1 F60\nEXCLUDE_OBJECT_END\nX2\n"
    )
    assert in_mm(program.path) == [[0, 0], [1, 0], [2, 0]]
    (note,) = program.notes
    for word in ("START_PRINT", "EXCLUDE_OBJECT_START", "START (1", "M486 (2 times", "G29"):
        assert word in note


@pytest.mark.parametrize(
    "line", ["SET_GCODE_OFFSET Z=0.2 MOVE=1", "RESTORE_GCODE_STATE NAME=a", "TRANS X=10", "IF[#1]"]
)
def test_macros_that_move_what_follows_are_refused(line, refuses):
    refuses(lambda: read(f"G1 X1 F60\n{line}\nX2\n"), InvalidInput, "line 2")


def test_feed_moves_of_a_printer_from_an_unknown_place_draw_nothing(refuses):
    program = read(PRINT + "G28 X0\nG1 Y180 F2000\n")
    assert in_mm(program.path) == [[0, 0], [1, 0]]
    (note,) = program.notes
    assert "line 4" in note
    refuses(lambda: read(PRINT + "G28 X0\nG1 Y180 E1\n"), InvalidInput, "line 4")
    refuses(lambda: read("G1 X1 F60\nG28 X0\nG1 Y180\n"), InvalidInput, "line 3")


def test_a_shift_of_other_axes_alone_moves_nothing():
    for skip in (frozenset(), frozenset("A")):
        assert in_mm(read("G1 X1 F60\nG92 A0\nX2\n", skip=skip).path) == [[0, 0], [1, 0], [2, 0]]


def test_a_skipped_code_takes_its_coordinates_with_it(refuses):
    text = "G1 X1 F60\nG28.2 X0 Y5\nX2\n"
    refuses(lambda: read(text), InvalidInput, "line 2", "--skip G28.2")
    assert in_mm(read(text, skip=frozenset(("G28.2",))).path) == [[0, 0], [1, 0], [2, 0]]


def test_blending_with_zero_sets_no_tolerance():
    program = read("G64 P0.1\nG64 P0\nG1 X1 F60\nY1\n")
    assert np.isnan(program.path.tolerances).all()
    (note,) = program.notes
    assert "line 2" in note


@pytest.mark.parametrize(
    "line", ["#" + "9" * 400 + "=2", "#[EXP[700]*EXP[700]]=2", "G28 T", "G4 P1 T-.5"]
)
def test_numbers_that_are_no_numbers_of_anything_are_refused(line, refuses):
    refuses(lambda: read(f"G1 X1 F60\n{line}\nX2\n"), InvalidInput, "line 2")


def test_modes_of_other_controllers_move_nothing():
    program = read("G1 X1 F60\nG05 P10000\nG5.1 Q1\nG8 P1\nG187 P1 E.01\nM0 P500\nX2\n")
    assert [in_mm(x.path) for x in program.contours] == [[[0, 0], [1, 0]], [[1, 0], [2, 0]]]
    assert program.notes == (
        "Left out, because it moves nothing: G5 (1 time, first in line 2), G5.1 (1 time, first in "
        "line 3), the word P (2 times, first in line 4), G187 (1 time, first in line 5).",
    )


@pytest.mark.parametrize("code", ["M201", "M203", "M205", "M92", "M566", "M999"])
def test_words_of_m_codes_never_become_motion(code):
    start = "G92 E0\nG0 Z20\nG1 F1500 E-6.5\nG1 F600 Z2\n"
    program = read(f"{start}{code} X5 Y5 E3\nG1 X10 Y10 E0\n{code} X20 Y20\nM2\n")
    assert in_mm(program.path) == [[0, 0, 20], [0, 0, 2], [10, 10, 2]]
    assert f"{code} (2 times, first in line 5)" in program.notes[0]


def test_words_before_an_m_code_belong_to_the_motion_in_force():
    assert in_mm(read("G1 X1 F60\nX2 Y3 M88\n").path) == [[0, 0], [1, 0], [2, 3]]


def test_a_motion_of_the_line_keeps_its_coordinates():
    program = read("F60\nG1 X5 M88 P3\nG1 X9 M67 E2 Q25\n")
    assert in_mm(program.path) == [[0, 0], [5, 0], [9, 0]]
    assert [(x.name, x.value, x.s) for x in program.contours[0].events] == [
        ("analog output 2", 25.0, 0.005)
    ]


def test_tools_and_outputs_are_events():
    program = read_file("events/tools_and_outputs")
    tools = [(x.name, x.value) for x in program.moves if isinstance(x, Event)]
    assert tools == [("tool", 3.0), ("tool", 4.0)]
    assert [(x.name, x.value, x.s) for x in program.contours[0].events] == [
        ("analog output 2", 25.0, 0.001),
        ("output 1", True, 0.002),
    ]


def test_t_alone_changes_the_tool_where_the_program_has_no_m6():
    program = read("T1\nG1 X1 F60\nT2\nX2\n")
    assert [(x.name, x.value) for x in program.moves if isinstance(x, Event)] == [
        ("tool", 1.0),
        ("tool", 2.0),
    ]


def test_the_extruder_is_on_along_moves_that_feed_material():
    bead, retraction, dwell, start, last = read_file("events/extruder").moves
    events = [(x.name, x.value, round(x.s * 1e3, 9)) for x in (*bead.events, *last.events)]
    assert events == [
        ("extruder", True, 1.0),
        ("extruder", False, 3.0),
        ("extruder", False, 1.0),
    ]
    assert (retraction.name, retraction.value) == ("extruder feed", -3.0)
    assert dwell.duration == pytest.approx(3.0)
    assert (start.name, start.value) == ("extruder", True)


def test_feed_modes_give_speeds():
    (contour,) = read_file("feeds/inverse_time").contours
    expected = [1e-3, 1e-3 * 2 / 60, 3e-3 / 60, 2e-3, 1e-3]
    np.testing.assert_allclose(contour.path.speeds, expected, rtol=1e-12)


def test_after_a_change_of_feed_mode_a_feed_rate_is_asked_for_again(refuses):
    text = "G1 X1 F60\nG93 X2 F2\nG94 X3\n"
    refuses(lambda: read(text), InvalidInput, "line 3", "no feed rate")
    refuses(lambda: read("G95 G1 X1 F1\n"), InvalidInput, "line 1", "turns per minute")


def test_a_file_without_feed_rates_leaves_the_speed_open_and_says_so():
    program = read("G0 X1\nG1 X2\n")
    assert np.isnan(program.path.speeds).all()
    assert program.notes == (
        "The file gives no feed rate for moves, first in line 2: they have no speed of their own, "
        "and the job's limits hold.",
    )


def test_a_reference_that_is_not_known_is_a_stop_with_a_note():
    program = read_file("references/unknown")
    assert [type(x) for x in program.moves] == [Contour, Event, Rapid, Contour]
    assert in_mm(program.moves[2].path) == [[7, 7, 4], [7, 7, 1]]
    assert program.notes[0] == (
        "Moves to a reference position that the file does not give are only a stop: G28 (1 time, "
        "first in line 5), G53 (1 time, first in line 12). The tool stays where it is, and goes "
        "straight on to the next point that the file gives: make sure that nothing stands between "
        "them."
    )


def test_a_known_reference_is_a_rapid():
    program = read_file("references/known")
    assert in_mm(program.moves[1].path) == [[3, 2], [3, 5], [3, 2]]


def test_offsets_of_the_controller_can_be_stated_to_be_zero():
    text = "G1 X1 F60\nG55 X2\nG53 G0 X5\nG1 X6\n"
    program = read(text, offsets="zero")
    assert [in_mm(x.path) for x in program.moves] == [
        [[0, 0], [1, 0], [2, 0]],
        [[2, 0], [5, 0]],
        [[5, 0], [6, 0]],
    ]


def test_words_are_left_out_by_name():
    program = read("T1 M6\nG1 X1 A90 F60\nG55 X2\n", skip=frozenset(("T", "M6", "A", "G55")))
    assert in_mm(program.path) == [[0, 0], [1, 0], [2, 0]]
    assert not [x for x in program.moves if isinstance(x, Event)]
    for x in ("M6", "the word T", "the word A", "G55"):
        assert f"{x} (1 time" in program.notes[0]


def test_offsets_at_an_unknown_place_are_refused(refuses):
    start = "F60\nG0 Z1\nG1 X1\nG28 Z5\n"
    for line in ("G92 Z0", "G10 L20 P1 Z0", "G28.1", "#1=#5422", "G1 X2", "G81 X1 Y1 Z0 R1"):
        refuses(lambda line=line: read(start + line), InvalidInput, "line 5: ", "G0")


def test_the_largest_spindle_speed_of_lathes_shifts_nothing(refuses):
    program = read("G1 X1 F60\nG92 S1500\nG50 S900\nX2\n:1000\n")
    assert in_mm(program.path) == [[0, 0], [1, 0], [2, 0]]
    assert not program.contours[0].events
    refuses(lambda: read("G1 X1 F60\nG92\n"), InvalidInput, "line 2: G92 without coordinates")
    refuses(lambda: read("G1 X1 F60\nG50 X2\n"), InvalidInput, "line 2: G50 with coordinates")


def test_contours_of_loops_have_names_of_their_own():
    program = read("F60\no1 repeat [3]\nG91\nG1 X1\nG0 Y1\no1 endrepeat\n")
    assert [x.name for x in program.contours] == ["line 4", "line 4 (2)", "line 4 (3)"]


def test_subprograms_in_files_beside_the_program(tmp_path, refuses):
    (tmp_path / "side.ngc").write_text("o<side> sub\nG1 X#1\nG0 Y1\nG1 X9\no<side> endsub\n")
    (tmp_path / "wrong.ngc").write_text("o<wrong> sub\n\nG1 X\no<wrong> endsub\n")
    data = b"F60\no<side> call [4]\nM2\n"
    options = {"source": "part.ngc", "reading": Reading(), "folder": tmp_path}
    program = read_gcode(data, **options)
    assert [x.name for x in program.contours] == ["side.ngc line 2", "side.ngc line 4"]
    assert in_mm(program.contours[0].path) == [[0, 0], [4, 0]]
    refuses(lambda: read_gcode(b"o<wrong> call\n", **options), InvalidInput, "wrong.ngc, line 3: ")
    refuses(lambda: read_gcode(b"o<../side> call\n", **options), InvalidInput, "line 1: a call of")


def test_loops_and_calls_without_end_are_refused(refuses):
    endless = "#1=0\no1 while [1]\n#1=[#1+1]\no1 endwhile\n"
    refuses(lambda: read(endless), InvalidInput, "part.ngc, line", "a loop without end")
    deep = "o1 sub\no1 call\no1 endsub\no1 call\n"
    refuses(lambda: read(deep), InvalidInput, "part.ngc, line 2", "calls within each other")
    brackets = "G1 X" + "[" * 60 + "1" + "]" * 60 + "\n"
    refuses(lambda: read(brackets), InvalidInput, "line 1", "brackets within each other")


def test_cycles_without_end_are_refused(refuses):
    for words in ("G81 X1 Z-1 R1 L999999", "G83 X1 Z-1 R1 Q.00001 L9", "G73 Z-1 R1 Q.001 L199"):
        text = f"F60\nG91\n{words}\n"
        refuses(lambda text=text: read(text), InvalidInput, "line 3", "holes and pecks together")
    assert len(read("F60\nG81 X1 Y1 Z-1 R1 Q0\n").contours) == 1


def test_a_file_of_subprograms_alone_says_so(refuses):
    text = "o<pocket> sub\nG1 X1 F60\no<pocket> endsub\nM2\n"
    refuses(lambda: read(text), InvalidInput, "it only defines subprograms (o<pocket>)")


@pytest.mark.parametrize(
    "code",
    ["G5.2 X1 Y1 P0 L3", "G33 Z1 K1", "G38.2 Z-1", "M98 P1", "G17.1", "G41 D1", "G68 X0 R9", "G16"],
)
def test_what_would_move_the_rest_is_never_skipped(code, refuses):
    refuses(lambda: read(f"F60\nG1 X1\n{code}\n", unknown="skip"), InvalidInput, "line 3")


def test_a_code_that_nobody_knows_is_not_skipped_with_coordinates(refuses):
    assert read("G1 X1 F60\nG123\n", unknown="skip").notes == (
        "Left out, because it moves nothing: G123 (1 time, first in line 2).",
    )
    refuses(lambda: read("G1 X1 F60\nG123\n"), InvalidInput, "line 2", "--skip G123")
    refuses(lambda: read("G1 X1 F60\nG123 X2\n", unknown="skip"), InvalidInput, "line 2", "G123")


def test_lines_left_out_are_noted():
    assert read_file("format/block_delete").notes == (
        "2 lines with a slash (block delete) were left out, first line 3.",
    )
    assert read_file("frame/percent_signs").notes == (
        "Lines after the end of the program, line 5, were not read.",
    )
    assert read("%\nG1 X1 F60\n%\n\n").notes == ()


def test_the_guide_s_example_is_what_the_guide_says():
    guide = Path(__file__).parents[3] / "docs" / "guides" / "gcode.md"
    (text,) = re.findall(r"```text\n(.*?)```", guide.read_text(), re.DOTALL)
    program = read(text)
    assert [type(x) for x in program.moves] == [Event, Event, Contour, Rapid]
    contour = program.contours[0]
    assert contour.name == "line 5"
    assert contour.path.speeds == pytest.approx([0.1, 0.1])
    assert contour.path.tolerances == pytest.approx([5e-4, 5e-4])
    assert contour.path.lengths[1] == pytest.approx(0.06 * math.pi / 2)
    assert [(x.name, x.value) for x in contour.events] == [("spindle", False)]
    assert in_mm(program.moves[-1].path)[-1] == [70, 150]


def test_the_guide_quotes_a_refusal_as_it_is():
    guide = Path(__file__).parents[3] / "docs" / "guides" / "gcode.md"
    with pytest.raises(InvalidInput) as caught:
        read("G1 X1 F60\n" + "\n" * 12 + "G55 X2\n")
    assert str(caught.value) in guide.read_text()


def test_nothing_to_follow_is_refused_with_the_name_of_the_file(refuses):
    for text in ("", "\n\n", "%\n%", "; nothing", "G0 X1\nG0 X2\n"):
        refuses(lambda text=text: read(text), InvalidInput, "part.ngc has no contour")


def test_p_that_may_belong_to_two_codes_is_refused(refuses):
    refuses(lambda: read("G4 G64 P1\n"), InvalidInput, "line 1", "G4 or G64")


def test_turns_without_end_are_refused(refuses):
    refuses(lambda: read("F1\nG2 I1 P999999999\n"), InvalidInput, "line 2", "segments")
    refuses(lambda: read("F1\nG2 I1 Z1 P9999999\n"), InvalidInput, "line 2", "segments")


WORD = st.sampled_from(
    ["X1", "X-2.5", "X.25", "X+3.", "Y4", "Y0", "Y-.5", "Z0", "Z1.5", "F60", "F1200.5"]
)


@given(st.lists(st.lists(WORD, unique_by=lambda x: x[0], max_size=4), min_size=1, max_size=12))
def test_plain_lines_are_read_to_the_same_effect_as_all_others(lines):
    ordered = [sorted(x, key=lambda w: "XYZF".index(w[0])) for x in lines]
    plain = "G1 F10 X9\n" + "".join(" ".join(x) + "\n" for x in ordered) + "X50\n"
    # A comment in every line keeps it from the short way.
    other = "G1 F10 X9\n" + "".join("(x)" + " ".join(x) + "\n" for x in ordered) + "(x)X50\n"
    a, b = read(plain), read(other)
    for name in ("starts", "tangents", "lengths", "speeds", "tolerances"):
        found, expected = (getattr(p.contours[0].path, name) for p in (a, b))
        np.testing.assert_array_equal(found, expected)
    assert a.contours[0].name == b.contours[0].name


def mutated(data, rng):
    """A few bytes changed, put in, left out or doubled."""
    data = bytearray(data)
    for _ in range(rng.randint(1, 5)):
        at = rng.randrange(len(data) + 1)
        kind = rng.randrange(4)
        if kind == 0:
            data[at : at + 1] = bytes([rng.randrange(256)])
        elif kind == 1:
            data[at:at] = bytes([rng.choice(b"GMXYZIJKRPFSNOE0123456789.-+ \n\r()%;/#[]<>=")])
        elif kind == 2:
            del data[at : at + rng.randint(1, 5)]
        else:
            data[at:at] = data[at : at + 40]
    return bytes(data)


@pytest.mark.parametrize("unknown", ["refuse", "skip"])
def test_any_bytes_make_a_program_or_a_refusal_with_its_line(unknown):
    rng = random.Random(20)
    bodies = [x.read_bytes() for x in FILES]
    made = 0
    for _ in range(1500):
        data = mutated(rng.choice(bodies), rng)
        try:
            program = read(data, unknown=unknown)
        except InvalidInput as error:
            message = str(error)
            assert re.match(r"part\.ngc(, line \d+: | has no contour)", message)
            assert message.endswith(".") and not message.endswith("..")
        else:
            assert isinstance(program, Program)
            made += 1
    assert made > 100


def spiral(n):
    """Lines of G1 with a mean step of half a millimetre."""
    turn = np.cumsum(np.random.default_rng(3).normal(0, 0.3, n))
    x, y = np.cumsum(0.5 * np.cos(turn)), np.cumsum(0.5 * np.sin(turn))
    lines = [f"G1 X{a:.4f} Y{b:.4f}" for a, b in zip(x, y, strict=True)]
    return "\n".join(["G21 G90 F1200", "G0 X0 Y0", *lines, "M2"]).encode()


def test_a_long_program_says_how_far_it_is():
    data, shares = spiral(150_000), []
    program = read_gcode(
        data, source="long.ngc", reading=Reading(), progress=lambda x: shares.append(x.done)
    )
    # Vertices that are mended have an arc more.
    assert 150_000 <= len(program.contours[0].path) < 151_000
    assert len(shares) > 20 and shares[-1] == 1.0
    assert all(0 <= a <= b <= 1 for a, b in zip(shares, shares[1:], strict=False))


def test_a_long_program_takes_memory_in_proportion():
    import tracemalloc

    data = spiral(20_000)
    tracemalloc.start()
    read(data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # 1 kB a line is 150 MB for 150,000 lines.
    assert peak < 20_000 * 1_000


@pytest.mark.parametrize(
    "data",
    [
        b"F1\nG1 X1\n" + b"X1 " * 5_000_000,
        b"F1\nG1 X1\n" + b"(" * 60_000 + b"\n",
        b"F1\nG1 X1\n(" + b")(" * 30_000 + b"\n",
        b"F1\nG1 X" + b"1" * 60_000 + b"\n",
        b"F1\nG1 X1" + b"\n" * 300_000,
        b"F1\nG1 X1\n" + b"G0 X1\nG0 X2\n" * 50_000,
        b"G0 X1\nG0 X2\n" * 50_000,
        b"F1\nG1 X1\n" + b"O1\n" * 20_000,
        b"".join(b"o%d sub\no%d endsub\n" % (i, i) for i in range(5_000))
        + b"o1 repeat [9000]\no4999 call\no1 endrepeat\n",
        b"#1=0\no1 repeat [50]\no2 if [0]\n" + b"o2 elseif [0]\n" * 2_000 + b"o2 endif\n"
        b"o1 endrepeat\n",
    ],
    ids=[
        *("one line", "open", "comments", "digits", "empty lines", "rapids", "rapids only"),
        *("numbers", "calls", "branches"),
    ],
)
def test_nothing_takes_longer_than_in_proportion(data, usual_time):
    assert time_to_read(data) < PATIENCE * usual_time


def test_a_long_program_takes_time_in_proportion(usual_time):
    # It is 7.5 times as long.
    assert min(time_to_read(spiral(150_000)) for _ in range(2)) < 15 * usual_time


@pytest.fixture(scope="module")
def usual_time():
    """Time of the processor for a usual program [s]."""
    return min(time_to_read(spiral(20_000)) for _ in range(3))


def time_to_read(data):
    """Time of the processor until a program is read, or refused [s]."""
    begin = time.process_time()
    try:
        read(data)
    except InvalidInput as error:
        assert "part.ngc" in str(error)
    return time.process_time() - begin
