"""Tables of all keys of job files, and their JSON Schema, which `make docs` writes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

from tools.job_schema import FILE, schema_text

from armcontour.core import quantities
from armcontour.robot.servo import ServoModel

HERE = Path(__file__).parent
# The two files that are written here: the JSON Schema and the page.
SCHEMA = HERE / "job.schema.json"
PAGE = HERE / "job_keys.md"
HEAD = """# Keys of job files

This page lists all keys of a [job file](../guides/job.md), from the outermost mapping to the
innermost. Editors read them from the [JSON Schema](job.schema.json). A quantity is a plain number
in the unit of the table, or text with a unit, such as the example. The unit 1 is that of a ratio,
which may be in percent. "keys" means a mapping, whose keys have their own table. A key that is not
required and has no default is optional. `NAME` is a name that you choose.
"""
# Annotations of the values of keys, quantities among them.
KINDS = (
    *vars(quantities).values(),
    *get_type_hints(ServoModel, include_extras=True).values(),
)


def _quantities() -> Iterator[quantities.Quantity]:
    """Yield the quantities among the annotations, and those that mark them or their parts."""
    for kind in KINDS:
        for part in (kind, *get_args(kind)):
            for x in (kind, *getattr(part, "__metadata__", ())):
                if isinstance(x, quantities.Quantity):
                    yield x


# The unit of SI for each example of a quantity. Quantities with one example have one unit.
UNITS = {x.example: x.unit for x in _quantities()} | {"10 deg": "rad, m"}
WORDS = {
    "boolean": "true or false",
    "integer": "whole number",
    "string": "text",
    "number": "number",
}


def published() -> dict[Path, str]:
    """The files on the keys of job files, with their texts."""
    text = schema_text()
    tables = "\n\n".join(_tables(json.loads(text)))
    return {SCHEMA: text, FILE: text, PAGE: f"{HEAD}\n{tables}\n"}


def _tables(schema: dict[str, Any]) -> Iterator[str]:
    """A table per mapping of keys, from the outside in, under the place where it first stands."""
    places = _places(schema)
    for kind, place in {"": "", **places}.items():
        mapping = schema["$defs"][kind] if kind else schema
        rows = ["| key | value | unit | default | meaning |", "|---|---|---|---|---|"]
        for key, value in mapping["properties"].items():
            # What says no more than the description of its keys is left out of the schema.
            texts = [schema["$defs"][x]["description"] for _, x in _inside(value, "")]
            cells = (
                f"`{key}`",
                " or ".join(dict.fromkeys(_values(value, places))).replace(" or list", ", or list"),
                " or ".join(dict.fromkeys(UNITS[x] for x in _examples(value))),
                "required" if key in mapping.get("required", ()) else _default(value),
                value.get("description") or texts[0],
            )
            rows.append(f"| {' | '.join(cells)} |")
        title = [f"## `{place}`"] if place else []
        yield "\n\n".join([*title, mapping["description"], "\n".join(rows)])


def _places(schema: dict[str, Any]) -> dict[str, str]:
    """Where each mapping of keys first stands, from the outside in, by its name in the schema."""
    queue = [("", schema)]
    places = dict[str, str]()
    while queue:
        place, kind = queue.pop(0)
        for key, value in kind["properties"].items():
            for name, inner in _inside(value, f"{place}.{key}" if place else key):
                if inner not in places and inner != "JobModel":
                    places[inner] = name
                    queue.append((name, schema["$defs"][inner]))
    return places


def _values(kind: dict[str, Any], places: dict[str, str]) -> Iterator[str]:
    """What a key may hold, in words; "keys" leads to their table."""
    if "$ref" in kind:
        place = places[_name_of(kind)]
        yield f"[keys](#{place.lower().replace('.', '')})"
    elif "enum" in kind or "const" in kind:
        yield from (f"`{x}`" for x in kind.get("enum", [kind.get("const")]))
    elif "examples" in kind:
        # A quantity: a plain number, or such text.
        yield f"`{kind['examples'][0]}`"
    elif "anyOf" in kind:
        for x in kind["anyOf"]:
            yield from _values(x, places)
    elif kind.get("type") == "array":
        number = kind.get("minItems")
        many = f"{number} " if number and number == kind.get("maxItems") else ""
        yield f"list of {many}{' or '.join(dict.fromkeys(_values(kind['items'], places)))}"
    elif kind.get("type") == "object":
        yield f"by name: {' or '.join(dict.fromkeys(_values(_named(kind), places)))}"
    elif kind.get("type") in WORDS:
        yield WORDS[kind["type"]]


def _examples(kind: Any) -> Iterator[str]:
    """The first example of each quantity that a key may hold, not those of keys inside it."""
    if isinstance(kind, dict):
        yield from kind.get("examples", ())[:1]
        for x in kind.values():
            yield from _examples(x)
    elif isinstance(kind, list):
        for x in kind:
            yield from _examples(x)


def _name_of(reference: dict[str, Any]) -> str:
    """The name in the schema of what a reference refers to."""
    return str(reference["$ref"]).rpartition("/")[2]


def _named(kind: dict[str, Any]) -> Any:
    """The schema of the values of a mapping by name."""
    return next(iter(kind.get("patternProperties", {}).values()), kind.get("additionalProperties"))


def _default(kind: dict[str, Any]) -> str:
    value = kind.get("default")
    if value is None or isinstance(value, dict | list):
        return ""
    text = f"{value:g}" if isinstance(value, float) else json.dumps(value)
    return "`" + text.strip('"') + "`"


def _inside(kind: dict[str, Any], place: str) -> Iterator[tuple[str, str]]:
    """The mappings of keys in a key, each with its place and its name in the schema."""
    if "$ref" in kind:
        yield place, _name_of(kind)
    for x in kind.get("anyOf", ()):
        yield from _inside(x, place)
    if "items" in kind:
        yield from _inside(kind["items"], place)
    if kind.get("type") == "object":
        yield from _inside(_named(kind), f"{place}.NAME")
