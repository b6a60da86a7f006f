"""Pictures of single results: for `plot`, and for notebooks with the rows of the report."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.render import figure
from armcontour.core.result import Data, Row
from armcontour.geometry import Path
from armcontour.jobs import JobResult
from armcontour.program import Program
from armcontour.report.figure import Figure, Picture, render
from armcontour.report.plan_drawing import Drawing
from armcontour.report.sections.joints import draw_joints
from armcontour.report.sections.motion import draw_over_time, plot_error, plot_speed
from armcontour.report.sections.path_section import draw_tool, tools_of
from armcontour.report.sheet import Sheet, view_of
from armcontour.report.single_results import Result, job_result_of
from armcontour.report.view import drawn_curve
from armcontour.studies.certification import Certificate
from armcontour.verification import Evaluation

Shown = Result | Certificate | Path | Program


def draw_result(result: Shown, kind: str) -> Picture:
    """Draw a result as a picture of a kind in KINDS, see `armcontour.core.pictures.plot`."""
    checks.check_choice("kind", kind, tuple(KINDS))
    if isinstance(result, Path | Program):
        if kind != "path":
            raise InvalidInput(
                f"A {type(result).__name__} has no picture of the kind {kind!r}, because it has no "
                "motion. Plan it first, with plan(path, arm)."
            )
        return _draw_paths(Program.from_path(result))
    return KINDS[kind](_job_result(result))


def result_as_html(result: Shown) -> str | None:
    """Write the picture and the rows of a result as HTML without scripts, for a notebook.

    Returns None if the result does not contain what its picture shows, such as the arm.
    """
    try:
        picture = draw_result(result, "path")
    except InvalidInput:
        return None
    data = _data(result)
    rows = [(x.label, figure(x), x.note) for x in data.shown()]
    values = {"title": data.title, "rows": rows, "warnings": data.warnings}
    return str(render("notebook.html", picture=picture, **values))


def _job_result(result: Result | Certificate) -> JobResult:
    """Return the job result whose picture is shown."""
    return result.job_result if isinstance(result, Certificate) else job_result_of(result)


def _data(result: Shown) -> Data:
    """Return the values of a result that a notebook shows."""
    if isinstance(result, Path | Program):
        return _path_data(result)
    if isinstance(result, Certificate | Evaluation):
        return result.to_data()
    job_result = job_result_of(result)
    if len(job_result.runs) == 1:
        return next(iter(job_result.figures.values()))
    return job_result.to_data()


def _path_data(path: Path | Program) -> Data:
    """Return length and size of a path or a program."""
    program = Program.from_path(path)
    points = np.concatenate([drawn_curve(x.path) for x in program.contours])
    sizes = np.ptp(points, axis=0)
    named = zip("xyz", sizes.tolist(), strict=False)
    return Data(
        title=program.source or type(path).__name__,
        rows=(
            Row("length", program.length, "m", "length"),
            Row("contours", len(program.contours), "", "contours"),
            Row("segments", sum(len(x.path) for x in program.contours), "", "segments"),
            *(Row(f"size.{axis}", size, "m", f"size in {axis}") for axis, size in named),
        ),
    )


def _draw_paths(program: Program) -> Drawing:
    """Draw the contours of a program."""
    curves = [drawn_curve(x.path) for x in program.contours]
    points = np.concatenate(curves)
    sheet = Sheet.of(points, view_of(points))
    title = program.source or "Path"
    lines = [sheet.line(curves, 'class="contour"', "path")]
    drawn = {"sheet": sheet, "lines": lines, "marks": (), "numbers": (), "insets": ()}
    return Drawing(title=title, svg=render("drawing.svg", id="path", label=title, **drawn), keys=())


def _draw_error(job_result: JobResult) -> Figure:
    if not job_result.simulated:
        raise InvalidInput("A plan has no contour error. Execute and evaluate the plan first.")
    return draw_over_time(job_result, plot_error, title="Contour error")


KINDS: dict[str, Callable[[JobResult], Picture]] = {
    "path": lambda job_result: draw_tool(tools_of(job_result)[0], job_result.job.name),
    "joints": lambda job_result: draw_joints(*next(iter(job_result.runs.items()))),
    "speed": lambda job_result: draw_over_time(job_result, plot_speed, title="Tool speed"),
    "error": _draw_error,
}
