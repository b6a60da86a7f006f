"""Conversion of users' quantities, numbers in SI units or texts such as `5 mm`, to SI units."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from decimal import Decimal
from functools import cache
from typing import Any

from armcontour.core.checks import suffix
from armcontour.core.quantities import WHOLE_TURN, Quantity
from armcontour.core.text import plain_number, show

# Values that mean infinity if a quantity may be infinite.
INFINITE_VALUES = {
    "none": math.inf,
    "inf": math.inf,
    "-inf": -math.inf,
    math.inf: math.inf,
    -math.inf: -math.inf,
}
# Maximum length of the text of a quantity [characters].
MAX_CHARACTERS = 100
# The possessive quantifiers (++, *+, ?+) prevent backtracking, so that matching takes linear time.
# Groups have none, because Python before 3.11.5 matches possessive groups wrongly.
NUMBER = r"[-+]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][-+]?[0-9]{1,3}+)?"
# A unit name with at most one power of one digit, because pint would compute powers of powers.
NAME = r"[A-Za-zµμΩÅ][A-Za-z0-9_µμΩÅ]*+(?:\s*+(?:\*\*|\^)\s*+-?[0-9](?![0-9])|[²³])?"
# Products and quotients of unit names; the first factor may be 1, as in 1/s.
UNIT = rf"(?:1\s*+/\s*+)?{NAME}(?:(?:\s*+[*/·]\s*+|\s++){NAME})*"
QUANTITY = re.compile(rf"\s*+({NUMBER})\s*+({UNIT}|°)\s*+")
PERCENT = re.compile(rf"\s*+({NUMBER})\s*+%\s*+")
# Largest relative difference of numbers that is only a rounding error.
RELATIVE_ROUNDING = 1e-15
# Maximum length of a number that is written without an exponent [characters].
LONGEST_POSITIONAL = 20
# Conversion factors of usual units, by SI unit. For other units pint is imported, which takes about
# 0.3 s.
UNIT_FACTORS = {
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "m/min": 1 / 60, "mm/min": 1e-3 / 60},
    "m/s^2": {"m/s^2": 1.0, "m/s²": 1.0, "m/s**2": 1.0, "mm/s^2": 1e-3, "mm/s²": 1e-3},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180},
    "rad/s^2": {"rad/s^2": 1.0, "rad/s²": 1.0, "rad/s**2": 1.0, "deg/s^2": math.pi / 180},
    "m/s^3": {"m/s^3": 1.0, "m/s³": 1.0},
    "rad/s^3": {"rad/s^3": 1.0, "rad/s³": 1.0},
    "N m": {"N m": 1.0, "N*m": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "1/s": {"1/s": 1.0},
    "kg": {"kg": 1.0, "g": 1e-3},
}


@cache
def _registry() -> Any:
    """Unit registry of pint, extended by unit names of data sheets; cached."""
    from pint import UnitRegistry

    registry: Any = UnitRegistry(cache_folder=None)
    # Data sheets write Nm for the unit of torque.
    registry.define("newton_meter = newton * meter = Nm")
    return registry


def parse_quantity(value: Any, unit: str) -> float:
    """Convert a number or a text with a unit to a number in `unit`; ValueError if invalid."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"must be a number in {unit} or text with a unit, but is {show(value)}")
    return _parse_text(value, unit) if isinstance(value, str) else _finite_number(value)


def _parse_text(text: str, unit: str) -> float:
    """Convert text such as "5 mm" to a number in `unit`."""
    if len(text) > MAX_CHARACTERS:
        raise ValueError(
            f"{show(text)} has {len(text)} characters, but a quantity in {unit} has at most "
            f"{MAX_CHARACTERS}. Write a number and a unit"
        )
    if plain_number(text) is not None:
        raise ValueError(f"{text!r} has no unit. Write a unit, such as '{text} {unit}'")
    # The form is checked here, because pint would compute any arithmetic expression in the text.
    match = QUANTITY.fullmatch(text)
    if not match:
        pointed = re.sub(r"(?<=\d),(?=\d)", ".", text, count=1)
        if pointed != text and QUANTITY.fullmatch(pointed):
            raise ValueError(f"{text!r} has a decimal comma. Write {pointed!r}")
        raise ValueError(f"{show(text)} is not a quantity in {unit}. Write a number and a unit")
    number, written_unit = match.groups()
    factor = UNIT_FACTORS.get(unit, {}).get(written_unit.strip())
    result = _convert(text, unit) if factor is None else float(number) * factor
    if not math.isfinite(result):
        raise ValueError(f"must be finite, but is {text!r}")
    return result


def _convert(text: str, unit: str) -> float:
    """Convert text such as "5 thou" to a number in `unit` by pint."""
    import pint

    try:
        return float(_registry().Quantity(text).to(unit).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"must be a quantity in {unit}, but is {text!r}") from None
    except Exception as error:  # the parser of pint can raise tokenizer and syntax errors
        raise ValueError(f"{text!r} is not a quantity in {unit}: {error}") from None


def _finite_number(value: float) -> float:
    """Convert a number to a float; ValueError if it is not finite."""
    try:
        number = float(value)
    except OverflowError:
        raise ValueError("must be finite, but has hundreds of digits") from None
    if not math.isfinite(number):
        raise ValueError(f"must be finite, but is {value}")
    return number


def parse_share(value: Any) -> float:
    """Convert a dimensionless share, a number or a text such as "10 %"; ValueError if invalid."""
    if isinstance(value, str):
        match = PERCENT.fullmatch(value[: MAX_CHARACTERS + 1])
        if match is None or len(value) > MAX_CHARACTERS:
            raise ValueError(
                f"must be a plain number or a percentage such as '10 %', but is {show(value)}"
            )
        return parse_quantity(float(match[1]), "%") / 100
    return parse_quantity(value, "1")


def read_quantity(value: Any, kind: Quantity) -> float:
    """Convert a user's quantity to SI units and check its range; ValueError if invalid."""
    if kind.endless and isinstance(value, str | float) and value in INFINITE_VALUES:
        endless = INFINITE_VALUES[value]
        if endless > 0 or kind.sign == "any":
            return endless
    number = read_plain(value, kind)
    low, high = kind.range
    turned = kind.sign == "turn" and abs(number) > WHOLE_TURN and not isinstance(value, str)
    if low <= number <= high and not turned:
        return number
    written = value.strip() if isinstance(value, str) else f"{number:g}{suffix(kind.words)}"
    percent = kind.sign == "share" and not isinstance(value, str) and 1 <= number < 100
    hint = f". For {written} percent, write {written} %" if percent else ""
    if turned:
        hint = f". For {number:g} degrees, write {number:g} deg"
    needed = "be at most a whole turn without a unit" if turned else kind.needed(number)
    raise ValueError(f"must {needed}, but is {written}{hint}")


def write_like(value: float, old: Any, kind: Quantity, *, within: float = 0.0) -> Any:
    """Write an SI value in the unit of `old`, with the fewest digits for an error of `within`.

    `within` is in SI units. Returns text with a unit, or a number if `old` is a number.
    """
    affixes = _unit_affixes(old, kind)
    if affixes is None:
        number = float(_shortest_text(value, value, float, within))
        return int(number) if isinstance(old, int) and number == int(number) else number
    before, after = affixes
    one = read_plain(f"{before}1{after}", kind)
    text = _shortest_text(
        value / one, value, lambda x: read_plain(f"{before}{x}{after}", kind), within
    )
    return before + text + after


def unit_of(old: Any, kind: Quantity) -> tuple[str, float]:
    """Unit in which the quantity `old` is written, and its conversion factor to SI units."""
    affixes = _unit_affixes(old, kind)
    if affixes is None:
        return ("" if kind.unit == "1" else kind.unit), 1.0
    return affixes[1].strip(), read_plain(f"1{affixes[1]}", kind)


def _unit_affixes(old: Any, kind: Quantity) -> tuple[str, str] | None:
    """Text before and after the number of a quantity; None for a plain number.

    For other values, the texts of the example of `kind`.
    """
    if isinstance(old, int | float) and not isinstance(old, bool):
        return None
    pattern = PERCENT if kind.unit == "1" else QUANTITY
    match = pattern.fullmatch(old) if isinstance(old, str) else None
    if match is None:
        old, match = kind.example, pattern.fullmatch(kind.example)
    assert match is not None
    return old[: match.start(1)], old[match.end(1) :]


def read_plain(value: Any, kind: Quantity) -> float:
    """Convert a quantity to SI units without a check of its range; ValueError if invalid."""
    return parse_share(value) if kind.unit == "1" else parse_quantity(value, kind.unit)


def _shortest_text(number: float, value: float, read: Callable[[str], float], within: float) -> str:
    """Text of `number` with the fewest digits for which `read` returns `value` within `within`."""
    allowed = max(within, RELATIVE_ROUNDING * abs(value))
    text = "0"
    if abs(value) <= allowed:
        return text
    for digits in range(1, 18):
        text = _positional(f"{number:.{digits}g}")
        if abs(read(text) - value) <= allowed:
            break
    return text


def _positional(text: str) -> str:
    """Convert a number text to one without an exponent, unless the result would be too long."""
    if "e" not in text:
        return text
    plain = f"{Decimal(text):f}"
    return text if len(plain) > LONGEST_POSITIONAL else plain
