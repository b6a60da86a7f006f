"""Logs that are misread or that tell nothing are refused, or determine nothing."""

import math

import numpy as np
from soak.identification import move

from armcontour.errors import InvalidInput
from armcontour.identification import Log, identify
from armcontour.io.servo_file import identification_json


def test_misread_logs_are_refused(refuses):
    t = np.arange(1500) * 4e-3
    # From place to place; one sine alone would fit a turned sign, with a slow loop that resonates.
    places = np.random.default_rng(5).uniform(-0.3, 0.3, (2, 9))
    u = np.stack([np.interp(t, np.linspace(0.3, 5.5, 9), x) for x in places], axis=1) + [0.5, -1.5]
    q = np.stack([move(t, x, kp=25.0, kv=150.0, delay=10e-3) for x in u.T], axis=1)
    q += 2e-5 * np.random.default_rng(1).normal(size=q.shape)
    for times, measured, words in (
        (t, q[:, ::-1], "fit the joints in the order joint 2, joint 1"),
        (t, q * [1, -1], "of joint 2 have opposite signs"),
        (t, q * [-1, 1], "of joint 1 have opposite signs"),
        (t * 1e-3, q, "no joint is faster than 100 rad/s"),  # seconds labelled ms
    ):
        log = Log(t=times, command=u, measured=measured, source="log.csv")
        refuses(lambda log=log: identify(log), InvalidInput, words)


def ramp(noise=0.0, digits=9):
    t, rate = np.arange(1001) * 0.004, np.array([0.1, 0.05])
    measured = (t[:, None] - 0.04) * rate
    measured = measured + noise * np.random.default_rng(3).standard_normal(measured.shape)
    command, measured = (np.round(x, digits) for x in (t[:, None] * rate, measured))
    return Log(t=t, command=command, measured=measured, source="ramp.csv")


def test_a_ramp_tells_only_how_late_the_joint_is():
    for log in (ramp(), ramp(1e-5, 6)):
        found = identify(log)
        assert not found.determined
        for joint in found.joints:
            for x in joint.estimates:
                assert not x.determined and math.isnan(x.value) and "40 ms late" in x.advice
            assert joint.rms < 2e-5
        assert "Infinity" not in identification_json(found)
