"""Figures of angular speed and orientation error of the tool of an arm in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.jobs import Study
from armcontour.jobs.quantities import angular_speed
from armcontour.motion import Trajectory
from armcontour.report.figure import Figure
from armcontour.report.sections.rapids import shade_rapids
from armcontour.report.style import (
    EXPERIMENT_DASH,
    LIMIT_COLOUR,
    finish,
    line,
    run_colours,
    run_widths,
    thin,
)

# Smallest range of the axis of angular speeds [deg/s].
SLOWEST_TURN = 1.0
# Smallest range of the axis of orientation errors [deg]: less is numerical noise.
LEAST_ERROR = 1e-3


def angular_speeds(study: Study) -> list[Any]:
    """Figure of the executed angular speed of the tool; empty for a planar arm."""
    figure = Figure()
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    limits: dict[float, Trajectory] = {}
    for name, result in study.runs.items():
        speed = angular_speed(result.execution)
        if speed is None:
            return []
        t, values = thin(result.execution.t, np.degrees(speed))
        figure.add_trace(line(t, values, name, colours[name], width=widths[name]))
        limit, plan = result.run.limits.angular_speed, result.trajectory
        if limit is not None and (limit not in limits or limits[limit].duration < plan.duration):
            limits[limit] = plan
    for value, plan in sorted(limits.items()):
        times = _contour_times(plan)
        label = f"limit {np.degrees(value):g} deg/s"
        level = np.where(np.isnan(times), np.nan, np.degrees(value))
        figure.add_trace(line(times, level, label, LIMIT_COLOUR, dash="dash", width=1))
    shade_rapids(figure, study)
    figure.update_xaxes(title="time [s]")
    # So that a tool of constant orientation does not show numerical noise.
    top = max(SLOWEST_TURN, *(1.05 * float(np.nanmax(x.y)) for x in figure.data))
    figure.update_yaxes(title="angular speed [deg/s]", range=[0, top])
    return [finish(figure, title="Angular speed of the tool over time", height=400)]


def _contour_times(plan: Trajectory) -> FloatArray:
    """Start and end of every contour [s], with gaps (NaN) between them."""
    spans = [x.t for x in plan.spans if x.kind == "contour"] or [(0.0, plan.duration)]
    return np.array([y for start, end in spans for y in (start, end, np.nan)])


def orientation_errors(study: Study) -> list[Any]:
    """Figure of the angle between the tool and its required orientation; empty without one."""
    figure = Figure()
    colours = run_colours(study.runs)
    for name, result in study.runs.items():
        done = [(name, result.evaluation, "solid")]
        if result.experiment is not None:
            done.append((f"{name}, experiment", result.experiment.evaluation, EXPERIMENT_DASH))
        for label, evaluation, dash in done:
            e = evaluation.orientation_error
            if e is None:
                continue
            t, values = thin(e.t, np.degrees(e.values))
            label += f": largest {np.degrees(e.max):.4f} deg"
            figure.add_trace(line(t, values, label, colours[name], dash=dash))
    if not figure.data:
        return []
    figure.update_xaxes(title="time [s]")
    top = max(LEAST_ERROR, *(1.05 * float(np.nanmax(x.y)) for x in figure.data))
    figure.update_yaxes(title="orientation error [deg]", range=[0, top])
    return [finish(figure, title="Orientation error over time", height=420)]
