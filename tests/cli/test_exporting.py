"""Exports from the command line: their options, and `export` of an earlier result."""

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.spatial.transform import Rotation
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.files.cell import cell_text, read_cell

PART = """G21 G90 F6000
S1000 M3
G0 X10 Y10
G1 X30 Y10
G1 X30 Y20
M5
M2
"""
REFERENCE = ("--reference", "--cycle", "48 ms", "--decimals", "12")


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
            *("--export", "ros-yaml", "--template", "abb", "--template", "kuka"),
            *("--output", "abb:spindle=doTool", "--output", "kuka:spindle=3"),
            *("--cycle", "48 ms", "--tool-motion", "--decimals", "12"),
        )
        assert (
            printed.count("times the acceleration limit") == 1
            and "no output is named" not in printed
        )
    return folder / "out"


@needs_dynamics
def test_the_plan_is_sampled_at_the_period_and_outputs_are_of_their_format(result):
    exports = result / "compensated" / "export"
    reference = pd.read_csv(exports / "reference.csv")
    np.testing.assert_allclose(np.diff(reference["t [s]"])[:-1], 0.048, atol=1e-12)
    set_points = pd.read_csv(exports / "set_points.csv")
    np.testing.assert_allclose(np.diff(set_points["t [s]"]), 0.004, atol=1e-12)
    abb, kuka = ((exports / f"reference{x}").read_text() for x in (".mod", ".src"))
    assert "SetDO doTool" in abb and "$OUT[3]" in kuka
    # A period of 48 ms is 12 set-points of this controller.
    assert abs(abb.count("MoveAbsJ") - reference["t [s]"].iloc[-1] / 48e-3) <= 3
    # These controllers plan between the points: they get the plan only.
    assert not (exports / "set_points.mod").exists() and not (exports / "set_points.src").exists()


LIMITED = """
name: square
arm: ur5e
path:
  points: [[0.45, -0.05, 0.3], [0.55, -0.05, 0.3], [0.55, 0.05, 0.3]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 250 mm/s, joint_jerk: 400 rad/s^3}
corners: {tolerance: 1 mm, continuity: curvature}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs:
  free: {timing: {reserve: 20 %}}
  kept: {timing: {reserve: 20 %}, command_limits: {joint_acceleration: 3.14159 rad/s^2}}
"""


def test_a_warning_of_accelerations_names_command_limits_with_their_effect(call, folder):
    (folder / "square.yaml").write_text(LIMITED)
    base = ("run", "square.yaml", "--no-changes", "--force", "--out", "square")
    printed = call(*base, "--export", "ros-yaml")
    assert printed.count("times the acceleration limit") == 1 and "reserve:" not in printed
    assert printed.count("as command_limits") == 1
    files = [folder / "square" / x / "export" / "set_points.yaml" for x in ("free", "kept")]
    free, kept = (yaml.safe_load(x.read_text())["points"][0]["accelerations"] for x in files)
    assert len(free) == 6 and len(kept) == 0
    # The stated effect is that of the run with these limits.
    (change,) = (x for x in printed.split("Warning: ") if "command_limits change" in x)
    assert change.split("contour error ")[1].split(" at most")[0] in printed.split("and cause")[1]
    # The derivatives of an earlier result are those of the run.
    call("export", "square", "stored.yaml", "--run", "kept", "--force")
    assert not yaml.safe_load((folder / "stored.yaml").read_text())["points"][0]["accelerations"]
    printed = call(*base, "--export", "ros-yaml", "--derivatives", "2")
    assert printed.count("files have only positions") == 1


@needs_dynamics
def test_tool_motion_is_that_of_the_arm(result, folder):
    columns = pd.read_csv(result / "compensated" / "export" / "reference.csv")
    arm = read_cell("ur5e", folder / "part.ngc").arm
    assert isinstance(arm, ac.SerialArm)
    q, dq = (
        columns[[f"{quantity} {name} [{unit}]" for name in arm.joint_names]].to_numpy()
        for quantity, unit in (("q", "rad"), ("dq", "rad/s"))
    )
    point, rotation = arm.pose(q)
    np.testing.assert_allclose(columns[["x [m]", "y [m]", "z [m]"]], point, atol=1e-11)
    quaternion = columns[["qx", "qy", "qz", "qw"]].to_numpy()
    turned = Rotation.from_quat(quaternion).as_matrix()
    np.testing.assert_allclose(turned, rotation, atol=1e-11)
    assert (np.sum(quaternion[1:] * quaternion[:-1], axis=1) > 0).all()
    step = 1e-6
    speed = np.linalg.norm(
        arm.tool_position(q + step * dq) - arm.tool_position(q - step * dq), axis=1
    )
    np.testing.assert_allclose(columns["speed [m/s]"], speed / (2 * step), atol=1e-8)


@pytest.mark.parametrize("name", ["set_points", "reference"])
@needs_dynamics
def test_an_earlier_result_gives_what_the_run_exported(name, result, call, folder):
    options = REFERENCE if name == "reference" else ("--decimals", "12")
    printed = call("export", "out", f"{name}.csv", *options)
    assert f"Exported {name} of run compensated" in printed
    table = pd.read_csv(folder / f"{name}.csv")
    before = pd.read_csv(result / "compensated" / "export" / f"{name}.csv")
    shared = [x for x in before.columns if x in table.columns]
    assert shared == list(table.columns) and "events" in shared
    assert table["events"].equals(before["events"])
    # Set-points have 12 decimals in the result, the derivatives of their spline follow.
    for key, atol in (("t ", 0.0), ("q ", 0.0), ("dq ", 2e-9), ("ddq ", 2e-6)):
        columns = [x for x in shared if x.startswith(key)]
        assert columns
        np.testing.assert_allclose(table[columns], before[columns], rtol=0, atol=atol)


@needs_dynamics
def test_an_earlier_result_takes_the_arm_of_its_cell(result, call, folder):
    """A drawing is run in a cell, so that there is no job file of the run."""
    (folder / "own.yaml").write_text(cell_text("ur5e"))
    before = pd.read_csv(result / "compensated" / "export" / "reference.csv")
    for cell in ("ur5e", "own.yaml"):
        options = (*REFERENCE, "--tool-motion", "--job", cell)
        call("export", "out", f"{cell}.csv", *options)
        columns = pd.read_csv(folder / f"{cell}.csv")
        for name in ("x [m]", "y [m]", "z [m]", "speed [m/s]"):
            np.testing.assert_allclose(columns[name], before[name], rtol=0, atol=1e-9)
        # A quaternion and its negative are the same orientation.
        turned, expected = (
            Rotation.from_quat(x[["qx", "qy", "qz", "qw"]]) for x in (columns, before)
        )
        assert (turned * expected.inv()).magnitude().max() < 1e-9


@needs_dynamics
def test_a_run_is_divided_into_files_with_tolerances_and_torques(call, folder):
    (folder / "pauses.ngc").write_text(PART.replace("Y10\n", "Y10\nG4 P0.3\n"))
    printed = call(
        *("run", "pauses.ngc", "--cell", "ur5e", "--out", "divided", "--export", "ros-yaml"),
        *("--export", "csv", "--points-per-file", "40", "--tolerances", "2", "--effort"),
        "--comments",
    )
    exports = folder / "divided" / "compensated" / "export"
    assert "set_points_01.yaml to set_points_" in printed and " files, " in printed
    parts = [yaml.safe_load(x.read_text()) for x in sorted(exports.glob("set_points_*.yaml"))]
    points = [x["trajectory"]["points"] for x in parts]
    assert len(parts) > 2 and all(len(x[0]["effort"]) == 6 for x in points)
    for before, after in zip(points[:-1], points[1:], strict=True):
        assert before[-1]["positions"] == after[0]["positions"]
        assert not any(before[-1]["velocities"]) and not any(after[0]["velocities"])
        assert after[0]["time_from_start"] == {"sec": 0, "nanosec": 0}
    tolerances = [[y["position"] for y in x["path_tolerance"]] for x in parts]
    assert tolerances.count(tolerances[0]) == len(parts) and min(tolerances[0]) >= 1e-3
    reference = yaml.safe_load(next(exports.glob("reference_*.yaml")).read_text())
    assert "points" in reference
    for file in exports.glob("*.csv"):
        head = file.read_text().splitlines()
        assert head[0].startswith("# ") and any("torque " in x for x in head[:4])
    assert all(len(x.read_text().splitlines()) <= 46 for x in exports.glob("*.csv"))
    # The same files from the result.
    options = ("--points-per-file", "40")
    call("export", "divided", "again.yaml", *options)
    again = [yaml.safe_load(x.read_text()) for x in sorted(folder.glob("again_*.yaml"))]
    for of_run, message in zip(points, again, strict=True):
        positions = [[x["positions"] for x in y] for y in (of_run, message["points"])]
        np.testing.assert_allclose(*positions, rtol=0, atol=1.1e-9)


@needs_dynamics
def test_refuses_in_one_sentence_and_writes_nothing(result, folder, refused, call, tmp_path):
    rows = [
        ("a.csv --run none", ["'none'", "'compensated'"]),
        ("a.csv --cycle 48ms", ["--cycle requires --reference"]),
        ("a.csv --reference --cycle 1ms", ["multiple", "4 ms", "1 ms"]),
        ("a.csv --tool-motion", ["its job file or cell with --job"]),
        ("a.csv --points-per-file 1", ["--points-per-file", "of at least 2", "motoros2"]),
        ("a.csv --call", ["supports --call"]),
        ("a.npz --decimals 7", ["supports --decimals"]),
        ("a.csv --output spindle=1", ["--output requires"]),
        ("a.script --output spindle=9", ["Error: a.script: The output of spindle", "0 to 7"]),
        ("part.ngc --format csv", ["part.ngc already exists", "--force"]),
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


def test_analog_outputs_are_columns_of_a_run_and_not_of_an_earlier_result(call, folder):
    (folder / "laser.yaml").write_text(LASER)
    options = ("--no-simulation", "--export", "csv", "--export", "ros-yaml", "--out", "laser")
    run_output = call("run", "laser.yaml", *options)
    assert (
        run_output.count("does not support analog outputs (power)") == 1
        and "--export ros-yaml" in run_output
    )
    columns = pd.read_csv(folder / "laser" / "compensated" / "export" / "reference.csv")
    power = columns["analog power"]
    assert power.iloc[0] == 0.0 and 990 < power.max() <= 1000 + 1e-6
    call("run", "laser.yaml", "--no-simulation", "--out", "plain")
    export_output = call("export", "plain", "laser.csv")
    assert "The analog outputs power are not exported" in export_output
    assert not any(x.startswith("analog") for x in pd.read_csv(folder / "laser.csv").columns)


ROBOT_LASER = """name: laser
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
seed: [0.2, -1.7, -2.4, -0.6, 1.6, 2.5]
path:
  file: part.ngc
  frame: {position: [380 mm, -70 mm, 50 mm]}
  orientation: {axis: [0, 0, -1]}
process:
  dwell: 100 ms
  analog: [{name: power, rest: 20 %, full: 1, off: 0}]
limits: {speed: 50 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {compensated: {}}
"""


def test_analog_outputs_of_robots_follow_their_options(call, folder):
    (folder / "robot.yaml").write_text(ROBOT_LASER)
    printed = call(
        *("run", "robot.yaml", "--no-simulation", "--out", "robot", "--export", "urscript"),
        *("--template", "kuka", "--output", "urscript:power=AO1", "--output", "urscript:spindle=0"),
        *("--cycle", "45 ms", "--call", "--export", "ros-yaml", "--derivatives", "0"),
    )
    assert "does not set power" in printed and "controller) requires velocities" in printed
    exports = folder / "robot" / "compensated" / "export"
    for name in ("set_points", "reference"):
        text = (exports / f"{name}.script").read_text()
        # The period is for the other format: a servo needs every set-point.
        assert " 0.004, lookahead" in text and " 0.045, lookahead" not in text
        assert "set_standard_analog_out(1, 1.0000)" in text and "# contour line" in text
        assert text.splitlines()[-1] == text.splitlines()[0][len("def ") : -1]
