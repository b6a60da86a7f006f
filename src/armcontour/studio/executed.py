"""The picture of an execution, as a frame for the screen.

Errors are magnified on the screen, so that they are computed here, in 64 bits.
"""

from __future__ import annotations

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
from armcontour.jobs.verdict import verdict_rows
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
    which = np.concatenate([np.arange(x.which.start, x.which.stop) for x in executed.pieces])
    base = np.concatenate([x.on_path for x in executed.pieces])
    tool = np.concatenate([x.tool for x in executed.pieces])
    distance = np.concatenate([x.found.distance for x in executed.pieces])
    demand = signed_shares("joint_acceleration", planned.run.limits, execution.demand[which])
    offset = view.offsets(tool - base)
    kept = thin(
        _peaks(distance),
        [*offset.T.astype(np.float64), distance, *demand.T],
        MOST_SAMPLES,
    )
    begins = np.cumsum([0, *(x.which.stop - x.which.start for x in executed.pieces[:-1])])
    at = which[kept]
    header = {
        "run": planned.run.name,
        "rows": frame(_figures(executed)),
        "centre": view.centre,
        "ms": {name: x * 1e3 for name, x in executed.seconds.items()},
    }
    return Frame(
        "executed",
        header,
        {
            "base": view.drawn(base[kept]),
            "offset": offset[kept],
            "breaks": np.searchsorted(kept, begins).astype(np.uint32),
            "t": short(execution.t[at]),
            "error": short(distance[kept]),
            "demand": short(demand[kept]),
            **_poses(execution),
        },
    )


def _figures(executed: Executed) -> Data:
    """Figures of the execution, as an evaluation has them."""
    planned, execution, errors = executed.planned, executed.execution, executed.errors
    until, limits = planned.run.until, planned.run.limits
    end = executed.settled if until is None else until
    return Data(
        "Preview",
        (
            *verdict_rows(planned, errors.max),
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
