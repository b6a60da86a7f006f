"""The section on a program: a picture of its moves, and the times and errors of its contours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from armcontour.core.result import Row, Table
from armcontour.evaluation import ErrorProfile
from armcontour.jobs import RunResult, Study
from armcontour.jobs.run_data import pierce_length, work_length
from armcontour.motion import Span
from armcontour.program import Contour, cut_parts
from armcontour.report import section
from armcontour.report.section import Section
from armcontour.report.sections.program_picture import picture

# Largest number of rows; of more contours, those with the largest errors are listed.
MOST_ROWS = 20
# Share of the assigned velocity from which the velocity counts as reached.
REACHED = 0.999
# Shorter leads are rounding errors [m].
ROUNDING = 1e-9
# A contour, its part of the plan and its error.
Judged = tuple[Contour, Span, ErrorProfile | None]
COLUMNS = (
    Row("contour", None, "", "contour"),
    Row("layer", None, "", "layer"),
    Row("length", None, "m", "length"),
    Row("pierce", None, "m", "pierce"),
    Row("lead_in", None, "m", "lead-in"),
    Row("lead_out", None, "m", "lead-out"),
    Row("start", None, "s", "from"),
    Row("time", None, "s", "time"),
    Row("mean_speed", None, "m/s", "mean"),
    Row("assigned", None, "1", "as assigned"),
    Row("rms", None, "m", "RMS error"),
    Row("max", None, "m", "largest"),
)


def program(study: Study) -> Section | None:
    """A picture of a program and a table of its contours; None for a single path."""
    first = next(iter(study.runs.values()))
    if first.path.single_path is not None and not cut_parts(first.path, study.job.process):
        return None
    results = study.runs.items()
    drawn, notes = picture(first, study.job)
    return Section(
        key="program",
        title="Program",
        text=(
            "As planned: contours with the process on, leads, and rapids between them; with a "
            "kerf, the drawn contours and the band of the cut. Rapids keep the limits of the "
            "joints, and rapid_speed and approach_speed of the process if there are any; else the "
            "tool may be faster than the assigned velocity. Between two moves the tool is at rest."
        ),
        figures=(drawn,),
        tables=tuple(_table(name, x) for name, x in results),
        notes=(
            'In the table, lengths, times and errors are those at work; "as assigned" is the '
            "share of the length that is run at the assigned velocity.",
            *notes,
        ),
    )


def _table(name: str, result: RunResult) -> section.Table:
    """A row for every contour, or for those with the largest errors."""
    program, limit = result.path, result.run.limits.speed
    errors = () if result.evaluation is None else result.evaluation.contours
    spans, most = result.trajectory.contour_spans, np.inf if limit is None else limit
    contours = list[Judged](
        zip(program.contours, spans, errors or [None] * len(spans), strict=True)
    )
    order, caption = np.arange(len(spans)), f"Run {name}: contours in order"
    if len(spans) > MOST_ROWS and not errors:
        caption = f"Run {name}: the first {MOST_ROWS} of {len(spans)} contours"
    elif len(spans) > MOST_ROWS:
        order = np.argsort([-x.max for x in errors], kind="stable")
        caption = (
            f"Run {name}: the {MOST_ROWS} of {len(spans)} contours with the largest errors; all "
            "are in summary.json"
        )
    rows = [_row(k, contours[k], most) for k in order[:MOST_ROWS].tolist()]
    if rest := [contours[k] for k in order[MOST_ROWS:].tolist()]:
        rows.append(_rest(rest))
    used = [any(x[k] for x in rows) for k in range(len(COLUMNS))]
    columns = tuple(x if y else replace(x, label="") for x, y in zip(COLUMNS, used, strict=True))
    return section.table_of(Table("contours", columns, rows), caption)


def _row(k: int, judged: Judged, most: float) -> list[Any]:
    """The values of a contour, by `COLUMNS`."""
    contour, span, error = judged
    assert span.work is not None
    (start, end), way = contour.at_work, pierce_length(contour)
    length, time = work_length(contour), span.work[1] - span.work[0]
    return [
        f"{k + 1}" + (f": {contour.name}" if contour.name else ""),
        contour.layer,
        length,
        *(x if x > ROUNDING else 0.0 for x in (way, start - way, contour.path.length - end)),
        *(span.work[0], time, length / time, _assigned_share(contour, span, most)),
        *((None, None) if error is None else (error.rms, error.max)),
    ]


def _rest(contours: Sequence[Judged]) -> list[Any]:
    """The values of all contours that are not listed."""
    length = sum(work_length(x) for x, _, _ in contours)
    times = [end - start for start, end in (x.work or x.t for _, x, _ in contours)]
    errors = [x for _, _, x in contours if x is not None]
    time, rms, most = sum(times), None, None
    if errors:
        squares = sum(x.rms**2 * t for x, t in zip(errors, times, strict=True))
        rms, most = float(np.sqrt(squares / time)), max(x.max for x in errors)
    name = f"and {len(contours)} more"
    return [name, "", length, *[None] * 4, time, length / time, None, rms, most]


def _assigned_share(contour: Contour, span: Span, most: float) -> float | None:
    """Share of a contour's length, with the process on, that has the assigned velocity."""
    assert span.trajectory is not None
    times = span.trajectory.breaks
    s, speeds = span.trajectory.s(times), span.trajectory.s(times, 1)
    start, end = contour.at_work
    middle, width = (s[:-1] + s[1:]) / 2, np.diff(s)
    assigned = np.fmin(contour.path.speeds[contour.path.locate(middle)], most)
    has_speed = np.isfinite(assigned) & (middle >= start) & (middle <= end)
    if not has_speed.any():
        return None
    speed = np.minimum(speeds[:-1], speeds[1:])
    reached = has_speed & (speed >= REACHED * assigned)
    return float(width[reached].sum() / width[has_speed].sum())
