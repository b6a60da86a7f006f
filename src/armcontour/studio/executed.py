"""The picture of an execution, as a frame for the screen.

Errors are magnified on the screen, so that they are computed here, in 64 bits.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.motion import Execution
from armcontour.studio.demand import demand_shares, largest_demand, saturated_joints
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
    planned, execution, errors = executed.planned, executed.execution, executed.errors
    which = np.concatenate([np.arange(x.which.start, x.which.stop) for x in executed.pieces])
    base = np.concatenate([x.on_path for x in executed.pieces])
    tool = np.concatenate([x.tool for x in executed.pieces])
    distance = np.concatenate([x.found.distance for x in executed.pieces])
    demand = demand_shares(execution.demand[which], planned.run.limits)
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
        "rms": errors.rms,
        "max": errors.max,
        "settled": executed.settled,
        "saturated": saturated_joints(execution),
        "demand": largest_demand(execution.demand_range, planned.run.limits),
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
