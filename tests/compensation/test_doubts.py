"""Command intervals and gains that are probably mistaken: refused or warned of, once."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armcontour as ac
from armcontour.compensation import doubt_gains, doubt_interval

SERVO = ac.ServoModel(kp=25.0, kv=150.0)


def test_doubtful_intervals(conventional, arm, refuses):
    period = min(2 * conventional.duration, 10.0)
    call = lambda: ac.compensate(conventional, SERVO, period=period)  # noqa: E731
    refuses(call, ac.InvalidInput, "it is in seconds: for 10 ms give 0.01")
    with pytest.warns(UserWarning, match="The command interval of 0.5 s is longer than") as told:
        ac.compensate(conventional, SERVO, period=0.5, method="none")
    assert len(told) == 1 and told[0].filename == __file__
    assert not doubt_interval(0.1) and not doubt_interval(4e-3)
    # A tiny motion may be shorter than the interval.
    tiny = ac.plan(ac.Path.polyline([(0.35, 0.10), (0.35, 0.10000001)]), arm, arm.limits)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert tiny.duration < 4e-3 and len(ac.compensate(tiny, SERVO, period=4e-3).q)
        ac.compensate(conventional, SERVO, period=0.1)


def test_gains_without_damping_are_warned_of_with_their_values(conventional):
    exchanged = ac.ServoModel(kp=150.0, kv=25.0)
    with pytest.warns(UserWarning, match=r"kp = 150 1/s and kv = 25 1/s.* of 0.2:") as told:
        ac.compensate(conventional, exchanged, method="none")
    assert len(told) == 1
    (said,) = doubt_gains(ac.ServoModel(kp=[25.0, 150.0], kv=[150.0, 25.0]))
    assert said.startswith("the servo of joint 2 has") and "past a step by 52 % of it" in said
    # Half of critical damping is slow to settle, but usual; a lag of first order has none.
    assert not doubt_gains(ac.ServoModel(kp=25.0, order="first"))
    for kp, kv in ((25.0, 150.0), (50.0, 50.0), (500.0, 250.0)):
        assert not doubt_gains(ac.ServoModel(kp=kp, kv=kv))


def test_the_overshoot_that_is_told_is_that_of_the_model():
    kp, kv = 90.0, 20.0
    t = np.linspace(0, 1, 4001)
    motion = lambda _, x: [x[1], kv * (kp * (1 - x[0]) - x[1])]  # noqa: E731
    done = solve_ivp(motion, (0.0, 1.0), [0.0, 0.0], rtol=1e-9, atol=1e-9, t_eval=t)
    past = done.y[0].max() - 1
    assert f"past a step by {past * 100:.0f} %" in doubt_gains(ac.ServoModel(kp=kp, kv=kv))[0]
