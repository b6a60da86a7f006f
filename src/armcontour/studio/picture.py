"""The picture of a plan, or of a program that is not planned yet, as a frame for the screen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.core.render import cells, frame, number
from armcontour.core.result import Data
from armcontour.evaluation.evaluation import duration_row
from armcontour.geometry import RoundedPath
from armcontour.jobs import Rounding
from armcontour.jobs.single_corners import corner_waypoints
from armcontour.jobs.verdict import time_limit_row
from armcontour.program import Program, cut_parts
from armcontour.studio.demand import demand_of
from armcontour.studio.line import NOTHING, Line, places_of
from armcontour.studio.previewed import Preview
from armcontour.studio.thinning import bends, thin
from armcontour.studio.view import View, in_space, short
from armcontour.studio.wire import Frame
from armcontour.timing import Explanation

# About the largest number of points of a path.
MOST_POINTS = 20_000
# A short path needs fewer, with so many more for each place that makes its curves look smooth.
LEAST_POINTS, PER_PLACE = 1_200, 8
# Points of a drawn rapid.
OF_RAPID = 16
# Longest lists in headers: corners have handles, and sentences are read.
MOST_CORNERS, MOST_SHORTFALLS = 400, 100
# Smallest share of the time in the legend.
VISIBLE = 5e-5


def picture_frame(planned: Preview, view: View) -> Frame:
    """The picture of a plan.

    Args:
        planned: The plan.
        view: How points get on the screen.
    """
    line = Line.of(planned)
    limits = _limits(planned.explanation)
    binding = line.binding(planned.explanation, limits)
    places = sum(len(places_of(x.path)) for x in planned.path.contours)
    kept = line.thinned(binding, min(MOST_POINTS, LEAST_POINTS + PER_PLACE * places))
    points, s = line.points[kept], line.s[kept]
    kerfs, cut = _kerf(planned, view)
    duration = duration_row(planned.trajectory.duration)
    header = {
        "run": planned.run.name,
        "rows": frame(Data("Plan", (duration, *time_limit_row(planned.explanation)))),
        **view.header,
        "contours": _contours(planned.path, line.ends, kept),
        "limits": limits,
        **time_header(planned.explanation),
        "shortfalls": _shortfalls(planned, view),
        "corners": _corners(planned, view),
        "kerfs": kerfs,
        "warnings": [*planned.warnings, *filter(None, [planned.below_base])],
        "notes": _notes(planned),
        "ms": {name: x * 1e3 for name, x in planned.seconds.items()},
        "planned": True,
    }
    header["plane"]["flat"] = view.is_flat(line.points)
    return Frame(
        "picture",
        header,
        {
            **_objective(planned.objective, view),
            **cut,
            "path": view.drawn(points),
            "path_s": short(s),
            "path_t": short(line.t[kept]),
            "speed": short(line.speed[kept]),
            "assigned": short(line.assigned[kept]),
            "binding": binding[kept],
            "xyz": short(in_space(points)),
            **_rapids(planned, view),
            **demand_of(planned.trajectory, planned.job.arm, planned.run.limits),
        },
    )


def drawing_frame(program: Program, view: View, *, run: str = "", note: str = "") -> Frame:
    """The picture of a program that is not planned yet; without speeds and times.

    Args:
        program: The program.
        view: How points get on the screen.
        run: Name of the run that is shown.
        note: Why it is not planned.
    """
    points, first = _outline(program)
    arrays = _thinned_outline(points, first, view)
    header = {
        "run": run,
        "rows": [],
        **view.header,
        "contours": [],
        "limits": [],
        **time_header(None),
        "shortfalls": [],
        "corners": [],
        "kerfs": [],
        "warnings": [],
        "notes": [*program.notes, *([note] if note else [])],
        "ms": {},
        "planned": False,
    }
    header["plane"]["flat"] = view.is_flat(points)
    return Frame("picture", header, arrays)


def _outline(program: Program) -> tuple[FloatArray, IntArray]:
    """Points of all contours [m], and the index of the first point of each, and their number."""
    return _join([x.path(places_of(x.path)) for x in program.contours])


def _join(parts: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Points of all parts, and the index of the first point of each, and their number."""
    return np.concatenate(parts), np.cumsum([0, *(len(x) for x in parts)])


def _objective(objective: Program, view: View) -> dict[str, Any]:
    return _thinned_outline(*_outline(objective), view)


def _kerf(planned: Preview, view: View) -> tuple[list[float], dict[str, Any]]:
    """The kerf of each part that is cut [m], and arrays of these parts and of what is drawn."""
    process, parts = planned.job.process, cut_parts(planned.path, planned.job.process)
    if not parts:
        return [], {}
    cut = []
    for path, begin, end, _ in parts:
        s = places_of(path)
        cut.append(path(np.concatenate([[begin], s[(s > begin) & (s < end)], [end]])))
    given = [x for x in planned.job.program.contours if process.of_layer(x.layer).kerf]
    drawn = _join([x.path(places_of(x.path)) for x in given])
    return [kerf for *_, kerf in parts], {
        **_thinned_outline(*_join(cut), view, "cut"),
        **_thinned_outline(*drawn, view, "drawn"),
    }


def _thinned_outline(
    points: FloatArray, ends: IntArray, view: View, name: str = "objective"
) -> dict[str, Any]:
    """Arrays of lines of a name, by default the path before corners are rounded."""
    weight = bends(points)
    weight[ends[:-1]] = weight[ends[1:] - 1] = np.inf
    kept = thin(weight, list(points.T), MOST_POINTS)
    return {
        name: view.drawn(points[kept]),
        f"{name}_breaks": np.searchsorted(kept, ends).astype(np.uint32),
    }


def _contours(program: Program, ends: IntArray, kept: IntArray) -> list[dict[str, Any]]:
    """First point of each contour, the one after its last, its name and its layer."""
    first = np.searchsorted(kept, ends).tolist()
    return [
        {"from": begin, "to": end, "name": x.name, "tag": x.layer or x.path.tags[0]}
        for x, begin, end in zip(program.contours, first[:-1], first[1:], strict=True)
    ]


def _limits(explanation: Explanation | None) -> list[dict[str, Any]]:
    """The limits that bind somewhere, in the order of the motion."""
    if explanation is None:
        return []
    found = {x.name: x.limit for x in explanation.bindings if x.limit != "nothing"}
    return [{"name": name, "kind": limit} for name, limit in list(found.items())[:NOTHING]]


def time_header(explanation: Explanation | None) -> dict[str, Any]:
    """Headers of what takes the time: a table as people read it, and shares of the kinds."""
    if explanation is None:
        return {"time": [], "kinds": []}
    shares = [(x, share) for x, share in explanation.kinds.items() if share >= VISIBLE]
    kinds = [{"kind": x, "share": number(share, "1")} for x, share in shares]
    return {"time": cells(explanation.time_table), "kinds": kinds}


def _shortfalls(planned: Preview, view: View) -> list[dict[str, Any]]:
    """Where the tool is slower than assigned, and why; the worst ones if there are many."""
    found = () if planned.explanation is None else planned.explanation.shortfalls
    worst = sorted(found, key=lambda x: x.speed / x.assigned)[:MOST_SHORTFALLS]
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
    """Points at arc lengths that are counted over all contours [m], (n, dimension)."""
    breaks = program.breaks
    which = np.clip(np.searchsorted(breaks, s, side="right") - 1, 0, len(breaks) - 2)
    found = np.empty((len(s), program.dimension))
    for k in np.unique(which).tolist():
        path, of = program.contours[k].path, which == k
        found[of] = path(np.clip(s[of] - breaks[k], 0.0, path.length))
    return found


def _corners(planned: Preview, view: View) -> list[dict[str, Any]]:
    """The rounded corners of all contours; none if they are too many to grab."""
    found: list[dict[str, Any]] = []
    rounding, given = planned.run.rounding, planned.job.program.contours
    for index, contour in enumerate(planned.path.contours):
        path = contour.path
        if not isinstance(path, RoundedPath):
            continue
        c = path.corners
        if len(found) + len(c) > MOST_CORNERS:
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
    """The largest errors that a job gives corners [m], by their waypoints; NaN without one."""
    usual = np.nan if rounding.tolerance is None else rounding.tolerance
    single = rounding.at or {}
    return np.array([single.get(k, usual) for k in numbers.tolist()], dtype=np.float64)


def _notes(planned: Preview) -> list[str]:
    """What a reader of the picture should know."""
    found = [*planned.differs]
    found += [x for x in (planned.stops_note, planned.shape_note) if x is not None]
    if planned.explanation is None:
        found.append(
            f"plans of the method {planned.trajectory.method} have no explanation: which limit "
            "binds is known for the method optimal."
        )
    return found


def _rapids(planned: Preview, view: View) -> dict[str, Any]:
    """Arrays of the ways of the tool between contours."""
    spans = [x.t for x in planned.trajectory.spans if x.kind == "rapid"]
    spans = spans[: MOST_POINTS // OF_RAPID]
    if not spans:
        return {}
    begin, end = np.array(spans).T
    t = np.linspace(begin, end, OF_RAPID, axis=1).ravel()
    duration = planned.trajectory.duration
    points = planned.job.arm.tool_position(planned.trajectory(np.minimum(t, duration)))
    return {
        "rapid": view.drawn(points),
        "rapid_xyz": short(in_space(points)),
        "rapid_t": short(t),
        "rapid_breaks": np.arange(0, len(points) + 1, OF_RAPID, dtype=np.uint32),
    }
