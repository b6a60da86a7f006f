"""Loops over time that come to no end give up, and their callers say so."""

from __future__ import annotations

import math

import numpy as np
import pytest

import armcontour as ac
from armcontour.execution._pieces import advance_first_order, advance_under_cubic
from armcontour.execution._servo import advance_joint
from armcontour.execution.servo_run import Part, refuse_endless
from armcontour.identification._joint import _limited
from armcontour.study._spread import _saturating

# An acceleration limit that is not reached.
FAR = 1e30
LARGE = pytest.mark.parametrize("gain", [1e9, 1e300])


@LARGE
def test_a_joint_of_second_order_gives_up(gain):
    assert math.isnan(advance_joint(gain, gain, -FAR, FAR, 0.0, 1.0, 0.0, 0.0, 1.0)[0])
    assert math.isnan(_saturating(gain, gain, -FAR, FAR, 0.0, 1.0, 0.0, 0.0, 1.0)[0])


@LARGE
def test_a_joint_under_a_bent_command_gives_up(gain):
    command = np.array([0.0, 1.0, 1.0, 1.0])
    assert math.isnan(advance_under_cubic(gain, gain, -FAR, FAR, command, 0.0, 0.0, 1.0)[0])


@LARGE
def test_a_joint_of_first_order_gives_up(gain):
    assert math.isnan(advance_first_order(gain, np.array([0.0, 1.0, 1.0, 1.0]), 0.0, 1.0)[0])


@LARGE
def test_a_joint_of_a_log_gives_up(gain):
    state, scratch, seen = np.zeros((2, 1)), np.zeros((3, 4)), np.zeros(2)
    _limited(state, 1, scratch, gain, gain, FAR, 0.0, 1.0, 1.0, seen)
    assert math.isnan(state[0, 0])


def test_the_sentence_names_the_joint_the_time_and_its_gains():
    q, other = np.zeros((3, 2)), np.zeros((3, 2))
    q[1:, 1] = math.nan
    part = Part(q, other, other, other, np.zeros(2), np.zeros((2, 2)))
    servo = ac.ServoModel(kp=[25.0, 26.0], kv=[150.0, 160.0])
    with pytest.raises(ac.ExecutionError, match=r"joint 2 .* t = 1\.5 s .* 26 1/s and kv = 160"):
        refuse_endless(part, servo, 1.0, 0.5)
