"""The section on shaped paths: a table of their starts, durations and distances."""

from __future__ import annotations

import numpy as np

from armcontour.geometry import ShapedPath
from armcontour.geometry.shaped import ARCS, PARABOLAS, SHAPED, STOPS
from armcontour.jobs import Study
from armcontour.report.section import Section, Table
from armcontour.report.style import few

# Largest number of rows of the table.
MOST_ROWS = 20
STARTS = (ARCS, PARABOLAS, STOPS)


def shaping(study: Study) -> Section | None:
    """Durations and distances of shaped paths; None without a shaped path."""
    found = sorted(_shaped_contours(study), key=lambda x: -_saved(x[1]))
    if not found:
        return None
    outcomes = [(label, path.outcome.note) for label, path in found]
    notes = [*few((f"{label}: {note}." for label, note in outcomes if note is not None), "notes")]
    if len(found) > MOST_ROWS:
        notes.append(f"The table has the {MOST_ROWS} of {len(found)} contours that gain the most.")
    return Section(
        key="shaping",
        title="Shaped path",
        text=(
            "The shape of the path was found together with its timing: the fastest path within the "
            "tolerance, two-sided: every point of the path is within the tolerance of its place on "
            "the objective path, and every vertex within the tolerance of the path."
        ),
        tables=(_table(found[:MOST_ROWS]),),
        notes=tuple(notes),
    )


def _saved(path: ShapedPath) -> float:
    """Time that a shape saves [s]."""
    return path.outcome.durations[path.outcome.start] - path.outcome.durations[SHAPED]


def _shaped_contours(study: Study) -> list[tuple[str, ShapedPath]]:
    """Names and paths of the shaped contours of all runs; runs with the same shape share one."""
    found: list[tuple[str, ShapedPath]] = []
    several = len({x.run.rounding for x in study.runs.values()}) > 1
    for name, result in study.runs.items():
        for i, contour in enumerate(result.path.contours):
            path = contour.path
            if not isinstance(path, ShapedPath) or any(_alike(x, path) for _, x in found):
                continue
            words = [f"contour {i + 1}"] if len(result.path.contours) > 1 else []
            words += [contour.name] if contour.name else []
            words += [f"run {name}"] if several or not words else []
            found.append((", ".join(words), path))
    return found


def _alike(first: ShapedPath, second: ShapedPath) -> bool:
    """Whether two shaped paths are the same."""
    return np.array_equal(first.places, second.places) and np.array_equal(
        first.vertices, second.vertices
    )


def _table(found: list[tuple[str, ShapedPath]]) -> Table:
    """A row for every shaped contour."""
    rows = []
    for label, path in found:
        outcome = path.outcome
        times = [outcome.durations.get(name) for name in STARTS]
        rows.append(
            (
                label,
                *("" if t is None else f"{t:.3f}" for t in times),
                f"{outcome.durations[SHAPED]:.3f}",
                outcome.start,
                f"{outcome.gain:.2%}",
                f"{max(len(outcome.history) - 1, 0)}",
                _tolerance(path),
                f"{path.deviation * 1e3:.4f}",
            )
        )
    return Table(
        header=(
            "",
            *(f"{name} [s]" for name in STARTS),
            "shaped [s]",
            "best start",
            "gain",
            "iterations",
            "tolerance [mm]",
            "distance [mm]",
        ),
        rows=tuple(rows),
        caption="Least times, and largest distances from the objective path",
    )


def _tolerance(path: ShapedPath) -> str:
    """The tolerance of a shaped path as text, in mm."""
    if path.line_tolerance is None or path.zone is None:
        return f"{path.tolerance * 1e3:.4g}"
    return (
        f"{path.tolerance * 1e3:.4g}, from {path.zone * 1e3:.4g} off corners "
        f"{path.line_tolerance * 1e3:.4g}"
    )
