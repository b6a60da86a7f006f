"""What rounding makes of a tool's orientation: its rate of turning becomes continuous.

Across a rounded vertex the orientation leaves the rotation before it and takes up the next one
together, `exp(g b) exp(f a) R`, where R is the orientation at the vertex, a and b are the rates
before and after it, f runs out to 0 with slope 0 and g starts from 0 with slope 0. A vertex is
given by the segment before it.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.frames import angle_between, exp, log
from armcontour.geometry.orientation import LINEAR, RATE_FLOOR, SAME_RATE, Orientation
from armcontour.geometry.orienting import tangent_rates
from armcontour.geometry.path import Path
from armcontour.geometry.segments import Segments

# A rest of even turning between two roundings that is shorter than this is left out [m].
SLIVER = 1e-12


def find_kinks(path: Path) -> IntArray:
    """Vertices of a path at which its orientation's rate of turning jumps.

    Raises:
        InvalidInput: The path's orientation was rounded before.
    """
    orientation = path.orientation
    if orientation is None or orientation.follows:
        return np.zeros(0, dtype=np.intp)
    fits = len(orientation) == len(path) and np.array_equal(orientation.breaks, path.breaks)
    if not fits or orientation.second.any():
        raise InvalidInput(
            "The corners of this path, or its orientation, were rounded before: round the "
            "objective path."
        )
    return np.flatnonzero(orientation.kinks > 0)


def largest_tangent(path: Path, vertex: IntArray, half: FloatArray, allowed: float) -> FloatArray:
    """Tangent lengths at which the orientation in the middle of a corner is off by `allowed`.

    With tangent length t, the middle is `exp(k b) exp(-k a) R` with `k = t (1/2 - arc / 8 t)`.

    Args:
        path: The objective path.
        vertex: Vertices, (k,).
        half: Half of the turn at each [rad], (k,).
        allowed: Largest angle [rad].

    Returns:
        (k,) [m], infinite where the rate does not jump or the orientation follows the tangent.
    """
    orientation = path.orientation
    if orientation is None or orientation.follows:
        return np.full(len(vertex), np.inf)
    return np.asarray(_largest_part(orientation, vertex, allowed) / (0.5 - _ratio(half) / 8))


def round_orientation(
    objective: Path, vertex: IntArray, half: FloatArray, tangent: FloatArray
) -> tuple[Orientation, FloatArray]:
    """Orientation of a rounded path, where it does not follow the tangent.

    Args:
        objective: The path before rounding.
        vertex: Rounded vertices, (k,).
        half: Half of the turn at each [rad], (k,).
        tangent: Tangent length of each [m], (k,); 0 where it stays sharp.

    Returns:
        The orientation, and by how much it, or its axis where only that counts, is off in the
        middle of each rounding [rad], (k,).
    """
    own = objective.orientation
    assert own is not None
    lengths, n = objective.lengths, len(objective)
    if not own.first.any():
        one = Orientation.even(
            np.array([lengths.sum() - (2 * tangent - _arc_lengths(half, tangent)).sum()]),
            own.starts[:1],
            np.zeros((1, 3)),
            axis_only=own.axis_only,
        )
        return one, np.zeros(len(vertex))
    reach, way = np.zeros(n - 1), np.zeros(n - 1)
    reach[vertex] = tangent
    way[vertex] = _arc_lengths(half, tangent)
    found = _pieces(lengths, own, reach, way)
    middle = exp((tangent / 2 - way[vertex] / 8)[:, None] * own.first[vertex + 1]) @ exp(
        -(tangent / 2 - way[vertex] / 8)[:, None] * own.first[vertex]
    )
    if own.axis_only:
        axis = own.starts[vertex + 1][:, :, 2]
        return found, angle_between(np.einsum("nij,nj->ni", middle, axis), axis)
    return found, np.linalg.norm(log(middle), axis=1)


def follow_rounded(
    rounded: Segments, objective: Path, segment: IntArray, allowed: float
) -> Orientation:
    """Orientation of a rounded path whose tangent it follows.

    Args:
        rounded: The segments of the rounded path.
        objective: The path before rounding.
        segment: For each segment of the rounded path, the objective one that it is a part of or
            that lies before its corner, (n,).
        allowed: Largest angle from the tangent's own orientation [rad].
    """
    own = objective.orientation
    assert own is not None
    rates = tangent_rates(rounded)
    starts = np.empty((len(rounded), 3, 3))
    here = own.starts[0]
    turned = exp(rates * rounded.lengths[:, None])
    for k in range(len(rounded)):
        if k and segment[k] != segment[k - 1]:
            # On a corner's arc the frame has turned into the next segment's, but for rounding.
            here = own.starts[segment[k]]
        starts[k] = here
        here = turned[k] @ here
    sharp = Orientation.even(rounded.lengths, starts, rates, axis_only=own.axis_only, follows=True)
    vertex = np.arange(len(sharp) - 1)
    wanted = np.where(sharp.kinks > 0, 4 * _largest_part(sharp, vertex, allowed), 0.0)
    room = rounded.lengths / 2
    reach = np.minimum(wanted, np.minimum(room[:-1], room[1:]))
    reach[sharp.jumps > 1e-9] = 0.0
    return _pieces(rounded.lengths, sharp, reach, 2 * reach)


def _largest_part(sharp: Orientation, vertex: IntArray, allowed: float) -> FloatArray:
    """The largest k with which `exp(k b) exp(-k a)` turns the tool by no more than `allowed`.

    Rotations are nowhere farther apart than their rotation vectors: it turns by no more than
    `k |b - a|`. The tool axis alone turns by no more than `k d + k² e m / 2` either, where d is the
    part of b - a across the axis, e that along it, and m what the slower of both rates tilts it by:
    see docs/concepts/rounding.md.

    Args:
        sharp: The even orientation.
        vertex: Vertices between its pieces, (k,).
        allowed: Largest angle [rad].

    Returns:
        (k,) [m], infinite where the rate goes on.
    """
    a, b = sharp.first[vertex], sharp.first[vertex + 1]
    step = b - a
    size = np.linalg.norm(step, axis=1)
    # A rate that goes on asks for nothing, though rounding makes two numbers of it.
    rates = np.linalg.norm(a, axis=1) + np.linalg.norm(b, axis=1)
    play = SAME_RATE * rates + RATE_FLOOR
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(size > play, allowed / size, np.inf)
        if sharp.axis_only and np.isfinite(allowed):
            axis = sharp.starts[vertex + 1][:, :, 2]
            across = sharp.kinks[vertex]
            along = np.abs(np.sum(step * axis, axis=1))
            tilt = np.minimum(*(np.linalg.norm(np.cross(x, axis), axis=1) for x in (a, b)))
            bend = along * np.where(tilt > play, tilt, 0.0)
            root = across + np.sqrt(across**2 + 2 * allowed * bend)
            free = np.where(root > 0, 2 * allowed / root, np.where(bend > 0, 0.0, np.inf))
            found = np.maximum(found, free)
    return np.asarray(found)


def _ratio(half: FloatArray) -> FloatArray:
    """Length of a corner's arc over its tangent length."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(half > 0, 2 * half / np.tan(half), 2.0))


def _arc_lengths(half: FloatArray, tangent: FloatArray) -> FloatArray:
    return np.asarray(tangent * _ratio(half))


def _pieces(
    lengths: FloatArray, sharp: Orientation, reach: FloatArray, way: FloatArray
) -> Orientation:
    """Even pieces with roundings between them.

    Args:
        lengths: Of the even pieces [m], (n,).
        sharp: The even orientation.
        reach: How far each vertex's rounding reaches into both neighbours, (n - 1,) [m].
        way: Path length of each rounding, (n - 1,) [m].
    """
    n = len(lengths)
    size = 2 * n - 1
    before, after = np.append(0.0, reach), np.append(reach, 0.0)
    spans = np.zeros(size)
    spans[::2] = lengths - before - after
    spans[::2][spans[::2] <= SLIVER] = 0.0
    spans[1::2] = way
    starts, first, second = np.empty((size, 3, 3)), np.empty((size, 3)), np.zeros((size, 3))
    f, g = np.zeros((size, 4)), np.zeros((size, 4))
    starts[::2] = exp(before[:, None] * sharp.first) @ sharp.starts
    starts[1::2] = sharp.starts[1:]
    first[::2], first[1::2] = sharp.first, sharp.first[:-1]
    second[1::2] = sharp.first[1:]
    f[::2] = LINEAR
    with np.errstate(divide="ignore", invalid="ignore"):
        left = reach - way
        f[1::2, 0], f[1::2, 1] = -reach, 1.0
        f[1::2, 2], f[1::2, 3] = (3 * left + way) / way**2, -(way + 2 * left) / way**3
        g[1::2, 2], g[1::2, 3] = (3 * reach - way) / way**2, (way - 2 * reach) / way**3
    used = spans > 0
    return Orientation(
        breaks=np.concatenate([[0.0], np.cumsum(spans[used])]),
        starts=starts[used],
        first=first[used],
        second=second[used],
        f=f[used],
        g=g[used],
        axis_only=sharp.axis_only,
        follows=sharp.follows,
    )
