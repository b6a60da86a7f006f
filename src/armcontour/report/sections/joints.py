"""The section on joints of an arm in space: use of limits; position, velocity, acceleration."""

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
# Height of the three plots of a joint [px].
HEIGHT = 58
# Points of a curve; a report has many such small figures.
MAX_POINTS = 400
# Digits after the decimal point of values in tables, so that numerical noise is 0.
ROUNDED = 6
# Range of motion [rad], or share of a limit, below which a joint is at rest.
AT_REST = 1e-4
# Relative difference of demand and acceleration above which a joint is shown as saturated.
SATURATED = 1e-3
# Use of a limit from which it is drawn; otherwise it would flatten the curve.
WORTH_SHOWING = 0.3
# Percentile of an experiment's values that sets the scale, so that spikes do not.
USUAL = 99.5


def joints(study: JobResult) -> Section:
    """Joint motion of every run, with ranges and limits."""
    executed = ", executed and, with an experiment, on the arm's rigid bodies"
    executed = executed if study.simulated else ""
    return Section(
        key="joints",
        title="Joints",
        summary="position, velocity and acceleration with their limits",
        text=(
            f"Planned{executed}. Black lines are limits; a limit of which less than a third is "
            "used is in the table only. Shaded: the joint is saturated, so that its acceleration "
            "differs from the demand of its servo by more than a thousandth."
        ),
        choices=tuple((k, (draw_joints(k, x), _table(x))) for k, x in study.runs.items()),
    )


def draw_joints(name: str, result: RunResult) -> Any:
    """Figure of position, velocity and acceleration of every joint of a run."""
    names = result.arm.joint_names
    n = len(names)
    figure = make_subplots(
        rows=n, cols=3, shared_xaxes=True, column_titles=list(QUANTITIES), vertical_spacing=0.15 / n
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
        # Names are in the table, because they are longer than the height of a plot.
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
    """Times, values and line options of one quantity, by the names of the curves."""
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
    """Lower and upper bound of every joint's position, velocity and acceleration."""
    limits = result.run.limits
    return [limits.joint_range(dof), limits.velocity_bounds(dof), limits.acceleration_bounds(dof)]


def _range(
    curves: list[tuple[str, FloatArray]], low: float, high: float, order: int
) -> list[float]:
    """Range of an axis: curves without the spikes of an experiment, and limits nearby."""
    ends: list[float] = []
    for name, values in curves:
        if name == "experiment":
            ends += np.percentile(values, [100 - USUAL, USUAL]).tolist()
        else:
            ends += [float(values.min()), float(values.max())]
    bottom, top = min(ends), max(ends)
    # The noise of a joint at rest is not enlarged.
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
    """Times in which a joint does not reach its commanded acceleration; close ones are joined."""
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
    """Used range and largest values of every joint, and their limits."""
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
    """The largest use of a limit by each joint, or the largest value without a limit."""
    use = use_of(name, limits, values)
    rows = np.where(np.isinf(use.limit), use.value, use.ratio).argmax(axis=0)
    return use_of(name, limits, values[rows, np.arange(values.shape[1])])
