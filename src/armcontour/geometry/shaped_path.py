"""Shaped paths: lines and arcs near an objective path, along which an arm moves in less time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, Frozen, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quintics import evaluate
from armcontour.core.render import number
from armcontour.core.text import count_noun, short_repr
from armcontour.geometry.largest_distance import MeasuredCurve, PieceBounds, largest_distance
from armcontour.geometry.path import Path
from armcontour.geometry.projection import Projection

# Key of the shaped path's duration in `ShapingOutcome.durations`.
SHAPED = "shaped"
# Largest difference between the distance from the objective and its bound, as a share of the
# tolerance, and the smallest such difference that rounding errors allow [m].
RESOLUTION_SHARE = 1e-7
FINEST_RESOLUTION = 1e-12
# Names of the shapes from which a search starts: corners replaced by arcs, corners replaced by
# parabolas, and the objective path, which stops at its corners.
ARCS = "arcs"
PARABOLAS = "parabolas"
STOPS = "stops"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapingOutcome(Frozen):
    """Result of a path's shape search.

    Args:
        start: Name of the fastest start: "arcs", "parabolas" or "stops".
        durations: Least durations of all starts by their names, and of the path itself as "shaped"
            [s].
        history: Least duration after each iteration, the first before any [s], (iterations + 1,).
            The search times joint splines, whose durations differ slightly from those of the traced
            paths.
        note: Reason why the path has the shape of a start, one clause; None after a search.
        joints: Joint positions at the start of the program with this path, near which an arm in
            space has these durations [rad]; None for the default configuration.
        unfinished: Whether the search ended early, because the tolerance needs too many nodes.
    """

    start: str
    durations: Mapping[str, float]
    history: tuple[float, ...] = ()
    note: str | None = None
    joints: tuple[float, ...] | None = None
    unfinished: bool = False

    @property
    def gain(self) -> float:
        """Time that the shape saves, as a fraction of the fastest start shape's duration."""
        return 1 - self.durations[SHAPED] / self.durations[self.start]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SmoothCurve(Frozen):
    """A curve of quintics over arc length, which a chain of arcs follows closely.

    Its curvature varies along each quintic, and jumps between quintics only where the shape has a
    jump. The curvature of the arcs would jump at every vertex.

    Args:
        breaks: Arc lengths at which the quintics start and end [m], (n + 1,).
        coefficients: Coefficients of the quintics [m], (n, 6, dimension), as from `quintic`.
        spreads: Largest distance between each quintic and the arcs [m], (n,).
    """

    breaks: FloatArray
    coefficients: FloatArray
    spreads: FloatArray

    def on_piece(self, i: IntArray, s: FloatArray, order: int = 0) -> FloatArray:
        """Return points or derivatives on quintics `i` at arc lengths `s` [m], (n, dimension)."""
        width = self.breaks[i + 1] - self.breaks[i]
        u = np.clip(s - self.breaks[i], 0.0, width)
        return evaluate(self.coefficients[i], width, u, order)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapedPath(Path):
    """A path whose shape was optimized together with its timing, near its objective.

    Args:
        objective: The path before shaping.
        places: Corresponding arc lengths on the objective and on this path [m], from start to end,
            both increasing, (n, 2).
        tolerance: The specified tolerance [m].
        outcome: Result of the shape search.
        curve: The curve that the tool follows; None if it follows the lines and arcs.

    Raises:
        InvalidInput: The places do not increase from start to end of both paths.
    """

    objective: Path
    places: FloatArray
    tolerance: float
    outcome: ShapingOutcome = field(repr=False)
    curve: SmoothCurve | None = field(default=None, repr=False)
    # Index of the curve's quintic to which each segment belongs, (n,).
    _piece: IntArray = field(init=False, repr=False)

    def _check_together(self) -> None:
        super()._check_together()
        piece = np.zeros(0, dtype=np.intp)
        if self.curve is not None:
            middle = (self.breaks[:-1] + self.breaks[1:]) / 2
            last = len(self.curve.breaks) - 2
            piece = np.clip(np.searchsorted(self.curve.breaks, middle) - 1, 0, last)
        object.__setattr__(self, "_piece", piece)
        places = check_correspondence(self.places, self.objective, self)
        object.__setattr__(self, "places", places)

    @cached_property
    def deviation(self) -> float:
        """Upper bound of the distance between path and objective, in both directions [m].

        It exceeds the distance by at most RESOLUTION_SHARE of the tolerance. A path that the shape
        search made is proven to be within its tolerance (`Tube.prove`), so the bound is at most the
        tolerance, unless a measured distance is larger.
        """
        if self._is_objective:
            return 0.0
        resolution = max(RESOLUTION_SHARE * self.tolerance, FINEST_RESOLUTION)
        own = self._measured
        objective = MeasuredCurve.of_path(self.objective)
        there = largest_distance(own, objective, resolution)
        back = largest_distance(objective, own, resolution)
        bound = min(max(there.bound, back.bound), self.tolerance)
        return max(there.measured, back.measured, bound)

    @property
    def _is_objective(self) -> bool:
        """Whether the path consists of the same lines and arcs as its objective."""
        pairs = ((x.vertices, x.curvatures) for x in (self, self.objective))
        return all(np.array_equal(a, b) for a, b in zip(*pairs, strict=True))

    @property
    def _measured(self) -> MeasuredCurve:
        """The curve that the tool follows, for distances."""
        if self.curve is None:
            return MeasuredCurve.of_path(self)
        bounds = PieceBounds.of_quintics(self.curve.breaks, self.curve.coefficients)
        return MeasuredCurve(points=self, nearest=self._nearest_on_curve, bounds=bounds)

    def _nearest_on_curve(self, points: FloatArray) -> Projection:
        """Return distances from points to the curve, at most a rounding error too large.

        One Newton step leads from the nearest point of the arcs to that of the curve.
        """
        s = self.project(points).s
        offset = points - self(s)
        tangent = self(s, 1)
        slope = np.sum(offset * tangent, axis=1)
        bend = np.sum(tangent**2, axis=1) - np.sum(offset * self(s, 2), axis=1)
        step = np.where(bend > 0, slope / np.where(bend > 0, bend, 1.0), 0.0)
        moved = np.clip(s + step, 0.0, self.length)
        distance = np.linalg.norm(offset, axis=1)
        moved_distance = np.linalg.norm(points - self(moved), axis=1)
        nearer = moved_distance < distance
        return Projection(
            distance=np.where(nearer, moved_distance, distance), s=np.where(nearer, moved, s)
        )

    __repr__ = short_repr

    def __call__(self, s: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Return the point or derivative of the curve that the tool follows."""
        if self.curve is None:
            return super().__call__(s, order, side=side)
        arc_lengths = checks.clip_within("arc length", s, 0.0, self.length, "m", "the path")
        i = self.locate(arc_lengths, side=side)
        return self.on_segment(i, arc_lengths - self.breaks[i], checks.derivative(order))

    def on_segment(self, i: IntArray, u: FloatArray, order: int = 0) -> FloatArray:
        """Return the curve's point or derivative at distance `u` [m] along segment `i`.

        Args:
            i: Indices of segments, (n,).
            u: Distances from the starts of these segments [m], (n,).
            order: Order of the derivative, 0 for the point.
        """
        if self.curve is None:
            return super().on_segment(i, u, order)
        return self.curve.on_piece(self._piece[i], self.breaks[i] + u, order)

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Return arc lengths on this path that correspond to those on the objective path [m].

        Args:
            s: Arc lengths of the objective path [m], any shape.
        """
        arc_lengths = np.interp(
            checks.floats("arc lengths", s, "m"), self.places[:, 0], self.places[:, 1]
        )
        return np.asarray(np.clip(arc_lengths, 0.0, self.length))


def describe_unfinished(paths: Iterable[Path]) -> list[str]:
    """Return a sentence on paths whose shape search ended early, if there are any."""
    shaped = [x for x in paths if isinstance(x, ShapedPath)]
    early = [x for x in shaped if x.outcome.unfinished]
    if not early:
        return []
    subject = f" of {count_noun(len(early), 'contour')}" if len(shaped) > 1 else ""
    return [
        f"the search for the shape{subject} ended early, because a tolerance of "
        f"{number(early[0].tolerance, 'm')} needs too many nodes. The path is the fastest one "
        "found until then. Specify a larger tolerance, or round the corners, which needs no search."
    ]


def check_correspondence(places: npt.ArrayLike, objective: Path, path: Path) -> FloatArray:
    """Return read-only arc length pairs; raise InvalidInput unless they cover both paths.

    - `places`: arc lengths on the objective and on the path [m], (n, 2).
    - `path`: a path that was made from the objective.
    """
    pairs = checks.frozen_array(places)
    ends = np.array([[0.0, 0.0], [objective.length, path.length]])
    near = 1e-9 * (1 + ends[1])
    if pairs.ndim != 2 or not pairs.size or (np.abs(pairs[[0, -1]] - ends) > near).any():
        raise InvalidInput(
            "places of a shaped path (corresponding arc lengths) must run from the start to the "
            "end of both paths."
        )
    if (np.diff(pairs, axis=0) < 0).any():
        raise InvalidInput("places of a shaped path (corresponding arc lengths) must not decrease.")
    return pairs
