"""Conversion of the quantities in file data to SI units, and the quantity of a key."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from armcontour.core.quantities import PartialFields, Quantity
from armcontour.files.file_keys import MappingKeys, Methods, SpecifiedKeys
from armcontour.files.key_overrides import KEY_OVERRIDES, KeyOverrides
from armcontour.files.units import read_quantity

# Kind of the value of a key: a `Quantity`, a dataclass, or a type of lists or mappings.
Kind = Any


def quantity_of(file_class: type, keys: Sequence[str | int]) -> Quantity | None:
    """Quantity that the value of a key represents; None if the value is not a quantity."""
    kinds: tuple[Kind, ...] = (file_class,)
    for key in keys:
        # A quantity may be one value for all joints, or a list with one value per joint.
        of_all = (x for x in kinds if isinstance(x, Quantity) and isinstance(key, int))
        kinds = (*of_all, *_inside(kinds, key))
    return next((x for x in kinds if isinstance(x, Quantity)), None)


def in_si(data: Any, file_class: type) -> Any:
    """Copy of the data of a file with plain numbers in SI units for all quantities."""
    # Values that cannot be converted are unchanged; the validation of the keys rejects them later.
    return _convert(data, (file_class,))


def _convert(value: Any, kinds: tuple[Kind, ...]) -> Any:
    """Value in SI units; `kinds` are the possible kinds of its key."""
    if isinstance(value, dict):
        return {key: _convert(x, _inside(kinds, key)) for key, x in value.items()}
    quantities = tuple(x for x in kinds if isinstance(x, Quantity))
    if isinstance(value, list):
        # A quantity may be one value for all joints, or a list with one value per joint.
        inner = (*quantities, *_inside(kinds, 0))
        return [_convert(x, inner) for x in value]
    for kind in quantities:
        try:
            return read_quantity(value, kind)
        except ValueError:
            pass
    return value


def _inside(kinds: Iterable[Kind], key: Any) -> tuple[Kind, ...]:
    """Possible kinds of a key inside a mapping, or of an item of a list."""
    inner: list[Kind] = []
    for kind in kinds:
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            inner += _fields(kind).get(key, ())
            continue
        origin: Any = get_origin(kind)
        if origin in (dict, Mapping):
            numbered = get_args(kind)[0] is int
            if isinstance(key, int if numbered else str):
                inner += alternatives(get_args(kind)[1])
        elif origin in (list, tuple) and isinstance(key, int):
            inner += alternatives(get_args(kind)[0])
    return tuple(inner)


@cache
def _fields(owner: type) -> dict[str, tuple[Kind, ...]]:
    """Possible kinds of the keys of a dataclass."""
    overrides = KEY_OVERRIDES.get(owner, KeyOverrides())
    hints = {**get_type_hints(owner, include_extras=True), **overrides.types}
    return {
        overrides.names.get(x.name, x.name): tuple(alternatives(hints[x.name]))
        for x in dataclasses.fields(owner)
    }


def alternatives(hint: Any) -> Iterator[Kind]:
    """Yield the kinds of values that an annotation allows, if they can contain quantities."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        mark = parts[1]
        if isinstance(mark, Quantity):
            yield mark
        elif isinstance(mark, SpecifiedKeys | MappingKeys):
            yield mark.target
        elif isinstance(mark, PartialFields):
            yield mark.of
        elif isinstance(mark, Methods):
            yield from mark.kinds
        else:
            yield from alternatives(parts[0])
    elif origin in (Union, types.UnionType):
        for part in parts:
            yield from alternatives(part)
    elif origin is not None or dataclasses.is_dataclass(hint):
        yield hint
