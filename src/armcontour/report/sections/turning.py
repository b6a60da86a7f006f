"""Figures of angular speed and orientation error of the tool of an arm in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.jobs import Study
from armcontour.jobs.quantities import angular_speed
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


def angular_speeds(study: Study) -> list[Any]:
    """Figure of the executed angular speed of the tool; empty for a planar arm."""
    import plotly.graph_objects as go

    figure = go.Figure()
    colours, widths = run_colours(study.runs), run_widths(study.runs)
    limits: dict[float, float] = {}
    for name, result in study.runs.items():
        speed = angular_speed(result.execution)
        if speed is None:
            return []
        t, values = thin(result.execution.t, np.degrees(speed))
        figure.add_trace(line(t, values, name, colours[name], width=widths[name]))
        if result.run.limits.angular_speed is not None:
            longest = limits.get(result.run.limits.angular_speed, 0.0)
            limits[result.run.limits.angular_speed] = max(longest, result.trajectory.duration)
    for value, time in sorted(limits.items()):
        limit = np.degrees([value, value])
        label = f"limit {limit[0]:g} deg/s"
        figure.add_trace(line([0, time], limit, label, LIMIT_COLOUR, dash="dash", width=1))
    figure.update_xaxes(title="time [s]")
    # So that a tool of constant orientation does not show numerical noise.
    top = max(SLOWEST_TURN, *(1.05 * float(np.max(x.y)) for x in figure.data))
    figure.update_yaxes(title="angular speed [deg/s]", range=[0, top])
    return [finish(figure, title="Angular speed of the tool over time", height=400)]


def orientation_errors(study: Study) -> list[Any]:
    """Figure of the angle between the tool and its required orientation; empty without one."""
    import plotly.graph_objects as go

    figure = go.Figure()
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
    figure.update_yaxes(title="orientation error [deg]", rangemode="tozero")
    return [finish(figure, title="Orientation error over time", height=420)]
