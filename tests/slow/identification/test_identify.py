"""Estimates from long logs, by many seeds."""

import math

import numpy as np
import pytest
from soak.identification import NOISE, move, multisine

import armcontour as ac
from armcontour.identification import Log, identify

TRUTH = {"kp": 25.0, "kv": 150.0, "delay": 12.3e-3}


def _one(t, u, y):
    return identify(Log(t=t, command=u, measured=y)).joints[0]


@pytest.mark.parametrize(("friction", "standstill"), [(0.3, 0.0), (0.3, 100.0), (0.0, 100.0)])
def test_standstill_does_not_hide_friction(friction, standstill):
    """A joint that is shaken for 20 s, and stands still while the others are."""
    truth = {"kp": 20.0, "kv": 72.2, "delay": 11e-3}
    t = np.arange(round((20 + standstill) / 4e-3)) * 4e-3
    shaken = np.minimum(t, 20.0)
    phases = np.random.default_rng(7).uniform(0, 2 * np.pi, 20)
    waves = [
        np.sin(2 * np.pi * f * shaken + p) / (1 + f)
        for f, p in zip(np.linspace(0.1, 5, 20), phases, strict=True)
    ]
    u = 3e-3 * np.clip((20 - shaken) / 0.5, 0.0, 1.0) * np.sum(waves, axis=0)
    y = move(t, u, **truth, steps=40, friction=friction)
    y = y + NOISE * np.random.default_rng(0).normal(size=len(t))
    joint = _one(t, u, y)
    assert any("Dry friction" in x for x in joint.notes) == (friction > 0)
    for x, value in zip(joint.estimates, truth.values(), strict=False):
        assert x.determined == (friction == 0)
        assert x.low <= value <= x.high


def test_a_ramp_of_an_arm_is_refused_with_its_cause():
    t, rate = np.arange(2001) * 0.004, np.array([0.1, 0.05])
    command, measured = (np.round(x, 9) for x in (t[:, None] * rate, (t[:, None] - 0.04) * rate))
    with pytest.raises(ac.InvalidInput, match="stands or moves at a uniform velocity"):
        identify(Log(t=t, command=command, measured=measured), arm=ac.load_arm("pmk3s"))


def test_columns_that_have_nothing_to_do_with_each_other():
    t = np.arange(2000) * 1e-3
    joint = _one(t, 3e-3 * multisine(t, 25.0, 1), 3e-3 * multisine(t, 10.0, 7))
    assert "so nothing is determined" in joint.notes[0]
    for x in joint.estimates:
        assert math.isnan(x.value) and math.isnan(x.sd) and not x.determined


def test_an_error_that_repeats_is_not_averaged_away():
    """The same residual in each period is one residual, however often it is seen."""
    t = np.arange(10_000) * 2e-3
    u = 3e-3 * multisine(t, 25.0, 1)
    q = move(t, u, **TRUTH, steps=20)
    rng = np.random.default_rng(3)
    once = NOISE * rng.normal(size=1000)
    always = _one(t, u, q + NOISE * rng.normal(size=len(t)))
    again = _one(t, u, q + np.tile(once, 10))
    # Ten periods: less known by the root of ten.
    assert again.kp.sd / always.kp.sd == pytest.approx(math.sqrt(10), rel=0.4)
    assert any("correlated" in x for x in again.notes)
    assert not always.notes


def test_noise_that_is_not_white_is_seen_and_widens_the_intervals():
    t = np.arange(6000) * 1e-3
    u = 3e-3 * multisine(t, 25.0, 1)
    q = move(t, u, **TRUTH)
    white = _one(t, u, q + NOISE * np.random.default_rng(0).normal(size=len(t)))
    rng = np.random.default_rng(4)
    slow = np.convolve(NOISE * rng.normal(size=len(t)), np.ones(30) / np.sqrt(30), "same")
    joint = _one(t, u, q + slow)
    assert any("correlated" in x for x in joint.notes)
    assert joint.kp.sd > 2 * white.kp.sd
    assert abs(joint.kp.value - 25) < 4.5 * joint.kp.sd


def test_a_change_of_velocity_is_no_ramp():
    t = np.arange(2001) * 0.004
    u, y = (0.1 * (t - late) + 0.2 * np.maximum(t - 4.0 - late, 0.0) for late in (0.0, 0.04))
    joint = identify(Log(t=t, command=u, measured=y)).joints[0]
    assert not any("uniform velocity" in x for x in joint.notes)
