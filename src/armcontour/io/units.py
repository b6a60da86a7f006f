"""Quantities as users write them: a number in SI units, or text with a unit such as `5 mm`."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from armcontour._checks import LARGEST
from armcontour._numbers import parse_number
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
    if isinstance(value, int | float):
        return _finite(value)
    if len(value) > MOST_CHARACTERS:
        raise ValueError(
            f"{show(value)} has {len(value)} characters, more than the {MOST_CHARACTERS} of a "
            f"quantity in {unit}: write a number and a unit"
        )
    if _is_number(value):
        raise ValueError(
            f"{value!r} has no unit: write one, such as '{value} {unit}', "
            f"or a plain number in {unit}"
        )
    # The library would compute whatever arithmetic stands there.
    if not QUANTITY.fullmatch(value):
        raise ValueError(f"{show(value)} is not a quantity in {unit}: write a number and a unit")
    import pint

    try:
        quantity = _registry().Quantity(value)
        result = float(quantity.to(unit).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"must be a quantity in {unit}, which {value!r} is not") from None
    except (
        pint.UndefinedUnitError,
        pint.PintError,
        ValueError,
        TypeError,
        AssertionError,
    ) as error:
        raise ValueError(f"{value!r} is not a quantity in {unit}: {error}") from None
    except Exception as error:  # pint's parser lets tokenizer and syntax errors through
        raise ValueError(f"{value!r} is not a quantity in {unit}: {error}") from None
    if not math.isfinite(result):
        raise ValueError(f"must be finite, but is {value!r}")
    return result


def _finite(value: float) -> float:
    try:
        number = float(value)
    except OverflowError:
        raise ValueError("must be finite, but has hundreds of digits") from None
    if not math.isfinite(number):
        raise ValueError(f"must be finite, but is {value}")
    return number


def _is_number(text: str) -> bool:
    try:
        parse_number(text)
    except ValueError:
        return False
    return True


def _position(value: Any) -> Any:
    """The position of a joint as it is written, refused if it is neither an angle nor a length."""
    if isinstance(value, str):
        try:
            parse(value, "m")
            return value
        except ValueError:
            pass
    parse(value, "rad")
    return value


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


def quantity(unit: str, example: str) -> tuple[BeforeValidator, WithJsonSchema]:
    """What makes a field of a model a quantity in a unit, either way of zero."""
    return _read(lambda value: parse(value, unit), unit, example, {})


def _positive(unit: str, example: str) -> tuple[BeforeValidator, WithJsonSchema]:
    def above_zero(value: Any) -> float:
        found = parse(value, unit)
        if found <= 0:
            raise ValueError(f"must be above zero, but is {found:g} {unit}")
        return found

    return _read(above_zero, unit, example, {"exclusiveMinimum": 0})


def _negative(unit: str, example: str) -> tuple[BeforeValidator, WithJsonSchema]:
    def below_zero(value: Any) -> float:
        found = parse(value, unit)
        if found >= 0:
            raise ValueError(f"must be below zero, but is {found:g} {unit}")
        return found

    return _read(below_zero, unit, example, {"exclusiveMaximum": 0})


def _not_negative(unit: str, example: str) -> tuple[BeforeValidator, WithJsonSchema]:
    def from_zero(value: Any) -> float:
        found = parse(value, unit)
        if found < 0:
            raise ValueError(f"must not be negative, but is {found:g} {unit}")
        return found

    return _read(from_zero, unit, example, {"minimum": 0})


def _read(
    read: Callable[[Any], float], unit: str, example: str, bound: dict[str, Any]
) -> tuple[BeforeValidator, WithJsonSchema]:
    schema = {
        "description": f"A number in {unit}, or text with a unit such as '{example}'.",
        "anyOf": [{"type": "number", **bound}, {"type": "string"}],
        "examples": [example],
    }

    def within(value: Any) -> float:
        found = read(value)
        if abs(found) > LARGEST:
            raise ValueError(
                f"must be between -{LARGEST:g} and {LARGEST:g} {unit}, but is {found:g} {unit}"
            )
        return found

    return BeforeValidator(within), WithJsonSchema(schema)


Length = Annotated[float, *quantity("m", "5 mm")]
Distance = Annotated[float, *_not_negative("m", "5 mm")]
Speed = Annotated[float, *_positive("m/s", "0.15 m/s")]
Acceleration = Annotated[float, *_positive("m/s^2", "0.09 m/s^2")]
Angle = Annotated[float, *quantity("rad", "90 deg")]
AngularDistance = Annotated[float, *_not_negative("rad", "2 deg")]
JointVelocity = Annotated[float, *_positive("rad/s", "1.5 rad/s")]
JointAcceleration = Annotated[float, *_positive("rad/s^2", "0.72 rad/s^2")]
Duration = Annotated[float, *_not_negative("s", "4 ms")]
Interval = Annotated[float, *_positive("s", "4 ms")]
Gain = Annotated[float, *_positive("1/s", "25 1/s")]
Pole = Annotated[float, *_negative("1/s", "-100 1/s")]
Torque = Annotated[float, *_positive("N m", "150 N m")]
JointJerk = Annotated[float, *_positive("rad/s^3", "4000 rad/s^3")]
AngularSpeed = Annotated[float, *_positive("rad/s", "90 deg/s")]
AngularAcceleration = Annotated[float, *_positive("rad/s^2", "720 deg/s^2")]
Mass = Annotated[float, *quantity("kg", "2 kg")]
Memory = Annotated[float, *_positive("byte", "4 GB")]
Inertia = Annotated[float, *quantity("kg m^2", "0.002 kg m^2")]
Ratio = Annotated[
    float,
    BeforeValidator(share),
    WithJsonSchema(
        {
            "description": "A plain number, or text in percent such as '10 %'.",
            "anyOf": [{"type": "number"}, {"type": "string"}],
            "examples": ["10 %"],
        }
    ),
]
# Which of the two it must be is up to its joint.
JointPosition = Annotated[
    float | str,
    BeforeValidator(_position),
    WithJsonSchema(
        {
            "description": "A number in rad (in m of a joint that slides), or text with a unit.",
            "anyOf": [{"type": "number"}, {"type": "string"}],
            "examples": ["10 deg", "20 mm"],
        }
    ),
]
