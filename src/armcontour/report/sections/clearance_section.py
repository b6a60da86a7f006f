"""Section on clearance: smallest distances over time, and the arm at the smallest distance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from armcontour.core.text import list_some
from armcontour.jobs import Job, JobResult, RunResult
from armcontour.report.figure import Figure
from armcontour.report.section import Section, text_table
from armcontour.report.style import RUN_COLOURS, finish, line

# Displayed names of the kinds of pairs.
KINDS = {
    "environment": "links and cell",
    "own": "links among each other",
    "tool": "tool and others",
}
# Number of points of the curves, and maximum number of rows of the table.
TIMES, MAX_ROWS = 200, 7
# Height of the figures [px].
HEIGHT = 320


def clearance(study: JobResult) -> Section | None:
    """Section with the clearance of each run that was checked; None if no run was checked."""
    runs = {name: x for name, x in study.runs.items() if x.clearance is not None}
    if not runs:
        return None
    first = next(iter(runs.values()))
    result = first.clearance
    assert result is not None
    reasons = Counter(x.reason for x in result.left_out)
    skipped = list_some([f"{reason} ({n})" for reason, n in reasons.items()], 6)
    return Section(
        key="clearance",
        title="Clearance",
        summary="least distances of the arm from itself, from its tool and from its cell",
        text="The clearance is proven for all times, also between samples. The figure shows "
        "distances at single times; dashed lines are margins.",
        choices=tuple((name, tuple(_parts(study.job, x))) for name, x in runs.items()),
        notes=(f"Pairs that are not checked: {skipped}.",) if reasons else (),
    )


def _parts(job: Job, result: RunResult) -> Iterator[Any]:
    """Yield figures and tables of a run: distances over time, and nearest pairs."""
    assert result.clearance is not None
    yield _over_time(job, result)
    for clearance, source in (
        (result.clearance, "planned"),
        (result.executed_clearance, "executed"),
    ):
        if clearance is not None:
            pairs = next(x for x in clearance.to_data().tables if x.name == "pairs")
            yield text_table(replace(pairs, rows=pairs.rows[:MAX_ROWS]), f"Nearest pairs, {source}")


def _over_time(job: Job, result: RunResult) -> Any:
    """Figure with the smallest distance of each kind of pair over time, planned and executed."""
    figure = Figure()
    cell = job.cell
    t = np.linspace(0.0, result.trajectory.duration, TIMES)
    planned = cell.smallest_distances(result.trajectory(t))
    executed = result.motion
    rows = np.unique(np.linspace(0, len(executed.t) - 1, TIMES).astype(int))
    driven = cell.smallest_distances(executed.q[rows])
    margins = {x.kind: x.margin for x in cell.pairs}
    for (kind, least), colour in zip(planned.items(), RUN_COLOURS, strict=False):
        figure.add_trace(line(t, least * 1e3, f"{KINDS[kind]}, planned", colour))
        if result.execution is not None:
            least, label = driven[kind] * 1e3, f"{KINDS[kind]}, executed"
            figure.add_trace(line(executed.t[rows], least, label, colour, dash="dot"))
        figure.add_hline(y=margins[kind] * 1e3, line={"color": colour, "width": 1, "dash": "dash"})
    figure.update_xaxes(title="t [s]")
    figure.update_yaxes(title="least distance [mm]", rangemode="tozero")
    return finish(figure, title="Least distances", height=HEIGHT, span=3)
