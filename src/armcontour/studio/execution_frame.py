"""Message frames with the simulated execution: tool deviation and poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import frame
from armcontour.core.result import FIRST, Data
from armcontour.jobs.rows import verdict_rows
from armcontour.motion import Execution
from armcontour.report.message_frame import MessageFrame
from armcontour.report.view import (
    View,
    allowed_drawing_error,
    essential_points,
    in_space,
    sample_times,
    select_points,
    to_float32,
)
from armcontour.studio.preview import PreviewExecution
from armcontour.verification.error_profile import error_rows
from armcontour.verification.evaluation import (
    demand_ratio,
    demand_row,
    saturated_fractions,
    saturated_row,
    settled_row,
)

# Approximate maximum number of drawn samples per execution.
MAX_SAMPLES = 4_000


def execution_frame(executed: PreviewExecution, view: View) -> MessageFrame:
    """Make the message frame with an execution's values, tool deviation and poses."""
    planned = executed.planned
    header = {
        "run": planned.run.name,
        "rows": frame(_figures(executed)),
        "centre": view.centre,
        "allowed": planned.allowed_distance,
        "tier": planned.tier,
        "off_t": _worst_time(executed),
    }
    arrays = {**_execution_lines(executed, view), **_poses(executed.execution)}
    return MessageFrame("executed", header, arrays)


def _worst_time(executed: PreviewExecution) -> float:
    """Return the time of the largest distance from the drawing [s]."""
    pieces = [(x.t, (x.followed_objective or x.followed).distance) for x in executed.pieces]
    t, distance = max(pieces, key=lambda piece: float(piece[1].max()))
    return float(t[distance.argmax()])


def _execution_lines(executed: PreviewExecution, view: View) -> dict[str, Any]:
    """Return the arrays of the tool deviation on the path.

    Deviations are computed with 64 bits, because the page magnifies them. `base` and `offset` are
    the nearest points on the path and the deviations from them on the drawing, `base_xyz` and
    `offset_xyz` the same in the frame of the path [m].
    """
    pieces = executed.pieces
    base, tool = (np.concatenate([getattr(x, y) for x in pieces]) for y in ("on_path", "tool"))
    ends = np.cumsum([0, *(len(x.on_path) for x in pieces)])
    distance = np.concatenate([x.followed.distance for x in pieces])
    # Without an objective, the drawing is the path.
    off = np.concatenate([(x.followed_objective or x.followed).distance for x in pieces])
    offset = view.screen_vectors(tool - base)
    indices = np.arange(len(base))
    if len(indices) > MAX_SAMPLES:
        error = allowed_drawing_error(view.uv(base))
        weight = np.where(essential_points(base, ends, error), np.inf, 0.0)
        weight[[np.argmax(distance), np.argmax(off)]] = np.inf
        shown = [*offset.T.astype(np.float64), distance, off]
        indices = select_points(weight, shown, MAX_SAMPLES)
    return {
        "base": view.screen_points(base[indices]),
        "offset": offset[indices],
        "base_xyz": to_float32(in_space(base[indices])),
        "offset_xyz": to_float32(in_space(tool - base)[indices]),
        "breaks": np.searchsorted(indices, ends[:-1]).astype(np.uint32),
        "t": to_float32(np.concatenate([x.t for x in pieces])[indices]),
        "error": to_float32(distance[indices]),
        "off": to_float32(off[indices]),
    }


def _figures(executed: PreviewExecution) -> Data:
    """Return the execution's values: the same rows as in a run's evaluation."""
    planned = executed.planned
    execution = executed.execution
    errors = executed.errors
    end_time = planned.run.end_time
    limits = planned.run.limits
    end = executed.settled if end_time is None else end_time
    return Data(
        "Preview",
        (
            *verdict_rows(planned, planned.judge(executed.judged_errors)),
            settled_row(executed.settled),
            *error_rows("contour_error", "contour error", errors, FIRST, FIRST),
            demand_row(demand_ratio(execution, limits)),
            saturated_row(saturated_fractions(execution, end)),
        ),
    )


def _poses(execution: Execution) -> dict[str, FloatArray]:
    """Return the arrays that animate the arm on the page: times, joint and tool positions."""
    t = execution.t
    even = np.searchsorted(t, t[0] + sample_times(t[-1] - t[0]))
    poses = np.unique(np.minimum(even, len(t) - 1))
    q = execution.q[poses]
    return {
        "pose_t": to_float32(t[poses]),
        "q": q,
        "xyz": to_float32(in_space(execution.arm.tool_position(q))),
    }
