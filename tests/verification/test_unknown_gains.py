"""The error of the worst robot with other gains, against robots that are simulated."""

import itertools

import numpy as np
import pytest

import armcontour as ac

SHARE = 0.01
JOB = """
name: corner
arm: pmk3s
path: {points: [[0.35, 0.1], [0.4, 0.1], [0.4, 0.14]]}
limits: {speed: 100 mm/s}
servo: %s
runs: {only: {}}
"""


def run_of(tmp_path, servo):
    file = tmp_path / "job.yaml"
    file.write_text(JOB % servo)
    job = ac.read_job(file)
    return job, ac.run(job).runs["only"]


def worst_of_corners(job, run):
    """Largest contour error of all robots whose gains are larger or smaller by the share."""
    servo = job.plant_servo
    largest = 0.0
    for signs in itertools.product((-1, 1), repeat=2 * job.arm.dof):
        up = 1 + SHARE * np.reshape(signs, (2, -1))
        robot = ac.ServoPlant(job.arm, servo.replace(kp=servo.kp * up[0], kv=servo.kv * up[1]))
        executed = ac.simulate(run.set_points, robot)
        error = ac.evaluate(executed, run.path, end_time=run.run.end_time).contour_error
        largest = max(largest, error.max)
    return largest


@pytest.mark.parametrize(
    "servo",
    [
        # Without a reserve, its joints saturate.
        "{kp: 25 1/s, kv: 150 1/s}",
        "{kp: 25 1/s, kv: 150 1/s, acceleration_limit: 2 rad/s^2}",
        "{kp: [25 1/s, 22 1/s], kv: [150 1/s, 170 1/s], velocity_feedforward: 0.8}",
        "{kp: 25 1/s, kv: 150 1/s, dead_time: 6 ms}",
    ],
)
def test_the_estimate_is_near_the_worst_simulated_robot(tmp_path, servo):
    job, run = run_of(tmp_path, servo)
    assert run.unknown_gains.shares == {"kp": SHARE, "kv": SHARE}
    assert run.unknown_gains.max > run.evaluation.contour_error.max
    assert run.unknown_gains.max == pytest.approx(worst_of_corners(job, run), rel=0.05)


def test_drawn_robots_on_an_arm_in_space_stay_near_the_estimate(tmp_path):
    file = tmp_path / "job.yaml"
    points = "[[0.4, -0.05, 0.2], [0.44, -0.05, 0.2], [0.44, -0.02, 0.2]]"
    file.write_text(
        f"name: corner\narm: ur5e\npath: {{points: {points}, orientation: {{axis: [0, 0, -1]}}}}\n"
        "limits: {speed: 100 mm/s}\nservo: {kp: 25 1/s, kv: 150 1/s}\nruns: {only: {}}\n"
    )
    job = ac.read_job(file)
    run = ac.run(job).runs["only"]
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(30):
        up = 1 + SHARE * rng.choice([-1, 1], (2, 6))
        robot = ac.ServoPlant(job.arm, ac.ServoModel(kp=25 * up[0], kv=150 * up[1]))
        executed = ac.simulate(run.set_points, robot)
        errors.append(ac.evaluate(executed, run.path).contour_error.max)
    assert 0.6 * run.unknown_gains.max < max(errors) <= 1.03 * run.unknown_gains.max


def test_joints_without_gains_have_no_such_error(tmp_path):
    _, run = run_of(tmp_path, "{order: delay, dead_time: 8 ms}")
    assert run.unknown_gains is None
    assert "gains" not in str(run)


def test_the_largest_gain_of_a_servo_is_simulated_without_the_estimate(tmp_path):
    _, run = run_of(tmp_path, "{order: first, kp: 250000 1/s}")
    assert run.unknown_gains is None and run.evaluation is not None
    _, run = run_of(tmp_path, "{order: first, kp: 25 1/s}")
    assert run.unknown_gains.max > run.evaluation.contour_error.max


def test_motion_before_the_first_contour_does_not_count(tmp_path):
    # The contour is slow, and the joints move to it as fast as they can.
    file = tmp_path / "job.yaml"
    text = JOB.replace("100 mm/s", "10 mm/s") % "{kp: 25 1/s, kv: 150 1/s}"
    text = text.replace("runs: {only: {}}", "runs: {only: {timing: {reserve: 5 %}}}")
    file.write_text(text)
    alone = ac.run(ac.read_job(file)).runs["only"]
    start = [x + 0.4 for x in alone.trajectory(0.0).tolist()]
    file.write_text(f"{text}start_from: {{joints: {start}}}\n")
    job = ac.read_job(file)
    run = ac.run(job).runs["only"]
    assert run.trajectory.duration > alone.trajectory.duration + 0.2
    assert run.unknown_gains.max == pytest.approx(worst_of_corners(job, run), rel=0.05)
