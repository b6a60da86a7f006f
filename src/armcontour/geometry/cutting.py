"""Parts of a path, paths put together, and paths put somewhere else."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.frames import Frame, exp
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.path import REPEATED_POINT, Path

# A frame keeps a plane path in the plane if it lifts and tilts it by no more than this.
IN_PLANE = 1e-12
# What a path holds of every segment in arrays.
PER_SEGMENT = (
    "starts",
    "tangents",
    "inwards",
    "curvatures",
    "lengths",
    "speeds",
    "tolerances",
)


def part(path: Path, begin: float, end: float) -> Path:
    """The part of a path between two arc lengths [m], with what belongs to its segments.

    Raises:
        InvalidInput: No place of the path, or nothing between them.
    """
    for name, s in (("begin", begin), ("end", end)):
        value = _checks.number(name, s, "m")
        if not -REPEATED_POINT <= value <= path.length + REPEATED_POINT:
            raise InvalidInput(
                f"{name} of a part must lie within the path of {path.length:.9g} m, but is "
                f"{value:.9g} m.",
                s=value,
                allowed=path.length,
            )
    begin, end = max(begin, 0.0), min(end, path.length)
    # What is left of a segment below the resolution of a point is left out.
    first = int(path.locate(begin + REPEATED_POINT))
    last = int(path.locate(end - REPEATED_POINT, side="left"))
    if end - begin <= REPEATED_POINT or first > last:
        raise InvalidInput(f"There is no path between {begin:.9g} and {end:.9g} m along it.")
    # The orientation is cut where the segments are.
    begin = max(begin, float(path.breaks[first]))
    end = min(end, float(path.breaks[last + 1]))
    i = np.arange(first, last + 1)
    u0 = np.zeros(len(i))
    u0[0] = begin - path.breaks[first]
    u1 = path.lengths[i].copy()
    u1[-1] = min(end - path.breaks[last], u1[-1])
    starts, tangents, inwards = path.starts[i], path.tangents[i].copy(), path.inwards[i].copy()
    if u0[0] > 0:
        begun, at = i[:1], u0[:1]
        starts = np.concatenate([path.on_segment(begun, at), starts[1:]])
        turn = path.curvatures[first] * u0[0]
        c, s = np.cos(turn), np.sin(turn)
        tangents[0] = c * path.tangents[first] + s * path.inwards[first]
        inwards[0] = c * path.inwards[first] - s * path.tangents[first]
    orientation = None
    if path.orientation is not None:
        orientation = _part_of_orientation(path.orientation, begin, float((u1 - u0).sum()))
    return Path(
        starts=starts,
        tangents=tangents,
        inwards=inwards,
        curvatures=path.curvatures[i],
        lengths=u1 - u0,
        speeds=path.speeds[i],
        tolerances=path.tolerances[i],
        tags=path.tags[first : last + 1],
        orientation=orientation,
    )


def _part_of_orientation(orientation: Orientation, begin: float, length: float) -> Orientation:
    breaks = orientation.breaks - begin
    inside = (breaks[1:] > REPEATED_POINT) & (breaks[:-1] < length - REPEATED_POINT)
    i = np.flatnonzero(inside)
    cut = np.concatenate([[0.0], breaks[i[1:]], [length]])
    f, g = orientation.f[i].copy(), orientation.g[i].copy()
    starts, first = orientation.starts[i].copy(), orientation.first[i].copy()
    before = max(-float(breaks[i[0]]), 0.0)
    if before > 0:
        # A piece begins with its own rotation; what g has turned so far carries the axis of f.
        starts[0] = orientation.on_piece(i[:1], np.array([before]))[0]
        f[0], g[0] = _shifted(f[0], before), _shifted(g[0], before)
        first[0] = exp(g[0, 0] * orientation.second[i[:1]])[0] @ first[0]
        f[0, 0] = g[0, 0] = 0.0
    return dataclasses.replace(
        orientation,
        breaks=cut,
        starts=starts,
        first=first,
        second=orientation.second[i],
        f=f,
        g=g,
    )


def _shifted(c: FloatArray, by: float) -> FloatArray:
    """Coefficients of the cubic polynomial with `u + by` in the place of u."""
    a0, a1, a2, a3 = c
    return np.array(
        [
            a0 + by * (a1 + by * (a2 + by * a3)),
            a1 + by * (2 * a2 + 3 * by * a3),
            a2 + 3 * by * a3,
            a3,
        ]
    )


def joined(paths: Sequence[Path]) -> Path:
    """One path of several, each of which starts where the one before ends.

    Raises:
        InvalidInput: A gap, no path, or orientations on some of them only.
    """
    if not paths:
        raise InvalidInput("There is no path to join.")
    if len(paths) == 1:
        return paths[0]
    if len({x.dimension for x in paths}) > 1:
        raise InvalidInput("Paths to join must all be in the plane or all in space.")
    oriented = [x.orientation for x in paths if x.orientation is not None]
    if oriented and len(oriented) < len(paths):
        raise InvalidInput("Paths to join must all have an orientation, or none.")
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(x, name) for x in paths]) for name in PER_SEGMENT
    }
    return Path(
        **arrays,
        tags=tuple(tag for x in paths for tag in x.tags),
        orientation=_joined_orientation(oriented, [x.length for x in paths]) if oriented else None,
    )


def _joined_orientation(parts: Sequence[Orientation], lengths: Sequence[float]) -> Orientation:
    offsets = np.concatenate([[0.0], np.cumsum(lengths)])
    breaks = [x.breaks[:-1] + offset for x, offset in zip(parts, offsets, strict=False)]
    return Orientation(
        breaks=np.concatenate([*breaks, offsets[-1:]]),
        **{
            name: np.concatenate([getattr(x, name) for x in parts])
            for name in ("starts", "first", "second", "f", "g")
        },
        axis_only=all(x.axis_only for x in parts),
        follows=all(x.follows for x in parts),
    )


def reversed_path(path: Path) -> Path:
    """The same path run from its end to its start, with the tool held as it was at every place."""
    every = np.arange(len(path))[::-1]
    lengths = path.lengths[::-1]
    orientation = path.orientation
    if orientation is not None:
        orientation = _reversed_orientation(orientation)
    return Path(
        starts=path.on_segment(every, lengths),
        tangents=-path.on_segment(every, lengths, 1),
        inwards=_inwards(path)[::-1],
        curvatures=path.curvatures[::-1],
        lengths=lengths,
        speeds=path.speeds[::-1],
        tolerances=path.tolerances[::-1],
        tags=path.tags[::-1],
        waypoints=len(path) - path.waypoints[::-1],
        orientation=orientation,
    )


def _inwards(path: Path) -> FloatArray:
    """Vectors towards the centres at the ends of the segments."""
    turn = (path.curvatures * path.lengths)[:, None]
    return (
        np.asarray(np.cos(turn) * path.inwards - np.sin(turn) * path.tangents)
        * (path.curvatures > 0)[:, None]
    )


def _reversed_orientation(orientation: Orientation) -> Orientation:
    """Each piece from its end; as f and g start at zero there, it starts with its own rotation."""
    lengths = np.diff(orientation.breaks)
    every = np.arange(len(orientation))
    at_end = [
        np.array([_shifted(c, u) for c, u in zip(x, lengths, strict=True)])
        for x in (orientation.f, orientation.g)
    ]
    back = exp(at_end[1][:, :1] * orientation.second)
    # f(end) - f(end - u), about the axis turned round.
    f, g = (-x * [0, -1, 1, -1] for x in at_end)
    return dataclasses.replace(
        orientation,
        breaks=np.concatenate([[0.0], np.cumsum(lengths[::-1])]),
        starts=orientation.on_piece(every, lengths)[::-1],
        first=-np.einsum("nij,nj->ni", back, orientation.first)[::-1],
        second=-orientation.second[::-1],
        f=f[::-1],
        g=g[::-1],
    )


def placed(path: Path, frame: Frame, *, scale: float = 1.0) -> Path:
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
        path = in_space(path)
    turn, origin = frame.rotation, frame.position
    if path.dimension == 2:
        turn, origin = turn[:2, :2], origin[:2]
    orientation = path.orientation
    if orientation is not None:
        turned = frame.rotation
        orientation = dataclasses.replace(
            orientation,
            breaks=orientation.breaks * factor,
            starts=turned @ orientation.starts,
            first=orientation.first @ turned.T,
            second=orientation.second @ turned.T,
            f=orientation.f / factor ** np.arange(4),
            g=orientation.g / factor ** np.arange(4),
        )
    return _plain(
        path,
        starts=origin + factor * path.starts @ turn.T,
        tangents=path.tangents @ turn.T,
        inwards=path.inwards @ turn.T,
        curvatures=path.curvatures / factor,
        lengths=path.lengths * factor,
        orientation=orientation,
    )


def _plain(path: Path, **changed: Any) -> Path:
    """A path with other values, and without what a path of another kind knows of the old ones."""
    kept = {x.name: getattr(path, x.name) for x in dataclasses.fields(Path) if x.init}
    return Path(**{**kept, **changed})


def keeps_plane(frame: Frame) -> bool:
    """Whether a frame leaves what is drawn in the x-y plane there."""
    lifted = max(abs(frame.position[2]), float(np.abs(frame.rotation[2] - [0, 0, 1]).max()))
    return bool(lifted <= IN_PLANE)


def in_space(path: Path) -> Path:
    """A path in the plane as one in space, at z = 0."""
    if path.dimension == 3:
        return path

    def deeper(array: FloatArray) -> FloatArray:
        return np.pad(array, ((0, 0), (0, 1)))

    return _plain(
        path,
        starts=deeper(path.starts),
        tangents=deeper(path.tangents),
        inwards=deeper(path.inwards),
    )
