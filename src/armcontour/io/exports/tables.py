"""The table as CSV and npz."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.io.exports.table import Table
from armcontour.io.exports.text import (
    csv_pieces,
    event_text,
    joint_columns,
    write_pieces,
)


def write_csv(table: Table, file: FilePath) -> None:
    """Write columns t, then q, dq and ddq of all joints, and `events` if there are any, as CSV.

    If the table has the speed of the tool, its point, orientation and speed are columns too; so
    are analog outputs, `analog power`.
    An event is in the row of the last point at or before it and has its own time:
    `tool=on@0.104000000000; gas=2.5@0.104500000000`.
    """
    header, columns = _columns(table)
    cells = _event_cells(table) if table.events else None
    if cells is not None:
        header.append("events")
    write_pieces(file, csv_pieces(header, columns, cells))


def write_npz(table: Table, file: FilePath) -> None:
    """Write the table to an npz file.

    The arrays are name, joint_names, period, start_time, t, q, dq, ddq, tool,
    tool_rotation and tool_speed; for analog outputs `analog_name`, (outputs,), and `analog`,
    (n, outputs); and for the events `event_name`, `event_value` (JSON), `event_t`, `event_due` and
    `event_s`, (events,).
    Arrays that the table does not have are left out. Nothing is pickled.
    """
    events = table.events
    arrays: dict[str, Any] = {
        "name": np.array(table.name),
        "joint_names": np.array(table.joint_names),
        "period": np.array(table.period),
        "start_time": np.array(table.start_time),
        "event_name": np.array([x.name for x in events], dtype=np.str_),
        "event_value": np.array([json.dumps(x.value) for x in events], dtype=np.str_),
    }
    for key in ("t", "due", "s"):
        arrays[f"event_{key}"] = np.array([getattr(x, key) for x in events], dtype=np.float64)
    for key in ("t", "q", "dq", "ddq", "tool", "tool_rotation", "tool_speed"):
        if getattr(table, key) is not None:
            arrays[key] = getattr(table, key)
    if table.analog:
        arrays["analog_name"] = np.array(list(table.analog), dtype=np.str_)
        arrays["analog"] = np.column_stack(list(table.analog.values()))
    # An open file keeps numpy from adding .npz to the name.
    with file.open("wb") as stream:
        np.savez(stream, **arrays)


def _columns(table: Table) -> tuple[list[str], list[FloatArray]]:
    """Titles and columns of joints, of analog outputs, and of the tool if its speed is there."""
    header, columns = joint_columns(
        table.t, table.joint_names, q=table.q, dq=table.dq, ddq=table.ddq
    )
    tool = table.tool_speed is not None
    if tool and table.tool is not None:
        header += [f"{axis} [m]" for axis in "xyz"[: table.tool.shape[1]]]
        columns.append(table.tool)
    if tool and table.tool_rotation is not None:
        header += ["qx", "qy", "qz", "qw"]
        columns.append(table.tool_rotation)
    if tool and table.tool_speed is not None:
        header.append("speed [m/s]")
        columns.append(table.tool_speed)
    for name, values in table.analog.items():
        header.append(f"analog {name}")
        columns.append(values)
    return header, columns


def _event_cells(table: Table) -> dict[int, str]:
    """The events of each point as text, by the index of the point."""
    cells: dict[int, str] = {}
    for event, i in zip(table.events, table.point_of_events, strict=True):
        cells[i] = f"{cells[i]}; {event_text(event)}" if i in cells else event_text(event)
    return cells
