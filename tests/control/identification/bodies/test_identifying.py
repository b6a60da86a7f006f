"""Payload, friction, drives and dead time from logs of a robot in MuJoCo."""

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour import identify_bodies
from armcontour.control.identification.bodies.body_model import RobotUnknowns
from armcontour.control.identification.bodies.log_grid import LogGrid
from armcontour.control.identification.bodies.output_error import (
    position_derivatives,
    simulate_logs,
)
from armcontour.core.errors import InvalidInput
from armcontour.motion import Log
from armcontour.motion.log_checks import arrange_joints
from armcontour.robot.drives import Drives

from .robots import (
    COULOMB,
    HOME,
    KP,
    LOADED,
    NOISE,
    NOMINAL,
    VISCOUS,
    nominal_arm,
    nominal_servo,
    planar,
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
    """Four seconds at 250 Hz; the controller does not know of the payload."""
    servo = nominal_servo().replace(kp=KP, dead_time=6e-3)
    return record(arm, servo, set_points(0, 4.0), controller=nominal)


@pytest.fixture(scope="module")
def identification(log, nominal):
    return identify_bodies(log, nominal, nominal_servo())


def deviations(identification):
    """True values less estimates, in standard deviations, by names."""
    joints = {
        f"{name} {j}": (getattr(joint, name), true[j])
        for name, true in (("kp", KP), ("viscous", VISCOUS), ("coulomb", COULOMB))
        for j, joint in enumerate(identification.joints)
    }
    center = {
        f"center {i}": (x, [0.02, 0.0, 0.05][i])
        for i, x in enumerate(identification.payload_center)
    }
    common = {
        "mass": (identification.payload_mass, 2.0),
        "armature": (identification.armature, 1.0),
        "dead time": (identification.dead_time, 6e-3),
    }
    return {k: (true - x.value) / x.sd for k, (x, true) in (joints | center | common).items()}


def test_the_identified_robot_is_within_its_standard_deviations(identification, nominal):
    assert identification.determined and identification.open == ()
    assert identification.gravity == "nominal"
    deviations_in_sigma = np.array(list(deviations(identification).values()))
    assert np.abs(deviations_in_sigma).max() < 4.5
    assert 0.3 < np.sqrt(np.mean(deviations_in_sigma**2)) < 1.7
    assert identification.payload_mass.value == pytest.approx(2.0, rel=0.01)
    np.testing.assert_allclose([x.coulomb.value for x in identification.joints], COULOMB, rtol=0.02)
    np.testing.assert_allclose([x.rms for x in identification.joints], NOISE, rtol=0.15)
    chain = identification.arm.chain
    np.testing.assert_allclose(chain.coulomb, COULOMB, rtol=0.02)
    np.testing.assert_allclose(chain.viscous, VISCOUS, rtol=0.3)
    assert chain.payload.mass == identification.payload_mass.value
    np.testing.assert_allclose(chain.payload.center, [0.02, 0, 0.05], atol=2e-3)
    np.testing.assert_allclose(chain.armature, 0.1, rtol=0.05)
    servo = identification.servo_model()
    assert (servo.kv == 150.0).all()
    np.testing.assert_allclose(servo.kp, KP, rtol=5e-3)
    assert (servo.inertia == Drives(arm=nominal, servo=nominal_servo()).inertia).all()
    assert servo.dead_time == pytest.approx(6e-3, abs=1e-4)
    # The nominal arm is as it was.
    assert nominal.chain.payload is None and not np.any(nominal.chain.coulomb)


def test_derivatives_are_those_of_the_simulated_motion(log, nominal):
    """By central differences, at values that are neither nominal nor true."""
    short = log.between(0.0, 2.5)
    model = RobotUnknowns(
        arm=nominal, servo=nominal_servo().for_joints(6), fixed_kv=True, gravity="nominal", lag=1e-4
    )
    values = np.array(model.nominal)
    names = model.names
    for name, value in (("viscous", 3.0), ("payload_mass", 1.5), ("dead_time", 5e-3)):
        values[names == name] = value
    for axis, value in zip("xyz", (0.02, -0.03, 0.05), strict=True):
        values[names == f"payload_center_{axis}"] = value
    grids = [LogGrid.from_log(short, "linear", 0.3)]
    exact = position_derivatives(model, grids, simulate_logs(model, grids, values))
    steps = {"dead_time": 1e-3, "payload_mass": 1e-2, "coulomb": None}
    for k, name in enumerate(names):
        step = steps.get(name, 1e-3)
        if step is None:
            continue
        shift = step * (np.arange(len(values)) == k)
        up, down = (simulate_logs(model, grids, values + s * shift) for s in (1, -1))
        slope = (down.residuals[0] - up.residuals[0]) / (2 * step)
        assert np.abs(exact[:, :, k] - slope).max() < 0.02 * np.abs(slope).max(), name


def test_without_a_nominal_servo_friction_is_kept_and_gains_are_found(log, nominal):
    fit = identify_bodies(log, nominal, options=NOMINAL)
    assert fit.determined
    inertia = Drives(arm=nominal, servo=nominal_servo()).inertia
    damping = inertia * fit.servo_model().kv
    np.testing.assert_allclose(damping, inertia * 150.0 + VISCOUS, rtol=0.01)
    np.testing.assert_allclose(damping * fit.servo_model().kp, inertia * 150.0 * KP, rtol=0.01)
    assert not np.any(fit.arm.chain.viscous)
    np.testing.assert_allclose([x.coulomb.value for x in fit.joints], COULOMB, rtol=0.02)


def test_parameters_of_joints_at_rest_stay_nominal(arm, nominal):
    servo = nominal_servo().replace(kp=KP)
    log = record(arm, servo, set_points(1, 2.2, joints=(0, 1, 2, 3, 4)), every=8)
    fit = identify_bodies(log, nominal, nominal_servo(), LOADED)
    assert not fit.determined
    wrist = fit.joints[5]
    assert wrist.kp.value == pytest.approx(25.0, rel=1e-12) and not wrist.kp.determined
    assert "coulomb of wrist_3_joint" in fit.open
    assert fit.joints[0].kp.determined
    assert fit.servo_model().kp[5] == pytest.approx(25.0, rel=1e-12)
    # The other joints shake it less than its friction: how strong that is, nobody knows.
    assert fit.arm.chain.coulomb[5] == 0.0
    blind = dataclasses.replace(fit, gains_known=False)
    with pytest.raises(InvalidInput, match="does not determine k"):
        blind.servo_model()


def changed(log, **changes):
    return dataclasses.replace(log, **changes)


def of_joints(log, columns, names=()):
    columns_kept = {"command": log.command[:, columns], "measured": log.measured[:, columns]}
    return changed(log, joint_names=names, **columns_kept)


def test_logs_that_do_not_fit_the_arm_are_refused(log, nominal):
    log = log.between(0, 2.1)
    limits = ac.Limits(joint_velocity=[9.0, 9.0], joint_acceleration=[900.0, 900.0])
    rods = ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)
    for wrong, arm, message in (
        (log.between(0, 1.0), nominal, "covers 1 s, but identification needs at least 2 s"),
        (changed(log, t=log.t * 6), nominal, "a sample every 24 ms"),
        (of_joints(log, range(5)), nominal, "has 5 joints .*, but the arm has 6"),
        (
            changed(log, measured=np.degrees(log.measured), command=np.degrees(log.command)),
            nominal,
            "in degrees. If they are",
        ),
        (
            changed(log, measured=log.measured[:, [1, 0, 2, 3, 4, 5]]),
            nominal,
            "in the order joint 2, joint 1, joint 3",
        ),
        (
            changed(log, joint_names=(*"abcde", "elbow_joint")),
            nominal,
            "Name the joints in the file",
        ),
        (of_joints(log, range(2)), rods, "masses of the arm rods are not known"),
    ):
        with pytest.raises(InvalidInput, match=message):
            identify_bodies(wrong, arm, nominal_servo(), NOMINAL)
    cascade = nominal_servo().replace(ki=5.0)
    with pytest.raises(InvalidInput, match="without integrator"):
        identify_bodies(log, nominal, cascade, NOMINAL)


def test_joints_are_put_in_the_order_of_the_arm(log, nominal):
    order = [3, 1, 5, 0, 2, 4]
    mixed = of_joints(log, order, tuple(nominal.joint_names[k] for k in order))
    back = arrange_joints(mixed, nominal.joint_names)
    assert (back.measured == log.measured).all() and back.joint_names == nominal.joint_names
    # Also by names with a prefix, without joints that the arm does not have.
    mixed = of_joints(log, order, tuple(f"left_{nominal.joint_names[k]}" for k in order))
    back = arrange_joints(mixed, nominal.joint_names[:5])
    assert (back.measured == log.measured[:, :5]).all() and "wrist_3" in back.notes[-1]
    # Numbers are no names: some programs count from 0.
    numbered = of_joints(log, range(6), tuple(f"joint {k}" for k in range(6)))
    assert arrange_joints(numbered, [f"joint {k}" for k in range(1, 7)]) is numbered


def test_logs_at_rest_determine_nothing(nominal):
    t = np.arange(0, 3.0, 8e-3)
    still = np.tile(HOME, (len(t), 1))
    noise = np.random.default_rng(0).normal(0, NOISE, still.shape)
    log = Log(t=t, command=still, measured=still + noise)
    fit = identify_bodies(log, nominal, nominal_servo())
    assert not any(x.determined for joint in fit.joints for x in joint.estimates)
    np.testing.assert_allclose(fit.servo_model().kp, 25.0, rtol=1e-12)


def test_a_planar_arm_without_gravity_determines_parameters_up_to_a_scale():
    """Without gravity and drive inertias, only ratios of torques are told: a gain stays nominal."""
    fit, coulomb = planar(0.0)
    first = fit.joints[0].kp
    assert not first.determined and first.value == pytest.approx(25.0, rel=1e-12)
    ratios = np.array([x.coulomb.value for x in fit.joints]) * 26.0 / 25.0 / coulomb
    np.testing.assert_allclose(ratios, 1.0, rtol=0.005)
    assert "payload_center_z" in fit.open and fit.payload_center[2].value == 0.0
    np.testing.assert_allclose(fit.joints[1].kp.value / fit.servo_model().kp[0], 24 / 26, rtol=5e-3)
