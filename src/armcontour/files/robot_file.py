"""Write an identified robot: an arm file, and its servo as keys of a job file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import yaml

from armcontour._version import __version__
from armcontour.control.identification import BodyIdentification, Estimate
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import read_text
from armcontour.core.render import jsonable
from armcontour.core.yaml_layout import load
from armcontour.files.keys import Keys, read_keys
from armcontour.robot.servo import ServoModel


def robot_yaml(found: BodyIdentification, arm: str | Mapping[str, str], folder: FilePath) -> str:
    """The identified arm as an arm file: another arm, with payload, friction and drive inertias.

    Args:
        found: The identification.
        arm: The nominal arm: a built-in name, or `file` with `tip` and the like.
        folder: Folder of the arm file, to which `file` will be relative.
    """
    chain = found.arm.dynamics.chain
    base: Any = arm if isinstance(arm, str) else _relative(arm, folder)
    page: dict[str, Any] = {
        "name": found.arm.name,
        "kind": "derived",
        "source": f"identified from {found.source} by armcontour {__version__}",
        "arm": base,
    }
    load_of = chain.payload
    if load_of is not None:
        x, y, z = found.payload_center
        page["payload_mass"] = _quantity(load_of.mass, "kg", [found.payload_mass])
        page["payload_center"] = _quantity(load_of.center, "m", [x, y, z])
        if load_of.inertia.any():
            six = load_of.inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
            page["payload_inertia"] = _quantity(six, "kg m^2", [])
    factor = found.parameters.get("armature")
    inertias = [x.armature for x in found.joints] if factor is None else [factor]
    page["armature"] = _quantity(chain.armature, "kg m^2", inertias)
    if factor is not None:
        page["armature"]["source"] += " times those of the nominal arm" * factor.determined
    page["viscous"] = _quantity(chain.viscous, "N m s/rad", [x.viscous for x in found.joints])
    page["coulomb"] = _quantity(chain.coulomb, "N m", [x.coulomb for x in found.joints])
    return yaml.safe_dump(page, sort_keys=False, width=96, allow_unicode=True)


def robot_servo_yaml(found: BodyIdentification) -> str:
    """The key `servo` of a job file, with identified values.

    Raises:
        InvalidInput: A gain is neither told nor known.
    """
    servo = found.servo_model()
    lines = [
        f"# Identified from {found.source} by armcontour {__version__}: goes into a job file, with "
        "robot.yaml as its arm.",
        "# inertia is J, by which the controller scales its loops: a log shows only its products "
        "with gains.",
        *(f"# {joint.name}: {_ranges((joint.kp, joint.kv))}" for joint in found.joints),
        "servo:",
        "  order: second",
        f"  kp: {_list(servo.kp)}    # 1/s",
        f"  kv: {_list(servo.kv)}    # 1/s",
        f"  inertia: {_list(servo.inertia)}    # kg m^2",
        f"  dead_time: {_list(servo.for_joints(len(found.joints)).dead_time)}    # s",
        f"  interpolation: {servo.interpolation}",
    ]
    return "\n".join(lines) + "\n"


def read_servo(file: FilePath, dof: int) -> ServoModel:
    """The key `servo` of a YAML file, such as a job file or an identified servo.yaml.

    Args:
        file: The file.
        dof: Number of joints.

    Raises:
        InvalidInput: Not YAML, no key `servo`, or values that make no servo.
    """
    data = load(read_text(file, "servo file"), file.name)
    if not isinstance(data, dict) or not isinstance(data.get("servo"), dict):
        raise InvalidInput(
            f"{file.name} has no key servo with gains: give a job file, or the servo.yaml of an "
            "identification."
        )
    servo: ServoModel = read_keys(Keys(ServoModel), data["servo"], f"{file.name}: servo")
    return servo.for_joints(dof)


def _relative(arm: Mapping[str, str], folder: FilePath) -> dict[str, str]:
    """Files of an arm relative to a folder."""
    files = ("file", "joint_limits")
    return {
        key: FilePath(os.path.relpath(value, folder)).as_posix() if key in files else value
        for key, value in arm.items()
    }


def _quantity(values: Any, unit: str, estimates: Sequence[Estimate]) -> dict[str, Any]:
    """A quantity of an arm file, whose source says how well each value is known."""
    array: FloatArray = values
    rounded = jsonable(array)
    told = _ranges(estimates) if estimates else ""
    kept = [x for x in estimates if not x.determined]
    source = f"identified, 95 % intervals: {told}" if len(kept) < len(estimates) else "nominal"
    if not estimates:
        source = "nominal"
    return {"value": rounded, "unit": unit, "source": source}


def _list(values: Any) -> str:
    """Numbers as a list in YAML."""
    return "[" + ", ".join(f"{float(x):.9g}" for x in values) + "]"


def _ranges(estimates: Sequence[Estimate]) -> str:
    return "; ".join(
        f"{x.low:.5g} to {x.high:.5g}" if x.determined else "nominal" for x in estimates
    )
