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


def table(file, columns=None):
    """Read the numbers of a file of set-points."""
    return np.loadtxt(file, delimiter=",", skiprows=1, usecols=columns)


LIST_OF_EVENTS = """{% set keeps_times = true %}
{% for e in events %}{{ e.text }} {{ outputs.get(e.name) }}
{% endfor %}"""


@pytest.fixture
def exported(folder, call):
    """Folder of a run of G-code that is exported as CSV and through a template of the user."""
    (folder / "list.txt.j2").write_text(LIST_OF_EVENTS)
    call(
        "run part.ngc --cell pmk3s --out out --export csv --export list.txt.j2",
        *("--set", "export.outputs.spindle=3", "--speed", "80 mm/s"),
    )
    return folder / "out"


def test_g_code_run_follows_the_drawing_at_the_cycle_of_the_cell(exported):
    set_points = table(exported / "compensated" / "set_points.csv")
    np.testing.assert_allclose(np.diff(set_points[:, 0]), 4e-3, atol=1e-12)
    assert summary(exported)["runs"]["compensated"]["contour_error"]["max"] < 1e-4


def test_exported_files_are_listed_in_the_summary(exported):
    files = summary(exported)["files"]
    for name in files:
        assert (exported / name).is_file()
    assert {x for x in files if "/export/" in x} == {
        "compensated/export/set_points.csv",
        "compensated/export/set_points.txt",
        "compensated/export/reference.csv",
        "compensated/export/reference.txt",
    }
    assert not list(exported.rglob(".armcontour-*"))


def test_template_of_the_user_gets_the_spindle_and_its_output(exported):
    text = (exported / "compensated" / "export" / "set_points.txt").read_text()
    spindle = [x for x in text.splitlines() if x.startswith("spindle=")]
    assert spindle == ["spindle=on 3", "spindle=off 3", "spindle=on 3", "spindle=off 3"]


REFUSED = [
    ("plain.csv", ["--cell", "requires a cell"]),
    ("deep.ngc --cell pmk3s", ["deep.ngc has z", "--ignore-z"]),
    ("two.csv --cell pmk3s --position 0.5m,0.3m", ["Contour 2 (b)", "out of reach"]),
    ("two.csv --cell pmk3s --export template", ["template", "urscript, mcap, kuka"]),
    ("two.csv --cell pmk3s --call", ["--call requires --export"]),
    (
        "two.csv --cell ur5e --export urscript --set export.outputs.tool=1",
        ["'tool'", "switches no output"],
    ),
]


def test_invalid_commands_for_drawings_are_refused_and_write_nothing(folder, refused):
    rows = [(f"run {line} --out out", words) for line, words in REFUSED]
    assert refused(folder, rows) == []


@pytest.fixture
def unsimulated(folder, call):
    """Folder of a run of G-code that is planned and exported, but not simulated."""
    call("run part.ngc --cell pmk3s --no-simulation --out out --export csv")
    return folder / "out"


def test_run_without_simulation_writes_the_requested_files_only(unsimulated):
    result = summary(unsimulated)
    assert result["simulated"] is False
    assert result["files"] == [
        "compensated/export/reference.csv",
        "compensated/export/set_points.csv",
        "summary.json",
    ]
    written = {x.relative_to(unsimulated).as_posix() for x in unsimulated.rglob("*.*")}
    assert written == {*result["files"], ".armcontour.json"}


def test_run_without_simulation_has_a_plan_but_no_errors(unsimulated):
    run = summary(unsimulated)["runs"]["compensated"]
    assert run["duration"] > 0
    assert run["moves"]
    assert "contour_error" not in run


def test_exported_set_points_equal_those_of_a_simulated_run(folder, call, unsimulated):
    call("run part.ngc --cell pmk3s --out whole")
    stored_file = folder / "whole" / "compensated" / "set_points.csv"
    exported_file = unsimulated / "compensated" / "export" / "set_points.csv"
    stored = table(stored_file)
    exported = table(exported_file, columns=(0, 1, 2))
    np.testing.assert_allclose(exported[:, 1:], stored[:, 1:3], rtol=0, atol=0.51e-9)
    # In exports, time counts from the first set-point.
    stored_time = stored[:, 0] - stored[0, 0]
    np.testing.assert_allclose(exported[:, 0], stored_time, rtol=0, atol=2e-12)
    titles = stored_file.read_text().splitlines()[0]
    assert titles == "t [s],q 1 [rad],q 2 [rad]"
    assert exported_file.read_text().startswith(titles)


def test_run_without_simulation_and_format_writes_the_plan(folder, call):
    call("run part.ngc --cell pmk3s --no-simulation --out plain")
    assert (folder / "plain" / "compensated" / "planned.csv").is_file()
    assert not (folder / "plain" / "report.html").exists()


def test_position_of_two_lengths_keeps_the_height_of_the_cell(folder, call):
    options = ("--no-simulation", "--export", "csv", "--position")
    call("run plain.csv --cell ur5e --out two", *options, "350 mm, -100 mm")
    call("run plain.csv --cell ur5e --out three", *options, "350 mm, -100 mm, 100 mm")
    name = "compensated/export/set_points.csv"
    assert (folder / "two" / name).read_text() == (folder / "three" / name).read_text()
