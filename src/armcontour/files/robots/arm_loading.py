"""`load_arm`, which loads arms from all sources; reader of arm files and link hulls."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache, partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks, file_access, yaml_loader
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.frames import Frame, Pose, from_rpy
from armcontour.core.text import plain_number, show
from armcontour.files.robots.urdf_tree import (
    DESCRIPTION,
    MAX_CHARACTERS,
    ArmOptions,
    refuse_urdf_options,
)
from armcontour.robot.arm import Arm
from armcontour.robot.bodies import Payload
from armcontour.robot.chain import Chain
from armcontour.robot.external_axes import Tilt
from armcontour.robot.limits import LIMITS as RECORDS
from armcontour.robot.limits import Limits
from armcontour.robot.planar import LinkTube, PlanarTwoLink
from armcontour.robot.scene import ArmShapes, LinkShape, Mesh
from armcontour.robot.serial import SerialArm

# Folder with the files of the built-in arms.
LIBRARY = FilePath(__file__).with_name("library")
# Folder with the link hulls of built-in arms; some arms have none.
HULLS = LIBRARY / "hulls"
# Required units of limits.
LIMITS = {name: x.quantity.unit for name, x in RECORDS.items() if x.kind == "joint"}
# Required units of the quantities in arm files, by key.
UNITS = LIMITS | {
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
}
# Arms for which calibrations of UR can be read.
CALIBRATED_ARMS = ("ur5e", "ur10e")
# Links in a calibration of UR.
CALIBRATED_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
# Keys of a link in a calibration of UR: position [m], and angles [rad].
POSE = ("x", "y", "z", "roll", "pitch", "yaw")
# Largest shift of the tool by a calibration [m]; larger shifts are of another robot.
MAX_CALIBRATION = 0.1
# Unit of the integer coordinates in files of hulls [m].
HULL_UNIT = 1e-6
# Keys of all arm files. "not_kept" has published limits that plans keep only if a job specifies
# them.
COMMON = {"name", "kind", "source", "limits", "assumed", "not_kept"}
PLANAR = COMMON | {"base", "links", "tubes"}
BODIES = ("masses", "centers", "inertias")
OPTIONAL = ("tip", "tip_angles", "inertia_angles", "armature", "viscous", "coulomb", "gravity")
SERIAL = COMMON | {"joints", "positions", "angles", "axes", *BODIES, *OPTIONAL}
PER_JOINT = ("armature", "viscous", "coulomb")
KINDS = {"planar_two_link": PLANAR, "serial": SERIAL}


@checks.explained
def arm_names() -> tuple[str, ...]:
    """Return the names of the built-in arms.

    >>> "ur5e" in ac.arm_names()
    True
    """
    return tuple(sorted(x.stem for x in LIBRARY.glob("*.yaml")))


@checked
def load_arm(
    name: str | FilePath,
    *,
    tip: str | None = None,
    base: str | None = None,
    part: str | None = None,
    tilt: Tilt | None = None,
    joint_limits: str | FilePath | None = None,
    calibration: str | FilePath | None = None,
    srdf: str | FilePath | None = None,
    tool: Pose | None = None,
    work: Pose | None = None,
    payload: Payload | None = None,
) -> Arm:
    """Load an arm by its built-in name, such as "ur5e", or from a file.

        arm = load_arm("ur5e", tool=pinocchio.SE3(rotation, position))
        own = load_arm("robot.urdf", tip="tool0")

    >>> ac.load_arm("ur5e", tool=ac.Frame((0.0, 0.0, 0.1))).dof
    6

    Args:
        name: Built-in name, arm file (.yaml) or robot description (.urdf). In a built-in name, case
            and hyphens are ignored.
        tip: Link at the end of the arm, for a robot description (.urdf); by default `tool0`, or
            `flange` if there is no `tool0`.
        base: Fixed link at the start of the arm, for a robot description; by default the root.
        part: Link that carries the part, for a robot description of a cell: the joints between it
            and the base are the axes of a positioner, and its frame is the default work frame.
        tilt: Largest angle between the tool axis and gravity [rad]: the positioner turns the part
            so that the tool points downwards. By default any angle is allowed.
        joint_limits: A joint_limits.yaml of MoveIt, which replaces limits of the arm's own file.
            Its default scaling factors are not applied.
        calibration: File of UR's `ur_calibration` for a built-in UR arm (.yaml): the transforms of
            the six links of your robot, which differ from the nominal ones by up to centimetres at
            the tool.
        srdf: A file of MoveIt (.srdf) with the pairs of links that may touch each other.
        tool: The tool frame relative to the tip: a Frame, a 4 by 4 transform, a pinocchio.SE3 or a
            position [m].
        work: The frame of tool points relative to the base, in the same forms.
        payload: Payload at the tip.

    Raises:
        InvalidInput: The arm or file does not exist, an option is not valid for its kind, or the
            file does not describe an arm.
    """
    options = ArmOptions(
        tip=tip,
        base=base,
        part=part,
        tilt=tilt,
        joint_limits=joint_limits,
        calibration=calibration,
        srdf=srdf,
    )
    name = FilePath(name)
    arm = _load(name, options, payload)
    if options.calibration is not None:
        arm = _calibrated_arm(arm, str(name), FilePath(options.calibration))
    arm = _attach(arm, tool, work, payload)
    return arm if options.srdf is None else with_more_shapes(arm, srdf=FilePath(options.srdf))


def _load(name: str | FilePath, options: ArmOptions, payload: Payload | None) -> Arm:
    """Load an arm without the tool, the work frame and the SRDF that `load_arm` adds."""
    file_access.refuse_ending(name, "robot description")
    if str(name).lower().endswith(DESCRIPTION):
        from armcontour.files.robots.urdf import read_arm

        return read_arm(FilePath(name), options)
    refuse_urdf_options(options, f"The arm {name}")
    arm = _read_arm(str(name), payload)
    if options.joint_limits is None:
        return arm
    from armcontour.files.robots.moveit_limits import make_limits, override_limits, table_of

    table = table_of(arm.limits, arm.dof)
    override_limits(table, arm.joint_names, options.joint_limits)
    # The file replaces only joint limits; other limits of the arm do not change.
    slides = arm.chain.prismatic or ()
    replaced = make_limits(table, arm.joint_names, str(options.joint_limits), slides)
    values = {key: getattr(replaced, key) for key in table}
    lifted: dict[str, Any] = {key: np.inf for key, x in values.items() if x is None}
    return arm.with_limits(Limits().replace(**values | lifted))


def _calibrated_arm(arm: Arm, name: str, file: FilePath) -> SerialArm:
    """UR arm whose links have the transforms of a file that `ur_calibration` wrote."""
    built_in = name.lower().replace("-", "")
    if built_in not in CALIBRATED_ARMS or not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"calibration is valid only for the built-in arms {' and '.join(CALIBRATED_ARMS)}, but "
            f"the arm is {name}. Calibrate a URDF with the tools of its maker."
        )
    content = file_access.read_bytes(file, "calibration")
    data = yaml_loader.load(content, str(file))
    links = data.get("kinematics") if isinstance(data, Mapping) else None
    transforms = []
    for link in CALIBRATED_LINKS:
        entry = links.get(link) if isinstance(links, Mapping) else None
        numbers = [plain_number(entry.get(x) if isinstance(entry, Mapping) else None) for x in POSE]
        if None in numbers:
            raise InvalidInput(
                f"{file}: kinematics.{link} must have the numbers x, y, z [m], roll, pitch and yaw "
                "[rad], as ur_calibration writes them."
            )
        transforms.append(numbers)
    table = np.array(transforms, dtype=np.float64)
    chain = arm.chain.replace(positions=table[:, :3], rotations=from_rpy(table[:, 3:]))
    calibrated = SerialArm(
        name=arm.name, chain=chain, limits=arm.limits, source=f"{arm.source}; calibration {file}"
    ).with_shapes(partial(read_hulls, built_in))
    shift = calibrated.tool_position(np.zeros(arm.dof)) - arm.tool_position(np.zeros(arm.dof))
    if np.linalg.norm(shift) > MAX_CALIBRATION:
        raise InvalidInput(
            f"{file} moves the tool of {name} by {np.linalg.norm(shift) * 1e3:.0f} mm at joint "
            f"positions of 0, more than {MAX_CALIBRATION * 1e3:.0f} mm. Specify the file of this "
            "robot."
        )
    return calibrated


def _read_arm(name: str, payload: Payload | None) -> Arm:
    """Read a built-in arm or an arm file."""
    if name.lower().endswith((".yaml", ".yml")):
        content = file_access.read_bytes(name, "arm file")
        return arm_of(name, yaml_loader.load(content, name), payload)
    built_in = name.lower().replace("-", "")
    if built_in not in arm_names():
        raise InvalidInput(
            f"There is no built-in arm {name!r}. The built-in arms are {', '.join(arm_names())}. "
            "Describe your own arm in a .urdf or .yaml file."
        )
    arm = arm_of(f"{built_in}.yaml", _built_in(built_in), payload)
    has_hulls = (HULLS / f"{built_in}.json").is_file()
    return arm.with_shapes(partial(read_hulls, built_in)) if has_hulls else arm


def _attach(arm: Arm, tool: Pose | None, work: Pose | None, payload: Payload | None) -> Arm:
    """Return the arm with another tool, work frame and payload; None means no change."""
    if isinstance(arm, SerialArm):
        if tool is not None or payload is not None:
            arm = arm.with_tool(arm.chain.tool if tool is None else tool, payload)
        return arm if work is None else arm.with_work(work)
    if tool is not None or work is not None:
        raise InvalidInput(
            f"The planar arm {arm.name} does not support a tool or work frame. Transform the path "
            "instead (in a job, path.frame)."
        )
    return arm


@cache
def _built_in(name: str) -> Any:
    """Data of a built-in arm, read-only; cached, because parsing takes most of the loading time."""
    file = LIBRARY / f"{name}.yaml"
    return yaml_loader.load(file.read_bytes(), file.name)


def arm_of(file: str, data: Any, payload: Payload | None = None) -> Arm:
    """Make an arm from the data of an arm file.

    Args:
        file: Name of the file, for messages.
        data: Data of the file.
        payload: Payload at the tip; None for no payload.

    Raises:
        InvalidInput: The data do not describe an arm.
    """
    kind = data.get("kind") if isinstance(data, Mapping) else None
    keys = KINDS.get(kind) if isinstance(kind, str) else None
    if keys is None:
        raise InvalidInput(
            f"{file} does not describe an arm. It must be a mapping with keys such as name and "
            f"source, and its kind must be {' or '.join(KINDS)}."
        )
    if not set(data) <= keys:
        raise InvalidInput(
            f"{file} has the unknown keys {', '.join(str(x) for x in set(data) - keys)}. An arm of "
            f"the kind {kind} has the keys {', '.join(sorted(keys))}."
        )
    return _serial(file, data) if kind == "serial" else _planar(file, data, payload)


def _planar(file: str, data: Mapping[str, Any], payload: Payload | None) -> PlanarTwoLink:
    """Make the planar arm of an arm file."""
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
    """Read the two link tubes of a planar arm."""
    keys = ("outer_diameter", "wall", "density")
    if not isinstance(data, Mapping) or set(data) != set(keys):
        raise InvalidInput(f"{file}: tubes must have the keys {', '.join(keys)}.")
    values = {key: _array(file, key, data, (2,)) for key in keys}
    first, second = (LinkTube(**{key: values[key][k] for key in keys}) for k in range(2))
    return first, second


def _serial(file: str, data: Mapping[str, Any]) -> SerialArm:
    """Make the serial arm of an arm file."""
    joints = data.get("joints")
    if not isinstance(joints, list) or not all(isinstance(x, str) for x in joints) or not joints:
        raise InvalidInput(f"{file}: joints must be a list of the names of the joints.")
    for joint in joints:
        checks.check_name(f"name of a joint of {file}", joint, longest=MAX_CHARACTERS)
    n = len(joints)
    shapes = {**dict.fromkeys(PER_JOINT, (n,)), "gravity": (3,)}
    values = _bodies(file, data, n)
    values |= {key: _array(file, key, data, x) for key, x in shapes.items() if key in data}
    position, angles = (
        _array(file, key, data, (3,)) if key in data else np.zeros(3)
        for key in ("tip", "tip_angles")
    )
    directions = _array(file, "axes", data, (n, 3))
    return SerialArm(
        **_common(file, data),
        unused_limits=_unused_limits(file, data),
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


def _bodies(file: str, data: Mapping[str, Any], n: int) -> dict[str, Any]:
    """Masses, centres of mass and inertias of n bodies; empty if the file has no bodies."""
    body_keys = [key for key in BODIES if key in data]
    if not body_keys:
        return {}
    if len(body_keys) < len(BODIES):
        raise InvalidInput(
            f"{file}: bodies require all of the keys {', '.join(BODIES)}, but the file has only "
            f"{' and '.join(body_keys)}."
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
        # The products are symmetric only up to rounding errors.
        "inertias": (inertias + np.swapaxes(inertias, -1, -2)) / 2,
    }


def _common(file: str, data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of an arm that all arm files have: name, source and limits."""
    limits = data.get("limits") or {}
    if not isinstance(limits, Mapping):
        raise InvalidInput(
            f"{file}: limits must be a mapping of quantities, each with value and unit."
        )
    unknown = set(limits) - set(LIMITS)
    if unknown:
        raise InvalidInput(
            f"{file}: the limit {sorted(unknown)[0]} is unknown. An arm has the limits "
            f"{', '.join(LIMITS)}."
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


def _unused_limits(file: str, data: Mapping[str, Any]) -> Limits | None:
    """Published limits of the joints under the key "not_kept"; None if there are none."""
    published = data.get("not_kept") or {}
    values = {key: _value(file, key, published) for key in published if key in LIMITS}
    return Limits(**values) if values else None


def _array(file: str, key: str, data: Mapping[str, Any], shape: tuple[int, ...]) -> FloatArray:
    """Return the numbers of a key as an array, which must have the given shape."""
    array = checks.check_numbers(f"{key} in {file}", _value(file, key, data), UNITS[key])
    if array.shape != shape:
        raise InvalidInput(
            f"{file}: {key} must be {' by '.join(str(x) for x in shape)} numbers, but is "
            f"{' by '.join(str(x) for x in array.shape) or 'one'}."
        )
    return array


def _value(file: str, key: str, data: Mapping[str, Any]) -> Any:
    """Return the value of a key, which must be a quantity in the unit that UNITS requires."""
    quantity = data.get(key)
    if not isinstance(quantity, Mapping) or "value" not in quantity:
        raise InvalidInput(f"{file}: {key} must be a quantity with value, unit and source.")
    if quantity.get("unit") != UNITS[key]:
        raise InvalidInput(
            f"{file}: the unit of {key} must be {UNITS[key]}, but is {quantity.get('unit')!r}."
        )
    return _numbers(f"{key} in {file}", quantity["value"], UNITS[key])


def _numbers(location: str, value: Any, unit: str) -> Any:
    """Number, or nested list of numbers, of a file; `unit` is for messages."""
    if isinstance(value, list):
        return [_numbers(location, x, unit) for x in value]
    number = plain_number(value)
    if number is None:
        raise InvalidInput(f"{location} must have finite numbers in {unit}, but has {show(value)}.")
    return number


def read_hulls(name: str) -> ArmShapes:
    """Read the hulls of a built-in arm, which are convex meshes that contain its links."""
    data = json.loads((HULLS / f"{name}.json").read_bytes())
    return ArmShapes(
        shapes=tuple(
            LinkShape(
                name=x["name"],
                link=x["link"],
                shape=Mesh(
                    points=HULL_UNIT * np.array(x["points"]), source=f"the hull of {x['name']}"
                ),
            )
            for x in data["hulls"]
        ),
        source=f"{data['source']} {data['license']}",
    )


def with_more_shapes(
    arm: Arm, shapes: tuple[LinkShape, ...] = (), srdf: FilePath | None = None
) -> Arm:
    """Add shapes to an arm, and exclude pairs of links from distance checks.

    Args:
        arm: The arm.
        shapes: Additional shapes of links.
        srdf: SRDF file with the excluded pairs; None for no further pairs.

    Raises:
        InvalidInput: The SRDF file cannot be read or names an unknown link.
    """
    if not shapes and srdf is None:
        return arm
    # The file is read now, so that a file that is missing or not allowed is refused at once.
    content = b"" if srdf is None else file_access.read_bytes(srdf, "SRDF file")
    if srdf is not None:
        arm = _note_unknown_links(arm, srdf, content, [x.name for x in shapes])
    return arm.with_shapes(partial(_combine_shapes, arm, shapes, srdf, content))


def _note_unknown_links(arm: Arm, srdf: FilePath, content: bytes, further: Sequence[str]) -> Arm:
    """Add a note on the links of an SRDF file that the arm does not have.

    The links of arms without a description (.urdf) are not known, so these arms get no note.
    `further`: names of shapes that the arm has in addition to the links of its description.
    """
    if not arm.source.lower().endswith(DESCRIPTION):
        return arm
    from armcontour.files.robots.collision_shapes import note_unknown_links
    from armcontour.files.robots.urdf_tree import read_tree

    description = FilePath(arm.source)
    tree = read_tree(arm.source, file_access.read_bytes(description, "robot description"))
    note = note_unknown_links(content, srdf, tree.file, [*tree.links, *further])
    return arm if not note else arm._copy(notes=(*arm.notes, note))


def _combine_shapes(
    arm: Arm, shapes: tuple[LinkShape, ...], srdf: FilePath | None, content: bytes
) -> ArmShapes:
    """Combine an arm's shapes with more shapes, and with the pairs that an SRDF file excludes."""
    # Imported here, because the import loads compiled code of motions.
    from armcontour.verification.clearance.body_pairs import exclude_touching

    existing = arm.shapes or ArmShapes(shapes=())
    every = (*existing.shapes, *shapes)
    left_out = existing.left_out
    if srdf is not None:
        from armcontour.files.robots.collision_shapes import excluded_pairs_of

        names = list(dict.fromkeys(x.name for x in every))
        left_out = (*left_out, *excluded_pairs_of(content, srdf, names))
    combined = ArmShapes(shapes=every, left_out=left_out, source=existing.source)
    return exclude_touching(arm.with_shapes(combined)) if every else combined
