"""Logs that are misread are refused with one sentence; nothing absurd is printed of any."""

import math

import numpy as np
import pytest
from soak.joint import move

from armcontour.errors import InvalidInput
from armcontour.identification import Log, identify

T = np.arange(1500) * 4e-3
# From place to place; one sine alone would fit a turned sign, with a slow loop that resonates.
PLACES = np.random.default_rng(5).uniform(-0.3, 0.3, (2, 9))
U = np.stack([np.interp(T, np.linspace(0.3, 5.5, 9), x) for x in PLACES], axis=1) + [0.5, -1.5]
Q = np.stack([move(T, u, kp=25.0, kv=150.0, delay=10e-3) for u in U.T], axis=1)
Q += 2e-5 * np.random.default_rng(1).normal(size=Q.shape)


@pytest.mark.parametrize(
    ("t", "measured", "words"),
    [
        (T, Q[:, ::-1], ("fit the joints in the order joint 2, joint 1",)),
        (T, Q * [1, -1], ("joint 2", "of joint 2 have opposite signs")),
        (T, Q * [-1, 1], ("joint 1", "of joint 1 have opposite signs")),
        (T * 1e-3, Q, ("rad/s", "no joint is faster than 100 rad/s", "units")),
    ],
    ids=["order", "sign", "sign with an offset", "seconds labelled ms"],
)
def test_misread_logs_are_refused(refuses, t, measured, words):
    log = Log(t=t, command=U, measured=measured, source="log.csv")
    refuses(lambda: identify(log), InvalidInput, "log.csv", *words)


def test_columns_that_do_not_belong_together_have_no_values():
    other = 0.2 * np.sin(np.outer(T, [5.1, 7.3]) ** 1.2)
    for joint in identify(Log(t=T, command=U, measured=other)).joints:
        for x in joint.estimates:
            assert math.isnan(x.value) and math.isnan(x.sd) and not x.determined
            assert "say nothing" in x.advice
            assert "would tell it" not in x.advice and "rad" not in x.advice
