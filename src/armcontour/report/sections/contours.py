"""Section on the contours of a program: times and errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from armcontour.core.result import Row, Table
from armcontour.jobs import JobResult, RunResult
from armcontour.jobs.rows import pierce_length, work_length
from armcontour.motion import Span
from armcontour.program import Contour
from armcontour.report.section import Section, TextTable, text_table
from armcontour.verification import ErrorProfile

# Maximum number of rows. If there are more contours, those with the largest errors are listed, or
# the first ones if no errors were simulated.
MAX_ROWS = 200
# Share of the assigned velocity above which the velocity counts as reached.
REACHED = 0.999
# Length below which a lead is a rounding error [m].
ROUNDING = 1e-9
# A contour, its span of the plan, and its contour error (None if not simulated).
ContourJudgement = tuple[Contour, Span, ErrorProfile | None]
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


def contours(study: JobResult) -> Section | None:
    """Section with a table of the contours of a program; None for a single path."""
    if next(iter(study.runs.values())).path.single_path is not None:
        return None
    return Section(
        key="contours",
        title="Contours",
        summary="length, time, speed and error of each contour",
        text=(
            "Lengths, times and errors are for the process on; "
            '"as assigned" is the share of the length '
            "at the assigned velocity. Rapids between contours satisfy the joint limits, and "
            "rapid_speed and approach_speed of the process if specified."
        ),
        choices=tuple((name, (_table(name, x),)) for name, x in study.runs.items()),
    )


def _table(name: str, result: RunResult) -> TextTable:
    """Table with a row per contour, with at most MAX_ROWS rows."""
    program, limit = result.path, result.run.limits.speed
    errors = () if result.judged is None else result.judged.contours
    spans = result.trajectory.contour_spans
    contours = list[ContourJudgement](
        zip(program.contours, spans, errors or [None] * len(spans), strict=True)
    )
    order, caption = np.arange(len(spans)), f"Run {name}: contours in order"
    if len(spans) > MAX_ROWS and not errors:
        caption = f"Run {name}: the first {MAX_ROWS} of {len(spans)} contours"
    elif len(spans) > MAX_ROWS:
        order = np.argsort([-x.max for x in errors], kind="stable")
        caption = (
            f"Run {name}: the {MAX_ROWS} of {len(spans)} contours with the largest errors; all "
            "are in summary.json"
        )
    rows = [_row(k, contours[k], limit) for k in order[:MAX_ROWS].tolist()]
    used = [any(x[k] for x in rows) for k in range(len(COLUMNS))]
    columns = tuple(x if y else replace(x, label="") for x, y in zip(COLUMNS, used, strict=True))
    return text_table(Table("contours", columns, rows), caption)


def _row(k: int, judged: ContourJudgement, limit: float | None) -> list[Any]:
    """Values of a contour in the order of `COLUMNS`."""
    contour, span, error = judged
    assert span.work is not None
    (start, end), pierce = contour.at_work, pierce_length(contour)
    length, time = work_length(contour), span.work[1] - span.work[0]
    return [
        f"{k + 1}" + (f": {contour.name}" if contour.name else ""),
        contour.layer,
        length,
        *(x if x > ROUNDING else 0.0 for x in (pierce, start - pierce, contour.path.length - end)),
        *(span.work[0], time, length / time, _share_at_assigned_speed(contour, span, limit)),
        *((None, None) if error is None else (error.rms, error.max)),
    ]


def _share_at_assigned_speed(contour: Contour, span: Span, limit: float | None) -> float | None:
    """Share of a contour's working length at the assigned velocity; None if none is assigned.

    Only the length that has an assigned velocity counts.
    """
    assert span.trajectory is not None
    times = span.trajectory.breaks
    s, speeds = span.trajectory.s(times), span.trajectory.s(times, 1)
    start, end = contour.at_work
    middle, width = (s[:-1] + s[1:]) / 2, np.diff(s)
    assigned = contour.path.assigned_speeds(limit, middle)
    has_speed = np.isfinite(assigned) & (middle >= start) & (middle <= end)
    if not has_speed.any():
        return None
    speed = np.minimum(speeds[:-1], speeds[1:])
    reached = has_speed & (speed >= REACHED * assigned)
    return float(width[reached].sum() / width[has_speed].sum())
