"""Edits of waypoints and pen segments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.text import Keys, show
from armcontour.files.job_text_edits import Change, value_at
from armcontour.studio.edits.keys import format_value
from armcontour.studio.handles import (
    CENTER,
    END,
    EXACT,
    POINT,
    POINTS,
    SEGMENTS,
    VIA,
    EditState,
    Handles,
    Waypoint,
    uv_of,
)

TO = "to"
# A drawn shape continues the path if it starts within this distance of the path's end [m].
NEAR = 1e-9


def move_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that move a waypoint in the picture, rounded to `step` [m]."""
    point = _waypoint(edit, state)
    within = EXACT
    if edit.get("step") is not None:
        within = max(EXACT, checks.not_negative("step", edit["step"], "m") / 2)
    new = state.handles.to_file(uv_of("to", edit["to"]), point, within=within)
    return [Change(point.keys, list(new))]


def set_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that set a waypoint's coordinates to typed values."""
    point = _waypoint(edit, state)
    values = edit["value"]
    if not isinstance(values, list) or len(values) != len(point.written):
        raise InvalidInput(
            f"The value of waypoint {point.index + 1} must be a list of {len(point.written)} "
            f"coordinates, but is {show(values)}."
        )
    new = [
        format_value(x, old, (*point.keys, k))
        for k, (x, old) in enumerate(zip(values, point.written, strict=True))
    ]
    return [Change(point.keys, new)]


def insert_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that insert a waypoint before `index` of the edit, or at the end."""
    handles = require_editable(state)
    index = edit["index"]
    ends = handles.ends
    checks.check_int("number of the waypoint", index, 0, len(ends))
    neighbour = ends[min(index, len(ends) - 1)]
    if neighbour.role == END:
        neighbour = next(x for x in reversed(ends[: neighbour.index]) if x.role == POINT)
    coordinates = list(handles.to_file(uv_of("at", edit["at"]), neighbour))
    if handles.kind == SEGMENTS:
        changes = _insert_segment(index, coordinates, state)
    else:
        changes = [Change(("path", POINTS, index), coordinates, insert=True)]
    like = min(index, len(ends) - 1)
    return [*changes, *copy_orientation(index, like, state)]


def _insert_segment(index: int, coordinates: list[Any], state: EditState) -> list[Change]:
    """Return the changes that insert a waypoint into segments; a line becomes two lines."""
    path = state.data["path"]
    segments = path[SEGMENTS]
    if index == 0:
        line = {"to": path["start"]}
        return [
            Change(("path", "start"), coordinates),
            Change(("path", SEGMENTS, 0), line, insert=True),
        ]
    if index > len(segments):
        return [Change(("path", SEGMENTS, len(segments)), {"to": coordinates}, insert=True)]
    parted = segments[index - 1]
    if parted.get(VIA) is not None or parted.get(CENTER) is not None:
        raise InvalidInput(
            f"Segment {index} is an arc, which cannot be divided. Move its end, via point or "
            "centre instead."
        )
    return [Change(("path", SEGMENTS, index - 1), {**parted, "to": coordinates}, insert=True)]


def remove_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that remove a waypoint at an end of a segment."""
    handles = require_editable(state)
    point = _waypoint(edit, state, computed=True)
    if point.role not in (POINT, END):
        raise InvalidInput(
            f"Waypoint {point.index + 1} cannot be removed, because it is the {point.role} point "
            "of an arc. Remove the end of the arc instead."
        )
    index = point.index
    ends = handles.ends
    if len(ends) <= 2:
        raise InvalidInput("The waypoint cannot be removed, because a path needs two points.")
    if handles.kind != SEGMENTS:
        changes = [Change(("path", POINTS, index))]
    elif index > 0:
        changes = [Change(("path", SEGMENTS, index - 1))]
    else:
        first = state.data["path"][SEGMENTS][0].get("to")
        if first is None:
            raise InvalidInput(
                "The first point of the path cannot be removed, because the path starts with an "
                "arc around a centre. Move the point instead."
            )
        changes = [Change(("path", "start"), first), Change(("path", SEGMENTS, 0))]
    orientation = value_at(state.data, ("path", "orientation"))
    if isinstance(orientation, list) and index < len(orientation):
        changes.append(Change(("path", "orientation", index)))
    return changes


def copy_orientation(index: int, like: int, state: EditState) -> list[Change]:
    """Return the changes that give a new waypoint the orientation of `like`."""
    orientations = value_at(state.data, ("path", "orientation"))
    if not isinstance(orientations, list) or like >= len(orientations):
        return []
    return [Change(("path", "orientation", index), orientations[like], insert=True)]


def require_editable(state: EditState) -> Handles:
    """Return the job's handles; raise InvalidInput if its points come from a drawing."""
    if state.handles.why_not is not None:
        raise InvalidInput(state.handles.why_not)
    return state.handles


def _waypoint(edit: Mapping[str, Any], state: EditState, *, computed: bool = False) -> Waypoint:
    """Return an edit's waypoint; raise InvalidInput if it is fixed, unless `computed`."""
    points = require_editable(state).waypoints
    point = points[checks.check_int("number of the waypoint", edit["index"], 0, len(points) - 1)]
    if point.why_not is not None and not computed:
        raise InvalidInput(f"Waypoint {point.index + 1} cannot be moved. {point.why_not}")
    return point


def draw(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that append drawn segments: lines, arcs via points or by centre."""
    handles = require_editable(state)
    path = state.data["path"]
    drawn = edit["segments"]
    if not isinstance(drawn, list) or not all(isinstance(x, Mapping) for x in drawn):
        raise InvalidInput("`segments` of the edit draw must be a list of mappings.")
    ends = handles.ends
    start = uv_of("start", edit["start"])
    like = next((x for x in reversed(ends) if x.role == POINT), handles.origin)
    normal = handles.frame.rotation.T @ handles.plane.normal
    segments: list[dict[str, Any]] = []
    for segment in drawn:
        points = {k: uv_of(k, segment[k]) for k in (VIA, TO, CENTER) if k in segment}
        segments.append({k: list(handles.to_file(at, like)) for k, at in points.items()})
        if CENTER in points:
            segments[-1]["angle"] = "360 deg"
            if len(like.written) == 3:
                segments[-1]["normal"] = normal.tolist()
    first = list(handles.to_file(start, like))
    if ends and np.linalg.norm(ends[-1].uv - start) > NEAR:
        segments.insert(0, {TO: first})
    kind = handles.kind
    if kind == SEGMENTS or (kind == POINTS and all(set(x) == {TO} for x in segments)):
        new = [x[TO] if kind == POINTS else x for x in segments]
        keys: Keys = ("path", kind)
        count = len(path[kind])
        changes = [Change((*keys, count + k), x, insert=True) for k, x in enumerate(new)]
    else:
        # The path becomes a list of segments: its points are converted to lines.
        begin, *others = path.get(POINTS) or [first]
        values = {"start": begin, SEGMENTS: [*({TO: x} for x in others), *segments]}
        changes = [Change(("path", POINTS)), *(Change(("path", k), x) for k, x in values.items())]
    for k in range(len(segments)):
        changes += copy_orientation(len(ends) + k, len(ends) - 1, state)
    return changes
