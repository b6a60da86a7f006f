"""Quantities as users write them: a number in SI units, or text with a unit such as `5 mm`."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Any

from armcontour._checks import LARGEST
from armcontour._numbers import plain_number
from armcontour._quantities import Quantity
from armcontour._text import show

# No quantity is longer.
MOST_CHARACTERS = 100
# What is taken is not given back, so the time grows with the length of the text alone.
NUMBER = r"[-+]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eE][-+]?[0-9]{1,3}+)?+"
# A name, and at most one power of one digit: the library would work out powers of powers.
NAME = r"[A-Za-zµμΩÅ][A-Za-z0-9_µμΩÅ]*+(?:\s*+(?:\*\*|\^)\s*+-?[0-9](?![0-9])|[²³])?+"
# Products and quotients of names, or of one and names.
UNIT = rf"(?:1\s*+/\s*+)?+{NAME}(?:(?:\s*+[*/·]\s*+|\s++){NAME})*+"
QUANTITY = re.compile(rf"\s*+{NUMBER}\s*+(?:{UNIT}|°)\s*+")
PERCENT = re.compile(rf"\s*+({NUMBER})\s*+%\s*+")


@cache
def _registry() -> Any:
    from pint import UnitRegistry

    registry: Any = UnitRegistry(cache_folder=None)
    # What data sheets write for the unit of torque.
    registry.define("newton_meter = newton * meter = Nm")
    return registry


def parse(value: Any, unit: str) -> float:
    """The value in `unit`.

    Args:
        value: A number, which is in `unit` already, or text such as "5 mm".
        unit: The SI unit wanted, such as "m/s".

    Raises:
        ValueError: Neither, text without a unit, an unknown unit, or one of another dimension.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"must be a number in {unit} or text with a unit, not {show(value)}")
    return _parse_text(value, unit) if isinstance(value, str) else _finite(value)


def _parse_text(text: str, unit: str) -> float:
    """A number with its unit, in another unit."""
    if len(text) > MOST_CHARACTERS:
        raise ValueError(
            f"{show(text)} has {len(text)} characters, more than the {MOST_CHARACTERS} of a "
            f"quantity in {unit}: write a number and a unit"
        )
    if plain_number(text) is not None:
        raise ValueError(
            f"{text!r} has no unit: write one, such as '{text} {unit}', or a plain number in {unit}"
        )
    # The library would compute whatever arithmetic stands there.
    if not QUANTITY.fullmatch(text):
        raise ValueError(f"{show(text)} is not a quantity in {unit}: write a number and a unit")
    import pint

    try:
        result = float(_registry().Quantity(text).to(unit).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"must be a quantity in {unit}, which {text!r} is not") from None
    except Exception as error:  # pint's parser lets tokenizer and syntax errors through
        raise ValueError(f"{text!r} is not a quantity in {unit}: {error}") from None
    if not math.isfinite(result):
        raise ValueError(f"must be finite, but is {text!r}")
    return result


def _finite(value: float) -> float:
    try:
        number = float(value)
    except OverflowError:
        raise ValueError("must be finite, but has hundreds of digits") from None
    if not math.isfinite(number):
        raise ValueError(f"must be finite, but is {value}")
    return number


def share(value: Any) -> float:
    """A share of something, from a plain number or text in percent such as "10 %".

    Raises:
        ValueError: Neither.
    """
    if isinstance(value, str):
        found = PERCENT.fullmatch(value[: MOST_CHARACTERS + 1])
        if found is None or len(value) > MOST_CHARACTERS:
            raise ValueError(
                f"must be a plain number or a percentage such as '10 %', not {show(value)}"
            )
        return parse(float(found[1]), "%") / 100
    return parse(value, "1")


def read_quantity(value: Any, kind: Quantity) -> float:
    """A quantity of a kind in SI units, from a plain number or text with a unit.

    Args:
        value: What the user wrote.
        kind: The unit, and where the quantity lies.

    Raises:
        ValueError: It is no such quantity.
    """
    if kind.unit == "1":
        return share(value)
    found = parse(value, kind.unit)
    outside, words = {
        "any": (False, ""),
        "positive": (found <= 0, "be above zero"),
        "not negative": (found < 0, "not be negative"),
        "negative": (found >= 0, "be below zero"),
    }[kind.sign]
    if outside:
        raise ValueError(f"must {words}, but is {found:g} {kind.unit}")
    if abs(found) > LARGEST:
        raise ValueError(
            f"must be between -{LARGEST:g} and {LARGEST:g} {kind.unit}, but is {found:g} "
            f"{kind.unit}"
        )
    return found
