"""Keys of scenes and of shapes of links and tools in a job file, as dataclasses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from armcontour._quantities import Choice, Distance, Turn
from armcontour._text import show
from armcontour.io.forms import Place
from armcontour.io.keys import Number
from armcontour.scene.scene import BASE, PART, Margins

Angles = Annotated[list[Turn], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]


def three_numbers(value: Any) -> Any:
    """Refuse a direction that has another shape than three numbers; return it as written."""
    shaped = isinstance(value, list) and len(value) == 3
    if not shaped or any(isinstance(x, list | dict) for x in value):
        raise ValueError(f"must be three numbers such as [0, 0, -1], not {show(value)}")
    return value


Direction = Annotated[
    list[Number], Field(min_length=3, max_length=3), BeforeValidator(three_numbers)
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
    """What obstacles, and shapes of links and tools, have in common.

    Args:
        at: The position of its origin [m]: the middle of boxes, cylinders, spheres and capsules, a
            point of the plane of a half-space, the origin of a mesh or of a file.
        fixed_to: For obstacles, what they stand on: the `base` of the arm, whose frame places them,
            or the `part`, with the frame of the path.
        margin: For obstacles, how near links and tool may come [m]; by default as `margins` says.
        allow: For obstacles, links that may touch; `tool` is the tool.
        link: For shapes of links, the link: a joint, for the link after this joint, another shape's
            name, or `base`.
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
        name: Its name, for messages.
    """

    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxModel(BodyModel):
    """A box.

    Args:
        size: Its lengths along x, y and z [m].
    """

    size: Place


@dataclass(frozen=True, slots=True, kw_only=True)
class SphereModel(BodyModel):
    """A ball.

    Args:
        radius: Its radius [m].
    """

    radius: Distance


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderModel(BodyModel):
    """A round cylinder along its z axis.

    Args:
        radius: Its radius [m].
        length: Its length [m].
    """

    radius: Distance
    length: Distance


@dataclass(frozen=True, slots=True, kw_only=True)
class CapsuleModel(BodyModel):
    """All points near a stretch of its z axis.

    Args:
        radius: Distance of the surface from the stretch [m].
        length: Length of the stretch, without the round ends [m].
    """

    radius: Distance
    length: Distance


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfSpaceModel(BodyModel):
    """All points on one side of a plane, such as a table or a wall.

    Args:
        normal: The direction out of the half-space, upwards by default; in the place of rpy and
            quaternion.
    """

    normal: Direction | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshModel(BodyModel):
    """A body within the triangles of a file.

    Args:
        file: A .stl or .obj file; its name is relative to the job file.
        unit: Unit of its lengths, such as mm; metres by default.
    """

    file: str
    unit: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BodiesModel:
    """Bodies by their shapes.

    Args:
        boxes: Boxes with lengths along three axes.
        cylinders: Round cylinders.
        spheres: Balls about a point.
        capsules: Cylinders with round ends.
        halfspaces: Half-spaces, for obstacles only.
        meshes: Bodies from files.
    """

    boxes: list[BoxModel] = field(default_factory=list)
    cylinders: list[CylinderModel] = field(default_factory=list)
    spheres: list[SphereModel] = field(default_factory=list)
    capsules: list[CapsuleModel] = field(default_factory=list)
    halfspaces: list[HalfSpaceModel] = field(default_factory=list)
    meshes: list[MeshModel] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneFileModel(PlacedModel):
    """A file of obstacles.

    Args:
        file: A description (.urdf) whose `<collision>` elements stand still, or a scene of MoveIt
            (.scene); its name is relative to the job file.
        unit: Unit of the lengths of meshes that the file names without a scale; metres by default.
    """

    file: str
    unit: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneModel(BodiesModel):
    """Obstacles in the cell, and how near the arm may come to them and to itself.

    Args:
        margins: How near bodies may come, by the kinds of pairs.
        files: Files of more obstacles, with or without their place and margin.
    """

    margins: Margins = Margins()
    files: list[str | SceneFileModel] = field(default_factory=list)
