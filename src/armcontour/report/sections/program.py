"""The section on a program: a picture of its moves, and the times and errors of its contours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.evaluation import ErrorProfile
from armcontour.jobs import RunResult, Study
from armcontour.jobs.run_data import pierce_length, work_length
from armcontour.motion import Span
from armcontour.program import Contour, Program, cut_parts
from armcontour.report.section import Section, Table
from armcontour.report.sections.program_picture import picture

# Largest number of rows; of more contours, those with the largest errors are listed.
MOST_ROWS = 20
# Share of the assigned velocity from which the velocity counts as reached.
REACHED = 0.999


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


def _table(name: str, result: RunResult) -> Table:
    """A row for every contour, or for those with the largest errors."""
    program = result.path
    errors = () if result.evaluation is None else result.evaluation.contours
    spans = result.trajectory.contour_spans
    order = np.arange(len(spans))
    caption = f"Run {name}: contours in order"
    if len(spans) > MOST_ROWS and not errors:
        order = order[:MOST_ROWS]
        caption = f"Run {name}: the first {MOST_ROWS} of {len(spans)} contours"
    elif len(spans) > MOST_ROWS:
        order = np.argsort([-x.max for x in errors], kind="stable")[:MOST_ROWS]
        caption = (
            f"Run {name}: the {MOST_ROWS} of {len(spans)} contours with the largest errors; all "
            "are in summary.json"
        )
    several = len({x.layer for x in program.contours}) > 1 or program.contours[0].layer
    led = program.length - sum(work_length(x) for x in program.contours) > 1e-9
    pierced = any(pierce_length(x) for x in program.contours)
    limit = result.run.limits.speed
    most = np.inf if limit is None else limit
    cells = [
        _cells(
            *(k, program.contours[k], spans[k], errors[k] if errors else None, most),
            layers=bool(several),
            led=led,
            pierced=pierced,
        )
        for k in order.tolist()
    ]
    rows = [tuple(row.values()) for row in cells]
    if len(spans) > len(rows):
        shown = set(order.tolist())
        rest = [k for k in range(len(spans)) if k not in shown]
        rows.append(_rest(rest, program, spans, errors, list(cells[0])))
    return Table(header=tuple(cells[0]), rows=tuple(rows), caption=caption)


def _cells(
    k: int,
    contour: Contour,
    span: Span,
    error: ErrorProfile | None,
    most: float,
    *,
    layers: bool,
    led: bool,
    pierced: bool,
) -> dict[str, str]:
    """Cells of a contour, by the titles of their columns."""
    assert span.work is not None
    length, time = work_length(contour), span.work[1] - span.work[0]
    found = {"contour": f"{k + 1}" + (f": {contour.name}" if contour.name else "")}
    if layers:
        found["layer"] = contour.layer
    found["length [mm]"] = f"{length * 1e3:.2f}"
    if led:
        start, end = contour.at_work
        way = pierce_length(contour)
        found["leads [mm]"] = f"{(start - way) * 1e3:.2f}, {(contour.path.length - end) * 1e3:.2f}"
        if pierced:
            found["pierce [mm]"] = f"{way * 1e3:.2f}"
    found |= {
        "from [s]": f"{span.work[0]:.3f}",
        "time [s]": f"{time:.3f}",
        "mean [mm/s]": f"{length / time * 1e3:.2f}",
        "as assigned": _assigned_share(contour, span, most),
    }
    if error is None:
        return found
    return {
        **found,
        "RMS error [mm]": f"{error.rms * 1e3:.4f}",
        "largest [mm]": f"{error.max * 1e3:.4f}",
    }


def _assigned_share(contour: Contour, span: Span, most: float) -> str:
    """Share of a contour's length, with the process on, that has the assigned velocity."""
    assert span.trajectory is not None
    times = span.trajectory.breaks
    s, speeds = span.trajectory.s(times), span.trajectory.s(times, 1)
    start, end = contour.at_work
    middle, width = (s[:-1] + s[1:]) / 2, np.diff(s)
    assigned = np.fmin(contour.path.speeds[contour.path.locate(middle)], most)
    has_speed = np.isfinite(assigned) & (middle >= start) & (middle <= end)
    if not has_speed.any():
        return ""
    speed = np.minimum(speeds[:-1], speeds[1:])
    reached = has_speed & (speed >= REACHED * assigned)
    return f"{width[reached].sum() / width[has_speed].sum():.0%}"


def _rest(
    which: list[int],
    program: Program,
    spans: Sequence[Span],
    errors: tuple[ErrorProfile, ...],
    header: list[str],
) -> tuple[str, ...]:
    """A row for all contours that are not listed."""
    length = sum(work_length(program.contours[k]) for k in which)
    ends = [spans[k].work or spans[k].t for k in which]
    times = [b - a for a, b in ends]
    cells = {
        "contour": f"and {len(which)} more",
        "length [mm]": f"{length * 1e3:.2f}",
        "time [s]": f"{sum(times):.3f}",
        "mean [mm/s]": f"{length / sum(times) * 1e3:.2f}",
    }
    if errors:
        squares = sum(errors[k].rms ** 2 * t for k, t in zip(which, times, strict=True))
        cells["RMS error [mm]"] = f"{np.sqrt(squares / sum(times)) * 1e3:.4f}"
        cells["largest [mm]"] = f"{max(errors[k].max for k in which) * 1e3:.4f}"
    return tuple(cells.get(name, "") for name in header)
