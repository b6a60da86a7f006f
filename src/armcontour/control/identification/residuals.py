"""Residuals of a joint: whiteness test, patterns, and the recommended next recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.sampling import white_noise
from armcontour.motion.log import Log

# A pattern is named if it explains this share of the squared residuals.
NAMED = 0.25
# Residuals are fast if half of their power is above this multiple of that frequency of the motion.
FAST = 3.0
# Velocity below which dry friction is not at its full size, as a share of the largest one.
SLIDING = 0.02
# Velocities and accelerations are those over this time [s].
SMOOTHED = 8e-3
# Fits of the scaling of residuals, each with the weights of the one before.
REWEIGHTED = 5
# Patterns of residuals: description and recommended recording.
PATTERNS = {
    "velocity": (
        "is in phase with velocity, as by viscous friction or a changing delay",
        "the same program at half its speed, too",
    ),
    "sign": (
        "has the sign of velocity, as by dry friction or backlash",
        "slow reversals of this joint alone",
    ),
    "position": (
        "follows position, as by gravity",
        "the same program at half its speed, and one about the positions of the work",
    ),
}
# Correlations of residuals below this are not significant.
UNCORRELATED = 0.05
# Significance level of the whiteness test, and the fewest spectral lines that it compares.
CHANCE, FEWEST_LINES = 0.01, 8
# Rounding of positions as a share of their range, and of multiples of an encoder's step; variance
# of an encoder's resolution may be larger by this share.
ROUNDED, STEP_ROUNDING, SLACK = 1e-9, 0.01, 0.2


def describe_residuals(logs: Sequence[Log], j: int, rests: Sequence[FloatArray]) -> str:
    """A sentence on the largest pattern in the residuals of joint j, and on the next recording."""
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
        pitches.append([_middle_frequency(x, log.interval) for x in both])
    if not residuals:
        return ""
    residual = np.concatenate(residuals)
    shares = {x: _explained(residual, np.concatenate(y)) for x, y in every.items()}
    name = max(shares, key=shares.__getitem__)
    fast, slow = np.mean(pitches, axis=0)
    if shares[name] < NAMED:
        if fast > FAST * slow:
            pattern = f"is mostly above {fast:.3g} Hz, as by elastic joints"
            record = f"a multisine up to {4 * fast:.3g} Hz, sampled at 1 kHz"
        else:
            pattern, record = "has no known pattern", "one program twice, to see what repeats"
    elif name in PATTERNS:
        pattern, record = PATTERNS[name]
    else:
        pattern = f"follows the motion of {name}, as by coupled axes"
        record = f"each of both joints alone, while {name} or this one rests"
    much = f" by {shares[name]:.0%}" if shares[name] >= NAMED else ""
    return f"The residual {pattern}{much}: record {record}."


def fastest_motion(logs: Sequence[Log]) -> tuple[FloatArray, FloatArray]:
    """Largest velocities [rad/s] and accelerations [rad/s²] of commands, (dof,) each."""
    sizes = []
    for log in logs:
        some = slice(None, None, max(round(SMOOTHED / log.interval), 1))
        rates = np.gradient(log.command[some], log.t[some], axis=0)
        accelerations = np.gradient(rates, log.t[some], axis=0)
        sizes.append([np.abs(x).max(axis=0) for x in (rates, accelerations)])
    largest = np.max(sizes, axis=0)
    return largest[0], largest[1]


def scale_residuals(logs: Sequence[Log], j: int, rests: Sequence[FloatArray]) -> FloatArray:
    """RMS residual at rest [rad], per velocity [s] and per acceleration [s²], by regression."""
    # The squared residuals are the sum of the squares of these three parts.
    # rests [rad].
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
    # Squares scatter in proportion to their expectation.
    for _ in range(REWEIGHTED):
        q, r = np.linalg.qr(every / scale / expected[:, None])
        parts = nnls(r, q.T @ (values / expected))[0] / scale
        expected = np.maximum(every @ parts, 1e-6 * expected.max())
    return np.asarray(np.sqrt(parts))


def find_residuals(log: Log, j: int) -> FloatArray:
    """Tracking errors of a joint not explained by its own velocity and acceleration [rad]."""
    rate = np.gradient(log.command[:, j], log.t)
    columns = np.stack([rate, np.gradient(rate, log.t), np.ones(len(rate))], axis=1)
    lag = log.measured[:, j] - log.command[:, j]
    return np.asarray(lag - columns @ np.linalg.lstsq(columns, lag, rcond=None)[0])


def _patterns(log: Log, j: int) -> dict[str, FloatArray]:
    """Columns of each pattern at the samples of a log, (n, 1) or more."""
    rates = np.gradient(log.command, log.t, axis=0)
    accelerations = np.gradient(rates, log.t, axis=0)
    q, rate = log.command[:, j], rates[:, j]
    columns = {
        "velocity": rate[:, None],
        "sign": np.tanh(rate / max(SLIDING * float(np.abs(rate).max()), 1e-30))[:, None],
        "position": np.stack([np.sin(q), np.cos(q)], axis=1),
    }
    for k, name in enumerate(log.joint_names):
        if k != j:
            columns[name] = np.stack([rates[:, k], accelerations[:, k]], axis=1)
    return columns


def _explained(residual: FloatArray, columns: FloatArray) -> float:
    """Share of the squared residuals that columns explain by least squares."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    remaining = residual - scaled @ np.linalg.lstsq(scaled, residual, rcond=None)[0]
    return 1.0 - float(remaining @ remaining) / max(float(residual @ residual), 1e-300)


def _middle_frequency(signal: FloatArray, interval: float) -> float:
    """Frequency above which half of the power of a signal is [Hz]."""
    power = np.cumsum(np.abs(np.fft.rfft(signal - signal.mean())) ** 2)
    k = int(np.searchsorted(power, power[-1] / 2))
    return float(np.fft.rfftfreq(len(signal), interval)[k])


def is_white(residuals: FloatArray, step: float) -> bool:
    """True if residuals are white noise, except for the effect of the encoder's resolution."""
    # The power of the lowest frequencies is compared with that of the others, for 8, 16, ... lines
    # of the spectrum.
    # residuals (n,) [rad], step [rad].
    from scipy.stats import f

    # Quantization explains variance beyond the noise from sample to sample.
    if np.var(residuals) - white_noise(residuals) ** 2 <= (1 + SLACK) * step**2 / 12:
        return True
    power = np.abs(np.fft.rfft(residuals - np.mean(residuals))[1:]) ** 2
    n = len(power)
    chances: list[float] = []
    while (m := FEWEST_LINES << len(chances)) <= n / 2:
        ratio = np.mean(power[:m]) / max(float(np.mean(power[m:])), 1e-300)
        chances.append(float(f.sf(ratio, 2 * m, 2 * (n - m))))
    return not chances or min(chances) * len(chances) > CHANCE


def resolution(y: FloatArray) -> float:
    """Resolution of an encoder [rad]: common divisor of all differences; 0 if there is none."""
    steps = np.diff(np.unique(y))
    steps = steps[steps > ROUNDED * max(float(np.ptp(y)), 1e-12)]
    if len(steps) < 2:
        return 0.0
    step = float(np.min(steps))
    differences = np.abs(steps / step - np.rint(steps / step))
    return step if np.all(differences < STEP_ROUNDING * np.maximum(steps / step, 1.0)) else 0.0


def correlation_length(residuals: FloatArray) -> float:
    """Number of residuals per independent residual, at least 1."""
    n = len(residuals)
    power = np.abs(np.fft.rfft(residuals, 2 * n)) ** 2
    correlations = np.fft.irfft(power)[: max(n // 5, 1)]
    if correlations[0] <= 0:
        return 1.0
    correlations = correlations / correlations[0]
    below = np.flatnonzero(correlations < UNCORRELATED)
    end = int(below[0]) if len(below) else len(correlations)
    return float(max(1.0, 1 + 2 * np.sum(correlations[1:end])))
