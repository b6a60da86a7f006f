"""Command intervals and gains that are probably mistaken: refused or warned of, once."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import pytest

import armcontour as ac
from armcontour.compensation import doubt_gains, doubt_interval

SERVO = ac.ServoModel(kp=25.0, kv=150.0)


def test_milliseconds_given_for_seconds_are_refused(
    conventional: ac.Trajectory, refuses: Callable[..., None]
) -> None:
    period = 2 * conventional.duration
    refuses(
        lambda: ac.compensate(conventional, SERVO, period=min(period, 10.0)),
        ac.InvalidInput,
        "longer than the motion of",
        "it is in seconds: for 10 ms give 0.01, in a job `command_interval: 10 ms`.",
    )


def test_an_interval_that_no_controller_has_is_warned_of_once(conventional: ac.Trajectory) -> None:
    with pytest.warns(UserWarning, match="The command interval of 0.5 s is longer than") as told:
        ac.compensate(conventional, SERVO, period=0.5, method="none")
    assert len(told) == 1 and told[0].filename == __file__
    assert not doubt_interval(0.1) and not doubt_interval(4e-3)


def test_a_tiny_motion_may_be_shorter_than_the_interval(arm: ac.PlanarTwoLink) -> None:
    path = ac.Path.polyline([(0.35, 0.10), (0.35, 0.10000001)])
    tiny = ac.plan(path, arm, arm.limits)
    assert tiny.duration < 4e-3
    assert len(ac.compensate(tiny, SERVO, period=4e-3).q)


def test_gains_without_damping_are_warned_of_with_their_values(
    conventional: ac.Trajectory,
) -> None:
    exchanged = ac.ServoModel(kp=150.0, kv=25.0)
    with pytest.warns(UserWarning, match=r"kp = 150 1/s and kv = 25 1/s.* of 0.2:") as told:
        ac.compensate(conventional, exchanged, method="none")
    assert len(told) == 1
    (said,) = doubt_gains(ac.ServoModel(kp=[25.0, 150.0], kv=[150.0, 25.0]))
    assert said.startswith("the servo of joint 2 has") and "past a step by 52 % of it" in said
    # Half of critical damping is slow to settle, but usual; a lag of first order has none.
    for sound in (
        SERVO,
        ac.ServoModel(kp=50.0, kv=50.0),
        ac.ServoModel(kp=500.0, kv=250.0),
        ac.ServoModel(kp=25.0, order="first"),
    ):
        assert not doubt_gains(sound)


def test_the_overshoot_that_is_told_is_that_of_the_model() -> None:
    import numpy as np
    from scipy.integrate import solve_ivp

    kp, kv = 90.0, 20.0
    done = solve_ivp(
        lambda _, x: [x[1], kv * (kp * (1 - x[0]) - x[1])],
        (0.0, 1.0),
        [0.0, 0.0],
        rtol=1e-9,
        atol=1e-9,
        t_eval=np.linspace(0, 1, 4001),
    )
    past = done.y[0].max() - 1
    assert f"past a step by {past * 100:.0f} %" in doubt_gains(ac.ServoModel(kp=kp, kv=kv))[0]


def test_usual_values_give_no_warning(conventional: ac.Trajectory) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ac.compensate(conventional, SERVO, period=0.1)
