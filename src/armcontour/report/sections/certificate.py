"""The certificate: what holds, on which model, and what it cost."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.certification import Certificate
from armcontour.report.section import Section, Table, Tile
from armcontour.report.style import (
    EXECUTED_COLOUR,
    LIMIT_COLOUR,
    PATH_COLOUR,
    PLANNED_COLOUR,
    RUN_COLOURS,
    finish,
    line,
    thin,
)


def certificate(found: Certificate) -> Section:
    """Its parts, its cost, and where acceleration was held back."""
    return Section(
        key="certificate",
        title="Certificate",
        text=(
            f"The fastest plan found whose execution holds the tolerance. It holds for "
            f"{found.model}. It says nothing of collisions, of flexibility, or of any other model."
        ),
        tiles=((found.run.name, _tiles(found)),),
        tables=(_budget(found), _compared(found)),
        figures=(_parts(found), _held(found), _error(found)),
        notes=_notes(found),
    )


def _tiles(found: Certificate) -> tuple[Tile, ...]:
    budget, e = found.budget, found.evaluation
    optimum = found.uncertified.duration
    return (
        Tile(
            label="certified motion",
            value=f"{found.duration:.4f} s",
            note=f"{found.cost * 1e3:+.1f} ms ({found.cost / optimum:+.2%}) to the optimum",
        ),
        Tile(
            label="contour error, largest",
            value=f"{budget.executed * 1e3:.5f} mm",
            note="servo, command interval and box",
        ),
        Tile(
            label="left of the tolerance",
            value=f"{budget.left * 1e3:.5f} mm",
            note=f"of {_mm(budget.servo_allowed if budget.allowed is None else budget.allowed)}",
        ),
        Tile(
            label="joint demand / limit",
            value=f"{e.demand_ratio.max():.6f}",
            note="saturated " + ", ".join(f"{x:.1%}" for x in e.saturated) + " of the time",
        ),
        Tile(
            label="acceleration held back",
            value=", ".join(f"{x:.2%}" for x in found.headroom),
            note="mean; at most " + ", ".join(f"{x:.1%}" for x in found.largest_headroom),
        ),
        Tile(
            label="smoothing",
            value=" + ".join(f"{x * 1e3:.3g}" for x in found.windows) + " ms"
            if found.windows
            else "none",
            note=f"moving averages of s(t); {found.trials} plans tried",
        ),
    )


def _budget(found: Certificate) -> Table:
    budget = found.budget
    rows = [
        ("rounding of corners", _mm(budget.rounding)),
        ("servo, with a continuous command", _mm(budget.servo)),
        ("command interval", _mm(budget.sampling)),
    ]
    if found.corners is not None:
        rows.append(("worst robot of the box", _mm(budget.box)))
    rows += [("sum", _mm(budget.total)), ("left", _mm(budget.left))]
    return Table(header=("part of the contour error", "largest"), rows=tuple(rows))


def _compared(found: Certificate) -> Table:
    e, before = found.evaluation, found.uncertified
    header = ["", "motion", "largest error", "RMS error", "saturated"]
    rows: list[tuple[str, ...]] = [
        (
            "uncertified optimum",
            f"{before.duration:.4f} s",
            _mm(before.contour_error[0]),
            _mm(before.contour_error[1]),
            ", ".join(f"{x:.1%}" for x in before.saturated),
        ),
        (
            "certified",
            f"{found.duration:.4f} s",
            _mm(e.contour_error.max),
            _mm(e.contour_error.rms),
            ", ".join(f"{x:.1%}" for x in e.saturated),
        ),
    ]
    if found.corners is not None and before.box is not None:
        header.append("worst of the box")
        rows = [
            (*x, _mm(y)) for x, y in zip(rows, (before.box, found.budget.executed), strict=True)
        ]
    if found.experiment is not None:
        e = found.experiment.evaluation
        row = (
            "certified, on rigid bodies",
            f"{found.duration:.4f} s",
            _mm(e.contour_error.max),
            _mm(e.contour_error.rms),
            ", ".join(f"{x:.1%}" for x in e.saturated),
        )
        rows.append((*row, "") if found.corners is not None else row)
    return Table(header=tuple(header), rows=tuple(rows))


def _parts(found: Certificate) -> Any:
    """The budget's parts side by side; logarithmic, for they differ by thousands."""
    import plotly.graph_objects as go

    budget = found.budget
    parts = {
        "rounding": budget.rounding,
        "servo": budget.servo,
        "command interval": abs(budget.sampling),
        "box": budget.box,
        "left": budget.left,
    }
    shown = {name: value * 1e3 for name, value in parts.items() if value > 0}
    colours = [RUN_COLOURS[k % len(RUN_COLOURS)] for k in range(len(shown))]
    figure = go.Figure(
        go.Bar(
            x=list(shown),
            y=list(shown.values()),
            marker={"color": colours},
            hovertemplate="%{x}: %{y:.5g} mm<extra></extra>",
        )
    )
    figure.update_yaxes(type="log", title="largest part [mm]")
    return finish(figure, title="Parts of the contour error", height=360)


def _held(found: Certificate) -> Any:
    """What is left of every joint's acceleration limit along the path."""
    import plotly.graph_objects as go

    held, figure = found.held, go.Figure()
    middle = (held.cells[:-1] + held.cells[1:]) / 2
    for j, name in enumerate(found.job.arm.joint_names):
        s, left = thin(middle, held.share[:, j])
        figure.add_trace(line(s, left * 100, name, RUN_COLOURS[j % len(RUN_COLOURS)], width=1.5))
    figure.update_xaxes(title="arc length [m]")
    figure.update_yaxes(title="acceleration limit left [%]")
    return finish(figure, title="What was held back", height=360)


def _error(found: Certificate) -> Any:
    import plotly.graph_objects as go

    error = found.evaluation.contour_error
    t, values = thin(error.t, error.values)
    figure = go.Figure(line(t, values * 1e3, "nominal robot", EXECUTED_COLOUR, width=1.2))
    allowed = found.budget.servo_allowed * 1e3
    ends = [0.0, float(t[-1])]
    if found.corners is not None:
        worst = np.full(2, found.budget.executed * 1e3)
        figure.add_trace(line(ends, worst, "worst robot of the box", PLANNED_COLOUR, width=1.5))
    figure.add_trace(line(ends, [allowed] * 2, "allowed", LIMIT_COLOUR, dash="dash", width=1))
    figure.update_xaxes(title="time [s]")
    figure.update_yaxes(title="contour error [mm]")
    figure.update_layout(plot_bgcolor="white", legend={"font": {"color": PATH_COLOUR}})
    return finish(figure, title="Contour error of the execution", height=360)


def _notes(found: Certificate) -> tuple[str, ...]:
    notes = []
    if found.spread is not None:
        drawn = found.spread
        notes.append(
            f"{len(drawn)} robots drawn from the box (seed {drawn.seed}): the worst has a contour "
            f"error of {_mm(drawn.max.max())}."
        )
    if found.corners is not None:
        notes.append(
            f"{len(found.corners)} corners of the box: the worst has a contour error of "
            f"{_mm(found.corners.max.max())}."
        )
    if found.goal.saturation == "report":
        notes.append("Saturation was allowed, and is part of the execution that is certified.")
    if found.check.not_judged:
        notes.append("Not judged: " + ", ".join(found.check.not_judged) + ".")
    return tuple(notes)


def _mm(value: float) -> str:
    return f"{value * 1e3:.5f} mm"
