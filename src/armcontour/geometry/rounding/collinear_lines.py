"""Nearly collinear lines become one line, for corner rounding and for the repair of vertices.

CAM programs divide lines into short moves, often with rounded coordinates. A curve at a vertex
replaces at most half of a segment, so the moves must be one segment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.frames import exp, shortest
from armcontour.core.kernel_cache import compiled
from armcontour.geometry.orientation import SAME_ORIENTATION, copy_pieces
from armcontour.geometry.origins import join_origins
from armcontour.geometry.path import Path
from armcontour.geometry.prescribed_orientation import carry_frame
from armcontour.geometry.rounding.rounded_orientation import SLIVER, turns_evenly
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE, Segments

# A vertex with a larger turn [rad] is a corner, whose turn may increase. Rounding errors of short
# moves can explain smaller turns.
SMALLEST_CORNER_TURN = 0.5
# Share of the largest turn inside a run by which the turns at its ends may increase. On a circle,
# runs of three lines would increase them by this turn; near an inflection, by a third of it.
TURN_INCREASE = 0.25
# Number of times that runs are split at their farthest vertices. Then they are split at every
# vertex. A million lines need 20 times if runs are split in halves.
MAX_SPLITS = 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MergedLines:
    """A path in which lines replace runs of nearly collinear lines, with m segments."""

    path: Path
    vertex: IntArray  # Index of each inner vertex among those of the given path, (m - 1,)
    deviation: FloatArray  # Distance of the given path from each segment [m], (m,)


class _Lines(NamedTuple):
    """The given lines, for the kernel: n segments of a path."""

    points: FloatArray  # Vertices of the path [m], (n + 1, dimension)
    starts: FloatArray  # Unit tangents at the starts of the segments, (n, dimension)
    ends: FloatArray  # Unit tangents at the ends of the segments, (n, dimension)
    turns: FloatArray  # Turns at the inner vertices [rad], (n - 1,)
    corner: BoolArray  # Mask of the inner vertices that are corners, (n - 1,)
    allowed: FloatArray  # Largest distance of each inner vertex from its line [m], (n - 1,)


class _Runs(NamedTuple):
    """Runs of segments between splits, with a value for each of the n segments, (n,)."""

    number: IntArray  # Number of segments in the run of each segment
    lines: FloatArray  # Unit vectors along the line of the run, (n, dimension)
    lengths: FloatArray  # Lengths of the runs' lines [m]
    distances: FloatArray  # Distance of the segment's start from the line of its run [m]
    deviations: FloatArray  # Largest of these distances in the run [m]
    inner_turns: FloatArray  # Largest turn inside the run [rad]
    is_new: BoolArray  # Whether the run was made by the last splits
    is_unacceptable: BoolArray  # Whether the segment requires a split of its run

    @classmethod
    def empty(cls, n: int, dimension: int) -> _Runs:
        """Make the arrays for n segments that are in no run yet."""
        return cls(
            number=np.empty(n, dtype=np.intp),
            lines=np.empty((n, dimension)),
            lengths=np.empty(n),
            distances=np.empty(n),
            deviations=np.empty(n),
            inner_turns=np.empty(n),
            is_new=np.ones(n, dtype=np.bool_),
            is_unacceptable=np.zeros(n, dtype=np.bool_),
        )


@compiled()
def split_runs(given: _Lines, runs: _Runs, split: BoolArray) -> None:
    """Split runs until every run is acceptable, and write them.

    Only runs that the last splits made are examined, because the others do not change.

    - `split`: mask of the inner vertices at which a run ends, (n - 1,); changed in place.
    """
    n = len(runs.number)
    attempt = 0
    has_split = True
    while has_split:
        first = 0
        while first < n:
            end = _run_end(split, first)
            if runs.is_new[first]:
                _measure_run(given, runs, first, end)
            first = end
        _mark_sharper_turns(given, runs, split)
        has_split = False
        first = 0
        while first < n:
            end = _run_end(split, first)
            if _split_run(given, runs, split, (first, end), attempt > MAX_SPLITS):
                has_split = True
            first = end
        attempt += 1


@compiled(inner=True)
def _run_end(split: BoolArray, first: int) -> int:
    """Return the index after the last segment of the run that begins with segment `first`."""
    end = first + 1
    while end <= len(split) and not split[end - 1]:
        end += 1
    return end


@compiled(inner=True)
def _measure_run(given: _Lines, runs: _Runs, first: int, end: int) -> None:
    """Write a run's line from its first point to its last, and test its segments."""
    points = given.points
    dimension = points.shape[1]
    square = 0.0
    for d in range(dimension):
        square += (points[end, d] - points[first, d]) ** 2
    size = math.sqrt(square)
    for d in range(dimension):
        runs.lines[first, d] = (points[end, d] - points[first, d]) / max(size, REPEATED_POINT)
    line = runs.lines[first]
    largest = 0.0
    largest_turn = 0.0
    for i in range(first, end):
        along = 0.0
        ahead = 0.0
        for d in range(dimension):
            along += (points[i, d] - points[first, d]) * line[d]
            ahead += given.starts[i, d] * line[d]
        square = 0.0
        for d in range(dimension):
            square += (points[i, d] - points[first, d] - along * line[d]) ** 2
        distance = math.sqrt(square)
        runs.distances[i] = distance
        largest = max(largest, distance)
        if i < end - 1:
            largest_turn = max(largest_turn, given.turns[i])
        allowed = given.allowed[i - 1] if i > 0 else 0.0
        # A single vertex with a turn is a corner, and not a sign of a divided line.
        is_corner = end - first == 2 and distance > SLIVER
        runs.is_unacceptable[i] = distance > allowed or ahead <= 0.0 or is_corner
    for i in range(first, end):
        runs.number[i] = end - first
        runs.lengths[i] = size
        runs.deviations[i] = largest
        runs.inner_turns[i] = largest_turn
        for d in range(dimension):
            runs.lines[i, d] = line[d]


@compiled(inner=True)
def _mark_sharper_turns(given: _Lines, runs: _Runs, split: BoolArray) -> None:
    """Mark the runs at whose ends the lines turn too much.

    The turn between two lines may exceed the turn of the given path by a share of the largest turn
    inside the runs.
    """
    for i in range(len(split)):
        if not split[i] or given.corner[i] or given.turns[i] >= SMALLEST_CORNER_TURN:
            continue
        # Between two segments of the given path, the turn is the given one.
        is_given = runs.number[i] == 1 and runs.number[i + 1] == 1
        if is_given or not (runs.is_new[i] or runs.is_new[i + 1]):
            continue
        difference = 0.0
        total = 0.0
        for d in range(runs.lines.shape[1]):
            before = runs.lines[i, d] if runs.number[i] > 1 else given.ends[i, d]
            after = runs.lines[i + 1, d] if runs.number[i + 1] > 1 else given.starts[i + 1, d]
            difference += (before - after) ** 2
            total += (before + after) ** 2
        turn = 2 * math.atan2(math.sqrt(difference), math.sqrt(total))
        inner_turn = max(runs.inner_turns[i], runs.inner_turns[i + 1])
        allowed_turn = max(given.turns[i] + TURN_INCREASE * inner_turn, inner_turn)
        if turn > allowed_turn + TANGENT_TOLERANCE:
            # The run that deviates more is the cause of a sharper turn.
            cause = i if runs.deviations[i] >= runs.deviations[i + 1] else i + 1
            runs.is_unacceptable[cause] = True


@compiled(inner=True)
def _split_run(
    given: _Lines, runs: _Runs, split: BoolArray, run: tuple[int, int], everywhere: bool
) -> bool:
    """Split an unacceptable run at its farthest vertices, or everywhere; return whether it was.

    A split at a vertex without a turn has no effect, so its distance counts as 0.
    """
    first, end = run
    is_unacceptable = False
    farthest = 0.0
    for i in range(first, end):
        is_unacceptable |= runs.is_unacceptable[i]
        if i > first and given.turns[i - 1] > TANGENT_TOLERANCE:
            farthest = max(farthest, runs.distances[i])
    was_split = False
    for i in range(first, end):
        runs.is_unacceptable[i] = False
        runs.is_new[i] = is_unacceptable
        if not is_unacceptable or i == first:
            continue
        has_turn = given.turns[i - 1] > TANGENT_TOLERANCE
        distance = runs.distances[i] if has_turn else 0.0
        if distance >= farthest or everywhere:
            split[i - 1] = True
            was_split = True
    return was_split


def merge_lines(path: Path, allowed: FloatArray) -> MergedLines:
    """Replace nearly collinear lines with equal limits, tag and angular rate by one line.

    The turns at the ends of such a run must not increase, unless a corner is there. Tessellated
    curves are therefore not changed. Runs begin as long as possible. As long as a run is not
    acceptable, it is split at the vertex that is farthest from its line.

    - `allowed`: largest distance of each inner vertex from its line [m], (n - 1,).
    """
    segments = path.segments
    points = path.vertices
    turns = path.turns
    carried = _carries_frame(path, turns)
    corner = _find_corners(segments, turns, allowed)
    split = corner | _find_changes(path, carried=carried)
    runs = _Runs.empty(len(path), points.shape[1])
    split_runs(
        _Lines(points, segments.tangents, segments.end_tangents, turns, corner, allowed),
        runs,
        split,
    )
    if split.all():
        unchanged = np.arange(len(split))
        return MergedLines(path=path, vertex=unchanged, deviation=np.zeros(len(path)))
    first = np.flatnonzero(np.append(True, split))
    return MergedLines(
        path=_draw_lines(path, runs, first, carried=carried),
        vertex=first[1:] - 1,
        deviation=runs.deviations[first],
    )


def _find_corners(segments: Segments, turns: FloatArray, allowed: FloatArray) -> BoolArray:
    """Return the mask of the inner vertices that are corners, (n - 1,).

    If both ends of a line move by `allowed` [m], this cannot explain a corner's turn [rad].
    """
    shorter = np.minimum(segments.lengths[1:], segments.lengths[:-1])
    corner = shorter * np.sin(turns) > 4 * allowed
    return np.asarray(corner | (turns >= np.pi / 2))


def _carries_frame(path: Path, turns: FloatArray) -> bool:
    """Return whether the orientation follows the tangent and never turns about it."""
    orientation = path.orientation
    if (
        orientation is None
        or not orientation.follows
        or not turns.max() < np.pi - SMALLEST_CORNER_TURN
    ):
        return False
    # Joined paths can have an orientation that turns about the tangent where they meet.
    frames = carry_frame(path.segments, orientation.starts[0]).starts
    return bool(np.abs(frames - orientation.starts).max() < SAME_ORIENTATION)


def _find_changes(path: Path, *, carried: bool) -> BoolArray:
    """Return the mask of inner vertices where a run must end, (n - 1,).

    A run ends next to a curve, and where limits, tag or angular rate change.

    - `carried`: true if the orientation follows the tangent, so that its rate is not compared.
    """
    segments = path.segments
    curved = (segments.curvatures > 0) | segments.is_transition
    changes = curved[1:] | curved[:-1] | (segments.tags[1:] != segments.tags[:-1])
    for column in (segments.speeds, segments.tolerances):
        changes |= np.diff(np.nan_to_num(column, nan=-1.0)) != 0
    orientation = path.orientation
    if orientation is not None and not turns_evenly(path):
        # An orientation with pieces of its own fits the given segments only.
        changes[:] = True
    elif orientation is not None and not carried:
        changes |= (orientation.kinks > 0) | (orientation.jumps > SAME_ORIENTATION)
    return np.asarray(changes)


def _draw_lines(path: Path, runs: _Runs, first: IntArray, *, carried: bool) -> Path:
    """Replace each run by one line.

    - `first`: index of the first segment in each run, (m,).
    - `carried`: true if the orientation follows the tangent and never turns about it.
    """
    segments = path.segments
    several = runs.number > 1
    last = first + runs.number[first] - 1
    lines = segments.replace(
        tangents=np.where(several[:, None], runs.lines, segments.tangents),
        lengths=np.where(several, runs.lengths, segments.lengths),
    )[first]
    lines = lines.replace(origins=join_origins(segments.origins[first], segments.origins[last]))
    orientation = path.orientation
    if orientation is not None and carried:
        # The frame turns with the first tangent.
        turn = exp(shortest(segments.tangents[0], lines.tangents[0]))
        along_lines = carry_frame(
            lines, turn @ orientation.starts[0], axis_only=orientation.axis_only
        )
        orientation = along_lines.with_cone(orientation.cone)
    elif orientation is not None:
        columns = copy_pieces(orientation, first)
        old_lengths = np.add.reduceat(segments.lengths, first)
        columns["first"] *= (old_lengths / lines.lengths)[:, None]
        orientation = replace(orientation, breaks=lines.breaks, **columns)
    return Path(
        segments=lines,
        merged=path.merged,
        orientation=orientation,
        smoothing=path.smoothing,
    )
