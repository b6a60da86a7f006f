"""Parameters of a plan: keys of job files and their values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, raise_if
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.quantities import Quantity
from armcontour.core.text import show, suggest
from armcontour.files.job_edits import Change, Keys, change_data, value_at
from armcontour.files.job_model import JobModel
from armcontour.files.patch import full_key, key_of
from armcontour.files.si_data import in_si, quantity_of
from armcontour.files.units import parse_quantity, read_quantity

RANGE = ("from", "to", "steps", "scale")
SCALES = ("linear", "log")
# Largest number of values of one parameter.
MAX_VALUES = 1_000_000


@dataclass(frozen=True, slots=True)
class Parameter:
    """A key of job files with its values."""

    # The key, with dots between the keys that lead there
    key: str
    # Unit of the numbers; None if they are not quantities
    unit: str | None
    # Values in SI units; the ends of a sampled range
    values: tuple[Any, ...]
    # The values are a range, it has a logarithmic scale, and the plan draws samples of it
    ranged: bool = False
    log: bool = False
    sampled: bool = False

    @property
    def parts(self) -> Keys:
        """The keys that lead to the value."""
        return key_of(self.key)

    @property
    def numeric(self) -> bool:
        """True if all values are numbers."""
        return all(isinstance(x, int | float) and not isinstance(x, bool) for x in self.values)

    def values_at(self, fractions: FloatArray) -> FloatArray:
        """Values at fractions of a range."""
        return _between(self.values[0], self.values[-1], fractions, log=self.log)


def read_parameter(key: str, specified: Any, *, sampled: bool) -> Parameter:
    """Read the values of a key of a plan."""
    location = f"over.{key}"
    with error_context("over"):
        quantity = quantity_of(JobModel, full_key(key_of(key)))
    unit = None if quantity is None else quantity.unit
    if isinstance(specified, Mapping):
        low, high, count, log = _read_range(location, specified, quantity, sampled)
        if sampled:
            return Parameter(key, unit, (low, high), True, log, True)
        values = _between(low, high, np.linspace(0.0, 1.0, count), log=log).tolist()
        if quantity is None and all(_whole(specified[x]) for x in ("from", "to")):
            # Counts, such as knots, must be integers.
            values = [round(x) if abs(x - round(x)) < 1e-9 * abs(x) else x for x in values]
        return Parameter(key, unit, tuple(values), True, log)
    listed = specified if isinstance(specified, list) else [specified]
    count = len(listed)
    raise_if(
        sampled and count > 1,
        f"{location}: samples are drawn of ranges, not of lists: write {{from: ..., to: ...}}, or "
        "combine: product.",
    )
    raise_if(count == 0, f"{location} is an empty list: give a value, or remove the key.")
    raise_if(count > MAX_VALUES, f"{location} has {count} values, more than {MAX_VALUES}.")
    return Parameter(key, unit, tuple(_in_si(key, x) for x in listed))


def _read_range(
    location: str, ends: Mapping[str, Any], quantity: Quantity | None, sampled: bool
) -> tuple[float, float, int, bool]:
    """Start, end and number of values of a range, and whether it is logarithmic."""
    for name in ends:
        if name not in RANGE:
            hint = suggest(str(name), RANGE, f"a range has {', '.join(RANGE)}.")
            raise InvalidInput(f"{location}: unknown key {show(name)} of a range: {hint}")
    for name in RANGE[: 2 if sampled else 3]:
        if ends.get(name) is None:
            raise InvalidInput(
                f"{location}.{name} is missing: a range is written as {{from: ..., to: ..., "
                "steps: 5}."
            )
    raise_if(
        sampled and "steps" in ends,
        f"{location}.steps: the plan draws samples, whose number is combine.sobol: remove steps.",
    )
    scale = checks.check_choice(f"{location}.scale", ends.get("scale", "linear"), SCALES)
    low, high = (_read_end(f"{location}.{x}", ends[x], quantity) for x in ("from", "to"))
    count = 2 if sampled else ends["steps"]
    if not (_whole(count) and 1 <= count <= MAX_VALUES):
        raise InvalidInput(
            f"{location}.steps must be a whole number from 1 to {MAX_VALUES}, but is {show(count)}."
        )
    start, end = show(ends["from"]), show(ends["to"])
    empty = f"{location} is an empty range: from and to are both {end}."
    raise_if(low == high and count > 1, empty)
    one = f"{location}.steps is 1, but from and to differ: write one value, or more."
    raise_if(low != high and count == 1, one)
    raise_if(
        scale == "log" and min(low, high) <= 0,
        f"{location}: a range with scale: log must be above zero, but goes from {start} to {end}: "
        "write scale: linear.",
    )
    return low, high, count, scale == "log"


def _read_end(location: str, value: Any, quantity: Quantity | None) -> float:
    """End of a range in SI units."""
    try:
        return parse_quantity(value, "1") if quantity is None else read_quantity(value, quantity)
    except ValueError as error:
        raise InvalidInput(f"{location}: {str(error).rstrip('.')}.") from None


def _in_si(key: str, value: Any) -> Any:
    """Value of a key in SI units; a value without a quantity is unchanged."""
    keys = full_key(key_of(key))
    return value_at(in_si(change_data({}, [Change(keys, value)]), JobModel), keys)


def _between(low: float, high: float, fractions: FloatArray, *, log: bool) -> FloatArray:
    """Values between two ends, which are reproduced exactly."""
    if log:
        values = np.exp(math.log(low) + fractions * (math.log(high) - math.log(low)))
    else:
        values = low + fractions * (high - low)
    values = np.where(fractions == 0.0, low, np.where(fractions == 1.0, high, values))
    return np.clip(values, min(low, high), max(low, high))


def _whole(value: Any) -> bool:
    """True if a value is written as an integer."""
    return isinstance(value, int) and not isinstance(value, bool)
