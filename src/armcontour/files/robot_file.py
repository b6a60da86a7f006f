"""Files of limits and of an identified servo."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour._version import __version__
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.file_access import read_text
from armcontour.core.quantities import Angle, Length
from armcontour.core.render import figure
from armcontour.core.yaml_loader import load
from armcontour.files.file_keys import MappingKeys, SpecifiedKeys, read_keys
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.servo import ServoModel

if TYPE_CHECKING:
    from armcontour.control.identification import Estimate, Identification


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitsFile(Limits):
    """Keys of a limits file.

    Args:
        deviation: Largest distance of the tool from its path [m].
        orientation_deviation: Largest angle between the tool and its required orientation [rad].
    """

    deviation: Length | None = None
    orientation_deviation: Angle | None = None


def read_limits(file: str | FilePath, arm: Arm) -> tuple[Limits, float | None, float | None]:
    """Read limits from a YAML file.

    Limits that are not in the file are those of the arm. Infinity removes a limit, as in a job
    file.

    Returns:
        The limits, and the largest deviation from the path [m] and from the required orientation
        [rad]; None if the file does not specify it.

    Raises:
        InvalidInput: The file does not exist, is not YAML, or has an unknown key or invalid value.
    """
    location = FilePath(file)
    text = read_text(location, "limits file")
    data = load(text, location.name)
    if not isinstance(data, dict):
        raise InvalidInput(f"{location.name} must be a mapping of limits such as speed: 0.15 m/s.")
    if "joint_limits" in data:
        raise InvalidInput(
            f"{location.name} has joint limits of MoveIt, which belong to the arm. Specify it with "
            "arm.joint_limits of a job."
        )
    specified = read_keys(SpecifiedKeys(LimitsFile), data, location.name)
    deviations = [specified.pop(name, None) for name in ("deviation", "orientation_deviation")]
    with error_context(location.name):
        limits = resolve_limits(location.name, arm, Limits(**specified))
    return limits, *deviations


def read_servo(file: FilePath, dof: int) -> ServoModel:
    """Read the key `servo` of a YAML file, such as a job file or an identified servo.yaml."""
    data = load(read_text(file, "servo file"), file.name)
    if not isinstance(data, dict) or not isinstance(data.get("servo"), dict):
        raise InvalidInput(
            f"{file.name} has no key servo with gains. Specify a job file, or the servo.yaml of an "
            "identification."
        )
    servo: ServoModel = read_keys(MappingKeys(ServoModel), data["servo"], f"{file.name}: servo")
    return servo.for_joints(dof)


# Parameters with one value per joint in a servo file, and their comments (unit and meaning).
JOINT_PARAMETERS = {
    "kp": "1/s",
    "kv": "1/s",
    "ki": "1/s",
    "velocity_feedforward": "",
    "acceleration_feedforward": "",
    "friction": "rad",
    "dead_time": "s",
    "acceleration_limit": "rad/s^2; none means no saturation",
    "offset": "rad, static deviation (or encoder offset), which is not compensated",
    "model_error": "rad, with the offset, largest error on motion that was not fitted",
    "logged_velocity": "rad/s, largest velocity of this motion",
    "logged_acceleration": "rad/s^2, largest acceleration of this motion",
}
# Parameters with one value for all joints, and their comments.
SCALAR_PARAMETERS = {
    "contour_ratio": "contour error with / without compensation, on motion that was not fitted",
    "programs": "number of programs from which contour_ratio was determined",
    "drive_cycle": "s",
}


def servo_yaml(identification: Identification) -> str:
    """YAML text of the key `servo` of a job file, with identified values and their intervals."""
    servo = identification.servo_model()
    lines = [
        f"# Identified from {identification.source} by armcontour {__version__}. Copy it into a "
        "job file.",
        *(
            f"# {x.note}"
            if x.note
            else f"# {x.name}: {'effective ' * x.effective}"
            + "; ".join(map(_estimate_text, x.estimates))
            for x in identification.joints
        ),
        *(f"# {x.saturation}" for x in identification.joints if x.saturation),
        *([f"# {servo.doubt}"] if servo.doubt else []),
        *servo_lines(servo, len(identification.joints)),
    ]
    return "\n".join(lines) + "\n"


def servo_values(identification: Identification) -> dict[str, Any]:
    """Values of the key `servo` of a job file, as `servo_yaml` writes them."""
    return dict(load(servo_yaml(identification), "servo")["servo"])


def servo_lines(servo: ServoModel, dof: int) -> list[str]:
    """Lines of YAML with the key `servo`, with one value per joint."""
    orders = [servo.order] * dof if isinstance(servo.order, str) else servo.order
    lines = ["servo:", f"  order: [{', '.join(orders)}]"]
    for name, unit in JOINT_PARAMETERS.items():
        values = getattr(servo, name)
        if values is not None:
            listed = ["none" if math.isinf(x) else f"{float(x):.6g}" for x in values]
            lines.append(f"  {name}: [{', '.join(listed)}]{f'    # {unit}' if unit else ''}")
    for name, unit in SCALAR_PARAMETERS.items():
        if (value := getattr(servo, name)) is not None:
            lines.append(f"  {name}: {value:.6g}    # {unit}")
    return [*lines, f"  interpolation: {servo.interpolation}"]


def _estimate_text(estimate: Estimate) -> str:
    """Text with the value and the interval of an estimate, for a comment."""
    if not estimate.determined:
        return f"{estimate.label} not determined"
    return f"{estimate.label} {figure(estimate.row)} {estimate.row.note}".rstrip()
