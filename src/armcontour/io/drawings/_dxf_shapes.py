"""What a DXF entity draws: chains of lines and arcs of ellipses, and splines; exact until here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.geometry import Path
from armcontour.geometry.curves import arcs_of
from armcontour.geometry.path import REPEATED_POINT

# Semi-diameters that differ in length or from a right angle by this part make a circle.
ROUND = 1e-12
# A bulge below this makes an arc that leaves its chord by half this part of it, a line.
NO_BULGE = 1e-12
# Vertices nearer than this are one [m]: so close that a path takes what is left for no gap.
ONE_VERTEX = 0.5 * REPEATED_POINT


class Unreadable(Exception):
    """What is wrong with an entity, as the end of a sentence that names it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Affine:
    """`linear @ p + offset`."""

    linear: FloatArray
    offset: FloatArray

    def points(self, p: FloatArray) -> FloatArray:
        """Points, (..., 3)."""
        return np.asarray(p @ self.linear.T + self.offset)

    def vectors(self, v: FloatArray) -> FloatArray:
        """Differences of points, (..., 3)."""
        return np.asarray(v @ self.linear.T)

    def after(self, first: Affine) -> Affine:
        """The other one, and then this one."""
        return Affine(linear=self.linear @ first.linear, offset=self.points(first.offset))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """Lines and arcs of ellipses, each of which starts where the one before ends.

    Arc i is `vertices[i] + cosine[i] (cos t - 1) + sine[i] sin t` for t from 0 to `angles[i]`;
    lines have no angle.

    Args:
        vertices: (n + 1, 3).
        cosine, sine: Conjugate semi-diameters, (n, 3).
        angles: Swept angles [rad], (n,).
    """

    vertices: FloatArray
    cosine: FloatArray
    sine: FloatArray
    angles: FloatArray

    @classmethod
    def arc(cls, centre: FloatArray, cosine: FloatArray, sine: FloatArray, angle: float) -> Chain:
        """One arc around a centre."""
        ends = [centre + cosine, centre + np.cos(angle) * cosine + np.sin(angle) * sine]
        if angle == 2 * np.pi:
            ends[1] = ends[0]
        return cls(
            vertices=np.array(ends),
            cosine=cosine[None],
            sine=sine[None],
            angles=np.array([angle]),
        )

    @classmethod
    def straight(cls, points: FloatArray) -> Chain:
        """Lines through points, (n + 1, 3)."""
        n = len(points) - 1
        zeros = np.zeros((n, 3))
        return cls(vertices=points, cosine=zeros, sine=zeros, angles=np.zeros(n))

    @classmethod
    def bulged(cls, points: FloatArray, bulges: FloatArray, normal_axes: FloatArray) -> Chain:
        """A polyline; a bulge is the tangent of a quarter of the angle that its arc sweeps.

        Args:
            points: (n + 1, 3).
            bulges: (n,), positive to the left of the direction.
            normal_axes: Axes of the plane that the arcs lie in, as columns.
        """
        chord = np.diff(points, axis=0)
        bent = (np.abs(bulges) > NO_BULGE) & (np.abs(chord).max(axis=1, initial=0.0) > 0)
        b = np.where(bent, bulges, 1.0)[:, None]
        left = np.cross(normal_axes[:, 2], chord)
        # From the centre to the start, without the difference of large numbers.
        cosine = -chord / 2 - left * (1 - b * b) / (4 * b)
        sine = np.sign(b) * np.cross(normal_axes[:, 2], cosine)
        return cls(
            vertices=points,
            cosine=np.where(bent[:, None], cosine, 0.0),
            sine=np.where(bent[:, None], sine, 0.0),
            angles=np.where(bent, 4 * np.arctan(np.abs(bulges)), 0.0),
        )

    def placed(self, affine: Affine) -> Chain:
        """The same after an affine map."""
        return Chain(
            vertices=affine.points(self.vertices),
            cosine=affine.vectors(self.cosine),
            sine=affine.vectors(self.sine),
            angles=self.angles,
        )

    @property
    def corners(self) -> FloatArray:
        """Points around all of it, (m, 3)."""
        centre = self.vertices[:-1] - self.cosine
        size = np.hypot(self.cosine, self.sine)
        return np.concatenate([self.vertices, centre - size, centre + size])

    def path(self, dimension: int, tolerance: float) -> Path | None:
        """The path in the plane or in space, ellipses within a tolerance [m]; None if no length."""
        p = self.vertices[:, :dimension].copy()
        u, v = self.cosine[:, :dimension], self.sine[:, :dimension]
        a, b = np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)
        arc = (self.angles > 0) & (np.maximum(a, b) * self.angles > ONE_VERTEX)
        size = np.linalg.norm(np.diff(p, axis=0), axis=1)
        kept = arc | (size > ONE_VERTEX)
        if not kept.all():
            kept = _kept(p, arc)
        if not kept.any():
            return None
        skew = np.abs(np.sum(u * v, axis=1))
        circle = arc & (np.abs(a - b) <= ROUND * a) & (skew <= ROUND * a * b)
        segments = (p[:-1][kept], np.diff(p, axis=0)[kept], u[kept], v[kept], self.angles[kept])
        if (arc & ~circle).any():
            return _curved(*segments, arc[kept], tolerance)
        return _lines_and_circles(*segments, circle[kept])


def _lines_and_circles(
    starts: FloatArray,
    chords: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    angles: FloatArray,
    circle: BoolArray,
) -> Path:
    radius = np.where(circle, np.linalg.norm(cosine, axis=1), 1.0)
    along = np.where(circle[:, None], sine, chords)
    tangents = along / np.linalg.norm(along, axis=1)[:, None]
    inwards = np.where(circle[:, None], -cosine / radius[:, None], 0.0)
    inwards -= np.sum(inwards * tangents, axis=1)[:, None] * tangents
    return Path(
        starts=starts,
        tangents=tangents,
        inwards=inwards,
        curvatures=np.where(circle, 1 / radius, 0.0),
        lengths=np.where(circle, radius * angles, np.linalg.norm(chords, axis=1)),
    )


def _kept(p: FloatArray, arc: BoolArray) -> BoolArray:
    """Segments that go somewhere; vertices, changed in place, of the others are one."""
    kept = arc.copy()
    for i in range(len(arc)):
        if not arc[i]:
            # Measured from the last vertex kept, so that many small steps are not lost.
            kept[i] = np.linalg.norm(p[i + 1] - p[i]) > ONE_VERTEX
            if not kept[i]:
                p[i + 1] = p[i]
    return kept


def _curved(
    starts: FloatArray,
    chords: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    angles: FloatArray,
    arc: BoolArray,
    tolerance: float,
) -> Path:
    """All segments as one curve, of which segment i has the parameters from i to i + 1."""
    n = len(starts)
    u, v = np.where(arc[:, None], cosine, 0.0), np.where(arc[:, None], sine, 0.0)
    straight = np.where(arc[:, None], 0.0, chords)

    def curve(t: FloatArray, order: int) -> FloatArray:
        i = np.clip(np.floor(t).astype(np.intp), 0, n - 1)
        x = (t - i)[:, None]
        a = angles[i][:, None]
        c, s = np.cos(a * x), np.sin(a * x)
        if order:
            return np.asarray(a * (c * v[i] - s * u[i]) + straight[i])
        return np.asarray(starts[i] + (c - 1) * u[i] + s * v[i] + x * straight[i])

    quarters = np.where(arc, np.maximum(np.ceil(angles / (np.pi / 2) - 1e-9), 1), 1).astype(int)
    i = np.repeat(np.arange(n), quarters)
    k = np.arange(len(i)) - np.repeat(np.cumsum(quarters) - quarters, quarters)
    return arcs_of(curve, np.append(i + k / quarters[i], n), tolerance)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spline:
    """A rational B-spline.

    Args:
        points: Control points, (n, 3).
        weights: Theirs, (n,).
        knots: (n + degree + 1,), in order.
        degree: Of its polynomials.
    """

    points: FloatArray
    weights: FloatArray
    knots: FloatArray
    degree: int

    def placed(self, affine: Affine) -> Spline:
        """The same after an affine map."""
        return Spline(
            points=affine.points(self.points),
            weights=self.weights,
            knots=self.knots,
            degree=self.degree,
        )

    @property
    def corners(self) -> FloatArray:
        """Points around all of it, (n, 3)."""
        return self.points

    def path(self, dimension: int, tolerance: float) -> Path | None:
        """The path in the plane or in space within a tolerance [m]; None if it has no length."""
        from scipy.interpolate import BSpline

        points = self.points[:, :dimension]
        if np.ptp(points, axis=0).max() <= REPEATED_POINT:
            return None
        if self.degree == 1:
            # Straight between its points, whatever their weights.
            return Path.polyline(points)
        weights = self.weights / self.weights.max()
        whole = BSpline(
            self.knots, np.column_stack([weights[:, None] * points, weights]), self.degree
        )

        def curve(t: FloatArray, order: int) -> FloatArray:
            value = whole(t)
            w, p = value[:, -1:], value[:, :-1] / value[:, -1:]
            if order == 0:
                return np.asarray(p)
            change = whole(t, 1)
            return np.asarray((change[:, :-1] - p * change[:, -1:]) / w)

        inner = self.knots[self.degree : len(self.points) + 1]
        return arcs_of(curve, np.unique(inner), tolerance)


Shape = Chain | Spline
