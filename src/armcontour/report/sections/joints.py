"""Section on joints: position, velocity and acceleration over time, and use of limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.result import Row, Table
from armcontour.jobs import JobResult, RunResult
from armcontour.report.figure import make_subplots
from armcontour.report.section import Section, TextTable, text_table
from armcontour.report.style import (
    EXECUTED_COLOUR,
    EXPERIMENT_COLOUR,
    LIMIT_COLOUR,
    PLANNED_COLOUR,
    SATURATION_COLOUR,
    finish,
    line,
    thin,
)
from armcontour.robot import Limits
from armcontour.robot.limit_use import Use, use_of

QUANTITIES = ("position [rad]", "velocity [rad/s]", "acceleration [rad/s²]")
# Height of the row of plots of a joint [px].
HEIGHT = 58
# Maximum number of points of a curve; it is small because a report has many such plots.
MAX_POINTS = 400
# Number of decimals of values in tables, so that numerical noise is shown as 0.
ROUNDED = 6
# Range of values, in the unit of the plot or as a share of the limit, below which a curve is noise.
AT_REST = 1e-4
# Relative difference of demand and acceleration above which a joint counts as saturated.
SATURATED = 1e-3
# Share of a limit above which the limit is drawn; a limit far away would flatten the curve.
WORTH_SHOWING = 0.3
# Percentile of the values of an experiment that determines the scale, so that spikes are ignored.
USUAL = 99.5


def joints(study: JobResult) -> Section:
    """Section with the joint motion of every run, with ranges and limits."""
    executed = ", executed and, with an experiment, simulated with rigid bodies"
    executed = executed if study.simulated else ""
    return Section(
        key="joints",
        title="Joints",
        summary="position, velocity and acceleration with their limits",
        text=(
            f"Planned{executed}. Black lines are limits; a limit of which less than "
            f"{WORTH_SHOWING:.0%} is used is listed only in the table. In shaded intervals, the "
            "joint is saturated: its acceleration differs from the demand of its servo by more "
            "than 0.1 %."
        ),
        choices=tuple((k, (draw_joints(k, x), _table(x))) for k, x in study.runs.items()),
    )


def draw_joints(name: str, result: RunResult) -> Any:
    """Figure with position, velocity and acceleration of every joint of a run."""
    names = result.arm.joint_names
    n = len(names)
    figure = make_subplots(
        rows=n, cols=3, column_titles=list(QUANTITIES), vertical_spacing=0.15 / n
    )
    bounds = _bounds(result, n)
    for order in range(3):
        curves = _curves(result, order)
        for j in range(n):
            place = {"row": j + 1, "col": order + 1}
            for label, (t, values, look) in curves.items():
                times, y = thin(t, values[:, j], count=MAX_POINTS)
                first = order == 0 and j == 0
                figure.add_trace(
                    line(times, y, label, showlegend=first, legendgroup=label, **look), **place
                )
            low, high = (float(x[j]) for x in bounds[order])
            visible = _range([(k, v[:, j]) for k, (_, v, _) in curves.items()], low, high, order)
            figure.update_yaxes(range=visible, nticks=4, **place)
            for value in (low, high):
                if visible[0] < value < visible[1]:
                    figure.add_hline(value, {"color": LIMIT_COLOUR, "width": 1}, **place)
    for j in range(n):
        motion = result.motion
        for span in find_saturation(motion.t, motion.demand[:, j], motion.ddq[:, j]):
            figure.add_vspan(span, SATURATION_COLOUR, row=j + 1, col=3)
        # The axis shows the joint number, because joint names are longer than the plot is high.
        title = {"text": f"joint {j + 1}", "font": {"size": 11}}
        figure.update_yaxes(title=title, row=j + 1, col=1)
    for column in range(3):
        figure.update_xaxes(title="time [s]", row=n, col=column + 1)
    finish(figure, title=f"Run {name}: joints", height=HEIGHT * n + 150)
    figure.update_layout(
        margin={"t": 50, "b": 90}, legend={"traceorder": "reversed"}, showlegend=True
    )
    return figure


def _curves(
    result: RunResult, order: int
) -> dict[str, tuple[FloatArray, FloatArray, dict[str, Any]]]:
    """Times, values and line options of the curves of a derivative (`order`), by name."""
    t = np.linspace(0, result.trajectory.duration, 4 * MAX_POINTS)
    curves: dict[str, tuple[FloatArray, FloatArray, dict[str, Any]]] = {}
    if result.experiment is not None:
        done = result.experiment.execution
        look = {"colour": EXPERIMENT_COLOUR, "width": 1.2}
        curves["experiment"] = (done.t, (done.q, done.dq, done.ddq)[order], look)
    if (moved := result.execution) is not None:
        curves["executed"] = (
            moved.t,
            (moved.q, moved.dq, moved.ddq)[order],
            {"colour": EXECUTED_COLOUR},
        )
    dotted = {"colour": PLANNED_COLOUR, "width": 1.5, "dash": "dot"}
    curves["planned"] = (t, result.trajectory(t, order), dotted)
    return curves


def _bounds(result: RunResult, dof: int) -> list[tuple[FloatArray, FloatArray]]:
    """Lower and upper bounds of position, velocity and acceleration, (dof,) each."""
    limits = result.run.limits
    return [limits.joint_range(dof), limits.velocity_bounds(dof), limits.acceleration_bounds(dof)]


def _range(
    curves: list[tuple[str, FloatArray]], low: float, high: float, order: int
) -> list[float]:
    """Axis range that shows the curves, except spikes of an experiment, and nearby limits."""
    ends: list[float] = []
    for name, values in curves:
        if name == "experiment":
            ends += np.percentile(values, [100 - USUAL, USUAL]).tolist()
        else:
            ends += [float(values.min()), float(values.max())]
    bottom, top = min(ends), max(ends)
    # The range has a minimum size, so that the noise of a joint at rest is not enlarged.
    noise = max(AT_REST, AT_REST * high) if np.isfinite(high) else AT_REST
    edge = 0.12 * (top - bottom) if top - bottom > noise else 0.01
    bottom, top = bottom - edge, top + edge
    size = max(abs(bottom), abs(top))
    if order > 0 and np.isfinite(high) and size > WORTH_SHOWING * min(high, -low):
        bottom, top = min(bottom, 1.15 * low), max(top, 1.15 * high)
    return [bottom, top]


def find_saturation(
    t: Any, commanded_acceleration: Any, acceleration: Any
) -> list[tuple[float, float]]:
    """Intervals [s] in which a joint does not reach its demand; close intervals are joined."""
    over = np.abs(commanded_acceleration - acceleration) > SATURATED * np.abs(acceleration)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], over.astype(int), [0]])))
    joined: list[tuple[float, float]] = []
    for i, k in zip(edges[::2], edges[1::2] - 1, strict=True):
        start, end = float(t[i]), float(t[k])
        if joined and start - joined[-1][1] < 2e-3 * t[-1]:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((start, end))
    return joined


def _table(result: RunResult) -> TextTable:
    """Table with range and largest values of every joint, and the used shares of its limits."""
    done, arm, limits = result.motion, result.arm, result.run.limits
    plan = result.torques
    amounts = [
        ("velocity", "rad/s", _worst("joint_velocity", limits, done.dq)),
        ("acceleration", "rad/s^2", _worst("joint_acceleration", limits, done.ddq)),
    ]
    if limits.joint_jerk is not None and result.evaluation is not None:
        amounts.append(("jerk", "rad/s^3", use_of("joint_jerk", limits, result.evaluation.jerk)))
    if plan is not None:
        amounts.append(("planned torque", "N m", use_of("joint_torque", limits, plan.peak)))
    columns = [Row("joint", None, "", "joint")]
    ends = (*limits.joint_range(arm.dof), done.q.min(axis=0), done.q.max(axis=0))
    values: list[Sequence[Any]] = [arm.joint_names]
    for label, values_of_joints in zip(("lower end", "upper end", "from", "to"), ends, strict=True):
        columns.append(Row(label, None, "rad", label))
        values.append(np.where(np.isfinite(values_of_joints), values_of_joints, np.nan).tolist())
    for label, unit, use in amounts:
        columns.append(Row(label, None, unit, label))
        values.append(np.round(use.value, ROUNDED).tolist())
        if (limited := np.isfinite(use.limit)).any():
            columns.append(Row(f"{label}.use", None, "1", f"of {label} limit"))
            values.append(np.where(limited, use.ratio, np.nan).tolist())
    rows = list(zip(*values, strict=True))
    return text_table(Table("joints", tuple(columns), rows), "Largest amounts")


def _worst(name: str, limits: Limits, values: FloatArray) -> Use:
    """Largest use of a limit by each joint; for a joint without the limit, the largest value."""
    use = use_of(name, limits, values)
    rows = np.where(np.isinf(use.limit), use.value, use.ratio).argmax(axis=0)
    return use_of(name, limits, values[rows, np.arange(values.shape[1])])
