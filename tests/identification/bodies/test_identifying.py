"""Payload, friction, drives and dead time from logs of a robot in MuJoCo."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.drives import Drives
from armcontour.errors import InvalidInput
from armcontour.identification import RobotIdentification, identify, propose
from armcontour.identification.bodies.fitting import attempt, derivatives
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import Model
from armcontour.motion import Log

from .robots import (
    COULOMB,
    HOME,
    KP,
    NOISE,
    VISCOUS,
    nominal_arm,
    nominal_servo,
    record,
    set_points,
    true_arm,
)

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def nominal():
    return nominal_arm()


@pytest.fixture(scope="module")
def arm(nominal):
    return true_arm(nominal)


@pytest.fixture(scope="module")
def log(arm, nominal):
    """Six seconds at 250 Hz; the controller does not know of the payload."""
    servo = nominal_servo().replace(kp=KP, dead_time=6e-3)
    return record(arm, servo, set_points(0, 6.0), known=nominal)


@pytest.fixture(scope="module")
def found(log, nominal):
    return identify(log, arm=nominal, servo=nominal_servo())


def deviations(found: RobotIdentification):
    """True values less estimates, in standard deviations, by names."""
    joints = {
        f"{name} {j}": (getattr(joint, name), true[j])
        for name, true in (("kp", KP), ("viscous", VISCOUS), ("coulomb", COULOMB))
        for j, joint in enumerate(found.joints)
    }
    center = {f"center {i}": (x, [0.02, 0.0, 0.05][i]) for i, x in enumerate(found.payload_center)}
    common = {
        "mass": (found.payload_mass, 2.0),
        "armature": (found.armature, 1.0),
        "dead time": (found.dead_time, 6e-3),
    }
    return {k: (true - x.value) / x.sd for k, (x, true) in (joints | center | common).items()}


def test_everything_is_told_within_its_standard_deviation(found):
    assert found.determined and found.open == ()
    assert found.gravity == "nominal"
    off = np.array(list(deviations(found).values()))
    assert np.abs(off).max() < 4.5
    assert 0.3 < np.sqrt(np.mean(off**2)) < 1.7
    assert found.payload_mass.value == pytest.approx(2.0, rel=0.01)
    np.testing.assert_allclose([x.coulomb.value for x in found.joints], COULOMB, rtol=0.02)
    np.testing.assert_allclose([x.rms for x in found.joints], NOISE, rtol=0.15)


def test_the_identified_robot_is_an_arm_and_a_servo(found, nominal):
    chain = found.arm.chain
    np.testing.assert_allclose(chain.coulomb, COULOMB, rtol=0.02)
    np.testing.assert_allclose(chain.viscous, VISCOUS, rtol=0.3)
    assert chain.payload.mass == found.payload_mass.value
    np.testing.assert_allclose(chain.payload.center, [0.02, 0, 0.05], atol=2e-3)
    np.testing.assert_allclose(chain.armature, 0.1, rtol=0.05)
    servo = found.servo
    assert (servo.kv == 150.0).all()
    np.testing.assert_allclose(servo.kp, KP, rtol=5e-3)
    assert (servo.inertia == Drives(arm=nominal, servo=nominal_servo()).inertia).all()
    assert servo.dead_time == pytest.approx(6e-3, abs=1e-4)
    # The nominal arm is as it was.
    assert nominal.chain.payload is None and not np.any(nominal.chain.coulomb)


def test_derivatives_are_those_of_the_simulated_motion(log, nominal):
    """By central differences, at values that are neither nominal nor true."""
    short = log.between(0.0, 2.5)
    model = Model(
        arm=nominal, servo=nominal_servo().for_joints(6), keep_kv=True, gravity="nominal", lag=1e-4
    )
    values = np.array(model.nominal)
    names = [x.name for x in model.unknowns]
    for name, value in (("viscous", 3.0), ("payload_mass", 1.5), ("dead_time", 5e-3)):
        values[[x == name for x in names]] = value
    values[[x == "payload_center" for x in names]] = [0.02, -0.03, 0.05]
    grids = [Gridded.of(short, "linear", 0.3)]
    exact = derivatives(model, grids, attempt(model, grids, values))
    steps = {"payload_center": 1e-3, "dead_time": 1e-3, "payload_mass": 1e-2, "coulomb": None}
    for k, name in enumerate(names):
        step = steps.get(name, 1e-3)
        if step is None:
            continue
        shift = step * (np.arange(len(values)) == k)
        up, down = (attempt(model, grids, values + s * shift) for s in (1, -1))
        slope = (down.residuals[0] - up.residuals[0]) / (2 * step)
        assert np.abs(exact[:, :, k] - slope).max() < 0.02 * np.abs(slope).max(), name


def test_without_a_nominal_servo_friction_is_kept_and_gains_are_found(log, nominal):
    found = identify(log, arm=nominal, gravity="nominal")
    assert found.determined
    inertia = Drives(arm=nominal, servo=nominal_servo()).inertia
    damping = inertia * found.servo.kv
    np.testing.assert_allclose(damping, inertia * 150.0 + VISCOUS, rtol=0.01)
    np.testing.assert_allclose(damping * found.servo.kp, inertia * 150.0 * KP, rtol=0.01)
    assert not np.any(found.arm.chain.viscous)
    np.testing.assert_allclose([x.coulomb.value for x in found.joints], COULOMB, rtol=0.02)


def test_what_joints_at_rest_do_not_tell_stays_nominal(arm, nominal):
    servo = nominal_servo().replace(kp=KP)
    log = record(arm, servo, set_points(1, 3.0, joints=(0, 1, 2, 3, 4)), every=8)
    found = identify(log, arm=nominal, servo=nominal_servo(), gravity="loaded")
    assert not found.determined
    wrist = found.joints[5]
    assert wrist.kp.value == pytest.approx(25.0, rel=1e-12) and not wrist.kp.determined
    assert "not told to move" in wrist.kp.advice and "nominal value" in wrist.kp.advice
    assert "coulomb of wrist_3_joint" in found.open
    assert found.joints[0].kp.determined
    assert found.servo.kp[5] == pytest.approx(25.0, rel=1e-12)
    # The other joints shake it less than its friction: how strong that is, nobody knows.
    assert found.arm.chain.coulomb[5] == 0.0
    limits = nominal.limits.replace(joint_jerk=20.0)
    excitation = propose(found, limits=limits, duration=10.0)
    assert "coulomb of wrist_3_joint" in excitation.tells
    q, rates = excitation.taught.q, np.diff(excitation.taught.q, axis=0) / 4e-3
    assert np.abs(q[[0, -1]] - HOME).max() < 1e-9 and np.abs(rates[[0, -1]]).max() < 1e-3
    plan, t = excitation.taught.trajectory, excitation.taught.t
    np.testing.assert_allclose(plan(t[1:-1], 1), (q[2:] - q[:-2]) / 8e-3, atol=1e-3)
    second = np.diff(q, 2, axis=0) / 16e-6
    np.testing.assert_allclose(plan(t[1:-1], 2), second, atol=0.02)
    own = nominal.limits
    assert (np.abs(rates).max(axis=0) < own.joint_velocity).all()
    torque = found.arm.torque(plan(t), plan(t, 1), plan(t, 2))
    assert (np.abs(torque).max(axis=0) < own.joint_torque).all()
    third = np.abs(np.diff(q, 3, axis=0)).max(axis=0) / 4e-3**3
    assert third.max() < 20.0 and (third > 10.0).all()
    blind = dataclasses.replace(found, gains_known=False)
    with pytest.raises(InvalidInput, match="does not determine k"):
        _ = blind.servo


def test_logs_add_up(arm, nominal):
    servo = nominal_servo().replace(kp=KP)
    logs = [
        record(arm, servo, set_points(k, 3.0, joints=joints), every=8)
        for k, joints in ((2, (0, 1, 2)), (3, (3, 4, 5)))
    ]
    found = identify(logs, arm=nominal, servo=nominal_servo(), gravity="loaded")
    assert not [x for x in found.open if x.startswith(("kp", "coulomb"))]
    assert len(found.fitted) == 2


def changed(log, **changes):
    return dataclasses.replace(log, **changes)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: x.between(0, 1.0), "covers 1 s, but a robot can be told only from 2 s"),
        (lambda x: changed(x, t=x.t * 6), "a sample every 24 ms"),
        (
            lambda x: changed(
                x, command=x.command[:, :5], measured=x.measured[:, :5], joint_names=()
            ),
            "has 5 joints .*, but the arm UR5e has 6",
        ),
        (
            lambda x: changed(x, measured=np.degrees(x.measured), command=np.degrees(x.command)),
            "seems to be degrees",
        ),
        (
            lambda x: changed(x, measured=x.measured[:, [1, 0, 2, 3, 4, 5]]),
            "in the order joint 2, joint 1, joint 3",
        ),
        (
            lambda x: changed(
                x,
                command=x.command[:, [0, 1, 5, 3, 4, 2]],
                measured=x.measured[:, [0, 1, 5, 3, 4, 2]],
            ),
            "explains",
        ),
        (lambda x: changed(x, joint_names=tuple("abcde") + ("elbow_joint",)), "has a joint a, but"),
    ],
)
def test_logs_that_do_not_fit_the_arm_are_refused(log, nominal, change, message):
    with pytest.raises(InvalidInput, match=message) as raised:
        identify(change(log.between(0, 2.5)), arm=nominal, servo=nominal_servo(), gravity="nominal")
    assert "\n" not in str(raised.value)


def test_masses_are_needed(log):
    limits = ac.Limits(joint_velocity=[9.0, 9.0], joint_acceleration=[900.0, 900.0])
    rods = ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)
    two = changed(log, command=log.command[:, :2], measured=log.measured[:, :2], joint_names=())
    with pytest.raises(InvalidInput, match="masses of the arm rods are not known"):
        identify(two, arm=rods)


def test_joints_are_put_in_the_order_of_the_arm(log, nominal):
    from armcontour.identification.bodies.checking import arranged

    order = [3, 1, 5, 0, 2, 4]
    names = tuple(nominal.joint_names[k] for k in order)
    mixed = changed(
        log, command=log.command[:, order], measured=log.measured[:, order], joint_names=names
    )
    back = arranged(mixed, nominal)
    assert (back.measured == log.measured).all() and back.joint_names == nominal.joint_names


@pytest.mark.parametrize("name", ["servo", "gravity", "drive_cycle"])
def test_options_of_robots_need_an_arm(log, name):
    with pytest.raises(InvalidInput, match=f"{name} goes with an arm"):
        identify(log, **{name: {"servo": nominal_servo(), "gravity": "none"}.get(name, 1e-4)})


def test_at_rest_nothing_is_told(nominal):
    t = np.arange(0, 3.0, 8e-3)
    still = np.tile(HOME, (len(t), 1))
    noise = np.random.default_rng(0).normal(0, NOISE, still.shape)
    log = Log(t=t, command=still, measured=still + noise)
    found = identify(log, arm=nominal, servo=nominal_servo())
    assert not any(x.determined for joint in found.joints for x in joint.estimates)
    np.testing.assert_allclose(found.servo.kp, 25.0, rtol=1e-12)


@pytest.mark.parametrize("armature", [0.05, 0.0])
def test_a_planar_arm_without_gravity_tells_no_more_than_the_scale_allows(armature):
    """Without gravity and drive inertias, only ratios of torques are told: a gain stays nominal."""
    nominal = ac.load_arm("pmk3s").with_dynamics(armature=armature)
    home, kp = np.array([0.4, 1.2]), np.array([26.0, 24.0])
    coulomb = np.array([0.8, 0.4])
    true = nominal.with_dynamics(
        payload=ac.Payload(mass=1.0, center=[0.02, 0.01, 0.03]),
        coulomb=coulomb,
        viscous=[0.9, 0.5],
        armature=1.15 * armature if armature else [0.05, 0.03],
    )
    q = home + (set_points(3, 4.0) - HOME)[:, :2]
    log = record(true, nominal_servo().replace(kp=kp, dead_time=5e-3), q, known=nominal)
    found = identify(log, arm=nominal, servo=nominal_servo(), gravity="nominal")
    scale = 1.0 if armature else 25.0 / 26.0
    first = found.joints[0].kp
    assert first.determined == bool(armature)
    assert "payload_center_z" in found.open and found.payload_center[2].value == 0.0
    if not armature:
        assert first.value == pytest.approx(25.0, rel=1e-12)
        assert any("count what keeps its nominal value as true" in x for x in found.notes)
    ratios = np.array([x.coulomb.value for x in found.joints]) / (scale * coulomb)
    np.testing.assert_allclose(ratios, 1.0, rtol=0.15 if armature else 0.005)
    np.testing.assert_allclose(found.joints[1].kp.value / found.servo.kp[0], 24 / 26, rtol=5e-3)


def test_a_search_that_does_not_come_to_rest_determines_nothing(log, nominal, monkeypatch):
    monkeypatch.setattr("armcontour.identification.bodies.precision.REST", 1e-12)
    monkeypatch.setattr("armcontour.identification.bodies.identifying.FEW_LEFT_OUT", 0)
    monkeypatch.setattr("armcontour.identification.bodies.describing.EXPLAINS", -np.inf)
    found = identify(log.between(0, 2.1), arm=nominal, servo=nominal_servo(), gravity="nominal")
    assert not any(x.determined for joint in found.joints for x in joint.estimates)
    assert "did not come to rest" in found.joints[0].kp.advice
    np.testing.assert_allclose(found.servo.kp, 25.0, rtol=1e-12)
