"""Entry point of all readers: units, scale, frame, selection and refusals."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from tests.files.tables import refusals

import armcontour as ac
from armcontour.files.drawings.outlines import BezierSpline, fit_splines

GASKET = Path(__file__).parents[3] / "examples" / "drawings" / "gasket.dxf"
CSV = "x,y,contour,layer\n0,0,a,CUT\n20,0,a,CUT\n0,10,b,MARK\n20,10,b,MARK\n"
GCODE = "G21 F600\nG0 X0 Y0\nG1 X20\nG0 X0 Y10 Z2\nG1 X20\n"
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="10mm" viewBox="0 0 20 10">'
    '<g id="CUT"><line id="a" x1="0" y1="10" x2="20" y2="10"/></g></svg>'
)


@pytest.fixture
def read(tmp_path):
    """Read a file of a folder with three drawings, or a new one with the given text."""
    (tmp_path / "w.csv").write_text(CSV)
    (tmp_path / "part.ngc").write_text(GCODE)
    (tmp_path / "PART.SVG").write_text(SVG)

    def reader(name="w.csv", text=None, *, frame=None, progress=None, **options):
        if text is not None:
            (tmp_path / name).write_text(text)
        read_options = ac.ReadOptions(**options)
        return ac.read_path(tmp_path / name, read_options, frame=frame, progress=progress)

    return reader


def names(program):
    return [x.name for x in program.contours]


def test_every_file_format_is_read_in_metres(read):
    for name, units in (("w.csv", "mm"), ("part.ngc", None), ("PART.SVG", None)):
        program = read(name, units=units)
        assert program.source == name
        first = program.contours[0].path
        assert first.length == pytest.approx(0.02, abs=1e-12)
        ends = first([0.0, first.length])[:, :2]
        np.testing.assert_allclose(ends, [[0, 0], [0.02, 0]], atol=1e-12)
    assert read(units=0.0254).contours[0].path.length == pytest.approx(20 * 0.0254)


def test_a_drawing_is_scaled_before_it_is_placed(read):
    frame = ac.Frame.rpy((0.3, 0.1, 0.0), (0, 0, np.pi / 2))
    program = read(units="mm", scale=2.0, frame=frame)
    assert program.dimension == 2
    path = program.contours[1].path
    expected = [[0.3 - 0.02, 0.1], [0.3 - 0.02, 0.14]]
    np.testing.assert_allclose(path([0.0, path.length]), expected, atol=1e-12)
    lifted = read(units="mm", frame=ac.Frame(position=(0, 0, 0.5)))
    assert lifted.dimension == 3
    assert lifted.contours[0].path(0.0)[2] == 0.5
    # The height can be left out.
    assert read("part.ngc").dimension == 3
    flat = read("part.ngc", ignore_z=True)
    assert flat.dimension == 2
    assert flat.length == pytest.approx(0.04)


def test_layers_and_names_select_contours(read):
    assert names(read(units="mm", layers=["MARK"])) == ["b"]
    assert names(read(units="mm", layers="CUT")) == ["a"]
    assert [x.layer for x in read(units="mm", names=["a"]).contours] == ["CUT"]
    # Layers that are not run are listed with their number of contours.
    (remark,) = read(units="mm", layers=["CUT"]).remarks
    assert "MARK (1)" in remark and "CUT" not in remark
    assert read(units="mm").remarks == read(units="mm", layers=["CUT", "MARK"]).remarks == ()
    for name in ("w.csv", GASKET):
        cut = read(name, layers=["CUT"])
        numbers = {x.name: x.number for x in (*cut.contours, *cut.left_out)}
        assert numbers == {x.name: x.number for x in read(name).contours}
        assert cut.left_out and {x.layer for x in cut.left_out} == {"MARK"}
    # Only a program of one contour has a path.
    assert read("PART.SVG").path.length == pytest.approx(0.02)
    refusals(lambda x: x.path, [(read(units="mm"), "w.csv has 2 contours")])


def test_unreadable_files_are_refused(read, tmp_path):
    (tmp_path / "folder.dxf").mkdir()
    (tmp_path / "part.dwg").write_bytes(b"AC1032")
    (tmp_path / "across.ngc").write_text("G21 F600\nG18\nG1 X10\nG2 X20 Z0 I5 K0\n")
    (tmp_path / "large.ngc").write_text("G1 X220 F60\nY140\n")
    table = [
        (("missing.dxf", {}), "There is no file ... missing.dxf"),
        (("part.dwg", {}), "Save it as DXF"),
        (("w.csv", {"units": "mm", "layers": ["FOO"]}), "no layer 'FOO' ... 'CUT', 'MARK'"),
        (("w.csv", {"units": "mm", "names": ["c"]}), "no contour 'c' ... 'a', 'b'"),
        (("w.csv", {"scale": -1.0}), "scale ... above zero"),
        (("w.csv", {"unknown": "guess"}), "unknown"),
        (("w.csv", {"layers": 5}), "layer ... 5"),
        (("across.ngc", {"ignore_z": True}), "across.ngc: contour 1 (line 3): Segment 2"),
        (("part.ngc", {"colors": ["red"]}), "DXF and SVG"),
        (("PART.SVG", {"colors": "red"}), "must be a list"),
        (("large.ngc", {"units": "furlongs"}), "furlong ... 4.426e+04 m ... 1000 m"),
    ]
    refusals(lambda x: read(x[0], **x[1]), table)
    assert read("large.ngc", units="furlongs", scale=1e-3).path.length > 70
    assert read("large.ngc", units="mm").path.length == pytest.approx(0.36)


@pytest.mark.parametrize("ending", [".dxf", ".svg", ".ngc", ".csv"])
def test_endless_or_too_large_files_are_refused_before_they_are_read(tmp_path, ending):
    os.mkfifo(tmp_path / f"pipe{ending}")
    (tmp_path / f"zero{ending}").symlink_to("/dev/zero")
    (tmp_path / f"loop{ending}").symlink_to(tmp_path / f"loop{ending}")
    for name, size in (("huge", 65_000_000), ("large", 3_000_000_000)):
        with open(tmp_path / f"{name}{ending}", "wb") as file:
            file.truncate(size)
    table = [
        ("pipe", "pipe ... not a regular file"),
        ("zero", "zero ... not a regular file"),
        ("huge", "huge ... 65 MB ... 64 MB"),
        ("large", "large ... 3000 MB ... 64 MB"),
        ("loop", "cannot be read"),
        ("nul\0", "cannot be read"),
        ("x" * 5000, "cannot be read"),
    ]
    refusals(lambda name: ac.read_path(tmp_path / f"{name}{ending}"), table)


TOLERANCE = 1e-5


@given(seed=st.integers(0, 2**32), degree=st.integers(2, 5), extra=st.integers(0, 6))
@settings(max_examples=15)
def test_the_path_of_a_b_spline_follows_any_knots_and_weights(seed, degree, extra):
    rng = np.random.default_rng(seed)
    n = degree + 1 + extra
    points = rng.uniform(-0.05, 0.05, (n, 2))
    weights = rng.uniform(0.3, 3.0, n)
    knots = np.sort(np.round(rng.uniform(0, 4, n + degree + 1), 1)) * 0.7
    knots[: degree + 1] = -0.7
    knots[-degree - 1 :] = 3.5
    spline = BezierSpline.from_knots(points, weights, knots, degree)
    if np.unique(knots[1:-1], return_counts=True)[1].max(initial=0) > degree + 1 or spline is None:
        # A gap: the curve on both sides of a knot that occurs too often.
        assert np.unique(knots[degree + 1 : n], return_counts=True)[1].max() > degree
        return
    whole = BSpline(knots, np.column_stack([weights[:, None] * points, weights]), degree)
    value = whole(np.linspace(-0.7, 3.5, 3001))
    ((_, segments),) = fit_splines([spline], TOLERANCE)
    path = ac.Path(segments=segments)
    assert path.project(value[:, :2] / value[:, 2:]).distance.max() <= TOLERANCE
