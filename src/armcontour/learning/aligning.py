"""The clock of a recording, in time of the plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour._sampling import interpolate
from armcontour.errors import InvalidInput
from armcontour.learning.lifted import Lifted
from armcontour.learning.recording import Recording
from armcontour.motion import TaughtData

# Largest difference between two clocks; more is another job, or another unit of time.
WORST_RATE = 0.03
# Command intervals over which differences of set-points are averaged.
AVERAGED = 10
# Steps of Newton's method, which ends below this time [s].
STEPS, NEAR = 30, 1e-9


@dataclass(frozen=True, slots=True)
class Clock:
    """Time of the plan as `offset + rate t`, t being that of a recording.

    Args:
        offset: Time of the plan when the recording's clock is at 0 [s].
        rate: Seconds of the plan in a second of the recording.
    """

    offset: float
    rate: float

    def plan_time(self, t: FloatArray) -> FloatArray:
        """Times of the plan [s], same shape."""
        return self.offset + self.rate * t


def fit_clock(recording: Recording, lifted: Lifted, q: FloatArray) -> Clock:
    """The clock of a recording.

    By the recorded set-points where there are some, and else by the expected motion: a dead time
    that the servo model does not know is then part of the offset.

    Args:
        recording: What was measured.
        lifted: The model.
        q: Set-points of the run [rad], (count, dof).

    Raises:
        InvalidInput: The recording is shorter than the motion.
    """
    if recording.in_plan_time:
        return Clock(0.0, 1.0)
    _refuse_short(recording, lifted)
    if recording.command is not None:
        times = lifted.start + np.arange(len(q), dtype=np.float64) * lifted.period
        return fit_to(recording.t, recording.command, times, q)
    return fit_to(recording.t, recording.q, lifted.t, lifted.expected(q))


def set_points_off(recording: Recording, clock: Clock, taught: TaughtData) -> float:
    """RMS by which recorded set-points are beside those of the taught data [rad]; 0 without any.

    Controllers record them held or interpolated, and stamp them a little early or late. That makes
    differences which go to and fro within an interval, so differences are averaged over several.

    Args:
        recording: What was measured.
        clock: Its clock.
        taught: The set-points that the robot should have executed.
    """
    if recording.command is None:
        return 0.0
    times = taught.times(len(taught.q), taught.period)
    at = clock.plan_time(recording.t)
    off = recording.command - interpolate(at, times, taught.q)
    part = np.floor((at - at[0]) / (AVERAGED * taught.period)).astype(np.intp)
    count = np.bincount(part)
    means = [np.bincount(part, weights=x)[count > 0] / count[count > 0] for x in off.T]
    return float(np.sqrt(np.average(np.square(means).mean(axis=0), weights=count[count > 0])))


def _refuse_short(recording: Recording, lifted: Lifted) -> None:
    """Refuse a recording that cannot hold the whole motion.

    Raises:
        InvalidInput: It is shorter.
    """
    lasts = float(recording.t[-1] - recording.t[0])
    if lasts * (1 + WORST_RATE) < lifted.plan.duration:
        raise InvalidInput(
            f"{recording.source} lasts {lasts:.4g} s, but the motion lasts "
            f"{lifted.plan.duration:.4g} s: record the whole run, from before its first set-point "
            "until the arm rests."
        )


def fit_to(t: FloatArray, values: FloatArray, times: FloatArray, reference: FloatArray) -> Clock:
    """The clock with which values fit a reference.

    Args:
        t: Times of the recording [s], (m,).
        values: Values of the recording, (m, dof).
        times: Regular times of the plan [s], (n,).
        reference: Values of the plan, (n, dof).
    """
    from scipy.interpolate import CubicSpline

    curve = CubicSpline(times, reference)
    slope = curve.derivative()
    offset, rate = coarse_offset(t, values, times, reference), 1.0
    middle = float(t.mean())
    centre = offset + middle
    for _ in range(STEPS):
        at = centre + rate * (t - middle)
        inside = (at >= times[0]) & (at <= times[-1])
        if inside.sum() < 2:
            break
        rows = slope(at[inside])
        off = values[inside] - curve(at[inside])
        # Constant differences of a joint, as of a load that hangs on it, say nothing about time.
        parts = np.stack([rows, rows * (t[inside] - middle)[:, None]], axis=2)
        parts -= parts.mean(axis=0)
        off = off - off.mean(axis=0)
        step, *_ = np.linalg.lstsq(parts.reshape(-1, 2), off.ravel(), rcond=None)
        centre, rate = centre + float(step[0]), rate + float(step[1])
        if abs(step[0]) < NEAR and abs(step[1]) * np.ptp(t) < NEAR:
            break
        if abs(rate - 1) > 2 * WORST_RATE:
            break
    return Clock(centre - rate * middle, rate)


def coarse_offset(
    t: FloatArray, values: FloatArray, times: FloatArray, reference: FloatArray
) -> float:
    """About the offset with which values fit a reference best [s].

    Args:
        t: Times of the recording [s], (m,).
        values: Values of the recording, (m, dof).
        times: Regular times of the plan [s], (n,).
        reference: Values of the plan, (n, dof).
    """
    from scipy.signal import fftconvolve

    step = max(float(np.median(np.diff(t))), float(times[1] - times[0]))
    edge = WORST_RATE * float(times[-1] - times[0])
    short = np.arange(times[0], times[-1] + step / 2, step)
    # The arm rests before and after its motion: what was not recorded is as at the edges.
    missing = max(float(times[-1] - times[0]) - float(t[-1] - t[0]), 0.0)
    long = np.arange(t[0] - edge - missing, t[-1] + edge + missing + step / 2, step)
    wanted = interpolate(short, times, reference)
    given = interpolate(long, t, values)
    middle = wanted.mean(axis=0)
    wanted, given = wanted - middle, given - middle
    product = fftconvolve(given, wanted[::-1], mode="valid", axes=0).sum(axis=1)
    squares = np.concatenate([[0.0], np.cumsum((given**2).sum(axis=1))])
    power = squares[len(short) :] - squares[: len(product)]
    k = int(np.argmin(power - 2 * product))
    return float(short[0] - long[k])
