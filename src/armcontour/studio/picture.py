"""Frames with the picture of a plan, of a program without a plan, or of a refusal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmContourError
from armcontour.core.render import cells, frame, number
from armcontour.core.result import Data
from armcontour.files.job_edits import key_in
from armcontour.geometry import Path, RoundedPath
from armcontour.jobs import Rounding, Run
from armcontour.jobs.single_corners import corner_waypoints
from armcontour.jobs.verdict import time_limit_row
from armcontour.motion import LawAlongPath
from armcontour.planning import Explanation
from armcontour.program import Program, cut_parts
from armcontour.studio.execution_picture import execution_lines, joint_usage
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.preview import Preview, PreviewExecution, Tier
from armcontour.studio.view import Detail, View, in_space, select_points, to_float32
from armcontour.verification.evaluation import duration_row

# About the largest number of points that are drawn for the speed alone; a short path needs fewer.
MAX_POINTS, MIN_POINTS = 20_000, 1_200
# A stretch on which another limit binds is drawn if it is longer than so many errors of the line.
VISIBLE_STRETCH = 8.0
# Where no limit binds, or it is not known.
NO_LIMIT = 255

# Points of a drawn rapid, and about the largest number of those of all.
RAPID_POINTS, MAX_RAPID_POINTS = 16, 50_000
# Longest lists in headers: corners have handles, and sentences are read.
MAX_CORNERS, MAX_SHORTFALLS = 400, 60
# Smallest share of the time in the legend.
MIN_SHARE = 5e-5


@dataclass(frozen=True, slots=True, eq=False)
class PlanCurve:
    """Points along all contours of a plan, with arc lengths over all contours."""

    # The places [m], (n, dimension).
    points: FloatArray
    # Their arc lengths, counted over all contours [m], (n,).
    s: FloatArray
    # Times at which the tool is there [s], (n,).
    t: FloatArray
    # Its speeds there [m/s], (n,).
    speed: FloatArray
    # Assigned velocities there, NaN for none [m/s], (n,).
    assigned: FloatArray
    ends: IntArray

    @classmethod
    def from_plan(cls, planned: Preview, view: View, detail: Detail) -> PlanCurve:
        """Visible points of a plan: points of curves and grid points of its laws."""
        rows: list[tuple[FloatArray, ...]] = []
        for contour, span in zip(
            planned.path.contours, planned.trajectory.contour_spans, strict=True
        ):
            path = contour.path
            if not detail.may_show(view.box, path):
                continue
            assert span.trajectory is not None
            laws = [x.s for x in span.trajectory.laws if isinstance(x, LawAlongPath)]
            places = np.unique(np.concatenate([detail.arc_lengths(path), *laws]))
            s = np.clip(places, 0.0, path.length)
            rows.append(
                (
                    path(s),
                    span.s[0] + s,
                    span.t[0] + span.trajectory.time_at(s),
                    span.trajectory.speed_at(s),
                    _assigned(path, s, planned.run),
                )
            )
        ends = np.cumsum([0, *(len(x[0]) for x in rows)])
        if not rows:
            rows = [(np.empty((0, planned.path.dimension)), *[np.empty(0)] * 4)]
        points, s, t, speed, assigned = (np.concatenate(x) for x in zip(*rows, strict=True))
        k, ends = detail.visible_ends(view.screen_points(points), ends)
        return cls(points[k], s[k], t[k], speed[k], assigned[k], ends)

    def drawn_indices(self, binding: npt.NDArray[np.uint8], detail: Detail) -> IntArray:
        """Indices of the drawn points: shape, changes of the limit, extremes of the speed."""
        shape = detail.essential_points(self.points, self.ends)
        weight = np.where(shape, np.inf, 0.0)
        changes = np.flatnonzero(np.diff(binding)) + 1
        # What a change is worth is the length up to the next one.
        lengths = np.diff(self.s[np.append(changes, len(self.s) - 1)])
        lengths[lengths > VISIBLE_STRETCH * detail.error] = np.inf
        weight[changes] = np.maximum(weight[changes], lengths)
        return select_points(weight, [self.speed], min(MAX_POINTS, MIN_POINTS + 2 * shape.sum()))

    def binding(
        self, explanation: Explanation | None, limits: Sequence[Mapping[str, Any]]
    ) -> npt.NDArray[np.uint8]:
        """Index of the active limit from each point to the next, (n,)."""
        if explanation is None:
            return np.full(len(self.s), NO_LIMIT, dtype=np.uint8)
        index = {x["name"]: k for k, x in enumerate(limits)}
        starts = np.array([x.s[0] for x in explanation.bindings])
        known = np.array([index.get(x.name, NO_LIMIT) for x in explanation.bindings], np.uint8)
        which = np.searchsorted(starts, self.s, side="right") - 1
        return known[np.clip(which, 0, len(known) - 1)]


def _assigned(path: Path, s: FloatArray, this: Run) -> FloatArray:
    """Assigned velocities at arc lengths, NaN for none [m/s], (n,)."""
    own = path.speeds[path.locate(s)]
    return own if this.limits.speed is None else np.fmin(own, this.limits.speed)


def refusal_header(
    error: ArmContourError,
    view: View,
    *,
    tier: int,
    run: str = "",
    planned: Preview | None = None,
    waypoints: FloatArray | None = None,
) -> dict[str, Any]:
    """Header of a refusal with its position; `tier`: 1 plan, 2 execution, 3 full run."""
    point = None if error.point is None else np.array(error.point)
    if point is None and error.t is not None and planned is not None:
        t = np.clip(error.t, 0.0, planned.trajectory.duration)
        point = planned.job.arm.tool_position(planned.trajectory(t))
    at: dict[str, Any] = {"s": error.s, "t": error.t, "joint": error.joint, "index": error.index}
    if point is not None and point.shape in {(2,), (3,)}:
        at |= {"xyz": in_space(point), "uv": view.uv(point)}
        if waypoints is not None and len(waypoints):
            away = np.linalg.norm(waypoints - at["uv"], axis=1)
            at["waypoint"] = int(away.argmin()) if away.min() < 1e-4 else None
    return {
        **{"tier": tier, "run": run, "sentence": str(error)},
        **{"error": type(error).__name__, "exit": error.exit_code, "limit": error.limit},
        **{"needed": error.needed, "allowed": error.allowed, "key": key_in(str(error))},
        "at": {name: x for name, x in at.items() if x is not None},
    }


def picture_frame(planned: Preview, view: View) -> PageFrame:
    """Frame with the picture of a plan."""
    detail, flat = _whole_detail(planned.path, view)
    header, arrays = _line_arrays(planned, view, detail)
    duration = duration_row(planned.trajectory.duration)
    header |= {
        "run": planned.run.name,
        "rows": frame(Data("Plan", (duration, *time_limit_row(planned)))),
        **view.header,
        **time_header(planned.explanation),
        "shortfalls": _shortfalls(planned, view),
        "corners": _corners(planned, view),
        "warnings": [*planned.warnings, *filter(None, [planned.below_base])],
        "notes": _notes(planned),
        "tier": planned.tier,
    }
    header["plane"]["flat"] = flat
    rest = joint_usage(planned.trajectory, planned.job.arm, planned.run.limits)
    return PageFrame("picture", header, {**arrays, **_rapids(planned, view), **rest})


def drawing_frame(program: Program | None, view: View, *, run: str = "") -> PageFrame:
    """Frame with the picture of a program without a plan; None for an empty path."""
    header: dict[str, Any] = {"error": 0.0, "limits": [], "kerfs": []}
    arrays: dict[str, Any] = {
        "objective": to_float32(np.empty(0)),
        "objective_breaks": np.zeros(1, np.uint32),
    }
    flat = True
    if program is not None:
        detail, flat = _whole_detail(program, view)
        header, arrays = _line_arrays(program, view, detail)
    lists = ("rows", "shortfalls", "corners", "warnings")
    header |= {name: [] for name in lists} | view.header | time_header(None)
    notes = () if program is None else program.notes
    header |= {"run": run, "notes": notes, "tier": Tier.OUTLINE}
    header["plane"]["flat"] = flat
    return PageFrame("picture", header, arrays)


def detail_frame(
    made: Preview | Program, executed: PreviewExecution | None, view: View, detail: Detail
) -> PageFrame:
    """Frame with the visible part of a picture and of its execution in full resolution."""
    header, arrays = _line_arrays(made, view, detail)
    if executed is not None:
        arrays |= execution_lines(executed, view, detail)
    return PageFrame("detail", {**header, "box": detail.box}, arrays)


def _whole_detail(program: Program, view: View) -> tuple[Detail, bool]:
    """Detail for the whole program, and whether it is flat."""
    smooth = Detail(np.inf)
    points = np.concatenate([x.path(smooth.arc_lengths(x.path)) for x in program.contours])
    return Detail.for_points(view.uv(points)), view.is_flat(points)


def _line_arrays(
    made: Preview | Program, view: View, detail: Detail
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and arrays of all lines."""
    planned = made if isinstance(made, Preview) else None
    objective = made if isinstance(made, Program) else made.objective
    header: dict[str, Any] = {"error": detail.error, "limits": [], "kerfs": []}
    paths = [x.path for x in objective.contours if detail.may_show(view.box, x.path)]
    arrays, _ = _lines("objective", [x(detail.arc_lengths(x)) for x in paths], view, detail)
    if planned is None:
        return header, arrays
    header["limits"] = limits = _limits(planned.explanation)
    header["kerfs"], kerf = _kerf(planned, view, detail)
    line = PlanCurve.from_plan(planned, view, detail)
    binding = line.binding(planned.explanation, limits)
    kept = line.drawn_indices(binding, detail)
    points, s = line.points[kept], line.s[kept]
    return header, {
        **arrays,
        **kerf,
        "path": view.screen_points(points),
        "path_breaks": np.searchsorted(kept, line.ends).astype(np.uint32),
        "path_s": to_float32(s),
        "path_t": to_float32(line.t[kept]),
        "speed": to_float32(line.speed[kept]),
        "assigned": to_float32(line.assigned[kept]),
        "binding": binding[kept],
        "xyz": to_float32(in_space(points)),
    }


def _lines(
    name: str, parts: Sequence[FloatArray], view: View, detail: Detail
) -> tuple[dict[str, Any], IntArray]:
    """Arrays of lines through points [m], and the index of the part that each line belongs to."""
    points = np.concatenate(parts) if parts else np.empty((0, 2))
    starts = np.cumsum([0, *map(len, parts)])
    seen, ends = detail.visible_ends(view.screen_points(points), starts)
    kept = np.arange(len(seen))
    if len(kept) > MAX_POINTS:
        kept = np.flatnonzero(detail.essential_points(points[seen], ends))
    arrays = {
        name: view.screen_points(points[seen[kept]]),
        f"{name}_breaks": np.searchsorted(kept, ends).astype(np.uint32),
    }
    return arrays, np.searchsorted(starts, seen[ends[:-1]], side="right") - 1


def _kerf(planned: Preview, view: View, detail: Detail) -> tuple[list[float], dict[str, Any]]:
    """Kerf of each cut line [m], and arrays of cut lines and drawn lines."""
    process = planned.job.process
    parts = [x for x in cut_parts(planned.path, process) if detail.may_show(view.box, x[0])]
    if not parts:
        return [], {}
    cut = []
    for path, begin, end, _ in parts:
        s = detail.arc_lengths(path)
        cut.append(path(np.concatenate([[begin], s[(s > begin) & (s < end)], [end]])))
    given = [x.path for x in planned.job.program.contours if process.of_layer(x.layer).kerf]
    drawn = [x(detail.arc_lengths(x)) for x in given if detail.may_show(view.box, x)]
    arrays, owners = _lines("cut", cut, view, detail)
    return [parts[k][3] for k in owners], arrays | _lines("drawn", drawn, view, detail)[0]


def _limits(explanation: Explanation | None) -> list[dict[str, Any]]:
    """Active limits, in the order of the motion."""
    if explanation is None:
        return []
    found = {x.name: x.limit for x in explanation.bindings if x.limit != "nothing"}
    return [{"name": name, "kind": limit} for name, limit in list(found.items())[:NO_LIMIT]]


def time_header(explanation: Explanation | None) -> dict[str, Any]:
    """Header with the table of active limits by time, and shares of the kinds."""
    if explanation is None:
        return {"time": [], "kinds": []}
    shares = [(x, share) for x, share in explanation.kinds.items() if share >= MIN_SHARE]
    kinds = [{"kind": x, "share": number(share, "1")} for x, share in shares]
    return {"time": cells(explanation.time_table), "kinds": kinds}


def _shortfalls(planned: Preview, view: View) -> list[dict[str, Any]]:
    """Slowest points below the assigned velocity, with reasons."""
    found = () if planned.explanation is None else planned.explanation.shortfalls
    worst = sorted(found, key=lambda x: x.speed / x.assigned)[:MAX_SHORTFALLS]
    if not worst:
        return []
    chosen = sorted(worst, key=lambda x: x.s)
    s = np.array([x.s for x in chosen])
    times = planned.trajectory.time_at(s).tolist()
    places = view.uv(_points_at(planned.path, s)).tolist()
    return [
        {"s": x.s, "t": t, "uv": uv, "sentence": x.sentence, "kind": x.kind}
        for x, t, uv in zip(chosen, times, places, strict=True)
    ]


def _points_at(program: Program, s: FloatArray) -> FloatArray:
    """Points at arc lengths over all contours [m], (n, dimension)."""
    breaks = program.breaks
    which = np.clip(np.searchsorted(breaks, s, side="right") - 1, 0, len(breaks) - 2)
    found = np.empty((len(s), program.dimension))
    for k in np.unique(which).tolist():
        path, of = program.contours[k].path, which == k
        found[of] = path(np.clip(s[of] - breaks[k], 0.0, path.length))
    return found


def _corners(planned: Preview, view: View) -> list[dict[str, Any]]:
    """Rounded corners of all contours; none if there are too many for handles."""
    found: list[dict[str, Any]] = []
    rounding, given = planned.run.rounding, planned.job.program.contours
    for index, contour in enumerate(planned.path.contours):
        path = contour.path
        if not isinstance(path, RoundedPath):
            continue
        c = path.corners
        if len(found) + len(c) > MAX_CORNERS:
            return []
        apex, point = view.uv(path((c.start + c.end) / 2)), view.uv(c.point)
        own = path.objective.tolerances
        beside = np.fmin(own[c.vertex - 1], own[np.minimum(c.vertex, len(own) - 1)])
        # Corners of several contours have no tolerance of their own.
        numbers = np.zeros(len(c), dtype=np.intp)
        if len(given) == 1:
            numbers = corner_waypoints(given[0].path, path.objective)[c.vertex - 1]
        allowed = beside if rounding is None else np.fmin(beside, _caps(rounding, numbers))
        for k in range(len(c)):
            found.append(
                {
                    **{"index": len(found), "contour": index, "vertex": c.vertex[k]},
                    "waypoint": int(numbers[k]) - 1 if numbers[k] else None,
                    **{"apex": apex[k], "corner": point[k], "error": c.error[k]},
                    **{"allowed": allowed[k], "radius": c.radius[k], "reason": c.reason[k]},
                }
            )
    return found


def _caps(rounding: Rounding, numbers: IntArray) -> FloatArray:
    """Largest errors that the job allows at corners [m], by waypoint; NaN without one."""
    usual = np.nan if rounding.tolerance is None else rounding.tolerance
    single = rounding.at or {}
    return np.array([single.get(k, usual) for k in numbers.tolist()], dtype=np.float64)


def _notes(planned: Preview) -> list[str]:
    """Notes on the accuracy of the picture."""
    found = [*planned.differs]
    found += [x for x in (planned.stops_note, planned.shape_note) if x is not None]
    why = planned.explanation
    if why is not None and (more := len(why.shortfalls) - MAX_SHORTFALLS) > 0:
        found.append(
            f"{more} more places are below the assigned velocity; the {MAX_SHORTFALLS} slowest "
            "are marked and listed."
        )
    if why is None:
        found.append(
            f"plans of the method {planned.trajectory.method} have no explanation: which limit "
            "binds is known for the method optimal."
        )
    return found


def _rapids(planned: Preview, view: View) -> dict[str, Any]:
    """Arrays of the tool paths of rapids."""
    spans = [x.t for x in planned.trajectory.spans if x.kind == "rapid"]
    if not spans:
        return {}
    each = max(2, min(RAPID_POINTS, MAX_RAPID_POINTS // len(spans)))
    begin, end = np.array(spans).T
    t = np.linspace(begin, end, each, axis=1).ravel()
    duration = planned.trajectory.duration
    points = planned.job.arm.tool_position(planned.trajectory(np.minimum(t, duration)))
    return {
        "rapid": view.screen_points(points),
        "rapid_xyz": to_float32(in_space(points)),
        "rapid_t": to_float32(t),
        "rapid_breaks": np.arange(0, len(points) + 1, each, dtype=np.uint32),
    }
