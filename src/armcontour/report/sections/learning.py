"""Report of learning: errors of tool and joints from run to run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.render import LINES, number
from armcontour.core.result import FIRST
from armcontour.core.validity import AT_ENCODERS
from armcontour.report.figure import Curve, Figure, Plot
from armcontour.report.moving_arm import draw_arm
from armcontour.report.plan_drawing import draw_plan
from armcontour.report.section import Front, Section, text_table, tiles
from armcontour.report.sections.motion import scale_errors
from armcontour.report.style import LIMIT_DASH, MAX_SENTENCES

if TYPE_CHECKING:
    from armcontour.jobs.run_learning import LearnedRun


# Height of the figures [px].
HEIGHT = 260


def learned(learned_run: LearnedRun) -> Front:
    """Make the first screen: the verdict with the next step, and the error from run to run."""
    data = learned_run.result
    return Front(
        verdict=learned_run.notes[0],
        tiles=tiles(data, FIRST),
        drawing=draw_plan(learned_run.plan, learned_run.job),
        arm=draw_arm(learned_run.plan, learned_run.job),
        parts=(_over_runs(learned_run),),
        sentences=(
            ("Definition of the error", _introduction(learned_run)),
            ("", data.not_proven),
        ),
    )


def learning(learned_run: LearnedRun) -> Section:
    """Make the section with the contour error over time, and a table of runs."""
    figures = [_over_time(learned_run)] if learned_run.has_path else []
    return Section(
        key="learning",
        title="Runs",
        summary="errors of tool and joints, and contour error over time",
        parts=(*figures, text_table(learned_run.result.tables[0], "Runs")),
        notes=tuple(learned_run.notes[1:MAX_SENTENCES]),
    )


def _introduction(learned_run: LearnedRun) -> str:
    """Define the errors in the figures."""
    error = "contour error"
    if not learned_run.has_path:
        error = "distance of the tool from its planned position"
    return (
        f"The error is the {error} {AT_ENCODERS}, from the logs of the robot, without measurement "
        "noise. Each run executes the set-points learned from the previous runs."
    )


def _over_runs(learned_run: LearnedRun) -> Figure:
    """Draw RMS and largest error against the run number, with noise."""
    count = len(learned_run.lesson.runs)
    noise = learned_run.lesson.noise
    runs = np.arange(1.0, count + 1)
    rms, largest = 1e3 * np.array([learned_run.errors(k) for k in range(count)]).T
    curves = [
        Curve(x=runs, y=largest, name="largest", colour=LINES["planned"], marked=True),
        Curve(x=runs, y=rms, name="RMS", colour=LINES["executed"], marked=True),
    ]
    if noise is not None:
        level = np.full(count, noise * 1e3)
        name = "does not repeat"
        curves.append(Curve(x=runs, y=level, name=name, colour=LINES["objective"], dash=LIMIT_DASH))
    plot = Plot(
        label="error of the tool [mm]",
        x_label="run",
        curves=tuple(curves),
        counts=True,
        height=HEIGHT,
    )
    return Figure(title="Error of the tool from run to run", plots=(scale_errors(plot),))


def _over_time(learned_run: LearnedRun) -> Figure:
    """Draw the contour error over time in the first and in the best run."""
    best = learned_run.lesson.best
    curves = []
    shown = {0: LINES["planned"], best: LINES["executed"]} if best else {0: LINES["planned"]}
    for k, colour in shown.items():
        profile = learned_run.profile(k)
        name = "before learning" if k == 0 else f"run {k + 1}"
        rms, largest = learned_run.errors(k)
        label = f"{name}: RMS {number(rms, 'm')}, largest {number(largest, 'm')}"
        y = profile.values * 1e3
        curves.append(Curve(x=profile.t, y=y, name=label, colour=colour, width=1.5))
    plot = Plot(label="contour error [mm]", curves=tuple(curves), height=HEIGHT)
    return Figure(title=f"Contour error {AT_ENCODERS}, over time", plots=(scale_errors(plot),))
