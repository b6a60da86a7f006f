"""Functions that place a path in a frame, lift it to space, and project it onto the plane."""

from __future__ import annotations

import dataclasses

import numpy as np

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.frames import Frame, Pose
from armcontour.geometry.path import Path
from armcontour.geometry.segments import REPEATED_POINT

# Largest z offset [m] and tilt with which a frame keeps a path in the x-y plane; also the largest
# z component of the vectors of an arc that lies in a plane of constant z.
IN_PLANE = 1e-12


def place_path(path: Path, frame: Pose, *, scale: float = 1.0) -> Path:
    """A path given in a frame, in the coordinates in which the frame is given.

    Speeds and tolerances are kept. A path in the plane stays in the plane if the frame neither
    lifts nor tilts it; otherwise it becomes a path in space.

    Args:
        path: The path in the frame's coordinates.
        frame: Position and rotation of the frame, as of `Frame.of`.
        scale: Factor of all lengths, applied first.

    Raises:
        InvalidInput: The scale is not above zero, or it is no frame.
    """
    frame = Frame.of(frame)
    factor = _checks.positive("scale", scale)
    if path.dimension == 2 and not keeps_plane(frame):
        path = lift_path(path)
    d, orientation = path.dimension, path.orientation
    if orientation is not None:
        orientation = orientation.place(frame.rotation, factor)
    segments = path.segments.place(frame.rotation[:d, :d], frame.position[:d], factor)
    return _with_segments(path, segments=segments, orientation=orientation)


def keeps_plane(frame: Frame) -> bool:
    """Whether a path in the x-y plane stays in it when it is placed in the frame."""
    lifted = max(abs(frame.position[2]), float(np.abs(frame.rotation[2] - [0, 0, 1]).max()))
    return bool(lifted <= IN_PLANE)


def lift_path(path: Path) -> Path:
    """A path in the plane as a path in space at z = 0; a path in space is returned as it is."""
    return path if path.dimension == 3 else _with_segments(path, segments=path.segments.lift())


def drop_z(path: Path) -> Path:
    """Projection of a path in space onto the x-y plane, without its orientation.

    Raises:
        InvalidInput: An arc does not lie in a plane of constant z, or the projection has no length.
    """
    if path.dimension == 2:
        return path
    across = (np.abs(path.tangents[:, 2]) + np.abs(path.normals[:, 2]) > IN_PLANE) & (
        path.curvatures > 0
    )
    quintics = path.segments.quintics
    if quintics.size:
        across |= np.abs(quintics[:, :, 2]).max(axis=1) > IN_PLANE
    if across.any():
        i = int(np.argmax(across))
        raise InvalidInput(
            f"Segment {i + 1} is a curve that leaves the plane, which cannot be flattened.", index=i
        )
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    kept = run * path.lengths > REPEATED_POINT
    if not kept.any():
        raise InvalidInput("The path only goes up and down: nothing is left of it in the plane.")
    rows, shortening = path.segments[kept], run[kept]
    return Path(
        segments=rows.replace(
            starts=rows.starts[:, :2],
            tangents=rows.tangents[:, :2] / shortening[:, None],
            normals=rows.normals[:, :2],
            lengths=rows.lengths * shortening,
            quintics=rows.quintics[:, :, :2],
        )
    )


def has_length_without_z(path: Path) -> bool:
    """Whether the projection of a path onto the x-y plane has any length."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1) * path.lengths
    return bool(((run > REPEATED_POINT) | (path.curvatures > 0)).any())


def arc_length_without_z(path: Path, s: float) -> float:
    """Arc length on the projected path of the point at arc length `s` on a path in space [m]."""
    run = np.linalg.norm(path.tangents[:, :2], axis=1)
    run = np.where(path.curvatures > 0, 1.0, run)
    run = np.where(run * path.lengths > REPEATED_POINT, run, 0.0)
    return float(np.sum(run * np.clip(s - path.breaks[:-1], 0.0, path.lengths)))


def _with_segments(path: Path, **changed: object) -> Path:
    """A plain Path with some attributes changed, without the attributes of a subclass of Path."""
    kept = {x.name: getattr(path, x.name) for x in dataclasses.fields(Path) if x.init}
    return Path(**{**kept, **changed})
