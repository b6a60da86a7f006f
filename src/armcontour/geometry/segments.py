"""Table of the lines and arcs of a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.errors import InvalidInput

# Points closer than this count as one point: no arm resolves a nanometre [m].
REPEATED_POINT = 1e-9
# Tangents that differ by less than this count as equal: at 1 m/s the velocity jumps by 1 nm/s
# [rad].
TANGENT_TOLERANCE = 1e-9
# Rounding errors of coordinates beyond this come near the distance of repeated points [m].
FAR = 1e3
EVERY = slice(None)
VECTORS = ("starts", "tangents", "normals")
NUMBERS = ("curvatures", "lengths", "speeds", "tolerances")
COLUMNS = (*VECTORS, *NUMBERS, "tags")
NOT_GIVEN = _checks.lock_floats([])
NO_TAGS = _checks.lock_copy(np.empty(0, dtype=object))


@dataclass(frozen=True, slots=True, weakref_slot=True, kw_only=True, eq=False)
class Segments:
    """Lines and arcs in the plane or in space, one per row.

    Segment i is `starts[i] + tangents[i] sin(k u)/k + normals[i] (1 - cos(k u))/k` with
    `k = curvatures[i]` and `0 <= u <= lengths[i]`; for a line k is 0.

    Args:
        starts: First points of the segments [m], (n, 2) or (n, 3).
        tangents: Unit tangents at the starts, same shape.
        normals: Unit normals at the starts towards the arcs' centres, zero for lines, same shape.
        curvatures: Curvatures of the segments [1/m], zero for lines, (n,).
        lengths: Lengths of the segments, above zero [m], (n,).
        speeds: Assigned velocities of the segments [m/s], NaN for segments without one, (n,).
        tolerances: Largest corner errors of the segments [m], NaN for segments without one, (n,).
        tags: Free text per segment, or None, (n,).
        checked: Whether `check` has found that the segments make a continuous path.
    """

    starts: FloatArray
    tangents: FloatArray
    normals: FloatArray
    curvatures: FloatArray
    lengths: FloatArray
    speeds: FloatArray = field(default_factory=lambda: NOT_GIVEN)
    tolerances: FloatArray = field(default_factory=lambda: NOT_GIVEN)
    tags: npt.NDArray[np.object_] = field(default_factory=lambda: NO_TAGS)
    checked: bool = False

    def __post_init__(self) -> None:
        n = len(self.starts)
        for name in ("speeds", "tolerances"):
            if getattr(self, name) is NOT_GIVEN:
                object.__setattr__(self, name, np.full(n, np.nan))
        if self.tags is NO_TAGS:
            object.__setattr__(self, "tags", np.full(n, None))
        for name in COLUMNS:
            array = np.asarray(getattr(self, name), dtype=object if name == "tags" else np.float64)
            # Arrays that are locked already are shared, not copied.
            if array.flags.writeable or not array.flags.owndata:
                object.__setattr__(self, name, _checks.lock_copy(array))

    @classmethod
    def lines(cls, points: FloatArray, **columns: Any) -> Segments:
        """The table of straight lines through points.

        Args:
            points: Ends of the lines without equal neighbours [m], (n + 1, dimension).
            columns: Other columns of the table, such as speeds.
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
        """One table with the rows of several tables in order."""
        if len(tables) == 1:
            return tables[0]
        columns = {x: np.concatenate([getattr(table, x) for table in tables]) for x in COLUMNS}
        return tables[0].replace(**columns, checked=checked)

    def replace(self, *, checked: bool = False, **columns: npt.NDArray[Any]) -> Segments:
        """The table with some columns replaced by new arrays, which are locked and not copied."""
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
        """The table of the selected rows; neighbours of a checked table stay checked."""
        found = {name: getattr(self, name)[rows] for name in COLUMNS}
        together = isinstance(rows, slice) and rows.step in (None, 1) and len(found["lengths"]) > 0
        return self.replace(checked=self.checked and together, **found)

    def split(self, bounds: IntArray) -> list[Segments]:
        """Tables of consecutive rows, each a continuous path; checked all at once.

        Args:
            bounds: First row of every table, and the number of rows, (n + 1,).

        Raises:
            InvalidInput: As in `check`.
        """
        self._refuse_values()
        self.refuse_gaps(apart=bounds[1:-1])
        whole = self.replace(checked=True)
        return [whole[a:b] for a, b in zip(bounds[:-1], bounds[1:], strict=True)]

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.starts.shape[1])

    @property
    def breaks(self) -> FloatArray:
        """Arc lengths of the ends of the segments, from 0 [m], (n + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])

    @property
    def ends(self) -> FloatArray:
        """Last point of every segment [m], (n, dimension)."""
        return self.at(EVERY, self.lengths)

    @property
    def end_tangents(self) -> FloatArray:
        """Unit tangents at the segments' ends, (n, dimension)."""
        return self.at(EVERY, self.lengths, 1)

    @property
    def extent(self) -> FloatArray:
        """Smallest and largest coordinates [m], (2, dimension); those of arcs are exact."""
        points = [self.starts, self.ends]
        bent = np.flatnonzero(self.curvatures > 0)
        sweeps = self.curvatures[bent] * self.lengths[bent]
        for axis in range(self.dimension):
            # A coordinate of an arc is extreme where the tangent has no part along its axis.
            along, across = self.tangents[bent, axis], self.normals[bent, axis]
            for turn in (0.0, np.pi):
                angle = (np.arctan2(-along, across) + turn) % (2 * np.pi)
                on = angle < sweeps
                i = bent[on]
                points.append(self.at(i, angle[on] / self.curvatures[i]))
        everything = np.concatenate(points)
        return np.stack([everything.min(axis=0), everything.max(axis=0)])

    def at(self, i: IntArray | slice, u: FloatArray, order: int = 0) -> FloatArray:
        """Point or derivative at distance `u` [m] from the start of segment `i`."""
        k = self.curvatures[i]
        angle = k * u
        if order == 0:
            along = u * np.sinc(angle / np.pi)
            across = u * (angle / 2) * np.sinc(angle / (2 * np.pi)) ** 2
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
        """Unit normals at distance `u` [m] from the start of segment `i`, towards the centre."""
        turn = (self.curvatures[i] * u)[..., None]
        return np.asarray(np.cos(turn) * self.normals[i] - np.sin(turn) * self.tangents[i])

    def cut(self, i: IntArray, begin: FloatArray, end: FloatArray) -> Segments:
        """Parts of segments `i`, each from distance `begin` to `end` along its segment [m]."""
        rows, later = self[i], begin > 0
        starts, tangents, normals = (np.array(getattr(rows, name)) for name in VECTORS)
        at = i[later], begin[later]
        starts[later], tangents[later] = self.at(*at), self.at(*at, 1)
        normals[later] = self.normals_at(*at)
        return rows.replace(starts=starts, tangents=tangents, normals=normals, lengths=end - begin)

    def run(self, i: IntArray, back: BoolArray) -> Segments:
        """Segments `i`, with those in mask `back` reversed."""
        rows, k = self[i], i[back]
        starts, tangents, normals = (np.array(getattr(rows, name)) for name in VECTORS)
        at = k, self.lengths[k]
        starts[back], tangents[back] = self.at(*at), -self.at(*at, 1)
        normals[back] = self.normals_at(*at)
        return rows.replace(starts=starts, tangents=tangents, normals=normals)

    def put(self, which: BoolArray, rows: Segments) -> Segments:
        """The table with the rows in mask `which` replaced by `rows`."""
        columns = {name: getattr(self, name).copy() for name in COLUMNS}
        for name, column in columns.items():
            column[which] = getattr(rows, name)
        return self.replace(**columns)

    def place(self, rotation: FloatArray, origin: FloatArray, scale: float = 1.0) -> Segments:
        """The segments scaled about zero, then rotated, then translated by `origin`."""
        starts = origin + scale * self.starts @ rotation.T
        # Gaps can exceed their limit only by scaling or by the rounding of large coordinates.
        close = scale == 1.0 and float(np.abs(starts).max()) <= FAR
        return self.replace(
            starts=starts,
            tangents=self.tangents @ rotation.T,
            normals=self.normals @ rotation.T,
            curvatures=self.curvatures / scale,
            lengths=self.lengths * scale,
            checked=self.checked and close,
        )

    def lift(self) -> Segments:
        """Segments in the plane as segments in space, at z = 0."""
        deeper = {x: np.pad(getattr(self, x), ((0, 0), (0, 1))) for x in VECTORS}
        return self.replace(checked=self.checked, **deeper)

    def check(self) -> Segments:
        """The same segments, after a check that they make a continuous path.

        Raises:
            InvalidInput: The columns do not fit together, or there is a gap between segments.
        """
        if self.checked:
            return self
        self._refuse_values()
        self.refuse_gaps()
        return self.replace(checked=True)

    def _refuse_values(self) -> None:
        """Refuse columns that do not fit together, or values that no segment has."""
        n = len(_checks.points("starts", self.starts))
        if n == 0:
            raise InvalidInput("A path needs at least one segment.")
        for name in (*VECTORS, "curvatures", "lengths"):
            array = getattr(self, name)
            shape = self.starts.shape if name in VECTORS else (n,)
            if array.shape != shape or not np.isfinite(array).all():
                raise InvalidInput(f"{name} of a path must be finite and of shape {shape}.")
        if (self.lengths <= 0).any() or (self.curvatures < 0).any():
            raise InvalidInput("Segment lengths must be above zero and curvatures not negative.")
        for name in ("speeds", "tolerances", "tags"):
            if getattr(self, name).shape != (n,):
                raise InvalidInput(f"{name} of a path must be one per segment ({n}).")
        if (self.speeds <= 0).any() or (self.tolerances < 0).any():
            raise InvalidInput("Segment speeds must be above zero and tolerances not negative.")
        if (np.abs(np.linalg.norm(self.tangents, axis=1) - 1) > REPEATED_POINT).any():
            raise InvalidInput("The tangents of a path must be unit vectors.")

    def refuse_gaps(self, apart: IntArray | None = None) -> None:
        """Refuse a table in which a segment does not start where the segment before it ends.

        Args:
            apart: Rows that may start anywhere.

        Raises:
            InvalidInput: There is a gap; with the index of the segment after it.
        """
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
                f"of segment {first + 1}: a path must be continuous.",
                index=first + 1,
                point=point,
                needed=float(gaps[first]),
                allowed=REPEATED_POINT,
            )


def share_demand(before: Segments, after: Segments) -> dict[str, Any]:
    """Columns of segments that replace parts of two others: the lower speeds and tolerances.

    Args:
        before: The segments before them, whose tags they take.
        after: The segments after them.
    """
    return {
        "speeds": np.fmin(before.speeds, after.speeds),
        "tolerances": np.fmin(before.tolerances, after.tolerances),
        "tags": before.tags.copy(),
    }


def close_up(
    starts: FloatArray, ends: FloatArray, stay: BoolArray, nearest: float
) -> tuple[FloatArray, BoolArray]:
    """Drop segments that are too short, and move the starts of the next ones to close the gaps.

    Args:
        starts: Starts of consecutive segments [m], (n, dimension).
        ends: Ends of these segments [m], (n, dimension).
        stay: Mask of segments that are kept whatever their length, (n,).
        nearest: Other segments are kept if they end farther than this from the last kept end [m],
            so that many small steps are not lost.

    Returns:
        The new starts, (n, dimension), and the mask of kept segments, (n,).
    """
    kept = stay | (np.linalg.norm(ends - starts, axis=1) > nearest)
    if kept.all():
        return starts, kept
    starts, tip = starts.copy(), starts[0]
    for i in range(len(kept)):
        starts[i] = tip
        kept[i] = stay[i] or np.linalg.norm(ends[i] - tip) > nearest
        tip = ends[i] if kept[i] else tip
    return starts, kept
