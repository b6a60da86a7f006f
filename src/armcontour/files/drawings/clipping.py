"""Plane paths cut at polygons, of which only the part inside counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.files.drawings.chain import Affine
from armcontour.geometry import Path
from armcontour.geometry.segments import REPEATED_POINT, Segments


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """A polygon at which drawn things are cut.

    Args:
        corners: Its corners, (n, dimension); what its edges wind around is inside.
        outside: Whether what lies outside is kept, instead of what lies inside.
    """

    corners: FloatArray
    outside: bool = False

    def place(self, to: Affine) -> Clip:
        """The image of the clip under an affine map."""
        return Clip(to(self.corners), self.outside)


def clip_path(path: Path, *clips: Clip) -> list[Path]:
    """The parts of a path in the plane that all clips keep, in their order.

    Lines and arcs are cut where they cross the edges; a closed path that begins inside goes on
    through its start.

    Args:
        path: A path in the plane.
        clips: The clips in the plane [m]; what lies on their edges is kept.
    """
    parts = [path]
    for clip in clips:
        parts = [x for part in parts for x in _clip_once(part, clip)]
    return parts


def _clip_once(path: Path, clip: Clip) -> list[Path]:
    """The parts of a path that one clip keeps."""
    table, polygon = path.segments, clip.corners
    i, begin, end = _cut_at_edges(table, polygon)
    inside = _kept(table.at(i, (begin + end) / 2), clip)
    if not inside.any():
        return []
    if inside.all():
        return [path]
    runs = np.split(np.arange(len(i)), np.flatnonzero(np.diff(inside)) + 1)
    kept = [run for run in runs if inside[run[0]]]
    closed = np.linalg.norm(path.vertices[-1] - path.vertices[0]) <= REPEATED_POINT
    if closed and inside[0] and inside[-1]:
        *kept, last = kept
        kept[0] = np.concatenate([last, kept[0]])
    return [Path(segments=table.cut(i[run], begin[run], end[run])) for run in kept]


def _cut_at_edges(table: Segments, polygon: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Segment, begin and end [m] of the parts between the crossings with a polygon's edges."""
    n = len(table)
    rows, places = [np.arange(n)], [np.zeros(n)]
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        size = float(np.linalg.norm(b - a))
        if size <= REPEATED_POINT:
            continue
        along = (b - a) / size
        for u in _crossings(table, a, np.array([-along[1], along[0]])):
            # Crossings at the ends of a segment or beside the edge do not cut.
            good = (u > REPEATED_POINT) & (u < table.lengths - REPEATED_POINT)
            i = np.flatnonzero(good)
            x = (table.at(i, u[i]) - a) @ along
            i = i[(x >= -REPEATED_POINT) & (x <= size + REPEATED_POINT)]
            rows.append(i)
            places.append(u[i])
    row, begin = np.concatenate(rows), np.concatenate(places)
    order = np.lexsort([begin, row])
    row, begin = row[order], begin[order]
    apart = np.append(True, (np.diff(row) > 0) | (np.diff(begin) > REPEATED_POINT))
    row, begin = row[apart], begin[apart]
    last = np.append(np.diff(row) > 0, True)
    return row, begin, np.where(last, table.lengths[row], np.append(begin[1:], 0.0))


def _crossings(table: Segments, a: FloatArray, normal: FloatArray) -> list[FloatArray]:
    """Distances along each segment [m] at which it meets a straight line; not finite for none.

    Args:
        table: Lines and arcs in the plane.
        a: A point of the straight line [m], (2,).
        normal: Unit normal of the straight line, (2,).
    """
    k = table.curvatures
    height = (table.starts - a) @ normal
    rise, bend = table.tangents @ normal, table.normals @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        straight = -height / rise
        # k height + bend + rise sin(ku) - bend cos(ku) = 0, and rise² + bend² = 1 for an arc.
        middle, half = np.arctan2(rise, -bend), np.arccos(-(k * height + bend))
        turns = [np.mod(middle + x, 2 * np.pi) / k for x in (-half, half)]
    return [np.where(k > 0, x, straight) for x in turns]


def _kept(points: FloatArray, clip: Clip) -> BoolArray:
    """Which points a clip keeps, (n,)."""
    winding = np.zeros(len(points), dtype=np.intp)
    near = np.zeros(len(points), dtype=bool)
    for a, b in zip(clip.corners, np.roll(clip.corners, -1, axis=0), strict=True):
        edge, v = b - a, points - a
        side = edge[0] * v[:, 1] - edge[1] * v[:, 0]
        up = (a[1] <= points[:, 1]) & (b[1] > points[:, 1])
        down = (a[1] > points[:, 1]) & (b[1] <= points[:, 1])
        winding += (up & (side > 0)).astype(np.intp) - (down & (side < 0))
        size = float(edge @ edge)
        share = np.clip(v @ edge / size, 0.0, 1.0) if size else np.zeros(len(v))
        near |= np.linalg.norm(v - share[:, None] * edge, axis=1) <= REPEATED_POINT
    return np.asarray(((winding != 0) != clip.outside) | near)
