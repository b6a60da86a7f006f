"""Verdict, bands and refusals of `play`, on a controller that simulates loops without a clock."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from docs.pages import run_command
from tests.controllers.simulated import Lost, Simulated

import armcontour as ac
from armcontour.cli import play_command
from armcontour.control.compensation import NoCompensation
from armcontour.controllers import play
from armcontour.core.errors import ControllerRefused
from armcontour.files import parse_job
from armcontour.files.limits_and_servo_files import servo_yaml
from armcontour.files.log_file import log_text
from armcontour.jobs.run_learning import learn_logs

JOB = """
name: line
arm: pmk3s
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.350, 0.200]]}
corners: {tolerance: 5 mm}
limits: {speed: 0.15 m/s, centripetal_acceleration: 0.09 m/s²}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {cycle: 1 ms, compensation: {method: inverse}}}
"""
START = np.array([2.0483, -2.0810])


class Machine(Simulated):
    """A machine, whose drives set-points can overload."""

    simulates = False


def simulated(**changes) -> Simulated:
    """Loops as the job describes them, but for some parameters."""
    return Simulated(**{"late": False, **changes})


@pytest.fixture(scope="module")
def job() -> ac.Job:
    return parse_job(JOB)


@pytest.fixture(scope="module")
def plain(job) -> ac.Job:
    return uncompensated(job)


def uncompensated(job: ac.Job) -> ac.Job:
    return replace(job, runs=(replace(job.runs[0], compensation=NoCompensation()),))


def run_at(job, robot, speed=1.0, **options):
    return play(job, robot, execute=True, override=speed, **options)


def without_saturation(job):
    """The job with a reserve, because the loops of the robot integrate by steps."""
    return replace(job, runs=(replace(job.runs[0], timing=ac.Optimal(reserve=0.3)),))


def test_a_robot_that_moves_as_simulated_is_kept(job):
    played = run_at(without_saturation(job), simulated())
    assert not played.plan.evaluation.saturated.any()
    data = played.to_data()
    assert played.kept and data["kept"].value and data["completed"].value
    assert max(data["difference.joints"].value) < 2e-5
    assert data["difference.tool"].value < 1e-5
    assert data["contour_error.max"].value < 3e-6
    # A wrong gain of all joints delays the tool along its path.
    slower = run_at(job, simulated(kp=20.0))
    assert slower.kept and max(slower.to_data()["difference.joints"].value) > 3e-3


def test_reported_differences_are_computed_from_the_log(job):
    """Differences by the record, and the contour error by the path."""
    played = run_at(without_saturation(job), simulated(kp=20.0, friction=3e-3))
    execution = played.plan.execution
    record = played.record
    begin = played.plan.set_points
    t = begin.start_time + record.t
    expected = np.column_stack([np.interp(t, execution.t, x) for x in execution.q.T])
    data = played.to_data()
    arm = played.job.arm
    joints = np.abs(record.measured - expected).max(axis=0)
    np.testing.assert_allclose(data["difference.joints"].value, joints, rtol=1e-9)
    tools = arm.tool_position(record.measured) - arm.tool_position(expected)
    largest = np.linalg.norm(tools, axis=1).max()
    assert data["difference.tool"].value == pytest.approx(largest, rel=1e-9)
    points = [(0.350, 0.100), (0.410, 0.150), (0.350, 0.200)]
    path = ac.round_corners(ac.Path.polyline(points), tolerance=5e-3)
    distance = path.project(arm.tool_position(record.measured)).distance.max()
    assert data["contour_error.max"].value == pytest.approx(distance, rel=0.02)


RAIL = """
name: seam
arm:
  name: ur5e
  rail: {axis: [0, 1, 0], upper: 1 m, velocity: 1 m/s, acceleration: 2 m/s^2}
path:
  points: [[-0.5, 0, 0.3], [-0.5, 0.4, 0.3], [-0.4, 0.4, 0.3]]
  orientation: {axis: [0, 0, -1]}
corners: {tolerance: 5 mm, continuity: curvature}
limits: {speed: 0.15 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {compensation: {method: inverse}, timing: {reserve: 50 %}}}
"""


def test_values_of_a_rail_are_in_m():
    job = parse_job(RAIL)
    units = "m, " + ", ".join(["rad"] * 6)
    played = run_at(job, simulated(acceleration=3.0, cycle=4e-3, noise=1e-5))
    data = played.to_data()
    log = played.log
    assert data["difference.joints"].unit == units and data["distance"].unit == "rad, m"
    assert "command 1 [m],command 2 [rad]" in log_text(log)
    fit = ac.identify([log], ac.ServoFit(kinematics=job.arm))
    rail, turned = (x.to_data() for x in fit.joints[:2])
    assert (rail["unseen_rms"].unit, turned["unseen_rms"].unit) == ("m", "rad")
    assert f"# {units}" in servo_yaml(fit)
    learned = learn_logs(job, played.plan, [log])
    assert learned.runs[0].to_data()["joint_rms"].unit == units
    servo = job.servo.replace(friction=1e-3, acceleration_limit=3.0)
    text = servo.describe(job.arm.chain.prismatic)
    assert "friction 1 mm, 1 mrad" in text and "acceleration limit 3 m/s², 3 rad/s²" in text


def test_a_rail_has_its_own_tolerances():
    job = parse_job(RAIL)
    dry = play(job, simulated(cycle=4e-3))
    assert str(dry).count("0 deg, 0 mm") == 1
    start = dry.motion.q[0]
    away = start + np.array([0.05, 0.1, 0, 0, 0, 0, 0])
    far = run_at(job, simulated(acceleration=3.0, cycle=4e-3, at=away))
    assert far.kept and far.distances == pytest.approx(np.abs(away - start))
    assert far.to_data()["distance"].value == pytest.approx([0.1, 0.05])
    assert "5.73 deg, 50 mm" in str(far)
    # A band of revolute joints is no band of the rail, which has 2 mm and the distance of 50 ms.
    full = np.ones(1)
    default = dry.motion.band_at(full)[0]
    wide = play(job, simulated(cycle=4e-3), band=0.1).motion.band_at(full)[0]
    assert wide[0] == default[0] and set(wide[1:]) == {0.1}
    q = dry.motion.predicted
    assert default[0] == pytest.approx(2e-3 + 0.05 * np.abs(np.diff(q[:, 0])).max() / 4e-3)
    # It rests 3 mm from its simulated end.
    stuck = run_at(job, Offset(late=False, acceleration=3.0, cycle=4e-3), band=0.1)
    assert stuck.kept is False and "joint 1 rests 3 mm from its simulated end" in stuck.reason


class Offset(Simulated):
    """A robot whose rail drifts by 3 mm until the end."""

    def stream(self, *arguments):
        record = super().stream(*arguments)
        measured = record.measured.copy()
        measured[:, 0] += np.linspace(0.0, 3e-3, len(measured))
        return replace(record, measured=measured)


@pytest.mark.parametrize("execute", [False, True])
def test_the_command_line_plays_a_rail(tmp_path, monkeypatch, execute):
    asked = []

    def answer(prompt, **_):
        asked.append(prompt)
        return "UR5e"

    def robot(*_):
        return simulated(acceleration=3.0, cycle=4e-3)

    monkeypatch.setattr(play_command, "controller_of", robot)
    monkeypatch.setattr(play_command, "refuse_without_terminal", lambda _: None)
    monkeypatch.setattr(play_command.typer, "prompt", answer)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.yaml").write_text(RAIL, encoding="utf-8")
    words = ["play", "job.yaml", "--on", "linuxcnc", "--speed-factor", "100 %"]
    code, printed, _ = run_command([*words, *["--execute"] * execute])
    assert code == 0 and "0 deg, 0 mm" in printed
    assert ("joint difference" in printed) == execute
    assert [x for x in asked if "0 deg, 0 mm to the start" in x] == asked


@pytest.mark.parametrize(
    ("robot", "stops"),
    [
        ({"acceleration": 0.3}, True),
        ({"trip": 900}, True),
        ({"kp": 8.0}, True),
        ({"kp": 100.0, "kv": 600.0}, True),
        ({"friction": 0.03}, False),
    ],
)
def test_a_robot_that_differs_from_the_simulation_is_not_kept(job, robot, stops):
    played = run_at(job, simulated(**robot))
    assert played.kept is False
    assert (played.record.stopped is not None) == played.record.deviated == stops
    assert ("contour_error.max" in [x.name for x in played.differences]) != stops
    assert played.to_data()["kept"].note


def test_the_allowed_difference_grows_with_the_speed(job, plain):
    motion = play(job, simulated(), override=0.1).motion
    fastest = np.abs(np.diff(motion.predicted, axis=0)).max(axis=0) / 1e-3
    speeds = np.array([0.0, 0.1, 1.0])
    np.testing.assert_allclose(motion.band_at(speeds), 2e-3 + 0.05 * np.outer(speeds, fastest))
    fixed = play(job, simulated(), band=0.1).motion.band_at(speeds)
    np.testing.assert_array_equal(fixed, np.full((3, 2), 0.1))
    stopped = run_at(plain, simulated(kp=15.0), band=3e-3)
    assert stopped.record.deviated and not stopped.kept


def test_a_slow_motion_is_the_full_one_in_slower_time(job):
    """The joints go through the same positions; nothing has the speed that it has at full speed."""
    segments = """
path:
  start: [0.350, 0.100]
  segments: [{to: [0.410, 0.150], speed: 60 mm/s}, {to: [0.350, 0.200]}]
"""
    lines = JOB.splitlines(keepends=True)
    layered = parse_job("".join(x for x in lines if not x.startswith("path")) + segments)
    for each in (job, layered):
        slow = run_at(each, simulated(), 0.1)
        assert slow.kept and slow.speed_factor == 0.1
        assert play(each, simulated()).speed_factor == 0.1
        record = slow.record
        plan = slow.plan.trajectory
        np.testing.assert_allclose(record.t[-1] - 1, 10 * plan.duration, rtol=1e-2)
        np.testing.assert_allclose(record.measured, plan.with_rests(record.plan_time), atol=2e-6)
        speeds = np.abs(np.diff(record.measured, axis=0)).max(axis=0) / 1e-3
        fastest = np.abs(plan(np.linspace(0, plan.duration, 5001), 1)).max(axis=0)
        np.testing.assert_allclose(speeds, 0.1 * fastest, rtol=0.03)


def test_a_run_keeps_its_own_speed_factor(job):
    half = replace(job, runs=(replace(job.runs[0], speed_factor=0.5),))
    assert play(half, simulated()).speed_factor == 0.5
    assert play(half, simulated(), override=1.0).speed_factor == 1.0


def test_the_motion_to_the_start_is_at_most_a_tenth_of_the_speed(job):
    for speed in (1.0, 0.02):
        robot = simulated(at=START + 0.05)
        run_at(job, robot, speed)
        # This arm has no limits of velocity. Accelerations change by the square of the factor.
        accelerations = np.abs(np.diff(robot.motions[0].q, 2, axis=0)) / 1e-6
        limit = min(speed, 0.1) ** 2 * job.arm.limits.joint_acceleration
        assert (accelerations.max(axis=0) <= limit * (1 + 1e-3)).all()
        # A dry run states the speed of the tool.
        stated = play(job, simulated(at=START + 0.05), override=speed).approach_speed
        steps = np.diff(job.arm.tool_position(robot.motions[0].q), axis=0)
        assert stated == pytest.approx(np.linalg.norm(steps, axis=1).max() / 1e-3, rel=0.01)
    assert play(job, simulated()).approach_speed is None


def test_drives_that_do_not_move_are_refused(job, refuses):
    words = ("have not moved", "joint")
    refuses(lambda: run_at(job, simulated(trip=0)), ControllerRefused, *words)
    away = simulated(trip=0, at=START + 0.05)
    refuses(lambda: run_at(job, away), ControllerRefused, *words)
    assert len(away.motions) == 1


def test_a_joint_that_does_not_follow_to_the_start_is_refused(job, refuses):
    """The drives trip in the middle, or near the end."""
    for trip, word in ((2500, "predicted"), (4000, "Check the drives")):
        robot = simulated(trip=trip, at=START + 0.05)
        refuses(lambda x=robot: run_at(job, x), ControllerRefused, "motion to the start", word)
        assert len(robot.motions) == 1


def test_implausible_positions_are_refused_in_a_dry_run(job, refuses):
    degrees = np.degrees(START)
    refuses(lambda: play(job, simulated(at=degrees)), ControllerRefused, "turn", needed=degrees[1])
    limits = job.runs[0].limits.replace(joint_lower=-3.0, joint_upper=3.0)
    limited = replace(job, runs=(replace(job.runs[0], limits=limits),))
    beyond = simulated(at=START + [1.0, 0.0])
    refuses(lambda: play(limited, beyond), ControllerRefused, "Joint 1", "range", joint=0)
    assert play(limited, simulated(at=START)).distance < 1e-3
    assert play(limited, simulated(at=START + [0.5, 0.0])).distance == pytest.approx(0.5, abs=1e-3)


def test_a_stop_during_the_motion_to_the_start_reports_that_joints_moved(job):
    robot = simulated(at=START + 0.05)
    played = run_at(job, robot, stop_requested=lambda: bool(robot.motions))
    assert played.record is None and 0.0 < played.approach < 0.05
    data = played.to_data()
    assert data["executed"].value and "deg" in data.notes[0]
    before = run_at(job, simulated(at=START + 0.05), stop_requested=lambda: True)
    assert before.record is None and before.approach == 0.0
    assert not before.to_data()["executed"].value and not before.to_data().notes


def largest_acceleration(played):
    """The largest acceleration of the set-points / that of the plan's limit."""
    return max(played.to_data()["set_points.joint_acceleration"].value)


def test_set_points_beyond_the_assumed_limit_need_the_word_of_the_user(job, plain, refuses):
    """Whether the servo was identified plays no role: a controller does not know it."""
    assert 0.9 < largest_acceleration(play(plain, Machine(late=False), override=1.0)) <= 1.0
    assert 2.9 < largest_acceleration(run_at(job, Machine(late=False), 0.5)) <= 3.0 + 1e-6
    jumping = replace(plain.runs[0], timing=ac.Conventional(), accuracy=0.2)
    identified = job.servo.replace(contour_ratio=0.01, programs=2)
    for servo in (job.servo, identified):
        robot = Machine(late=False)
        fast = replace(plain, runs=(jumping,), servo=servo)
        refuses(lambda x=fast, y=robot: run_at(x, y), ControllerRefused, "assumed", allowed=2.16)
        assert not robot.motions
    anything = NoCompensation(command_limits=ac.Limits(joint_acceleration=np.inf))
    allowed = replace(plain, runs=(replace(jumping, compensation=anything),))
    assert play(allowed, Machine(late=False), override=1.0).record is None


def test_outputs_that_are_not_switched_are_named_before_the_robot_moves(tmp_path, monkeypatch):
    asked = []

    def answer(prompt, **_):
        asked.append(prompt)
        return ""

    monkeypatch.setattr(play_command, "controller_of", lambda *_: simulated())
    monkeypatch.setattr(play_command, "refuse_without_terminal", lambda _: None)
    monkeypatch.setattr(play_command.typer, "prompt", answer)
    monkeypatch.chdir(tmp_path)
    names = [f"valve {k}" for k in range(6)]
    events = ", ".join(f"{{name: {x}, value: true, at: 10 mm}}" for x in names)
    process = f"process: {{switch: {{name: laser}}, events: [{events}], analog: [{{name: power}}]}}"
    (tmp_path / "job.yaml").write_text(f"{JOB}{process}\n", encoding="utf-8")
    words = ["play", "job.yaml", "--on", "linuxcnc", "--speed-factor", "100 %"]
    code, printed, _ = run_command(words)
    line = next(x for x in printed.splitlines() if "no outputs are switched" in x)
    assert code == 0 and "laser" in line and line.endswith("and 2 more.")
    code, _, _ = run_command([*words, "--execute"])
    assert code == 10 and "laser" in asked[0] and "No outputs are switched" in asked[0]
    # A job without outputs needs no line.
    (tmp_path / "job.yaml").write_text(JOB, encoding="utf-8")
    assert "outputs" not in run_command(words)[1]


@pytest.mark.parametrize(
    ("robot", "code", "word"),
    [
        (simulated, 0, "kept"),
        (lambda: simulated(acceleration=0.3), 1, "NOT KEPT"),
        (lambda: simulated(friction=0.03), 1, "NOT KEPT"),
        (lambda: simulated(trip=0), 10, ""),
    ],
)
def test_play_asks_for_the_robot_name_and_writes_a_log(tmp_path, monkeypatch, robot, code, word):
    asked = []

    def answer(prompt, **_):
        asked.append(prompt)
        return "PMK-3s"

    monkeypatch.setattr(play_command, "controller_of", lambda *_: robot())
    monkeypatch.setattr(play_command, "refuse_without_terminal", lambda _: None)
    monkeypatch.setattr(play_command.typer, "prompt", answer)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.yaml").write_text(JOB, encoding="utf-8")
    words = ["play", "job.yaml", "--on", "linuxcnc", "--speed-factor", "100 %"]
    ended, printed, _ = run_command([*words, "--execute", "--out", "out"])
    assert ended == code and word in printed
    assert len(asked) == 1 and "0 deg to the start" in asked[0]
    assert (tmp_path / "out" / "log.csv").exists() == (code < 10)
    dry, printed, _ = run_command(words)
    assert dry == 0 and "kept" not in printed


@pytest.mark.parametrize(("cycles", "file"), [(700, "log.csv"), (3, "unfinished.csv")])
def test_a_lost_controller_leaves_a_log_that_is_marked(tmp_path, monkeypatch, cycles, file):
    monkeypatch.setattr(play_command, "controller_of", lambda *_: Lost(cycles))
    monkeypatch.setattr(play_command, "refuse_without_terminal", lambda _: None)
    monkeypatch.setattr(play_command.typer, "prompt", lambda *_, **__: "PMK-3s")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.yaml").write_text(JOB, encoding="utf-8")
    words = ["play", "job.yaml", "--on", "linuxcnc", "--speed-factor", "100 %", "--execute"]
    code, _, errors = run_command([*words, "--out", "out"])
    assert code == 11 and "its process has ended" in errors
    out = tmp_path / "out"
    assert {x.name for x in out.iterdir() if x.suffix == ".csv"} == {file}
    assert "incomplete" in (out / file).read_text()
    assert len(ac.read_log(out / file).t) == max(cycles, 60)
    if file == "log.csv":
        summary = json.loads((out / "summary.json").read_text())
        assert summary["kept"] is False and summary["completed"] is False


def test_a_run_that_is_only_kept_slowly_is_played_at_most_at_that_speed(plain):
    """Without compensation, the tool cuts the corner more at full speed than slowly."""
    run = replace(plain.runs[0], accuracy=5.02e-3)
    coarse = replace(plain, runs=(run,))
    with pytest.raises(ControllerRefused, match="exceeds"):
        play(coarse, simulated(), override=1.0)
    slow = play(coarse, simulated(), execute=True, override=0.1)
    plan = slow.plan.trajectory
    assert slow.kept and plan.speed_factor == 0.1
    assert "at most" in slow.to_data()["speed_factor"].note
    # The wanted speed is a fraction of full speed also then.
    wanted = play(coarse, simulated(), execute=True, override=lambda: 0.1)
    assert wanted.record.t[-1] == pytest.approx(slow.record.t[-1])
