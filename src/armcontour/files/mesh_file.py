"""Read meshes of bodies: STL, binary and ASCII, and OBJ."""

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
# Largest number of triangles: a scan of a whole machine; distances of more take minutes.
MAX_TRIANGLES = 2_000_000
# Two million triangles of ASCII STL take about this much [bytes].
MAX_BYTES = 600 * file_access.MEGABYTE
# Binary STL: a header with the number of triangles, and triangles of twelve numbers and two bytes.
HEADER, RECORD = 84, 50
VERTEX = re.compile(rb"^\s*vertex[ \t]+(.*)$", re.MULTILINE)
# Units that drawings of bodies have, and the sizes that bodies in a cell usually have [m].
USUAL = ("mm", "inch", "cm", "km")
LIKELY = (0.01, 5.0)


def read_mesh(
    file: str | FilePath,
    *,
    unit: str | None = None,
    scale: npt.ArrayLike | None = None,
) -> Mesh:
    """Read the triangles of a body.

    Triangles without an area are omitted: their edges belong to their neighbours.

    Args:
        file: A .stl file, binary or ASCII, or a .obj file.
        unit: The unit of its lengths, such as "mm"; metres by default.
        scale: Factors of x, y and z, or one of all.

    Raises:
        InvalidInput: No such file, another format, no triangles, an invalid number, too many
            triangles, or an unlikely size in metres without unit and scale.
    """
    location = FilePath(file)
    kind = location.suffix.lower()
    if kind not in MESHES:
        raise InvalidInput(
            f"The mesh {location} is not read: name a {' or '.join(MESHES)} file, to which "
            "programs for meshes convert others."
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
        raise InvalidInput(f"No triangle of the mesh {location} has an area: export it again.")
    return Mesh(points=points, triangles=triangles[~flat], source=location.name)


def _factor(unit: str, location: FilePath) -> float:
    """A unit of length in metres."""
    try:
        return parse_quantity(f"1 {unit}", "m")
    except ValueError:
        raise InvalidInput(
            f"The mesh {location} has the unit {show(unit)}, which is no unit of length such as mm."
        ) from None


def _check_size(points: FloatArray, location: FilePath) -> None:
    """Check that the size is likely in metres; the error names a unit that fits."""
    size = float(np.ptp(points, axis=0).max())
    if SMALLEST <= size <= LARGEST:
        return
    factors = {x: parse_quantity(f"1 {x}", "m") for x in USUAL}
    hint = "its unit or a scale"
    for unit, factor in factors.items():
        if LIKELY[0] <= size * factor <= LIKELY[1]:
            scale = " ".join([f"{factor:g}"] * 3)
            hint = (
                f"unit: {unit} if that is its unit, which makes it {size * factor:.4g} m large (in "
                f'a URDF, scale="{scale}")'
            )
            break
    raise InvalidInput(
        f"The mesh {location} would be {size:.4g} m large if its lengths were metres, and bodies "
        f"in a cell are {SMALLEST:g} to {LARGEST:g} m: give {hint}."
    )


def _read_stl(content: bytes, source: str) -> tuple[FloatArray, IntArray]:
    """Points and triangles of an STL file, binary or ASCII."""
    if content[:5].lower() == b"solid" and b"vertex" in content[:4096]:
        corners = _ascii_corners(content, source)
    else:
        corners = _binary_corners(content, source)
    points, index = _merge(corners)
    return points, index.reshape(-1, 3)


def _binary_corners(content: bytes, source: str) -> FloatArray:
    """Corners of the triangles of a binary STL file, (3 n, 3)."""
    count = int.from_bytes(content[80:HEADER], "little")
    if len(content) < HEADER + RECORD * count:
        raise InvalidInput(
            f"The mesh {source} ends early, or is no STL file: {count} triangles take "
            f"{HEADER + RECORD * count} bytes, and it has {len(content)}."
        )
    _check_triangle_count(count, source)
    rows = np.frombuffer(content, np.uint8, RECORD * count, HEADER).reshape(-1, RECORD)
    corners = rows[:, 12:48].copy().view("<f4").reshape(-1, 3).astype(np.float64)
    wrong = ~np.isfinite(corners).all(axis=1)
    if wrong.any():
        raise InvalidInput(
            f"Triangle {int(np.argmax(wrong)) // 3 + 1} of the mesh {source} has a corner that is "
            "no finite number: export it again."
        )
    return corners


def _ascii_corners(content: bytes, source: str) -> FloatArray:
    """Corners of the triangles of an ASCII STL file, (3 n, 3)."""
    words = [x.split() for x in VERTEX.findall(content)]
    _check_triangle_count(len(words) // 3, source)
    if len(words) % 3:
        raise InvalidInput(
            f"The mesh {source} ends within a triangle: it has {len(words)} corners."
        )
    try:
        corners = np.array(words, dtype=np.float64)
        good = corners.shape[1:] == (3,) and bool(np.isfinite(corners).all())
    except ValueError:
        good = False
    if not good:
        for match in VERTEX.finditer(content):
            line = content.count(b"\n", 0, match.start(1)) + 1
            _three(match[1].decode("utf-8", "replace").split(), source, line)
    return corners


def _read_obj(content: bytes, source: str) -> tuple[FloatArray, IntArray]:
    """Points and triangles of an OBJ file; faces of more corners are cut into triangles."""
    points: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, words in _obj_lines(content):
        if words[0] == "v":
            points.append(_three(words[1:4], source, number))
        elif words[0] == "f":
            corners = [_corner(x, len(points), source, number) for x in words[1:]]
            if len(corners) < 3:
                raise InvalidInput(f"{source}, line {number}: a face has at least 3 corners.")
            triangles += [(corners[0], *x) for x in zip(corners[1:-1], corners[2:], strict=True)]
            _check_triangle_count(len(triangles), source)
    _check_triangle_count(len(triangles), source)
    return np.array(points), np.array(triangles)


def _obj_lines(content: bytes) -> Iterator[tuple[int, list[str]]]:
    """Lines with vertices and faces, with their numbers."""
    for number, line in enumerate(content.splitlines(), start=1):
        if line[:2] in (b"v ", b"f ", b"v\t", b"f\t"):
            yield number, line.split(b"#")[0].decode("utf-8", "replace").split()


def _corner(word: str, count: int, source: str, line: int) -> int:
    """The index of a corner of a face, such as 7, 7/1/3 or -2."""
    text = word.split("/")[0]
    try:
        index = int(text)
    except ValueError:
        index = 0
    # Indices count from 1, or back from the last vertex so far.
    position = index - 1 if index > 0 else count + index
    if index == 0 or not 0 <= position < count:
        raise InvalidInput(
            f"{source}, line {line}: the face names the vertex {show(text)}, and there are "
            f"{count} before it."
        )
    return position


def _three(words: list[str], source: str, line: int) -> list[float]:
    """Three finite numbers of a line."""
    numbers = [plain_number(x) for x in words]
    if len(numbers) != 3 or None in numbers:
        raise InvalidInput(
            f"{source}, line {line}: a vertex has three finite numbers, not "
            f"{show(' '.join(words))}."
        )
    return [float(x) for x in numbers if x is not None]


def _check_triangle_count(count: int, source: str) -> None:
    """Check the number of triangles of a mesh."""
    if count == 0:
        raise InvalidInput(f"The mesh {source} has no triangles: export it again.")
    if count > MAX_TRIANGLES:
        raise InvalidInput(
            f"The mesh {source} has {count:,} triangles, more than the {MAX_TRIANGLES:,} that are "
            "read: export it coarser."
        )


def _merge(corners: FloatArray) -> tuple[FloatArray, IntArray]:
    """Different points, and the index of each given one among them."""
    # Zero with and without a sign are the same number, but not the same bytes.
    rows = np.ascontiguousarray(corners + 0.0).view(np.dtype((np.void, 24))).ravel()
    _, first, index = np.unique(rows, return_index=True, return_inverse=True)
    return corners[first], index.astype(np.intp)
