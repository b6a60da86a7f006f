"""Plateaus of acceleration or velocity at which a joint saturates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.control.identification.log_segments import LogSegment
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.quantities import shared_unit
from armcontour.core.sampled_data import white_noise

# Derivatives are computed from parabolas through the fewest samples for which the noise is below
# this fraction of the largest derivative.
MAX_NOISE = 0.015
# Longest time that such a parabola spans on each side of its sample [s].
LONGEST_WINDOW = 0.04
# This percentile of the magnitudes of a derivative counts as the largest derivative, and is the
# first guess of a limit.
TOP_PERCENTILE = 99.0
# A limit is first searched within this fraction of the guess above and below it.
PLATEAU_RANGE = 0.1
# A value is at a limit if it differs from the limit by at most this fraction of the limit.
PLATEAU_SHARE = 0.01
# A value is also at a limit if it differs from the limit by at most this number of standard
# deviations of the noise.
PLATEAU_SIGMAS = 4.0
# Searches: derivative, kind of the limit, range, and time before and after a plateau [s] in which
# the limit also applies, because the joint accelerates to it. The narrow range finds a limit above
# a planned plateau.
SEARCHES = (
    (2, "acceleration", PLATEAU_RANGE, 0.0),
    (2, "acceleration", 2 * PLATEAU_SHARE, 0.0),
    (1, "velocity", PLATEAU_RANGE, 0.05),
)
# Smallest number of successive samples of a plateau.
FEWEST_SAMPLES = 4
# Shortest duration of a plateau [s].
SHORTEST_PLATEAU = 5e-3
# On a saturated plateau, the commanded acceleration exceeds the measured acceleration by more than
# this fraction of the largest acceleration. Velocities less than this fraction below a velocity
# limit are saturated too.
EXCESS = 0.05
# On a saturated plateau, the commanded acceleration also exceeds the measured acceleration by more
# than this multiple of the RMS error of the commanded acceleration at the unsaturated samples.
EXCESS_ERRORS = 4.0
# Number of dead times that are tried for the commanded acceleration.
DELAY_COUNT = 26
# Longest dead time that is tried for the commanded acceleration [s].
LONGEST_DELAY = 0.1
# Smallest fraction of saturated samples that counts as saturation.
LEAST_SHARE = 2e-3
# Smallest number of samples outside of plateaus to which the commanded acceleration is fitted.
FEWEST_FREE = 50
# If a joint is at its acceleration limit for more than this fraction of the time, models with
# undetermined K_p are rejected.
MAX_LIMIT_TIME = 0.5
# If the unsaturated samples of such a joint determine no model, the times of the reversals must
# determine it. This number of reversals is sufficient, one for each of K_p, K_v, feed-forward and
# dead time.
FEWEST_REVERSALS = 4
# Margin before and after saturated samples [s], because drives react up to one drive cycle later.
MARGIN = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Saturation:
    """Acceleration or velocity limit at which a joint saturates, and the affected samples."""

    kind: str  # "acceleration" or "velocity"
    limit: float  # The limit [rad/s² or rad/s]
    sd: float  # Standard deviation of the limit [rad/s² or rad/s]
    time: float  # Time at the limit [s]
    duration: float  # Total duration of the segments [s]
    reversals: int  # Number of changes between the positive and the negative limit
    clipped: tuple[BoolArray, ...]  # Mask of the samples that the limit affects, for each segment

    @property
    def hides(self) -> bool:
        """True if the joint is at its acceleration limit for too much time, see MAX_LIMIT_TIME."""
        return self.kind == "acceleration" and self.time > MAX_LIMIT_TIME * self.duration

    @property
    def determines_servo(self) -> bool:
        """True if a model with the limit can be fitted to all samples, see FEWEST_REVERSALS."""
        few = self.hides and self.reversals < FEWEST_REVERSALS
        return self.kind == "acceleration" and not few

    def describe(self, name: str, *, prismatic: bool = False) -> str:
        """Clause for messages, such as "joint 2 saturates at 3 rad/s² for 0.4 s of 10 s"."""
        unit = shared_unit("rad/s²" if self.kind == "acceleration" else "rad/s", [prismatic])
        limit = f"{self.limit:.3g} {unit}"
        return f"{name} saturates at {limit} for {self.time:.2g} s of {self.duration:.3g} s"

    def explain_no_model(self, name: str, *, prismatic: bool = False) -> str:
        """Note on a joint whose other samples do not determine its servo."""
        lower = "accelerations" if self.kind == "acceleration" else "velocities"
        cause = self.describe("it", prismatic=prismatic)
        return (
            f"{name} has no model, because {cause}, and the other samples do not "
            f"determine its servo. Record more motion at lower {lower}."
        )


def find_saturation(segments: Sequence[LogSegment]) -> Saturation | None:
    """Find plateaus of acceleration or velocity that the loop commands to exceed; None if none."""
    # The commanded acceleration is linear in position, velocity and command. Its coefficients are
    # fitted to the samples outside the plateaus. Therefore a planned plateau that the joint follows
    # is not saturation.
    motion = _MeasuredMotion(segments)
    for order, kind, share, transient in SEARCHES:
        # The test of a velocity plateau also requires the acceleration.
        windows = [motion.window(x) for x in {2, order}]
        if not all(windows):
            continue
        k = max(windows)
        values = motion.derive(order, k)
        noise = motion.noise(order, k)
        limit, plateaus = _find_plateaus(values, noise, share, motion.interval)
        if not plateaus.any():
            continue
        excluded = _widen(plateaus, 2 * k + round(transient / motion.interval))
        prediction = motion.predict_acceleration(k, ~excluded)
        if prediction is None:
            continue
        acceleration = motion.derive(2, k)
        demanded, error = prediction
        excess = np.sign(values) * (demanded - acceleration)
        top = float(np.percentile(np.abs(acceleration), TOP_PERCENTILE))
        threshold = max(EXCESS * top, EXCESS_ERRORS * error)
        clipped = np.full(len(values), False)
        for i, j in find_spans(plateaus):
            clipped[i:j] = np.median(excess[i:j]) > threshold
        if np.mean(clipped) < LEAST_SHARE:
            continue
        time = float(np.sum(clipped)) * motion.interval
        reversals = int(np.sum(np.diff(np.sign(values[clipped])) != 0))
        sizes = np.abs(values[clipped])
        sd = float(np.std(sizes) * np.sqrt((2 * k + 1) / len(sizes)))
        if order == 2:
            slack = max(EXCESS_ERRORS * error, EXCESS * PLATEAU_SHARE * limit)
            clipped |= np.abs(demanded) > limit + slack
        else:
            clipped |= np.abs(values) > (1 - EXCESS) * limit
        margin = k + max(round((MARGIN + transient) / motion.interval), 1)
        every = motion.at_samples(_widen(clipped, margin), k)
        duration = sum(float(t[-1] - t[0]) for t in motion.times)
        return Saturation(
            kind=kind, limit=limit, sd=sd, time=time, duration=duration, reversals=reversals,
            clipped=every,
        )  # fmt: skip
    return None


class _MeasuredMotion:
    """Measured motion of a joint on uniform times, and its derivatives from fitted parabolas."""

    # The parabola of a sample spans the `k` samples before and after it, so derivatives lack the
    # first `k` and the last `k` samples of a segment.

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
        """Standard deviation of the noise of a derivative [rad/s**order]."""
        return self.sigma * float(np.linalg.norm(_filter(order, k, self.interval)))

    def derive(self, order: int, k: int, signals: Sequence[FloatArray] | None = None) -> FloatArray:
        """Derivative of the positions or of other signals, concatenated over the segments."""
        weights = _filter(order, k, self.interval)
        every = self.positions if signals is None else signals
        return np.concatenate([np.convolve(x, weights, "valid") for x in every if len(x) > 2 * k])

    def window(self, order: int) -> int:
        """Half-width k of the filter of a derivative [samples]; 0 if noise dominates for all k."""
        longest = min(
            round(LONGEST_WINDOW / self.interval), max(len(x) for x in self.positions) // 4
        )
        for k in range(1, longest + 1):
            top = float(np.percentile(np.abs(self.derive(order, k)), TOP_PERCENTILE))
            if self.noise(order, k) < MAX_NOISE * top:
                return k
        return 0

    def predict_acceleration(self, k: int, free: BoolArray) -> tuple[FloatArray, float] | None:
        """Commanded acceleration [rad/s²], (n,), and its RMS error at the samples in `free`."""
        # None if the mask has too few samples for the fit.
        if np.sum(free) < FEWEST_FREE:
            return None
        acceleration = self.derive(2, k)
        best = None
        position = self.derive(0, k)
        velocity = self.derive(1, k)
        for delay in np.linspace(0.0, LONGEST_DELAY, DELAY_COUNT):
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
        """Convert a mask of derivatives to a mask of the samples of each segment."""
        masks = []
        done = 0
        for t, s in zip(self.times, self.segments, strict=True):
            times_mask = np.full(len(t), False)
            count = max(len(t) - 2 * k, 0)
            times_mask[k : k + count] = mask[done : done + count]
            done += count
            masks.append(times_mask[np.rint((s.command.t - t[0]) / self.interval).astype(np.intp)])
        return tuple(masks)


def _filter(order: int, k: int, interval: float) -> FloatArray:
    """Weights for `np.convolve`: middle derivative of a parabola fitted to 2 k + 1 samples."""
    from scipy.signal import savgol_coeffs

    return np.asarray(savgol_coeffs(2 * k + 1, 2, deriv=order, delta=interval))


def _find_plateaus(
    values: FloatArray, noise: float, first: float, interval: float
) -> tuple[float, BoolArray]:
    """Limit of a derivative, and the mask of the samples in plateaus at this limit."""
    sizes = np.abs(values)
    limit = float(np.percentile(sizes, TOP_PERCENTILE))
    width = PLATEAU_SIGMAS * noise
    plateaus = np.full(len(sizes), False)
    for share in (first, first / 2, *[PLATEAU_SHARE] * 5):
        near = np.abs(sizes - limit) <= max(share * limit, width)
        if not near.any():
            return limit, plateaus
        limit = float(np.median(sizes[near]))
    near = np.abs(sizes - limit) <= max(PLATEAU_SHARE * limit, width)
    fewest = max(FEWEST_SAMPLES, round(SHORTEST_PLATEAU / interval))
    for sign in (1.0, -1.0):
        for i, j in find_spans(near & (np.sign(values) == sign)):
            plateaus[i:j] = j - i >= fewest
    return limit, plateaus


def find_spans(mask: BoolArray) -> list[tuple[int, int]]:
    """Start and end index (exclusive) of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.intp)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _widen(mask: BoolArray, by: int) -> BoolArray:
    """The mask with each run of true values extended by `by` samples on both sides."""
    return np.asarray(np.convolve(mask, np.ones(2 * by + 1))[by : len(mask) + by] > 0.5)
