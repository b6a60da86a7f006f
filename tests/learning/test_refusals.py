"""Logs that are not of the taught data are refused, with what they are instead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac

PERIOD = 4e-3


@pytest.fixture(scope="module")
def servo():
    return ac.ServoModel(kp=25.0, kv=150.0)


def rods(lengths=(0.25, 0.25)):
    limits = ac.Limits(joint_velocity=[3.0, 3.0], joint_acceleration=[5.0, 5.0])
    return ac.PlanarTwoLink(name="rods", links=lengths, base=0.0, limits=limits)


def executed(arm, servo, path):
    taught = ac.compensate(ac.plan(ac.JointPath.spline(path), arm), servo, method="none")
    return taught, log_of(arm, servo, taught)


def log_of(arm, servo, taught):
    done = ac.execute(taught, ac.ServoPlant(arm, servo.replace(kp=24.0)))
    t = np.arange(-0.1, done.t[-1], 5e-3)
    q = np.stack([np.interp(t, done.t, x) for x in done.q.T], axis=1)
    command = np.stack([np.interp(t, taught.t, x) for x in taught.q.T], axis=1)
    return ac.Log(t=t + 7.0, command=command, measured=q, source="run1.csv")


@pytest.fixture(scope="module")
def run(servo):
    arm = rods()
    return arm, *executed(arm, servo, [(0.1, 0.9), (0.5, 1.3), (0.2, 1.6)])


def other(log, **changes):
    parts = {"t": log.t, "command": log.command, "measured": log.measured, "source": log.source}
    return ac.Log(**{**parts, **changes})


def test_the_log_of_this_run_is_taken(run, servo):
    arm, taught, log = run
    lesson = ac.learn(taught, log, arm=arm, servo=servo)
    assert lesson.runs[0].offset == pytest.approx(-7.0, abs=2e-4)
    assert lesson.runs[0].rate == pytest.approx(1.0, abs=1e-4)


def test_units_wrong_by_57_3(run, servo, refuses):
    arm, taught, log = run
    wrong = other(log, measured=np.degrees(log.measured))
    refuses(
        lambda: ac.learn(taught, wrong, arm=arm, servo=servo),
        ac.InvalidInput, "run1.csv", "look like degrees", "rad RMS",
    )  # fmt: skip
    wrong = other(log, measured=np.degrees(log.measured), command=np.degrees(log.command))
    refuses(lambda: ac.learn(taught, wrong, arm=arm, servo=servo), ac.InvalidInput, "degrees")
    wrong = other(log, measured=np.radians(log.measured), command=np.radians(log.command))
    refuses(lambda: ac.learn(taught, wrong, arm=arm, servo=servo), ac.InvalidInput, "radians")


@pytest.mark.parametrize("both", [True, False])
def test_joints_swapped(run, servo, refuses, both):
    arm, taught, log = run
    command = log.command[:, ::-1] if both else log.command
    wrong = other(log, measured=log.measured[:, ::-1], command=command)
    refuses(
        lambda: ac.learn(taught, wrong, arm=arm, servo=servo),
        ac.InvalidInput, "in the order 2, 1",
    )  # fmt: skip


def test_another_job(run, servo, refuses):
    arm, taught, log = run
    _, another = executed(arm, servo, [(0.7, 0.4), (0.2, 1.1), (0.6, 0.5), (0.0, 0.4)])
    refuses(lambda: ac.learn(taught, another, arm=arm, servo=servo), ac.InvalidInput, "another job")


@pytest.mark.parametrize("amplitude", [0.4e-3, 1e-2])
def test_the_log_of_another_run(run, servo, amplitude):
    """Its set-points are other ones, by 30 times the noise of the log and more."""
    arm, taught, _ = run
    taught = ac.compensate(taught.trajectory, servo, method="inverse")
    other_run = replace(
        taught, q=taught.q + amplitude * np.sin(0.02 * np.arange(len(taught.q)))[:, None]
    )
    log = log_of(arm, servo, other_run)
    noise = np.random.default_rng(3).normal(scale=1e-5, size=log.measured.shape)
    log = other(log, measured=log.measured + noise)
    with pytest.raises(ac.InvalidInput, match="another run") as caught:
        ac.learn(taught, log, arm=arm, servo=servo)
    assert caught.value.limit == "set_points" and 0.4 < caught.value.needed / amplitude < 1
    assert ac.learn(other_run, log, arm=arm, servo=servo).runs[0].set_points_off < 2e-5


def test_too_short(run, servo, refuses):
    arm, taught, log = run
    for part in (
        log.between(7.0, 7.3),
        log.between(7.05),
        log.between(0.0, 7.0 + 0.96 * taught.trajectory.duration),
    ):
        refuses(
            lambda part=part: ac.learn(taught, part, arm=arm, servo=servo),
            ac.InvalidInput, "run1.csv", "whole run",
        )  # fmt: skip


def test_too_coarse(run, servo, refuses):
    arm, taught, log = run
    t = np.arange(log.t[0], log.t[-1], 25e-3)
    rows = [
        np.stack([np.interp(t, log.t, x) for x in y.T], axis=1) for y in (log.command, log.measured)
    ]
    coarse = ac.Recording(t=t, command=rows[0], q=rows[1], source="run1.csv")
    refuses(
        lambda: ac.learn(taught, coarse, arm=arm, servo=servo),
        ac.InvalidInput, "every 25 ms", "every 20.5 ms",
    )  # fmt: skip


def test_a_clock_that_is_none(run, servo, refuses):
    arm, taught, log = run
    wrong = other(log, t=log.t * 1.05)
    refuses(lambda: ac.learn(taught, wrong, arm=arm, servo=servo), ac.InvalidInput, "clock", "%")


def test_another_number_of_joints(run, servo, refuses):
    arm, taught, log = run
    wrong = other(log, measured=log.measured[:, :1], command=log.command[:, :1])
    refuses(
        lambda: ac.learn(taught, wrong, arm=arm, servo=servo), ac.InvalidInput, "1 joints", "has 2"
    )


def test_an_execution_of_other_set_points(run, servo, refuses):
    arm, taught, _ = run
    plain = ac.compensate(taught.trajectory, servo, method="inverse")
    done = ac.execute(plain, ac.ServoPlant(arm, servo))
    refuses(
        lambda: ac.learn(taught, done, arm=arm, servo=servo), ac.InvalidInput, "other set-points"
    )


def test_something_else(run, servo, refuses):
    arm, taught, _ = run
    refuses(lambda: ac.learn(taught, 1.0, arm=arm, servo=servo), ac.InvalidInput, "float")
