"""Segments of which parts beside vertices are replaced by others."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.geometry.biarcs import STRAIGHT
from armcontour.geometry.segments import Segments

# A remainder of a line between two arcs that is shorter than this is a rounding error and is left
# out [m].
SLIVER = 1e-12


def fit_lengths(wanted: FloatArray, vertex: IntArray, lengths: FloatArray) -> FloatArray:
    """Lengths beside vertices reduced to fit their segments [m], (n,).

    A vertex may take half of a segment, or all that the vertex at its other end does not want.
    This rule depends on direct neighbours only, is independent of the direction of travel, and
    always has a solution.

    Args:
        wanted: Wanted lengths on either side [m], (n,).
        vertex: Segments after which the vertices are, increasing, (n,).
        lengths: Lengths of all segments [m].
    """
    at = np.zeros(len(lengths) + 1)
    at[vertex + 1] = wanted
    room_before = np.maximum(lengths / 2, lengths - at[:-1])  # for the vertex at a segment's end
    room_after = np.maximum(lengths / 2, lengths - at[1:])  # for the vertex at its start
    return np.asarray(np.minimum(wanted, np.minimum(room_before[vertex], room_after[vertex + 1])))


def replace_vertices(
    rows: Segments, cut: FloatArray, drawn: Segments, after: IntArray
) -> tuple[Segments, IntArray, IntArray]:
    """Segments of which parts beside vertices are replaced.

    Args:
        rows: The segments, n of them.
        cut: Length that is replaced on either side of each vertex [m], (n + 1,).
        drawn: What replaces them, in order at each vertex.
        after: The segment after which each of these comes.

    Returns:
        The segments; for each, the index of the given segment, or of the one before its vertex; and
        its index in `drawn`, below 0 if it is not from there.
    """
    n = len(rows)
    starts, lengths = (
        rows.starts + cut[:-1, None] * rows.tangents,
        rows.lengths - cut[:-1] - cut[1:],
    )
    shorter = rows.replace(starts=starts, lengths=lengths)
    later = ((rows.curvatures > 0) & (cut[:-1] > 0)) | (rows.bent & (cut[1:] > 0))
    if later.any():
        ends = (rows.lengths - cut[1:])[later]
        shorter = shorter.put(later, rows.cut(np.flatnonzero(later), cut[:-1][later], ends))
    table = Segments.join([shorter, drawn])
    source = np.concatenate([np.arange(n), after])
    # A remainder of an arc is left out only if the tangent jumps by no more than a rounding error.
    used = table.lengths > SLIVER / np.maximum(1.0, SLIVER / STRAIGHT * table.curvatures)
    used[n:] = True
    order = np.argsort(source, kind="stable")
    order = order[used[order]]
    return table[order], source[order], order - n
