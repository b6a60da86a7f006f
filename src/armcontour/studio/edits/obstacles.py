"""Edits of the obstacles: bodies that are added, changed and removed, and pairs that may touch."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import exp, quaternions, rotations
from armcontour.core.quantities import write_like
from armcontour.core.text import Keys, show
from armcontour.files.file_keys import in_si
from armcontour.files.job_text_edits import Change, value_at
from armcontour.files.scene_file import SceneModel
from armcontour.robot.scene import PART, Scene
from armcontour.studio.edits.keys import format_value
from armcontour.studio.handles import ANGLE, EditState

OBSTACLES: Keys = ("scene", "obstacles")
# Key of the bodies of a CAD model.
MODEL: Keys = ("scene", "model")
# Keys of an edit that are no keys of a body.
NO_BODY_KEYS = ("do", "action", "type", "index", "name", "turn")
# Maximum rounding error of written angles [rad].
EXACT_ANGLE = 1e-14


def obstacle(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that add, change or remove an obstacle.

    `turn` rotates a changed obstacle about its origin and the z axis of its reference frame [rad].
    """
    action = checks.check_choice("action", edit["action"], ("add", "change", "remove"))
    bodies = value_at(state.data, OBSTACLES) or []
    if action == "add":
        name = _free_name(edit.get("name") or edit["type"], bodies)
        new = {"type": edit["type"], "name": name, **_body(edit)}
        index = len(bodies)
        values = {key: format_value(x, None, (*OBSTACLES, index, key)) for key, x in new.items()}
        return [Change((*OBSTACLES, index), values, insert=True)]
    index = checks.check_int("number of the obstacle", edit["index"], 0, len(bodies) - 1)
    keys = (*OBSTACLES, index)
    if action == "remove":
        return [Change(keys if len(bodies) > 1 else OBSTACLES)]
    fresh = {"name": edit["name"]} if "name" in edit else {}
    changes = [
        Change((*keys, key), format_value(x, bodies[index].get(key), (*keys, key)))
        for key, x in {**fresh, **_body(edit)}.items()
    ]
    turn = checks.check_number("turn", edit.get("turn", 0.0), "rad")
    return changes if turn == 0 else [*changes, _turned(keys, turn, state)]


def _turned(keys: Keys, turn: float, state: EditState) -> Change:
    """Rotate an obstacle about the z axis of its reference frame; other angles stay as written."""
    written = value_at(state.data, keys)
    si = in_si(value_at(state.data, ("scene",)), SceneModel)["obstacles"][keys[-1]]
    if si.get("normal") is not None:
        raise InvalidInput(
            f"{show(written['name'])} has a normal, so it cannot be turned. Change its normal."
        )
    if si.get("quaternion") is not None:
        rotation = rotations("quaternion", si["quaternion"])
        new = quaternions(exp([0.0, 0.0, turn]) @ rotation).tolist()
        return Change((*keys, "quaternion"), new)
    # The yaw is the last rotation, so that only it changes.
    yaw = (si.get("rpy") or [0.0, 0.0, 0.0])[2]
    texts = written.get("rpy") or ["0 deg", "0 deg", "0 deg"]
    new_yaw = math.remainder(yaw + turn, 2 * math.pi)
    text = write_like(new_yaw, texts[2], ANGLE, within=EXACT_ANGLE)
    return Change((*keys, "rpy"), [*texts[:2], text])


def allow(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that let the two `bodies` touch: an obstacle and a link or the tool.

    For a part of a CAD model, the link may touch all parts of the model.
    """
    bodies: Any = edit["bodies"]
    is_pair = isinstance(bodies, list) and len(bodies) == 2
    if not is_pair or not all(isinstance(x, str) for x in bodies):
        raise InvalidInput(f"bodies must be a list of two names, but is {show(bodies)}.")
    found = _allowing_keys(bodies, state)
    if found is None:
        raise InvalidInput(
            f"{bodies[0]} and {bodies[1]} cannot be allowed to touch, because neither is an "
            "obstacle of the job. Change the path or the posture of the arm."
        )
    keys, link = found
    names = value_at(state.data, (*keys, "allow")) or []
    if link in names:
        return []
    if keys == MODEL and not isinstance(value_at(state.data, MODEL), Mapping):
        return [Change(MODEL, {"allow": [link]})]
    return [Change((*keys, "allow"), [*names, link])]


def part_names(data: Mapping[str, Any], scene: Scene | None) -> list[str]:
    """Return the names of the parts of a CAD model, which are obstacles that the file lacks."""
    written = {x.get("name") for x in value_at(data, OBSTACLES) or []}
    obstacles = () if scene is None else scene.obstacles
    return [x.name for x in obstacles if x.fixed_to == PART and x.name not in written]


def _allowing_keys(bodies: Sequence[str], state: EditState) -> tuple[Keys, str] | None:
    """Return the keys of the body that can allow the other one to touch it, and the other's name.

    None if neither body is an obstacle of the job.
    """
    names = [x.get("name") for x in value_at(state.data, OBSTACLES) or []]
    parts = part_names(state.data, state.handles.job.scene)
    first, second = bodies
    for body, other in ((first, second), (second, first)):
        if body in names:
            return (*OBSTACLES, names.index(body)), other
    for body, other in ((first, second), (second, first)):
        if body in parts:
            return MODEL, other
    return None


def _body(edit: Mapping[str, Any]) -> dict[str, Any]:
    """Return the body's keys in an edit, such as its size and pose."""
    return {key: x for key, x in edit.items() if key not in NO_BODY_KEYS}


def _free_name(name: str, bodies: Iterable[Mapping[str, Any]]) -> str:
    """Return a name that no body has: the name itself, or the name with a number from 2."""
    used_names = {x.get("name") for x in bodies}
    numbered = (name if k == 1 else f"{name} {k}" for k in range(1, len(used_names) + 2))
    return next(x for x in numbered if x not in used_names)
