"""What was learned at one speed, at another speed of the same path."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import smooth

from .robots import POINTS, SERVO, loaded, rods, rounded, with_inertias

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def arm():
    return with_inertias()


@pytest.fixture(scope="module")
def path():
    return rounded()


@pytest.fixture(scope="module")
def robot(arm):
    """A robot with a load, friction, gains and dead time that its model does not have."""
    return loaded(arm, dead_time=9e-3)


def taught_at(arm, path, factor):
    """Set-points of the model for a speed, as a factor of the speed that is learned."""
    limits = ac.Limits(
        speed=0.15 * factor, joint_acceleration=3.0 * factor**2, joint_velocity=2.0 * factor
    )
    plan = smooth(ac.plan(path, arm, limits.for_joints(2)), 0.02 / factor)
    return ac.compensate(plan, SERVO, method="inverse_dynamics", arm=arm)


@pytest.fixture(scope="module")
def lesson(arm, path, robot):
    lesson = taught_at(arm, path, 1.0)
    for _ in range(3):
        lesson = ac.learn(lesson, ac.execute(lesson, robot), arm=arm, servo=SERVO)
    return lesson


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_a_correction_carries_over_to_another_speed(arm, path, robot, lesson, factor):
    plain = taught_at(arm, path, factor)
    carried = ac.transfer(lesson, plain, arm=arm, servo=SERVO)
    done = [ac.execute(x, robot) for x in (plain, carried)]
    before, after = (ac.evaluate(x, path).contour_error.rms for x in done)
    assert after < before / 20
    assert carried.explained > 0.99
    # The dead time is known from the lesson, and set-points start earlier by it.
    assert carried.start_time == pytest.approx(plain.start_time - 8e-3)
    next_lesson = ac.learn(carried, done[1], arm=arm, servo=SERVO)
    assert next_lesson.delay == lesson.delay
    assert next_lesson.runs[0].rms == pytest.approx(after, rel=0.2, abs=1e-6)


def test_at_its_own_speed_nothing_is_lost(arm, path, robot, lesson):
    again = ac.transfer(lesson, taught_at(arm, path, 1.0), arm=arm, servo=SERVO)
    found = ac.evaluate(ac.execute(again, robot), path).contour_error.rms
    assert found < 1.5 * lesson.remaining
    # A lesson from a file carries over as well.
    slow = taught_at(arm, path, 0.7)
    one, other = (
        ac.transfer(x, slow, arm=arm, servo=SERVO) for x in (lesson, replace(lesson, lifted=None))
    )
    np.testing.assert_allclose(one.q, other.q, atol=1e-9)


def test_another_path_is_refused(arm, lesson, refuses):
    for path in (rounded(POINTS[::-1]), rounded(tolerance=4e-3)):
        call = partial(ac.transfer, lesson, taught_at(arm, path, 1.0), arm=arm, servo=SERVO)
        refuses(call, ac.InvalidInput, "not on the path that was learned")


def test_servos_without_masses_carry_over_their_gains():
    """A wrong gain is all that differs, so that everything is explained."""
    arm = rods()
    robot = ac.ServoPlant(arm, SERVO.replace(kp=[24.0, 26.0]))
    way = ac.JointPath.spline([(0.1, 0.9), (0.5, 1.3)])
    found = []
    for k in (1.0, 0.7):
        limits = ac.Limits(joint_velocity=[1.5 * k] * 2, joint_acceleration=[3.0 * k**2] * 2)
        plan = smooth(ac.plan(way, arm, limits), 0.02)
        found.append(ac.compensate(plan, SERVO, method="inverse"))
    lesson, slow = found
    for _ in range(2):
        lesson = ac.learn(lesson, ac.execute(lesson, robot), arm=arm, servo=SERVO)
    carried = ac.transfer(lesson, slow, arm=arm, servo=SERVO)
    done = [ac.execute(x, robot) for x in (slow, carried)]
    before, after = (np.abs(x.q - plan(np.clip(x.t, 0.0, plan.duration))).max() for x in done)
    assert carried.explained > 0.999
    assert after < before / 50
