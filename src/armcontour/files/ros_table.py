"""CSV of ROS topics: names of joints in cells, and messages without column titles."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from armcontour.core.errors import InvalidInput
from armcontour.core.text import count_noun, list_some, show
from armcontour.files.csv_table import MAX_NAMED, NUMBER, CsvColumn, CsvTable
from armcontour.files.joint_table import QUANTITIES, JointColumn
from armcontour.motion.log import is_same_joint

# Titles of columns with the name of a joint, as in `field.name0` or `joint_names[2]`.
_NAME_TITLE = re.compile(r"(?:.*[./ ])?(?:joint_)?names?[_ ]?\[?\d+\]?", re.IGNORECASE)
# The last number of a title is the index of a joint.
_INDEX = re.compile(r".*?(\d+)\D*")
# Number of columns before the joint names: seconds, nanoseconds and frame name.
_HEADER = 3


def joint_state_titles(cells: Sequence[str]) -> list[str] | None:
    """Column titles of a JointState in a row of `ros2 topic echo --csv`; None for other rows.

    The row has seconds, nanoseconds, the name of the frame, n names, n positions, and n velocities
    and n efforts, each of which can be missing.
    """
    rest = cells[_HEADER:]
    is_stamped = len(rest) > 0 and all(x.isdigit() for x in cells[:2]) and not _is_number(cells[2])
    if not is_stamped:
        return None
    n = next((k for k, x in enumerate(rest) if _is_number(x)), 0)
    arrays: Mapping[int, tuple[str, ...]] = {
        1: ("position",),
        # Either array can be missing.
        2: ("position", "velocity_or_effort"),
        3: ("position", "velocity", "effort"),
    }
    numbers = rest[n:]
    if not n or len(numbers) % n or len(numbers) // n not in arrays:
        return None
    if not all(rest[:n]) or not all(map(_is_number, numbers)):
        return None
    names = ("name", *arrays[len(numbers) // n])
    return ["sec", "nanosec", "frame_id", *(f"{x}[{k}]" for x in names for k in range(n))]


def _is_number(text: str) -> bool:
    return NUMBER.fullmatch(text) is not None or text.lower() in ("nan", ".nan")


def name_joints(
    table: CsvTable[JointColumn], joint_names: Sequence[str]
) -> tuple[CsvTable[JointColumn], tuple[str, ...]]:
    """Name the joints of a table instead of numbering them; returns the table and a note.

    The names are the cells of columns such as `field.name0`, or cells with a name of `joint_names`.
    A column belongs to the name with the same index in its title, or else with the same place among
    the columns of its quantity. A table without names is returned unchanged.
    """
    columns = _name_columns(table, joint_names)
    if not columns:
        return table, ()
    names = _constant_names(table, columns)
    # Names that the option gives to joints whose own names the arm does not have.
    given: dict[str, str] = {}
    assigned: dict[JointColumn, CsvColumn] = {}
    # Positions come first, so rates follow the names that the option gives to positions.
    for kind in ("t", *QUANTITIES):
        for role in dict.fromkeys(x.role for x in table.columns if x.kind == kind):
            keys = [x for x in table.columns if (x.kind, x.role) == (kind, role)]
            called = _names_of_group(table, keys, names) if kind in QUANTITIES else [""]
            for key, name in zip(keys, called, strict=True):
                if name and not key.joint.isdigit() and key.joint != name:
                    _refuse_known_joint(table, key, name, joint_names)
                    given[name] = key.joint
                own = key._replace(joint=given.get(name, name))
                _refuse_same_joint(table, own, assigned.get(own), table.columns[key])
                assigned[own] = table.columns[key]
    _refuse_two_arms(table, assigned, joint_names)
    used = [table.titles[i] for i in columns]
    unknown = tuple(x for x in table.unknown if x not in used)
    listed = list_some(list(names.values()), MAX_NAMED)
    note = f"The columns of {table.source} are assigned to joints by the names in it: {listed}."
    return replace(table, columns=assigned, unknown=unknown), (note,)


def _refuse_known_joint(
    table: CsvTable[JointColumn], key: JointColumn, name: str, joint_names: Sequence[str]
) -> None:
    """Raise InvalidInput if a column has another name than that of the file, which the arm has."""
    if any(is_same_joint(name, x) for x in joint_names):
        title = table.file_title(key)
        raise InvalidInput(
            f"{table.heading}: {table.option} names the column {show(title)} {show(key.joint)}, "
            f"but in the file it is the joint {show(name)} of the arm. Remove {show(title)} from "
            f"{table.option}."
        )


def _refuse_same_joint(
    table: CsvTable[JointColumn], key: JointColumn, first: CsvColumn | None, second: CsvColumn
) -> None:
    """Raise InvalidInput if two columns have the same quantity of one joint."""
    if first is not None:
        titles = [table.titles[x.index] for x in (first, second)]
        raise InvalidInput(
            f"{table.heading}: the columns {show(titles[0])} and {show(titles[1])} both are of the "
            f"joint {show(key.joint)}. Ignore one of them with {table.option} '-={titles[1]}'."
        )


def _refuse_two_arms(
    table: CsvTable[JointColumn],
    columns: Mapping[JointColumn, CsvColumn],
    joint_names: Sequence[str],
) -> None:
    """Raise InvalidInput if two joints of the file, with prefixes, can be a joint of the arm."""
    positions = {x: y for x, y in columns.items() if x.kind == "q"}
    names = list(dict.fromkeys(x.joint for x in positions))
    for joint in joint_names:
        alike = [x for x in names if is_same_joint(x, joint)]
        if joint in alike or len(alike) < 2:
            continue
        prefix = alike[1].removesuffix(joint)
        others = [y.index for x, y in positions.items() if x.joint.startswith(prefix)]
        ignored = ",".join(f"-={table.titles[i]}" for i in others)
        raise InvalidInput(
            f"{table.heading}: {show(alike[0])} and {show(alike[1])} can both be the joint {joint} "
            f"of the arm. Ignore the positions of one arm, such as {table.option} '{ignored}'."
        )


def _name_columns(table: CsvTable[JointColumn], joint_names: Sequence[str]) -> list[int]:
    """Return the indices of the columns with names of joints."""
    recognized = {x.index for x in table.columns.values()}
    cells = table.first_cells()
    if len(cells) != table.width:
        # The error follows when the rows are read.
        return []
    with_text = [i for i, x in enumerate(cells) if i not in recognized and x and not _is_number(x)]
    titled = [i for i in with_text if _NAME_TITLE.fullmatch(table.titles[i])]
    known = [i for i in with_text if any(is_same_joint(cells[i], x) for x in joint_names)]
    sizes = Counter((x.kind, x.role) for x in table.columns if x.kind == "q")
    # Other texts than names of joints can have such a title.
    is_complete = len(titled) >= min(sizes.values(), default=0)
    return titled if titled and (known or is_complete) else known


def _constant_names(table: CsvTable[JointColumn], columns: Sequence[int]) -> dict[int, str]:
    """Return the joint name in each column; raise InvalidInput if a column has several names.

    `columns`: indices of the columns, which are the keys of the result.
    """
    first_row = table.cells(0)
    names = {i: first_row[i] for i in columns}
    for row in range(1, len(table.lines)):
        cells = table.cells(row)
        i = next((i for i, x in names.items() if cells[i] != x), None)
        if i is not None:
            raise InvalidInput(
                f"{table.place(row)}: the joint {show(cells[i])} is in the column in which the "
                f"first row has {show(names[i])}. Record one publisher, whose order of joints does "
                "not change.",
                index=row,
            )
    return names


def _names_of_group(
    table: CsvTable[JointColumn], keys: Sequence[JointColumn], names: Mapping[int, str]
) -> list[str]:
    """Return each column's joint name for one quantity, in the order of `keys`."""
    indices = [table.columns[x].index for x in keys]
    by_number = {_index(table.titles[i]): name for i, name in names.items()}
    numbers = [_index(table.titles[i]) for i in indices]
    if len(by_number) == len(names) and set(numbers) <= set(by_number) - {None}:
        return [by_number[x] for x in numbers]
    if len(keys) != len(names):
        title = show(table.titles[indices[0]])
        raise InvalidInput(
            f"{table.heading}: the file names {count_noun(len(names), 'joint')}, but has "
            f"{count_noun(len(keys), 'column')} like {title}, so their joints are unknown. Name "
            f"the columns by joint ({table.option} 'JOINT={table.titles[indices[0]]}')."
        )
    ordered = [names[i] for i in sorted(names)]
    return [ordered[sorted(indices).index(i)] for i in indices]


def _index(title: str) -> str | None:
    """Return the last number of a title, without leading zeros; None without a number."""
    match = _INDEX.fullmatch(title)
    return str(int(match[1])) if match else None
