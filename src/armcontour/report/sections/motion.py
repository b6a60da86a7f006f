"""Section on the motion over time: tool speed, active limits and error."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import LIMITS, number
from armcontour.jobs import JobResult, RunResult
from armcontour.jobs.rows import allowed_error
from armcontour.planning.explanation import Binding
from armcontour.report.figure import make_subplots, make_trace
from armcontour.report.plan_drawing import kind_of, word_of
from armcontour.report.section import Section, text_table
from armcontour.report.style import (
    EXPERIMENT_DASH,
    LIMIT_COLOUR,
    finish,
    line,
    run_colours,
    run_widths,
    thin,
)

# Minimum error on the logarithmic axis [mm]; smaller errors are drawn at this value.
SMALLEST_ERROR = 1e-6
# If the largest speed on contours is below this share of the largest speed (of a rapid), the speed
# axis is scaled to the contours.
SQUEEZED = 0.5
# Maximum number of bars of a plan.
MAX_BARS = 1200
# Number of points of the curve of assigned velocities.
ASSIGNED_POINTS = 4000
# Height of a plot, of the bars of a plan, and of the other parts of a figure [px].
HEIGHT, BARS, OTHER_HEIGHT = 150, 28, 125
# Start and end of a part of a plan [s], and kind and name of its active limit.
Bar = tuple[float, float, str, str]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """One plot of a figure over time."""

    traces: list[Any]
    # Options of the vertical axis
    axis: dict[str, Any]
    # Height [px]
    height: int = HEIGHT


def over_time(study: JobResult) -> Section:
    """Section with tool speed, active limits and contour error over time."""
    text = ""
    if _is_squeezed(study):
        text += "Speeds of rapids are cut off at the top; double-click the plot to show them. "
    if any(x.experiment is not None for x in study.runs.values()):
        text += "Dotted curves are experiments: simulations with rigid bodies. "
    tables = [
        text_table(x.explanation.time_table, name * (len(study.runs) > 1))
        for name, x in _plans(study).items()
        if x.explanation is not None
    ]
    return Section(
        key="time",
        title="Over time",
        summary="tool speed and active limits" + ", contour error" * study.simulated,
        text=text,
        parts=(draw_over_time(study, speed, limits, error), *tables),
    )


def draw_over_time(study: JobResult, *made: Any) -> Any:
    """Figure with plots over time; each function of `made` returns a panel of a study, or None."""
    panels = [x for x in (make(study) for make in made) if x is not None]
    height = sum(x.height for x in panels)
    figure = make_subplots(
        rows=len(panels),
        cols=1,
        row_heights=[x.height for x in panels],
        vertical_spacing=15 / (height + 15 * len(panels)),
    )
    shown: set[str] = set()
    for row, panel in enumerate(panels, start=1):
        for trace in panel.traces:
            # All bars of a kind of limit and all curves of a name share one entry of the legend.
            group = trace.legendgroup or trace.name
            trace.merge({"legendgroup": group, "showlegend": trace.name not in shown})
            shown.add(trace.name)
            figure.add_trace(trace, row, 1)
        figure.update_yaxes(row, 1, **panel.axis)
    figure.update_layout(barmode="overlay", bargap=0.1)
    figure.update_xaxes(len(panels), 1, title="time [s]")
    return finish(figure, title="Motion over time", height=height + OTHER_HEIGHT)


def speed(study: JobResult) -> Panel:
    """Panel with the executed or planned tool speed of every run and the assigned velocity."""
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    traces = []
    for name, result in study.runs.items():
        motion = result.motion
        t, values = thin(motion.t, motion.tool_speed * 1e3)
        traces.append(line(t, values, name, colours[name], width=widths[name]))
    axis: dict[str, Any] = {"title": "speed [mm/s]"}
    if _is_squeezed(study):
        axis["range"] = [0, 1.2 * _largest_on_contours(study) * 1e3]
    return Panel(traces=[*traces, *_assigned(study)], axis=axis)


def limits(study: JobResult) -> Panel | None:
    """Panel with bars of the active limits of every plan; None if no plan has an explanation."""
    bars: defaultdict[str, list[tuple[Bar, str]]] = defaultdict(list)
    plans = _plans(study)
    for name, result in plans.items():
        for bar in list_bars([] if result.explanation is None else result.explanation.bindings):
            bars[bar[2]].append((bar, name if len(plans) > 1 else ""))
    if not bars:
        return None
    traces = [_bars(kind, found) for kind, found in bars.items()]
    axis = {"title": "" if len(plans) > 1 else "limit", "showticklabels": len(plans) > 1}
    return Panel(traces=traces, axis=axis, height=BARS * max(2, len(plans)))


def _bars(kind: str, bars: list[tuple[Bar, str]]) -> Any:
    """Trace with the intervals in which limits of one kind are active."""
    return make_trace(
        "bar",
        name=word_of(kind),
        orientation="h",
        y=[y for _, y in bars],
        base=[x[0] for x, _ in bars],
        x=[x[1] - x[0] for x, _ in bars],
        # Bars have no edges, because edges would cover thin bars.
        marker={"color": LIMITS.get(kind, LIMITS["other"])["light"], "line": {"width": 0}},
        customdata=[[x[0], x[1], x[3]] for x, _ in bars],
        hovertemplate=(
            "%{customdata[2]}<br>t %{customdata[0]:.3f} to %{customdata[1]:.3f} s<extra></extra>"
        ),
    )


def list_bars(bindings: Sequence[Binding]) -> list[Bar]:
    """Time intervals with their active limits, in order; adjacent intervals of a limit are joined.

    If there are more than MAX_BARS intervals, the motion is divided into equal parts, and each part
    has the limit of its longest interval.
    """
    bars = [(*x.t, kind_of(x.limit), x.name) for x in bindings]
    ends = np.array([x[:2] for x in bars])
    if len(bars) > MAX_BARS:
        cell = np.floor(ends.mean(axis=1) / ends[-1, 1] * MAX_BARS).astype(int)
        order = np.lexsort((ends[:, 0] - ends[:, 1], cell))
        chosen = order[np.flatnonzero(np.diff(cell[order], prepend=-1))]
        bars = [bars[k] for k in chosen.tolist()]
        # The bars are extended, so that each bar ends where the next bar starts.
        starts = [*ends[chosen, 0], ends[-1, 1]]
        starts[0] = ends[0, 0]
        bars = [(a, b, *x[2:]) for x, a, b in zip(bars, starts, starts[1:], strict=False)]
    joined: list[Bar] = []
    for bar in bars:
        if joined and joined[-1][2:] == bar[2:] and joined[-1][1] == bar[0]:
            joined[-1] = (joined[-1][0], *bar[1:])
        else:
            joined.append(bar)
    return joined


def error(study: JobResult) -> Panel | None:
    """Panel with the contour error of every run and its tolerance; None without a simulation."""
    if not study.simulated:
        return None
    colours, traces, allowed = run_colours(study.runs), [], set()
    for name, result in study.runs.items():
        judged = [(name, result.evaluation, {"legendgroup": name})]
        if result.experiment is not None:
            look: dict[str, Any] = {"dash": EXPERIMENT_DASH, "width": 1.5}
            judged.append((f"{name}, experiment", result.experiment.evaluation, look))
        for label, evaluation, look in judged:
            if evaluation is None:
                continue
            e = evaluation.contour_error
            t, values = thin(e.t, e.values * 1e3)
            values = np.maximum(values, SMALLEST_ERROR)
            traces.append(line(t, values, label, colours[name], **look))
        limit = allowed_error(result)
        if limit is not None and result.evaluation is not None:
            allowed.add((limit, result.trajectory.duration))
    for value, end in allowed:
        name, dashed = f"allowed {number(value, 'm')}", {"dash": "dash", "width": 1}
        traces.append(line([0, end], [1e3 * value] * 2, name, LIMIT_COLOUR, **dashed))
    return Panel(traces=traces, axis={"title": "contour error [mm]", "type": "log"})


def _plans(study: JobResult) -> dict[str, RunResult]:
    """First run of each explained plan; the keys list the names of all runs with the same plan."""
    names_of_plan: dict[int, list[str]] = {}
    for name, result in study.runs.items():
        if result.explanation is not None:
            names_of_plan.setdefault(id(result.trajectory), []).append(name)
    return {", ".join(names): study.runs[names[0]] for names in names_of_plan.values()}


def _is_squeezed(study: JobResult) -> bool:
    """True if contours are much slower than rapids, so that the axis is scaled to contours."""
    fastest = max(float(x.motion.tool_speed.max()) for x in study.runs.values())
    return _largest_on_contours(study) < SQUEEZED * fastest


def _largest_on_contours(study: JobResult) -> float:
    """Largest planned tool speed along contours [m/s]; infinite if no contour has a path."""
    motions = [y.trajectory for x in study.runs.values() for y in x.trajectory.contour_spans]
    speeds = [x.s(x.breaks, 1).max() for x in motions if x is not None and x.path is not None]
    return float(max(speeds, default=np.inf))


def _assigned(study: JobResult) -> Iterator[Any]:
    """Yield curves of assigned velocities; runs with the same constant velocity share a curve."""
    steps: dict[str, tuple[FloatArray, FloatArray]] = {}
    for name, result in study.runs.items():
        t, value = _assigned_speeds(result)
        known = value[np.isfinite(value)]
        if not len(known):
            continue
        label = f"assigned velocity, {name}" if len(study.runs) > 1 else "assigned velocity"
        if np.ptp(known) == 0:
            label = f"assigned velocity {number(known[0], 'm/s')}"
        if label not in steps or t[-2] > steps[label][0][-2]:
            steps[label] = t, value * 1e3
    for label, both in steps.items():
        t, value = thin(*both)
        yield line(t, value, label, LIMIT_COLOUR, dash="dash", width=1)


def _assigned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray]:
    """Times [s] and assigned velocities [m/s], (n,) each; NaN between contours or if unassigned."""
    parts, count = [np.empty((0, 2))], len(result.path.contours)
    for contour, span in zip(result.path.contours, result.trajectory.contour_spans, strict=True):
        if span.trajectory is not None:
            times = np.linspace(*span.t, 2 + ASSIGNED_POINTS // count)
            s = span.trajectory.s(times - span.t[0])
            value = contour.path.assigned_speeds(result.run.limits.speed, s)
            parts += [np.column_stack([times, value]), np.full((1, 2), np.nan)]
    t, values = np.concatenate(parts).T
    return t, np.where(np.isfinite(values), values, np.nan)
