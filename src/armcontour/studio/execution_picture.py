"""Message frames with the simulated execution: tool deviation and shares of joint limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import frame
from armcontour.core.result import FIRST, Data
from armcontour.jobs.rows import verdict_rows
from armcontour.motion import Execution, Trajectory
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import use_of
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.preview import PreviewExecution
from armcontour.studio.view import (
    View,
    drawing_error,
    essential_points,
    in_space,
    sample_times,
    select_points,
    to_float32,
)
from armcontour.verification.error_profile import error_rows
from armcontour.verification.evaluation import (
    demand_ratio,
    demand_row,
    saturated_fractions,
    saturated_row,
    settled_row,
)

# Approximate maximum number of drawn samples of an execution.
MAX_SAMPLES = 4_000
# Maximum number of breaks at which joint usage is evaluated, and approximate maximum number of
# times with extreme usage that are drawn in addition to evenly spaced times.
MAX_BREAKS, MAX_TIMES = 2_000, 1_000


def execution_frame(executed: PreviewExecution, view: View) -> PageFrame:
    """Message frame with values, tool deviation, joint demand and poses of an execution."""
    planned = executed.planned
    header = {
        "run": planned.run.name,
        "rows": frame(_figures(executed)),
        "centre": view.centre,
        "tier": planned.tier,
    }
    arrays = {**_execution_lines(executed, view), **_poses(executed.execution)}
    return PageFrame("executed", header, arrays)


def _execution_lines(executed: PreviewExecution, view: View) -> dict[str, Any]:
    """Arrays of tool deviation and demand (share of acceleration limit) on the path.

    Deviations are computed with 64 bits, because the page magnifies them.
    """
    pieces, limits = executed.pieces, executed.planned.run.limits
    base, tool = (np.concatenate([getattr(x, y) for x in pieces]) for y in ("on_path", "tool"))
    ends = np.cumsum([0, *(len(x.on_path) for x in pieces)])
    samples = np.concatenate([np.arange(x.which.start, x.which.stop) for x in pieces])
    distance = np.concatenate([x.followed.distance for x in pieces])
    demand = signed_shares("joint_acceleration", limits, executed.execution.demand)[samples]
    offset = view.screen_vectors(tool - base)
    indices = np.arange(len(samples))
    if len(indices) > MAX_SAMPLES:
        error = drawing_error(view.uv(base))
        weight = np.where(essential_points(base, ends, error), np.inf, 0.0)
        weight[np.argmax(distance)] = np.inf
        shown = [*offset.T.astype(np.float64), distance, *demand.T]
        indices = select_points(weight, shown, MAX_SAMPLES)
    return {
        "base": view.screen_points(base[indices]),
        "offset": offset[indices],
        "breaks": np.searchsorted(indices, ends[:-1]).astype(np.uint32),
        "t": to_float32(np.concatenate([x.t for x in pieces])[indices]),
        "error": to_float32(distance[indices]),
        "demand": to_float32(demand[indices]),
    }


def _figures(executed: PreviewExecution) -> Data:
    """Values of the execution: the same rows as in the evaluation of a run."""
    planned, execution, errors = executed.planned, executed.execution, executed.errors
    end_time, limits = planned.run.end_time, planned.run.limits
    end = executed.settled if end_time is None else end_time
    return Data(
        "Preview",
        (
            *verdict_rows(planned, executed.contour_errors),
            settled_row(executed.settled),
            *error_rows("contour_error", "contour error", errors, FIRST, FIRST),
            demand_row(demand_ratio(execution, limits)),
            saturated_row(saturated_fractions(execution, end)),
        ),
    )


def _poses(execution: Execution) -> dict[str, FloatArray]:
    """Arrays with which the page animates the arm: times, joint and tool positions."""
    t = execution.t
    even = np.searchsorted(t, t[0] + sample_times(t[-1] - t[0]))
    poses = np.unique(np.minimum(even, len(t) - 1))
    q = execution.q[poses]
    return {
        "pose_t": to_float32(t[poses]),
        "q": q,
        "xyz": to_float32(in_space(execution.arm.tool_position(q))),
    }


def joint_usage(trajectory: Trajectory, arm: Arm, limits: Limits) -> dict[str, Any]:
    """Arrays over time of joint positions and signed shares of joint limits."""
    breaks = trajectory.breaks
    if len(breaks) > MAX_BREAKS:
        breaks = breaks[np.linspace(0, len(breaks) - 1, MAX_BREAKS).astype(np.intp)]
    # Evenly spaced times are added, because rapids have few breaks and the page interpolates
    # linearly between times.
    even = sample_times(trajectory.duration)
    # Accelerations jump at breaks, so each break has a value from the left and one from the right.
    t = np.concatenate([breaks[1:], breaks[:-1], even])
    order = np.argsort(t, kind="stable")
    sides = trajectory.motion(breaks[1:], side="left"), trajectory.motion(t[len(breaks) - 1 :])
    t, is_even = t[order], order >= 2 * (len(breaks) - 1)
    q, dq, ddq = (np.concatenate(x)[order] for x in zip(*sides, strict=True))
    shares = {
        "usage_v": signed_shares("joint_velocity", limits, dq),
        "usage_a": signed_shares("joint_acceleration", limits, ddq),
    }
    if limits.joint_torque is not None and arm.has_bodies:
        shares["usage_torque"] = signed_shares("joint_torque", limits, arm.torque(q, dq, ddq))
    rows = [x for share in shares.values() for x in share.T]
    is_even[select_points(np.zeros(len(t)), rows, MAX_TIMES)] = True
    indices = np.flatnonzero(is_even)
    return {
        "t": to_float32(t[indices]),
        "q": np.ascontiguousarray(q[indices]),
        **{name: to_float32(x[indices]) for name, x in shares.items()},
    }


def signed_shares(name: str, limits: Limits, values: FloatArray) -> FloatArray:
    """Values as shares of a joint limit, with the signs of the values, (n, dof)."""
    return np.copysign(use_of(name, limits, values).ratio, values)
