"""Splines, and outlines of splines and chains, which become paths."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path, Segments
from armcontour.geometry.fit import fit_arcs
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings.affine import Affine
from armcontour.io.drawings.chain import Chain

# The gap of a closed outline is closed by moving the end only if it is at most this fraction of
# the length of the last line, arc or curve; otherwise a line closes it.
SMALL_GAP = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spline:
    """A rational B-spline.

    Args:
        points: Control points, (n, dimension).
        weights: Weights of the control points, (n,).
        knots: Knots in ascending order, (n + degree + 1,).
        degree: Degree of the polynomials.
    """

    points: FloatArray
    weights: FloatArray
    knots: FloatArray
    degree: int

    @classmethod
    def beziers(cls, points: FloatArray) -> Spline:
        """The spline of cubic Bézier curves in sequence, with control points (3 n + 1, dimension).

        The end point of each curve is the start point of the next one.
        """
        n = len(points) // 3
        knots = np.repeat(np.arange(n + 1.0), 3)
        knots = np.concatenate([[0.0], knots, [n]])
        return cls(points=points, weights=np.ones(len(points)), knots=knots, degree=3)

    def place(self, to: Affine) -> Spline:
        """The image of the spline under an affine map."""
        return dataclasses.replace(self, points=to(self.points))

    @property
    def starts(self) -> FloatArray:
        """The first point, (1, dimension)."""
        return self.points[:1]

    @property
    def last(self) -> FloatArray:
        """Start and end point of the last polynomial if it is a Bézier curve, (2, dimension)."""
        return self.points[[-1 - self.degree, -1]]

    def start_at(self, point: FloatArray) -> Spline:
        """A copy of the spline with another start point, (dimension,)."""
        return dataclasses.replace(self, points=np.concatenate([point[None], self.points[1:]]))

    def end_at(self, point: FloatArray) -> Spline:
        """A copy of the spline with another end point, (dimension,), and the same end tangent."""
        moved = [self.points[-2] + point - self.points[-1], point]
        return dataclasses.replace(self, points=np.concatenate([self.points[:-2], moved]))

    @property
    def reach(self) -> FloatArray:
        """Points whose bounding box contains the spline, (n, dimension)."""
        return self.points

    def to_segments(self, tolerance: float) -> Segments | None:
        """Tangent arcs within a tolerance [m] of the spline; None if the spline has no length.

        Raises:
            InvalidInput: The spline is too large for the tolerance.
        """
        from scipy.interpolate import BSpline

        if np.ptp(self.points, axis=0).max() <= REPEATED_POINT:
            return None
        if self.degree == 1:
            # Straight between the points, whatever the weights.
            return Path.polyline(self.points).segments
        inner = np.unique(self.knots[self.degree : len(self.points) + 1])
        if np.ptp(self.weights) == 0:
            plain = BSpline(self.knots, self.points, self.degree)
            return fit_arcs(lambda t, order: plain(t, order), inner, tolerance)
        weights = (self.weights / self.weights.max())[:, None]
        whole = BSpline(self.knots, np.hstack([weights * self.points, weights]), self.degree)

        def curve(t: FloatArray, order: int) -> FloatArray:
            value = whole(t)
            w, p = value[:, -1:], value[:, :-1] / value[:, -1:]
            if order == 0:
                return np.asarray(p)
            change = whole(t, 1)
            return np.asarray((change[:, :-1] - p * change[:, -1:]) / w)

        return fit_arcs(curve, inner, tolerance)


Shape = Chain | Spline


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Shapes in sequence.

    Args:
        shapes: The shapes, each of which starts at the end of the one before.
        closed: Whether the last shape must end where the first one starts.
    """

    shapes: Sequence[Shape]
    closed: bool = False

    def place(self, to: Affine) -> Outline:
        """The image of the outline under an affine map."""
        return Outline([x.place(to) for x in self.shapes], self.closed)

    @property
    def reach(self) -> FloatArray:
        """Points whose largest coordinates tell how far the outline extends, (m, dimension)."""
        return np.concatenate([x.reach for x in self.shapes])

    def to_path(self, tolerance: float, join: float = 0.0) -> Path | None:
        """The path of the outline; None if it has no length.

        Lines stay lines, and arcs of circles arcs; other curves become tangent arcs.

        Args:
            tolerance: Largest distance between a curve and its arcs [m].
            join: Largest gap of a closed outline that is closed by moving its end [m].

        Raises:
            InvalidInput: A curve is too large for the tolerance.
        """
        tables: list[Segments] = []
        for x in self._closed(join):
            table = (x.start_at(tables[-1][-1:].ends[0]) if tables else x).to_segments(tolerance)
            if table is not None:
                tables.append(table)
        return Path(segments=Segments.join(tables)) if tables else None

    def _closed(self, join: float) -> Sequence[Shape]:
        """The shapes, of a closed outline with its gap closed: by moving the end, or by a line."""
        if not self.closed:
            return self.shapes
        *others, last = self.shapes
        start, (before, end) = self.shapes[0].starts[0], last.last
        gap, size = (float(np.linalg.norm(end - x)) for x in (start, before))
        if gap > min(join, SMALL_GAP * size):
            return [*self.shapes, Chain.straight(np.stack([end, start]))]
        return [*others, last.end_at(start)]
