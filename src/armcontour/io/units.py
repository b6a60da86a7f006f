"""Quantities as users write them: a number in SI units, or text with a unit such as `5 mm`."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from armcontour._checks import LARGEST
from armcontour._numbers import plain_number
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
    if plain_number(value) is not None:
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


# Bounds of quantities by their names in JSON Schema: what they say, and what keeps them.
BOUNDS: dict[str, tuple[str, Callable[[float, float], bool]]] = {
    "exclusiveMinimum": ("be above zero", operator.gt),
    "exclusiveMaximum": ("be below zero", operator.lt),
    "minimum": ("not be negative", operator.ge),
}


def quantity(
    unit: str, example: str, bound: str | None = None
) -> tuple[BeforeValidator, WithJsonSchema]:
    """What makes a field of a model a quantity in a unit.

    Args:
        unit: The SI unit.
        example: Text with another unit.
        bound: On which side of zero it must be, of `BOUNDS`; None: on either.
    """
    schema = {
        "description": f"A number in {unit}, or text with a unit such as '{example}'.",
        "anyOf": [{"type": "number", **({bound: 0} if bound else {})}, {"type": "string"}],
        "examples": [example],
    }

    def within(value: Any) -> float:
        found = parse(value, unit)
        if bound is not None:
            must, keeps = BOUNDS[bound]
            if not keeps(found, 0.0):
                raise ValueError(f"must {must}, but is {found:g} {unit}")
        if abs(found) > LARGEST:
            raise ValueError(
                f"must be between -{LARGEST:g} and {LARGEST:g} {unit}, but is {found:g} {unit}"
            )
        return found

    return BeforeValidator(within), WithJsonSchema(schema)


Length = Annotated[float, *quantity("m", "5 mm")]
Distance = Annotated[float, *quantity("m", "5 mm", "minimum")]
Speed = Annotated[float, *quantity("m/s", "0.15 m/s", "exclusiveMinimum")]
Acceleration = Annotated[float, *quantity("m/s^2", "0.09 m/s^2", "exclusiveMinimum")]
Angle = Annotated[float, *quantity("rad", "90 deg")]
AngularDistance = Annotated[float, *quantity("rad", "2 deg", "minimum")]
JointVelocity = Annotated[float, *quantity("rad/s", "1.5 rad/s", "exclusiveMinimum")]
JointAcceleration = Annotated[float, *quantity("rad/s^2", "0.72 rad/s^2", "exclusiveMinimum")]
Duration = Annotated[float, *quantity("s", "4 ms", "minimum")]
Interval = Annotated[float, *quantity("s", "4 ms", "exclusiveMinimum")]
Gain = Annotated[float, *quantity("1/s", "25 1/s", "exclusiveMinimum")]
Pole = Annotated[float, *quantity("1/s", "-100 1/s", "exclusiveMaximum")]
Torque = Annotated[float, *quantity("N m", "150 N m", "exclusiveMinimum")]
JointJerk = Annotated[float, *quantity("rad/s^3", "4000 rad/s^3", "exclusiveMinimum")]
AngularSpeed = Annotated[float, *quantity("rad/s", "90 deg/s", "exclusiveMinimum")]
AngularAcceleration = Annotated[float, *quantity("rad/s^2", "720 deg/s^2", "exclusiveMinimum")]
Mass = Annotated[float, *quantity("kg", "2 kg")]
Memory = Annotated[float, *quantity("byte", "4 GB", "exclusiveMinimum")]
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
