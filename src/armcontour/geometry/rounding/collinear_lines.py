"""Nearly collinear lines become one line, for corner rounding and for the repair of vertices.

CAM programs divide lines into short moves, often with rounded coordinates. A curve at a vertex
replaces at most half of a segment, so the moves must be one segment.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.frames import angle_between, exp, shortest
from armcontour.geometry.biarcs import dot, length
from armcontour.geometry.orientation import SAME_ORIENTATION, copy_pieces
from armcontour.geometry.path import Path
from armcontour.geometry.prescribed_orientation import carry_frame
from armcontour.geometry.rounding.rounded_orientation import SLIVER
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE

# A vertex with a larger turn [rad] is a corner, whose turn may increase. Rounding errors of short
# moves can explain smaller turns.
SHARP = 0.5
# Share of the largest turn inside a run by which the turns at its ends may increase. On a circle,
# runs of three lines would increase them by this turn; near an inflection, by a third of it.
NOISE = 0.25
# Number of times that runs are split at their farthest vertices. Then they are split at every
# vertex. A million lines need 20 times if runs are split in halves.
MAX_SPLITS = 40


def merge_lines(path: Path, allowed: FloatArray) -> tuple[Path, IntArray, FloatArray]:
    """Replace nearly collinear lines with equal limits, tag and angular rate by one line.

    The turns at the ends of such a run must not increase, unless a corner is there. Tessellated
    curves are therefore not changed.
    """
    # `allowed`: largest distance of each vertex between segments from its line [m], (n - 1,).
    # Returns the path with m segments; the index of each of its inner vertices among those of the
    # given path, (m - 1,); and the distance of the given path from each of its segments [m], (m,).
    rows = path.segments
    points = path.vertices
    turns = path.turns
    orientation = path.orientation
    curved = (rows.curvatures > 0) | rows.is_transition
    # A movement of both ends of a line by `allowed` cannot explain the turn of a corner.
    corner = np.minimum(rows.lengths[1:], rows.lengths[:-1]) * np.sin(turns) > 4 * allowed
    corner |= turns >= np.pi / 2
    split = corner | curved[1:] | curved[:-1] | (rows.tags[1:] != rows.tags[:-1])
    for column in (rows.speeds, rows.tolerances):
        split |= np.diff(np.nan_to_num(column, nan=-1.0)) != 0
    carried = orientation is not None and orientation.follows and turns.max() < np.pi - SHARP
    if orientation is not None and carried:
        # Joined paths can have an orientation that turns about the tangent where they meet.
        frames = carry_frame(rows, orientation.starts[0]).starts
        carried = bool(np.abs(frames - orientation.starts).max() < SAME_ORIENTATION)
    if orientation is not None and not carried:
        split |= (orientation.kinks > 0) | (orientation.jumps > SAME_ORIENTATION)
    for k in count():
        if split.all():
            return path, np.arange(len(split)), np.zeros(len(path))
        first = np.flatnonzero(np.append(True, split))
        run = np.cumsum(np.append(0, split))
        chords = np.append(points[first[1:]], points[-1:], axis=0) - points[first]
        lengths = length(chords)[run]
        number = np.bincount(run)[run]
        lines = chords[run] / np.maximum(lengths, REPEATED_POINT)[:, None]
        offsets = points[:-1] - points[first[run]]
        distances = length(offsets - dot(offsets, lines)[:, None] * lines)
        deviations = np.maximum.reduceat(distances, first)[run]
        before = np.where(number[:, None] > 1, lines, rows.end_tangents)[:-1]
        after = np.where(number[:, None] > 1, lines, rows.tangents)[1:]
        inner = np.maximum.reduceat(np.append(np.where(split, 0.0, turns), 0.0), first)[run]
        largest = np.maximum(inner[:-1], inner[1:])
        largest = np.maximum(turns + NOISE * largest, largest) + TANGENT_TOLERANCE
        sharper = (angle_between(before, after) > largest) & split & ~corner & (turns < SHARP)
        wrong = (distances > np.append(0.0, allowed)) | (dot(rows.tangents, lines) <= 0)
        # A single vertex with a turn is a corner, and not a sign of a divided line.
        wrong |= (number == 2) & (distances > SLIVER)
        # The run that deviates more is the cause of a sharper turn.
        wrong[:-1] |= sharper & (deviations[:-1] >= deviations[1:])
        wrong[1:] |= sharper & (deviations[:-1] < deviations[1:])
        # A split at a vertex without a turn has no effect.
        bent = distances * np.append(False, turns > TANGENT_TOLERANCE)
        far = (bent >= np.maximum.reduceat(bent, first)[run]) | (k > MAX_SPLITS)
        far = (far & np.logical_or.reduceat(wrong, first)[run])[1:] & ~split
        if not far.any():
            break
        split = split | far
    table = rows.replace(
        tangents=np.where(number[:, None] > 1, lines, rows.tangents),
        lengths=np.where(number > 1, lengths, rows.lengths),
    )[first]
    if orientation is not None and carried:
        frame = exp(shortest(rows.tangents[0], table.tangents[0])) @ orientation.starts[0]
        orientation = carry_frame(table, frame, axis_only=orientation.axis_only)
    elif orientation is not None:
        columns = copy_pieces(orientation, first)
        columns["first"] *= (np.add.reduceat(rows.lengths, first) / table.lengths)[:, None]
        orientation = replace(orientation, breaks=table.breaks, **columns)
    merged = Path(
        segments=table,
        merged=path.merged,
        orientation=orientation,
        smoothing=path.smoothing,
    )
    return merged, first[1:] - 1, deviations[first]
