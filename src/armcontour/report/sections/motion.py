"""Section on the motion over time: tool speed, active limits and error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import LINES, number
from armcontour.jobs import JobResult, RunResult
from armcontour.planning.explanation import Binding
from armcontour.report.figure import Bar, Curve, Figure, Plot
from armcontour.report.plan_drawing import colour_of, kind_of, word_of
from armcontour.report.section import Section, text_table
from armcontour.report.sections.path_section import tools_of
from armcontour.report.style import DECADES, EXPERIMENT_DASH, LIMIT_DASH, run_colours, run_widths
from armcontour.report.time_table import time_table

# The error axis is logarithmic if one run's largest error exceeds another's by this factor.
VARIED = 10.0
# The line of the allowed error is drawn if the largest error is above this fraction of it.
WORTH_SHOWING = 0.3
# If the largest speed on contours is below this fraction of the largest speed (of a rapid), the
# speed axis is scaled to the contours.
SQUEEZED = 0.5
# Maximum number of bars per plan.
MAX_BARS = 1200
# Number of points in the assigned-velocity curve.
ASSIGNED_POINTS = 4000
# An axis of errors in mm begins at SMALLEST_ERROR if an error is larger than NOTABLE_ERROR [mm].
SMALLEST_ERROR = 1e-4
NOTABLE_ERROR = 3e-3
# Height of a plan's bars [px].
BARS = 28


def over_time(job_result: JobResult) -> Section:
    """Make the section with tool speed, active limits and contour error over time."""
    text = ""
    mouse = ""
    if _largest_shown(job_result) is not None:
        text += "Speeds of rapids are cut off at the top. "
        mouse = "Double-click the plot to show them."
    if any(x.experiment is not None for x in job_result.runs.values()):
        text += "Dotted curves are experiments: simulations with rigid bodies. "
    tables = [
        text_table(time_table(x.explanation), name * (len(job_result.runs) > 1))
        for name, x in _plans(job_result).items()
        if x.explanation is not None
    ]
    return Section(
        key="time",
        title="Over time",
        summary="tool speed and active limits" + ", contour error" * job_result.simulated,
        text=text,
        mouse=mouse,
        parts=(draw_over_time(job_result, plot_speed, plot_limits, plot_error), *tables),
    )


def draw_over_time(
    job_result: JobResult,
    *made: Callable[[JobResult], Plot | None],
    title: str = "Motion over time",
) -> Figure:
    """Draw plots over time; each function in `made` returns a job result's plot, or None."""
    plots = tuple(x for x in (make(job_result) for make in made) if x is not None)
    return Figure(title=title, plots=plots)


def plot_speed(job_result: JobResult) -> Plot:
    """Plot every run's executed or planned tool speed, and the assigned velocity."""
    colours = run_colours(job_result.runs)
    widths = run_widths(job_result.runs)
    curves = []
    for name, result in job_result.runs.items():
        t = result.motion.t
        y = result.motion.tool_speed * 1e3
        curves.append(Curve(x=t, y=y, name=name, colour=colours[name], width=widths[name]))
    largest = _largest_shown(job_result)
    visible = None if largest is None else (0.0, 1.2 * largest * 1e3)
    return Plot(label="speed [mm/s]", curves=(*curves, *_assigned(job_result)), limits=visible)


def plot_limits(job_result: JobResult) -> Plot | None:
    """Plot every plan's active limits as bars; None if no plan has an explanation."""
    plans = _plans(job_result)
    bars = list[Bar]()
    for row, plan in enumerate(plans.values()):
        if plan.explanation is not None:
            bars += list_bars(plan.explanation.bindings, row)
    if not bars:
        return None
    names = tuple(plans) if len(plans) > 1 else ()
    height = BARS * max(2, len(plans))
    return Plot(label="" if names else "limit", bars=tuple(bars), rows=names, height=height)


def list_bars(bindings: Sequence[Binding], row: int) -> list[Bar]:
    """List the bars of the active limits, in order; adjacent bars with the same limit are joined.

    Bars that are too short to be visible are joined; the longest one determines the limit.
    """
    bars = list[Bar]()
    shortest = bindings[-1].t[1] / MAX_BARS
    for x in bindings:
        kind = kind_of(x.limit)
        bar = Bar(*x.t, row, word_of(kind), x.name, colour_of(kind))
        last = bars[-1] if bars else None
        if last is None or (
            last[1:] != (bar.start, *bar[2:]) and last.end - last.start >= shortest
        ):
            bars.append(bar)
        else:
            longest = max(last, bar, key=lambda y: y.end - y.start)
            bars[-1] = longest._replace(start=last.start, end=bar.end)
    return bars


def plot_error(job_result: JobResult) -> Plot | None:
    """Plot every run's contour error; None without a simulation.

    The errors are shares of the allowed error if it is the same for all runs.
    """
    if not job_result.simulated:
        return None
    allowed = {x.verdict.allowed for x in job_result.runs.values() if x.evaluation is not None}
    limit = allowed.pop() if len(allowed) == 1 else None
    unit = limit / 100 if limit else 1e-3
    colours = run_colours(job_result.runs)
    curves = []
    for name, result, _, evaluation in tools_of(job_result):
        if evaluation is not None:
            e = evaluation.contour_error
            run = result.run.name
            dash = () if name == run else EXPERIMENT_DASH
            y = e.values / unit
            curves.append(Curve(x=e.t, y=y, name=name, colour=colours[run], dash=dash))
    largest = [float(np.nanmax(x.y)) for x in curves]
    label = f"error [% of {number(limit, 'm')}]" if limit else "contour error [mm]"
    plot = Plot(
        label=label,
        curves=tuple(curves),
        lines=(100.0,) if limit and max(largest) > 100 * WORTH_SHOWING else (),
        also=(1e3 * unit, "mm") if limit else None,
    )
    return scale_errors(plot, max(largest) > VARIED * min(largest))


def scale_errors(plot: Plot, logarithmic: bool = True) -> Plot:
    """Return a plot of errors with its axis from 0 or, if logarithmic, from above the noise."""
    largest = max(float(np.nanmax(x.y)) for x in plot.curves) or 1.0
    if not logarithmic:
        return replace(plot, limits=(0.0, 1.1 * largest))
    least = 10.0 ** np.floor(np.log10(largest / DECADES))
    if "[mm]" in plot.label and largest > NOTABLE_ERROR:
        least = max(least, SMALLEST_ERROR)
    raised = tuple(replace(x, y=np.maximum(x.y, least)) for x in plot.curves)
    return replace(plot, curves=raised, limits=(float(least), 1.3 * largest), logarithmic=True)


def _plans(job_result: JobResult) -> dict[str, RunResult]:
    """Return the first run of each explained plan, by the names of all runs with this plan."""
    names_of_plan: dict[int, list[str]] = {}
    for name, result in job_result.runs.items():
        if result.explanation is not None:
            names_of_plan.setdefault(id(result.trajectory), []).append(name)
    return {", ".join(names): job_result.runs[names[0]] for names in names_of_plan.values()}


def _largest_shown(job_result: JobResult) -> float | None:
    """Return the largest speed that the axis shows [m/s]; None if it shows all speeds.

    If contours are much slower than rapids, the axis is scaled to the contours.
    """
    fastest = max(float(x.motion.tool_speed.max()) for x in job_result.runs.values())
    on_contours = _largest_on_contours(job_result)
    return on_contours if on_contours < SQUEEZED * fastest else None


def _largest_on_contours(job_result: JobResult) -> float:
    """Return the largest planned tool speed on contours [m/s]; infinite if none has a path."""
    speeds = []
    for result in job_result.runs.values():
        for span in result.trajectory.contour_spans:
            motion = span.trajectory
            if motion is not None and motion.path is not None:
                speeds.append(motion.s(motion.breaks, 1).max())
    return float(max(speeds, default=np.inf))


def _assigned(job_result: JobResult) -> list[Curve]:
    """Return the curves of assigned velocities; runs with the same constant one share a curve."""
    curves: dict[str, Curve] = {}
    look: dict[str, Any] = {"colour": LINES["allowed"], "dash": LIMIT_DASH, "width": 1.0}
    for name, result in job_result.runs.items():
        t, value = _assigned_speeds(result)
        known = value[np.isfinite(value)]
        if not len(known):
            continue
        label = f"assigned velocity, {name}" if len(job_result.runs) > 1 else "assigned velocity"
        if np.ptp(known) == 0:
            label = f"assigned velocity {number(known[0], 'm/s')}"
        if label not in curves or t[-1] > curves[label].x[-1]:
            curves[label] = Curve(x=t, y=value * 1e3, name=label, **look)
    return list(curves.values())


def _assigned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray]:
    """Return times [s] and assigned velocities [m/s], (n,) each; NaN where none is assigned."""
    parts = [np.empty((0, 2))]
    count = len(result.path.contours)
    for contour, span in zip(result.path.contours, result.trajectory.contour_spans, strict=True):
        if span.trajectory is not None:
            times = np.linspace(*span.t, 2 + ASSIGNED_POINTS // count)
            s = span.trajectory.s(times - span.t[0])
            value = contour.path.assigned_speeds(result.run.limits.speed, s)
            parts += [np.column_stack([times, value]), np.array([[times[-1], np.nan]])]
    t, values = np.concatenate(parts).T
    return t, np.where(np.isfinite(values), values, np.nan)
