"""Checks, interpolation and noise of sampled motions; numbering of parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput

# Smallest time step [s]. Controllers sample at 1 MHz at most, and times are printed with at most
# nine decimals, so a shorter step means damaged data. Divisions by the square of a very short step
# can overflow.
SHORTEST_STEP = 1e-9
# Smallest distinguishable difference of two times, in units in the last place.
STEP_ULPS = 4
# Largest time [s]: 300 years. It admits seconds since 1970, and rejects milliseconds since 1970.
LATEST = 1e10
# Largest joint positions [rad], velocities [rad/s] and accelerations [rad/s²]. 10,000 rad are 1,600
# turns. The other bounds only keep sums and squares finite; the limits are checked elsewhere.
LARGEST = {"q": 1e4, "dq": 1e9, "ddq": 1e12}
Place = Callable[[str, int, int], str]
JOINT_UNITS = {"q": "rad", "dq": "rad/s", "ddq": "rad/s²"}
# A step longer than this multiple of the usual step is a gap, in which the command is unknown.
GAP = 3.0
# Fraction of gaps above which the times come in bursts.
MAX_GAPS = 0.05
# Ratio of the standard deviation of normally distributed values to the median of their magnitudes.
DEVIATION_PER_MEDIAN = 1.4826


def check_time_range(t: FloatArray, describe: Place, rename: Callable[[str], str] = str) -> None:
    """Check that times are small enough to be seconds."""
    distant = np.flatnonzero(np.abs(t) > LATEST)
    if len(distant):
        i = int(distant[0])
        unit = next((x for x, y in (("ms", 1e-3), ("us", 1e-6)) if abs(t[i]) * y < LATEST), "ns")
        raise InvalidInput(
            f"{describe('t', i, 0)} is {t[i]:.3g} s, but times must stay within {LATEST:g} s. "
            f"Correct the number, or specify the unit of time, such as {rename(f't [{unit}]')}.",
            index=i,
            t=float(t[i]),
        )


def check_samples(t: FloatArray, arrays: Mapping[str, FloatArray], describe: Place) -> None:
    """Check that times and joint values of a sampled motion are possible."""
    check_time_range(t, describe)
    # The bound depends on the later time; a step back is below any bound.
    steps = np.diff(t)
    short = np.flatnonzero(~(steps >= _shortest_step(t[1:])))
    if len(short):
        i = int(short[0]) + 1
        step, minimum, reason = float(steps[i - 1]), f"{SHORTEST_STEP * 1e9:g} ns", ""
        if step > 0:
            reason = (
                f". The step must be at least {minimum} and more than the rounding of the times"
            )
        elif step == 0 and all((x[i] == x[i - 1]).all() for x in arrays.values()):
            reason = ". Remove the repeated sample"
        elif step == 0:
            reason = (
                ". The times are repeated or rounded, and do not fit regular steps. Print them "
                "with more digits"
            )
        before, after = (f"{float(x)!r} s" for x in t[i - 1 : i + 1])
        raise InvalidInput(
            f"{describe('t', i, 0)} is {after}, but times must increase, and the previous time is "
            f"{before}{reason}.",
            index=i,
            t=float(t[i]),
        )
    for name, values in arrays.items():
        kind = name if name in LARGEST else "q"
        large = np.argwhere(~(np.abs(values) <= LARGEST[kind]))
        if len(large):
            i, j = map(int, large[0])
            unit = JOINT_UNITS[kind]
            raise InvalidInput(
                f"{describe(name, i, j)} is {values[i, j]:.3g} {unit}, but joint values must not "
                f"be more than {LARGEST[kind]:g} {unit}. Correct the number, or specify its unit, "
                "such as q1 [deg].",
                index=i,
                t=float(t[i]),
                joint=j,
            )


def _shortest_step(t: FloatArray) -> FloatArray:
    """Shortest usable steps before times `t` [s]."""
    ulp = STEP_ULPS * np.finfo(np.float64).eps
    # The difference of two times that are printed a nanosecond apart may be a little less.
    return np.asarray(np.maximum(0.999 * SHORTEST_STEP, ulp * np.abs(t)))


def describe_bursts(t: FloatArray, source: str) -> str:
    """Warning about times in bursts, such as arrival times of messages; empty if regular."""
    steps = np.diff(t)
    if len(steps) < 10 or np.mean(steps > GAP * np.median(steps)) < MAX_GAPS:
        return ""
    return (
        f"The times of {source} come in bursts, usually {np.median(steps):.3g} s apart, but with "
        f"gaps of up to {steps.max():.3g} s. They are probably the times at which messages "
        "arrived, so speeds computed from them are wrong. Use the controller's own times."
    )


def interpolate(times: FloatArray, t: FloatArray, values: FloatArray) -> FloatArray:
    """Columns of samples, linearly interpolated at `times`, constant outside, (m, columns)."""
    if len(times):
        # Only the needed samples are copied, so that short parts of long motions are fast.
        first, last = np.searchsorted(t, (times.min(), times.max()))
        neighbours = slice(max(first - 1, 0), last + 1)
        t, values = t[neighbours], values[neighbours]
    return np.stack([np.interp(times, t, x) for x in values.T], axis=1)


def integrate(values: FloatArray, t: FloatArray) -> float:
    """Integral of values over time by the trapezoidal rule; `numpy.trapezoid` needs numpy 2."""
    return float((np.diff(t) * (values[1:] + values[:-1]) / 2.0).sum())


def number_parts(count: IntArray) -> tuple[IntArray, IntArray]:
    """Index of each part's item, and of each part in its item, for `count` parts per item."""
    whole = np.repeat(np.arange(len(count)), count)
    return whole, np.arange(len(whole)) - np.repeat(np.cumsum(count) - count, count)


def white_noise(values: FloatArray, order: int = 3) -> FloatArray:
    """Standard deviation of the white noise in regular samples of smooth motion, (...)."""
    # The deviation is computed from differences of a high order, to which smooth motion contributes
    # little. The median ignores outliers and short disturbances, such as friction at a reversal. If
    # most differences are 0, as with a coarse encoder, their root mean square is used.
    if len(values) <= order:
        return np.zeros(values.shape[1:])
    differences = np.abs(np.diff(values, order, axis=0))
    deviation = DEVIATION_PER_MEDIAN * np.median(differences, axis=0)
    deviation = np.where(deviation > 0, deviation, np.sqrt(np.mean(differences**2, axis=0)))
    return np.asarray(deviation / np.linalg.norm(np.diff(np.pad([1.0], order), order)))
