"""Edits of where the part lies: its frame is moved and turned in the plane of the picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.frames import exp, quaternions, to_rpy
from armcontour.core.quantities import Quantity
from armcontour.files.job_edits import Change, Keys, value_at
from armcontour.files.job_model import FrameModel
from armcontour.files.si_data import in_si
from armcontour.files.units import write_like
from armcontour.studio.edits.state import EditState, uv_of
from armcontour.studio.handles import ANGLE, EXACT, LENGTH

# Angles are written with the fewest digits that are this exact [rad].
EXACT_ANGLE = 1e-14


def place(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Move and turn the part in the plane of the picture."""
    plane, own = state.handles.plane, state.handles.frame
    by, about = uv_of("by", edit.get("by", [0, 0])), uv_of("about", edit.get("about", [0, 0]))
    turn = checks.check_number("turn", edit.get("turn", 0.0), "rad")
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
