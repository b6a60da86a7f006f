"""Units of length that users state for files."""

from __future__ import annotations

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import parse_quantity


def unit_length(units: str | float | None) -> float | None:
    """Return the length of a stated unit [m]; None if none is stated.

    Args:
        units: A unit such as "mm", or its length in metres.

    Raises:
        InvalidInput: It is no unit of length, or not above zero.
    """
    if isinstance(units, str):
        try:
            return parse_quantity(f"1 {units}", "m")
        except ValueError:
            raise InvalidInput(
                f"units must be a unit of length such as mm, but is {units!r}."
            ) from None
    return None if units is None else checks.positive("units", units, "m")
