"""Checks of fields and arguments by their annotations: type, finiteness, sign, shape and choices.

An annotation such as `speed: Speed | None` is the only declaration: `check` and `checked` use it
here, and `files/file_keys.py` reads keys of files by it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cache, wraps
from os import PathLike
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import Frozen
from armcontour.core.errors import InvalidInput
from armcontour.core.lazy import load_method
from armcontour.core.quantities import AtLeast, Axes, Choice, Named, Quantity, read_quantity
from armcontour.core.text import shorten, show

P = ParamSpec("P")
R = TypeVar("R")
C = TypeVar("C")
# Takes a value and the words for it in messages, such as "speed of limits". Returns the converted
# value, or the value itself if no conversion was needed.
Reader = Callable[[Any, str], Any]
UNIONS = (Union, UnionType)
# Shape of one number.
SINGLE = (Axes(),)
# Shapes of one number for all joints, or one per joint.
PER_JOINT = (Axes(), Axes("joints"))
# Shapes in PER_JOINT, and the shape of two bounds per joint.
BOUNDED = (*PER_JOINT, Axes("joints", 2))
# Shape of any array.
ANY_SHAPE = (Axes(...),)
# Largest number of values that Python compares faster than NumPy.
FASTER_IN_PYTHON = 16


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
def declared(**options: Any) -> Callable[[type[C]], type[C]]:
    """Decorate a class that users construct: a frozen dataclass with slots and keyword-only fields.

    Wrong arguments of its constructor raise InvalidInput.
    """

    def make(cls: type[C]) -> type[C]:
        """Make the dataclass, and explain errors of its constructor and its class methods."""
        made: Any = dataclass(**{"frozen": True, "slots": True, "kw_only": True, **options})(cls)
        made.__init__ = checks.explained(made.__init__)
        for name, member in list(vars(made).items()):
            if isinstance(member, classmethod) and not name.startswith("_"):
                setattr(made, name, classmethod(checks.explained(member.__func__)))
        return cast(type[C], made)

    return make


class Checked(Frozen):
    """Base of dataclasses whose fields are checked, converted and made read-only by annotation."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check(self)
        self._check_together()


class Options(Checked):
    """Base of dataclasses with a method's options; equal if all their values are equal."""

    __slots__ = ()
    method: ClassVar[str]

    def __post_init__(self) -> None:
        if not hasattr(self, "method"):
            raise InvalidInput(
                f"{type(self).__name__} have no method. Use the options of one of the methods."
            )
        Checked.__post_init__(self)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and all(
            np.array_equal(getattr(self, x.name), getattr(other, x.name))
            for x in fields(cast(Any, self))
        )

    def __hash__(self) -> int:
        return hash(self.method)


def check(value: Any) -> None:
    """Check the fields of a dataclass by their annotations; convert numbers, freeze arrays."""
    kind: Any = type(value)
    readers, shapes = _readers(kind)
    name = ""
    try:
        for name, who, read, default in readers:
            original = getattr(value, name)
            if original is default:
                continue
            try:
                read_value = read(original, who)
            except InvalidInput as error:
                _add_name(error, name, original)
                raise
            if read_value is not original:
                object.__setattr__(value, name, read_value)
        if shapes:
            _refuse_misfits(value, shapes)
    except InvalidInput as error:
        quantity = quantities(kind).get(name)
        if quantity is not None and quantity.endless:
            error.limit = name
        # Only fields are used, because properties `name` and `source` may depend on the invalid
        # field.
        named = {x.name for x in fields(kind)} & {"source", "name"} - {name}
        location = getattr(value, max(named)) if named else None
        if not isinstance(location, str) or not location:
            raise
        raise error.with_location(shorten(location, checks.LONGEST_NAME)) from None


def _read_named(name: str, read: Reader, value: Any, who: str) -> Any:
    """Check a field or an argument; add its name to the key of an error."""
    try:
        return read(value, who)
    except InvalidInput as error:
        _add_name(error, name, value)
        raise


def _add_name(error: InvalidInput, name: str, value: Any) -> None:
    """Add the name of a field or an argument to the key of an error, with the refused value."""
    error.key = (name, *error.key)
    error.value = value if isinstance(value, bool | int | float | str) else None


@cache
def quantities(kind: type) -> dict[str, Quantity]:
    """Map the fields of a dataclass to their quantities."""
    hints = get_type_hints(kind, include_extras=True).items()
    pairs = ((name, _find(Quantity, tuple(parts_of(hint)))) for name, hint in hints)
    return {name: x for name, x in pairs if x is not None}


def parts_of(hint: Any) -> Iterator[Any]:
    """Yield an annotation and its parts, recursively: classes and metadata."""
    yield get_origin(hint) or hint
    for part in get_args(hint):
        yield from parts_of(part)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a public function so that its arguments are checked by their annotations."""
    code = function.__code__
    names = code.co_varnames[: code.co_argcount]

    # The annotations are read at the first call, because they may name classes defined later.
    @cache
    def readers_by_place() -> list[tuple[int, str, Reader]]:
        readers = _readers_of_arguments(function)
        return [(i, k, readers[k]) for i, k in enumerate(names) if k in readers]

    @wraps(function)
    def call(*args: Any, **keywords: Any) -> R:
        """Check and convert the arguments, then call the function."""
        positional = list(args)
        for i, k, read in readers_by_place():
            if i < len(args):
                positional[i] = _read_named(k, read, args[i], k)
        named = keywords
        if keywords:
            readers = _readers_of_arguments(function)
            named = {
                k: _read_named(k, readers[k], x, k) if k in readers else x
                for k, x in keywords.items()
            }
        # `explained` is repeated here, because a second wrapper would change the stack level of
        # warnings.
        try:
            return function(*positional, **named)
        except TypeError:
            checks.raise_call_error(function, args, keywords)
            raise

    return call


@cache
def _readers(kind: Any) -> tuple[list[tuple[str, str, Reader, Any]], list[tuple[str, Axes]]]:
    """Read how to check a dataclass: (field, words, reader, default) and axes shared by arrays."""
    hints = get_type_hints(kind, include_extras=True)
    readers = []
    shapes = []
    for name, default in ((x.name, x.default) for x in fields(kind) if x.init):
        if (read := reader_of(hints[name])) is not None:
            known = default if _fits(default, read) else MISSING
            readers.append((name, f"{name} of {_noun(kind)}", read, known))
        for hint in (hints[name], *get_args(hints[name])):
            axes = _find(Axes, getattr(hint, "__metadata__", ()))
            if axes is not None:
                shapes.append((name, axes))
    # Only shapes that share an axis with another field are needed.
    names: Counter[Any] = Counter()
    for _, shape in shapes:
        names.update(x for x in shape.axes if isinstance(x, str))
    return readers, [(x, shape) for x, shape in shapes if any(names[n] > 1 for n in shape.axes)]


def _fits(default: Any, read: Reader) -> bool:
    """Return whether a default is valid without conversion; invalid defaults are replaced later."""
    try:
        return default is not MISSING and read(default, "") is default
    except InvalidInput:
        return False


@cache
def _readers_of_arguments(function: Callable[..., Any]) -> dict[str, Reader]:
    """Map arguments to readers; arrays are left out, because the function checks them."""
    hints = get_type_hints(function, include_extras=True)
    readers = {}
    for name, hint in hints.items():
        if name == "return" or _allows_array(hint):
            continue
        read = reader_of(hint)
        if read is not None:
            readers[name] = read
    return readers


def _allows_array(hint: Any) -> bool:
    """Return whether an annotation is an array or a union with an array."""
    return np.ndarray in [get_origin(x) for x in (hint, *get_args(hint))]


def _noun(kind: type) -> str:
    """Write the name of a class in words, such as "a joint path"; a plural has no article."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind.__name__).lower()
    is_plural = words.endswith(("s", "data")) and not words.endswith("ss")
    if is_plural:
        return words
    article = "an" if words[0] in "aeio" else "a"
    return f"{article} {words}"


def _find(kind: type[R], marks: tuple[Any, ...]) -> R | None:
    """Find the first object of a class in an annotation's metadata; None if there is none."""
    return next((x for x in marks if isinstance(x, kind)), None)


@cache
def reader_of(hint: Any) -> Reader | None:
    """Make the reader of values with this annotation; None if every value is valid."""
    origin = get_origin(hint)
    parts = get_args(hint)
    # Type aliases, such as `npt.NDArray` in newer versions of NumPy, hide the class.
    assert not hasattr(origin, "__value__"), f"{hint} is an alias"
    if origin is Annotated:
        return _read_annotated(parts[0], parts[1:])
    if origin in UNIONS:
        return _read_union(parts)
    if origin is Literal:
        return lambda value, who: checks.check_choice(who, value, parts)
    if origin in (dict, Mapping):
        return _read_mapping(reader_of(parts[1]))
    if origin is np.ndarray:
        return _read_numbers(hint, None, ANY_SHAPE)
    if origin in (tuple, list, Sequence):
        return _read_list(parts)
    if hint is float:
        return _read_numbers(hint, None, SINGLE)
    if hint is int:
        return _read_whole(AtLeast(None))
    kinds = checks.kinds_of(hint)
    return _read_kinds(kinds) if kinds else None


def _read_kinds(kinds: tuple[type, ...]) -> Reader:
    """Make the reader of instances of some classes, one of which may be loaded by a name."""
    loaders = [x.loaded_by for x in kinds if hasattr(x, "loaded_by")]

    def read(value: Any, who: str) -> Any:
        """Check the class of a value; load the object if a name or file is given."""
        if loaders and isinstance(value, str | PathLike):
            value = load_method(loaders[0])(value)
        return checks.check_type(who, value, *kinds)

    return read


def _read_annotated(base: Any, marks: tuple[Any, ...]) -> Reader | None:
    """Make the reader for an annotation with metadata."""
    quantity = _find(Quantity, marks)
    axes = _find(Axes, marks)
    if quantity is not None or (axes is not None and get_origin(base) is np.ndarray):
        shapes: tuple[Axes, ...] = PER_JOINT
        if base is float:
            shapes = SINGLE
        elif axes is not None:
            shapes = (axes,)
        elif quantity is not None and quantity.bounds:
            shapes = BOUNDED
        return _read_numbers(base, quantity, shapes)
    for mark in marks:
        if isinstance(mark, Choice):
            return _read_choice(mark.known, base is str)
        if isinstance(mark, AtLeast):
            return _read_whole(mark)
        if isinstance(mark, Named):
            return lambda value, who: checks.check_name(
                who, value, longest=mark.most, needed=mark.needed
            )
    return reader_of(base)


def _read_choice(choices: tuple[str, ...], single: bool) -> Reader:
    """Make the reader of one choice; unless `single`, it also reads a sequence of choices."""

    def read(value: Any, who: str) -> Any:
        """Check a choice, or convert a sequence of choices to a tuple."""
        if single or isinstance(value, str):
            return checks.check_choice(who, value, choices)
        values = checks.check_sequence(who, value, str, "texts")
        checks.raise_if(not values, f"{who} must not be empty.")
        return tuple(checks.check_choice(who, x, choices) for x in values)

    return read


def _read_whole(mark: AtLeast) -> Reader:
    return lambda value, who: checks.check_int(who, value, mark.least, mark.most)


def _read_union(parts: tuple[Any, ...]) -> Reader | None:
    """Make the reader of a union; None if its classes cannot be told apart."""
    texts = [x for x in parts if x is str or _is_text(x)]
    others = [x for x in parts if x not in (*texts, bool, NoneType)]
    if len(texts) > 1 or len(others) > 1:
        kinds = [checks.kinds_of(x) for x in parts]
        return _read_kinds(sum(kinds, ())) if all(kinds) else None
    passing: tuple[type, ...] = (NoneType,) if NoneType in parts else ()
    passing += (bool, np.bool_) if bool in parts else ()
    text = reader_of(texts[0]) if texts else None
    other = reader_of(others[0]) if others else None

    def read(value: Any, who: str) -> Any:
        """Check a value by the part of the union to which its class belongs."""
        if isinstance(value, passing):
            return value
        use = text if not others or (texts and isinstance(value, str)) else other
        return value if use is None else use(value, who)

    return read


def _is_text(hint: Any) -> bool:
    """Return whether an annotation allows texts only."""
    return get_origin(hint) is Literal or (
        get_origin(hint) is Annotated and get_args(hint)[0] is str
    )


def _read_list(parts: tuple[Any, ...]) -> Reader:
    """Make the reader that converts a list to a tuple."""
    count = None if parts[1:] in ((), (...,)) else len(parts)
    each = [reader_of(x) for x in (parts if count else parts[:1])]
    item = parts[0]
    kinds = () if count else checks.kinds_of(parts[0])
    names = [
        f"{x.__name__}{'es' if x.__name__.endswith('ch') else 's'}" for x in kinds if x is not str
    ]
    if kinds:
        plain = "texts"
    elif _is_text(item):
        plain = "names"
    else:
        plain = "values"
    noun = " or ".join(names) or plain
    if count:
        noun = f"{count} {noun}"

    def read(value: Any, who: str) -> Any:
        """Check the items of a list, and convert it to a tuple."""
        values = checks.check_sequence(who, value, kinds or object, noun, count)
        if kinds or each == [None]:
            return values
        every = zip(each if count else each * len(values), values, strict=True)
        return tuple(x if read_item is None else read_item(x, who) for read_item, x in every)

    return read


def _read_mapping(each: Reader | None) -> Reader:
    """Make the reader of a mapping whose values are of one kind."""

    def read(value: Any, who: str) -> Any:
        """Check the values of a mapping."""
        checks.check_type(who, value, Mapping)
        for key, item in value.items() if each is not None else ():
            try:
                each(item, who)  # type: ignore[misc]
            except InvalidInput as error:
                raise error.with_location(show(key)) from None
        return value

    return read


def _fixed_lengths(shape: Axes) -> list[tuple[int, int]]:
    """List index and length of each axis with a fixed length."""
    return [(i, n) for i, n in enumerate(shape.axes) if isinstance(n, int)]


def _read_numbers(base: Any, quantity: Quantity | None, shapes: tuple[Axes, ...]) -> Reader:
    """Make the reader of numbers in a range, or of read-only arrays with one of these shapes."""
    (low, high), unit = (quantity.range, quantity.words) if quantity else ((-np.inf, np.inf), "")
    # Element type of the array.
    kind = get_args(get_args(base)[1])[0] if get_origin(base) is np.ndarray else np.float64
    needed = "be one number" if shapes is SINGLE else f"have shape {shapes[0]}"
    per_joint = shapes in (PER_JOINT, BOUNDED)
    if per_joint:
        pair = " or a lower and an upper bound per joint" if shapes is BOUNDED else ""
        needed = f"be one value for all joints or one per joint{pair}"

    # The axes with a fixed length, by the number of axes.
    lengths = {len(x.axes): _fixed_lengths(x) for x in shapes}

    # The range of texts is checked with that of numbers.
    written = replace(quantity, sign="any", within=None) if quantity and quantity.unit else None

    def freeze(value: Any, who: str) -> Any:
        """Convert a value to a read-only array of the required element type."""
        if kind is np.float64:
            return checks.frozen_array(value, who, unit)
        array = checks.indices(who, value) if kind is np.intp else value
        checks.raise_if(not isinstance(array, np.ndarray), f"{who} must be an array.")
        return checks.freeze(array)

    def read(value: Any, who: str) -> Any:
        """Convert numbers, or texts with units, to a float or an array; check shape and range."""
        # Fast paths for most values. NaN fails the comparisons.
        if shapes is SINGLE and type(value) is float and low <= value <= high:
            return value
        few = value.tolist() if per_joint and type(value) is np.ndarray else value
        if per_joint and type(few) in (list, tuple) and 0 < len(few) <= FASTER_IN_PYTHON:
            for x in few:
                if type(x) is not float or not low <= x <= high:
                    break
            else:
                return checks.frozen_array(value)
        if written is not None and isinstance(value, str | list | tuple):
            value = texts_to_si(value, written, who)
        array = freeze(value, who)
        fixed = lengths.get(array.ndim)
        fits = shapes[0].axes == (...,) or (
            fixed is not None and all([array.shape[i] == x for i, x in fixed])
        )
        if not fits or (per_joint and not array.size):
            raise InvalidInput(
                f"{who} must {needed}{checks.in_unit(unit)}, but has shape {array.shape}."
            )
        if quantity is not None:
            paired = quantity.bounds and array.ndim == 2
            _refuse_outside(array * (-1.0, 1.0) if paired else array, quantity, who)
        return float(array) if shapes is SINGLE else array

    return freeze if quantity is None and shapes is ANY_SHAPE else read


def texts_to_si(value: Any, quantity: Quantity, who: str) -> Any:
    """Convert texts such as "5 mm" to SI units, in a number or in lists of numbers."""
    if isinstance(value, list | tuple):
        return [texts_to_si(x, quantity, who) for x in value]
    try:
        return read_quantity(value, quantity) if isinstance(value, str) else value
    except ValueError as error:
        raise InvalidInput(f"{who}: {str(error).rstrip('.')}.") from None


def _refuse_outside(array: Any, quantity: Quantity, who: str) -> None:
    """Refuse numbers outside the quantity's range; the message has the first of them."""
    low, high = quantity.range
    # NaN fails both comparisons.
    if not array.size or (low <= array.min() and array.max() <= high):
        return
    sound = (array >= low) & (array <= high)
    if quantity.endless:
        sound |= np.isposinf(array) | (np.isneginf(array) & (low < 0))
    if sound.all():
        return
    index = tuple(int(x) for x in np.argwhere(~sound)[0])
    value = float(array[index])
    unit = checks.suffix(quantity.words)
    location = f" at index {', '.join(str(x) for x in index)}" if index else ""
    needed = quantity.needed(value) if np.isfinite(value) else "be finite"
    if quantity.bounds and array.ndim == 2:
        needed = "be a lower bound below zero and an upper bound above zero"
        value = -value if index[1] == 0 else value
    raise InvalidInput(
        f"{who} must {needed}, but is {value:g}{unit}{location}.",
        index=index[0] if index else None,
    )


def _refuse_misfits(value: Any, shapes: list[tuple[str, Axes]]) -> None:
    """Refuse arrays whose axes have the same name but different lengths."""
    axis_lengths: dict[str, tuple[int, str]] = {}
    for name, shape in ((name, x) for name, x in shapes if getattr(value, name) is not None):
        array = getattr(value, name)
        lengths = (len(array),) if isinstance(array, tuple) else array.shape
        for axis, n in zip(shape.axes, lengths, strict=True):
            if isinstance(axis, str) and axis_lengths.setdefault(axis, (n, name))[0] != n:
                needed, first = axis_lengths[axis]
                raise InvalidInput(
                    f"{name} of {_noun(type(value))} has shape {lengths}, but must have shape "
                    f"{shape} with {axis} = {needed}, as {first} has.",
                    key=(name,),
                )
