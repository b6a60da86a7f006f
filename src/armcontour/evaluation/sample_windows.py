"""Means of rates of change over windows between samples, with bounds on their errors.

Whatever a motion does between samples, these means are known: divided differences are means of
derivatives, with weights that are positive and integrate to 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Log:
    """Samples that were checked, with bounds on their errors.

    Args:
        t: Times, increasing [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq: Joint velocities [rad/s], (n, dof), or None.
        ddq: Joint accelerations [rad/s²], (n, dof), or None.
        errors: Bounds on the error of q, dq and ddq, (dof,) each.
        t_error: Bound on the error of every time [s], (n,).
        clock: Bound on the share by which all times may be stretched together.
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray | None
    ddq: FloatArray | None
    errors: tuple[FloatArray, FloatArray, FloatArray]
    t_error: FloatArray
    clock: float

    def spans(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Length of every window of `k` samples, and a bound on its error, (windows, 1) each."""
        span = (self.t[k:] - self.t[:-k])[:, None]
        return span, (self.t_error[k:] + self.t_error[:-k])[:, None] + self.clock * span

    def middles(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Middle times of windows of `k` samples [s], and joint positions near them [rad]."""
        return (self.t[k:] + self.t[:-k]) / 2, self.q[k // 2 : len(self.q) - k + k // 2]

    def errors_of(self, order: int) -> FloatArray:
        """Bounds on the error of q, dq or ddq at every sample, (n, dof)."""
        return np.tile(self.errors[order], (len(self.t), 1))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Windows:
    """Means of a quantity over windows, (windows, columns), with bounds on their errors."""

    mean: FloatArray
    error: FloatArray


def mean_rate(
    log: Log, y: FloatArray, off: FloatArray, k: int, *, both_ways: bool = False
) -> Windows:
    """Mean rate of change of `y` over windows of `k` samples.

    Args:
        log: The samples.
        y: Values at the samples, (n, columns).
        off: Bound on the error of y, (n, columns), or on the length of the error, (n, 1).
        k: Number of samples per window.
        both_ways: Whether the error bounds how much the true mean may be larger, too; otherwise
            only how much it may be smaller.
    """
    return _windows(log, y[k:] - y[:-k], off[k:] + off[:-k], k, both_ways=both_ways)


def second_rate(
    log: Log, y: FloatArray, off: FloatArray, k: int, *, both_ways: bool = False
) -> tuple[Windows, Windows, Windows]:
    """Mean rates of `y` before and after each middle sample, and of that rate over both.

    Arguments as of `mean_rate`; a window of the third result has 2 k samples.
    """
    chords = mean_rate(log, y, off, k, both_ways=True)
    before = Windows(mean=chords.mean[:-k], error=chords.error[:-k])
    after = Windows(mean=chords.mean[k:], error=chords.error[k:])
    step, off = 2 * (after.mean - before.mean), 2 * (before.error + after.error)
    return before, after, _windows(log, step, off, 2 * k, both_ways=both_ways)


def third_rate(log: Log, y: FloatArray, off: FloatArray, k: int) -> Windows:
    """Mean third derivative of `y` over windows of 3 k samples; arguments as of `mean_rate`."""
    if len(log.t) <= 3 * k:
        nothing = np.zeros((0, y.shape[1]))
        return Windows(mean=nothing, error=nothing[:, : off.shape[1]])
    _, _, second = second_rate(log, y, off, k, both_ways=True)
    step = 3 * (second.mean[k:] - second.mean[:-k])
    return _windows(log, step, 3 * (second.error[k:] + second.error[:-k]), 3 * k)


def _windows(
    log: Log, step: FloatArray, off: FloatArray, k: int, *, both_ways: bool = False
) -> Windows:
    """Means over windows of k samples, of a rate of which steps and their errors are known."""
    span, late = log.spans(k)
    mean = step / span
    size = np.abs(mean) if off.shape[1] > 1 else np.linalg.norm(mean, axis=1)[:, None]
    # The shortest true length of a window is never quite none.
    least = np.maximum(span - late, 1e-6 * span) if both_ways else span + late
    return Windows(mean=mean, error=(off + size * late) / least)
