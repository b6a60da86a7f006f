"""Kinds of quantities, as annotations of fields: unit, example, range.

`core/fields.py` checks fields by them, and `files/file_keys.py` reads keys of files. Quantities of
users are numbers in SI units, or texts such as `5 mm`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from types import EllipsisType
from typing import Annotated, Any, Literal

from armcontour.core.checks import LARGEST_NUMBER, LONGEST_NAME, SMALLEST_NUMBER, FloatArray, suffix
from armcontour.core.text import plain_number, show

# Largest angle about an axis [rad]: a whole turn with three decimals. A larger angle is probably in
# degrees.
WHOLE_TURN = 6.284


# Ranges of numbers by the `sign` of their quantity. A "share" is at most the largest float below 1.
RANGES = {
    "any": (-LARGEST_NUMBER, LARGEST_NUMBER),
    "positive": (SMALLEST_NUMBER, LARGEST_NUMBER),
    "not negative": (0.0, LARGEST_NUMBER),
    "negative": (-LARGEST_NUMBER, -SMALLEST_NUMBER),
    "share": (0.0, 1.0 - 2.0**-53),
    "turn": (-LARGEST_NUMBER, LARGEST_NUMBER),
}
# Values that mean infinity if a quantity may be infinite.
INFINITE_VALUES = {
    "none": math.inf,
    "inf": math.inf,
    "-inf": -math.inf,
    math.inf: math.inf,
    -math.inf: -math.inf,
}
# Maximum length of a quantity's text [characters].
MAX_QUANTITY_LENGTH = 100
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


# Units of cycles per second. A gain in 1/s is in radians per second, 2 pi times as large.
CYCLES = re.compile("Hz|hertz", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Quantity:
    """Annotate a float or an array with a physical quantity.

    An array has one value for all joints or one per joint.

    Args:
        unit: SI unit; "1" for a fraction, which users may write in percent; empty for plain
            numbers.
        example: Example of a text that users may write.
        sign: Allowed range: a "share" is from 0 to below 1; the magnitude of a "turn" without a
            unit is at most WHOLE_TURN.
        endless: Whether the value may be infinite, as `.inf` or as the texts "inf" and "none".
        bounds: Whether a lower and an upper bound may replace each value of an array.
        within: Smallest and largest allowed value; None for any value of this sign.
    """

    unit: str
    example: str = ""
    sign: Literal["any", "positive", "not negative", "negative", "share", "turn"] = "any"
    endless: bool = False
    bounds: bool = False
    within: tuple[float, float] | None = None

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest allowed finite value."""
        return self.within or RANGES[self.sign]

    @property
    def words(self) -> str:
        """Unit for messages; empty for plain numbers."""
        return "" if self.unit == "1" else self.unit.replace("^2", "²").replace("^3", "³")

    def needed(self, value: float) -> str:
        """Return the requirement that a finite value violates, as words that follow "must"."""
        low, high = self.range
        unit = self.words and f" {self.words}"
        if self.within is None and self.sign == "share":
            return "be from 0 to below 1, as 0.1 for 10 %"
        if value <= 0 < low:
            return "be above zero"
        if value < 0 == low:
            return "not be negative"
        if value >= 0 > high:
            return "be below zero"
        return f"be from {low:g} to {high:g}{unit}"


def joint_units(unit: str, prismatic: Iterable[bool]) -> list[str]:
    """List the unit of each joint, given that of revolute joints."""
    return [linear_unit(unit) if x else unit for x in prismatic]


def shared_unit(unit: str, prismatic: Iterable[bool]) -> str:
    """Return the unit of all joints, given that of revolute joints; a list if the units differ.

    >>> shared_unit("rad/s", [True, False])
    'm/s, rad/s'
    """
    units = joint_units(unit, prismatic)
    return ", ".join(units) if len(set(units)) > 1 else (units or [unit])[0]


def any_unit(unit: str, prismatic: Iterable[bool]) -> str:
    """Return the unit of any joint, given that of revolute joints; two units if joints differ."""
    return shared_unit(unit, sorted(set(prismatic)))


def list_values(texts: Sequence[str], unit: str, prismatic: Iterable[bool]) -> str:
    """Write joint values with their unit, or each with its own; equal values only once."""
    units = joint_units(unit, prismatic)
    if len(set(units)) > 1:
        every = [*texts] * (len(units) if len(texts) == 1 else 1)
        return ", ".join(f"{x} {y}" for x, y in zip(every, units, strict=True))
    text = texts[0] if len(set(texts)) == 1 else ", ".join(texts)
    return f"{text} {units[0] if units else unit}".rstrip()


def linear_unit(unit: str) -> str:
    """Return the unit for a prismatic joint, given the unit for a revolute joint.

    >>> linear_unit("N m s/rad")
    'N s/m'
    """
    for angular, linear in (("kg m^2", "kg"), ("kg m²", "kg"), ("N m", "N"), ("rad", "m")):
        unit = unit.replace(angular, linear)
    return unit


@dataclass(frozen=True, slots=True, init=False)
class Axes:
    """Annotate an array with its shape.

    Args:
        axes: Length of each axis, or its name. In a dataclass, axes with the same name have the
            same length. `...` alone is any shape.
    """

    axes: tuple[str | int | EllipsisType, ...]

    def __init__(self, *axes: str | int | EllipsisType) -> None:
        object.__setattr__(self, "axes", axes)

    def __str__(self) -> str:
        """Write the shape as numpy does, such as "(n, 3)"."""
        return f"({', '.join(str(x) for x in self.axes)}{',' * (len(self.axes) == 1)})"


@dataclass(frozen=True, slots=True)
class Choice:
    """Annotate a str with its allowed values."""

    known: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class AtLeast:
    """Annotate an int with its range; None for no bound."""

    least: int | None
    most: int | None = None


@dataclass(frozen=True, slots=True)
class Named:
    """Annotate a str as printable text of limited length, such as a name."""

    most: int = LONGEST_NAME
    needed: bool = False


@dataclass(frozen=True, slots=True)
class PartialFields:
    """Annotate a mapping that gives some fields of a dataclass by name.

    Args:
        of: The dataclass.
        null: Whether every key of a file may be `null`.
        omit: Fields that are no keys.
    """

    of: type
    null: bool = False
    omit: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Items:
    """Annotate a list or a mapping of a file with its allowed length."""

    least: int
    most: int | None = None

    def problem(self, n: int) -> str:
        """Return words after the key for a wrong length; empty for a right one."""
        high = self.most is not None and n > self.most
        bound = self.most if high else self.least
        if not high and n >= self.least:
            return ""
        entries = "one entry" if bound == 1 else f"{bound} entries"
        return f"must have at {'most' if high else 'least'} {entries}, but has {n}"


@dataclass(frozen=True, slots=True)
class Convert:
    """Annotate a type with the function that converts a file's value; it may raise ValueError."""

    convert: Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Key:
    """Annotate a field whose key in a file differs from the field.

    Args:
        name: Name of the key; empty for the field's name.
        hint: Annotation of the key; None for that of the field.
        default: Default of the key; None for that of the field.
        text: Description of the key; empty for that of the field.
        omit: Whether the field has no key.
    """

    name: str = ""
    hint: Any = None
    default: Any = None
    text: str = ""
    omit: bool = False


NO_KEY = Key(omit=True)
Name = Annotated[str, Named()]
NeededName = Annotated[str, Named(needed=True)]
Seed = Annotated[int, AtLeast(0)]
Workers = Annotated[int, AtLeast(1, 1024)]
PlainNumber = Annotated[float, Quantity("")]
Factor = Annotated[float, Quantity("1", "50 %", "positive")]
NotNegative = Annotated[float, Quantity("", sign="not negative")]
Direction = Annotated[FloatArray, Quantity(""), Axes(3)]
Length = Annotated[float, Quantity("m", "5 mm")]
Distance = Annotated[float, Quantity("m", "5 mm", "not negative")]
Size = Annotated[float, Quantity("m", "5 mm", "positive")]
Tolerance = Annotated[float, Quantity("m", "0.2 mm", "positive")]
Speed = Annotated[float, Quantity("m/s", "0.15 m/s", "positive")]
Acceleration = Annotated[float, Quantity("m/s^2", "0.09 m/s^2", "positive")]
Jerk = Annotated[float, Quantity("m/s^3", "50 m/s^3", "positive")]
Force = Annotated[float, Quantity("N", "2000 N", "positive")]
Angle = Annotated[float, Quantity("rad", "90 deg")]
Turn = Annotated[float, Quantity("rad", "90 deg", "turn")]
AngularDistance = Annotated[float, Quantity("rad", "2 deg", "not negative")]
# Largest cone around a tool axis [rad]
LARGEST_CONE = math.pi / 3
ConeAngle = Annotated[float, Quantity("rad", "10 deg", within=(0.0, LARGEST_CONE))]
AngularRate = Annotated[float, Quantity("rad/s", "90 deg/s", "positive")]
AngularAcceleration = Annotated[float, Quantity("rad/s^2", "720 deg/s^2", "positive")]
AngularJerk = Annotated[float, Quantity("rad/s^3", "4000 rad/s^3", "positive")]
Torque = Annotated[float, Quantity("N m", "150 N m", "positive")]
Time = Annotated[float, Quantity("s", "20 ms")]
Moment = Annotated[float, Quantity("s", "2 s")]
Duration = Annotated[float, Quantity("s", "4 ms", "not negative")]
Interval = Annotated[float, Quantity("s", "4 ms", "positive")]
Rest = Annotated[float, Quantity("s", "0.5 s", "positive")]
Frequency = Annotated[float, Quantity("1/s", "2 Hz", "positive")]
Pole = Annotated[float, Quantity("1/s", "-100 1/s", "negative")]
Mass = Annotated[float, Quantity("kg", "2 kg", "not negative")]
Inertia = Annotated[float, Quantity("kg m^2", "0.002 kg m^2")]
Ratio = Annotated[float, Quantity("1", "10 %")]
SpeedFactor = Annotated[float, Quantity("1", "10 %", within=(1e-3, 1.0))]
Reserve = Annotated[float, Quantity("1", "10 %", "share")]

DEAD_TIME = Quantity("s", "4 ms", "not negative")
GAIN_ERROR = Quantity("1", "10 %", "share")
# One value for all joints, or one per joint. An infinite limit is no limit.
JointRanges = Annotated[FloatArray, Quantity("rad", "90 deg", endless=True)]
JointVelocities = Annotated[
    FloatArray, Quantity("rad/s", "1.5 rad/s", "positive", endless=True, bounds=True)
]
JointAccelerations = Annotated[
    FloatArray, Quantity("rad/s^2", "0.72 rad/s^2", "positive", endless=True, bounds=True)
]
JointJerks = Annotated[FloatArray, Quantity("rad/s^3", "4000 rad/s^3", "positive", endless=True)]
JointTorques = Annotated[FloatArray, Quantity("N m", "150 N m", "positive", endless=True)]
SpeedLimit = Annotated[float, Quantity("m/s", "0.15 m/s", "positive", endless=True)]
AccelerationLimit = Annotated[float, Quantity("m/s^2", "0.09 m/s^2", "positive", endless=True)]
AngularSpeedLimit = Annotated[float, Quantity("rad/s", "90 deg/s", "positive", endless=True)]
AngularAccelerationLimit = Annotated[
    float, Quantity("rad/s^2", "720 deg/s^2", "positive", endless=True)
]
JointArmatures = Annotated[FloatArray, Quantity("kg m^2", "0.1 kg m^2", "not negative")]
ViscousFrictions = Annotated[FloatArray, Quantity("N m s/rad", "8 N m s/rad", "not negative")]
CoulombFrictions = Annotated[FloatArray, Quantity("N m", "6 N m", "not negative")]
OwnAccelerations = Annotated[
    FloatArray, Quantity("rad/s^2", "0.72 rad/s^2", "positive", endless=True)
]


@cache
def _registry() -> Any:
    """Return pint's unit registry with unit names of data sheets added; cached."""
    from pint import UnitRegistry

    registry: Any = UnitRegistry(cache_folder=None)
    # Data sheets write Nm for the unit of torque.
    registry.define("newton_meter = newton * meter = Nm")
    return registry


def parse_quantity(value: Any, unit: str) -> float:
    """Convert a number or a text with a unit to a number in `unit`; ValueError if invalid.

    >>> parse_quantity("5 mm", "m")
    0.005
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"must be a number in {unit} or text with a unit, but is {show(value)}")
    return _parse_text(value, unit) if isinstance(value, str) else _finite_number(value)


def _parse_text(text: str, unit: str) -> float:
    """Convert text such as "5 mm" to a number in `unit`."""
    if len(text) > MAX_QUANTITY_LENGTH:
        raise ValueError(
            f"{show(text)} has {len(text)} characters, but a quantity in {unit} has at most "
            f"{MAX_QUANTITY_LENGTH}. Write a number and a unit"
        )
    if plain_number(text) is not None:
        raise ValueError(f"{text!r} has no unit. Write a unit, such as '{text} {unit}'")
    # The form is checked here, because pint would compute any arithmetic expression in the text.
    match = QUANTITY.fullmatch(text)
    if not match:
        pointed = re.sub(r"(?<=\d),(?=\d)", ".", text, count=1)
        if pointed != text and QUANTITY.fullmatch(pointed):
            raise ValueError(f"{text!r} has a decimal comma. Write {pointed!r}")
        if pointed != text and plain_number(pointed) is not None:
            raise ValueError(f"{text!r} has a decimal comma. Write {pointed!r} with its unit")
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
    except Exception as error:  # The parser of pint can raise tokenizer and syntax errors.
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
        match = PERCENT.fullmatch(value[: MAX_QUANTITY_LENGTH + 1])
        if match is None or len(value) > MAX_QUANTITY_LENGTH:
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

    >>> write_like(0.00123, "2 mm", Quantity("m"), within=1e-5)
    '1.23 mm'
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
    """Return the unit in which `old` is written, and its conversion factor to SI units."""
    affixes = _unit_affixes(old, kind)
    if affixes is None:
        return ("" if kind.unit == "1" else kind.unit), 1.0
    return affixes[1].strip(), read_plain(f"1{affixes[1]}", kind)


def _unit_affixes(old: Any, kind: Quantity) -> tuple[str, str] | None:
    """Return the text before and after the number of a quantity; None for a plain number.

    If `old` is neither a number nor a text with a number, the example of `kind` is split.
    """
    if isinstance(old, int | float) and not isinstance(old, bool):
        return None
    pattern = PERCENT if kind.unit == "1" else QUANTITY
    match = pattern.fullmatch(old) if isinstance(old, str) else None
    if match is None:
        old = kind.example
        match = pattern.fullmatch(kind.example)
    assert match is not None
    return old[: match.start(1)], old[match.end(1) :]


def read_plain(value: Any, kind: Quantity) -> float:
    """Convert a quantity to SI units without checking its range; ValueError if invalid."""
    if kind.unit == "1/s" and isinstance(value, str) and CYCLES.search(value):
        if CYCLES.search(kind.example) is None:
            hertz = parse_quantity(value, kind.unit)
            raise ValueError(
                f"must be in 1/s, but is {value.strip()}. Hz counts cycles: write {hertz:g} 1/s "
                f"if this is the gain, or {math.tau * hertz:.4g} 1/s if it is a bandwidth in Hz"
            )
    return parse_share(value) if kind.unit == "1" else parse_quantity(value, kind.unit)


def _shortest_text(number: float, value: float, read: Callable[[str], float], within: float) -> str:
    """Write `number` with the fewest digits that `read` converts to `value` within `within`."""
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
