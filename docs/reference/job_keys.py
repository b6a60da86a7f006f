"""Write what is published of the keys of job files: `python -m docs.reference.job_keys`.

The JSON Schema goes to docs/reference/job.schema.json, tables of all keys to docs/guides/job.md,
between the two comments that START and END are.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from armcontour.io import json_schema

DOCS = Path(__file__).parents[1]
SCHEMA, GUIDE = DOCS / "reference" / "job.schema.json", DOCS / "guides" / "job.md"
START, END = "<!-- keys: make schema writes what follows -->", "<!-- end of the keys -->"
WORDS = {
    "boolean": "true or false",
    "integer": "whole number",
    "string": "text",
    "number": "number",
}


def published() -> dict[Path, str]:
    """The text of every file that is published of the keys."""
    schema = json_schema()
    page = GUIDE.read_text(encoding="utf-8")
    before, _, rest = page.partition(START)
    _, _, after = rest.partition(END)
    tables = "\n\n".join(_tables(schema))
    return {
        SCHEMA: json.dumps(schema, indent=2) + "\n",
        GUIDE: f"{before}{START}\n\n{tables}\n\n{END}{after}",
    }


def _tables(schema: dict[str, Any]) -> Iterator[str]:
    """A table per mapping of keys, from the outside in, under the place where it first stands."""
    left, seen = [("", schema)], [schema.get("title")]
    while left:
        place, kind = left.pop(0)
        if place:
            yield f"### `{place}`"
        yield kind["description"]
        rows = ["| key | value | default | what it holds |", "|---|---|---|---|"]
        for key, value in kind["properties"].items():
            inner_kinds = list(_inside(value, f"{place}.{key}" if place else key))
            # What says no more than the description of its keys is left out of the schema.
            texts = [schema["$defs"][x]["description"] for _, x in inner_kinds]
            cells = (
                f"`{key}`",
                " or ".join(dict.fromkeys(_values(value))).replace(" or list", ", or list"),
                "needed" if key in kind.get("required", ()) else _default(value),
                value.get("description") or texts[0],
            )
            rows.append(f"| {' | '.join(cells)} |")
            for name, inner in inner_kinds:
                if inner not in seen:
                    seen.append(inner)
                    left.append((name, schema["$defs"][inner]))
        yield "\n".join(rows)


def _values(kind: dict[str, Any]) -> Iterator[str]:
    """What a key may hold, in words."""
    if "$ref" in kind:
        yield "keys"
    elif "enum" in kind or "const" in kind:
        yield from (f"`{x}`" for x in kind.get("enum", [kind.get("const")]))
    elif "examples" in kind:
        # A quantity: a plain number, or such text.
        yield f"`{kind['examples'][0]}`"
    elif "anyOf" in kind:
        for x in kind["anyOf"]:
            yield from _values(x)
    elif kind.get("type") == "array":
        number = kind.get("minItems")
        many = f"{number} " if number and number == kind.get("maxItems") else ""
        yield f"list of {many}{' or '.join(dict.fromkeys(_values(kind['items'])))}"
    elif kind.get("type") == "object":
        yield f"by name: {' or '.join(dict.fromkeys(_values(_named(kind))))}"
    elif kind.get("type") in WORDS:
        yield WORDS[kind["type"]]


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
        yield place, kind["$ref"].rpartition("/")[2]
    for x in kind.get("anyOf", ()):
        yield from _inside(x, place)
    if "items" in kind:
        yield from _inside(kind["items"], place)
    if kind.get("type") == "object":
        yield from _inside(_named(kind), f"{place}.NAME")


if __name__ == "__main__":
    for file, text in published().items():
        file.write_text(text, encoding="utf-8")
        print(file.relative_to(DOCS.parent))
