"""The servo model against SciPy, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

import armcontour as ac


@pytest.mark.parametrize(("kp", "kv"), [(25.0, 150.0), (25.0, 100.0), (60.0, 40.0)])
def test_response_is_5(kp, kv):
    servo = ac.ServoModel(kp=kp, kv=kv)
    omega = np.array([0.0, 1.0, 30.0, 500.0])
    _, expected = signal.freqresp(([kp * kv], [1.0, kv, kp * kv]), omega)
    np.testing.assert_allclose(servo.response(1j * omega)[:, 0], expected, rtol=1e-12)


def test_response_of_every_joint():
    servo = ac.ServoModel(kp=[25.0, 10.0], kv=150.0).for_joints(2)
    found = servo.response([0.0, 2.0])
    assert found.shape == (2, 2)
    np.testing.assert_allclose(found[0], [1, 1])  # no static error
    np.testing.assert_allclose(found[1], [3750 / 4054, 1500 / 1804])


@pytest.mark.parametrize("tau", [0.0, 0.034])
def test_response_of_first_order_and_dead_time(tau):
    omega = np.array([0.0, 1.0, 30.0, 500.0])
    late = np.exp(-1j * omega * tau)
    first = ac.ServoModel(kp=25.0, order="first", dead_time=tau)
    np.testing.assert_allclose(first.response(1j * omega)[:, 0], late * 25 / (25 + 1j * omega))
    second = ac.ServoModel(kp=25.0, kv=150.0, dead_time=[0.0, tau])
    prompt = ac.ServoModel(kp=25.0, kv=150.0).response(1j * omega)[:, 0]
    np.testing.assert_allclose(
        second.response(1j * omega), np.stack([prompt, late * prompt], axis=1)
    )


def test_what_is_not_given():
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    assert servo.order == "second" and servo.interpolation == "linear" and servo.dead_time == 0
    first = ac.ServoModel(kp=25.0, order="first", dead_time=[0.01, 0.02]).for_joints(2)
    assert first.kv is None and first.order == "first"
    np.testing.assert_array_equal(first.dead_time, [0.01, 0.02])


def test_one_gain_serves_all_joints():
    servo = ac.ServoModel(kp=25.0, kv=[150.0, 100.0], interpolation="step").for_joints(2)
    np.testing.assert_array_equal(servo.kp, [25.0, 25.0])
    np.testing.assert_array_equal(servo.kv, [150.0, 100.0])
    assert servo.interpolation == "step"


def test_gains_are_copied_and_locked():
    gains = np.array([25.0, 20.0])
    servo = ac.ServoModel(kp=gains, kv=150.0)
    gains[0] = 1.0
    assert servo.kp[0] == 25.0
    with pytest.raises(ValueError, match="read-only"):
        servo.kp[0] = 1.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"kp": 25.0}, ("order second", "kv", "1/s")),
        ({"kp": 25.0, "kv": 150.0, "order": "first"}, ("order first", "leave its gain kv out")),
        ({"kp": 25.0, "order": "third"}, ("order", "second, first", "'third'")),
        ({"kp": 25.0, "kv": 150.0, "dead_time": -0.01}, ("dead_time", "not be negative", "s")),
        ({"kp": 25.0, "kv": 150.0, "dead_time": [0.1, -1]}, ("dead_time", "[0.1, -1.0]")),
        ({"kp": 25.0, "kv": 150.0, "dead_time": np.inf}, ("dead_time", "finite")),
        ({"kp": 0.0, "kv": 150.0}, ("kp", "above zero", "0.0 1/s")),
        ({"kp": 25.0, "kv": -1.0}, ("kv", "above zero", "-1.0")),
        ({"kp": [25.0, 0.0], "kv": 150.0}, ("kp", "[25.0, 0.0]")),
        ({"kp": [], "kv": 150.0}, ("kp", "one for all joints or one per joint")),
        ({"kp": [[25.0]], "kv": 150.0}, ("kp", "one per joint")),
        ({"kp": np.nan, "kv": 150.0}, ("kp", "finite")),
        ({"kp": "high", "kv": 150.0}, ("kp", "numbers in 1/s")),
        (
            {"kp": 25.0, "kv": 150.0, "velocity_feedforward": 2.5},
            ("velocity_feedforward", "from 0 to 2", "2.5"),
        ),
        (
            {"kp": 25.0, "kv": 150.0, "velocity_feedforward": [1.0, -0.1]},
            ("velocity_feedforward", "from 0 to 2", "-0.1"),
        ),
        (
            {"kp": 25.0, "kv": 150.0, "acceleration_feedforward": 1.0},
            ("acceleration_feedforward", "give velocity_feedforward"),
        ),
        (
            {"kp": 25.0, "order": "first", "acceleration_feedforward": 1.0},
            ("order first", "leave acceleration_feedforward out"),
        ),
        (
            {"kp": 25.0, "kv": 9.0, "interpolation": "step", "acceleration_feedforward": 1.0},
            ("held set-points", "leave acceleration_feedforward out"),
        ),
        (
            {"kp": 25.0, "kv": 150.0, "interpolation": "quintic"},
            ("interpolation", "linear, step, cubic", "'quintic'"),
        ),
    ],
)
def test_refused(values, words, refuses):
    refuses(lambda: ac.ServoModel(**values), ac.InvalidInput, *words)


def test_wrong_number_of_joints_is_refused(refuses):
    servo = ac.ServoModel(kp=[25.0, 25.0], kv=150.0)
    refuses(lambda: servo.for_joints(3), ac.InvalidInput, "servo gain kp has 2 values", "3 joints")


@pytest.mark.parametrize("kv", [1e300, 1e15, 1e9, 1e-12, 5e-324])
def test_gains_that_no_robot_has_are_refused(kv: float) -> None:
    with pytest.raises(
        ac.InvalidInput, match=r"servo gain kv must be (from 0\.001 to 1e\+06|between)"
    ):
        ac.ServoModel(kp=25.0, kv=kv)
    with pytest.raises(ac.InvalidInput, match="servo gain kp must be"):
        ac.ServoModel(kp=kv, kv=150.0)


@pytest.mark.parametrize("late", [1e5, 1e6, 1e9, 1e300, 1e308])
def test_dead_time_of_more_than_a_minute_is_refused(late: float) -> None:
    with pytest.raises(ac.InvalidInput, match="dead_time must be"):
        ac.ServoModel(kp=25.0, kv=150.0, dead_time=late)


def test_gains_fit_the_command_interval() -> None:
    servo = ac.ServoModel(kp=25.0, kv=1e6)
    servo.refuse_too_fast(1e-3)
    with pytest.raises(
        ac.InvalidInput, match=r"4e\+03 time constants in .* of 0\.004 s.* 250000 1/s"
    ):
        servo.refuse_too_fast(4e-3)


def test_the_slowest_rate_is_that_of_the_servo_s_slowest_pole() -> None:
    for kp, kv in [(25.0, 150.0), (25.0, 100.0), (25.0, 40.0)]:
        poles = np.roots([1.0, kv, kp * kv])
        np.testing.assert_allclose(
            ac.ServoModel(kp=kp, kv=kv).slowest, -poles.real.max(), rtol=1e-6
        )
    assert ac.ServoModel(kp=[5.0, 7.0], order="first").slowest == 5.0
