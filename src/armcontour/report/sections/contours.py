"""Section on the contours of a program: times and errors."""

from __future__ import annotations

import numpy as np

from armcontour.core.result import Row, Table
from armcontour.jobs import JobResult, RunResult
from armcontour.jobs.rows import work_length
from armcontour.report.section import Section, TextTable, text_table

# Maximum number of rows. If there are more contours, those with the largest errors are listed, or
# the first ones if no errors were simulated.
MAX_ROWS = 200
COLUMNS = (
    Row("contour", None, "", "contour"),
    Row("layer", None, "", "layer"),
    Row("length", None, "m", "length"),
    Row("start", None, "s", "from"),
    Row("time", None, "s", "time"),
    Row("mean_speed", None, "m/s", "mean"),
    Row("rms", None, "m", "RMS error"),
    Row("max", None, "m", "largest"),
)


def contours(job_result: JobResult) -> Section | None:
    """Make the section with a table of the contours; None for a single path."""
    if next(iter(job_result.runs.values())).path.single_path is not None:
        return None
    return Section(
        key="contours",
        title="Contours",
        summary="length, time, speed and error of each contour",
        text=(
            "Lengths, times and errors are for the process on. Rapids between contours satisfy the "
            "joint limits, and rapid_speed and approach_speed of the process if specified."
        ),
        choices=tuple((name, (_table(name, x),)) for name, x in job_result.runs.items()),
    )


def _table(name: str, result: RunResult) -> TextTable:
    """Make the table with a row per contour, with at most MAX_ROWS rows."""
    errors = () if result.judged is None else result.judged.contours
    rows = []
    for k, (contour, span) in enumerate(
        zip(result.path.contours, result.trajectory.contour_spans, strict=True)
    ):
        assert span.work is not None
        length = work_length(contour)
        time = span.work[1] - span.work[0]
        label = f"{contour.number or k + 1}" + f": {contour.name}" * bool(contour.name)
        error = (errors[k].rms, errors[k].max) if errors else (None, None)
        rows.append((label, contour.layer, length, span.work[0], time, length / time, *error))
    caption = f"Run {name}: contours in order"
    if len(rows) > MAX_ROWS:
        order = np.argsort([-x.max for x in errors], kind="stable") if errors else range(len(rows))
        caption = f"Run {name}: {MAX_ROWS} of {len(rows)} contours; all are in summary.json"
        rows = [rows[k] for k in order[:MAX_ROWS]]
    return text_table(Table("contours", COLUMNS, rows), caption)
