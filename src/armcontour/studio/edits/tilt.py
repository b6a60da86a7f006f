"""The tilt of the tool axis as one angle, which edits change in the orientation of the path."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import exp, quaternions, shortest, to_rpy
from armcontour.core.text import plain_number
from armcontour.files.job_edits import Change, Keys, value_at
from armcontour.files.job_model import OrientationModel
from armcontour.files.keys import Keys as Model
from armcontour.files.keys import read_keys
from armcontour.files.scene import rotation_of
from armcontour.files.units import read_quantity, write_like
from armcontour.geometry.orienting import POINTING_DOWN
from armcontour.studio.edits.state import EditState
from armcontour.studio.handles import ANGLE, Handles

KEYS: Keys = ("path", "orientation")
# Angles in degrees and components of axes are shown and written with so many decimals.
DECIMALS = 9


def tilt_of(handles: Handles, data: Mapping[str, Any]) -> dict[str, float] | None:
    """Angles of the tool axis in degrees: from -z (`angle`), and of its direction (`towards`).

    They are in the frame of the drawing, or of the tangent if the tool follows it.

    Args:
        handles: The handles of the job.
        data: The data of the job file.

    Returns:
        None for an arm in the plane, and where each waypoint has its own orientation.
    """
    known = None if handles.job.arm.dimension == 2 else _oriented(data)
    if known is None:
        return None
    x, y, z = known[2]
    angle, towards = math.atan2(math.hypot(x, y), -z), math.atan2(y, x)
    return {
        "angle": round(math.degrees(angle), DECIMALS),
        "towards": round(math.degrees(towards), DECIMALS) if math.hypot(x, y) > 1e-9 else 0.0,
    }


def tilt(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Tilt the tool axis by angles as of `tilt_of`, given in degrees or with a unit."""
    now, known = tilt_of(state.handles, state.data), _oriented(state.data)
    if now is None or known is None:
        raise InvalidInput(
            "The tool of this job has no single tilt: give path.orientation in the job file."
        )
    angle, towards = (_degrees(name, edit.get(name, now[name])) for name in ("angle", "towards"))
    flat = math.sin(angle)
    wanted = np.array([flat * math.cos(towards), flat * math.sin(towards), -math.cos(angle)])
    keys, rotation, axis = known
    if rotation is None:
        parts = [round(float(x), DECIMALS) + 0.0 for x in wanted]
        return [Change((*keys, "axis"), [int(x) if x == int(x) else x for x in parts])]
    turned = exp(shortest(axis, wanted)) @ rotation
    if value_at(state.data, (*keys, "quaternion")) is not None:
        return [Change((*keys, "quaternion"), quaternions(turned).tolist())]
    angles = to_rpy(turned)
    return [
        Change((*keys, "rpy"), [write_like(float(x), "0 deg", ANGLE, within=1e-9) for x in angles])
    ]


def _oriented(data: Mapping[str, Any]) -> tuple[Keys, FloatArray | None, FloatArray] | None:
    """Keys, rotation (None for an axis alone) and axis of the tool; None for a list of them."""
    given = value_at(data, KEYS) or {}
    if isinstance(given, list):
        return None
    model = read_keys(Model(OrientationModel), given, "job")
    follow = model.follow_tangent
    if model.axis is not None or not given:
        axis = np.array([0.0, 0.0, -1.0] if model.axis is None else model.axis)
        return KEYS, None, axis / np.linalg.norm(axis)
    keys = KEYS if follow is None else (*KEYS, "follow_tangent")
    rotation = rotation_of("", model if follow is None else follow)
    rotation = POINTING_DOWN if rotation is None else rotation
    return keys, rotation, np.asarray(rotation[:, 2])


def _degrees(name: str, value: Any) -> float:
    """An angle [rad], from text with a unit or a number in degrees."""
    number = plain_number(value) if isinstance(value, str) else value
    text = value if number is None else f"{number} deg"
    try:
        return read_quantity(text, ANGLE)
    except ValueError as error:
        raise InvalidInput(f"The tilt ({name}) {error}.") from None
