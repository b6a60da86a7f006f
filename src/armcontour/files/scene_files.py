"""Read the obstacles of descriptions of cells (URDF)."""

from __future__ import annotations

from pathlib import Path as FilePath

from armcontour.core import file_access
from armcontour.core.errors import InvalidInput, error_context
from armcontour.files.robots.collision import Packages, collisions, shape_of
from armcontour.files.robots.description import Description
from armcontour.files.robots.tree import read_tree
from armcontour.robot.scene import Obstacle


def read_scene_file(
    file: str | FilePath,
    *,
    unit: str | None = None,
    packages: Packages | None = None,
) -> tuple[Obstacle, ...]:
    """Read the obstacles of a description of a cell (.urdf), in its own frame.

    Its `<collision>` elements are obstacles; moving joints stand still, at 0 or at the end of their
    range that is nearest to 0.

    Args:
        file: The description.
        unit: Unit of the lengths of meshes that it names without a scale; metres by default.
        packages: Folders of its ROS packages; others are looked for near the file.

    Raises:
        InvalidInput: No such file, another format, or a body that is none.
    """
    place = FilePath(file)
    if place.suffix.lower() != ".urdf":
        raise InvalidInput(
            f"The file of obstacles {place} is not read: name a .urdf file, and meshes under the "
            "key meshes."
        )
    tree = read_tree(str(place), file_access.read_bytes(place, "description of a cell"))
    found: list[Obstacle] = []
    for link, (_, frame) in Description(tree, (), (), {}, tree.root).carried().items():
        for k, x in enumerate(collisions(tree, link)):
            with error_context(place.name):
                shape = shape_of(tree, x, packages, unit)
                name = link if k == 0 else f"{link} {k + 1}"
                found.append(Obstacle(name=name, shape=shape, place=frame @ x.place))
    if not found:
        raise InvalidInput(f"{place} has no collision elements, so it describes no obstacles.")
    return tuple(found)
