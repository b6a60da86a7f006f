"""Derivatives of a joint's measured motion, and the acceleration that its loop commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armcontour.control.identification.log_segments import LogSegment
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.sampled_data import white_noise

# Derivatives are computed from parabolas through the fewest samples for which the noise is below
# this fraction of the largest derivative.
MAX_NOISE = 0.015
# Longest time that such a parabola spans on each side of its sample [s].
LONGEST_WINDOW = 0.04
# Number of dead times that are tried for the commanded acceleration.
DELAY_COUNT = 26
# Longest dead time that is tried for the commanded acceleration [s].
LONGEST_DELAY = 0.1
# Smallest number of samples outside plateaus to which the commanded acceleration is fitted.
FEWEST_FREE = 50
# This percentile of a derivative, without signs, counts as the largest value, and is the first
# guess of a limit.
TOP_PERCENTILE = 99.0
# Singular values below this fraction of the largest one count as zero.
SINGULAR = 1e-10


class Demand(NamedTuple):
    """The acceleration that a loop commands, as estimated from the measured motion."""

    acceleration: FloatArray  # [rad/s²], (n,)
    error: float  # RMS error at the samples to which it was fitted [rad/s²]


class MeasuredMotion:
    """Measured motion of a joint on uniform times, and its derivatives from fitted parabolas.

    The parabola of a sample spans the k samples before and after it, so derivatives lack the first
    k and the last k samples of a segment.
    """

    def __init__(self, segments: Sequence[LogSegment]) -> None:
        self.segments = segments
        self.interval = float(np.median(np.diff(segments[0].command.t)))
        self.sigma = max(float(white_noise(s.y)) for s in segments)
        self.times = []
        for s in segments:
            start, end = s.command.t[[0, -1]]
            self.times.append(np.linspace(start, end, round((end - start) / self.interval) + 1))
        self.positions = [
            np.interp(t, s.command.t, s.y) for t, s in zip(self.times, segments, strict=True)
        ]

    def noise(self, order: int, k: int) -> float:
        """Return the standard deviation of the noise in a derivative [rad/s**order].

        - `k`: half-width of the parabola [samples].
        """
        return self.sigma * float(np.linalg.norm(_filter(order, k, self.interval)))

    def derive(self, order: int, k: int, signals: Sequence[FloatArray] | None = None) -> FloatArray:
        """Return a derivative of the positions or of other signals, (n,), with segments joined.

        - `k`: half-width of the parabola [samples].
        - `signals`: one signal per segment, at `times`.
        """
        weights = _filter(order, k, self.interval)
        chosen = self.positions if signals is None else signals
        return np.concatenate([np.convolve(x, weights, "valid") for x in chosen if len(x) > 2 * k])

    def window(self, order: int) -> int:
        """Return the half-width k with which noise does not dominate a derivative [samples].

        It is the smallest one, or 0 if noise dominates for all k.
        """
        longest = min(
            round(LONGEST_WINDOW / self.interval), max(len(x) for x in self.positions) // 4
        )
        for k in range(1, longest + 1):
            largest = float(np.percentile(np.abs(self.derive(order, k)), TOP_PERCENTILE))
            if self.noise(order, k) < MAX_NOISE * largest:
                return k
        return 0

    def predict_acceleration(self, k: int, free: BoolArray) -> Demand | None:
        """Predict the acceleration that the loop commands.

        The acceleration of a loop with feed-forward is

            ddq = c₁ (u - q) + c₂ dq + c₃ du + c₄ ddu + c₅

        with the position q and the delayed command u. The coefficients c are fitted for several
        delays, and those with the smallest error are used.

        - `k`: half-width of the derivatives [samples].
        - `free`: mask of the samples to which the coefficients are fitted, (n,).

        Returns:
            The acceleration; None if the mask has too few samples.
        """
        if np.sum(free) < FEWEST_FREE:
            return None
        measured = [self.derive(x, k) for x in range(3)]
        delays = np.linspace(0.0, LONGEST_DELAY, DELAY_COUNT)
        demands = [self._predict(k, free, measured, x) for x in delays]
        return min(demands, key=lambda x: x.error)

    def _predict(
        self, k: int, free: BoolArray, measured: Sequence[FloatArray], delay: float
    ) -> Demand:
        """Predict the commanded acceleration with a delay of the command [s].

        - `measured`: measured position, velocity and acceleration, (n,) each.
        """
        position, velocity, acceleration = measured
        pairs = zip(self.times, self.segments, strict=True)
        commands = [s.command.evaluate(t - delay) for t, s in pairs]
        u, du, ddu = (self.derive(x, k, commands) for x in range(3))
        columns = np.stack([u - position, velocity, du, ddu, np.ones(len(u))], axis=1)
        columns /= np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
        gains = np.linalg.lstsq(columns[free], acceleration[free], rcond=SINGULAR)[0]
        values = columns @ gains
        error = float(np.sqrt(np.mean((values - acceleration)[free] ** 2)))
        return Demand(values, error)

    def at_samples(self, mask: BoolArray, k: int) -> tuple[BoolArray, ...]:
        """Convert a mask of derivatives, (n,), to masks of each segment's samples.

        - `k`: half-width of the derivatives [samples].
        """
        masks = []
        start = 0
        for t, s in zip(self.times, self.segments, strict=True):
            times_mask = np.full(len(t), False)
            count = max(len(t) - 2 * k, 0)
            times_mask[k : k + count] = mask[start : start + count]
            start += count
            masks.append(times_mask[np.rint((s.command.t - t[0]) / self.interval).astype(np.intp)])
        return tuple(masks)


def _filter(order: int, k: int, interval: float) -> FloatArray:
    """Return weights for `np.convolve` that derive a parabola through 2 k + 1 samples.

    The derivative is that at the middle sample (A. Savitzky and M. Golay, Smoothing and
    Differentiation of Data, Analytical Chemistry 36, 1964).
    """
    from scipy.signal import savgol_coeffs

    return np.asarray(savgol_coeffs(2 * k + 1, 2, deriv=order, delta=interval))
