"""`armcontour check` as a user meets it: the table, JSON, exit codes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import yaml

import armcontour as ac

JOB = {
    "name": "paper's path",
    "arm": "pmk3s",
    "path": {"points": [[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]]},
    "limits": {"speed": 0.15, "centripetal_acceleration": 0.09},
    "corners": {"tolerance": "5 mm"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {
        "sharp": {"timing": {"method": "conventional"}, "corners": "sharp"},
        "rounded": {"timing": {"method": "mac"}},
    },
}
LIMITS = {"speed": "0.15 m/s", "centripetal_acceleration": "0.0901 m/s^2", "deviation": "0.1 mm"}
Check = Callable[..., Any]


@pytest.fixture
def check(command_in: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Check:
    """`armcontour check` in this process, in a folder: how it ended."""
    monkeypatch.setenv("COLUMNS", "200")
    return lambda folder, *arguments: command_in(folder, "check", *arguments)


def test_the_exit_code_of_a_verdict_is_that_of_the_process(folder: FilePath) -> None:
    (folder / "limits.yaml").write_text("joint_acceleration: [0.7, 0.8]\n")
    options = ["planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml"]
    done = subprocess.run(
        [sys.executable, "-m", "armcontour", "check", *options],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.returncode, done.stderr) == (1, ""), done.stdout
    assert "violated" in done.stdout


@pytest.fixture
def folder(tmp_path: FilePath, mac: ac.Trajectory) -> FilePath:
    """The paper's job planned by its method, as a file of positions with nine decimals."""
    samples = mac.sample(4e-3)
    np.savetxt(
        tmp_path / "planned.csv",
        np.column_stack([samples.t, samples.q]),
        "%.9f",
        ",",
        header="t [s],joint 1 [rad],joint 2 [rad]",
        comments="",
    )
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    (tmp_path / "limits.yaml").write_text(
        # The method's velocity steps at knots need a little more than its 0.72 rad/s².
        yaml.safe_dump({**LIMITS, "joint_acceleration": 0.722})
    )
    return tmp_path


def test_kept_limits_end_with_0(folder: FilePath, check: Check) -> None:
    given = ("planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml", "--path", "job.yaml")
    done = check(folder, *given)
    assert done.code == 0, done.out + done.errors
    for words in ("joint acceleration", "speed", "path deviation", "kept", "Samples of q:"):
        assert words in done.out
    assert "violated" not in done.out
    data = json.loads(check(folder, *given, "--json").out)
    assert data["kept"] is True
    uses = {x["name"]: x for x in data["limits"]}
    assert set(uses) == {
        "joint_acceleration",
        "speed",
        "centripetal_acceleration",
        "path_deviation",
    }
    assert uses["joint_acceleration"]["ratio"] == pytest.approx(0.72 / 0.722, abs=2e-3)
    assert data["path_deviation"]["distance"] < 1e-6
    assert data["rounding"]["q"] == pytest.approx(5e-10)
    assert data["end_speeds"] == [None, None]


def test_a_violation_ends_with_1_and_says_where(folder: FilePath, check: Check) -> None:
    (folder / "limits.yaml").write_text("joint_acceleration: [0.7, 0.8]\n")
    done = check(folder, "planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml")
    assert done.code == 1
    assert "violated" in done.out
    assert done.errors == ""
    done = check(folder, "planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml", "--json")
    assert done.code == 1
    data = json.loads(done.out)
    assert data["kept"] is False
    (use,) = data["limits"]
    assert (use["name"], use["joint"], use["verdict"]) == (
        "joint_acceleration",
        1,
        "violated",
    )
    assert use["ratio"] == pytest.approx(0.72 / 0.7, abs=3e-3)


def test_jerk_is_judged_and_its_units_stand_beside_it(folder: FilePath, check: Check) -> None:
    text = "joint_jerk: 7.2 rad/s^3\ntool_jerk: 1000 m/s^3\npath_jerk: 1 m/s^3\n"
    (folder / "limits.yaml").write_text(text)
    done = check(folder, "planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml")
    assert done.code == 1
    (joint,) = (line for line in done.out.splitlines() if "joint jerk" in line)
    # Planned without limits of jerk: accelerations jump by 1.44 rad/s² within 4 ms.
    assert "rad/s³" in joint and "violated" in joint
    (tool,) = (line for line in done.out.splitlines() if "tool jerk" in line)
    assert "1000 m/s³" in tool and "kept" in tool
    assert "Not judged" in done.out and "samples have no arc length" in done.out


def test_the_path_of_one_run(folder: FilePath, check: Check) -> None:
    given = ("planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml", "--path", "job.yaml")
    sharp = check(folder, *given, "--run", "sharp", "--json")
    assert sharp.code == 1
    assert json.loads(sharp.out)["path_deviation"]["distance"] > 1e-3
    unknown = check(folder, *given, "--run", "other")
    assert unknown.code == 2
    assert "its runs are rounded, sharp" in unknown.errors
    runs = {**JOB["runs"], "wide": {"timing": {"method": "mac"}, "corners": {"tolerance": 0.01}}}
    (folder / "job.yaml").write_text(yaml.safe_dump({**JOB, "runs": runs}))
    torn = check(folder, *given)
    assert torn.code == 2
    assert "choose one with --run (rounded, wide)" in torn.errors


def test_what_cannot_be_used_ends_with_2_and_one_sentence(folder: FilePath, check: Check) -> None:
    (folder / "bad.csv").write_text("t,q1,q2\n0,1,2\n0,1,2\n")
    for arguments, words in (
        (("none.csv", "--arm", "pmk3s"), "There is no trajectory file"),
        (("bad.csv", "--arm", "pmk3s"), "bad.csv, line 3: times must increase"),
        (("planned.csv", "--arm", "pmk4"), "no built-in arm"),
        (("planned.csv", "--arm", "pmk3s", "--limits", "none.yaml"), "There is no limits file"),
        (("planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml"), "with --path"),
        (
            ("planned.csv", "--arm", "ur5e"),
            "planned.csv has positions of 2 joints ('joint 1 [rad]', 'joint 2 [rad]'), but the arm "
            "UR5e has 6 (shoulder_pan_joint",
        ),
        (("planned.csv", "--arm", "pmk3s", "--columns", "t,q1"), "names of 2 are given"),
        (("planned.csv", "--arm", "pmk3s", "--noise", "1 mrad, 1 rad/s"), "--noise takes"),
        (("planned.csv", "--arm", "pmk3s", "--noise", "0.1"), "--noise: '0.1' has no unit"),
    ):
        done = check(folder, *arguments)
        assert done.code == 2, arguments
        assert done.errors.startswith("Error: ")
        assert words in done.errors
        assert len(done.errors.strip().splitlines()) == 1


# All of these were once taken for motions that keep every limit: numbers that overflow, digits too
# few to tell, and a joint that jumps by the last digit while another one rests.
HUGE = "t,q1,q2\n0,0,0\n1,1e308,-1e308\n2,-1e308,1e308\n3,0,0\n"
INSTANT = "t,q1,q2\n0,0,0\n5e-324,0.1,0\n1e-323,0.2,0\n"
COARSE = "t [s],q1 [deg],q2 [deg]\n" + "".join(f"{i},{10 + i % 2 * 50},10\n" for i in range(5))
JUMPS = "t,q1,q2\n0.00,0,0\n0.01,1,0\n0.02,0,0\n0.03,1,0\n0.04,0,0\n"


@pytest.mark.parametrize(("text", "ratio"), [(COARSE, np.deg2rad(100) / 0.72), (JUMPS, 2e4 / 0.72)])
def test_what_the_samples_cannot_tell_ends_with_7(
    tmp_path: FilePath, text: str, ratio: float, check: Check
) -> None:
    (tmp_path / "log.csv").write_text(text)
    done = check(tmp_path, "log.csv", "--arm", "pmk3s")
    assert done.code == 7, done.out + done.errors
    for words in ("cannot tell", "print more digits"):
        assert words in done.out
    # A second row, where the ratio is largest on another joint than the certain one.
    assert ("numbers as printed" in done.out) is (text == JUMPS)
    assert "kept" not in done.out
    done = check(tmp_path, "log.csv", "--arm", "pmk3s", "--json")
    assert done.code == 7
    data = json.loads(done.out)
    assert (data["kept"], data["verdict"]) == (None, "cannot tell")
    (use,) = data["limits"]
    assert use["verdict"] == "cannot tell"
    assert use["highest"]["ratio"] == pytest.approx(ratio)
    assert use["highest"]["joint"] == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HUGE, "line 3: '1e308' in the column 'q1'"),
        (INSTANT, "line 3: times must increase by at least 1 ns"),
        (JUMPS.replace("0.03,1,0", "0.03,1,1e308"), "line 5: '1e308' in the column 'q2'"),
    ],
)
def test_numbers_that_overflow_are_refused(
    tmp_path: FilePath, text: str, words: str, check: Check
) -> None:
    (tmp_path / "log.csv").write_text(text)
    for options in ((), ("--json",)):
        done = check(tmp_path, "log.csv", "--arm", "pmk3s", *options)
        assert (done.code, done.out) == (2, "")
        assert words in done.errors
        assert len(done.errors.strip().splitlines()) == 1


def test_help_tells_the_exit_codes(tmp_path: FilePath, check: Check) -> None:
    told = " ".join(check(tmp_path, "--help").out.split())
    assert "0 all limits kept, 1 a limit violated, 7 the samples cannot tell, 2" in told


def test_what_run_writes_can_be_checked(
    tmp_path: FilePath, check: Check, command_in: Callable[..., Any]
) -> None:
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    assert command_in(tmp_path, "run", "job.yaml", "--out", "out").code == 0
    (tmp_path / "limits.yaml").write_text("speed: 0.151\njoint_acceleration: 0.73\n")
    done = check(
        tmp_path,
        *("out/rounded/planned.csv", "--arm", "pmk3s", "--limits", "limits.yaml"),
        *("--path", "job.yaml"),
    )
    assert done.code == 0, done.out + done.errors
    assert "Largest distance from the path" in done.out


def test_help_imports_nothing_heavy(tmp_path: FilePath) -> None:
    code = (
        "import sys\n"
        "sys.argv = ['armcontour', 'check', '--help']\n"
        "from armcontour.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "sys.exit(len({'numpy', 'scipy', 'numba', 'yaml', 'pint'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60)
    assert done.returncode == 0


def test_an_arm_from_a_description_with_its_limits(tmp_path: FilePath, check: Check) -> None:
    data = FilePath(__file__).parents[1] / "io" / "robots" / "data"
    t = np.linspace(0, 1, 51)
    q = np.outer(3 * t**2 - 2 * t**3, [1.0, 0.2, 0.2, 0.2])
    np.savetxt(
        tmp_path / "log.csv",
        np.column_stack([t, q]),
        "%.9f",
        ",",
        header="t [s],pan [rad],tilt [rad],elbow [rad],roll [rad]",
        comments="",
    )
    arm = (
        "--arm",
        str(data / "robot.urdf"),
        "--tip",
        "tcp",
        "--base",
        "base_link",
        "--joint-limits",
    )
    done = check(tmp_path, "log.csv", *arm, str(data / "joint_limits.yaml"), "--json")
    assert done.code in (0, 1), done.errors
    found = json.loads(done.out)
    velocity = next(x for x in found["limits"] if x["name"] == "joint_velocity")
    # The file's 90 deg/s, not the description's 2 rad/s.
    assert (velocity["joint"], velocity["limit"]) == (1, pytest.approx(np.pi / 2))


def test_a_job_brings_its_limits(folder: FilePath, check: Check) -> None:
    arguments = ("planned.csv", "--path", "job.yaml", "--json")
    found = json.loads(check(folder, *arguments).out)
    uses = {x["name"]: x for x in found["limits"]}
    assert uses["speed"]["limit"] == 0.15
    assert uses["centripetal_acceleration"]["limit"] == 0.09
    fast = {"timing": {"method": "mac"}, "limits": {"speed": 0.2}}
    runs = {**JOB["runs"], "fast": fast}
    (folder / "job.yaml").write_text(yaml.safe_dump({**JOB, "runs": runs}))
    torn = check(folder, *arguments)
    assert torn.code == 2
    assert "have different limits: choose one with --run (rounded, fast)" in torn.errors.replace(
        "(fast, rounded)", "(rounded, fast)"
    )
    named = json.loads(check(folder, *arguments, "--run", "fast").out)
    assert {x["name"]: x for x in named["limits"]}["speed"]["limit"] == 0.2
    table = check(folder, "planned.csv", "--path", "job.yaml", "--run", "fast").out
    assert "t [s]" in table


def test_the_jobs_own_arm_is_the_default(folder: FilePath, check: Check) -> None:
    named = check(folder, "planned.csv", "--arm", "pmk3s", "--path", "job.yaml", "--json")
    default = check(folder, "planned.csv", "--path", "job.yaml", "--json")
    assert json.loads(default.out) == json.loads(named.out)
    without = check(folder, "planned.csv")
    assert without.code == 2
    assert "Name the arm with --arm" in without.errors
    both = check(folder, "planned.csv", "--path", "job.yaml", "--tip", "tcp")
    assert both.code == 2
    assert "--xacro-arg go with --arm" in both.errors


def test_how_the_tool_is_held_is_checked_too(tmp_path: FilePath, check: Check) -> None:
    robot = ac.load_arm("ur5e")
    points = [[0.4, -0.1, 0.3], [0.45, 0.1, 0.3]]
    planned = ac.plan(ac.Path.polyline(points).pointing((0, 0, -1)), robot, robot.limits)
    x = planned.sample(4e-3)
    np.savetxt(
        tmp_path / "planned.csv",
        np.column_stack([x.t, x.q]),
        "%.9f",
        ",",
        header=",".join(["t [s]", *(f"{name} [rad]" for name in robot.joint_names)]),
        comments="",
    )
    job = {
        "name": "held",
        "arm": "ur5e",
        "path": {"points": points, "orientation": {"axis": [0, 0.1, -1]}},
        "servo": {"kp": 25, "kv": 150},
        "runs": {"one": {}},
    }
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(job))
    given = ("planned.csv", "--path", "job.yaml", "--json")
    without = json.loads(check(tmp_path, *given).out)
    assert without["not_judged"] == ["joint_torque", "orientation_deviation"]
    for allowed, code in (("0.5 deg", 1), ("6 deg", 0)):
        (tmp_path / "limits.yaml").write_text(
            f"orientation_deviation: {allowed}\njoint_acceleration: 100\n"
        )
        done = check(tmp_path, *given, "--limits", "limits.yaml")
        assert done.code == code, done.out + done.errors
        (use,) = (x for x in json.loads(done.out)["limits"] if x["name"] == "orientation_deviation")
        assert use["value"] == pytest.approx(np.arctan(0.1), abs=1e-4)
    (tmp_path / "limits.yaml").write_text("orientation_deviation: 1 deg\n")
    lost = check(tmp_path, "planned.csv", "--arm", "ur5e", "--limits", "limits.yaml")
    assert lost.code == 2 and "name its job with --path" in lost.errors


def test_a_measured_motion(folder: FilePath, mac: ac.Trajectory, check: Check) -> None:
    """Noise is motion unless it is declared; columns that are not known are left out."""
    samples = mac.sample(4e-3)
    noise = 2e-5 * np.random.default_rng(0).uniform(-1, 1, samples.q.shape)
    rows = np.column_stack([samples.t, samples.q + noise, 5 * samples.q[:, 0]])
    np.savetxt(folder / "log.csv", rows, "%.9f", ",", header="t,q1,q2,i1 [A]", comments="")
    given = ("log.csv", "--arm", "pmk3s", "--limits", "joint.yaml")
    (folder / "joint.yaml").write_text("joint_acceleration: 0.73\n")
    done = check(folder, *given)
    assert done.code == 1
    told = " ".join(done.out.split())
    assert "Left out of log.csv, since they are not known: 'i1 [A]'." in told
    assert "scatter by 0.012 mrad" in told
    assert "--noise, such as '0.047 mrad'" in told
    declared = check(folder, *given, "--noise", "0.02 mrad")
    assert declared.code in (0, 7), declared.out
    assert "scatter" not in declared.out
    assert "violated" not in declared.out
    # A motion that really exceeds its limit still does.
    (folder / "joint.yaml").write_text("joint_acceleration: 0.3\n")
    assert check(folder, *given, "--noise", "0.02 mrad").code == 1
    # What is computed has no noise to declare.
    rough = check(folder, "planned.csv", "--arm", "pmk3s", "--limits", "joint.yaml")
    assert rough.code == 1
    assert "scatter" not in rough.out


def test_a_file_without_titles(folder: FilePath, check: Check) -> None:
    text = (folder / "planned.csv").read_text().splitlines()[1:]
    (folder / "bare.csv").write_text("\n".join(f"{x},open" for x in text))
    done = check(folder, "bare.csv", "--arm", "pmk3s")
    assert done.code == 2
    bare = check(folder, "bare.csv", "--arm", "pmk3s", "--columns", "t,q1,q2,-", "--json")
    titled = check(folder, "planned.csv", "--arm", "pmk3s", "--json")
    assert json.loads(bare.out) == json.loads(titled.out)


SWEEP = """t,q1,q2,q3,q4,q5,q6
1,-0.3,-1.2,1.5,-1.8,-1.57,0
1.5,0.4,-1.2,1.5,-1.8,-1.57,0
2,0.5,-1.2,1.5,-1.8,-1.57,0
"""


def test_a_cell_is_checked_between_samples_too(folder: FilePath, check: Check) -> None:
    (folder / "sweep.csv").write_text(SWEEP)
    arm = ac.load_arm("ur5e")
    x, y, z = arm.forward([0.1, -1.2, 1.5, -1.8, -1.57, 0.0]).tolist()
    (folder / "cell.scene").write_text(
        f"(noname)+\n* wall\n1\nbox\n0.001 0.3 0.3\n{x} {y} {z}\n0 0 0 1\n0 0 0 0\n.\n"
    )
    options = ["sweep.csv", "--arm", "ur5e", "--scene", "cell.scene"]
    done = check(folder, *options)
    assert done.code == 1
    assert "touch, first at t = 1." in done.out and "wall" in done.out
    assert "Between samples the joints count as moving evenly." in done.out
    page = json.loads(check(folder, *options, "--json").out)["clearance"]
    assert page["kept"] is False
    touched = next(x for x in page["pairs"] if x["first"] == "wall" and x["first_too_near"])
    assert 1.0 < touched["first_too_near"] < 1.5
    (folder / "cell.scene").write_text("(noname)+\n.\n")
    free = check(folder, *options)
    assert "Clear: " in free.out


def test_the_scene_of_a_cell_is_checked_without_a_path_and_runs(
    folder: FilePath, check: Check
) -> None:
    (folder / "sweep.csv").write_text(SWEEP)
    arm = ac.load_arm("ur5e")
    at = arm.forward([0.1, -1.2, 1.5, -1.8, -1.57, 0.0]).tolist()
    wall = f"scene: {{boxes: [{{name: wall, size: [0.001, 0.3, 0.3], at: {at}}}]}}\n"
    (folder / "scene.yaml").write_text(wall)
    (folder / "cell.yaml").write_text(f"arm: ur5e\n{wall}")
    for options in (["--arm", "ur5e", "--scene", "scene.yaml"], ["--scene", "cell.yaml"]):
        done = check(folder, "sweep.csv", *options)
        assert done.code == 1 and "wall" in done.out, done
    built_in = check(folder, "sweep.csv", "--scene", "ur5e", "--json")
    pairs = json.loads(built_in.out)["clearance"]["pairs"]
    assert "table" in {y for x in pairs for y in (x["first"], x["second"])}
    # A scene alone does not name the arm.
    assert check(folder, "sweep.csv", "--scene", "scene.yaml").code == 2


def test_joints_are_called_by_number_and_name(folder: FilePath, check: Check) -> None:
    (folder / "fast.csv").write_text(
        "t,q1,q2,q3,q4,q5,q6\n0,0,0,0,0,0,0\n0.1,0,1,0,0,0,0\n0.2,0,2,0,0,0,0\n"
    )
    assert "2 (shoulder_lift_joint)" in check(folder, "fast.csv", "--arm", "ur5e").out
