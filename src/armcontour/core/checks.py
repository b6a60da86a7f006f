"""Checks of type, shape, finiteness and range; wrong values raise InvalidInput in one sentence."""

from __future__ import annotations

import copyreg
from collections.abc import Callable, Iterable, Mapping
from dataclasses import FrozenInstanceError, fields, is_dataclass
from functools import cache, wraps
from inspect import Parameter, signature
from os import PathLike
from pathlib import Path as FilePath
from types import MappingProxyType, UnionType
from typing import (
    Any,
    ClassVar,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
import numpy.typing as npt

from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.guesses import Explained, ExplainedABC, form_of, made_by, suggest
from armcontour.core.text import capitalise, make_printable, show

P = ParamSpec("P")
R = TypeVar("R")
C = TypeVar("C")
# Longest name [characters]; names appear in lines of robot programs, tables and terminals.
LONGEST_NAME = 80
# Fields are checked by these annotations. They name the class, because `npt.NDArray` is an alias
# that hides it in newer versions of NumPy.
FloatArray = np.ndarray[tuple[Any, ...], np.dtype[np.float64]]
IntArray = np.ndarray[tuple[Any, ...], np.dtype[np.intp]]
BoolArray = np.ndarray[tuple[Any, ...], np.dtype[np.bool_]]
ObjectArray = np.ndarray[tuple[Any, ...], np.dtype[np.object_]]
# Largest number in SI units, above any length, time, speed or torque of a robot. Its powers up to
# the twenty-fifth are finite, so products of squares and cubes do not overflow.
LARGEST_NUMBER = 1e12
# Smallest positive number, below any tolerance or time in any unit. Powers of its reciprocal up to
# the tenth are finite.
SMALLEST_NUMBER = 1e-30
# Largest number of joints, more than any arm has.
MAX_JOINTS = 1000
# Largest number of sampled values, such as set-points times joints. The arrays that are computed
# from so many values need some GB.
MAX_VALUES = 5e7
# Largest whole number, for values such as seeds that have no other upper bound.
MAX_WHOLE = 2**63 - 1
# Highest supported derivative of a curve.
HIGHEST_DERIVATIVE = 20

# Values outside a range by at most this fraction of its length are rounding errors.
RANGE_ROUNDING = 1e-12
# Length that counts for shorter ranges, in the unit of the range.
SHORTEST_RANGE = 1e-3
# Array kinds (`dtype.kind`) that can be numbers; in an object array, every object must be one.
NUMERIC = "iufO"
# Classes of values that messages repeat.
PLAIN = (bool, int, float, str, list, dict, type(None))
# Descriptions of other classes in annotations.
WORDS: dict[Any, str] = {
    bool: "True or False",
    str: "text",
    type(None): "None",
    Callable: "a function",
    Mapping: "a mapping",
    PathLike: "a path",
}


def frozen_mapping(mapping: Mapping[Any, Any]) -> MappingProxyType[Any, Any]:
    """Return a read-only copy of a mapping."""
    return MappingProxyType(dict(mapping))


# Pickle does not support read-only mappings, but some pickled dataclasses have such fields.
copyreg.pickle(MappingProxyType, lambda x: (frozen_mapping, (dict(x),)))


def frozen_array(values: npt.ArrayLike, name: str = "An array", unit: str = "") -> FloatArray:
    """Return `values` as a read-only float array; no copy if it is read-only already."""
    return freeze(floats(name, values, unit))


def kernel_array(values: npt.ArrayLike) -> FloatArray:
    """Return a C-ordered, writeable float array for kernels; no copy if possible."""
    # Checking the flags takes a tenth of the time that `np.require` takes.
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        flags = values.flags
        if flags.c_contiguous:
            return values if flags.writeable else values.copy()
    return np.require(values, np.float64, ["C", "W"])


def freeze(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a read-only copy of an array; no copy if it is read-only and owns its data."""
    if array.flags.owndata and not array.flags.writeable:
        return array
    copy = np.array(array)
    copy.setflags(write=False)
    return copy


@cache
def _field_names(kind: type) -> tuple[str, ...]:
    """Return the field names of a dataclass; none for other classes."""
    return tuple(x.name for x in fields(kind)) if is_dataclass(kind) else ()


def make_unchecked(kind: type[C], **values: Any) -> C:
    """Make a dataclass instance without checking its fields; its arrays become read-only."""
    # Use it only for values that are valid by construction: arrays that this package's compiled
    # functions return and that no other code uses, and fields of checked objects.
    made = object.__new__(kind)
    for name, value in values.items():
        if type(value) is np.ndarray:
            value.setflags(write=False)
        object.__setattr__(made, name, value)
    return made


def copy_unchecked(value: C, **changes: Any) -> C:
    """Copy a checked dataclass and change fields without checking them."""
    kind: Any = type(value)
    copied = make_unchecked(kind, **changes)
    for name in _field_names(kind):
        if name not in changes:
            object.__setattr__(copied, name, getattr(value, name))
    return cast(C, copied)


class Frozen(Explained):
    """Base of frozen dataclasses that only this package makes: arrays become read-only."""

    __slots__ = ()

    def __post_init__(self) -> None:
        kind: Any = type(self)
        for name in _field_names(kind):
            values = getattr(self, name, None)
            if type(values) is np.ndarray:
                object.__setattr__(self, name, freeze(values))
        self._check_together()

    def _check_together(self) -> None:
        """Check combinations of fields, or compute fields; called after arrays are read-only."""


class Immutable(Explained, metaclass=ExplainedABC):
    """Base of classes whose instances do not change after their constructor has called `_freeze`.

    `functools.cached_property` works. A subclass that is a dataclass needs `frozen=True`.
    """

    # Last sentence of the error message: how to get a changed instance.
    _instead: ClassVar[str] = "Create another instance"

    def _freeze(self) -> None:
        """Make all arrays read-only, and refuse other changes from now on."""
        arrays = {k: freeze(x) for k, x in vars(self).items() if isinstance(x, np.ndarray)}
        vars(self).update(arrays, _frozen=True)

    def __setattr__(self, name: str, value: Any) -> None:
        if "_frozen" in vars(self):
            raise FrozenInstanceError(
                f"The {name} of a {type(self).__name__} cannot be set after construction, because "
                f"plans may depend on it. {self._instead}."
            )
        super().__setattr__(name, value)


def check_numbers(name: str, values: npt.ArrayLike, unit: str = "") -> FloatArray:
    """Return `values` as a new float array, all finite and at most `LARGEST_NUMBER`."""
    array = np.array(floats(name, values, unit))
    # The sum of squares is a fast sufficient test. NaN fails the comparison.
    row = array.ravel("K")
    # Unlike `dot`, `vdot` never warns of overflow.
    if np.vdot(row, row) <= LARGEST_NUMBER**2:
        return array
    sound = np.abs(array) <= LARGEST_NUMBER
    if not sound.all():
        index = np.argwhere(~sound)[0]
        location = f" at index {', '.join(str(i) for i in index)}" if array.ndim else ""
        value = float(array[tuple(index)] if array.ndim else array)
        range_ = f"between -{LARGEST_NUMBER:g} and {LARGEST_NUMBER:g}{suffix(unit)}"
        needed = range_ if np.isfinite(value) else "finite"
        raise InvalidInput(
            f"{name} must be {needed}, but is {value:g}{location}.",
            index=int(index[0]) if array.ndim else None,
        )
    return array


def floats(name: str, values: npt.ArrayLike, unit: str = "") -> FloatArray:
    """Return `values` as a float array, finite or not; unchanged if it is a float array."""
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    needed = f"{name} must be numbers{in_unit(unit)}"
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise InvalidInput(f"{needed}, but some are masked. Remove the masked values.")
    try:
        array = np.asarray(values)
        if array.size and array.dtype.kind not in NUMERIC:
            raise InvalidInput(f"{needed}, not {show(values)}.")
        # numpy would convert these objects to numbers, None to NaN.
        for item in array.flat if array.dtype.kind == "O" else ():
            if item is None or isinstance(item, str | bytes | bool):
                raise InvalidInput(f"{needed}, but one of them is {show(item)}.")
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InvalidInput):
            raise
        # The first sentence of numpy's message is the reason.
        reason = str(error).split(". ")[0].rstrip(".")
        raise InvalidInput(f"{needed}: {reason}.") from None


def clip_within(
    name: str, values: npt.ArrayLike, low: float, high: float, unit: str, range_name: str
) -> FloatArray:
    """Clip values to a range; refuse values outside by more than rounding errors.

    - `name`, `unit`: name and unit of the values, for the message.
    - `range_name`: name of the range, for the message, such as "the path".
    """
    array = floats(name, values, unit)
    rounding = RANGE_ROUNDING * max(high - low, SHORTEST_RANGE)
    outside = ~((array >= low - rounding) & (array <= high + rounding))
    if outside.any():
        value = float(array[outside].flat[0])
        raise InvalidInput(
            f"{capitalise(name)} {value:g} {unit} lies outside {range_name}, which runs from "
            f"{low:g} to {high:.9g} {unit}.",
            t=value if unit == "s" else None,
            s=None if unit == "s" else value,
            allowed=high,
        )
    return np.asarray(np.clip(array, low, high))


def locate(breaks: FloatArray, values: npt.ArrayLike, side: str) -> IntArray:
    """Return the index of the interval between `breaks` that contains each arc length, (n,).

    - `breaks`: ends of the intervals [m], ascending.
    - `values`: arc lengths [m], (n,).
    - `side`: interval of an arc length that is a break: "right" for the one that begins there.
    """
    index = np.searchsorted(breaks, floats("arc lengths", values, "m"), side=check_side(side)) - 1
    return np.clip(index, 0, len(breaks) - 2)


def shaped(
    name: str, values: npt.ArrayLike, shape: tuple[int | None, ...], unit: str = ""
) -> FloatArray:
    """Return `values` as a float array of a shape; None in the shape allows any length."""
    array = floats(name, values, unit)
    if array.ndim != len(shape) or any(
        x not in (n, None) for n, x in zip(array.shape, shape, strict=True)
    ):
        required = ", ".join("any" if x is None else f"{x}" for x in shape)
        raise InvalidInput(f"{name} must have shape ({required}), not {array.shape}.")
    return array


def indices(name: str, values: npt.ArrayLike) -> IntArray:
    """Return `values` as an array of integers; unchanged if it is an array of integers."""
    if isinstance(values, np.ndarray) and values.dtype == np.intp:
        return values
    array = check_numbers(name, values)
    raise_if((array % 1).any(), f"{name} must be whole numbers.")
    return array.astype(np.intp)


def points(name: str, values: npt.ArrayLike) -> FloatArray:
    """Return `values` as a new (n, 2) or (n, 3) array of finite coordinates [m]."""
    array = check_numbers(name, values, "m")
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise InvalidInput(
            f"{name} must be rows of 2 or 3 coordinates in m, but have shape {array.shape}."
        )
    return array


def check_number(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a finite float.

    `name` and `unit` appear in messages, here and in the functions below.
    """
    # Fast path for most values. NaN fails the comparison.
    if type(value) in (float, int) and -LARGEST_NUMBER <= value <= LARGEST_NUMBER:
        return float(value)
    array = check_numbers(name, value, unit)
    if array.ndim:
        raise InvalidInput(
            f"{name} must be one number{in_unit(unit)}, not an array of {array.size}."
        )
    return float(array)


def check_count(work: str, values: float, fix: str) -> None:
    """Check that a task has at most MAX_VALUES values, before the values are computed.

    - `work`: what would have these values, for the message.
    - `values`: number of values.
    - `fix`: what the user can do, as a sentence without a period.
    """
    if not values <= MAX_VALUES:
        raise InvalidInput(
            f"{work} would have {values:.3g} values, but at most {MAX_VALUES:.3g} are allowed. "
            f"{fix}.",
            limit="values",
            needed=values,
            allowed=MAX_VALUES,
        )


def positive(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a finite float above zero, at least `SMALLEST_NUMBER`."""
    return check_range(name, value, SMALLEST_NUMBER, LARGEST_NUMBER, unit)


def not_negative(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a finite float that is zero or above."""
    return check_range(name, value, 0.0, LARGEST_NUMBER, unit)


def check_range(name: str, value: Any, low: float, high: float, unit: str = "") -> float:
    """Return `value` as a float from `low` to `high`."""
    checked = check_number(name, value, unit)
    if low <= checked <= high:
        return checked
    needed = f"be from {low:g} to {high:g}{suffix(unit)}"
    if checked <= 0 < low:
        needed = "be above zero"
    elif checked < 0 == low:
        needed = "not be negative"
    raise InvalidInput(f"{name} must {needed}, but is {checked:g}{suffix(unit)}.")


def check_int(name: str, value: Any, low: int | None = None, high: int | None = None) -> int:
    """Return `value` as an int from `low` to `high`; None means unbounded."""
    minimum = -LARGEST_NUMBER if low is None else low
    maximum = MAX_WHOLE if high is None else high
    if type(value) is int and minimum <= value <= maximum:
        return value
    checked = check_number(name, value)
    if checked != int(checked) or not minimum <= checked <= maximum:
        range_ = "" if low is None else f" of at least {low}"
        range_ = range_ if high is None else f" from {low} to {high}"
        raise InvalidInput(f"{name} must be a whole number{range_}, but is {checked:g}.")
    return int(checked)


def per_vertex(
    name: str, values: npt.ArrayLike | None, vertices: int, unit: str = ""
) -> FloatArray:
    """Return a nonnegative number per vertex between segments, (vertices,); infinity if None."""
    if values is None:
        return np.full(vertices, np.inf)
    array = check_numbers(name, values, unit)
    if array.ndim and array.shape != (vertices,):
        raise InvalidInput(
            f"{name} has {array.size} values, but the path has {vertices} vertices between "
            f"segments. Specify one value for all vertices or {vertices} values."
        )
    if array.size and (array < 0).any():
        raise InvalidInput(f"{name} must not be negative, but is {array.min():g} {unit}.")
    return np.full(vertices, array)


def per_joint(name: str, values: npt.ArrayLike, dof: int, unit: str = "") -> FloatArray:
    """Return one number for all joints, or one number per joint, as a new (dof,) array."""
    array = check_numbers(name, values, unit)
    if array.ndim == 0:
        return np.full(dof, float(array))
    if array.shape != (dof,):
        raise ArmMismatch(
            f"{name} has {array.size} values, but the arm has {dof} joints. "
            f"Specify one value for all joints or {dof} values."
        )
    return array


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> str:
    """Return `value` if it is one of the `choices` texts."""
    # The type is checked first, because the comparison of an array would return an array.
    if not isinstance(value, str) or value not in choices:
        raise InvalidInput(f"{name} must be one of {', '.join(choices)}, not {show(value)}.")
    return value


def derivative(order: Any, highest: int = HIGHEST_DERIVATIVE) -> int:
    """Check and return the order of a derivative, 0 for the value itself."""
    return check_int("order of a derivative", order, 0, highest)


def check_name(name: str, value: Any, *, longest: int = LONGEST_NAME, needed: bool = False) -> str:
    """Return `value` if it is a name: printable text of limited length, possibly empty."""
    if not isinstance(value, str):
        raise InvalidInput(f"{name} must be text, not {show(value)}.")
    if needed and not value.strip():
        raise InvalidInput(f"{name} must not be empty.")
    if len(value) > longest:
        raise InvalidInput(
            f"{name} has {len(value)} characters, more than {longest}, the maximum: {show(value)}."
        )
    if not value.isprintable():
        bad = next(x for x in value if not x.isprintable())
        raise InvalidInput(
            f"{name} has the character U+{ord(bad):04X}, which is not printable: "
            f"'{make_printable(value)}'."
        )
    return value


def raise_if(wrong: bool | np.bool_, message: str) -> None:
    """Raise InvalidInput if a condition is true; the message is formatted in either case."""
    if wrong:
        raise InvalidInput(message)


def check_type(name: str, value: Any, *kinds: type) -> Any:
    """Return `value` if it belongs to one of the classes; else raise InvalidInput."""
    if isinstance(value, kinds):
        return value
    words = [_words_for(x) for x in kinds if x is not np.bool_]
    shown = show(value) if isinstance(value, PLAIN) else type(value).__name__
    such = made_by(x for x in kinds if isinstance(x, type))
    raise InvalidInput(f"{name} must be {' or '.join(words)}{such or ','} not {shown}.")


def _words_for(kind: type) -> str:
    """Describe an instance of a class, such as "a number" or "an Arm"."""
    if kind in WORDS:
        return WORDS[kind]
    article = "an" if kind.__name__[0] in "AEIO" else "a"
    return f"{article} {kind.__name__}"


def explained(function: Callable[P, R]) -> Callable[P, R]:
    """Wrap a function so that calls with wrong arguments raise InvalidInput."""

    @wraps(function)
    def call(*args: P.args, **keywords: P.kwargs) -> R:
        """Call the function; for wrong arguments raise InvalidInput instead of TypeError."""
        try:
            return function(*args, **keywords)
        except TypeError:
            raise_call_error(function, args, keywords)
            raise

    return call


def raise_call_error(
    function: Callable[..., Any], args: tuple[Any, ...], keywords: Mapping[str, Any]
) -> None:
    """Raise InvalidInput if arguments of a call are unknown, repeated or missing."""
    called = signature(function)
    try:
        called.bind(*args, **keywords)
    except TypeError as error:
        slots = {k: x for k, x in called.parameters.items() if k not in ("self", "cls")}
        user = function.__qualname__.removesuffix(".__init__")
        takes = f"it takes {', '.join(slots)}"
        needed = ", ".join(f"{k}=..." for k, x in slots.items() if x.default is x.empty)
        reason = str(error)
        hint = f"write {user}({needed}); {takes}"
        for name in (x for x in keywords if x not in slots):
            reason = f"there is no argument {show(name)}"
            given = {*[*called.parameters][: len(args)], *keywords}
            left = {k: x for k, x in slots.items() if k not in given}
            hint = (
                form_of((user,), name)
                or _form_of_value(function, left, name)
                or suggest(name, slots, takes)
            )
        raise InvalidInput(f"{user}: {reason} ({hint}).") from None


def _form_of_value(function: Callable[..., Any], slots: Mapping[str, Parameter], name: str) -> str:
    """Write the argument that takes options with this field name; empty if there is none."""
    hints = {} if function.__name__ == "__init__" else get_type_hints(function)
    for argument, slot in slots.items():
        kinds: Any = [type(slot.default), hints.get(argument), *get_args(hints.get(argument))]
        for kind in kinds:
            if not is_dataclass(kind) or not isinstance(kind, type):
                continue
            if name in _field_names(kind):
                return f"write {argument}={kind.__name__}({name}=...)"
            if name == "method" and hasattr(kind, name):
                return f"write {argument}={kind.__name__}()"
    return ""


def kinds_of(annotation: Any) -> tuple[type, ...]:
    """Return the classes that an annotation allows; none if it allows numbers, arrays or lists."""
    kind = get_origin(annotation) or annotation
    if kind in (Union, UnionType):
        parts = [kinds_of(x) for x in get_args(annotation)]
        return sum(parts, ()) if all(parts) else ()
    if kind in (bool, FilePath):
        return (bool, np.bool_) if kind is bool else (PathLike,)
    if kind in WORDS:
        return (kind,)
    is_library_class = isinstance(kind, type) and kind.__module__.startswith(
        ("armcontour.", "concurrent.")
    )
    is_protocol = getattr(kind, "_is_protocol", False)
    return (kind,) if is_library_class and not is_protocol else ()


def check_sequence(
    name: str, values: Any, kind: Any, noun: str, count: int | None = None
) -> tuple[Any, ...]:
    """Check the values of a list, and return them as a tuple.

    - `kind`: class of the values, or a tuple of classes.
    - `noun`: what the values are, for the message, such as "names".
    - `count`: required number of values; None for any number.
    """
    if isinstance(values, np.ndarray):
        values = np.atleast_1d(values)
    # Fast path for tuples.
    no_list = (str, bytes, Mapping)
    if type(values) is tuple or (isinstance(values, Iterable) and not isinstance(values, no_list)):
        items = tuple(values)
        if count in (None, len(items)) and (not items or all(isinstance(x, kind) for x in items)):
            return items
    kinds = kind if isinstance(kind, tuple) else (kind,)
    such = made_by(x for x in kinds if isinstance(x, type))
    raise InvalidInput(f"{name} must be a list of {noun}{such or ','} not {show(values)}.")


def check_names(name: str, values: Any) -> tuple[str, ...]:
    """Check the names of a list, and return them as a tuple."""
    names = check_sequence(name, values, str, "names")
    return tuple(check_name(f"name in {name}", x) for x in names)


def check_side(value: str) -> Literal["left", "right"]:
    """Return "left" or "right", the side from which a function with a jump is evaluated."""
    return cast(Literal["left", "right"], check_choice("side", value, ("left", "right")))


def in_unit(unit: str) -> str:
    """Return the words " in <unit>" for messages; empty without a unit."""
    return f" in {unit}" if unit else ""


def suffix(unit: str) -> str:
    """Return the unit as it follows a number in messages, with a leading space; may be empty."""
    return f" {unit}" if unit else ""


def comparable(value: Any) -> Any:
    """Convert a value with arrays or mappings in its fields to a form that `==` can compare."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if is_dataclass(value):
        parts = [comparable(getattr(value, x.name)) for x in fields(value)]
        return type(value), parts
    if isinstance(value, Mapping):
        return {name: comparable(x) for name, x in value.items()}
    if isinstance(value, tuple):
        return [comparable(x) for x in value]
    return value
