"""Exports on the command line: options, and `export` of an earlier result."""

import re
import shlex

import numpy as np
import pandas as pd
import pytest
import yaml
from tests.dynamics_extra import needs_dynamics

# A drawing with a spindle that is switched on and off.
PART = """G21 G90 F6000
S1000 M3
G0 X10 Y10
G1 X30 Y10
G1 X30 Y20
M5
M2
"""
# Two runs of a corner: without and with limits of the set-points.
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
# A line for a UR5e on a rail, with the part on a rotary table.
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
# Two runs of a corner with a laser, for KUKA and ABB.
TWO_FORMATS = """
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
# A line with an analog output in proportion to the speed.
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
# Period of ABB's points, and of the plan in all formats [s].
POINT_PERIOD = 48e-3
CYCLE = 2e-3  # Period of set-points of the UR5e [s]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A drawing for a UR5e."""
    place = tmp_path_factory.mktemp("exports")
    (place / "part.ngc").write_text(PART)
    return place


@pytest.fixture
def call(folder, done, monkeypatch, capsys):
    """Run a command in the folder, which must succeed; return the words of its output."""
    monkeypatch.chdir(folder)

    def run_command(command, *more):
        return " ".join(done(*shlex.split(command), *more).split())

    return run_command


@pytest.fixture
def result(call, folder):
    """Folder of the result of PART; the run is done once."""
    if not (folder / "out").exists():
        printed = call(
            "run part.ngc --cell ur5e --out out --export csv --export ros-yaml --export abb"
            " --derivatives 2 --cycle '48 ms' --set 'export.outputs={spindle: doTool}'"
        )
        (folder / "printed.txt").write_text(printed)
    return folder / "out"


@pytest.fixture
def exports(result):
    """Folder of the exported files of the result."""
    return result / "compensated" / "export"


@needs_dynamics
def test_a_run_warns_once_of_accelerations_and_not_of_named_outputs(result, folder):
    printed = (folder / "printed.txt").read_text()
    assert printed.count("times the acceleration limit") == 1
    assert "no output is named" not in printed


@needs_dynamics
def test_the_plan_has_the_exported_period_and_set_points_have_the_cycle(exports):
    reference = pd.read_csv(exports / "reference.csv")
    np.testing.assert_allclose(np.diff(reference["t [s]"])[:-1], POINT_PERIOD, atol=1e-12)
    set_points = pd.read_csv(exports / "set_points.csv")
    np.testing.assert_allclose(np.diff(set_points["t [s]"]), CYCLE, atol=1e-12)


@needs_dynamics
def test_an_abb_program_contains_the_plan_and_its_outputs(exports):
    program = (exports / "reference.mod").read_text()
    assert "SetDO doTool" in program
    duration = pd.read_csv(exports / "reference.csv")["t [s]"].iloc[-1]
    assert abs(program.count("MoveAbsJ") - duration / POINT_PERIOD) <= 3


@needs_dynamics
def test_compensated_set_points_are_not_exported_for_abb(exports):
    """The controller plans between the points, so it gets only the plan."""
    assert not (exports / "set_points.mod").exists()


@needs_dynamics
def test_an_export_of_an_earlier_result_has_the_outputs_of_its_job(exports, call, folder):
    program = (exports / "reference.mod").read_text()
    call("export out again.mod --force")
    assert (folder / "again.mod").read_text().count("SetDO") == program.count("SetDO") > 0


def run_urscript(call, folder, out, options=""):
    """Run PART and return its URScript, the set-points [rad] and the set of their periods [s]."""
    call(
        f"run part.ngc --cell ur5e --out {out} --no-changes --export urscript"
        f" --set 'export.outputs={{spindle: 0}}' {options} --force"
    )
    text = (folder / out / "compensated" / "export" / "reference.script").read_text()
    # The last point is held.
    points = re.findall(r"servoj\(\[(.*?)\], 0, 0, ([0-9.]+)", text)[:-1]
    set_points = np.array([x.split(",") for x, _ in points], dtype=float)
    return text, set_points, {float(period) for _, period in points}


@needs_dynamics
def test_an_export_of_an_earlier_result_has_the_arguments_of_servoj_of_its_job(call, folder):
    text, *_ = run_urscript(call, folder, "servoj", "--set export.servoj.gain=500")
    call("export servoj servoj.script --force")
    for program in (text, (folder / "servoj.script").read_text()):
        assert "gain = 500\n" in program and "lookahead = 0.1\n" in program


FIRST_RUN = "--speed-factor '10 %' --process-off --set 'cycle=20 ms'"


@needs_dynamics
def test_a_first_run_has_the_same_points_ten_times_as_slow(call, folder):
    _, at_full_speed, full_periods = run_urscript(call, folder, "full")
    _, slow, slow_periods = run_urscript(call, folder, "first", FIRST_RUN)
    assert full_periods == {CYCLE}
    assert slow_periods == {10 * CYCLE}
    count = min(len(slow), len(at_full_speed))
    assert count >= max(len(slow), len(at_full_speed)) - 1
    np.testing.assert_allclose(slow[: count - 1], at_full_speed[: count - 1], atol=2e-7)


@needs_dynamics
def test_a_first_run_switches_no_output(call, folder):
    full, _, _ = run_urscript(call, folder, "full")
    slow, set_points, _ = run_urscript(call, folder, "first", FIRST_RUN)
    assert "digital_out" in full
    assert "digital_out" not in slow
    # An export of the earlier result has its speed, and does not warn of missing outputs.
    call("export first first.script --force")
    text = (folder / "first.script").read_text()
    assert text.count("servoj") >= len(set_points) and "digital_out" not in text


def test_exporting_an_earlier_result_writes_its_external_axes(call, folder):
    (folder / "cell.yaml").write_text(CELL)
    call("run cell.yaml --force --out cell")
    written = pd.read_csv(folder / "cell" / "moved" / "set_points.csv")
    last = [1e3 * written["q rail [m]"].iloc[-1], np.degrees(written["q turn [rad]"].iloc[-1])]
    number = r"(-?[0-9.]+)"
    for ending, form in (
        ("src", rf"E1 {number}, E2 {number}\}}"),
        ("mod", rf"\[{number}, {number}, 9E9"),
    ):
        call(f"export cell cell.{ending} --force")
        found = re.findall(form, (folder / f"cell.{ending}").read_text())[-1]
        np.testing.assert_allclose([float(x) for x in found], last, rtol=0, atol=1e-5)


def test_command_limits_replace_exported_accelerations(call, folder):
    (folder / "square.yaml").write_text(LIMITED)
    call("run square.yaml --no-changes --force --out square --export csv")
    free, kept = (
        pd.read_csv(folder / "square" / x / "export" / "set_points.csv") for x in ("free", "kept")
    )
    assert sum(x.startswith("ddq") for x in free) == 6
    assert not any(x.startswith(("dq", "ddq")) for x in kept)


def test_set_points_within_the_limits_of_a_controller_have_no_accelerations(call, folder):
    late = LIMITED.replace("kept: {", "late: {compensation: {method: none}, ")
    (folder / "square.yaml").write_text(late.replace("3.14159 rad/s^2", "inf"))
    printed = call("run square.yaml --no-changes --force --out ros --export ros-yaml")
    assert "times the acceleration limit" not in printed
    files = [folder / "ros" / x / "export" / "set_points.yaml" for x in ("free", "late")]
    free, late = (yaml.safe_load(x.read_text())["points"][0]["accelerations"] for x in files)
    # Set-points of the plan have its accelerations.
    assert len(free) == 0 and len(late) == 6
    call("export ros late.yaml --run late --force")
    assert (folder / "late.yaml").read_text().count("accelerations: [0") > 0


@needs_dynamics
def test_exporting_an_earlier_result_gives_the_file_of_its_run(result, call, folder):
    printed = call("export out set_points.csv --derivatives 2")
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


REDUCED = "--points 60 --point-tolerance '0.2 mrad'"


@pytest.fixture
def reduced(call, folder):
    """Folder of the files that a run with reduced points exports; the run is done once."""
    if not (folder / "few").exists():
        call(f"run part.ngc --cell ur5e --out few --export ros-yaml --tolerances 2 {REDUCED}")
    return folder / "few" / "compensated" / "export"


@needs_dynamics
def test_an_exported_goal_has_tolerances_and_reduced_points(reduced):
    goal = yaml.safe_load((reduced / "set_points.yaml").read_text())
    assert 2 < len(goal["trajectory"]["points"]) <= 60
    assert min(x["position"] for x in goal["path_tolerance"]) >= 1e-3
    plan = yaml.safe_load((reduced / "reference.yaml").read_text())
    assert len(plan["points"]) <= 60


@needs_dynamics
def test_an_earlier_result_is_exported_with_the_same_reduced_points(reduced, call, folder):
    goal = yaml.safe_load((reduced / "set_points.yaml").read_text())
    call(f"export few again.yaml {REDUCED} --force")
    again = yaml.safe_load((folder / "again.yaml").read_text())["points"]
    positions = [[x["positions"] for x in y] for y in (goal["trajectory"]["points"], again)]
    np.testing.assert_allclose(*positions, rtol=0, atol=1.1e-9)


@needs_dynamics
def test_too_few_points_for_the_tolerance_are_refused(result, folder, refused):
    words = ["9 points", "requires", "Increase points"]
    rows = [("c.yaml --points 9 --point-tolerance 0.1mrad", words)]
    assert refused(folder, rows, codes=(2,), begin=("export", "out")) == []


@needs_dynamics
def test_invalid_options_of_exports_are_refused(result, folder, refused):
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


@needs_dynamics
def test_changed_or_missing_results_are_not_exported(result, folder, refused, call, tmp_path):
    file = result / "compensated" / "set_points.csv"
    text = file.read_text()
    file.write_text(text + "\n")
    rows = [
        (("export", tmp_path, "a.csv"), ["has no result"]),
        ("export out a.csv", ["set_points.csv has changed since"]),
    ]
    assert refused(folder, rows, codes=(2,)) == []
    file.write_text(text)
    call("export out a.csv")


def test_outputs_that_a_format_cannot_have_are_refused_before_the_plan(folder, refused):
    (folder / "two.yaml").write_text(TWO_FORMATS)
    rows = [("run two.yaml --out two", ["export abb", "names of signals", "laser is 17", "differ"])]
    assert refused(folder, rows, codes=(2,)) == []


@pytest.fixture
def two_formats(call, folder):
    """Folder of a result with outputs for KUKA and ABB; the run is done once."""
    if not (folder / "two").exists():
        (folder / "two.yaml").write_text(TWO_FORMATS)
        outputs = "export.outputs.laser={kuka: 17, abb: doLaser}"
        call("run two.yaml --no-changes --out two --set", outputs)
    return folder / "two"


@pytest.mark.parametrize("run", ["a", "b"])
def test_each_format_has_its_own_outputs(two_formats, run):
    exports = two_formats / run / "export"
    assert "$OUT[17] = TRUE" in (exports / "reference.src").read_text()
    assert "SetDO doLaser, 1;" in (exports / "reference.mod").read_text()


def test_abb_programs_of_two_runs_have_different_names(two_formats):
    """A controller can load the programs of both runs."""
    programs = [(two_formats / x / "export" / "reference.mod").read_text() for x in "ab"]
    names = [re.findall(r"(?:MODULE|PROC) (\w+)", program) for program in programs]
    assert names == [[f"square_{x}_reference", f"run_square_{x}_reference"] for x in "ab"]


def test_an_earlier_result_has_the_outputs_of_each_format(two_formats, call, folder):
    call("export two again.mod --run a --force")
    assert "SetDO doLaser, 1;" in (folder / "again.mod").read_text()


def test_an_export_that_fails_after_the_plan_loses_no_result(folder, command_in):
    (folder / "one.yaml").write_text(TWO_FORMATS)
    command = (
        "run one.yaml --no-changes --out one --export ros-yaml --export csv"
        " --points 3 --point-tolerance '0.001 mrad' --set export.outputs={}"
    )
    ended = command_in(folder, *shlex.split(command))
    assert ended.code == 2
    printed = " ".join(ended.out.split())
    assert "reference.yaml was not written" in printed and "Increase points" in printed
    for run in ("a", "b"):
        written = {x.name for x in (folder / "one" / run / "export").iterdir()}
        assert written == {"set_points.csv", "reference.csv"}
        assert (folder / "one" / run / "set_points.csv").is_file()
    for name in ("report.html", "summary.json"):
        assert (folder / "one" / name).is_file()


def test_analog_outputs_are_columns_of_an_exported_run(call, folder):
    (folder / "laser.yaml").write_text(LASER)
    printed = call("run laser.yaml --no-simulation --export csv --export ros-yaml --out laser")
    assert printed.count("does not support analog outputs (power)") == 1
    assert "export ros-yaml" in printed
    columns = pd.read_csv(folder / "laser" / "compensated" / "export" / "reference.csv")
    power = columns["analog power"]
    assert power.iloc[0] == 0.0 and 990 < power.max() <= 1000 + 1e-6


def test_analog_outputs_of_an_earlier_result_are_not_exported(call, folder):
    (folder / "laser.yaml").write_text(LASER)
    call("run laser.yaml --no-simulation --out plain")
    printed = call("export plain laser.csv")
    assert "The analog outputs power are not exported" in printed
    assert not any(x.startswith("analog") for x in pd.read_csv(folder / "laser.csv").columns)
