"""Commands and measured positions of one joint: reasons against a model, and errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.control.identification.log_segments import LogSegment
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampled_data import interpolate, white_noise
from armcontour.motion.log import (
    FEWEST,
    Log,
)

# A joint is at rest if the standard deviation of its measured positions is at most this multiple of
# that of the noise. Its velocity is uniform if the same holds for deviations from a line.
REST_SIGMAS = 1.5
# A joint is also at rest if the range of its measured positions is at most this [rad]; a 32-bit
# encoder has a resolution of 1.5e-9 rad.
LEAST_MOTION = 1e-9
# Lower bound of a tracking error that is used as a divisor [rad].
LEAST_LAG = 1e-12
# Deviations from uniform velocity below this value are rounding errors, because logs have at most
# nine digits [rad].
LEAST_BEND = 1e-8


def check_columns(log: Log, j: int, lag: float) -> None:
    """Raise InvalidInput if joint j follows other commands, or its own with the opposite sign."""
    commands = interpolate(log.t - lag, log.t, log.command - log.command.mean(axis=0))
    products = (log.measured[:, j] - log.measured[:, j].mean()) @ commands
    similar = products / np.maximum(np.linalg.norm(commands, axis=0), LEAST_LAG)
    if similar[j] < np.abs(similar).max():
        raise InvalidInput(
            f"{log.source}: {log.joint_names[j]} does not follow its commands. Correct the order "
            "and the signs of the columns.",
            joint=j,
        )


def worst_log(errors: Sequence[FloatArray], segments: Sequence[LogSegment]) -> tuple[float, float]:
    """RMS error and RMS tracking error [rad] of the log in which their ratio is largest."""
    # If there is only one log, its errors are weighted by motion, because the joint may rest in
    # parts of it.
    logs = sorted({s.log for s in segments if s.weight.any()})
    single = int(len(logs) == 1)
    pairs = []
    lags = lags_of(segments)
    for k in logs:
        indices = [i for i, s in enumerate(segments) if s.log == k]
        some = [segments[i] for i in indices]
        error = rms_of([errors[i] for i in indices], some, centred=False)[single]
        pairs.append((error, max(rms_of([lags[i] for i in indices], some)[single], LEAST_LAG)))
    return max(pairs, key=lambda x: x[0] / x[1])


def lags_of(segments: Sequence[LogSegment]) -> list[FloatArray]:
    """Measured positions less commands [rad]."""
    return [s.y - s.command.u for s in segments]


def rms_of(
    values: Sequence[FloatArray], segments: Sequence[LogSegment], *, centred: bool = True
) -> tuple[float, float]:
    """Unweighted and motion-weighted RMS of values over the used samples, about their means.

    If not `centred`, means are not subtracted.
    """
    sums = np.zeros(4)
    for row, s in zip(values, segments, strict=True):
        square = (row - (np.mean(row[s.use]) if centred else 0.0)) ** 2
        weight = s.weight * s.use
        sums += [square @ s.use, s.use.sum(), square @ weight, weight.sum()]
    return float(np.sqrt(sums[0] / sums[1])), float(np.sqrt(sums[2] / max(sums[3], 1e-300)))


def explain_no_model(segments: Sequence[LogSegment]) -> str:
    """Reason why no model can be identified (no motion, uniform velocity); empty if none."""
    if not segments:
        return f"the log has fewer than {FEWEST} samples without a gap. Record a longer motion."
    if not any((s.weight * s.use).any() for s in segments):
        return "no motion is commanded. Record a program that moves this joint."
    if all(
        np.ptp(s.y) <= LEAST_MOTION or np.std(s.y) <= REST_SIGMAS * white_noise(s.y)
        for s in segments
    ):
        change = max(float(np.ptp(s.command.u)) for s in segments)
        still = f"its measured motion is only noise, although its commands span {change:.3g} rad"
        return f"{still}. Record more motion."
    if all(_is_uniform(s) for s in segments):
        return "the velocity is uniform, which determines a lag, but no gains. Record a multisine."
    return ""


def _is_uniform(segment: LogSegment) -> bool:
    """Return whether both the commanded and the measured velocity of a segment are uniform."""
    t = segment.command.t
    return not changes_velocity(t, segment.command.u) and not changes_velocity(t, segment.y)


def changes_velocity(t: FloatArray, positions: FloatArray) -> bool:
    """Return whether positions [rad] at times t [s], (n,), deviate from a line beyond the noise."""
    errors = positions - np.polyval(np.polyfit(t, positions, 1), t)
    return bool(
        np.std(errors) > REST_SIGMAS * white_noise(positions) and np.ptp(errors) > LEAST_BEND
    )
