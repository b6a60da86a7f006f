"""Data of files with their quantities in SI units, and the quantity that a key takes."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from armcontour.core.quantities import PartialFields, Quantity
from armcontour.files.forms import FORMS, Form
from armcontour.files.keys import Given, Keys, Methods
from armcontour.files.units import read_quantity

# A quantity, a dataclass, or a type of lists or mappings.
Kind = Any


def quantity_of(of: type, keys: Sequence[str | int]) -> Quantity | None:
    """The quantity that a key of a file takes; None if it takes none.

    Args:
        of: The dataclass of the file.
        keys: The keys that lead there, from the outermost.
    """
    kinds: tuple[Kind, ...] = (of,)
    for key in keys:
        # One value for all joints, or a list with one for each.
        of_all = (x for x in kinds if isinstance(x, Quantity) and isinstance(key, int))
        kinds = (*of_all, *_inside(kinds, key))
    return next((x for x in kinds if isinstance(x, Quantity)), None)


def in_si(data: Any, of: type) -> Any:
    """The data of a file with plain numbers in SI units for all quantities.

    What is no quantity of the required unit stays as it is: reading the file refuses it.

    Args:
        data: The data.
        of: The dataclass of the file.
    """
    return _convert(data, (of,))


def _convert(value: Any, kinds: tuple[Kind, ...]) -> Any:
    """A value in SI units, by what its key may take."""
    if isinstance(value, dict):
        return {key: _convert(x, _inside(kinds, key)) for key, x in value.items()}
    quantities = tuple(x for x in kinds if isinstance(x, Quantity))
    if isinstance(value, list):
        # One value for all joints, or a list with one for each.
        inner = (*quantities, *_inside(kinds, 0))
        return [_convert(x, inner) for x in value]
    for kind in quantities:
        try:
            return read_quantity(value, kind)
        except ValueError:
            pass
    return value


def _inside(kinds: Iterable[Kind], key: Any) -> tuple[Kind, ...]:
    """What a key inside a mapping may take, or an item of a list."""
    found: list[Kind] = []
    for kind in kinds:
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            found += _fields(kind).get(key, ())
            continue
        origin: Any = get_origin(kind)
        if origin in (dict, Mapping):
            numbered = get_args(kind)[0] is int
            if isinstance(key, int if numbered else str):
                found += alternatives(get_args(kind)[1])
        elif origin in (list, tuple) and isinstance(key, int):
            found += alternatives(get_args(kind)[0])
    return tuple(found)


@cache
def _fields(of: type) -> dict[str, tuple[Kind, ...]]:
    """What the keys of a dataclass may take."""
    form = FORMS.get(of, Form())
    hints = {**get_type_hints(of, include_extras=True), **form.types}
    return {
        form.names.get(x.name, x.name): tuple(alternatives(hints[x.name]))
        for x in dataclasses.fields(of)
    }


def alternatives(hint: Any) -> Iterator[Kind]:
    """All that an annotation allows, as far as it holds quantities."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        mark = parts[1]
        if isinstance(mark, Quantity):
            yield mark
        elif isinstance(mark, Given | PartialFields | Keys):
            yield mark.of
        elif isinstance(mark, Methods):
            yield from mark.kinds
        else:
            yield from alternatives(parts[0])
    elif origin in (Union, types.UnionType):
        for x in parts:
            yield from alternatives(x)
    elif origin is not None or dataclasses.is_dataclass(hint):
        yield hint
