"""Detection of saturated samples in a log: acceleration or velocity limits of a drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.identification.estimates import UNITS, Estimate
from armcontour.control.identification.joint_fit import (
    REACH,
    LogSegment,
    Model,
    Problem,
    Search,
    estimate_parameters,
    fit,
    predict,
)
from armcontour.control.identification.least_squares import allowed_deviation
from armcontour.control.identification.selection import (
    GAIN,
    KP,
    LIMIT,
    Selected,
    is_implausible,
    predict_parts,
    select,
)
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.sampling import white_noise
from armcontour.robot.servo.simulation import JointServo

# Derivatives are those of parabolas over the fewest samples with which noise is at most this share
# of the largest derivative, and over at most this time before and after [s].
NOISY, LONGEST = 0.015, 0.04
# Percentile of a derivative that is near its limit, and the range about it, as a share of it.
TOP, RANGE = 99.0, 0.1
# Values at a limit differ by at most this share of it or this many deviations of the noise.
EQUAL, SIGMAS = 0.01, 4.0
# Fewest successive samples at a limit, and the shortest time [s].
FEWEST_EQUAL, SHORTEST = 4, 5e-3
# At a limit the commanded acceleration exceeds the measured one by at least this share of the
# largest acceleration, and by this many times its error at the other samples.
EXCESS, ERRORS = 0.05, 4.0
# Dead times that are tried for the commanded acceleration: number, and longest one [s].
DELAYS, LATEST = 26, 0.1
# Smallest share of samples at a limit, and fewest samples to fit the commanded acceleration.
LEAST_SHARE, FEWEST_FREE = 2e-3, 50
# Smallest and largest multiple of the measured limit that is tried, and their number.
REFINED = (0.98, 1.06, 9)
# Fewest samples in a row that are fitted: shorter segments only determine their initial state.
FEWEST_BETWEEN = 20
# With more segments, their free initial states would explain most of the motion.
MAX_BETWEEN = 40
# Above this share of time at a limit, undetermined gains are not accepted as a model.
HIDDEN = 0.5
# Margin about clipped samples [s]: drives with a cycle react up to one cycle later.
MARGIN = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Saturation:
    """Saturation of a joint."""

    kind: str  # "acceleration" or "velocity"
    # limit, sd: the limit and its standard deviation [rad/s² or rad/s].
    limit: float
    sd: float
    # time, duration: time at the limit and of the logs [s].
    time: float
    duration: float
    clipped: tuple[BoolArray, ...]  # Samples of each segment that the limit affects

    @property
    def hides(self) -> bool:
        """True if the joint is at its acceleration limit for more than HIDDEN of the time."""
        return self.kind == "acceleration" and self.time > HIDDEN * self.duration

    def describe(self, name: str) -> str:
        """Clause on the saturation of the joint with this name."""
        limit = f"{self.limit:.3g} {'rad/s²' if self.kind == 'acceleration' else 'rad/s'}"
        return f"{name} saturates at {limit} for {self.time:.2g} s of {self.duration:.3g} s"


def find_saturation(segments: Sequence[LogSegment]) -> Saturation | None:
    """Find plateaus of acceleration or velocity at which the loop commands a larger value."""
    # The commanded acceleration is linear in position, velocity and command, and is fitted to the
    # other samples. So motion that is planned at a limit and follows its command is not saturation.
    motion = _MeasuredMotion(segments)
    for order, kind in ((2, "acceleration"), (1, "velocity")):
        # The test of a velocity plateau needs the acceleration, too.
        windows = [motion.window(x) for x in {2, order}]
        if not all(windows):
            continue
        k = max(windows)
        values, noise = motion.derive(order, k), motion.noise(order, k)
        limit, plateaus = _find_plateaus(values, noise, motion.interval)
        prediction = motion.predict_acceleration(k, ~_widen(plateaus, 2 * k))
        if prediction is None:
            continue
        acceleration, (demanded, error) = motion.derive(2, k), prediction
        excess = np.sign(values) * (demanded - acceleration)
        top = float(np.percentile(np.abs(acceleration), TOP))
        threshold = max(EXCESS * top, ERRORS * error)
        clipped = np.full(len(values), False)
        for i, j in _spans(plateaus):
            clipped[i:j] = np.median(excess[i:j]) > threshold
        if np.mean(clipped) < LEAST_SHARE:
            continue
        time = float(np.sum(clipped)) * motion.interval
        sizes = np.abs(values[clipped])
        sd = float(np.std(sizes) * np.sqrt((2 * k + 1) / len(sizes)))
        if order == 2:
            slack = max(ERRORS * error, EXCESS * EQUAL * limit)
            clipped |= np.abs(demanded) > limit + slack
        margin = k + max(round(MARGIN / motion.interval), 1)
        every = motion.at_samples(_widen(clipped, margin), k)
        duration = sum(float(t[-1] - t[0]) for t in motion.times)
        return Saturation(
            kind=kind, limit=limit, sd=sd, time=time, duration=duration, clipped=every
        )
    return None


def select_between(
    segments: Sequence[LogSegment], saturation: Saturation, search: Search
) -> Selected | None:
    """Select the model of a joint from the samples that its limit does not affect."""
    # Position and velocity are free after each saturated interval. A fit of all samples with the
    # limit is preferred if its error between these intervals is no larger and its K_p is more
    # certain. None if the limit affects too many samples, or too many intervals.
    between = [
        s.cut(i, j)
        for s, clipped in zip(segments, saturation.clipped, strict=True)
        for i, j in _spans(~clipped)
        if np.sum(s.use[i:j]) >= FEWEST_BETWEEN
    ]
    if not between or len(between) > MAX_BETWEEN:
        return None
    free = select(between, search, limited=False)
    if free is None:
        return None
    if saturation.kind == "velocity" or free.fit.problem.model.order != "second":
        return replace(predict_parts(free.fit, segments), rivals=free.rivals)
    order, names = free.fit.problem.model
    problem = Problem(Model(order, (*names, LIMIT)), segments, search)
    start = {**free.fit.servo._asdict(), LIMIT: saturation.limit}
    whole = fit(problem, [problem.guess(start, free.fit.servo.dead_time)])
    squares = _error(between, whole.servo._replace(acceleration_limit=np.inf), search.drive_cycle)
    rms = (squares / sum(float(np.sum(s.weight)) for s in between)) ** 0.5
    certain = [estimate_parameters(x)[KP].sd for x in (whole, free.fit)]
    if not is_implausible(whole) and rms * GAIN < free.rms and certain[0] < certain[1]:
        return replace(predict_parts(whole), rivals=free.rivals)
    # Smoothing lowers short plateaus, so larger limits are tried, too.
    measured, servo = saturation.limit, free.fit.servo
    value = min(
        (measured, *measured * np.linspace(*REFINED)),
        key=lambda x: _error(segments, servo._replace(acceleration_limit=x), search.drive_cycle),
    )
    sd = max(saturation.sd, abs(value - measured) / 2)
    limit = Estimate(
        name=LIMIT, unit=UNITS[LIMIT], value=float(value), sd=sd, low=value - REACH * sd,
        high=value + REACH * sd, determined=bool(sd <= allowed_deviation(value)),
    )  # fmt: skip
    return replace(predict_parts(free.fit, segments, limit), rivals=free.rivals)


def _error(segments: Sequence[LogSegment], servo: JointServo, drive_cycle: float) -> float:
    """Sum of the squared errors of a servo of second order, weighted by motion [rad²]."""
    errors = [s.y - predict(s, servo, "second", drive_cycle) for s in segments]
    return sum(float(s.weight @ x**2) for s, x in zip(segments, errors, strict=True))


class _MeasuredMotion:
    """Motion of a joint at regular times, and its derivatives by parabolas."""

    # A parabola spans `k` samples before and after its own, so derivatives lack `k` samples at both
    # ends of a segment.

    def __init__(self, segments: Sequence[LogSegment]) -> None:
        self.segments = segments
        self.interval = float(np.median(np.diff(segments[0].command.t)))
        self.sigma = max(float(white_noise(s.y)) for s in segments)
        self.times = []
        for s in segments:
            first, last = s.command.t[[0, -1]]
            self.times.append(np.linspace(first, last, round((last - first) / self.interval) + 1))
        self.positions = [
            np.interp(t, s.command.t, s.y) for t, s in zip(self.times, segments, strict=True)
        ]

    def noise(self, order: int, k: int) -> float:
        """Standard deviation of the noise of a derivative."""
        return self.sigma * float(np.linalg.norm(_filter(order, k, self.interval)))

    def derive(self, order: int, k: int, signals: Sequence[FloatArray] | None = None) -> FloatArray:
        """A derivative of the positions or of other signals, segments concatenated."""
        weights = _filter(order, k, self.interval)
        every = self.positions if signals is None else signals
        return np.concatenate([np.convolve(x, weights, "valid") for x in every if len(x) > 2 * k])

    def window(self, order: int) -> int:
        """Half width in samples of the filter for a derivative; 0 if it would be noise."""
        longest = min(round(LONGEST / self.interval), max(len(x) for x in self.positions) // 4)
        for k in range(1, longest + 1):
            top = float(np.percentile(np.abs(self.derive(order, k)), TOP))
            if self.noise(order, k) < NOISY * top:
                return k
        return 0

    def predict_acceleration(self, k: int, free: BoolArray) -> tuple[FloatArray, float] | None:
        """Acceleration that the loop commands [rad/s²], (n,), and its RMS error at free samples."""
        # None if there are too few free samples for the fit.
        if np.sum(free) < FEWEST_FREE:
            return None
        acceleration, best = self.derive(2, k), None
        position, velocity = self.derive(0, k), self.derive(1, k)
        for delay in np.linspace(0.0, LATEST, DELAYS):
            every = zip(self.times, self.segments, strict=True)
            commands = [s.command.evaluate(t - delay) for t, s in every]
            u, du, ddu = (self.derive(x, k, commands) for x in range(3))
            columns = np.stack([u - position, velocity, du, ddu, np.ones(len(u))], axis=1)
            columns /= np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
            gains = np.linalg.lstsq(columns[free], acceleration[free], rcond=1e-10)[0]
            values = columns @ gains
            error = float(np.sqrt(np.mean((values - acceleration)[free] ** 2)))
            if best is None or error < best[1]:
                best = values, error
        return best

    def at_samples(self, mask: BoolArray, k: int) -> tuple[BoolArray, ...]:
        """The mask of derivatives, resampled at the samples of each segment."""
        masks, done = [], 0
        for t, s in zip(self.times, self.segments, strict=True):
            times_mask = np.full(len(t), False)
            count = max(len(t) - 2 * k, 0)
            times_mask[k : k + count] = mask[done : done + count]
            done += count
            masks.append(times_mask[np.rint((s.command.t - t[0]) / self.interval).astype(np.intp)])
        return tuple(masks)


def _filter(order: int, k: int, interval: float) -> FloatArray:
    """Weights of `np.convolve` for a derivative of the parabola through 2 k + 1 samples."""
    from scipy.signal import savgol_coeffs

    return np.asarray(savgol_coeffs(2 * k + 1, 2, deriv=order, delta=interval))


def _find_plateaus(values: FloatArray, noise: float, interval: float) -> tuple[float, BoolArray]:
    """The limit of a derivative, and the runs of samples at it."""
    sizes = np.abs(values)
    limit, width = float(np.percentile(sizes, TOP)), SIGMAS * noise
    plateaus = np.full(len(sizes), False)
    for share in (RANGE, RANGE / 2, *[EQUAL] * 5):
        near = np.abs(sizes - limit) <= max(share * limit, width)
        if not near.any():
            return limit, plateaus
        limit = float(np.median(sizes[near]))
    near = np.abs(sizes - limit) <= max(EQUAL * limit, width)
    fewest = max(FEWEST_EQUAL, round(SHORTEST / interval))
    for sign in (1.0, -1.0):
        for i, j in _spans(near & (np.sign(values) == sign)):
            plateaus[i:j] = j - i >= fewest
    return limit, plateaus


def _spans(mask: BoolArray) -> list[tuple[int, int]]:
    """Start and end indices of the runs of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.intp)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _widen(mask: BoolArray, by: int) -> BoolArray:
    """The mask, extended by some samples before and after each run."""
    return np.asarray(np.convolve(mask, np.ones(2 * by + 1))[by : len(mask) + by] > 0.5)
