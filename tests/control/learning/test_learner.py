"""Learning from run to run: results of `learn`, and the errors of the next runs."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import armcontour as ac
from armcontour.control.learning import Recording
from armcontour.motion import SetPoints, make_rule

from .robots import GAINS, SERVO, gentle_plan, loaded, rods, rounded, with_inertias

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def arm():
    return with_inertias()


@pytest.fixture(scope="module")
def path():
    return rounded()


@pytest.fixture(scope="module")
def set_points(arm, path):
    limits = ac.Limits.only(speed=0.15, joint_acceleration=3.0, joint_velocity=2.0)
    plan = gentle_plan(path, arm, limits.for_joints(2))
    return ac.compensate(plan, SERVO, ac.Inverse())


def plant(arm, run, *, dead_time=0.0, noise=1e-6):
    return loaded(arm, seed=run, dead_time=dead_time, noise=noise)


def teach(arm, set_points, runs, **options):
    """Executions and lessons, in turn."""
    done = []
    lessons = []
    for run in range(runs):
        done.append(ac.simulate(set_points, plant(arm, run, **options)))
        set_points = ac.learn(set_points, done[-1], arm=arm, servo=SERVO)
        lessons.append(set_points)
    return done, lessons


@pytest.fixture(scope="module")
def delayed_runs(arm, set_points):
    """Runs of a robot that is 9 ms later than its model."""
    return teach(arm, set_points, 4, dead_time=9e-3)


def test_errors_decrease_from_run_to_run(delayed_runs, path):
    done, lessons = delayed_runs
    errors = [ac.evaluate(x, path).contour_error.rms for x in done]
    assert errors[1] < 0.25 * errors[0]
    assert errors[3] < 0.05 * errors[0]
    for error, run in zip(errors, lessons[-1].runs, strict=True):
        assert run.rms == pytest.approx(error, rel=0.1)


def test_a_learning_result_is_restored_from_its_arrays(arm, delayed_runs):
    """The history of a folder gives the same next set-points as the history in memory."""
    done, lessons = delayed_runs
    lesson = ac.learn(replace(lessons[1], lifted=None), done[2], arm=arm, servo=SERVO)
    np.testing.assert_allclose(lesson.q, lessons[2].q, atol=1e-9)
    assert lesson.repeats == pytest.approx(lessons[2].repeats, rel=1e-6)


def test_each_step_starts_from_the_best_run(arm, set_points, delayed_runs):
    """Set-points that are worse than their forerunners count as a setback, and are left again."""
    done, lessons = delayed_runs
    wave = 0.05 * np.sin(0.2 * np.arange(len(set_points.q)))[:, None]
    spoiled = replace(lessons[0], q=lessons[0].q + wave)
    bad = ac.simulate(spoiled, plant(arm, 1, dead_time=9e-3))
    after = ac.learn(spoiled, bad, arm=arm, servo=SERVO)
    good = ac.learn(lessons[0], done[1], arm=arm, servo=SERVO)
    assert after.runs[1].rms > after.runs[0].rms
    assert (after.best, after.setbacks, good.best, good.setbacks) == (0, 1, 1, 0)


def test_learning_ends_with_the_best_run_after_setbacks(arm, set_points, delayed_runs):
    done, lessons = delayed_runs
    lesson = replace(lessons[0], setbacks=2, q=lessons[0].q * 1.02)
    bad = ac.simulate(lesson, plant(arm, 1, dead_time=9e-3))
    last = ac.learn(lesson, bad, arm=arm, servo=SERVO)
    assert last.finished
    assert "did not reduce the error" in last.reason
    np.testing.assert_array_equal(last.q, set_points.q)


@pytest.mark.parametrize("noise", [1e-6, 1e-4])
def test_learning_works_with_encoder_noise(set_points, path, noise):
    arm = ac.load_arm("pmk3s")
    robot = SERVO.replace(kp=[22.0, 27.0])
    robot = ac.ServoPlant(arm, robot, ac.Limits.only(joint_acceleration=30.0).for_joints(2))
    errors = []
    rng = np.random.default_rng(5)
    for _ in range(2):
        execution = ac.simulate(set_points, robot)
        q = execution.q + rng.normal(scale=noise, size=execution.q.shape)
        run = Recording(t=execution.t, q=q, in_plan_time=True)
        set_points = ac.learn(set_points, run, arm=arm, servo=SERVO)
        errors.append(ac.evaluate(execution, path).contour_error.rms)
        assert set_points.noise is None
    assert errors[1] < 0.1 * errors[0]


def test_learning_ends_if_only_noise_remains(arm, set_points):
    """A robot like its model, but with noise: four runs of equal set-points show it."""
    limits = ac.Limits.only(joint_torque=1e3).for_joints(2)
    lesson = set_points
    for k in range(3):
        loud = [ac.RigidBodyPlant(arm, SERVO, limits, noise=1e-4, seed=4 * k + i) for i in range(4)]
        runs = [ac.simulate(lesson, x) for x in loud]
        lesson = ac.learn(lesson, runs, arm=arm, servo=SERVO)
        if lesson.finished:
            break
    assert lesson.reason == "the remaining error is noise"
    assert lesson.noise == pytest.approx(lesson.remaining, rel=0.5)
    np.testing.assert_array_equal(lesson.q, lesson.runs[lesson.best].q)


def limited(set_points, limits):
    """The same set-points with limits, which the next ones must keep."""
    return replace(set_points, rule=make_rule(ac.Limits(), set_points.q.shape[1], limits))


def test_learned_set_points_stay_within_the_velocity_limit(arm, set_points):
    robot = ac.ServoPlant(arm, SERVO.replace(kp=GAINS), saturation="none")
    executed = ac.simulate(set_points, robot)
    teach_again = partial(ac.learn, executed=executed, arm=arm, servo=SERVO)
    rate = np.abs(np.diff(set_points.q, axis=0)).max(axis=0) / set_points.cycle
    close = ac.Limits.only(joint_velocity=1.0005 * rate)
    free = teach_again(limited(set_points, ac.Limits.only()))
    held = teach_again(limited(set_points, close))
    fastest = [np.abs(np.diff(x.q, axis=0)).max(axis=0) / set_points.cycle for x in (free, held)]
    assert (fastest[0] > close.joint_velocity).any()
    assert (fastest[1] <= close.joint_velocity * (1 + 1e-8)).all()
    assert "of the set-points of joint" in held.reason
    # Joints that have room keep all of their change.
    only = int(np.argmax(fastest[0] / rate))
    one = np.full(len(rate), 100.0)
    one[only] = 1.0005 * rate[only]
    half = teach_again(limited(set_points, ac.Limits.only(joint_velocity=one)))
    others = np.arange(len(rate)) != only
    np.testing.assert_array_equal(half.q[:, others], free.q[:, others])
    assert (half.q[:, only] != free.q[:, only]).any()


def test_a_learning_result_without_improvement_has_a_note():
    """Set-points that always move at the limit of velocity: no others have the same ends."""
    arm = rods()
    servo = ac.ServoModel(kp=25.0, order="first")
    plan = gentle_plan(ac.JointPath.spline([(0.1, 0.9), (0.5, 1.3)]), arm, arm.limits)
    q = np.linspace(*plan([0.0, plan.duration]), int(plan.duration / 4e-3) + 2)
    set_points = SetPoints(cycle=4e-3, q=q, trajectory=plan, method="none")
    execution = ac.simulate(
        set_points, ac.ServoPlant(arm, servo.replace(kp=22.0), saturation="none")
    )
    rate = np.abs(q[1] - q[0]) / set_points.cycle
    none = limited(set_points, ac.Limits(joint_velocity=(1 + 1e-7) * rate))
    lesson = ac.learn(none, execution, arm=arm, servo=servo)
    assert lesson.finished and "velocity" in lesson.reason
    np.testing.assert_array_equal(lesson.q, set_points.q)


def test_the_first_order_servo_learns_without_masses():
    """One run takes all of a wrong gain's error away that the model explains."""
    arm = rods()
    servo = ac.ServoModel(kp=25.0, order="first")
    plan = gentle_plan(ac.JointPath.spline([(0.1, 0.9), (0.5, 1.3)]), arm, arm.limits)
    set_points = ac.compensate(plan, servo, ac.Inverse())
    robot = ac.ServoPlant(arm, servo.replace(kp=[23.0, 27.0]))
    first = ac.simulate(set_points, robot)
    lesson = ac.learn(set_points, first, arm=arm, servo=servo)
    second = ac.simulate(lesson, robot)
    errors = [np.abs(x.q - plan(np.clip(x.t, 0, plan.duration))).max() for x in (first, second)]
    assert errors[1] < 0.1 * errors[0]
    assert lesson.runs[0].contour_rms is None
    assert lesson.runs[0].rms == lesson.runs[0].tool_rms
