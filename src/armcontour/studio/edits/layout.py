"""Edits of the part frame and the tool tilt."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.frames import exp, quaternions, shortest, to_rpy
from armcontour.core.quantities import Quantity, read_quantity, write_like
from armcontour.core.render import number
from armcontour.core.text import Keys, plain_number
from armcontour.files.file_keys import in_si, read_keys
from armcontour.files.job_model import FrameModel, OrientationModel
from armcontour.files.job_path import ORIENTATION_IGNORED
from armcontour.files.job_text_edits import Change, value_at
from armcontour.files.scene_file import rotation_of
from armcontour.geometry.prescribed_orientation import POINTING_DOWN
from armcontour.jobs import Job
from armcontour.studio.handles import ANGLE, EXACT, LENGTH, EditState, Handles, uv_of

# Maximum rounding error of written angles [rad].
EXACT_ANGLE = 1e-14

KEYS: Keys = ("path", "orientation")
# Number of decimals in displayed and written angles [deg] and axis components.
DECIMALS = 9


def place(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that move the part by `by` and `rise`, and rotate it about `about`.

    `by` is a displacement in the picture [m], `rise` one along the normal of the picture [m]. By
    default the part rotates about its centre.
    """
    plane = state.handles.plane
    frame = state.handles.frame
    by = uv_of("by", edit.get("by", [0, 0]))
    rise = checks.check_number("rise", edit.get("rise", 0.0), "m")
    if rise != 0 and state.handles.job.arm.dimension == 2:
        raise InvalidInput(
            f"rise must be 0, because a planar arm has no height, but is {number(rise, 'm')}."
        )
    about = uv_of("about", edit.get("about", state.handles.centre))
    turn = checks.check_number("turn", edit.get("turn", 0.0), "rad")
    turned = exp(turn * plane.normal)
    pivot = plane.lift(about)
    shift = plane.lift(by) - plane.origin + rise * plane.normal
    position = pivot + turned @ (frame.position - pivot) + shift
    frame_data = value_at(state.data, ("path", "frame")) or {}
    keys: Keys = ("path", "frame", "position")
    moved = _vector(keys, position, frame.position, frame_data, LENGTH, EXACT)
    if turn == 0:
        return [moved]
    if frame_data.get("quaternion") is not None:
        new = quaternions(turned @ frame.rotation).tolist()
        return [moved, Change(("path", "frame", "quaternion"), new)]
    before = to_rpy(frame.rotation)
    angles = to_rpy(turned @ frame.rotation)
    if abs(plane.normal[2]) == 1:
        # Only yaw changes, because it is the last rotation. Roll and pitch stay as written, because
        # the angles of `to_rpy` can differ from them.
        before = np.array(in_si(frame_data, FrameModel).get("rpy") or [0.0, 0.0, 0.0])
        yaw = math.remainder(before[2] + turn * plane.normal[2], 2 * math.pi)
        angles = np.append(before[:2], yaw)
    keys = ("path", "frame", "rpy")
    return [moved, _vector(keys, angles, before, frame_data, ANGLE, EXACT_ANGLE)]


def _vector(
    keys: Keys,
    new: FloatArray,
    old: FloatArray,
    frame_data: Mapping[str, Any],
    kind: Quantity,
    within: float,
) -> Change:
    """Change a vector; components that differ by at most `within` stay as they are written."""
    written = frame_data.get(str(keys[-1])) or [None] * len(new)
    values = []
    for value, before, text in zip(new, old, written, strict=False):
        if text is not None and abs(value - before) <= within:
            values.append(text)
        else:
            values.append(write_like(float(value), text, kind, within=within))
    return Change(keys, values)


def tilt_ignored(job: Job, data: Mapping[str, Any]) -> str | None:
    """Return why the tilt has no effect: the file states the tool axes; None if it has one."""
    path = data.get("path")
    if not isinstance(path, Mapping) or "file" not in path:
        return None
    program = job.program
    is_ignored = any(x.startswith(ORIENTATION_IGNORED) for x in program.notes)
    # Without an orientation in the job, those of the contours are from the file.
    is_from_file = "orientation" not in path and any(
        x.path.orientation is not None for x in program.contours
    )
    if not is_ignored and not is_from_file:
        return None
    return f"{path['file']} states the tool axis along its contours, so the tilt has no effect."


def tilt_of(handles: Handles, data: Mapping[str, Any]) -> dict[str, float] | None:
    """Return the tool axis's angle from -z and azimuth [deg]; None if planar or several axes."""
    tool_orientation = None if handles.job.arm.dimension == 2 else _find_orientation(data)
    if tool_orientation is None:
        return None
    x, y, z = tool_orientation[2]
    angle = math.atan2(math.hypot(x, y), -z)
    towards = math.atan2(y, x)
    return {
        "angle": round(math.degrees(angle), DECIMALS),
        "towards": round(math.degrees(towards), DECIMALS) if math.hypot(x, y) > 1e-9 else 0.0,
    }


def tilt(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that tilt the tool axis to the angles of `tilt_of`, by default in deg."""
    now = tilt_of(state.handles, state.data)
    tool_orientation = _find_orientation(state.data)
    if now is None or tool_orientation is None:
        raise InvalidInput(
            "The tilt of the tool cannot be set here, because path.orientation is a list or the "
            "arm is planar. Edit path.orientation in the job file."
        )
    why_not = tilt_ignored(state.handles.job, state.data)
    if why_not is not None:
        raise InvalidInput(f"{why_not} Change the tool axes in the file.")
    angle, towards = (_degrees(name, edit.get(name, now[name])) for name in ("angle", "towards"))
    horizontal = math.sin(angle)
    new_axis = np.array(
        [horizontal * math.cos(towards), horizontal * math.sin(towards), -math.cos(angle)]
    )
    keys, rotation, axis = tool_orientation
    if rotation is None:
        parts = [round(float(x), DECIMALS) + 0.0 for x in new_axis]
        return [Change((*keys, "axis"), [int(x) if x == int(x) else x for x in parts])]
    new_rotation = exp(shortest(axis, new_axis)) @ rotation
    if value_at(state.data, (*keys, "quaternion")) is not None:
        return [Change((*keys, "quaternion"), quaternions(new_rotation).tolist())]
    angles = to_rpy(new_rotation)
    return [
        Change((*keys, "rpy"), [write_like(float(x), "0 deg", ANGLE, within=1e-9) for x in angles])
    ]


def _find_orientation(data: Mapping[str, Any]) -> tuple[Keys, FloatArray | None, FloatArray] | None:
    """Return the orientation's keys, rotation and tool axis; None for several orientations.

    The rotation is None if only the tool axis is specified.
    """
    orientation = value_at(data, KEYS) or {}
    if isinstance(orientation, list):
        return None
    with error_context("job"):
        model = read_keys(OrientationModel, orientation)
    follow = model.follow_tangent
    if model.axis is not None or not orientation:
        axis = np.array([0.0, 0.0, -1.0] if model.axis is None else model.axis)
        return KEYS, None, axis / np.linalg.norm(axis)
    keys = KEYS if follow is None else (*KEYS, "follow_tangent")
    rotation = rotation_of("", model if follow is None else follow)
    rotation = POINTING_DOWN if rotation is None else rotation
    return keys, rotation, np.asarray(rotation[:, 2])


def _degrees(name: str, value: Any) -> float:
    """Read an angle from a text with a unit or a number in degrees; returns radians."""
    number = plain_number(value) if isinstance(value, str) else value
    text = value if number is None else f"{number} deg"
    try:
        return read_quantity(text, ANGLE)
    except ValueError as error:
        raise InvalidInput(f"The tilt ({name}) {error}.") from None
