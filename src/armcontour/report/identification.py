"""The report of an identification as one HTML page: motion and residuals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._describing import digits
from armcontour.identification import (
    Estimate,
    Identification,
    JointIdentification,
    RobotIdentification,
)
from armcontour.report.figure import Figure, render_page
from armcontour.report.style import (
    EXECUTED_COLOUR,
    LIMIT_COLOUR,
    PATH_COLOUR,
    PLANNED_COLOUR,
    finish,
    line,
    thin,
)

SYMBOLS = {
    "kp": "K_p",
    "kv": "K_v",
    "dead_time": "dead time",
    "velocity_feedforward": "velocity feed-forward",
    "acceleration": "acceleration limit",
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "payload_mass": "payload, mass",
    "payload_center_x": "payload, centre along x",
    "payload_center_y": "payload, centre along y",
    "payload_center_z": "payload, centre along z",
    "armature": "inertia of drives",
}


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
    return render_page("identification.html", found=found, joints=joints)


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
    """The figures of one joint."""
    joint, log = found.joints[j], found.log
    return [
        _motion(joint, log.t, log.command[:, j], log.measured[:, j]),
        _residuals(joint),
    ]


def _motion(
    joint: JointIdentification, t: FloatArray, command: FloatArray, measured: FloatArray
) -> Any:
    """Figure of command, measured and simulated position of a joint."""
    figure = Figure()
    for curve, name, colour in (
        ((t, command), "command", PATH_COLOUR),
        ((t, measured), "measured", EXECUTED_COLOUR),
        ((joint.t, joint.simulated), "simulated", PLANNED_COLOUR),
    ):
        x, y = thin(*curve)
        figure.add_trace(line(x, y, name, colour, width=1.5))
    figure.update_xaxes(title="t [s]")
    figure.update_yaxes(title="position [rad]")
    return finish(figure, title=f"{joint.name}: command, measured and simulated")


def _residuals(joint: JointIdentification) -> Any:
    """Figure of the residuals of a joint."""
    x, y = thin(joint.t, joint.residuals * 1e3)
    figure = Figure(line(x, y, "measured less simulated", EXECUTED_COLOUR, width=1))
    figure.update_xaxes(title="t [s]")
    figure.update_yaxes(title="residual [mrad]")
    return finish(figure, title=f"{joint.name}: residuals", height=320)
