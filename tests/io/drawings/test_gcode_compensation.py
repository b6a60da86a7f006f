"""Cutter radius compensation: points worked out by hand, random contours by distance, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armcontour.errors import InvalidInput
from armcontour.io.drawings.gcode import read_gcode
from armcontour.io.drawings.reading import Reading
from armcontour.program import Contour, Dwell, Process, Rapid, prepare

NANOMETRE = 1e-9
TOOLS = {1: 2e-3, 3: 0.5e-3, 7: -2e-3}


def read(text, **options):
    reading = Reading(**{"mend_vertices": 0.0, "tools": TOOLS} | options)
    return read_gcode(text.encode(), source="part.ngc", reading=reading)


def in_mm(path):
    return (path.vertices * 1e3).round(9).tolist()


def moved(text, **options):
    """All vertices of a program [mm], move by move; None for what is no move."""
    moves = read(text, **options).moves
    return [in_mm(x.path) if isinstance(x, Contour | Rapid) else None for x in moves]


# By hand: the tool of 2 mm is 1 mm beside the contour.
BY_HAND = {
    # The entry ends beside its own line; an outside corner gets an arc around it.
    "outside": ("G41 D1 G1 X5\nG1 Y-5\nG40 G1 X9 Y-9", [[0, 0], [5, 1], [6, 0], [6, -5], [9, -9]]),
    # An inside corner ends both moves where their parallels cross.
    "inside": ("G41 D1 G1 X5\nY5\nX0\nG40 X-2", [[0, 0], [4, 1], [4, 4], [0, 4], [-2, 5]]),
    # A quarter circle with the tool inside stays a quarter of the same centre.
    "inner arc": ("G41 D1 G1 X5\nG3 X9 Y4 J4\nG40 G1 Y6", [[0, 0], [5, 1], [8, 4], [9, 6]]),
    "outer arc": ("G42 D1 G1 X5\nG3 X9 Y4 J4\nG40 G1 Y6", [[0, 0], [5, -1], [10, 4], [9, 6]]),
    # A line into a half circle at a right angle: 4 mm around (5, 0), crossed by the parallel y = 1.
    "line and arc": (
        "G41 D1 G1 X2\nG2 X8 I3\nG40 G1 X9",
        [[0, 0], [5 - math.sqrt(15), 1], [9, 0]],
    ),
    # Two half circles of 2 mm: those of 3 mm cross above the point between them.
    "two arcs": (
        "G41 D1 G1 Y2\nG2 X4 I2\nG2 X8 I2\nG40 G1 Y0",
        [[0, 0], [-1, 2], [4, 2 + math.sqrt(5)], [9, 2], [8, 0]],
    ),
    "negative": ("G41 D7 G1 X5\nX9\nG40 X11", [[0, 0], [5, -1], [9, -1], [11, 0]]),
    "in the spindle": ("T1 M6\nG42 G1 X5\nX9\nG40 X11", [[0, 0], [5, -1], [9, -1], [11, 0]]),
    "by diameter": ("G42.1 D2 G1 X5\nX9\nG40 X11", [[0, 0], [5, -1], [9, -1], [11, 0]]),
    "set by G10": ("G10 L1 P5 R1\nG42 D5 G1 X5\nX9\nG40 X11", [[0, 0], [5, -1], [9, -1], [11, 0]]),
    "straight back": ("G41 D1 G1 X5\nX1\nG40 X0", [[0, 0], [5, 1], [5, -1], [1, -1], [0, 0]]),
    # An arc that goes back on the tool's side makes an inside corner, on the other side a tip.
    "cusp": ("G41 D1 G1 X5\nG2 X2 Y3 J3\nG40 G1 X0", [[0, 0], [5 - 12**0.5, 1], [1, 3], [0, 3]]),
    "tip": ("G42 D1 G1 X5\nG2 X2 Y3 J3\nG40 G1 X0", [[0, 0], [5, -1], [5, 1], [3, 3], [0, 3]]),
    # Without G40 the end of the program ends it.
    "open end": ("G41 D1 G1 X5\nX9\nM2", [[0, 0], [5, 1], [9, 1]]),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_points_worked_out_by_hand(name):
    text, expected = BY_HAND[name]
    contours = read(f"F60\n{text}\n").contours
    assert len(contours) == 1
    np.testing.assert_allclose(contours[0].path.vertices * 1e3, expected, atol=1e-9)


def test_arcs_keep_their_centres_and_corners_get_the_tool_s_radius():
    path = read("F60\nG42 D1 G1 X5\nG3 X9 Y4 J4\nG1 X5\n").path
    assert path.curvatures == pytest.approx([0, 200, 1000, 0])
    assert path.lengths[1:3] == pytest.approx([5e-3 * math.pi / 2, 1e-3 * math.pi / 2])


def test_a_radius_of_zero_changes_nothing():
    text = "F60\nG1 X5\nG2 X6 Y-1 J-1\nG1 Y-3\n"
    plain, none = read(text).path, read("G41.1 D0\n" + text + "G40\n").path
    np.testing.assert_array_equal(plain.vertices, none.vertices)
    np.testing.assert_array_equal(plain.curvatures, none.curvatures)


def test_an_arc_may_lead_to_the_contour():
    """From (0, 0) to 1 mm left of (5, 5), tangent to the contour there."""
    path = read("F60\nG41 D1 G2 X5 Y5 I5\nG1 X9\n").path
    assert in_mm(path)[:2] == [[0, 0], [5, 6]]
    center = path.vertices[1] - [0, 1 / path.curvatures[0]]
    assert 1 / path.curvatures[0] == pytest.approx((25 + 36) / 12 * 1e-3)
    assert np.linalg.norm(center) == pytest.approx(1 / path.curvatures[0])


def test_a_radius_that_the_program_sets_is_not_left_out():
    assert not read("F60\nG10 L1 P5 R1\nG41 D5 G1 X5\n").notes
    assert "G10 L1 (1 time" in read("F60\nG10 L1 P5 Z9 R1\nG41 D5 G1 X5\n").notes[0]
    assert "G10 L12 (1 time" in read("F60\nG10 L12 P5 R1\nG1 X5\n").notes[0]


def test_the_side_may_change_without_a_move_between():
    """The entry starts where the tool is, and is square to the programmed way, as in LinuxCNC."""
    text = "F60\nG41 D1 G1 X5\nX9\nG40\nG42 D1\nG1 X15\nX19\n"
    assert moved(text) == [[[0, 0], [5, 1], [9, 1], [15, -1], [19, -1]]]


def test_rapids_go_beside_the_contour_without_an_arc():
    text = "F60\nG41 D1\nG0 X5\nG1 X9\nG0 Y-5\nG1 Y-9\nG40 G0 X0\nG1 X-1\n"
    assert moved(text) == [
        [[5, 1], [9, 1]],
        [[9, 1], [10, 0], [10, -5]],
        [[10, -5], [10, -9]],
        [[10, -9], [0, -9]],
        [[0, -9], [-1, -9]],
    ]


def test_heights_events_and_dwells_stay_where_the_corner_is():
    text = "F60\nG41 D1 G1 X5\nM3\nG1 Z-1\nG4 P2\nG1 Y5\nZ0\nX3 Z1\nM2\n"
    moves = read(text).moves
    assert [type(x) for x in moves] == [Contour, Dwell, Contour]
    assert in_mm(moves[0].path) == [[0, 0, 0], [4, 1, 0], [4, 1, -1]]
    assert [(x.name, x.s) for x in moves[0].events] == [
        ("spindle", pytest.approx(moves[0].path.breaks[1]))
    ]
    assert in_mm(moves[2].path) == [[4, 1, -1], [4, 4, -1], [4, 4, 0], [3, 4, 1]]


def test_a_height_may_change_before_the_tool_goes_to_the_contour():
    assert moved("F60\nG1 Z1\nG41 D1\nZ0\nX5\nX9\n") == [
        [[0, 0, 0], [0, 0, 1], [0, 0, 0], [5, 1, 0], [9, 1, 0]]
    ]


def test_a_helix_keeps_its_centre():
    path = read("F60\nG41 D1 G1 X5\nG3 X5 J4 Z-2 P2\nG40 G1 X9\n").path
    turned = path.vertices[1:-1]
    np.testing.assert_allclose(np.hypot(turned[:, 0] - 5e-3, turned[:, 1] - 4e-3), 3e-3, rtol=1e-12)
    assert turned[0] == pytest.approx([5e-3, 1e-3, 0])
    assert turned[-1] == pytest.approx([5e-3, 1e-3, -2e-3])
    assert (np.diff(turned[:, 2]) < 0).all()


def test_the_speed_and_the_tolerance_of_a_move_hold_for_the_arc_before_it():
    path = read("F60\nG41 D1 G1 X5\nF120 G64 P0.1\nY-5\n").path
    assert path.speeds == pytest.approx([1e-3, 2e-3, 2e-3])
    np.testing.assert_array_equal(np.isnan(path.tolerances), [True, False, False])


def test_inverse_time_goes_by_the_programmed_length():
    """As in LinuxCNC: 10 mm in a tenth of a minute, although the tool goes 8 mm."""
    path = read("F60\nG41 D1 G1 X5\nG93 Y10 F10\nX0 F10\n").path
    assert path.speeds[1] == pytest.approx(10e-3 / 6)


def test_parameters_tell_the_state():
    path = read("F60\nG41 D1 G1 X5\nG1 X[#<_ccomp>/41]\nG40\nG1 X[#<_ccomp>/20]\n").path
    assert in_mm(path) == [[0, 0], [5, 1], [10, 1], [20, 0]]
    path = read("F60\nT1 M6\nG1 X#5410\nG20\nG1 X[#5410*25.4]\n").path
    assert in_mm(path) == [[0, 0], [2, 0], [50.8, 0]]


REFUSED = {
    "G41 D2 G1 X5": (1, "the tool 2, whose diameter", "tools: {2: 3 mm}", "--tool '2: 3 mm'"),
    "G41 G1 X5": (1, "G41 without D, while no tool is in the spindle"),
    "G41.1 G1 X5": (1, "G41.1 without D, the tool's diameter"),
    "G41 D1.5 G1 X5": (1, "a tool D of 1.5, which must be a whole number"),
    "G10 L12 P1 R1\nG41 D1 G1 X5": (2, "the program changes by G10 L12"),
    "G18\nG41 D1 G1 X5": (2, "G41 in the plane G18"),
    "G41 D1\nG42 D1": (2, "G42 while cutter radius compensation (G41) is on: write G40"),
    "G41 D1 G1 X5\nG19": (2, "another plane (G19) while"),
    "G41 D1 G1 X5\nG28": (2, "G28 while"),
    "G41 D1 G1 X5\nG92 X0": (2, "G92 while"),
    "G41 D1 G1 X5\nG81 X7 Z-1 R1": (2, "the cycle G81 while"),
    "G41 D1 G1 X5\nT2 M6": (2, "another tool while"),
    "M70\nG41 D1 G1 X5\nM72": (3, "changes cutter radius compensation"),
    "G41 D1 G1 X5\nG1 X[#5420+1]": (2, "the tool's position while"),
    "G1 X#5410": (1, "#5410"),
    "G41 D1 G1 X1": (1, "1 mm long", "longer than the tool's radius of 1 mm"),
    "G41 D1 G3 X0.5 Y0.1 R5": (1, "longer than the tool's radius of 1 mm"),
    "G41 D1 G1 X5\nG3 X6 Y1 J1": (2, "an inside arc of radius 1 mm", "must be below 2 mm"),
    "G41 D1 G1 X5\nG3 X5.5 Y.5 J.5": (2, "an inside arc of radius 0.5 mm for a tool of 2 mm"),
    "G41 D1 G1 X5\nX9\nG40\nG2 X10 Y-1 J-1": (4, "an arc as the first move after G40"),
    # The step of 0.5 mm is shorter than what the inside corners take at both its ends.
    "G41 D1 G1 X5\nX9\nY0.5\nX5": (
        3,
        "inside corner at (9 mm, 0 mm)",
        "after it by 1 mm",
        "0.5 mm",
    ),
    "G41 D1 G1 X5\nX9\nY1.5\nX5": (
        4,
        "inside corner at (9 mm, 1.5 mm)",
        "before it by 1 mm",
        "0.5",
    ),
    # The parallel of the line passes by the circle of 0.5 mm that is left for the tool's centre.
    "G41 D1 G1 X5\nG3 X3.5 Y1.5 I-1.5": (2, "inside corner at (5 mm, 0 mm)", "does not fit"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_is_refused_with_its_line(text, refuses):
    line, *words = REFUSED[text]
    refuses(lambda: read(f"F60\n{text}\n"), InvalidInput, f"part.ngc, line {line + 1}: ", *words)


@pytest.mark.parametrize("tools", [{1: "3 mm"}, {1.5: 1e-3}, {-1: 1e-3}, {1: math.inf}, [1e-3]])
def test_diameters_that_are_none_are_refused(tools, refuses):
    refuses(lambda: read("G1 X1 F60\n", tools=tools), InvalidInput, "tool")


def test_words_left_out_by_name_stay_left_out():
    program = read("F60\nG41 D9\nG1 X5\nG40\nX9\n", skip=frozenset(("G41",)))
    assert in_mm(program.path) == [[0, 0], [5, 0], [9, 0]]
    assert "G41 (1 time" in program.notes[0]


class Loop:
    """A random closed contour of lines and arcs around the origin [mm], as G-code and as points.

    The corners lie 40 to 60 mm around the origin; arcs bulge by up to 0.15 of half their chord, so
    that nothing but neighbours comes near to a tool of up to 6 mm.
    """

    def __init__(self, seed):
        random = np.random.default_rng(seed)
        n = int(random.integers(4, 9))
        angles = 2 * math.pi * (np.arange(n) + random.uniform(-0.2, 0.2, n)) / n
        radii = random.uniform(40, 60, n)
        corners = radii * np.exp(1j * angles) * (1 if seed % 2 else -1)
        if seed % 4 < 2:
            corners = corners.conj()
        bulges = np.where(random.random(n) < 0.6, random.uniform(-0.15, 0.15, n), 0.0)
        bulges[0] = 0.0
        self.radius = float(random.uniform(0.5, 3.0))
        self.left = bool(random.random() < 0.5)
        self.points = [(corners[0] + corners[1]) / 2, *corners[1:], corners[0]]
        self.points.append(self.points[0])
        self.bulges = [*bulges, 0.0]

    def edges(self):
        """Start, end, and centre or None of every edge, as complex numbers [mm]."""
        for a, b, bulge in zip(self.points, self.points[1:], self.bulges, strict=False):
            middle, half = (a + b) / 2, (b - a) / 2
            center = middle + 1j * half * (1 - bulge**2) / (2 * bulge) if bulge else None
            yield a, b, bulge, center

    def moves(self):
        """The contour as lines of G-code."""
        for a, b, bulge, center in self.edges():
            end = f"X{b.real:.12f} Y{b.imag:.12f}"
            if center is None:
                yield f"G1 {end}"
            else:
                c = center - a
                yield f"G{3 if bulge > 0 else 2} {end} I{c.real:.12f} J{c.imag:.12f}"

    def compensated(self):
        """A program whose only contour is the compensated loop: entry and exit are rapids."""
        a, b = self.points[:2]
        start = a - 10 * (b - a) / abs(b - a)
        code = "G41.1" if self.left else "G42.1"
        return "\n".join(
            [
                f"F600\nG0 X{start.real:.12f} Y{start.imag:.12f}",
                f"{code} D{2 * self.radius:.15f}\nG0 X{a.real:.12f} Y{a.imag:.12f}",
                *self.moves(),
                "G40\nG0 X0 Y0\nM2\n",
            ]
        )

    def plain(self):
        """The same contour at the cutting edge."""
        a = self.points[0]
        moves = "\n".join(self.moves())
        return f"F600\nG0 X{a.real:.12f} Y{a.imag:.12f}\n{moves}\n"

    def distances(self, points):
        """How far points are from the contour, by formulas of lines and circles [mm]."""
        found = np.full(len(points), np.inf)
        for a, b, bulge, center in self.edges():
            ends = np.minimum(abs(points - a), abs(points - b))
            if center is None:
                along = ((points - a) / (b - a)).real
                foot = abs(((points - a) / (b - a)).imag) * abs(b - a)
                over = (along > 0) & (along < 1)
            else:
                foot = abs(abs(points - center) - abs(a - center))
                sign = 1 if bulge > 0 else -1
                angle = (sign * np.angle((points - center) / (a - center))) % (2 * math.pi)
                over = angle < (sign * np.angle((b - center) / (a - center))) % (2 * math.pi)
            found = np.minimum(found, np.where(over, foot, ends))
        return found

    def on_the_left(self, points):
        """Which points are on the left of the contour: inside, if it goes counter-clockwise."""
        outline = []
        for a, b, bulge, center in self.edges():
            share = np.linspace(0, 1, 200, endpoint=False)
            if center is None:
                outline.append(a + share * (b - a))
            else:
                sweep = 4 * math.atan(bulge)
                outline.append(center + (a - center) * np.exp(1j * share * sweep))
        outline = np.concatenate(outline)
        around = np.angle((np.roll(outline, -1) - points[:, None]) / (outline - points[:, None]))
        inside = abs(around.sum(axis=1)) > math.pi
        counter_clockwise = np.angle(np.roll(outline, -1) / outline).sum() > 0
        return inside == counter_clockwise


def sampled(path, n=40):
    """Points of every segment of a path, as complex numbers [mm]."""
    i = np.repeat(np.arange(len(path.lengths)), n)
    u = np.tile(np.linspace(0, 1, n), len(path.lengths)) * path.lengths[i]
    x, y = path.on_segment(i, u).T * 1e3
    return x + 1j * y


@pytest.mark.parametrize("first", range(0, 200, 40))
def test_random_contours_are_at_the_tool_s_radius_everywhere(first):
    corners = 0
    for seed in range(first, first + 40):
        loop = Loop(seed)
        path = read(loop.compensated()).contours[0].path
        points = sampled(path)
        assert abs(loop.distances(points) - loop.radius).max() <= 1e3 * NANOMETRE, seed
        assert (loop.on_the_left(points[::13]) == loop.left).all(), seed
        assert abs(points[0] - points[-1]) <= 1e3 * NANOMETRE, seed
        corners += len(path.lengths) - len(loop.bulges)
    # Outside corners add arcs: otherwise nothing was turned around.
    assert corners > 40


@pytest.mark.parametrize("seed", range(12))
def test_a_kerf_of_the_tool_s_diameter_is_the_same_path(seed):
    loop = Loop(seed)
    ours = read(loop.compensated()).contours[0].path
    side = "left" if loop.left else "right"
    process = Process(kerf=2e-3 * loop.radius, kerf_side=side, begin="drawn")
    (theirs,) = (x.path for x in prepare(read(loop.plain()), process).contours)
    assert ours.length == pytest.approx(theirs.length, abs=1e-8)
    x, y = ours(np.linspace(0, ours.length, 300)).T
    assert theirs.project(np.column_stack([x, y])).distance.max() <= NANOMETRE


def chain_of_arcs(seed, decimals):
    """A line, two arcs of any size and a line, tangent but for their decimals."""
    random = np.random.default_rng(seed)
    at, way = complex(*random.uniform(-100, 100, 2)), np.exp(1j * random.uniform(0, 7))
    bends = 10 ** random.uniform(0.1, 6, 2) * random.choice([-1, 1], 2)

    def words(point, letters="XY"):
        return f"{letters[0]}{point.real:.{decimals}f} {letters[1]}{point.imag:.{decimals}f}"

    lines = [f"F600\nG0 {words(at)}", f"G0 {words(at + 30 * way)}"]
    at += 50 * way
    lines.append(f"G1 {words(at)}")
    for bend in bends:
        start = complex(round(at.real, decimals), round(at.imag, decimals))
        center = at + 1j * bend * way
        turn = np.exp(1j * math.copysign(min(1.0, 50 / abs(bend)), bend))
        at, way = center + (at - center) * turn, way * turn
        lines.append(f"G{3 if bend > 0 else 2} {words(at)} {words(center - start, 'IJ')}")
    lines.append(f"G1 {words(at + 20 * way)}")
    code, radius = random.choice(["G41.1", "G42.1"]), random.uniform(0.1, 0.9)
    entered = [lines[0], f"{code} D{2 * radius:.9f}", *lines[1:], "G40\nG0 X0 Y0"]
    return "\n".join(lines), "\n".join(entered), radius * 1e-3


@pytest.mark.parametrize("decimals", [3, 4, 6])
def test_printed_arcs_of_any_size_are_followed(decimals):
    for seed in range(60):
        plain, entered, radius = chain_of_arcs(seed, decimals)
        contour, path = read(plain).contours[0].path, read(entered).contours[0].path
        i = np.repeat(np.arange(len(path.lengths)), 9)
        u = np.tile(np.linspace(0, 1, 9), len(path.lengths)) * path.lengths[i]
        off = contour.project(path.on_segment(i, u)).distance - radius
        assert abs(off).max() <= NANOMETRE, seed


def test_a_printed_rounded_rectangle_has_no_full_stops():
    text = """F600
G0 X27.615 Y11.722
G42.1 D4
G0 X36.820 Y15.629
G1 X66.276 Y28.133
G3 X70.515 Y38.623 I-3.125 J7.364
G1 X57.230 Y69.920
G3 X46.740 Y74.158 I-7.364 J-3.126
G1 X-12.173 Y49.151
G3 X-16.411 Y38.661 I3.126 J-7.364
G1 X-3.126 Y7.364
G3 X7.364 Y3.126 I7.364 J3.126
G1 X36.820 Y15.629
G40 G0 X0 Y0
"""
    printed, mended = (read(text, mend_vertices=x).contours[0].path for x in (0.0, None))
    assert len(printed.stops) > 2
    assert len(mended.stops) == 0


def test_d0_is_the_tool_in_the_spindle(refuses):
    text = "T1 M6\nF60\nG41 D0 G1 X5\nX10\nG40\n"
    assert moved(text, tools={1: 0.002})[-1] == [[0, 0], [5, 1], [10, 1]]
    refuses(lambda: read(text, tools={}), InvalidInput, "tool 1")
