"""Write identified servo parameters as the key `servo` of a job file, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from armcontour._version import __version__
from armcontour.identification import (
    Estimate,
    Identification,
    JointIdentification,
    Prediction,
)
from armcontour.io.json_text import to_json
from armcontour.servo import ServoModel

# Attributes of an estimate, of a joint and of a prediction in the JSON file.
OF_PARAMETER = "name unit value sd low high determined".split()
OF_JOINT = (
    "determined effective tracking_rms rms largest unseen_rms share unexplained scaling noise "
    "written note saturation"
).split()
OF_PREDICTION = "tracking_rms rms largest".split()
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
    "unexplained": "rad, largest error on motion that was not fitted",
    "logged_velocity": "rad/s, largest one of that motion",
    "logged_acceleration": "rad/s^2",
}
# Parameters with one value.
SINGLE = {
    "contour_ratio": "contour error with compensation over without, on motion that was not fitted",
    "programs": "programs on which it was determined",
    "cycle": "s",
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


def identification_json(
    found: Identification, predictions: Sequence[Prediction] = (), files: Sequence[str] = ()
) -> str:
    """All results of an identification as JSON, without the samples of the log.

    Args:
        found: The identification.
        predictions: Predictions of other logs.
        files: The files of the result, relative to its folder.
    """
    joints = [
        {
            **{x: getattr(joint, x) for x in ("name", "order")},
            "parameters": [{x: getattr(y, x) for x in OF_PARAMETER} for y in joint.estimates],
            **{x: getattr(joint, x) for x in OF_JOINT},
            "contour_ratio": ratio,
        }
        for joint, ratio in zip(found.joints, found.judgement.joints, strict=True)
    ]
    page: dict[str, Any] = {
        "version": __version__,
        "logs": [x.source for x in found.logs],
        "samples": sum(len(x.t) for x in found.logs),
        "interpolation": found.interpolation,
        "cycle": found.cycle,
        "determined": found.determined,
        "judgement": {x: getattr(found.judgement, x) for x in ("programs", "ratio", "errors")},
        "joints": joints,
    }
    if predictions:
        page["predictions"] = [
            {
                "log": x.log.source,
                **{name: getattr(x, name).tolist() for name in OF_PREDICTION},
            }
            for x in predictions
        ]
    if files:
        page["files"] = list(files)
    return to_json(page)


def _list(values: Any) -> str:
    """Numbers as a list in YAML; `none` is infinity."""
    return "[" + ", ".join("none" if math.isinf(x) else f"{float(x):.6g}" for x in values) + "]"


def _ranges(joint: JointIdentification) -> str:
    """Estimates of a joint with their ranges, for a comment."""
    return "effective " * joint.effective + "; ".join(_range(x) for x in joint.estimates)


def _range(x: Estimate) -> str:
    """An estimate with its range and unit, for a comment."""
    scale, unit = x.shown
    name = x.name.replace("_", " ")
    if not x.determined:
        return f"{name} not determined"
    ends = f"{x.value * scale:.5g} [{x.low * scale:.5g}, {x.high * scale:.5g}]"
    return f"{name} {ends} {unit}".rstrip()
