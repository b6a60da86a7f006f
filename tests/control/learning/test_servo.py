"""Learning uses the given servo, or the one of the first log if this log contradicts it."""

import numpy as np
import pytest
from soak.learning import record, task

import armcontour as ac
from armcontour.control.learning import Recording

from .robots import SERVO, gentle_plan, loaded, rods, rounded, with_inertias

pytest.importorskip("mujoco")


def log_of(done, noise=0.0, seed=0):
    """Log of an execution, with a sample of set-points and noisy positions per millisecond."""
    set_points = done.set_points
    command = np.stack([np.interp(done.t, set_points.t, x) for x in set_points.q.T], axis=1)
    measured = done.q + np.random.default_rng(seed).normal(scale=noise, size=done.q.shape)
    return ac.Log(t=done.t - done.t[0], command=command, measured=measured)


@pytest.mark.parametrize("feedforward", [0.75, 0.95])
def test_a_log_with_unmodelled_feed_forward_contradicts_the_servo(feedforward):
    """Learning uses the servo of the log, and says so."""
    job_task = task("pmk3s")
    true = {"kp": [28.0, 24.0], "kv": [160.0, 130.0], "velocity_feedforward": feedforward}
    robot = ac.ServoPlant(job_task.arm, SERVO.replace(**true, dead_time=6e-3), saturation="none")
    first = ac.simulate(job_task.set_points, robot)
    lesson = ac.learn(job_task.set_points, log_of(first, 1e-6), arm=job_task.arm, servo=SERVO)
    assert "identified" in lesson.model and not lesson.finished
    assert any("contradicts the servo" in x for x in lesson.runs[0].notes)
    np.testing.assert_allclose(lesson.servo.velocity_feedforward, feedforward, atol=0.05)
    second = ac.simulate(lesson, robot)
    errors = [ac.evaluate(x, job_task.path).contour_error.rms for x in (first, second)]
    assert errors[0] > 1e-5 and errors[1] < 0.1 * errors[0]


@pytest.mark.filterwarnings("ignore:Compensation may be worse")
def test_learning_ends_if_no_servo_fits_the_log():
    """The robot moves as its set-points, but with errors that no servo has."""
    job_task = task("pmk3s")
    set_points = job_task.set_points
    t = set_points.start_time + np.arange(len(set_points.q)) * set_points.cycle
    waves = 2e-3 * np.sin(2 * np.pi * np.array([7.0, 9.0]) * (t - t[0])[:, None])
    log = ac.Log(t=t - t[0], command=set_points.q, measured=set_points.q + waves)
    lesson = ac.learn(set_points, log, arm=job_task.arm, servo=SERVO)
    assert lesson.finished and "identify the servo first" in lesson.reason.lower()
    np.testing.assert_array_equal(lesson.q, set_points.q)


@pytest.fixture(scope="module")
def slow_plan():
    """A plan whose set-points for a wrong servo have a small error."""
    limits = ac.Limits.only(speed=0.05, joint_acceleration=3.0, joint_velocity=2.0)
    path = rounded([(0.30, 0.05), (0.36, 0.10), (0.30, 0.16)])
    return gentle_plan(path, rods(), limits.for_joints(2))


FIRST_ORDER = ac.ServoModel(kp=30.0, order="first", velocity_feedforward=0.4, dead_time=3e-3)


@pytest.mark.parametrize(("has_commands", "remaining"), [(True, 0.1), (False, 0.5)])
def test_learning_uses_the_servo_that_fits_the_log(slow_plan, has_commands, remaining):
    """A log that the servo explains partly: its lag is wrong, but less than the lag itself."""
    arm = rods()
    set_points = ac.compensate(slow_plan, SERVO, ac.Inverse())
    robot = ac.ServoPlant(arm, FIRST_ORDER, saturation="none")
    for k in range(3):
        log = log_of(ac.simulate(set_points, robot), 1e-7, seed=k)
        if not has_commands:
            log = Recording(t=log.t, q=log.measured)
        set_points = ac.learn(set_points, log, arm=arm, servo=SERVO)
    errors = [x.rms for x in set_points.runs]
    # Without commands, the unknown offset of the clock explains the wrong lag.
    assert ("identified" in set_points.model) == has_commands
    assert max(errors) == errors[0] and errors[-1] < remaining * errors[0]


def test_no_step_makes_the_next_run_much_worse(slow_plan):
    """Set-points for another servo fit the robot better than the model does."""
    arm = rods()
    lesson = ac.compensate(slow_plan, FIRST_ORDER.replace(dead_time=0.0), ac.Inverse())
    robot = ac.ServoPlant(arm, FIRST_ORDER, saturation="none")
    # Logs do not determine a servo with this interpolation.
    servo = SERVO.replace(interpolation="cubic")
    for _ in range(3):
        executed = ac.simulate(lesson, robot)
        recording = Recording(t=executed.t, q=executed.q, in_plan_time=True)
        lesson = ac.learn(lesson, recording, arm=arm, servo=servo)
        if lesson.finished:
            break
    errors = [x.rms for x in lesson.runs]
    assert max(errors) < 1.3 * errors[0]
    assert lesson.finished and "identify" in lesson.reason.lower()


def test_a_correct_servo_is_not_contradicted():
    arm = with_inertias()
    limits = ac.Limits.only(speed=0.15, joint_acceleration=3.0)
    set_points = ac.compensate(gentle_plan(rounded(), arm, limits.for_joints(2)), SERVO)
    strong = ac.Limits.only(joint_torque=1e3).for_joints(2)
    robots = [
        ac.RigidBodyPlant(arm, SERVO, strong, controller=arm, noise=x) for x in (0.0, 1e-6, 1e-4)
    ]
    for robot in (*robots, loaded(arm, dead_time=9e-3, noise=1e-5)):
        lesson = ac.learn(set_points, ac.simulate(set_points, robot), arm=arm, servo=SERVO)
        assert "identify" not in lesson.reason


def test_learning_ends_with_the_best_run_where_a_log_lacks_set_points():
    """Positions alone do not show the lag, so that the first log cannot contradict the servo."""
    job_task = task("pmk3s")
    random = np.random.default_rng(0)
    robot = ac.ServoPlant(job_task.arm, SERVO.replace(velocity_feedforward=0.95), saturation="none")
    set_points = job_task.set_points
    for _ in range(6):
        log = record(ac.simulate(set_points, robot), 1e-6, 1.0, random)
        set_points = ac.learn(
            set_points, Recording(t=log.t, q=log.measured), arm=job_task.arm, servo=SERVO
        )
        if set_points.finished:
            break
    assert set_points.finished and set_points.reason
    np.testing.assert_array_equal(set_points.q, set_points.runs[set_points.best].q)


def one_moves(true, noise=1e-5):
    """Learning result of a planar arm whose second joint is at rest."""
    arm = rods()
    plan = gentle_plan(ac.JointPath.spline([(0.1, 0.9), (0.5, 0.9)]), arm, arm.limits)
    set_points = ac.compensate(plan, SERVO, ac.Inverse())
    execution = ac.simulate(set_points, ac.ServoPlant(arm, true, saturation="none"))
    return ac.learn(set_points, log_of(execution, noise), arm=arm, servo=SERVO)


def test_a_joint_at_rest_does_not_contradict_a_servo():
    assert not one_moves(SERVO.replace(kp=20.0)).finished
    contradicted = one_moves(SERVO.replace(velocity_feedforward=[0.9, 0.0])).runs[0].notes
    assert any("joint 1" in x and "contradicts" in x for x in contradicted)
