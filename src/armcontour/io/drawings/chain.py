"""Lines and arcs of ellipses, exact until they become segments."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.geometry import Segments
from armcontour.geometry.fit import fit_arcs
from armcontour.geometry.segments import REPEATED_POINT, close_up
from armcontour.io.drawings.affine import Affine

# An ellipse whose axes differ by no more than this part of the chord tolerance is a circle.
SAME_AXES = 0.01
# No circle is an ellipse whose axes differ by more than the square root of this part.
FLAT = 0.01
# An arc that is drawn by its radius ends where it should within this [m].
SAME_END = 0.1 * REPEATED_POINT
# Where the axes differ by no more than this part of them, the difference is rounding.
ROUND = 1e-12
# From its chord, an arc of more than this [rad] is not known well.
WELL_KNOWN = 1.5 * np.pi
# Vertices nearer than this are one [m]: so close that a path takes what is left for no gap.
ONE_VERTEX = 0.5 * REPEATED_POINT
# An arc of more than this [rad] reaches about as far as all of its ellipse.
WIDE = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """Lines and arcs of ellipses, each of which starts where the one before ends.

    Arc i is `starts[i] + cosines[i] (cos t - 1) + sines[i] sin t` for t from 0 to `angles[i]`;
    lines have no angle.

    Args:
        starts: (n, dimension).
        ends: As they are drawn, without the rounding of the arcs, (n, dimension).
        cosines: From the centre to the start, (n, dimension).
        sines: The conjugate semi-diameters, (n, dimension).
        angles: Swept angles [rad], (n,).
    """

    starts: FloatArray
    ends: FloatArray
    cosines: FloatArray
    sines: FloatArray
    angles: FloatArray

    @classmethod
    def straight(cls, points: FloatArray) -> Chain:
        """Lines through points, (n + 1, dimension)."""
        zeros = np.zeros_like(points[1:])
        return cls(
            starts=points[:-1],
            ends=points[1:],
            cosines=zeros,
            sines=zeros,
            angles=np.zeros(len(zeros)),
        )

    @classmethod
    def arc(
        cls,
        centre: FloatArray,
        cosine: FloatArray,
        sine: FloatArray,
        angle: float,
        ends: FloatArray | None = None,
    ) -> Chain:
        """One arc around a centre, (dimension,); `ends`, (2, dimension), if they are known."""
        if ends is None:
            start = centre + cosine
            end = centre + np.cos(angle) * cosine + np.sin(angle) * sine
            ends = np.stack([start, start if angle == 2 * np.pi else end])
        return cls(
            starts=ends[:1],
            ends=ends[1:],
            cosines=cosine[None],
            sines=sine[None],
            angles=np.array([angle]),
        )

    @classmethod
    def join(cls, chains: Sequence[Chain]) -> Chain:
        """Chains one after the other."""
        return cls(**{x: np.concatenate([getattr(y, x) for y in chains]) for x in cls.__slots__})

    def __getitem__(self, rows: BoolArray | IntArray) -> Chain:
        """Some of the lines and arcs."""
        return Chain(**{name: getattr(self, name)[rows] for name in self.__slots__})

    def place(self, to: Affine) -> Chain:
        """The chain as an affine map changes it."""
        return Chain(
            starts=to(self.starts),
            ends=to(self.ends),
            cosines=to.turn(self.cosines),
            sines=to.turn(self.sines),
            angles=self.angles,
        )

    def halve(self) -> Chain:
        """The chain with each line or arc in two."""
        middles, half = self._at(0.5), self.angles[:, None] / 2
        c, s = np.cos(half), np.sin(half)
        first = dataclasses.replace(self, ends=middles, angles=self.angles / 2)
        second = Chain(
            starts=middles,
            ends=self.ends,
            cosines=c * self.cosines + s * self.sines,
            sines=c * self.sines - s * self.cosines,
            angles=self.angles / 2,
        )
        return Chain.join([first, second])[np.arange(2 * len(half)).reshape(2, -1).T.ravel()]

    @property
    def last(self) -> FloatArray:
        """Ends of the last line or arc, (2, dimension)."""
        return np.stack([self.starts[-1], self.ends[-1]])

    def start_at(self, point: FloatArray) -> Chain:
        """The chain from another start."""
        return dataclasses.replace(self, starts=np.concatenate([point[None], self.starts[1:]]))

    def end_at(self, point: FloatArray) -> Chain:
        """The chain to another end."""
        return dataclasses.replace(self, ends=np.concatenate([self.ends[:-1], point[None]]))

    @property
    def reach(self) -> FloatArray:
        """Points from which no other one is far, (m, dimension)."""
        points = [self.starts[:1], self.ends]
        if self.angles.any():
            wide = self.angles > WIDE
            centres = (self.starts - self.cosines)[wide]
            sizes = np.hypot(self.cosines[wide], self.sines[wide])
            # Of a narrow arc the ellipse reaches much farther than the arc.
            narrow = self[(self.angles > 0) & ~wide]
            points += [centres - sizes, centres + sizes, narrow._at(0.5)]
        return np.concatenate(points)

    def to_segments(self, tolerance: float) -> Segments | None:
        """Lines and arcs of circles as they are, others within a tolerance [m]; None if no length.

        Raises:
            InvalidInput: An arc that is too large for the tolerance.
        """
        chain = self._without_points()
        if not len(chain.angles):
            return None
        elliptical = chain._elliptical(tolerance)
        if not elliptical.any():
            return chain._as_drawn()
        runs = np.split(np.arange(len(elliptical)), np.flatnonzero(np.diff(elliptical)) + 1)
        parts = [
            chain[run]._fitted(tolerance) if elliptical[run[0]] else chain[run]._as_drawn()
            for run in runs
        ]
        return Segments.join(parts)

    def _without_points(self) -> Chain:
        """What goes somewhere; ends that are one vertex become one."""
        arc = self.angles > 0
        if arc.any():
            radius = np.maximum(*(np.linalg.norm(x, axis=1) for x in (self.cosines, self.sines)))
            arc = radius * self.angles > ONE_VERTEX
        starts, kept = close_up(self.starts, self.ends, arc, ONE_VERTEX)
        if kept.all():
            return self
        angles = np.where(arc, self.angles, 0.0)
        return dataclasses.replace(self, starts=starts, angles=angles)[kept]

    def _elliptical(self, tolerance: float) -> BoolArray:
        """Whether it is an arc of an ellipse that is no circle within the tolerance [m]."""
        arc = self.angles > 0
        if not arc.any():
            return arc
        u, v = self.cosines, self.sines
        long, wide, across = (np.sum(x * y, axis=1) for x, y in ((u, u), (v, v), (u, v)))
        # Longest minus shortest semi-axis, squared, without the difference of large numbers.
        area = np.sqrt(np.maximum(long * wide - across**2, 0.0))
        with np.errstate(invalid="ignore"):
            skew = np.nan_to_num(2 * across**2 / (np.sqrt(long * wide) + area))
        off = (np.sqrt(long) - np.sqrt(wide)) ** 2 + skew
        # From its chord, a long arc is known well if it is round to the last digit only.
        long_arc = (self.angles > WELL_KNOWN) & (self.angles < 2 * np.pi)
        allowed = np.minimum((SAME_AXES * tolerance) ** 2, FLAT * np.maximum(long, wide))
        return np.asarray(arc & (off > np.where(long_arc, ROUND**2 * long, allowed)))

    def _at(self, share: float | FloatArray, order: int = 0) -> FloatArray:
        """Points, or derivatives, at shares of the angles; the ends are met exactly."""
        x = np.broadcast_to(share, self.angles.shape)[:, None]
        a = self.angles[:, None]
        c, s = np.cos(a * x), np.sin(a * x)
        missed = self.ends - self.starts
        missed = missed - (np.cos(a) - 1) * self.cosines - np.sin(a) * self.sines
        if order:
            return np.asarray(a * (c * self.sines - s * self.cosines) + missed)
        return np.asarray(self.starts + (c - 1) * self.cosines + s * self.sines + x * missed)

    def _fitted(self, tolerance: float) -> Segments:
        """Arcs of ellipses as tangent arcs; arc i has the parameters from i to i + 1."""
        n = len(self.angles)

        def curve(t: FloatArray, order: int) -> FloatArray:
            i = np.clip(np.floor(t).astype(np.intp), 0, n - 1)
            return self[i]._at(t - i, order)

        quarters = np.maximum(np.ceil(self.angles / (np.pi / 2) - 1e-9), 1).astype(np.intp)
        i = np.repeat(np.arange(n), quarters)
        k = np.arange(len(i)) - np.repeat(np.cumsum(quarters) - quarters, quarters)
        return fit_arcs(curve, np.append(i + k / quarters[i], n), tolerance)

    def _as_drawn(self) -> Segments:
        """Lines, and arcs of circles by their radii, or through their ends where these differ."""
        arc = self.angles > 0
        if not arc.any():
            return Segments.lines(np.concatenate([self.starts, self.ends[-1:]]))
        chords = self.ends - self.starts
        sizes = np.linalg.norm(chords, axis=1)
        radii = np.where(arc, np.linalg.norm(self.cosines, axis=1), 1.0)
        tangents = np.where(arc[:, None], self.sines, chords)
        tangents = tangents / np.linalg.norm(tangents, axis=1)[:, None]
        normals = np.where(arc[:, None], -self.cosines / radii[:, None], 0.0)
        drawn = Segments(
            starts=self.starts,
            tangents=tangents,
            normals=normals - np.sum(normals * tangents, axis=1)[:, None] * tangents,
            curvatures=np.where(arc, 1 / radii, 0.0),
            lengths=np.where(arc, radii * self.angles, sizes),
        )
        off = arc & (np.linalg.norm(drawn.ends - self.ends, axis=1) > SAME_END)
        return drawn.put(off, self[off]._through_ends()) if off.any() else drawn

    def _through_ends(self) -> Segments:
        """Arcs of circles through their ends, with their angles."""
        chords, half = self.ends - self.starts, self.angles / 2
        sizes = np.linalg.norm(chords, axis=1)
        along = chords / sizes[:, None]
        c, s = np.cos(half)[:, None], np.sin(half)[:, None]
        towards = -c * self.cosines - s * self.sines
        towards = towards - np.sum(towards * along, axis=1)[:, None] * along
        towards = towards / np.linalg.norm(towards, axis=1)[:, None]
        curvatures = 2 * np.sin(half) / sizes
        return Segments(
            starts=self.starts,
            tangents=c * along - s * towards,
            normals=c * towards + s * along,
            curvatures=curvatures,
            lengths=self.angles / curvatures,
        )
