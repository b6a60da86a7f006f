"""Each joint with a weak model or none says what its residual looks like, and what to record."""

import numpy as np
import pytest
from tests.control.identification.test_judgement import T, program

import armcontour as ac
from armcontour.control.identification.residuals import describe_residuals, scale_residuals
from armcontour.robot.servo.simulation import JointServo, LoggedCommand, follow

SERVO = JointServo(kp=25.0, kv=150.0, dead_time=6e-3)


def gravity(u, q):
    return 0.05 * np.cos(4 * u[:, 1])


def coupling(u, q):
    return 2e-5 * np.gradient(np.gradient(u[:, 0], T), T)


def vibration(u, q):
    return 3e-3 * np.sin(2 * np.pi * 30.0 * T + 4 * np.sin(0.9 * T))


@pytest.mark.parametrize(
    ("disturbance", "words", "record"),
    [
        (gravity, "depends on the position", "half its speed"),
        (coupling, "depends on the motion of joint 1", "this joint rests"),
        (vibration, "is mostly above ", "sampled at 1 kHz"),
    ],
)
def test_a_pattern_is_named_with_what_to_record(disturbance, words, record):
    u = program(3) * 3
    q = np.stack(
        [follow(LoggedCommand(T, x.copy(), "linear"), SERVO, x[0], 0.0).ravel() for x in u.T], 1
    )
    residual = disturbance(u, q)
    lag = np.std((q - u)[:, 1])
    q[:, 1] += residual * 0.6 * lag / np.std(residual)
    fit = ac.identify(ac.Log(t=T, command=u, measured=q), ac.ServoFit(model="second"))
    one, two = fit.joints
    assert not one.note
    assert words in two.note and record in two.note


def test_sign_and_phase_of_velocity_are_distinguished():
    u = program(3)
    log = ac.Log(t=T, command=u, measured=u)
    rate = np.gradient(u[:, 0], T)
    noise = np.std(rate) * np.random.default_rng(0).normal(size=len(T))
    assert "in phase with the velocity" in describe_residuals([log], 0, [1e-3 * (rate + noise)])
    assert "sign of the velocity" in describe_residuals([log], 0, [np.sign(rate)])
    assert "no known pattern" in describe_residuals([log], 0, [np.roll(u[:, 1], 500) ** 3])
    rest = np.where(T > 1.0, np.sign(rate), np.nan)
    assert "sign of the velocity" in describe_residuals([log], 0, [rest])


def test_residuals_scale_with_velocity_and_acceleration():
    u = program(3)
    log = ac.Log(t=T, command=u, measured=u)
    rate = np.gradient(u[:, 0], T)
    parts = 1e-5, 2e-4 * rate, 3e-5 * np.gradient(rate, T)
    random = np.random.default_rng(1).normal(size=(3, len(T)))
    rest = sum(x * y for x, y in zip(parts, random, strict=True))
    np.testing.assert_allclose(scale_residuals([log], 0, [rest]), [1e-5, 2e-4, 3e-5], rtol=0.35)


def test_a_servo_states_the_motion_of_its_logs():
    logs = [ac.Log(t=T, command=program(k), measured=program(k)) for k in (1, 2)]
    rates = np.max([np.abs(np.gradient(x.command, T, axis=0)).max(axis=0) for x in logs], axis=0)
    moved = [
        np.stack(
            [follow(LoggedCommand(T, u.copy(), "linear"), SERVO, u[0], 0.0).ravel() for u in x.T], 1
        )
        for x in (y.command for y in logs)
    ]
    fit = ac.identify(
        [ac.Log(t=T, command=x.command, measured=q) for x, q in zip(logs, moved, strict=True)]
    )
    servo = fit.servo_model()
    np.testing.assert_allclose(servo.logged_velocity, rates, rtol=0.05)
    slower = 0.5 * servo.logged_acceleration[None]
    assert not servo.describe_excess(rates[None], slower)
    assert "joint 2" in servo.describe_excess(rates[None] * [1, 1.5], slower)
    # At a nearly uniform velocity, a joint errs otherwise than in a multisine.
    assert servo.is_similar(rates[None], slower) and not servo.is_similar(rates[None], slower / 10)
    assert "reverses" in servo.describe_excess(rates[None], slower / 10)
    assert "acceleration" in servo.describe_excess(rates[None], 1e3 + 0 * rates[None])
