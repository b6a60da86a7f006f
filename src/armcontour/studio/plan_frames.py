"""Message frames with the picture of a plan or a program, and the header of a refusal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmContourError, Collision
from armcontour.core.render import cells, frame, number
from armcontour.core.result import Data
from armcontour.core.text import Keys
from armcontour.geometry import RoundedPath
from armcontour.jobs import Job
from armcontour.jobs.rows import verdict_rows
from armcontour.jobs.run_result import RunResult
from armcontour.motion import LawAlongPath, Trajectory
from armcontour.planning import Explanation, Shortfall
from armcontour.program import Contour, Program, cut_parts, idle_parts
from armcontour.report.arm_frame import nearest_pair
from armcontour.report.message_frame import MessageFrame
from armcontour.report.time_table import MIN_TIME_SHARE, time_table
from armcontour.report.view import (
    View,
    allowed_drawing_error,
    drawn_arc_lengths,
    drawn_points,
    essential_points,
    in_space,
    points_at,
    sample_times,
    select_points,
    to_float32,
)
from armcontour.robot import Arm, Limits
from armcontour.robot.chain import floor_poses
from armcontour.robot.limit_use import use_of
from armcontour.studio.axis_frames import tool_axes
from armcontour.studio.model_reader import is_model_file
from armcontour.verification.clearance import Clearance

# Approximate maximum number of drawn points per path.
MAX_POINTS = 20_000
# Approximate maximum number of drawn points per simple path. Each point that the path's shape needs
# allows two more, up to MAX_POINTS.
MIN_POINTS = 1_200
# The interval of an active limit is always drawn if it is longer than this factor times the drawing
# tolerance.
VISIBLE_STRETCH = 8.0
# Limit index of points without an active limit.
NO_LIMIT = 255

# Number of points per rapid.
RAPID_POINTS = 16
# Number of times per rapid at which the largest tool speed is sought.
RAPID_PEAK_TIMES = 512
# Approximate maximum number of points for all rapids together.
MAX_RAPID_POINTS = 50_000
# Maximum number of rounded corners with handles; with more, no corner has a handle.
MAX_CORNERS = 400
# Maximum number of listed speed shortfalls.
MAX_SHORTFALLS = 60
# Maximum number of breaks at which joint usage is evaluated.
MAX_BREAKS = 2_000
# Approximate maximum number of times with extreme joint usage that are drawn in addition to evenly
# spaced times.
MAX_TIMES = 1_000


class Tier(StrEnum):
    """Accuracy of a picture."""

    # Path without a plan.
    OUTLINE = "outline"
    # Coarse plan without collision checks.
    PREVIEW = "preview"
    # Plan of a full run.
    EXACT = "exact"
    # Plan of a certificate.
    CERTIFIED = "certified"


@dataclass(frozen=True, kw_only=True, eq=False)
class Preview(RunResult):
    """The plan of a run, with the accuracy `tier`."""

    job: Job
    tier: Tier = Tier.PREVIEW
    # Warning if links move below the base; otherwise None.
    below_base: str | None = None

    @property
    def start(self) -> FloatArray:
        """Joint positions at the start of the motion [rad], (dof,)."""
        return self.trajectory(0.0)


def refusal_header(
    error: ArmContourError,
    view: View | None,
    *,
    tier: int,
    run: str | None = "",
    planned: Preview | None = None,
    waypoints: FloatArray | None = None,
    arm: Arm | None = None,
) -> dict[str, Any]:
    """Make the header of a frame `refusal`: the error and where it is on the path.

    `tier` is the failed computation: 1 plan, 2 execution, 3 full run. Without a `view`, the
    position is unknown. With an `arm`, the header has the postures at which bodies touch.
    """
    edits = [
        [_edit((*error.key, *keys), value) for keys, value in remedy.items()]
        for remedy in error.remedies
    ]
    return {
        **{"tier": tier, "run": run, "sentence": str(error)},
        **{"error": type(error).__name__, "exit": error.exit_code, "limit": error.limit},
        **{"needed": error.needed, "allowed": error.allowed},
        **{"key": ".".join(map(str, error.key)), "remedies": edits},
        "at": {} if view is None else _position(error, view, planned, waypoints),
        "bodies": error.bodies if isinstance(error, Collision) else (),
        "contacts": [] if arm is None else _contacts(error, arm),
    }


def _contacts(error: ArmContourError, arm: Arm) -> list[dict[str, Any]]:
    """Describe the pairs of bodies that are too near, in order of time.

    Each has the joint positions `q` [rad] at its first time `t` [s], and the nearest points of both
    bodies in the frame of the floor [m].
    """
    clearance = getattr(error, "clearance", None)
    if not isinstance(clearance, Clearance):
        return []
    rows = []
    for pair in clearance.too_near:
        (floor,) = floor_poses(arm.chain, pair.q[None])
        rows.append(
            {
                **{"first": pair.first, "second": pair.second, "words": pair.bodies},
                **{"t": pair.first_time, "q": pair.q, "frame": "floor"},
                "points": (pair.points - floor[:, 3]) @ floor[:, :3],
                "sentence": str(pair),
            }
        )
    return rows


def _position(
    error: ArmContourError, view: View, planned: Preview | None, waypoints: FloatArray | None
) -> dict[str, Any]:
    """Return where an error is on the path, and the waypoint there."""
    point = None if error.point is None else np.array(error.point)
    if point is None and error.t is not None and planned is not None:
        t = np.clip(error.t, 0.0, planned.trajectory.duration)
        point = planned.job.arm.tool_position(planned.trajectory(t))
    position: dict[str, Any] = {x: getattr(error, x) for x in ("s", "t", "joint", "index")}
    if point is not None and point.shape in {(2,), (3,)}:
        position |= {"xyz": in_space(point), "uv": view.uv(point)}
        if waypoints is not None and len(waypoints):
            away = np.linalg.norm(waypoints - position["uv"], axis=1)
            position["waypoint"] = int(away.argmin()) if away.min() < 1e-4 else None
    return {name: x for name, x in position.items() if x is not None}


def _edit(keys: Keys, value: Any) -> dict[str, Any]:
    return {"do": "unset" if value is None else "set", "key": [*keys], "value": value}


def picture_frame(planned: Preview, view: View) -> MessageFrame:
    """Make the message frame with the picture and the values of a plan."""
    header, arrays = _line_arrays(planned, planned.path, view)
    header |= {
        "run": planned.run.name,
        "rows": frame(Data("Plan", tuple(verdict_rows(planned, planned.judge(None))))),
        **view.header,
        **time_header(planned.explanation),
        "shortfalls": _shortfalls(planned, view),
        "corners": _corners(planned, view),
        "warnings": [*planned.warnings, *filter(None, [planned.below_base])],
        "notes": _notes(planned),
        "tier": planned.tier,
        "nearest": nearest_pair(planned),
    }
    usage = joint_usage(planned.trajectory, planned.job.arm, planned.run.limits)
    return MessageFrame("picture", header, {**arrays, **_rapids(planned, view), **usage})


def drawing_frame(program: Program | None, view: View, *, run: str = "") -> MessageFrame:
    """Make the message frame with a program's picture without a plan; None is an empty path."""
    header: dict[str, Any] = {"limits": [], "kerfs": [], "contours": []}
    arrays: dict[str, Any] = {
        "objective": to_float32(np.empty(0)),
        "objective_breaks": np.zeros(1, np.uint32),
    }
    if program is not None:
        header, arrays = _line_arrays(None, program, view)
    lists = ("rows", "shortfalls", "corners", "warnings")
    header |= {name: [] for name in lists} | view.header | time_header(None)
    notes = () if program is None else program.notes
    header |= {"run": run, "notes": notes, "tier": Tier.OUTLINE}
    return MessageFrame("picture", header, arrays)


def _line_arrays(
    planned: Preview | None, program: Program, view: View
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Make the header and the arrays of all lines.

    The lines are the objective, and with a plan the kerf, and the path with speed and active limit.
    """
    paths = [x.path for x in program.contours]
    points, _ = drawn_points(paths, np.inf)
    error = allowed_drawing_error(view.uv(points))
    header: dict[str, Any] = {
        "limits": [],
        "kerfs": [],
        "contours": _contours(planned, program.contours),
    }
    contours = program.contours
    if planned is not None:
        paths = [x.path for x in planned.objective.contours]
        program = planned.job.program
    arrays = _lines("objective", *drawn_points(paths, error), view, error)
    if is_model_file(program.source):
        header["knobs"], arrays["tool_axes"] = tool_axes([x.path for x in contours])
    if program.left_out:
        header["left_out"] = _contours(None, program.left_out)
        left_out = drawn_points([x.path for x in program.left_out], error)
        arrays |= _lines("left_out", *left_out, view, error)
    if planned is None:
        return header, arrays
    header["limits"] = limits = _limits(planned.explanation)
    header["kerfs"], kerf = _kerf(planned, view, error)
    points, ends, values = _sample_plan(planned, error)
    s = values["path_s"]
    binding = _active_limits(planned.explanation, limits, s)
    shape = essential_points(points, ends, error)
    weight = np.where(shape, np.inf, 0.0)
    changes = np.flatnonzero(np.diff(binding)) + 1
    # A change of the active limit weighs as much as the arc length to the next change.
    lengths = np.diff(s[np.append(changes, len(s) - 1)])
    lengths[lengths > VISIBLE_STRETCH * error] = np.inf
    weight[changes] = np.maximum(weight[changes], lengths)
    most = min(MAX_POINTS, MIN_POINTS + 2 * shape.sum())
    indices = select_points(weight, [values["speed"]], most)
    arrays |= {
        **kerf,
        "idle": _idle(planned),
        "path": view.screen_points(points[indices]),
        "path_breaks": np.searchsorted(indices, ends).astype(np.uint32),
        **{name: to_float32(x[indices]) for name, x in values.items()},
        "binding": binding[indices],
        "xyz": to_float32(in_space(points[indices])),
    }
    return header, arrays


def _sample_plan(
    planned: Preview, error: float
) -> tuple[FloatArray, IntArray, dict[str, FloatArray]]:
    """Sample all contours: return points [m], `ends` as in `essential_points`, and values.

    The values are arc length over all contours [m], time [s], tool speed and assigned velocity
    [m/s], NaN if not assigned. The points are points on curves and grid points of the plan.
    """
    rows: list[tuple[FloatArray, ...]] = []
    for contour, span in zip(planned.path.contours, planned.trajectory.contour_spans, strict=True):
        path = contour.path
        motion = span.trajectory
        assert motion is not None
        laws = [x.s for x in motion.laws if isinstance(x, LawAlongPath)]
        arc_lengths = np.unique(np.concatenate([drawn_arc_lengths(path, error), *laws]))
        s = np.clip(arc_lengths, 0.0, path.length)
        assigned = path.assigned_speeds(planned.run.limits.speed, s)
        assigned = np.where(np.isfinite(assigned), assigned, np.nan)
        times = span.t[0] + motion.time_at(s)
        rows.append((path(s), span.s[0] + s, times, motion.speed_at(s), assigned))
    ends = np.cumsum([0, *(len(x[0]) for x in rows)])
    points, *values = (np.concatenate(x) for x in zip(*rows, strict=True))
    names = ("path_s", "path_t", "speed", "assigned")
    return points, ends, dict(zip(names, values, strict=True))


def _active_limits(
    explanation: Explanation | None, limits: Sequence[Mapping[str, Any]], s: FloatArray
) -> npt.NDArray[np.uint8]:
    """Return the index in `limits` of the active limit from each arc length to the next, (n,)."""
    if explanation is None:
        return np.full(len(s), NO_LIMIT, dtype=np.uint8)
    index = {x["name"]: k for k, x in enumerate(limits)}
    bindings = explanation.bindings
    limit_indices = np.array([index.get(x.name, NO_LIMIT) for x in bindings], np.uint8)
    intervals = np.searchsorted([x.s[0] for x in bindings], s, side="right") - 1
    return limit_indices[np.clip(intervals, 0, len(limit_indices) - 1)]


def _contours(planned: Preview | None, contours: Sequence[Contour]) -> list[dict[str, Any]]:
    """List each contour's number, name and layer in the motion's order; with a plan also times."""
    rows: list[dict[str, Any]] = [
        {"number": x.number or k + 1, "name": x.name, "layer": x.layer}
        for k, x in enumerate(contours)
    ]
    if planned is not None:
        process = planned.job.process
        spans = planned.trajectory.contour_spans
        for row, contour, span in zip(rows, contours, spans, strict=True):
            row |= {"t": span.t, "pierces": process.of_contour(contour).pierce is not None}
    return rows


def _idle(planned: Preview) -> Any:
    """Return the parts on which the process is off: contour, and arc lengths [m], (n, 3)."""
    parts = np.array(idle_parts(planned.path, planned.job.process)).reshape(-1, 3)
    parts[:, 1:] += planned.path.breaks[parts[:, 0].astype(np.intp), None]
    return to_float32(parts)


def _lines(
    name: str, points: FloatArray, ends: IntArray, view: View, error: float
) -> dict[str, Any]:
    """Return screen coordinates and breaks of lines through points [m].

    `ends` is as in `essential_points`. Lines with more than `MAX_POINTS` points are simplified to
    within `error` [m].
    """
    indices = np.arange(len(points))
    if len(indices) > MAX_POINTS:
        indices = np.flatnonzero(essential_points(points, ends, error))
    return {
        name: view.screen_points(points[indices]),
        f"{name}_breaks": np.searchsorted(indices, ends).astype(np.uint32),
    }


def _kerf(planned: Preview, view: View, error: float) -> tuple[list[float], dict[str, Any]]:
    """Return each cut line's kerf [m], and the arrays of cut lines and drawn contours."""
    process = planned.job.process
    parts = cut_parts(planned.path, process)
    if not parts:
        return [], {}
    cut = [path(drawn_arc_lengths(path, error, begin, end)) for path, begin, end, _ in parts]
    uncut = [x.path for x in planned.job.program.contours if process.of_contour(x).kerf]
    points = np.concatenate(cut)
    ends = np.cumsum([0, *map(len, cut)])
    lines = _lines("cut", points, ends, view, error)
    lines |= _lines("drawn", *drawn_points(uncut, error), view, error)
    return [x[3] for x in parts], lines


def _limits(explanation: Explanation | None) -> list[dict[str, Any]]:
    """List name and kind of each active limit, in the motion's order."""
    if explanation is None:
        return []
    kinds = {x.name: x.limit for x in explanation.bindings if x.limit != "nothing"}
    return [{"name": name, "kind": limit} for name, limit in list(kinds.items())[:NO_LIMIT]]


def time_header(explanation: Explanation | None) -> dict[str, Any]:
    """Make the header with the times of active limits, and each limit kind's fraction."""
    if explanation is None:
        return {"time": [], "kinds": []}
    shares = [(x, share) for x, share in explanation.kinds.items() if share >= MIN_TIME_SHARE]
    kinds = [{"kind": x, "share": number(share, "1")} for x, share in shares]
    return {"time": cells(time_table(explanation)), "kinds": kinds}


def _shortfalls(planned: Preview, view: View) -> list[dict[str, Any]]:
    """List the points slowest relative to the assigned velocity, with reasons, in path order."""
    shortfalls = () if planned.explanation is None else planned.explanation.shortfalls
    worst = sorted(shortfalls, key=lambda x: x.speed / x.assigned)[:MAX_SHORTFALLS]
    if not worst:
        return []
    chosen = sorted(worst, key=lambda x: x.s)
    s = np.array([x.s for x in chosen])
    times = planned.trajectory.time_at(s).tolist()
    uv_points = view.uv(points_at(planned.path, s)).tolist()
    contours = np.searchsorted(planned.path.breaks[1:-1], s, side="right").tolist()
    return [
        {"s": x.s, "t": t, "uv": uv, "contour": contour, "kind": x.kind}
        | {"reason": x.reason, "share": x.speed / x.assigned}
        | {"sentence": _shortfall_sentence(x, planned.path)}
        for x, t, uv, contour in zip(chosen, times, uv_points, contours, strict=True)
    ]


def _shortfall_sentence(shortfall: Shortfall, program: Program) -> str:
    """Write reason, speeds and place in the file of a point below the assigned velocity."""
    speed = number(shortfall.speed, "m/s")
    words = f"{shortfall.reason}: {speed} of {number(shortfall.assigned, 'm/s')}"
    return ", ".join(filter(None, [words, program.origin_at(shortfall.s)]))


def _corners(planned: Preview, view: View) -> list[dict[str, Any]]:
    """List the rounded corners of all contours; an empty list if more than MAX_CORNERS."""
    rows: list[dict[str, Any]] = []
    rounding = planned.run.rounding
    for index, contour in enumerate(planned.path.contours):
        path = contour.path
        if not isinstance(path, RoundedPath):
            continue
        c = path.corners
        if len(rows) + len(c) > MAX_CORNERS:
            return []
        apex = view.uv(path((c.start + c.end) / 2))
        point = view.uv(c.point)
        tolerances = path.objective.tolerances
        bound = np.fmin(
            tolerances[c.vertex - 1], tolerances[np.minimum(c.vertex, len(tolerances) - 1)]
        )
        usual = np.nan if rounding is None or rounding.tolerance is None else rounding.tolerance
        allowed = np.fmin(bound, usual)
        for k in range(len(c)):
            rows.append(
                {
                    **{"index": len(rows), "contour": index, "vertex": c.vertex[k]},
                    **{"apex": apex[k], "corner": point[k], "error": c.error[k]},
                    **{"allowed": allowed[k], "radius": c.radius[k], "reason": c.reason[k]},
                }
            )
    return rows


def _notes(planned: Preview) -> list[str]:
    """List notes on the picture's accuracy and completeness."""
    notes = list(planned.remarks)
    explanation = planned.explanation
    if explanation is not None and (hidden := len(explanation.shortfalls) - MAX_SHORTFALLS) > 0:
        notes.append(
            f"{hidden} further points are below the assigned velocity; only the {MAX_SHORTFALLS} "
            "slowest points are marked and listed."
        )
    if explanation is None:
        notes.append(
            f"active limits are not available for the method {planned.trajectory.method}, only for "
            "the method optimal."
        )
    return notes


def _rapids(planned: Preview, view: View) -> dict[str, Any]:
    """Return the arrays of the rapids' sampled tool paths, and tool speeds [m/s].

    `rapid_most` is the largest speed of each rapid.
    """
    spans = [x.t for x in planned.trajectory.spans if x.kind == "rapid"]
    if not spans:
        return {}
    room = MAX_RAPID_POINTS // len(spans)
    each = max(2, min(RAPID_POINTS, room))
    times = _times_within(spans, each)
    t = times.ravel()
    duration = planned.trajectory.duration
    points = planned.job.arm.tool_position(planned.trajectory(np.minimum(t, duration)))
    finer = _times_within(spans, max(each, min(RAPID_PEAK_TIMES, room)))
    return {
        "rapid": view.screen_points(points),
        "rapid_xyz": to_float32(in_space(points)),
        "rapid_t": to_float32(t),
        "rapid_breaks": np.arange(0, len(points) + 1, each, dtype=np.uint32),
        "rapid_speed": to_float32(_tool_speed(planned, times).ravel()),
        "rapid_most": to_float32(_tool_speed(planned, finer).max(axis=1)),
    }


def _times_within(spans: Sequence[tuple[float, float]], count: int) -> FloatArray:
    """Return equidistant times within each span, with both ends [s], (spans, count)."""
    begin, end = np.array(spans).T
    return np.linspace(begin, end, count, axis=1)


def _tool_speed(planned: Preview, t: FloatArray) -> FloatArray:
    """Return the planned tool speed at times [m/s], shaped like `t`."""
    duration = planned.trajectory.duration
    q, dq = planned.trajectory.motion(np.minimum(t.ravel(), duration), 1)
    speed = np.linalg.norm(planned.job.arm.tool_velocity(q, dq), axis=-1)
    return np.asarray(speed.reshape(t.shape))


def joint_usage(trajectory: Trajectory, arm: Arm, limits: Limits) -> dict[str, Any]:
    """Return arrays over time: joint positions, and signed shares of joint limits."""
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
    t = t[order]
    is_even = order >= 2 * (len(breaks) - 1)
    q, dq, ddq = (np.concatenate(x)[order] for x in zip(*sides, strict=True))
    shares = {
        "usage_v": signed_shares("joint_velocity", limits, dq),
        "usage_a": signed_shares("joint_acceleration", limits, ddq),
    }
    if limits.joint_torque is not None and arm.has_bodies:
        shares["usage_torque"] = signed_shares("joint_torque", limits, arm.torque(q, dq, ddq))
    rows = list(chain.from_iterable(x.T for x in shares.values()))
    is_even[select_points(np.zeros(len(t)), rows, MAX_TIMES)] = True
    indices = np.flatnonzero(is_even)
    return {
        "t": to_float32(t[indices]),
        "q": np.ascontiguousarray(q[indices]),
        **{name: to_float32(x[indices]) for name, x in shares.items()},
    }


def signed_shares(name: str, limits: Limits, values: FloatArray) -> FloatArray:
    """Return values as fractions of a joint limit, with the values' signs, (n, dof)."""
    return np.copysign(use_of(name, limits, values).ratio, values)
