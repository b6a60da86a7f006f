"""Checks and repairs of the times of recorded motions.

`repair_times` is the only place that judges the times of a log; `identify`, `learn` and `check` use
it, and the readers use `follow_clock` for times that jump back. The true time between two samples
follows from the positions: with n joints it is

    τ = Σ w_j v_j Δq_j / Σ w_j v_j²,    w_j = 1 / σ_j²

where Δq_j are the steps of the positions, v_j the measured velocities (means of both samples;
without velocities the speed before and after, a median), and σ_j the deviations of Δq_j / Δt from
v_j. Only the median speed of neighbours finds a stall without velocities, but it does not measure
it, because a stall and lost samples then look alike. Therefore times are rebuilt only with
velocities, and otherwise refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampled_data import DEVIATION_PER_MEDIAN, interpolate, white_noise
from armcontour.motion.log import FEWEST, Log
from armcontour.motion.log_checks import GAP
from armcontour.motion.time_finding import TimeFinding, name_samples

# A longer sequence of equal positions is a rest of the joint [samples].
LONGEST_REPEAT = 10
# Smallest fraction of repeated positions in motion.
LEAST_REPEATED = 0.1
# A slow joint repeats positions because its encoder is coarse or it sticks. A joint is slow if the
# position after a repeat differs by less than this multiple of the log's smallest difference
# (median).
RESOLUTIONS = 4.0
# A joint is also slow if the position after a repeat differs by less than this fraction of the
# difference between two positions without repeats (medians).
SLOW_SHARE = 0.5
# Differences of positions up to this fraction of their range are rounding errors.
LOG_ROUNDING = 1e-9
# Times jitter if the standard deviation of their steps exceeds this fraction of the interval.
LEAST_JITTER = 0.02
# The other times describe a motion better if it deviates from a smooth motion by less than this
# fraction.
SMOOTHER = 0.8
# Replaces a divisor of zero.
SMALLEST_DIVISOR = 1e-300
# Number of samples over which the drift of a clock is averaged.
DRIFT_SAMPLES = 101
# Lower bound of speeds that are used as divisors [rad/s].
TINY_SPEED = 1e-9
# Number of intervals whose median is the speed about an interval (odd).
NEIGHBOURS = 9
# An interval or a shift of a position is wrong if it deviates by this fraction of the sample
# interval.
WRONG_SHARE = 0.5
# It must also exceed this multiple of its standard deviation.
WRONG_SIGMAS = 8.0
# It must also exceed this multiple of the jitter, which is this percentile of the deviations.
JITTER_FACTOR = 4.0
JITTER_PERCENTILE = 90
# Number of intervals over which an error of the times must not be made up for (odd).
PERSISTENCE = 7
# Intervals about a wrong one deviate by at most this multiple of their standard deviation more.
USUAL_SIGMAS = 3.0
# Positions of a sample belong to another cycle if they are shifted by a sample interval, up to this
# fraction of it.
SHIFT_SLACK = 0.35
# The speed about a torn sample may change by at most this fraction over its neighbours.
STEADY_SHARE = 1.0
# Longest time between two samples that velocities determine [s], because they are averaged.
LONGEST_REBUILT = 0.1
# With a longer sample interval [s], accelerations are not known well enough for longer times than
# GAP intervals.
SLOWEST_REBUILT = 5e-3
# An interval shorter than this fraction of the sample interval is that of a sample written twice.
EXTRA_SHARE = 0.25
# Number of velocities before and after a wrong interval from which accelerations are computed.
SLOPE_SAMPLES = 7
# Slopes of parabolas are used if their noise changes the time by at most this fraction.
LARGEST_SLOPE_ERROR = 0.02
# Times by slopes of lines and of parabolas may differ by this fraction (median).
LARGEST_DIFFERENCE = 0.03
# If the clock's rate also differs from 1 by more than this, the other intervals are wrong, too.
MANY_WRONG = 0.01
# Number of Gauss-Newton steps that solve for a wrong interval.
GAUSS_NEWTON_STEPS = 4
# Shortest rebuilt time, as a fraction of the sample interval.
SHORTEST_SHARE = 0.05
# Number of samples over which velocities and positions are compared.
FITTED_SAMPLES = 5
# Velocities are compared with positions if they are above this percentile of each joint.
FAST_PERCENTILE = 60
# Velocities fit the positions if this fraction of the compared ones agrees with them.
FITTING_SHARE = 0.7
# Largest difference of a clock's rate from 1. A larger one is that of another unit.
MAX_RATE_ERROR = 0.25
# Duration of the windows over which positions and integrated velocities are averaged [s].
RATE_WINDOW = 0.1
# Number of parts of a log whose scatter is the error of the clock's rate.
RATE_PARTS = 8
# Product of the gains of a fast servo [1/s²].
HELD_GAINS = 5e3
# Smallest difference of a clock's rate from 1 that is corrected.
LEAST_RATE_ERROR = 5e-4
# The difference must also exceed this multiple of its standard deviation.
RATE_SIGMAS = 4.0
# Remedies for times that cannot be rebuilt, without and with velocities.
RECORD_TIMES = (
    "Record the controller's own times, or also the measured velocities (columns such as "
    "measured velocity 1 [rad/s]), from which the times are rebuilt."
)
RECORD_FASTER = (
    "The measured velocities do not determine the true times. Record at a higher rate, or record "
    "the controller's own times."
)


def repair_times(log: Log) -> Log:
    """Find wrong times of a log, and repair them where the log determines the true ones.

    The repairs are `findings` of the log that is returned: torn samples and samples with old
    positions are interpolated, regular times replace those that jitter, and times that the measured
    velocities contradict are rebuilt from these.

    >>> from armcontour.motion.log_times import repair_times
    >>> t = np.arange(500) * 2e-3
    >>> q = 0.3 * np.sin(np.column_stack([5 * t, 4 * t + 1]))
    >>> q[[200, 300], 0] = q[[201, 301], 0]  # one cycle newer than joint 2
    >>> repaired = repair_times(ac.Log(t=t, command=q, measured=q))
    >>> [(x.kind, x.samples.tolist()) for x in repaired.findings]
    [('torn', [200, 300])]

    Args:
        log: A log.

    Raises:
        InvalidInput: Times are wrong, and no measured velocities determine the true ones.
    """
    if len(log.t) < FEWEST:
        return log
    log = _use_velocities(log)
    log = _leave_out_torn_samples(log)
    log = _rebuild_intervals(regularize_times(log))
    if not any(x.repair == "rebuilt" for x in log.findings):
        log = _correct_rate(log)
    return replace_repeated_positions(log)


def _with_finding(log: Log, finding: TimeFinding, **fields: Any) -> Log:
    """Return the log with a finding, and with other fields."""
    return replace(log, findings=(*log.findings, finding), **fields)


def _use_velocities(log: Log) -> Log:
    """Return the log without velocities that do not fit its positions.

    Raises:
        InvalidInput: The velocities fit with a factor, which is that of another unit.
    """
    v = log.velocity
    if v is None or not np.any(v):
        return replace(log, velocity=None)
    # Over several samples, the noise of the positions counts less.
    k = min(FITTED_SAMPLES, len(v) - 1)
    integral = np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(log.t)[:, None], axis=0)
    change = integral[k:] - integral[:-k]
    fast = np.abs(change) > np.percentile(np.abs(change), FAST_PERCENTILE, axis=0)
    fast &= np.abs(change) > 0
    steps = log.measured[k + 1 :] - log.measured[1:-k]
    factors = steps[fast] / change[fast]
    if not len(factors):
        return replace(log, velocity=None)
    factor = float(np.median(factors))
    if np.mean(np.abs(factors / factor - 1) < SHIFT_SLACK) < FITTING_SHARE or factor <= 0:
        note = (
            f"The measured velocities of {log.source} do not fit its positions, so they are not "
            "used."
        )
        return replace(log, velocity=None, notes=(*log.notes, note))
    if abs(factor - 1) > MAX_RATE_ERROR:
        raise InvalidInput(
            f"{log.source}: the positions change {factor:.3g} times as fast as the measured "
            "velocities say. Specify the units of positions, velocities and times, such as t [s], "
            "q1 [deg], dq1 [deg/s].",
            needed=factor,
            allowed=1 + MAX_RATE_ERROR,
        )
    return log


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Intervals:
    """True times between successive samples, relative to the recorded ones; arrays are (n - 1,)."""

    factor: FloatArray  # True time per recorded time
    deviation: FloatArray  # Standard deviation of `factor`
    bias: FloatArray  # Largest error of `factor` because accelerations change within an interval
    steps: FloatArray  # Recorded times between samples [s]
    steady: BoolArray  # Mask of the intervals about which the speed is known
    alone: BoolArray  # Mask of the intervals whose steps differ from those of both neighbours
    interval: float  # Usual time between two samples [s]
    measured: bool  # Whether the speeds were measured

    @classmethod
    def of(
        cls, log: Log, velocity: FloatArray | None, values: FloatArray | None = None
    ) -> _Intervals:
        """Compare steps of positions with velocities; None for the median of neighbouring steps.

        - `velocity`: measured velocities [rad/s], (n, dof).
        - `values`: the positions, by default the measured ones [rad], (n, dof).
        """
        from scipy.ndimage import median_filter

        q = log.measured if values is None else values
        steps = np.diff(log.t)
        rates = np.diff(q, axis=0) / steps[:, None]
        steady = np.full(len(steps), True)
        alone = steady
        largest_bias = np.zeros_like(rates)
        if velocity is None:
            speed = median_filter(rates, (NEIGHBOURS, 1), mode="nearest")
        else:
            speed = (velocity[1:] + velocity[:-1]) / 2
            bends = np.abs(np.diff(np.pad(velocity, ((1, 1), (0, 0)), mode="edge"), 2, axis=0))
            # Where an acceleration jumps in the middle of an interval
            largest_bias = (bends[1:] + bends[:-1]) / 8
        noise = np.sqrt(2) * white_noise(q) / log.interval
        scatter = DEVIATION_PER_MEDIAN * np.median(np.abs(rates - speed), axis=0)
        scale = np.maximum(np.maximum(noise, scatter), TINY_SPEED)
        power = np.maximum(np.sum((speed / scale) ** 2, axis=1), SMALLEST_DIVISOR)
        if velocity is None:
            # A joint that sticks and slips moves slowly.
            change = np.sum((_change(speed) / scale) ** 2, axis=1)
            steady = (change <= STEADY_SHARE**2 * power) & (
                power >= (WRONG_SIGMAS / WRONG_SHARE) ** 2
            )
            alone = _stands_out(rates / scale, speed / scale)
        return cls(
            factor=np.sum(rates * speed / scale**2, axis=1) / power,
            deviation=1 / np.sqrt(power),
            bias=np.sum(largest_bias * np.abs(speed) / scale**2, axis=1) / power,
            steps=steps,
            steady=steady,
            alone=alone,
            interval=log.interval,
            measured=velocity is not None,
        )

    @property
    def sure(self) -> BoolArray:
        """Mask of the intervals in which the joints move fast enough."""
        return np.asarray(WRONG_SIGMAS * self.deviation <= WRONG_SHARE)

    @property
    def times(self) -> FloatArray:
        """True times between samples [s]."""
        return self.factor * self.steps

    def find_wrong(self) -> BoolArray:
        """Return the mask of the intervals whose recorded times are wrong, (n - 1,).

        Around a wrong interval, most times are right. Otherwise the motion only changes quickly.
        """
        excess = self.times - self.steps
        jitter = float(np.percentile(np.abs(np.append(excess[self.sure], 0.0)), JITTER_PERCENTILE))
        least = np.maximum(
            max(WRONG_SHARE * self.interval, 0.0 if self.measured else JITTER_FACTOR * jitter),
            WRONG_SIGMAS * self.deviation * self.steps,
        )
        # The time does not run back, so a joint that does moves otherwise.
        forward = self.times > -WRONG_SHARE * self.interval
        wrong = np.abs(excess) > least + self.bias * self.steps
        wrong &= self.steady & self.alone & forward
        # After a gap, the motion may be another one, unless it continues as if there were none.
        after_gap = self.steps > GAP * self.interval
        continues = np.abs(self.times - self.interval) < SHIFT_SLACK * self.interval
        wrong &= ~after_gap | continues
        usual = wrong | (np.abs(self.factor - 1) < WRONG_SHARE + USUAL_SIGMAS * self.deviation)
        # A time that jitters is made up for by the next ones.
        window = np.ones(PERSISTENCE)
        remaining = np.convolve(np.where(self.sure | wrong, excess, 0.0), window, mode="same")
        wrong &= remaining * np.sign(excess) >= WRONG_SHARE * np.abs(excess)
        padded = np.pad(usual, 2, constant_values=True)
        alone = np.pad(wrong.astype(np.intp), 2)
        count = len(wrong)
        around = np.stack([padded[k : k + count] for k in range(5)])
        wrong_around = np.stack([alone[k : k + count] for k in range(5)])
        return np.asarray(wrong & around.all(axis=0) & (wrong_around.sum(axis=0) <= 2))


def _stands_out(rates: FloatArray, speed: FloatArray) -> BoolArray:
    """Return the mask of rates that differ from both neighbours, which agree, (n,).

    The rates are compared along `speed`. Both are relative to their deviations, (n, dof).
    """
    power = np.maximum(np.sum(speed**2, axis=1), SMALLEST_DIVISOR)
    padded = np.pad(rates, ((1, 1), (0, 0)), mode="edge")
    before = np.sum(padded[:-2] * speed, axis=1) / power
    own = np.sum(rates * speed, axis=1) / power
    after = np.sum(padded[2:] * speed, axis=1) / power
    agree = np.abs(before - after) < SHIFT_SLACK
    return np.asarray(agree & (np.abs(own - (before + after) / 2) > WRONG_SHARE))


def _change(speed: FloatArray) -> FloatArray:
    """Return how much speeds change over their neighbours, of the shape of `speed`."""
    half = NEIGHBOURS // 2
    padded = np.pad(speed, ((half, half), (0, 0)), mode="edge")
    return np.asarray(np.abs(padded[2 * half :] - padded[: -2 * half]))


def _leave_out_torn_samples(log: Log) -> Log:
    """Interpolate the positions of samples in which some or all joints are of another cycle.

    A joint that is a cycle older or newer than the others deviates from its own motion by one
    sample interval. Samples whose joints all repeat the previous positions are left out, too.
    """
    from scipy.ndimage import median_filter

    q = log.measured
    if len(q) <= NEIGHBOURS:
        return log
    # Controllers measure at regular times, also if the recorded times jitter.
    steps = np.diff(q, axis=0)
    speed = median_filter(steps, (NEIGHBOURS, 1), mode="nearest")
    # Rows of the following arrays are the samples 1 to n - 2.
    before = steps[:-1]
    after = steps[1:]
    middle = (speed[:-1] + speed[1:]) / 2
    size = np.maximum(np.abs(middle), SMALLEST_DIVISOR)
    # Shift of each position along its motion [sample intervals]: 1 is one cycle newer.
    shift = np.sign(middle) * (before - after) / 2 / size
    steady = _change(speed) <= STEADY_SHARE * np.abs(speed)
    passes = np.abs((before + after) / 2 - middle) <= size * WRONG_SHARE / 2
    # The sum of the squared weights of the three positions in `shift` is 3/2.
    deviation = np.sqrt(1.5) * white_noise(q) / size
    sure = steady[:-1] & steady[1:] & passes & (WRONG_SIGMAS * deviation <= WRONG_SHARE)
    newest = np.max(np.where(sure, shift, -np.inf), axis=1, keepdims=True)
    oldest = np.min(np.where(sure, shift, np.inf), axis=1, keepdims=True)
    is_newest = newest - shift < SHIFT_SLACK
    is_oldest = shift - oldest < SHIFT_SLACK
    torn = (np.abs(newest - oldest - 1) < SHIFT_SLACK)[:, 0]
    torn &= (is_newest | is_oldest | ~sure).all(axis=1)
    stale = sure & (before == 0) & (np.abs(shift + 1) < SHIFT_SLACK)
    stale |= sure & (after == 0) & (np.abs(shift - 1) < SHIFT_SLACK)
    repeated = stale.any(axis=1) & (stale | ~sure).all(axis=1)
    # A joint that repeats positions by itself has a coarse encoder or sticks.
    for kind, mask in (("torn", torn), ("repeated", repeated)):
        samples = np.flatnonzero(mask) + 1
        if len(samples):
            log = _interpolate_samples(log, kind, samples)
    return log


def _interpolate_samples(log: Log, kind: str, samples: IntArray) -> Log:
    """Interpolate the measured positions of some samples, with the finding."""
    from scipy.interpolate import CubicSpline

    others = np.delete(np.arange(len(log.t)), samples)
    measured = log.measured.copy()
    measured[samples] = CubicSpline(log.t[others], log.measured[others])(log.t[samples])
    cause = {
        "torn": "contain joints of two cycles (they are torn)",
        "repeated": "have the positions of the previous or next sample although the joints move",
    }[kind]
    finding = TimeFinding(
        kind=kind,
        samples=samples,
        t=log.t[samples],
        repair="left out",
        sentence=f"{log.source}: {name_samples(samples, log.t[samples])} {cause}. Their positions "
        "were left out, and interpolation replaces them.",
    )
    return _with_finding(log, finding, measured=measured)


def _refine_factors(log: Log, intervals: _Intervals, wrong: BoolArray) -> FloatArray:
    """Return the factors of intervals, those of wrong ones from velocities and accelerations.

    Their time τ solves `Δq = τ (v_0 + v_1) / 2 + τ² (a_0 - a_1) / 12`, which is exact for a cubic
    velocity. The accelerations a_0 before and a_1 after the interval are the slopes of parabolas
    through the nearest SLOPE_SAMPLES velocities at their ends, or of lines if the noise of the
    velocities is too large. Gauss-Newton steps solve for τ.

    Raises:
        InvalidInput: The samples are too far apart for these slopes: parabolas and lines give
            different times.
    """
    assert log.velocity is not None
    factor = intervals.factor.copy()
    noise = np.maximum(white_noise(log.measured), TINY_SPEED * log.interval)
    noise_v = white_noise(log.velocity)
    # Weights of the velocities after an interval in their slopes at the first of them.
    places = np.arange(SLOPE_SAMPLES) * log.interval
    line, parabola = (np.linalg.pinv(np.vander(places, n))[-2] for n in (2, 3))
    differences = [0.0]
    for i in np.flatnonzero(wrong).tolist():
        if not SLOPE_SAMPLES <= i + 1 <= len(log.t) - SLOPE_SAMPLES:
            continue
        before = log.velocity[i + 1 - SLOPE_SAMPLES : i + 1]
        after = log.velocity[i + 1 : i + 1 + SLOPE_SAMPLES]
        mean = (before[-1] + after[0]) / 2
        step = log.measured[i + 1] - log.measured[i]
        time = float(intervals.times[i])
        # Deviation of the steps due to the noise of the slopes, in multiples of their noise.
        spread = np.linalg.norm(parabola) * np.linalg.norm(noise_v / noise) * time**2 / 12
        exact = int(spread < LARGEST_SLOPE_ERROR * np.linalg.norm(step / noise))
        bends = [(-x @ before[::-1] - x @ after) / 12 / noise for x in (line, parabola)]
        times = [_solve_time(step / noise, mean / noise, x, time) for x in bends]
        factor[i] = times[exact] / intervals.steps[i]
        differences.append(abs(times[1] - times[0]) / max(abs(times[0]), log.interval) * exact)
    if np.median(differences) > LARGEST_DIFFERENCE:
        _refuse(log, intervals, wrong)
    return factor


def _solve_time(step: FloatArray, mean: FloatArray, bend: FloatArray, time: float) -> float:
    """Return the time τ [s] that solves `step = τ mean + τ² bend` best; arrays are (dof,).

    - `time`: first guess [s].
    """
    for _ in range(GAUSS_NEWTON_STEPS):
        gradient = mean + 2 * time * bend
        error = step - time * mean - time**2 * bend
        time += float(gradient @ error) / max(float(gradient @ gradient), SMALLEST_DIVISOR)
    return time


class _Cause(NamedTuple):
    """Intervals that are wrong for one reason."""

    kind: str
    words: str  # What the recorded times hide
    mask: BoolArray  # (n - 1,)


def _rebuild_intervals(log: Log) -> Log:
    """Rebuild wrong times between samples from the velocities.

    Raises:
        InvalidInput: Times are wrong, but there are no velocities, or these do not determine them.
    """
    v = log.velocity
    by_neighbours = _Intervals.of(log, None)
    unexplained = by_neighbours.find_wrong()
    if v is None:
        if unexplained.any():
            _refuse(log, by_neighbours, unexplained)
        return log
    intervals = _Intervals.of(log, v)
    wrong = intervals.find_wrong()
    commands = _Intervals.of(log, None, log.command)
    # If the commands move on by their usual steps, the positions are old, but the time passed.
    moves_on = commands.sure & (commands.factor > WRONG_SHARE)
    wrong &= ~(moves_on & (np.abs(intervals.factor) < EXTRA_SHARE) & _is_usual(intervals))
    intervals = replace(intervals, factor=_refine_factors(log, intervals, wrong))
    # Velocities that were computed from the recorded times do not contradict them.
    missed = unexplained & ~wrong
    if missed.any():
        _refuse(log, by_neighbours, missed)
    if not wrong.any():
        return log
    true = np.where(wrong, intervals.times, intervals.steps)
    longest = LONGEST_REBUILT if log.interval <= SLOWEST_REBUILT else GAP * log.interval
    undetermined = wrong & (true > longest)
    if undetermined.any():
        _refuse(log, intervals, undetermined)
    causes = _causes_of(commands, intervals, wrong)
    dropped = next(x.mask for x in causes if x.kind == "dropped")
    # Samples that were dropped leave whole intervals.
    true[dropped] = np.rint(true[dropped] / log.interval) * log.interval
    findings = [_describe(log, x, true) for x in causes if x.mask.any()]
    extra = next(x.mask for x in causes if x.kind == "extra")
    stalls = next(x.mask for x in causes if x.kind == "stall")
    true[extra] = 0.0
    kept = np.append(True, ~extra)
    filled = stalls | dropped
    rebuilt = _at_true_times(log, true, kept, filled, stalls)
    rate = _clock_rate(rebuilt)
    if rate is not None and abs(rate - 1) > MANY_WRONG:
        # The other times are wrong, too, by less than can be told for each of them.
        known = ~wrong & (intervals.deviation < WRONG_SHARE)
        least = SHORTEST_SHARE * log.interval
        true[known] = np.clip(intervals.times[known], least, LONGEST_REBUILT)
        rebuilt = _at_true_times(log, true, kept, filled, stalls)
    return replace(rebuilt, findings=(*log.findings, *findings))


def _causes_of(commands: _Intervals, intervals: _Intervals, wrong: BoolArray) -> list[_Cause]:
    """Divide wrong intervals by their causes.

    If commands continue at their speed over an interval, samples were dropped. If they move by the
    step of one cycle, the set-points waited.
    """
    usual = _is_usual(intervals)
    extra = wrong & usual & (intervals.factor < EXTRA_SHARE)
    late = wrong & usual & ~extra & (intervals.factor > 1)
    continues = commands.factor - 1 > WRONG_SHARE * (intervals.factor - 1)
    # Where the commands rest or turn, the cause is that of most other intervals.
    known = late & commands.steady
    continues = np.where(commands.steady, continues, 2 * continues[known].sum() > known.sum())
    return [
        _Cause("stall", "The set-points waited before", late & ~continues),
        _Cause("dropped", "Samples are missing before", late & continues),
        _Cause("extra", "No time passed before", extra),
        _Cause("clock set", "The clock was set before", wrong & ~late & ~extra),
    ]


def _is_usual(intervals: _Intervals) -> BoolArray:
    """Return the mask of the intervals whose recorded times are about the usual one, (n - 1,)."""
    interval = intervals.interval
    return np.asarray(np.abs(intervals.steps - interval) < WRONG_SHARE * interval)


def _describe(log: Log, cause: _Cause, true: FloatArray) -> TimeFinding:
    """Return the finding on wrong intervals.

    - `true`: true times between samples [s], (n - 1,).
    """
    samples = np.flatnonzero(cause.mask) + 1
    interval = float(np.median(true[cause.mask]))
    recorded = float(np.median(np.diff(log.t)[cause.mask]))
    return TimeFinding(
        kind=cause.kind,
        samples=samples,
        t=log.t[samples],
        interval=interval,
        repair="rebuilt",
        sentence=f"{log.source}: {cause.words} {name_samples(samples, log.t[samples])}: by the "
        f"measured velocities, {interval * 1e3:.3g} ms passed (median), but the times say "
        f"{recorded * 1e3:.3g} ms. The times were rebuilt from the velocities.",
    )


def _refuse(log: Log, intervals: _Intervals, wrong: BoolArray) -> None:
    """Raise the error for wrong times that the log does not determine."""
    samples = np.flatnonzero(wrong) + 1
    i = int(samples[0])
    factor = float(np.median(intervals.factor[wrong]))
    raise InvalidInput(
        f"The times of {log.source} are wrong: before {name_samples(samples, log.t[samples])}, the "
        f"positions change by {factor:.3g} times the speed before and after (median), as if a "
        "program had waited, samples were lost, or a clock was set. "
        + (RECORD_TIMES if log.velocity is None else RECORD_FASTER),
        index=i,
        t=float(log.t[i]),
    )


def _at_true_times(
    log: Log, true: FloatArray, kept: BoolArray, filled: BoolArray, stalls: BoolArray
) -> Log:
    """Return the log at true times, with samples in stalls and in place of dropped ones.

    Their measured positions are cubic Hermite polynomials of the positions and velocities. The
    command is held in stalls, and interpolated linearly where samples were dropped.

    - `true`: true times between samples [s], (n - 1,).
    - `kept`: mask of the samples to keep, (n,).
    - `filled`: mask of the intervals with new samples, (n - 1,).
    - `stalls`: mask of those that are stalls, (n - 1,).
    """
    from scipy.interpolate import CubicHermiteSpline

    assert log.velocity is not None
    t = log.t[0] + np.append(0.0, np.cumsum(true))
    new = []
    sources = []
    for i in np.flatnonzero(filled).tolist():
        count = max(int(np.rint((t[i + 1] - t[i]) / log.interval)) - 1, 0)
        new.append(t[i] + log.interval * np.arange(1, count + 1))
        sources.append(np.full(count, i))
    curve = CubicHermiteSpline(t[kept], log.measured[kept], log.velocity[kept])
    times = np.concatenate([t[kept], *new])
    rows = np.concatenate([np.flatnonzero(kept), *sources]).astype(np.intp)
    order = np.argsort(times, kind="stable")
    times = times[order]
    rows = rows[order]
    is_new = order >= int(kept.sum())
    measured = log.measured[rows]
    measured[is_new] = curve(times[is_new])
    velocity = log.velocity[rows]
    velocity[is_new] = curve(times[is_new], 1)
    command = log.command[rows]
    is_moving = is_new & ~np.append(stalls, False)[rows]
    command[is_moving] = interpolate(times[is_moving], t[kept], log.command[kept])
    plan_time = None
    if log.plan_time is not None:
        plan_time = np.interp(times, t[kept], log.plan_time[kept])
    return replace(
        log,
        t=times,
        command=command,
        measured=measured,
        velocity=velocity,
        plan_time=plan_time,
    )


def _clock_rate(log: Log) -> float | None:
    """Return the true time per recorded time by the velocities; None if it is 1 or unknown.

    Over a window, positions change by `r ∫ v dt + b Δt + d Δv`, where r is the true time per
    recorded time, b an offset of the velocities, and d their delay. Least squares determine the
    three for each joint. The standard deviation of r is that of fits without one part of the log
    each (jackknife).

    If the controller holds set-points, velocities ripple with their cycle T, and samples of a joint
    with the gains K_p and K_v are wrong by a fraction of up to `K_p K_v T² / 12`. Therefore such a
    difference from 1 is no finding, unless the log states linear interpolation.
    """
    v = log.velocity
    if v is None:
        return None
    window = max(round(RATE_WINDOW / log.interval), 1)
    count = len(log.t) // window
    if count < 5 * RATE_PARTS:
        return None
    steps = np.diff(log.t)
    integral = np.zeros_like(v)
    integral[1:] = np.cumsum((v[1:] + v[:-1]) / 2 * steps[:, None], axis=0)

    def change(values: FloatArray) -> FloatArray:
        """Return the changes of the means over windows, (count - 1, dof)."""
        means = values[: count * window].reshape(count, window, -1).mean(axis=1)
        return np.asarray(np.diff(means, axis=0))

    times = change(log.t[:, None])[:, 0]
    used = times < GAP * window * log.interval
    parts = (np.arange(count - 1) * RATE_PARTS) // (count - 1)
    dq = change(log.measured)
    columns = np.stack(
        [change(integral), np.broadcast_to(times[:, None], dq.shape), change(v)], axis=2
    )
    trials = [used, *(used & (parts != k) for k in range(RATE_PARTS))]
    rates = [_fit_rate(columns[x], dq[x]) for x in trials]
    rate = rates[0]
    deviation = float(np.std(rates[1:]) * np.sqrt(RATE_PARTS - 1))
    # NaN fails the comparison.
    differs = abs(rate - 1) > max(LEAST_RATE_ERROR, RATE_SIGMAS * deviation)
    if log.interpolation != "linear" and abs(rate - 1) < HELD_GAINS * log.interval**2 / 12:
        return None
    return rate if differs else None


def _correct_rate(log: Log) -> Log:
    """Correct the rate of a log's clock by the measured velocities."""
    rate = _clock_rate(log)
    if rate is None:
        return log
    finding = TimeFinding(
        kind="clock rate",
        samples=np.zeros(0, dtype=np.intp),
        t=np.zeros(0),
        rate=rate,
        repair="rebuilt",
        sentence=f"The clock of {log.source} runs {abs(1 / rate - 1):.2%} too "
        f"{'slow' if rate > 1 else 'fast'}, by the measured velocities. The times were corrected.",
    )
    return _with_finding(log, finding, t=log.t[0] + rate * (log.t - log.t[0]))


def _fit_rate(columns: FloatArray, dq: FloatArray) -> float:
    """Return the rate r of `_correct_rate`: the mean over the joints, weighted by information.

    - `columns`: changes of the integral, time and velocity, (m, dof, 3).
    - `dq`: changes of the positions [rad], (m, dof).
    """
    total = 0.0
    weights = 0.0
    for j in range(dq.shape[1]):
        a = columns[:, j]
        scale = np.linalg.norm(a, axis=0)
        if scale[0] <= 0:
            continue
        a = a[:, scale > 0]
        solution, *_ = np.linalg.lstsq(a, dq[:, j], rcond=None)
        residual = dq[:, j] - a @ solution
        others = a[:, 1:]
        own = a[:, 0] - others @ np.linalg.lstsq(others, a[:, 0], rcond=None)[0]
        weight = float(own @ own) / max(float(np.mean(residual**2)), SMALLEST_DIVISOR)
        total += weight * float(solution[0])
        weights += weight
    return total / weights if weights else np.nan


def follow_clock(
    t: FloatArray, q: FloatArray, dq: FloatArray | None, source: str
) -> tuple[FloatArray, TimeFinding | None]:
    """Return times that continue where the recorded ones jump back, by the measured velocities.

    Args:
        t: Recorded times [s], (n,).
        q: Measured positions [rad], (n, dof).
        dq: Measured velocities [rad/s], (n, dof); None if they were not recorded.
        source: Name of the recording, for messages.

    Returns:
        The times and the finding; None if the times do not jump back.

    Raises:
        InvalidInput: The velocities do not determine the time of a jump.
    """
    steps = np.diff(t)
    back = np.flatnonzero(steps < 0)
    if not len(back) or len(back) > len(t) / 10:
        # Times that jump back more often are in the wrong order or damaged.
        return t, None
    samples = back + 1
    interval = float(np.median(steps[steps > 0]))
    named = name_samples(samples, t[samples])
    true = np.full(len(back), np.nan)
    if dq is not None:
        noise = np.maximum(np.sqrt(2) * white_noise(q), SMALLEST_DIVISOR)
        speed = (dq[back] + dq[samples]) / 2 / noise
        power = np.maximum(np.sum(speed**2, axis=1), SMALLEST_DIVISOR)
        values = np.sum((q[samples] - q[back]) / noise * speed, axis=1) / power
        sure = WRONG_SIGMAS / np.sqrt(power) <= WRONG_SHARE * interval
        true[sure] = values[sure]
    wrong = ~((true > EXTRA_SHARE * interval) & (true < LONGEST_REBUILT))
    if wrong.any():
        i = int(samples[wrong][0])
        raise InvalidInput(
            f"The times of {source} jump back at {named}, as if a clock was set, and no measured "
            f"velocities determine the time of sample {i + 1}. Cut the log there (--start or "
            "--end), or record it again with one clock.",
            index=i,
            t=float(t[i]),
        )
    new = steps.copy()
    new[back] = true
    finding = TimeFinding(
        kind="clock set",
        samples=samples,
        t=t[samples],
        interval=float(np.median(true)),
        repair="rebuilt",
        sentence=f"The times of {source} jump back at {named}, because a clock was set. They were "
        "continued by the measured velocities.",
    )
    return t[0] + np.append(0.0, np.cumsum(new)), finding


def replace_repeated_positions(log: Log) -> Log:
    """Replace measured positions that repeat the previous position by interpolated ones.

    Rows that only repeat the previous row are removed.
    """
    q = log.measured
    repeated = np.stack([_find_repeats(x) for x in q.T], axis=1)
    joints = np.flatnonzero(repeated.any(axis=0))
    if not len(joints):
        return log
    from scipy.interpolate import CubicSpline

    rows = np.concatenate([log.command, q], axis=1)
    repeats_row = np.append(False, (np.diff(rows, axis=0) == 0).all(axis=1))
    remaining = ~(repeats_row & repeated.any(axis=1))
    interpolated = q.copy()
    for j in joints:
        new = ~repeated[:, j]
        interpolated[:, j] = CubicSpline(log.t[new], q[new, j])(log.t)
    names = ", ".join(log.joint_names[j] for j in joints)
    finding = TimeFinding(
        kind="renewed",
        samples=np.zeros(0, dtype=np.intp),
        t=np.zeros(0),
        repair="left out",
        sentence=f"{log.source} repeats {repeated[:, joints].mean():.0%} of the measured positions "
        f"of {names}. Interpolation between the new positions replaces them.",
    )
    return _with_finding(log, finding, measured=interpolated).at(remaining)


def regularize_times(log: Log) -> Log:
    """Replace times that jitter by regular times, if the samples are regular.

    Times of a computer that receives or writes samples jitter, which moves samples on a curve by
    speed times jitter. The samples are regular if the positions are smoother at regular times than
    at their own times. Lost samples are counted by the times.
    """
    steps = np.diff(log.t)
    interval = log.interval
    counts = np.maximum(np.rint(steps / interval), 1.0)
    without_gap = counts <= GAP
    interval = float(steps[without_gap].sum() / counts[without_gap].sum())
    jitter = float(np.std((steps - counts * interval)[without_gap]))
    if jitter <= LEAST_JITTER * interval:
        return log
    # If times jitter by half an interval, samples seem to be lost that are not. Therefore times
    # without lost samples are also tried.
    candidates = [_smooth_times(log.t, x) for x in (counts, np.ones_like(counts))]
    regular = min(candidates, key=lambda times: float(np.std(log.t - times)))
    measured = _compare_roughness(log.measured, log.t, regular)
    commanded = _compare_roughness(log.command, log.t, regular)
    ratio = commanded if SMOOTHER < measured < 1 / SMOOTHER else measured
    if ratio >= SMOOTHER or (np.diff(regular) <= 0).any():
        return log
    deviation = float(np.std(log.t - regular))
    finding = TimeFinding(
        kind="jitter",
        samples=np.zeros(0, dtype=np.intp),
        t=np.zeros(0),
        interval=float(np.median(np.diff(regular))),
        repair="regular",
        sentence=f"The times of {log.source} jitter by {deviation * 1e3:.2g} ms (standard "
        "deviation), but its positions are regular. Regular times "
        f"{np.median(np.diff(regular)) * 1e3:.4g} ms apart replace them.",
    )
    return _with_finding(log, finding, t=regular)


def _smooth_times(t: FloatArray, counts: FloatArray) -> FloatArray:
    """Return times without jitter [s], (n,): regular times that follow the clock's slow drift.

    `counts` are the numbers of sample intervals between successive times, (n - 1,).
    """
    from scipy.ndimage import uniform_filter1d

    numbers = np.concatenate([[0.0], np.cumsum(counts)])
    regular = np.polyval(np.polyfit(numbers, t, 1), numbers)
    return np.asarray(regular + uniform_filter1d(t - regular, DRIFT_SAMPLES, mode="nearest"))


def _compare_roughness(positions: FloatArray, t: FloatArray, regular: FloatArray) -> float:
    """Return the positions' roughness at regular times divided by that at their own times.

    - `positions`: joint positions [rad], (n, dof).
    - `t`, `regular`: the positions' own times and regular times [s], (n,) each.
    """
    return _roughness(positions, regular) / max(_roughness(positions, t), SMALLEST_DIVISOR)


def _roughness(positions: FloatArray, t: FloatArray) -> float:
    """Return the RMS deviation of positions, (n, dof), from cubics through four neighbours."""
    nodes = np.stack([t[:-4], t[1:-3], t[3:-1], t[4:]]) - t[2:-2]
    values = np.stack([positions[:-4], positions[1:-3], positions[3:-1], positions[4:]])
    predicted = np.zeros_like(positions[2:-2])
    for i, node in enumerate(nodes):
        others = np.delete(nodes, i, axis=0)
        weight = np.prod(others / (others - node), axis=0)
        predicted += weight[:, None] * values[i]
    return float(np.sqrt(np.mean((positions[2:-2] - predicted) ** 2)))


def _find_repeats(q: FloatArray) -> BoolArray:
    """Return the mask of a moving joint's positions that repeat the previous position, (n,).

    - `q`: measured positions of one joint [rad], (n,).
    """
    repeated = np.full(len(q), False)
    steps = np.abs(np.diff(q))
    # Sequences of equal positions between two changes: their numbers of samples, and the change
    # after each of them.
    changes = np.flatnonzero(steps > LOG_ROUNDING * np.ptp(q))
    lengths = np.diff(changes)
    jumps = steps[changes[1:]]
    moving = lengths <= LONGEST_REPEAT
    held = moving & (lengths > 1)
    single = lengths == 1
    if held.sum() <= LEAST_REPEATED * moving.sum():
        return repeated
    held_jump = float(np.median(jumps[held]))
    single_jump = float(np.median(jumps[single])) if single.any() else 0.0
    if held_jump < RESOLUTIONS * jumps.min() or held_jump < SLOW_SHARE * single_jump:
        # The joint is slow.
        return repeated
    starts = changes[:-1][held] + 1
    ends = changes[1:][held] + 1
    # The log may end before the next new position.
    if held[-1] and len(q) - 1 - changes[-1] <= lengths[-1]:
        starts = np.append(starts, changes[-1] + 1)
        ends = np.append(ends, len(q))
    for start, end in zip(starts, ends, strict=True):
        repeated[start + 1 : end] = True
    return repeated
