"""Refusals of recordings that are not of the taught data, with the reason that fits them best."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.learning.aligning import WORST_RATE, Clock, coarse_offset
from armcontour.learning.lesson import LearnedRun
from armcontour.learning.lifted import Lifted
from armcontour.learning.recording import Recording
from armcontour.motion.misreading import find_misreading

# A recording is one of this motion if it differs from what is expected by at most this share of
# the motion. A loaded arm with weak gains differs by some percent, other jobs by 100 % and more.
UNLIKE = 0.3
# Fewest samples in a period of the loops' natural frequency: disturbances up to it become errors.
SAMPLES = 5.0
# Logged set-points are those of another run if they differ from the taught ones by more than this
# RMS [rad], by more than this share of the errors, and by more than so many times the noise.
OTHERS, SHARE, NOISES = 1e-4, 0.05, 10.0


def refuse_coarse(recording: Recording, lifted: Lifted) -> None:
    """Refuse a recording with fewer samples than the loops' bandwidth needs.

    Raises:
        InvalidInput: It is too coarse.
    """
    servo = lifted.nominal.servo
    rate = servo.kp if servo.kv is None else np.sqrt(servo.kp * servo.kv)
    allowed = 2 * math.pi / float(rate.max()) / SAMPLES
    if recording.interval > allowed:
        raise InvalidInput(
            f"{recording.source} has a sample every {1e3 * recording.interval:.4g} ms, but the "
            f"joints' loops need one every {1e3 * allowed:.3g} ms at least: record faster.",
            limit="interval",
            needed=recording.interval,
            allowed=allowed,
        )


def refuse_unlike(recording: Recording, clock: Clock, lifted: Lifted, expected: FloatArray) -> None:
    """Refuse a recording that ends before the plan, or of another motion.

    Args:
        recording: What was measured.
        clock: Its clock.
        lifted: The model.
        expected: Expected joint positions at the model's times [rad], (n, dof).

    Raises:
        InvalidInput: It does not hold this motion; with what it is instead, if that can be told.
    """
    t = clock.plan_time(recording.t)
    wanted = lifted.between(t, expected)
    moved = _size(expected - expected.mean(axis=0))
    off = _size(recording.q - wanted)
    if off > UNLIKE * moved:
        raise InvalidInput(
            f"{recording.source} is {off:.3g} rad RMS from what the set-points make the arm do, "
            f"but the whole motion is {moved:.3g} rad RMS{_reason(recording, lifted, expected)}."
        )
    _refuse_clock(recording, clock)
    slack = 2 * recording.interval
    if t[-1] < lifted.plan.duration - slack or t[0] > slack:
        raise InvalidInput(
            f"{recording.source} covers the plan from {t[0]:.4g} s to {t[-1]:.4g} s, but the plan "
            f"lasts from 0 to {lifted.plan.duration:.4g} s: record the whole run, from before its "
            "first set-point until the arm rests."
        )


def refuse_other_set_points(run: LearnedRun) -> None:
    """Refuse the log of another run by its set-points.

    Raises:
        InvalidInput: They differ from those of the taught data by more than noise explains.
    """
    error, noise = _size(run.error), _size(run.noise)
    allowed = max(OTHERS, SHARE * error, NOISES * noise)
    if run.set_points_off > allowed:
        raise InvalidInput(
            f"{run.source} is the log of another run: its set-points differ from the taught data "
            f"by {run.set_points_off * 1e3:.3g} mrad RMS, and at most {allowed * 1e3:.3g} mrad is "
            f"allowed for noise of {noise * 1e3:.2g} mrad. Give the taught data that the robot "
            "executed; if the controller logs filtered set-points, give a log without them.",
            limit="set_points",
            needed=run.set_points_off,
            allowed=allowed,
        )


def _refuse_clock(recording: Recording, clock: Clock) -> None:
    """Refuse a clock that runs too fast or too slowly.

    Raises:
        InvalidInput: It is off by more than WORST_RATE.
    """
    off = abs(clock.rate - 1)
    if off > WORST_RATE:
        raise InvalidInput(
            f"{recording.source} fits the motion with a clock that is off by {100 * off:.3g} %, "
            f"and more than {100 * WORST_RATE:g} % is not a clock: give its times the unit that "
            "they have."
        )


def _reason(recording: Recording, lifted: Lifted, expected: FloatArray) -> str:
    """What explains measured positions better than that they are of this motion, and what mends it.

    Args:
        recording: What was measured.
        lifted: The model.
        expected: Expected joint positions at the model's times [rad], (n, dof).
    """
    # How far the joints are from where they start needs neither the order nor the unit of columns.
    gone, due = (_distance(x) for x in (recording.q, expected))
    offset = 0.0 if recording.in_plan_time else coarse_offset(recording.t, gone, lifted.t, due)
    wanted = lifted.between(recording.t + offset, expected)
    found = find_misreading(recording.t, recording.q, wanted)
    return f": {found or 'it is a log of another job, of other set-points or of another arm'}"


def _distance(q: FloatArray) -> FloatArray:
    """Distance of the joints from their start, as a share of the largest one, (n, 1)."""
    found = np.linalg.norm(q - q[0], axis=1)
    return np.asarray(found / max(float(found.max()), 1e-300))[:, None]


def _size(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
