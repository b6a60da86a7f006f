"""Residuals of the model of a joint: whiteness test, patterns, and recommended next recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.sampling import white_noise
from armcontour.motion.log import Log

# A pattern is reported if it explains at least this share of the squared residuals.
LEAST_EXPLAINED = 0.25
# Residuals are fast if their median frequency exceeds the median frequency of the command by this
# factor.
FAST_RATIO = 3.0
# The regressor of dry friction is tanh(velocity / (SLIDING_SHARE * largest velocity)), a smoothed
# sign function.
SLIDING_SHARE = 0.02
# Spacing of the samples from which velocities and accelerations are computed [s].
SAMPLE_SPACING = 8e-3
# Number of reweighted fits of the growth of residuals with velocity and acceleration.
REWEIGHTINGS = 5
# Description of each pattern of residuals, and the recording that is recommended for it.
PATTERNS = {
    "velocity": (
        "is in phase with the velocity, as with viscous friction or a changing delay",
        "the same program also at half its speed",
    ),
    "sign": (
        "has the sign of the velocity, as with dry friction or backlash",
        "slow reversals of this joint alone",
    ),
    "position": (
        "depends on the position, as with gravity",
        "the same program at half its speed, and a program around the positions of the work",
    ),
}
# The correlation length is the sum of the autocorrelations before the first one below this value.
LEAST_CORRELATION = 0.05
# Whiteness test: significance level, and smallest number of spectral lines of its low band.
SIGNIFICANCE, FEWEST_LINES = 0.01, 8
# POSITION_ROUNDING: differences of positions up to this share of their range are rounding errors.
# STEP_ROUNDING: largest relative deviation of a difference from a multiple of the encoder's
# resolution. VARIANCE_SLACK: relative excess over the variance of quantization that is still
# accepted.
POSITION_ROUNDING, STEP_ROUNDING, VARIANCE_SLACK = 1e-9, 0.01, 0.2


def describe_residuals(logs: Sequence[Log], j: int, rests: Sequence[FloatArray]) -> str:
    """Sentence that names the strongest pattern in the residuals [rad] and the next recording."""
    every: dict[str, list[FloatArray]] = {}
    residuals, pitches = [], []
    for log, errors in zip(logs, rests, strict=True):
        use = np.isfinite(errors)
        if not use.any():
            continue
        for name, columns in _patterns(log, j).items():
            some = columns[use]
            every.setdefault(name, []).append(some - some.mean(axis=0))
        residuals.append(errors[use] - errors[use].mean())
        both = residuals[-1], log.command[use, j]
        pitches.append([_median_frequency(x, log.interval) for x in both])
    if not residuals:
        return ""
    residual = np.concatenate(residuals)
    shares = {x: _explained_share(residual, np.concatenate(y)) for x, y in every.items()}
    name = max(shares, key=shares.__getitem__)
    fast, slow = np.mean(pitches, axis=0)
    if shares[name] < LEAST_EXPLAINED:
        if fast > FAST_RATIO * slow:
            pattern = f"is mostly above {fast:.3g} Hz, as with elastic joints"
            record = f"a multisine up to {4 * fast:.3g} Hz, sampled at 1 kHz"
        else:
            pattern, record = "has no known pattern", "one program twice, to see which part repeats"
    elif name in PATTERNS:
        pattern, record = PATTERNS[name]
    else:
        pattern = f"depends on the motion of {name}, as with coupled axes"
        record = f"the motion of each of the two joints while {name} or this joint rests"
    much = f" ({shares[name]:.0%} of its square)" if shares[name] >= LEAST_EXPLAINED else ""
    return f"The residual {pattern}{much}. Record {record}."


def fastest_motion(logs: Sequence[Log]) -> tuple[FloatArray, FloatArray]:
    """Largest velocities [rad/s] and accelerations [rad/s²] of commands, (dof,) each."""
    sizes = []
    for log in logs:
        some = slice(None, None, max(round(SAMPLE_SPACING / log.interval), 1))
        rates = np.gradient(log.command[some], log.t[some], axis=0)
        accelerations = np.gradient(rates, log.t[some], axis=0)
        sizes.append([np.abs(x).max(axis=0) for x in (rates, accelerations)])
    largest = np.max(sizes, axis=0)
    return largest[0], largest[1]


def scale_residuals(logs: Sequence[Log], j: int, rests: Sequence[FloatArray]) -> FloatArray:
    """RMS residual at rest [rad], its growth per velocity [s] and per acceleration [s²], (3,)."""
    # Model: the expected squared residual is the sum of the squares of these three parts.
    from scipy.optimize import nnls

    rows, squares = [], []
    for log, errors in zip(logs, rests, strict=True):
        use = np.isfinite(errors)
        rate = np.gradient(log.command[:, j], log.t)
        columns = (np.ones(len(rate)), rate, np.gradient(rate, log.t))
        rows.append(np.stack(columns, axis=1)[use] ** 2)
        squares.append(errors[use] ** 2)
    every, values = np.concatenate(rows), np.concatenate(squares)
    scale = np.maximum(np.linalg.norm(every, axis=0), 1e-300)
    parts, expected = np.zeros(3), np.full(len(values), max(float(values.mean()), 1e-300))
    # Weights are reciprocal because the scatter of a square is proportional to its expectation.
    for _ in range(REWEIGHTINGS):
        q, r = np.linalg.qr(every / scale / expected[:, None])
        parts = nnls(r, q.T @ (values / expected))[0] / scale
        expected = np.maximum(every @ parts, 1e-6 * expected.max())
    return np.asarray(np.sqrt(parts))


def tracking_residuals(log: Log, j: int) -> FloatArray:
    """Tracking errors of joint j less their regression on velocity and acceleration [rad], (n,)."""
    rate = np.gradient(log.command[:, j], log.t)
    columns = np.stack([rate, np.gradient(rate, log.t), np.ones(len(rate))], axis=1)
    lag = log.measured[:, j] - log.command[:, j]
    return np.asarray(lag - columns @ np.linalg.lstsq(columns, lag, rcond=None)[0])


def _patterns(log: Log, j: int) -> dict[str, FloatArray]:
    """Regressors of each pattern by name, at the samples of a log, (n, 1) or (n, 2)."""
    rates = np.gradient(log.command, log.t, axis=0)
    accelerations = np.gradient(rates, log.t, axis=0)
    q, rate = log.command[:, j], rates[:, j]
    columns = {
        "velocity": rate[:, None],
        "sign": np.tanh(rate / max(SLIDING_SHARE * float(np.abs(rate).max()), 1e-30))[:, None],
        "position": np.stack([np.sin(q), np.cos(q)], axis=1),
    }
    for k, name in enumerate(log.joint_names):
        if k != j:
            columns[name] = np.stack([rates[:, k], accelerations[:, k]], axis=1)
    return columns


def _explained_share(residual: FloatArray, columns: FloatArray) -> float:
    """Share of the squared residuals that a least-squares fit of the columns explains."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    remaining = residual - scaled @ np.linalg.lstsq(scaled, residual, rcond=None)[0]
    return 1.0 - float(remaining @ remaining) / max(float(residual @ residual), 1e-300)


def _median_frequency(signal: FloatArray, interval: float) -> float:
    """Median frequency of a signal [Hz]: half of its power is below this frequency."""
    power = np.cumsum(np.abs(np.fft.rfft(signal - signal.mean())) ** 2)
    k = int(np.searchsorted(power, power[-1] / 2))
    return float(np.fft.rfftfreq(len(signal), interval)[k])


def is_white(residuals: FloatArray, step: float) -> bool:
    """True if residuals [rad], (n,), are white except for quantization by the resolution `step`."""
    # F-tests compare the mean power of the lowest 8, 16, ... spectral lines with that of the rest.
    from scipy.stats import f

    # True if quantization explains the variance in excess of the white noise.
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
    """Resolution of an encoder [rad]: common divisor of all position differences, 0 if none."""
    steps = np.diff(np.unique(y))
    steps = steps[steps > POSITION_ROUNDING * max(float(np.ptp(y)), 1e-12)]
    if len(steps) < 2:
        return 0.0
    step = float(np.min(steps))
    differences = np.abs(steps / step - np.rint(steps / step))
    return step if np.all(differences < STEP_ROUNDING * np.maximum(steps / step, 1.0)) else 0.0


def correlation_length(residuals: FloatArray) -> float:
    """Correlation length of residuals [samples], at least 1 (white noise)."""
    n = len(residuals)
    power = np.abs(np.fft.rfft(residuals, 2 * n)) ** 2
    correlations = np.fft.irfft(power)[: max(n // 5, 1)]
    if correlations[0] <= 0:
        return 1.0
    correlations = correlations / correlations[0]
    below = np.flatnonzero(correlations < LEAST_CORRELATION)
    end = int(below[0]) if len(below) else len(correlations)
    return float(max(1.0, 1 + 2 * np.sum(correlations[1:end])))
