"""Drawing of a plan as SVG: the path, coloured by the limiting constraint."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import LINES, limit_style, number, number_range
from armcontour.core.text import count_noun
from armcontour.jobs import Job, RunResult
from armcontour.planning.explanation import BETWEEN, RAPIDS, Binding
from armcontour.program import Contour, Process, contour_called, cut_parts, idle_parts
from armcontour.report.figure import Picture, render
from armcontour.report.sheet import Line, Mark, Sheet, view_of
from armcontour.report.tool_axes import WORDS, axis_arrows
from armcontour.report.view import drawn_arc_lengths, drawn_curve, points_at

# Minimum visible length [px]. A shorter piece gets the previous piece's colour, shorter leads are
# not drawn, and if corners are rounded by less, the contours as drawn are left out.
SHORTEST = 1.0
# Number of points per rapid.
RAPID_PLACES = 24
# Maximum number of contours for which numbers are drawn.
MAX_NUMBERED = 60
# The place of a number is free if it is at least this far, horizontally or vertically, from the
# other numbers and from the starts of the other contours [px].
FREE = 22.0
# Places of a number relative to the start of its contour, in order of preference [px].
BESIDE = 15.0 * np.array([[1.0, -1.0], [-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
# Fraction of the maximum speed below which the tool counts as stopped.
STILL = 1e-6
# Fraction of the duration below which a limit is not listed in the legend.
LEAST_SHARE = 5e-3
# Arc lengths that differ by at most this [m] are one place.
SAME_PLACE = 1e-9


class LegendEntry(NamedTuple):
    """An entry in a drawing's legend: one limit kind.

    Args:
        word: Name of the limit kind.
        time: Time in which this kind restricts the speed [s].
        share: This time divided by the duration.
        look: SVG attributes of the line.
        names: Limits of this kind with their times, such as single joint limits.
        place: Id of the place at which this kind is active longest; "" between contours.
    """

    word: str
    time: float
    share: float
    look: str
    names: str
    place: str = ""


class SymbolEntry(NamedTuple):
    """An entry below a drawing: a symbol of the drawing and its meaning.

    Args:
        symbol: Symbol as HTML.
        words: Meaning of the symbol.
        place: Id of the mark; "" without a link.
    """

    symbol: str
    words: str
    place: str = ""


class Tab(NamedTuple):
    """A part at work on which the process is off.

    Args:
        contour: The contour.
        offset: Arc length over all contours at which the contour starts [m].
        start, end: Arc lengths of the tab on the contour [m].
    """

    contour: Contour
    offset: float
    start: float
    end: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing(Picture):
    """A drawing with its legends.

    Args:
        svg: The drawing as SVG.
        keys: Entries below the drawing.
        legend: Limit kinds, the longest active one first.
        places: Ids of marks, by names of the values that they show.
    """

    template: ClassVar[str] = "drawing.html"
    svg: str = field(repr=False)
    keys: tuple[SymbolEntry, ...]
    legend: tuple[LegendEntry, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict)


def draw_plan(result: RunResult, job: Job) -> Drawing:
    """Draw the path of a plan with its active limits, rapids, kerf, process and extremes."""
    contours = [drawn_curve(x.path) for x in result.path.contours]
    rapids = rapid_paths(result)
    tabs = _tabs(result, job.process)
    # A flat part is viewed from above, also if the tool is lifted between its contours.
    axes = view_of(np.concatenate(contours))
    sheet = Sheet.of(np.concatenate([*contours, *rapids]), axes)
    lines = [
        *_draw_kerf(result, job.process, sheet),
        *_as_drawn(result, job, sheet),
        *_leads(result, sheet),
    ]
    if rapids:
        lines.append(sheet.line(rapids, f'class="limit" {look_of(RAPIDS)}'))
    for kind, curves in pieces_of(result, SHORTEST / sheet.size).items():
        lines.append(sheet.line(curves, f'class="limit path" {look_of(kind)}', word_of(kind)))
    tab_curves = [drawn_curve(x.contour.path, x.start, x.end) for x in tabs]
    if tab_curves:
        lines.append(sheet.line(tab_curves, 'class="tab"', "tab, not cut"))
    arrows = axis_arrows((x.path for x in result.path.contours), sheet)
    if arrows:
        lines.append(Line('class="tool-axis"', arrows, WORDS))
    prefix = slug(job.name)
    extremes = list(_extremes(result, prefix))
    kinds: dict[str, tuple[str, str, list[Mark]]] = {
        "start": ("▶", "start of a contour", _start_marks(result)),
        "stop": ("■", "stop inside a contour", _stop_marks(result)),
        "pierce": ("⊙", "pierce", _pierce_marks(result, job.process)),
        "on": ("◆", "output on or changed", _output_marks(result, tabs, on=True)),
        "off": ("◇", "output off", _output_marks(result, tabs, on=False)),
        **{name: (symbol, mark.words, [mark]) for name, symbol, mark in extremes},
    }
    keys = [SymbolEntry("┄", f"tab ({len(tabs)})")] if tabs else []
    if arrows:
        keys.append(SymbolEntry("→", WORDS))
    marks: list[tuple[str, Mark]] = []
    for name, (symbol, words, points) in kinds.items():
        if points:
            marks += ((name, x) for x in sheet.without_overlap(points))
            place = points[0].place
            keys.append(SymbolEntry(symbol, words if place else f"{words} ({len(points)})", place))
    limits = _limit_marks(result, prefix)
    marks += (("", x) for x in limits.values())
    legend = legend_of(result, {kind: x.place for kind, x in limits.items()})
    label = f"Path of the tool, {count_noun(len(contours), 'contour')}; what takes the time: "
    label += ", ".join(f"{x.word} {number(x.share, '1')}" for x in legend) or "unknown"
    places = {ROW_OF[name]: mark.place for name, _, mark in extremes}
    explanation = result.explanation
    if explanation is not None and explanation.longest is not None:
        longest = explanation.longest[0]
        kind = next(x.kind for x in explanation.shares if x.name == longest)
        if kind in limits:
            places["time_limit"] = limits[kind].place
    title = "Path" + ", coloured by the active limit" * bool(legend)
    drawn = {"sheet": sheet, "lines": lines, "marks": marks, "numbers": _numbers(result, sheet)}
    svg = render("drawing.svg", id=prefix, label=label, insets=(), **drawn)
    return Drawing(title=title, svg=svg, keys=tuple(keys), legend=legend, places=places)


# Names of the result rows whose values the marks show, by name of the mark.
ROW_OF = {"error": "off_drawing", "near": "clearance.low", "slow": "slowest"}


def slug(text: str) -> str:
    """Convert a text to letters, digits and hyphens, for the id of an element."""
    return re.sub(r"\W+", "-", text)


def word_of(kind: str) -> str:
    """Return the name of a limit kind on pages."""
    return str(limit_style(kind).get("word", kind))


def colour_of(kind: str) -> str:
    """Return a limit kind's colour on a light page."""
    return str(limit_style(kind)["light"])


def look_of(kind: str) -> str:
    """Return the SVG attribute with a limit kind's colours (light, dark theme) and dashes."""
    entry = limit_style(kind)
    dash = " ".join(map(str, entry["dash"]))
    return (
        f'style="--light:{entry["light"]};--dark:{entry["dark"]};stroke-dasharray:{dash or "none"}"'
    )


def pieces_of(result: RunResult, shortest: float) -> dict[str, list[FloatArray]]:
    """Cut the contours into curves [m] by the limiting constraint's kind.

    A curve shorter than `shortest` [m] gets the kind of the previous curve.
    """
    explanation = result.explanation
    pieces: defaultdict[str, list[FloatArray]] = defaultdict(list)
    starts = np.array([0.0])
    kinds = ["unknown"]
    if explanation is not None:
        starts = np.array([x.s[0] for x in explanation.bindings])
        kinds = [kind_of(x.limit) for x in explanation.bindings]
    names = list(dict.fromkeys(kinds))
    kind_of_part = np.array([names.index(x) for x in kinds])
    for contour, offset in zip(result.path.contours, result.path.breaks, strict=False):
        end = offset + contour.path.length
        first = np.searchsorted(starts, offset, side="right")
        inner = starts[first : np.searchsorted(starts, end)] - offset
        s = np.union1d(drawn_arc_lengths(contour.path, np.inf), inner)
        indices = np.searchsorted(starts, offset + (s[:-1] + s[1:]) / 2, side="right") - 1
        kind = kind_of_part[np.clip(indices, 0, len(kind_of_part) - 1)]
        edges = np.flatnonzero(np.diff(kind, prepend=-1))
        # A piece that is too short to be visible gets the colour of the previous piece.
        visible = np.diff(np.append(s[edges], s[-1])) >= shortest
        visible[0] = True
        edges = edges[visible]
        edges = edges[np.diff(kind[edges], prepend=-1) != 0]
        points = contour.path(s)
        for a, b in zip(edges, [*edges[1:], len(s) - 1], strict=True):
            pieces[names[kind[a]]].append(points[a : b + 1])
    return dict(pieces)


def kind_of(limit: str) -> str:
    """Return the palette name of a limit, which is its kind."""
    return BETWEEN if limit == "nothing" else limit


def legend_of(result: RunResult, places: Mapping[str, str]) -> tuple[LegendEntry, ...]:
    """Make the legend of a run: one entry per limit kind, the longest active time first.

    `places` has, for each limit kind, the id of the mark where this kind is active longest.
    """
    if (explanation := result.explanation) is None:
        return ()
    entries = []
    for kind, share in explanation.kinds.items():
        parts = [x for x in explanation.shares if x.kind == kind]
        names = [f"{x.name.removesuffix(f' {kind}')} {number(x.time, 's')}" for x in parts]
        words = ", ".join(names) if len(parts) > 1 else ""
        time = sum(x.time for x in parts)
        place = places.get(kind, "")
        entries.append(LegendEntry(word_of(kind), time, share, look_of(kind), words, place))
    return tuple(x for x in entries if x.share >= LEAST_SHARE)


def rapid_paths(result: RunResult) -> list[FloatArray]:
    """Sample the tool paths of the rapids [m], (RAPID_PLACES, dimension) each."""
    spans = [x.t for x in result.trajectory.spans if x.kind == "rapid"]
    if not spans:
        return []
    start, end = np.array(spans).T
    times = np.linspace(start, end, RAPID_PLACES, axis=1)
    points = result.arm.tool_position(result.trajectory(times.ravel(), side="left"))
    return list(points.reshape(len(spans), RAPID_PLACES, -1))


def _draw_kerf(result: RunResult, process: Process, sheet: Sheet) -> Iterator[Line]:
    """Yield the bands of material that the kerf removes."""
    widths: defaultdict[float, list[FloatArray]] = defaultdict(list)
    for path, begin, end, kerf in cut_parts(result.path, process):
        widths[kerf].append(drawn_curve(path, begin, end))
    for kerf, curves in widths.items():
        look = f'class="kerf" stroke-width="{kerf * sheet.size:.1f}"'
        yield sheet.line(curves, look, f"kerf {number(kerf, 'm')}")


def _as_drawn(result: RunResult, job: Job, sheet: Sheet) -> Iterator[Line]:
    """Yield the contours as drawn: those with kerf, else all if rounding is visible."""
    contours = [x for x in job.program.contours if job.process.of_contour(x).kerf]
    if not contours and (result.rounding_error or 0.0) * sheet.size > SHORTEST:
        contours = list(result.objective.contours)
    curves = [drawn_curve(x.path) for x in contours]
    if curves:
        yield sheet.line(curves, 'class="objective"', "as drawn")


def _leads(result: RunResult, sheet: Sheet) -> Iterator[Line]:
    """Yield leads and pierce moves, which are drawn as a wide band."""
    curves = []
    for contour in result.path.contours:
        begin, end = contour.at_work
        for a, b in ((0.0, begin), (end, contour.path.length)):
            if (b - a) * sheet.size > SHORTEST:
                curves.append(drawn_curve(contour.path, a, b))
    if curves:
        yield sheet.line(curves, f'class="lead" stroke="{LINES["leads"]}"', "lead")


def _start_marks(result: RunResult) -> list[Mark]:
    """Mark the starts of contours, with their directions."""
    spans = result.trajectory.contour_spans
    marks = []
    for k, (contour, span) in enumerate(zip(result.path.contours, spans, strict=True)):
        words = f"{contour_called(contour, k)} {contour.layer}".strip()
        words += f": {number(contour.path.length, 'm')}, {number_range(span.t, 's')}"
        marks.append(Mark(contour.path(0.0), words, contour.path(0.0, 1)))
    return marks


def _numbers(result: RunResult, sheet: Sheet) -> Iterator[tuple[int, FloatArray]]:
    """Yield numbers of contours and their places [px], if there are 2 to MAX_NUMBERED contours."""
    contours = result.path.contours
    if 1 < len(contours) <= MAX_NUMBERED:
        starts = sheet.place(np.array([x.path(0.0) for x in contours]))
        places_of_numbers = list[FloatArray]()
        for k, contour in enumerate(contours):
            # The first place next to the start that is free, else the one with most room.
            others = np.array([*np.delete(starts, k, axis=0), *places_of_numbers])
            places = starts[k] + BESIDE
            room = np.abs(places[:, None] - others).max(axis=2).min(axis=1)
            place = places[np.argmax(np.minimum(room, FREE))]
            places_of_numbers.append(place)
            yield contour.number or k + 1, place


def _stop_marks(result: RunResult) -> list[Mark]:
    """Mark the points inside contours at which the tool stops."""
    marks = []
    for contour, span in zip(result.path.contours, result.trajectory.contour_spans, strict=True):
        motion = span.trajectory
        if motion is None or motion.path is None:
            continue
        t = motion.breaks
        speeds = motion.s(t, 1)
        stops = t[1:-1][speeds[1:-1] < STILL * speeds.max(initial=0.0)]
        for s in motion.s(stops) if len(stops) else ():
            marks.append(Mark(contour.path(s), f"stop at s = {number(span.s[0] + s, 'm')}"))
    return marks


def _output_marks(result: RunResult, tabs: Sequence[Tab], *, on: bool) -> list[Mark]:
    """Mark the points at which outputs are switched, without those of tabs."""
    words = {True: "on", False: "off"}
    tab_ends = list[float]()
    for tab in tabs:
        tab_ends += [tab.offset + tab.start, tab.offset + tab.end]
    marks = []
    for event in result.trajectory.events:
        if (event.value is not False) != on:
            continue
        if np.isclose(event.s, tab_ends, rtol=0, atol=SAME_PLACE).any():
            continue
        value = words[event.value] if isinstance(event.value, bool) else event.value
        place = f"t = {number(event.t, 's')}, s = {number(event.s, 'm')}"
        marks.append(Mark(np.asarray(event.point), f"{event.name} = {value}, {place}"))
    return marks


def _tabs(result: RunResult, process: Process) -> list[Tab]:
    """List the tabs of all contours."""
    tabs = []
    for k, start, end in idle_parts(result.path, process):
        contour = result.path.contours[k]
        work_start, work_end = contour.at_work
        if work_start < start and end < work_end:
            tabs.append(Tab(contour, float(result.path.breaks[k]), start, end))
    return tabs


def _pierce_marks(result: RunResult, process: Process) -> list[Mark]:
    """Mark the starts of contours at which the tool pierces."""
    return [
        Mark(x.path(0.0), f"pierce {number(pierce.time, 's')}")
        for x in result.path.contours
        if (pierce := process.of_contour(x).pierce) is not None
    ]


def _extremes(result: RunResult, prefix: str) -> Iterator[tuple[str, str, Mark]]:
    """Yield name, symbol and mark of the slowest point, the largest error and the nearest pair."""
    slowest = None if result.explanation is None else result.explanation.slowest
    if slowest is not None:
        origin = result.path.origin_at(slowest.s)
        words = ", ".join(filter(None, [f"slowest point: {slowest.sentence}", origin]))
        yield "slow", "▲", Mark(_at(result, slowest.s), words, place=f"{prefix}-slow")
    if result.judged is not None:
        # If the drawing is unknown, the path takes its place.
        errors = result.judged.drawing_errors
        contours = result.objective.contours
        if not errors:
            errors = result.judged.contours
            contours = result.path.contours
        k = int(np.argmax([x.max for x in errors]))
        name = contour_called(contours[k], k)
        words = f"largest distance from the drawing, {name}: {number(errors[k].max, 'm')}"
        point = contours[k].path(errors[k].s_max - result.path.breaks[k])
        mark = Mark(point, words, place=f"{prefix}-error")
        yield "error", "✕", mark
    if result.clearance is not None and (pair := result.clearance.least) is not None:
        t = pair.t if pair.first_time is None else pair.first_time
        words = f"nearest pair: {pair.bodies}, {number(result.clearance.low, 'm')}"
        tool = result.arm.tool_position(result.trajectory(t))
        yield "near", "◎", Mark(tool, words, place=f"{prefix}-near")


def _at(result: RunResult, s: float) -> FloatArray:
    """Return the point at an arc length over all contours [m], (dimension,)."""
    return np.asarray(points_at(result.path, np.array([s]))[0])


def _limit_marks(result: RunResult, prefix: str) -> dict[str, Mark]:
    """Mark the middle of the longest part with each limit kind."""
    longest: dict[str, Binding] = {}
    for part in () if result.explanation is None else result.explanation.bindings:
        kind = kind_of(part.limit)
        if kind not in longest or np.ptp(part.t) > np.ptp(longest[kind].t):
            longest[kind] = part
    marks = {}
    for kind, part in longest.items():
        words = f"{part.name}, {number_range(part.t, 's')}"
        place = f"{prefix}-limit-{slug(kind)}"
        marks[kind] = Mark(_at(result, float(np.mean(part.s))), words, place=place)
    return marks
