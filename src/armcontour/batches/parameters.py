"""Parameters of a plan: keys of job files, with the values that they take."""

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
MOST_VALUES = 1_000_000


@dataclass(frozen=True, slots=True)
class Parameter:
    """A key of job files, with its values.

    Args:
        key: The key, with dots between the keys that lead there.
        unit: Unit of its numbers; None if they are no quantities.
        values: Its values, in SI units; the ends of a range that is sampled.
        ranged: Whether its values are a range.
        log: Whether that has a logarithmic scale.
        sampled: Whether a plan draws samples of it.
    """

    key: str
    unit: str | None
    values: tuple[Any, ...]
    ranged: bool = False
    log: bool = False
    sampled: bool = False

    @property
    def parts(self) -> Keys:
        """The keys that lead to its key, and the last one."""
        return key_of(self.key)

    @property
    def numeric(self) -> bool:
        """Whether all its values are numbers."""
        return all(isinstance(x, int | float) and not isinstance(x, bool) for x in self.values)

    def at(self, shares: FloatArray) -> FloatArray:
        """Values of a range, from its start to its end.

        Args:
            shares: Places in the range, from 0 to 1.
        """
        return _between(self.values[0], self.values[-1], shares, log=self.log)


def read_parameter(key: str, given: Any, *, sampled: bool) -> Parameter:
    """Read the values of a key of a plan.

    Args:
        key: The key.
        given: A list of values, a range, or a value that holds for all jobs.
        sampled: Whether the plan draws samples of its ranges.

    Raises:
        InvalidInput: A wrong range, or no value.
    """
    place = f"over.{key}"
    with error_context("over"):
        quantity = quantity_of(JobModel, full_key(key_of(key)))
    unit = None if quantity is None else quantity.unit
    if isinstance(given, Mapping):
        low, high, count, log = _read_range(place, given, quantity, sampled)
        if sampled:
            return Parameter(key, unit, (low, high), True, log, True)
        values = _between(low, high, np.linspace(0.0, 1.0, count), log=log).tolist()
        if quantity is None and all(_whole(given[x]) for x in ("from", "to")):
            # Counts, such as knots, have to be whole.
            values = [round(x) if abs(x - round(x)) < 1e-9 * abs(x) else x for x in values]
        return Parameter(key, unit, tuple(values), True, log)
    listed = given if isinstance(given, list) else [given]
    count = len(listed)
    raise_if(
        sampled and count > 1,
        f"{place}: samples are drawn of ranges, not of lists: write {{from: ..., to: ...}}, or "
        "combine: product.",
    )
    raise_if(count == 0, f"{place} is an empty list: give a value, or leave the key out.")
    raise_if(count > MOST_VALUES, f"{place} has {count} values, more than {MOST_VALUES}.")
    return Parameter(key, unit, tuple(_in_si(key, x) for x in listed))


def _read_range(
    place: str, given: Mapping[str, Any], quantity: Quantity | None, sampled: bool
) -> tuple[float, float, int, bool]:
    """Start, end and number of values of a range, and whether it is logarithmic.

    Raises:
        InvalidInput: An unknown key, a missing one, an empty range, or a wrong value.
    """
    for name in given:
        if name not in RANGE:
            hint = suggest(str(name), RANGE, f"a range has {', '.join(RANGE)}.")
            raise InvalidInput(f"{place}: unknown key {show(name)} of a range: {hint}")
    for name in RANGE[: 2 if sampled else 3]:
        if given.get(name) is None:
            raise InvalidInput(
                f"{place}.{name} is missing: a range is written as {{from: ..., to: ..., "
                "steps: 5}."
            )
    raise_if(
        sampled and "steps" in given,
        f"{place}.steps: the plan draws samples, whose number stands in combine.sobol: leave "
        "steps out.",
    )
    scale = checks.check_choice(f"{place}.scale", given.get("scale", "linear"), SCALES)
    low, high = (_read_end(f"{place}.{x}", given[x], quantity) for x in ("from", "to"))
    count = 2 if sampled else given["steps"]
    if not (_whole(count) and 1 <= count <= MOST_VALUES):
        raise InvalidInput(
            f"{place}.steps must be a whole number from 1 to {MOST_VALUES}, but is {show(count)}."
        )
    start, end = show(given["from"]), show(given["to"])
    empty = f"{place} is an empty range: from and to are both {end}."
    raise_if(low == high and count > 1, empty)
    one = f"{place}.steps is 1, but from and to differ: write one value, or more."
    raise_if(low != high and count == 1, one)
    raise_if(
        scale == "log" and min(low, high) <= 0,
        f"{place}: a range with scale: log must be above zero, but goes from {start} to {end}: "
        "write scale: linear.",
    )
    return low, high, count, scale == "log"


def _read_end(place: str, value: Any, quantity: Quantity | None) -> float:
    """An end of a range in SI units."""
    try:
        return parse_quantity(value, "1") if quantity is None else read_quantity(value, quantity)
    except ValueError as error:
        raise InvalidInput(f"{place}: {str(error).rstrip('.')}.") from None


def _in_si(key: str, value: Any) -> Any:
    """A value of a key in SI units; what is no quantity stays as it is."""
    keys = full_key(key_of(key))
    return value_at(in_si(change_data({}, [Change(keys, value)]), JobModel), keys)


def _between(low: float, high: float, shares: FloatArray, *, log: bool) -> FloatArray:
    """Values between two ends, which are met exactly."""
    if log:
        found = np.exp(math.log(low) + shares * (math.log(high) - math.log(low)))
    else:
        found = low + shares * (high - low)
    found = np.where(shares == 0.0, low, np.where(shares == 1.0, high, found))
    return np.clip(found, min(low, high), max(low, high))


def _whole(value: Any) -> bool:
    """Whether a value is written as a whole number."""
    return isinstance(value, int) and not isinstance(value, bool)
