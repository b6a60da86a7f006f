"""Shaped paths: lines and arcs near an objective path, along which an arm moves in less time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core._quintics import evaluate
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.describing import count_noun, format_table, short_repr
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.render import number
from armcontour.geometry.path import Path, check_arc_length

# Name of the duration of the shaped path itself, beside those of its starts.
SHAPED = "shaped"
# Evenly spaced places at which the largest distance from the objective is looked for.
PLACES = 15_000
# and those of known shapes, from which a search starts.
ARCS, PARABOLAS, STOPS = "arcs", "parabolas", "stops"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome(Checked):
    """How the shape of a path was found.

    Args:
        start: Name of the fastest start: "arcs", "parabolas" or "stops".
        durations: Least durations of all starts by their names, and of the path itself as "shaped"
            [s].
        history: Least duration after each iteration, the first before any [s], (iterations + 1,).
        note: Why the path has the shape of a start, one clause; None if another was looked for.
        joints: Joint positions at the start of the program with this path, near which an arm in
            space has these durations [rad]; None for those that it would have anyway.
        unfinished: Whether the search ended early, because a smaller tolerance takes more steps.
    """

    start: str
    durations: Mapping[str, float]
    history: tuple[float, ...] = ()
    note: str | None = None
    joints: tuple[float, ...] | None = None
    unfinished: bool = False

    def _check_together(self) -> None:
        object.__setattr__(self, "durations", MappingProxyType(dict(self.durations)))

    def __reduce__(self) -> tuple[partial[Outcome], tuple[()]]:
        # Mapping proxies cannot be pickled.
        given = {x.name: getattr(self, x.name) for x in fields(self)}
        return partial(Outcome, **given | {"durations": dict(self.durations)}), ()

    @property
    def gain(self) -> float:
        """Share of the duration of the fastest start that the shape saves."""
        return 1 - self.durations[SHAPED] / self.durations[self.start]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SmoothCurve(Checked):
    """A curve of quintics over arc length, which a chain of arcs follows closely.

    Its curvature varies along each quintic, and jumps between quintics only where the shape wants
    a jump. The arcs, whose curvatures are constant, would jump everywhere.

    Args:
        breaks: Arc lengths of the ends of the quintics [m], (n + 1,).
        coefficients: Coefficients of the quintics [m], (n, 6, dimension), as `quintic` gives them.
        spreads: Largest distance of the arcs from each quintic [m], (n,).
    """

    breaks: FloatArray
    coefficients: FloatArray
    spreads: FloatArray

    def on_piece(self, i: IntArray, s: FloatArray, order: int = 0) -> FloatArray:
        """Points or derivatives on quintics `i` at arc lengths `s` [m], (n, dimension)."""
        width = self.breaks[i + 1] - self.breaks[i]
        u = np.clip(s - self.breaks[i], 0.0, width)
        return evaluate(self.coefficients[i], width, u, order)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapedPath(Path):
    """A path whose shape was found together with its timing, within a tolerance of its objective.

    Args:
        objective: The path before shaping.
        places: Arc lengths on the objective and on this path that belong together [m], from the
            start to the end, both increasing, (n, 2).
        tolerance: The given tolerance [m].
        line_tolerance: The given tolerance outside the zones of the vertices [m]; None if there
            are no zones.
        zone: Distance from a vertex, along the objective, within which `tolerance` holds [m].
        outcome: How the shape was found.
        curve: The curve that the tool follows; None if it is the lines and arcs themselves.

    Raises:
        InvalidInput: The places do not increase from start to end of both paths.
    """

    objective: Path
    places: FloatArray
    tolerance: float
    line_tolerance: float | None = None
    zone: float | None = None
    outcome: Outcome = field(repr=False)
    curve: SmoothCurve | None = field(default=None, repr=False)
    # The quintic of the curve that each segment belongs to, (n,).
    _piece: IntArray = field(init=False, repr=False)

    def _check_together(self) -> None:
        super()._check_together()
        piece = np.zeros(0, dtype=np.intp)
        if self.curve is not None:
            middle = (self.breaks[:-1] + self.breaks[1:]) / 2
            last = len(self.curve.breaks) - 2
            piece = np.clip(np.searchsorted(self.curve.breaks, middle) - 1, 0, last)
        object.__setattr__(self, "_piece", piece)
        places = check_places(self.places, self.objective, self)
        object.__setattr__(self, "places", places)

    @cached_property
    def deviation(self) -> float:
        """Largest distance of its points from their places on the objective [m], of 15,000."""
        s = np.union1d(np.linspace(0.0, self.length, PLACES), self.places[:, 1])
        points = self.objective(np.interp(s, self.places[:, 1], self.places[:, 0]))
        return float(np.linalg.norm(self(s) - points, axis=1).max())

    def __str__(self) -> str:
        """As of any path, and what the shape gained."""
        durations = self.outcome.durations
        return format_table(
            self._title("Shaped path"),
            [
                ("tolerance", number(self.tolerance, "m")),
                (
                    "off the vertices",
                    "" if self.line_tolerance is None else number(self.line_tolerance, "m"),
                ),
                ("least durations", ", ".join(f"{k} {x:.4g} s" for k, x in durations.items())),
                *self._rows,
            ],
        )

    __repr__ = short_repr

    def __call__(self, s: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Point or derivative of the curve that the tool follows, as of any path."""
        if self.curve is None:
            return super().__call__(s, order, side=side)
        at = check_arc_length(s, self.length)
        i = self.locate(at, side=side)
        return self.on_segment(i, at - self.breaks[i], checks.derivative(order))

    def on_segment(self, i: IntArray, u: FloatArray, order: int = 0) -> FloatArray:
        """Point or derivative at distance `u` [m] from the start of segment `i`, of the curve.

        Args:
            i: Indices of segments, (n,).
            u: Distances from the starts of these segments [m], (n,).
            order: Order of the derivative, 0 for the point.
        """
        if self.curve is None:
            return super().on_segment(i, u, order)
        return self.curve.on_piece(self._piece[i], self.breaks[i] + u, order)

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Arc lengths on this path that correspond to arc lengths on the objective path [m].

        Args:
            s: Arc lengths of the objective path [m], any shape.
        """
        found = np.interp(
            checks.floats("arc lengths", s, "m"), self.places[:, 0], self.places[:, 1]
        )
        return np.asarray(np.clip(found, 0.0, self.length))


def doubt_search(paths: Iterable[Path]) -> list[str]:
    """A sentence on paths whose search for a shape ended early, or none."""
    found = [x for x in paths if isinstance(x, ShapedPath)]
    early = [x for x in found if x.outcome.unfinished]
    if not early:
        return []
    which = f" of {count_noun(len(early), 'contour')}" if len(found) > 1 else ""
    return [
        f"the search for the shape{which} ended early, because a tolerance of "
        f"{number(early[0].tolerance, 'm')} needs too many nodes. The path is the fastest one so "
        "far. A larger tolerance lets the search end, and rounded corners need no search."
    ]


def check_places(places: npt.ArrayLike, objective: Path, path: Path) -> FloatArray:
    """Places that belong together, locked, after a check that they lead along both paths.

    Args:
        places: Arc lengths on the objective and on the path [m], (n, 2).
        objective: The objective path.
        path: A path that was made from it.

    Raises:
        InvalidInput: The places do not increase from start to end of both paths.
    """
    found = checks.frozen_array(places)
    ends = np.array([[0.0, 0.0], [objective.length, path.length]])
    near = 1e-9 * (1 + ends[1])
    if found.ndim != 2 or not found.size or (np.abs(found[[0, -1]] - ends) > near).any():
        raise InvalidInput("The places of a shaped path must lead from its start to its end.")
    if (np.diff(found, axis=0) < 0).any():
        raise InvalidInput("The places of a shaped path must not decrease.")
    return found
