"""Write the data of the Studio's settings form."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from typing import Any, TypeAlias

from tools.job_schema import schema_text

from armcontour.core.quantities import unit_of
from armcontour.core.text import Keys
from armcontour.files.drawings.path_reader import READERS, YAML
from armcontour.files.exports.formats import ENDINGS, format_named
from armcontour.files.file_keys import quantity_of
from armcontour.files.job_file import GEOMETRY_KEYS, cell_names
from armcontour.files.job_model import JobModel, RunModel, SharedModel
from armcontour.files.job_patch import MERGED, full_key
from armcontour.files.robots.arm_loading import arm_names
from armcontour.robot.limits import TOOL_LIMITS
from armcontour.studio.edits.keys import shown_unit
from armcontour.studio.slider_ranges import SLIDER_RANGES

# Keys in each group of the form. A key belongs to the group that lists the longest prefix of its
# key path.
GROUPS = {
    "Speed": (
        *(f"limits.{name}" for name in TOOL_LIMITS),
        *("process.rapid_speed", "process.approach_speed"),
    ),
    "Corners": ("corners", "accuracy"),
    "Process": (
        *("process.kerf", "process.kerf_side", "process.lead_in", "process.lead_out"),
        *("process.pierce", "process.tabs", "process.weave", "process"),
    ),
    "Tool and tilt": ("path.orientation", "arm.tool", "arm.payload"),
    "Arm and limits": ("arm", "limits", "seed", "start_from", "command_limits"),
    "Layers and order": (
        *("path.layers", "process.by_layer", "process.order"),
        *("process.direction", "process.begin", "process.passes", "path.names", "path.colors"),
        "process.only",
    ),
    "Part": ("path.frame", "path.repeat", "path.edges", "path"),
    "Servo": ("servo", "cycle", "plant"),
    "Run": ("timing", "compensation", "duration", "end_time", "speed_factor"),
    "Cell": ("scene",),
    "Name, certificate": ("name", "title", "certificate", "experiment"),
    "Export": ("export",),
}
# The fields of the mappings FLAT_MAPPINGS are shown directly in the group of the mapping. Of these
# fields, those named in MAPPING_LABELLED have the name of the mapping as their label.
FLAT_MAPPINGS = ("corners", "servo", "timing", "compensation")
MAPPING_LABELLED = {"method", "shape"}
# Names of fields on the page, if their key is also that of another field.
CALLED = {
    "arm.positioner.tilt": "tilt from gravity",
    "arm.tilt": "tilt from gravity (axes of the description)",
}
# Keys without a field: geometry, because the drawing defines it; contours and `runs`, because they
# have lists; and keys of the arm, because the arm has a single field.
OMITTED = (
    *(f"path.{x}" for x in (*GEOMETRY_KEYS, "file", "contours")),
    *("runs", "arm.name", "arm.file"),
)
# Matches the unit in a description.
UNIT = re.compile(r" \[([a-zN1][^\],]*)\]")
# Value of the key `corners` that the form shows as a choice of the field `shape`.
SHARP = "sharp"
# Values of entries that are omitted from the form data.
EMPTY: tuple[Any, ...] = ("", [], {})

Field: TypeAlias = dict[str, Any]


def form_text() -> str:
    """Return the form as JSON text, which the Studio's page reads at its start."""
    formats = []
    for name, ending in ENDINGS.items():
        format = format_named(name)
        what = "" if format.keeps_times else ", the plan only"
        formats.append([name, f"{name} ({ending}){what}", format.joints, format.keeps_times])
    form = {
        "groups": [{"title": title, "fields": x} for title, x in _groups().items()],
        "in_run": [x.name for x in fields(RunModel)],
        "shared": [x.name for x in fields(SharedModel)],
        "merged": MERGED,
        "cells": cell_names(),
        "drawings": sorted(READERS),
        "jobs": [*YAML, ".urdf"],
        "formats": sorted(formats, key=lambda x: x[2] is None),
    }
    return json.dumps(form, indent=0, separators=(",", ":"), ensure_ascii=False) + "\n"


def _groups() -> dict[str, list[Field]]:
    """Return each group's fields, by title; the entry `at` of a field is its key path."""
    # If groups list only some keys of a mapping, the other keys are in the group that lists the
    # mapping.
    schema = json.loads(schema_text())
    tree = _fields(schema, schema["$defs"])
    run = _fields(schema["$defs"]["RunModel"], schema["$defs"])
    tree += [x for x in run if x["name"] not in {y["name"] for y in tree}]
    ranges = {".".join(map(str, keys)): x for keys, x in SLIDER_RANGES.items()}
    # The plant has the gains of the servo, but no sliders.
    ranges |= {x.replace("servo", "plant"): y for x, y in ranges.items() if x.startswith("servo.")}
    for key, called in CALLED.items():
        _find_field(tree, key.split("."))["called"] = called
    for key in OMITTED:
        _remove_field(tree, key.split("."))
    listed = {key: title for title, keys in GROUPS.items() for key in keys}
    split = {key for key in listed if any(x.startswith(f"{key}.") for x in listed)} | {
        *FLAT_MAPPINGS
    }
    taken = {
        key: _remove_field(tree, key.split(".")) for key in sorted(listed, key=_depth, reverse=True)
    }
    assert not tree, f"no group has {', '.join(x['name'] for x in tree)}"
    groups: dict[str, list[Field]] = {title: [] for title in GROUPS}
    for key, title in listed.items():
        whole = {"at": key, **_add_ranges(taken[key], key, ranges)}
        _add_units(whole, tuple(key.split(".")))
        parts = whole.pop("fields") if key in split else []
        # A mapping with a short form, such as the arm, also has a field for the short form.
        if key not in split or "choices" in whole:
            groups[title].append(whole)
        for x in parts:
            called = (
                {"label": key} if key in FLAT_MAPPINGS and x["name"] in MAPPING_LABELLED else {}
            )
            groups[title].append({"at": f"{key}.{x['name']}", **x, **called})
    return groups


def _depth(key: str) -> int:
    """Count the mappings that contain a key."""
    return key.count(".")


def _add_ranges(field: Field, key: str, ranges: Mapping[str, tuple[float, float]]) -> Field:
    """Copy of a field, and of the fields inside it, with the usual ranges of quantities."""
    if key in ranges:
        return {**field, "usual": ranges[key]}
    inner = [_add_ranges(y, f"{key}.{y['name']}", ranges) for y in field.get("fields", ())]
    return {**field, "fields": inner} if inner else field


def _add_units(field: Field, keys: Keys) -> None:
    """Add `typed` to fields of quantities: the unit of a number that is typed without one.

    It applies to a key without a value; a value that is written has its own unit.
    """
    for inner in field.get("fields", ()):
        _add_units(inner, (*keys, inner["name"]))
    for inner in field.get("items", ()):
        _add_units(inner, (*keys, 0, inner["name"]))
    if "each" in field:
        _add_units(field["each"], (*keys, "name"))
    place = full_key((*keys, 0) if field.get("list") else keys)
    kind = quantity_of(JobModel, place)
    if kind is not None and kind.unit not in ("", "1"):
        field["typed"] = shown_unit(keys, kind) or unit_of(None, kind)[0]


def _find_field(tree: list[Field], keys: list[str]) -> Field:
    """Return the field at a key path in a tree of fields."""
    (field,) = (x for x in tree if x["name"] == keys[0])
    return _find_field(field["fields"], keys[1:]) if keys[1:] else field


def _remove_field(tree: list[Field], keys: list[str]) -> Field:
    """Remove the field at a key path from a tree of fields, and return it."""
    siblings = _find_field(tree, keys[:-1])["fields"] if keys[1:] else tree
    field = _find_field(siblings, keys[-1:])
    siblings.remove(field)
    return field


def _fields(schema: Mapping[str, Any], defs: Mapping[str, Any]) -> list[Field]:
    """Make the form fields of a mapping's keys, from its schema."""
    needed = schema.get("required", ())
    return [
        _field(name, x, defs) | ({"needed": True} if name in needed else {})
        for name, x in schema["properties"].items()
    ]


def _field(name: str, schema: Mapping[str, Any], defs: Mapping[str, Any]) -> Field:
    """Make a key's form field from its schema: name, text, unit, example, default, kind."""
    # Entries for the kind: `choices`; `fields` of a mapping; `each`, the field of the values of a
    # mapping by name; `items`, the fields of a list of mappings; `list`; `plain` for numbers
    # without units; `tick` for booleans; `open` if other values than the choices are allowed.
    parts = list(_alternatives(schema, defs))
    text = str(schema.get("description") or parts[0].get("description", ""))
    unit = UNIT.search(text)
    examples = [y for x in parts for y in x.get("examples", ())]
    types = {x.get("type") for x in parts} - {"null"}
    field: Field = {
        # The page shows plain text.
        "text": UNIT.sub("", text).replace("`", ""),
        "unit": unit[1] if unit and any(x.get("type") != "string" for x in parts) else "",
        "example": examples[0] if examples else "",
        "default": _form_default(schema.get("default")),
        "choices": _choices(parts),
        "open": any("enum" not in x and "const" not in x and "type" in x for x in parts) or None,
        "tick": types == {"boolean"} or None,
        "plain": (bool(types & {"number", "integer"}) and "string" not in types) or None,
    }
    for part in parts:
        items = list(_alternatives(part["items"], defs)) if "items" in part else []
        mapping = next((y for y in items if "properties" in y), None)
        if "properties" in part:
            field["fields"] = _fields(part, defs)
        elif isinstance(part.get("additionalProperties"), dict):
            field["each"] = _field("", part["additionalProperties"], defs)
        elif mapping is not None:
            field["items"] = _fields(mapping, defs)
        elif items:
            field["list"] = True
            field["plain"] = not any(y.get("type") == "string" for y in items) or None
    if name == "corners" and "fields" in field:
        field["choices"] = []
        shape = next(x for x in field["fields"] if x["name"] == "shape")
        shape["choices"] = [SHARP, *shape["choices"]]
    if name == "arm":
        field["choices"] = list(arm_names())
    entries = {key: x for key, x in field.items() if x is not None and x not in EMPTY}
    return {"name": name, **entries}


def _choices(alternatives: Iterable[Mapping[str, Any]]) -> list[Any]:
    """Return the values that a key's schema lists, over all alternatives."""
    values: list[Any] = []
    for schema in alternatives:
        values += schema.get("enum", ())
        if "const" in schema:
            values.append(schema["const"])
    return values


def _form_default(default: Any) -> Any:
    """Return the default for the form; None for a mapping, a list and infinity."""
    finite = not isinstance(default, float) or math.isfinite(default)
    return default if finite and not isinstance(default, dict | list) else None


def _alternatives(
    schema: Mapping[str, Any], defs: Mapping[str, Any]
) -> Iterator[Mapping[str, Any]]:
    """Yield a schema's alternatives, without null."""
    if "$ref" in schema:
        outer = {key: x for key, x in schema.items() if key != "$ref"}
        yield from _alternatives({**defs[schema["$ref"].rpartition("/")[2]], **outer}, defs)
        return
    if "anyOf" in schema:
        if "examples" in schema:
            yield {"examples": schema["examples"]}
        for part in schema["anyOf"]:
            yield from _alternatives(part, defs)
    elif schema.get("type") != "null":
        yield schema
