"""Estimates of parameters, and base classes of the results of identification."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armcontour.control.identification.least_squares import allowed_deviation
from armcontour.core.checks import FloatArray, Frozen
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import quantities
from armcontour.core.render import Result, number_range
from armcontour.core.result import Data, Row, Table
from armcontour.core.text import short_repr
from armcontour.motion.log import Log
from armcontour.robot.servo import ServoModel

PARAMETERS = (
    *("kp", "kv", "ki", "velocity_feedforward", "acceleration_feedforward"),
    *("dead_time", "friction", "acceleration_limit"),
)
UNITS = {name: quantities(ServoModel)[name].words for name in PARAMETERS}
# Lower and upper end of an interval, each as its difference from the value.
Ends = tuple[float, float]
# Parameters that are fitted as logarithms.
LOGARITHMIC = ("kp", "kv", "ki", "acceleration_limit")


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate(Result):
    """The estimate of one parameter.

    Args:
        name: Name of the parameter.
        unit: Unit of the value.
        value: The value; nan if the model does not have the parameter.
        sd: Standard deviation; nan for a parameter at the bound of its range, or with its nominal
            value.
        low, high: Ends of the 95 % interval.
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
        """Estimate with the interval `ends` relative to the value (logarithms for LOGARITHMIC)."""
        # also: a parameter with at most this standard deviation is determined, however small its
        # value.
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

    @property
    def label(self) -> str:
        """Name of the parameter in texts, with spaces instead of underscores."""
        return self.name.replace("_", " ")

    def to_data(self) -> Data:
        """Data of the value, the standard deviation and the interval."""
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimates(Result, Frozen):
    """Base of results with estimates, which are also attributes, such as `kp`.

    Args:
        parameters: Estimates of the parameters by name.
    """

    parameters: dict[str, Estimate] = field(default_factory=dict)

    def __getattr__(self, name: str) -> Estimate:
        """The estimate of a parameter; its value is nan if the model has none."""
        if name not in UNITS:
            raise AttributeError(f"{type(self).__name__} has no {name}.")
        none = Estimate(name=name, unit=UNITS[name], value=math.nan, low=math.nan, high=math.nan)
        return self.parameters.get(name, none)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The estimates of all parameters of the model."""
        return tuple(self.parameters.values())

    def table(self, name: str) -> Table:
        """Table of the estimates, one row per estimate.

        Args:
            name: Name of the table.
        """
        return Table.from_rows(name, [x.to_data().rows for x in self.estimates])

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointEstimates(Estimates):
    """Base of the results of one joint.

    Args:
        name: Name of the joint.
        rms: RMS error of the model on the logs that were fitted [rad].
        rests: Residuals of each log: measured less predicted positions [rad], (n,); nan at samples
            that do not count. Empty if no model was fitted.
    """

    name: str
    rms: float = math.nan
    rests: tuple[FloatArray, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedJoints(Estimates):
    """Base of the result of an identification.

    Args:
        logs: The logs.
        interpolation: Interpolation of set-points that was assumed.
        joints: The result of each joint.
    """

    logs: tuple[Log, ...]
    interpolation: str
    joints: tuple[JointEstimates, ...] = field(repr=False)

    def __getitem__(self, name: str | int) -> Any:
        """The result of a joint by its name, or by its number from 1."""
        for j, joint in enumerate(self.joints):
            if name in (joint.name, j + 1):
                return joint
        names = ", ".join(x.name for x in self.joints)
        raise InvalidInput(f"{self.source} has no joint {name!r}: its joints are {names}.")

    @property
    def source(self) -> str:
        """Sources of the logs (file names), separated by commas."""
        return ", ".join(dict.fromkeys(x.source for x in self.logs))

    def _tables(self) -> tuple[Table, Table]:
        """Two tables: all rows of each joint, and only the estimates of each joint."""
        every = [x.to_data() for x in self.joints]
        rows = [(*x.rows, Row("parameters", x.tables[0].as_dicts())) for x in every]
        names = [x for x in UNITS if any(x in y.parameters for y in self.joints)]
        parameters = [
            (Row("joint", x.name, "", "joint"), *(getattr(x, name).row for name in names))
            for x in self.joints
            if x.parameters
        ]
        return Table.from_rows("joints", rows), Table.from_rows("parameters", parameters)
