"""Estimates from logs whose residuals depend on each other."""

import numpy as np
from soak.identification import move, multisine

import armcontour as ac
from armcontour.control.identification import Log, identify

TRUTH = {"kp": 25.0, "kv": 150.0, "delay": 12.3e-3}


def test_noise_that_is_not_white_widens_the_intervals():
    t = np.arange(6000) * 1e-3
    u = 2e-2 * multisine(t, 25.0, 1)
    q = move(t, u, **TRUTH)
    deviations = []
    for width in (1, 30):
        noise = 1e-4 * np.random.default_rng(4).normal(size=len(t))
        slow = np.convolve(noise, np.ones(width) / np.sqrt(width), "same")
        joint = identify(
            Log(t=t, command=u, measured=q + slow), ac.ServoFit(model="second")
        ).joints[0]
        assert abs(joint.kp.value - 25) < 4.5 * joint.kp.sd
        deviations.append(joint.kp.sd)
    assert deviations[1] > 3 * deviations[0]
