"""Nearly collinear lines become one line, for corner rounding and for the repair of vertices.

CAM programs divide lines into short moves, often with rounded coordinates. A curve at a vertex
replaces at most half of a segment, so the moves must be one segment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.frames import angle_between, exp, shortest
from armcontour.geometry.biarcs import dot, length
from armcontour.geometry.orientation import SAME_ORIENTATION, copy_pieces
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Runs:
    """Runs of segments between splits; columns have a value for each of the n segments, (n,)."""

    first: IntArray  # Index of the first segment in each run, (m,)
    run: IntArray  # Index of the run of each segment
    number: IntArray  # Number of segments in the run of each segment
    lines: FloatArray  # Unit vectors along the line of the run, (n, dimension)
    lengths: FloatArray  # Lengths of the runs' lines [m]
    distances: FloatArray  # Distance of the segment's start from the line of its run [m]
    deviations: FloatArray  # Largest of these distances in the run [m]

    @classmethod
    def between(cls, points: FloatArray, split: BoolArray) -> _Runs:
        """Make the runs between splits, with lines from their first points to their last.

        - `points`: vertices of the path [m], (n + 1, dimension).
        - `split`: mask of the inner vertices at which a run ends, (n - 1,).
        """
        first = np.flatnonzero(np.append(True, split))
        run = np.cumsum(np.append(0, split))
        chords = np.append(points[first[1:]], points[-1:], axis=0) - points[first]
        lengths = length(chords)[run]
        lines = chords[run] / np.maximum(lengths, REPEATED_POINT)[:, None]
        offsets = points[:-1] - points[first[run]]
        distances = length(offsets - dot(offsets, lines)[:, None] * lines)
        return cls(
            first=first,
            run=run,
            number=np.bincount(run)[run],
            lines=lines,
            lengths=lengths,
            distances=distances,
            deviations=np.maximum.reduceat(distances, first)[run],
        )

    def is_farthest(self, turns: FloatArray, *, everywhere: bool) -> BoolArray:
        """Return the mask of the segments that start at the farthest vertex of their run, (n,).

        - `turns`: turns at the inner vertices [rad]. A split at a vertex without a turn has no
          effect, so its distance counts as 0.
        - `everywhere`: choose all vertices instead of the farthest.
        """
        distances = self.distances * np.append(False, turns > TANGENT_TOLERANCE)
        farthest = distances >= np.maximum.reduceat(distances, self.first)[self.run]
        return np.asarray(farthest | everywhere)

    def any_in_run(self, mask: BoolArray) -> BoolArray:
        """Return the mask of segments whose run has a segment in `mask`, (n,)."""
        return np.asarray(np.logical_or.reduceat(mask, self.first)[self.run])


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
    for k in count():
        if split.all():
            unchanged = np.arange(len(split))
            return MergedLines(path=path, vertex=unchanged, deviation=np.zeros(len(path)))
        runs = _Runs.between(points, split)
        unacceptable = _find_unacceptable(segments, turns, runs, split, corner, allowed)
        farthest = runs.is_farthest(turns, everywhere=k > MAX_SPLITS)
        new_splits = (farthest & runs.any_in_run(unacceptable))[1:] & ~split
        if not new_splits.any():
            break
        split = split | new_splits
    return MergedLines(
        path=_draw_lines(path, runs, carried=carried),
        vertex=runs.first[1:] - 1,
        deviation=runs.deviations[runs.first],
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


def _find_unacceptable(
    segments: Segments,
    turns: FloatArray,
    runs: _Runs,
    split: BoolArray,
    corner: BoolArray,
    allowed: FloatArray,
) -> BoolArray:
    """Return the mask of the segments that require a split of their run, (n,).

    - `turns`, `split`, `corner`, `allowed`: turns of the given path [rad], ends of runs, corners
      and largest distances from the lines [m] at the inner vertices, (n - 1,) each.
    """
    sharper = _find_sharper_turns(segments, turns, runs, split) & ~corner
    unacceptable = (runs.distances > np.append(0.0, allowed)) | (
        dot(segments.tangents, runs.lines) <= 0
    )
    # A single vertex with a turn is a corner, and not a sign of a divided line.
    unacceptable |= (runs.number == 2) & (runs.distances > SLIVER)
    # The run that deviates more is the cause of a sharper turn.
    deviations = runs.deviations
    unacceptable[:-1] |= sharper & (deviations[:-1] >= deviations[1:])
    unacceptable[1:] |= sharper & (deviations[:-1] < deviations[1:])
    return unacceptable


def _find_sharper_turns(
    segments: Segments, turns: FloatArray, runs: _Runs, split: BoolArray
) -> BoolArray:
    """Return the mask of run ends at which the lines turn too much, (n - 1,).

    The turn between the lines may exceed the turn of the given path by a share of the largest turn
    inside the runs.

    - `turns`, `split`: turns of the given path [rad] and ends of runs, at the inner vertices.
    """
    several = runs.number[:, None] > 1
    before = np.where(several, runs.lines, segments.end_tangents)[:-1]
    after = np.where(several, runs.lines, segments.tangents)[1:]
    inner_turns = np.append(np.where(split, 0.0, turns), 0.0)
    largest_inner_turn = np.maximum.reduceat(inner_turns, runs.first)[runs.run]
    of_both_runs = np.maximum(largest_inner_turn[:-1], largest_inner_turn[1:])
    allowed_turns = (
        np.maximum(turns + TURN_INCREASE * of_both_runs, of_both_runs) + TANGENT_TOLERANCE
    )
    return np.asarray(
        (angle_between(before, after) > allowed_turns) & split & (turns < SMALLEST_CORNER_TURN)
    )


def _draw_lines(path: Path, runs: _Runs, *, carried: bool) -> Path:
    """Replace each run by one line.

    - `carried`: true if the orientation follows the tangent and never turns about it.
    """
    segments = path.segments
    several = runs.number > 1
    lines = segments.replace(
        tangents=np.where(several[:, None], runs.lines, segments.tangents),
        lengths=np.where(several, runs.lengths, segments.lengths),
    )[runs.first]
    orientation = path.orientation
    if orientation is not None and carried:
        # The frame turns with the first tangent.
        turn = exp(shortest(segments.tangents[0], lines.tangents[0]))
        along_lines = carry_frame(
            lines, turn @ orientation.starts[0], axis_only=orientation.axis_only
        )
        orientation = along_lines.with_cone(orientation.cone)
    elif orientation is not None:
        columns = copy_pieces(orientation, runs.first)
        old_lengths = np.add.reduceat(segments.lengths, runs.first)
        columns["first"] *= (old_lengths / lines.lengths)[:, None]
        orientation = replace(orientation, breaks=lines.breaks, **columns)
    return Path(
        segments=lines,
        merged=path.merged,
        orientation=orientation,
        smoothing=path.smoothing,
    )
