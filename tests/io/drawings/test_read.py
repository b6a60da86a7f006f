"""One entry point of all readers: by the ending; units, scale, frame and filters here."""

from __future__ import annotations

import os

import numpy as np
import pytest

import armcontour as ac
from armcontour._progress import Step
from armcontour.io.drawings.endings import READERS

CSV = "x,y,contour,layer\n0,0,a,CUT\n20,0,a,CUT\n0,10,b,MARK\n20,10,b,MARK\n"
GCODE = "G21 F600\nG0 X0 Y0\nG1 X20\nG0 X0 Y10 Z2\nG1 X20\n"
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="10mm" viewBox="0 0 20 10">'
    '<g id="CUT"><line id="a" x1="0" y1="10" x2="20" y2="10"/></g></svg>'
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "w.csv").write_text(CSV)
    (tmp_path / "part.ngc").write_text(GCODE)
    (tmp_path / "PART.SVG").write_text(SVG)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "units"), [("w.csv", "mm"), ("part.ngc", None), ("PART.SVG", None)]
)
def test_every_file_comes_in_metres(folder, name, units):
    program = ac.read_path(folder / name, units=units)
    assert program.source == name
    first = program.contours[0].path
    assert first.length == pytest.approx(0.02, abs=1e-12)
    np.testing.assert_allclose(first([0.0, first.length])[:, :2], [[0, 0], [0.02, 0]], atol=1e-12)


def test_units_may_be_metres_per_unit(folder):
    program = ac.read_path(folder / "w.csv", units=0.0254)
    assert program.contours[0].path.length == pytest.approx(20 * 0.0254)


def test_a_drawing_is_scaled_and_then_placed(folder):
    frame = ac.Frame.rpy((0.3, 0.1, 0.0), (0, 0, np.pi / 2))
    program = ac.read_path(folder / "w.csv", units="mm", scale=2.0, frame=frame)
    assert program.dimension == 2
    path = program.contours[1].path
    np.testing.assert_allclose(
        path([0.0, path.length]), [[0.3 - 0.02, 0.1], [0.3 - 0.02, 0.14]], atol=1e-12
    )
    lifted = ac.read_path(folder / "w.csv", units="mm", frame=ac.Frame(position=(0, 0, 0.5)))
    assert lifted.dimension == 3
    assert lifted.contours[0].path(0.0)[2] == 0.5


def test_tools_keep_their_diameters_when_a_drawing_is_scaled(tmp_path):
    (tmp_path / "part.ngc").write_text("F600\nG41 D1 G1 X10\nX20\nM2\n")
    path = ac.read_path(tmp_path / "part.ngc", tools={1: 4e-3}, scale=3.0).path
    np.testing.assert_allclose(path.vertices, [[0, 0], [0.03, 2e-3], [0.06, 2e-3]], atol=1e-12)


def test_layers_and_names_choose_contours(folder):
    file = folder / "w.csv"
    by_layer = ac.read_path(file, units="mm", layers=["MARK"])
    assert [x.name for x in by_layer.contours] == ["b"]
    by_name = ac.read_path(file, units="mm", names=["a"])
    assert [x.layer for x in by_name.contours] == ["CUT"]


def test_layers_that_are_not_run_are_listed_with_their_contours(folder):
    (remark,) = ac.read_path(folder / "w.csv", units="mm", layers=["CUT"]).remarks
    assert "MARK (1)" in remark and "CUT" not in remark
    assert ac.read_path(folder / "w.csv", units="mm").remarks == ()
    assert ac.read_path(folder / "w.csv", units="mm", layers=["CUT", "MARK"]).remarks == ()


def test_z_can_be_left_out(folder):
    assert ac.read_path(folder / "part.ngc").dimension == 3
    flat = ac.read_path(folder / "part.ngc", flat=True)
    assert flat.dimension == 2
    assert flat.length == pytest.approx(0.04)


def test_a_program_of_one_contour_gives_its_path(folder, refuses):
    assert ac.read_path(folder / "PART.SVG").path.length == pytest.approx(0.02)
    program = ac.read_path(folder / "w.csv", units="mm")
    refuses(lambda: program.path, ac.InvalidInput, "w.csv has 2 contours and not one path")


def test_reading_tells_how_far_it_is(folder):
    (folder / "long.ngc").write_text("G21 F600\n" + "G1 X1\nG1 X2\n" * 20_000)
    told: list[Step] = []
    ac.read_path(folder / "long.ngc", progress=told.append)
    assert {x.names for x in told} == {("long.ngc",)}
    shares = [x.done or 0.0 for x in told]
    assert shares == sorted(shares)
    assert 0 <= shares[0] < shares[-1] <= 1


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("missing.dxf", {}, ("There is no file", "missing.dxf")),
        ("part.step", {}, ("part.step is no file that can be read", ".dxf, .svg")),
        ("w.csv", {"units": "kg"}, ("units must be a unit of length", "'kg'")),
        ("w.csv", {"units": "mm", "layers": ["FOO"]}, ("has no layer 'FOO'", "'CUT', 'MARK'")),
        ("w.csv", {"units": "mm", "names": ["c"]}, ("has no contour 'c'", "'a', 'b'")),
        ("w.csv", {"units": "mm", "scale": -1.0}, ("scale must be above zero",)),
        ("w.csv", {"unknown": "guess"}, ("unknown",)),
    ],
)
def test_what_cannot_be_read_is_refused(folder, refuses, name, options, words):
    refuses(lambda: ac.read_path(folder / name, **options), ac.InvalidInput, *words)


def test_a_large_file_is_refused_before_it_is_read(folder, refuses):
    with (folder / "huge.ngc").open("wb") as file:
        file.truncate(65_000_000)
    refuses(lambda: ac.read_path(folder / "huge.ngc"), ac.InvalidInput, "huge.ngc has 65 MB")


def test_every_ending_has_a_reader():
    for module, function, _ in READERS.values():
        assert callable(
            getattr(__import__(f"armcontour.io.drawings.{module}", fromlist=[function]), function)
        )


@pytest.mark.parametrize("scale", [1e11, 1e-12])
def test_a_scale_that_leaves_no_drawing_is_refused(folder, refuses, scale):
    read = lambda: ac.read_path(folder / "w.csv", scale=scale)  # noqa: E731
    refuses(read, ac.InvalidInput, f"scale {scale:g}", "w.csv", "check the scale")


def test_what_is_no_frame_and_no_name_is_refused(folder, refuses):
    file = folder / "w.csv"
    refuses(lambda: ac.read_path(file, frame=[0.3, 0, 0]), ac.InvalidInput, "Frame", "list")
    refuses(lambda: ac.read_path(file, layers=5), ac.InvalidInput, "layer", "5")
    refuses(lambda: ac.read_path(file, names=["a", 5]), ac.InvalidInput, "no contour 5")
    assert len(ac.read_path(file, layers="CUT").contours) == 1


def test_an_arc_that_cannot_be_flattened_is_named_by_its_line(folder, refuses):
    (folder / "across.ngc").write_text("G21 F600\nG18\nG1 X10\nG2 X20 Z0 I5 K0\n")
    read = lambda: ac.read_path(folder / "across.ngc", flat=True)  # noqa: E731
    refuses(read, ac.InvalidInput, "across.ngc: contour line 3: Segment 2", "leaves the plane")


def test_what_is_no_file_is_refused(folder, refuses):
    (folder / "folder.dxf").mkdir()
    refuses(lambda: ac.read_path(folder / "folder.dxf"), ac.InvalidInput, "Is a directory")


def test_a_program_is_held_as_a_path_is(folder):
    program = ac.read_path(folder / "w.csv", units="mm").pointing((0, 0, -1))
    assert program.dimension == 3
    assert all(x.path.orientation.axis_only for x in program.contours)
    turned = ac.read_path(folder / "w.csv", units="mm").oriented(np.diag([1.0, -1.0, -1.0]))
    np.testing.assert_array_equal(turned.contours[1].path.orientation(0.0)[:, 2], [0, 0, -1])
    assert repr(program) == "Program('w.csv', 2 contours, 0.04 m)"


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("ending", [".dxf", ".svg", ".ngc", ".csv", ".parquet"])
def test_what_never_ends_or_is_too_large_is_refused_before_it_is_read(tmp_path, refuses, ending):
    def refused(name, *words):
        refuses(lambda: ac.read_path(tmp_path / name), ac.InvalidInput, *words)

    os.mkfifo(tmp_path / f"pipe{ending}")
    refused(f"pipe{ending}", "pipe", "not a regular file")
    (tmp_path / f"zero{ending}").symlink_to("/dev/zero")
    refused(f"zero{ending}", "zero", "not a regular file")
    with open(tmp_path / f"large{ending}", "wb") as file:
        file.truncate(3_000_000_000)
    refused(f"large{ending}", "large", "3000 MB, more than the 64 MB")
    (tmp_path / f"loop{ending}").symlink_to(tmp_path / f"loop{ending}")
    refused(f"loop{ending}", "cannot be read")
    refused(f"nul\0{ending}", "cannot be read")
    refused("x" * 5000 + ending, "cannot be read")


@pytest.mark.parametrize("name", ["gasket.dxf", "lettering.svg"])
def test_drawings_tell_how_much_of_them_is_read(name):
    told = []
    ac.read_path(f"examples/drawings/{name}", progress=told.append)
    assert {x.names for x in told} == {(name,)}
    shares = [x.done for x in told]
    assert shares == sorted(set(shares)) and 0 <= shares[0] < shares[-1] <= 1


def test_a_dwg_is_to_be_saved_as_dxf(tmp_path, refuses):
    file = tmp_path / "part.dwg"
    file.write_bytes(b"AC1032")
    refuses(lambda: ac.read_path(file), ac.InvalidInput, "save it as DXF")


def test_colors_are_a_list_and_of_drawings(tmp_path, refuses):
    file = tmp_path / "part.ngc"
    file.write_text("G1 X1 F100\n")
    refuses(lambda: ac.read_path(file, colors=["red"]), ac.InvalidInput, "DXF and SVG")
    svg = "examples/drawings/lettering.svg"
    refuses(lambda: ac.read_path(svg, colors="red"), ac.InvalidInput, "must be a list")


def test_an_implausible_unit_is_refused_by_the_size_of_the_part(tmp_path, refuses):
    (tmp_path / "a.ngc").write_text("G1 X220 F60\nY140\n")
    words = ("furlong", "4.426e+04 m", "1000 m")
    refuses(lambda: ac.read_path(tmp_path / "a.ngc", units="furlongs"), ac.InvalidInput, *words)
    assert ac.read_path(tmp_path / "a.ngc", units="furlongs", scale=1e-3).path.length > 70
    assert ac.read_path(tmp_path / "a.ngc", units="mm").path.length == pytest.approx(0.36)


def test_a_table_without_a_unit_beyond_the_reach_of_arms_has_a_note(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("x,y\n0,0\n89,50\n")
    (note,) = ac.read_path(file).notes
    assert "89 m" in note and "units: mm" in note
    assert ac.read_path(file, units="mm").notes == ()
    file.write_text("x,y\n0,0\n0.89,0.5\n")
    assert ac.read_path(file).notes == ()
