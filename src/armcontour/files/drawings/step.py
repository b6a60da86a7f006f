"""Reader for CAD models (STEP), whose edges become contours in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath

from armcontour.core.errors import error_context
from armcontour.core.file_access import MAX_HAND_WRITTEN, read_bytes
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.files.model.cad_model import Model
from armcontour.program import Program
from armcontour.robot.scene import Mesh, Obstacle, Shape


def read_step(data: bytes, *, source: str, options: ReadOptions) -> Program:
    """Read the edges of a model that `options.edges` selects, as `Model.program` does."""
    with error_context("", "path", "edges"):
        return _open(data, source, options).program(
            *options.rules,
            axis=options.tool_axis,
            tolerance=options.chord_tolerance,
            join_tolerance=options.join_tolerance,
            repair=options.repair_vertices,
        )


def read_parts(
    file: FilePath, options: ReadOptions, *, margin: float | None, allow: Sequence[str]
) -> tuple[Obstacle, ...]:
    """Read the parts of a model as obstacles, scaled by the options.

    Args:
        file: The file.
        options: Options with which its edges are read.
        margin: Smallest allowed distance of links and tool [m]; None is that of the scene.
        allow: Names of links and of shapes of the tool that may touch the parts.
    """
    content = read_bytes(file, "file", maximum=MAX_HAND_WRITTEN)
    parts = _open(content, file.name, options).obstacles(margin=margin, allow=tuple(allow))
    return tuple(replace(x, shape=_scale(x.shape, options.scale)) for x in parts)


def _open(content: bytes, source: str, options: ReadOptions) -> Model:
    """Return a model with what its rules and its obstacles need, so that it is read only once."""
    return Model(content, source, unit=options.unit, rules=options.rules, triangles=True)


def _scale(mesh: Shape, scale: float) -> Shape:
    """Return a mesh scaled about the origin."""
    assert isinstance(mesh, Mesh)
    return replace(mesh, points=mesh.points * scale)
