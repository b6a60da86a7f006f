"""The picture of an execution, as a frame for the screen.

Errors are magnified on the screen, so that they are computed here, in 64 bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.core.render import frame
from armcontour.core.result import FIRST, Data
from armcontour.evaluation.error_profile import error_rows
from armcontour.evaluation.evaluation import (
    demand_ratio,
    demand_row,
    saturated_row,
    saturated_shares,
    settled_row,
)
from armcontour.evaluation.pieces import Piece
from armcontour.jobs.run_data import off_drawing
from armcontour.motion import Execution
from armcontour.studio.demand import signed_shares
from armcontour.studio.previewed import Executed
from armcontour.studio.thinning import evenly, thin
from armcontour.studio.view import View, in_space, short
from armcontour.studio.wire import Frame

# About the largest number of samples of an execution.
MOST_SAMPLES = 4_000


def executed_frame(executed: Executed, view: View) -> Frame:
    """The picture of an execution: how far the tool is from the path, and what the joints need.

    Args:
        executed: The execution.
        view: How points get on the screen.
    """
    planned, execution = executed.planned, executed.execution
    demand = signed_shares("joint_acceleration", planned.run.limits, execution.demand)
    header = {
        "run": planned.run.name,
        "rows": frame(_figures(executed)),
        "centre": view.centre,
        "ms": {name: x * 1e3 for name, x in executed.seconds.items()},
    }
    arrays = {**tool_arrays(executed.pieces, view, demand=demand), **_poses(execution)}
    return Frame("executed", header, arrays)


def tool_arrays(pieces: Sequence[Piece], view: View, **columns: FloatArray) -> dict[str, Any]:
    """Arrays from which the tool is drawn, with its distance from the path.

    Args:
        pieces: The motion along each contour.
        view: How points get on the screen.
        **columns: Further arrays with a row for each sample of the whole motion.
    """
    which = np.concatenate([np.arange(x.which.start, x.which.stop) for x in pieces])
    base = np.concatenate([x.on_path for x in pieces])
    tool = np.concatenate([x.tool for x in pieces])
    distance = np.concatenate([x.found.distance for x in pieces])
    more = {name: values[which] for name, values in columns.items()}
    offset = view.offsets(tool - base)
    shown = [*offset.T.astype(np.float64), distance, *(y for x in more.values() for y in x.T)]
    kept = thin(_peaks(distance), shown, MOST_SAMPLES)
    begins = np.cumsum([0, *(x.which.stop - x.which.start for x in pieces[:-1])])
    return {
        "base": view.drawn(base[kept]),
        "offset": offset[kept],
        "breaks": np.searchsorted(kept, begins).astype(np.uint32),
        "t": short(np.concatenate([x.t for x in pieces])[kept]),
        "error": short(distance[kept]),
        **{name: short(values[kept]) for name, values in more.items()},
    }


def _figures(executed: Executed) -> Data:
    """Figures of the execution, as an evaluation has them."""
    planned, execution, errors = executed.planned, executed.execution, executed.errors
    until, limits = planned.run.until, planned.run.limits
    end = executed.settled if until is None else until
    return Data(
        "Preview",
        (
            off_drawing(planned.rounding_error, planned.tolerance, errors.max),
            settled_row(executed.settled),
            *error_rows("contour_error", "contour error", errors, FIRST, FIRST),
            demand_row(demand_ratio(execution, limits)),
            saturated_row(saturated_shares(execution, end)),
        ),
    )


def _poses(execution: Execution) -> dict[str, FloatArray]:
    """Arrays from which the arm is played, also between contours."""
    t = execution.t
    even = np.searchsorted(t, t[0] + evenly(t[-1] - t[0]))
    poses = np.unique(np.minimum(even, len(t) - 1))
    q = execution.q[poses]
    return {
        "pose_t": short(t[poses]),
        "q": q,
        "xyz": short(in_space(execution.arm.tool_position(q))),
    }


def _peaks(distance: FloatArray) -> FloatArray:
    """Infinite at the largest distance, else zero."""
    found = np.zeros(len(distance))
    found[int(np.argmax(distance))] = np.inf
    return found
