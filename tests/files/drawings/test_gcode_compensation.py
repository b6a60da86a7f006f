"""Cutter radius compensation: points worked out by hand, random contours by distance, refusals."""

import itertools
import math

import numpy as np
import pytest
from tests.files.drawings import test_gcode
from tests.files.tables import refusals, rows

from armcontour.program import Contour, Dwell, Process, prepare

NANOMETRE = 1e-9
OPTIONS = {"mend_vertices": 0.0, "tools": {1: 2e-3, 3: 0.5e-3, 7: -2e-3}}
in_mm = test_gcode.in_mm


def read(text, **options):
    return test_gcode.read(text, **OPTIONS | options)


# Vertices by hand: the tool of 2 mm is 1 mm beside the contour. The entry ends beside its own line;
# outside corners get an arc, inside corners end both moves where their parallels cross; arcs keep
# their centres. A line into a half circle at a right angle: 4 mm around (5, 0), crossed by y = 1.
# Two half circles of 2 mm: those of 3 mm cross above the point between them. An arc that goes back
# on the tool's side makes an inside corner, on the other side a tip. If the side changes without a
# move between, the entry starts where the tool is, square to the programmed way, as in LinuxCNC.
# Rapids go beside the contour without an arc.
BY_HAND = f"""
F60|G41 D1 G1 X5|G1 Y-5|G40 G1 X9 Y-9 => 0,0 5,1 6,0 6,-5 9,-9
F60|G41 D1 G1 X5|Y5|X0|G40 X-2 => 0,0 4,1 4,4 0,4 -2,5
F60|G41 D1 G1 X5|G3 X9 Y4 J4|G40 G1 Y6 => 0,0 5,1 8,4 9,6
F60|G42 D1 G1 X5|G3 X9 Y4 J4|G40 G1 Y6 => 0,0 5,-1 10,4 9,6
F60|G41 D1 G1 X2|G2 X8 I3|G40 G1 X9 => 0,0 {5 - 15**0.5},1 9,0
F60|G41 D1 G1 Y2|G2 X4 I2|G2 X8 I2|G40 G1 Y0 => 0,0 -1,2 4,{2 + 5**0.5} 9,2 8,0
F60|G41 D7 G1 X5|X9|G40 X11 => 0,0 5,-1 9,-1 11,0
F60|T1 M6|G42 G1 X5|X9|G40 X11 => 0,0 5,-1 9,-1 11,0
F60|T1 M6|G41 D0 G1 X5|X10|G40 => 0,0 5,1 10,1
F60|G42.1 D2 G1 X5|X9|G40 X11 => 0,0 5,-1 9,-1 11,0
F60|G41 D1 G1 X5|X1|G40 X0 => 0,0 5,1 5,-1 1,-1 0,0
F60|G41 D1 G1 X5|G2 X2 Y3 J3|G40 G1 X0 => 0,0 {5 - 12**0.5},1 1,3 0,3
F60|G42 D1 G1 X5|G2 X2 Y3 J3|G40 G1 X0 => 0,0 5,-1 5,1 3,3 0,3
F60|G41 D1 G1 X5|X9|M2 => 0,0 5,1 9,1
F60|G41 D1 G1 X5|X9|G40|G42 D1|G1 X15|X19 => 0,0 5,1 9,1 15,-1 19,-1
F60|G1 Z1|G41 D1|Z0|X5|X9 => 0,0,0 0,0,1 0,0,0 5,1,0 9,1,0
F60|G41 D1|G0 X5|G1 X9|G0 Y-5|G1 Y-9|G40 G0 X0|G1 X-1 => 5,1 9,1 / > 9,1 10,0 10,-5 / 10,-5 \
10,-9 / > 10,-9 0,-9 / 0,-9 -1,-9
"""


def test_points_worked_out_by_hand():
    test_gcode.check_points(BY_HAND, **OPTIONS)
    noted = "F60|G41 D9|G1 X5|G40|X9 => 0,0 5,0 9,0 => G41 (1 time"
    test_gcode.check_points(noted, unknown={"skip": ["G41"]}, **OPTIONS)


def test_arcs_keep_their_centres_and_corners_get_the_tool_s_radius():
    path = read("F60\nG42 D1 G1 X5\nG3 X9 Y4 J4\nG1 X5\n").path
    assert path.curvatures == pytest.approx([0, 200, 1000, 0])
    assert path.lengths[1:3] == pytest.approx([5e-3 * math.pi / 2, 1e-3 * math.pi / 2])
    path = read("F60\nG41 D1 G1 X5\nG3 X5 J4 Z-2 P2\nG40 G1 X9\n").path
    helix = path.vertices[1:-1]
    np.testing.assert_allclose(np.hypot(helix[:, 0] - 5e-3, helix[:, 1] - 4e-3), 3e-3, rtol=1e-12)
    assert helix[0] == pytest.approx([5e-3, 1e-3, 0])
    assert helix[-1] == pytest.approx([5e-3, 1e-3, -2e-3])
    assert (np.diff(helix[:, 2]) < 0).all()


def test_an_arc_may_lead_to_the_contour_and_the_radius_may_be_zero():
    # A radius of zero changes nothing.
    text = "F60\nG1 X5\nG2 X6 Y-1 J-1\nG1 Y-3\n"
    plain, none = read(text).path, read("G41.1 D0\n" + text + "G40\n").path
    np.testing.assert_array_equal(plain.vertices, none.vertices)
    np.testing.assert_array_equal(plain.curvatures, none.curvatures)
    # From (0, 0) to 1 mm left of (5, 5), tangent to the contour there.
    path = read("F60\nG41 D1 G2 X5 Y5 I5\nG1 X9\n").path
    assert in_mm(path)[:2] == [[0, 0], [5, 6]]
    center = path.vertices[1] - [0, 1 / path.curvatures[0]]
    assert 1 / path.curvatures[0] == pytest.approx((25 + 36) / 12 * 1e-3)
    assert np.linalg.norm(center) == pytest.approx(1 / path.curvatures[0])


def test_heights_events_and_dwells_stay_where_the_corner_is():
    text = "F60\nG41 D1 G1 X5\nM3\nG1 Z-1\nG4 P2\nG1 Y5\nZ0\nX3 Z1\nM2\n"
    moves = read(text).moves
    assert [type(x) for x in moves] == [Contour, Dwell, Contour]
    assert in_mm(moves[0].path) == [[0, 0, 0], [4, 1, 0], [4, 1, -1]]
    (event,) = moves[0].events
    assert (event.name, event.s) == ("spindle", pytest.approx(moves[0].path.breaks[1]))
    assert in_mm(moves[2].path) == [[4, 1, -1], [4, 4, -1], [4, 4, 0], [3, 4, 1]]


def test_speeds_and_tolerances_are_those_of_the_programmed_moves():
    # Those of a move hold for the arc before it.
    path = read("F60\nG41 D1 G1 X5\nF120 G64 P0.1\nY-5\n").path
    assert path.speeds == pytest.approx([1e-3, 2e-3, 2e-3])
    np.testing.assert_array_equal(np.isnan(path.tolerances), [True, False, False])
    # As in LinuxCNC: 10 mm in a tenth of a minute, although the tool goes 8 mm.
    path = read("F60\nG41 D1 G1 X5\nG93 Y10 F10\nX0 F10\n").path
    assert path.speeds[1] == pytest.approx(10e-3 / 6)


# Text behind F60, number of its refused line in it, and words of the message.
REFUSED = """
G41 D2 G1 X5 => 1 => the diameter of tool 2 ... tools: {2: 3 mm}
G41 G1 X5 => 1 => G41 needs ... D
G41.1 G1 X5 => 1 => G41.1 needs D
G41 D1.5 G1 X5 => 1 => tool number D ... 1.5
G18|G41 D1 G1 X5 => 2 => G18
G41 D1|G42 D1 => 2 => G42 ... while ... (G41)
G41 D1 G1 X5|G19 => 2 => G19
G41 D1 G1 X5|G28 => 2 => G28 ... while
G41 D1 G1 X5|G92 X0 => 2 => G92 ... while
G41 D1 G1 X5|G81 X7 Z-1 R1 => 2 => the cycle G81 ... while
G41 D1 G1 X5|T2 M6 => 2 => a tool change ... while
G41 D1 G1 X1 => 1 => radius of the tool, 1 mm, but its length is 1 mm
G41 D1 G3 X0.5 Y0.1 R5 => 1 => radius of the tool, 1 mm
G41 D1 G1 X5|G3 X6 Y1 J1 => 2 => inside arc of radius 1 mm ... 2 mm
G41 D1 G1 X5|G3 X5.5 Y.5 J.5 => 2 => inside arc of radius 0.5 mm ... 2 mm
G41 D1 G1 X5|X9|G40|G2 X10 Y-1 J-1 => 4 => the first move after G40 must be straight
G41 D1 G1 X5|X9|Y0.5|X5 => 3 => corner at (9 mm, 0 mm) ... after the corner by 1 mm ... 0.5 mm
G41 D1 G1 X5|X9|Y1.5|X5 => 4 => corner at (9 mm, 1.5 mm) ... before the corner by 1 mm ... 0.5
G41 D1 G1 X5|G3 X3.5 Y1.5 I-1.5 => 2 => corner at (5 mm, 0 mm) ... too narrow
"""


def test_what_cannot_be_is_refused_with_its_line():
    table = [(x, f"part.ngc, line {int(line) + 1}: ", *more) for x, line, *more in rows(REFUSED)]
    refusals(lambda text: read(f"F60|{text}"), table)
    for tools in ({1: "3 mm"}, {1.5: 1e-3}, {-1: 1e-3}, {1: math.inf}, [1e-3]):
        refusals(lambda x: read("G1 X1 F60", tools=x), [(tools, "tool")])
    refusals(lambda x: read(x, tools={}), [("T1 M6|F60|G41 D0 G1 X5", "line 3: ", "tool 1")])


class Loop:
    """A random closed contour of lines and arcs around the origin [mm], as G-code and as points.

    The corners lie 40 to 60 mm around the origin; arcs bulge by up to 0.15 of half their chord, so
    that nothing but neighbours comes near to a tool of up to 6 mm. The first edge is straight.
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
        self.radius = float(random.uniform(0.5, 3.0))
        self.left = bool(random.random() < 0.5)
        start = (corners[0] + corners[1]) / 2
        ends = [start, *corners[1:], corners[0], start]
        # Start, end, bulge, and centre or None of every edge.
        self.edges = []
        for a, b, bulge in zip(ends, ends[1:], [0.0, *bulges[1:], 0.0], strict=False):
            middle, half = (a + b) / 2, (b - a) / 2
            center = middle + 1j * half * (1 - bulge**2) / (2 * bulge) if bulge else None
            self.edges.append((a, b, bulge, center))
        self.moves = []
        for a, b, bulge, center in self.edges:
            code, around = "G1", ""
            if center is not None:
                code, around = f"G{3 if bulge > 0 else 2}", f" {words(center - a, 'IJ', 12)}"
            self.moves.append(f"{code} {words(b, 'XY', 12)}{around}")
        self.enter = f"F600\nG0 {words(start, 'XY', 12)}"

    def compensated(self):
        """A program whose only contour is the compensated loop: entry and exit are rapids."""
        a, b = self.edges[0][:2]
        before = f"F600\nG0 {words(a - 10 * (b - a) / abs(b - a), 'XY', 12)}"
        code = f"{'G41.1' if self.left else 'G42.1'} D{2 * self.radius:.15f}"
        return "\n".join([before, code, self.enter, *self.moves, "G40\nG0 X0 Y0\nM2\n"])

    def distances(self, points):
        """Distances of points to the contour, by formulas of lines and circles [mm]."""
        nearest = np.full(len(points), np.inf)
        for a, b, bulge, center in self.edges:
            ends = np.minimum(abs(points - a), abs(points - b))
            if center is None:
                along = (points - a) / (b - a)
                foot, over = abs(along.imag) * abs(b - a), (along.real > 0) & (along.real < 1)
            else:
                foot = abs(abs(points - center) - abs(a - center))
                sign = 1 if bulge > 0 else -1
                angle = (sign * np.angle((points - center) / (a - center))) % (2 * math.pi)
                over = angle < (sign * np.angle((b - center) / (a - center))) % (2 * math.pi)
            nearest = np.minimum(nearest, np.where(over, foot, ends))
        return nearest


def words(point, letters, decimals):
    return f"{letters[0]}{point.real:.{decimals}f} {letters[1]}{point.imag:.{decimals}f}"


def sampled(path, n=40):
    """Points of every segment of a path [m]."""
    i = np.repeat(np.arange(len(path.lengths)), n)
    return path.on_segment(i, np.tile(np.linspace(0, 1, n), len(path.lengths)) * path.lengths[i])


def test_random_contours_are_at_the_tool_s_radius_everywhere():
    corners = 0
    for seed in range(100):
        loop = Loop(seed)
        path = read(loop.compensated()).contours[0].path
        points = sampled(path) @ [1e3, 1e3j]
        assert abs(loop.distances(points) - loop.radius).max() <= 1e3 * NANOMETRE, seed
        # The path does not cross the contour, so the side of its start is that of all points.
        a, b = loop.edges[0][:2]
        assert (((points[0] - a) / (b - a)).imag > 0) == loop.left, seed
        assert abs(points[0] - points[-1]) <= 1e3 * NANOMETRE, seed
        corners += len(path.lengths) - len(loop.edges)
        if seed < 12:
            # A kerf of the tool's diameter is the same path.
            side = "left" if loop.left else "right"
            process = Process(kerf=2e-3 * loop.radius, kerf_side=side, begin="drawn")
            plain = read("\n".join([loop.enter, *loop.moves, ""]))
            (kerf,) = (x.path for x in prepare(plain, process).contours)
            assert path.length == pytest.approx(kerf.length, abs=1e-8), seed
            points = path(np.linspace(0, path.length, 300))[:, :2]
            assert kerf.project(points).distance.max() <= NANOMETRE, seed
    # Outside corners add arcs: otherwise nothing was turned around.
    assert corners > 40


def chain_of_arcs(seed, decimals):
    """A line, two arcs of any size and a line, tangent but for their decimals."""
    random = np.random.default_rng(seed)
    position, way = complex(*random.uniform(-100, 100, 2)), np.exp(1j * random.uniform(0, 7))
    bends = 10 ** random.uniform(0.1, 6, 2) * random.choice([-1, 1], 2)
    lines = [f"G0 {words(position + 30 * way, 'XY', decimals)}"]
    head = f"F600\nG0 {words(position, 'XY', decimals)}"
    position += 50 * way
    lines.append(f"G1 {words(position, 'XY', decimals)}")
    for bend in bends:
        start = complex(round(position.real, decimals), round(position.imag, decimals))
        center = position + 1j * bend * way
        turn = np.exp(1j * math.copysign(min(1.0, 50 / abs(bend)), bend))
        position, way = center + (position - center) * turn, way * turn
        code, around = f"G{3 if bend > 0 else 2}", words(center - start, "IJ", decimals)
        lines.append(f"{code} {words(position, 'XY', decimals)} {around}")
    lines.append(f"G1 {words(position + 20 * way, 'XY', decimals)}")
    code, radius = random.choice(["G41.1", "G42.1"]), random.uniform(0.1, 0.9)
    entered = [head, f"{code} D{2 * radius:.9f}", *lines, "G40\nG0 X0 Y0"]
    return "\n".join([head, *lines]), "\n".join(entered), radius * 1e-3


def test_printed_arcs_of_any_size_are_followed():
    for seed, decimals in itertools.product(range(40), (3, 4, 6)):
        plain, entered, radius = chain_of_arcs(seed, decimals)
        contour, path = read(plain).contours[0].path, read(entered).contours[0].path
        deviation = contour.project(sampled(path, 9)).distance - radius
        assert abs(deviation).max() <= NANOMETRE, (seed, decimals)


def test_a_printed_rounded_rectangle_has_no_full_stops():
    text = """F600
G0 X27.615 Y11.722
G42.1 D4
G0 X36.820 Y15.629
G1 X66.276 Y28.133|G3 X70.515 Y38.623 I-3.125 J7.364
G1 X57.230 Y69.920|G3 X46.740 Y74.158 I-7.364 J-3.126
G1 X-12.173 Y49.151|G3 X-16.411 Y38.661 I3.126 J-7.364
G1 X-3.126 Y7.364|G3 X7.364 Y3.126 I7.364 J3.126
G1 X36.820 Y15.629
G40 G0 X0 Y0
"""
    printed, mended = (read(text, mend_vertices=x).contours[0].path for x in (0.0, 2e-6))
    assert len(printed.stops) > 2
    assert len(mended.stops) == 0
