"""Arm files that name another arm, and what is different: payload, friction, drive inertias."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._text import show
from armcontour.arms.arm import Arm
from armcontour.arms.chain import Payload
from armcontour.errors import InvalidInput
from armcontour.io.robots.options import ArmOptions
from armcontour.io.robots.tree import MOST_CHARACTERS

KIND = "derived"
PAYLOAD = ("payload_mass", "payload_center", "payload_inertia")
PER_JOINT = ("armature", "viscous", "coulomb")
# Keys of the arm that it is derived from: a built-in name or a file, and what `load_arm` takes.
OF_ARM = ("name", "file", "tip", "base", "joint_limits")
KEYS = {"name", "kind", "source", "arm", *PAYLOAD, *PER_JOINT}

Values = Callable[[str, tuple[int, ...]], FloatArray]


def read_derived(
    file: str,
    data: Mapping[str, Any],
    values: Values,
    load: Callable[..., Arm],
) -> Arm:
    """The arm of a file that names another one.

    Args:
        file: Name of the file, for messages.
        data: Its keys.
        values: Numbers of a key in a given shape, from a quantity with value and unit.
        load: Loads the other arm, as `load_arm` does.

    Raises:
        InvalidInput: The file names no arm, or gives a part of a payload.
    """
    arm = load(*_arm(file, data))
    given = [x for x in PAYLOAD if x in data]
    changes: dict[str, Any] = {x: values(x, (arm.dof,)) for x in PER_JOINT if x in data}
    if given:
        if "payload_mass" not in data:
            raise InvalidInput(f"{file}: {given[0]} needs the payload_mass too.")
        inertia = np.zeros((3, 3))
        if "payload_inertia" in data:
            inertia = values("payload_inertia", (6,))[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
        changes["payload"] = Payload(
            mass=float(values("payload_mass", ())),
            center=values("payload_center", (3,)) if "payload_center" in data else np.zeros(3),
            inertia=inertia,
        )
    arm = arm.with_dynamics(**changes)
    if "name" in data:
        name = str(data["name"])
        _checks.check_name(f"name of the arm of {file}", name, most=MOST_CHARACTERS)
        arm = arm.with_name(name)
    return arm


def _arm(file: str, data: Mapping[str, Any]) -> tuple[str | FilePath, ArmOptions]:
    """The name or file, and the options, of the arm that another one is derived from.

    Raises:
        InvalidInput: It is not named, or by unknown keys.
    """
    given = data.get("arm")
    if isinstance(given, str):
        return given, ArmOptions()
    if not isinstance(given, Mapping) or not set(given) <= set(OF_ARM):
        raise InvalidInput(
            f"{file}: arm must be the name of a built-in arm, or a mapping with the keys "
            f"{', '.join(OF_ARM)}, not {show(given)}."
        )
    if ("name" in given) == ("file" in given) or not all(
        isinstance(x, str) for x in given.values()
    ):
        raise InvalidInput(f"{file}: arm takes either name, a built-in arm, or file, as texts.")
    folder, limits = FilePath(file).parent, given.get("joint_limits")
    options = ArmOptions(
        tip=given.get("tip"),
        base=given.get("base"),
        joint_limits=None if limits is None else folder / limits,
    )
    return folder / given["file"] if "file" in given else given["name"], options
