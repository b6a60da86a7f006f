"""Figure of the moves and events of a program over time."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from armcontour.jobs import RunResult
from armcontour.motion import Span
from armcontour.report.figure import Figure, make_trace
from armcontour.report.sections.program_picture import said
from armcontour.report.style import PATH_COLOUR, finish

# Rows from the top, with the colours of their bars.
ROWS = {"contour": "#0072B2", "rapid": PATH_COLOUR, "dwell": "#E69F00"}
PATTERNS = {"contour": "", "rapid": "/", "dwell": "x"}
LABELS = {"contour": "contours", "rapid": "rapids", "dwell": "dwells"}
# Gap between moves, as a share of the time, below which the moves are drawn as one.
FINEST = 1 / 1500
MOST_TICKS = 2000
# Margin before and after, as a share of the time, so that an event at the start is visible.
EDGE = 0.01


def timeline(name: str, result: RunResult) -> Any:
    """Bars for moves and ticks for events over the time of a run."""
    figure = Figure()
    plan = result.trajectory
    labels = []
    for kind, colour in ROWS.items():
        bars = merge_moves([x for x in plan.spans if x.kind == kind], FINEST * plan.duration)
        if not bars:
            continue
        labels.append(LABELS[kind])
        figure.add_trace(
            make_trace(
                "bar",
                name=LABELS[kind],
                orientation="h",
                y=[LABELS[kind]] * len(bars),
                base=[x[0] for x in bars],
                x=[x[1] - x[0] for x in bars],
                text=[x[2] for x in bars],
                textposition="none",
                hovertemplate="%{text}<extra></extra>",
                marker={
                    "color": colour,
                    "pattern": {"shape": PATTERNS[kind], "fgcolor": "#FFFFFF", "size": 5},
                    # Edges make short bars visible and separate neighbours.
                    "line": {"color": "#FFFFFF" if len(bars) < 200 else colour, "width": 0.6},
                },
            )
        )
    events = plan.events[:: -(-len(plan.events) // MOST_TICKS)] if plan.events else ()
    if events:
        labels.append("events")
        figure.add_trace(
            make_trace(
                "scatter",
                name="events",
                mode="markers",
                x=[x.t for x in events],
                y=["events"] * len(events),
                text=[said(x) for x in events],
                hovertemplate="%{text}<extra></extra>",
                marker={
                    "symbol": "line-ns",
                    "size": 18,
                    "line": {"width": 1.6, "color": "#222222"},
                    "color": "#222222",
                },
            )
        )
    figure.update_layout(barmode="overlay", bargap=0.25)
    finish(figure, title=f"Run {name}: moves and events over time", height=170 + 38 * len(labels))
    figure.update_layout(showlegend=False)
    figure.update_xaxes(title="time [s]", range=[-EDGE * plan.duration, (1 + EDGE) * plan.duration])
    figure.update_yaxes(categoryorder="array", categoryarray=labels[::-1], ticks="")
    return figure


def merge_moves(spans: Sequence[Span], finest: float) -> list[tuple[float, float, str]]:
    """Start, end and hover text of bars; moves that are too close to see are merged."""
    if not spans:
        return []
    short = np.array([x.t[1] - x.t[0] for x in spans]) < 2 * finest
    gaps = np.array([b.t[0] - a.t[1] for a, b in zip(spans[:-1], spans[1:], strict=True)])
    apart = (gaps >= finest) | ~(short[:-1] & short[1:])
    groups = np.split(np.arange(len(spans)), np.flatnonzero(apart) + 1)
    return [
        (spans[x[0]].t[0], spans[x[-1]].t[1], _words(spans, int(x[0]), int(x[-1]))) for x in groups
    ]


def _words(spans: Sequence[Span], first: int, last: int) -> str:
    """Hover text of the moves first to last."""
    kind, start, end = spans[first].kind, spans[first].t[0], spans[last].t[1]
    times = f"<br>{start:.3f} to {end:.3f} s"
    if last > first:
        return f"{LABELS[kind]} {first + 1} to {last + 1}{times}"
    name = spans[first].name
    return f"{kind} {first + 1}" + (f": {escape(name)}" if name else "") + times
