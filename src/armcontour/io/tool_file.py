"""Read positions of the tool over time, as a tracker measured them."""

from __future__ import annotations

import re
from pathlib import Path as FilePath

from armcontour._checks import FloatArray
from armcontour._files import LARGE, read_text
from armcontour.errors import InvalidInput
from armcontour.io.columns import read_titles
from armcontour.io.joint_titles import TIME, read_joint_title
from armcontour.io.number_table import read_columns, split_csv

AXES = ("x", "y", "z")
# Words that may stand beside the axis.
PLAIN = ("tool", "tcp", "actual", "measured", "position", "pos")
UNITS = ("m", "mm", "um", "cm")
EXAMPLE = "t,x,y,z or t [ms],x [mm],y [mm],z [mm]"
_WORDS = re.compile(r"[^\W\d_]+|\d+")


def read_tool_positions(file: str | FilePath, dimension: int) -> tuple[FloatArray, FloatArray]:
    """Read positions of the tool over time from a CSV file.

    The first line names the columns: `t`, `x`, `y` and, of a tool in space, `z`, also as
    `tool x` or `tcp_x`. Units are SI unless in brackets or a suffix: `t [ms]`, `x [mm]`, `x_mm`.
    Other columns are left out. Positions are those of the tool point in the frame of the job's
    path. Separators and comments as in `read_log`.

    Args:
        file: The file.
        dimension: Number of coordinates, 2 or 3.

    Returns:
        Times [s], (n,), and positions [m], (n, dimension).

    Raises:
        InvalidInput: A file of another form; names file and line.
    """
    source = FilePath(file).name
    table = split_csv(read_text(file, "file of tool positions", most=LARGE), source)
    known = read_titles(
        table.names,
        where=table.heading,
        example=EXAMPLE,
        key_of=_quantity,
        si_of=lambda key: "s" if key == "t" else "m",
        unknown=lambda title: None,
    )
    keys = ("t", *AXES[:dimension])
    missing = [key for key in keys if key not in known]
    if missing:
        raise InvalidInput(
            f"{table.heading}: the column {missing[0]} of the tool's positions is missing: name "
            f"the columns such as {','.join(keys)}, with units such as x [mm] if they are not SI."
        )
    used = [known[key] for key in keys]
    values = read_columns(table, [x.index for x in used])[0] * [x.factor for x in used]
    return values[:, 0], values[:, 1:]


def _quantity(name: str, has_unit: bool) -> tuple[str, str | None, int] | None:
    """Quantity, unit and rank of a column by its name; None if not needed."""
    words = [x.lower() for x in _WORDS.findall(name)]
    unit = words.pop() if not has_unit and len(words) > 1 and words[-1] in UNITS else None
    rest = [x for x in words if x not in PLAIN]
    if len(rest) == 1 and rest[0] in AXES:
        return rest[0], unit, 0
    title = read_joint_title(name, has_unit)
    return ("t", title.unit, title.rank) if title is not None and title.key == TIME else None
