"""The command `check`: table, JSON, exit codes."""

import json
from pathlib import Path as FilePath

import numpy as np
import pytest
import yaml
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.render import number

JOB = {
    "name": "paper's path",
    "arm": "pmk3s",
    "path": {"points": [[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]]},
    "limits": {"speed": 0.15, "centripetal_acceleration": 0.09},
    "corners": {"tolerance": "5 mm"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {
        "sharp": {"timing": {"method": "conventional"}, "corners": "sharp"},
        "rounded": {"timing": {"method": "paper"}},
    },
}
LIMITS = {"speed": "0.15 m/s", "centripetal_acceleration": "0.0901 m/s^2", "deviation": "0.1 mm"}
PLANNED = ("planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml")


@pytest.fixture
def check(command_in, monkeypatch):
    """Run `armcontour check` in a folder."""
    monkeypatch.setenv("COLUMNS", "200")
    return lambda folder, *arguments: command_in(folder, "check", *arguments)


def write(file, titles, *columns):
    np.savetxt(file, np.column_stack(columns), "%.9f", ",", header=titles, comments="")


@pytest.fixture
def folder(tmp_path, mac):
    """The paper's job planned by its method, as a file of positions with nine decimals."""
    samples = mac.sample(4e-3)
    titles = "t [s],joint 1 [rad],joint 2 [rad]"
    write(tmp_path / "planned.csv", titles, samples.t, samples.q)
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    (tmp_path / "limits.yaml").write_text(
        # The method's velocity steps at knots need a little more than its 0.72 rad/s².
        yaml.safe_dump({**LIMITS, "joint_acceleration": 0.722})
    )
    return tmp_path


def test_satisfied_limits_have_exit_code_0(folder, check):
    options = (*PLANNED, "--path", "job.yaml")
    outcome = check(folder, *options)
    assert outcome.code == 0, outcome.out + outcome.errors
    for words in ("joint_acceleration", "speed", "path_deviation", "kept", "samples (q)"):
        assert words in outcome.out
    assert "violated" not in outcome.out
    data = json.loads(check(folder, *options, "--json").out)
    assert data["kept"] is True
    uses = {x["name"]: x for x in data["limits"]}
    names = {"joint_acceleration", "speed", "centripetal_acceleration", "path_deviation"}
    assert set(uses) == names
    assert uses["joint_acceleration"]["ratio"] == pytest.approx(0.72 / 0.722, abs=2e-3)
    assert data["path_deviation"]["distance"] < 1e-6
    assert data["rounding"]["q"] == pytest.approx(5e-10)
    assert data["end_speeds"] == [0, 0] and "at rest" not in outcome.out


def test_a_violation_has_exit_code_1_and_states_its_location(folder, check):
    (folder / "limits.yaml").write_text("joint_acceleration: [0.7, 0.8]\n")
    outcome = check(folder, *PLANNED)
    assert outcome.code == 1 and "violated" in outcome.out and outcome.errors == ""
    outcome = check(folder, *PLANNED, "--json")
    assert outcome.code == 1
    data = json.loads(outcome.out)
    assert data["kept"] is False
    (use,) = data["limits"]
    assert (use["name"], use["joint"], use["verdict"]) == ("joint_acceleration", 1, "violated")
    assert use["ratio"] == pytest.approx(0.72 / 0.7, abs=3e-3)
    (folder / "limits.yaml").write_text("joint_jerk: 7.2 rad/s^3\n")
    outcome = check(folder, *PLANNED)
    assert outcome.code == 1
    # Planned without limits of jerk: accelerations jump by 1.44 rad/s² within 4 ms.
    (line,) = (x for x in outcome.out.splitlines() if x.split()[:1] == ["joint_jerk"])
    assert "rad/s³" in line and "violated" in line


def test_check_uses_the_path_and_the_limits_of_one_run(folder, check, refused):
    options = (*PLANNED, "--path", "job.yaml")
    sharp = check(folder, *options, "--run", "sharp", "--json")
    assert sharp.code == 1
    assert json.loads(sharp.out)["path_deviation"]["distance"] > 1e-3
    check_data = json.loads(check(folder, "planned.csv", "--path", "job.yaml", "--json").out)
    uses = {x["name"]: x for x in check_data["limits"]}
    assert uses["speed"]["limit"] == 0.15 and uses["centripetal_acceleration"]["limit"] == 0.09
    # Runs that differ in their corners, and in their limits.
    runs = {**JOB["runs"], "wide": {"timing": {"method": "paper"}, "corners": {"tolerance": 0.01}}}
    (folder / "job.yaml").write_text(yaml.safe_dump({**JOB, "runs": runs}))
    fast = {"timing": {"method": "paper"}, "limits": {"speed": 0.2}}
    runs = {**JOB["runs"], "fast": fast}
    (folder / "fast.yaml").write_text(yaml.safe_dump({**JOB, "runs": runs}))
    rows = [
        ((*options, "--run", "other"), ["Its runs are rounded, sharp, wide"]),
        (options, ["Choose a run with --run (rounded, wide)"]),
        (("planned.csv", "--path", "fast.yaml"), ["different limits. Choose a run with --run"]),
    ]
    assert refused(folder, rows, codes=(2,), begin=("check",)) == []
    named = json.loads(
        check(folder, "planned.csv", "--path", "fast.yaml", "--json", "--run", "fast").out
    )
    assert {x["name"]: x for x in named["limits"]}["speed"]["limit"] == 0.2


# Motions that must not count as valid: one with too few digits to decide, and one whose joint jumps
# by the last digit while another joint rests.
COARSE = "t [s],q1 [deg],q2 [deg]\n" + "".join(f"{i},{10 + i % 2 * 50},10\n" for i in range(5))
JUMPS = "t,q1,q2\n0.00,0,0\n0.01,1,0\n0.02,0,0\n0.03,1,0\n0.04,0,0\n"


def test_repeated_runs_are_compared(folder, check, refused):
    """Three logs of one motion, and one whose second joint is off."""
    lines = (folder / "planned.csv").read_text().splitlines()
    titles = lines[0]
    table = np.loadtxt(lines[1:], delimiter=",", ndmin=2)
    names = []
    for k, offset in enumerate((1.0e-3, 1.02e-3, 0.98e-3, 3e-3)):
        log = table[:, :3].copy()
        log[:, 2] += offset
        names.append(f"run{k + 1}.csv")
        write(folder / names[-1], ",".join(titles.split(",")[:3]), log[:, 0], log[:, 1:])
    repeats = [x for name in names[1:] for x in ("--repeat", name)]
    options = (names[0], "--path", "job.yaml", *repeats)
    page = json.loads(check(folder, *options, "--json").out)
    assert page["repeated"]["different_runs"] == [4]
    assert page["repeated"]["largest_of_runs"] > 2 * page["path_deviation"]["distance"]
    assert "Run 4 differs from runs 1 to 3" in check(folder, *options).out
    slow = np.loadtxt((folder / "run2.csv").read_text().splitlines()[1:], delimiter=",")
    write(folder / "slow.csv", ",".join(titles.split(",")[:3]), 1.2 * slow[:, 0], slow[:, 1:])
    rows = [
        (("run1.csv", "--path", "job.yaml", "--repeat", "slow.csv"), ["one speed"]),
        (("run1.csv", "--arm", "pmk3s", "--repeat", "run2.csv"), ["--path"]),
    ]
    assert refused(folder, rows, codes=(2,), begin=("check",)) == []


def test_wrong_files_and_options_are_refused(folder, refused):
    (folder / "bare.csv").write_text("0,1,2,open\n1,2,3,open\n")
    arm = "--arm pmk3s"
    rows = [
        (f"none.csv {arm}", ["no trajectory file"]),
        (f"bare.csv {arm}", []),
        ("planned.csv --arm ur5e", ["2 joints ('joint 1 [rad]'", "the arm has 6", "Add the other"]),
        (f"planned.csv {arm} --limits limits.yaml", ["with --path"]),
        (f"planned.csv {arm} --columns t,q1", ["--columns has 2 names"]),
        (
            ("planned.csv", *arm.split(), "--noise", "1 mrad, 1 rad/s"),
            ["--noise has 2 values", "no velocities"],
        ),
    ]
    assert refused(folder, rows, codes=(2,), begin=("check",)) == []


def test_samples_without_a_verdict_have_exit_code_7(tmp_path, check):
    for text, ratio in ((COARSE, np.deg2rad(100) / 0.72), (JUMPS, 2e4 / 0.72)):
        (tmp_path / "log.csv").write_text(text)
        outcome = check(tmp_path, "log.csv", "--arm", "pmk3s")
        assert outcome.code == 7, outcome.out + outcome.errors
        assert "cannot tell" in outcome.out and "kept" not in outcome.out
        assert number(ratio, "1") in outcome.out
        outcome = check(tmp_path, "log.csv", "--arm", "pmk3s", "--json")
        assert outcome.code == 7
        data = json.loads(outcome.out)
        assert (data["kept"], data["verdict"]) == (None, "cannot tell")
        (use,) = data["limits"]
        assert use["verdict"] == "cannot tell" and use["highest"]["joint"] == 1
        assert use["highest"]["ratio"] == pytest.approx(ratio)


def test_a_specified_limit_that_was_not_checked_has_exit_code_7(tmp_path, check):
    t = np.arange(11) / 10
    titles = "t [s]," + ",".join(f"q{j} [rad]" for j in range(1, 7))
    write(tmp_path / "log.csv", titles, t, np.outer(t, np.full(6, 0.01)))
    (tmp_path / "limits.yaml").write_text("joint_torque: [150, 150, 150, 28, 28, 28]\n")
    assert check(tmp_path, "log.csv", "--arm", "ur5e").code == 0
    outcome = check(tmp_path, "log.csv", "--arm", "ur5e", "--limits", "limits.yaml")
    assert outcome.code == 7
    assert "cannot tell" in outcome.out and "not judged: joint_torque" in outcome.out


def test_an_arm_from_a_description_is_checked_with_its_limits(tmp_path, check):
    data = FilePath(__file__).parents[1] / "files" / "robots" / "data"
    t = np.linspace(0, 1, 51)
    q = np.outer(3 * t**2 - 2 * t**3, [1.0, 0.2, 0.2, 0.2])
    write(tmp_path / "log.csv", "t [s],pan [rad],tilt [rad],elbow [rad],roll [rad]", t, q)
    keys = f"file: {data}/robot.urdf, tip: tcp, base: base_link"
    keys += f", joint_limits: {data}/joint_limits.yaml"
    (tmp_path / "cell.yaml").write_text(f"arm: {{{keys}}}\n")
    outcome = check(tmp_path, "log.csv", "--arm", "cell.yaml", "--json")
    assert outcome.code in (0, 1), outcome.errors
    report = json.loads(outcome.out)
    velocity = next(x for x in report["limits"] if x["name"] == "joint_velocity")
    # The file's 90 deg/s, not the description's 2 rad/s.
    assert (velocity["joint"], velocity["limit"]) == (1, pytest.approx(np.pi / 2))


def test_undeclared_noise_of_a_log_counts_as_motion(folder, mac, check):
    """Noise is motion unless it is declared; unknown columns are skipped."""
    samples = mac.sample(4e-3)
    noise = 2e-5 * np.random.default_rng(0).uniform(-1, 1, samples.q.shape)
    columns = (samples.t, samples.q + noise, 5 * samples.q[:, 0])
    write(folder / "log.csv", "t,q1,q2,i1 [A]", *columns)
    options = ("log.csv", "--arm", "pmk3s", "--limits", "joint.yaml")
    (folder / "joint.yaml").write_text("joint_acceleration: 0.73\n")
    outcome = check(folder, *options)
    assert outcome.code == 1
    output = " ".join(outcome.out.split())
    for words in ("columns of log.csv", "'i1 [A]'", "scatter by 0.012 mrad", "'0.047 mrad'"):
        assert words in output
    declared = check(folder, *options, "--noise", "0.02 mrad")
    assert declared.code in (0, 7), declared.out
    assert "scatter" not in declared.out and "violated" not in declared.out
    # A motion that really exceeds its limit still does.
    (folder / "joint.yaml").write_text("joint_acceleration: 0.3\n")
    assert check(folder, *options, "--noise", "0.02 mrad").code == 1
    # What is computed has no noise to declare.
    rough = check(folder, "planned.csv", *options[1:])
    assert rough.code == 1 and "scatter" not in rough.out


SWEEP = """t,q1,q2,q3,q4,q5,q6
1,-0.3,-1.2,1.5,-1.8,-1.57,0
1.5,0.4,-1.2,1.5,-1.8,-1.57,0
2,0.5,-1.2,1.5,-1.8,-1.57,0
"""


@needs_dynamics
def test_a_scene_is_also_checked_between_samples(tmp_path, check):
    (tmp_path / "sweep.csv").write_text(SWEEP)
    position = ac.load_arm("ur5e").tool_position([0.1, -1.2, 1.5, -1.8, -1.57, 0.0]).tolist()
    wall = f"{{type: box, name: wall, size: [0.001, 0.3, 0.3], at: {position}}}"
    boxes = f"scene: {{obstacles: [{wall}]}}\n"
    (tmp_path / "scene.yaml").write_text(boxes)
    (tmp_path / "cell.yaml").write_text(f"arm: ur5e\n{boxes}")
    arm = ("--arm", "ur5e", "--scene")
    for options in ((*arm, "scene.yaml"), ("--scene", "cell.yaml")):
        outcome = check(tmp_path, "sweep.csv", *options)
        assert outcome.code == 1, (options, outcome)
        assert "touch, first at t = 1." in outcome.out and "wall" in outcome.out
        assert "1 (shoulder_pan_joint)" in outcome.out
        page = json.loads(check(tmp_path, "sweep.csv", *options, "--json").out)["clearance"]
        assert page["kept"] is False
        touched = next(x for x in page["pairs"] if x["first"] == "wall" and x["first_too_near"])
        assert 1.0 < touched["first_too_near"] < 1.5
    (tmp_path / "free.yaml").write_text("scene: {floor: -5 m}\n")
    assert "Clear: " in check(tmp_path, "sweep.csv", *arm, "free.yaml").out
    built_in = check(tmp_path, "sweep.csv", "--scene", "ur5e", "--json")
    pairs = json.loads(built_in.out)["clearance"]["pairs"]
    assert "floor" in {y for x in pairs for y in (x["first"], x["second"])}
    # A scene alone does not name the arm.
    assert check(tmp_path, "sweep.csv", "--scene", "scene.yaml").code == 2


def test_commands_between_the_points_are_checked(folder, mac, check, refused):
    given = (*PLANNED, "--path", "job.yaml")
    with_jtc = (*given, "--controller", "jtc", "--rate", "1000 Hz")
    done = check(folder, *with_jtc)
    # The file has positions only, and lines between points 4 ms apart need four times as much.
    assert done.code == 1 and "lines" in done.out
    lines = json.loads(check(folder, *with_jtc, "--json").out)["commands"]
    (use,) = (x for x in lines["limits"] if x["name"] == "joint_acceleration")
    assert use["ratio"] == pytest.approx(4, rel=0.1) and lines["verdict"] == "violated"
    assert lines["path_deviation"] <= 1e-4
    # At the rate of the points they are the commands.
    assert check(folder, *given, "--controller", "jtc", "--rate", "250 Hz").code == 0
    with_spline = (*given, "--controller", "linuxcnc", "--rate", "1 kHz")
    found = json.loads(check(folder, *with_spline, "--json").out)["commands"]
    assert found["law"] == "uniform B-spline"
    rows = [
        ([*given, "--controller", "jtc"], ["--rate"]),
        ([*given, "--controller", "ros", "--rate", "1 kHz"], ["linuxcnc"]),
        ([*given, "--controller", "jtc", "--rate", "1 MHz"], ["commands"]),
        ([*given, "--controller", "jtc", "--rate", "0.1 Hz"], ["cycle"]),
    ]
    assert not refused(folder, rows, begin=["check"])
