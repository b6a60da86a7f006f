"""What a log says of what it cannot see well: the profile of its likelihood.

Where K_v grows, its lag becomes a dead time, and the Fisher information of gain, dead time and K_v
becomes singular: it says less than the log does. The profile does not: the best fit for each K_v.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from armcontour.identification.covariance import covariance, inflation
from armcontour.identification.fitting import GAINS, Data, Fit, fit

# What twice the logarithm of the likelihood loses at the end of a 95 % interval.
LOSS = 3.84
# Bisections of the end of the interval, in the logarithm of K_v.
BISECTIONS = 6
# The same for a limit, and iterations that show whether it is possible.
LOWER = 0.9
TRIES = 12
# Strides of K_v on the way there.
STRIDE = 2.0
# Larger exponents are beyond all floats.
LARGEST_EXPONENT = 700.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """The 95 % interval of K_v.

    Args:
        best: The best fit, as one with a given K_v.
        slow: The fit at the lower end.
        fast: The one at the upper end, or at the end of what is looked for.
        open: Whether any larger K_v would do as well.
    """

    best: Fit
    slow: Fit
    fast: Fit
    open: bool

    def interval(self, name: str, quantile: float, *, white: bool) -> tuple[float, float]:
        """The 95 % interval of "kp" or "delay".

        The total variance is the variance given K_v plus the variance due to K_v, as for a
        Gaussian likelihood.
        """
        forth, back = (math.log, _exp) if name == "kp" else (float, float)
        value, *ends = (forth(getattr(x.state, name)) for x in (self.best, self.slow, self.fast))
        k = self.best.state.free.index(name)
        own = quantile * math.sqrt(max(covariance(self.best, white=white)[0][k, k], 0.0))
        below, above = max(value - min(ends), 0.0), max(max(ends) - value, 0.0)
        return back(value - math.hypot(below, own)), back(value + math.hypot(above, own))


def _exp(x: float) -> float:
    """The exponential, infinite where it is beyond all floats: the log tells nothing."""
    return math.exp(x) if x < LARGEST_EXPONENT else math.inf


def with_kv(data: Data, found: Fit, kv: float) -> Fit:
    """The best fit with a given K_v."""
    return fit(data, replace(found.state, kv=kv, fixed=("kv",)))


def loss(found: Fit, best: Fit) -> float:
    """Twice the logarithm of the likelihood that a fit loses against the best one.

    Samples count less where residuals depend on each other.
    """
    lost = found.count * math.log(max(found.sse, 1e-300) / max(best.sse, 1e-300))
    return lost / inflation(best) if lost > 0 else lost


def lowest_limit(data: Data, found: Fit, demand: float) -> float:
    """The lowest acceleration limit that a log without a visible one leaves possible [rad/s²].

    Args:
        data: The log of the joint.
        found: Its fit, without a limit.
        demand: The largest acceleration that it asks for [rad/s²].
    """
    enough = found.sse * math.exp(LOSS * inflation(found) / found.count)

    def possible(limit: float) -> Fit | None:
        start = replace(inside.state, limit=limit, fixed=("limit",))
        trial = fit(data, start, enough=enough, most=TRIES)
        return trial if trial.sse <= enough else None

    high, inside, low = demand, found, LOWER * demand
    while (trial := possible(low)) is not None and low > 1e-3 * demand:
        high, inside, low = low, trial, LOWER * low
    for _ in range(BISECTIONS // 2):
        middle = math.sqrt(low * high)
        trial = possible(middle)
        if trial is None:
            low = middle
        else:
            high, inside = middle, trial
    # The end that is known not to be possible any more.
    return low


def profile(data: Data, found: Fit, quantile: float) -> Profile:
    """Find both ends of the 95 % interval of K_v.

    Args:
        data: The log of the joint.
        found: Its fit.
        quantile: Half the width of the interval, in standard deviations.
    """
    allowed = quantile**2 * inflation(found)
    slow = _end(data, found, 1 / STRIDE, GAINS[0], allowed)
    fast = _end(data, found, STRIDE, GAINS[1], allowed)
    return Profile(
        best=with_kv(data, found, found.state.kv),
        slow=slow,
        fast=fast,
        open=fast.state.kv >= GAINS[1],
    )


def _end(data: Data, found: Fit, stride: float, bound: float, allowed: float) -> Fit:
    """The fit with the K_v, from the best one on in strides, that costs more than `allowed`."""
    enough = found.sse * math.exp(min(allowed / found.count, LARGEST_EXPONENT))
    inside = outside = with_kv(data, found, found.state.kv)
    while outside.sse < enough:
        if outside.state.kv == bound:
            return outside
        inside, kv = outside, outside.state.kv * stride
        outside = with_kv(data, inside, min(kv, bound) if stride > 1 else max(kv, bound))
    for _ in range(BISECTIONS):
        middle = with_kv(data, inside, math.sqrt(inside.state.kv * outside.state.kv))
        if middle.sse < enough:
            inside = middle
        else:
            outside = middle
    return outside
