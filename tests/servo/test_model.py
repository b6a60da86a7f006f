"""The servo model against SciPy, and what it refuses."""

import numpy as np
import pytest
from scipy import signal

import armcontour as ac

OMEGA = np.array([0.0, 1.0, 30.0, 500.0])


def test_response_is_5():
    for kp, kv in ((25.0, 150.0), (25.0, 100.0), (60.0, 40.0)):
        found = ac.ServoModel(kp=kp, kv=kv).response(1j * OMEGA)[:, 0]
        _, expected = signal.freqresp(([kp * kv], [1.0, kv, kp * kv]), OMEGA)
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    servo = ac.ServoModel(kp=[25.0, 10.0], kv=150.0).for_joints(2)
    # No static error.
    both = [(1, 1), (3750 / 4054, 1500 / 1804)]
    np.testing.assert_allclose(servo.response([0.0, 2.0]), both)


@pytest.mark.parametrize("tau", [0.0, 0.034])
def test_response_of_first_order_and_dead_time(tau):
    late = np.exp(-1j * OMEGA * tau)
    first = ac.ServoModel(kp=25.0, order="first", dead_time=tau)
    np.testing.assert_allclose(first.response(1j * OMEGA)[:, 0], late * 25 / (25 + 1j * OMEGA))
    second = ac.ServoModel(kp=25.0, kv=150.0, dead_time=[0.0, tau])
    prompt = ac.ServoModel(kp=25.0, kv=150.0).response(1j * OMEGA)[:, 0]
    both = np.stack([prompt, late * prompt], axis=1)
    np.testing.assert_allclose(second.response(1j * OMEGA), both)


def test_what_is_not_given_and_one_gain_for_all_joints():
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    assert servo.order == "second" and servo.interpolation == "linear" and servo.dead_time == 0
    first = ac.ServoModel(kp=25.0, order="first", dead_time=[0.01, 0.02]).for_joints(2)
    assert first.kv is None and first.order == "first"
    np.testing.assert_array_equal(first.dead_time, [0.01, 0.02])
    gains = np.array([25.0, 20.0])
    servo = ac.ServoModel(kp=25.0, kv=gains, interpolation="step").for_joints(2)
    gains[0] = 1.0
    np.testing.assert_array_equal([servo.kp, servo.kv], [(25.0, 25.0), (25.0, 20.0)])
    assert servo.interpolation == "step" and not servo.kv.flags.writeable


def test_refusals(refuses):
    both = {"kp": 25.0, "kv": 150.0}
    first = {"kp": 25.0, "order": "first"}
    for values, *words in (
        ({"kp": 25.0}, "kv"),
        (both | {"order": "first"}, "kv"),
        ({"kp": 25.0, "order": "third"}, "order"),
        *((both | {"dead_time": x}, "dead_time") for x in (-0.01, [0.1, -1], np.inf, 1e5, 1e308)),
        *((both | {"kp": x}, "kp") for x in (0.0, [25.0, 0.0], [], [[25.0]], np.nan, "high")),
        (both | {"kv": -1.0}, "kv", "-1.0"),
        *((both | {k: x}, k) for k in both for x in (1e300, 1e15, 1e9, 1e-12, 5e-324)),
        *((both | {"velocity_feedforward": x}, "velocity_feed") for x in (2.5, [1.0, -0.1])),
        (both | {"acceleration_feedforward": 1.0}, "give velocity_feedforward"),
        (first | {"acceleration_feedforward": 1.0}, "order first"),
        (both | {"interpolation": "step", "acceleration_feedforward": 1.0}, "held set-points"),
        (both | {"interpolation": "quintic"}, "interpolation"),
    ):
        refuses(lambda x=values: ac.ServoModel(**x), ac.InvalidInput, *words)
    servo = ac.ServoModel(kp=[25.0, 25.0], kv=150.0)
    refuses(lambda: servo.for_joints(3), ac.InvalidInput, "2 values", "3 joints")
    # Gains fit the command interval.
    servo = ac.ServoModel(kp=25.0, kv=1e6)
    servo.refuse_too_fast(1e-3)
    refuses(lambda: servo.refuse_too_fast(4e-3), ac.InvalidInput, "0.004 s", "250000 1/s")


def test_the_slowest_rate_is_that_of_the_servo_s_slowest_pole():
    for kp, kv in [(25.0, 150.0), (25.0, 100.0), (25.0, 40.0)]:
        slowest = -np.roots([1.0, kv, kp * kv]).real.max()
        np.testing.assert_allclose(ac.ServoModel(kp=kp, kv=kv).slowest, slowest, rtol=1e-6)
    assert ac.ServoModel(kp=[5.0, 7.0], order="first").slowest == 5.0
