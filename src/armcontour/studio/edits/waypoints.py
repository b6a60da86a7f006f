"""Edits of the points of a path: moved, set, inserted and removed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.text import show
from armcontour.files.job_edits import Change, Keys, value_at
from armcontour.studio.edits.corners import renumbered
from armcontour.studio.edits.keys import written
from armcontour.studio.edits.state import EditState, uv_of
from armcontour.studio.handles import (
    CENTER,
    END,
    EXACT,
    POINT,
    POINTS,
    SEGMENTS,
    SPLINE,
    VIA,
    Handles,
    Waypoint,
)


def move_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Move a point to a place in the picture; with `step` to one whose digits are round."""
    point = _waypoint(edit, state)
    within = EXACT
    if edit.get("step") is not None:
        within = max(EXACT, checks.not_negative("step", edit["step"], "m") / 2)
    new = state.handles.to_file(uv_of("to", edit["to"]), point, within=within)
    return _coordinates(point.keys, point.written, new)


def set_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Set the coordinates of a point, as typed."""
    point = _waypoint(edit, state)
    given = edit["value"]
    if not isinstance(given, list) or len(given) != len(point.written):
        raise InvalidInput(
            f"Waypoint {point.index + 1} has {len(point.written)} coordinates, not {show(given)}."
        )
    new = [
        written(x, old, (*point.keys, k))
        for k, (x, old) in enumerate(zip(given, point.written, strict=True))
    ]
    return _coordinates(point.keys, point.written, new)


def _coordinates(keys: Keys, old: Sequence[Any], new: Sequence[Any]) -> list[Change]:
    """The changes of those coordinates that are different."""
    pairs = enumerate(zip(old, new, strict=True))
    return [Change((*keys, k), x) for k, (was, x) in pairs if x != was or type(x) is not type(was)]


def insert_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Insert a point, which gets a number in the order of the path."""
    handles, index = editable(state), edit["index"]
    ends = handles.ends
    checks.check_int("number of the waypoint", index, 0, len(ends))
    beside = ends[min(index, len(ends) - 1)]
    if beside.role == END:
        beside = next(x for x in reversed(ends[: beside.index]) if x.role == POINT)
    at = list(handles.to_file(uv_of("at", edit["at"]), beside))
    if handles.kind == SEGMENTS:
        changes = _insert_segment(index, at, state)
    else:
        changes = [Change((*_list_of(handles), index), at, insert=True)]
    like = min(index, len(ends) - 1)
    return [*changes, *insert_orientation(index, like, state), *renumbered(index, 1, state)]


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


def remove_waypoint(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Remove a point at the end of a segment."""
    handles, point = editable(state), _waypoint(edit, state, computed=True)
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
    return [*changes, *renumbered(index, -1, state)]


def insert_orientation(index: int, like: int, state: EditState) -> list[Change]:
    """The orientation of a new point, which is that of one beside it."""
    given = value_at(state.data, ("path", "orientation"))
    if not isinstance(given, list) or like >= len(given):
        return []
    return [Change(("path", "orientation", index), given[like], insert=True)]


def editable(state: EditState) -> Handles:
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
    points = editable(state).waypoints
    point = points[checks.check_int("number of the waypoint", edit["index"], 0, len(points) - 1)]
    if point.why_not is not None and not computed:
        raise InvalidInput(f"Waypoint {point.index + 1} cannot be moved. {point.why_not}")
    return point


def _list_of(handles: Handles) -> Keys:
    """The keys of the list of points of a job."""
    return ("path", SPLINE, POINTS) if handles.kind == SPLINE else ("path", POINTS)
