"""Projection of paths onto the picture plane, and reduction of the number of drawn points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.geometry import Path

# The box of a path is computed from so many of its points, and from the ends of its segments.
BOX_SAMPLES = 41

# Times of a motion that are drawn, whatever happens between them, are so close [s], and at most so
# many: on straight lines between them an arm that accelerates by 20 rad/s² is off by 0.3 mrad.
MAX_SPACING, MAX_SAMPLES = 10e-3, 2_000
# The error of a picture of all lines is its size divided by this; its size is at least this [m].
PICTURE_FINENESS, MIN_SIZE = 5_000, 1e-4
# Curves are drawn with points that are not farther apart than this [rad], and at most so many.
TURN, MAX_PER_ARC = 0.06, 20_000
# At such turns drawn lines keep a point [rad], unless these points are too many.
CORNER_TURN, MAX_CORNERS = 0.4, 100_000
# Charts of short motions have so many at least.
MIN_SAMPLES = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plane:
    """Plane of the picture in the frame of the job's path: origin [m], unit vectors, (3,) each."""

    # The point with the coordinates 0, 0 [m], (3,).
    origin: FloatArray
    x: FloatArray
    y: FloatArray
    flat: bool = True

    @property
    def normal(self) -> FloatArray:
        """Normal of the plane, (3,)."""
        return np.asarray(np.cross(self.x, self.y))

    def uv(self, points: npt.ArrayLike) -> FloatArray:
        """Coordinates in the picture [m], (..., 2)."""
        given = np.asarray(points, dtype=np.float64)
        off = given - self.origin[: given.shape[-1]]
        axes = np.stack([self.x, self.y], axis=1)[: given.shape[-1]]
        return np.asarray(off @ axes)

    def lift(self, uv: npt.ArrayLike) -> FloatArray:
        """Points in the plane [m], (..., 3), from coordinates in the picture, (..., 2)."""
        u = np.asarray(uv, dtype=np.float64)
        return np.asarray(self.origin + u @ np.stack([self.x, self.y]))


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Projection of points onto the screen: plane, and its centre [m], (2,)."""

    plane: Plane
    # The point of the plane that arrays of points are relative to [m], (2,).
    centre: FloatArray
    # Boxes of paths by their identity; the paths are kept so that no other one has it.
    _boxes: dict[int, tuple[Path, FloatArray]] = field(default_factory=dict, init=False)

    def uv(self, points: FloatArray) -> FloatArray:
        """Points in the plane [m], (n, 2)."""
        axes = np.stack([self.plane.x, self.plane.y], axis=1)
        return np.asarray((in_space(points) - self.plane.origin) @ axes)

    def screen_points(self, points: FloatArray) -> FloatArray:
        """Points relative to the centre, float32, (n, 2)."""
        return np.asarray(self.uv(points) - self.centre, dtype=np.float32)

    def box(self, path: Path) -> FloatArray:
        """Bounds (u_min, v_min, u_max, v_max) of a path from the centre [m], (4,)."""
        if id(path) not in self._boxes:
            s = np.linspace(0.0, path.length, BOX_SAMPLES)
            uv = self.uv(path(np.union1d(path.breaks, s))) - self.centre
            # No point is farther from all of these than half a piece.
            more = np.full(2, path.length / (BOX_SAMPLES - 1) / 2)
            self._boxes[id(path)] = path, np.append(uv.min(0) - more, uv.max(0) + more)
        return self._boxes[id(path)][1]

    def screen_vectors(self, vectors: FloatArray) -> FloatArray:
        """Vectors in the plane, float32, (n, 2)."""
        axes = np.stack([self.plane.x, self.plane.y], axis=1)
        return np.asarray(in_space(vectors) @ axes, dtype=np.float32)

    def is_flat(self, points: FloatArray) -> bool:
        """True if points are within 0.1 µm of the plane."""
        if points.shape[-1] == 2:
            return True
        away = (in_space(points) - self.plane.origin) @ np.cross(self.plane.x, self.plane.y)
        return bool(np.abs(away).max(initial=0.0) < 1e-7)

    @property
    def header(self) -> dict[str, Any]:
        """Plane and centre."""
        plane = self.plane
        return {
            "plane": {"origin": plane.origin, "x": plane.x, "y": plane.y},
            "centre": self.centre,
        }


def in_space(points: FloatArray) -> FloatArray:
    """Points with z = 0 if they are planar, (n, 3)."""
    if points.shape[-1] == 3:
        return points
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)


def to_float32(values: FloatArray) -> Any:
    """Values as float32."""
    return np.ascontiguousarray(values, dtype=np.float32)


def sample_times(duration: float) -> FloatArray:
    """Evenly spaced times of a motion [s]."""
    count = min(MAX_SAMPLES, max(MIN_SAMPLES, 1 + int(np.ceil(duration / MAX_SPACING))))
    return np.linspace(0.0, duration, count)


def select_points(weight: FloatArray, rows: Sequence[FloatArray], most: int) -> IntArray:
    """Indices of about `most` points: infinite weights, the heaviest, and extremes of rows."""
    count = len(weight)
    if count <= most:
        return np.arange(count)
    kept = np.flatnonzero(weight > 0)
    if len(kept) > most // 2:
        heaviest = np.argpartition(weight[kept], -(most // 2))[-(most // 2) :]
        kept = np.union1d(kept[heaviest], np.flatnonzero(np.isinf(weight)))
    stays = np.zeros(count, dtype=bool)
    stays[kept] = stays[0] = stays[-1] = True
    parts = max(1, (most - len(kept)) // (2 * len(rows)))
    width = -(-count // parts)
    table = np.nan_to_num(np.stack(rows))
    # The last part may be shorter than the others.
    whole = count - count % width
    for begin, end in ((0, whole), (whole, count)):
        if begin < end:
            cut = table[:, begin:end].reshape(len(rows), -1, min(width, end - begin))
            first = begin + np.arange(cut.shape[1]) * width
            stays[first + cut.argmin(axis=2)] = True
            stays[first + cut.argmax(axis=2)] = True
    return np.flatnonzero(stays)


@dataclass(frozen=True, slots=True, eq=False)
class Detail:
    """Resolution and visible part of a picture."""

    # Largest distance of the path from the drawn line [m].
    error: float
    # Least and largest u and v of what is seen, from the centre [m], (4,); None for all.
    box: FloatArray | None = None

    @classmethod
    def for_points(cls, uv: FloatArray) -> Detail:
        """Resolution for all points of a path [m], (n, 2)."""
        # The size is the same when the path is turned.
        away = np.linalg.norm(uv - uv.mean(axis=0), axis=1)
        size = 2.0 * float(away.max(initial=0.0))
        return cls(max(size, MIN_SIZE) / PICTURE_FINENESS)

    def may_show(self, box_of: Callable[[Path], FloatArray], path: Path) -> bool:
        """True if a path may be visible; its box is computed only if necessary."""
        if self.box is None:
            return True
        box = box_of(path)
        return bool((box[2:] >= self.box[:2]).all() and (box[:2] <= self.box[2:]).all())

    def arc_lengths(self, path: Path) -> FloatArray:
        """Arc lengths of segment ends and of points on curves [m]."""
        bend = np.abs(path.curvatures)
        coarse = np.maximum(bend * path.lengths / TURN, path.lengths * np.sqrt(bend / self.error))
        parts = np.clip(np.ceil(coarse), 1, MAX_PER_ARC).astype(np.intp)
        if len(path) == parts.sum():
            return path.breaks
        i = np.repeat(np.arange(len(path)), parts)
        k = np.arange(len(i)) - np.repeat(np.cumsum(parts) - parts, parts)
        return np.append(path.breaks[i] + path.lengths[i] * (k / parts[i]), path.length)

    def visible_ends(self, uv: FloatArray, ends: IntArray) -> tuple[IntArray, IntArray]:
        """Indices of the ends of visible segments, and among them the first of each line."""
        if self.box is None or len(uv) < 2:
            return np.arange(len(uv)), ends
        low, high = np.minimum(uv[:-1], uv[1:]), np.maximum(uv[:-1], uv[1:])
        outside = (high < self.box[:2]) | (low > self.box[2:])
        inside: BoolArray = ~np.any(outside, axis=1)
        inside[ends[1:-1] - 1] = False
        begins = np.append(inside, False)
        ends_here = np.append(False, inside)
        kept = np.flatnonzero(begins | ends_here)
        first = np.flatnonzero((begins & ~ends_here)[kept])
        return kept, np.append(first, len(kept))

    def essential_points(self, points: FloatArray, ends: IntArray) -> BoolArray:
        """Mask of the points that keep lines within the error and keep their corners, (n,)."""
        kept = np.zeros(len(points), dtype=bool)
        kept[ends[:-1]] = kept[ends[1:] - 1] = True
        turned = np.floor(_turns(points, ends) / CORNER_TURN)
        corners = 1 + np.flatnonzero(np.diff(turned))
        # Far more corners are a hatching, whose lines are nearer than what is seen.
        if len(corners) <= MAX_CORNERS:
            kept[corners] = True
        left = np.flatnonzero(~kept)
        while len(left):
            places = np.flatnonzero(kept)
            which = np.searchsorted(places, left) - 1
            off = _from_piece(points[left], points[places[which]], points[places[which + 1]])
            # Of places that are equally far, all are kept: a path that is moved has the same.
            off = np.round(off / self.error, 6)
            worst = np.zeros(len(places))
            np.maximum.at(worst, which, off)
            far = worst[which] > 1.0
            kept[left[far & (off == worst[which])]] = True
            left = left[far & (off < worst[which])]
        return kept


def _turns(points: FloatArray, ends: IntArray) -> FloatArray:
    """Accumulated direction change at each point, over all lines [rad], (n,)."""
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    along = step / np.where(length > 0, length, 1.0)
    cosine = np.einsum("ij,ij->i", along[1:], along[:-1])
    turn = np.zeros(len(points))
    turn[1:-1] = np.arccos(np.clip(cosine, -1.0, 1.0))
    turn[ends[:-1]] = turn[ends[1:] - 1] = 0.0
    return np.cumsum(turn)


def _from_piece(points: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Distances of points from line segments [m], (n,)."""
    chord, away = end - begin, points - begin
    square = np.einsum("ij,ij->i", chord, chord)
    along = np.einsum("ij,ij->i", away, chord) / np.where(square > 0, square, 1.0)
    off = away - np.clip(along, 0.0, 1.0)[:, None] * chord
    return np.asarray(np.linalg.norm(off, axis=1))
