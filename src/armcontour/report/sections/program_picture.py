"""Figure of a program: contours by layer, leads, rapids, start points and events."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.core.render import number, number_range
from armcontour.jobs import Job, RunResult
from armcontour.motion import TimedEvent
from armcontour.program import Contour, Process, Program, cut_parts
from armcontour.report.figure import Figure, make_trace
from armcontour.report.outline import fine_places, finely, outlines, simplify
from armcontour.report.sections.bodies import in_space, line_in_space
from armcontour.report.style import LAYER_COLOURS, LEAD_COLOUR, PATH_COLOUR, finish, line

# Layers after the longest ones, which have colours.
OTHER_COLOUR = "#000000"
KERF_COLOUR, DRAWN_COLOUR = "rgba(120, 120, 120, 0.35)", "#000000"
# Points along every rapid, which is a curve in space.
RAPID_PLACES = 24
# Largest number of markers; more markers overlap and are slow to draw.
MOST_MARKERS = 1500
# Largest number of contours with a second arrow in their middle.
MOST_ARROWED = 60
# Largest number of contours with a number at their start.
MOST_NUMBERED = 60
# Number of markers of one kind from which they are drawn smaller, and the factor.
MANY = 100
SMALLER = 0.5
# Length of the arrows in space, in sizes of the picture.
ARROW = 0.025
# Symbols of events, by name in turn: switched on, and switched off or to a value.
SYMBOLS_ON = ("circle", "square", "diamond", "cross")
SYMBOLS_OFF = ("circle-open", "square-open", "diamond-open", "x")
SUFFIXES = {1: "st", 2: "nd", 3: "rd"}
# Look of lines in the plane, and in space, where plotly restarts dashes at every point.
LOOKS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "rapids": ({"width": 1.2, "dash": "dash"}, {"width": 2}),
    "leads": ({"width": 1.8}, {"width": 4}),
    "contours": ({"width": 2.2}, {"width": 5}),
    "drawn": ({"width": 1.2, "dash": "dot"}, {"width": 2}),
}
ON_COLOUR, OFF_COLOUR, VALUE_COLOUR = "#009E73", "#D55E00", "#CC79A7"


def picture(result: RunResult, job: Job) -> tuple[Any, tuple[str, ...]]:
    """Figure of the planned tool path of a program, and sentences on what is left out."""
    program, figure = result.path, Figure()
    flat = program.dimension == 2
    leads = "leads" if any(x.active for x in job.process.leads) else "leads, tool off"
    drawn = [x for x in job.program.contours if job.process.of_layer(x.layer).kerf]
    curves = [
        *_draw("rapids", _rapids(result), "rapids", PATH_COLOUR, flat),
        *_draw_kerf(program, job.process),
        *_draw("leads", _leads(program), leads, LEAD_COLOUR, flat),
    ]
    for name, colour, points in split_layers(program):
        curves += _draw("contours", points, name, colour, flat)
    curves += _draw("drawn", _outline(drawn) if drawn else None, "as drawn", DRAWN_COLOUR, flat)
    everywhere = np.concatenate([coordinates_of(x, program.dimension) for x in curves])
    starts, first = _starts(result, program)
    arrows = (arrows_in_plane if flat else arrows_in_space)(starts, everywhere)
    events, second = mark_events(result.trajectory.events, flat)
    for trace in (*curves, *arrows, *number_contours(program), *events):
        figure.add_trace(trace)
    lay_out(figure, everywhere, flat=flat, title="The program {}, as planned")
    return figure, tuple(note for note in (first, second) if note)


def _draw(look: str, points: FloatArray | None, name: str, colour: str, flat: bool) -> list[Any]:
    """The trace of a curve in the plane or in space; none without points [m]."""
    draw = draw_in_plane if flat else draw_in_space
    return [] if points is None else [draw(points, name, colour, **LOOKS[look][not flat])]


def lay_out(figure: Any, points: FloatArray, *, flat: bool, title: str) -> None:
    """Set the axes of the picture of a program.

    Args:
        figure: The figure.
        points: All points that are drawn [mm], (n, 2) or (n, 3).
        flat: Whether the program is in the plane.
        title: Title with a place for "in the plane" or "in space".
    """
    if flat:
        figure.update_xaxes(title="x [mm]")
        figure.update_yaxes(title="y [mm]", scaleanchor="x")
        finish(figure, title=title.format("in the plane"), height=640)
        return
    in_space(figure, points, title=title.format("in space"), height=680)


def draw_in_plane(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    """A curve in the plane, from points in m."""
    mm = points * 1e3
    return line(mm[:, 0], mm[:, 1], name, colour, hoverinfo="skip", **look)


def draw_in_space(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    """A curve in space, from points in m."""
    return line_in_space(points * 1e3, name, colour, **look)


def coordinates_of(trace: Any, dimension: int) -> FloatArray:
    """Points of a curve, (n, dimension) [mm]."""
    return np.stack([trace.x, trace.y] + ([trace.z] if dimension == 3 else []), axis=1)


def split_layers(program: Program) -> list[tuple[str, str, FloatArray]]:
    """Name, colour and points [m] of the contours of every layer, without leads."""
    lengths: dict[str, float] = {}
    for x in program.contours:
        lengths[x.layer] = lengths.get(x.layer, 0.0) + x.path.length
    if len(lengths) == 1:
        (layer,) = lengths
        name = f"contours on {layer}" if layer else "contours"
        return [(escape(name), LAYER_COLOURS[0], _outline(program.contours))]
    # The longest layers get colours; the legend has the order of the drawing.
    largest = sorted(lengths, key=lambda x: -lengths[x])[: len(LAYER_COLOURS)]
    found = []
    named = [x for x in lengths if x in largest]
    for layer, colour in zip(named, LAYER_COLOURS, strict=False):
        on = [x for x in program.contours if x.layer == layer]
        name = f"layer {layer}" if layer else "no layer"
        found.append((escape(name), colour, _outline(on)))
    rest = [x for x in program.contours if x.layer not in largest]
    if rest:
        name = f"{len(lengths) - len(named)} other layers"
        found.append((name, OTHER_COLOUR, _outline(rest)))
    return found


def _outline(contours: Sequence[Contour]) -> FloatArray:
    """Points of contours without leads."""
    return outlines([finely(x.path, *x.at_work) for x in contours])


def _draw_kerf(program: Program, process: Process) -> list[Any]:
    """The bands of material that the kerf takes away; none without a kerf."""
    parts = cut_parts(program, process)
    if not parts:
        return []
    places = [fine_places(path, begin, end) for path, begin, end, _ in parts]
    kept = simplify([path(s) for (path, *_), s in zip(parts, places, strict=True)])
    bands = []
    for (path, _, _, kerf), s, few in zip(parts, places, kept, strict=True):
        # Both tangents at every place, so that a corner has both of its edges.
        tangents = np.stack([path(s[few], 1, side=x) for x in ("left", "right")], axis=1)
        tangents = tangents.reshape(-1, program.dimension)
        if program.dimension == 2:
            across = np.column_stack([-tangents[:, 1], tangents[:, 0]])
        else:
            across = np.cross(process.up, tangents)
        across *= kerf / 2 / np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
        points = np.repeat(path(s[few]), 2, axis=0)
        bands.append((1e3 * (points + across), 1e3 * (points - across)))
    kerfs = {number(kerf, "m") for *_, kerf in parts}
    name = f"kerf, {kerfs.pop()}" if len(kerfs) == 1 else "kerf"
    look = {"name": name, "showlegend": True, "hoverinfo": "skip"}
    if program.dimension == 2:
        gap = np.full((1, 2), np.nan)
        rings = [x for left, right in bands for x in (left, right[::-1], left[:1], gap)]
        x, y = np.concatenate(rings).astype(np.float32).T
        look |= {"mode": "lines", "line": {"width": 0}, "fill": "toself"}
        return [make_trace("scatter", x=x, y=y, fillcolor=KERF_COLOUR, **look)]
    x, y, z = np.concatenate([y for both in bands for y in both]).astype(np.float32).T
    corners, first = [], 0
    for left, right in bands:
        k = first + np.arange(len(left) - 1)
        other = k + len(left)
        corners += [np.stack([k, k + 1, other]), np.stack([k + 1, other + 1, other])]
        first += len(left) + len(right)
    i, j, k = np.concatenate(corners, axis=1).astype(np.int32)
    return [make_trace("mesh3d", x=x, y=y, z=z, i=i, j=j, k=k, color=KERF_COLOUR, **look)]


def _leads(program: Program) -> FloatArray | None:
    """Points of all leads; None without leads."""
    found = []
    for x in program.contours:
        begin, end = x.at_work
        if begin > 1e-9:
            found.append(finely(x.path, 0.0, begin))
        if x.path.length - end > 1e-9:
            found.append(finely(x.path, end))
    return outlines(found) if found else None


def _rapids(result: RunResult) -> FloatArray | None:
    """Points of all rapids; None without rapids."""
    plan, arm = result.trajectory, result.arm
    spans = [x for x in plan.spans if x.kind == "rapid"]
    if not spans:
        return None
    times = np.concatenate([np.linspace(*x.t, RAPID_PLACES) for x in spans])
    points = arm.tool_position(plan(times, side="left"))
    return outlines(np.split(points, len(spans)))


def _starts(
    result: RunResult, program: Program
) -> tuple[list[tuple[FloatArray, FloatArray, str]], str]:
    """Arrows at starts of contours: point [m], direction and hover text; and a note, or ""."""
    spans = result.trajectory.contour_spans
    every = -(-len(spans) // MOST_MARKERS)
    found = []
    for k in range(0, len(spans), every):
        x, span = program.contours[k], spans[k]
        said = f"contour {k + 1}" + (f": {escape(x.name)}" if x.name else "")
        said += f"<br>layer {escape(x.layer)}" if x.layer else ""
        said += f"<br>{number(x.path.length, 'm')}, {number_range(span.t, 's')}"
        places = [0.0, x.path.length / 2] if len(spans) <= MOST_ARROWED else [0.0]
        found += [(x.path(s), x.path(s, 1), said) for s in places]
    if every == 1:
        return found, ""
    return found, f"In the picture every {_ordinal(every)} contour has an arrow at its start."


def number_contours(program: Program) -> list[Any]:
    """The numbers of contours at their starts; none if there are too many or only one."""
    if not 1 < len(program.contours) <= MOST_NUMBERED:
        return []
    points = np.array([x.path(0.0) for x in program.contours]) * 1e3
    kind = "scatter" if program.dimension == 2 else "scatter3d"
    return [
        make_trace(
            kind,
            **dict(zip("xyz", points.astype(np.float32).T, strict=False)),
            mode="text",
            name="numbers",
            text=[str(k + 1) for k in range(len(points))],
            textposition="top right",
            showlegend=False,
            hoverinfo="skip",
        )
    ]


def arrows_in_plane(
    starts: list[tuple[FloatArray, FloatArray, str]], everywhere: FloatArray
) -> list[Any]:
    """Arrows in the plane, as markers."""
    points = np.array([x[0] for x in starts]) * 1e3
    # Angles of markers count clockwise from the vertical.
    angles = [float(np.degrees(np.arctan2(x[1][0], x[1][1]))) for x in starts]
    return [
        make_trace(
            "scatter",
            x=points[:, 0].astype(np.float32),
            y=points[:, 1].astype(np.float32),
            mode="markers",
            name="start and direction",
            text=[x[2] for x in starts],
            hovertemplate="%{text}<extra></extra>",
            marker={
                "symbol": "arrow",
                "size": 11 * (SMALLER if len(starts) > MANY else 1.0),
                "angle": angles,
                "color": "#222222",
                "line": {"width": 0.5, "color": "#FFFFFF"},
            },
        )
    ]


def arrows_in_space(
    starts: list[tuple[FloatArray, FloatArray, str]], everywhere: FloatArray
) -> list[Any]:
    """Arrows in space, as lines."""
    size = ARROW * float(np.nanmax(np.nanmax(everywhere, 0) - np.nanmin(everywhere, 0)))
    points = np.array([x[0] for x in starts]) * 1e3
    along = np.array([x[1] for x in starts])
    # Horizontal vectors perpendicular to the directions.
    side = np.cross(along, [0.0, 0.0, 1.0])
    upright = np.linalg.norm(side, axis=1) < 1e-6
    side[upright] = [1.0, 0.0, 0.0]
    side /= np.linalg.norm(side, axis=1)[:, None]
    back = points - size * along
    wings = [back + size / 2 * side, points, back - size / 2 * side, np.full_like(points, np.nan)]
    heads = np.stack(wings, axis=1).reshape(-1, 3)
    x, y, z = points.astype(np.float32).T
    return [
        line_in_space(heads, "start and direction", "#222222", width=4),
        make_trace(
            "scatter3d",
            x=x,
            y=y,
            z=z,
            mode="markers",
            marker={"size": 2.5, "color": "#222222"},
            text=[x[2] for x in starts],
            hovertemplate="%{text}<extra></extra>",
            showlegend=False,
        ),
    ]


def mark_events(events: Sequence[TimedEvent], flat: bool) -> tuple[list[Any], str]:
    """Markers of events, a trace per name and kind of value; and a note, or ""."""
    every = -(-len(events) // MOST_MARKERS) if events else 1
    groups: dict[tuple[str, str], list[TimedEvent]] = {}
    for x in events[::every]:
        kind = (
            {True: "on", False: "off"}.get(x.value, "set") if isinstance(x.value, bool) else "set"
        )
        groups.setdefault((x.name, kind), []).append(x)
    names = list(dict.fromkeys(name for name, _ in groups))
    traces = [
        _mark(name, kind, found, names.index(name), flat) for (name, kind), found in groups.items()
    ]

    note = f"In the picture only every {_ordinal(every)} event is marked." if every > 1 else ""
    return traces, note


def _mark(name: str, kind: str, events: list[TimedEvent], k: int, flat: bool) -> Any:
    """Markers of the events of one name and kind of value."""
    points = np.array([x.point for x in events]) * 1e3
    scale = SMALLER if len(events) > MANY else 1.0
    symbols = SYMBOLS_ON if kind == "on" else SYMBOLS_OFF
    marker = {
        "symbol": symbols[k % len(symbols)],
        "size": (10 if kind == "on" else 14) * scale if flat else 5 * scale,
        "color": {"on": ON_COLOUR, "off": OFF_COLOUR, "set": VALUE_COLOUR}[kind],
        "line": {"width": 2 * scale if kind != "on" and flat else 0.5},
    }
    common: dict[str, Any] = {
        "mode": "markers",
        "name": escape(f"{name} {kind}"),
        "marker": marker,
        "text": [said(x) for x in events],
        "hovertemplate": "%{text}<extra></extra>",
    }
    kind = "scatter" if flat else "scatter3d"
    at = dict(zip("xyz", points.astype(np.float32).T, strict=False))
    return make_trace(kind, **at, **common)


def _ordinal(n: int) -> str:
    """A number as an ordinal: 1st, 2nd, 3rd, 4th."""
    last = 0 if 10 < n % 100 < 14 else n % 10
    return f"{n}{SUFFIXES.get(last, 'th')}"


def said(x: TimedEvent) -> str:
    """The hover text of an event."""
    value = {True: "on", False: "off"}[x.value] if isinstance(x.value, bool) else x.value
    lead = "" if x.t == x.due else f", {number(abs(x.due - x.t), 's')} {_side(x)} the tool is there"
    return f"{escape(x.name)} = {escape(str(value))}<br>t = {x.t:.4f} s{lead}<br>s = {x.s:.4f} m"


def _side(x: TimedEvent) -> str:
    """Whether an event is switched before or after the tool is at its position."""
    return "before" if x.t < x.due else "after"
