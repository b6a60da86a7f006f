"""Numbers and events as text."""

from __future__ import annotations

import csv
import io
import json
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.motion import TimedEvent

# Decimals of a number; the rounding error is at most half of the last digit.
DECIMALS = 12
FIXED = f"%.{DECIMALS}f"
# Number of values that are formatted at once: more take more memory and are not faster.
CHUNK = 1 << 16
UNITS = {"q": "rad", "dq": "rad/s", "ddq": "rad/s^2", "torque": "N m"}


def joint_columns(
    t: FloatArray, joint_names: Sequence[str], **quantities: FloatArray | None
) -> tuple[list[str], list[FloatArray]]:
    """Titles and columns of joints over time: `t [s]`, then `q 1 [rad]`, `q 2 [rad]`, ...

    A joint has its name in the titles, or its number where its name is "joint" and a number. All
    files of joints have these titles, and are read by them again.

    Args:
        t: Times [s], (n,).
        joint_names: One per joint.
        quantities: By their names in `UNITS`, (n, dof) each; None is left out.
    """
    called = [x.removeprefix("joint ") for x in joint_names]
    if len(set(called)) < len(called):
        called = list(joint_names)
    header, columns = ["t [s]"], [t]
    for quantity, values in quantities.items():
        if values is not None:
            header += [f"{quantity} {name} [{UNITS[quantity]}]" for name in called]
            columns.append(values)
    return header, columns


def csv_text(header: Sequence[str], columns: Sequence[FloatArray]) -> str:
    """Numbers as CSV with 12 decimals.

    Args:
        header: Titles of all columns, with units.
        columns: Arrays (n,) or (n, columns), which are put side by side.
    """
    return "".join(csv_pieces(header, columns))


def csv_pieces(
    header: Sequence[str], columns: Sequence[FloatArray], cells: Mapping[int, str] | None = None
) -> Iterator[str]:
    """Yield the text of `csv_text`, several thousand rows at a time.

    Args:
        header: Titles of all columns, with units.
        columns: Arrays (n,) or (n, columns), which are put side by side.
        cells: Texts of a last column by their rows; empty in the other rows. None without that
            column.
    """
    yield _csv_line(header)
    width = sum(1 if x.ndim == 1 else x.shape[1] for x in columns)
    row = ",".join([FIXED] * width) + ("\n" if cells is None else ",\n")
    at_once, count = _rows_at_once(width), len(columns[0])
    texts = sorted((cells or {}).items())

    for i in range(0, count, at_once):
        piece = _format_rows(row, np.column_stack([x[i : i + at_once] for x in columns]))
        here = texts[bisect_left(texts, (i,)) : bisect_left(texts, (i + at_once,))]
        if here:
            lines = piece.splitlines()
            for k, text in here:
                lines[k - i] = lines[k - i][: -len(",")] + _csv_line(["", text]).rstrip("\n")
            piece = "\n".join([*lines, ""])
        yield piece


def _csv_line(cells: Sequence[str]) -> str:
    """One line of CSV; texts with commas or quotes are in quotes."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()


def filled(row: str, values: FloatArray) -> Iterator[str]:
    """Yield the text `row % values[i]` of all rows, several thousand rows at a time.

    Args:
        row: Format of one row.
        values: Numbers, (n, columns).
    """
    at_once = _rows_at_once(values.shape[1])
    for i in range(0, len(values), at_once):
        yield _format_rows(row, values[i : i + at_once])


def _rows_at_once(width: int) -> int:
    """Number of rows that are formatted at once."""
    return max(1, CHUNK // max(1, width))


def _format_rows(row: str, values: FloatArray) -> str:
    """The text of rows, (n, columns)."""
    return (row * len(values)) % tuple(values.ravel().tolist())


def write_pieces(file: FilePath, pieces: Iterable[str]) -> None:
    """Write pieces of text to a file, one after the other."""
    with file.open("w", encoding="utf-8", newline="\n") as stream:
        stream.writelines(pieces)


def event_text(event: TimedEvent) -> str:
    """An event with its time [s] as text, such as `tool=on@0.104000000000`."""
    return f"{format_event(event)}@{FIXED % event.t}"


def format_event(event: TimedEvent) -> str:
    """An event without its time, such as `tool=on`; a value that is text is in quotes."""
    plain = all(x.isalnum() or x in "_-. " for x in event.name)
    name = event.name if plain else json.dumps(event.name)
    if isinstance(event.value, bool):
        return f"{name}={'on' if event.value else 'off'}"
    return f"{name}={json.dumps(event.value)}"


def event_data(event: TimedEvent) -> dict[str, Any]:
    """An event as a dictionary for JSON, in SI units."""
    return {
        "name": event.name,
        "value": event.value,
        "t": event.t,
        "due": event.due,
        "s": event.s,
        "point": list(event.point),
    }
