"""Validators and schemas of file keys, derived from dataclasses.

Building the validators of all keys of a job takes as long as a small plan, but a job uses few keys.
Therefore the validator of a nested mapping is built only if a file has such a mapping.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import types
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, partial
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    StrictBool,
    StrictInt,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    create_model,
)
from pydantic_core import CoreSchema, core_schema

from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Options, parts_of
from armcontour.core.quantities import (
    WHOLE_TURN,
    About,
    AtLeast,
    Axes,
    Choice,
    Named,
    PartialFields,
    Quantity,
)
from armcontour.core.text import describe_fields
from armcontour.files.key_errors import describe_first_error
from armcontour.files.key_overrides import KEY_OVERRIDES, KeyOverrides
from armcontour.files.units import read_quantity

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
STRICT_TYPES: dict[Any, Any] = {
    **{bool: StrictBool, int: StrictInt, float: Number},
    **{Mapping: dict, Sequence: list},
}
BOUNDS: dict[str, dict[str, float]] = {
    "any": {},
    "positive": {"exclusiveMinimum": 0},
    "not negative": {"minimum": 0},
    "negative": {"exclusiveMaximum": 0},
    "share": {"minimum": 0, "exclusiveMaximum": 1},
    "turn": {"minimum": -WHOLE_TURN, "maximum": WHOLE_TURN},
}
# Matches array shapes in docstrings, which are removed from the descriptions of keys.
SHAPE = re.compile(r", \((?:dof|\d)[\w, ]*\)(?: or \([\w, ]*\),)?")
# True while a validator is built whose nested validators are built on demand.
_defer_nested = ContextVar("_later", default=False)


class KeyMark(ABC):
    """Annotation of a value that is made from a mapping of keys."""

    __slots__ = ()

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        if _defer_nested.get():
            return core_schema.no_info_plain_validator_function(self._read)
        return self.schema(handler)

    def _read(self, data: Any) -> Any:
        """Check a mapping and make its value; problems are reported as problems of the file."""
        return _deferred_adapter(self).validate_python(data)

    @abstractmethod
    def schema(self, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Pydantic schema that checks the mapping and makes its value."""


@dataclass(frozen=True, slots=True)
class _WholeFile:
    """Annotation of a whole file, whose nested validators are built on demand."""

    mark: KeyMark

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        token = _defer_nested.set(True)
        try:
            return self.mark.schema(handler)
        finally:
            _defer_nested.reset(token)


@dataclass(frozen=True, slots=True)
class MappingKeys(KeyMark):
    """Annotation of a dataclass that is made from a mapping of its keys."""

    target: type

    def schema(self, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Pydantic schema that checks the keys and makes the dataclass."""
        inner = handler.generate_schema(_model(self.target))
        return core_schema.no_info_after_validator_function(self._build, inner)

    def _build(self, model: BaseModel) -> Any:
        """Make the dataclass from the validated keys."""
        values, made = _values(self.target, model), _factory_fields(self.target)
        return self.target(**{k: v for k, v in values.items() if not (v is None and k in made)})


@dataclass(frozen=True, slots=True)
class SpecifiedKeys(KeyMark):
    """Annotation of a dictionary with those fields of a dataclass that a file specifies."""

    target: type
    null: bool = False  # Whether every key may be `null`

    def schema(self, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Pydantic schema that checks the specified keys and makes the dictionary."""
        inner = handler.generate_schema(_model(self.target, specified=True, null=self.null))
        return core_schema.no_info_after_validator_function(partial(_values, self.target), inner)


@dataclass(frozen=True, slots=True)
class Methods(KeyMark):
    """Annotation of one of several dataclasses, selected by the key `method`."""

    text: str  # Description of the mapping
    method: str  # Description of the key `method`
    kinds: tuple[Any, ...]  # Dataclasses with an attribute `method`; without it, the first
    more: tuple[Any, ...] = ()  # Additional annotations of the key `method`
    has_default: bool = True  # False: without keys, the value is None

    @property
    def keys(self) -> list[str]:
        """Names of the fields that are keys, because they have an `About` annotation."""
        hints = [
            x for kind in self.kinds for x in get_type_hints(kind, include_extras=True).items()
        ]
        return sorted({name for name, x in hints if any(isinstance(y, About) for y in parts_of(x))})

    def schema(self, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Pydantic schema that checks the keys and makes the dataclass of the method."""
        inner = handler.generate_schema(_methods_model(self))
        return core_schema.no_info_after_validator_function(self._build, inner)

    def _build(self, model: BaseModel) -> Any:
        """Make the dataclass from the validated keys."""
        values = {x: getattr(model, x) for x in model.model_fields_set}
        method = getattr(model, "method") or self.kinds[0].method  # noqa: B009
        specified = {key: x for key, x in values.items() if x is not None and key != "method"}
        if not self.has_default and not specified and values.get("method") is None:
            return None
        kind = next(x for x in self.kinds if x.method == method)
        for key in specified.keys() - _parameters(kind).keys():
            raise ValueError(f"{key} requires the method {self.methods(key)}, not {kind.method}")
        return kind(**specified)

    def methods(self, key: str) -> str:
        """Text with the names of the methods that have a key."""
        return " and ".join(x.method for x in self.kinds if key in _parameters(x))


def read_keys(mark: KeyMark, data: Any, source: str) -> Any:
    """Check the data of a file and make the value that `mark` describes."""
    with suppress(ValidationError):
        return _deferred_adapter(mark).validate_python(data)
    # Data with an error is validated again by the validator of the whole file, which is slow to
    # build but knows the location of each key.
    try:
        return _complete_adapter(mark).validate_python(data)
    except ValidationError as error:
        raise InvalidInput(f"{source}: {describe_first_error(error, schema_of(mark))}") from None


@cache
def schema_of(mark: KeyMark) -> dict[str, Any]:
    """JSON Schema of a file with the keys of a dataclass."""
    return _complete_adapter(mark).json_schema()


@cache
def _deferred_adapter(mark: KeyMark) -> TypeAdapter[Any]:
    """Validator of a mapping, whose nested validators are built on demand."""
    return TypeAdapter(Annotated[Any, _WholeFile(mark)])


@cache
def _complete_adapter(mark: KeyMark) -> TypeAdapter[Any]:
    """Validator of a mapping and all nested mappings."""
    return TypeAdapter(Annotated[Any, mark])


@cache
def _model(kind: type, *, specified: bool = False, null: bool = False) -> type[BaseModel]:
    """Pydantic model of a dataclass; if `specified` is true, all keys are optional."""
    name = f"Given{kind.__name__}" if specified else kind.__name__
    summary = inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0]
    return _new_model(name, summary, _keys(kind, specified=specified, null=null))


@cache
def _methods_model(mark: Methods) -> type[BaseModel]:
    """Pydantic model with the keys of all methods."""
    names = tuple(str(x.method) for x in mark.kinds)
    one_of: Any = Annotated[(Literal[names], *mark.more)] if mark.more else Literal[names]
    default = names[0] if mark.has_default else None
    fields: dict[str, Any] = {
        "method": (one_of if default else one_of | None, Field(default, description=mark.method))
    }
    every = {key: x for kind in mark.kinds for key, x in _keys(kind).items()}
    for key in mark.keys:
        annotation, info = every[key]
        text = info.description
        if any(key not in _parameters(x) for x in mark.kinds):
            text = f"For the method {mark.methods(key)}: {text[:1].lower()}{text[1:]}"
        fields[key] = (annotation, Field(info.default, description=text))
    return _new_model(mark.kinds[0].__mro__[1].__name__, mark.text, fields)


def _new_model(name: str, summary: str, keys: dict[str, Any]) -> type[BaseModel]:
    config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    return create_model(name, __config__=config, __doc__=summary, __module__=__name__, **keys)


def _keys(owner: type, *, specified: bool = False, null: bool = False) -> dict[str, Any]:
    """Types and pydantic fields of the keys of a dataclass, by key."""
    overrides = KEY_OVERRIDES.get(owner, KeyOverrides())
    hints = {**get_type_hints(owner, include_extras=True), **overrides.types}
    described = {**_descriptions(owner), **overrides.texts}
    fields: dict[str, Any] = {}
    own_names = inspect.get_annotations(owner)
    # Keys of the class itself come before the keys of its base classes.
    for field in sorted(dataclasses.fields(owner), key=lambda x: x.name not in own_names):
        if field.name in overrides.omit or not field.init:
            continue
        kind = _type_of(hints[field.name])
        if null or (_has_factory(field) and field.default_factory not in (dict, list)):
            kind = kind | None
        default = None if specified else overrides.defaults.get(field.name, _default(owner, field))
        key = overrides.names.get(field.name, field.name)
        text = described.get(field.name)
        if isinstance(default, Options):
            same: Any = partial(dataclasses.replace, default)
            fields[key] = (kind, Field(default_factory=same, description=text))
        else:
            fields[key] = (kind, Field(default, description=text))
    return fields


def _default(owner: type, field: dataclasses.Field[Any]) -> Any:
    """Default of the key of a field; None for a factory other than `dict` and `list`."""
    if field.default_factory in (dict, list):
        return field.default_factory()
    if _has_factory(field):
        return None
    default = _parameters(owner)[field.name].default
    return ... if default is inspect.Parameter.empty else default


@cache
def _parameters(owner: type) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(owner).parameters


def _has_factory(field: dataclasses.Field[Any]) -> bool:
    return field.default_factory is not dataclasses.MISSING


@cache
def _factory_fields(owner: type) -> frozenset[str]:
    """Names of the fields with a default factory; for these keys, null means the default."""
    return frozenset(x.name for x in dataclasses.fields(owner) if _has_factory(x))


def _values(owner: type, model: BaseModel) -> dict[str, Any]:
    """Values that a file specifies, by field of the dataclass."""
    names, specified = _names_of(owner), model.model_fields_set
    return {names.get(x, x): getattr(model, x) for x in type(model).model_fields if x in specified}


@cache
def _names_of(owner: type) -> dict[str, str]:
    """Names of the fields of a dataclass by key, for keys with another name than the field."""
    return {key: name for name, key in KEY_OVERRIDES.get(owner, KeyOverrides()).names.items()}


def _descriptions(owner: type) -> dict[str, str]:
    """Descriptions of the fields of a dataclass for users of files: null replaces None."""
    fields = describe_fields(owner).items()
    return {name: SHAPE.sub("", text).replace("None ", "null ") for name, text in fields}


def _type_of(hint: Any) -> Any:
    """Pydantic type of a key, from the annotation of its field."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _annotated(*parts)
    if origin in (Union, types.UnionType):
        return Union[tuple(_type_of(x) for x in parts)]  # noqa: UP007
    origin = STRICT_TYPES.get(origin, origin)
    if origin in (list, dict, tuple):
        return origin[tuple(_type_of(x) for x in parts)]
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return Annotated[hint, MappingKeys(hint)]
    return STRICT_TYPES.get(hint, hint)


def _annotated(annotated: Any, *marks: Any) -> Any:
    """Pydantic type of a key whose field has an `Annotated` type."""
    mark = marks[0]
    if isinstance(mark, Quantity):
        number = _number(mark)
        if annotated is float:
            return number if mark.unit else Number
        each: Any = number | list[number]  # type: ignore[valid-type]
        lengths = next((x.axes for x in marks[1:] if isinstance(x, Axes)), ())
        match lengths:
            case (int(n),):
                exact: Any = Annotated[list[number], Field(min_length=n, max_length=n)]  # type: ignore[valid-type]
                return exact
        bound: Any = _number(dataclasses.replace(mark, sign="any"))
        pair = Annotated[list[bound], Field(min_length=2, max_length=2)]
        return each | list[pair] if mark.bounds else each
    if isinstance(mark, Choice):
        literal: Any = Literal[mark.known]
        if annotated is not str:
            return literal | list[literal]
        return Annotated[(literal, *marks[1:])] if marks[1:] else literal
    if isinstance(mark, AtLeast):
        return Annotated[StrictInt, Field(ge=mark.least, le=mark.most)]
    if isinstance(mark, Named):
        return Annotated[str, Field(min_length=1)] if mark.needed else str
    if isinstance(mark, PartialFields):
        return Annotated[dict[str, Any], SpecifiedKeys(mark.of, null=True)]
    if isinstance(mark, SpecifiedKeys | Methods):
        return Annotated[annotated, mark]
    return Annotated[(_type_of(annotated), *marks)]


def _bounds(kind: Quantity) -> dict[str, float]:
    """Bounds of a quantity as keywords of JSON Schema."""
    if kind.within is None:
        return BOUNDS[kind.sign]
    return dict(zip(("minimum", "maximum"), kind.within, strict=True))


def _number(kind: Quantity) -> Any:
    """Pydantic type of a quantity: a plain number, or text with a unit."""
    text = f"A number in {kind.unit}, or text with a unit such as '{kind.example}'."
    if kind.unit == "1":
        text = f"A plain number, or text in percent such as '{kind.example}'."
    schema: dict[str, Any] = {
        "description": text,
        "anyOf": [{"type": "number", **_bounds(kind)}, {"type": "string"}],
        "examples": [kind.example],
    }
    read = BeforeValidator(partial(read_quantity, kind=kind))
    return Annotated[float, read, WithJsonSchema(schema)]
