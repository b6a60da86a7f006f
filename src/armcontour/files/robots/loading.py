"""`load_arm`: load a built-in arm, an arm file or a robot description."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache, partial
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks, file_access, yaml_loader
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.frames import Frame, Pose, from_rpy
from armcontour.core.text import plain_number, show
from armcontour.files.robots.arm_options import (
    ANY,
    DESCRIPTION,
    MAX_CHARACTERS,
    MJCF,
    MODEL,
    ArmOptions,
    check_options,
    is_description,
    is_model,
)
from armcontour.robot.arm import Arm
from armcontour.robot.chain import Chain, Payload
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE, Limits
from armcontour.robot.limits import UNITS as LIMIT_UNITS
from armcontour.robot.planar import LinkTube, PlanarTwoLink
from armcontour.robot.scene import ArmShapes, LinkShape, Mesh
from armcontour.robot.serial import SerialArm

# Largest depth of derived arm files; a deeper chain refers to itself.
MAX_DERIVED = 16
UNITS = {
    "base": "m",
    "links": "m",
    "outer_diameter": "m",
    "wall": "m",
    "density": "kg/m^3",
    "positions": "m",
    "angles": "rad",
    "axes": "1",
    "tip": "m",
    "tip_angles": "rad",
    "masses": "kg",
    "centers": "m",
    "inertias": "kg m^2",
    "inertia_angles": "rad",
    "armature": "kg m^2",
    "viscous": "N m s/rad",
    "coulomb": "N m",
    "gravity": "m/s^2",
    "payload_mass": "kg",
    "payload_center": "m",
    "payload_inertia": "kg m^2",
}
# Arm files write powers as ^2 and ^3.
LIMITS = {
    name: LIMIT_UNITS[name].replace("²", "^2").replace("³", "^3")
    for name in (*JOINT_LIMITS, *JOINT_RANGE)
}
# Lengths in files of hulls are whole numbers of this [m].
STEP = 1e-6


@checks.explained
def arm_names() -> tuple[str, ...]:
    """Names of the built-in arms.

    >>> "ur5e" in ac.arm_names()
    True
    """
    folder = resources.files("armcontour.files.robots") / "library"
    return tuple(sorted(x.name[:-5] for x in folder.iterdir() if x.name.endswith(".yaml")))


@checked
def load_arm(
    name: str | FilePath | Any,
    options: ArmOptions = ArmOptions(),
    *,
    tool: Pose | None = None,
    work: Pose | None = None,
    payload: Payload | None = None,
    trust_xacro: bool = False,
) -> Arm:
    """Load an arm by its built-in name, such as "ur5e", from a file or from a model.

        arm = load_arm("ur5e", tool=pinocchio.SE3(rotation, position))
        own = load_arm(model, ArmOptions(tip="tool0"))

    >>> ac.load_arm("ur5e", tool=ac.Frame((0.0, 0.0, 0.1))).dof
    6

    Args:
        name: Built-in name, arm file (.yaml), robot description (.urdf, .xacro), MJCF file (.xml,
            read by MuJoCo, without shapes) or `pinocchio.Model`. Case and hyphens of
            built-in names are ignored.
        options: Options, such as ArmOptions(tip="tool0") for a robot description.
        tool: The tool frame relative to the tip: a Frame, a 4 by 4 transform, a pinocchio.SE3 or a
            position [m].
        work: The frame of tool points relative to the base, in the same forms.
        payload: Payload at the tip.
        trust_xacro: Whether a .xacro file may be expanded. Such a file is a program that can run
            any code: trust only files that you would run.

    Raises:
        InvalidInput: No such arm or file, an option that its kind does not have, a .xacro file that
            is not trusted, or a file that does not describe an arm.
    """
    if not is_model(name):
        name = checks.read_file_path("load_arm", name)
    arm = _load(name, options, payload, trust_xacro)
    arm = _equip(arm, tool, work, payload)
    return arm if options.srdf is None else with_more_shapes(arm, srdf=FilePath(options.srdf))


def _load(
    name: Any, options: ArmOptions, payload: Payload | None, trust_xacro: bool, depth: int = 0
) -> Arm:
    """Load an arm without the tool, the work frame and the SRDF that `load_arm` adds."""
    file = FilePath("") if is_model(name) else FilePath(name)
    if is_description(file):
        from armcontour.files.robots.urdf import arm_of_tree, read_description

        check_options(options, DESCRIPTION, str(file))
        return arm_of_tree(read_description(file, options, trust_xacro=trust_xacro), options)
    if is_model(name) or file.suffix.lower() in MJCF:
        from armcontour.files.robots.external_models import arm_of_mjcf, arm_of_model

        check_options(options, MODEL, "the model" if is_model(name) else str(file))
        return arm_of_model(name, options) if is_model(name) else arm_of_mjcf(file, options)
    check_options(options, ANY, f"The arm {name}")
    derive = partial(_load, payload=payload, trust_xacro=trust_xacro, depth=depth + 1)
    arm = _read(str(name), payload, derive if depth < MAX_DERIVED else None)
    if options.limits_file is None:
        return arm
    from armcontour.files.robots.moveit_limits import limits_of, override, table_of

    table = table_of(arm.limits, arm.dof)
    override(table, arm.joint_names, options.limits_file)
    # The file has joint limits only; the arm keeps its other limits.
    replaced = limits_of(table, arm.joint_names, str(options.limits_file))
    values = {key: getattr(replaced, key) for key in table}
    lifted: dict[str, Any] = {key: np.inf for key, x in values.items() if x is None}
    return arm.with_limits(Limits().replace(**values | lifted))


def _read(name: str, payload: Payload | None, load: Callable[..., Arm] | None) -> Arm:
    """Read a built-in arm or an arm file, by the arguments of `arm_of`."""
    if name.lower().endswith((".yaml", ".yml")):
        content = file_access.read_bytes(name, "arm file")
        return arm_of(name, yaml_loader.load(content, name, yaml_loader.AngleLoader), payload, load)
    built_in = name.lower().replace("-", "")
    if built_in not in arm_names():
        raise InvalidInput(
            f"There is no built-in arm {name!r}: the built-in arms are {', '.join(arm_names())}; "
            "your own arm goes in a .yaml, .urdf, .xacro or MJCF .xml file."
        )
    arm = arm_of(f"{built_in}.yaml", _built_in(built_in), payload)
    return arm.with_shapes(partial(read_hulls, built_in)) if _file(built_in).is_file() else arm


def _equip(arm: Arm, tool: Pose | None, work: Pose | None, payload: Payload | None) -> Arm:
    """The arm with a tool, a work frame and a payload; None keeps those of the arm."""
    if isinstance(arm, SerialArm):
        if tool is not None or payload is not None:
            arm = arm.with_tool(arm.chain.tool if tool is None else tool, payload)
        return arm if work is None else arm.with_work(work)
    if tool is not None or work is not None:
        raise InvalidInput(
            f"The arm {arm.name} moves in the plane and takes no tool or work frame: move the path "
            "instead."
        )
    return arm


UNITS |= LIMITS
# "not_kept" is for readers of the file: published limits that armcontour does not use.
COMMON = {"name", "kind", "source", "limits", "assumed", "not_kept"}
PLANAR = COMMON | {"base", "links", "tubes"}
BODIES = ("masses", "centers", "inertias")
OPTIONAL = ("tip", "tip_angles", "inertia_angles", "armature", "viscous", "coulomb", "gravity")
SERIAL = COMMON | {"joints", "positions", "angles", "axes", *BODIES, *OPTIONAL}
PAYLOAD = ("payload_mass", "payload_center", "payload_inertia")
PER_JOINT = ("armature", "viscous", "coulomb")
DERIVED = {"name", "kind", "source", "arm", *PAYLOAD, *PER_JOINT}
KINDS = {"planar_two_link": PLANAR, "serial": SERIAL, "derived": DERIVED}
# Keys of the original arm of a derived one: a built-in name or a file, and options.
OF_ARM = ("name", "file", "tip", "base", "joint_limits")


@cache
def _built_in(name: str) -> Any:
    """The data of a built-in arm, read-only; cached, because parsing takes most of the time."""
    file = f"{name}.yaml"
    content = (resources.files("armcontour.files.robots") / "library" / file).read_bytes()
    return yaml_loader.load(content, file, yaml_loader.AngleLoader)


def arm_of(
    file: str, data: Any, payload: Payload | None = None, load: Callable[..., Arm] | None = None
) -> Arm:
    """The arm of an arm file's data."""
    kind = data.get("kind") if isinstance(data, Mapping) else None
    keys = KINDS.get(kind) if isinstance(kind, str) else None
    if keys is None:
        raise InvalidInput(
            f"{file} does not describe an arm: it takes keys such as name and source, and its kind "
            f"must be {' or '.join(KINDS)}."
        )
    if not set(data) <= keys:
        raise InvalidInput(
            f"{file} does not describe an arm of the kind {kind}: it takes the keys "
            f"{', '.join(sorted(keys))}, not {', '.join(str(x) for x in set(data) - keys)}."
        )
    if kind == "derived":
        if load is None:
            raise InvalidInput(
                f"{file} names an arm file that leads back to it: name the arm that differs."
            )
        return _derived(file, data, load)
    return _serial(file, data) if kind == "serial" else _planar(file, data, payload)


def _planar(file: str, data: Mapping[str, Any], payload: Payload | None) -> PlanarTwoLink:
    """The planar arm of an arm file."""
    links = _array(file, "links", data, (2,)).tolist()
    return PlanarTwoLink(
        **_common(file, data),
        base=_value(file, "base", data),
        links=(links[0], links[1]),
        tubes=_tubes(file, data["tubes"]) if "tubes" in data else None,
        payload=payload,
        assumed=str(data.get("assumed", "")),
    )


def _tubes(file: str, data: Any) -> tuple[LinkTube, LinkTube]:
    """The two tubes of a planar arm."""
    keys = ("outer_diameter", "wall", "density")
    if not isinstance(data, Mapping) or set(data) != set(keys):
        raise InvalidInput(f"{file}: tubes take the keys {', '.join(keys)}.")
    values = {key: _array(file, key, data, (2,)) for key in keys}
    first, second = (LinkTube(**{key: values[key][k] for key in keys}) for k in range(2))
    return first, second


def _serial(file: str, data: Mapping[str, Any]) -> SerialArm:
    """The serial arm of an arm file."""
    joints = data.get("joints")
    if not isinstance(joints, list) or not all(isinstance(x, str) for x in joints) or not joints:
        raise InvalidInput(f"{file}: joints must be the names of the joints.")
    for joint in joints:
        checks.check_name(f"name of a joint of {file}", joint, longest=MAX_CHARACTERS)
    n = len(joints)
    values = _bodies(file, data, n)
    for key in PER_JOINT:
        if key in data:
            values[key] = _array(file, key, data, (n,))
    if "gravity" in data:
        values["gravity"] = _array(file, "gravity", data, (3,))
    position, angles = (
        _array(file, key, data, (3,)) if key in data else np.zeros(3)
        for key in ("tip", "tip_angles")
    )
    directions = _array(file, "axes", data, (n, 3))
    return SerialArm(
        **_common(file, data),
        chain=Chain(
            joints=tuple(joints),
            rotations=from_rpy(_array(file, "angles", data, (n, 3))),
            positions=_array(file, "positions", data, (n, 3)),
            axes=directions,
            tip=Frame(position=position, rotation=from_rpy(angles)),
            assumed=str(data.get("assumed", "")).strip(),
            **values,
        ),
    )


def _derived(file: str, data: Mapping[str, Any], load: Callable[..., Arm]) -> Arm:
    """The arm of a file that is derived from another arm."""

    def values(key: str, shape: tuple[int, ...]) -> FloatArray:
        return _array(file, key, data, shape)

    arm = load(*_origin(file, data))
    payload_keys = [x for x in PAYLOAD if x in data]
    changes: dict[str, Any] = {x: values(x, (arm.dof,)) for x in PER_JOINT if x in data}
    if payload_keys:
        if "payload_mass" not in data:
            raise InvalidInput(f"{file}: {payload_keys[0]} needs the payload_mass too.")
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
        checks.check_name(f"name of the arm of {file}", name, longest=MAX_CHARACTERS)
        arm = arm.with_name(name)
    return arm


def _origin(file: str, data: Mapping[str, Any]) -> tuple[str | FilePath, ArmOptions]:
    """The name or file, and the options, of the arm from which another arm is derived."""
    origin = data.get("arm")
    if isinstance(origin, str):
        return origin, ArmOptions()
    if not isinstance(origin, Mapping) or not set(origin) <= set(OF_ARM):
        raise InvalidInput(
            f"{file}: arm must be the name of a built-in arm, or a mapping with the keys "
            f"{', '.join(OF_ARM)}, not {show(origin)}."
        )
    if ("name" in origin) == ("file" in origin) or not all(
        isinstance(x, str) for x in origin.values()
    ):
        raise InvalidInput(f"{file}: arm takes either name, a built-in arm, or file, as texts.")
    folder, limits = FilePath(file).parent, origin.get("joint_limits")
    options = ArmOptions(
        tip=origin.get("tip"),
        base=origin.get("base"),
        joint_limits=None if limits is None else folder / limits,
    )
    return folder / origin["file"] if "file" in origin else origin["name"], options


def _bodies(file: str, data: Mapping[str, Any], n: int) -> dict[str, Any]:
    """Masses, centres of mass and inertias of n bodies; empty if the file gives none."""
    body_keys = [key for key in BODIES if key in data]
    if not body_keys:
        return {}
    if len(body_keys) < len(BODIES):
        raise InvalidInput(
            f"{file}: bodies need all of {', '.join(BODIES)}, not {body_keys[0]} alone."
        )
    tensors = _array(file, "inertias", data, (n, 6))[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]]
    angles = np.zeros((n, 3))
    if "inertia_angles" in data:
        angles = _array(file, "inertia_angles", data, (n, 3))
    axes = from_rpy(angles)
    inertias = axes @ tensors.reshape(n, 3, 3) @ np.swapaxes(axes, -1, -2)
    return {
        "masses": _array(file, "masses", data, (n,)),
        "centers": _array(file, "centers", data, (n, 3)),
        # Products of rotations are symmetric only up to rounding.
        "inertias": (inertias + np.swapaxes(inertias, -1, -2)) / 2,
    }


def _common(file: str, data: Mapping[str, Any]) -> dict[str, Any]:
    """Name, source and limits of an arm file."""
    limits = data.get("limits") or {}
    if not isinstance(limits, Mapping):
        raise InvalidInput(f"{file}: limits must be named quantities, each with value and unit.")
    unknown = set(limits) - set(LIMITS)
    if unknown:
        raise InvalidInput(
            f"{file}: unknown limit {sorted(unknown)[0]}: an arm has {', '.join(LIMITS)}."
        )
    name = str(data.get("name", file))
    checks.check_name(f"name of the arm of {file}", name, longest=MAX_CHARACTERS)
    hint = f"add joint_acceleration to the limits in {file}"
    return {
        "name": name,
        "source": str(data.get("source", "")),
        "limits": Limits(**{key: _value(file, key, limits) for key in limits}),
        "limits_hint": "" if "joint_acceleration" in limits else hint,
    }


def _array(file: str, key: str, data: Mapping[str, Any], shape: tuple[int, ...]) -> FloatArray:
    """The numbers of a key as an array of a given shape."""
    array = checks.check_numbers(f"{key} in {file}", _value(file, key, data), UNITS[key])
    if array.shape != shape:
        raise InvalidInput(
            f"{file}: {key} must be {' by '.join(str(x) for x in shape)} numbers, but is "
            f"{' by '.join(str(x) for x in array.shape) or 'one'}."
        )
    return array


def _value(file: str, key: str, data: Mapping[str, Any]) -> Any:
    """The value of a key, which must be a quantity in the unit of `UNITS`."""
    quantity = data.get(key)
    if not isinstance(quantity, Mapping) or "value" not in quantity:
        raise InvalidInput(f"{file}: {key} must be a quantity with value, unit and source.")
    if quantity.get("unit") != UNITS[key]:
        raise InvalidInput(
            f"{file}: {key} must be given in {UNITS[key]}, not {quantity.get('unit')!r}."
        )
    return _numbers(f"{key} in {file}", quantity["value"], UNITS[key])


def _numbers(location: str, value: Any, unit: str) -> Any:
    """A number of a file, or a nested list of numbers."""
    if isinstance(value, list):
        return [_numbers(location, x, unit) for x in value]
    number = plain_number(value)
    if number is None:
        raise InvalidInput(f"{location} must be finite numbers in {unit}, not {show(value)}.")
    return number


def read_hulls(name: str) -> ArmShapes:
    """Read the hulls of a built-in arm: convex bodies that contain its links."""
    data = json.loads(_file(name).read_bytes())
    return ArmShapes(
        shapes=tuple(
            LinkShape(
                name=x["name"],
                link=x["link"],
                shape=Mesh(points=STEP * np.array(x["points"]), source=f"the hull of {x['name']}"),
            )
            for x in data["hulls"]
        ),
        source=f"{data['source']} {data['license']}",
    )


def _file(name: str) -> Traversable:
    """The file of the hulls of a built-in arm, which may not exist."""
    return resources.files("armcontour.files.robots") / "library" / "hulls" / f"{name}.json"


def with_more_shapes(
    arm: Arm, shapes: tuple[LinkShape, ...] = (), srdf: FilePath | None = None
) -> Arm:
    """An arm with more shapes, or with pairs that an SRDF file excludes from checks."""
    if not shapes and srdf is None:
        return arm
    return arm.with_shapes(partial(_add, arm, shapes, srdf))


def _add(arm: Arm, shapes: tuple[LinkShape, ...], srdf: FilePath | None) -> ArmShapes:
    """The shapes of an arm and more of them."""
    # Imported here, because it loads the compiled code of motions.
    from armcontour.verification.clearance.distances import exclude_touching

    existing = arm.shapes or ArmShapes(shapes=())
    every = (*existing.shapes, *shapes)
    left_out = existing.left_out
    if srdf is not None:
        from armcontour.files.robots.collision import read_left_out

        names = list(dict.fromkeys(x.name for x in every))
        left_out = (*left_out, *read_left_out(srdf, names))
    combined = ArmShapes(shapes=every, left_out=left_out, source=existing.source)
    return exclude_touching(arm.with_shapes(combined)) if every else combined
