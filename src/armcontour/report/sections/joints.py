"""Section on joints: position, velocity and acceleration over time, and use of limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import LINES
from armcontour.core.result import Row, Table
from armcontour.jobs import JobResult, RunResult
from armcontour.report.figure import Curve, Figure, Plot
from armcontour.report.section import Section, TextTable, text_table
from armcontour.robot import Limits
from armcontour.robot.limit_use import Use, use_of

QUANTITIES = ("position [rad]", "velocity [rad/s]", "acceleration [rad/s²]")
# Height of a joint's row of plots [px].
HEIGHT = 58
# Maximum number of points per curve; it is small because a report has many such plots.
MAX_POINTS = 320
# Number of decimals in tables, so that numerical noise is shown as 0.
ROUNDED = 6
# Fraction of a limit above which the limit is drawn; a limit far away would flatten the curve.
WORTH_SHOWING = 0.3
# Percentile of the values that determines the scale, so that spikes are ignored.
USUAL = 99.8


def joints(job_result: JobResult) -> Section:
    """Make the section with the joint motion of every run, with ranges and limits."""
    executed = ", executed and, with an experiment, simulated with rigid bodies"
    executed = executed if job_result.simulated else ""
    return Section(
        key="joints",
        title="Joints",
        summary="position, velocity and acceleration with their limits",
        text=(
            f"Planned{executed}. Black lines are limits; a limit of which less than "
            f"{WORTH_SHOWING:.0%} is used is listed only in the table."
        ),
        choices=tuple((k, (draw_joints(k, x), _table(x))) for k, x in job_result.runs.items()),
    )


def draw_joints(name: str, result: RunResult) -> Figure:
    """Draw position, velocity and acceleration of every joint in one run."""
    limits = result.run.limits
    n = result.arm.dof
    plots = []
    bounds = limits.joint_range(n), limits.velocity_bounds(n), limits.acceleration_bounds(n)
    motions = list(_motions(result))
    slides = result.arm.chain.slides
    for j in range(n):
        for order, both in enumerate(bounds):
            low, high = (float(x[j]) for x in both)
            curves = tuple(
                Curve(
                    x=motion.t,
                    y=motion.derivatives[order][:, j],
                    name=motion.name,
                    colour=LINES[motion.name],
                    width=motion.width,
                    dash=motion.dash,
                )
                for motion in motions
            )
            # A limit of positions is far away, so that it would flatten the curves.
            nearby = (low, high) if order else (-np.inf, np.inf)
            visible = _range([x.y for x in curves], *nearby)
            plots.append(
                Plot(
                    # The axis shows the joint number, because joint names are longer than the
                    # plot is high.
                    label="" if order else f"joint {j + 1}" + " (m)" * bool(slides[j]),
                    curves=curves,
                    limits=visible,
                    lines=tuple(x for x in (low, high) if visible[0] < x < visible[1]),
                    height=HEIGHT,
                    max_points=MAX_POINTS,
                )
            )
    titles: tuple[str, ...] = QUANTITIES
    if slides.any():
        titles = tuple(x.replace("rad", "rad, m") for x in QUANTITIES)
    return Figure(title=f"Run {name}: joints", plots=tuple(plots), columns=titles)


class DrawnMotion(NamedTuple):
    """A motion in the figure.

    Args:
        name: "planned", "executed" or "experiment", which also determines the colour.
        t: Times [s], (n,).
        derivatives: Joint positions, velocities and accelerations, (n, dof) each.
        width: Width of the curves [px].
        dash: Dashes of the curves, as in `Curve`.
    """

    name: str
    t: FloatArray
    derivatives: Sequence[FloatArray]
    width: float
    dash: tuple[float, ...] = ()


def _motions(result: RunResult) -> Iterator[DrawnMotion]:
    """Yield the experiment, the executed and the planned motion of a run, if they exist."""
    if result.experiment is not None:
        done = result.experiment.execution
        yield DrawnMotion("experiment", done.t, (done.q, done.dq, done.ddq), width=1.2)
    if (moved := result.execution) is not None:
        yield DrawnMotion("executed", moved.t, (moved.q, moved.dq, moved.ddq), width=2.0)
    t = np.linspace(0, result.trajectory.duration, MAX_POINTS)
    planned = [result.trajectory(t, order) for order in range(3)]
    yield DrawnMotion("planned", t, planned, width=1.5, dash=(2.0, 3.0))


def _range(curves: list[FloatArray], low: float, high: float) -> tuple[float, float]:
    """Return an axis range that shows the curves without rare spikes, and nearly reached limits."""
    ends = [np.percentile(x, [100 - USUAL, USUAL]) for x in curves]
    bottom, top = float(np.min(ends)), float(np.max(ends))
    # The range has a minimum size, so that the noise of a joint at rest is not enlarged.
    edge = max(0.12 * (top - bottom), 0.01)
    used = max(top / high if high else 0.0, bottom / low if low else 0.0)
    if used > WORTH_SHOWING:
        bottom = min(bottom, 1.15 * low)
        top = max(top, 1.15 * high)
    return bottom - edge, top + edge


def _table(result: RunResult) -> TextTable:
    """Tabulate every joint's range and largest values, and the used fractions of its limits."""
    done = result.motion
    arm = result.arm
    limits = result.run.limits
    torques = result.peak_torques
    amounts = [
        ("velocity", "rad/s", _worst("joint_velocity", limits, done.dq)),
        ("acceleration", "rad/s^2", _worst("joint_acceleration", limits, done.ddq)),
    ]
    if limits.joint_jerk is not None and result.evaluation is not None:
        amounts.append(("jerk", "rad/s^3", use_of("joint_jerk", limits, result.evaluation.jerk)))
    if torques is not None:
        amounts.append(("planned torque", "N m", use_of("joint_torque", limits, torques)))
    columns: list[tuple[Row, Sequence[Any]]] = [(Row("joint", None, "", "joint"), arm.joint_names)]

    def add(label: str, unit: str, values: FloatArray) -> None:
        """Add a column with the values of all joints in their own units."""
        units = [arm.chain.unit(unit, j) for j in range(arm.dof)]
        rows = [Row(label, x, y) for x, y in zip(values.tolist(), units, strict=True)]
        columns.append((Row(label, None, unit, label), rows))

    ends = (*limits.joint_range(arm.dof), done.q.min(axis=0), done.q.max(axis=0))
    for label, values in zip(("lower end", "upper end", "from", "to"), ends, strict=True):
        add(label, "rad", np.where(np.isfinite(values), values, np.nan))
    for label, unit, use in amounts:
        add(label, unit, np.round(use.value, ROUNDED))
        if (limited := np.isfinite(use.limit)).any():
            shares = np.where(limited, use.ratio, np.nan).tolist()
            columns.append((Row(f"{label}.use", None, "1", f"of {label} limit"), shares))
    header, by_column = zip(*columns, strict=True)
    rows = list(zip(*by_column, strict=True))
    return text_table(Table("joints", header, rows), "Largest amounts")


def _worst(name: str, limits: Limits, values: FloatArray) -> Use:
    """Return each joint's largest use of a limit; without the limit, the largest value."""
    use = use_of(name, limits, values)
    rows = np.where(np.isinf(use.limit), use.value, use.ratio).argmax(axis=0)
    return use_of(name, limits, values[rows, np.arange(values.shape[1])])
