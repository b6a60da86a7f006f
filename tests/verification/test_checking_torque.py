"""Checks of torque, joint ranges and angular limits."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.robot.serial import SerialArm

COULOMB = np.array([8.0, 8.0, 5.0, 1.5, 1.5, 1.0])
POINTS = np.random.default_rng(3).uniform(-1.5, 1.5, (4, 6))


@pytest.fixture(scope="module")
def robot():
    arm = ac.load_arm("ur5e")
    chain = arm.chain.replace(coulomb=COULOMB, viscous=2 * COULOMB)
    return SerialArm(name="UR5e", chain=chain, limits=arm.limits)


@pytest.fixture(scope="module")
def planned(robot):
    return ac.plan(ac.JointPath.spline(POINTS), robot, robot.limits)


@pytest.fixture(scope="module")
def turning(robot):
    held = ac.Path.polyline([(0.4, -0.1, 0.4), (0.4, 0.1, 0.4)])
    return ac.plan(held.pointing([(0, 0, -1), (0.5, 0.2, -1)]), robot, robot.limits)


def sampled(planned, *, cycle=0.002, **without):
    x = planned.sample(cycle)
    columns = {"t": x.t, "q": x.q, "dq": x.dq, "ddq": x.ddq}
    return SimpleNamespace(**{k: v for k, v in columns.items() if k not in without})


def test_torque_is_checked_for_laws_and_for_samples(planned, robot):
    q, dq, ddq = (planned(np.linspace(0, planned.duration, 20_001), k) for k in (0, 1, 2))
    torque = np.abs(robot.torque(q, dq, ddq))[1:-1].max(axis=0)
    limits = robot.limits.replace(joint_torque=torque * 0.9)
    for motion in (planned, sampled(planned)):
        check = ac.check(motion, robot, limits)["joint_torque"]
        assert check.ratio == pytest.approx(1 / 0.9, rel=2e-3)
        assert check.certain > 1 and check.joint is not None
        assert check.limit == pytest.approx(0.9 * torque[check.joint])
    loose = ac.check(planned, robot, robot.limits.replace(joint_torque=torque * 1.01))
    assert not loose.violated


def test_dry_friction_at_rest_has_the_most_favourable_sign(robot):
    """At its ends a motion brakes with friction; standing, no more is certain than without it."""
    limits = ac.Limits.only(joint_torque=[150, 150, 150, 28, 28, 28])
    path = ac.JointPath.spline([np.zeros(6), np.array([1.0, 0, 0, 0, 0, 0])])
    check = ac.check(ac.plan(path, robot, limits), robot, limits)
    assert not check.violated
    assert check["joint_torque"].ratio == pytest.approx(1, abs=1e-6)


def test_torque_without_digits_columns_or_masses_is_undecided(planned, robot, arm, mac):
    limits = robot.limits
    coarse = {"q": 1e-3, "dq": 1e-2, "ddq": 1.0}
    exact = ac.check(sampled(planned), robot, limits)["joint_torque"]
    check = ac.check(sampled(planned), robot, limits, resolution=coarse)["joint_torque"]
    assert exact.slack < 1e-9 < 1e-3 < check.slack
    for missing in ("dq", "ddq"):
        check = ac.check(sampled(planned, **{missing: True}), robot, robot.limits)
        assert "joint_torque" in check.not_judged and "joint_lower" not in check.not_judged
    chain = robot.chain.replace(masses=None, centers=None, inertias=None)
    bare = SerialArm(name="bare", chain=chain, limits=robot.limits)
    assert ac.check(planned, bare).not_judged == ("joint_torque",)
    flat = arm.limits.replace(angular_speed=1.0, angular_acceleration=1.0)
    assert ac.check(mac, arm, flat).not_judged == ("angular_speed", "angular_acceleration")


def test_the_ratio_of_a_joint_position_counts_from_the_middle_of_its_range(planned, robot):
    q = planned(np.linspace(0, planned.duration, 20_001))
    upper, lower = q.max(axis=0), q.min(axis=0)
    upper[2] -= 0.1
    limits = ac.Limits.only(joint_lower=lower, joint_upper=upper)
    for motion in (planned, sampled(planned), sampled(planned, dq=True)):
        check = ac.check(motion, robot, limits)
        over = check["joint_upper"]
        assert over.joint == 2 and over.limit == upper[2]
        assert over.value == pytest.approx(upper[2] + 0.1, abs=1e-4)
        assert over.ratio == pytest.approx(1 + 0.2 / (upper[2] - lower[2]), abs=1e-3)
        assert check["joint_lower"].ratio == pytest.approx(1, abs=1e-3)
        assert over in check.violations
    # With one end, or none.
    one = np.where(np.arange(6) == 1, q.max(axis=0) - 0.2, np.inf)
    check = ac.check(planned, robot, ac.Limits.only(joint_lower=np.inf, joint_upper=one))[
        "joint_upper"
    ]
    assert check.joint == 1 and check.ratio == pytest.approx(1 + 0.2 / np.pi, abs=1e-4)
    endless = ac.Limits.only(joint_lower=np.inf, joint_upper=np.full(6, np.inf))
    assert not any(x.name.startswith("joint_") for x in ac.check(planned, robot, endless).uses)


def test_angular_speed_and_acceleration_are_checked_for_laws_and_samples(turning, robot):
    t = np.linspace(0, turning.duration, 20_001)
    q, dq, ddq = (turning(t, order) for order in (0, 1, 2))
    rate = np.linalg.norm(robot.tool_twist(q, dq)[:, 3:], axis=1).max()
    bend = np.linalg.norm(robot.tool_twist_rate(q, dq, ddq)[:, 3:], axis=1).max()
    limits = robot.limits.replace(angular_speed=rate * 0.95, angular_acceleration=bend * 0.95)
    for motion in (turning, sampled(turning), sampled(turning, ddq=True)):
        check = ac.check(motion, robot, limits)
        assert {x.name for x in check.violations} == {"angular_speed", "angular_acceleration"}
        for name in ("angular_speed", "angular_acceleration"):
            assert check[name].ratio == pytest.approx(1 / 0.95, rel=2e-2)
            assert check[name].ratio < 1 / 0.95 * (1 + 1e-3)
    positions = ac.check(sampled(turning, dq=True, ddq=True), robot, limits)
    assert positions["angular_speed"].ratio == pytest.approx(1 / 0.95, rel=1e-2)
    assert "angular_acceleration" in positions.not_judged


def test_an_evaluation_reports_time_at_the_torque_limit(turning, robot, servo):
    set_points = ac.compensate(turning, servo, cycle=0.002)
    executed = ac.simulate(set_points, ac.ServoPlant(robot, servo))
    torque = np.abs(robot.torque(executed.q, executed.dq, executed.ddq)).max(axis=0)
    loose = robot.limits.replace(joint_acceleration=1e3, joint_torque=1e3 * torque)
    evaluate = partial(ac.evaluate, executed, turning.path, limit_use=True)
    assert evaluate(limits=loose).time_at_limit == 0
    evaluation = evaluate(limits=loose.replace(joint_torque=torque / 2))
    assert evaluation.time_at_limit > 0 and evaluation.limit_ratios["joint_torque"] > 1.5
