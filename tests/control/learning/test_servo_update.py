"""The servo that learning assumes is the nominal one, unless the log supports another."""

import numpy as np
import pytest
from soak.learning import record, task, wrong_model

import armcontour as ac
from armcontour.control.learning import Recording

from .robots import SERVO, gentle_plan, loaded, rods, rounded, with_inertias

pytest.importorskip("mujoco")


def log_of(done, noise, seed=0):
    """Log of an execution, with a sample of set-points and noisy positions per millisecond."""
    set_points = done.set_points
    command = np.stack([np.interp(done.t, set_points.t, x) for x in set_points.q.T], axis=1)
    measured = done.q + np.random.default_rng(seed).normal(scale=noise, size=done.q.shape)
    return ac.Log(t=done.t - done.t[0], command=command, measured=measured)


def runs_of(set_points, robot, noise, count, servo=SERVO):
    """Lessons, and true RMS contour errors of the runs [mm], that of the last lesson included."""
    arm, path, lessons, errors = robot.arm, set_points.trajectory.path, [], []
    for k in range(count):
        execution = ac.simulate(set_points, robot)
        errors.append(1e3 * ac.evaluate(execution, path).contour_error.rms)
        set_points = ac.learn(set_points, log_of(execution, noise, k), arm=arm, servo=servo)
        lessons.append(set_points)
        if set_points.finished:
            break
    errors.append(1e3 * ac.evaluate(ac.simulate(set_points, robot), path).contour_error.rms)
    return lessons, errors


def with_set_points():
    arm = with_inertias()
    limits = ac.Limits.only(speed=0.15, joint_acceleration=3.0, joint_velocity=2.0).for_joints(2)
    return arm, ac.compensate(gentle_plan(rounded(), arm, limits), SERVO)


def test_feed_forward_that_the_model_lacks_is_found():
    """Corrections of a model without it are wrong by the factor 1 + f s / K_p, and diverge."""
    job_task = task("pmk3s")
    true = {"kp": [28.0, 24.0], "kv": [160.0, 130.0], "velocity_feedforward": 0.9}
    robot = ac.ServoPlant(job_task.arm, SERVO.replace(**true, dead_time=6e-3), saturation="none")
    lessons, errors = runs_of(job_task.set_points, robot, 1e-5, 4)
    servo = lessons[0].servo
    # The fit trades feed-forward for gains where the plan is as gentle as this one.
    np.testing.assert_allclose(servo.velocity_feedforward, 0.9, atol=0.15)
    assert lessons[0].misfits[1] < 0.2 * lessons[0].misfits[0]
    assert errors[0] > 0.04 and min(errors[:4]) < 0.005 and errors[-1] < 0.005
    assert all(after < before + 1e-3 for before, after in zip(errors, errors[1:], strict=False))
    fastest = [np.abs(np.diff(x.q, 2, axis=0)).max(axis=0) for x in (job_task.set_points, *lessons)]
    assert all((x <= 2 * fastest[0] * (1 + 1e-9)).all() for x in fastest)
    assert all(x.servo is servo for x in lessons)


@pytest.mark.parametrize("seed", [0, 3])
def test_random_wrong_models_are_learned_from(seed):
    """`python -m soak learning-servos` has more."""
    errors, lessons = wrong_model(task("pmk3s"), seed, runs=4)
    assert errors.min() < 5e-6 or lessons[-1].finished
    assert errors[-1] < errors.min() + 3 * lessons[-1].noise


def test_a_right_model_is_kept():
    arm, set_points = with_set_points()
    strong = ac.Limits.only(joint_torque=1e3).for_joints(2)
    for noise in (0.0, 1e-6, 1e-4):
        execution = ac.simulate(
            set_points, ac.RigidBodyPlant(arm, SERVO, strong, controller=arm, noise=noise)
        )
        lesson = ac.learn(set_points, execution, arm=arm, servo=SERVO)
        assert lesson.misfits == (0.0, 0.0) and lesson.delay == 0.0
        np.testing.assert_array_equal(lesson.servo.kp, [25.0, 25.0])


def test_dead_time_is_found_beside_load_and_friction():
    """A load delays joints, too: dead time is that of the servo that explains both best."""
    arm, set_points = with_set_points()
    robot = loaded(arm, dead_time=9e-3, noise=1e-5)
    lesson = ac.learn(set_points, ac.simulate(set_points, robot), arm=arm, servo=SERVO)
    assert lesson.delay == pytest.approx(9e-3, abs=3e-3)
    assert lesson.start_time == pytest.approx(set_points.start_time - 8e-3)


def test_learning_ends_with_the_best_run_where_no_servo_can_be_fitted():
    """Positions alone do not show dead time, so the servo of the job is used, right or wrong."""
    job_task, random = task("pmk3s"), np.random.default_rng(0)
    robot = ac.ServoPlant(job_task.arm, SERVO.replace(velocity_feedforward=0.95), saturation="none")
    set_points = job_task.set_points
    for _ in range(6):
        log = record(ac.simulate(set_points, robot), 1e-6, 1.0, random)
        set_points = ac.learn(
            set_points, Recording(t=log.t, q=log.measured), arm=job_task.arm, servo=SERVO
        )
        assert set_points.misfits == (0.0, 0.0)
        if set_points.finished:
            break
    assert set_points.finished and set_points.reason
    np.testing.assert_array_equal(set_points.q, set_points.runs[set_points.best].q)


def one_moves(servo, true, noise=1e-5):
    """A lesson of a planar arm whose second joint stands still."""
    arm = rods()
    plan = gentle_plan(ac.JointPath.spline([(0.1, 0.9), (0.5, 0.9)]), arm, arm.limits)
    set_points = ac.compensate(plan, servo, ac.Inverse())
    execution = ac.simulate(set_points, ac.ServoPlant(arm, true, saturation="none"))
    return ac.learn(set_points, log_of(execution, noise), arm=arm, servo=servo)


def test_a_joint_that_stands_still_keeps_its_servo():
    servo = one_moves(SERVO, SERVO.replace(kp=18.0, velocity_feedforward=0.5)).servo
    assert (servo.kp[1], servo.kv[1]) == pytest.approx((25.0, 150.0), rel=1e-3)
    assert servo.velocity_feedforward[1] == pytest.approx(0.0, abs=1e-3)
    assert servo.velocity_feedforward[0] == pytest.approx(0.5, abs=0.1)


def test_a_servo_with_acceleration_feed_forward_is_learned_from():
    """A start of the fit has no velocity feed-forward, which such a servo must have."""
    servo = SERVO.replace(velocity_feedforward=0.9, acceleration_feedforward=0.5)
    lesson = one_moves(servo, SERVO.replace(velocity_feedforward=0.3))
    assert lesson.servo.velocity_feedforward[0] < 0.6
    assert lesson.predicted < 0.5 * lesson.runs[0].rms


LOOPS = {"kp": (22.0, 24.0), "kv": (140.0, 130.0), "dead_time": 3e-3}


@pytest.mark.parametrize(
    "servo",
    [
        ac.ServoModel(order=("second", "first"), kp=(25.0, 20.0), kv=(150.0, np.inf)),
        ac.ServoModel(order=("delay", "second"), kp=(np.inf, 25.0), kv=(np.inf, 150.0)),
        ac.ServoModel(order=("unknown", "first"), kp=(np.inf, 25.0)),
        ac.ServoModel(order="delay", dead_time=8e-3),
        ac.ServoModel(order="unknown"),
        SERVO.replace(friction=1e-4),
        SERVO.replace(drive_cycle=4e-3),
    ],
    ids=lambda x: f"{x.order} {x.friction} {x.drive_cycle}",
)
def test_learning_starts_from_any_servo(servo):
    """The second run shows an error that is 30 times smaller; a third one the noise."""
    arm = rods()
    limits = ac.Limits(speed=0.15, joint_acceleration=3.0, joint_velocity=2.0).for_joints(2)
    set_points = ac.compensate(gentle_plan(rounded(), arm, limits), servo, ac.Inverse())
    robot = ac.ServoPlant(arm, ac.ServoModel(**LOOPS), saturation="none")
    errors = []
    for k in range(2):
        execution = ac.simulate(set_points, robot)
        errors.append(ac.evaluate(execution, set_points.trajectory.path).contour_error.rms)
        set_points = ac.learn(set_points, log_of(execution, 1e-5, k), arm=arm, servo=servo)
    assert errors[1] < max(errors[0] / 30, 2e-6)
