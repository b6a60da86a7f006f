"""Printed vertices of files are tangent again: no full stop, and no time lost."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.io.drawings.mending import half_a_place

HEAD = "G21 G90 G17 F6000 G64 P0.1\n"


def rectangle(decimals, by_radius=False):
    """A rectangle 80 x 50 with corners of 8, turned by 23 degrees, as G-code."""
    c, s = np.cos(np.radians(23)), np.sin(np.radians(23))
    corners = [((8, 0), (72, 0), (72, 8)), ((80, 8), (80, 42), (72, 42))]
    corners += [((72, 50), (8, 50), (8, 42)), ((0, 42), (0, 8), (8, 8))]

    def at(p):
        return np.array([c * p[0] - s * p[1] + 300, s * p[0] + c * p[1] + 100])

    def show(letters, values):
        return " ".join(f"{a}{x:.{decimals}f}" for a, x in zip(letters, values, strict=True))

    text = HEAD + f"G0 {show('XY', at(corners[0][0]))}\n"
    for i, (_, end, center) in enumerate(corners):
        after = at(corners[(i + 1) % 4][0])
        how = show("R", [8.0]) if by_radius else show("IJ", at(center) - at(end))
        text += f"G1 {show('XY', at(end))}\nG3 {show('XY', after)} {how}\n"
    return text + "M2\n"


def arcs(decimals, by_radius=False):
    """Ten tangent arcs as G-code."""
    rng = np.random.default_rng(1)
    here, heading = np.array([300.0, 100.0]), 0.3

    def show(letters, values):
        return " ".join(f"{a}{x:.{decimals}f}" for a, x in zip(letters, values, strict=True))

    text = HEAD + f"G0 {show('XY', here)}\n"
    for _ in range(10):
        r, sense, sweep = rng.uniform(5, 20), rng.choice([-1, 1]), rng.uniform(0.4, 1.6)
        center = here + r * sense * np.array([-np.sin(heading), np.cos(heading)])
        heading += sense * sweep
        end = center - r * sense * np.array([-np.sin(heading), np.cos(heading)])
        how = show("R", [r]) if by_radius else show("IJ", center - here)
        text += f"{'G3' if sense > 0 else 'G2'} {show('XY', end)} {how}\n"
        here = end
    return text + "M2\n"


def ellipse(decimals, scale=1.0):
    """An ellipse of four Beziers as SVG, in units of which one millimetre has `scale`."""
    k, a, b = 0.5522847498, 40, 25
    c, s = np.cos(0.3), np.sin(0.3)

    def at(x, y):
        p = np.array([c * x - s * y + 101.23, s * x + c * y + 99.77]) * scale
        return " ".join(f"{v:.{decimals}f}" for v in p)

    quarters = [[(a, k * b), (k * a, b), (0, b)], [(-k * a, b), (-a, k * b), (-a, 0)]]
    quarters += [[(-x, -y) for x, y in q] for q in quarters]
    data = f"M {at(a, 0)} " + " ".join("C " + " ".join(at(*p) for p in q) for q in quarters)
    size = f'width="200mm" height="200mm" viewBox="0 0 {200 * scale} {200 * scale}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}><path d="{data} Z"/></svg>'


@pytest.fixture
def read(tmp_path):
    def reader(text, ending=".ngc", **options):
        file = tmp_path / f"part{ending}"
        file.write_text(text)
        return ac.read_path(file, **options)

    return reader


def duration(program):
    """Time of the program's one contour, corners rounded within 0.1 mm; it must have no stop."""
    path = ac.round_corners(program.contours[0].path, tolerance=1e-4)
    assert len(path.stops) == 0
    vertices = path.vertices
    middle = (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    frame = ac.Frame(position=(*(np.array([0.33, 0.2]) - middle), 0.0))
    placed = ac.Program(moves=(ac.Contour(path=path),)).placed(frame)
    arm = ac.load_arm("pmk3s")
    limits = ac.Limits(joint_acceleration=3.0, speed=0.1)
    return ac.plan(ac.trace(placed.contours[0].path, arm), arm, limits=limits).duration


SHAPES = {
    "rectangle": (rectangle, ".ngc"),
    "rectangle by R": (lambda n: rectangle(n, by_radius=True), ".ngc"),
    "arcs": (arcs, ".ngc"),
    "arcs by R": (lambda n: arcs(n, by_radius=True), ".ngc"),
    "ellipse": (ellipse, ".svg"),
    "ellipse in small units": (lambda n: ellipse(n, 0.1), ".svg"),
}


@pytest.mark.parametrize("decimals", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("shape", SHAPES)
def test_printed_curves_have_no_corners(read, shape, decimals):
    draw, ending = SHAPES[shape]
    printed = read(draw(decimals), ending, mend_vertices=0.0)
    mended = read(draw(decimals), ending)
    kinks = int((printed.path.turns > 1e-9).sum())
    assert kinks > 0 and not printed.notes
    assert (mended.path.turns <= 1e-9).all()
    ends = mended.path([0.0, mended.path.length], 1, side="left")
    ends[0] = mended.path(0.0, 1)
    if mended.contours[0].closed:
        assert np.linalg.norm(ends[1] - ends[0]) <= 1e-9
    (note,) = mended.notes
    assert note.startswith(f"Mended {kinks}") or note.startswith(f"Mended {kinks + 1}")
    s = np.linspace(0, mended.path.length, 999)
    most = 0.5 * 10.0**-decimals * 1e-3 * np.sqrt(2) * (10 if "small" in shape else 1)
    assert printed.path.project(mended.path(s)).distance.max() <= min(most, 1e-5)


@pytest.mark.parametrize(("shape", "decimals"), [("rectangle", 3), ("arcs", 3), ("ellipse", 2)])
def test_printed_curves_take_no_longer_than_exact_ones(read, shape, decimals):
    draw, ending = SHAPES[shape]
    exact = duration(read(draw(13), ending))
    assert duration(read(draw(decimals), ending)) <= 1.01 * exact


def test_a_program_keeps_its_events_and_its_start(read):
    text = rectangle(3).replace("G3", "M62 P1\nG3", 1)
    printed, mended = read(text, mend_vertices=0.0), read(text)
    for a, b in zip(printed.moves, mended.moves, strict=True):
        assert type(a) is type(b)
    (before,), (after,) = printed.contours, mended.contours
    assert len(before.events) == len(after.events) > 0
    for x, y in zip(before.events, after.events, strict=True):
        np.testing.assert_allclose(after.path(y.s), before.path(x.s), atol=1e-6)
    np.testing.assert_array_equal(after.path(0.0), before.path(0.0))


def test_exact_stops_stay(read):
    text = rectangle(3).replace("G64 P0.1", "G61")
    assert (read(text).path.turns > 1e-9).sum() >= 5


def test_a_tolerance_of_the_program_bounds_it(read):
    tight = read(rectangle(2).replace("P0.1", "P0.00001"))
    assert "1e-05 mm" in tight.notes[0]
    printed = read(rectangle(2), mend_vertices=0.0).path
    s = np.linspace(0, tight.path.length, 999)
    assert printed.project(tight.path(s)).distance.max() <= 1e-8 * 1.001


def test_the_tolerance_of_a_layer_bounds_it(read):
    draw = ellipse(2).replace("<path", '<path id="cut"')
    (name,) = {x.layer for x in read(draw, ".svg").contours}
    free = read(draw, ".svg").notes[0]
    tight = read(draw, ".svg", layers={name: ac.Demand(tolerance=1e-8)}).notes[0]
    assert "1e-05 mm" in tight and "1e-05 mm" not in free
    assert not read(draw, ".svg", layers={name: ac.Demand(tolerance=0.0)}).notes


def test_a_corner_stays_beside_mended_vertices(read):
    text = "G21 G90 F600\nG0 X0 Y0\nG1 X30.01 Y10.003\nG1 X60.02 Y20.007\nG1 X60.02 Y50\nM2\n"
    mended = read(text)
    assert "Mended 1 vertex" in mended.notes[0]
    assert (mended.path.turns > 1e-9).sum() == 1
    np.testing.assert_array_equal(mended.path.vertices[-2:] * 1e3, [(60.02, 20.007), (60.02, 50)])


def test_what_printing_cannot_have_done_is_a_corner(read):
    # 0.1° over 30 mm is a twentieth of a millimetre, 100 times the last of three decimals.
    y = 30 * np.tan(np.radians(0.1))
    text = f"G21 G90 F600\nG0 X0.000 Y0.000\nG1 X30.000\nG1 X60.000 Y{y:.3f}\nM2\n"
    assert not read(text).notes
    assert read(text, mend_vertices=5e-5).notes


def test_collinear_waypoints_are_mended(read):
    places = np.linspace(0, 70, 8)
    rows = [f"{100 + x * np.cos(0.4):.3f},{50 + x * np.sin(0.4):.3f}" for x in places]
    text = "x [mm],y [mm]\n" + "\n".join(rows) + "\n"
    assert len(read(text, ".csv", mend_vertices=0.0).path.stops) >= 5
    assert len(read(text, ".csv").path.stops) == 0


def test_bulges_of_dxf_are_mended(read):
    ezdxf = pytest.importorskip("ezdxf")
    document = ezdxf.new(units=4)
    bulge = np.tan(np.pi / 8)
    c, s = np.cos(0.4), np.sin(0.4)
    flat = [(8, 0, 0), (72, 0, bulge), (80, 8, 0), (80, 42, bulge)]
    flat += [(72, 50, 0), (8, 50, bulge), (0, 42, 0), (0, 8, bulge)]
    points = [(round(c * x - s * y, 4), round(s * x + c * y, 4), round(b, 6)) for x, y, b in flat]
    document.modelspace().add_lwpolyline(points, format="xyb", close=True)
    import io

    stream = io.StringIO()
    document.write(stream)
    text = stream.getvalue()
    assert (read(text, ".dxf", mend_vertices=0.0).path.turns > 1e-9).sum() >= 5
    mended = read(text, ".dxf")
    assert (mended.path.turns <= 1e-9).all() and "Mended" in mended.notes[-1]


@pytest.mark.parametrize(
    ("text", "half"),
    [
        ("M 1.25,3 -0.500.125 7", 0.5e-3),
        ("M 1.5e-2 2.5e3", 0.5e-3),
        (" ".join(["0.12"] * 50 + ["0.123456789"]), 0.5e-2),
        ("1 2 3", 0.5),
        ("1.5e400", 0.5),
        ("", 0.5),
    ],
)
def test_what_decimals_say(text, half):
    assert half_a_place([text]) == pytest.approx(half, rel=1e-12)


def test_a_negative_distance_is_refused(read, refuses):
    refuses(
        lambda: read(arcs(3), mend_vertices=-1e-6), ac.InvalidInput, "mend_vertices", "negative"
    )
