"""Conversion of the contour of a drawing to points or segments of the job."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.quantities import Quantity
from armcontour.core.units import write_like
from armcontour.files.job_model import PathModel
from armcontour.files.job_path import FILE_OPTIONS, path_of
from armcontour.files.job_text_edits import Change, change_data
from armcontour.files.keys import read_keys
from armcontour.geometry import Path
from armcontour.studio.handles import ANGLE, FILE, LENGTH, Handles

SPEED = Quantity("m/s", "100 mm/s")
# Maximum angle of an arc that is written with a via point [rad]. Larger arcs are written with their
# centre, because their end points can be too close to each other for a via point.
MAX_VIA_ANGLE = 1.5 * math.pi
# Rounding error of coordinates due to the transform to the part frame [m].
FRAME_ROUNDING = 1e-15
# Maximum deviation of points [m] and of tool orientations after the conversion.
SAME = 1e-9

Write = Callable[[FloatArray], list[Any]]


def waypoint_changes(handles: Handles, data: Mapping[str, Any]) -> list[Change]:
    """Changes that convert the contour of a drawing to points or segments of the job."""
    path = _only_path(handles)
    path_data = data["path"]
    local_path = path.placed(handles.frame.inverse)
    old = ((path_data.get("frame") or {}).get("position") or [None])[0]
    write = partial(_coordinates, like=old)
    assigned = [_assigned_keys(local_path, i) for i in range(len(local_path))]
    straight = not any(assigned) and not local_path.curvatures.any()
    new = _points(local_path, write) if straight else _segments(local_path, write, assigned)
    changes = [Change(("path", key), x) for key, x in new.items()]
    changes += [Change(("path", key)) for key in ("file", *FILE_OPTIONS) if key in path_data]
    _verify(path, change_data(data, changes)["path"], handles)
    return changes


def is_convertible(handles: Handles) -> bool:
    """True if the contour of the drawing can be converted to waypoints."""
    try:
        _only_path(handles)
    except InvalidInput:
        return False
    return True


def _only_path(handles: Handles) -> Path:
    """Path of a drawing with one contour, with the speed and tolerance of its layer.

    Raises InvalidInput if waypoints cannot represent the drawing.
    """
    job, program = handles.job, handles.job.program
    if handles.kind != FILE:
        raise InvalidInput("The path already consists of waypoints of the job.")
    contours = program.contours
    if len(contours) != 1:
        raise InvalidInput(
            f"{handles.file} has {len(contours)} contours, but only a single contour can be "
            "converted to waypoints. Select one contour with path.names first."
        )
    path, layer = program.single_path, contours[0].layer
    if path is None:
        raise InvalidInput(
            f"{handles.file} has rapids, dwells or events, which cannot be converted to waypoints. "
            "Use a drawing that has only the contour."
        )
    if layer in job.process.by_layer:
        raise InvalidInput(
            f"process.by_layer has values for the layer {layer}, but waypoints have no layer. "
            "Specify these values for the whole process first."
        )
    if path.segments.is_transition.any():
        raise InvalidInput(
            f"{handles.file} has transitions (clothoids), but only lines and arcs can be converted "
            "to waypoints."
        )
    layer_values = job.process.layers.get(layer or "")
    if layer_values is None:
        return path
    table = path.segments
    columns: dict[str, Any] = {
        name: np.where(np.isnan(getattr(table, name)), value, getattr(table, name))
        for name, value in (("speeds", layer_values.speed), ("tolerances", layer_values.tolerance))
        if value is not None
    }
    return Path(segments=table.replace(**columns), orientation=path.orientation)


def _points(path: Path, write: Write) -> dict[str, Any]:
    return {"points": _close([write(x) for x in path.vertices], path)}


def _segments(path: Path, write: Write, assigned: list[dict[str, Any]]) -> dict[str, Any]:
    """Keys `start` and `segments` of a path of lines and arcs."""
    ends = _close([write(x) for x in path.vertices], path)
    listed: list[dict[str, Any]] = []
    for i, (to, assigned_keys) in enumerate(zip(ends[1:], assigned, strict=True)):
        angle = float(path.curvatures[i] * path.lengths[i])
        if angle == 0:
            listed.append({"to": to, **assigned_keys})
        elif angle <= MAX_VIA_ANGLE:
            listed.append(
                {
                    "via": write(
                        path.segments.evaluate(slice(i, i + 1), path.lengths[i : i + 1] / 2)[0]
                    ),
                    "to": to,
                    **assigned_keys,
                }
            )
        else:
            listed.append({**_centre_keys(path, i, angle, write), **assigned_keys})
    return {"start": ends[0], "segments": listed}


def _centre_keys(path: Path, i: int, angle: float, write: Write) -> dict[str, Any]:
    """Keys of a segment that specify an arc by its centre and angle."""
    tangent, normal = path.tangents[i], path.normals[i]
    center = write(path.starts[i] + normal / path.curvatures[i])
    if path.dimension == 3:
        axis = np.cross(tangent, normal) + 0.0
        return {"center": center, "angle": write_like(angle, None, ANGLE), "normal": axis.tolist()}
    turn = math.copysign(angle, tangent[0] * normal[1] - tangent[1] * normal[0])
    return {"center": center, "angle": write_like(turn, None, ANGLE)}


def _close(points: list[list[Any]], path: Path) -> list[list[Any]]:
    """The points; if the path is closed, the last point is replaced by exactly the first point."""
    first, last = path.vertices[0], path.vertices[-1]
    closed = np.linalg.norm(last - first) <= SAME
    return [*points[:-1], points[0]] if closed else points


def _coordinates(point: FloatArray, like: Any) -> list[Any]:
    return [write_like(float(x), like, LENGTH, within=FRAME_ROUNDING) for x in point]


def _assigned_keys(path: Path, i: int) -> dict[str, Any]:
    """Keys `speed` and `tolerance` of a segment that has assigned values."""
    assigned = {}
    if not math.isnan(path.speeds[i]):
        assigned["speed"] = write_like(float(path.speeds[i]), None, SPEED)
    if not math.isnan(path.tolerances[i]):
        assigned["tolerance"] = write_like(float(path.tolerances[i]), None, LENGTH)
    return assigned


def _verify(path: Path, written: Mapping[str, Any], handles: Handles) -> None:
    """Raise InvalidInput if the path of the waypoints differs from the path of the drawing."""
    with error_context("the waypoints"):
        model = read_keys(PathModel, written)
    copy = path_of(model, FilePath(), handles.job.arm.dimension)
    assert isinstance(copy, Path)
    alike = len(copy) == len(path) and abs(copy.vertices - path.vertices).max() <= SAME
    if not alike:
        raise InvalidInput(
            f"The contour of {handles.file} cannot be converted to waypoints, because some of its "
            "segments are too short."
        )
    copied_orientation, orientation = copy.orientation, path.orientation
    if copied_orientation is None and orientation is None:
        return
    s = np.linspace(0, 1, 9)
    if (
        copied_orientation is None
        or orientation is None
        or abs(copied_orientation(s * copy.length) - orientation(s * path.length)).max() > SAME
    ):
        raise InvalidInput(
            f"{handles.file} specifies tool orientations, which the conversion to waypoints would "
            "lose. Specify path.orientation first."
        )
