"""The section on the jerk of the joints, for runs with limits of jerk."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.arms.limits import or_unlimited
from armcontour.evaluation.executed_jerk import mean_jerk
from armcontour.jobs import RunResult, Study
from armcontour.report.figure import make_subplots
from armcontour.report.section import Section
from armcontour.report.style import (
    EXECUTED_COLOUR,
    LIMIT_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
    thin,
)

# Points of a curve, and times between which the plan is looked at, with both sides of its breaks.
MOST_POINTS = 1500
MOST_TIMES = 20_000
# Largest share of a limit that an axis shows: a servo whose command has corners may go far beyond.
MOST_SHOWN = 2.0
# Height of a joint's part of a figure, of few and of many joints.
HIGH, LOW, MANY = 230, 150, 3


def jerks(study: Study) -> Section | None:
    """Jerk of every joint with a limit of jerk; None for a job whose runs have none."""
    found = [(name, x, _limited(x)) for name, x in study.runs.items()]
    limited = [(name, x, joints) for name, x, joints in found if len(joints)]
    if not limited:
        return None
    return Section(
        key="jerks",
        title="Joint jerk",
        text=(
            "Planned jerk of the joints that have a limit of it, and executed jerk, as its mean "
            "over one command interval. Black lines are the limits: plans keep them, while a servo "
            "answers set-points as it can. No axis shows more than twice a limit."
        ),
        figures=tuple(_figure(*x) for x in limited),
    )


def _limited(result: RunResult) -> IntArray:
    """The joints that have a limit of jerk, from 0."""
    limit = or_unlimited(result.run.limits.joint_jerk, result.execution.arm.dof)
    return np.flatnonzero(np.isfinite(limit))


def _figure(name: str, result: RunResult, joints: IntArray) -> Any:
    """Figure of the planned and executed jerk of some joints of a run."""
    executed, plan = result.execution, result.trajectory
    limit = or_unlimited(result.run.limits.joint_jerk, executed.arm.dof)
    figure = make_subplots(
        rows=len(joints), cols=1, shared_xaxes=True, vertical_spacing=0.12 / len(joints)
    )
    t, planned = _planned(result)
    done = mean_jerk(executed)
    for row, j in enumerate(joints.tolist(), start=1):
        place = {"row": row, "col": 1}
        dotted: dict[str, Any] = {"dash": "dot", "width": 1.5}
        for times, values, label, colour, look in (
            (executed.t, done[:, j], "executed", EXECUTED_COLOUR, {}),
            (t, planned[:, j], "planned", PLANNED_COLOUR, dotted),
        ):
            few, y = thin(times, values, most=MOST_POINTS)
            look = {**look, "showlegend": row == 1, "legendgroup": label}
            figure.add_trace(line(few, y, label, colour, **look), **place)
        top = float(limit[j])
        for bound in (-top, top):
            figure.add_hline(y=bound, line={"color": LIMIT_COLOUR, "width": 1}, **place)
        most = max(float(np.abs(done[:, j]).max()), float(np.abs(planned[:, j]).max()))
        edge = min(max(1.15 * top, 1.05 * most), MOST_SHOWN * top)
        title = {"text": executed.arm.joint_names[j], "font": {"size": 11}}
        figure.update_yaxes(title=title, range=[-edge, edge], nticks=5, **place)
    figure.update_xaxes(title="time [s]", row=len(joints), col=1)
    figure.update_xaxes(range=[0, max(plan.duration, result.evaluation.until)])
    height = (HIGH if len(joints) <= MANY else LOW) * len(joints) + 120
    return finish(figure, title=f"Run {name}: jerk [rad/s³]", height=height)


def _planned(result: RunResult) -> tuple[FloatArray, FloatArray]:
    """Times and planned jerks, with both sides of every break, at which jerk jumps."""
    plan = result.trajectory
    breaks = plan.breaks
    even = np.linspace(0.0, plan.duration, MOST_TIMES)
    t = np.concatenate([breaks, breaks, even])
    values = np.concatenate([plan(breaks, 3, side="left"), plan(breaks, 3), plan(even, 3)])
    order = np.argsort(t, kind="stable")
    return t[order], values[order]
