"""A log on a uniform grid of times, for the simulation of rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.sampling import interpolate, white_noise
from armcontour.motion import Log
from armcontour.robot.drives import regular_times

# Longest time step of the simulation [s]. It is 0.15 time constants of a velocity loop with K_v =
# 150 1/s.
LONGEST_STEP = 1e-3
# Error of linear interpolation midway between samples, as a share of the second difference.
LINE_ERROR = 1 / 8
# Lower bound of the noise of an encoder, because less noise is rounding error [rad].
LEAST_NOISE = 1e-7
# Cut-off frequency of the smoothed positions from which the simulation starts [Hz].
CUTOFF = 15.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogGrid:
    """A log, the grid of times on which it is simulated, and the compared samples."""

    log: Log
    held: bool  # True if each set-point is held until the next; else commands are interpolated
    t: FloatArray  # Times of the grid [s], (n,)
    smoothed: FloatArray  # Smoothed measured positions on the grid [rad], (n, dof)
    rows: slice  # Samples of the log that are compared with the simulation
    index: IntArray  # Indices of the four grid times around each compared sample, (samples, 4)
    weight: FloatArray  # Weights of these grid times in cubic interpolation, (samples, 4)

    @classmethod
    def from_log(
        cls, log: Log, interpolation: str, settled: float, *, step: float = LONGEST_STEP
    ) -> LogGrid:
        """Make the grid of a log; samples in the first `settled` seconds are not compared."""
        from scipy.interpolate import CubicSpline

        t = regular_times(float(log.t[0]), float(log.t[-1]), step)
        first = int(np.searchsorted(log.t, log.t[0] + settled))
        rows = slice(first, None, max(int(step / log.interval + 1e-6), 1))
        position = (log.t[rows] - t[0]) / (t[-1] - t[0]) * (len(t) - 1)
        near = np.round(position)
        # Times of a uniformly sampled log coincide with grid times, except for rounding errors.
        position = np.where(np.abs(position - near) < 1e-4, near, position)
        k = np.clip(np.floor(position).astype(np.intp) - 1, 0, len(t) - 4)
        x = position - k
        # Weights of cubic (Lagrange) interpolation.
        weight = [
            np.prod([(x - j) / (i - j) for j in range(4) if j != i], axis=0) for i in range(4)
        ]
        smooth = CubicSpline(log.t, low_pass(log.measured, log.interval))
        return cls(
            log=log,
            held=interpolation == "step",
            t=t,
            smoothed=checks.frozen_array(smooth(t)),
            rows=rows,
            index=k[:, None] + np.arange(4),
            weight=np.stack(weight, axis=1),
        )

    @property
    def step(self) -> float:
        """Time step of the grid [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def speed(self) -> FloatArray:
        """Joint velocities at the start of the grid [rad/s], (dof,)."""
        return np.asarray((self.smoothed[1] - self.smoothed[0]) / self.step)

    @property
    def noise(self) -> FloatArray:
        """Standard deviation of the noise of each joint's encoder [rad], (dof,)."""
        return np.asarray(np.maximum(white_noise(self.log.measured), LEAST_NOISE))

    def command(self, delay: float) -> FloatArray:
        """Command [rad] on the grid, delayed by the dead time `delay` [s], (n, dof)."""
        log, times = self.log, self.t - delay
        if self.held:
            # The small time allows for rounded times.
            k = np.searchsorted(log.t, times + 1e-6 * self.step, side="right") - 1
            return np.asarray(log.command[np.clip(k, 0, len(log.t) - 1)])
        return interpolate(times, log.t, log.command)

    def shifted_corner_command(self, delay: float) -> FloatArray:
        """Command on the grid if its corners are midway between the samples [rad], (n, dof)."""
        # The logged samples cut these corners. At an angular frequency ω and a sample interval T,
        # the true command is larger than their interpolation by the factor 1 / cos(ω T / 2), whose
        # series in differences of the samples is used here.
        second, fourth = (
            np.diff(np.pad(self.log.command, ((k, k), (0, 0)), mode="edge"), 2 * k, axis=0)
            for k in (1, 2)
        )
        sharp = self.log.command - LINE_ERROR * second + 1.5 * LINE_ERROR**2 * fourth
        return interpolate(self.t - delay, self.log.t, sharp)

    def sampled(self, values: FloatArray) -> FloatArray:
        """Interpolate values on the grid at the compared samples, (samples, ...)."""
        extra = (1,) * (values.ndim - 1)
        samples = np.zeros((len(self.index), *values.shape[1:]))
        for k in range(4):
            samples += self.weight[:, k].reshape(-1, *extra) * values[self.index[:, k]]
        return samples

    @property
    def measured(self) -> FloatArray:
        """Measured positions at the compared samples [rad], (samples, dof)."""
        return self.log.measured[self.rows]


def largest_noise(grids: list[LogGrid]) -> FloatArray:
    """Largest encoder noise of each joint in several logs, standard deviation [rad], (dof,)."""
    return np.asarray(np.max([x.noise for x in grids], axis=0))


def low_pass(values: FloatArray, interval: float) -> FloatArray:
    """Values after a zero-phase low-pass filter with the cut-off frequency CUTOFF, (n, ...)."""
    from scipy.signal import butter, sosfiltfilt

    nyquist = 0.5 / interval
    if nyquist * 0.9 <= CUTOFF:
        return values
    sos = butter(2, CUTOFF / nyquist, output="sos")
    lead = min(len(values) - 1, int(3 / (CUTOFF * interval)))
    return np.asarray(sosfiltfilt(sos, values, axis=0, padlen=lead))
