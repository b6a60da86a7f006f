"""The table as CSV, Parquet and npz."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.io.exports.table import Table
from armcontour.io.exports.text import csv_text, event_data, event_text, joint_columns


def csv_of(table: Table) -> str:
    """The table as CSV: columns t, then q, dq and ddq of all joints, and `events` if there are any.

    An event is in the row of the last point at or before it and has its own time:
    `tool=on@0.104000000000; gas=2.5@0.104500000000`.
    """
    header, columns = joint_columns(
        table.t, table.joint_names, q=table.q, dq=table.dq, ddq=table.ddq
    )
    text = csv_text(header, columns)
    if not table.events:
        return text
    lines = text.rstrip("\n").split("\n")
    cells = _event_cells(table)
    rows = [
        f"{line},{_quote(cell) if cell else ''}"
        for line, cell in zip(lines[1:], cells, strict=True)
    ]
    return "\n".join([f"{lines[0]},events", *rows]) + "\n"


def write_csv(table: Table, file: FilePath) -> None:
    """Write the text of `csv_of` to a file."""
    file.write_text(csv_of(table), encoding="utf-8", newline="\n")


def write_parquet(table: Table, file: FilePath) -> None:
    """Write the columns of the CSV and the tool points to a Parquet file in full precision.

    The file's metadata have the key `armcontour` with a JSON object of name, joint_names, period,
    start_time and events.

    Raises:
        InvalidInput: pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]
        import pyarrow.parquet as pq  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise InvalidInput(
            "Parquet needs the library pyarrow: pip install 'armcontour[tables]'."
        ) from None
    header, columns = joint_columns(
        table.t, table.joint_names, q=table.q, dq=table.dq, ddq=table.ddq
    )
    rows = np.column_stack(columns)
    arrays = [pa.array(np.ascontiguousarray(x)) for x in rows.T]
    names = list(header)
    if table.tool is not None:
        names += [f"{axis} [m]" for axis in "xyz"[: table.tool.shape[1]]]
        arrays += [pa.array(np.ascontiguousarray(x)) for x in table.tool.T]
    if table.events:
        names.append("events")
        arrays.append(pa.array([x or None for x in _event_cells(table)], type=pa.string()))
    about = {
        "name": table.name,
        "joint_names": table.joint_names,
        "period": table.period,
        "start_time": table.start_time,
        "events": [event_data(x) for x in table.events],
    }
    pq.write_table(
        pa.table(arrays, names=names).replace_schema_metadata({"armcontour": json.dumps(about)}),
        file,
    )


def write_npz(table: Table, file: FilePath) -> None:
    """Write the table to an npz file.

    The arrays are name, joint_names, period, start_time, t, q, dq, ddq and tool; and for the
    events `event_name`, `event_value` (JSON), `event_t`, `event_due` and `event_s`, (events,).
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
    for key in ("t", "q", "dq", "ddq", "tool"):
        if getattr(table, key) is not None:
            arrays[key] = getattr(table, key)
    # An open file keeps numpy from adding .npz to the name.
    with file.open("wb") as stream:
        np.savez(stream, **arrays)


def _event_cells(table: Table) -> list[str]:
    """The events of each point as text; empty for a point without events."""
    cells = [""] * len(table.t)
    for event, i in zip(table.events, table.point_of_events, strict=True):
        cells[i] += f"{'; ' if cells[i] else ''}{event_text(event)}"
    return cells


def _quote(cell: str) -> str:
    """The cell as CSV, in quotes if it contains a comma or quotes."""
    needed = any(x in cell for x in ',"')
    return '"' + cell.replace('"', '""') + '"' if needed else cell
