"""Quantities as users write them: a number in SI units, or text with a unit such as `5 mm`."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

# A number, then a unit: products, quotients and one-digit powers of names.
QUANTITY = re.compile(
    r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?\s*(1\s*/\s*)?[^\W\d_]\w*"
    r"(\s*(\*\*|\^)\s*-?\d|[²³]|(\s*[*/·]\s*|\s+)[^\W\d_]\w*)*\s*|"
    r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?\s*°\s*"
)


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
        raise ValueError(f"must be a number in {unit} or text with a unit, not {value!r}")
    if isinstance(value, int | float):
        try:
            number = float(value)
        except OverflowError:
            raise ValueError("must be finite, but has hundreds of digits") from None
        if not math.isfinite(number):
            raise ValueError(f"must be finite, but is {value}")
        return number
    try:
        float(value)
    except ValueError:
        pass
    else:
        raise ValueError(
            f"{value!r} has no unit: write one, such as '{value} {unit}', "
            f"or a plain number in {unit}"
        )
    # The library would compute whatever arithmetic stands there.
    if not QUANTITY.fullmatch(value):
        raise ValueError(f"{value[:40]!r} is not a quantity in {unit}: write a number and a unit")
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


def _quantity(unit: str, example: str) -> tuple[BeforeValidator, WithJsonSchema]:
    schema = {
        "description": f"A number in {unit}, or text with a unit such as '{example}'.",
        "anyOf": [{"type": "number"}, {"type": "string"}],
        "examples": [example],
    }
    return BeforeValidator(lambda value: parse(value, unit)), WithJsonSchema(schema)


Length = Annotated[float, *_quantity("m", "5 mm")]
Speed = Annotated[float, *_quantity("m/s", "0.15 m/s")]
Acceleration = Annotated[float, *_quantity("m/s^2", "0.09 m/s^2")]
Angle = Annotated[float, *_quantity("rad", "90 deg")]
JointVelocity = Annotated[float, *_quantity("rad/s", "1.5 rad/s")]
JointAcceleration = Annotated[float, *_quantity("rad/s^2", "0.72 rad/s^2")]
Duration = Annotated[float, *_quantity("s", "4 ms")]
Gain = Annotated[float, *_quantity("1/s", "25 1/s")]
Torque = Annotated[float, *_quantity("N m", "150 N m")]
JointJerk = Annotated[float, *_quantity("rad/s^3", "4000 rad/s^3")]
AngularSpeed = Annotated[float, *_quantity("rad/s", "90 deg/s")]
AngularAcceleration = Annotated[float, *_quantity("rad/s^2", "720 deg/s^2")]
Mass = Annotated[float, *_quantity("kg", "2 kg")]
Inertia = Annotated[float, *_quantity("kg m^2", "0.002 kg m^2")]
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
