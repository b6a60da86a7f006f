"""G-code: corpus, hand-computed points, refusals, and the effect of every word."""

import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.files.tables import refusals, rows

from armcontour.core.errors import InvalidInput
from armcontour.files.drawings.gcode import read_gcode
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.program import Contour, Dwell, Event, Program, Rapid

CORPUS = Path(__file__).with_name("gcode")
FILES = sorted(CORPUS.rglob("*.ngc"))
REFUSED = re.compile(rb"; refused in line (\d+): (.*)")
# With / between contours and > at rapids.
VERTICES = re.compile(rb"; vertices \[mm\] ([^\r\n]*)")


def read(text, **options):
    """Read a file of the corpus by its name, or a text with | for the ends of lines."""
    if isinstance(text, str) and re.fullmatch(r"\w+/\w+", text):
        data = (CORPUS / f"{text}.ngc").read_bytes()
        return read_gcode(data, source=f"{text}.ngc", options=ReadOptions(repair_vertices=0.0))
    data = text if isinstance(text, bytes) else f"{text}\n".replace("|", "\n").encode()
    return read_gcode(data, source="part.ngc", options=ReadOptions(**options))


def in_mm(path):
    return (path.vertices * 1e3).round(6).tolist()


def describe_moves(program):
    """The moves in words, contours with their events and the places of these [mm]."""
    words_of_moves = []
    for x in program.moves:
        if isinstance(x, Contour):
            events = [f" {e.name}={e.value}@{e.s * 1e3:.9g}" for e in x.events]
            words_of_moves.append("cut" + "".join(events))
        elif isinstance(x, Event):
            words_of_moves.append(f"{x.name}={x.value}")
        else:
            words_of_moves.append(f"dwell {x.duration:.9g}" if isinstance(x, Dwell) else "rapid")
    return ", ".join(words_of_moves)


def check_points(table, **options):
    """Rows of text, points [mm] with / between contours and > at rapids, and words of the notes.

    Rapids are compared only where there are any in the row; zeros at the end may be missing. Texts
    without words have no notes.
    """
    for text, points, *words in rows(table):
        program = read(text, **options)
        kinds = (Contour, Rapid) if ">" in points else Contour
        moves = [x for x in program.moves if isinstance(x, kinds)]
        parts = [x.strip() for x in points.split("/")]
        assert [isinstance(x, Rapid) for x in moves] == [x[0] == ">" for x in parts], text
        for move, part in zip(moves, parts, strict=True):
            expected = np.array([x.split(",") for x in part.strip("> ").split()], dtype=float)
            vertices = move.path.vertices * 1e3
            d = expected.shape[1]
            np.testing.assert_allclose(vertices[:, :d], expected, rtol=0, atol=1e-9, err_msg=text)
            assert np.abs(vertices[:, d:]).max(initial=0.0) <= 1e-9, text
        notes = " ".join(program.notes)
        missing = []
        for cell in words:
            missing += [x for x in cell.split(" ... ") if x not in notes]
        assert not missing and (words or "/" in text or not notes), (text, notes)


def test_the_corpus_cites_sources_and_its_refusals_name_their_line(refuses):
    assert len(FILES) >= 60
    for file in FILES:
        data = file.read_bytes()
        name = f"{file.parent.name}/{file.stem}"
        assert re.match(rb"(\xef\xbb\xbf)?; (LinuxCNC|docs/guides/gcode.md)", data), file
        for line, words in REFUSED.findall(data):
            begin = f"{name}.ngc, line {int(line)}: "
            index = int(line) - 1
            words = words.rstrip(b"\r").decode()
            refuses(lambda name=name: read(name), InvalidInput, begin, words, index=index)


def test_programs_of_the_corpus_have_the_points_computed_by_hand():
    table = []
    for file in FILES:
        name = f"{file.parent.name}/{file.stem}"
        comments = VERTICES.findall(file.read_bytes())
        table += [f"{name} => {points.decode()}" for points in comments]
    assert len(table) >= 35
    check_points("\n".join(table))


def test_programs_of_the_corpus_have_the_values_computed_by_hand():
    nan = math.nan
    pi = math.pi
    for name, kind, expected in (
        ("units/change_on_the_way", "speeds", [0.01, 0.0254, 0.0254]),
        ("units/inches", "speeds", [0.0254, 0.0254]),
        ("control/path_control", "tolerances", [nan, 5e-5, 0.0, 0.0, nan]),
        ("units/inches", "tolerances", [nan, 2.54e-4]),
        ("arcs/quarter", "lengths", [pi / 2 * 1e-3]),
        ("arcs/full_circles", "lengths", 2e-3 * pi * np.array([10, 5, 2])),
        # A chord as long as the radius sees 60 degrees, the other way 300.
        ("arcs/radius", "curvatures", [100, 100, 200]),
        ("arcs/radius", "lengths", [pi / 300, pi / 60, pi / 200]),
        # Rounded a little short, the radius is that of a half circle.
        ("arcs/radius_rounded_short", "curvatures", [1 / 5.001e-3]),
        ("arcs/radius_rounded_short", "lengths", [pi * 5.001e-3]),
    ):
        values = getattr(read(name).contours[0].path, kind)
        np.testing.assert_allclose(values, expected, rtol=1e-12, err_msg=f"{name} {kind}")
    # Points [mm] at arc lengths: clockwise from (0, 0) around (1, 0), and counter-clockwise around
    # the origin; G2 to the left of the chord, and G3's long way round to the right; as seen from
    # the positive end of the third axis, G18 G3 over -z, and G19 G2 over +z.
    half = math.sqrt(0.5)
    high = 10 - math.sqrt(75)
    for name, s, expected in (
        ("arcs/quarter", [1 / 4], [[1 - half, half]]),
        ("arcs/radius", [1 / 0.6, 35 / 3], [[5, high], [15, high - 20]]),
        ("arcs/other_planes", [2.5, 7.5, 12.5], [[5, 0, 5], [10, 5, 5], [5, 5, 0]]),
    ):
        values = read(name).contours[0].path(np.array(s) * pi * 1e-3) * 1e3
        np.testing.assert_allclose(values, expected, atol=1e-9, err_msg=name)


def test_a_program_with_any_height_is_in_space():
    for text in ("F60|G17 G2 X10 R5", "G0 Z5|G0 Z0|G1 X1 F60"):
        assert read(text).dimension == 2, text
    for text in ("F60|G18 G2 X10 R5", "G0 Z5|G1 X1 F60", "G1 X1 F60|G0 Z5|X9|Z0|G1 X10"):
        program = read(text)
        assert {x.path.dimension for x in program.moves} == {3} == {program.dimension}, text
    assert in_mm(program.moves[1].path) == [[1, 0, 0], [1, 0, 5], [9, 0, 5], [9, 0, 0]]


# Moves and events. What is so already is no event, and the end switches off; T alone changes the
# tool where the program has no M6.
MOVES = """
events/spindle_and_coolant => spindle speed=1000.0, spindle=True, coolant=flood, cut spindle \
speed=2000.0@1 coolant=mist and flood@2 spindle=reverse@2 spindle=False@3 coolant=False@3, rapid
events/on_only_once => spindle speed=500.0, spindle=True, cut spindle speed=600.0@2 spindle=False@3
M5|G1 X1 F60 => spindle=False, cut
M3 S60|G1 X1 F60|X2 S50|M5 => spindle speed=60.0, spindle=True, cut spindle speed=50.0@1 \
spindle=False@2
M3 $0 S1|G1 X1 F60|X2|M5 $0|X3 => spindle speed=1.0, spindle=True, cut spindle=False@2
M3 $0|S200 $1|$1 M4|G1 X1 F60|M5$-1|X2 => spindle=True, spindle 1 speed=200.0, \
spindle 1=reverse, cut spindle=False@1 spindle 1=False@1
M3 $2|G1 X1 F60|M2 => spindle 2=True, cut spindle 2=False@1
G1 X1 F60|G0 X2|M5|G0 X3|G1 X4 => cut, rapid, spindle=False, rapid, cut
events/dwell => cut, dwell 0.5, cut, cut
events/pause => cut, pause=True, cut, pause=optional, cut
events/tools_and_outputs => tool=3.0, cut analog output 2=25.0@1 output 1=True@2, tool=4.0, cut
references/unknown => cut, tool=2.0, rapid, cut
T1|G1 X1 F60|T2|X2 => tool=1.0, cut, tool=2.0, cut
F60|M88 P3|G1 X5 M48|G1 X9 M67 E2 Q25 => cut analog output 2=25.0@5
"""


def test_moves_and_events_are_in_the_order_of_the_program():
    for text, expected in rows(MOVES):
        assert describe_moves(read(text)) == expected, text


@given(
    radius=st.floats(1e-3, 10),
    turn=st.floats(0, 6.3),
    sweep=st.floats(1e-3, 6.28),
    offset=st.floats(-2.8e-5, 2.8e-5),
    way=st.sampled_from([2, 3]),
)
def test_arcs_with_rounded_centres_stay_near_them_and_meet_their_ends(
    radius, turn, sweep, offset, way
):
    b = turn + (sweep if way == 3 else -sweep)
    target = [(radius + offset) * math.cos(b), (radius + offset) * math.sin(b)]
    text = (
        f"G0 X{radius * math.cos(turn):.12f} Y{radius * math.sin(turn):.12f} F1|"
        f"G90.1 G{way} X{target[0]:.12f} Y{target[1]:.12f} I0 J0"
    )
    path = read(text, units=1.0).contours[0].path
    np.testing.assert_allclose(path.vertices[-1], target, atol=1.5e-9)
    distance = np.linalg.norm(path(np.linspace(0, path.length, 200)), axis=1)
    # At most twice the error of the centre.
    assert np.abs(distance - radius).max() <= 2 * abs(offset) + 1e-9


def test_helices_and_arcs_with_rounded_ends_are_read():
    for tolerance in (1e-4, 1e-8):
        for g61 in ("", "G61|"):
            text = f"{g61}G0 X10 Y0 Z2 F60|G3 I-10 Z0|G3 I-10 Z-2"
            path = read(text, chord_tolerance=tolerance).contours[0].path
            s = np.linspace(0, path.length, 20_001)
            points = path(s)
            assert np.abs(0.01 - np.hypot(points[:, 0], points[:, 1])).max() <= min(tolerance, 1e-9)
            # The height is proportional to the angle, and the tool does not stop.
            turn = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
            height = 2e-3 - turn / (2 * np.pi) * 2e-3
            np.testing.assert_allclose(points[:, 2], height, atol=1e-9)
            assert len(path.stops) == 0
            np.testing.assert_allclose(np.linalg.norm(path(s, 1), axis=1), 1, atol=1e-6)
            exact = 2 * np.hypot(2 * np.pi * 0.01, 2e-3)
            assert path.length == pytest.approx(exact, rel=1e-7)
            np.testing.assert_allclose(path.vertices[-1], [0.01, 0, -2e-3], rtol=0, atol=1e-17)
    for contour in read("arcs/nearly_full").contours:
        path = contour.path
        assert len(path) == 2 and path.turns[0] < 1e-12
        radius = np.linalg.norm(path(np.linspace(0, path.length, 1000)), axis=1)
        assert np.abs(radius - 0.01).max() <= 1.1e-5
        assert path.length == pytest.approx(2 * np.pi * 0.01, rel=5e-3)
        np.testing.assert_allclose(path.vertices[-1][0], 10.01e-3, atol=1e-15)
    # Radii that differ more than rounding makes them are refused.
    text = "G0 X{0} Y0 F60|G3 X0 Y{1} I-{0}"
    for r, end in ((10, 10.028), (100, 100.099), (1000, 1000.49)):
        assert len(read(text.format(r, end)).contours[0].path) == 1
    ends = (10, 10.029), (100, 100.11), (1000, 1000.51)
    refusals(read, [(text.format(*x), "part.ngc, line 2 ... allowed") for x in ends])


SLICED = "G1 X0 Y10 F600|M101|G1 X50|M103|G83|G1 Y50|M2"
ARC_WORDS = {"M101": {"arc": True}, "m103": {"arc": False, "gas": 2.5}, "G83": {}}


def test_declared_words_switch_outputs():
    program = read(SLICED, words=ARC_WORDS)
    assert describe_moves(program) == "cut arc=True@10 arc=False@60 gas=2.5@60"
    (note,) = program.notes
    assert "G83 (first in line 5)" in note
    # Their own parameters have no meaning; those of other codes on the line keep theirs. As by
    # other M codes, outputs are switched before the motion or dwell of the line.
    program = read("F600|M101 P5|G1 X10 M103|G4 P2 M101|G1 X20", words=ARC_WORDS)
    assert describe_moves(program) == (
        "arc=True, arc=False, gas=2.5, cut arc=True@10, dwell 2, cut"
    )
    # A declared M code replaces the usual meaning.
    program = read("F600|M3 S100|G1 X10|M5", words={"M3": {"arc": True}, "M05": {"arc": False}})
    assert describe_moves(program) == "spindle speed=100.0, arc=True, cut arc=False@10"


def test_words_that_move_or_end_the_program_cannot_be_declared():
    for word in ("G1", "G28", "G91", "M2", "M30", "M98", "X", "arc"):
        with pytest.raises(InvalidInput, match=word) as caught:
            read(SLICED, words={word: {"arc": True}})
        assert caught.value.key == ("words", word)
    refusals(
        lambda text: read(text, words=ARC_WORDS),
        [("F600|G1 X1|G83 X5 Z-2", "part.ngc, line 3 ... G83 ... coordinates")],
    )
    assert "G83 is not supported" in str(pytest.raises(InvalidInput, read, SLICED).value)


CIRCLE = 2 * math.pi * 0.01
HELIX = "G0 X10 Y0 Z0 F500|G2 X10 Y0 Z-3 I-10 J0 P3|G1 X20"


@pytest.mark.parametrize(
    ("comment", "arc_turns", "turns"),
    [
        ("", "total", 3),
        ("", "extra", 4),
        ("(Post Processor: linuxcnc_post)|", None, 3),
        ("; for FluidNC|", None, 3),
        (";FLAVOR:Marlin|", None, 4),
        (";FLAVOR:Marlin|", "total", 3),
    ],
)
def test_p_of_an_arc_is_the_number_of_turns_of_the_controller(comment, arc_turns, turns):
    program = read(comment + HELIX, arc_turns=arc_turns)
    path = program.contours[0].path
    assert path.length == pytest.approx(math.hypot(turns * CIRCLE, 3e-3) + 0.01, rel=1e-7)
    s = np.linspace(0, path.length - 0.0101, 5000)
    angle = np.unwrap(np.arctan2(path(s)[:, 1], path(s)[:, 0]))
    assert abs(angle[-1]) == pytest.approx(turns * 2 * np.pi, rel=1e-3)
    assert len(program.notes) == (arc_turns is None)


@pytest.mark.parametrize(
    ("arc", "length"),
    [
        ("G3 I-10 P1", CIRCLE),
        ("G3 I-10 P3", 3 * CIRCLE),
        ("G3 X0 Y10 I-10 P2", 1.25 * CIRCLE),
        ("G3 X0 Y10 R10 P2", 1.25 * CIRCLE),
        ("G2 X0 Y10 I-10 P2", 1.75 * CIRCLE),
    ],
)
def test_flat_arcs_have_full_circles_before_them(arc, length):
    path = read(f"G0 X10 F600|{arc}", arc_turns="total").contours[0].path
    assert path.length == pytest.approx(length, rel=1e-12)
    assert np.linalg.norm(path(np.linspace(0, length, 99)), axis=1) == pytest.approx(0.01)
    assert len(path.stops) == 0


def test_p_of_an_arc_is_refused_with_both_meanings_if_the_controller_is_unknown():
    both = (
        "part.ngc, line 2 ... LinuxCNC and FluidNC 3 turns ... Marlin 3 full circles ... arc_turns"
    )
    refusals(
        read,
        [(HELIX, both), ("(LinuxCNC or Marlin)|" + HELIX, both.replace("line 2", "line 3"))],
    )
    refusals(
        lambda text: read(text, arc_turns="total"),
        [
            (HELIX.replace("P3", "P0"), "line 2 ... from 1 to"),
            (HELIX.replace("P3", "P1.5"), "line 2 ... whole number"),
            (HELIX.replace("P3", "P1e9"), "exponent"),
            (HELIX.replace("P3", "P1000000"), "line 2 ... from 1 to"),
        ],
    )


def test_words_without_motion_are_skipped_with_a_note():
    check_points("""
format/block_delete => 0,0 1,0 2,0 => lines with a slash ... first in line 3
frame/percent_signs => 0,0 1,0 2,0 => after the end of the program, line 5,
references/unknown => 1,2,1 3,2,1 / > 7,7,4 7,7,1 / 7,7,1 8,7,1 => G28 (f ... line 5 ... G53 (f
G1 X2 F60 => 0,0 2,0
G1 X1 F60|G0 X1|G1 X2 => 0,0 1,0 2,0
M104 S2|G1 X1 F6|M106 S2|M104 S0|X2 => 0,0 1,0 2,0 => M104 (first in line 1) ... M106 (f
G1 X1 F60|G43 H2|X2 => 0,0 1,0 2,0 => first in line 2
G1 X1 F60|G4|X2 => 0,0 1,0 / 1,0 2,0 => G4 without a time ... line 2
M117 Hello X5|M862.3 P "MK3S"|M84 X Y E|G1 X1 F6 => 0,0 1,0 => M117 (f ... M862.3 (f ... M84 (f
G1 X1 F60 A0|X2 C0.0 => 0,0 1,0 2,0 => the word A with the value 0 ... word C with
G1 X1 F60|X2 Y3 M60 => 0,0 1,0 2,3 => M60
G0 X1|G1 X2 => 1,0 2,0 => without a feed rate, first in line 2
G92 E0|G1 X1 E1 F60|G1 E-5|X2 => 0,0 1,0 2,0 => The word E, first in line 1, is ignored
%|G1 X1 F60|%| => 0,0 1,0
G98 G1 X1 F60|G99 X2|G49|G59 => 0,0 1,0 2,0
G53 G90 G40|G1 X1 F60 => 0,0 1,0 => G53 without coordinates
START_PRINT BED=60|set_velocity_limit ACCEL=3|G1 X1 F60|END_PRINT => 0,0 1,0 => \
SET_VELOCITY_LIMIT (first in line 2) ... START_PRINT (first in line 1), END_PRINT (first in line 4)
""")


def test_feed_moves_that_replace_rapids_after_a_reference_are_no_contours():
    # Free CAM programs write rapids as G1 with a high feed rate, except those along Z.
    check_points("""
G0 Z5 F60|G1 Z1|G53 G0 Z0|G1 X2 Y3|G0 Z5|G1 Z0 => 0,0,5 0,0,1 / 2,3,5 2,3,0 => line 4, are read as
G0 Z5 F60|G1 Z1|G30 Z9|G1 X2|Y3|G0 Z5|G1 Z0 => 0,0,5 0,0,1 / 2,3,5 2,3,0 => G30 (first in line 3)
""")
    (note,) = [x for x in read("G1 X1 F60|G28 Z0|G1 X2|G0 Z1|G1 X3").notes if "rapids," in x]
    assert "line 3" in note
    table = [
        ("F60|G1 X1|G53 G0 Z0|G1 X2|G1 Z-1", "line 5: ", "G0"),
        ("F60|G1 X1|G53 G0 Z0|G2 X2 I1|G0 Z1", "line 4: ", "G0"),
    ]
    refusals(read, table)


def test_arcs_that_turn_back_at_both_ends_are_noted_with_their_line():
    corner = "G0 X0 Y0 F60|G1 X10|G{} X15 Y5 I0 J5|G1 Y20"
    (note,) = read(corner.format(2)).notes
    assert "line 3 (270° instead of 90°)" in note
    assert not read(corner.format(3)).notes
    # The same arc back and forth, an arc with one smooth end, and an arc at the start.
    for text in (
        "G0 X5 F60|G3 X0 Y5 I-5|G2 X5 Y0 J-5|G3 X0 Y5 I-5|G2 X5 Y0 J-5",
        "G0 X0 Y0 F60|G1 X10|G2 X15 Y5 I0 J5|G1 Y0",
        "G0 X10 Y0 F60|G2 X15 Y5 I0 J5|G1 Y20",
    ):
        assert not read(text).notes, text


def test_units_come_from_options_if_the_file_has_none():
    (contour,) = read("G1 X2 F60|G21|X3000", units=1.0).contours
    np.testing.assert_allclose(contour.path.vertices, [[0, 0], [2, 0], [3, 0]], atol=1e-15)
    assert contour.path.speeds == pytest.approx([1.0, 1.0])
    program = read("G64 P0.1|G64 P0|G1 X1 F60|Y1")
    assert np.isnan(program.path.tolerances).all() and "line 2" in program.notes[0]
    assert np.isnan(read("G0 X1|G1 X2").path.speeds).all()


# Unsupported words, and their messages.
UNSUPPORTED = """
O100 sub => 'O100SUB'
o<pocket> call [1] => 'O<POCKET>CALL[1]'
IF[#1EQ2]GOTO3 => 'IF[#1EQ2]GOTO3'
M98 P100 => M98
M72 => M72
M99 => M99
#1=5 => '#1=5'
X-#<a> => 'X-#<A>'
X[1 2] => 'X[12]'
G65 P9010 => G65
G10 L2 P1 X0 => G10
G28.1 => G28.1
G30.1 => G30.1
G52 X1 => G52
G92 X1 => G92 without E
G92 => G92 without E
G92.3 => G92.3
G93 G1 X2 F2 => G93
G5.2 X1 Y1 P0 L3 => G5.2
G17.1 => G17.1
G54.1 P2 => G54.1
G95 => G95
G-1 => G-1
G1.23 => G1.23
M-1 => M-1
G1 X=10 Y=20 => 'X=10Y=20'
$H => '$H'
$10=1 => '$10=1'
N3 T0*57 => '*57'
G28 T => 'T'
G1 A90 => A90, a move of the axis A,
"""


# Unsupported words with a remedy of their own.
REMEDIES = """
G1 X1 F60|G81 X2 Z-1 R1 => G81 is not supported ... drilling cycles as plain moves
G1 X1 F60|G73 X2 Z-1 R1 Q1 => G73 is not supported ... drilling cycles as plain moves
G1 X1 F60|G41 D1 => G41 is not supported ... tool's centre
G1 X1 F60|G96 S200 => G96 is not supported ... lathes
G1 X1 F60|SET_GCODE_OFFSET Z=1 => SET_GCODE_OFFSET is a command or a macro of Klipper
"""


def test_unsupported_words_are_refused_with_their_line():
    table = [
        (f"G1 X1 F60|{x}|X2", f"part.ngc, line 2: {y} is not supported. Post-process the program")
        for x, y in rows(UNSUPPORTED)
    ]
    refusals(read, table)
    refusals(read, REMEDIES, "part.ngc, line 2: ")
    for text in ("O0100 (PART)|G1 X1 F60", "%|N1 O7|G1 X1 F60|M30|O100 sub|%"):
        assert in_mm(read(text).path) == [[0, 0], [1, 0]]


WRONG = f"""
G1 X1 F60|G28 X0|G1 Y180 => line 3
G1 X Y5 F60 => line 1: 'XY5F60' is not supported
G1 X1 F60 $1 => line 1: no code on this line uses the word $
G1 X1 F60 H1 => line 1: no code on this line uses the word H
M3 $-2 => line 1: the number of a spindle $ must not be below -1
M3 $.5 => line 1: the number of a spindle $ must be a whole number
G1 X1 F60|G1 Y1 Y2 => line 2 ... Y occurs twice
G1 X1 F60|G53 G1 X2 => line 2 ... only a rapid move
G1 X1 F60|G55 X2 => line 2 ... one system
%|% => part.ngc has no contour
; nothing => part.ngc has no contour
G0 X1|G0 X2 => part.ngc has no contour
G4 G64 P1 => line 1 ... word P
F1|{"X1 " * 30_000} => line 2 ... characters
F1|G1 X1|{"(" * 60_000} => line 3 ... does not end
F1|G1 X1|({")(" * 30_000} => line 3 ... does not end
F1|G1 X{"1" * 60_000} => line 2 ... but has 60000
"""


def test_moves_that_cannot_be_followed_are_refused_with_their_line():
    refusals(read, WRONG, "part.ngc")
    refusals(read, [("F60|G0 Z1|G1 X1|G28 Z5|G1 X2", "line 5: ", "G0")])
    refusals(read, [(x, "part.ngc has no contour") for x in ("", "||")])


def test_the_example_of_the_guide_has_the_output_in_the_guide():
    guide = Path(__file__).parents[3] / "docs" / "guides" / "gcode.md"
    (text,) = re.findall(r"```text\n(.*?)```", guide.read_text(), re.DOTALL)
    program = read(text)
    quarter = 60 * math.pi / 2
    end = math.hypot(110, 50) + quarter
    moves = f"spindle speed=1000.0, spindle=True, cut spindle=False@{end:.9g}, rapid"
    assert describe_moves(program) == moves and program.contours[0].name == "line 5"
    path = program.contours[0].path
    assert path.lengths[1] == pytest.approx(quarter * 1e-3)
    np.testing.assert_allclose([path.speeds, path.tolerances], [[0.1, 0.1], [5e-4, 5e-4]])
    assert in_mm(program.moves[-1].path)[-1] == [70, 150]


def broken(data, rng):
    """One or two places changed, put in, left out or doubled."""
    data = bytearray(data)
    for _ in range(rng.randint(1, 2)):
        position = rng.randrange(len(data) + 1)
        kind = rng.randrange(5)
        other = rng.choice(b"0123456789.-+eMZACGXYIJ ,;\n()<>[]#&%/=\"'")
        if kind == 0:
            data[position : position + 1] = bytes([rng.randrange(256)])
        elif kind < 3:
            data[position : position + kind % 2] = bytes([other])
        elif kind == 3:
            del data[position : position + rng.randint(1, 5)]
        else:
            data[position:position] = data[position : position + 40]
    return bytes(data)


def test_any_bytes_are_read_or_refused_with_their_line():
    rng = random.Random(20)
    made = 0
    bodies = [x.read_bytes() for x in FILES]
    for _ in range(400):
        try:
            program = read(broken(rng.choice(bodies), rng))
        except InvalidInput as error:
            assert re.match(r"part\.ngc(, line \d+: | has no contour).*[^.]\.$", str(error))
        else:
            assert isinstance(program, Program)
            made += 1
    assert made > 30


def test_modal_words_without_an_effect_are_noted():
    plain = "G0 X0 Y0|G1 X10 F600|G1 Y10|M2"
    drawn = read(plain)
    program = read(f"G17 G20 G40 G49 G54 G80 G90 G94 G97|G8 G15 G69|G21|{plain}")
    np.testing.assert_array_equal(program.path.vertices, drawn.path.vertices)
    (note,) = program.notes
    assert all(x in note for x in ("G97", "G8", "G15", "G69"))
    for words in ("G13.1 G23 G40.1 G67", "G5 P10000", "G5.1 Q1", "G187 P1 E0.05", "G90 G50 G17"):
        program = read(f"G21|{words}|{plain}")
        np.testing.assert_array_equal(program.path.vertices, drawn.path.vertices)
        assert len(program.notes) == 1
    # With coordinates, these codes are splines, or a shift of the origin.
    splines = [("G5 X1 Y1 P2 Q3", "G5"), ("G5.1 X1 Y1 I2", "G5.1"), ("G50 X0 Z0", "G50")]
    refusals(read, [(f"G21|{line}|{plain}", words) for line, words in splines])
    stops = read(f"G61.1|{plain}")
    assert (stops.path.tolerances == 0).all() and "G61.1" in stops.notes[0]
    np.testing.assert_array_equal(stops.path.vertices, drawn.path.vertices)
    refusals(read, [("G96 S100|G1 X1 F6", "G96"), ("G16|G1 X1 F6", "G16"), ("G68|G1 X1", "G68")])
