"""The section on shaped paths: a table of their starts, durations and distances."""

from __future__ import annotations

from armcontour.core import result
from armcontour.core.result import Row
from armcontour.geometry import ShapedPath
from armcontour.geometry.shaped import ARCS, PARABOLAS, SHAPED, STOPS
from armcontour.jobs import JobResult
from armcontour.report.section import Section, Table, table_of
from armcontour.report.sections.corners import alike
from armcontour.report.style import few

STARTS = (ARCS, PARABOLAS, STOPS)


def shaping(study: JobResult) -> Section | None:
    """Durations and distances of shaped paths; None without a shaped path."""
    found = sorted(_shaped_contours(study), key=lambda x: -_saved(x[1]))
    if not found:
        return None
    outcomes = [(label, path.outcome.note) for label, path in found]
    notes = [*few((f"{label}: {note}." for label, note in outcomes if note is not None), "notes")]
    return Section(
        key="shaping",
        title="Shaped path",
        summary="least times of each start, and distances from the objective path",
        text=(
            "The shape of the path was found together with its timing: the fastest path within the "
            "tolerance, two-sided: every point of the path is within the tolerance of its place on "
            "the objective path, and every vertex within the tolerance of the path."
        ),
        parts=(_table(found),),
        notes=tuple(notes),
    )


def _saved(path: ShapedPath) -> float:
    """Time that a shape saves [s]."""
    return path.outcome.durations[path.outcome.start] - path.outcome.durations[SHAPED]


def _shaped_contours(study: JobResult) -> list[tuple[str, ShapedPath]]:
    """Names and paths of the shaped contours of all runs; runs with the same shape share one."""
    found: list[tuple[str, ShapedPath]] = []
    differ = len({x.run.rounding for x in study.runs.values()}) > 1
    for name, x in study.runs.items():
        contours = x.path.contours
        for i, contour in enumerate(contours):
            path = contour.path
            if not isinstance(path, ShapedPath) or any(alike(x, path) for _, x in found):
                continue
            words = [f"contour {i + 1}"] if len(contours) > 1 else []
            words += [contour.name] if contour.name else []
            words += [f"run {name}"] if differ or not words else []
            found.append((", ".join(words), path))
    return found


def _table(found: list[tuple[str, ShapedPath]]) -> Table:
    """A row for every shaped contour."""
    columns = (
        Row("contour", None, "", "contour"),
        *(Row(x, None, "s", x) for x in (*STARTS, SHAPED)),
        Row("start", None, "", "best start"),
        Row("gain", None, "1", "gain"),
        Row("iterations", None, "", "iterations"),
        Row("tolerance", None, "m", "tolerance"),
        Row("line_tolerance", None, "m", "along lines"),
        Row("zone", None, "m", "from corners"),
        Row("deviation", None, "m", "distance"),
    )
    rows = [
        (
            label,
            *(x.outcome.durations.get(name) for name in (*STARTS, SHAPED)),
            *(x.outcome.start, x.outcome.gain, max(len(x.outcome.history) - 1, 0)),
            *(x.tolerance, x.line_tolerance, x.zone, x.deviation),
        )
        for label, x in found
    ]
    caption = "Least times, and largest distances from the objective path"
    return table_of(result.Table("shaping", columns, rows), caption)
