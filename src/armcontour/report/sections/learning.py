"""Report of learning: errors of tool and joints from run to run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.render import number
from armcontour.core.result import FIRST
from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Front, Section, text_table, tiles
from armcontour.report.style import (
    EXECUTED_COLOUR,
    MAX_SENTENCES,
    PATH_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
    thin,
)

if TYPE_CHECKING:
    from armcontour.jobs.run_learning import LearningStudy

# Height of the figures [px].
HEIGHT = 360
# Minimum error on a logarithmic axis [mm]; smaller errors are drawn at this value.
SMALLEST_ERROR = 1e-6


def learned(study: LearningStudy) -> Front:
    """First screen: the verdict with the next step, and the error from run to run."""
    data = study.result
    return Front(
        verdict=study.notes[0],
        tiles=tiles(data, FIRST),
        parts=(_over_runs(study),),
        sentences=(("Definition of the error", _introduction(study)),),
    )


def learning(study: LearningStudy) -> Section:
    """Section with the contour error over time, and a table of runs."""
    figures = [_over_time(study)] if study.has_path else []
    return Section(
        key="learning",
        title="Runs",
        summary="errors of tool and joints, and contour error over time",
        parts=(*figures, text_table(study.result.tables[0], "Runs")),
        notes=tuple(study.notes[1:MAX_SENTENCES]),
    )


def _introduction(study: LearningStudy) -> str:
    """Text that defines the errors in the figures."""
    error = "contour error" if study.has_path else "distance of the tool from its planned position"
    return (
        f"The error is the {error} according to the logs of the robot, without measurement noise. "
        "Each run executes the set-points learned from the previous runs. The error does not "
        "include deviations that the encoders do not measure, such as bending of links."
    )


def _over_runs(study: LearningStudy) -> Any:
    """Figure with RMS and largest error against the run number, with noise."""
    lesson, count = study.lesson, len(study.lesson.runs)
    errors = np.array([study.errors(k) for k in range(count)])
    numbers = range(1, count + 1)
    drawn = Figure(
        _error_trace(numbers, errors[:, 1], "largest", PLANNED_COLOUR, "diamond"),
        _error_trace(numbers, errors[:, 0], "RMS", EXECUTED_COLOUR, "circle"),
    )
    if lesson.noise is not None:
        level = np.full(2, max(lesson.noise * 1e3, SMALLEST_ERROR))
        drawn.add_trace(line([1, count], level, "does not repeat", PATH_COLOUR, dash="dash"))
    drawn.update_xaxes(title="run", dtick=max(1, count // 12), range=[0.7, count + 0.3])
    drawn.update_yaxes(title="error of the tool [mm]", type="log")
    return finish(drawn, title="Error of the tool from run to run", height=HEIGHT)


def _error_trace(x: Sequence[int], y: Any, name: str, colour: str, symbol: str) -> Any:
    """Trace of errors [m or rad] against the run number, plotted in mm or mrad."""
    return make_trace(
        "scatter",
        x=list(x),
        y=np.maximum(1e3 * np.asarray(y), SMALLEST_ERROR),
        name=name,
        mode="lines+markers",
        line={"color": colour, "width": 2},
        marker={"color": colour, "symbol": symbol, "size": 9},
    )


def _over_time(study: LearningStudy) -> Any:
    """Figure with the contour error over time in the first and in the best run."""
    drawn = Figure()
    best = study.lesson.best
    shown = {0: PLANNED_COLOUR, best: EXECUTED_COLOUR} if best else {0: PLANNED_COLOUR}
    for k, colour in shown.items():
        profile = study.profile(k)
        t, values, s = thin(profile.t, profile.values * 1e3, profile.s)
        name = "before learning" if k == 0 else f"run {k + 1}"
        rms, largest = study.errors(k)
        label = f"{name}: RMS {number(rms, 'm')}, largest {number(largest, 'm')}"
        curve = line(t, np.maximum(values, SMALLEST_ERROR), label, colour, width=1.5)
        curve.customdata = s.astype(np.float32)
        curve.hovertemplate = "%{y:.4f} mm at %{x:.3f} s, s = %{customdata:.4f} m<extra></extra>"
        drawn.add_trace(curve)
    drawn.update_xaxes(title="time [s]")
    drawn.update_yaxes(title="contour error [mm]", type="log")
    return finish(drawn, title="Contour error as measured, over time", height=HEIGHT)
