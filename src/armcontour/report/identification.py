"""The report of an identification as one HTML page: motion and residuals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._describing import digits
from armcontour.identification import (
    Estimate,
    Identification,
    RobotIdentification,
)
from armcontour.identification.results import JOINT_HEADINGS, joint_cells
from armcontour.report.figure import Figure, render_page
from armcontour.report.style import (
    EXECUTED_COLOUR,
    LIMIT_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
    thin,
)

SYMBOLS = {
    "kp": "K_p",
    "kv": "K_v",
    "ki": "k_i",
    "dead_time": "dead time",
    "velocity_feedforward": "velocity feed-forward",
    "acceleration_feedforward": "acceleration feed-forward",
    "acceleration_limit": "acceleration limit",
    "friction": "friction",
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "payload_mass": "payload, mass",
    "payload_center_x": "payload, centre along x",
    "payload_center_y": "payload, centre along y",
    "payload_center_z": "payload, centre along z",
    "armature": "inertia of drives",
}


# Time between logs in the figures [s].
APART = 1.0


def render_identification(found: Identification) -> str:
    """Render the report of an identification as one HTML page without other files."""
    joints = [
        {
            "joint": joint,
            "rows": [_row(x) for x in joint.estimates],
            "figures": _figures(found, j),
        }
        for j, joint in enumerate(found.joints)
    ]
    table = [joint_cells(*x) for x in zip(found.joints, found.judgement.joints, strict=True)]
    return render_page(
        "identification.html", found=found, joints=joints, headings=JOINT_HEADINGS, table=table
    )


def render_robot(found: RobotIdentification) -> str:
    """Render the report of the identification of a robot as one HTML page."""
    joints = [
        {
            "joint": joint,
            "rows": [_row(x) for x in joint.estimates],
            "figures": _robot_figures(found, j),
        }
        for j, joint in enumerate(found.joints)
    ]
    return render_page(
        "robot_identification.html",
        found=found,
        rows=[_row(x) for x in found.common],
        joints=joints,
    )


def _robot_figures(found: RobotIdentification, j: int) -> list[Any]:
    """The figures of one joint: lag and residuals of every log."""
    figures, name = [], found.joints[j].name
    for x in found.fitted:
        figure = Figure()
        command = np.interp(x.t, x.log.t, x.log.command[:, j])
        for values, what, colour in (
            (command - x.measured[:, j], "command less measured", EXECUTED_COLOUR),
            (command - x.simulated[:, j], "command less simulated", PLANNED_COLOUR),
            (x.residuals[:, j], "measured less simulated", LIMIT_COLOUR),
        ):
            t, y = thin(x.t, values * 1e3)
            figure.add_trace(line(t, y, what, colour, width=1))
        figure.update_xaxes(title="t [s]")
        figure.update_yaxes(title="[mrad]")
        figures.append(finish(figure, title=f"{name}, {x.log.source}: lag", height=320))
    return figures


def _row(x: Estimate) -> tuple[str, ...]:
    """An estimate as cells of a table."""
    scale, unit = x.shown

    def shown(value: float) -> str:
        return f"{value * scale:.5g}" if math.isfinite(value) else "–"

    ends = [shown(x.low), shown(x.high)]
    if math.isfinite(x.low) != math.isfinite(x.high):
        ends = [f"above {ends[0]}" if math.isfinite(x.low) else f"below {ends[1]}"]
    return (
        SYMBOLS[x.name],
        shown(x.value),
        digits(x.sd * scale, 2) if math.isfinite(x.sd) else "–",
        " to ".join(ends) if any(map(math.isfinite, (x.low, x.high))) else "–",
        unit,
        "yes" if x.determined else "no",
    )


def _figures(found: Identification, j: int) -> list[Any]:
    """Figures of a joint: measured and predicted position, and residual, where not fitted."""
    joint = found.joints[j]
    if not joint.rests:
        return []
    gap, start, parts = np.full((1, 3), np.nan), 0.0, []
    for log, rest in zip(found.logs, joint.rests, strict=True):
        y = log.measured[:, j]
        parts += [np.stack([log.t - log.t[0] + start, y, rest], axis=1), gap]
        start += log.t[-1] - log.t[0] + APART
    times, measured, rests = np.concatenate(parts).T
    motion, residual = Figure(), Figure()
    for figure, curve, name, colour in (
        (motion, measured, "measured", EXECUTED_COLOUR),
        (motion, measured - rests, "predicted from the other parts", PLANNED_COLOUR),
        (residual, rests * 1e3, "residual", LIMIT_COLOUR),
    ):
        t, y = thin(times, curve)
        figure.add_trace(line(t, y, name, colour, width=1.5))
    for figure, unit in ((motion, "position [rad]"), (residual, "residual [mrad]")):
        figure.update_xaxes(title="t [s]")
        figure.update_yaxes(title=unit)
    return [
        finish(motion, title=f"{joint.name}: measured and predicted where not fitted"),
        finish(residual, title=f"{joint.name}: residuals where not fitted", height=320),
    ]
