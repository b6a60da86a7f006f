"""Tests of residuals: whiteness, correlation, and the resolution of an encoder."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.sampled_data import white_noise

# The correlation length is the sum of the autocorrelations before the first one below this value.
LEAST_CORRELATION = 0.05
# Significance level of the whiteness test.
SIGNIFICANCE = 0.01
# The whiteness test begins with a low band of so many spectral lines.
FEWEST_LINES = 8
# Differences between positions up to this fraction of their range are rounding errors.
POSITION_ROUNDING = 1e-9
# Differences between positions deviate from multiples of the encoder's resolution by at most this
# fraction.
STEP_ROUNDING = 0.01
# Residuals are quantized white noise if their variance in excess of the white noise exceeds the
# variance of quantization by at most this fraction.
VARIANCE_SLACK = 0.2


def is_white(residuals: FloatArray, step: float) -> bool:
    """Return whether residuals [rad], (n,), are white up to quantization by `step` [rad].

    F-tests compare the mean power of the lowest 8, 16, ... spectral lines with that of the others.
    The significance level is divided by the number of tests (Bonferroni). Residuals are also white
    if quantization explains the variance that exceeds the white noise.
    """
    from scipy.stats import f

    if np.var(residuals) - white_noise(residuals) ** 2 <= (1 + VARIANCE_SLACK) * step**2 / 12:
        return True
    power = np.abs(np.fft.rfft(residuals - np.mean(residuals))[1:]) ** 2
    n = len(power)
    chances: list[float] = []
    while (m := FEWEST_LINES << len(chances)) <= n / 2:
        ratio = np.mean(power[:m]) / max(float(np.mean(power[m:])), 1e-300)
        chances.append(float(f.sf(ratio, 2 * m, 2 * (n - m))))
    return not chances or min(chances) * len(chances) > SIGNIFICANCE


def encoder_resolution(y: FloatArray) -> float:
    """Return the common divisor of all position differences [rad]; 0 if there is none."""
    steps = np.diff(np.unique(y))
    steps = steps[steps > POSITION_ROUNDING * max(float(np.ptp(y)), 1e-12)]
    if len(steps) < 2:
        return 0.0
    step = float(np.min(steps))
    differences = np.abs(steps / step - np.rint(steps / step))
    return step if np.all(differences < STEP_ROUNDING * np.maximum(steps / step, 1.0)) else 0.0


def correlation_length(residuals: FloatArray) -> float:
    """Return the correlation length of residuals [samples], at least 1 (white noise).

    It is 1 plus twice the sum of the autocorrelations before the first one below LEAST_CORRELATION.
    """
    n = len(residuals)
    power = np.abs(np.fft.rfft(residuals, 2 * n)) ** 2
    correlations = np.fft.irfft(power)[: max(n // 5, 1)]
    if correlations[0] <= 0:
        return 1.0
    correlations = correlations / correlations[0]
    below = np.flatnonzero(correlations < LEAST_CORRELATION)
    end = int(below[0]) if len(below) else len(correlations)
    return float(max(1.0, 1 + 2 * np.sum(correlations[1:end])))
