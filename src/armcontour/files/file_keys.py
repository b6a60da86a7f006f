"""Reader of keys in files, from the annotations of dataclasses.

The reader selects the alternative of an annotation by the form of the data, converts quantities to
SI units, and makes the dataclasses. `core/fields.py` checks the values.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    TypeAlias,
    get_args,
    get_origin,
    get_type_hints,
)

from armcontour.core.errors import InvalidInput
from armcontour.core.fields import UNIONS, reader_of
from armcontour.core.guesses import suggest
from armcontour.core.quantities import (
    AtLeast,
    Axes,
    Choice,
    Convert,
    Items,
    Key,
    Named,
    PartialFields,
    Quantity,
    read_quantity,
)
from armcontour.core.text import Keys, describe_fields, key_text, show

# Values by key path in a job file, from the outermost key.
Patch: TypeAlias = Mapping[Keys, Any]
# Forms of data, with their descriptions in messages.
FORMS = {
    bool: "true or false",
    float: "a number",
    str: "text",
    list: "a list",
    dict: "a mapping of keys",
}
# Classes of annotations by the form of their values.
FORM_OF: dict[Any, type] = {
    **dict.fromkeys((int, float), float),
    **dict.fromkeys((str, Literal), str),
    **dict.fromkeys((list, tuple, Sequence), list),
    **dict.fromkeys((dict, Mapping), dict),
    bool: bool,
}
# Matches array shapes in docstrings, which are removed from the descriptions of keys.
SHAPE = re.compile(r", \((?:dof|\d)[\w, ]*\)(?: or \([\w, ]*\),)?")


@dataclass(frozen=True, slots=True)
class Methods:
    """Annotation: one of several dataclasses, which the key `method` selects."""

    text: str  # Description of the mapping
    method: str  # Description of the key `method`
    kinds: tuple[Any, ...]  # Dataclasses with an attribute `method`; without it, the first
    has_default: bool = True  # False: without keys, the value is None


class KeyField(NamedTuple):
    """A key of a file, and its field in the dataclass."""

    name: str
    hint: Any
    text: str
    default: Any  # `inspect.Parameter.empty` if the key is required
    is_made: bool  # Whether a default factory makes the default; null is this default


# Marks that determine the values of an annotation; other marks only describe a key.
MARKS = (Quantity, Axes, Choice, AtLeast, Named, Items, PartialFields, Methods)


class UnknownKey(Exception):
    """A key that its mapping does not have: the key path, and the value."""


def read_keys(kind: Any, data: Any) -> Any:
    """Check the data of a file, and make the value of an annotation, such as a dataclass.

    Raises:
        InvalidInput: A key is unknown or missing, or a value is wrong. The error has `key`, the key
            path of the wrong value, and `value`.
    """
    hint = Annotated[Any, kind] if isinstance(kind, PartialFields | Methods) else kind
    try:
        return _read(hint, data, ())
    except UnknownKey as error:
        keys, value = error.args
        sentence = f"unknown key {key_text(keys)}: {_suggest_key(hint, keys)}"
        stop = "" if sentence.endswith("?") else "."
        raise InvalidInput(sentence + stop, key=keys, value=value) from None


def _wrong(keys: Keys, value: Any, words: str) -> InvalidInput:
    sentence = f"{key_text(keys) or 'the file'}: {words.rstrip('.')}."
    return InvalidInput(sentence, key=keys, value=value)


def _read(hint: Any, data: Any, keys: Keys) -> Any:
    """Return the value of an annotation, made from the data at a key path."""
    every = tuple(leaves(hint))
    if data is None and type(None) in every:
        return None
    try:
        value = _read_leaf(_select(every, data), data, keys)
        for mark in getattr(hint, "__metadata__", ()):
            if isinstance(mark, Convert):
                value = mark.convert(value)
    except InvalidInput:
        raise
    except ValueError as error:
        raise _wrong(keys, data, str(error)) from None
    return value


def leaves(hint: Any) -> Iterator[Any]:
    """Yield the alternatives of an annotation: types, and annotations with one of MARKS."""
    parts = get_args(hint)
    if get_origin(hint) in UNIONS:
        for part in parts:
            yield from leaves(part)
    elif get_origin(hint) is Annotated and not isinstance(parts[1], MARKS):
        yield from leaves(parts[0])
    else:
        yield hint


def _mark(leaf: Any) -> tuple[Any, Any]:
    """Return the type of an alternative and its mark; the mark is None if it has none."""
    return get_args(leaf)[:2] if get_origin(leaf) is Annotated else (leaf, None)


def _forms(leaf: Any) -> tuple[type, ...]:
    """Return the forms that data of an alternative may have."""
    base, mark = _mark(leaf)
    if isinstance(mark, Quantity):
        text = (str,) if mark.unit or mark.endless else ()
        return (float, *text) if base is float else (float, *text, list)
    if isinstance(mark, PartialFields | Methods) or dataclasses.is_dataclass(base):
        return (dict,)
    if isinstance(mark, Choice) and get_origin(base) in UNIONS:
        return str, list
    form = FORM_OF.get(get_origin(base) or base)
    return () if form is None else (form,)


def _forms_of_items(leaf: Any) -> list[type]:
    """Return the forms that items may have in an alternative that is a list."""
    base, _ = _mark(leaf)
    return list(chain.from_iterable(map(_forms, leaves(get_args(base)[0]))))


def _form_of(data: Any) -> type | None:
    """Return the type in FORMS that data have (a whole number counts as a float); None if none."""
    return next((x for x in FORMS if isinstance(data, (int, float) if x is float else x)), None)


def _select(every: Sequence[Any], data: Any) -> Any:
    """Return the alternative for data of this form; ValueError if there is none."""
    form = _form_of(data)
    fitting = [x for x in every if form in _forms(x)]
    if form is list and data and len(fitting) > 1:
        # Alternatives with lists differ in the form of their items.
        inner = _form_of(data[0])
        fitting = [x for x in fitting if inner in _forms_of_items(x)] or fitting
    if not fitting:
        forms = dict.fromkeys(chain.from_iterable(map(_forms, every)))
        but = "but is empty" if data is None else f"not {show(data)}"
        raise ValueError(f"must be {' or '.join(FORMS[x] for x in forms)}, {but}")
    # A text is a choice if it is one of the choices, otherwise a quantity or a name.
    if form is str:
        for leaf in fitting:
            if data in choices(leaf):
                return leaf
    return fitting[-1]


def choices(leaf: Any) -> tuple[str, ...]:
    """Return the texts that an alternative allows; empty if it has no choices."""
    base, mark = _mark(leaf)
    if isinstance(mark, Choice):
        return mark.known
    return get_args(base) if get_origin(base) is Literal else ()


def _read_leaf(leaf: Any, data: Any, keys: Keys) -> Any:
    """Return the value of an alternative, made from data of its form."""
    base, mark = _mark(leaf)
    if isinstance(mark, Items) and (words := mark.problem(len(data))):
        raise ValueError(words)
    if isinstance(mark, PartialFields):
        return _read_fields(mark.of, data, keys, mark)
    if isinstance(mark, Methods):
        return _read_method(mark, data, keys)
    if isinstance(mark, Quantity):
        data = _in_si(data, mark, keys)
    elif dataclasses.is_dataclass(base):
        return _make(base, _read_fields(base, data, keys), keys)
    elif isinstance(data, dict):
        key_hint, hint = get_args(base)
        texts = [(key, (*keys, str(key)), x) for key, x in data.items()]
        return {_read(key_hint, key, at): _read(hint, x, at) for key, at, x in texts}
    elif isinstance(data, list) and not isinstance(mark, Choice):
        values = [_read(get_args(base)[0], x, (*keys, i)) for i, x in enumerate(data)]
        return tuple(values) if get_origin(base) is tuple else values
    read = reader_of(leaf)
    try:
        return data if read is None else read(data, f"{key_text(keys)}:")
    except InvalidInput as error:
        error.key = keys
        error.value = data
        raise


def _in_si(data: Any, quantity: Quantity, keys: Keys, depth: int = 0) -> Any:
    """Convert data to SI units, and check its sign and range.

    The numbers of a pair [lower, upper] may have any sign.

    - `keys`: key path of the data, for errors.
    - `depth`: number of lists around the data; 2 for a number of a pair.
    """
    if isinstance(data, list):
        return [_in_si(x, quantity, (*keys, i), depth + 1) for i, x in enumerate(data)]
    if isinstance(data, bool) or not isinstance(data, int | float | str):
        raise _wrong(keys, data, f"must be {FORMS[float]}, not {show(data)}")
    if quantity.bounds and depth == 2:
        quantity = dataclasses.replace(quantity, sign="any")
    try:
        return read_quantity(data, quantity)
    except ValueError as error:
        raise _wrong(keys, data, str(error)) from None


def _read_fields(
    kind: Any, data: Any, keys: Keys, partial: PartialFields | None = None
) -> dict[str, Any]:
    """Read the specified keys of a dataclass; values by the names of its fields."""
    known = key_fields(kind)
    values = {}
    for key in data:
        if key not in known or (partial and key in partial.omit):
            raise UnknownKey((*keys, str(key)), data[key])
    for key, field in known.items():
        if key in data:
            if data[key] is not None or not (field.is_made or (partial and partial.null)):
                values[field.name] = _read(field.hint, data[key], (*keys, key))
            elif partial:
                values[field.name] = None
        elif field.default is inspect.Parameter.empty and not partial:
            at = (*keys, key)
            raise InvalidInput(f"the key {key_text(at)} is missing.", key=at)
    return values


def _make(kind: Any, values: Mapping[str, Any], keys: Keys) -> Any:
    """Make a dataclass; its errors become errors of its keys."""
    try:
        return kind(**values)
    except InvalidInput as error:
        names = {x.name: key for key, x in key_fields(kind).items()}
        located = error.with_location(key_text(keys)) if keys else error
        located.key = (*keys, *(names.get(str(x), x) for x in error.key))
        raise located from None


def _read_method(mark: Methods, data: Any, keys: Keys) -> Any:
    """Return the value of the dataclass that the key `method` selects."""
    known = method_fields(mark)
    names = tuple(str(x.method) for x in mark.kinds)
    for key in data:
        if key != "method" and key not in known:
            raise UnknownKey((*keys, str(key)), data[key])
    one_of: Any = Annotated[str, Choice(names)]
    one_of = one_of if mark.has_default else one_of | None
    method = _read(one_of, data.get("method", names[0]), (*keys, "method"))
    every = {x: _read(known[x].hint, data[x], (*keys, x)) for x in data if x in known}
    values = {key: x for key, x in every.items() if x is not None}
    if not mark.has_default and not values and data.get("method") is None:
        return None
    kind = next(x for x in mark.kinds if x.method == (method or names[0]))
    for key in values:
        if key not in key_fields(kind):
            words = f"{key} requires the method {methods_with(mark, key)}, not {kind.method}"
            raise _wrong((*keys, key), data[key], words)
    return _make(kind, values, keys)


@cache
def method_fields(mark: Methods) -> dict[str, KeyField]:
    """Return the keys of all methods, in alphabetical order."""
    every: dict[str, KeyField] = {}
    for kind in mark.kinds:
        every |= key_fields(kind)
    return {key: every[key] for key in sorted(every)}


def methods_with(mark: Methods, key: str) -> str:
    """Return the text with the names of the methods that have a key."""
    return " and ".join(x.method for x in mark.kinds if key in key_fields(x))


@cache
def key_fields(kind: Any) -> dict[str, KeyField]:
    """Return the keys of a dataclass; its own keys come before those of its base classes."""
    hints = get_type_hints(kind, include_extras=True)
    own = inspect.get_annotations(kind)
    texts = describe_fields(kind)
    parameters = inspect.signature(kind).parameters
    keys = {}
    for field in sorted(dataclasses.fields(kind), key=lambda x: x.name not in own):
        hint = hints[field.name]
        factory = field.default_factory
        key = next((x for x in getattr(hint, "__metadata__", ()) if isinstance(x, Key)), Key())
        if not field.init or key.omit:
            continue
        is_made = factory is not dataclasses.MISSING and factory not in (dict, list)
        default = None if is_made else parameters[field.name].default
        default = factory() if factory in (dict, list) else default
        text = SHAPE.sub("", key.text or texts.get(field.name, "")).replace("None ", "null ")
        keys[key.name or field.name] = KeyField(
            field.name, key.hint or hint, text, key.default or default, is_made
        )
    return keys


def quantity_of(kind: type, keys: Sequence[str | int]) -> Quantity | None:
    """Return the quantity that a key's value represents; None if it is not a quantity."""
    hints: Sequence[Any] = (kind,)
    for key in keys:
        hints = _inside(hints, key)
    return next((_mark(x)[1] for x in hints if isinstance(_mark(x)[1], Quantity)), None)


def in_si(data: Any, *hints: Any) -> Any:
    """Copy file data, with all quantities as plain numbers in SI units."""
    # Values that cannot be converted are unchanged; the reader of the keys refuses them later.
    if isinstance(data, dict):
        return {key: in_si(x, *_inside(hints, key)) for key, x in data.items()}
    if isinstance(data, list):
        return [in_si(x, *_inside(hints, 0)) for x in data]
    for _, mark in map(_mark, hints):
        if isinstance(mark, Quantity):
            try:
                return read_quantity(data, mark)
            except ValueError:
                pass
    return data


def _inside(hints: Sequence[Any], key: Any) -> tuple[Any, ...]:
    """Return the alternatives of a key inside a mapping, or of a list item."""
    inner: list[Any] = []
    for leaf in hints:
        base, mark = _mark(leaf)
        if isinstance(mark, Quantity):
            # A quantity may be one value for all joints, or a list with one value per joint.
            inner += [leaf] * isinstance(key, int)
            continue
        for kind in kinds_of_keys(leaf):
            inner += leaves(key_fields(kind)[key].hint) if key in key_fields(kind) else ()
        form = FORM_OF.get(get_origin(base))
        if get_args(base) and (form is dict or (form is list and isinstance(key, int))):
            inner += leaves(get_args(base)[form is dict])
    return tuple(inner)


def kinds_of_keys(leaf: Any) -> tuple[Any, ...]:
    """Return the dataclasses whose keys an alternative has."""
    base, mark = _mark(leaf)
    if isinstance(mark, Methods):
        return mark.kinds
    kind = mark.of if isinstance(mark, PartialFields) else base
    return (kind,) if dataclasses.is_dataclass(kind) else ()


def _keys_of(hints: Sequence[Any]) -> list[str]:
    """Return the keys of all alternatives, in order."""
    keys = dict[str, None]()
    for leaf in hints:
        if isinstance(_mark(leaf)[1], Methods):
            keys["method"] = None
        for kind in kinds_of_keys(leaf):
            keys |= dict.fromkeys(key_fields(kind))
    return list(keys)


def _suggest_key(hint: Any, keys: Keys) -> str:
    """Suggest a key for an unknown one: advice, the most similar known key, or all keys."""
    *outer, name = keys
    hints = tuple(leaves(hint))
    top = _keys_of(hints)
    for part in outer:
        hints = _inside(hints, part)
    names = _keys_of(hints)
    if len(outer) == 2 and outer[0] == "runs" and name in top:
        return (
            f"{name} applies to the whole job, so write it at the top level, next to runs; to "
            "compare several values, use `armcontour batch`, or pins in the Studio"
        )
    if str(name)[:1].isdigit():
        # YAML reads {tolerance: 0,2 mm} as a mapping with the keys tolerance and 2 mm.
        return "a comma ends a value in braces, so write decimals with a point, such as 0.2 mm"
    outer_keys = [] if outer else [x for x in names if name in _keys_of(_inside(hints, x))]
    if outer_keys:
        inner = [f"{x}.{name}" for x in outer_keys]
        return f"did you mean {' or '.join(inner)}?"
    return suggest(str(name), names, f"the known keys are {', '.join(names)}")
