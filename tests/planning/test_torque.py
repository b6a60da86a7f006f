"""Torque limits: friction, gravity, payload, and the constraint rows."""

import itertools

import numpy as np
import pytest

import armcontour as ac
from armcontour.planning.topp import sampled_joint_path
from armcontour.robot.bodies import Payload
from armcontour.robot.serial import SerialArm

VISCOUS = np.array([15.0, 15.0, 10.0, 3.0, 3.0, 2.0])
COULOMB = np.array([8.0, 8.0, 5.0, 1.5, 1.5, 1.0])
# Every joint turns round somewhere.
POINTS = np.random.default_rng(7).uniform(-2, 2, (5, 6))


def ur5e(**changes):
    arm = ac.load_arm("ur5e")
    return SerialArm(name="UR5e", chain=arm.chain.replace(**changes), limits=arm.limits)


def torque_only(arm, **more):
    return ac.Limits.only(joint_torque=arm.limits.joint_torque, **more)


def judged(planned, arm, limits):
    check = ac.check(planned, arm, limits, points=30)
    assert not check.violated, check.worst
    return check


def test_friction_is_respected_where_joints_reverse():
    path = ac.JointPath.spline(POINTS)
    for viscous, coulomb in itertools.product((0, 1), repeat=2):
        arm = ur5e(viscous=viscous * VISCOUS, coulomb=coulomb * COULOMB)
        limits = torque_only(arm, joint_velocity=arm.limits.joint_velocity)
        planned = ac.plan(path, arm, limits)
        assert 1 - 1e-5 <= judged(planned, arm, limits)["joint_torque"].ratio <= 1 + 1e-9
        rate = planned(np.linspace(0, planned.duration, 1000), 1)
        assert (rate.min(axis=0) < 0).all() and (rate.max(axis=0) > 0).all()
    for intervals in (10, 50, 300):
        judged(
            ac.plan(path, arm, torque_only(arm), ac.Optimal(intervals=intervals)),
            arm,
            torque_only(arm),
        )


def test_torque_is_respected_at_stops_and_end_speeds():
    arm = ur5e(viscous=VISCOUS, coulomb=COULOMB)
    steps = np.diff(POINTS, axis=0)
    breaks = np.concatenate([[0], np.cumsum(np.linalg.norm(steps, axis=1))])
    coefficients = np.zeros((len(steps), 6, 6))
    coefficients[:, 0] = POINTS[:-1]
    coefficients[:, 1] = steps
    path = ac.JointPath(breaks=breaks, coefficients=coefficients)
    planned = ac.plan(path, arm, torque_only(arm), ac.Optimal(start_speed=0.1, end_speed=0.05))
    judged(planned, arm, torque_only(arm))
    (law,) = planned.laws
    assert law.speeds[[0, -1]] == pytest.approx([0.1, 0.05])
    assert (law.speeds[np.searchsorted(law.s, path.stops)] == 0).all()


def test_a_torque_limit_just_above_gravity_and_friction_is_satisfied():
    arm = ur5e(viscous=VISCOUS)
    path = ac.JointPath.spline([(0.0, -0.5, 0.3, 0, 0, 0), (0.5, 0.4, 0.5, 0, 0, 0)])
    q = path(np.linspace(0, path.length, 1000))
    holding = np.abs(arm.torque(q, 0 * q, 0 * q)).max(axis=0)
    limits = ac.Limits.only(joint_torque=holding * 1.001 + 0.01)
    judged(ac.plan(path, arm, limits), arm, limits)


def test_torque_limits_exceeded_at_rest_are_refused(refuses):
    loaded = ur5e(payload=Payload(mass=15.0))
    stiff = ur5e(coulomb=[0, 0, 0, 0, 0, 29.0])
    path = ac.JointPath.spline([np.zeros(6), np.full(6, 0.3)])
    for arm, words, data in (
        (loaded, "even at rest", {"joint": 1, "limit": "torque", "allowed": -150.0}),
        (stiff, "in the slowest motion, with friction", {"joint": 5, "allowed": 28.0}),
    ):
        torque_limits = torque_only(arm)
        refuses(lambda x=arm, y=torque_limits: ac.plan(path, x, y), ac.NotRealizable, words, **data)
    bare = ac.load_arm("ur5e")
    chain = bare.chain.replace(masses=None, centers=None, inertias=None)
    hint = "load_arm takes a joint_limits.yaml"
    arm = SerialArm(name="bare", chain=chain, limits=bare.limits, limits_hint=hint)
    refuses(lambda: ac.plan(path, arm), ac.InvalidInput, "masses of the arm bare are not known")
    refuses(lambda: ac.plan(path, arm, ac.Limits.only()), ac.InvalidInput, "joint_torque", hint)


def test_a_payload_slows_the_arm():
    path = ac.JointPath.spline(POINTS)
    arms = [ur5e()]
    arms += [ur5e(payload=Payload(mass=x)) for x in (2.0, 4.0)]
    durations = [ac.plan(path, arm, torque_only(arm)).duration for arm in arms]
    assert durations[0] < durations[1] < durations[2]


def test_the_explanation_names_the_limiting_torque():
    arm = ur5e(viscous=VISCOUS, coulomb=COULOMB)
    limits = torque_only(arm)
    planned = ac.plan(ac.JointPath.spline(POINTS), arm, limits)
    bindings = ac.explain(planned, arm, limits).bindings
    binding = [x for x in bindings if x.limit != "nothing"]
    assert {x.name for x in binding} <= {f"joint {k} torque" for k in range(1, 7)}
    length = sum(x.s[1] - x.s[0] for x in binding)
    assert length > 0.98 * (bindings[-1].s[1] - bindings[0].s[0])
    assert all(0.99 < x.share < 1 + 1e-9 for x in binding)


@pytest.mark.parametrize("at_once", [1, 97])
def test_plan_is_the_same_if_rows_are_computed_in_groups(monkeypatch, at_once):
    arm = ur5e(viscous=VISCOUS, coulomb=COULOMB)
    path = ac.JointPath.spline(POINTS)
    options = ac.Optimal(intervals=400)
    (whole,) = ac.plan(path, arm, torque_only(arm), options).laws
    monkeypatch.setattr(sampled_joint_path, "INTERVALS_AT_ONCE", at_once)
    (grouped,) = ac.plan(path, arm, torque_only(arm), options).laws
    np.testing.assert_array_equal(grouped.breaks, whole.breaks)
    np.testing.assert_array_equal(grouped.rates, whole.rates)
