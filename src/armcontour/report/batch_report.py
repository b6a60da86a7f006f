"""Report of a batch as an HTML page: chart of time over error, table, and a section per run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.render import VERDICTS, number, scale
from armcontour.core.result import Data
from armcontour.core.validity import AS_MODELLED
from armcontour.report.figure import render, render_page
from armcontour.report.origin import Origin
from armcontour.report.plan_drawing import Drawing, SymbolEntry
from armcontour.report.section import Chapter, Front, Section, TextTable, side_by_side

# Maximum number of runs with a section of their own.
MAX_SECTIONS = 200
# Names of the errors of a run, the preferred one first.
ERRORS = ("off_drawing", "contour_error.max")
# Plotted area of the chart [px], and its margins for ticks and labels.
WIDTH = 560.0
HEIGHT = 260.0
LEFT = 64.0
BELOW = 46.0
# Share of the range of the values that is free at each side of the chart.
FREE = 0.08
# Approximate number of ticks per axis.
TICKS = 5
# Steps between ticks, times a power of ten.
STEPS = (1.0, 2.0, 5.0, 10.0)
SOURCE = "Everything on this page was computed from the jobs of the batch."


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchEntry:
    """A run of a batch, or a job without results.

    Args:
        name: Number of the job and name of the run.
        values: Varied values in words.
        data: Results of the run; empty for a job without results.
        error: Why the job has no results.
        command: Command that runs this job alone and writes its report.
    """

    name: str
    values: str
    data: Data
    error: str = ""
    command: str = ""

    @property
    def key(self) -> str:
        """Anchor of the entry's section."""
        return "job-" + "-".join(self.name.split())

    @property
    def verdict(self) -> str:
        """Key of the verdict in `VERDICTS`."""
        kept = next((x.value for x in self.data.rows if x.name == "kept"), None)
        if kept is None:
            return "not judged"
        return "kept" if kept else "not kept"

    def value(self, *names: str) -> float | None:
        """Return the first known value among rows, in SI units; None if none is known."""
        values = {x.name: x.figure for x in self.data.rows}
        known = (values[x] for x in names if values.get(x) is not None)
        return next((float(x) for x in known), None)


def render_batch(
    title: str,
    about: str,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    entries: Sequence[BatchEntry],
    origin: Origin,
) -> str:
    """Render the report of a batch as one self-contained HTML page.

    Args:
        title: Title of the page.
        about: Line below the title.
        header: Heads of the table.
        rows: Row of each entry in the table.
        entries: The runs, in the order of the rows.
        origin: What the batch was computed from.
    """
    sections = [_section(x) for x in entries[:MAX_SECTIONS]]
    links = [x.key for x in sections]
    links += [""] * (len(entries) - len(links))
    table = TextTable(
        header=tuple(people_name(x) for x in header),
        rows=tuple(map(tuple, rows)),
        links=tuple(links),
    )
    chart = draw_chart(entries, links)
    sentences = []
    if len(entries) > MAX_SECTIONS:
        words = f"The first {MAX_SECTIONS} of {len(entries)} runs; results.csv has all results."
        sentences.append(("Runs below", words))
    front = Front(
        verdict=_summary(entries),
        parts=(table,) if chart is None else (chart, table),
        sentences=tuple(sentences),
    )
    return render_page(
        title, Chapter(front=front, sections=sections), about=about, source=SOURCE, origin=origin
    )


def _summary(entries: Sequence[BatchEntry]) -> str:
    """Name the fastest run that is kept; empty if no run is judged."""
    judged = [x for x in entries if x.verdict != "not judged"]
    kept = [x for x in judged if x.verdict == "kept"]
    if not kept:
        return f"None of {len(judged)} runs is kept, {AS_MODELLED}." if judged else ""
    best = min(kept, key=lambda x: x.value("duration") or np.inf)
    words = f"{len(kept)} of {len(judged)} runs are kept, {AS_MODELLED}."
    duration = number(best.value("duration"), "s")
    return f"{words} The fastest of them is job {best.name}: {duration}, {best.values}."


def people_name(key: str) -> str:
    """Return a key of a job file for people: its last name, then where it belongs.

    >>> people_name("limits.rapid_speed")
    'rapid speed (limits)'
    """
    *outer, name = key.replace("_", " ").split(".")
    return f"{name} ({', '.join(outer)})" if outer and all(outer) else key


def _section(entry: BatchEntry) -> Section:
    """Make the section with all figures of a run, or with the reason why it has none."""
    notes = []
    if entry.error:
        notes.append(entry.error)
    if entry.command:
        notes.append(f"The report of this job alone: {entry.command}")
    words = [entry.values]
    duration = entry.value("duration")
    if duration is not None:
        words += [VERDICTS[entry.verdict]["word"], number(duration, "s")]
    return Section(
        key=entry.key,
        title=f"Job {entry.name}",
        summary=" · ".join(filter(None, words)),
        parts=side_by_side({entry.name: entry.data}) if entry.data.rows else (),
        notes=tuple(notes),
    )


class _Axis(NamedTuple):
    """An axis of the chart: label, ends in SI units, and ticks as share of its length and text."""

    label: str
    low: float
    high: float
    ticks: list[tuple[float, str]]

    def share(self, value: float) -> float:
        """Return where a value is on the axis, from 0 to 1."""
        return (value - self.low) / (self.high - self.low)


def draw_chart(entries: Sequence[BatchEntry], links: Sequence[str]) -> Drawing | None:
    """Draw time over error with a point per run, which leads to its section; None without runs."""
    points = []
    for entry, link in zip(entries, links, strict=True):
        error = entry.value(*ERRORS)
        duration = entry.value("duration")
        if error is not None and duration is not None:
            points.append((error, duration, entry, link))
    if not points:
        return None
    name = ERRORS[0] if any(x[2].value(ERRORS[0]) is not None for x in points) else ERRORS[1]
    found = (row for x in points for row in x[2].data.rows if row.name == name)
    across = _axis(next(found).label, [x[0] for x in points], "m")
    up = _axis("motion", [x[1] for x in points], "s")
    marks = []
    for error, duration, entry, link in points:
        x = LEFT + across.share(error) * WIDTH
        y = (1.0 - up.share(duration)) * HEIGHT
        words = f"Job {entry.name}: {entry.values}; {number(duration, 's')}, {number(error, 'm')}"
        marks.append((x, y, entry.verdict.replace(" ", "-"), link, words))
    svg = render(
        "scatter.svg",
        left=LEFT,
        width=WIDTH,
        height=HEIGHT,
        below=BELOW,
        marks=marks,
        across=across,
        up=up,
        label=f"Time over error of {len(points)} runs",
    )
    keys = []
    for kind in dict.fromkeys(x[2].verdict for x in points):
        mark = f'<i class="dot {kind.replace(" ", "-")}"></i>'
        keys.append(SymbolEntry(mark, VERDICTS[kind]["word"]))
    return Drawing(title="Time over error; a point leads to its run", svg=svg, keys=tuple(keys))


def _axis(label: str, values: Sequence[float], unit: str) -> _Axis:
    """Make an axis with round ticks for values in SI units."""
    display, size = scale(unit)
    shown = np.array(values) / size
    span = float(np.ptp(shown)) or abs(float(shown[0])) or 1.0
    low = max(0.0, float(shown.min()) - FREE * span)
    high = float(shown.max()) + FREE * span
    power = 10.0 ** np.floor(np.log10((high - low) / TICKS))
    step = next(x * power for x in STEPS if (high - low) / (x * power) <= TICKS)
    first = int(np.ceil(low / step))
    last = int(np.floor(high / step))
    ticks = []
    for k in range(first, last + 1):
        ticks.append(((k * step - low) / (high - low), f"{k * step:.6g}"))
    return _Axis(f"{label} [{display}]", low * size, high * size, ticks)
