"""Sections on motion over time: tool speed, joint accelerations, contour error, time stamps."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.core import result as core
from armcontour.core.render import figure as figure_of
from armcontour.core.render import number
from armcontour.core.result import Row
from armcontour.evaluation import ErrorProfile
from armcontour.geometry import Path
from armcontour.jobs import RunResult, Study
from armcontour.jobs.results import unknown_notes
from armcontour.motion import Trajectory
from armcontour.report.figure import Figure, make_subplots
from armcontour.report.section import Section, Table, marked_run, table_of
from armcontour.report.sections.paths import done
from armcontour.report.style import (
    EXECUTED_COLOUR,
    EXPERIMENT_DASH,
    LIMIT_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
    run_colours,
    run_widths,
    shade,
    switching_labels,
    thin,
)

# Smallest error on the logarithmic axis [mm].
SMALLEST_ERROR = 1e-6
# Relative difference of demand and acceleration above which a joint is shown as saturated.
SATURATED = 1e-3
# Number of samples of planned accelerations.
MOST_TIMES = 20_000
# If contours are slower than this share of the fastest rapid, the axis shows the contours.
SQUEEZED = 0.5
# A path, its motion, the start of the motion [s], and the length of all paths before it [m].
Followed = tuple[Path, Trajectory, float, float]
GAP = np.array([np.nan])


def tool_speed(study: Study) -> Section:
    """Executed or planned tool speed of every run, with the assigned velocity."""
    figure = Figure()
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    for name, result in study.runs.items():
        x = result.motion
        t, speed = thin(x.t, x.tool_speed * 1e3)
        figure.add_trace(line(t, speed, name, colours[name], width=widths[name]))
    for trace in _assigned(study):
        figure.add_trace(trace)
    marked, text = marked_run(study), f"As {done(study)}."
    if any(x.kind != "contour" for y in study.runs.values() for x in y.trajectory.spans):
        text += (
            " Assigned velocities apply along contours; between contours rapids run at the limits "
            "of the joints."
        )
    if marked is not None:
        switching_labels(figure, marked.trajectory.switching_points)
        text += f" Dotted lines are the switching points of the run {marked.run.name}."
    figure.update_xaxes(title="time [s]")
    figure.update_yaxes(title="tool speed [mm/s]")
    most = _largest_on_contours(study)
    if most < SQUEEZED * max(float(x.motion.tool_speed.max()) for x in study.runs.values()):
        figure.update_yaxes(range=[0, 1.2 * most * 1e3])
        text += " Rapids are cut off at the top; a double click shows all of them."
    return Section(
        key="speed",
        title="Tool speed",
        text=text,
        figures=(finish(figure, title="Tool speed over time"),),
    )


def _largest_on_contours(study: Study) -> float:
    """The largest executed tool speed along contours [m/s]."""
    largest = 0.0
    for result in study.runs.values():
        x = result.motion
        on = np.zeros(len(x.t), dtype=bool)
        for span in result.trajectory.spans:
            if span.kind == "contour":
                on |= (x.t >= span.t[0]) & (x.t <= span.t[1])
        if not result.trajectory.spans:
            on[:] = True
        largest = max(largest, float(x.tool_speed[on].max()))
    return largest


def _assigned(study: Study) -> list[Any]:
    """Curves of assigned velocities over time; runs with the same constant velocity share one."""
    steps: dict[str, tuple[FloatArray, FloatArray]] = {}
    for name, result in study.runs.items():
        assigned = assigned_speeds(result)
        if assigned is None:
            continue
        label = f"assigned velocity, {name}" if len(study.runs) > 1 else "assigned velocity"
        # After the last contour there is a gap.
        t, value = assigned[0][:-1], assigned[2][:-1] * 1e3
        if np.ptp(value) == 0:
            label = f"assigned velocity {number(assigned[2][0], 'm/s')}"
        if label not in steps or t[-1] > steps[label][0][-1]:
            steps[label] = t, value
    found = []
    for label, both in steps.items():
        t, value = thin(*both)
        found.append(line(t, value, label, LIMIT_COLOUR, dash="dash", width=1))
    return found


def planned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray]:
    """Arc length over all contours [m] and planned tool speed [m/s], with gaps (NaN) between."""
    s, speed = [], []
    for _, motion, _, offset in _list_followed(result):
        t = motion.breaks
        s += [offset + motion.s(t), GAP]
        speed += [motion.s(t, 1), GAP]
    return np.concatenate(s)[:-1], np.concatenate(speed)[:-1]


def assigned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Times, arc lengths and assigned velocity as a step curve; None if no velocity is assigned."""
    most = np.inf if result.run.limits.speed is None else result.run.limits.speed
    found = []
    for path, motion, start, offset in _list_followed(result):
        times, places = start + motion.breaks, motion.s(motion.breaks)
        middle = (places[:-1] + places[1:]) / 2
        value = np.fmin(path.speeds[path.locate(middle)], most)
        value[~np.isfinite(value)] = np.nan
        # Only changes are drawn: a contour may have 100,000 segments of one speed.
        same = np.isclose(value[1:], value[:-1], rtol=1e-12, equal_nan=True)
        edges = np.concatenate([[0], np.flatnonzero(~same) + 1, [len(value)]])
        steps = np.repeat(edges, 2)[1:-1]
        found.append((times[steps], offset + places[steps], value[edges[:-1]]))
    if not any(np.isfinite(x[2]).any() for x in found):
        return None
    t, s = (np.concatenate([y for x in found for y in (x[i], GAP)]) for i in (0, 1))
    return t, s, np.concatenate([y for x in found for y in (np.repeat(x[2], 2), GAP)])


def _list_followed(result: RunResult) -> list[Followed]:
    """All contours with a planned motion, in order."""
    spans = result.trajectory.contour_spans
    return [
        (x.path, span.trajectory, span.t[0], span.s[0])
        for x, span in zip(result.path.contours, spans, strict=True)
        if span.trajectory is not None
    ]


def accelerations(study: Study) -> Section | None:
    """Joint accelerations of every run of an arm in the plane, with limits and saturation."""
    if study.job.program.dimension != 2:
        return None
    return Section(
        key="accelerations",
        title="Joint accelerations",
        text=(
            "Acceleration of every joint, with its limits as black lines. Shaded: the joint is "
            "saturated, so that its acceleration differs from the demand of its servo by more than "
            "a thousandth."
        ),
        figures=tuple(_accelerations(name, result) for name, result in study.runs.items()),
    )


def contour_error(study: Study) -> Section | None:
    """Contour error profile of every run; None if nothing was simulated."""
    if not study.simulated:
        return None
    figure = Figure()
    colours = run_colours(study.runs)
    for name, result in study.runs.items():
        if result.evaluation is None:
            continue
        e = result.evaluation.contour_error
        t, values = thin(e.t, e.values * 1e3)
        label = f"{name}: {_extremes(e)}"
        figure.add_trace(line(t, np.maximum(values, SMALLEST_ERROR), label, colours[name]))
        if result.experiment is not None:
            e = result.experiment.evaluation.contour_error
            t, values = thin(e.t, e.values * 1e3)
            label = f"{name}, experiment: {_extremes(e)}"
            look = {"dash": EXPERIMENT_DASH, "width": 1.5}
            values = np.maximum(values, SMALLEST_ERROR)
            figure.add_trace(line(t, values, label, colours[name], **look))
    figure.update_xaxes(title="time [s]")
    figure.update_yaxes(title="contour error [mm]", type="log")
    text = "Distance from the executed tool to the path of its run, on a logarithmic scale."
    notes: tuple[str, ...] = ()
    if any(x.experiment is not None for x in study.runs.values()):
        text += (
            " Dotted: the experiment, the same set-points on the arm's rigid bodies, with default "
            "drive gains."
        )
        notes = unknown_notes(study)
    return Section(
        key="contour-error",
        title="Contour error",
        text=text,
        figures=(finish(figure, title="Contour error over time", height=500),),
        notes=notes,
    )


def _extremes(error: ErrorProfile) -> str:
    """RMS and largest value of an error, for a legend."""
    data = error.to_data()
    return f"RMS {figure_of(data['rms'])}, largest {figure_of(data['max'])}"


def time_stamps(study: Study) -> Section | None:
    """Switching points with time, position, rule and joint demand."""
    if not any(x.trajectory.stretches for x in study.runs.values()):
        return None
    return Section(
        key="time-stamps",
        title="Switching points",
        text=(
            "Where one rule hands over to the next: MAC, maximum joint acceleration; AVC, assigned "
            "velocity; MDC, maximum deceleration; corner, one speed on an arc."
        ),
        tables=tuple(_stamps(name, x) for name, x in study.runs.items() if x.trajectory.stretches),
    )


def _accelerations(name: str, result: RunResult) -> Any:
    """Figure of planned and executed joint accelerations of a run."""
    x = result.motion
    names = x.arm.joint_names
    bounds = np.stack(result.run.limits.acceleration_bounds(len(names)))
    figure = make_subplots(rows=len(names), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    # Finely sampled, so that `thin` finds and keeps the peaks.
    every = np.linspace(0, result.trajectory.duration, MOST_TIMES)
    planned = result.trajectory(every, 2)
    for j, joint in enumerate(names):
        row = {"row": j + 1, "col": 1}
        t, ddq = thin(x.t, x.ddq[:, j])
        t_plan, ddq_plan = thin(every, planned[:, j])
        dotted: dict[str, Any] = {"dash": "dot", "width": 1.5}
        for curve, label, colour, look in (
            ((t, ddq), "executed", EXECUTED_COLOUR, {}),
            ((t_plan, ddq_plan), "planned", PLANNED_COLOUR, dotted),
        )[result.execution is None :]:
            look = {**look, "showlegend": j == 0, "legendgroup": label}
            figure.add_trace(line(curve[0], curve[1], label, colour, **look), **row)
        shade(figure, find_saturation(x.t, x.demand[:, j], x.ddq[:, j]), j + 1)
        for bound in bounds[np.isfinite(bounds[:, j]), j].tolist():
            figure.add_hline(y=bound, line={"color": LIMIT_COLOUR, "width": 1}, **row)
        figure.update_yaxes(title=f"{joint} [rad/s²]", **row)
    if len(result.trajectory.stretches) > 1:
        switching_labels(figure, result.trajectory.switching_points)
    figure.update_xaxes(title="time [s]", row=len(names), col=1)
    return finish(figure, title=f"Run {name}", height=230 * len(names) + 120)


def find_saturation(t: Any, demand: Any, given: Any) -> list[tuple[float, float]]:
    """Intervals of time in which a joint does not reach its demand; close intervals are joined."""
    over = np.abs(demand - given) > SATURATED * np.abs(given)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], over.astype(int), [0]])))
    joined: list[tuple[float, float]] = []
    for i, k in zip(edges[::2], edges[1::2] - 1, strict=True):
        start, end = float(t[i]), float(t[k])
        if joined and start - joined[-1][1] < 2e-3 * t[-1]:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((start, end))
    return joined


def _stamps(name: str, result: RunResult) -> Table:
    """Table of the switching points of a run."""
    stretches, joints = result.trajectory.stretches, result.arm.joint_names
    columns = (
        Row("point", None, "", "point"),
        Row("t", None, "s", "time"),
        Row("s", None, "m", "s"),
        Row("then", None, "", "then"),
        *(Row(f"demand.{x}", None, "rad/s^2", f"{x} demand") for x in joints),
    )
    rows: list[tuple[Any, ...]] = [
        (
            *(f"P{k}", x.t[0], x.s[0]),
            x.name if x.name.startswith(x.kind) else f"{x.name}: {x.kind}",
            *x.demand,
        )
        for k, x in enumerate(stretches)
    ]
    last = stretches[-1]
    rows.append((f"P{len(rows)}", last.t[1], last.s[1], "end", *[None] * len(joints)))
    return table_of(core.Table("switching points", columns, rows), f"Run {name}")
