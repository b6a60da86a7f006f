"""Message frame with the segments of the drawing, with which the page measures."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import Segments
from armcontour.program import Program
from armcontour.report.message_frame import MessageFrame
from armcontour.report.view import in_space


def segments_frame(program: Program | None) -> MessageFrame:
    """Make the message frame with the segments of a program in the work frame [m].

    A segment of length l, tangent T, normal N and curvature k is, as in `Segments`,
    `start + T sin(k u)/k + N (1 - cos(k u))/k` with 0 <= u <= l, and `start + T u` if k is 0. The
    curvature of a transition is NaN, because its curvature changes; `ends` are the ends of all
    segments. Without a program there are no segments.
    """
    if program is None or not program.contours:
        return MessageFrame("segments", {"count": 0})
    table = Segments.join([x.path.segments for x in program.contours])
    curvatures = table.curvatures.copy()
    if table.quintics.shape[1] > 0:
        curvatures[np.isfinite(table.quintics[:, 0, 0])] = np.nan
    arrays = {
        "starts": _flat(table.starts),
        "ends": _flat(table.ends),
        "tangents": _flat(table.tangents),
        "normals": _flat(table.normals),
        "curvatures": curvatures,
        "lengths": np.array(table.lengths),
    }
    return MessageFrame("segments", {"count": len(table.lengths)}, arrays)


def _flat(vectors: FloatArray) -> FloatArray:
    """Return vectors in space, row by row, (n, 3)."""
    return np.ascontiguousarray(in_space(vectors))
