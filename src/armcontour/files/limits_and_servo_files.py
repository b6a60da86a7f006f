"""Files with limits, and with an identified servo."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour._version import __version__
from armcontour.core.errors import InvalidInput, error_context, key_context
from armcontour.core.fields import quantities
from armcontour.core.file_access import read_text
from armcontour.core.quantities import Angle, Length, PartialFields, shared_unit
from armcontour.core.render import figure
from armcontour.core.yaml_loader import load
from armcontour.files.file_keys import read_keys
from armcontour.files.servo_presets import ServoKey
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.servo import ServoModel

if TYPE_CHECKING:
    from armcontour.control.identification import Estimate, Identification, JointIdentification

# Comments on parameters of a servo file, after their units.
COMMENTS = {
    "acceleration_limit": "none means no saturation",
    "offset": "static deviation (or encoder offset), which is not compensated",
    "model_error": "with the offset, largest error on motion that was not fitted",
    "logged_velocity": "largest velocity of this motion",
    "logged_acceleration": "largest acceleration of this motion",
    "logged_frequency": "smallest acceleration / velocity of one log",
    "contour_ratio": "contour error with / without compensation, on motion that was not fitted",
    "program_ratio": "the same in the logs of programs, without multisines",
    "programs": "number of programs from which contour_ratio was determined",
    "kp_spread": "relative standard deviation of kp",
    "kv_spread": "relative standard deviation of kv",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitsFile(Limits):
    """Keys of a limits file.

    Args:
        deviation: Largest distance of the tool from its path [m].
        orientation_deviation: Largest angle between the tool and its required orientation [rad].
    """

    deviation: Length | None = None
    orientation_deviation: Angle | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionRequirements:
    """Requirements that a motion is checked against."""

    limits: Limits
    deviation: float | None = None  # Largest distance of the tool from its path [m]
    # Largest angle between the tool and its required orientation [rad]
    orientation_deviation: float | None = None


def read_limits(file: str | FilePath, arm: Arm) -> MotionRequirements:
    """Read the limits and the largest deviations that a motion must satisfy, from a YAML file.

    Infinity removes a limit, as in a job file.

    Args:
        file: The file.
        arm: Arm that moves; it supplies the limits that the file lacks.

    Returns:
        The limits in SI units, and the largest deviations from the path and from the tool
        orientation, which are None if the file lacks them.

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
    with error_context(location.name):
        specified = read_keys(PartialFields(LimitsFile), data)
    deviation = specified.pop("deviation", None)
    orientation_deviation = specified.pop("orientation_deviation", None)
    with error_context(location.name):
        limits = resolve_limits(location.name, arm, Limits(**specified))
    return MotionRequirements(
        limits=limits, deviation=deviation, orientation_deviation=orientation_deviation
    )


def read_servo(file: FilePath, dof: int) -> ServoModel:
    """Read the key `servo` of a YAML file, such as a job file or an identified servo.yaml."""
    data = load(read_text(file, "servo file"), file.name)
    if not isinstance(data, dict) or not isinstance(data.get("servo"), dict | str):
        raise InvalidInput(
            f"{file.name} has no key servo with gains. Specify a job file, or the servo.yaml of an "
            "identification."
        )
    with error_context(file.name), key_context("servo"):
        servo: ServoModel = read_keys(ServoKey, data["servo"])
        return servo.for_joints(dof)


def servo_yaml(identification: Identification, assumed: ServoModel | None = None) -> str:
    """Write the key `servo` of a job file as YAML, with identified values and their intervals.

    `assumed`: servo of the joints that no log moves; by default they have no model.
    """
    servo = identification.servo_model(assumed)
    keeps_assumed = assumed is not None
    lines = [
        f"# Identified from {identification.source} by armcontour {__version__}. Copy it into a "
        "job file.",
        *(f"# {_describe_joint(x, keeps_assumed)}" for x in identification.joints),
        *(f"# {x.saturation}" for x in identification.joints if x.saturation),
        *([f"# {servo.doubt}"] if servo.doubt else []),
        *servo_lines(servo, [x.prismatic for x in identification.joints]),
    ]
    return "\n".join(lines) + "\n"


def _describe_joint(joint: JointIdentification, keeps_assumed: bool) -> str:
    """Describe in one line what was identified of a joint.

    `keeps_assumed`: whether joints that no log moves have an assumed servo.
    """
    if keeps_assumed and not joint.moves:
        return f"{joint.name} does not move in the logs and keeps its assumed servo."
    if joint.note:
        return joint.note
    estimates = "; ".join(map(_estimate_text, joint.estimates))
    return f"{joint.name}: {'effective ' * joint.effective}{estimates}"


def servo_values(
    identification: Identification, assumed: ServoModel | None = None
) -> dict[str, Any]:
    """Return the values that `servo_yaml` writes, by the keys in `servo`."""
    return dict(load(servo_yaml(identification, assumed), "servo")["servo"])


def servo_lines(servo: ServoModel, prismatic: Sequence[bool]) -> list[str]:
    """Return the lines of YAML with the key `servo`, with one value per joint."""
    orders = [servo.order] * len(prismatic) if isinstance(servo.order, str) else servo.order
    lines = ["servo:", f"  order: [{', '.join(orders)}]", f"  interpolation: {servo.interpolation}"]
    units = {name: x.unit for name, x in quantities(ServoModel).items() if x.unit != "1"}
    units = {name: shared_unit(x, prismatic) for name, x in units.items()}
    for name in (x.name for x in fields(servo) if x.name not in ("order", "interpolation")):
        value = getattr(servo, name)
        comment = ", ".join(x for x in (units.get(name), COMMENTS.get(name)) if x)
        if isinstance(value, np.ndarray):
            listed = ["none" if math.isinf(x) else f"{float(x):.6g}" for x in value]
            lines.append(f"  {name}: [{', '.join(listed)}]{f'    # {comment}' if comment else ''}")
        elif isinstance(value, str):
            lines.append(f"  {name}: {json.dumps(value, ensure_ascii=False)}")
        elif value is not None:
            lines.append(f"  {name}: {value:.6g}    # {comment}")
    return lines


def _estimate_text(estimate: Estimate) -> str:
    """Return the label, value and interval of an estimate, for a comment in a servo file."""
    if not estimate.determined:
        return f"{estimate.label} not determined"
    return f"{estimate.label} {figure(estimate.row)} {estimate.row.note}".rstrip()
