"""Quantities in options, which have units."""

from __future__ import annotations

import math
from typing import Any, get_args

from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import Moment
from armcontour.core.text import plain_number
from armcontour.core.units import read_quantity


def read_option(option: str, text: str | None, kind: Any) -> Any:
    """Read a quantity in SI units; values other than 0 require a unit; None without the option."""
    if text is None:
        return None
    quantity, plain = get_args(kind)[1], text.strip()
    number = plain_number(plain)
    if number:
        # The message has only an example, because the intended unit is unknown.
        raise InvalidInput(
            f"{option} requires a unit, but {plain!r} has none. Specify it as in "
            f"'{quantity.example}'."
        )
    try:
        return read_quantity(plain if number is None else number, quantity)
    except ValueError as error:
        raise InvalidInput(f"{option}: {str(error).rstrip('.')}.") from None


def read_window(start: str | None, end: str | None) -> tuple[float, float]:
    """First and last used time of a log [s]; infinite if the option is not given."""
    first, last = read_option("--from", start, Moment), read_option("--to", end, Moment)
    return -math.inf if first is None else first, math.inf if last is None else last
