"""Commands that lead the plan, a servo of first order, and what a controller takes."""

from functools import partial
from itertools import product

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import Law

DURATION = 0.6


class Smooth(Law):
    """A swing with velocity, acceleration and jerk 0 at both ends."""

    breaks = np.array([0.0, DURATION])

    def on_interval(self, i, t, order):
        x = t / DURATION
        s = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20]).deriv(order)(x)
        start = np.array([0.3, -0.2]) if order == 0 else 0.0
        return start + s[:, None] / DURATION**order * np.array([0.5, -0.8])


SWING = ac.Trajectory(laws=(Smooth(),), method="hand")
DEAD_TIMES = (0.0, 0.04, 0.0345, [0.0115, 0.087], 1.001)  # the last is longer than the motion


def gains(order):
    return {"kp": [25.0, 40.0], "kv": [150.0, 90.0] if order == "second" else None, "order": order}


def off(arm, servo, period, method="inverse", plant=None, **options):
    """Largest distance of a joint from the plan that it shall follow, at any time."""
    taught = ac.compensate(SWING, servo, method=method, period=period, **options)
    done = ac.execute(taught, ac.ServoPlant(arm, plant or servo, ac.Limits()), resolution=1e-3)
    assert done.t[0] == taught.start_time == taught.t[0]
    return np.abs(done.q - SWING(done.t.clip(0, DURATION))).max()


def test_the_joint_does_at_t_what_the_plan_says_at_t(arm):
    left = {"linear": 3e-5, "cubic": 2e-5, "step": 2e-4}
    for order, interpolation, dead in product(("second", "first"), left, DEAD_TIMES):
        servo = ac.ServoModel(**gains(order), interpolation=interpolation, dead_time=dead)
        errors = [off(arm, servo, period) for period in (4e-3, 2e-3)]
        # What is left is interpolation: of second order in the period or better, but for the ripple
        # of held set-points, which a servo of first order passes on.
        assert errors[0] < left[interpolation], servo
        assert errors[0] / errors[1] > 3, servo


def test_without_the_lead_a_joint_is_late_by_the_dead_time(arm):
    late = ac.ServoModel(**gains("second"), dead_time=0.05)
    prompt = ac.ServoModel(**gains("second"))
    speed = np.abs(SWING(np.linspace(0, DURATION, 1001), 1)).max()
    assert off(arm, prompt, 1e-3, plant=late) == pytest.approx(0.05 * speed, rel=0.02)
    assert off(arm, late, 1e-3) < 2e-6


def test_a_held_set_point_is_led_by_half_an_interval(arm):
    held = ac.ServoModel(**gains("second"), interpolation="step")
    drawn = ac.ServoModel(**gains("second"))
    speed = np.abs(SWING(np.linspace(0, DURATION, 1001), 1)).max()
    assert off(arm, drawn, 4e-3, plant=held) == pytest.approx(2e-3 * speed, rel=0.03)
    assert off(arm, held, 4e-3) < 0.02 * 2e-3 * speed


def test_it_holds_before_and_after():
    servo = ac.ServoModel(**gains("second"), dead_time=[0.01, 0.035])
    taught = ac.compensate(SWING, servo, method="inverse", period=0.01)
    assert taught.start_time == pytest.approx(-0.04)
    assert 0.0 in taught.t  # the plan begins at a set-point
    t = taught.t[:, None] + servo.dead_time
    # A set-point is a mean over the interval about its time.
    before, after = t <= -0.005, t >= DURATION + 0.005
    np.testing.assert_array_equal(taught.q[before[:, 0], 0], 0.3)
    np.testing.assert_array_equal(taught.q[before[:, 1], 1], -0.2)
    for j in range(2):
        np.testing.assert_array_equal(taught.q[after[:, j], j], SWING(DURATION)[j])
    at = t.clip(0, DURATION)
    for j in range(2):
        q, dq, ddq = (SWING(at[:, j], order)[:, j] for order in (0, 1, 2))
        u = q + dq / servo.kp[j] + ddq / (servo.kp[j] * servo.kv[j])
        np.testing.assert_allclose(taught.q[:, j], u, atol=3e-4)
    assert taught.t[-2] < DURATION + 0.005 - servo.dead_time.min() <= taught.t[-1] + 1e-12


def test_pole_placement_leads_too(arm):
    prompt = ac.ServoModel(**gains("second"))
    for dead, poles in product((0.04, 0.0345, [0.0115, 0.087]), (None, [-75.0, -75.0, -75.0])):
        done = []
        for servo in (prompt, prompt.replace(dead_time=dead)):
            how = {"method": "pole_placement", "poles": poles}
            taught = ac.compensate(SWING, servo, period=1e-3, **how)
            done.append(ac.execute(taught, ac.ServoPlant(arm, servo, ac.Limits()), resolution=1e-3))
        first, second = (x.q[np.searchsorted(x.t, 0.0) :][:600] for x in done)
        np.testing.assert_allclose(first, second, atol=1e-6)


def test_none_leads_nothing():
    servo = ac.ServoModel(**gains("second"), dead_time=0.05, interpolation="step")
    taught = ac.compensate(SWING, servo, method="none", period=0.01)
    assert taught.start_time == 0.0
    np.testing.assert_allclose(taught.q, SWING(taught.t.clip(0, DURATION)), atol=1e-14)


def test_first_order_in_closed_form():
    servo = ac.ServoModel(kp=[25.0, 40.0], order="first")
    taught = ac.compensate(SWING, servo, method="inverse", period=2.5e-3)
    inside = (taught.t > 0.035) & (taught.t < DURATION - 0.035)
    t = taught.t[inside]
    u, bend = (SWING(t, k) + SWING(t, k + 1) / servo.kp for k in (0, 2))
    # Lines between points of a curve are beside it by u'' T² / 12 on average.
    expected = u - bend * 2.5e-3**2 / 12
    np.testing.assert_allclose(taught.q[inside], expected, atol=3e-7)
    assert np.abs(taught.q[inside] - u).max() > 5e-6


def test_a_command_beyond_the_limits_is_refused(refuses):
    # The plan itself is within them: it ends at 0.8 and -1.0, and moves at 1.82 and 2.92 rad/s.
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=0.02)
    loose = {"joint_lower": [-2.0, -2.0], "joint_upper": [2.0, 2.0], "joint_velocity": [20.0, 20.0]}
    taught = ac.compensate(SWING, servo, method="inverse", limits=ac.Limits(**loose))
    rates = np.abs(np.diff(taught.q, axis=0)) / 4e-3
    for limit, values, j in (
        ("joint_upper", [0.8, 2.0], 0),
        ("joint_lower", [-2.0, -1.0], 1),
        ("joint_velocity", [1.85, 20.0], 0),
        ("joint_velocity", [20.0, 3.0], 1),
    ):
        limits = ac.Limits(**(loose | {limit: values}))
        fast = limit == "joint_velocity"
        k = int(np.argmax(rates[:, j] if fast else np.abs(taught.q[:, j])))
        data = {"t": taught.t[k], "needed": rates[k, j] if fast else taught.q[k, j]}
        data |= {"joint": j + 1, "limit": limit, "allowed": values[j]}
        call = partial(ac.compensate, SWING, servo, method="inverse", limits=limits)
        refuses(call, ac.CompensationError, f"joint {j + 1}", limit, **data)
        ac.compensate(SWING, servo, method="none", limits=limits)
    # One limit serves all joints.
    ac.compensate(SWING, servo, method="inverse", limits=ac.Limits(joint_velocity=20.0))
