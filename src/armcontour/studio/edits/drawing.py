"""Edits of the pen: lines and arcs at the end of a path, or the first ones of an empty one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.files.job_edits import Change, Keys
from armcontour.studio.edits.state import EditState, uv_of
from armcontour.studio.edits.waypoints import editable, insert_orientation
from armcontour.studio.handles import CENTER, POINT, POINTS, SEGMENTS, SPLINE, VIA

TO = "to"
# A shape that starts so near the end of the path goes on there [m].
NEAR = 1e-9


def draw(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Draw segments from a start: lines to points, arcs via points, circles around centres."""
    handles, path = editable(state), state.data["path"]
    if handles.kind == SPLINE:
        raise InvalidInput("A spline has no lines and arcs: draw on an empty plane instead (New).")
    drawn = edit["segments"]
    if not isinstance(drawn, list) or not all(isinstance(x, Mapping) for x in drawn):
        raise InvalidInput("The pen draws a list of segments.")
    ends, start = handles.ends, uv_of("start", edit["start"])
    like = next((x for x in reversed(ends) if x.role == POINT), handles.origin)
    normal = handles.frame.rotation.T @ handles.plane.normal
    segments: list[dict[str, Any]] = []
    for x in drawn:
        places = {k: uv_of(k, x[k]) for k in (VIA, TO, CENTER) if k in x}
        segments.append({k: list(handles.to_file(at, like)) for k, at in places.items()})
        if CENTER in places:
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
        # Points become lines; an empty path has none.
        begin, *others = path.get(POINTS) or [first]
        values = {"start": begin, SEGMENTS: [*({TO: x} for x in others), *segments]}
        changes = [Change(("path", POINTS)), *(Change(("path", k), x) for k, x in values.items())]
    for k in range(len(segments)):
        changes += insert_orientation(len(ends) + k, len(ends) - 1, state)
    return changes
