"""Outlines that consist of arc chains and Bézier splines, and the paths that approximate them."""

from __future__ import annotations

import dataclasses
import itertools
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.files.drawings.arc_chain import FIT_BATCH, Affine, ArcChain, segments_of_chains
from armcontour.geometry import Path, Segments
from armcontour.geometry.arc_fit import fit_many
from armcontour.geometry.segments import REPEATED_POINT

# Largest gap in a continuous spline due to rounding, as a fraction of the extent or of the largest
# coordinate of the spline (the larger one).
SAME_RELATIVE = 1e-9
# The gap of a closed outline is closed by moving the end point only if the gap is at most `join`
# and at most this fraction of the chord of the last line, arc or curve.
SMALL_GAP = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BezierSpline:
    """Rational Bézier curves with the same degree, each from the end of the previous one."""

    # Control points, (curves * degree + 1, dimension). Neighbouring curves share one point.
    points: FloatArray
    # Weights of the control points, (curves * degree + 1,); None if all are equal.
    weights: FloatArray | None = None
    degree: int = 3

    @classmethod
    def from_knots(
        cls, points: FloatArray, weights: FloatArray, knots: FloatArray, degree: int
    ) -> BezierSpline | None:
        """Return the Bézier curves of a rational B-spline; None if the spline has a gap.

        The n weights are above zero. The n + degree + 1 knots are ascending, and the parameter
        range from knot `degree` to knot n is not empty.
        """
        weights = weights / weights.max()
        whole = np.column_stack([weights[:, None] * points, weights])
        parts = _bezier_points(whole, knots, degree)
        # At a knot that occurs more than `degree` times, two curves can have different weights at
        # the same point. The weights of each curve are scaled to those of the previous curve, which
        # does not change the curve.
        ratios = parts[:-1, -1, -1] / parts[1:, 0, -1]
        parts = parts * np.cumprod(np.append(1.0, ratios))[:, None, None]
        controls = parts[..., :-1] / parts[..., -1:]
        gaps = np.abs(controls[1:, 0] - controls[:-1, -1]).max(initial=0.0)
        if gaps > SAME_RELATIVE * max(
            float(np.ptp(points, axis=0).max()), float(np.abs(points).max())
        ):
            return None
        flat = np.concatenate([controls[:, :-1].reshape(-1, points.shape[1]), controls[-1:, -1]])
        same = np.ptp(weights) == 0
        w = None if same else np.append(parts[:, :-1, -1].ravel(), parts[-1, -1, -1])
        return cls(points=flat, weights=w, degree=degree)

    def place(self, to: Affine) -> BezierSpline:
        """Return the image of the spline under an affine map."""
        return dataclasses.replace(self, points=to(self.points))

    @property
    def starts(self) -> FloatArray:
        """The first point, (1, dimension)."""
        return self.points[:1]

    @property
    def last(self) -> FloatArray:
        """Start and end point of the last curve, (2, dimension)."""
        return self.points[[-1 - self.degree, -1]]

    def start_at(self, point: FloatArray) -> BezierSpline:
        """Return a copy of the spline with another start point, (dimension,)."""
        return dataclasses.replace(self, points=np.concatenate([point[None], self.points[1:]]))

    def end_at(self, point: FloatArray) -> BezierSpline:
        """Return a copy with another end point, (dimension,), and the same end tangent."""
        moved = [self.points[-2] + point - self.points[-1], point]
        return dataclasses.replace(self, points=np.concatenate([self.points[:-2], moved]))

    @property
    def bounding_points(self) -> FloatArray:
        """Points whose bounding box contains the spline, (n, dimension)."""
        return self.points

    @property
    def curve_count(self) -> int:
        """Number of Bézier curves."""
        return (len(self.points) - 1) // self.degree

    @property
    def has_length(self) -> bool:
        """True if the control points are not all the same point."""
        return bool(np.ptp(self.points, axis=0).max() > REPEATED_POINT)


def _bezier_points(points: FloatArray, knots: FloatArray, degree: int) -> FloatArray:
    """Return the control points of a B-spline's Bézier curves, (curves, degree + 1, dimension)."""
    # Each control point is the value of the polar form (blossom) of a curve, with the ends of the
    # knot interval as arguments. De Boor's algorithm computes it with one argument per step.
    n = len(points)
    k = degree + np.flatnonzero(np.diff(knots[degree : n + 1]) > 0)
    a = knots[k]
    b = knots[k + 1]
    controls = np.empty((len(k), degree + 1, points.shape[1]))
    for j in range(degree + 1):
        p = points[k[:, None] + np.arange(-degree, 1)]
        for r in range(1, degree + 1):
            i = k[:, None] + np.arange(r - degree, 1)
            low = knots[i]
            high = knots[i + degree + 1 - r]
            parameter = (b if r <= j else a)[:, None]
            fraction = ((parameter - low) / (high - low))[..., None]
            p = (1 - fraction) * p[:, :-1] + fraction * p[:, 1:]
        controls[:, j] = p[:, 0]
    return controls


def fit_splines(
    splines: Sequence[BezierSpline], tolerance: float
) -> Iterator[tuple[int, Segments]]:
    """Yield the index of each spline, and tangent arcs within a tolerance [m] of the spline."""
    alike: dict[tuple[int, bool, int], list[int]] = defaultdict(list)
    for i, spline in enumerate(splines):
        alike[spline.degree, spline.weights is None, spline.points.shape[1]].append(i)
    for (degree, *_), numbers in alike.items():
        if degree == 1:
            # A spline of degree 1 consists of straight lines for all weights.
            yield from ((i, Path.polyline(splines[i].points).segments) for i in numbers)
            continue
        chunk = np.cumsum([splines[i].curve_count for i in numbers]) // FIT_BATCH
        for part in np.split(np.array(numbers), np.flatnonzero(np.diff(chunk)) + 1):
            yield from _fit_alike(splines, part.tolist(), tolerance)


def _fit_alike(
    splines: Sequence[BezierSpline], numbers: list[int], tolerance: float
) -> list[tuple[int, Segments]]:
    """Fit the splines with the indices `numbers`, which have equal degrees; indices and arcs."""
    table = _SplineCurves([splines[i] for i in numbers])
    try:
        return list(zip(numbers, fit_many(table, *table.breaks, tolerance), strict=True))
    except InvalidInput as error:
        if len(numbers) == 1:
            raise InvalidInput(str(error), index=numbers[0]) from None
    # The splines are fitted one by one to identify the spline that causes the error.
    fitted = list[tuple[int, Segments]]()
    for i in numbers:
        fitted += _fit_alike(splines, [i], tolerance)
    return fitted


class _SplineCurves:
    """Splines of one degree as the curve argument of `fit_many`.

    In each spline, Bézier curve k has the parameters from k to k + 1.
    """

    def __init__(self, splines: Sequence[BezierSpline]) -> None:
        self.degree = splines[0].degree
        self.plain = splines[0].weights is None
        self._points = np.concatenate([x.points for x in splines])
        if not self.plain:
            weights = np.concatenate([x.weights for x in splines if x.weights is not None])[:, None]
            self._points = np.hstack([weights * self._points, weights])
        self._counts = np.array([x.curve_count for x in splines])
        sizes = self._counts * self.degree + 1
        self._first = np.cumsum(sizes) - sizes

    @property
    def breaks(self) -> tuple[FloatArray, IntArray]:
        """Parameters at the ends of all Bézier curves, and the index of their spline, (m,) each."""
        parameters = np.concatenate([np.arange(n + 1.0) for n in self._counts])
        return parameters, np.repeat(np.arange(len(self._counts)), self._counts + 1)

    def __call__(self, row: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Points (order 0) or derivatives (order 1) of the splines `row` at `t`, (m, dimension)."""
        k = np.minimum(t.astype(np.intp), self._counts[row] - 1)
        fraction = (t - k)[:, None]
        first = self._first[row] + k * self.degree
        control = [self._points.take(first + j, axis=0) for j in range(self.degree + 1)]
        if self.plain:
            return _evaluate_bezier(_derivative_points(control) if order else control, fraction)
        value = _evaluate_bezier(control, fraction)
        w = value[:, -1:]
        p = value[:, :-1] / value[:, -1:]
        if order == 0:
            return np.asarray(p)
        change = _evaluate_bezier(_derivative_points(control), fraction)
        return np.asarray((change[:, :-1] - p * change[:, -1:]) / w)


def _derivative_points(control: list[FloatArray]) -> list[FloatArray]:
    """Return the control points of the derivatives of Bézier curves."""
    degree = len(control) - 1
    return [degree * (b - a) for a, b in itertools.pairwise(control)]


def _evaluate_bezier(control: list[FloatArray], fraction: FloatArray) -> FloatArray:
    """Return the points of Bézier curves, (m, dimension), by de Casteljau's algorithm."""
    complement = 1 - fraction
    while len(control) > 1:
        control = [complement * a + fraction * b for a, b in itertools.pairwise(control)]
    return control[0]


Shape = ArcChain | BezierSpline


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A sequence of connected shapes."""

    shapes: Sequence[Shape]  # The shapes; each starts at the end of the previous shape
    closed: bool = False  # Whether the last shape must end where the first one starts

    def place(self, to: Affine) -> Outline:
        """Return the image of the outline under an affine map."""
        return Outline([x.place(to) for x in self.shapes], self.closed)

    @property
    def bounding_points(self) -> FloatArray:
        """Points whose bounding box approximately contains the outline, (m, dimension)."""
        return np.concatenate([x.bounding_points for x in self.shapes])

    def parts(self, tolerance: float, join: float) -> list[Segments | BezierSpline]:
        """Return the chains of the outline as segments, and its splines.

        Parts without length are omitted.
        Each part starts exactly at the end of the previous part. `join` is that of `close_gap`.
        """
        parts: list[Segments | BezierSpline] = []
        for shape in self.close_gap(join):
            joined = shape.start_at(_end_of(parts[-1])) if parts else shape
            if isinstance(joined, ArcChain):
                segments = joined.to_segments(tolerance)
                if segments is not None:
                    parts.append(segments)
            elif joined.has_length:
                parts.append(joined)
        return parts

    def close_gap(self, join: float) -> Sequence[Shape]:
        """Return the shapes of the outline; the gap of a closed outline is closed.

        A gap up to `join` [m] and SMALL_GAP of the last chord is closed by moving the end point, a
        larger gap by a line.
        """
        if not self.closed:
            return self.shapes
        *others, last = self.shapes
        start = self.shapes[0].starts[0]
        before, end = last.last
        if np.array_equal(start, end):
            return self.shapes
        gap, size = (float(np.linalg.norm(end - x)) for x in (start, before))
        if gap > min(join, SMALL_GAP * size):
            return [*self.shapes, ArcChain.straight(np.stack([end, start]))]
        return [*others, last.end_at(start)]


def paths_of(
    outlines: Sequence[Outline],
    tolerance: float,
    join: float = 0.0,
    report_fraction: Callable[[float], None] = lambda done: None,
) -> list[Path | None]:
    """Return the paths of outlines; None for an outline without length.

    Lines and circular arcs are not changed; other curves become tangent arcs within `tolerance`
    [m]. `join` is that of `Outline.close_gap`.
    """
    # All single chains are converted in one call, which is faster.
    segments_of = _segments_of_single_chains(outlines, tolerance, join)
    parts: list[list[Segments | BezierSpline]] = []
    for i, outline in enumerate(outlines):
        with _indexed(i):
            single = segments_of.get(i)
            parts.append(outline.parts(tolerance, join) if single is None else [single])
    positions, splines = _find_splines(parts)
    try:
        for done, (n, segments) in enumerate(fit_splines(splines, tolerance)):
            i, k = positions[n]
            parts[i][k] = segments
            report_fraction((done + 1) / len(splines))
    except InvalidInput as error:
        assert error.index is not None
        raise InvalidInput(str(error), index=positions[error.index][0]) from None
    return _join_parts([[x for x in row if isinstance(x, Segments)] for row in parts])


def _end_of(part: Segments | BezierSpline) -> FloatArray:
    """Return the end point of a part of an outline [m], (dimension,)."""
    points = part.points if isinstance(part, BezierSpline) else part[-1:].ends
    return np.asarray(points[-1])


def _find_splines(
    parts: Sequence[Sequence[Segments | BezierSpline]],
) -> tuple[list[tuple[int, int]], list[BezierSpline]]:
    """Find the splines in the parts of outlines: indices of outline and part, and the splines."""
    positions = []
    splines = []
    for i, row in enumerate(parts):
        for k, part in enumerate(row):
            if isinstance(part, BezierSpline):
                positions.append((i, k))
                splines.append(part)
    return positions, splines


def _segments_of_single_chains(
    outlines: Sequence[Outline], tolerance: float, join: float
) -> dict[int, Segments]:
    """Return the segments of the outlines that are one chain, by index of the outline.

    Outlines that `segments_of_chains` does not convert are omitted. `join` is that of
    `Outline.close_gap`.
    """
    single_chains: dict[int, ArcChain] = {}
    for i, outline in enumerate(outlines):
        shapes = outline.close_gap(join)
        if len(shapes) == 1 and isinstance(shapes[0], ArcChain):
            single_chains[i] = shapes[0]
    converted = segments_of_chains(list(single_chains.values()), tolerance)
    return {i: x for i, x in zip(single_chains, converted, strict=True) if x is not None}


def _join_parts(rows: Sequence[Sequence[Segments]]) -> list[Path | None]:
    """Return the paths that join the parts of each outline; None for an outline without parts."""
    with_parts = [i for i, x in enumerate(rows) if x]
    parts = list(itertools.chain.from_iterable(rows))
    part_bounds = np.cumsum([0, *(sum(map(len, rows[i])) for i in with_parts)])
    paths: list[Path | None] = [None] * len(rows)
    try:
        # One check of all segments together is faster.
        joined = Segments.join(parts).split(part_bounds) if parts else []
    except InvalidInput:
        # The check below identifies the outline that causes the error.
        joined = [Segments.join(rows[i]) for i in with_parts]
    for i, segments in zip(with_parts, joined, strict=True):
        with _indexed(i):
            paths[i] = Path(segments=segments)
    return paths


@contextmanager
def _indexed(i: int) -> Iterator[None]:
    """Add the index of the outline to an error that is raised in the context."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput(str(error), index=i) from None
