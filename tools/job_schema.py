"""JSON Schema of job files, from the annotations of their dataclasses.

    python -m tools.job_schema

writes the file that `armcontour schema` prints.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

from armcontour.core.fields import UNIONS, Options
from armcontour.core.quantities import (
    WHOLE_TURN,
    AtLeast,
    Axes,
    Choice,
    Items,
    Named,
    PartialFields,
    Quantity,
)
from armcontour.files.file_keys import (
    KeyField,
    Methods,
    key_fields,
    leaves,
    method_fields,
    methods_with,
)
from armcontour.files.job_model import RUN_NAME, JobModel, RunModel

FILE = Path(str(resources.files("armcontour.files"))) / "job.schema.json"
TYPES: dict[Any, dict[str, Any]] = {
    bool: {"type": "boolean"},
    str: {"type": "string"},
    int: {"type": "integer"},
    float: {"type": "number"},
    NoneType: {"type": "null"},
}
BOUNDS: dict[str, dict[str, float]] = {
    "any": {},
    "positive": {"exclusiveMinimum": 0},
    "not negative": {"minimum": 0},
    "negative": {"exclusiveMaximum": 0},
    "share": {"minimum": 0, "exclusiveMaximum": 1},
    "turn": {"minimum": -WHOLE_TURN, "maximum": WHOLE_TURN},
}


class Schemas:
    """JSON Schemas of annotations; `defs` collects those of mappings by name."""

    def __init__(self) -> None:
        self.defs: dict[str, Any] = {}

    def of_hint(self, hint: Any) -> dict[str, Any]:
        """Return the schema for values of an annotation."""
        every = [x for x in leaves(hint) if not _is_path(x)]
        parts = [y for x in every for y in self._of_leaf(x)]
        return parts[0] if len(parts) == 1 else {"anyOf": parts}

    def _of_leaf(self, leaf: Any) -> list[dict[str, Any]]:
        """Return the schemas for the forms of an alternative."""
        base, mark = get_args(leaf)[:2] if get_origin(leaf) is Annotated else (leaf, None)
        origin = get_origin(base) or base
        parts = get_args(base)
        match mark:
            case Quantity():
                return self._of_quantity(base, get_args(leaf)[1:])
            case Choice() if origin in UNIONS:
                one = Annotated[str, mark]
                return [self.of_hint(one), self.of_hint(list[one])]  # type: ignore[valid-type]
            case Choice():
                return [{"enum": list(mark.known), "type": "string"}]
            case PartialFields():
                return [self._reference(f"Given{mark.of.__name__}", lambda: _given(mark), mark.of)]
            case Methods():
                keys = _method_keys(mark)
                return [self._reference(base.__name__, lambda: keys, mark.kinds[0], mark.text)]
        if dataclasses.is_dataclass(base):
            return [self._reference(base.__name__, lambda: key_fields(base), base)]
        if origin is Literal:
            one_of = {"const": parts[0]} if len(parts) == 1 else {"enum": list(parts)}
            schema: dict[str, Any] = {**one_of, "type": "string"}
        elif origin in (dict, Mapping):
            inner = self.of_hint(parts[1])
            named = {"patternProperties": {RUN_NAME: inner}}
            keys_of_file = named if parts[1] is RunModel else {"additionalProperties": inner}
            schema = {**keys_of_file, "type": "object"}
        elif origin in (list, tuple, Sequence):
            schema = {"items": self.of_hint(parts[0]), "type": "array"}
        else:
            schema = dict(TYPES[base])
        return [schema | _bounds_of(mark, schema["type"])]

    def _of_quantity(self, base: Any, marks: Sequence[Any]) -> list[dict[str, Any]]:
        """Return the schemas of a quantity: a number, a list of numbers, a list of rows."""
        number = _number(marks[0])
        axes = next((x.axes for x in marks if isinstance(x, Axes)), ())
        if base is float:
            return [number if marks[0].unit else TYPES[float]]
        if len(axes) == 1 and isinstance(axes[0], int):
            return [{"items": number, "maxItems": axes[0], "minItems": axes[0], "type": "array"}]
        rows: list[Any] = [number, {"items": number, "type": "array"}]
        if axes == (...,):
            rows.append({"items": rows[1], "type": "array"})
        if marks[0].bounds:
            bound = _number(replace(marks[0], sign="any"))
            pair = {"items": bound, "maxItems": 2, "minItems": 2, "type": "array"}
            rows.append({"items": pair, "type": "array"})
        return rows

    def _reference(
        self,
        name: str,
        keys: Callable[[], Mapping[str, KeyField]],
        kind: Any,
        text: str | None = None,
    ) -> dict[str, Any]:
        """Return the reference to the schema of a mapping."""
        if name not in self.defs:
            # The entry is made first, because a mapping may contain mappings of its own kind.
            self.defs[name] = {}
            self.defs[name] = self.of_keys(kind, keys(), text)
        return {"$ref": f"#/$defs/{name}"}

    def of_keys(
        self, kind: Any, keys: Mapping[str, KeyField], text: str | None = None
    ) -> dict[str, Any]:
        """Return the schema of a mapping with keys."""
        required = [key for key, x in keys.items() if x.default is inspect.Parameter.empty]
        return {
            "additionalProperties": False,
            "description": text or inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0],
            "properties": {key: self._of_key(x) for key, x in keys.items()},
            **({"required": required} if required else {}),
            "type": "object",
        }

    def _of_key(self, field: KeyField) -> dict[str, Any]:
        """Return the schema of a key, with its default and its description."""
        schema = dict(self.of_hint(field.hint))
        default = field.default
        if field.is_made and {"type": "null"} not in schema.get("anyOf", ()):
            parts = [schema] if "examples" in schema else schema.get("anyOf", [schema])
            schema = {"anyOf": [*parts, {"type": "null"}]}
        if default is not inspect.Parameter.empty and not isinstance(default, Options):
            if dataclasses.is_dataclass(default) and not isinstance(default, type):
                default = dataclasses.asdict(default)
            schema["default"] = list(default) if isinstance(default, tuple) else default
        return schema | ({"description": field.text} if field.text else {})


def _is_path(hint: Any) -> bool:
    """Return whether a class is that of paths, which are text in a file."""
    return isinstance(hint, type) and issubclass(hint, Path)


def _number(kind: Quantity) -> dict[str, Any]:
    """Return the schema of a quantity: a plain number, or text with a unit."""
    text = f"A number in {kind.unit}, or text with a unit such as '{kind.example}'."
    if kind.unit == "1":
        text = f"A plain number, or text in percent such as '{kind.example}'."
    bounds = BOUNDS[kind.sign]
    if kind.within is not None:
        bounds = dict(zip(("minimum", "maximum"), kind.within, strict=True))
    number: list[Any] = [{**bounds, "type": "number"}, {"type": "string"}]
    return {"anyOf": number, "description": text, "examples": [kind.example]}


def _bounds_of(mark: Any, form: str) -> dict[str, Any]:
    """Return a mark's bounds as keywords of JSON Schema."""
    bounds: dict[str, Any] = {}
    if isinstance(mark, AtLeast):
        bounds = {"minimum": mark.least, "maximum": mark.most}
    elif isinstance(mark, Items):
        noun = "Items" if form == "array" else "Properties"
        bounds = {f"min{noun}": mark.least, f"max{noun}": mark.most}
    elif isinstance(mark, Named):
        bounds = {"minLength": 1 if mark.needed else None}
    return {key: x for key, x in bounds.items() if x is not None}


def _given(mark: PartialFields) -> dict[str, KeyField]:
    """Return the keys of a mapping that has some fields of a dataclass."""
    keys = key_fields(mark.of).items()
    given = {key: x._replace(default=None, is_made=mark.null or x.is_made) for key, x in keys}
    return {key: x for key, x in given.items() if key not in mark.omit}


def _method_keys(mark: Methods) -> dict[str, KeyField]:
    """Return the keys of all methods; each description names the methods with this key."""
    names = tuple(str(x.method) for x in mark.kinds)
    one_of: Any = Literal[names] if mark.has_default else Literal[names] | None
    default = names[0] if mark.has_default else None
    keys = {"method": KeyField("method", one_of, mark.method, default, False)}
    for key, field in method_fields(mark).items():
        text = field.text
        if any(key not in key_fields(x) for x in mark.kinds):
            text = f"For the method {methods_with(mark, key)}: {text[:1].lower()}{text[1:]}"
        keys[key] = field._replace(text=text)
    return keys


def schema_text() -> str:
    """Return the schema as JSON text."""
    schemas = Schemas()
    schema = schemas.of_keys(JobModel, key_fields(JobModel))
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "JobModel"}
    defs = dict(sorted(schemas.defs.items()))
    return json.dumps({**head, "$defs": defs, **schema}, indent=2) + "\n"


if __name__ == "__main__":
    FILE.write_text(schema_text(), encoding="utf-8")
