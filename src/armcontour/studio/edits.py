"""Named edits of the page as changes of keys of the job file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._numbers import plain_number
from armcontour._quantities import Quantity
from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.frames import exp, quaternions, to_rpy
from armcontour.io.job_edits import Change, Key, Keys, value_at
from armcontour.io.job_file import COMPENSATION_OPTIONS, TIMING_OPTIONS
from armcontour.io.job_model import FrameModel, JobModel
from armcontour.io.si_data import in_si, quantity_of
from armcontour.io.units import unit_of, write_like
from armcontour.jobs import Job, Run
from armcontour.studio.converting import waypoint_changes
from armcontour.studio.handles import (
    BODIES,
    CENTER,
    END,
    EXACT,
    LENGTH,
    POINT,
    POINTS,
    SEGMENTS,
    SPLINE,
    VIA,
    Handles,
    Waypoint,
)

SHARP = "sharp"
# The tolerance of corners that were sharp before.
FIRST_TOLERANCE = "1 mm"
# What an edit says in words.
TEXTS = ("name", "action", "kind")
# Largest number of a waypoint.
MOST_POINTS = 10_000_000
# Keys of lists of obstacles by the names of their kinds.
BODY_KINDS = {
    "box": "boxes",
    "cylinder": "cylinders",
    "sphere": "spheres",
    "capsule": "capsules",
    "halfspace": "halfspaces",
    "mesh": "meshes",
}
ANGLE = Quantity("rad", "90 deg")
# Angles are written with the fewest digits that are this exact [rad].
EXACT_ANGLE = 1e-14
# Keys that a run has in the place of the job's; all others of a run are its own alone.
OF_BOTH = ("limits", "corners", "command_interval")
OF_RUN = ("timing", "compensation", "until", "duration", "smoothing")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EditState:
    """What an edit is made on.

    Args:
        data: The data of the job file, as written.
        run: The name of the run that is shown.
        handles: What can be grabbed of the job.
    """

    data: Mapping[str, Any]
    run: str
    handles: Handles


def changes_of(edit: Mapping[str, Any], state: EditState) -> tuple[Change, ...]:
    """The changes of keys that an edit makes.

    Args:
        edit: The edit; `do` says which.
        state: What it is made on.

    Raises:
        InvalidInput: There is no such edit, it lacks something, or the job does not allow it.
    """
    do = edit.get("do")
    if not isinstance(do, str) or do not in EDITS:
        raise InvalidInput(f"There is no edit {show(do)}: the edits are {', '.join(EDITS)}.")
    for name in TEXTS:
        if not isinstance(edit.get(name, ""), str):
            raise InvalidInput(f"The edit {do} needs text for {name}, not {show(edit[name])}.")
    try:
        return tuple(EDITS[do](edit, state))
    except KeyError as error:
        raise InvalidInput(f"The edit {do} lacks {error.args[0]}.") from None


def place_of(key: str | Sequence[Key], data: Mapping[str, Any], run: str) -> Keys:
    """The keys at which a value of the job is set, for the run that is shown.

    A key of the run goes to the run. Limits, corners and the command interval go to the run if it
    has them itself, else to the job.

    Args:
        key: The key, such as "limits.speed" or "timing.method".
        data: The data of the job file, as written.
        run: The name of the run.

    Raises:
        InvalidInput: It is no key.
    """
    parts: Any = key.split(".") if isinstance(key, str) else key
    known = isinstance(parts, list) and all(type(x) in (str, int) for x in parts)
    if not known or not parts or "" in parts:
        raise InvalidInput(f"{show(key)} is no key: write one such as limits.speed.")
    first = parts[0]
    if first in OF_RUN or (first in OF_BOTH and _is_own(parts, data, run)):
        parts = ["runs", run, *parts]
    return _with_positions(parts, data)


def _is_own(parts: Sequence[Key], data: Mapping[str, Any], run: str) -> bool:
    """Whether a run has a value of its own in the place of the job's."""
    own = (data["runs"].get(run) or {}).get(parts[0])
    if parts[0] == "limits" and len(parts) > 1:
        return isinstance(own, dict) and parts[1] in own
    return own is not None


def _with_positions(parts: Sequence[Key], data: Any) -> Keys:
    """Keys of which those that are numbers are so, unless the data have such a text as a key."""
    found: list[Key] = []
    for x in parts:
        named = isinstance(data, dict) and x in data
        key = int(x) if isinstance(x, str) and x.isdecimal() and not named else x
        found.append(key)
        inside = isinstance(data, dict) and key in data
        if isinstance(data, list):
            inside = isinstance(key, int) and 0 <= key < len(data)
        data = data[key] if inside else None
    return tuple(found)


def _set(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Set a key, to a text as typed, a number in SI units, or null."""
    keys, value = place_of(edit["key"], state.data, state.run), edit["value"]
    if keys[-2:] == ("corners", "shape"):
        return _set_shape(keys, value, state)
    joint, of = keys[-1], value_at(state.data, keys[:-1])
    if isinstance(joint, int) and not isinstance(of, list | dict):
        return [Change(keys[:-1], _for_joints(keys, value, of, state))]
    changes = [Change(keys, _written(value, value_at(state.data, keys), keys))]
    for name, options in (("timing", TIMING_OPTIONS), ("compensation", COMPENSATION_OPTIONS)):
        if keys[-2:] == (name, "method"):
            # What goes with another method would be refused.
            others = (x for x, method in options.items() if method != value)
            there = value_at(state.data, keys[:-1]) or {}
            changes += [Change((*keys[:-1], x)) for x in others if x in there]
    return changes


def _set_shape(keys: Keys, shape: Any, state: EditState) -> list[Change]:
    """Set the shape of the corners, of which sharp ones are no shape in the file."""
    own = value_at(state.data, keys[:-1])
    if shape == SHARP:
        return [Change(keys[:-1], SHARP)]
    if isinstance(own, dict):
        return [Change(keys, shape)]
    return [Change(keys[:-1], {"shape": shape, "tolerance": FIRST_TOLERANCE})]


def _for_joints(keys: Keys, value: Any, old: Any, state: EditState) -> list[Any]:
    """One value per joint, where there was one for all: one of them is new.

    Raises:
        InvalidInput: The key has no values of joints, or there is no such joint.
    """
    *outer, joint = keys
    now = joint_values(tuple(outer), state.handles.job, state.run)
    if now is None:
        raise InvalidInput(f"{'.'.join(map(str, outer))} has no values of single joints.")
    _checks.whole("number of the joint", joint, 0, len(now) - 1)
    si = [value if k == joint else float(x) for k, x in enumerate(now)]
    return [_written(x, old, (*outer, k)) for k, x in enumerate(si)]


def joint_values(keys: Keys, job: Job, run: str) -> FloatArray | None:
    """The values of all joints for limits and gains of a run in SI units, (dof,); None for others.

    Args:
        keys: The keys, such as limits and joint_velocity, or servo and kp.
        job: The job.
        run: The name of the run.
    """
    sources: dict[Key, Any] = {"limits": run_of(job, run).limits, "servo": job.servo}
    found = getattr(sources.get(keys[-2]), str(keys[-1]), None) if len(keys) > 1 else None
    return found if isinstance(found, np.ndarray) and found.shape == (job.arm.dof,) else None


def run_of(job: Job, name: str) -> Run:
    """The run of a job with a name.

    Raises:
        InvalidInput: There is no such run.
    """
    for x in job.runs:
        if x.name == name:
            return x
    raise InvalidInput(f"The job has no run {show(name)}.")


def _written(value: Any, old: Any, keys: Keys) -> Any:
    """A value of a key, in the form in which the old one is written.

    A number without a unit that somebody typed has the unit of the old value.
    """
    if isinstance(value, list):
        olds = old if isinstance(old, list) and len(old) == len(value) else [old] * len(value)
        pairs = enumerate(zip(value, olds, strict=True))
        return [_written(x, was, (*keys, k)) for k, (x, was) in pairs]
    kind = quantity_of(JobModel, keys)
    if kind is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        number = plain_number(value)
        return value if number is None else _typed(value.strip(), old, kind)
    if isinstance(value, int | float):
        _checks.number(".".join(map(str, keys)), value, kind.unit)
        like = old if isinstance(old, int | float | str) and not isinstance(old, bool) else None
        return write_like(float(value), like, kind)
    return value


def _typed(number: str, old: Any, kind: Quantity) -> Any:
    """A number that was typed without a unit, with the unit that the old value has."""
    if isinstance(old, int | float) and not isinstance(old, bool):
        return float(number)
    return f"{number} {unit_of(old, kind)[0]}"


def _unset(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Remove a key."""
    return [Change(place_of(edit["key"], state.data, state.run))]


def _move_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Move a point to a place in the picture; with `step` to one whose digits are round."""
    point = _waypoint(edit, state)
    within = EXACT
    if edit.get("step") is not None:
        within = max(EXACT, _checks.not_negative("step", edit["step"], "m") / 2)
    new = state.handles.to_file(_uv("to", edit["to"]), point, within=within)
    return _coordinates(point.keys, point.written, new)


def _set_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Set the coordinates of a point, as typed."""
    point = _waypoint(edit, state)
    given = edit["value"]
    if not isinstance(given, list) or len(given) != len(point.written):
        raise InvalidInput(
            f"Waypoint {point.index + 1} has {len(point.written)} coordinates, not {show(given)}."
        )
    new = [
        _written(x, old, (*point.keys, k))
        for k, (x, old) in enumerate(zip(given, point.written, strict=True))
    ]
    return _coordinates(point.keys, point.written, new)


def _coordinates(keys: Keys, old: Sequence[Any], new: Sequence[Any]) -> list[Change]:
    """The changes of those coordinates that are different."""
    pairs = enumerate(zip(old, new, strict=True))
    return [Change((*keys, k), x) for k, (was, x) in pairs if x != was or type(x) is not type(was)]


def _insert_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Insert a point, which gets a number in the order of the path."""
    handles, index = _editable(state), edit["index"]
    ends = handles.ends
    _checks.whole("number of the waypoint", index, 0, len(ends))
    beside = ends[min(index, len(ends) - 1)]
    if beside.role == END:
        beside = next(x for x in reversed(ends[: beside.index]) if x.role == POINT)
    at = list(handles.to_file(_uv("at", edit["at"]), beside))
    if handles.kind == SEGMENTS:
        changes = _insert_segment(index, at, state)
    else:
        changes = [Change((*_list_of(handles), index), at, insert=True)]
    like = min(index, len(ends) - 1)
    return [*changes, *_insert_orientation(index, like, state), *_renumbered(index, 1, state)]


def _insert_segment(index: int, at: list[Any], state: EditState) -> list[Change]:
    """Insert a point between segments: the line that goes there becomes two."""
    path = state.data["path"]
    segments = path[SEGMENTS]
    if index == 0:
        line = {"to": path["start"]}
        return [Change(("path", "start"), at), Change(("path", SEGMENTS, 0), line, insert=True)]
    if index > len(segments):
        return [Change(("path", SEGMENTS, len(segments)), {"to": at}, insert=True)]
    parted = segments[index - 1]
    if parted.get(VIA) is not None or parted.get(CENTER) is not None:
        raise InvalidInput(
            f"Segment {index} is an arc, which takes no more points: move its end or the point "
            "that it goes through."
        )
    return [Change(("path", SEGMENTS, index - 1), {**parted, "to": at}, insert=True)]


def _remove_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Remove a point at the end of a segment."""
    handles, point = _editable(state), _waypoint(edit, state, computed=True)
    if point.role not in (POINT, END):
        raise InvalidInput(
            f"Waypoint {point.index + 1} is the {point.role} point of an arc, which needs it: "
            "remove the end of the arc."
        )
    index, ends = point.index, handles.ends
    if len(ends) <= 2:
        raise InvalidInput("A path needs two points, so that none of them can be removed.")
    if handles.kind != SEGMENTS:
        changes = [Change((*_list_of(handles), index))]
    elif index > 0:
        changes = [Change(("path", SEGMENTS, index - 1))]
    else:
        first = state.data["path"][SEGMENTS][0].get("to")
        if first is None:
            raise InvalidInput(
                "The path starts with an arc around a centre, so that its first point cannot be "
                "removed: move it."
            )
        changes = [Change(("path", "start"), first), Change(("path", SEGMENTS, 0))]
    orientation = value_at(state.data, ("path", "orientation"))
    if isinstance(orientation, list) and index < len(orientation):
        changes.append(Change(("path", "orientation", index)))
    return [*changes, *_renumbered(index, -1, state)]


def _insert_orientation(index: int, like: int, state: EditState) -> list[Change]:
    """The orientation of a new point, which is that of one beside it."""
    given = value_at(state.data, ("path", "orientation"))
    if not isinstance(given, list) or like >= len(given):
        return []
    return [Change(("path", "orientation", index), given[like], insert=True)]


def _renumbered(index: int, by: int, state: EditState) -> list[Change]:
    """The tolerances of single corners, by the new numbers of waypoints from one on."""
    changes = []
    runs = (("runs", name, "corners", "at") for name in state.data["runs"])
    for keys in (("corners", "at"), *runs):
        given = value_at(state.data, keys)
        if not isinstance(given, dict):
            continue
        # The waypoint that is removed has the number index + 1.
        kept = {k: x for k, x in given.items() if by > 0 or k != index + 1}
        new = {k + by if k > index else k: x for k, x in kept.items()}
        if new != given:
            changes.append(Change(keys, new) if new else Change(keys))
    return changes


def _corner_tolerance(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Set the tolerance of one corner; null takes it away."""
    if edit["index"] is None:
        raise InvalidInput(
            "This corner is at no waypoint of a path of one contour, so that it cannot have a "
            "tolerance of its own: set that of all corners."
        )
    index = _checks.whole("number of the waypoint", edit["index"], 0, MOST_POINTS)
    keys = place_of(["corners", "at"], state.data, state.run)
    key: Keys = (*keys, index + 1)
    given = value_at(state.data, keys)
    if edit["value"] is None:
        alone = isinstance(given, dict) and set(given) == {index + 1}
        return [Change(keys if alone else key)]
    like = value_at(state.data, key)
    if like is None:
        like = value_at(state.data, (*keys[:-1], "tolerance"))
    return [Change(key, _written(edit["value"], like, key))]


def _place(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Move and turn the part in the plane of the picture."""
    plane, own = state.handles.plane, state.handles.frame
    by, about = _uv("by", edit.get("by", [0, 0])), _uv("about", edit.get("about", [0, 0]))
    turn = _checks.number("turn", edit.get("turn", 0.0), "rad")
    turned = exp(turn * plane.normal)
    pivot = plane.lift(about)
    position = pivot + turned @ (own.position - pivot) + plane.lift(by) - plane.origin
    given = value_at(state.data, ("path", "frame")) or {}
    changes = _vector(("path", "frame", "position"), position, own.position, given, LENGTH, EXACT)
    if turn == 0:
        return changes
    if given.get("quaternion") is not None:
        new = quaternions(turned @ own.rotation).tolist()
        return [*changes, Change(("path", "frame", "quaternion"), new)]
    before = to_rpy(own.rotation)
    angles = to_rpy(turned @ own.rotation)
    if abs(plane.normal[2]) == 1:
        # Yaw is the last rotation, so that the other angles stay, also where they are not unique.
        before = np.array(in_si(given, FrameModel).get("rpy") or [0.0, 0.0, 0.0])
        yaw = math.remainder(before[2] + turn * plane.normal[2], 2 * math.pi)
        angles = np.append(before[:2], yaw)
    keys: Keys = ("path", "frame", "rpy")
    return [*changes, *_vector(keys, angles, before, given, ANGLE, EXACT_ANGLE)]


def _vector(
    keys: Keys,
    new: FloatArray,
    old: FloatArray,
    given: Mapping[str, Any],
    kind: Quantity,
    within: float,
) -> list[Change]:
    """The changes of a vector of three quantities that a mapping has under the last of its keys."""
    written = given.get(str(keys[-1]))
    if written is None:
        return [Change(keys, [write_like(float(x), None, kind, within=within) for x in new])]
    return [
        Change((*keys, k), write_like(float(new[k]), x, kind, within=within))
        for k, x in enumerate(written)
        if abs(new[k] - old[k]) > within
    ]


def _to_waypoints(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Make the contour of a drawing points or segments of the job."""
    return waypoint_changes(state.handles, state.data)


def _obstacle(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Add, change or remove an obstacle."""
    action = _checks.choice("action", edit["action"], ("add", "change", "remove"))
    named = str(edit["kind"])
    kind = _checks.choice("kind of obstacles", BODY_KINDS.get(named, named), BODIES)
    there = value_at(state.data, ("scene", kind)) or []
    if action == "add":
        new = {"name": _free_name(edit.get("name") or named, state)}
        keys: Keys = ("scene", kind, len(there))
        given = {key: _written(x, None, (*keys, key)) for key, x in _body(edit).items()}
        return [Change(keys, {**new, **given}, insert=True)]
    index = _checks.whole("number of the obstacle", edit["index"], 0, len(there) - 1)
    keys = ("scene", kind, index)
    if action == "remove":
        return [Change(keys if len(there) > 1 else keys[:2])]
    fresh = {"name": edit["name"]} if "name" in edit else {}
    return [
        Change((*keys, key), _written(x, there[index].get(key), (*keys, key)))
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


def _editable(state: EditState) -> Handles:
    """The handles of a job whose points can be changed.

    Raises:
        InvalidInput: They come from a file.
    """
    if state.handles.why_not is not None:
        raise InvalidInput(state.handles.why_not)
    return state.handles


def _waypoint(edit: Mapping[str, Any], state: EditState, *, computed: bool = False) -> Waypoint:
    """The point that an edit names.

    Raises:
        InvalidInput: There is no such point, or it cannot be moved.
    """
    points = _editable(state).waypoints
    point = points[_checks.whole("number of the waypoint", edit["index"], 0, len(points) - 1)]
    if point.why_not is not None and not computed:
        raise InvalidInput(f"Waypoint {point.index + 1} cannot be moved. {point.why_not}")
    return point


def _list_of(handles: Handles) -> Keys:
    """The keys of the list of points of a job."""
    return ("path", SPLINE, POINTS) if handles.kind == SPLINE else ("path", POINTS)


def _uv(name: str, value: Any) -> FloatArray:
    """A place in the picture [m], (2,)."""
    found = _checks.numbers(name, value, "m")
    if found.shape != (2,):
        raise InvalidInput(f"{name} must be two coordinates in the picture, not {show(value)}.")
    return found


Made: TypeAlias = Callable[[Mapping[str, Any], EditState], Sequence[Change]]
EDITS: dict[Any, Made] = {
    "set": _set,
    "unset": _unset,
    "move_waypoint": _move_waypoint,
    "set_waypoint": _set_waypoint,
    "insert_waypoint": _insert_waypoint,
    "remove_waypoint": _remove_waypoint,
    "corner_tolerance": _corner_tolerance,
    "place": _place,
    "to_waypoints": _to_waypoints,
    "obstacle": _obstacle,
}
