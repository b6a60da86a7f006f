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
