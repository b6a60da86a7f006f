"""Drawings on the command line: results, refusals, and runs that fail while writing."""

import numpy as np
import pytest
from tests.cli.helpers import summary

PLAIN = "x [mm],y [mm]\n0,0\n60,0\n60,40\n"
TWO = "contour,x [mm],y [mm]\na,0,0\na,60,0\nb,0,30\nb,60,30\nb,60,60\nb,0,30\n"
GCODE = """G21 G90 F3000
S1000 M3
G0 X10 Y10
G1 X50 Y10
G1 X50 Y40
M5
G0 X60 Y60
M3
G1 X90 Y60
G1 X90 Y90
G1 X60 Y60
M2
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "plain.csv").write_text(PLAIN)
    (tmp_path / "two.csv").write_text(TWO)
    (tmp_path / "part.ngc").write_text(GCODE)
    (tmp_path / "deep.ngc").write_text("G21 F600\nG1 X10 Y0 Z1\nG1 X20 Y10 Z0\n")
    return tmp_path


@pytest.fixture
def call(folder, done, monkeypatch):
    """A command line in the folder, which has to succeed: its output."""
    monkeypatch.chdir(folder)
    return lambda line, *more: done(*line.split(), *more)


def table(file):
    return np.loadtxt(file, delimiter=",", skiprows=1)


def test_g_code_is_run_in_a_cell_and_exported(folder, call):
    (folder / "list.txt.j2").write_text(
        "{% for e in events %}{{ e.text }} {{ outputs.get(e.name) }}\n{% endfor %}"
    )
    call(
        "run part.ngc --cell pmk3s --out out --export csv --export list.txt.j2",
        *("--set", "export.outputs.spindle=3", "--speed", "80 mm/s"),
    )
    result = summary(folder / "out")
    for name in result["files"]:
        assert (folder / "out" / name).is_file()
    assert {x for x in result["files"] if "/export/" in x} == {
        f"compensated/export/{a}{b}" for a in ("set_points", "reference") for b in (".csv", ".txt")
    }
    set_point_lines = (
        (folder / "out" / "compensated" / "export" / "set_points.txt").read_text().splitlines()
    )
    spindle = [x for x in set_point_lines if x.startswith("spindle=")]
    assert spindle == ["spindle=on 3", "spindle=off 3", "spindle=on 3", "spindle=off 3"]
    set_points = table(folder / "out" / "compensated" / "set_points.csv")
    np.testing.assert_allclose(np.diff(set_points[:, 0]), 4e-3, atol=1e-12)
    assert result["runs"]["compensated"]["contour_error"]["max"] < 1e-4
    assert not list(folder.rglob(".armcontour-*"))


REFUSED = [
    ("plain.csv", ["--cell", "requires a cell"]),
    ("deep.ngc --cell pmk3s", ["deep.ngc has z", "--ignore-z"]),
    ("two.csv --cell pmk3s --position 0.5m,0.3m", ["Contour 2 (b)", "out of reach"]),
    ("two.csv --cell pmk3s --export template", ["template", "urscript, kuka"]),
    ("two.csv --cell pmk3s --call", ["--call requires --export"]),
    (
        "two.csv --cell ur5e --export urscript --set export.outputs.tool=1",
        ["'tool'", "switches no output"],
    ),
]


def test_invalid_commands_for_drawings_are_refused_and_write_nothing(folder, refused):
    rows = [(f"run {line} --out out", words) for line, words in REFUSED]
    assert refused(folder, rows) == []


def test_without_simulation_the_requested_files_are_written(folder, call):
    call("run part.ngc --cell pmk3s --no-simulation --out out --export csv")
    result = summary(folder / "out")
    assert result["simulated"] is False
    exports = ["compensated/export/reference.csv", "compensated/export/set_points.csv"]
    assert result["files"] == [*exports, "summary.json"]
    written = {x.relative_to(folder / "out").as_posix() for x in (folder / "out").rglob("*.*")}
    assert written == {*result["files"], ".armcontour.json"}
    run = result["runs"]["compensated"]
    assert run["duration"] > 0 and run["moves"] and "contour_error" not in run
    # The same set-points as with it.
    call("run part.ngc --cell pmk3s --out whole")
    whole = folder / "whole" / "compensated" / "set_points.csv"
    set_points = table(whole)
    file = folder / "out" / "compensated" / "export" / "set_points.csv"
    exported = np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1, 2))
    np.testing.assert_allclose(exported[:, 1:], set_points[:, 1:3], rtol=0, atol=0.51e-9)
    # In exports time counts from the first set-point.
    np.testing.assert_allclose(
        exported[:, 0], set_points[:, 0] - set_points[0, 0], rtol=0, atol=2e-12
    )
    titles = whole.read_text().splitlines()[0]
    assert titles == "t [s],q 1 [rad],q 2 [rad]" and file.read_text().startswith(titles)
    # Without formats it is the plain files.
    call("run part.ngc --cell pmk3s --no-simulation --out plain")
    assert (folder / "plain" / "compensated" / "planned.csv").is_file()
    assert not (folder / "plain" / "report.html").exists()


def test_a_position_of_two_lengths_keeps_the_height_of_the_cell(folder, call):
    place = ("--no-simulation", "--export", "csv", "--position")
    call("run plain.csv --cell ur5e --out two", *place, "350 mm, -100 mm")
    call("run plain.csv --cell ur5e --out three", *place, "350 mm, -100 mm, 100 mm")
    name = "compensated/export/set_points.csv"
    assert (folder / "two" / name).read_text() == (folder / "three" / name).read_text()
