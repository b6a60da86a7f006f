"""Standard deviations and 95 % intervals of the parameters of a fit, from its covariance."""

from __future__ import annotations

import math
from typing import NamedTuple

from armcontour.identification.covariance import covariance, is_white
from armcontour.identification.fitting import Fit


class Interval(NamedTuple):
    """Precision of one parameter, in its unit.

    Args:
        sd: Standard deviation; infinite if the log does not determine the parameter.
        low, high: Ends of the 95 % interval.
    """

    sd: float
    low: float
    high: float


def find_intervals(found: Fit) -> dict[str, Interval]:
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
            factor = math.exp(min(reach, 700.0))
            intervals[name] = Interval(value * error, value / factor, value * factor)
        elif name == "kv":
            # A log shows the time constant of the velocity loop, 1 / K_v.
            high = value / (1 - reach) if reach < 1 else math.inf
            intervals[name] = Interval(value * error, value / (1 + reach), high)
        else:
            intervals[name] = Interval(error, value - reach, value + reach)
    return intervals
