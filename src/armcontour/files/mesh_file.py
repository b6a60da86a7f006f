"""Meshes of bodies, read by trimesh."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path as FilePath

import numpy as np
import numpy.typing as npt

from armcontour.core import file_access
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import parse_quantity
from armcontour.core.text import show
from armcontour.robot.scene import LARGEST, SMALLEST, Mesh

MESHES = (".stl", ".obj")
# Maximum number of triangles, as in a scan of a whole machine. Distances of larger meshes take
# minutes.
MAX_TRIANGLES = 2_000_000
# Maximum file size [bytes], approximately that of two million triangles in ASCII STL.
MAX_BYTES = 600 * file_access.MEGABYTE


def read_mesh(
    file: str | FilePath,
    *,
    unit: str | None = None,
    scale: npt.ArrayLike | None = None,
) -> Mesh:
    """Read the triangle mesh of a body.

    Triangles of zero area are omitted, because their edges also belong to other triangles.

    Args:
        file: A .stl file, binary or ASCII, or a .obj file.
        unit: Unit of the lengths in the file, such as "mm"; metres by default.
        scale: Scale factors of x, y and z, or one factor for all axes.

    Raises:
        InvalidInput: The file does not exist or has another format, no triangles, too many
            triangles or an invalid number; or neither unit nor scale is given and the size in
            metres is unlikely.
    """
    location = FilePath(file)
    kind = location.suffix.lower()
    if kind not in MESHES:
        raise InvalidInput(
            f"The format of the mesh {location} is not supported. Convert it to "
            f"{' or '.join(MESHES)}."
        )
    factor = 1.0 if unit is None else _factor(unit, location)
    content = file_access.read_bytes(location, "mesh", maximum=MAX_BYTES)
    points, triangles = _read(content, location)
    points = points * factor * (1.0 if scale is None else np.asarray(scale))
    if unit is None and scale is None:
        _check_size(points, location)
    first, second, third = points[triangles.T]
    flat = ~np.cross(second - first, third - first).any(axis=1)
    if flat.all():
        raise InvalidInput(
            f"All triangles of the mesh {location} have zero area. Export the mesh again."
        )
    return Mesh(points=points, triangles=triangles[~flat], source=location.name)


def _read(content: bytes, location: FilePath) -> tuple[FloatArray, IntArray]:
    """Return the unique points, (n, 3), and triangles as point indices, (m, 3), of a file."""
    import trimesh

    kind = location.suffix.lower()[1:]
    damaged = InvalidInput(
        f"The mesh {location} has no triangles, is incomplete, or does not have the format {kind}. "
        "Export it again."
    )
    try:
        mesh = trimesh.load_mesh(BytesIO(content), kind, process=False, skip_materials=True)
    except Exception:  # Damaged files raise errors of any class.
        raise damaged from None
    if mesh.vertices.shape[1:] != (3,) or not len(mesh.faces):
        raise damaged
    if not np.isfinite(mesh.vertices).all():
        raise InvalidInput(
            f"The mesh {location} has a corner whose coordinates are not finite. Export the mesh "
            "again."
        )
    mesh.merge_vertices()
    points = np.array(mesh.vertices)
    triangles = np.array(mesh.faces)
    count = len(triangles)
    if count > MAX_TRIANGLES:
        raise InvalidInput(
            f"The mesh {location} has {count:,} triangles, but at most {MAX_TRIANGLES:,} are "
            "allowed. Export a coarser mesh."
        )
    return points, triangles


def _factor(unit: str, location: FilePath) -> float:
    """Return the conversion factor from a unit of length to metres."""
    try:
        return parse_quantity(f"1 {unit}", "m")
    except ValueError:
        raise InvalidInput(
            f"The unit of the mesh {location} must be a unit of length such as mm, but is "
            f"{show(unit)}."
        ) from None


def _check_size(points: FloatArray, location: FilePath) -> None:
    """Check that the size of a mesh is likely in metres."""
    size = float(np.ptp(points, axis=0).max())
    if SMALLEST <= size <= LARGEST:
        return
    raise InvalidInput(
        f"The mesh {location} would be {size:.4g} m large if its unit were m, but bodies in a cell "
        f"must be {SMALLEST:g} to {LARGEST:g} m large. Specify its unit, such as unit: mm (in a "
        'URDF, scale="0.001 0.001 0.001").'
    )
