"""A servo model contains the largest motion of its logs."""

import numpy as np
from tests.control.identification.test_judgement import T, program

import armcontour as ac
from armcontour.robot.servo.simulation import JointServo, LoggedCommand, follow

SERVO = JointServo(kp=25.0, kv=150.0, dead_time=6e-3)


def followed(command):
    """Return the positions of joints that follow their commands, (n, joints)."""
    joints = [follow(LoggedCommand(T, u.copy(), "linear"), SERVO, u[0], 0.0) for u in command.T]
    return np.stack([x.ravel() for x in joints], 1)


def test_a_servo_contains_the_largest_velocity_of_its_logs():
    logs = [ac.Log(t=T, command=program(k), measured=program(k)) for k in (1, 2)]
    rates = np.max([np.abs(np.gradient(x.command, T, axis=0)).max(axis=0) for x in logs], axis=0)
    moved = [followed(x.command) for x in logs]
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
