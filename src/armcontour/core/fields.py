"""Checks of the fields of dataclasses: type, finiteness, sign, shape and choices by annotations.

An annotation such as `speed: Speed | None` is the only declaration: `check` reads it here, and
`io/keys.py` makes keys of files, their JSON schema and their tables from it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, Value
from armcontour._quantities import AtLeast, Axes, Choice, Named, Quantity
from armcontour._text import capitalise, shorten, show
from armcontour.errors import InvalidInput

# Reads a value: the checked one, or the value itself if nothing had to be converted.
Reader = Callable[[Any], Any]
# Axes of arrays with one value for all joints or one per joint; and with a pair of bounds for each.
PER_JOINT: tuple[tuple[str | int, ...], ...] = ((), ("joints",))
BOUNDS = ("joints", 2)


class Checked(Value):
    """Base of dataclasses whose fields are checked, converted and locked by their annotations."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check(self)
        self._check_together()

    def _check_together(self) -> None:
        """Refuse fields that do not fit together, or compute others; each one is checked before."""


def check(value: Any) -> None:
    """Check the fields of a dataclass by their annotations; convert numbers and lock arrays.

    Raises:
        InvalidInput: A field does not fit its annotation.
    """
    kind: Any = type(value)
    readers, shapes = _readers(kind)
    try:
        for name, read, optional in readers:
            given = getattr(value, name)
            if given is None and optional:
                continue
            checked = read(given)
            if checked is not given:
                object.__setattr__(value, name, checked)
        if shapes:
            _refuse_misfits(value, shapes)
    except InvalidInput as error:
        where = getattr(value, "source", getattr(value, "name", None))
        if not isinstance(where, str) or not where or name in ("source", "name"):
            raise
        raise error.at(shorten(where, _checks.LONGEST_NAME)) from None


@dataclass(frozen=True, slots=True)
class _Field:
    """A field of a class, for messages.

    Args:
        user: Name of the class, such as "A payload".
        role: Name of the field.
        who: Both, such as "mass of a payload".
    """

    user: str
    role: str
    who: str


@cache
def _readers(
    kind: Any,
) -> tuple[tuple[tuple[str, Reader, bool], ...], tuple[tuple[str, Axes], ...]]:
    """Readers of the fields of a dataclass, and those with axes that other fields have, too."""
    hints = get_type_hints(kind, include_extras=True)
    found, shapes = [], []
    for x in fields(kind):
        if not x.init:
            continue
        hint, optional = _without_none(hints[x.name])
        user = _noun(kind)
        field = _Field(capitalise(user), x.name, f"{x.name} of {user}")
        # None is named by a message on a wrong class, as other classes are.
        simple = _checks.kinds_of(hint) and get_origin(hint) is not Mapping
        read = _reader(hints[x.name] if simple else hint, field)
        if read is not None:
            found.append((x.name, read, optional))
        shape = next((y for y in getattr(hint, "__metadata__", ()) if isinstance(y, Axes)), None)
        if shape is not None and any(isinstance(y, str) for y in shape.axes):
            shapes.append((x.name, shape))
    return tuple(found), tuple(shapes)


def _noun(kind: type) -> str:
    """The name of a class in words, such as "a joint path"; several things have no article."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind.__name__).lower()
    several = words.endswith(("s", "data")) and not words.endswith("ss")
    return words if several else f"{'an' if words[0] in 'aeio' else 'a'} {words}"


def _without_none(hint: Any) -> tuple[Any, bool]:
    """An annotation without None, and whether it has None."""
    parts = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    others = tuple(x for x in parts if x is not type(None))
    return (Union[others] if others else hint), len(others) < len(parts)  # noqa: UP007


def _reader(hint: Any, field: _Field) -> Reader | None:
    """The reader of values with an annotation; None if all values fit."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _read_annotated(parts[0], parts[1:], field)
    if origin in (Union, UnionType):
        return _read_union(parts, field)
    if origin is Literal:
        return lambda value: _checks.choice(field.who, value, parts)
    if origin is np.ndarray:
        return _read_array(get_args(parts[1])[0], field)
    if origin is tuple:
        return _read_tuple(parts, field)
    if origin is Sequence:
        return _read_tuple((*parts, ...), field)
    if origin in (dict, Mapping):
        return _read_mapping(parts[1], field)
    if hint is float:
        return _read_float(field)
    if hint is int:
        return _read_whole(field.who)
    kinds = _checks.kinds_of(hint)
    return _read_kinds(kinds, field) if kinds else None


def _read_annotated(of: Any, marks: tuple[Any, ...], field: _Field) -> Reader | None:
    """The reader of values with metadata."""
    who = field.who
    quantity = next((x for x in marks if isinstance(x, Quantity)), None)
    shape = next((x for x in marks if isinstance(x, Axes)), None)
    if quantity is not None:
        return _read_number(quantity, who) if of is float else _read_numbers(quantity, shape, who)
    if shape is not None:
        return _read_shaped(_reader(of, field), shape, who)
    for mark in marks:
        if isinstance(mark, Choice) and of is str:
            return lambda value: _checks.choice(who, value, mark.known)
        if isinstance(mark, AtLeast):
            return _read_whole(who, mark.least, mark.most)
        if isinstance(mark, Named):
            return lambda value: _read_name(value, mark, who)
    return _reader(of, field)


def _read_name(value: Any, mark: Named, who: str) -> str:
    """A printable text of a limited length."""
    name = _checks.check_name(who, value, most=mark.most)
    _checks.refuse_if(mark.needed and not name.strip(), f"The {who} must not be empty.")
    return name


def _read_union(parts: tuple[Any, ...], field: _Field) -> Reader | None:
    """The reader of one of several kinds: of classes, or of a text or another kind."""
    kinds = [_checks.kinds_of(x) for x in parts]
    if all(kinds):
        return _read_kinds(sum(kinds, ()), field)
    texts = [x for x in parts if x is str or _is_text(x)]
    others = [x for x in parts if x not in (*texts, bool)]
    if not texts or len(others) != 1:
        return None
    text, other = _reader(texts[0], field), _reader(others[0], field)
    assert text is not None

    def read(value: Any) -> Any:
        if isinstance(value, str):
            return text(value)
        if other is None or (bool in parts and isinstance(value, bool | np.bool_)):
            return value
        return other(value)

    return read


def _is_text(hint: Any) -> bool:
    """Whether an annotation allows texts only."""
    parts = get_args(hint)
    return (get_origin(hint) is Annotated and parts[0] is str) or (
        get_origin(hint) is Literal and all(isinstance(x, str) for x in parts)
    )


def _read_kinds(kinds: tuple[type, ...], field: _Field) -> Reader:
    """The reader of objects of some classes."""

    def read(value: Any) -> Any:
        if not isinstance(value, kinds):
            _checks.refuse_other(field.user, value, *kinds, role=field.role)
        return value

    return read


def _read_array(kind: Any, field: _Field) -> Reader:
    """The reader of an array of any shape, finite or not, which is locked."""
    if kind is np.float64:
        return lambda value: _checks.lock_floats(value, field.who)
    whole = kind is np.intp

    def read(value: Any) -> Any:
        array = _checks.indices(field.who, value) if whole else np.asarray(value, kind)
        flags = array.flags
        return array if flags.owndata and not flags.writeable else _checks.lock_copy(array)

    return read


def _read_tuple(parts: tuple[Any, ...], field: _Field) -> Reader:
    """The reader of a list as a tuple."""
    many = parts[1:] == (...,)
    each = [_reader(x, field) for x in (parts[:1] if many else parts)]
    kinds = _checks.kinds_of(parts[0]) if many else ()
    count = None if many else len(parts)
    names = [f"{x.__name__}s" for x in kinds if x is not str]
    plain = "texts" if kinds else "names" if _is_text(parts[0]) else "values"
    what = f"{f'{count} ' if count else ''}{' or '.join(names) or plain}"

    def read(value: Any) -> Any:
        values = _checks.listed(field.who, value, kinds or object, what, count)
        if kinds:
            return values
        every = each * len(values) if many else each
        return tuple(x if item is None else item(x) for item, x in zip(every, values, strict=True))

    return read


def _read_mapping(of: Any, field: _Field) -> Reader:
    """The reader of a mapping, whose values are of one kind."""
    each = _reader(of, field)

    def read(value: Any) -> Any:
        if not isinstance(value, Mapping):
            _checks.refuse_other(field.user, value, Mapping, role=field.role)
        if each is not None:
            for key, x in value.items():
                try:
                    each(x)
                except InvalidInput as error:
                    raise error.at(show(key)) from None
        return value

    return read


def _read_whole(who: str, low: int | None = None, high: int | None = None) -> Reader:
    """The reader of a whole number."""
    most = _checks.MOST_WHOLE if high is None else high

    def read(value: Any) -> int:
        if type(value) is int and (low is None or low <= value) and value <= most:
            return value
        return _checks.whole(who, value, low, high)

    return read


def _read_float(field: _Field) -> Reader:
    """The reader of one number, finite or not."""

    def read(value: Any) -> Any:
        if type(value) is float:
            return value
        array = _checks.floats(field.who, value)
        if array.ndim:
            raise InvalidInput(f"{field.who} must be one number, not an array of {array.size}.")
        return float(array)

    return read


def _read_number(quantity: Quantity, who: str) -> Reader:
    """The reader of one number within the range of its quantity."""
    low, high = quantity.range

    def read(value: Any) -> float:
        # NaN fails the comparison.
        if type(value) is float and low <= value <= high:
            return value
        array = np.asarray(_checks.floats(who, value, quantity.words))
        if array.ndim:
            raise InvalidInput(
                f"{who} must be one number{_checks.in_unit(quantity.words)}, not an array of "
                f"{array.size}."
            )
        _refuse_outside(array, quantity, who)
        return float(array)

    return read


def _read_numbers(quantity: Quantity, shape: Axes | None, who: str) -> Reader:
    """The reader of an array within the range of its quantity, which is locked."""
    unit, axes = quantity.words, PER_JOINT
    if shape is not None:
        axes = (shape.axes,)
    elif quantity.bounds:
        axes = (*PER_JOINT, BOUNDS)

    def read(value: Any) -> FloatArray:
        array = _checks.lock_floats(value, who, unit)
        if not any(_fits(array, x) for x in axes) or (shape is None and not array.size):
            _refuse_shape(array, shape, unit, who)
        _refuse_outside(array, quantity, who)
        return array

    return read


def _read_shaped(read: Reader | None, shape: Axes, who: str) -> Reader:
    """The reader of an array of a shape, with any numbers."""
    assert read is not None

    def read_shaped(value: Any) -> Any:
        array = read(value)
        if not _fits(array, shape.axes):
            _refuse_shape(array, shape, "", who)
        return array

    return read_shaped


def _fits(array: FloatArray, axes: tuple[str | int, ...]) -> bool:
    """Whether the shape of an array is that of some axes; an axis with a name has any length."""
    return array.ndim == len(axes) and all(
        isinstance(x, str) or x == n for x, n in zip(axes, array.shape, strict=True)
    )


def _refuse_shape(array: FloatArray, shape: Axes | None, unit: str, who: str) -> None:
    """Refuse an array of another shape.

    Raises:
        InvalidInput: Always.
    """
    needed = f"of shape {shape}" if shape else "one number for all joints or one per joint"
    raise InvalidInput(f"{who} must be {needed}{_checks.in_unit(unit)}, not of {array.shape}.")


def _refuse_outside(array: FloatArray, quantity: Quantity, who: str) -> None:
    """Refuse numbers outside the range of their quantity.

    Raises:
        InvalidInput: A number is outside; the message names the first one.
    """
    low, high = quantity.range
    if low <= array.min(initial=low) and array.max(initial=high) <= high:
        return
    sound = (array >= low) & (array <= high)
    if quantity.endless:
        sound |= np.isposinf(array) | (np.isneginf(array) & (low < 0))
    if sound.all():
        return
    where = tuple(int(x) for x in np.argwhere(~sound)[0])
    value, more = float(array[where]), _checks.suffix(quantity.words)
    place = f" at index {', '.join(str(x) for x in where)}" if where else ""
    needed = quantity.needed(value) if np.isfinite(value) else "be finite"
    raise InvalidInput(
        f"{who} must {needed}, but is {value:g}{more}{place}.", index=where[0] if where else None
    )


def _refuse_misfits(value: Any, shapes: tuple[tuple[str, Axes], ...]) -> None:
    """Refuse arrays whose axes have the same name, but another length.

    Raises:
        InvalidInput: An axis has two lengths.
    """
    lengths: dict[str, tuple[int, str]] = {}
    for name, shape in shapes:
        array = getattr(value, name)
        if array is None:
            continue
        for axis, n in zip(shape.axes, array.shape, strict=True):
            if isinstance(axis, int):
                continue
            known, first = lengths.setdefault(axis, (n, name))
            if n != known:
                raise InvalidInput(
                    f"{name} of {_noun(type(value))} has shape {array.shape}, but must have "
                    f"shape {shape} with {axis} = {known}, as {first} has."
                )
