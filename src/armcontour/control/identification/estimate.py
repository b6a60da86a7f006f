"""The estimate of one parameter, with its interval."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armcontour.core.fields import quantities
from armcontour.core.render import Result, number_range
from armcontour.core.result import Data, Row
from armcontour.robot.servo import ServoModel

# Largest standard deviation of a determined parameter, relative to its value.
RELATIVE_SD = 0.10
PARAMETERS = (
    *("kp", "kv", "ki", "velocity_feedforward", "acceleration_feedforward"),
    *("dead_time", "friction", "acceleration_limit"),
)
UNITS = {name: quantities(ServoModel)[name].words for name in PARAMETERS}
# Lower and upper end of an interval, each less the value.
Ends = tuple[float, float]
# Parameters that are fitted as logarithms.
LOGARITHMIC = ("kp", "kv", "ki", "acceleration_limit")


def allowed_deviation(value: Any, also: Any = 0.0) -> Any:
    """Return the largest standard deviation with which a parameter counts as determined.

    - `also`: standard deviation that is sufficient, however small the value is.
    """
    return np.maximum(RELATIVE_SD * np.abs(value), also)


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate(Result):
    """The estimate of one parameter.

    Args:
        name: Name of the parameter.
        unit: Unit of the value.
        value: The value; nan if the model does not have the parameter.
        sd: Standard deviation; nan for a parameter at the bound of its range, or with its nominal
            value.
        low, high: Ends of the 95 % interval; nan without one, as for `sd`, and for an effective
            parameter, which compensates for an effect that is not modelled, or of a log that was
            repaired.
        determined: True if the logs determine the parameter: `sd` is at most 10 % of the value, at
            most 0.5 ms for a dead time, or at most 0.05 for feed-forward.
    """

    name: str
    unit: str
    value: float
    sd: float = math.nan
    low: float = -math.inf
    high: float = math.inf
    determined: bool = False

    @classmethod
    def from_interval(
        cls, name: str, value: float, sd: float, ends: Ends, also: float = 0.0, **others: Any
    ) -> Estimate:
        """Make an estimate from its interval.

        - `sd`: standard deviation, of the logarithm for LOGARITHMIC.
        - `ends`: lower and upper end less the value, in the logarithm for LOGARITHMIC.
        - `also`: see `allowed_deviation`.
        """
        if name in LOGARITHMIC:
            low, high = (value * math.exp(x) for x in np.clip(ends, -700.0, 700.0))
            sd *= value
        else:
            low, high = value + ends[0], value + ends[1]
        if not math.isfinite(sd):
            low = high = math.nan
        sure = bool(sd <= allowed_deviation(value, also))
        fields: dict[str, Any] = {"unit": UNITS[name], "determined": sure, **others}
        return cls(name=name, value=value, sd=sd, low=low, high=high, **fields)

    def including(self, other: float) -> Estimate:
        """Return the estimate with an interval that also contains another solution's interval.

        The interval about the value `other` is as wide as that about this value. For LOGARITHMIC,
        it has the same ratios to its value.
        """
        if not (math.isfinite(self.low) and math.isfinite(other)):
            return self
        shift = other - self.value
        low = self.low + shift
        high = self.high + shift
        if self.name in LOGARITHMIC:
            low = self.low * other / self.value
            high = self.high * other / self.value
        within = self.low <= other <= self.high
        return replace(
            self,
            low=min(self.low, max(low, 0.0)),
            high=max(self.high, high),
            determined=self.determined and within,
        )

    def without_interval(self) -> Estimate:
        """Return the estimate without its interval, because an unknown error biases it."""
        return replace(self, low=math.nan, high=math.nan)

    @property
    def label(self) -> str:
        """Name of the parameter in texts, with spaces instead of underscores."""
        return self.name.replace("_", " ")

    def to_data(self) -> Data:
        """Return the value, the standard deviation and the interval as data."""
        ends = (("value", "value"), ("sd", "sd"), ("low", "from"), ("high", "to"))
        return Data(
            f"Estimate of {self.label}",
            (
                Row("name", self.name, "", "parameter"),
                Row("unit", self.unit),
                *(Row(x, getattr(self, x), self.unit, label) for x, label in ends),
                Row("determined", self.determined, "", "determined"),
            ),
        )

    @property
    def row(self) -> Row:
        """Row of a table with the value and its 95 % interval; "open" if it is not determined."""
        ends = self.low, self.high
        note = f"({number_range(ends, self.unit)})" if np.isfinite(ends).all() else ""
        if not (self.determined or math.isnan(self.value)):
            note = f"{note} open".strip()
        return Row(self.name, self.value, self.unit, self.label, note)
