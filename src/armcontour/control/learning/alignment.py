"""Alignment of a recording with the plan (clock, outliers, tool positions), with checks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

from armcontour.control.learning.learning_result import LearningRun, Recording
from armcontour.control.learning.lifted_model import Lifted, rms
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampling import DEVIATION_PER_MEDIAN, interpolate, white_noise
from armcontour.motion import SetPoints
from armcontour.motion.log_checks import check_completeness, find_misreading

# Largest difference between two clocks; a larger one means another job or unit of time.
WORST_RATE = 0.03
# Cycles over which differences of set-points are averaged.
AVERAGED = 10
# Largest number of Newton steps, and the change at which they end [s].
STEPS, NEAR = 30, 1e-9
# A recording belongs to this motion if it differs from the expected one by at most this share of
# the motion. A loaded arm with weak gains differs by some percent, other jobs by 100 % and more.
UNLIKE = 0.3
# Fewest samples per period of the loops' natural frequency: slower disturbances cause errors.
SAMPLES = 5.0
# Intervals that differ by less than this share are equal, because clocks drift.
SAME = 0.01
# Logged set-points belong to another run if they differ from the exported ones by more than this
# RMS [rad], by more than this share of the errors, and by more than this multiple of the noise.
OTHERS, SHARE, NOISES = 1e-4, 0.05, 10.0
# A tracker measures in another frame, or another point, if its tool positions differ by more than
# this [m]: elastic joints deflect less.
FAR = 0.05
# Smallest outlier relative to the noise and to the range of samples between these quantiles, number
# of passes, and largest share of outliers.
OUTLIER, SPIKE, RANGE, PASSES, MAX_OUTLIERS = 10.0, 0.1, (0.05, 0.95), 5, 0.02
# An encoder has a new offset if the median deviation from the previous run is at least this many
# standard deviations, and at least this [rad].
SHIFTED, LEAST_SHIFT = 6.0, 1e-4


def replace_outliers(values: FloatArray, noise: FloatArray) -> tuple[FloatArray, int]:
    """Samples with outliers replaced by interpolation, and the number of outliers."""
    # An outlier differs from the cubic through its two neighbours on each side by OUTLIER times the
    # noise and by SPIKE times the quantile range. If there are too many, none is replaced.
    # values (n, dof) [rad], noise (dof,) [rad].
    cleaned, bad = values.copy(), np.zeros(values.shape, dtype=np.bool_)
    low, high = np.quantile(values, RANGE, axis=0)
    allowed = np.maximum(OUTLIER * noise, SPIKE * (high - low))
    for _ in range(PASSES):
        padded = np.pad(cleaned, ((2, 2), (0, 0)), mode="edge")
        far, near = padded[:-4] + padded[4:], padded[1:-3] + padded[3:-1]
        distances = np.abs(cleaned - (4 * near - far) / 6)
        # An outlier distorts the cubics of its neighbours, so only the local maximum counts.
        new = (distances > allowed) & (distances >= maximum_filter1d(distances, 5, axis=0))
        if not new.any():
            break
        bad |= new
        for j in np.flatnonzero(new.any(axis=0)):
            rows = np.arange(len(values))
            good = ~bad[:, j]
            cleaned[:, j] = np.interp(rows, rows[good], values[good, j])
    if bad.mean() > MAX_OUTLIERS:
        return values, 0
    return cleaned, int(bad.any(axis=1).sum())


class Aligned(NamedTuple):
    """A recording in time of the plan."""

    offset: float  # Time of the plan when the clock of the recording was at 0 [s]
    rate: float  # Seconds of the plan in a second of the recording
    expected: FloatArray  # Expected joint positions at the model's times [rad], (n, dof)
    measured: FloatArray  # Measured joint positions at these times [rad], (n, dof)
    noise: FloatArray  # Standard deviation of their white noise [rad], (dof,)
    # Offset of each encoder since the run before [rad], (dof,); not in `measured`.
    shift: FloatArray
    outliers: int  # Number of samples that were ignored


def align(
    recording: Recording, lifted: Lifted, set_points: SetPoints, expected: FloatArray | None = None
) -> Aligned:
    """Align a recording with the plan by its set-points, or else by the expected motion."""
    # In the latter case, dead time that is not in the servo model becomes part of the offset.
    # `expected` are the joint positions at the model's times that the run before lets expect [rad],
    # (n, dof); by default those of the model, which do not show offsets of encoders.
    source, duration = recording.source, lifted.plan.duration
    servo = lifted.nominal.servo
    loops = servo.kp if servo.kv is None else np.where(np.isinf(servo.kv), servo.kp, servo.kv)
    allowed = 2 * math.pi / float(np.sqrt(servo.kp * loops).max()) / SAMPLES
    # Set-points correct no faster disturbances than a log of the cycle shows.
    allowed = max(allowed, set_points.cycle)
    if recording.interval > allowed * (1 + SAME):
        raise InvalidInput(
            f"{source} has a sample every {1e3 * recording.interval:.4g} ms, but the joints' loops "
            f"need one every {1e3 * allowed:.3g} ms at least: record faster.",
            limit="interval",
            needed=recording.interval,
            allowed=allowed,
        )
    has_forerunner = expected is not None
    expected = lifted.expected(set_points.q) if expected is None else expected
    offset, rate = 0.0, 1.0
    if not recording.in_plan_time:
        lasts = float(np.ptp(recording.t))
        if lasts * (1 + WORST_RATE) < duration:
            raise InvalidInput(
                f"{source} lasts {lasts:.4g} s, but the motion lasts {duration:.4g} s: record the "
                "whole run, from before its first set-point until the arm rests."
            )
        values, times, reference = recording.q, lifted.t, expected
        if recording.command is not None:
            values, times, reference = recording.command, set_points.t, set_points.q
        offset, rate = fit_to(recording.t, values, times, reference)
    t = offset + rate * recording.t
    moved = rms(expected - expected.mean(axis=0))
    apart = recording.q - lifted.between(t, expected)
    deviation = rms(apart)
    if deviation > UNLIKE * moved:
        # The distance from the start depends on neither the order nor the unit of columns.
        gone, due = (np.linalg.norm(x - x[0], axis=1)[:, None] for x in (recording.q, expected))
        gone, due = (x / max(float(x.max()), 1e-300) for x in (gone, due))
        start = 0.0 if recording.in_plan_time else coarse_offset(recording.t, gone, lifted.t, due)
        shifted = lifted.between(recording.t + start, expected)
        reason = find_misreading(recording.t, recording.q, shifted)
        reason = reason or "it is a log of another job, of other set-points or of another arm"
        raise InvalidInput(
            f"{source} differs by {deviation:.3g} rad RMS from the motion that the set-points "
            f"cause, but the whole motion is {moved:.3g} rad RMS: {reason}."
        )
    if abs(rate - 1) > WORST_RATE:
        raise InvalidInput(
            f"{source} fits the motion with a clock that is off by {100 * abs(rate - 1):.3g} %, "
            f"and more than {100 * WORST_RATE:g} % is not a clock: it is a log of another job or "
            "another speed, or its times need their unit."
        )
    check_completeness(source, t, duration, 2 * recording.interval)
    apart = recording.q - lifted.between(t, expected)
    noise = white_noise(apart, order=4)
    shift, outliers = np.zeros(lifted.dof), 0
    if not recording.exact:
        apart, outliers = replace_outliers(apart, noise)
    if has_forerunner:
        middle = np.median(apart, axis=0)
        spread = DEVIATION_PER_MEDIAN * np.median(np.abs(apart - middle), axis=0)
        sure = np.maximum(SHIFTED * np.maximum(spread, noise), LEAST_SHIFT)
        shift = np.where(np.abs(middle) > sure, middle, 0.0)
    measured = expected + lifted.bridge(t, apart - shift, noise)
    return Aligned(offset, rate, expected, measured, noise, shift, outliers)


def require_same_set_points(run: LearningRun) -> None:
    """Check that the logged set-points are those of the run."""
    error, noise = rms(run.error), rms(run.noise)
    allowed = max(OTHERS, SHARE * error, NOISES * noise)
    if run.set_points_off > allowed:
        raise InvalidInput(
            f"{run.source} is the log of another run: its set-points differ from those of this run "
            f"by {run.set_points_off * 1e3:.3g} mrad RMS, and at most {allowed * 1e3:.3g} mrad is "
            f"allowed for noise of {noise * 1e3:.2g} mrad. Give the set-points that the robot "
            "executed; if the controller logs filtered set-points, give a log without them.",
            limit="set_points",
            needed=run.set_points_off,
            allowed=allowed,
        )


def set_points_off(t: FloatArray, command: FloatArray | None, set_points: SetPoints) -> float:
    """RMS difference of recorded and executed set-points [rad]; 0 if none are recorded."""
    # Controllers record set-points held or interpolated, with small offsets in time. The resulting
    # differences alternate within a cycle, so they are averaged over AVERAGED cycles.
    if command is None:
        return 0.0
    differences = command - interpolate(t, set_points.t, set_points.q)
    part = np.floor((t - t[0]) / (AVERAGED * set_points.cycle)).astype(np.intp)
    count = np.bincount(part)
    means = [np.bincount(part, weights=x)[count > 0] / count[count > 0] for x in differences.T]
    return float(np.sqrt(np.average(np.square(means).mean(axis=0), weights=count[count > 0])))


def fit_to(
    t: FloatArray, values: FloatArray, times: FloatArray, reference: FloatArray
) -> tuple[float, float]:
    """Offset and rate of the plan's time `offset + rate t`, by fitting values to a reference."""
    # t (m,) [s], values (m, dof), regular times (n,) [s], reference (n, dof).
    curve = CubicSpline(times, reference)
    slope = curve.derivative()
    middle, rate = float(t.mean()), 1.0
    centre = coarse_offset(t, values, times, reference) + middle
    for _ in range(STEPS):
        plan_times = centre + rate * (t - middle)
        inside = (plan_times >= times[0]) & (plan_times <= times[-1])
        if inside.sum() < 2:
            break
        rows = slope(plan_times[inside])
        errors = values[inside] - curve(plan_times[inside])
        # Constant differences of a joint, for example due to a load, do not depend on time.
        parts = np.stack([rows, rows * (t[inside] - middle)[:, None]], axis=2)
        parts -= parts.mean(axis=0)
        errors = errors - errors.mean(axis=0)
        step, *_ = np.linalg.lstsq(parts.reshape(-1, 2), errors.ravel(), rcond=None)
        centre, rate = centre + float(step[0]), rate + float(step[1])
        near = abs(step[0]) < NEAR and abs(step[1]) * np.ptp(t) < NEAR
        if near or abs(rate - 1) > 2 * WORST_RATE:
            break
    return centre - rate * middle, rate


def coarse_offset(
    t: FloatArray, values: FloatArray, times: FloatArray, reference: FloatArray
) -> float:
    """Approximate offset with the best fit of values to a reference [s]; see `fit_to`."""
    from scipy.signal import fftconvolve

    step = max(float(np.median(np.diff(t))), float(times[1] - times[0]))
    span = float(np.ptp(times))
    short = np.arange(times[0], times[-1] + step / 2, step)
    # The arm rests before and after its motion, so the edges are extrapolated as constants.
    edge = WORST_RATE * span + max(span - float(np.ptp(t)), 0.0)
    long = np.arange(t[0] - edge, t[-1] + edge + step / 2, step)
    pattern = interpolate(short, times, reference)
    padded = interpolate(long, t, values) - pattern.mean(axis=0)
    pattern -= pattern.mean(axis=0)
    product = fftconvolve(padded, pattern[::-1], mode="valid", axes=0).sum(axis=1)
    squares = np.concatenate([[0.0], np.cumsum((padded**2).sum(axis=1))])
    power = squares[len(short) :] - squares[: len(product)]
    k = int(np.argmin(power - 2 * product))
    return float(short[0] - long[k])


def add_tool(
    tool: tuple[npt.ArrayLike, npt.ArrayLike],
    lifted: Lifted,
    error: FloatArray,
    clock: tuple[float, float] | None,
) -> tuple[FloatArray, FloatArray]:
    """Joint errors that explain encoders and a tracker [rad], (n, dof), and noise, (dof,)."""
    # Deviations that only the tracker measures, such as deflections of links, are converted to
    # joint errors by damped least squares, with damping from the noise. tool: times (m,) [s] and
    # tool points in the frame of the path (m, dimension) [m]. A clock (offset and rate) of None is
    # fitted to the motion.
    arm = lifted.nominal.arm
    t, points = checks.check_numbers("tool times", tool[0], "s"), checks.points("tool", tool[1])
    form = t.ndim == 1 and len(t) >= 5 and points.shape == (len(t), arm.dimension)
    if not form or (np.diff(t) <= 0).any():
        raise InvalidInput(
            f"The positions of the tool need at least five times, which must increase, and "
            f"{arm.dimension} coordinates at each, but have the shape {points.shape} at {t.size} "
            "times."
        )
    encoded = arm.tool_position(lifted.planned + error)
    offset, rate = clock or fit_to(t, points, lifted.t, encoded)
    plan_times = offset + rate * t
    check_completeness(
        "The file of tool positions",
        plan_times,
        lifted.plan.duration,
        2 * np.diff(plan_times).max(),
    )
    offsets = lifted.at_times(plan_times, points, encoded) - encoded
    largest = float(np.linalg.norm(offsets, axis=1).max())
    if largest > FAR:
        raise InvalidInput(
            f"The measured tool is {1e3 * largest:.4g} mm from its position by the encoders, and "
            f"more than {1e3 * FAR:g} mm is not compliance: give positions of the tool point in "
            "the frame of the path, in metres.",
            needed=largest,
            allowed=FAR,
        )
    noise = float(np.mean(white_noise(points - lifted.between(plan_times, encoded), order=4) ** 2))
    # Prior variance of joint deflections, from the size of the tool's deviations.
    jacobian = arm.tool_jacobian(lifted.planned)
    transposed = np.swapaxes(jacobian, 1, 2)
    product = jacobian @ transposed
    reach = float(np.trace(product, axis1=1, axis2=2).mean())
    likely = max(float(np.mean((offsets**2).sum(axis=1))) / reach, 1e-300)
    damped = product + noise / likely * np.eye(offsets.shape[1])
    inverse = transposed @ np.linalg.pinv(damped, hermitian=True)
    correction = np.einsum("njd,nd->nj", inverse, offsets)
    spread = np.sqrt(noise * (inverse**2).sum(axis=2).mean(axis=0))
    return error + correction, spread * np.sqrt(
        max(np.median(np.diff(plan_times)) / lifted.step, 1.0)
    )
