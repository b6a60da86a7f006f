"""Tables of all keys of job files, and their JSON Schema, which `make docs` writes."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

from tools.job_schema import FILE, schema_text

from armcontour.core import quantities
from armcontour.motion import Servoj
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
required and has no default is optional. "see meaning" stands for a default that is not one value.
`NAME` is a name that you choose.
"""
# Annotations of the values of keys; some of them are quantities.
ANNOTATIONS = (
    *vars(quantities).values(),
    *get_type_hints(ServoModel, include_extras=True).values(),
    *get_type_hints(Servoj, include_extras=True).values(),
)


def _quantities() -> Iterator[quantities.Quantity]:
    """Yield the quantities in the annotations, in their metadata and in that of their parts."""
    for annotation in ANNOTATIONS:
        for part in (annotation, *get_args(annotation)):
            for candidate in (annotation, *getattr(part, "__metadata__", ())):
                if isinstance(candidate, quantities.Quantity):
                    yield candidate


# Maps the example of a quantity to its SI unit. Quantities with equal examples have equal units,
# except for 10 deg, the example of revolute and prismatic joints.
UNITS = {x.example: x.unit for x in _quantities()} | {"10 deg": "rad, m"}
# A default value in the description of a key: code, or a number with its unit.
STATED_VALUE = r"(`[^`]+`|\d[\d.]*(?: ?(?:%|[a-z]+(?:/s)?))?)"
STATED_DEFAULT = re.compile(
    rf"[Bb]y default,? {STATED_VALUE}(?=[,;.]|$)|{STATED_VALUE},? (?:by|the) default"
)
# Words that show that a description states a default.
MENTIONED_DEFAULT = re.compile(r"\b[Bb]y default\b")
# Maps types of JSON to words.
WORDS = {
    "boolean": "true or false",
    "integer": "whole number",
    "string": "text",
    "number": "number",
}


def published() -> dict[Path, str]:
    """Return the text of each file that is generated from the keys of job files."""
    text = schema_text()
    tables = "\n\n".join(_tables(json.loads(text)))
    return {SCHEMA: text, FILE: text, PAGE: f"{HEAD}\n{tables}\n"}


def _tables(schema: dict[str, Any]) -> Iterator[str]:
    """Yield a table for each mapping of keys, from the outermost to the innermost.

    The heading of a table is the place where its mapping first occurs in a job file.
    """
    places = _places(schema)
    yield _key_table(schema, schema, places)
    for name, place in places.items():
        mapping = schema["$defs"][name]
        table = _key_table(mapping, schema, places)
        yield "\n\n".join([f"## `{place}`", mapping["description"], table])


def _key_table(mapping: dict[str, Any], schema: dict[str, Any], places: dict[str, str]) -> str:
    """Return the Markdown table of the keys of one mapping."""
    rows = ["| key | value | unit | default | meaning |", "|---|---|---|---|---|"]
    for key, value in mapping["properties"].items():
        values = " or ".join(dict.fromkeys(_values(value, places)))
        units = list(dict.fromkeys(UNITS[example] for example in _examples(value)))
        meaning = value.get("description") or _inner_description(value, schema)
        required = key in mapping.get("required", ())
        default = "required" if required else _default(value, units, meaning)
        cells = (
            f"`{key}`",
            values.replace(" or list", ", or list"),
            " or ".join(units),
            default,
            meaning,
        )
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def _inner_description(value: dict[str, Any], schema: dict[str, Any]) -> str:
    """Return the description of the mapping in a key that has no description itself."""
    _, name = next(iter(_inside(value, "")))
    return str(schema["$defs"][name]["description"])


def _places(schema: dict[str, Any]) -> dict[str, str]:
    """Map the schema name of each mapping of keys to the place where it first occurs.

    The order is breadth-first from the job file, so that outer mappings come first.
    """
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
    """Yield the allowed values of a key in words; "keys" links to the table of these keys."""
    if "$ref" in kind:
        place = places[_name_of(kind)]
        yield f"[keys](#{place.lower().replace('.', '')})"
    elif "enum" in kind or "const" in kind:
        yield from (f"`{x}`" for x in kind.get("enum", [kind.get("const")]))
    elif "examples" in kind:
        # A quantity is a plain number, or text such as its example.
        yield f"`{kind['examples'][0]}`"
    elif "anyOf" in kind:
        for x in kind["anyOf"]:
            yield from _values(x, places)
    elif kind.get("type") == "array":
        least = kind.get("minItems")
        count = f"{least} " if least and least == kind.get("maxItems") else ""
        yield f"list of {count}{' or '.join(dict.fromkeys(_values(kind['items'], places)))}"
    elif kind.get("type") == "object":
        yield f"by name: {' or '.join(dict.fromkeys(_values(_named(kind), places)))}"
    elif kind.get("type") in WORDS:
        yield WORDS[kind["type"]]


def _examples(kind: Any) -> Iterator[str]:
    """Yield the first example of each quantity in the schema of a key, without inner keys."""
    if isinstance(kind, dict):
        yield from kind.get("examples", ())[:1]
        for x in kind.values():
            yield from _examples(x)
    elif isinstance(kind, list):
        for x in kind:
            yield from _examples(x)


def _name_of(reference: dict[str, Any]) -> str:
    """Return the schema name to which a reference points."""
    return str(reference["$ref"]).rpartition("/")[2]


def _named(kind: dict[str, Any]) -> Any:
    """Return the schema of the values of a mapping whose keys the user names."""
    return next(iter(kind.get("patternProperties", {}).values()), kind.get("additionalProperties"))


def _default(kind: dict[str, Any], units: list[str], meaning: str) -> str:
    """Return the default of a key with its unit; without one in the schema, that of its meaning."""
    value = kind.get("default")
    if value in (None, "") or isinstance(value, dict | list):
        return _stated_default(meaning)
    if not isinstance(value, int | float) or isinstance(value, bool):
        return f"`{json.dumps(value).strip(chr(34))}`"
    has_unit = len(units) == 1 and units[0] not in ("1", UNITS["10 deg"]) and math.isfinite(value)
    unit = f" {units[0]}" if has_unit else ""
    return f"`{value:g}{unit}`"


def _stated_default(meaning: str) -> str:
    """Return the default that the description of a key states; empty if it states none."""
    stated = STATED_DEFAULT.search(meaning)
    if stated is not None:
        value = stated[1] or stated[2]
        return f"`{value.strip('`')}`"
    return "see meaning" if MENTIONED_DEFAULT.search(meaning) else ""


def _inside(kind: dict[str, Any], place: str) -> Iterator[tuple[str, str]]:
    """Yield the place and the schema name of each mapping that is a value of a key."""
    if "$ref" in kind:
        yield place, _name_of(kind)
    for x in kind.get("anyOf", ()):
        yield from _inside(x, place)
    if "items" in kind:
        yield from _inside(kind["items"], place)
    if kind.get("type") == "object":
        yield from _inside(_named(kind), f"{place}.NAME")


if __name__ == "__main__":
    for file, content in published().items():
        file.write_text(content, encoding="utf-8")
