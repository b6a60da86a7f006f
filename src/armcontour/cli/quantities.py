"""Read quantities from options of the command line."""

from __future__ import annotations

import math
from typing import Any, get_args


def read_option(option: str, text: str | None, kind: Any) -> float | None:
    """The quantity of an option in SI units; None without the option.

    Args:
        option: The option, such as "--speed".
        text: A number with its unit, or 0.
        kind: The annotated type of the quantity, such as `Speed`.

    Raises:
        InvalidInput: The text is no quantity of the required unit, or has no unit.
    """
    return None if text is None else _read(option, text, kind)


def read_option_list(
    option: str, text: str | None, kind: Any, *, counts: tuple[int, ...] = (), example: str = ""
) -> tuple[float, ...] | None:
    """The quantities of an option, separated by commas, in SI units; None without the option.

    Args:
        option: The option.
        text: As in `read_option`, for each quantity.
        kind: As in `read_option`.
        counts: Allowed numbers of quantities; any number by default.
        example: A valid text, for the message.

    Raises:
        InvalidInput: Too many or too few quantities, or text that is no such quantity.
    """
    from armcontour.errors import InvalidInput

    if text is None:
        return None
    parts = text.split(",")
    if counts and len(parts) not in counts:
        wanted = " or ".join(str(n) for n in counts)
        raise InvalidInput(f"{option} takes {wanted} values, such as '{example}', not {text!r}.")
    return tuple(_read(option, part, kind) for part in parts)


def read_window(start: str | None, end: str | None) -> tuple[float, float]:
    """First and last time of a log to use [s]; infinite without the option.

    Args:
        start: The option --from.
        end: The option --to.

    Raises:
        InvalidInput: One of them is no time.
    """
    from armcontour._quantities import Moment

    first, last = read_option("--from", start, Moment), read_option("--to", end, Moment)
    return -math.inf if first is None else first, math.inf if last is None else last


def _read(option: str, text: str, kind: Any) -> float:
    """Read one quantity of an option: options are text, and text other than 0 needs a unit."""
    from armcontour._text import plain_number
    from armcontour.errors import InvalidInput
    from armcontour.io.units import read_quantity

    quantity = get_args(kind)[1]
    plain = text.strip()
    number = plain_number(plain)
    if number:
        # Not the number with a unit: the unit that was meant is not known.
        raise InvalidInput(
            f"{option}: {plain!r} has no unit: write one, as in '{quantity.example}'."
        )
    try:
        return read_quantity(plain if number is None else number, quantity)
    except ValueError as error:
        raise InvalidInput(f"{option}: {str(error).rstrip('.')}.") from None
