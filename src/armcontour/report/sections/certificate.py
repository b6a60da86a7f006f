"""The section on a certificate: what holds, for which model, and what it costs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.jobs.job import FREE
from armcontour.report.figure import Figure, make_trace
from armcontour.report.section import Section, Table, Tile
from armcontour.report.sections.program import MOST_ROWS
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

if TYPE_CHECKING:
    from armcontour.certification import Certificate


def certificate(found: Certificate) -> Section:
    """Error budget, cost in time, and derating of a certificate."""
    return Section(
        key="certificate",
        title="Certificate",
        text=(
            f"The fastest plan found whose execution holds the tolerance. It holds for "
            f"{found.model}. It does not cover collisions, flexibility, or any other model."
            + ("" if found.on_bodies is None else f" {found.on_bodies}")
            + (_SEVERAL if _several(found) else "")
        ),
        tiles=((found.run.name, _tiles(found)),),
        tables=(
            _budget(found),
            *_unknowns(found),
            _comparison(found),
            *([_contours(found)] if _several(found) else []),
        ),
        figures=(
            *([_errors_figure(found)] if _several(found) else []),
            _parts(found),
            _derating(found),
            _error(found),
        ),
        notes=_notes(found),
    )


# Smallest range of the axis of derated limits [%].
LEAST_RANGE = 1.0
_SEVERAL = (
    " Every contour is certified while the process is on, in the execution of the whole program; "
    "rapids only keep the limits of the joints."
)


def _several(found: Certificate) -> bool:
    """Whether the program has several contours."""
    return len(found.contours) > 1


def _free(found: Certificate) -> bool:
    """Whether the certified path was shaped."""
    return found.run.rounding is not None and found.run.rounding.free


def _tiles(found: Certificate) -> tuple[Tile, ...]:
    """Important figures of a certificate."""
    budget = found.budget
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
            note=(f"on {found.worst.name}; " if _several(found) else "")
            + "servo, command interval and box, of tool to path and path to tool",
        ),
        Tile(
            label="left of the tolerance",
            value=f"{budget.left * 1e3:.5f} mm",
            note=f"of {_mm(budget.servo_allowed if budget.allowed is None else budget.allowed)}",
        ),
        _demand(found),
        _derated(found),
        *([_certified_contours(found)] if _several(found) else []),
    )


def _derated(found: Certificate) -> Tile:
    """Tile with the joint whose acceleration limit is derated most."""
    worst = int(found.headroom.argmax())
    name = found.job.arm.joint_names[worst]
    at_most = f"at most {found.largest_headroom.max():.2%} of any joint"
    share = float(found.headroom[worst])
    # Less than what is shown is none.
    which = f"mean of {name}; " if share >= 5e-5 else "mean; "
    return Tile(label="acceleration derated", value=f"{share:.2%}", note=which + at_most)


def _saturated(found: Certificate, shares: FloatArray) -> str:
    """Joints that saturate, with their shares of the time."""
    known = zip(found.job.arm.joint_names, shares, strict=True)
    return ", ".join(f"{name} {x:.1%}" for name, x in known if x > 0) or "no joint"


def _demand(found: Certificate) -> Tile:
    """Tile with what drives need of their limits: acceleration, or torque of rigid bodies."""
    e = found.evaluation
    note = f"saturated: {_saturated(found, e.saturated)}"
    spreads = [x for x in (found.corners, found.spread) if x is not None]
    if found.linear is None:
        return Tile(label="joint demand / limit", value=f"{e.demand_ratio.max():.6f}", note=note)
    most = max([float(x.demand_ratio.max()) for x in spreads], default=None)
    return Tile(
        label="torque / limit, of the box",
        value="-" if most is None else f"{most:.4f}",
        note="nominal robot " + note,
    )


def _certified_contours(found: Certificate) -> Tile:
    """Tile with the number of certified contours."""
    pauses = f"; pauses {found.pauses * 1e3:.3g} ms" if found.pauses > 0 else ""
    return Tile(
        label="contours certified",
        value=f"{len(found.contours)}",
        note=f"{found.trials} plans tried{pauses}",
    )


def _budget(found: Certificate) -> Table:
    """Table of the parts of the error of the contour with the least margin."""
    budget = found.budget
    rows = [
        ("shape of the path" if _free(found) else "rounding of corners", _mm(budget.rounding)),
        ("servo, with a continuous command", _mm(budget.servo)),
        ("command interval", _mm(budget.sampling)),
    ]
    if found.corners is not None:
        rows.append(("worst robot of the box", _mm(budget.box)))
    if budget.unexplained:
        rows.append(("not explained by the servo model", _mm(budget.unexplained)))
    rows += [("sum", _mm(budget.total)), ("left", _mm(budget.left))]
    caption = f"On {found.worst.name}, which has the least left" if _several(found) else ""
    header = ("part of the contour error", "largest")
    return Table(header=header, rows=tuple(rows), caption=caption)


KINDS = {
    "payload": "payload",
    "friction": "friction",
    "kp": "gains of position loops",
    "kv": "gains of velocity loops",
    "armature": "inertias of drives",
    "dead time": "dead time",
    "sampling": "command interval, of the nominal robot",
}


def _unknowns(found: Certificate) -> list[Table]:
    """Table of what each unknown of rigid bodies takes; both figures of the worst robot."""
    linear = found.linear
    if linear is None or found.corners is None or found.spread is None:
        return []
    allowed = found.budget.servo_allowed
    rows = [
        (KINDS[kind], _mm(part), f"{part / allowed:.1%}") for kind, part in linear.shares.items()
    ]
    rows += [
        ("linear model, bound of all robots of the box", _mm(linear.bound), ""),
        (
            f"linear model, worst of {len(linear.drawn)} drawn robots",
            _mm(float(linear.drawn.max())),
            "",
        ),
        (f"MuJoCo, worst of {len(found.corners)} corners", _mm(found.corners.max.max()), ""),
        (f"MuJoCo, worst of {len(found.spread)} drawn robots", _mm(found.spread.max.max()), ""),
    ]
    caption = (
        f"What each unknown takes of the contour error of the worst robot ({linear.corner}), in "
        "the linear model, and the figures of both models"
    )
    header = ("unknown", "largest", "of the budget")
    return [Table(header=header, rows=tuple((a, b, c) for a, b, c in rows), caption=caption)]


def _contours(found: Certificate) -> Table:
    """Rows for all contours, or for those with the least margin, and a row for the program."""
    contours, optimum = list(found.contours), found.uncertified.duration
    caption = "Contours in order"
    if len(contours) > MOST_ROWS:
        contours = sorted(contours, key=lambda x: x.budget.left)[:MOST_ROWS]
        caption = (
            f"The {MOST_ROWS} of {len(found.contours)} contours with the least left; all are in "
            "summary.json"
        )
    rows = [
        (
            x.name,
            f"{x.t[0]:.3f} s",
            f"{x.duration:.4f} s",
            f"{(x.duration - x.optimum) * 1e3:+.1f} ms",
            _mm(x.budget.executed),
            _mm(x.error.rms),
            _mm(x.budget.left),
            f"{x.headroom.max():.2%}",
        )
        for x in contours
    ]
    error = found.evaluation.contour_error
    rows.append(
        (
            "whole program",
            "0.000 s",
            f"{found.duration:.4f} s",
            f"{(found.duration - optimum) * 1e3:+.1f} ms",
            _mm(found.budget.executed),
            _mm(error.rms),
            _mm(found.budget.left),
            f"{found.headroom.max():.2%}",
        )
    )
    header = (
        *("contour", "start", "motion", "to the optimum", "largest error", "RMS error", "left"),
        "derated, mean",
    )
    return Table(header=header, rows=tuple(rows), caption=caption)


def _errors_figure(found: Certificate) -> Any:
    """Figure of the largest error of every contour, and the allowed error."""
    contours = found.contours
    number = np.arange(1, len(contours) + 1)
    figure = Figure(
        make_trace(
            "bar",
            x=number,
            y=[x.budget.executed * 1e3 for x in contours],
            name="certified",
            marker={"color": EXECUTED_COLOUR},
            customdata=[x.name for x in contours],
            hovertemplate="%{customdata}: %{y:.5g} mm<extra></extra>",
        )
    )
    ends = [0.5, len(contours) + 0.5]
    allowed = found.budget.servo_allowed * 1e3
    figure.add_trace(line(ends, [allowed] * 2, "allowed", LIMIT_COLOUR, dash="dash", width=1.5))
    figure.update_xaxes(title="contour")
    if len(contours) <= MOST_ROWS:
        names = [x.name.removeprefix("contour ") for x in contours]
        figure.update_xaxes(tickvals=number, ticktext=names)
    figure.update_yaxes(type="log", title="largest contour error [mm]")
    return finish(figure, title="Errors of contours and allowed error", height=360)


def _comparison(found: Certificate) -> Table:
    """Table of the certified and the uncertified plan."""
    e, before = found.evaluation, found.uncertified
    header = ["", "motion", "largest error", "RMS error", "saturated"]
    rows: list[tuple[str, ...]] = [
        (
            "uncertified optimum",
            f"{before.duration:.4f} s",
            _mm(before.contour_error[0]),
            _mm(before.contour_error[1]),
            _saturated(found, before.saturated),
        ),
        (
            "certified",
            f"{found.duration:.4f} s",
            _mm(e.contour_error.max),
            _mm(e.contour_error.rms),
            _saturated(found, e.saturated),
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
            "certified, in the experiment on rigid bodies",
            f"{found.duration:.4f} s",
            _mm(e.contour_error.max),
            _mm(e.contour_error.rms),
            _saturated(found, e.saturated),
        )
        rows.append((*row, "") if found.corners is not None else row)
    return Table(header=tuple(header), rows=tuple(rows))


def _parts(found: Certificate) -> Any:
    """Figure of the parts of the error, with a logarithmic axis, because they differ widely."""
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
    figure = Figure(
        make_trace(
            "bar",
            x=list(shown),
            y=list(shown.values()),
            marker={"color": colours},
            hovertemplate="%{x}: %{y:.5g} mm<extra></extra>",
        )
    )
    figure.update_yaxes(type="log", title="largest part [mm]")
    return finish(figure, title="Parts of the contour error", height=360)


def _derating(found: Certificate) -> Any:
    """Figure of the usable share of every joint's acceleration limit along all contours."""
    figure = Figure()
    starts = np.cumsum([0.0, *(x.path.length for x in found.contours)])
    deratings = [x.derating for x in found.contours]
    # A gap after every contour.
    places = [
        np.append(start + (x.cells[:-1] + x.cells[1:]) / 2, start + x.cells[-1])
        for start, x in zip(starts[:-1], deratings, strict=True)
    ]
    for j, name in enumerate(found.job.arm.joint_names):
        shares = [np.append(x.share[:, j], np.nan) for x in deratings]
        s, left = thin(np.concatenate(places), np.concatenate(shares))
        figure.add_trace(line(s, left * 100, name, RUN_COLOURS[j % len(RUN_COLOURS)], width=1.5))
    figure.update_xaxes(
        title="arc length of the contours [m]" if _several(found) else "arc length [m]"
    )
    figure.update_yaxes(title="usable acceleration limit [%]")
    least = 100 * min(float(x.share.min()) for x in deratings)
    if least > 100 - LEAST_RANGE:
        # Rounding errors must not fill the height of the figure.
        figure.update_yaxes(range=[100 - LEAST_RANGE, 100 + LEAST_RANGE / 10])
    return finish(figure, title="Derating of limits", height=360)


def _error(found: Certificate) -> Any:
    """Figure of the contour error over time."""
    error = found.evaluation.contour_error
    t, values = thin(error.t, error.values)
    figure = Figure(line(t, values * 1e3, "nominal robot", EXECUTED_COLOUR, width=1.2))
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
    """Sentences on robots of the box, saturation and limits that were not checked."""
    notes = []
    for shape, duration in found.shapes.items():
        if (shape == FREE) != _free(found):
            kept = "the shape free" if _free(found) else "arcs at the corners"
            other = "arcs at the corners" if _free(found) else "the shape free"
            notes.append(f"Certified with {kept}: with {other} it takes at least {duration:.4f} s.")
    if found.spread is not None:
        drawn = found.spread
        where = f", {found.worst.name}" if _several(found) else ""
        notes.append(
            f"{len(drawn)} robots drawn from the box (seed {drawn.seed}){where}: the worst has a "
            f"contour error of {_mm(drawn.max.max())}."
        )
    if found.corners is not None:
        notes.append(
            f"{len(found.corners)} corners of the box: the worst has a contour error of "
            f"{_mm(found.corners.max.max())}."
        )
    notes += [f"Reduced: {x}." for x in found.lowered]
    if found.goal.saturation == "report":
        notes.append("Saturation was allowed; the certified execution includes it.")
    if found.check.not_judged:
        notes.append("Not checked: " + ", ".join(found.check.not_judged) + ".")
    notes += filter(None, [found.condition])
    return tuple(notes)


def _mm(value: float) -> str:
    """A length in mm as text."""
    return f"{value * 1e3:.5f} mm"
