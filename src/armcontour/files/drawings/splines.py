"""Splines of drawings as Bézier curves in sequence, and their tangent arcs."""

from __future__ import annotations

import dataclasses
import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.files.drawings.chain import Affine
from armcontour.geometry import Path, Segments
from armcontour.geometry.fit import fit_many
from armcontour.geometry.segments import REPEATED_POINT

# Number of Bézier curves that are fitted at once: enough to make numpy's overhead small, and few
# enough to keep what they need in memory below 100 MB.
AT_ONCE = 4000
# Largest gap inside a continuous spline, as a fraction of its size: the rounding of its points.
SAME = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spline:
    """Rational Bézier curves of one degree in sequence, each from the end of the one before.

    Args:
        points: Control points; neighbouring curves share one, (curves * degree + 1, dimension).
        weights: Weights of the control points, same length; None if all are equal.
        degree: Degree of the curves.
    """

    points: FloatArray
    weights: FloatArray | None = None
    degree: int = 3

    @classmethod
    def from_knots(
        cls, points: FloatArray, weights: FloatArray, knots: FloatArray, degree: int
    ) -> Spline | None:
        """The Bézier curves of a rational B-spline; None if it has a gap.

        Args:
            points: Control points, (n, dimension).
            weights: Weights of the control points, above zero, (n,).
            knots: Ascending knots, the middle ones not all equal, (n + degree + 1,).
            degree: Degree of the polynomials.
        """
        weights = weights / weights.max()
        whole = np.column_stack([weights[:, None] * points, weights])
        parts = _bezier_points(whole, knots, degree)
        # A knot that occurs more than `degree` times separates curves that may have other weights
        # at the same point; the scale of a curve's weights does not matter.
        ratios = parts[:-1, -1, -1] / parts[1:, 0, -1]
        parts = parts * np.cumprod(np.append(1.0, ratios))[:, None, None]
        at = parts[..., :-1] / parts[..., -1:]
        gaps = np.abs(at[1:, 0] - at[:-1, -1]).max(initial=0.0)
        if gaps > SAME * max(float(np.ptp(points, axis=0).max()), float(np.abs(points).max())):
            return None
        flat = np.concatenate([at[:, :-1].reshape(-1, points.shape[1]), at[-1:, -1]])
        same = np.ptp(weights) == 0
        w = None if same else np.append(parts[:, :-1, -1].ravel(), parts[-1, -1, -1])
        return cls(points=flat, weights=w, degree=degree)

    def place(self, to: Affine) -> Spline:
        """The image of the spline under an affine map."""
        return dataclasses.replace(self, points=to(self.points))

    @property
    def starts(self) -> FloatArray:
        """The first point, (1, dimension)."""
        return self.points[:1]

    @property
    def last(self) -> FloatArray:
        """Start and end point of the last curve, (2, dimension)."""
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

    @property
    def pieces(self) -> int:
        """Number of its curves."""
        return (len(self.points) - 1) // self.degree

    @property
    def has_length(self) -> bool:
        """Whether its points are not all one point."""
        return bool(np.ptp(self.points, axis=0).max() > REPEATED_POINT)


def _bezier_points(points: FloatArray, knots: FloatArray, degree: int) -> FloatArray:
    """Control points of the Bézier curves of a B-spline, (curves, degree + 1, dimension).

    They are the values of the curves' polar forms at the ends of their knot intervals (de Boor's
    algorithm with another parameter in each step).
    """
    n = len(points)
    k = degree + np.flatnonzero(np.diff(knots[degree : n + 1]) > 0)
    a, b = knots[k], knots[k + 1]
    found = np.empty((len(k), degree + 1, points.shape[1]))
    for j in range(degree + 1):
        p = points[k[:, None] + np.arange(-degree, 1)]
        for r in range(1, degree + 1):
            i = k[:, None] + np.arange(r - degree, 1)
            low, high = knots[i], knots[i + degree + 1 - r]
            x = (b if r <= j else a)[:, None]
            share = ((x - low) / (high - low))[..., None]
            p = (1 - share) * p[:, :-1] + share * p[:, 1:]
        found[:, j] = p[:, 0]
    return found


def fit_splines(splines: Sequence[Spline], tolerance: float) -> Iterator[tuple[int, Segments]]:
    """Yield the number of each spline and tangent arcs within a tolerance [m] of it.

    Args:
        splines: Splines that have a length.
        tolerance: Largest distance between a spline and its arcs [m].

    Raises:
        InvalidInput: A spline is too large for the tolerance; with its index.
    """
    alike: dict[tuple[int, bool, int], list[int]] = defaultdict(list)
    for i, x in enumerate(splines):
        alike[x.degree, x.weights is None, x.points.shape[1]].append(i)
    for (degree, *_), numbers in alike.items():
        if degree == 1:
            # Straight between the points, whatever the weights.
            yield from ((i, Path.polyline(splines[i].points).segments) for i in numbers)
            continue
        chunk = np.cumsum([splines[i].pieces for i in numbers]) // AT_ONCE
        for part in np.split(np.array(numbers), np.flatnonzero(np.diff(chunk)) + 1):
            yield from _fit_alike(splines, part.tolist(), tolerance)


def _fit_alike(
    splines: Sequence[Spline], numbers: list[int], tolerance: float
) -> list[tuple[int, Segments]]:
    """Numbers and arcs of splines of one degree, as in `fit_splines`."""
    table = _Table([splines[i] for i in numbers])
    try:
        return list(zip(numbers, fit_many(table, *table.breaks, tolerance), strict=True))
    except InvalidInput as error:
        if len(numbers) == 1:
            raise InvalidInput(str(error), index=numbers[0]) from None
    # One of them cannot be fitted: alone it is found.
    return [x for i in numbers for x in _fit_alike(splines, [i], tolerance)]


class _Table:
    """Splines of one degree as curves for `fit_many`; curve k of each has the parameters k to k+1.

    Args:
        splines: The splines, all with weights or all without.
    """

    def __init__(self, splines: Sequence[Spline]) -> None:
        self.degree = splines[0].degree
        self.plain = splines[0].weights is None
        self._points = np.concatenate([x.points for x in splines])
        if not self.plain:
            weights = np.concatenate([x.weights for x in splines if x.weights is not None])[:, None]
            self._points = np.hstack([weights * self._points, weights])
        self._counts = np.array([x.pieces for x in splines])
        sizes = self._counts * self.degree + 1
        self._first = np.cumsum(sizes) - sizes

    @property
    def breaks(self) -> tuple[FloatArray, IntArray]:
        """Parameters of the ends of all curves, and the spline of each."""
        at = np.concatenate([np.arange(n + 1.0) for n in self._counts])
        return at, np.repeat(np.arange(len(self._counts)), self._counts + 1)

    def __call__(self, row: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Points (order 0) or derivatives (order 1) of the splines `row` at `t`."""
        k = np.minimum(t.astype(np.intp), self._counts[row] - 1)
        share = (t - k)[:, None]
        first = self._first[row] + k * self.degree
        control = [self._points.take(first + j, axis=0) for j in range(self.degree + 1)]
        if self.plain:
            return _blend(_slopes(control) if order else control, share)
        value = _blend(control, share)
        w, p = value[:, -1:], value[:, :-1] / value[:, -1:]
        if order == 0:
            return np.asarray(p)
        change = _blend(_slopes(control), share)
        return np.asarray((change[:, :-1] - p * change[:, -1:]) / w)


def _slopes(control: list[FloatArray]) -> list[FloatArray]:
    """Control points of the derivatives of Bézier curves."""
    degree = len(control) - 1
    return [degree * (b - a) for a, b in itertools.pairwise(control)]


def _blend(control: list[FloatArray], share: FloatArray) -> FloatArray:
    """Points of Bézier curves by de Casteljau's algorithm.

    Args:
        control: The first control points of all curves, the second ones, ..., each (n, dimension).
        share: Parameters from 0 to 1, (n, 1).
    """
    rest = 1 - share
    while len(control) > 1:
        control = [rest * a + share * b for a, b in itertools.pairwise(control)]
    return control[0]
