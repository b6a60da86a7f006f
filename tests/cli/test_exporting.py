"""Exports on the command line: options, and `export` of an earlier result."""

import re

import numpy as np
import pandas as pd
import pytest
import yaml
from tests.dynamics_extra import needs_dynamics

PART = """G21 G90 F6000
S1000 M3
G0 X10 Y10
G1 X30 Y10
G1 X30 Y20
M5
M2
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A drawing for a UR5e."""
    place = tmp_path_factory.mktemp("exports")
    (place / "part.ngc").write_text(PART)
    return place


@pytest.fixture
def call(folder, done, monkeypatch, capsys):
    """A command line in the folder, which has to succeed: the words of its output."""
    monkeypatch.chdir(folder)
    return lambda *arguments: " ".join(done(*arguments).split())


@pytest.fixture
def result(call, folder):
    """The folder of the result; the run is done once."""
    if not (folder / "out").exists():
        printed = call(
            *("run", "part.ngc", "--cell", "ur5e", "--out", "out", "--export", "csv"),
            *("--export", "ros-yaml", "--export", "abb", "--cycle", "48 ms"),
            *("--set", "export.outputs={spindle: doTool}"),
        )
        assert (
            printed.count("times the acceleration limit") == 1
            and "no output is named" not in printed
        )
    return folder / "out"


@needs_dynamics
def test_export_uses_the_period_and_the_outputs_of_the_job(result, call, folder):
    exports = result / "compensated" / "export"
    reference = pd.read_csv(exports / "reference.csv")
    np.testing.assert_allclose(np.diff(reference["t [s]"])[:-1], 0.048, atol=1e-12)
    set_points = pd.read_csv(exports / "set_points.csv")
    np.testing.assert_allclose(np.diff(set_points["t [s]"]), 0.004, atol=1e-12)
    abb = (exports / "reference.mod").read_text()
    assert "SetDO doTool" in abb
    # A period of 48 ms is 12 set-points of this controller.
    assert abs(abb.count("MoveAbsJ") - reference["t [s]"].iloc[-1] / 48e-3) <= 3
    # This controller plans between the points: it gets the plan only.
    assert not (exports / "set_points.mod").exists()
    # An earlier result has the outputs of its job.
    call("export", "out", "again.mod", "--force")
    assert (folder / "again.mod").read_text().count("SetDO") == abb.count("SetDO") > 0


@needs_dynamics
def test_exports_of_a_first_run_are_slow_and_switch_nothing(result, call, folder):
    table = {}
    for name, words in {
        "full": (),
        "first": ("--speed-factor", "10 %", "--process-off", "--set", "cycle=40 ms"),
    }.items():
        call(
            *("run", "part.ngc", "--cell", "ur5e", "--out", name, "--no-changes"),
            *("--export", "urscript", "--set", "export.outputs={spindle: 0}", *words),
        )
        text = (folder / name / "compensated" / "export" / "reference.script").read_text()
        points = re.findall(r"servoj\(\[(.*?)\], 0, 0, ([0-9.]+)", text)
        # The last point is held.
        table[name] = np.array([x.split(",") for x, _ in points[:-1]], dtype=float)
        assert {float(t) for _, t in points[:-1]} == {0.004 if name == "full" else 0.04}
        assert ("digital_out" in text) == (name == "full")
    # The points are those of the full speed, ten times as far apart in time.
    count = min(map(len, table.values()))
    assert count >= max(map(len, table.values())) - 1
    np.testing.assert_allclose(table["first"][: count - 1], table["full"][: count - 1], atol=2e-7)
    # An earlier result is exported at its speed, and its outputs are not missed.
    call("export", "first", "first.script", "--force")
    text = (folder / "first.script").read_text()
    assert len(re.findall("servoj", text)) >= count and "digital_out" not in text


LIMITED = """
name: square
arm: ur5e
path:
  points: [[0.45, -0.05, 0.3], [0.55, -0.05, 0.3], [0.55, 0.05, 0.3]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 250 mm/s}
corners: {tolerance: 1 mm, continuity: curvature}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs:
  free: {timing: {reserve: 20 %}}
  kept: {timing: {reserve: 20 %}, command_limits: {joint_acceleration: 3.14159 rad/s^2}}
"""


CELL = """
name: cell
arm:
  name: ur5e
  work: {position: [0.5, 0, 0.2]}
  rail: {axis: [0, 1, 0], upper: 1 m, velocity: 1 m/s, acceleration: 2 m/s^2}
  positioner:
    axes:
      - {name: turn, axis: [0, 0, 1], origin: [0.5, 0, 0.2], lower: -3 rad, upper: 3 rad,
         velocity: 1 rad/s, acceleration: 2 rad/s^2}
path:
  points: [[0.05, -0.05, 0.1], [0.05, 0.05, 0.1]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 50 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs:
  moved: {}
"""


def test_exporting_an_earlier_result_writes_its_external_axes(call, folder):
    (folder / "cell.yaml").write_text(CELL)
    call("run", "cell.yaml", "--force", "--out", "cell")
    written = pd.read_csv(folder / "cell" / "moved" / "set_points.csv")
    last = [1e3 * written["q rail [m]"].iloc[-1], np.degrees(written["q turn [rad]"].iloc[-1])]
    number = r"(-?[0-9.]+)"
    for ending, form in (
        ("src", rf"E1 {number}, E2 {number}\}}"),
        ("mod", rf"\[{number}, {number}, 9E9"),
    ):
        call("export", "cell", f"cell.{ending}", "--force")
        found = re.findall(form, (folder / f"cell.{ending}").read_text())[-1]
        np.testing.assert_allclose([float(x) for x in found], last, rtol=0, atol=1e-5)


def test_a_warning_of_accelerations_names_command_limits(call, folder):
    (folder / "square.yaml").write_text(LIMITED)
    base = ("run", "square.yaml", "--no-changes", "--force", "--out", "square")
    printed = call(*base, "--export", "ros-yaml")
    assert printed.count("times the acceleration limit") == 1 and "reserve:" not in printed
    files = [folder / "square" / x / "export" / "set_points.yaml" for x in ("free", "kept")]
    free, kept = (yaml.safe_load(x.read_text())["points"][0]["accelerations"] for x in files)
    assert len(free) == 6 and len(kept) == 0


@needs_dynamics
def test_exporting_an_earlier_result_gives_the_file_of_its_run(result, call, folder):
    printed = call("export", "out", "set_points.csv")
    assert "Exported set_points of run compensated" in printed
    table = pd.read_csv(folder / "set_points.csv")
    before = pd.read_csv(result / "compensated" / "export" / "set_points.csv")
    shared = [x for x in before.columns if x in table.columns]
    assert shared == list(table.columns) and "events" in shared
    assert table["events"].equals(before["events"])
    for key, atol in (("t ", 0.0), ("q ", 1.1e-9), ("dq ", 1.1e-8), ("ddq ", 2e-6)):
        columns = [x for x in shared if x.startswith(key)]
        assert columns
        np.testing.assert_allclose(table[columns], before[columns], rtol=0, atol=atol)


@needs_dynamics
def test_an_exported_goal_has_tolerances_and_reduced_points(result, call, folder, refused):
    options = ("--points", "60", "--point-tolerance", "0.2 mrad")
    call(
        *("run", "part.ngc", "--cell", "ur5e", "--out", "few", "--export", "ros-yaml"),
        *("--tolerances", "2", *options),
    )
    exports = folder / "few" / "compensated" / "export"
    goal = yaml.safe_load((exports / "set_points.yaml").read_text())
    points = goal["trajectory"]["points"]
    assert 2 < len(points) <= 60
    assert min(x["position"] for x in goal["path_tolerance"]) >= 1e-3
    assert len(yaml.safe_load((exports / "reference.yaml").read_text())["points"]) <= 60
    # The same points from an earlier result.
    call("export", "few", "again.yaml", *options)
    again = yaml.safe_load((folder / "again.yaml").read_text())["points"]
    positions = [[x["positions"] for x in y] for y in (points, again)]
    np.testing.assert_allclose(*positions, rtol=0, atol=1.1e-9)
    rows = [
        ("c.yaml --points 9 --point-tolerance 0.1mrad", ["9 points", "requires", "Increase points"])
    ]
    assert refused(folder, rows, codes=(2,), begin=("export", "out")) == []


@needs_dynamics
def test_invalid_exports_are_refused_and_write_nothing(result, folder, refused, call, tmp_path):
    rows = [
        ("a.csv --run none", ["'none'", "'compensated'"]),
        ("a.csv --cycle 48ms", ["--cycle applies to run"]),
        ("a.yaml --points 9", ["point_tolerance", "Specify both"]),
        ("a.csv --call", ["call requires the format urscript"]),
        ("a.npz", ["a.npz does not belong to a format"]),
        ("a.script", ["The output of spindle", "must be a number"]),
        ("part.ngc --format csv", ["part.ngc exists", "--force"]),
    ]
    assert refused(folder, rows, codes=(2,), begin=("export", "out")) == []
    file = result / "compensated" / "set_points.csv"
    text = file.read_text()
    file.write_text(text + "\n")
    rows = [
        (("export", tmp_path, "a.csv"), ["has no result"]),
        ("export out a.csv", ["set_points.csv has changed since"]),
    ]
    assert refused(folder, rows, codes=(2,)) == []
    file.write_text(text)
    call("export", "out", "a.csv")


TWO_ROBOTS = """
name: square
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
path:
  points: [[0.45, -0.05, 0.3], [0.55, -0.05, 0.3], [0.55, 0.05, 0.3]]
  orientation: {axis: [0, 0, -1]}
process: {switch: {name: laser}}
limits: {speed: 250 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
export: {formats: [kuka, abb], outputs: {laser: 17}}
runs: {a: {}, b: {cycle: 8 ms}}
"""


def test_outputs_that_a_format_cannot_have_are_refused_before_the_plan(folder, refused, call):
    (folder / "two.yaml").write_text(TWO_ROBOTS)
    rows = [("run two.yaml --out two", ["export abb", "names of signals", "laser is 17", "differ"])]
    assert refused(folder, rows, codes=(2,)) == []
    outputs = "export.outputs.laser={kuka: 17, abb: doLaser}"
    call("run", "two.yaml", "--no-changes", "--out", "two", "--set", outputs)
    programs = {}
    for run in ("a", "b"):
        exports = folder / "two" / run / "export"
        assert "$OUT[17] = TRUE" in (exports / "reference.src").read_text()
        programs[run] = (exports / "reference.mod").read_text()
        assert "SetDO doLaser, 1;" in programs[run]
    # Programs of both runs can be in one controller.
    names = [re.findall(r"(?:MODULE|PROC) (\w+)", x) for x in programs.values()]
    assert names == [[f"square_{x}_reference", f"run_square_{x}_reference"] for x in "ab"]
    # An earlier result has the outputs of each format.
    call("export", "two", "again.mod", "--run", "a", "--force")
    assert "SetDO doLaser, 1;" in (folder / "again.mod").read_text()


def test_an_export_that_fails_after_the_plan_loses_no_result(folder, command_in):
    (folder / "one.yaml").write_text(TWO_ROBOTS)
    exports = ("--export", "ros-yaml", "--export", "csv")
    few = ("--points", "3", "--point-tolerance", "0.001 mrad", "--set", "export.outputs={}")
    ended = command_in(folder, "run", "one.yaml", "--no-changes", "--out", "one", *exports, *few)
    assert ended.code == 2
    printed = " ".join(ended.out.split())
    assert "reference.yaml was not written" in printed and "Increase points" in printed
    for run in ("a", "b"):
        written = {x.name for x in (folder / "one" / run / "export").iterdir()}
        assert written == {"set_points.csv", "reference.csv"}
        assert (folder / "one" / run / "set_points.csv").is_file()
    for name in ("report.html", "summary.json"):
        assert (folder / "one" / name).is_file()


# -------------------------------------------------------------------------------- analog outputs

LASER = """name: laser
arm: pmk3s
path:
  points: [[0.30, 0.20], [0.34, 0.20]]
process:
  lead_in: {length: 5 mm}
  switch: {name: laser}
  analog: [{name: power, rest: 20 %, full: 1000}]
limits: {speed: 50 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {compensated: {}}
"""


def test_analog_outputs_are_columns_of_a_run_but_not_of_an_earlier_result(call, folder):
    (folder / "laser.yaml").write_text(LASER)
    options = ("--no-simulation", "--export", "csv", "--export", "ros-yaml", "--out", "laser")
    run_output = call("run", "laser.yaml", *options)
    assert (
        run_output.count("does not support analog outputs (power)") == 1
        and "export ros-yaml" in run_output
    )
    columns = pd.read_csv(folder / "laser" / "compensated" / "export" / "reference.csv")
    power = columns["analog power"]
    assert power.iloc[0] == 0.0 and 990 < power.max() <= 1000 + 1e-6
    call("run", "laser.yaml", "--no-simulation", "--out", "plain")
    export_output = call("export", "plain", "laser.csv")
    assert "The analog outputs power are not exported" in export_output
    assert not any(x.startswith("analog") for x in pd.read_csv(folder / "laser.csv").columns)
