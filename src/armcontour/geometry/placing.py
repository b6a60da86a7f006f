"""Paths put somewhere else: placed in a frame, lifted to space, and projected onto the plane."""

from __future__ import annotations

import dataclasses

import numpy as np

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.geometry.path import Path
from armcontour.geometry.segments import REPEATED_POINT

# A frame keeps a plane path in the plane if it lifts and tilts it by no more than this; an arc lies
# in a plane of constant z if its vectors leave that plane by no more than this.
IN_PLANE = 1e-12


def place_path(path: Path, frame: Frame, *, scale: float = 1.0) -> Path:
    """A path drawn in a frame, as seen from where the frame stands.

    Speeds and tolerances stay what they are. A path in the plane stays there if the frame neither
    lifts nor tilts it, and is otherwise one in space.

    Args:
        path: The path in the frame's coordinates.
        frame: Where its origin is and how it is turned.
        scale: Factor of all lengths, before that.

    Raises:
        InvalidInput: A scale that is not above zero, or no frame.
    """
    if not isinstance(frame, Frame):
        raise InvalidInput(
            f"A path is placed in a Frame, such as Frame(position=[0.3, 0, 0]), not in a "
            f"{type(frame).__name__}."
        )
    factor = _checks.positive("scale", scale)
    if path.dimension == 2 and not keeps_plane(frame):
        path = lift_path(path)
    d, orientation = path.dimension, path.orientation
    if orientation is not None:
        orientation = orientation.place(frame.rotation, factor)
    segments = path.segments.place(frame.rotation[:d, :d], frame.position[:d], factor)
    return _with_segments(path, segments=segments, orientation=orientation)


def keeps_plane(frame: Frame) -> bool:
    """Whether a frame leaves what is drawn in the x-y plane there."""
    lifted = max(abs(frame.position[2]), float(np.abs(frame.rotation[2] - [0, 0, 1]).max()))
    return bool(lifted <= IN_PLANE)


def lift_path(path: Path) -> Path:
    """A path in the plane as one in space, at z = 0."""
    return path if path.dimension == 3 else _with_segments(path, segments=path.segments.lift())


def drop_z(path: Path) -> Path:
    """A path in space without its z, of lines and of arcs in planes of constant z.

    It has no orientation: a tool is oriented in space only.

    Raises:
        InvalidInput: An arc that stands across the plane, or nothing that is left.
    """
    if path.dimension == 2:
        return path
    across = (np.abs(path.tangents[:, 2]) + np.abs(path.normals[:, 2]) > IN_PLANE) & (
        path.curvatures > 0
    )
    if across.any():
        i = int(np.argmax(across))
        raise InvalidInput(
            f"Segment {i + 1} is an arc that leaves the plane, which cannot be flattened.", index=i
        )
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    kept = run * path.lengths > REPEATED_POINT
    if not kept.any():
        raise InvalidInput("The path only goes up and down: nothing is left of it in the plane.")
    rows, steep = path.segments[kept], run[kept]
    return Path(
        segments=rows.replace(
            starts=rows.starts[:, :2],
            tangents=rows.tangents[:, :2] / steep[:, None],
            normals=rows.normals[:, :2],
            lengths=rows.lengths * steep,
        )
    )


def has_length_without_z(path: Path) -> bool:
    """Whether something of a path is left without its z."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1) * path.lengths
    return bool(((run > REPEATED_POINT) | (path.curvatures > 0)).any())


def arc_length_without_z(path: Path, s: float) -> float:
    """Arc length at which the place `s` of a path lies once its z is dropped [m]."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    run = np.where(path.curvatures > 0, 1.0, run)
    run = np.where(run * path.lengths > REPEATED_POINT, run, 0.0)
    return float(np.sum(run * np.clip(s - path.breaks[:-1], 0.0, path.lengths)))


def _with_segments(path: Path, **changed: object) -> Path:
    """A path with other values, and without what a path of another kind knows of the old ones."""
    kept = {x.name: getattr(path, x.name) for x in dataclasses.fields(Path) if x.init}
    return Path(**{**kept, **changed})
