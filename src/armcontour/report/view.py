"""Project paths onto the plane of the picture, and select the points to draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.geometry import Path, Segments
from armcontour.program import Program

# Maximum spacing of a motion's evenly spaced times [s], unless there would be more than
# MAX_SAMPLES. With this spacing, linear interpolation has an error of 0.3 mrad at 20 rad/s².
MAX_SPACING = 10e-3
# Maximum number of evenly spaced times in a motion.
MAX_SAMPLES = 2_000
# Size of a picture divided by the maximum deviation of its lines.
PICTURE_FINENESS = 20_000
# A smaller picture has the same maximum deviation as a picture with this size [m].
MIN_SIZE = 1e-4
# Maximum angle between adjacent points of a curve [rad].
TURN = 0.06
# Maximum number of points per arc.
MAX_PER_ARC = 20_000
# Accumulated change of direction after which a point is always drawn [rad].
CORNER_TURN = 0.4
# Default maximum number of points that are always drawn because the direction changes.
MAX_CORNERS = 100_000
# Ratios of distances to the allowed error are rounded to multiples of this.
RATIO_STEP = 1e-6
# Minimum number of evenly spaced times in a motion.
MIN_SAMPLES = 200
# Default approximate maximum number of points in a drawing.
MAX_DRAWN = 20_000
# Approximate maximum number of points from which the drawn points are selected.
MAX_CANDIDATES = 200_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plane:
    """Plane of the picture in the work frame: origin [m] and unit vectors x and y, (3,) each."""

    origin: FloatArray
    x: FloatArray
    y: FloatArray

    @property
    def normal(self) -> FloatArray:
        """Unit normal of the plane, (3,)."""
        return np.asarray(np.cross(self.x, self.y))

    def uv(self, points: npt.ArrayLike) -> FloatArray:
        """Project points [m], (..., 2 or 3), to coordinates in the picture [m], (..., 2)."""
        coordinates = np.asarray(points, dtype=np.float64)
        offsets = coordinates - self.origin[: coordinates.shape[-1]]
        axes = np.stack([self.x, self.y], axis=1)[: coordinates.shape[-1]]
        return np.asarray(offsets @ axes)

    def lift(self, uv: npt.ArrayLike) -> FloatArray:
        """Return the points in space [m], (..., 3), of coordinates in the picture [m], (..., 2)."""
        u = np.asarray(uv, dtype=np.float64)
        return np.asarray(self.origin + u @ np.stack([self.x, self.y]))


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Projection of points onto the plane of the picture, relative to its centre."""

    plane: Plane
    # Centre of the picture in the plane [m], (2,); origin of the arrays for the page.
    centre: FloatArray

    def uv(self, points: FloatArray) -> FloatArray:
        """Project points [m], (n, 2 or 3), to coordinates in the plane [m], (n, 2)."""
        return self.plane.uv(in_space(points))

    def screen_points(self, points: FloatArray) -> FloatArray:
        """Project points to coordinates relative to the centre [m], float32, (n, 2)."""
        return np.asarray(self.uv(points) - self.centre, dtype=np.float32)

    def screen_vectors(self, vectors: FloatArray) -> FloatArray:
        """Project vectors to components in the plane, float32, (n, 2)."""
        axes = np.stack([self.plane.x, self.plane.y], axis=1)
        return np.asarray(in_space(vectors) @ axes, dtype=np.float32)

    @property
    def header(self) -> dict[str, Any]:
        """Header of a message frame with plane and centre."""
        plane = self.plane
        return {
            "plane": {"origin": plane.origin, "x": plane.x, "y": plane.y},
            "centre": self.centre,
        }


def in_space(points: FloatArray) -> FloatArray:
    """Return points with three coordinates, (..., 3); planar points get z = 0."""
    if points.shape[-1] == 3:
        return points
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)


def points_at(program: Program, s: FloatArray) -> FloatArray:
    """Return the points at arc lengths that are cumulated over all contours [m], (n, dimension)."""
    breaks = program.breaks
    contour_indices = np.clip(np.searchsorted(breaks, s, side="right") - 1, 0, len(breaks) - 2)
    points = np.empty((len(s), program.dimension))
    for k in np.unique(contour_indices).tolist():
        path = program.contours[k].path
        mask = contour_indices == k
        points[mask] = path(np.clip(s[mask] - breaks[k], 0.0, path.length))
    return points


def to_float32(values: FloatArray) -> Any:
    """Convert values to a contiguous float32 array."""
    return np.ascontiguousarray(values, dtype=np.float32)


def sample_times(duration: float) -> FloatArray:
    """Return evenly spaced times from 0 to a motion's duration [s], (n,)."""
    count = min(MAX_SAMPLES, max(MIN_SAMPLES, 1 + int(np.ceil(duration / MAX_SPACING))))
    return np.linspace(0.0, duration, count)


def select_points(weight: FloatArray, rows: Sequence[FloatArray], limit: int) -> IntArray:
    """Select about `limit` points to draw; return their indices.

    They are the points with infinite or the largest weights, the first and the last point, and the
    minima and maxima of the rows in equal intervals.
    """
    count = len(weight)
    if count <= limit:
        return np.arange(count)
    indices = np.flatnonzero(weight > 0)
    if len(indices) > limit // 2:
        heaviest = np.argpartition(weight[indices], -(limit // 2))[-(limit // 2) :]
        indices = np.union1d(indices[heaviest], np.flatnonzero(np.isinf(weight)))
    mask = np.zeros(count, dtype=bool)
    mask[indices] = mask[0] = mask[-1] = True
    parts = max(1, (limit - len(indices)) // (2 * len(rows)))
    width = -(-count // parts)
    table = np.nan_to_num(np.stack(rows))
    # The last interval may have fewer points, so it is processed separately.
    equal_end = count - count % width
    for begin, end in ((0, equal_end), (equal_end, count)):
        if begin < end:
            cut = table[:, begin:end].reshape(len(rows), -1, min(width, end - begin))
            first = begin + np.arange(cut.shape[1]) * width
            mask[first + cut.argmin(axis=2)] = True
            mask[first + cut.argmax(axis=2)] = True
    return np.flatnonzero(mask)


def allowed_drawing_error(uv: FloatArray) -> float:
    """Return how far a drawn line may be from its path [m], for picture points [m], (n, 2)."""
    # This measure of the size does not change when the path is rotated.
    radii = np.linalg.norm(uv - uv.mean(axis=0), axis=1)
    return max(2.0 * float(radii.max(initial=0.0)), MIN_SIZE) / PICTURE_FINENESS


def drawn_points(paths: Sequence[Path], error: float) -> tuple[FloatArray, IntArray]:
    """Sample lines [m], (n, dimension); also return each line's first index, and n."""
    # One evaluation of all paths is many times faster than one of each path.
    table = Segments.join([x.segments for x in paths])
    last = np.cumsum([len(x) for x in paths])
    i, share = _drawn_parts(table, error)
    points = table.evaluate(i, table.lengths[i] * share)
    firsts = np.searchsorted(i, last)
    points = np.insert(points, firsts, table[last - 1].ends, axis=0)
    return points, np.append(0, firsts + np.arange(1, len(paths) + 1))


def drawn_arc_lengths(
    path: Path, error: float, start: float = 0.0, end: float | None = None
) -> FloatArray:
    """Sample a path for drawing: return arc lengths of segment ends and points on curves [m]."""
    i, share = _drawn_parts(path.segments, error)
    s = np.append(path.breaks[i] + path.lengths[i] * share, path.length)
    last = path.length if end is None else end
    return np.concatenate([[start], s[(s > start) & (s < last)], [last]])


def drawn_curve(path: Path, start: float = 0.0, end: float | None = None) -> FloatArray:
    """Sample a part of a path for drawing, with points on curves by angle only [m], (n, dim)."""
    return path(drawn_arc_lengths(path, np.inf, start, end))


def _drawn_parts(table: Segments, error: float) -> tuple[IntArray, FloatArray]:
    """Sample segments for drawing: return each sample's segment, and its share of the length, (n,).

    The end of the last segment is not a sample. `error`: see `allowed_drawing_error` [m].
    """
    # A part turns by at most TURN, and is at most about `error` away from its chord.
    curvature = np.abs(table.curvatures)
    by_angle = curvature * table.lengths / TURN
    by_error = table.lengths * np.sqrt(curvature / error)
    parts = np.clip(np.ceil(np.maximum(by_angle, by_error)), 1, MAX_PER_ARC).astype(np.intp)
    i = np.repeat(np.arange(len(table)), parts)
    k = np.arange(len(i)) - np.repeat(np.cumsum(parts) - parts, parts)
    return i, k / parts[i]


def simplify(curves: Sequence[FloatArray], error: float, limit: int = MAX_DRAWN) -> list[IntArray]:
    """Select each curve's points to draw, about `limit` in all; return their indices."""
    step = max(1, sum(map(len, curves)) // MAX_CANDIDATES)
    sampled = [np.append(np.arange(0, len(x) - 1, step), len(x) - 1) for x in curves]
    points = np.concatenate([x[rows] for x, rows in zip(curves, sampled, strict=True)])
    ends = np.cumsum([0, *map(len, sampled)])
    size = float(np.ptp(points, axis=0).max())
    mask = essential_points(points, ends, error, limit)
    while mask.sum() > limit and error < size:
        error *= 2
        mask = essential_points(points, ends, error, 0)
    parts = np.split(mask, ends[1:-1])
    return [rows[drawn] for rows, drawn in zip(sampled, parts, strict=True)]


def essential_points(
    points: FloatArray, ends: IntArray, error: float, max_corners: int = MAX_CORNERS
) -> BoolArray:
    """Select the points to draw, as a mask, (n,): corners, and points that keep `error` [m].

    Args:
        points: Points of all lines [m], (n, dimension).
        ends: Each line's first index in `points`, and n, (lines + 1,).
        error: Largest distance from a line to an omitted point [m].
        max_corners: With more corners than this, corners are not preferred.
    """
    from armcontour.report.kernels import keep_error

    mask = np.zeros(len(points), dtype=np.bool_)
    mask[ends[:-1]] = mask[ends[1:] - 1] = True
    if max_corners > 0:
        # A point at which the accumulated turn passes a multiple of CORNER_TURN is a corner.
        turns = np.floor(_turns(points, ends) / CORNER_TURN)
        corners = 1 + np.flatnonzero(np.diff(turns))
        # A picture with more corners is hatching whose lines are too dense for the screen.
        if len(corners) <= max_corners:
            mask[corners] = True
    rows = np.array(points, dtype=np.float64, order="C")
    keep_error(rows, error, RATIO_STEP, mask, np.empty(len(points)))
    return mask


def _turns(points: FloatArray, ends: IntArray) -> FloatArray:
    """Return the change of direction, accumulated up to each point [rad], (n,)."""
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    along = step / np.where(length > 0, length, 1.0)
    cosine = np.einsum("ij,ij->i", along[1:], along[:-1])
    turn = np.zeros(len(points))
    turn[1:-1] = np.arccos(np.clip(cosine, -1.0, 1.0))
    turn[ends[:-1]] = turn[ends[1:] - 1] = 0.0
    return np.cumsum(turn)
