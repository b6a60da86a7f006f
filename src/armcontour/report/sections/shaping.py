"""The section on shaped paths: against their objective path, and against arcs."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.geometry import ShapedPath
from armcontour.geometry.shaped import ARCS, PARABOLAS, SHAPED, STOPS
from armcontour.jobs import Study
from armcontour.report.section import Section, Table
from armcontour.report.sections.corners import Replaced, draw_corners, find_corners
from armcontour.report.sections.shape_comparison import (
    ShapedContour,
    largest_distance,
    missed_vertices,
    starts_of,
    time_variant,
    variant_of,
)
from armcontour.report.sections.shaping_figures import (
    ARCS_NAME,
    LOOKS,
    along,
    magnified,
)
from armcontour.report.style import few

# Largest number of contours with figures, and of rows of the table.
MOST_CONTOURS = 6
MOST_ROWS = 20
# Largest number of enlarged corners.
MOST_CORNERS = 4
STARTS = (ARCS, PARABOLAS, STOPS)


def shaping(study: Study) -> Section | None:
    """Shaped paths with their starts, distances and speeds; None without a shaped path."""
    found = sorted(_shaped_contours(study), key=lambda x: -x.saved)
    if not found:
        return None
    shown = found[:MOST_CONTOURS]
    told = [(x.label, x.path.outcome.note) for x in found]
    notes = [*few((f"{label}: {note}." for label, note in told if note is not None), "notes")]
    if len(found) > len(shown):
        notes.append(f"Figures show the {len(shown)} contours that gain the most time.")
    if len(found) > MOST_ROWS:
        notes.append(f"The table has the {MOST_ROWS} of {len(found)} contours that gain the most.")
    return Section(
        key="shaping",
        title="Shaped path",
        text=(
            "The shape of the path was found together with its timing: the fastest path within the "
            "tolerance, two-sided: every point of the path is within the tolerance of its place on "
            "the objective path, and every vertex within the tolerance of the path. Speeds are "
            "those of the fastest motion under the limits of the run, as planned."
        ),
        choices=tuple((x.label, _figures(study, x)) for x in shown),
        tables=(_table(found[:MOST_ROWS]),),
        notes=tuple(notes),
    )


def _shaped_contours(study: Study) -> list[ShapedContour]:
    """The shaped contours of all runs; runs with the same shape share one."""
    found: list[ShapedContour] = []
    several = len({x.run.rounding for x in study.runs.values()}) > 1
    for name, result in study.runs.items():
        spans = result.trajectory.contour_spans
        for i, (contour, span) in enumerate(zip(result.path.contours, spans, strict=True)):
            path = contour.path
            if not isinstance(path, ShapedPath) or any(_alike(x.path, path) for x in found):
                continue
            words = [f"contour {i + 1}"] if len(spans) > 1 else []
            words += [contour.name] if contour.name else []
            words += [f"run {name}"] if several or not words else []
            found.append(
                ShapedContour(
                    label=", ".join(words),
                    result=result,
                    path=path,
                    start=result.trajectory(span.t[0]),
                )
            )
    return found


def _alike(first: ShapedPath, second: ShapedPath) -> bool:
    """Whether two shaped paths are the same."""
    return np.array_equal(first.places, second.places) and np.array_equal(
        first.vertices, second.vertices
    )


def _table(found: list[ShapedContour]) -> Table:
    """A row for every shaped contour."""
    rows = []
    for x in found:
        outcome, missed = x.path.outcome, missed_vertices(x.path)
        times = [outcome.durations.get(name) for name in STARTS]
        rows.append(
            (
                x.label,
                *("" if t is None else f"{t:.3f}" for t in times),
                f"{outcome.durations[SHAPED]:.3f}",
                outcome.start,
                f"{outcome.gain:.2%}",
                f"{max(len(outcome.history) - 1, 0)}",
                _tolerance(x.path),
                f"{largest_distance(x.path) * 1e3:.4f}",
                f"{missed.max(initial=0.0) * 1e3:.4f}",
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
            "missed [mm]",
        ),
        rows=tuple(rows),
        caption="Least times; largest distances from the objective path, and of missed vertices",
    )


def _tolerance(path: ShapedPath) -> str:
    """The tolerance of a shaped path as text, in mm."""
    if path.line_tolerance is None or path.zone is None:
        return f"{path.tolerance * 1e3:.4g}"
    return (
        f"{path.tolerance * 1e3:.4g}, from {path.zone * 1e3:.4g} off corners "
        f"{path.line_tolerance * 1e3:.4g}"
    )


def _figures(study: Study, contour: ShapedContour) -> tuple[Any, ...]:
    """Figures of one shaped contour: corners, the whole path magnified, speeds."""
    path = contour.path
    starts = starts_of(path, contour.result.run)
    shaped, rival = variant_of(path), starts[path.outcome.start]
    motions = [time_variant(x, contour, study.job) for x in (rival, shaped)]
    turned = find_corners(path)
    sharpest = sorted(turned, key=lambda x: -path.objective.turns[x.vertex - 1])[:MOST_CORNERS]
    title = "Corners of the shaped path"
    if len(turned) > len(sharpest):
        title += f": the sharpest {len(sharpest)} of {len(turned)}"
    # The shaped path is drawn over the arcs, if its tolerance has room for arcs.
    drawn = {**({ARCS_NAME: starts[ARCS]} if ARCS in starts else {}), shaped.name: shaped}
    found = []
    if sharpest:
        found.append(
            draw_corners(
                sorted(sharpest, key=lambda x: x.vertex),
                {name: x.path for name, x in drawn.items() if isinstance(x.path, Replaced)},
                title=title,
                looks=LOOKS[-len(drawn) :],
            )
        )
    if path.dimension == 2 and path.tolerance > 0:
        found.append(magnified(path, drawn))
    return (*found, along(path, (rival, shaped), motions))
