"""Standard deviations and 95 % intervals of the parameters of a fit.

They come from the covariance. Where K_v is poorly known, its lag acts as a dead time, and intervals
of the covariance contained the truth in 80 to 92 % of logs of a smooth job. There the profile of
the likelihood gives the intervals of K_p, K_v and dead time.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from armcontour.identification.covariance import covariance, inflation, is_white
from armcontour.identification.fitting import GAINS, Data, Fit, fit

# Relative standard deviation of K_v up to which the covariance gives the intervals.
GAUSSIAN = 0.1
# Bisections of an end of the interval of K_v, in its logarithm, and factors on the way there.
BISECTIONS = 6
STRIDE = 2.0
# Larger exponents overflow.
LARGEST_EXPONENT = 700.0


class Interval(NamedTuple):
    """Precision of one parameter, in its unit.

    Args:
        sd: Standard deviation; infinite if the log does not determine the parameter.
        low, high: Ends of the 95 % interval.
    """

    sd: float
    low: float
    high: float


def find_intervals(data: Data, found: Fit) -> dict[str, Interval]:
    """Precision of each free parameter of the servo, by its name."""
    from scipy.special import stdtrit

    matrix, freedom = covariance(found, white=is_white(found))
    quantile = float(stdtrit(freedom, 0.975))
    intervals = {}
    for k, name in enumerate(found.state.free):
        value = float(getattr(found.state, name))
        error = math.sqrt(matrix[k, k]) if matrix[k, k] >= 0 else math.inf
        reach = quantile * error
        if name in ("kp", "limit"):
            intervals[name] = Interval(value * error, value * _exp(-reach), value * _exp(reach))
        elif name == "kv":
            # A log shows the time constant of the velocity loop, 1 / K_v.
            high = value / (1 - reach) if reach < 1 else math.inf
            intervals[name] = Interval(value * error, value / (1 + reach), high)
            poor = error > GAUSSIAN or name in found.at_edge
        else:
            intervals[name] = Interval(error, value - reach, value + reach)
    if "kv" in intervals and poor:
        intervals |= _profile(data, found, quantile)
    return intervals


def _profile(data: Data, found: Fit, quantile: float) -> dict[str, Interval]:
    """Intervals of "kp", "kv" and "delay" from the best fits for given values of K_v.

    The total variance is the variance given K_v plus the variance due to K_v, as for a Gaussian
    likelihood.
    """
    allowed = quantile**2 * inflation(found)
    best = _with_kv(data, found, found.state.kv)
    slow = _end(data, best, 1 / STRIDE, GAINS[0], allowed)
    fast = _end(data, best, STRIDE, GAINS[1], allowed)
    matrix = covariance(best, white=is_white(found))[0]
    kv = (slow.state.kv, fast.state.kv if fast.state.kv < GAINS[1] else math.inf)
    ends = {"kv": kv}
    for name, forth, back in (("kp", math.log, _exp), ("delay", float, float)):
        value, *others = (forth(getattr(x.state, name)) for x in (best, slow, fast))
        k = best.state.free.index(name)
        own = quantile * math.sqrt(max(matrix[k, k], 0.0))
        below, above = max(value - min(others), 0.0), max(max(others) - value, 0.0)
        ends[name] = back(value - math.hypot(below, own)), back(value + math.hypot(above, own))
    return {
        x: Interval((high - low) / (2 * quantile), low, high) for x, (low, high) in ends.items()
    }


def _exp(x: float) -> float:
    """The exponential; infinite where it overflows."""
    return math.exp(x) if x < LARGEST_EXPONENT else math.inf


def _with_kv(data: Data, found: Fit, kv: float) -> Fit:
    """The best fit with a given K_v."""
    return fit(data, replace(found.state, kv=kv, fixed=("kv",)))


def _end(data: Data, best: Fit, stride: float, bound: float, allowed: float) -> Fit:
    """The fit at an end of the interval of K_v, which costs `allowed`, found in strides."""
    enough = best.sse * math.exp(min(allowed / best.count, LARGEST_EXPONENT))
    inside = outside = best
    while outside.sse < enough:
        if outside.state.kv == bound:
            return outside
        inside, kv = outside, outside.state.kv * stride
        outside = _with_kv(data, inside, min(kv, bound) if stride > 1 else max(kv, bound))
    for _ in range(BISECTIONS):
        middle = _with_kv(data, inside, math.sqrt(inside.state.kv * outside.state.kv))
        if middle.sse < enough:
            inside = middle
        else:
            outside = middle
    return outside
