"""Kinds of quantities, as annotations of fields: unit, example, range.

`core/fields.py` checks fields by them, `files/keys.py` reads keys of files, and `core/units.py`
converts text of users.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import EllipsisType
from typing import Annotated, Any, Literal

from armcontour.core.checks import LARGEST, LONGEST_NAME, SMALLEST, FloatArray

# Largest angle about an axis [rad]: a whole turn with three decimals. A larger angle is probably in
# degrees.
WHOLE_TURN = 6.284


# Ranges of numbers by the `sign` of their quantity. A "share" is at most the largest float below 1.
RANGES = {
    "any": (-LARGEST, LARGEST),
    "positive": (SMALLEST, LARGEST),
    "not negative": (0.0, LARGEST),
    "negative": (-LARGEST, -SMALLEST),
    "share": (0.0, 1.0 - 2.0**-53),
    "turn": (-LARGEST, LARGEST),
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """Kind of a quantity: annotates a float, or an array with one value or one per joint."""

    # SI unit; "1" for a fraction, which users may write in percent; empty for plain numbers.
    unit: str
    example: str = ""  # Example of a text that users may write
    # Allowed range of the value; a "share" is from 0 to below 1. The magnitude of a "turn" without
    # a unit is at most WHOLE_TURN.
    sign: Literal["any", "positive", "not negative", "negative", "share", "turn"] = "any"
    # True if the value may be infinite, as `.inf` or as the texts "inf" and "none".
    endless: bool = False
    # True if each value of an array may be replaced by a lower and an upper bound.
    bounds: bool = False
    # Smallest and largest allowed value; None for any value of this sign.
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
        """Requirement that a finite value violates, as words that follow "must"."""
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


def linear_unit(unit: str) -> str:
    """Unit of a quantity of a prismatic joint, from the unit for a revolute joint."""
    for angular, linear in (("kg m^2", "kg"), ("kg m²", "kg"), ("N m", "N"), ("rad", "m")):
        unit = unit.replace(angular, linear)
    return unit


@dataclass(frozen=True, slots=True, init=False)
class Axes:
    """Shape of an array: annotates an array."""

    # Length of each axis, or its name. Axes with the same name have the same length in all fields
    # of a dataclass. `...` alone is any shape.
    axes: tuple[str | int | EllipsisType, ...]

    def __init__(self, *axes: str | int | EllipsisType) -> None:
        object.__setattr__(self, "axes", axes)

    def __str__(self) -> str:
        """Shape as numpy writes it, such as "(n, 3)"."""
        return f"({', '.join(str(x) for x in self.axes)}{',' * (len(self.axes) == 1)})"


@dataclass(frozen=True, slots=True)
class Choice:
    """Allowed texts: annotates a str."""

    known: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class AtLeast:
    """Range of an integer, None for no bound: annotates an int."""

    least: int | None
    most: int | None = None


@dataclass(frozen=True, slots=True)
class Named:
    """Printable text of limited length, such as a name: annotates a str."""

    most: int = LONGEST_NAME
    needed: bool = False


@dataclass(frozen=True, slots=True)
class About:
    """Options and sliders that set a field of a job: annotates the field, once per option."""

    # `tools/job_form.py` makes the short options of the command line and the sliders of the Studio.

    option: str = ""  # Option of the command line, such as "--units"; "" for none
    topic: str = ""  # Section of the help; by default that of the neighbouring keys
    help: str = ""
    read: str = ""  # Function of `cli/inputs.py` that reads the option, unless it is a single value
    # Key that the option sets in the mapping of the field; "*" if its text has the keys.
    key: str = ""
    # Range of the slider in the Studio, in SI units; linear if it begins at 0, otherwise
    # logarithmic. By default there is no slider.
    usual: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class PartialFields:
    """Values of some fields of a dataclass, by their names: annotates a mapping."""

    of: type
    null: bool = False  # Whether every key of a file may be `null`
    omit: tuple[str, ...] = ()  # Fields that are no keys


@dataclass(frozen=True, slots=True)
class Items:
    """Length of a list or a mapping of a file: annotates its type."""

    least: int
    most: int | None = None

    def problem(self, n: int) -> str:
        """Words after the key for a wrong length; empty for a right one."""
        high = self.most is not None and n > self.most
        bound = self.most if high else self.least
        if not high and n >= self.least:
            return ""
        entries = "one entry" if bound == 1 else f"{bound} entries"
        return f"must have at {'most' if high else 'least'} {entries}, but has {n}"


@dataclass(frozen=True, slots=True)
class Convert:
    """Conversion of a value of a file by a function that may raise ValueError: annotates a type."""

    convert: Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Key:
    """Key of a file that differs from its field: annotates the field."""

    name: str = ""
    hint: Any = None  # Annotation of the key
    default: Any = None
    text: str = ""
    omit: bool = False  # Whether the field has no key


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
AngularRate = Annotated[float, Quantity("rad/s", "90 deg/s", "positive")]
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
