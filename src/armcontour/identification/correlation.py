"""How residuals depend on each other, and what that does to the variance of an estimate.

Two causes are told apart. Residuals may depend on those shortly before, as after a filter. Or they
repeat: under a command that repeats, the error of a coarse encoder does so too, and each repetition
tells nothing new.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray

# Residuals are white, and do not repeat, unless chance would make them so in one log of a thousand.
WHITE = 1e-3
# Lags at which residuals are looked at for whiteness.
LAGS = 20
# Lines of the spectrum at frequency zero. More of them would take in frequencies that the sum of
# the scores does not have, fewer would leave the variance itself uncertain.
LINES = 24
# Samples for each line.
PER_LINE = 4
# Commands repeat if this share of their rates does.
REPEATS = 0.95
# Rates beyond this many times their mean size are jumps, which need not repeat.
JUMP = 4.0


def correlations(values: FloatArray, most: int) -> FloatArray:
    """Autocorrelation at the lags 1 to `most`, (most,)."""
    # A mean is not taken out: noise has none.
    power = max(float(values @ values), 1e-300)
    size = 2 ** math.ceil(math.log2(len(values) + most))
    spectrum = np.abs(np.fft.rfft(values, size)) ** 2
    return np.asarray(np.fft.irfft(spectrum)[1 : most + 1] / power)


def whiteness(residuals: FloatArray) -> float:
    """Probability that white residuals are as correlated as these (Ljung and Box)."""
    n = len(residuals)
    lags = min(LAGS, n // 5)
    rho = correlations(residuals, lags)
    statistic = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return _chance(statistic, lags)


def find_period(command: FloatArray) -> int:
    """Samples after which commands repeat; 0 if they do not within the log.

    Args:
        command: Set-points [rad], (n,).
    """
    n = len(command)
    rates = np.diff(command)
    usual = float(np.mean(np.abs(rates)))
    rates = np.clip(rates, -JUMP * usual, JUMP * usual)
    most = n - n // 8
    # Each lag has the samples that it has: a repetition at the end counts in full.
    power = np.concatenate([[0.0], np.cumsum(rates**2)])
    lags = np.arange(1, most)
    both = power[-1 - lags] * (power[-1] - power[lags])
    shared = correlations(rates, most - 1) * float(rates @ rates)
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = np.where(both > 0, shared / np.sqrt(both), 1.0)
    # Neighbours are alike without repeating.
    apart = int(np.argmax(alike < 0.5))
    if not alike[apart] < 0.5:
        return 0
    again = np.flatnonzero(alike[apart:] > REPEATS)
    if len(again) == 0:
        return 0
    first = apart + int(again[0])
    # The top of the peak, not its foot.
    while first + 1 < len(alike) and alike[first + 1] > alike[first]:
        first += 1
    return first + 1


def repeats(residuals: FloatArray, period: int) -> bool:
    """Whether residuals repeat after `period` samples, more than chance would have it."""
    if not 0 < period < len(residuals):
        return False
    counts = np.bincount(np.arange(len(residuals)) % period, minlength=period)
    sums = _fold(residuals[None, :], period)[0]
    variance = max(float(np.mean(residuals**2)), 1e-300)
    return _chance(float(np.sum(sums**2 / counts)) / variance, period) < WHITE


def long_run(scores: FloatArray, weights: FloatArray, period: int) -> tuple[FloatArray, int]:
    """Covariance of the sum of correlated scores, from the lowest lines of their spectrum.

    The scores of a best fit have the sum zero, so the line at frequency zero tells nothing, and its
    neighbours take its place (Müller, Econometrica 2007; Lazarus and others, J. Bus. Econ. Stat.
    2018). Scores that repeat are added up over the repetitions first.

    Args:
        scores: Derivatives times residuals, (free, n).
        weights: Information of each sample, (n,): samples without any take no time.
        period: Samples after which residuals repeat, or 0.

    Returns:
        The covariance, (free, free), and its degrees of freedom.
    """
    if period:
        scores, weights = (_fold(x, period) for x in (scores, weights[None, :]))
        weights = weights[0]
    n = scores.shape[1]
    lines = max(min(LINES, n // PER_LINE), 2)
    clock = np.cumsum(weights) - weights / 2
    clock /= max(float(np.sum(weights)), 1e-300)
    if period:
        turns = 2 * np.pi * np.outer(clock, np.arange(1, lines // 2 + 1))
        waves = math.sqrt(2) * np.hstack([np.cos(turns), np.sin(turns)])
    else:
        waves = math.sqrt(2) * np.cos(np.pi * np.outer(clock, np.arange(1, lines + 1)))
    found = scores @ waves
    count = waves.shape[1]
    return np.asarray(found @ found.T / count), count


def _fold(values: FloatArray, period: int) -> FloatArray:
    """Sums over all repetitions, (rows, period), of values (rows, n)."""
    rows, n = values.shape
    whole = np.zeros((rows, math.ceil(n / period) * period))
    whole[:, :n] = values
    return np.asarray(whole.reshape(rows, -1, period).sum(axis=1))


def _chance(statistic: float, freedom: int) -> float:
    """Probability of a chi-squared statistic at least as large."""
    from scipy.special import gammaincc

    return float(gammaincc(freedom / 2, statistic / 2))
