"""Alignment of a recording with the plan in time, its noise, and checks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d

from armcontour.control.learning.learning_result import LearningResult, LearningRun, Recording
from armcontour.control.learning.lifted_model import REST_TIME, Lifted, rms
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import any_unit
from armcontour.core.sampled_data import interpolate, white_noise
from armcontour.motion import SetPoints
from armcontour.motion.log_checks import check_completeness

# Rates of two clocks differ by at most this fraction. A larger difference means that the log is of
# another job or has another unit of time.
MAX_RATE_DIFFERENCE = 0.03
# Number of cycles over which differences of set-points are averaged.
AVERAGED_CYCLES = 10
# Largest number of Newton steps of `fit_clock`.
MAX_STEPS = 30
# The Newton steps end when a step changes times by less than this [s].
CONVERGED = 1e-9
# A recording belongs to the motion if it differs from the expected motion by at most this fraction
# of the motion. A loaded arm with weak gains differs by some percent, another job by 100 % or more.
MAX_DIFFERENCE = 0.3
# Smallest number of samples per period of the loops' natural frequency, because disturbances up to
# this frequency cause errors.
SAMPLES_PER_PERIOD = 5.0
# Relative tolerance of the sample interval, because clocks drift.
INTERVAL_TOLERANCE = 0.01
# Logged set-points are those of the run if their RMS difference from its set-points is at most this
# [rad].
SET_POINT_TOLERANCE = 1e-4
# The RMS difference may also be at most this fraction of the run's RMS error.
ERROR_SHARE = 0.05
# The RMS difference may also be at most this multiple of the run's noise.
NOISE_MULTIPLE = 10.0
# A log belongs to an earlier run if that run's set-points fit it with less than this fraction of
# the misfit that the current ones have.
NEARER = 0.5
# A joint rests if it has moved by at most this multiple of the noise.
REST_SIGMAS = 6.0
# A joint also rests if it has moved by at most this [rad].
REST_MOTION = 1e-6
# Number of decay rates that are tried for the motion of a joint to its rest position.
RATE_COUNT = 24
# Slowest decay rate that is tried [1/s].
SLOWEST_RATE = 0.3
# Fastest decay rate that is tried, and rate below which a joint creeps [position loop gains].
FASTEST_RATE = 4.0
CREEP_RATE = 0.6
# A joint still moves at the end of a recording if the fitted remaining motion exceeds this multiple
# of its standard deviation.
CREEP_SIGMAS = 5.0
# Fewest samples from which a decay is fitted.
FEWEST_REST_SAMPLES = 8


class AlignedRecording(NamedTuple):
    """A recording in plan time, resampled at the times of the model."""

    offset: float  # Time of the plan at which the clock of the recording is 0 [s]
    rate: float  # Time of the plan per time of the recording
    measured: FloatArray  # Measured joint positions at the model's times [rad], (n, dof)
    noise: FloatArray  # Standard deviation of the white noise of the samples [rad], (dof,)


def align(
    recording: Recording, lifted: Lifted, set_points: SetPoints, expected: FloatArray | None = None
) -> AlignedRecording:
    """Align a recording with the plan by its set-points; if it has none, by the expected motion.

    If the expected motion is used, dead time that the servo model lacks becomes part of the offset.

    - `expected`: joint positions at the model's times that follow from an earlier run [rad], (n,
      dof), by default those of the model.
    """
    _check_interval(recording, lifted, set_points)
    expected = lifted.expected(set_points.q) if expected is None else expected
    offset = 0.0
    rate = 1.0
    if not recording.in_plan_time:
        offset, rate = _fit_clock_of(recording, lifted, set_points, expected)
    t = offset + rate * recording.t
    apart = recording.q - lifted.interpolate_at(t, expected)
    _check_difference(recording, apart, expected)
    if abs(rate - 1) > MAX_RATE_DIFFERENCE:
        raise InvalidInput(
            f"The clock of {recording.source} may differ from the time of the plan by at most "
            f"{100 * MAX_RATE_DIFFERENCE:g} %, but differs by {100 * abs(rate - 1):.3g} %. Specify "
            "the unit of the times, or a log of this job at the same speed."
        )
    check_completeness(recording.source, t, lifted.plan.duration, 2 * recording.interval)
    noise = white_noise(apart, order=4)
    measured = expected + lifted.fill_gaps(t, apart, noise)
    return AlignedRecording(offset, rate, measured, noise)


def _check_interval(recording: Recording, lifted: Lifted, set_points: SetPoints) -> None:
    """Check that the samples of a recording are close enough for the joint loops.

    A sample interval of one cycle is always sufficient, because set-points cannot correct faster
    disturbances.
    """
    servo = lifted.nominal.servo
    loops = servo.kp if servo.kv is None else np.where(np.isinf(servo.kv), servo.kp, servo.kv)
    fastest = float(np.sqrt(servo.kp * loops).max())
    allowed = max(2 * math.pi / fastest / SAMPLES_PER_PERIOD, set_points.cycle)
    if recording.interval > allowed * (1 + INTERVAL_TOLERANCE):
        raise InvalidInput(
            f"{recording.source} has a sample every {1e3 * recording.interval:.4g} ms, but the "
            f"joint loops require one every {1e3 * allowed:.3g} ms or faster. Record at a higher "
            "rate.",
            limit="interval",
            needed=recording.interval,
            allowed=allowed,
        )


def _fit_clock_of(
    recording: Recording, lifted: Lifted, set_points: SetPoints, expected: FloatArray
) -> tuple[float, float]:
    """Fit the offset and the rate of a recording's clock; arguments as in `align`."""
    lasts = float(np.ptp(recording.t))
    duration = lifted.plan.duration
    if lasts * (1 + MAX_RATE_DIFFERENCE) < duration:
        raise InvalidInput(
            f"{recording.source} lasts {lasts:.4g} s, but the motion lasts {duration:.4g} s. "
            "Record the whole run, from before its first set-point until the arm rests."
        )
    if recording.command is None:
        return fit_clock(recording.t, recording.q, lifted.t, expected)
    return fit_clock(recording.t, recording.command, set_points.t, set_points.q)


def _check_difference(recording: Recording, difference: FloatArray, expected: FloatArray) -> None:
    """Check that a recording is near the motion that the set-points cause.

    - `difference`: recorded less expected positions [rad], (m, dof).
    - `expected`: expected positions [rad], (m, dof).
    """
    motion = rms(expected - expected.mean(axis=0))
    deviation = rms(difference)
    if deviation > MAX_DIFFERENCE * motion:
        reason = " ".join(recording.notes) or (
            "it is a log of another job, of other set-points or of another arm, or its columns "
            "have another unit, sign or order."
        )
        raise InvalidInput(
            f"{recording.source} differs by {deviation:.3g} rad RMS from the motion that the "
            f"set-points cause, although the whole motion is only {motion:.3g} rad RMS: {reason}"
        )


def find_rest(recording: Recording, lifted: Lifted, set_points: SetPoints) -> float:
    """Return the plan time at which the arm has rested for REST_TIME [s]; 0 if it never does."""
    aligned = align(recording, lifted, set_points)
    t = aligned.offset + aligned.rate * recording.t
    motion = np.abs(recording.q - interpolate(t - REST_TIME, t, recording.q))
    rests = (motion <= np.maximum(REST_SIGMAS * aligned.noise, REST_MOTION)).all(axis=1)
    times = t[rests & (t >= set_points.t[-1] + REST_TIME)]
    return float(times[0]) if len(times) else 0.0


class Rest(NamedTuple):
    """Rest of the joints after the last set-point of a recording."""

    positions: FloatArray  # Positions at which the joints come to rest [rad], (dof,)
    creeps: BoolArray  # Mask of the joints that still creep at the end of the recording, (dof,)
    later: (
        BoolArray  # Mask of the joints that rest elsewhere than in the model's last times, (dof,)
    )
    # Measured positions after the times of the model, averaged over REST_TIME [rad], (n, dof).
    measured: FloatArray


def measure_rest(
    recording: Recording, aligned: AlignedRecording, lifted: Lifted, set_points: SetPoints
) -> Rest:
    """Determine where the joints come to rest.

    After the last set-point, a joint moves as `c + a exp(-r t)`. If the motion that remains at the
    end of the recording is noise, the joint rests at its mean position in the last REST_TIME.
    Otherwise it rests at c. If the motion is slower than the position loop and goes to the last
    set-point, the joint creeps: the integrator of its velocity loop moves it to the last set-point.
    Other slow motions are drift or friction, and count as rest.
    """
    servo = lifted.nominal.servo
    times = aligned.offset + aligned.rate * recording.t
    reached = float(set_points.t[-1]) + servo.dead_time + 1 / servo.kp
    positions = np.empty(lifted.dof)
    creeps = np.full(lifted.dof, False)
    for j in range(lifted.dof):
        start = min(float(reached[j]), float(times[-1]) - REST_TIME)
        after_start = times >= start
        t = times[after_start] - start
        q = recording.q[after_start, j]
        positions[j] = float(q[t >= t[-1] - REST_TIME].mean())
        if len(t) < FEWEST_REST_SAMPLES:
            continue
        decay = fit_decay(t, q, float(servo.kp[j]))
        noise = max(float(aligned.noise[j]), decay.error)
        if abs(decay.remaining) <= max(CREEP_SIGMAS * noise * decay.deviation, REST_MOTION):
            continue
        last = float(set_points.q[-1, j])
        if decay.rate >= CREEP_RATE * servo.kp[j]:
            positions[j] = decay.end
        elif abs(last - decay.end) <= abs(decay.remaining):
            creeps[j] = True
            positions[j] = last
    count = max(round(REST_TIME / (recording.interval * aligned.rate)), 1)
    change = np.abs(positions - aligned.measured[lifted.is_rest].mean(axis=0))
    moves = change > np.maximum(REST_SIGMAS * aligned.noise / np.sqrt(count), REST_MOTION)
    after = recording.q[times > lifted.t[-1]]
    if len(after) < count:
        return Rest(positions, creeps, creeps, after[:0])
    return Rest(positions, creeps, creeps | moves, uniform_filter1d(after, count, axis=0))


class Decay(NamedTuple):
    """Motion `end + a exp(-rate t)` of a joint to its rest position."""

    end: float  # Rest position [rad]
    rate: float  # [1/s]
    remaining: float  # a exp(-rate t) at the last time [rad]
    deviation: float  # Standard deviation of `remaining` with white noise of 1 rad [rad]
    error: float  # RMS deviation of the positions from this motion [rad]


def fit_decay(t: FloatArray, q: FloatArray, gain: float) -> Decay:
    """Fit a decay to positions q [rad] at times t [s], (n,).

    - `gain`: gain of the position loop [1/s].
    """
    best: Decay | None = None
    for rate in np.geomspace(SLOWEST_RATE, FASTEST_RATE * gain, RATE_COUNT):
        shape = np.exp(-rate * t)
        columns = np.stack([np.ones_like(t), shape], axis=1)
        (end, size), *_ = np.linalg.lstsq(columns, q, rcond=None)
        error = rms(q - columns @ np.array([end, size]))
        if best is None or error < best.error:
            spread = float(np.linalg.norm(shape - shape.mean()))
            deviation = float(shape[-1]) / max(spread, 1e-300)
            remaining = float(size * shape[-1])
            best = Decay(float(end), float(rate), remaining, deviation, error)
    assert best is not None
    return best


def require_same_set_points(recording: Recording, run: LearningRun, set_points: SetPoints) -> None:
    """Raise an error if the logged set-points are not those of the run."""
    if recording.command is None:
        return
    t = recording.t
    command = recording.command
    times = set_points.t
    earlier = set_points.runs if isinstance(set_points, LearningResult) else ()
    misfits = []
    for q in (*(x.q for x in earlier), set_points.q):
        offset, rate = fit_clock(t, command, times, q)
        misfits.append(rms(command - interpolate(offset + rate * t, times, q)))
    k = int(np.argmin(misfits))
    if misfits[k] < NEARER * misfits[-1]:
        raise InvalidInput(
            f"{run.source} contains the set-points of run {k + 1} ({earlier[k].source}), but must "
            "contain the specified set-points. Specify the log of the last run, or the set-points "
            "that the robot executed.",
            index=k,
        )
    error = rms(run.error)
    noise = rms(run.noise)
    allowed = max(SET_POINT_TOLERANCE, ERROR_SHARE * error, NOISE_MULTIPLE * noise)
    if run.set_points_off > allowed:
        unit = any_unit("mrad", run.prismatic)
        raise InvalidInput(
            f"{run.source} is the log of another run, because its set-points differ from those of "
            f"this run by {run.set_points_off * 1e3:.3g} {unit} RMS. At most {allowed * 1e3:.3g} "
            f"{unit} is allowed with a noise of {noise * 1e3:.2g} {unit}. Specify the set-points "
            "that the robot executed. If the controller logs filtered set-points, specify a log "
            "without set-points.",
            limit="set_points",
            needed=run.set_points_off,
            allowed=allowed,
        )


def set_points_off(t: FloatArray, command: FloatArray | None, set_points: SetPoints) -> float:
    """Return the RMS difference of recorded and executed set-points [rad].

    - `t`, `command`: times in the plan [s], (m,), and recorded set-points [rad], (m, dof); None if
      set-points were not recorded, which returns 0.
    """
    # Controllers record held or interpolated set-points, with small time offsets. The resulting
    # differences alternate within a cycle, so differences are averaged over AVERAGED_CYCLES cycles.
    if command is None:
        return 0.0
    differences = command - interpolate(t, set_points.t, set_points.q)
    window = np.floor((t - t[0]) / (AVERAGED_CYCLES * set_points.cycle)).astype(np.intp)
    count = np.bincount(window)
    means = [np.bincount(window, weights=x)[count > 0] / count[count > 0] for x in differences.T]
    return float(np.sqrt(np.average(np.square(means).mean(axis=0), weights=count[count > 0])))


def fit_clock(
    t: FloatArray, values: FloatArray, times: FloatArray, reference: FloatArray
) -> tuple[float, float]:
    """Fit offset and rate so that values match a reference at plan times `offset + rate t`.

    - `values`: (m, dof), at the clock's times t [s], (m,).
    - `reference`: (n, dof), at uniform times of the plan [s], (n,).
    """
    curve = CubicSpline(times, reference)
    slope = curve.derivative()
    middle = float(t.mean())
    rate = 1.0
    centre = approximate_offset(t, values, times, reference) + middle
    for _ in range(MAX_STEPS):
        plan_times = centre + rate * (t - middle)
        inside = (plan_times >= times[0]) & (plan_times <= times[-1])
        if inside.sum() < 2:
            break
        rows = slope(plan_times[inside])
        errors = values[inside] - curve(plan_times[inside])
        # The fit ignores constant differences of a joint, for example due to a load.
        parts = np.stack([rows, rows * (t[inside] - middle)[:, None]], axis=2)
        parts -= parts.mean(axis=0)
        errors = errors - errors.mean(axis=0)
        step, *_ = np.linalg.lstsq(parts.reshape(-1, 2), errors.ravel(), rcond=None)
        centre = centre + float(step[0])
        rate = rate + float(step[1])
        converged = abs(step[0]) < CONVERGED and abs(step[1]) * np.ptp(t) < CONVERGED
        if converged or abs(rate - 1) > 2 * MAX_RATE_DIFFERENCE:
            break
    return centre - rate * middle, rate


def approximate_offset(
    t: FloatArray, values: FloatArray, times: FloatArray, reference: FloatArray
) -> float:
    """Approximate the clock's offset [s] by cross-correlation; arguments as in `fit_clock`."""
    from scipy.signal import fftconvolve

    step = max(float(np.median(np.diff(t))), float(times[1] - times[0]))
    span = float(np.ptp(times))
    short = np.arange(times[0], times[-1] + step / 2, step)
    # The arm rests before and after its motion, so the edges are extrapolated as constants.
    edge = MAX_RATE_DIFFERENCE * span + max(span - float(np.ptp(t)), 0.0)
    long = np.arange(t[0] - edge, t[-1] + edge + step / 2, step)
    pattern = interpolate(short, times, reference)
    padded = interpolate(long, t, values) - pattern.mean(axis=0)
    pattern -= pattern.mean(axis=0)
    product = fftconvolve(padded, pattern[::-1], mode="valid", axes=0).sum(axis=1)
    squares = np.concatenate([[0.0], np.cumsum((padded**2).sum(axis=1))])
    power = squares[len(short) :] - squares[: len(product)]
    k = int(np.argmin(power - 2 * product))
    return float(short[0] - long[k])
