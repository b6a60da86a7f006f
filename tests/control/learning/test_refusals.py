"""Logs of other set-points are refused; the message names the likely cause."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import armcontour as ac
from armcontour.control.learning import Recording

from .robots import SERVO, rods


def executed(arm, path):
    set_points = ac.compensate(ac.plan(ac.JointPath.spline(path), arm), SERVO, ac.NoCompensation())
    return set_points, log_of(arm, set_points)


def log_of(arm, set_points):
    execution = ac.simulate(
        set_points, ac.ServoPlant(arm, SERVO.replace(kp=24.0), saturation="none")
    )
    t = np.arange(-0.1, execution.t[-1], 5e-3)
    q = np.stack([np.interp(t, execution.t, x) for x in execution.q.T], axis=1)
    command = np.stack([np.interp(t, set_points.t, x) for x in set_points.q.T], axis=1)
    return ac.Log(t=t + 7.0, command=command, measured=q, source="run1.csv")


@pytest.fixture(scope="module")
def run():
    arm = rods()
    return arm, *executed(arm, [(0.1, 0.9), (0.5, 1.3), (0.2, 1.6)])


def other(log, **changes):
    parts = {"t": log.t, "command": log.command, "measured": log.measured, "source": log.source}
    return ac.Log(**{**parts, **changes})


def of_both(log, change):
    return other(log, measured=change(log.measured), command=change(log.command))


def test_the_log_of_this_run_is_accepted(run):
    arm, set_points, log = run
    lesson = ac.learn(set_points, log, arm=arm, servo=SERVO)
    assert lesson.runs[0].offset == pytest.approx(-7.0, abs=2e-4)
    assert lesson.runs[0].rate == pytest.approx(1.0, abs=1e-4)


def test_logs_in_other_units_or_orders_are_refused(run, refuses):
    arm, set_points, log = run
    _, another = executed(arm, [(0.7, 0.4), (0.2, 1.1), (0.6, 0.5), (0.0, 0.4)])
    t = np.arange(log.t[0], log.t[-1], 25e-3)

    def resampled(values):
        return np.stack([np.interp(t, log.t, x) for x in values.T], axis=1)

    coarse = Recording(
        t=t, command=resampled(log.command), q=resampled(log.measured), source="run1.csv"
    )
    plain = ac.compensate(set_points.trajectory, SERVO, ac.Inverse())
    for wrong, words in (
        (other(log, measured=np.degrees(log.measured)), "another unit, sign or order"),
        (of_both(log, np.degrees), "another unit"),
        (of_both(log, np.radians), "another unit"),
        (of_both(log, np.fliplr), "another unit, sign or order"),
        (other(log, measured=log.measured[:, ::-1]), "another unit, sign or order"),
        (another, "another job"),
        (log.between(7.0, 7.3), "whole run"),
        (log.between(7.05), "whole run"),
        (log.between(0.0, 7.0 + 0.96 * set_points.trajectory.duration), "whole run"),
        (coarse, "every 20.5 ms"),
        (other(log, t=log.t * 1.05), "clock"),
        (of_both(log, lambda x: x[:, :1]), "1 joints"),
        (ac.simulate(plain, ac.ServoPlant(arm, SERVO)), "the same set-points"),
        (1.0, "float"),
    ):
        refuses(partial(ac.learn, set_points, wrong, arm=arm, servo=SERVO), ac.InvalidInput, words)


@pytest.mark.parametrize("amplitude", [0.4e-3, 1e-2])
def test_the_log_of_another_run_is_refused(run, amplitude):
    """Its set-points are other ones, by 30 times the noise of the log and more."""
    arm, set_points, _ = run
    # Without limits, so that another clock does not explain the difference
    plan = replace(set_points.trajectory, limits=None)
    set_points = ac.compensate(plan, SERVO, ac.Inverse())
    wave = amplitude * np.sin(0.02 * np.arange(len(set_points.q)))[:, None]
    other_run = replace(set_points, q=set_points.q + wave)
    log = log_of(arm, other_run)
    noise = np.random.default_rng(3).normal(scale=1e-5, size=log.measured.shape)
    log = other(log, measured=log.measured + noise)
    with pytest.raises(ac.InvalidInput, match="another run") as caught:
        ac.learn(set_points, log, arm=arm, servo=SERVO)
    assert caught.value.limit == "set_points" and 0.4 < caught.value.needed / amplitude < 1
    assert ac.learn(other_run, log, arm=arm, servo=SERVO).runs[0].set_points_off < 2e-5
