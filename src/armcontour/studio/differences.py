"""Differences between two states of a job, as sentences for users."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.core.frames import to_rpy
from armcontour.core.render import number
from armcontour.core.text import Keys
from armcontour.files.file_keys import in_si
from armcontour.files.job_model import FrameModel
from armcontour.files.scene_file import rotation_of

# Value of a key that a job does not have.
MISSING = object()
FRAME: Keys = ("path", "frame")
OBSTACLES: Keys = ("scene", "obstacles")
LAYERS: Keys = ("path", "layers")
# Lists of the path's points, with their word for one entry.
POINT_LISTS: dict[Keys, str] = {
    ("path", "points"): "waypoint",
    ("path", "segments"): "segment",
}
# Mappings whose entries have a name that users know, with the word for one entry.
NAMED: dict[Keys, str] = {
    ("path", "contours"): "Contour",
    LAYERS: "Layer",
    ("process", "by_layer"): "Layer",
    ("runs",): "Run",
}
# Lists in an obstacle whose entries have a name.
PARTS = {"at": ("X", "Y", "Z"), "rpy": ("roll", "pitch", "yaw")}
# Largest number of values of an obstacle in a sentence.
MAX_BODY_CHANGES = 3
# Keys that are named by the mapping around them, such as the arm by its name.
NAMED_BY_OUTER = ("name", "method")
# Largest length of a value in a sentence [characters].
MAX_VALUE = 40
# Smallest displayed move [m] and turn [rad] of a part; smaller ones are rounding errors.
SMALLEST_MOVE = 1e-9
SMALLEST_TURN = 1e-9
ZERO = (0.0, 0.0, 0.0)
IDENTITY = np.eye(3)


def differences(
    before: Mapping[str, Any], after: Mapping[str, Any], layers: Sequence[str] = ()
) -> list[str]:
    """Describe each difference between the data of two states of a job.

    >>> differences({"limits": {"speed": "50 mm/s"}}, {"limits": {"speed": "40 mm/s"}})
    ['Speed 50 mm/s → 40 mm/s']

    Args:
        before: Keys and values of the earlier state, as written.
        after: Keys and values of the later state, as written.
        layers: Layers of the drawing. A job that lists no layers runs all of them.
    """
    sentences = [*_layer_switches(before, after, layers), *_differences((), before, after)]
    # A change of several contours' order is one change for users.
    return list(dict.fromkeys(sentences))


def _layer_switches(
    before: Mapping[str, Any], after: Mapping[str, Any], layers: Sequence[str]
) -> Iterator[str]:
    """Yield the layers that are run in one state only."""
    old = _run_layers(before, layers)
    new = _run_layers(after, layers)
    if not old or not new:
        # Without the drawing, the layers of a job that lists none are unknown.
        if old != new:
            yield f"Layers {', '.join(new)}" if new else "All layers on"
        return
    for name in dict.fromkeys([*old, *new]):
        if name not in new:
            yield f"Layer {name} off"
        elif name not in old:
            yield f"Layer {name} on"


def _run_layers(data: Mapping[str, Any], layers: Sequence[str]) -> list[str]:
    """Return the layers that a state runs, out of all layers of the drawing."""
    path = data.get("path")
    listed = path.get("layers") if isinstance(path, Mapping) else None
    if isinstance(listed, Mapping | list):
        return [str(x) for x in listed]
    return [*layers]


def _layer_values(listed: Any) -> dict[str, Any]:
    """Return the own values of each listed layer."""
    if isinstance(listed, list):
        return {str(name): {} for name in listed}
    return {str(k): x or {} for k, x in listed.items()} if isinstance(listed, Mapping) else {}


def _differences(keys: Keys, before: Any, after: Any) -> Iterator[str]:
    """Yield the differences between two values of a key; MISSING without a value."""
    if before is not MISSING and before == after:
        return
    if keys == FRAME:
        yield from _moves(before, after)
    elif keys == LAYERS:
        old_values = _layer_values(before)
        new_values = _layer_values(after)
        # Layers that are not run any more are named by `_layer_switches`.
        for name, values in new_values.items():
            yield from _differences((*keys, name), old_values.get(name, {}), values)
    elif keys == OBSTACLES:
        yield from _obstacles(before, after)
    elif keys in POINT_LISTS and isinstance(before, Sequence) and isinstance(after, Sequence):
        yield _points(POINT_LISTS[keys], before, after)
    elif keys[:2] == ("path", "contours") and keys[3:] == ("order",):
        yield "Order of the contours"
    elif _is_walked(keys, before, after):
        old = before if isinstance(before, Mapping) else {}
        new = after if isinstance(after, Mapping) else {}
        for key in {**old, **new}:
            old_value = old.get(key, MISSING)
            yield from _differences((*keys, key), old_value, new.get(key, MISSING))
    else:
        yield _sentence(keys, before, after)


def _is_walked(keys: Keys, before: Any, after: Any) -> bool:
    """Return whether a key's entries are described one by one."""
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        return True
    # An outer mapping that appears or goes has a name for users only through its entries.
    present = after if before is MISSING else before
    is_changed = before is MISSING or after is MISSING
    is_outer = len(keys) < 2 or keys in NAMED or keys[:-1] in NAMED and keys[:-1] != ("runs",)
    return is_changed and isinstance(present, Mapping) and bool(present) and is_outer


def _sentence(keys: Keys, before: Any, after: Any) -> str:
    """Describe the change of one value."""
    name = _called(keys)
    if before is MISSING:
        # An added run is a copy, so its values are not what has changed.
        value = "" if keys[:-1] == ("runs",) else _text(after)
        return f"{name} {value}" if value else f"{name} added"
    if after is MISSING:
        return f"{name} removed"
    old = _text(before)
    new = _text(after)
    return f"{name} {old} → {new}" if old and new else f"{name} changed"


def _called(keys: Keys) -> str:
    """Name a key for users: what it belongs to, and its last names."""
    for count in range(len(keys) - 1, 0, -1):
        word = NAMED.get(keys[:count])
        if word is not None:
            inner_keys = keys[count + 1 :]
            inner = " ".join(_words(x) for x in inner_keys)
            if inner_keys and word == "Run":
                # The values of a run have the names that those of the job have.
                inner = _called(inner_keys)
                inner = inner[:1].lower() + inner[1:]
            return f"{word} {keys[count]}{f', {inner}' if inner else ''}"
    if len(keys) > 1 and keys[-1] in NAMED_BY_OUTER:
        keys = keys[:-1]
    names = [_words(x) for x in keys[-2:] if not isinstance(x, int)]
    # The outer name is needed only where the last one says little, as in "tabs width".
    is_inner = len(keys) > 2
    words = " ".join(names if is_inner else names[-1:])
    return words[:1].upper() + words[1:]


def _words(key: Any) -> str:
    """Write a key as words."""
    return str(key).replace("_", " ")


def _text(value: Any) -> str:
    """Write a value as it is in the file; empty for a nested or long one."""
    if isinstance(value, Mapping):
        return _mapping_text(value)
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "on" if value else "off"
    text = str(value)
    if isinstance(value, list):
        is_flat = not any(isinstance(x, list | Mapping) for x in value)
        text = ", ".join(map(str, value)) if is_flat else ""
    return text if len(text) <= MAX_VALUE else ""


def _mapping_text(mapping: Mapping[str, Any]) -> str:
    """Write the keys and values of a mapping, such as "width 2 mm"; empty if they are long."""
    parts = []
    for key, value in mapping.items():
        text = "" if isinstance(value, Mapping) else _text(value)
        if not text:
            return ""
        parts.append(text if key == "name" else f"{_words(key)} {text}")
    line = ", ".join(parts)
    return line if len(line) <= MAX_VALUE else ""


def _moves(before: Any, after: Any) -> Iterator[str]:
    """Yield how the part has moved along each axis and turned about its z axis."""
    old = _frame(before)
    new = _frame(after)
    if old is None or new is None:
        yield "Part moved"
        return
    for axis, x, y in zip("XYZ", old.get("position", ZERO), new.get("position", ZERO), strict=True):
        if abs(y - x) > SMALLEST_MOVE:
            yield f"Part {axis} {_signed(y - x, 'm')}"
    try:
        turn = to_rpy(_rotation(new) @ _rotation(old).T)
    except InvalidInput:
        yield "Part turned"
        return
    if max(abs(turn)) <= SMALLEST_TURN:
        return
    is_about_z = max(abs(turn[:2])) <= SMALLEST_TURN
    yield f"Part turned {_signed(float(turn[2]), 'rad')}" if is_about_z else "Part turned"


def _frame(written: Any) -> dict[str, Any] | None:
    """Return a written frame in SI units; None if it is not valid."""
    data = {} if written is MISSING or written is None else written
    if not isinstance(data, Mapping):
        return None
    frame = in_si(dict(data), FrameModel)
    position = frame.get("position") or [*ZERO]
    position = [*position, 0.0] if len(position) == 2 else position
    numbers = [*position, *(frame.get("rpy") or ())]
    if len(position) != 3 or not all(_is_number(x) for x in numbers):
        return None
    return {**frame, "position": position}


def _rotation(frame: Mapping[str, Any]) -> Any:
    """Return the rotation matrix of a frame in SI units."""
    keys = {x: frame[x] for x in ("rpy", "quaternion") if x in frame}
    rotation = rotation_of("path.frame", FrameModel(**keys))
    return IDENTITY if rotation is None else rotation


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _signed(value: float, unit: str) -> str:
    """Write a change with its sign and its display unit."""
    text = number(value, unit)
    return text.replace("-", "−") if value < 0 else f"+{text}"


def _obstacles(before: Any, after: Any) -> Iterator[str]:
    """Yield the obstacles that were added, removed or changed, by their names."""
    old = _by_name(before)
    new = _by_name(after)
    for name in {**old, **new}:
        if name not in new:
            yield f"Obstacle {name} removed"
        elif name not in old:
            yield f"Obstacle {name} added"
        elif old[name] != new[name]:
            changes = list(_body_changes(old[name], new[name]))
            said = ", ".join(changes) if 0 < len(changes) <= MAX_BODY_CHANGES else "changed"
            yield f"Obstacle {name}: {said}"


def _body_changes(before: Any, after: Any) -> Iterator[str]:
    """Yield the changed values of an obstacle: coordinates and angles one by one."""
    if not isinstance(before, Mapping) or not isinstance(after, Mapping):
        return
    for key in {**before, **after}:
        old = before.get(key, MISSING)
        new = after.get(key, MISSING)
        if old == new:
            continue
        names = PARTS.get(key, ())
        if key == "allow":
            yield from _touches(old, new)
        elif _has_parts(old, names) and _has_parts(new, names):
            for name, x, y in zip(names, old, new, strict=True):
                if x != y:
                    yield f"{name} {x} → {y}"
        else:
            sentence = _sentence((key,), old, new)
            yield sentence[:1].lower() + sentence[1:]


def _has_parts(value: Any, names: Sequence[str]) -> bool:
    """Return whether a value is a list with one entry per name."""
    return isinstance(value, list) and bool(names) and len(value) == len(names)


def _touches(before: Any, after: Any) -> Iterator[str]:
    """Yield the bodies that may touch an obstacle in one state only."""
    old = before if isinstance(before, list) else []
    new = after if isinstance(after, list) else []
    for name in dict.fromkeys([*old, *new]):
        if name not in old:
            yield f"may touch {name}"
        elif name not in new:
            yield f"may no longer touch {name}"


def _by_name(bodies: Any) -> dict[str, Any]:
    """Return a list's bodies by name, or by number without one."""
    if not isinstance(bodies, list):
        return {}
    named: dict[str, Any] = {}
    for k, body in enumerate(bodies):
        name = body.get("name") if isinstance(body, Mapping) else None
        named[str(name or k + 1)] = body
    return named


def _points(word: str, before: Sequence[Any], after: Sequence[Any]) -> str:
    """Describe the change of a list of waypoints or segments."""
    more = len(after) - len(before)
    if more:
        count = abs(more)
        return f"{count} {word}{'s' if count > 1 else ''} {'added' if more > 0 else 'removed'}"
    moved = [k + 1 for k, (x, y) in enumerate(zip(before, after, strict=True)) if x != y]
    if len(moved) == 1:
        return f"{word.capitalize()} {moved[0]} moved"
    return f"{len(moved)} {word}s moved"
