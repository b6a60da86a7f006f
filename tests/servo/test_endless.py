"""Motions whose time steps make no progress are refused, with the joint and its gains."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.servo._response import MOST_STEPS, Servo, progresses
from armcontour.servo._sensitivity import move_limited
from armcontour.servo.simulation import Simulation


def servo(kp: float, kv: float, interpolation: str = "linear") -> SimpleNamespace:
    """Gains that `ServoModel` refuses, of the second of two joints."""
    return SimpleNamespace(
        kp=np.array([25.0, kp]),
        kv=np.array([150.0, kv]),
        dead_time=np.zeros(2),
        interpolation=interpolation,
        has_feedforward=False,
    )


@pytest.mark.parametrize("gain", [1e13, 1e300])
@pytest.mark.parametrize("interpolation", ["linear", "step", "cubic"])
def test_a_joint_that_cannot_be_simulated_is_named(gain: float, interpolation: str) -> None:
    q = np.linspace(0.0, 1.0, 6).reshape(3, 2)
    with pytest.raises(ac.ExecutionError, match=r"Joint 2 cannot be simulated with kp = 1e\+"):
        Simulation(q, 4e-3, servo(gain, gain, interpolation))


def test_progress_is_steps_that_move_the_time_and_are_not_too_many() -> None:
    assert progresses(25.0, 150.0, 4e-3)
    assert not progresses(1e300, 1e300, 4e-3)
    # Steps of half a time constant, so that a span of more than MOST_STEPS of them is too long.
    assert progresses(100.0, 400.0, 0.9 * MOST_STEPS * 0.5 / 400.0)
    assert not progresses(100.0, 400.0, 1.1 * MOST_STEPS * 0.5 / 400.0)


def test_a_joint_of_a_log_that_cannot_be_simulated_has_no_demand() -> None:
    state, scratch, seen = np.zeros((2, 1)), np.zeros((3, 4)), np.zeros(2)
    servo = Servo(1e300, 1e300, -1e30, 1e30)
    move_limited(state, scratch, servo, 0.0, 1.0, np.zeros(8), 1.0, seen)
    assert math.isnan(state[0, 0]) and math.isnan(seen[0])


def test_numbers_that_are_none_end_too() -> None:
    state, scratch, seen = np.full((2, 1), math.nan), np.zeros((3, 4)), np.zeros(2)
    servo = Servo(25.0, 150.0, -1.0, 1.0)
    move_limited(state, scratch, servo, 0.0, 1.0, np.zeros(8), 1.0, seen)
    assert math.isnan(state[0, 0])
