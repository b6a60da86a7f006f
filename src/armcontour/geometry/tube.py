"""The tube around an objective path, and the proof that another path stays in it.

A path satisfies its tolerance if each of its points is within the tolerance of the objective's part
that extends by `reach` around the corresponding arc length, and if each corner of the objective is
within the tolerance of its part of the path. The parts are local, so a path that switches to a
crossing line or to a neighbouring pass violates the tolerance.

The proof. A part of a path segment with curvature k and length l, and a part of an objective piece
with curvature k' and length l', are both passed evenly while t runs from 0 to 1. The difference D
of their points has D'' = k l² n - k' l'² n', where n and n' are the unit normals. D differs from
its linear interpolation by at most max |D''| / 8, so

    |D(t)| <= max(|D(0)|, |D(1)|) + max |D''| / 8
    |D''|  <= |k l² - k' l'²| + min(k l², k' l'²) max |n - n'|

and |n - n'|, at most 2, exceeds its values at the ends by no more than ((k l)² + (k' l')²) / 8, or
2 k' l' |b - b'| with the axes b and b' about which the tangents turn. The ends of the objective's
part are the nearest points to the ends of the path's part within reach. Arc lengths and reach
change linearly along the part, so all matched points are then within reach. Therefore this bounds
the distance of every point from its part of the objective. Parts of the path are halved until the
bound proves the tolerance for one piece, or until a point violates the tolerance of every piece.
Where the tolerance changes, points whose nearest point of the piece with the larger tolerance is
its end belong to the neighbour: no tolerance extends beyond its zone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, Frozen, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.geometry.path import Path
from armcontour.geometry.projection import pack_segments, pad_to_space
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE, Segments
from armcontour.geometry.shaped_path import check_correspondence

# Rounding errors of distances and arc lengths, in metres plus the same fraction of the path's size.
# Tolerances and reach may be exceeded by this value.
SLACK = 1e-12
# All corners of an objective
ALL = slice(None)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proof:
    """Result of a proof. Values are distance minus tolerance, above 0 outside the tube.

    The path is within its tolerance if all values are at most `slack`.

    Args:
        segments: Upper bound for each segment of the path [m], (n,).
        vertices: Value for each corner of the objective [m], (k,).
        slack: Rounding error that the bounds may have [m].
    """

    segments: FloatArray
    vertices: FloatArray
    slack: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tube(Frozen):
    """All points within a tolerance of an objective path, piece by piece.

    Args:
        objective: The objective path.
        segments: Pieces of the objective path, m lines and arcs.
        breaks: Arc lengths on the objective at which the pieces start and end [m], (m + 1,).
        tolerance: Largest distance from each piece [m], (m,).
        vertex: Indices of the objective's corners among its vertices, from 0, (k,).
        vertex_tolerance: Largest distance from each corner to the path [m], (k,).
    """

    objective: Path
    segments: Segments
    breaks: FloatArray
    tolerance: FloatArray
    vertex: IntArray
    vertex_tolerance: FloatArray
    _pieces: tuple[FloatArray, FloatArray, BoolArray] = field(init=False, repr=False)

    def _check_together(self) -> None:
        _check_no_transitions(self.segments)
        object.__setattr__(self, "_pieces", self._pack_pieces())

    def _pack_pieces(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Pack the fields of `TubePieces`."""
        rows = pack_segments(self.segments)
        rows[:, 11] = self.breaks[:-1]
        # Points beyond the end of a piece with a larger tolerance belong to its neighbour.
        step = np.diff(self.tolerance)
        excluded_ends = np.stack([np.append(False, step > 0), np.append(step < 0, False)], axis=1)
        return rows, np.array(self.tolerance), excluded_ends

    @classmethod
    def around(cls, objective: Path, tolerance: npt.ArrayLike) -> Tube:
        """Return the tube around an objective path.

        Tolerances of the objective's own segments cap those of their pieces and corners.

        Args:
            objective: The objective path.
            tolerance: Largest distance [m]: one number, or one per vertex between segments. The
                tolerance of a vertex applies up to the middle between it and the next vertex.

        Raises:
            InvalidInput: A tolerance is negative or not a number, their number is wrong, or the
                objective has transitions.
        """
        values = checks.per_vertex("tolerance", tolerance, len(objective) - 1, "m")
        corner = np.flatnonzero(objective.turns > TANGENT_TOLERANCE)
        inner = objective.breaks[1:-1]
        middles = (inner[1:] + inner[:-1]) / 2
        # The tolerance changes at these arc lengths, which are not vertices.
        changes = middles if np.ndim(tolerance) else inner[:0]
        changes = changes[(changes > 0) & (changes < objective.length)]
        neighbours = objective.breaks[objective.locate(changes) + np.array([[0], [1]])]
        changes = changes[np.abs(neighbours - changes).min(axis=0) > REPEATED_POINT]
        breaks = np.unique(np.concatenate([objective.breaks, changes]))
        source = objective.locate((breaks[:-1] + breaks[1:]) / 2)
        begin = np.maximum(breaks[:-1] - objective.breaks[source], 0.0)
        segments = objective.segments.cut(source, begin, breaks[1:] - objective.breaks[source])
        tolerances = np.full(len(segments), 0.0 if np.ndim(tolerance) else tolerance)
        if len(inner):
            tolerances = values[np.searchsorted(middles, (breaks[1:] + breaks[:-1]) / 2)]
        caps = np.where(np.isnan(objective.tolerances), np.inf, objective.tolerances)
        return cls(
            objective=objective,
            segments=segments,
            breaks=breaks,
            tolerance=np.minimum(tolerances, caps[source]),
            vertex=corner + 1,
            vertex_tolerance=np.minimum(values, np.minimum(caps[:-1], caps[1:]))[corner],
        )

    def __len__(self) -> int:
        """Number of pieces."""
        return len(self.segments)

    def nearest(self, points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the arc lengths of the objective's nearest points, each in a range [m], (n,).

        - `points`: the points [m], (n, dimension).
        - `low`: arc lengths on the objective at which the range of each point starts [m], (n,).
        - `high`: arc lengths at which the ranges end [m], (n,).
        """
        ranges = np.stack([low, np.maximum(low, high)], axis=1)
        windows = self.windows_between(ranges[:, 0], ranges[:, 1])
        _, s = _nearest_in_range(points, ranges, windows, self._pieces[0])
        return np.asarray(np.clip(s, low, high))

    def margin(self, points: FloatArray, windows: IntArray) -> FloatArray:
        """Return the remaining distance to the boundary of the tube, below 0 outside [m], (n,).

        The margin is the largest one of these pieces.

        - `points`: the points [m], (n, dimension).
        - `windows`: first and last piece of each point's part, as from `windows_between`, (n, 2).
        """
        from armcontour.geometry.kernels import TubePieces, find_excess

        everywhere = np.tile([-np.inf, np.inf], (len(points), 1))
        excess, _ = find_excess(
            pad_to_space(points), everywhere, windows, TubePieces(*self._pieces)
        )
        return np.asarray(-excess)

    def prove(self, path: Path, places: npt.ArrayLike, reach: npt.ArrayLike) -> Proof:
        """Bound the distances from path points to the objective, and from its corners to the path.

        The bounds are rigorous up to rounding errors, see `Proof.slack`.

        Args:
            path: The path.
            places: Corresponding arc lengths on the objective and on the path [m], from start to
                end, neither decreasing, (n, 2); linear between them.
            reach: Half length of a point's part of the objective [m]: a number, or one per row of
                `places`, (n,), linear between them.

        Raises:
            InvalidInput: The places do not run from start to end of both paths, the path has
                another dimension than the objective, or the path has transitions.
        """
        if path.dimension != self.objective.dimension:
            raise InvalidInput(
                f"The path and its objective must have the same number of coordinates, but have "
                f"{path.dimension} and {self.objective.dimension}."
            )
        _check_no_transitions(path.segments)
        return self.prove_part(path, check_correspondence(places, self.objective, path), reach)

    def prove_part(
        self, path: Path, places: FloatArray, reach: npt.ArrayLike, corners: slice = ALL
    ) -> Proof:
        """Bound distances as `prove` does, for a path along a part of the objective.

        Args:
            path: Lines and arcs.
            places: Corresponding arc lengths on the objective and on the path [m], neither
                decreasing, (n, 2); linear between them. Those on the path run from its start to its
                end.
            reach: As in `prove`.
            corners: The corners of the part.
        """
        from armcontour.geometry.kernels import TubePieces, bound_excess

        size = max(float(np.abs(self.objective.segments.extent).max()), self.breaks[-1])
        slack = SLACK * (1 + float(size))
        # The reach includes rounding errors, so an arc length slightly beyond the end of its piece
        # still belongs to the piece.
        reaches = np.broadcast_to(np.asarray(reach, dtype=np.float64) + slack, len(places))
        segment, parts = self._divide(path, places, reaches)
        # Arc length on the objective and reach at both ends of each part.
        centres = parts[:, 1::3]
        part_reaches = parts[:, 2::3]
        low = (centres - part_reaches).min(axis=1)
        high = (centres + part_reaches).max(axis=1)
        windows = self.windows_between(low, high)
        bounds = bound_excess(
            pack_segments(path.segments), segment, parts, windows, TubePieces(*self._pieces), slack
        )
        segments = np.full(len(path), -np.inf)
        np.maximum.at(segments, segment, bounds)
        distance, _ = self.nearest_to_corners(path, places, reaches, corners)
        vertices = distance - self.vertex_tolerance[corners]
        return Proof(segments=segments, vertices=vertices, slack=slack)

    def windows_between(self, low: FloatArray, high: FloatArray) -> IntArray:
        """Return the indices of the first and the last piece of arc length ranges, (n, 2).

        - `low`, `high`: arc lengths on the objective at which the ranges start and end [m], (n,).
        """
        last = len(self) - 1
        first = np.searchsorted(self.breaks[1:], low, side="left")
        end = np.searchsorted(self.breaks[:-1], high, side="right") - 1
        return np.stack([np.clip(first, 0, last), np.clip(end, 0, last)], axis=1)

    def _divide(
        self, path: Path, pairs: FloatArray, reach: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Divide a path into parts with linear arc length on the objective and linear reach.

        Returns the segment of each part, (m,), and at its start and its end: the arc length on this
        segment, the arc length on the objective, and the reach [m], (m, 6).
        """
        objective_s = pairs[:, 0]
        path_s = pairs[:, 1]
        piece_ends = np.interp(self.breaks, objective_s, path_s)
        cuts = np.concatenate([path.breaks, path_s, piece_ends])
        cuts = np.unique(np.clip(cuts, 0, path.length))
        low = cuts[:-1]
        high = cuts[1:]
        middle = (low + high) / 2
        segment = path.locate(middle)
        # Where the arc length on the objective jumps, the one-sided value is used.
        k = np.clip(np.searchsorted(path_s, middle, side="right") - 1, 0, len(path_s) - 2)
        ends = []
        for s in (low, high):
            share = np.clip((s - path_s[k]) / (path_s[k + 1] - path_s[k]), 0.0, 1.0)
            u = np.clip(s - path.breaks[segment], 0.0, path.lengths[segment])
            centre = np.clip(
                objective_s[k] + share * (objective_s[k + 1] - objective_s[k]), 0.0, self.breaks[-1]
            )
            ends += [u, centre, reach[k] + share * (reach[k + 1] - reach[k])]
        return segment, np.stack(ends, axis=1)

    def corners_between(self, low: float, high: float) -> slice:
        """Return the corners between two arc lengths on the objective [m], less the ends."""
        corner_s = self.objective.breaks[self.vertex]
        first = np.searchsorted(corner_s, low, side="right")
        return slice(int(first), int(np.searchsorted(corner_s, high, side="left")))

    def nearest_to_corners(
        self, path: Path, places: FloatArray, reach: FloatArray, corners: slice = ALL
    ) -> tuple[FloatArray, FloatArray]:
        """Return each corner's distance from its part of a path, and the nearest arc length [m].

        - `places`: corresponding arc lengths on the objective and on the path [m], (n, 2).
        - `reach`: half length of the part at each row of `places` [m], (n,).
        - `corners`: the corners, by default all.
        """
        corner_s = self.objective.breaks[self.vertex[corners]]
        objective_s = places[:, 0]
        path_s = places[:, 1]
        half = np.interp(corner_s, objective_s, reach)
        ends = [np.interp(x, objective_s, path_s) for x in (corner_s - half, corner_s + half)]
        windows = np.stack([path.locate(ends[0]), path.locate(ends[1])], axis=1)
        points = self.objective.vertices[self.vertex[corners]]
        return _nearest_in_range(
            points, np.stack(ends, axis=1), windows, pack_segments(path.segments)
        )


def _nearest_in_range(
    points: FloatArray, ranges: FloatArray, windows: IntArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the distance and arc length of the nearest point in each point's range [m], (n,) each.

    - `points`: the points [m], (n, dimension).
    - `ranges`: arc lengths at which each point's range starts and ends [m], (n, 2).
    - `windows`: indices of the first and last segment of each range, (n, 2).
    - `rows`: segments from `pack_segments`.
    """
    from armcontour.geometry.kernels import TubePieces, find_excess

    pieces = TubePieces(rows, np.zeros(len(rows)), np.zeros((len(rows), 2), np.bool_))
    return find_excess(pad_to_space(points), ranges, windows, pieces)


def _check_no_transitions(segments: Segments) -> None:
    """Raise InvalidInput for a transition, because the proof holds for lines and arcs only."""
    if segments.is_transition.any():
        i = int(np.argmax(segments.is_transition))
        raise InvalidInput(
            f"Segment {i + 1} is a transition between curvatures, but a tube supports lines and "
            "arcs only. Shape the path before you smooth its curvature.",
            index=i,
        )
