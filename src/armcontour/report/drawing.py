"""The drawing of a plan as SVG: its path, coloured by the limit that restricts the speed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.palette import LIMITS, LINES
from armcontour.core.render import number, number_range
from armcontour.core.text import count_noun
from armcontour.geometry import RoundedPath
from armcontour.jobs import Job, RunResult
from armcontour.planning.explanation import BETWEEN, RAPIDS, LimitShare
from armcontour.program import Process, cut_parts
from armcontour.report.outline import fine_places, simplify

# Width, largest and smallest height, and margin of the drawing [px].
WIDTH, HEIGHT, FLATTEST, EDGE = 800.0, 440.0, 190.0, 34.0
# Largest error of the drawn path [px], and pieces that are drawn as a part of the piece before.
VISIBLE, SHORTEST = 0.3, 1.0
# Points in thickness by length below which a path in space is drawn from the front of its plane.
FLAT = 0.02
# Direction to the viewer of other paths.
VIEWER = np.array([1.1, -1.5, 0.9])
# Points along every rapid, and the least distance of two marks of one kind [px].
RAPID_PLACES, APART = 24, 7.0
# Largest number of contours with numbers.
MAX_NUMBERED = 60
# Length of the arrows of the axes [px], and the least length of a drawn axis.
AXIS, SHORT_AXIS = 26.0, 0.25
# Share of the largest speed below which the tool stands still.
STILL = 1e-6
# Share of the duration below which a limit is not in the legend.
LEAST_SHARE = 5e-3


class Entry(NamedTuple):
    """A limit in the legend of a drawing.

    Args:
        word: What it is called.
        time: For how long it restricts the speed [s].
        share: The same as a share of the motion.
        look: Attributes of its line.
        names: Its parts, such as the joints.
    """

    word: str
    time: float
    share: float
    look: str
    names: str


class Mark(NamedTuple):
    """A mark in a drawing.

    Args:
        point: Its place [m], (dimension,).
        words: What it is.
        along: Its direction; None for marks without.
    """

    point: FloatArray
    words: str
    along: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """A drawing with its legend.

    Args:
        svg: The drawing.
        legend: The limits, the longest time first.
        marks: The symbols of the marks that are drawn, and what they mean.
    """

    svg: str
    legend: tuple[Entry, ...]
    marks: tuple[tuple[str, str], ...]


def draw_plan(result: RunResult, job: Job) -> Drawing:
    """Draw the path of a plan.

    Args:
        result: The plan of a run.
        job: Its job, for the kerf.
    """
    outline = [x.path(fine_places(x.path)) for x in result.path.contours]
    rapids = _rapids(result)
    sheet = Sheet.of(np.concatenate([*outline, *rapids]))
    parts = [
        *_kerf(result, job.process, sheet),
        *_as_drawn(result, job, sheet),
        *_leads(result, sheet),
    ]
    if rapids:
        parts.append(_line(sheet, rapids, f'class="limit" {look_of(RAPIDS)}'))
    for kind, curves in _pieces(result, sheet).items():
        parts.append(_line(sheet, curves, f'class="limit path" {look_of(kind)}', word_of(kind)))
    marks = {
        "start": ("▶", "start of a contour", _starts(result)),
        "corner": ("○", "rounded corner", _corners(result)),
        "stop": ("■", "stop inside a contour", _stops(result)),
        "event": ("◆", "output switched", _events(result)),
    }
    known = []
    for name, (symbol, words, places) in marks.items():
        if places:
            parts += sheet.mark(name, places)
            known.append((symbol, f"{words} ({len(places)})"))
    parts += [*_numbers(result, sheet), *sheet.scale()]
    legend = legend_of(result)
    what = f"Path of the tool, {count_noun(len(outline), 'contour')}; what takes the time: "
    what += ", ".join(f"{x.word} {number(x.share, '1')}" for x in legend) or "unknown"
    return Drawing(
        svg=(
            f'<svg class="drawing" role="img" viewBox="0 0 {WIDTH:.0f} {sheet.height:.0f}" '
            f'aria-label="{escape(what)}">{"".join(parts)}</svg>'
        ),
        legend=legend,
        marks=tuple(known),
    )


def word_of(kind: str) -> str:
    """What a limit is called."""
    return str(LIMITS.get(kind, LIMITS["other"]).get("word", kind))


def look_of(kind: str) -> str:
    """Colours by theme and dashes of a limit, as attributes of SVG."""
    x = LIMITS.get(kind, LIMITS["other"])
    dash = " ".join(map(str, x["dash"]))
    return f'style="--light:{x["light"]};--dark:{x["dark"]};stroke-dasharray:{dash or "none"}"'


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """Where points of a path are in the drawing.

    Args:
        axes: Directions to the right and up in the coordinates of the path, (2, dimension).
        origin: The point of the left lower corner, along these axes [m], (2,).
        size: Pixels per metre.
        height: Height of the drawing [px].
    """

    axes: FloatArray
    origin: FloatArray
    size: float
    height: float

    @classmethod
    def of(cls, points: FloatArray) -> Sheet:
        """The largest drawing of points, in which their plane is not tilted."""
        axes = view_of(points)
        low, high = (f(points @ axes.T, axis=0) for f in (np.min, np.max))
        wide, high_up = np.maximum(high - low, 1e-9)
        size = min((WIDTH - 2 * EDGE) / wide, (HEIGHT - 2 * EDGE) / high_up)
        height = max(FLATTEST, high_up * size + 2 * EDGE)
        room = (np.array([WIDTH, height]) / size - (high - low)) / 2
        return cls(axes, low - room, float(size), float(height))

    def place(self, points: FloatArray) -> FloatArray:
        """Points in the drawing [px], (n, 2)."""
        across = (points @ self.axes.T - self.origin) * self.size
        return np.asarray(np.stack([across[..., 0], self.height - across[..., 1]], axis=-1))

    def mark(self, name: str, marks: Iterable[Mark]) -> Iterator[str]:
        """Marks of one kind with their words; of marks in one place the first one."""
        taken: set[tuple[int, ...]] = set()
        for x in marks:
            right, down = self.place(x.point)
            cell = (int(right // APART), int(down // APART))
            if cell not in taken:
                taken.add(cell)
                along = np.array([1.0, 0.0]) if x.along is None else x.along @ self.axes.T
                angle = -np.degrees(np.arctan2(along[1], along[0]))
                turn = f"translate({right:.1f} {down:.1f}) rotate({angle:.0f})"
                title = f"<title>{escape(x.words)}</title>"
                yield f'<use href="#mark-{name}" transform="{turn}">{title}</use>'

    def scale(self) -> Iterator[str]:
        """A bar of a round length, and the axes of the coordinates."""
        most = WIDTH / 5 / self.size
        power = 10.0 ** np.floor(np.log10(most))
        length = max(x * power for x in (1, 2, 5) if x * power <= most)
        end, low = 12 + length * self.size, self.height - 10
        yield f'<path class="scale" d="M12 {low - 4:.1f}v4H{end:.1f}v-4"/>'
        yield f'<text x="{end + 6:.1f}" y="{low:.1f}">{number(length, "m")}</text>'
        drawn: list[tuple[float, float]] = []
        for k in np.argsort(-np.hypot(*self.axes)).tolist():
            right, up = self.axes[:, k].tolist()
            apart = (abs(right * y - up * x) for x, y in drawn)
            if min(apart, default=1.0) < SHORT_AXIS or np.hypot(right, up) < SHORT_AXIS:
                continue
            drawn.append((right, up))
            x, y = 22 + AXIS * right, low - 22 - AXIS * up
            yield f'<path class="scale" d="M22 {low - 22:.1f}L{x:.1f} {y:.1f}"/>'
            x, y = 22 + (AXIS + 9) * right, low - 18 - (AXIS + 9) * up
            yield f'<text class="axis" x="{x:.1f}" y="{y:.1f}">{"xyz"[k]}</text>'


def view_of(points: FloatArray) -> FloatArray:
    """Directions to the right and up in which points are seen, (2, dimension).

    Points of a plane are seen from its front, others from a corner of the room.
    """
    if points.shape[1] == 2:
        return np.eye(2)
    some = points[:: max(1, len(points) // 5000)]
    _, sizes, along = np.linalg.svd(some - some.mean(axis=0), full_matrices=False)
    if len(sizes) < 3 or sizes[1] < FLAT * sizes[0]:
        # Along a straight line: from above, or along y if the line is upright.
        normal = np.array([0.0, 0.0, 1.0]) if abs(along[0][2]) < 0.9 else np.array([0.0, -1.0, 0.0])
        normal = normal - (normal @ along[0]) * along[0]
    else:
        normal = VIEWER if sizes[2] > FLAT * sizes[1] else along[2]
    normal = normal / np.linalg.norm(normal) * (1.0 if normal @ VIEWER >= 0 else -1.0)
    above = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    up = above - (above @ normal) * normal
    up /= np.linalg.norm(up)
    return np.stack([np.cross(up, normal), up])


def _line(sheet: Sheet, curves: Sequence[FloatArray], look: str, words: str = "") -> str:
    """Curves as one path of SVG, simplified by the error on the screen."""
    drawn = [sheet.place(x) for x in curves]
    kept = simplify(drawn, even=1, visible=VISIBLE)
    rows = (points[few].ravel().tolist() for points, few in zip(drawn, kept, strict=True))
    texts = ("M" + " ".join(f"{x:.1f}" for x in row) for row in rows)
    title = f"<title>{escape(words)}</title>" if words else ""
    return f'<path {look} d="{"".join(texts)}">{title}</path>'


def _pieces(result: RunResult, sheet: Sheet) -> dict[str, list[FloatArray]]:
    """Parts of the contours by the kind of the limit that restricts the speed there."""
    why = result.explanation
    found: defaultdict[str, list[FloatArray]] = defaultdict(list)
    starts = np.array([0.0] if why is None else [x.s[0] for x in why.bindings])
    kinds = ["unknown"] if why is None else [kind_of(x.limit) for x in why.bindings]
    names = list(dict.fromkeys(kinds))
    which = np.array([names.index(x) for x in kinds])
    for x, offset in zip(result.path.contours, result.path.breaks, strict=False):
        inner = starts[(starts > offset) & (starts < offset + x.path.length)] - offset
        s = np.union1d(fine_places(x.path), inner)
        at = np.searchsorted(starts, offset + (s[:-1] + s[1:]) / 2, side="right") - 1
        kind = which[np.clip(at, 0, len(which) - 1)]
        edges = np.flatnonzero(np.diff(kind, prepend=-1))
        # A piece that is too short to be seen has the colour of the piece before.
        seen = np.diff(np.append(s[edges], s[-1])) * sheet.size >= SHORTEST
        seen[0] = True
        edges = edges[seen]
        edges = edges[np.diff(kind[edges], prepend=-1) != 0]
        points = x.path(s)
        for a, b in zip(edges, [*edges[1:], len(s) - 1], strict=True):
            found[names[kind[a]]].append(points[a : b + 1])
    return dict(found)


def kind_of(limit: str) -> str:
    """The name of a limit in the palette."""
    return BETWEEN if limit == "nothing" else limit


def legend_of(result: RunResult) -> tuple[Entry, ...]:
    """What takes the time of a motion, by kinds of limits, the longest first."""
    why, kinds = result.explanation, defaultdict[str, list[LimitShare]](list)
    for x in () if why is None else why.shares:
        kinds[x.kind].append(x)
    found = []
    for kind, parts in kinds.items():
        share = sum(x.of_time for x in parts)
        if share < LEAST_SHARE:
            continue
        names = [f"{x.name.removesuffix(f' {kind}')} {number(x.time, 's')}" for x in parts]
        words = ", ".join(names) if len(parts) > 1 else ""
        time = sum(x.time for x in parts)
        found.append(Entry(word_of(kind), time, share, look_of(kind), words))
    return tuple(sorted(found, key=lambda x: -x.time))


def _rapids(result: RunResult) -> list[FloatArray]:
    """The ways of the tool between contours."""
    plan = result.trajectory
    spans = [x.t for x in plan.spans if x.kind == "rapid"]
    if not spans:
        return []
    start, end = np.array(spans).T
    times = np.linspace(start, end, RAPID_PLACES, axis=1)
    points = result.arm.tool_position(plan(times.ravel(), side="left"))
    return list(points.reshape(len(spans), RAPID_PLACES, -1))


def _kerf(result: RunResult, process: Process, sheet: Sheet) -> Iterator[str]:
    """The band of material that the kerf takes away."""
    widths: defaultdict[float, list[FloatArray]] = defaultdict(list)
    for path, begin, end, kerf in cut_parts(result.path, process):
        widths[kerf].append(path(fine_places(path, begin, end)))
    for kerf, curves in widths.items():
        look = f'class="kerf" stroke-width="{kerf * sheet.size:.1f}"'
        yield _line(sheet, curves, look, f"kerf {number(kerf, 'm')}")


def _as_drawn(result: RunResult, job: Job, sheet: Sheet) -> Iterator[str]:
    """The contours before corners were rounded or a kerf was added, where that is visible."""
    contours = [x for x in job.program.contours if job.process.of_layer(x.layer).kerf]
    if not contours and (result.rounding_error or 0.0) * sheet.size > SHORTEST:
        contours = list(result.objective.contours)
    curves = [x.path(fine_places(x.path)) for x in contours]
    if curves:
        yield _line(sheet, curves, 'class="objective"', "as drawn")


def _leads(result: RunResult, sheet: Sheet) -> Iterator[str]:
    """Leads, and ways to the height of the pierce, as halos of the path."""
    curves = []
    for x in result.path.contours:
        begin, end = x.at_work
        for a, b in ((0.0, begin), (end, x.path.length)):
            if (b - a) * sheet.size > SHORTEST:
                curves.append(x.path(fine_places(x.path, a, b)))
    if curves:
        yield _line(sheet, curves, f'class="lead" stroke="{LINES["leads"]}"', "lead")


def _starts(result: RunResult) -> list[Mark]:
    """The starts of contours, and their directions."""
    spans, found = result.trajectory.contour_spans, []
    for k, (x, span) in enumerate(zip(result.path.contours, spans, strict=True), start=1):
        words = f"contour {k} {x.name} {x.layer}".strip() + f": {number(x.path.length, 'm')}"
        words += f", {number_range(span.t, 's')}"
        found.append(Mark(x.path(0.0), words, x.path(0.0, 1)))
    return found


def _numbers(result: RunResult, sheet: Sheet) -> Iterator[str]:
    """The numbers of contours at their starts; none if there are too many or only one."""
    contours = result.path.contours
    if 1 < len(contours) <= MAX_NUMBERED:
        for k, x in enumerate(contours, start=1):
            right, down = sheet.place(x.path(0.0))
            yield f'<text class="number" x="{right + 6:.1f}" y="{down - 6:.1f}">{k}</text>'


def _corners(result: RunResult) -> list[Mark]:
    """The rounded corners."""
    known = (x.path.corners for x in result.path.contours if isinstance(x.path, RoundedPath))
    return [
        Mark(
            c.point[k],
            f"corner {k + 1}: {number(c.error[k], 'm')} off, radius {number(c.radius[k], 'm')}",
        )
        for c in known
        for k in np.flatnonzero(c.radius > 0).tolist()
    ]


def _stops(result: RunResult) -> list[Mark]:
    """Places inside contours at which the tool stops."""
    found = []
    for x, span in zip(result.path.contours, result.trajectory.contour_spans, strict=True):
        motion = span.trajectory
        if motion is None or motion.path is None:
            continue
        t = motion.breaks[1:-1]
        speeds = motion.s(t, 1)
        for s in motion.s(t[speeds < STILL * motion.s(motion.breaks, 1).max(initial=0.0)]):
            found.append(Mark(x.path(s), f"stop at s = {number(span.s[0] + s, 'm')}"))
    return found


def _events(result: RunResult) -> list[Mark]:
    """Outputs that are switched."""
    return [Mark(np.asarray(x.point), event_words(x)) for x in result.trajectory.events]


def event_words(x: Any) -> str:
    """An event with its time and place."""
    value = {True: "on", False: "off"}[x.value] if isinstance(x.value, bool) else x.value
    side = "before" if x.t < x.due else "after"
    lead = "" if x.t == x.due else f", {number(abs(x.due - x.t), 's')} {side} the tool is there"
    return f"{x.name} = {value}, t = {number(x.t, 's')}{lead}, s = {number(x.s, 'm')}"
