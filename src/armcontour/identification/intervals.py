"""Standard deviations and 95 % intervals of the parameters of a fit."""

from __future__ import annotations

import math

from armcontour.identification.choosing import is_white
from armcontour.identification.fitting import Data, Fit, covariance
from armcontour.identification.profile import profile

# Up to this relative error of K_v the likelihood is as good as a Gaussian.
GAUSSIAN = 0.1


class Ends:
    """The precision of each parameter: the Cramér-Rao bound, or the profile where that is singular.

    Args:
        data: The log of the joint.
        found: Its fit.
    """

    def __init__(self, data: Data, found: Fit) -> None:
        from scipy.special import stdtrit

        white = is_white(found)
        matrix = covariance(found, white=white)
        names = found.state.free
        self._found = found
        self._quantile = float(stdtrit(max(found.count - len(names), 1), 0.975))
        self._errors = {
            name: math.sqrt(matrix[k, k]) if matrix[k, k] >= 0 else math.inf
            for k, name in enumerate(names)
        }
        self._profiled: dict[str, tuple[float, float]] = {}
        if "kv" in names and ("kv" in found.at_edge or self._errors["kv"] > GAUSSIAN):
            ends = profile(data, found)
            self._profiled = {
                x: ends.interval(x, self._quantile, white=white) for x in ("kp", "delay")
            }
            self._profiled["kv"] = (
                ends.slow.state.kv,
                math.inf if ends.open else ends.fast.state.kv,
            )

    def relative(self, name: str) -> float:
        """Standard deviation of a gain or limit, in parts of the value."""
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
        """Ends of the 95 % interval."""
        if name in self._profiled:
            return self._profiled[name]
        value = float(getattr(self._found.state, name))
        share = self._share(name)
        if name == "delay":
            return value - share, value + share
        if name == "kv":
            # What a log sees of the velocity loop is its time constant.
            return value / (1 + share), value / (1 - share)
        factor = math.exp(min(share, 700.0))
        return value / factor, value * factor

    def _share(self, name: str) -> float:
        return self._quantile * self._errors[name]
