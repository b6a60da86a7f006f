"""The report of an identification as one HTML page: motion and residuals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

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


def render_identification(found: Identification) -> str:
    """Render the report of an identification as one HTML page without other files."""
    joints = [
        {
            "joint": joint,
            "rows": [_row(x) for x in joint.estimates],
            "figures": _figures(joint),
        }
        for joint in found.joints
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


def _figures(joint: JointIdentification) -> list[Any]:
    """Figures of a joint: measured and predicted position, and residual, where not fitted."""
    if not len(joint.t):
        return []
    motion, residual = Figure(), Figure()
    for curve, name, colour in (
        (joint.measured, "measured", EXECUTED_COLOUR),
        (joint.unseen, "predicted from the other parts", PLANNED_COLOUR),
    ):
        t, y = thin(joint.t, curve)
        motion.add_trace(line(t, y, name, colour, width=1.5))
    off = (joint.measured - joint.unseen) * 1e3
    t, off = thin(joint.t, off)
    residual.add_trace(line(t, off, "residual", LIMIT_COLOUR, width=1))
    for figure, unit in ((motion, "position [rad]"), (residual, "residual [mrad]")):
        figure.update_xaxes(title="t [s]")
        figure.update_yaxes(title=unit)
    return [
        finish(motion, title=f"{joint.name}: measured and predicted where not fitted"),
        finish(residual, title=f"{joint.name}: residuals where not fitted", height=320),
    ]
