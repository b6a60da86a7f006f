"""Standard deviations and 95 % intervals of the parameters of a fit."""

from __future__ import annotations

import math

from armcontour.identification.covariance import covariance, is_white
from armcontour.identification.fitting import Data, Fit
from armcontour.identification.profile import profile

# Up to this relative error of K_v the likelihood is as good as a Gaussian.
GAUSSIAN = 0.1


class Ends:
    """The precision of each parameter: its Cramér-Rao bound, or its profile if that is singular.

    Args:
        data: The log of the joint.
        found: The fit of the joint.
    """

    def __init__(self, data: Data, found: Fit) -> None:
        from scipy.special import stdtrit

        white = is_white(found)
        matrix, freedom = covariance(found, white=white)
        names = found.state.free
        self._found = found
        self._quantile = float(stdtrit(freedom, 0.975))
        self._errors = {
            name: math.sqrt(matrix[k, k]) if matrix[k, k] >= 0 else math.inf
            for k, name in enumerate(names)
        }
        self._profiled: dict[str, tuple[float, float]] = {}
        if "kv" in names and ("kv" in found.at_edge or self._errors["kv"] > GAUSSIAN):
            ends = profile(data, found, self._quantile)
            self._profiled = {
                x: ends.interval(x, self._quantile, white=white) for x in ("kp", "delay")
            }
            self._profiled["kv"] = (
                ends.slow.state.kv,
                math.inf if ends.open else ends.fast.state.kv,
            )

    def relative(self, name: str) -> float:
        """Standard deviation of a gain or limit, as a share of its value."""
        if name in self._profiled:
            low, high = self._profiled[name]
            return (high - low) / (2 * self._quantile * float(getattr(self._found.state, name)))
        return self._errors[name]

    def sd(self, name: str) -> float:
        """Standard deviation of the dead time [s]."""
        if name in self._profiled:
            low, high = self._profiled[name]
            return (high - low) / (2 * self._quantile)
        return self._errors[name]

    def interval(self, name: str) -> tuple[float, float]:
        """Ends of the 95 % interval of a parameter, in its unit."""
        if name in self._profiled:
            return self._profiled[name]
        value = float(getattr(self._found.state, name))
        share = self._share(name)
        if name in ("delay", "feed"):
            return value - share, value + share
        if name == "kv":
            # A log shows the time constant of the velocity loop, 1 / K_v.
            return value / (1 + share), value / (1 - share)
        factor = math.exp(min(share, 700.0))
        return value / factor, value * factor

    def _share(self, name: str) -> float:
        """Half of the width of the 95 % interval, in the unit of the standard error."""
        return self._quantile * self._errors[name]
