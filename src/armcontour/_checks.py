"""Checks at the birth of a value: shape, finiteness, sign. Each refusal is one sentence."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from functools import wraps
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from armcontour._text import make_printable, show
from armcontour.errors import InvalidInput

# No name is longer: names stand in the lines of robot programs, in tables and on terminals.
LONGEST_NAME = 80
FloatArray = npt.NDArray[np.float64]
# No length, time, speed or torque of a robot is larger than this in SI units, and its powers up to
# the twenty-fifth are numbers; of larger ones squares, cubes and their products overflow.
LARGEST = 1e12
# A number that must be above zero must not be less than this: its reciprocal's powers up to the
# tenth are numbers. Of a tolerance or a time it is nothing in any unit.
SMALLEST = 1e-30
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

# Kinds of arrays that are numbers; an array of objects is one if each of them is.
NUMERIC = "iufO"
NOT_NUMERIC = {
    "b": "truth values",
    "U": "text",
    "S": "bytes",
    "c": "complex numbers",
    "M": "dates",
    "m": "spans of time",
    "V": "records",
}


def lock_floats(values: npt.ArrayLike) -> FloatArray:
    """A read-only copy of `values` as a float array."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def lock_copy(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A read-only copy of `array`, of the same type."""
    copy = array.copy()
    copy.setflags(write=False)
    return copy


class Locked:
    """Base of classes whose instances do not change once their constructor has returned.

    Constructors, of subclasses too, set attributes as usual; at their end all arrays are made
    read-only. A `functools.cached_property` works as ever. A subclass that is a dataclass locks
    itself, with `frozen=True`.
    """

    # How to get a changed one, the end of a sentence.
    _instead: ClassVar[str] = "make another one"

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__init__" not in vars(cls):
            return
        construct = cls.__init__

        @wraps(construct)
        def construct_and_lock(self: Locked, *args: Any, **keywords: Any) -> None:
            construct(self, *args, **keywords)
            # The constructor of a subclass goes on after this one.
            if type(self).__init__ is construct_and_lock:
                arrays = {k: x for k, x in vars(self).items() if isinstance(x, np.ndarray)}
                vars(self).update({k: lock_copy(x) for k, x in arrays.items()}, _locked=True)

        cls.__init__ = construct_and_lock  # type: ignore[assignment, method-assign]

    def __setattr__(self, name: str, value: Any) -> None:
        self._refuse_change(name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        self._refuse_change(name)
        super().__delattr__(name)

    def _refuse_change(self, name: str) -> None:
        if "_locked" in vars(self):
            raise FrozenInstanceError(
                f"The {name} of a {type(self).__name__} cannot be set after it was made, as plans "
                f"may rely on it: {self._instead}."
            )


def numbers(name: str, values: npt.ArrayLike, unit: str = "") -> FloatArray:
    """`values` as a new float array, all finite and within LARGEST.

    Raises:
        InvalidInput: Not numbers (text and truth values are none), not finite or too large; names
            the first offending index.
    """
    try:
        given = np.asarray(values)
        if given.dtype.kind not in NUMERIC:
            raise InvalidInput(
                f"{name} must be numbers{in_unit(unit)}, not {NOT_NUMERIC[given.dtype.kind]}."
            )
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InvalidInput):
            raise
        # The library's first sentence says what is wrong.
        said = str(error).split(". ")[0].rstrip(".")
        raise InvalidInput(f"{name} must be numbers{in_unit(unit)}: {said}.") from None
    bad = ~(np.abs(array) <= LARGEST)
    if bad.any():
        where = np.argwhere(bad)[0]
        place = f" at index {', '.join(str(i) for i in where)}" if array.ndim else ""
        value = float(array[tuple(where)] if array.ndim else array)
        range_ = f"between -{LARGEST:g} and {LARGEST:g}{suffix(unit)}"
        needed = range_ if np.isfinite(value) else "finite"
        raise InvalidInput(
            f"{name} must be {needed}, but is {value:g}{place}.",
            index=int(where[0]) if array.ndim else None,
        )
    return array


def points(name: str, values: npt.ArrayLike) -> FloatArray:
    """`values` as a new (n, 2) or (n, 3) array of finite coordinates [m].

    Raises:
        InvalidInput: Ragged, of another shape, or not finite.
    """
    array = numbers(name, values, "m")
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise InvalidInput(
            f"{name} must be rows of 2 or 3 coordinates in m, but have shape {array.shape}."
        )
    return array


def number(name: str, value: Any, unit: str = "") -> float:
    """`value` as a finite float.

    Raises:
        InvalidInput: Not one finite number.
    """
    array = numbers(name, value, unit)
    if array.ndim:
        raise InvalidInput(f"{name} must be one number{in_unit(unit)}, not {array.size}.")
    return float(array)


def positive(name: str, value: Any, unit: str = "") -> float:
    """`value` as a finite float above zero, at least SMALLEST.

    Raises:
        InvalidInput: Not one such number.
    """
    checked = number(name, value, unit)
    if checked <= 0:
        raise InvalidInput(f"{name} must be above zero, but is {checked:g}{suffix(unit)}.")
    if checked < SMALLEST:
        raise InvalidInput(
            f"{name} must be at least {SMALLEST:g}{suffix(unit)}, but is {checked:g}{suffix(unit)}."
        )
    return checked


def between(name: str, value: Any, low: float, high: float, unit: str = "") -> float:
    """`value` as a float from `low` to `high`.

    Raises:
        InvalidInput: Not one finite number in that range.
    """
    checked = not_negative(name, value, unit) if low == 0 else number(name, value, unit)
    if low > 0 >= checked:
        raise InvalidInput(f"{name} must be above zero, but is {checked:g}{suffix(unit)}.")
    if not low <= checked <= high:
        raise InvalidInput(
            f"{name} must be from {low:g} to {high:g}{suffix(unit)}, but is "
            f"{checked:g}{suffix(unit)}."
        )
    return checked


def not_negative(name: str, value: Any, unit: str = "") -> float:
    """`value` as a finite float, zero or above.

    Raises:
        InvalidInput: Not one finite number, or below zero.
    """
    checked = number(name, value, unit)
    if checked < 0:
        raise InvalidInput(f"{name} must not be negative, but is {checked:g}{suffix(unit)}.")
    return checked


def whole(name: str, value: Any, low: int, high: int) -> int:
    """`value` as an int from `low` to `high`.

    Raises:
        InvalidInput: Not a whole number, or outside that range.
    """
    checked = number(name, value)
    if checked != int(checked) or not low <= checked <= high:
        raise InvalidInput(
            f"{name} must be a whole number from {low} to {high}, but is {checked:g}."
        )
    return int(checked)


def per_joint(name: str, values: npt.ArrayLike, dof: int, unit: str = "") -> FloatArray:
    """One number for all joints, or one per joint, as a new (dof,) array.

    Raises:
        InvalidInput: A wrong number of values, or not finite.
    """
    array = numbers(name, values, unit)
    if array.ndim == 0:
        return np.full(dof, float(array))
    if array.shape != (dof,):
        raise InvalidInput(
            f"{name} has {array.size} values, but the arm has {dof} joints: "
            f"give one value for all joints or {dof}."
        )
    return array


def choice(name: str, value: str, known: tuple[str, ...]) -> str:
    """`value`, if it is one of `known`.

    Raises:
        InvalidInput: Another value; the message lists the known ones.
    """
    if value not in known:
        raise InvalidInput(f"{name} must be one of {', '.join(known)}, not {value!r}.")
    return value


def check_name(what: str, value: Any, *, most: int = LONGEST_NAME) -> str:
    """`value` as a name: one line of printable text, or none.

    Args:
        what: What the name is of, for messages, such as "name of the event".
        value: The name.
        most: The largest number of characters.

    Raises:
        InvalidInput: No text, a character that is not printable, or too long.
    """
    if not isinstance(value, str):
        raise InvalidInput(f"The {what} must be text, not {show(value)}.")
    if len(value) > most:
        raise InvalidInput(
            f"The {what} has {len(value)} characters, more than {most}: {show(value)}."
        )
    bad = next((x for x in value if not x.isprintable()), None)
    if bad is not None:
        raise InvalidInput(
            f"The {what} has the character U+{ord(bad):04X}, which is not printable: "
            f"'{make_printable(value)}'."
        )
    return value


def side(value: str) -> Literal["left", "right"]:
    """Which value to take where there are two: "left" or "right".

    Raises:
        InvalidInput: Another word.
    """
    if value == "right":
        return "right"
    if value == "left":
        return "left"
    raise InvalidInput(f"side must be left or right, not {value!r}.")


def in_unit(unit: str) -> str:
    """`unit` as the end of a phrase, for messages."""
    return f" in {unit}" if unit else ""


def suffix(unit: str) -> str:
    """`unit` after a number, for messages."""
    return f" {unit}" if unit else ""
