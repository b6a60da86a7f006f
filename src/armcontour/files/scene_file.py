"""The key `scene` of a job file, and shapes of tools and links."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Annotated, Literal

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.frames import Frame, exp, from_rpy, rotations, shortest
from armcontour.core.quantities import Choice, Distance, Items, Length, Turn
from armcontour.core.text import list_some
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

# Keys that the types of bodies require, and keys that they may have.
BODY_KEYS = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "halfspace": (),
    "mesh": ("file",),
}
SHAPES: dict[str, Callable[..., Shape]] = {
    "box": Box,
    "cylinder": Cylinder,
    "sphere": Sphere,
    "capsule": Capsule,
    "halfspace": HalfSpace,
}
OPTIONAL_KEYS = {"halfspace": ("normal",), "mesh": ("unit",)}
# Maximum number of links that a message lists.
MAX_NAMED = 40
Angles = Annotated[list[Turn], Items(3, 3)]
Quaternion = Annotated[list[float], Items(4, 4)]
Place = Annotated[list[Length], Items(3, 3)]
Direction = Annotated[list[float], Items(3, 3)]


def scene_of(
    model: SceneModel, folder: FilePath, part: Frame, parts: Sequence[Obstacle] = ()
) -> Scene:
    """Make the scene of a job; reads the files of meshes.

    Args:
        model: Keys of the scene.
        folder: Folder against which relative file names are resolved.
        part: Frame of the part, for obstacles that are fixed to it.
        parts: Parts of a CAD model as obstacles, in this frame.

    Raises:
        InvalidInput: A body is wrong, or its file cannot be read.
    """
    obstacles = tuple(_obstacle(x, folder, part) for x in model.obstacles)
    taken = {x.name for x in obstacles}
    placed = [
        replace(x, name=f"{x.name} (part)" if x.name in taken else x.name, place=part @ x.place)
        for x in parts
    ]
    return Scene(obstacles=(*obstacles, *placed), margins=model.margins, floor=model.floor)


def tool_shapes(models: Iterable[BodyModel], folder: FilePath, arm: Arm) -> tuple[LinkShape, ...]:
    """Shapes of a tool as link shapes; the models specify them in the frame of the tip."""
    chain = arm.chain
    return tuple(
        _link_shape(f"arm.tool.shapes: {x.name}", x, folder, len(chain), tip=chain.tip)
        for x in models
    )


def assumed_tool(arm: Arm) -> tuple[LinkShape, ...]:
    """Capsule from the flange towards the tool point, for a tool without specified shapes."""
    # The capsule ends before the tool point, because the tool point touches the work. A tool that
    # is too short for a capsule has no shape.
    chain = arm.chain
    flange = chain.tip.position
    point = (chain.tip @ chain.tool).position
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


def more_link_shapes(
    models: Iterable[LinkShapeModel], folder: FilePath, arm: Arm
) -> tuple[LinkShape, ...]:
    """Shapes that a job adds to links of its arm; the models specify them in the link frames."""
    links = {x.name: x.link for x in (() if arm.shapes is None else arm.shapes.shapes)}
    links |= {BASE: arm.chain.floor_link}
    links |= {name: k for k, name in enumerate(arm.joint_names, start=1)}
    # The body after an axis of a positioner, from the floor, is before its joint, from the part.
    links |= {name: k for k, name in enumerate(arm.joint_names[: arm.chain.floor_link])}
    shapes = []
    for model in models:
        key = f"arm.shapes: {model.name}"
        if model.link not in links:
            raise InvalidInput(
                f"{key}: link must be one of {list_some(list(links), MAX_NAMED)}, but is "
                f"{model.link!r}."
            )
        shape = _link_shape(key, model, folder, links[model.link])
        if shape.link <= arm.chain.floor_link:
            # The frame of the floor with the positioner at 0 is that of its shapes.
            floor = Frame(position=-arm.chain.positions[: shape.link].sum(axis=0))
            shape = replace(shape, place=floor @ shape.place)
        shapes.append(shape)
    return tuple(shapes)


def rotation_of(key: str, model: RotationModel) -> FloatArray | None:
    """Return the rotation matrix of a model, (3, 3); None if the model specifies no rotation."""
    if model.rpy is not None and model.quaternion is not None:
        raise InvalidInput(f"{key or 'It'} has rpy and quaternion. Remove one of them.")
    if model.quaternion is not None:
        return rotations(f"{key}.quaternion".lstrip("."), model.quaternion)
    return None if model.rpy is None else from_rpy(model.rpy)


def _link_shape(
    key: str, model: BodyModel, folder: FilePath, link: int, *, tip: Frame | None = None
) -> LinkShape:
    """Shape of a link; with the frame `tip` of the tip in the last link, a shape of the tool."""
    with error_context(key):
        shape = _read_shape(model, folder)
        frame = _body_frame(model)
        if tip is not None:
            frame = tip @ frame
        body = LinkShape(name=model.name, link=link, shape=shape, place=frame, tool=tip is not None)
        return body.with_hull()


def _obstacle(model: ObstacleModel, folder: FilePath, part: Frame) -> Obstacle:
    """Obstacle of a model; `part` is the frame of the part."""
    with error_context(f"scene.obstacles: {model.name}"):
        place = _body_frame(model)
        return Obstacle(
            name=model.name,
            shape=_read_shape(model, folder),
            place=part @ place if model.fixed_to == PART else place,
            fixed_to=model.fixed_to,
            margin=model.margin,
            allow=tuple(model.allow),
        )


def _body_frame(model: BodyModel) -> Frame:
    """Return the frame of a body in its reference frame (the arm's base, the part or a link)."""
    turned = rotation_of("", model) if model.normal is None else _towards(model.normal, model)
    return Frame(
        position=np.array(model.at or [0.0, 0.0, 0.0]),
        rotation=np.eye(3) if turned is None else turned,
    )


def _towards(direction: list[float], model: BodyModel) -> FloatArray:
    """Return the rotation matrix whose z axis is the outward normal of a half-space."""
    if model.rpy is not None or model.quaternion is not None:
        raise InvalidInput("A half-space must have only one of normal, rpy and quaternion.")
    normal = checks.check_numbers("normal", direction)
    length = float(np.linalg.norm(normal))
    if length == 0:
        raise InvalidInput("The normal of a half-space must not be zero.")
    return upright(normal / length)


def upright(z: FloatArray) -> FloatArray:
    """Return the rotation matrix whose z axis is the unit vector `z`, (3, 3)."""
    return exp(shortest([0.0, 0.0, 1.0], z))


def _read_shape(model: BodyModel, folder: FilePath) -> Shape:
    """Return the shape of a body; reads the file of a mesh."""
    required = BODY_KEYS[model.type]
    optional = OPTIONAL_KEYS.get(model.type, ())
    for key in ("size", "radius", "length", "normal", "file", "unit"):
        value = getattr(model, key)
        if value is None and key in required:
            raise InvalidInput(f"A {model.type} requires the key {key}.")
        if value is not None and key not in (*required, *optional):
            raise InvalidInput(f"A {model.type} has no key {key}.")
    sizes = {key: getattr(model, key) for key in required}
    if model.type == "mesh":
        from armcontour.files.mesh_file import read_mesh

        return read_mesh(folder / sizes["file"], unit=model.unit)
    return SHAPES[model.type](**sizes)


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
class BodyModel(RotationModel):
    """A body: an obstacle, or a shape of a link or of the tool.

    Args:
        type: Type of the body; a `halfspace` consists of all points on one side of a plane, such as
            a table or a wall, and is an obstacle only.
        name: Name of the body, for messages.
        at: Position of the origin [m]: the centre of a box, cylinder, sphere or capsule, a point on
            the plane of a half-space, or the origin of a mesh.
        size: For a box, the lengths along x, y and z [m].
        radius: For a sphere, cylinder or capsule, the radius [m].
        length: For a cylinder or capsule, the length along z, without the hemispheres [m].
        normal: For a half-space, the outward normal, upwards by default; replaces rpy and
            quaternion.
        file: For a mesh, a .stl or .obj file; its name is relative to the job file.
        unit: For a mesh, the unit of the lengths in the file, such as mm; metres by default.
    """

    type: Annotated[str, Choice(tuple(BODY_KEYS))]
    name: str
    at: Place | None = None
    size: Place | None = None
    radius: Distance | None = None
    length: Distance | None = None
    normal: Direction | None = None
    file: str | None = None
    unit: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleModel(BodyModel):
    """A body that the arm must not touch.

    Args:
        fixed_to: The reference frame: the `base` of the arm, or the `part`, whose frame is the
            frame of the path.
        margin: Minimum distance of links and tool [m]; by default the value in `margins`.
        allow: Links that may touch the obstacle; `tool` is the tool.
    """

    fixed_to: Annotated[str, Choice((BASE, PART))] = BASE
    margin: Distance | None = None
    allow: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkShapeModel(BodyModel):
    """A shape of a link.

    Args:
        link: The link: the name of a joint for the link after this joint, the name of another shape
            of the link, or `base`. The frame of the links of a positioner is that of its origins.
    """

    link: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PartsModel:
    """The parts of a CAD model as obstacles that move with the part.

    Args:
        margin: Minimum distance of links and tool [m]; by default the value in `margins`.
        allow: Shapes of the tool, and links, that may touch the parts; `tool` is the whole tool.
    """

    margin: Distance | None = None
    allow: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneModel:
    """Obstacles in the cell, and minimum distances of the arm to them and to itself.

    Args:
        obstacles: Obstacles.
        model: The parts of a CAD model that is the path's file, which are obstacles; "none" leaves
            them out.
        margins: Minimum distances of bodies, by kind of pair.
        floor: Height of the floor, which is an obstacle, in the frame of the arm's base; "none" if
            there is no floor, for example on a pedestal or a wall. By default a link below the base
            causes a warning.
    """

    obstacles: list[ObstacleModel] = field(default_factory=list)
    model: PartsModel | Literal["none"] | None = None
    margins: Margins = Margins()
    floor: Literal["base", "none"] | Length = AT_BASE
