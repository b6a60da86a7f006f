"""Estimates from logs that are long, or whose residuals depend on each other."""

import numpy as np
import pytest
from soak.identification import NOISE, move, multisine

import armcontour as ac
from armcontour.control.identification import Log, identify

TRUTH = {"kp": 25.0, "kv": 150.0, "delay": 12.3e-3}


def test_standstill_changes_nothing():
    """A joint that is shaken for 20 s, and stands still while the others are."""
    joints = []
    for standstill in (0.0, 100.0):
        t = np.arange(round((20 + standstill) / 4e-3)) * 4e-3
        shaken = np.minimum(t, 20.0)
        phases = np.random.default_rng(7).uniform(0, 2 * np.pi, 20)
        waves = [
            np.sin(2 * np.pi * f * shaken + p) / (1 + f)
            for f, p in zip(np.linspace(0.1, 5, 20), phases, strict=True)
        ]
        u = 5e-3 * np.clip((20 - shaken) / 0.5, 0.0, 1.0) * np.sum(waves, axis=0)
        y = move(t, u, kp=20.0, kv=72.2, delay=11e-3, steps=40)
        y = y + NOISE * np.random.default_rng(0).normal(size=len(t))
        (joint,) = identify(Log(t=t, command=u, measured=y)).joints
        for x, value in zip(joint.estimates, (20.0, 72.2, 11e-3), strict=True):
            assert x.determined and abs(x.value - value) < 4.5 * x.sd
        joints.append(joint)
    assert joints[1].share == pytest.approx(joints[0].share, rel=0.2)


def test_columns_that_have_nothing_to_do_with_each_other():
    t = np.arange(2000) * 1e-3
    u, y = 3e-3 * multisine(t, 25.0, 1), 3e-3 * multisine(t, 10.0, 7)
    (joint,) = identify(Log(t=t, command=u, measured=y)).joints
    assert not joint.written and "has no model" in joint.note


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
