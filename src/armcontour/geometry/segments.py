"""Table of a path's segments: lines, arcs, and transitions between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypedDict

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray, ObjectArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quintics import evaluate, rescale
from armcontour.geometry.origins import first_lines, join_origins

# Points closer than this distance [m] count as one point, because no arm resolves a nanometre.
REPEATED_POINT = 1e-9
# Tangents that differ by less than this angle [rad] count as equal. At 1 m/s the velocity then
# jumps by less than 1 nm/s.
TANGENT_TOLERANCE = 1e-9
# Rounding errors of coordinates larger than this [m] approach REPEATED_POINT.
FAR = 1e3
EVERY = slice(None)
# Number of bisections for the extreme coordinates of a transition, enough for rounding precision.
BISECTIONS = 30
VECTORS = ("starts", "tangents", "normals")
NUMBERS = ("curvatures", "lengths", "speeds", "tolerances")
LIMITS = ("speeds", "tolerances", "tags", "origins")
COLUMNS = (*VECTORS, *NUMBERS, "tags", "origins", "quintics")
# Types of the columns that are not numbers with a fraction.
TYPES = {"tags": object, "origins": np.intp}
# Matrix from a quintic's coefficients of x² to x⁵ to the Bernstein control points of its second
# derivative.
SECOND_DERIVATIVE = checks.frozen_array([[2, 0, 0, 0], [2, 2, 0, 0], [2, 4, 4, 0], [2, 6, 12, 20]])
NOT_GIVEN = checks.frozen_array([])
NO_TAGS = checks.freeze(np.empty(0, dtype=object))
NO_ORIGINS = checks.freeze(np.empty(0, dtype=np.intp))


class LimitColumns(TypedDict):
    """Process requirements of n segments and their origins, as columns of `Segments`."""

    speeds: FloatArray
    tolerances: FloatArray
    tags: ObjectArray
    origins: IntArray


@dataclass(frozen=True, slots=True, weakref_slot=True, kw_only=True, eq=False)
class Segments:
    """Lines, arcs and transitions in the plane or in space, one per row.

    A line or arc i is `starts[i] + tangents[i] sin(k u)/k + normals[i] (1 - cos(k u))/k` with
    `k = curvatures[i]` and `0 <= u <= lengths[i]`; for a line k is 0. A transition is a segment
    whose curvature changes along it: `starts[i] + sum_k quintics[i, k] (u / lengths[i])^k`. There u
    differs from the arc length by at most a millionth (biarcs.py).

    Args:
        starts: First points of the segments [m], (n, 2) or (n, 3).
        tangents: Unit tangents at the starts, same shape.
        normals: Unit normals at the starts towards the arcs' centres, zero where a segment starts
            straight, same shape.
        curvatures: Curvatures of the segments [1/m], zero for lines, (n,); for a transition an
            upper bound.
        lengths: Lengths of the segments, above zero [m], (n,).
        speeds: Assigned velocities [m/s], NaN for segments without one, (n,).
        tolerances: Maximum permitted corner errors [m], NaN for segments without one, (n,).
        tags: Tag of each segment, or None, (n,).
        origins: Place in a file from which each segment was read (origins.py), 0 if unknown, (n,).
        quintics: Coefficients of the transitions from 1 to x⁵ [m], NaN for lines and arcs,
            (n, 6, dimension); (n, 0, 0) for a table without transitions.
        checked: Whether `check` has confirmed that the segments form a continuous path; false by
            default.
    """

    starts: FloatArray
    tangents: FloatArray
    normals: FloatArray
    curvatures: FloatArray
    lengths: FloatArray
    speeds: FloatArray = field(default_factory=lambda: NOT_GIVEN)
    tolerances: FloatArray = field(default_factory=lambda: NOT_GIVEN)
    tags: ObjectArray = field(default_factory=lambda: NO_TAGS)
    origins: IntArray = field(default_factory=lambda: NO_ORIGINS)
    quintics: FloatArray = field(default_factory=lambda: NOT_GIVEN)
    checked: bool = False

    def __post_init__(self) -> None:
        n = len(self.starts)
        for name in ("speeds", "tolerances"):
            if getattr(self, name) is NOT_GIVEN:
                object.__setattr__(self, name, np.full(n, np.nan))
        if self.tags is NO_TAGS:
            object.__setattr__(self, "tags", np.full(n, None))
        if self.origins is NO_ORIGINS:
            object.__setattr__(self, "origins", np.zeros(n, dtype=np.intp))
        if self.quintics is NOT_GIVEN:
            object.__setattr__(self, "quintics", np.empty((n, 0, 0)))
        for name in COLUMNS:
            array = np.asarray(getattr(self, name), dtype=TYPES.get(name, np.float64))
            object.__setattr__(self, name, checks.freeze(array))

    @classmethod
    def lines(cls, points: FloatArray, **columns: Any) -> Segments:
        """Return straight lines through points.

        `points` are the ends of the lines [m], (n + 1, dimension), each different from the previous
        point; `columns` are other columns of the table, such as speeds.
        """
        steps = np.diff(points, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        return cls(
            starts=points[:-1],
            tangents=steps / lengths[:, None],
            normals=np.zeros_like(steps),
            curvatures=np.zeros(len(steps)),
            lengths=lengths,
            **columns,
        )

    @classmethod
    def join(cls, tables: Sequence[Segments], *, checked: bool = False) -> Segments:
        """Join tables in order."""
        if len(tables) == 1:
            return tables[0]
        if len({table.quintics.shape[1] for table in tables}) > 1:
            tables = [table._with_quintics() for table in tables]
        columns = {x: np.concatenate([getattr(table, x) for table in tables]) for x in COLUMNS}
        return tables[0].replace(**columns, checked=checked)

    def _with_quintics(self) -> Segments:
        """Return the table with quintic coefficients, which are NaN if the table had none."""
        if self.quintics.shape[1]:
            return self
        quintics = np.full((len(self), 6, self.dimension), np.nan)
        return self.replace(quintics=quintics, checked=self.checked)

    def replace(self, *, checked: bool = False, **columns: npt.NDArray[Any]) -> Segments:
        """Replace some columns; the new arrays become read-only, without a copy."""
        table = object.__new__(Segments)
        for column in columns.values():
            column.setflags(write=False)
        for name in COLUMNS:
            object.__setattr__(table, name, columns.get(name, getattr(self, name)))
        object.__setattr__(table, "checked", checked)
        return table

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.lengths)

    def __getitem__(self, rows: Any) -> Segments:
        """Select rows; a contiguous slice of a checked table counts as checked."""
        columns = {name: getattr(self, name)[rows] for name in COLUMNS}
        is_contiguous = isinstance(rows, slice) and rows.step in (None, 1)
        is_path = is_contiguous and len(columns["lengths"]) > 0
        return self.replace(checked=self.checked and is_path, **columns)

    def split(self, bounds: IntArray) -> list[Segments]:
        """Split the table into tables of consecutive rows; each must be a continuous path.

        `bounds` are the first row of every table, and the number of rows, (n + 1,).
        """
        self._check_values()
        self.check_gaps(apart=bounds[1:-1])
        whole = self.replace(checked=True)
        return [whole[a:b] for a, b in zip(bounds[:-1], bounds[1:], strict=True)]

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point: 2 in the plane, 3 in space."""
        return int(self.starts.shape[1])

    @property
    def is_transition(self) -> BoolArray:
        """Mask of the transitions, (n,)."""
        if not self.quintics.shape[1]:
            return np.zeros(len(self), dtype=bool)
        return np.asarray(self.quintics[:, 0, 0] == 0)

    @property
    def limit_columns(self) -> LimitColumns:
        """Columns of the speeds, tolerances, tags and origins."""
        return {
            "speeds": self.speeds,
            "tolerances": self.tolerances,
            "tags": self.tags,
            "origins": self.origins,
        }

    @property
    def breaks(self) -> FloatArray:
        """Arc lengths at which the segments start and end, from 0 [m], (n + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])

    @property
    def ends(self) -> FloatArray:
        """Last point of every segment [m], (n, dimension)."""
        return self.evaluate(EVERY, self.lengths)

    @property
    def end_tangents(self) -> FloatArray:
        """Unit tangents at the segments' ends, (n, dimension)."""
        tangents = self.evaluate(EVERY, self.lengths, 1)
        bent = self.is_transition
        if bent.any():
            # At the end of a cut transition, the parameter is not exactly the arc length, so the
            # derivative is not exactly a unit vector.
            tangents[bent] = _unit_or_zero(tangents[bent])
        return tangents

    @property
    def closed(self) -> bool:
        """True if the last segment ends at the start of the first one."""
        return bool(np.linalg.norm(self[-1:].ends - self.starts[0]) <= REPEATED_POINT)

    @property
    def extent(self) -> FloatArray:
        """Bounding box: smallest and largest coordinates [m], (2, dimension); exact for arcs."""
        points = [self.starts, self.ends, *self._extreme_points()]
        bent = np.flatnonzero((self.curvatures > 0) & ~self.is_transition)
        sweeps = self.curvatures[bent] * self.lengths[bent]
        for axis in range(self.dimension):
            # A coordinate is extreme where the arc's tangent has no component along this axis.
            along = self.tangents[bent, axis]
            across = self.normals[bent, axis]
            for turn in (0.0, np.pi):
                angle = (np.arctan2(-along, across) + turn) % (2 * np.pi)
                on_arc = angle < sweeps
                i = bent[on_arc]
                points.append(self.evaluate(i, angle[on_arc] / self.curvatures[i]))
        all_points = np.concatenate(points)
        return np.stack([all_points.min(axis=0), all_points.max(axis=0)])

    def _extreme_points(self) -> list[FloatArray]:
        """Return transition points at which a coordinate is extreme [m], one array per axis."""
        if not self.quintics.size:
            return []
        points = []
        for axis in range(self.dimension):
            start_slopes = self.tangents[:, axis]
            end_slopes = self.end_tangents[:, axis]
            i = np.flatnonzero(self.is_transition & (start_slopes * end_slopes < 0))
            low = np.zeros(len(i))
            high = self.lengths[i]
            for _ in range(BISECTIONS):
                middle = (low + high) / 2
                before_extreme = self.evaluate(i, middle, 1)[:, axis] * start_slopes[i] > 0
                low = np.where(before_extreme, middle, low)
                high = np.where(before_extreme, high, middle)
            points.append(self.evaluate(i, low))
        return points

    def evaluate(self, i: IntArray | slice, u: FloatArray, order: int = 0) -> FloatArray:
        """Return the point or derivative at distance `u` [m] from the start of segment `i`."""
        values = self._on_arcs(i, u, order)
        if not self.quintics.shape[1]:
            return values
        bent = np.broadcast_to(self.is_transition[i], values.shape[:-1])
        if bent.any():
            rows = np.broadcast_to(np.arange(len(self))[i], bent.shape)[bent]
            distances = np.broadcast_to(u, bent.shape)[bent]
            on_quintics = evaluate(self.quintics[rows], self.lengths[rows], distances, order)
            values[bent] = on_quintics + self.starts[rows] if order == 0 else on_quintics
        return values

    def _on_arcs(self, i: IntArray | slice, u: FloatArray, order: int) -> FloatArray:
        """Return the point or derivative on lines and arcs; see `evaluate`."""
        k = self.curvatures[i]
        if order < 2 and not np.any(k):
            along = u if order == 0 else np.ones_like(u)
            line = along[..., None] * self.tangents[i]
            return np.asarray(self.starts[i] + line if order == 0 else line)
        angle = k * u
        if order == 0:
            half = angle / 2
            sine = np.sin(half)
            bent = half != 0
            # Chord length divided by arc length: sin(half) / half, or 1 if half is 0.
            share = np.divide(sine, half, out=np.ones_like(half), where=bent)
            chord = u * share
            along = chord * np.cos(half)
            across = chord * sine
            return np.asarray(
                self.starts[i]
                + along[..., None] * self.tangents[i]
                + across[..., None] * self.normals[i]
            )
        phase = angle + (order - 1) * np.pi / 2 if order > 1 else angle
        scale = k ** (order - 1)
        along, across = scale * np.cos(phase), scale * np.sin(phase)
        return np.asarray(along[..., None] * self.tangents[i] + across[..., None] * self.normals[i])

    def normals_at(self, i: IntArray | slice, u: FloatArray) -> FloatArray:
        """Return unit normals towards the centre at distance `u` [m] along segment `i`."""
        turn = (self.curvatures[i] * u)[..., None]
        normals = np.asarray(np.cos(turn) * self.normals[i] - np.sin(turn) * self.tangents[i])
        bent = self.is_transition[i]
        if bent.any():
            # A transition has no normal where it is straight.
            normals[bent] = _unit_or_zero(self.evaluate(i, u, 2)[bent])
        return normals

    def cut(self, i: IntArray, begin: FloatArray, end: FloatArray) -> Segments:
        """Cut segments `i`, each from distance `begin` to `end` along it [m]."""
        rows = self._move_starts(i, begin, begin > 0).replace(lengths=end - begin)
        lengths = self.lengths[i]
        return rows._restrict_transitions(begin / lengths, (end - begin) / lengths)

    def _move_starts(self, i: IntArray, u: FloatArray, moved: BoolArray, sign: int = 1) -> Segments:
        """Move the starts of segments in the mask `moved` by `u` along them; lengths stay.

        With sign -1, the moved segments run backwards from their new start.
        """
        rows = self[i]
        location = (i[moved], u[moved])
        starts, tangents, normals = (np.array(getattr(rows, name)) for name in VECTORS)
        starts[moved] = self.evaluate(*location)
        tangents[moved] = sign * self.evaluate(*location, 1)
        normals[moved] = self.normals_at(*location)
        return rows.replace(starts=starts, tangents=tangents, normals=normals)

    def _restrict_transitions(self, begin: FloatArray, factor: FloatArray) -> Segments:
        """Restrict each transition to its part from `begin` to `begin + factor` [1], (n,) each.

        `begin` and `factor` are fractions of the length; a negative factor reverses the transition.
        """
        changed = self.is_transition & ((begin != 0) | (factor != 1))
        if not changed.any():
            return self
        quintics, curvatures, tangents = (
            getattr(self, x).copy() for x in ("quintics", "curvatures", "tangents")
        )
        parts = rescale(quintics[changed], begin[changed], factor[changed])
        parts[:, 0] = 0.0
        quintics[changed] = parts
        curvatures[changed] = bound_second_derivatives(parts, self.lengths[changed])
        tangents[changed] = _unit_or_zero(tangents[changed])
        return self.replace(quintics=quintics, curvatures=curvatures, tangents=tangents)

    def reverse_rows(self, i: IntArray, back: BoolArray) -> Segments:
        """Select segments `i`, and reverse those in the mask `back`."""
        turned = self._move_starts(i, self.lengths[i], back, -1)
        return turned._restrict_transitions(np.where(back, 1.0, 0.0), np.where(back, -1.0, 1.0))

    def replace_rows(self, mask: BoolArray, rows: Segments) -> Segments:
        """Replace the rows in the mask `mask` by `rows`."""
        if self.quintics.shape[1] != rows.quintics.shape[1]:
            return self._with_quintics().replace_rows(mask, rows._with_quintics())
        columns = {name: getattr(self, name).copy() for name in COLUMNS}
        for name, column in columns.items():
            column[mask] = getattr(rows, name)
        return self.replace(**columns)

    def place(self, rotation: FloatArray, origin: FloatArray, scale: float = 1.0) -> Segments:
        """Scale segments about the origin, then rotate, then translate them by `origin`."""
        starts = origin + scale * self.starts @ rotation.T
        # Gaps can exceed their limit only by scaling or by the rounding of large coordinates.
        close = scale == 1.0 and float(np.abs(starts).max()) <= FAR
        return self.replace(
            starts=starts,
            tangents=self.tangents @ rotation.T,
            normals=self.normals @ rotation.T,
            curvatures=self.curvatures / scale,
            lengths=self.lengths * scale,
            quintics=scale * self.quintics @ rotation.T if self.quintics.size else self.quintics,
            checked=self.checked and close,
        )

    def lift(self) -> Segments:
        """Return segments in the plane as segments in space, at z = 0."""
        zero = np.zeros((len(self), 1))
        columns = {x: np.concatenate([getattr(self, x), zero], axis=1) for x in VECTORS}
        if self.quintics.size:
            columns["quintics"] = np.pad(self.quintics, ((0, 0), (0, 0), (0, 1)))
        return self.replace(checked=self.checked, **columns)

    def check(self) -> Segments:
        """Check that the segments form a continuous path, and mark the table as checked."""
        if self.checked:
            return self
        self._check_values()
        self.check_gaps()
        return self.replace(checked=True)

    def _check_values(self) -> None:
        """Raise InvalidInput for inconsistent columns or invalid values."""
        n = len(checks.points("starts", self.starts))
        if n == 0:
            raise InvalidInput("A path needs at least one segment.")
        for name in (*VECTORS, "curvatures", "lengths"):
            array = getattr(self, name)
            shape = self.starts.shape if name in VECTORS else (n,)
            if array.shape != shape or not np.isfinite(array).all():
                raise InvalidInput(
                    f"{name} of a path must be finite and have the shape {shape}, but have the "
                    f"shape {array.shape}{'' if array.shape != shape else ' and are not finite'}."
                )
        if (self.lengths <= 0).any() or (self.curvatures < 0).any():
            raise InvalidInput("Segment lengths must be above zero and curvatures not negative.")
        for name in LIMITS:
            if getattr(self, name).shape != (n,):
                raise InvalidInput(
                    f"{name} of a path must have one value per segment ({n}), but have the shape "
                    f"{getattr(self, name).shape}."
                )
        if (self.speeds <= 0).any() or (self.tolerances < 0).any():
            raise InvalidInput("Segment speeds must be above zero and tolerances not negative.")
        if (np.abs(np.linalg.norm(self.tangents, axis=1) - 1) > REPEATED_POINT).any():
            raise InvalidInput("The tangents of a path must be unit vectors.")

    def check_gaps(self, apart: IntArray | None = None) -> None:
        """Raise InvalidInput if a segment not in `apart` does not start at the previous end."""
        if len(self) == 1:
            return
        gaps = np.linalg.norm(self.ends[:-1] - self.starts[1:], axis=1)
        if apart is not None:
            gaps[apart - 1] = 0.0
        if (gaps > REPEATED_POINT).any():
            first = int(np.argmax(gaps > REPEATED_POINT))
            point = self.starts[first + 1].tolist()
            raise InvalidInput(
                f"Segment {first + 2} starts at {tuple(point)} m, {gaps[first]:.3g} m from the end "
                f"of segment {first + 1}. The segments of a path must be continuous.",
                index=first + 1,
                point=point,
                needed=float(gaps[first]),
                allowed=REPEATED_POINT,
            )


def bound_second_derivatives(quintics: FloatArray, lengths: FloatArray) -> FloatArray:
    """Return upper bounds of quintics' second derivatives by arc length [1/m], (n,).

    The bound is 0 for a quintic of length 0. The second derivative lies in the convex hull of its
    control points.

    - `quintics`: coefficients [m], (n, 6, dimension).
    - `lengths`: lengths [m], (n,).
    """
    control = np.einsum("ck,nkd->ncd", SECOND_DERIVATIVE, quintics[:, 2:])
    curvature = np.linalg.norm(control, axis=2).max(axis=1)
    return np.asarray(
        np.divide(curvature, lengths**2, out=np.zeros_like(curvature), where=lengths > 0)
    )


def _unit_or_zero(v: FloatArray) -> FloatArray:
    """Return unit vectors; zero for zero vectors."""
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(np.divide(v, size, out=np.zeros_like(v), where=size > 0))


def combine_limits(before: Segments, after: Segments) -> LimitColumns:
    """Combine limits at vertices: the smaller speed and tolerance, and the tag before it.

    The origin has the lines before and after the vertex, in the order of the file. Where a contour
    closes or runs backwards, it is that before the vertex.

    - `before`, `after`: segments before and after n vertices, n rows each.
    """
    return {
        "speeds": np.fmin(before.speeds, after.speeds),
        "tolerances": np.fmin(before.tolerances, after.tolerances),
        "tags": before.tags.copy(),
        "origins": np.where(
            first_lines(after.origins) > first_lines(before.origins),
            join_origins(before.origins, after.origins),
            before.origins,
        ),
    }


def close_gaps(
    starts: FloatArray, ends: FloatArray, stay: BoolArray, nearest: float
) -> tuple[FloatArray, BoolArray]:
    """Discard segments that are too short, and move the next start to close each gap.

    Returns the new starts, (n, dimension), and the mask of remaining segments, (n,).

    - `starts`: starts of consecutive segments [m], (n, dimension).
    - `ends`: ends of these segments [m], (n, dimension).
    - `stay`: mask of segments that remain whatever their length, (n,).
    - `nearest`: other segments remain if they end farther than this from the last remaining end
      [m], so many small steps are not lost.
    """
    mask = stay | (np.linalg.norm(ends - starts, axis=1) > nearest)
    if mask.all():
        return starts, mask
    starts = starts.copy()
    last_end = starts[0].copy()
    for i in range(len(mask)):
        starts[i] = last_end
        mask[i] = stay[i] or np.linalg.norm(ends[i] - last_end) > nearest
        last_end = ends[i] if mask[i] else last_end
    return starts, mask
