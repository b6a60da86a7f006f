"""Fast conversion of numbers and events to text."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence
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
    """Numbers as CSV with 12 decimals: the same text as `numpy.savetxt`, but faster.

    Args:
        header: Titles of all columns, with units.
        columns: Arrays (n,) or (n, columns), which are put side by side.
    """
    first = io.StringIO()
    csv.writer(first, lineterminator="\n").writerow(header)
    rows = np.column_stack(columns)
    return first.getvalue() + "".join(filled(",".join([FIXED] * rows.shape[1]) + "\n", rows))


def filled(row: str, values: FloatArray) -> Iterator[str]:
    """Yield the text `row % values[i]` of all rows, several thousand rows at a time.

    Python formats each number with correct rounding; formatting many rows in one operation saves
    time.

    Args:
        row: Format of one row.
        values: Numbers, (n, columns).
    """
    at_once = max(1, CHUNK // max(1, values.shape[1]))
    for i in range(0, len(values), at_once):
        piece = values[i : i + at_once]
        yield (row * len(piece)) % tuple(piece.ravel().tolist())


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
