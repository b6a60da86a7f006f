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
from armcontour.files.job_model import JobModel
from armcontour.files.job_text_edits import Change, Keys, change_data, value_at
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

    # The key path in the job file, such as "path.corner_error"
    key: str
    # SI unit of the values; None if they are not quantities
    unit: str | None
    # Values in SI units; for a sampled range its start and end
    values: tuple[Any, ...]
    # True if the values are a range
    ranged: bool = False
    # True if the range has a logarithmic scale
    log: bool = False
    # True if the plan draws samples from the range
    sampled: bool = False

    @property
    def parts(self) -> Keys:
        """Key path as a tuple of keys and list indices."""
        return key_of(self.key)

    @property
    def numeric(self) -> bool:
        """True if all values are numbers."""
        return all(isinstance(x, int | float) and not isinstance(x, bool) for x in self.values)

    def values_at(self, fractions: FloatArray) -> FloatArray:
        """Values at fractions (0 to 1) of the range, in the shape of `fractions`."""
        return _interpolate(self.values[0], self.values[-1], fractions, log=self.log)


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
        values = _interpolate(low, high, np.linspace(0.0, 1.0, count), log=log).tolist()
        if quantity is None and all(_is_integer(specified[x]) for x in ("from", "to")):
            # Integer keys, such as numbers of knots, need integer values.
            values = [round(x) if abs(x - round(x)) < 1e-9 * abs(x) else x for x in values]
        return Parameter(key, unit, tuple(values), True, log)
    listed = specified if isinstance(specified, list) else [specified]
    count = len(listed)
    raise_if(
        sampled and count > 1,
        f"{location}: combine.sobol requires a range, not a list. Write {{from: ..., to: ...}}, or "
        "combine: product.",
    )
    raise_if(count == 0, f"{location} is an empty list. Specify a value, or remove the key.")
    raise_if(
        count > MAX_VALUES, f"{location} has {count} values, but at most {MAX_VALUES} are allowed."
    )
    return Parameter(key, unit, tuple(_value_in_si(key, x) for x in listed))


def _read_range(
    location: str, ends: Mapping[str, Any], quantity: Quantity | None, sampled: bool
) -> tuple[float, float, int, bool]:
    """Start, end and number of values of a range, and True if its scale is logarithmic."""
    for name in ends:
        if name not in RANGE:
            hint = suggest(str(name), RANGE, f"a range has the keys {', '.join(RANGE)}.")
            raise InvalidInput(f"{location}: unknown key {show(name)} of a range: {hint}")
    for name in RANGE[: 2 if sampled else 3]:
        if ends.get(name) is None:
            raise InvalidInput(
                f"{location}.{name} is missing. Write a range as {{from: ..., to: ..., steps: 5}}."
            )
    raise_if(
        sampled and "steps" in ends,
        f"{location}.steps cannot be combined with combine.sobol, which is the number of samples. "
        "Remove steps.",
    )
    scale = checks.check_choice(f"{location}.scale", ends.get("scale", "linear"), SCALES)
    low, high = (_read_end(f"{location}.{x}", ends[x], quantity) for x in ("from", "to"))
    count = 2 if sampled else ends["steps"]
    if not (_is_integer(count) and 1 <= count <= MAX_VALUES):
        raise InvalidInput(
            f"{location}.steps must be a whole number from 1 to {MAX_VALUES}, but is {show(count)}."
        )
    start, end = show(ends["from"]), show(ends["to"])
    empty = f"{location} is an empty range, because from and to are both {end}."
    raise_if(low == high and count > 1, empty)
    one = (
        f"{location}.steps is 1, but from and to differ. Write one value instead of the range, or "
        "more steps."
    )
    raise_if(low != high and count == 1, one)
    raise_if(
        scale == "log" and min(low, high) <= 0,
        f"{location}: a range with scale: log must be positive, but is from {start} to {end}. "
        "Write scale: linear.",
    )
    return low, high, count, scale == "log"


def _read_end(location: str, value: Any, quantity: Quantity | None) -> float:
    """Start or end of a range in SI units."""
    try:
        return parse_quantity(value, "1") if quantity is None else read_quantity(value, quantity)
    except ValueError as error:
        raise InvalidInput(f"{location}: {str(error).rstrip('.')}.") from None


def _value_in_si(key: str, value: Any) -> Any:
    """Value of a key in SI units; a value that is not a quantity is unchanged."""
    keys = full_key(key_of(key))
    return value_at(in_si(change_data({}, [Change(keys, value)]), JobModel), keys)


def _interpolate(low: float, high: float, fractions: FloatArray, *, log: bool) -> FloatArray:
    """Values at fractions (0 to 1) of a range; at 0 and 1, they are exactly its ends."""
    if log:
        values = np.exp(math.log(low) + fractions * (math.log(high) - math.log(low)))
    else:
        values = low + fractions * (high - low)
    values = np.where(fractions == 0.0, low, np.where(fractions == 1.0, high, values))
    return np.clip(values, min(low, high), max(low, high))


def _is_integer(value: Any) -> bool:
    """True if a value is an integer, not a boolean."""
    return isinstance(value, int) and not isinstance(value, bool)
