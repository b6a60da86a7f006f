"""The key `scene` of a job file, and shapes of tools and links."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.frames import Frame, exp, from_rpy, rotations
from armcontour.core.quantities import Choice, Distance, Length, Turn
from armcontour.core.text import list_some, show
from armcontour.files.file_keys import Number
from armcontour.files.key_overrides import Place
from armcontour.robot import Arm
from armcontour.robot.scene import (
    ASSUMED_GAP,
    ASSUMED_RADIUS,
    AT_BASE,
    BASE,
    PART,
    TOOL,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    LinkShape,
    Margins,
    Obstacle,
    Scene,
    Shape,
    Sphere,
)

# Keys of bodies that are valid only for obstacles, and keys that are valid only for shapes of
# links.
OBSTACLE_KEYS, LINK_KEYS = ("fixed_to", "margin", "allow"), ("link",)
# Maximum number of links that a message lists.
MAX_NAMED = 40
Angles = Annotated[list[Turn], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]


def scene_of(model: SceneModel, folder: FilePath, part: Frame) -> Scene:
    """Scene of a job; `part` is the frame of the part, for obstacles that are fixed to it."""
    obstacles = []
    for key, body in _bodies(model, "scene", LINK_KEYS, "shapes of links"):
        with error_context(key):
            obstacle = Obstacle(name=body.name, shape=_shape(body, folder), place=_body_frame(body))
        obstacles.append(_place_obstacle(obstacle, body, part))
    return Scene(obstacles=tuple(obstacles), margins=model.margins, floor=model.floor)


def tool_shapes(model: BodiesModel, folder: FilePath, arm: Arm) -> tuple[LinkShape, ...]:
    """Shapes of a tool as link shapes; the model specifies them in the frame of the tip."""
    chain = arm.chain
    if chain is None:
        raise InvalidInput(
            f"arm.tool.shapes requires an arm with a kinematic chain, but {arm.name} has none."
        )
    keys = (*OBSTACLE_KEYS, *LINK_KEYS)
    return tuple(
        _link_shape(where, x, folder, len(chain), tip=chain.tip)
        for where, x in _bodies(model, "arm.tool.shapes", keys, "obstacles and links")
    )


def assumed_tool(arm: Arm) -> tuple[LinkShape, ...]:
    """Capsule from the flange towards the tool point, for a tool without specified shapes."""
    # The capsule ends before the tool point, because the tool point touches the work. A tool that
    # is too short for a capsule has no shape.
    chain = arm.chain
    if chain is None:
        return ()
    flange, point = chain.tip.position, (chain.tip @ chain.tool).position
    reach = float(np.linalg.norm(point - flange))
    length = reach - 2 * ASSUMED_RADIUS - ASSUMED_GAP
    if length <= 0:
        return ()
    direction = (point - flange) / reach
    middle = flange + (ASSUMED_RADIUS + length / 2) * direction
    return (
        LinkShape(
            name=TOOL,
            link=len(chain),
            shape=Capsule(radius=ASSUMED_RADIUS, length=length),
            place=Frame(position=middle, rotation=upright(direction)),
            tool=True,
            assumed=True,
        ),
    )


def more_link_shapes(model: BodiesModel, folder: FilePath, arm: Arm) -> tuple[LinkShape, ...]:
    """Shapes that a job adds to links of its arm; the model specifies them in the link frames."""
    links = {x.name: x.link for x in (() if arm.shapes is None else arm.shapes.shapes)}
    links |= {BASE: 0} | {name: k for k, name in enumerate(arm.joint_names, start=1)}
    shapes = []
    for key, body in _bodies(model, "arm.shapes", OBSTACLE_KEYS, "obstacles"):
        if body.link not in links:
            raise InvalidInput(
                f"{key}: link must be one of {list_some(list(links), MAX_NAMED)}, but is "
                f"{'missing' if body.link is None else repr(body.link)}."
            )
        shapes.append(_link_shape(key, body, folder, links[body.link]))
    return tuple(shapes)


def rotation_of(key: str, model: RotationModel) -> FloatArray | None:
    """Rotation matrix of a model, (3, 3); None if the model specifies no rotation."""
    if model.rpy is not None and model.quaternion is not None:
        raise InvalidInput(f"{key or 'It'} must have either rpy or quaternion, not both.")
    if model.quaternion is not None:
        return rotations(f"{key}.quaternion".lstrip("."), model.quaternion)
    return None if model.rpy is None else from_rpy(model.rpy)


def _bodies(
    model: BodiesModel, key: str, keys: tuple[str, ...], whose: str
) -> Iterator[tuple[str, BodyModel]]:
    """Yield the bodies of a model with their locations in the job; checks that `keys` are unset.

    `whose` says in the message which bodies have these keys.
    """
    for entry in dataclasses.fields(BodiesModel):
        for body in getattr(model, entry.name):
            location = f"{key}.{entry.name}: {body.name}"
            _check_keys(location, body, keys, whose)
            yield location, body


def _link_shape(
    key: str, model: BodyModel, folder: FilePath, link: int, *, tip: Frame | None = None
) -> LinkShape:
    """Shape of a link; with the frame `tip` of the tip in the last link, a shape of the tool."""
    with error_context(key):
        shape, frame = _shape(model, folder), _body_frame(model)
        if tip is not None:
            frame = tip @ frame
        body = LinkShape(name=model.name, link=link, shape=shape, place=frame, tool=tip is not None)
        return body.with_hull()


def _place_obstacle(obstacle: Obstacle, model: PlacedModel, part: Frame) -> Obstacle:
    """Copy of an obstacle with the reference frame, margin and allowed contacts of a model."""
    fixed = obstacle.fixed_to if model.fixed_to is None else model.fixed_to
    changes: dict[str, Any] = {"fixed_to": fixed}
    if fixed == PART:
        changes["place"] = part @ obstacle.place
    if model.margin is not None:
        changes["margin"] = model.margin
    if model.allow is not None:
        changes["allow"] = tuple(model.allow)
    return dataclasses.replace(obstacle, **changes)


def _body_frame(model: PlacedModel) -> Frame:
    """Frame of a body in its reference frame (the arm's base, the part or a link)."""
    turned = (
        _half_space_rotation(model) if isinstance(model, HalfSpaceModel) else rotation_of("", model)
    )
    return Frame(
        position=np.array(model.at or [0.0, 0.0, 0.0]),
        rotation=np.eye(3) if turned is None else turned,
    )


def _half_space_rotation(model: HalfSpaceModel) -> FloatArray | None:
    """Rotation matrix whose z axis is the outward normal of a half-space; None if unspecified."""
    turned = rotation_of("", model)
    if model.normal is None:
        return turned
    if turned is not None:
        raise InvalidInput("A half-space must have only one of normal, rpy and quaternion.")
    normal = checks.check_numbers("normal", model.normal)
    length = float(np.linalg.norm(normal))
    if length == 0:
        raise InvalidInput("The normal of a half-space must not be zero.")
    return upright(normal / length)


def upright(z: FloatArray) -> FloatArray:
    """Rotation matrix whose z axis is the unit vector `z`, (3, 3)."""
    axis = np.array([-z[1], z[0], 0.0])
    size = float(np.linalg.norm(axis))
    if size == 0:
        return np.diag([1.0, z[2], z[2]])
    return exp(axis / size * np.arctan2(size, z[2]))


def _shape(model: BodyModel, folder: FilePath) -> Shape:
    """Shape of a body; reads the file of a mesh."""
    match model:
        case BoxModel():
            return Box(size=np.array(model.size))
        case SphereModel():
            return Sphere(radius=model.radius)
        case CylinderModel():
            return Cylinder(radius=model.radius, length=model.length)
        case CapsuleModel():
            return Capsule(radius=model.radius, length=model.length)
        case MeshModel():
            from armcontour.files.mesh_file import read_mesh

            return read_mesh(folder / model.file, unit=model.unit)
    return HalfSpace()


def _check_keys(location: str, model: PlacedModel, keys: tuple[str, ...], whose: str) -> None:
    """Check that a body has none of `keys`, which are valid only for other bodies (`whose`)."""
    for key in keys:
        if getattr(model, key) is not None:
            raise InvalidInput(f"{location}: {key} is valid only for {whose}. Remove it.")


def check_direction(value: Any) -> Any:
    """Check that a direction is a list of three numbers; returns the value unchanged."""
    shaped = isinstance(value, list) and len(value) == 3
    if not shaped or any(isinstance(x, list | dict) for x in value):
        raise ValueError(f"must be three numbers such as [0, 0, -1], but is {show(value)}")
    return value


Direction = Annotated[
    list[Number], Field(min_length=3, max_length=3), BeforeValidator(check_direction)
]


@dataclass(frozen=True, slots=True, kw_only=True)
class RotationModel:
    """Either `rpy` or `quaternion`.

    Args:
        rpy: Roll, pitch and yaw about fixed x, y and z [rad].
        quaternion: Unit quaternion as x, y, z, w.
    """

    rpy: Angles | None = None
    quaternion: Quaternion | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedModel(RotationModel):
    """Keys of obstacles, and of shapes of links and tools.

    Args:
        at: Position of the origin [m]: the centre of a box, cylinder, sphere or capsule, a point on
            the plane of a half-space, or the origin of a mesh or a file.
        fixed_to: For obstacles, the reference frame: the `base` of the arm, or the `part`, whose
            frame is the frame of the path.
        margin: For obstacles, minimum distance of links and tool [m]; by default the value in
            `margins`.
        allow: For obstacles, links that may touch the obstacle; `tool` is the tool.
        link: For shapes of links, the link: the name of a joint for the link after this joint, the
            name of another shape of the link, or `base`.
    """

    at: Place | None = None
    fixed_to: Annotated[str, Choice((BASE, PART))] | None = None
    margin: Distance | None = None
    allow: list[str] | None = None
    link: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyModel(PlacedModel):
    """A body with a name.

    Args:
        name: Name of the body, for messages.
    """

    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxModel(BodyModel):
    """A box.

    Args:
        size: Lengths along x, y and z [m].
    """

    size: Place


@dataclass(frozen=True, slots=True, kw_only=True)
class SphereModel(BodyModel):
    """A sphere.

    Args:
        radius: Radius [m].
    """

    radius: Distance


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderModel(BodyModel):
    """A circular cylinder along its z axis.

    Args:
        radius: Radius [m].
        length: Length [m].
    """

    radius: Distance
    length: Distance


@dataclass(frozen=True, slots=True, kw_only=True)
class CapsuleModel(BodyModel):
    """A cylinder along its z axis with hemispheres at its ends.

    Args:
        radius: Radius of the cylinder and the hemispheres [m].
        length: Length of the cylinder, without the hemispheres [m].
    """

    radius: Distance
    length: Distance


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfSpaceModel(BodyModel):
    """All points on one side of a plane, such as a table or a wall.

    Args:
        normal: Outward normal of the half-space, upwards by default; replaces rpy and quaternion.
    """

    normal: Direction | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshModel(BodyModel):
    """A body whose surface is the triangle mesh of a file.

    Args:
        file: A .stl or .obj file; its name is relative to the job file.
        unit: Unit of the lengths in the file, such as mm; metres by default.
    """

    file: str
    unit: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BodiesModel:
    """Bodies by their shapes.

    Args:
        boxes: Boxes.
        cylinders: Circular cylinders.
        spheres: Spheres.
        capsules: Cylinders with hemispheres at their ends.
        halfspaces: Half-spaces, for obstacles only.
        meshes: Triangle meshes from files.
    """

    boxes: list[BoxModel] = field(default_factory=list)
    cylinders: list[CylinderModel] = field(default_factory=list)
    spheres: list[SphereModel] = field(default_factory=list)
    capsules: list[CapsuleModel] = field(default_factory=list)
    halfspaces: list[HalfSpaceModel] = field(default_factory=list)
    meshes: list[MeshModel] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneModel(BodiesModel):
    """Obstacles in the cell, and minimum distances of the arm to them and to itself.

    Args:
        margins: Minimum distances of bodies, by kind of pair.
        floor: Height of the floor, which is an obstacle, in the frame of the arm's base; "none" if
            there is no floor, for example on a pedestal or a wall. By default a link below the base
            causes a warning.
    """

    margins: Margins = Margins()
    floor: Literal["base", "none"] | Length = AT_BASE
