"""Rounded vertices of files become tangent; curvature is continuous if required."""

from functools import partial

import numpy as np
import pytest

import armcontour as ac

HEAD = "G21 G90 G17 F6000 G64 P0.1\n"


def gcode(parts, start, heading, decimals, by_radius):
    """Lines and tangent arcs, (0, length) or (signed radius, angle), from x + iy [mm]."""

    def words(letters, *values):
        return " ".join(f"{a}{x:.{decimals}f}" for a, x in zip(letters, values, strict=True))

    position = start
    text = f"{HEAD}G0 {words('XY', start.real, start.imag)}\n"
    for radius, size in parts:
        code = "G1"
        how = ""
        along = np.exp(1j * heading)
        to_center = 1j * radius * along
        if radius:
            code = "G3" if radius > 0 else "G2"
            how = words("IJ", to_center.real, to_center.imag)
            how = words("R", abs(radius)) if by_radius else how
            heading += np.sign(radius) * size
            position += to_center - 1j * radius * np.exp(1j * heading)
        else:
            position += size * along
        text += f"{code} {words('XY', position.real, position.imag)} {how}\n"
    return text + "M2\n"


def rectangle(decimals, by_radius=False):
    """A rectangle 80 x 50 with corners of 8, turned by 23 degrees."""
    turn = np.radians(23)
    corner = (8, np.pi / 2)
    parts = [(0, 64), corner, (0, 34), corner] * 2
    return gcode(parts, 8 * np.exp(1j * turn) + 300 + 100j, turn, decimals, by_radius)


def arcs(decimals, by_radius=False):
    """Ten tangent arcs."""
    rng = np.random.default_rng(1)
    parts = [(rng.uniform(5, 20) * rng.choice([-1, 1]), rng.uniform(0.4, 1.6)) for _ in range(10)]
    return gcode(parts, 300 + 100j, 0.3, decimals, by_radius)


def ellipse(decimals, scale=1.0):
    """An ellipse of four Beziers as SVG; one millimetre is `scale` units."""
    k = 0.5522847498
    a = 40
    b = 25
    c, s = np.cos(0.3), np.sin(0.3)

    def coordinates(x, y):
        p = np.array([c * x - s * y + 101.23, s * x + c * y + 99.77]) * scale
        return " ".join(f"{v:.{decimals}f}" for v in p)

    quarters = [[(a, k * b), (k * a, b), (0, b)], [(-k * a, b), (-a, k * b), (-a, 0)]]
    quarters += [[(-x, -y) for x, y in q] for q in quarters]
    data = f"M {coordinates(a, 0)} " + " ".join(
        "C " + " ".join(coordinates(*p) for p in q) for q in quarters
    )
    size = f'width="200mm" height="200mm" viewBox="0 0 {200 * scale} {200 * scale}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}><path d="{data} Z"/></svg>'


@pytest.fixture
def read(tmp_path):
    def reader(text, ending=".ngc", **options):
        file = tmp_path / f"part{ending}"
        file.write_text(text)
        return ac.read_path(file, ac.ReadOptions(**options))

    return reader


def kinks(program):
    return int((program.path.turns > 1e-9).sum())


SHAPES = {
    "rectangle": (rectangle, ".ngc"),
    "rectangle by R": (partial(rectangle, by_radius=True), ".ngc"),
    "arcs": (arcs, ".ngc"),
    "arcs by R": (partial(arcs, by_radius=True), ".ngc"),
    "ellipse": (ellipse, ".svg"),
    "ellipse in small units": (partial(ellipse, scale=0.1), ".svg"),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_printed_curves_have_no_corners(read, shape):
    draw, ending = SHAPES[shape]
    for decimals in (2, 3, 4, 5, 6):
        printed = read(draw(decimals), ending, repair_vertices=0.0)
        rounding = 0.5 * 10.0**-decimals * 1e-3 * np.sqrt(2) * (10 if "small" in shape else 1)
        # The default suits three decimals of a millimetre.
        coarse = {} if rounding <= 2e-6 else {"repair_vertices": 1e-5}
        mended = read(draw(decimals), ending, **coarse)
        bent = kinks(printed)
        assert bent > 0 and not printed.notes
        assert kinks(mended) == 0, decimals
        if mended.contours[0].closed:
            end = mended.path(mended.path.length, 1, side="left")
            assert np.linalg.norm(end - mended.path(0.0, 1)) <= 1e-9, decimals
        (note,) = mended.notes
        assert note.startswith((f"Repaired {bent}", f"Repaired {bent + 1}"))
        s = np.linspace(0, mended.path.length, 999)
        assert printed.path.project(mended.path(s)).distance.max() <= min(rounding, 1e-5), decimals


def test_tolerances_of_file_and_layer_limit_the_repair_of_vertices(read, refuses):
    # Exact path control stops at corners only, and rounded coordinates make no corners.
    exact = read(rectangle(3).replace("G64 P0.1", "G61"))
    assert kinks(exact) == 0 and "Repaired" in exact.notes[0]
    assert (exact.path.tolerances == 0).all()
    tight = read(rectangle(2).replace("P0.1", "P0.00001"))
    assert "1e-05 mm" in tight.notes[0]
    printed = read(rectangle(2), repair_vertices=0.0).path
    s = np.linspace(0, tight.path.length, 999)
    assert printed.project(tight.path(s)).distance.max() <= 1e-8 * 1.001
    draw = ellipse(2).replace("<path", '<path id="cut"')
    (name,) = {x.layer for x in read(draw, ".svg").contours}
    free = read(draw, ".svg").notes[0]
    tight = read(draw, ".svg", layers={name: ac.SegmentLimits(tolerance=1e-8)}).notes[0]
    assert "1e-05 mm" in tight and "1e-05 mm" not in free
    assert not read(draw, ".svg", layers={name: ac.SegmentLimits(tolerance=0.0)}).notes
    refuses(lambda: read(arcs(3), repair_vertices=-1e-6), ac.InvalidInput, "repair_vertices")


def test_corners_that_rounding_does_not_explain_remain(read):
    text = "G21 G90 F600\nG0 X0 Y0\nG1 X30.01 Y10.003\nG1 X60.02 Y20.007\nG1 X60.02 Y50\nM2\n"
    mended = read(text)
    assert "Repaired 1 vertex" in mended.notes[0] and kinks(mended) == 1
    np.testing.assert_array_equal(mended.path.vertices[-2:] * 1e3, [(60.02, 20.007), (60.02, 50)])
    # 0.1° over 30 mm is a twentieth of a millimetre, 100 times the last of three decimals.
    y = 30 * np.tan(np.radians(0.1))
    text = f"G21 G90 F600\nG0 X0.000 Y0.000\nG1 X30.000\nG1 X60.000 Y{y:.3f}\nM2\n"
    assert not read(text).notes
    assert read(text, repair_vertices=5e-5).notes


def test_rounded_collinear_waypoints_are_aligned(read):
    places = np.linspace(0, 70, 8)
    rows = [f"{100 + x * np.cos(0.4):.3f},{50 + x * np.sin(0.4):.3f}" for x in places]
    text = "x [mm],y [mm]\n" + "\n".join(rows) + "\n"
    assert len(read(text, ".csv", repair_vertices=0.0).path.stops) >= 5
    assert len(read(text, ".csv").path.stops) == 0


def test_rounded_bulges_of_dxf_become_tangent(tmp_path):
    document = pytest.importorskip("ezdxf").new(units=4)
    bulge = np.tan(np.pi / 8)
    c, s = np.cos(0.4), np.sin(0.4)
    flat = [(8, 0, 0), (72, 0, bulge), (80, 8, 0), (80, 42, bulge)]
    flat += [(72, 50, 0), (8, 50, bulge), (0, 42, 0), (0, 8, bulge)]
    points = [(round(c * x - s * y, 4), round(s * x + c * y, 4), round(b, 6)) for x, y, b in flat]
    document.modelspace().add_lwpolyline(points, format="xyb", close=True)
    document.saveas(tmp_path / "a.dxf")
    assert kinks(ac.read_path(tmp_path / "a.dxf", ac.ReadOptions(repair_vertices=0.0))) >= 5
    mended = ac.read_path(tmp_path / "a.dxf")
    assert kinks(mended) == 0 and "Repaired" in mended.notes[-1]
