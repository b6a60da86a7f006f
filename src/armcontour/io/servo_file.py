"""Write identified servo parameters as keys of a job file, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.identification import Estimate, Identification, Prediction
from armcontour.io.json_text import to_json

# Attributes of an estimate and of a joint in the JSON file.
OF_PARAMETER = "name unit value sd low high determined".split()
OF_JOINT = (
    "determined rms r_squared largest_demand saturated_time "
    "tracking_rms predicted_rms explained notes"
).split()
OF_PREDICTION = "tracking_rms rms explained".split()


def servo_yaml(found: Identification) -> str:
    """The keys `servo` and `limits` of a job file, with identified values.

    Raises:
        InvalidInput: The log does not determine the servo.
    """
    servo = found.servo_model()
    lines = [
        f"# Identified from {found.log.source} by armcontour {__version__}: goes into a job file.",
        *(f"# {joint.name}: {_ranges(joint.estimates)}" for joint in found.joints),
        "# Not explained by the model, RMS, in parts of the log that were predicted from others:",
        f"#   {_list([1e3 * x.predicted_rms for x in found.joints])} mrad",
        "servo:",
        f"  order: {servo.order}",
        f"  kp: {_list(servo.kp)}    # 1/s",
    ]
    if servo.kv is not None:
        lines.append(f"  kv: {_list(servo.kv)}    # 1/s")
    lines += [
        f"  dead_time: {_list(servo.dead_time)}    # s",
        *(
            f"  {name}: {_list(getattr(servo, name))}"
            for name in ("velocity_feedforward", "acceleration_feedforward")
            if getattr(servo, name).any()
        ),
        f"  interpolation: {servo.interpolation}",
    ]
    limits = [x.acceleration for x in found.joints]
    if all(x.determined for x in limits):
        lines += [
            "limits:",
            f"  joint_acceleration: {_list([x.value for x in limits])}    # rad/s^2",
        ]
    else:
        lines.append("# Not every acceleration limit is determined, so none is given.")
    return "\n".join(lines) + "\n"


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
            **{x: getattr(joint, x) for x in ("name", "order", "start")},
            "parameters": [{x: getattr(y, x) for x in OF_PARAMETER} for y in joint.estimates],
            **{x: getattr(joint, x) for x in OF_JOINT},
        }
        for joint in found.joints
    ]
    page: dict[str, Any] = {
        "version": __version__,
        "log": found.log.source,
        "samples": len(found.log.t),
        "interpolation": found.interpolation,
        "determined": found.determined,
        "joints": joints,
    }
    if predictions:
        page["predictions"] = [
            {
                "log": x.log.source,
                **{name: getattr(x, name).tolist() for name in OF_PREDICTION},
                "largest": np.abs(x.errors).max(axis=0).tolist(),
            }
            for x in predictions
        ]
    if files:
        page["files"] = list(files)
    return to_json(page)


def _list(values: Any) -> str:
    """Numbers as a list in YAML."""
    return "[" + ", ".join(f"{float(x):.6g}" for x in values) + "]"


def _ranges(estimates: Sequence[Estimate]) -> str:
    """Estimates with their ranges, for a comment."""
    return "; ".join(_range(x) for x in estimates)


def _range(x: Estimate) -> str:
    """An estimate with its range and unit, for a comment."""
    scale, unit = (1e3, "ms") if x.name == "dead_time" else (1.0, x.unit)
    name = x.name.replace("_", " ")
    if not x.determined:
        return f"{name} not determined"
    return f"{name} {x.value * scale:.5g} [{x.low * scale:.5g}, {x.high * scale:.5g}] {unit}"
