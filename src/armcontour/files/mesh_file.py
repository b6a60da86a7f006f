"""Reader of meshes of bodies: STL (binary and ASCII) and OBJ."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path as FilePath

import numpy as np
import numpy.typing as npt

from armcontour.core import file_access
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.text import plain_number, show
from armcontour.files.units import parse_quantity
from armcontour.robot.scene import LARGEST, SMALLEST, Mesh

MESHES = (".stl", ".obj")
# Maximum number of triangles, as in a scan of a whole machine. Distances of larger meshes take
# minutes.
MAX_TRIANGLES = 2_000_000
# Maximum file size [bytes], approximately that of two million triangles in ASCII STL.
MAX_BYTES = 600 * file_access.MEGABYTE
# Sizes in binary STL [bytes]: the header with the number of triangles, and a triangle (twelve
# numbers and two bytes).
HEADER, RECORD = 84, 50
VERTEX_LINE = re.compile(rb"^\s*vertex[ \t]+(.*)$", re.MULTILINE)
# Units of length in mesh files, in the order in which they are suggested.
SUGGESTED_UNITS = ("mm", "inch", "cm", "km")
# Usual range of the size of a body in a cell [m].
USUAL_SIZE = (0.01, 5.0)


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
    points, triangles = (_read_stl if kind == ".stl" else _read_obj)(content, str(location))
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


def _factor(unit: str, location: FilePath) -> float:
    """Conversion factor from a unit of length to metres."""
    try:
        return parse_quantity(f"1 {unit}", "m")
    except ValueError:
        raise InvalidInput(
            f"The unit of the mesh {location} must be a unit of length such as mm, but is "
            f"{show(unit)}."
        ) from None


def _check_size(points: FloatArray, location: FilePath) -> None:
    """Check that the size of a mesh is likely in metres; the error suggests a unit."""
    size = float(np.ptp(points, axis=0).max())
    if SMALLEST <= size <= LARGEST:
        return
    factors = {x: parse_quantity(f"1 {x}", "m") for x in SUGGESTED_UNITS}
    hint = "Specify its unit or a scale."
    for unit, factor in factors.items():
        if USUAL_SIZE[0] <= size * factor <= USUAL_SIZE[1]:
            scale = " ".join([f"{factor:g}"] * 3)
            hint = (
                f"If its unit is {unit}, it is {size * factor:.4g} m large; then specify unit: "
                f'{unit} (in a URDF, scale="{scale}").'
            )
            break
    raise InvalidInput(
        f"The mesh {location} would be {size:.4g} m large if its unit were m, but bodies in a cell "
        f"must be {SMALLEST:g} to {LARGEST:g} m large. {hint}"
    )


def _read_stl(content: bytes, source: str) -> tuple[FloatArray, IntArray]:
    """Points, (n, 3), and triangles as point indices, (m, 3), of an STL file, binary or ASCII."""
    if content[:5].lower() == b"solid" and b"vertex" in content[:4096]:
        corners = _ascii_corners(content, source)
    else:
        corners = _binary_corners(content, source)
    points, index = _merge_corners(corners)
    return points, index.reshape(-1, 3)


def _binary_corners(content: bytes, source: str) -> FloatArray:
    """Corners of the triangles of a binary STL file, (3 n, 3)."""
    count = int.from_bytes(content[80:HEADER], "little")
    if len(content) < HEADER + RECORD * count:
        raise InvalidInput(
            f"The mesh {source} is incomplete or is not an STL file. Its {count} triangles need "
            f"{HEADER + RECORD * count} bytes, but it has {len(content)} bytes."
        )
    _check_triangle_count(count, source)
    rows = np.frombuffer(content, np.uint8, RECORD * count, HEADER).reshape(-1, RECORD)
    corners = rows[:, 12:48].copy().view("<f4").reshape(-1, 3).astype(np.float64)
    wrong = ~np.isfinite(corners).all(axis=1)
    if wrong.any():
        raise InvalidInput(
            f"Triangle {int(np.argmax(wrong)) // 3 + 1} of the mesh {source} has a corner whose "
            "coordinates are not finite. Export the mesh again."
        )
    return corners


def _ascii_corners(content: bytes, source: str) -> FloatArray:
    """Corners of the triangles of an ASCII STL file, (3 n, 3)."""
    words = [x.split() for x in VERTEX_LINE.findall(content)]
    _check_triangle_count(len(words) // 3, source)
    if len(words) % 3:
        raise InvalidInput(
            f"The mesh {source} has {len(words)} vertices, but the number must be a multiple of 3."
        )
    try:
        corners = np.array(words, dtype=np.float64)
        good = corners.shape[1:] == (3,) and bool(np.isfinite(corners).all())
    except ValueError:
        good = False
    if not good:
        for match in VERTEX_LINE.finditer(content):
            line = content.count(b"\n", 0, match.start(1)) + 1
            _read_vertex(match[1].decode("utf-8", "replace").split(), source, line)
    return corners


def _read_obj(content: bytes, source: str) -> tuple[FloatArray, IntArray]:
    """Points, (n, 3), and triangles, (m, 3), of an OBJ file; polygons are split into triangles."""
    points: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, words in _obj_lines(content):
        if words[0] == "v":
            points.append(_read_vertex(words[1:4], source, number))
        elif words[0] == "f":
            corners = [_vertex_index(x, len(points), source, number) for x in words[1:]]
            if len(corners) < 3:
                raise InvalidInput(
                    f"{source}, line {number}: a face must have at least 3 vertices, but has "
                    f"{len(corners)}."
                )
            triangles += [(corners[0], *x) for x in zip(corners[1:-1], corners[2:], strict=True)]
            _check_triangle_count(len(triangles), source)
    _check_triangle_count(len(triangles), source)
    return np.array(points), np.array(triangles)


def _obj_lines(content: bytes) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the words of each line with a vertex or a face."""
    for number, line in enumerate(content.splitlines(), start=1):
        if line[:2] in (b"v ", b"f ", b"v\t", b"f\t"):
            yield number, line.split(b"#")[0].decode("utf-8", "replace").split()


def _vertex_index(word: str, count: int, source: str, line: int) -> int:
    """Index of a vertex, from 0, of a face corner such as 7, 7/1/3 or -2."""
    text = word.split("/")[0]
    try:
        index = int(text)
    except ValueError:
        index = 0
    # Indices start at 1; negative indices count backwards from the last vertex before the face.
    position = index - 1 if index > 0 else count + index
    if index == 0 or not 0 <= position < count:
        raise InvalidInput(
            f"{source}, line {line}: the face has the vertex {show(text)}, but only {count} "
            "vertices are defined before it."
        )
    return position


def _read_vertex(words: list[str], source: str, line: int) -> list[float]:
    """The three finite coordinates of a vertex, from the words of a line."""
    numbers = [plain_number(x) for x in words]
    if len(numbers) != 3 or None in numbers:
        raise InvalidInput(
            f"{source}, line {line}: a vertex must have three finite numbers, but has "
            f"{show(' '.join(words))}."
        )
    return [float(x) for x in numbers if x is not None]


def _check_triangle_count(count: int, source: str) -> None:
    """Check that a mesh has triangles, and not more than MAX_TRIANGLES."""
    if count == 0:
        raise InvalidInput(f"The mesh {source} has no triangles. Export the mesh again.")
    if count > MAX_TRIANGLES:
        raise InvalidInput(
            f"The mesh {source} has {count:,} triangles, but at most {MAX_TRIANGLES:,} are "
            "allowed. Export a coarser mesh."
        )


def _merge_corners(corners: FloatArray) -> tuple[FloatArray, IntArray]:
    """Unique points, (m, 3), and the index of each corner among them, (n,)."""
    # Adding 0.0 converts -0.0 to 0.0, because the bytes of both numbers differ.
    rows = np.ascontiguousarray(corners + 0.0).view(np.dtype((np.void, 24))).ravel()
    _, first, index = np.unique(rows, return_index=True, return_inverse=True)
    return corners[first], index.astype(np.intp)
