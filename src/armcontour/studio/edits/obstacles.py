"""Edits of obstacles: added, changed and removed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from armcontour.core import checks
from armcontour.files.job_edits import Change, Keys, value_at
from armcontour.studio.edits.keys import written
from armcontour.studio.edits.state import EditState
from armcontour.studio.handles import BODIES

# Keys of lists of obstacles by the names of their kinds.
BODY_KINDS = {
    "box": "boxes",
    "cylinder": "cylinders",
    "sphere": "spheres",
    "capsule": "capsules",
    "halfspace": "halfspaces",
    "mesh": "meshes",
}


def obstacle(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Add, change or remove an obstacle."""
    action = checks.check_choice("action", edit["action"], ("add", "change", "remove"))
    named = str(edit["kind"])
    kind = checks.check_choice("kind of obstacles", BODY_KINDS.get(named, named), BODIES)
    there = value_at(state.data, ("scene", kind)) or []
    if action == "add":
        new = {"name": _free_name(edit.get("name") or named, state)}
        keys: Keys = ("scene", kind, len(there))
        given = {key: written(x, None, (*keys, key)) for key, x in _body(edit).items()}
        return [Change(keys, {**new, **given}, insert=True)]
    index = checks.check_int("number of the obstacle", edit["index"], 0, len(there) - 1)
    keys = ("scene", kind, index)
    if action == "remove":
        return [Change(keys if len(there) > 1 else keys[:2])]
    fresh = {"name": edit["name"]} if "name" in edit else {}
    return [
        Change((*keys, key), written(x, there[index].get(key), (*keys, key)))
        for key, x in {**fresh, **_body(edit)}.items()
    ]


def _body(edit: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a body that an edit gives."""
    return {
        key: x for key, x in edit.items() if key not in ("do", "action", "kind", "index", "name")
    }


def _free_name(name: str, state: EditState) -> str:
    """A name that no other obstacle has."""
    scene = state.data.get("scene") or {}
    taken = {x.get("name") for kind in BODIES for x in scene.get(kind) or []}
    numbered = (name if k == 1 else f"{name} {k}" for k in range(1, len(taken) + 2))
    return next(x for x in numbered if x not in taken)
