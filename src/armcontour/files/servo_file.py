"""Write identified servo parameters as the key `servo` of a job file."""

from __future__ import annotations

import math
from typing import Any

from armcontour._version import __version__
from armcontour.control.identification import Estimate, Identification, JointIdentification
from armcontour.core.render import figure
from armcontour.core.yaml_layout import load
from armcontour.robot.servo import ServoModel

# Parameters with one value per joint in a servo file, with their units.
LISTS = {
    "kp": "1/s",
    "kv": "1/s",
    "ki": "1/s",
    "velocity_feedforward": "",
    "acceleration_feedforward": "",
    "friction": "rad",
    "dead_time": "s",
    "acceleration_limit": "rad/s^2; none: it never saturates",
    "model_error": "rad, largest error on motion that was not fitted",
    "logged_velocity": "rad/s, largest one of that motion",
    "logged_acceleration": "rad/s^2",
}
# Parameters with one value.
SINGLE = {
    "contour_ratio": "contour error with compensation over without, on motion that was not fitted",
    "programs": "programs on which it was determined",
    "drive_cycle": "s",
}


def servo_yaml(found: Identification) -> str:
    """The key `servo` of a job file, with identified values.

    Raises:
        InvalidInput: The logs determine the servo of no joint.
    """
    servo = found.servo_model()
    lines = [
        f"# Identified from {found.source} by armcontour {__version__}: goes into a job file.",
        *(f"# {x.note or f'{x.name}: {_ranges(x)}'}" for x in found.joints),
        *(f"# {x.saturation}" for x in found.joints if x.saturation),
        *([f"# {servo.doubt}"] if servo.doubt else []),
        *servo_lines(servo, len(found.joints)),
    ]
    return "\n".join(lines) + "\n"


def servo_values(found: Identification) -> dict[str, Any]:
    """The values of the key `servo` of a job file, as `servo_yaml` writes them.

    Raises:
        InvalidInput: As `servo_yaml`.
    """
    return dict(load(servo_yaml(found), "servo")["servo"])


def servo_lines(servo: ServoModel, dof: int) -> list[str]:
    """The key `servo` with one value per joint, as lines of YAML."""
    orders = [servo.order] * dof if isinstance(servo.order, str) else servo.order
    lines = ["servo:", f"  order: [{', '.join(orders)}]"]
    for name, unit in LISTS.items():
        values = getattr(servo, name)
        if values is not None:
            lines.append(f"  {name}: {_list(values)}{f'    # {unit}' if unit else ''}")
    for name, unit in SINGLE.items():
        if (value := getattr(servo, name)) is not None:
            lines.append(f"  {name}: {value:.6g}    # {unit}")
    return [*lines, f"  interpolation: {servo.interpolation}"]


def _list(values: Any) -> str:
    """Numbers as a list in YAML; `none` is infinity."""
    return "[" + ", ".join("none" if math.isinf(x) else f"{float(x):.6g}" for x in values) + "]"


def _ranges(joint: JointIdentification) -> str:
    """Estimates of a joint with their ranges, for a comment."""
    return "effective " * joint.effective + "; ".join(_range(x) for x in joint.estimates)


def _range(x: Estimate) -> str:
    """An estimate with its range, for a comment."""
    if not x.determined:
        return f"{x.label} not determined"
    return f"{x.label} {figure(x.row)} {x.row.note}".rstrip()
