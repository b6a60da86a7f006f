"""UR's adapter with a double of the controller on a loopback address."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.cli.commands import ControllerOptions
from armcontour.cli.play_command import controller_of
from armcontour.control.compensation import NoCompensation
from armcontour.controllers import Motion, RollingRows, Ur, play
from armcontour.controllers.player import approach_of
from armcontour.core.errors import ControllerLost, ControllerRefused
from armcontour.files import parse_job
from armcontour.files.exports.formats import format_named
from armcontour.motion import SetPoints

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs loopback addresses")
DOUBLE = Path(__file__).with_name("ur_double.py")
START = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
JOB = """
name: line
arm: ur5e
path: {points: [[0.40, 0, 0.1], [0.45, 0, 0.1]], orientation: {rpy: [180 deg, 0, 0]}}
limits: {speed: 0.1}
servo: {kp: 25, kv: 150}
cycle: 0.002
runs: {compensated: {timing: {method: optimal}, compensation: {method: inverse}}}
"""


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("ur5e")


@pytest.fixture
def double():
    """Start a double with some words; returns its address, and the words that it has printed."""
    pid = os.getpid()
    address = f"127.{pid >> 16 & 255}.{pid >> 8 & 255}.{pid & 255}"
    started = []

    def start(*words):
        process = subprocess.Popen(
            [sys.executable, DOUBLE, address, *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        assert process.stdout.readline() == "listening\n"
        return address, process

    yield start
    for process in started:
        process.stdin.close()
        process.stdout.close()
        process.wait()


def motion(arm, begin, end, stops=True):
    """A motion of the joints along a line."""
    line = ac.JointPath.spline(np.stack([begin, end]), [0.0, 1.0])
    trajectory = ac.plan(line, arm, arm.limits, ac.Optimal(reserve=0.05))
    q = trajectory.sample(2e-3).q
    set_points = SetPoints(cycle=2e-3, q=q, trajectory=trajectory, method="none")
    servo = ac.ServoModel(kp=1.0, order="first")
    rows = RollingRows(set_points, servo, NoCompensation(), arm, 2e-3)
    return Motion(q=rows.q, rows=rows if stops else None)


def test_every_set_point_is_sent_in_its_cycle_and_recorded(arm, double):
    address, _ = double()
    # The double does not wait for the time of a cycle, so no stop would be ready.
    there = motion(arm, START, START + 0.1, stops=False)
    back = motion(arm, START + 0.1, START, stops=False)
    with Ur(address) as robot:
        robot.connect(arm, START)
        assert np.array_equal(robot.position(), START)
        for part in (there, back):
            record = robot.stream(part)
            assert record.faithful and not record.notes and record.stopped is None
            # The last row is held until the feeder has seen it.
            n = len(part.q)
            assert n <= len(record.command) <= n + 5
            assert np.array_equal(record.command[:n], part.q)
            assert np.allclose(np.diff(record.t), 2e-3, atol=1e-12)
            assert np.array_equal(robot.position(), part.q[-1])
            # The double's joints, from the row before.
            moved = record.measured[:-1] + 0.1 * (record.command[1:] - record.measured[:-1])
            assert np.abs(moved - record.measured[1:]).max() < 1e-12


def test_program_and_feeder_have_the_arguments_of_servoj_of_the_job(arm, double, tmp_path):
    address, _ = double("gain=500", "lookahead=0.05")
    job = parse_job(JOB + "export: {servoj: {gain: 500, lookahead: 50 ms}}")
    part = motion(arm, START, START + 0.01, stops=False)
    with controller_of(job, ControllerOptions(on="ur", address=address)) as robot:
        robot.connect(arm, START)
        assert robot.stream(part).faithful
    line = ac.JointPath.spline(part.q[[0, -1]], [0.0, 1.0])
    planned = ac.plan(line, arm, arm.limits)
    ac.export(planned, tmp_path / "part.script", format_named("urscript", job.export))
    program = (tmp_path / "part.script").read_text()
    assert "lookahead = 0.05\n" in program and "gain = 500\n" in program


@pytest.mark.parametrize("wrong", ["{gain: 99}", "{gain: 2001}", "{lookahead: 20 ms}"])
def test_arguments_of_servoj_outside_the_range_of_ur_are_refused(wrong):
    with pytest.raises(ac.InvalidInput, match=r"export\.servoj.* must be from"):
        parse_job(JOB + f"export: {{servoj: {wrong}}}")


def test_a_dry_run_compares_positions_and_sends_no_program(double):
    address, process = double()
    job = parse_job(JOB)
    played = play(job, Ur(address), override=1.0)
    assert played.record is None and played.distance > 0.1
    shares = {x.name: max(np.atleast_1d(x.value)) for x in played.checks}
    assert shares["set_points.joint_acceleration"] <= 3.0 + 1e-6
    process.stdin.close()
    assert process.stdout.read() == ""


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("target_speed_fraction=0.5", "the speed slider is at 50 %"),
        ("safety_mode=3", "the robot's safety mode is protective stop"),
        ("robot_mode=5", "the robot is not running"),
        ("used=input_int_register_24", "input_int_register_24 is used by another client"),
    ],
)
def test_robots_that_are_not_ready_are_refused(arm, double, word, reason):
    address, _ = double(word)
    with Ur(address) as robot, pytest.raises(ControllerRefused, match=reason):
        robot.connect(arm, START)


def test_a_protective_stop_ends_the_motion_with_its_record(arm, double):
    address, _ = double("stopped_at=100")
    part = motion(arm, START, START + 0.1, stops=False)
    with Ur(address) as robot:
        robot.connect(arm, START)
        with pytest.raises(ControllerLost, match="protective stop") as lost:
            robot.stream(part)
    record = lost.value.record
    assert 50 < len(record.t) <= 101
    assert np.array_equal(record.command, part.q[: len(record.t)])


def test_motions_that_the_robot_does_not_support_are_refused(arm):
    robot = Ur("127.0.0.1")
    q = np.repeat(START[None], 5, axis=0)
    fast = q.copy()
    far = q.copy()
    fast[3, 2] += 0.01
    far[3, 1] = 7.0
    with pytest.raises(ControllerRefused, match="Joint 3 moves with 286 deg/s .* limit 180 deg/s"):
        robot.check(arm, arm.limits, fast)
    with pytest.raises(ControllerRefused, match="Joint 2 is at 401 deg .* limit 360 deg"):
        robot.check(arm, arm.limits, far)


@needs_dynamics
def test_motion_to_start_is_refused_if_arm_would_touch_itself(arm):
    """The arm has no scene, but its forearm touches its upper arm on the way."""
    job = parse_job(JOB)
    q = START.copy()
    approach = approach_of(job, arm.limits, q + 0.1, q, 0.1)
    assert approach(approach.duration) == pytest.approx(q)
    q[2] = 2.9
    with pytest.raises(ControllerRefused, match="upper_arm_link touch"):
        approach_of(job, arm.limits, q, START, 0.1)


def test_a_program_without_its_next_row_stops_and_does_not_resume(arm, double):
    address, _ = double("missing_at=100")
    part = motion(arm, START, START + 0.1, stops=False)
    with Ur(address) as robot:
        robot.connect(arm, START)
        record = robot.stream(part)
    end = record.stopped
    assert 100 < end <= 105 and end < len(part.q) - 500
    assert np.array_equal(record.command[:end], part.q[:end])
    assert (record.command[end:] == part.q[end - 1]).all()
    assert not record.faithful
    assert any("no set-point for cycle" in x for x in record.notes)


def test_a_moved_speed_slider_stops_the_motion_on_its_path(arm, double):
    """From cycle 20 on, a row takes two cycles; the joints move on a straight line."""
    address, _ = double("slowed_at=20")
    part = motion(arm, START, START + np.linspace(0.3, 0.8, 6))
    with Ur(address) as robot:
        robot.connect(arm, START)
        record = robot.stream(part)
        assert record.stopped is not None and 20 < record.stopped < len(part.q)
        assert np.array_equal(robot.position(), record.command[-1])
        assert any("50 %" in x for x in record.notes)
        assert np.abs(record.command[-1] - START).max() < np.abs(part.q[-1] - START).max() - 0.01
        share = (record.command - START) / np.linspace(0.3, 0.8, 6)
        assert np.ptp(share, axis=1).max() < 1e-9
        assert (record.command[-2:] == record.command[-1]).all()
        with pytest.raises(ControllerLost, match="the speed slider is at 50 %"):
            robot.stream(Motion(q=np.repeat(record.command[-1:], 10, axis=0)))
