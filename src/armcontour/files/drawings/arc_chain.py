"""Exact chains of lines and elliptical arcs, and their conversion to segments."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampled_data import number_parts
from armcontour.geometry import Segments
from armcontour.geometry.arc_fit import fit_many
from armcontour.geometry.segments import REPEATED_POINT, close_gaps

# An ellipse counts as a circle if both limits are satisfied: the difference of its semi-axes is at
# most SAME_AXES times the chord tolerance, and the square of the difference is at most
# MAX_FLATTENING times the square of the longer semi-axis.
SAME_AXES = 0.01
MAX_FLATTENING = 0.01
# An arc is drawn with its radius if it then ends within this distance [m] of the end point in the
# drawing. Otherwise it is drawn through both end points.
END_TOLERANCE = 0.1 * REPEATED_POINT
# Part of a quarter turn that an angle exceeds only because of rounding.
QUARTER_ROUNDING = 1e-9
# Relative difference of semi-axes that is due to rounding.
AXIS_ROUNDING = 1e-12
# An arc with a larger swept angle [rad] is not defined accurately by its chord.
MAX_CHORD_ANGLE = 1.5 * np.pi
# Vertices closer than this [m] are merged.
ONE_VERTEX = 0.5 * REPEATED_POINT
# For an arc with a larger swept angle [rad], the bounding box is that of the whole ellipse.
WIDE_ANGLE = 1.0
# Number of curves that are fitted at once: large enough for a small overhead of numpy, and small
# enough for less than 100 MB of memory.
FIT_BATCH = 4000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArcChain:
    """A sequence of lines and elliptical arcs; each starts at the end of the previous one."""

    # Arc i is `starts[i] + cosines[i] (cos t - 1) + sines[i] sin t` for t from 0 to `angles[i]`. A
    # line has the angle 0.

    starts: FloatArray  # Start points, (n, dimension)
    # End points from the drawing, which are not computed from the arcs, (n, dimension).
    ends: FloatArray
    cosines: FloatArray  # Vectors from the centres to the start points, (n, dimension)
    sines: FloatArray  # Conjugate semi-diameters of the ellipses, (n, dimension)
    angles: FloatArray  # Swept angles of the arcs [rad], (n,)

    @classmethod
    def straight(cls, points: FloatArray) -> ArcChain:
        """Return the chain of n lines through points, (n + 1, dimension)."""
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
    ) -> ArcChain:
        """Return the chain of one arc with the swept angle `angle` [rad].

        `cosine` is the vector from the centre to the start, `sine` its conjugate semi-diameter.
        `ends` are the start and end point, (2, dimension); None computes these from the arc.
        """
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
    def join(cls, chains: Sequence[ArcChain]) -> ArcChain:
        """Join several chains in sequence to one chain."""
        return cls(**{x: np.concatenate([getattr(y, x) for y in chains]) for x in cls.__slots__})

    def __getitem__(self, rows: BoolArray | IntArray) -> ArcChain:
        """Return the chain of the selected lines and arcs."""
        return ArcChain(**{name: getattr(self, name)[rows] for name in self.__slots__})

    def place(self, to: Affine) -> ArcChain:
        """Return the image of the chain under an affine map."""
        return ArcChain(
            starts=to(self.starts),
            ends=to(self.ends),
            cosines=to.map_vectors(self.cosines),
            sines=to.map_vectors(self.sines),
            angles=self.angles,
        )

    def halve(self) -> ArcChain:
        """Return the same curve with each line and arc split into two halves."""
        middles = self._evaluate(0.5)
        half = self.angles[:, None] / 2
        c, s = np.cos(half), np.sin(half)
        first_halves = dataclasses.replace(self, ends=middles, angles=self.angles / 2)
        second_halves = ArcChain(
            starts=middles,
            ends=self.ends,
            cosines=c * self.cosines + s * self.sines,
            sines=c * self.sines - s * self.cosines,
            angles=self.angles / 2,
        )
        # The two halves of each line or arc follow each other.
        order = np.arange(2 * len(half)).reshape(2, -1).T.ravel()
        return ArcChain.join([first_halves, second_halves])[order]

    @property
    def last(self) -> FloatArray:
        """Start and end point of the last line or arc, (2, dimension)."""
        return np.stack([self.starts[-1], self.ends[-1]])

    def start_at(self, point: FloatArray) -> ArcChain:
        """Return a copy of the chain with another start point, (dimension,)."""
        return dataclasses.replace(self, starts=np.concatenate([point[None], self.starts[1:]]))

    def end_at(self, point: FloatArray) -> ArcChain:
        """Return a copy of the chain with another end point, (dimension,)."""
        return dataclasses.replace(self, ends=np.concatenate([self.ends[:-1], point[None]]))

    @property
    def bounding_points(self) -> FloatArray:
        """Points whose bounding box approximately contains the chain, (m, dimension)."""
        points = [self.starts[:1], self.ends]
        if self.angles.any():
            wide = self.angles > WIDE_ANGLE
            centres = (self.starts - self.cosines)[wide]
            sizes = np.hypot(self.cosines[wide], self.sines[wide])
            points += [centres - sizes, centres + sizes]
            narrow = (self.angles > 0) & ~wide
            if narrow.any():
                # The ellipse of an arc with a small angle can be much larger than the arc, so the
                # middle of the arc is used.
                points.append(self[narrow]._evaluate(0.5))
        return np.concatenate(points)

    def to_segments(self, tolerance: float) -> Segments | None:
        """Convert the chain to segments; None if the chain has no length.

        Lines and circular arcs are not changed. Elliptical arcs become tangent circular arcs within
        the tolerance [m].
        """
        chain = self._without_points()
        if not len(chain.angles):
            return None
        elliptical = chain._elliptical(tolerance)
        if not elliptical.any():
            return chain._as_drawn()
        runs = np.split(np.arange(len(elliptical)), np.flatnonzero(np.diff(elliptical)) + 1)
        parts = [
            chain[run]._fitted(np.array([len(run)]), tolerance)[0]
            if elliptical[run[0]]
            else chain[run]._as_drawn()
            for run in runs
        ]
        return Segments.join(parts)

    @property
    def _long_arcs(self) -> BoolArray:
        """Mask of the arcs that have a length; lines are False, (n,)."""
        arc = self.angles > 0
        if arc.any():
            radius = np.maximum(*(np.linalg.norm(x, axis=1) for x in (self.cosines, self.sines)))
            arc = radius * self.angles > ONE_VERTEX
        return np.asarray(arc)

    def _without_points(self) -> ArcChain:
        """Return the chain without parts that have no length; close vertices are merged."""
        arc = self._long_arcs
        starts, has_length = close_gaps(self.starts, self.ends, arc, ONE_VERTEX)
        if has_length.all():
            return self
        angles = np.where(arc, self.angles, 0.0)
        return dataclasses.replace(self, starts=starts, angles=angles)[has_length]

    @property
    def _has_length(self) -> BoolArray:
        """Mask of the lines and arcs with a length, (n,)."""
        far = np.linalg.norm(self.ends - self.starts, axis=1) > ONE_VERTEX
        return np.where(self.angles > 0, self._long_arcs, far)

    def _elliptical(self, tolerance: float) -> BoolArray:
        """Return the mask of the arcs that are not circular within the tolerance [m], (n,)."""
        is_arc = self.angles > 0
        if not is_arc.any():
            return is_arc
        u, v = self.cosines, self.sines
        long, wide, across = (np.sum(x * y, axis=1) for x, y in ((u, u), (v, v), (u, v)))
        # `flattening` is the squared difference of the semi-axes, computed without a difference of
        # large numbers.
        area = np.sqrt(np.maximum(long * wide - across**2, 0.0))
        with np.errstate(invalid="ignore"):
            skew = np.nan_to_num(2 * across**2 / (np.sqrt(long * wide) + area))
        flattening = (np.sqrt(long) - np.sqrt(wide)) ** 2 + skew
        # An arc with a large angle counts as circular only if its semi-axes are equal except for
        # rounding, because its chord does not define the arc accurately.
        has_large_angle = (self.angles > MAX_CHORD_ANGLE) & (self.angles < 2 * np.pi)
        allowed = np.minimum((SAME_AXES * tolerance) ** 2, MAX_FLATTENING * np.maximum(long, wide))
        allowed = np.where(has_large_angle, AXIS_ROUNDING**2 * long, allowed)
        return np.asarray(is_arc & (flattening > allowed))

    def _evaluate(self, fraction: float | FloatArray, order: int = 0) -> FloatArray:
        """Return the points [m] (order 0) at a fraction of each line or arc, (n, dimension).

        Order 1 returns their derivatives with respect to the fraction. The curves are corrected to
        pass exactly through their end points.

        `fraction`: from 0 at the starts to 1 at the ends, a number or (n,).
        """
        fraction = np.broadcast_to(fraction, self.angles.shape)[:, None]
        a = self.angles[:, None]
        c, s = np.cos(a * fraction), np.sin(a * fraction)
        # Vectors from the ends of the arcs to the end points of the drawing.
        end_gaps = self.ends - self.starts
        end_gaps = end_gaps - (np.cos(a) - 1) * self.cosines - np.sin(a) * self.sines
        if order:
            return np.asarray(a * (c * self.sines - s * self.cosines) + end_gaps)
        points = self.starts + (c - 1) * self.cosines + s * self.sines
        return np.asarray(points + fraction * end_gaps)

    def _fitted(self, counts: IntArray, tolerance: float) -> list[Segments]:
        """Fit tangent circular arcs to chains of elliptical arcs.

        This chain is the sequence of the chains to fit.

        - `counts`: number of elliptical arcs in each of these chains, (chains,).
        - `tolerance`: largest distance of the circular arcs from the elliptical arcs [m].
        """
        first_arc = np.cumsum(counts) - counts
        chain_of = np.repeat(np.arange(len(counts)), counts)

        def curves(row: IntArray, t: FloatArray, order: int) -> FloatArray:
            # Elliptical arc i of a chain has the parameters from i to i + 1.
            i = np.clip(np.floor(t).astype(np.intp), 0, counts[row] - 1)
            return self[first_arc[row] + i]._evaluate(t - i, order)

        # Each arc is split into parts of at most a quarter turn.
        quarters = np.ceil(self.angles / (np.pi / 2) - QUARTER_ROUNDING)
        quarters = np.maximum(quarters, 1).astype(np.intp)
        i, k = number_parts(quarters)
        row = chain_of[i]
        ends = np.cumsum(np.add.reduceat(quarters, first_arc))
        breaks = np.insert(i - first_arc[row] + k / quarters[i], ends, counts)
        rows = np.insert(row, ends, np.arange(len(counts)))
        return fit_many(curves, breaks, rows, tolerance, separate=True)

    def _as_drawn(self) -> Segments:
        """Return the segments of lines and circular arcs; these can have gaps between them.

        A segment keeps the radius of its arc. If its end then differs from the end point, the
        segment passes through both end points with the swept angle.
        """
        arc = self.angles > 0
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
        inexact = arc & (np.linalg.norm(drawn.ends - self.ends, axis=1) > END_TOLERANCE)
        return (
            drawn.replace_rows(inexact, self[inexact]._through_ends()) if inexact.any() else drawn
        )

    def _through_ends(self) -> Segments:
        """Return the segments of circular arcs through their end points with their swept angles."""
        chords = self.ends - self.starts
        half = self.angles / 2
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


def segments_of_chains(chains: Sequence[ArcChain], tolerance: float) -> list[Segments | None]:
    """Convert many chains to segments in one step, which is faster than `ArcChain.to_segments`.

    The segments are those of `to_segments`. A chain is None if that method has to convert it: if it
    mixes elliptical arcs with lines or circular arcs, has a part without length, or cannot be
    fitted.

    `tolerance`: largest distance of the segments from elliptical arcs [m].
    """
    segments: list[Segments | None] = [None] * len(chains)
    counts = np.array([len(x.angles) for x in chains], dtype=np.intp)
    if not counts.any():
        return segments
    joined = ArcChain.join(chains)
    chain_of = np.repeat(np.arange(len(chains)), counts)
    is_elliptical = joined._elliptical(tolerance)
    has_length = joined._has_length
    exact = _chains_of_kind(~is_elliptical & has_length, chain_of, counts)
    if len(exact):
        drawn = joined[np.isin(chain_of, exact)]._as_drawn()
        ends = np.cumsum(counts[exact])
        for i, begin, end in zip(exact, ends - counts[exact], ends, strict=True):
            segments[i] = drawn[begin:end]
    elliptical = _chains_of_kind(is_elliptical & has_length, chain_of, counts)
    for batch in _split_batches(elliptical, counts):
        # A chain that cannot be fitted is left to its own call, whose error identifies the chain.
        with suppress(InvalidInput):
            fitted = joined[np.isin(chain_of, batch)]._fitted(counts[batch], tolerance)
            for i, segments_of_chain in zip(batch, fitted, strict=True):
                segments[i] = segments_of_chain
    return segments


def _chains_of_kind(is_kind: BoolArray, chain_of: IntArray, counts: IntArray) -> IntArray:
    """Return the indices of the chains all of whose parts are of a kind; empty chains have none.

    - `is_kind`: mask of the lines and arcs of the kind, of all chains, (n,).
    - `chain_of`: chain of each line or arc, (n,).
    - `counts`: number of lines and arcs of each chain, (chains,).
    """
    has_others = np.bincount(chain_of, ~is_kind, len(counts)) > 0
    return np.flatnonzero(~has_others & (counts > 0))


def _split_batches(chains: IntArray, counts: IntArray) -> list[IntArray]:
    """Split indices of chains into batches of about FIT_BATCH arcs, for a limited memory."""
    if not len(chains):
        return []
    batch_of = np.cumsum(counts[chains]) // FIT_BATCH
    return np.split(chains, np.flatnonzero(np.diff(batch_of)) + 1)


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """The affine map `linear @ point + offset`."""

    linear: FloatArray
    offset: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the images of points, (..., dimension)."""
        return np.asarray(points @ self.linear.T + self.offset)

    def __matmul__(self, inner: Affine) -> Affine:
        """Return the composition of two maps: the inner map is applied first."""
        # `finite` detects an overflow later.
        with np.errstate(over="ignore", invalid="ignore"):
            return Affine(self.linear @ inner.linear, self.linear @ inner.offset + self.offset)

    def map_vectors(self, vectors: FloatArray) -> FloatArray:
        """Return the images of vectors, (..., dimension); the offset does not apply to vectors."""
        return np.asarray(vectors @ self.linear.T)

    @property
    def finite(self) -> bool:
        """True if all coefficients are finite."""
        return bool(np.isfinite(self.linear).all() and np.isfinite(self.offset).all())


# The projection from space onto the plane z = 0.
WITHOUT_Z = Affine(np.eye(3)[:2], np.zeros(2))
