"""Learning on a selection of the robots of `soak.loops`, judged by the true motion of the tool."""

import numpy as np
import pytest
from soak.loops import KINDS, draw, exact_servo, faults, plan, record, servo_of, teach

import armcontour as ac

# `draw(seed)` draws a robot whose loops are KINDS[seed].
P_P = KINDS.index("P-P")
P_PI = KINDS.index("P-PI")
FEED_FORWARD = KINDS.index("feed-forward")


@pytest.mark.parametrize("seed", [P_PI, FEED_FORWARD])
def test_learning_improves_robots_with_other_loops(seed):
    robot = draw(seed)
    lesson = teach(robot, servo_of(robot, seed), seed, runs=2)
    assert faults(robot, lesson) == []


def test_independent_joints_with_the_servo_of_the_job_are_not_refused():
    """The arm has masses, which the joints of the robot do not feel."""
    robot = draw(P_P)
    lesson = teach(robot, exact_servo(robot), P_P, runs=1)
    assert faults(robot, lesson) == []


def test_a_heavy_arm_with_independent_servos_is_not_refused():
    pytest.importorskip("mujoco")
    arm = ac.load_arm("ur5e").with_dynamics(payload=ac.Payload(mass=1.5, center=(0, 0, 0.05)))
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    corners = np.array([[0, 0, 0], [0.04, 0, 0], [0.04, 0.04, 0]])
    path = ac.Path.polyline(np.array([0.4, -0.05, 0.2]) + corners)
    path = ac.round_corners(path.oriented(np.diag([1.0, -1.0, -1.0])), tolerance=1e-3)
    set_points = ac.compensate(ac.plan(path, arm, arm.limits.replace(speed=0.25)), servo)
    robot = ac.ServoPlant(arm, servo, saturation="none")
    lesson = ac.learn(set_points, ac.simulate(set_points, robot), arm=arm, servo=servo)
    assert lesson.model == "independent servos"
    assert "identify" not in lesson.reason


def test_rigid_bodies_are_learned_as_rigid_bodies():
    pytest.importorskip("mujoco")
    arm = ac.load_arm("pmk3s")
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    set_points = ac.compensate(plan(), servo, ac.Inverse())
    robot = ac.RigidBodyPlant(arm, servo, ac.Limits.only(joint_torque=1e3).for_joints(2))
    lesson = ac.learn(set_points, ac.simulate(set_points, robot), arm=arm, servo=servo)
    assert lesson.model == "rigid bodies"


def first_lesson(robot, servo, tail):
    set_points = ac.compensate(plan(), servo, ac.Inverse(), cycle=robot.period)
    log = record(robot, np.asarray(set_points.q), robot.period, 2e-6, 1, tail)
    return ac.learn(set_points, log, arm=ac.load_arm("pmk3s"), servo=servo)


@pytest.mark.parametrize("tail", [0.4, 2.0])
def test_integrators_leave_the_last_set_point_at_the_end_of_the_plan(tail):
    robot = draw(P_PI)
    lesson = first_lesson(robot, servo_of(robot, P_PI), tail)
    end = plan()(plan().duration)
    assert np.abs(lesson.q[-1] - end).max() < 1e-5
    assert lesson.runs[0].tool_max >= lesson.runs[0].tool_rest
    if tail < 1.0:
        assert any("creep" in x for x in lesson.runs[0].notes)
