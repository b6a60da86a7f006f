"""Reader for waypoints in CSV tables: points, tool orientations, speeds and tolerances."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from itertools import accumulate

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.frames import QUATERNION_TOLERANCE, from_rpy
from armcontour.core.text import show
from armcontour.files.csv_table import CsvTable, Title, read_table
from armcontour.files.drawings.read_options import MAX_COORDINATE, ReadOptions, repair_vertices
from armcontour.geometry import Path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program import Contour, Program

POINT = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
ANGLES = ("roll", "pitch", "yaw")
AXIS = ("ax", "ay", "az")
TEXTS = ("contour", "layer")
KNOWN = (*POINT, *QUATERNION, *ANGLES, *AXIS, "speed", "tolerance", *TEXTS)
# SI units of the columns with a unit.
UNITS = {
    **dict.fromkeys((*POINT, "tolerance"), "m"),
    **dict.fromkeys(ANGLES, "rad"),
    "speed": "m/s",
}
_NAME = re.compile(r"(?P<name>[A-Za-z]+)(?:_(?P<unit>[A-Za-zµ°]\S*))?")


def read_waypoints(data: bytes, *, source: str, options: ReadOptions) -> Program:
    """Read a program from a table of waypoints, which are connected by straight lines.

    The columns are `x`, `y` and, in space, `z`. Optional columns are the tool orientation (`qx`,
    `qy`, `qz`, `qw`, or `roll`, `pitch`, `yaw` about fixed axes, or the tool axis `ax`, `ay`, `az`
    with free rotation about the axis), `speed`, `tolerance`, `contour` and `layer`. A unit
    follows in brackets or as a suffix: `x [mm]`, `x_mm`. Without a unit, lengths are in
    `options.unit` or m, speeds in this unit per second, and angles in rad. Speed and tolerance of a
    row apply to the line that ends at the waypoint of the row. A new name in `contour` or `layer`
    starts a new contour.
    """
    table, notes = _read(data, source, options)
    values = _quantities(table, options)
    orientation = _read_orientation_columns(table, values)
    texts = {key: list(accumulate(_texts(table, key), _fill_down)) for key in TEXTS}
    bounds = [0, *_changes(texts), len(table.lines)]
    contours = []
    for k, (first, last) in enumerate(zip(bounds[:-1], bounds[1:], strict=True)):
        rows = slice(first, last)
        path = _path(table, values, rows)
        path = _orient(table, path, orientation, rows)
        for key in texts.keys() & table.columns.keys():
            checks.check_name(f"name in {table.place(first, key)}", texts[key][first])
        name = texts["contour"][first] or f"contour {k + 1}"
        layer = texts["layer"][first]
        contours.append(Contour(path=path, name=name, number=k + 1, layer=layer))
    program = Program(moves=tuple(contours), source=source, notes=tuple(notes))
    return repair_vertices(program, options)


def _read(data: bytes, source: str, options: ReadOptions) -> tuple[CsvTable[str], list[str]]:
    """Return the table in a file, and notes on unknown columns."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileError(
            f"{source} must be text in UTF-8, but is not. Save it as CSV in UTF-8."
        ) from None
    table = read_table(
        text,
        source,
        _title,
        example="x [mm],y [mm],z [mm]",
        columns=options.columns,
        option="path.columns (--waypoint-columns)",
    )
    if table.unknown and not options.skips:
        raise InvalidInput(
            f"{table.heading}: unknown column {show(table.unknown[0])}. The columns must be "
            f"{', '.join(KNOWN)}, with a unit in brackets. To ignore other columns, set "
            "unknown: skip (--skip-unknown)."
        )
    for group in (POINT[:2], QUATERNION, ANGLES, AXIS):
        if group[0] in POINT or not table.columns.keys().isdisjoint(group):
            table.require_columns(*group)
    return table, [
        f"The column {show(x)} of {source} is unknown and is skipped." for x in table.unknown
    ]


def _title(name: str) -> Title[str] | None:
    """Return the content and unit of a column from its title; None if the title is unknown."""
    match = _NAME.fullmatch(name.strip())
    key = match["name"].lower() if match else ""
    if match is None or key not in KNOWN:
        return None
    unit = match["unit"]
    return Title(key, UNITS.get(key), unit and unit.replace("_per_", "/").replace("_", "/"))


def _quantities(table: CsvTable[str], options: ReadOptions) -> dict[str, FloatArray]:
    """Return the numbers in SI units by column, (rows,) each; NaN if a cell is empty."""
    has_unit = {x: table.columns[x].unit is not None for x in POINT if x in table.columns}
    if len(set(has_unit.values())) > 1:
        has, lacks = (next(k for k, v in has_unit.items() if v is x) for x in (True, False))
        raise InvalidInput(
            f"{table.source}: the column {table.columns[has].title!r} has a unit, but the column "
            f"{table.columns[lacks].title!r} has none. Add a unit to this column."
        )
    keys = [x for x in table.columns if x not in TEXTS]
    values = {}
    for key, numbers in zip(keys, table.read(keys)[0].T, strict=True):
        column = table.columns[key]
        unit = UNITS.get(key, "") if column.unit is None else column.unit
        if column.unit is None and UNITS.get(key) in ("m", "m/s"):
            numbers = numbers * (options.unit or 1.0)
        for bad, must in (
            (np.isnan(numbers) & (key in POINT), "must not be empty"),
            (
                np.abs(numbers) > MAX_COORDINATE,
                f"must be within {MAX_COORDINATE / column.factor:g} {unit}",
            ),
            ((numbers <= 0) & (key == "speed"), "must be above zero"),
            ((numbers < 0) & (key == "tolerance"), "must not be negative"),
        ):
            if bad.any():
                i = int(np.argmax(bad))
                but = "" if np.isnan(numbers[i]) else f", but is {table.cell(i, key)}"
                raise InvalidInput(f"{table.place(i, key)}: the value {must}{but}.", index=i)
        values[key] = numbers
    return values


def _read_orientation_columns(
    table: CsvTable[str], values: Mapping[str, FloatArray]
) -> tuple[tuple[str, ...], FloatArray] | None:
    """Return the columns of the tool orientation and their numbers, (rows, 3 or 4).

    None if the table has no such columns.
    """
    kinds = [x for x in (QUATERNION, ANGLES, AXIS) if x[0] in values]
    if not kinds:
        return None
    if len(kinds) > 1:
        raise InvalidInput(
            f"{table.source} defines the tool orientation twice, in the columns "
            f"{', '.join(kinds[0])} and {', '.join(kinds[1])}. Remove one of these groups."
        )
    keys = kinds[0]
    if "z" not in values:
        raise InvalidInput(
            f"{table.source}: a tool orientation requires points in space. Add the column z."
        )
    numbers = np.stack([values[key] for key in keys], axis=1)
    # A quaternion must have length 1; a tool axis may have any length above 0.
    size = np.linalg.norm(numbers, axis=1)
    if keys == QUATERNION:
        bad = np.abs(size - 1) > QUATERNION_TOLERANCE
        must = "a quaternion must have length 1, but"
    else:
        bad = (size == 0) & (keys == AXIS)
        must = "a tool axis must have a length above 0, but"
    partial = np.isnan(numbers).any(axis=1) & ~np.isnan(numbers).all(axis=1)
    for wrong, text in ((partial, "fill all cells of the tool orientation or none"), (bad, must)):
        if wrong.any():
            i = int(np.argmax(wrong))
            length = f" has length {size[i]:.6g}" if text is must else ""
            raise InvalidInput(f"{table.place(i, *keys)}: {text}{length}.", index=i)
    return keys, numbers


def _texts(table: CsvTable[str], key: str) -> list[str]:
    """Return the texts of a column, one per row; empty texts if the column is missing."""
    if key not in table.columns:
        return [""] * len(table.lines)
    texts = list[str]()
    for _, (block,) in table.cell_blocks([key]):
        texts += block
    return texts


def _fill_down(above: str, text: str) -> str:
    """Return the text of a cell, or of the cell above if it is empty."""
    return text or above


def _changes(texts: Mapping[str, Sequence[str]]) -> list[int]:
    """Return the indices of the rows at which a new contour starts, except the first row."""
    rows = list(zip(*texts.values(), strict=True))
    return [i for i in range(1, len(rows)) if rows[i] != rows[i - 1]]


def _path(table: CsvTable[str], values: Mapping[str, FloatArray], rows: slice) -> Path:
    """Return the path of lines through the points of some rows, with limits and origins."""
    points = np.stack([values[key][rows] for key in POINT if key in values], axis=1)
    first = int(table.numbers[rows][0])
    if (np.linalg.norm(points - points[0], axis=1) <= REPEATED_POINT).all():
        raise InvalidInput(
            f"{table.source}: the contour that starts in line {first} has no two different "
            "points. Add a waypoint, or remove the contour."
        )
    path = Path.polyline(points)
    ends = np.delete(np.arange(len(points)), path.merged)[1:]
    speeds, tolerances = (
        values[key][rows][ends] if key in values else np.full(len(path), np.nan)
        for key in ("speed", "tolerance")
    )
    segments = path.segments.replace(
        speeds=speeds,
        tolerances=tolerances,
        origins=np.array(table.numbers[rows], dtype=np.intp)[ends],
    )
    return dataclasses.replace(path, segments=segments)


def _orient(
    table: CsvTable[str],
    path: Path,
    orientation: tuple[tuple[str, ...], FloatArray] | None,
    rows: slice,
) -> Path:
    """Return the path with the tool orientation of some rows; unchanged if these rows have none."""
    if orientation is None:
        return path
    keys = orientation[0]
    numbers = orientation[1][rows]
    empty = np.isnan(numbers[:, 0])
    if empty.all():
        return path
    if empty.any():
        i = rows.start + int(np.argmax(empty))
        raise InvalidInput(
            f"{table.place(i, *keys)}: the tool orientation is empty, but other rows of the "
            "contour have one. Fill these columns in all rows of the contour or in none.",
            index=i,
        )
    from scipy.spatial.transform import Rotation

    try:
        if keys == AXIS:
            return path.pointing(numbers)
        return path.oriented(from_rpy(numbers) if keys == ANGLES else Rotation.from_quat(numbers))
    except InvalidInput as error:
        i = rows.start + (error.index or 0)
        raise InvalidInput(f"{table.place(i, *keys)}: {error}", index=i) from None
