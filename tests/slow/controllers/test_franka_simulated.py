"""Franka's adapter against franky-sim, a simulator of the FCI's protocol at 1 kHz.

The simulator has a servo of first order with a gain of 10 1/s, friction, and no reflexes. Limits
are those of libfranka's limiter. A motion in which this machine was late is repeated.
"""

import os
import subprocess
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from tests.oracle.test_franka_limiter import commands_changed, fast_line, recipes, square

import armcontour as ac
from armcontour.control.compensation import NoCompensation
from armcontour.controllers import Franka, Motion, RollingRows, play
from armcontour.controllers.controller import START_TOLERANCE
from armcontour.controllers.player import approach_of, uncompensated_motion
from armcontour.files import parse_job
from armcontour.motion import SetPoints

pytestmark = pytest.mark.skipif(
    find_spec("franky_sim") is None or find_spec("pylibfranka") is None,
    reason="needs franky-sim and pylibfranka, which have wheels for Linux on x86-64 with Python "
    "3.11 and 3.12",
)
HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785])
GAIN = 10.0
TRIES = 5
JOB = """
name: square
arm: fr3
path:
  points: [[0.40, -0.05, 0.3], [0.50, -0.05, 0.3], [0.50, 0.05, 0.3], [0.40, 0.05, 0.3],
    [0.40, -0.05, 0.3]]
  orientation: {axis: [0, 0, -1]}
corners: {tolerance: 0.5 mm, continuity: curvature}
cycle: 1 ms
accuracy: 5 mm
limits:
  speed: 0.25
  joint_velocity: [1.98, 0.98, 1.48, 1.23, 2.98, 1.48, 2.98]
  joint_acceleration: [9.99, 9.99, 9.99, 9.99, 9.99, 9.99, 9.99]
  joint_jerk: [4750, 4750, 4750, 4750, 4750, 4750, 4750]
servo: {kp: 10, order: first}
runs:
  smooth: {compensation: {method: none}}
"""


@pytest.fixture
def address():
    pid = os.getpid()
    address = f"127.{pid >> 16 & 255}.{pid >> 8 & 255}.{pid & 255}"
    program = Path(sys.executable).with_name("franky-sim")
    process = subprocess.Popen(
        [sys.executable, "-u", program, "--simulator", "mujoco", "--hostname", address],
        stdout=subprocess.PIPE,
        text=True,
    )
    # Before other processes, where the system allows it; libfranka sets its own priority.
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process.pid, -15)
    next(x for x in process.stdout if "Connect to the server" in x)
    yield address
    process.terminate()
    process.wait()
    process.stdout.close()


@pytest.fixture
def robot(address):
    with Franka(address) as robot:
        robot.connect(ac.load_arm("fr3"), HOME)
        yield robot


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("fr3")


@pytest.fixture(scope="module")
def limits(arm):
    return arm.limits.replace(**recipes()["fr3"])


@pytest.fixture(scope="module")
def job():
    return parse_job(JOB)


def rows_of(trajectory, arm):
    q = trajectory.sample(1e-3).q
    set_points = SetPoints(cycle=1e-3, q=q, trajectory=trajectory, method="none")
    servo = ac.ServoModel(kp=GAIN, order="first")
    return RollingRows(set_points, servo, NoCompensation(), arm, 1e-3)


def played(robot, motion, job, limits, stop_requested=lambda: False):
    """The record of a motion that is played from its start, until one is faithful."""
    for _ in range(TRIES):
        if np.abs(robot.position() - motion.q[0]).max() > START_TOLERANCE:
            approach = approach_of(job, limits, robot.position(), motion.q[0], 0.1)
            record = robot.stream(uncompensated_motion(approach, job.arm, 1e-3))
            if record.stopped is not None:
                continue
        record = robot.stream(motion, stop_requested)
        if record.faithful and (record.stopped is None or stop_requested()):
            return record
    pytest.skip(f"This machine is too busy: {' '.join(record.notes)}")


MOTIONS = {
    "square": square,
    "fast line": fast_line,
}


@pytest.mark.parametrize("name", MOTIONS)
def test_motions_are_played_as_sent_and_the_limiter_changes_nothing(name, robot, arm, limits, job):
    rows = rows_of(MOTIONS[name](arm, limits), arm)
    checked = robot.check(arm, limits, rows.q)
    assert all(x.value <= 1 for x in checked)
    record = played(robot, Motion(q=rows.q, rows=rows), job, limits)
    n = len(rows.q) - 5
    assert record.stopped is None
    np.testing.assert_allclose(record.command[:n], rows.q[:n], rtol=0, atol=1e-9)
    assert commands_changed("fr3", record.command) == 0
    print(name, len(record.t), {x.name: round(x.value, 3) for x in checked})


def test_a_stop_ends_on_the_path_and_the_limiter_changes_nothing(robot, arm, limits, job):
    trajectory = square(arm, limits)
    rows = rows_of(trajectory, arm)
    tool = arm.forward(trajectory(np.linspace(0, trajectory.duration, 20_000)))
    path = ac.Path.polyline(tool[:, :3, 3])
    for share in (0.2, 0.5):
        far = share * np.abs(rows.q - rows.q[0]).max()

        def is_far(far=far):
            return np.abs(robot.position() - rows.q[0]).max() > far

        motion = Motion(q=rows.q, rows=rows)
        record = played(robot, motion, job, limits, is_far)
        assert record.stopped is not None and record.stopped < trajectory.duration * 1e3
        assert commands_changed("fr3", record.command) == 0
        assert np.abs(np.diff(record.command[-100:], axis=0)).max() < 1e-12
        away = path.project(arm.forward(record.command)[:, :3, 3]).distance.max()
        assert away < 1e-6
        print(share, record.stopped, away)


def test_play_moves_to_the_start_plays_and_gives_a_log(address, job):
    for _ in range(TRIES):
        result = play(job, Franka(address), execute=True, override=0.5)
        if result.record.faithful:
            break
    assert result.log.command.shape == result.record.command.shape
    assert result.distance > 1e-3 and result.record.stopped is None
    dry = play(job, Franka(address), override=0.5)
    assert dry.record is None and {x.name for x in dry.checks} > {"fci.jerk"}
