"""The section that compares published figures with the results."""

from __future__ import annotations

from dataclasses import replace

from armcontour.jobs import Published, Study
from armcontour.report.section import Section, Table

# Name in a job file: label, factor from SI, unit.
FIGURES = {
    "contour_error_rms": ("RMS contour error", 1e3, "mm"),
    "contour_error_max": ("largest contour error", 1e3, "mm"),
    "duration": ("time of motion", 1.0, "s"),
    "settled": ("time until rest", 1.0, "s"),
}


def published(study: Study) -> Section | None:
    """Tables of published figures and results; None without published figures of its runs."""
    found = study.job.published
    # A study may have some of the job's runs only.
    known = {} if found is None else {x: y for x, y in found.runs.items() if x in study.runs}
    if found is None or not known:
        return None
    found = replace(found, runs=known)
    tables = [_figures(study, found)]
    ratios = _ratios(study, found)
    if ratios is not None:
        tables.append(ratios)
    return Section(
        key="published",
        title="Comparison with published figures",
        text=f"Published: {found.source.rstrip('.')}.",
        tables=tuple(tables),
        notes=found.notes,
    )


def ours(study: Study, run: str, figure: str) -> float:
    """The result that corresponds to a published figure [SI]."""
    e = study.runs[run].evaluation
    return {
        "contour_error_rms": e.contour_error.rms,
        "contour_error_max": e.contour_error.max,
        "duration": e.duration,
        "settled": e.settled,
    }[figure]


def _figures(study: Study, found: Published) -> Table:
    """Table of published figures, results and differences."""
    rows = []
    for run, figures in found.runs.items():
        for name, value in figures.items():
            label, scale, unit = FIGURES[name]
            here = ours(study, run, name) * scale
            rows.append(
                (
                    f"{run}: {label}",
                    f"{value * scale:.3f} {unit}",
                    f"{here:.4f} {unit}",
                    f"{here - value * scale:+.4f} {unit}",
                )
            )
    return Table(header=("figure", "published", "here", "difference"), rows=tuple(rows))


def _ratios(study: Study, found: Published) -> Table | None:
    """Table of the ratios of later runs to the first run, in figures that both have."""
    runs = list(found.runs)
    rows = []
    for run in runs[1:]:
        for name in found.runs[run]:
            if name in found.runs[runs[0]]:
                theirs = found.runs[run][name] / found.runs[runs[0]][name]
                here = ours(study, run, name) / ours(study, runs[0], name)
                label = f"{run} / {runs[0]}: {FIGURES[name][0]}"
                rows.append((label, f"{100 * theirs:.3g}%", f"{100 * here:.3g}%"))
    if not rows:
        return None
    return Table(header=("ratio", "published", "here"), rows=tuple(rows))
