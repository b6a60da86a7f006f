"""Reader for touches: joint positions at points that the robot's tool touched, in a CSV table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath

import numpy as np

from armcontour.core.checks import FloatArray, Frozen
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import Quantity, read_quantity
from armcontour.core.text import list_some, plain_number, show
from armcontour.files.csv_table import MAX_NAMED, CsvTable, Title, read_table
from armcontour.files.joint_table import SI, read_csv_text, read_joint_title
from armcontour.robot import Arm

POINT = ("x", "y", "z")
# Largest number of touches, which are fitted in seconds.
MOST_TOUCHES = 2000
# Kinds of typed values, by the unit of those without a unit.
KINDS = {"mm": Quantity("m", "5 mm"), "deg": Quantity("rad", "90 deg")}
OPTION = "--columns"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touches(Frozen):
    """Touches of a file, in SI units."""

    # Touched points in the coordinates of the drawing [m], (n, 2) or (n, 3); None if the file has
    # no columns x and y
    points: FloatArray | None
    q: FloatArray  # Joint positions [rad], [m] for prismatic joints, (n, dof)
    notes: tuple[str, ...]  # Notes on columns that are not used


def read_touches(file: str | FilePath, arm: Arm, columns: str | None = None) -> Touches:
    """Read touches from a CSV table with a row per touch.

    The columns are the joint positions, by number (`q1 [deg]`) or by the joints' names, and for a
    part the coordinates of the touched points in its drawing (`x [mm]`, `y [mm]`, and `z [mm]` in
    space). All titles have a unit.

    Args:
        file: The CSV file.
        arm: Arm whose joints the file has.
        columns: Names of the columns of a file without titles, or new names, as for logs.

    Raises:
        InvalidInput: The file does not exist or is not a table, a column is missing or has no unit,
            a value is not a number, or there are more than 2000 touches.
    """
    location = FilePath(file)
    table = read_table(
        read_csv_text(location, "table of touches"),
        location.name,
        partial(_title, arm=arm),
        example="x [mm],y [mm],z [mm],q1 [deg],q2 [deg]",
        columns=columns,
        option=OPTION,
    )
    joints = [f"q{k + 1}" for k in range(arm.dof)]
    table.require_columns(*joints)
    has_points = any(name in table.columns for name in POINT)
    if has_points:
        table.require_columns(*POINT[:2])
    coordinates = [name for name in POINT if name in table.columns]
    _require_units(table, [*coordinates, *joints])
    if len(table.lines) > MOST_TOUCHES:
        raise InvalidInput(
            f"{table.source} has {len(table.lines)} touches, but at most {MOST_TOUCHES} are read. "
            "Remove rows."
        )
    values, _ = table.read([*coordinates, *joints])
    empty = np.argwhere(np.isnan(values))
    if len(empty):
        row, column = empty[0]
        table.raise_cell_error(int(row), [*coordinates, *joints][column])
    notes = list[str]()
    if table.unknown:
        names = list_some([show(x) for x in table.unknown], MAX_NAMED)
        notes.append(f"Columns of {table.source} that are not used: {names}.")
    count = len(coordinates)
    return Touches(
        points=values[:, :count] if has_points else None,
        q=values[:, count:],
        notes=tuple(notes),
    )


def read_typed(name: str, text: str, unit: str) -> float:
    """Read a typed value in SI units.

    - `name`: name of the value, for the message.
    - `text`: number, or quantity with a unit.
    - `unit`: unit of a number, mm or deg.

    Raises:
        InvalidInput: The text is no such quantity.
    """
    value = text if plain_number(text) is None else f"{text} {unit}"
    try:
        return read_quantity(value, KINDS[unit])
    except ValueError as error:
        raise InvalidInput(f"{name} {error}.") from None


def read_doubts(text: str) -> list[str]:
    """Read typed names of doubts to accept, separated by commas: "scaled, touch"."""
    return [x.strip() for x in text.split(",") if x.strip()]


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchColumn:
    """A column of a table in which touches are typed."""

    name: str  # Coordinate of the point in the drawing, or name of the joint
    label: str  # Short name, as in the titles of a file: x, y, z, or q1, q2, ...
    unit: str  # Unit of values without a unit: mm or deg

    def read(self, text: str, number: int) -> float:
        """Read a typed value in SI units.

        - `text`: number, or quantity with a unit.
        - `number`: number of the touch, from 1.

        Raises:
            InvalidInput: The text is empty or no such quantity.
        """
        if not text:
            raise InvalidInput(
                f"Touch {number} has no value of {self.title}. Type it in {self.unit}."
            )
        return read_typed(f"Touch {number}: {self.title}", text, self.unit)

    @property
    def title(self) -> str:
        """Name in messages: the short name, and the name of the joint if it differs."""
        return self.label if self.label == self.name else f"{self.label} ({self.name})"


def touch_columns(arm: Arm) -> tuple[TouchColumn, ...]:
    """Return the columns of a table in which touches are typed: the point, then the joints."""
    point = [TouchColumn(name=x, label=x, unit="mm") for x in POINT[: arm.dimension]]
    joints = [
        TouchColumn(name=name, label=f"q{k + 1}", unit="mm" if slides else "deg")
        for k, (name, slides) in enumerate(zip(arm.joint_names, arm.chain.slides, strict=True))
    ]
    return (*point, *joints)


def read_touch_rows(rows: Sequence[Sequence[str]], arm: Arm) -> Touches:
    """Read touches from the cells of a table.

    Args:
        rows: Texts of the cells, one row per touch, in the order of `touch_columns`. Rows without
            any text are ignored. The point is empty in all rows for the three-point method.
        arm: Arm whose joints were read.

    Raises:
        InvalidInput: A row has another number of cells, or a cell is empty or no quantity.
    """
    columns = touch_columns(arm)
    filled = {}
    for number, row in enumerate(rows, 1):
        if len(row) != len(columns):
            raise InvalidInput(
                f"Touch {number} has {len(row)} values, but {', '.join(x.label for x in columns)} "
                f"are {len(columns)}."
            )
        cells = [x.strip() for x in row]
        if any(cells):
            filled[number] = cells
    if not filled:
        raise InvalidInput("There are no touches. Type the joint positions of each touch.")
    count = arm.dimension
    has_points = any(text for cells in filled.values() for text in cells[:count])
    first = 0 if has_points else count
    values = np.array(
        [
            [x.read(text, number) for x, text in zip(columns[first:], cells[first:], strict=True)]
            for number, cells in filled.items()
        ]
    )
    points = values[:, :count] if has_points else None
    return Touches(points=points, q=values[:, count - first :], notes=())


def _title(name: str, arm: Arm) -> Title[str] | None:
    """Recognize the title of a coordinate or joint position; None for other titles."""
    plain = name.strip()
    if plain.lower() in POINT:
        return Title(plain.lower(), "m")
    title = read_joint_title(plain, arm.joint_names)
    if title is None or title.key.kind != "q":
        return None
    joint = title.key.joint
    if joint in arm.joint_names:
        joint = str(arm.joint_names.index(joint) + 1)
    return Title(f"q{joint}", SI["q"])


def _require_units(table: CsvTable[str], keys: list[str]) -> None:
    """Refuse columns without a unit, because degrees and radians look alike in a few touches."""
    for key in keys:
        column = table.columns[key]
        if column.unit is None:
            unit = "mm" if key in POINT else "deg"
            raise InvalidInput(
                f"{table.heading}: the column {show(column.title)} has no unit. Write it in "
                f"brackets, such as {column.title} [{unit}], or rename the column with "
                f"{table.rename(f'{column.title} [{unit}]', table.file_title(key))}."
            )
