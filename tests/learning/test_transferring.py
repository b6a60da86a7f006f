"""What was learned at one speed, at another speed of the same path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import smooth

pytest.importorskip("mujoco")
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
POINTS = [(0.35, 0.10), (0.38, 0.13), (0.35, 0.16)]
DEAD_TIME = 9e-3


@pytest.fixture(scope="module")
def arm():
    arm = ac.load_arm("pmk3s")
    return arm._copy(chain=arm.chain.replace(armature=np.array([0.02, 0.005])))


@pytest.fixture(scope="module")
def path():
    return ac.round_corners(ac.Path.polyline(POINTS), tolerance=2e-3)


@pytest.fixture(scope="module")
def robot(arm):
    """A robot with a load, friction, gains and dead time that its model does not have."""
    chain = arm.chain.replace(
        payload=ac.Payload(mass=0.05), coulomb=np.array([0.3, 0.05]), viscous=np.array([0.4, 0.05])
    )
    return ac.RigidBodyPlant(
        arm._copy(chain=chain),
        SERVO.replace(kp=(23.0, 26.5), dead_time=DEAD_TIME),
        ac.Limits(joint_torque=1e3).for_joints(2),
        known=arm,
    )


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


def test_a_lesson_from_a_file_carries_over_as_well(arm, path, lesson):
    plain = taught_at(arm, path, 0.7)
    found = [
        ac.transfer(x, plain, arm=arm, servo=SERVO).q
        for x in (lesson, replace(lesson, lifted=None))
    ]
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


def test_another_path_is_refused(arm, path, lesson, refuses):
    back = ac.round_corners(ac.Path.polyline(POINTS[::-1]), tolerance=2e-3)
    wide = ac.round_corners(ac.Path.polyline(POINTS), tolerance=4e-3)
    for other in (back, wide):
        refuses(
            lambda other=other: ac.transfer(
                lesson, taught_at(arm, other, 1.0), arm=arm, servo=SERVO
            ),
            ac.InvalidInput, "not on the path that was learned", "rad away",
        )  # fmt: skip


def test_servos_without_masses_carry_over_their_gains():
    """A wrong gain is all that differs, so that everything is explained."""
    limits = ac.Limits(joint_velocity=[3.0] * 2, joint_acceleration=[5.0] * 2)
    arm = ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)
    robot = ac.ServoPlant(arm, SERVO.replace(kp=[24.0, 26.0]))
    way = ac.JointPath.spline([(0.1, 0.9), (0.5, 1.3)])
    fast, slow = (
        ac.compensate(smooth(ac.plan(way, arm, x), 0.02), SERVO, method="inverse")
        for x in (
            ac.Limits(joint_velocity=[1.5 * k] * 2, joint_acceleration=[3.0 * k**2] * 2)
            for k in (1.0, 0.7)
        )
    )
    lesson = fast
    for _ in range(2):
        lesson = ac.learn(lesson, ac.execute(lesson, robot), arm=arm, servo=SERVO)
    carried = ac.transfer(lesson, slow, arm=arm, servo=SERVO)
    plan = slow.trajectory
    before, after = (
        np.abs(x.q - plan(np.clip(x.t, 0.0, plan.duration))).max()
        for x in (ac.execute(y, robot) for y in (slow, carried))
    )
    assert carried.explained > 0.999
    assert after < before / 50
