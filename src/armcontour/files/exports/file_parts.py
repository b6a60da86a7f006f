"""Division of a table into files, for controllers with a limited number of points per program."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core.checks import BoolArray
from armcontour.core.errors import InvalidInput
from armcontour.files.exports.table import EVENT_TOLERANCE, UNITS, SetPointTable

# Largest number of points per file, by controller: the limit of MotoROS2, and a conservative value
# for programs of UR, whose limit is not published.
POINTS_PER_FILE = {"motoros2": 200, "ur": 1000}
# Largest change of a joint position from a point at rest to its neighbours [rad]. It moves a tool
# at 1 m by 1 um.
REST_STEP = 1e-6


def read_points_per_file(value: int | str | None) -> int | None:
    """Largest number of points per file, from a number or the name of a controller; or None."""
    if value is None or (isinstance(value, int) and not isinstance(value, bool) and value > 1):
        return value
    number = POINTS_PER_FILE.get(value) if isinstance(value, str) else None
    if number is None:
        raise InvalidInput(
            "points_per_file must be an integer of at least 2, or one of the controllers "
            f"{', '.join(POINTS_PER_FILE)}, but is {value!r}."
        )
    return number


def split_table(table: SetPointTable, most: int, *, in_motion: bool) -> tuple[SetPointTable, ...]:
    """Tables of at most `most` points; each starts with the last point of the previous table.

    Args:
        table: The table.
        most: Largest number of points of a file.
        in_motion: Whether a table may end in motion. Otherwise it ends at rest, and has more points
            than `most` if the motion does not rest before.
    """
    last, cuts = len(table.t) - 1, [0]
    rests = np.append(np.flatnonzero(_find_rests(table)), last)
    while last - cuts[-1] >= most:
        reach = cuts[-1] + most - 1
        near = rests[(rests > cuts[-1]) & (rests <= reach)]
        if len(near):
            cuts.append(int(near[-1]))
        else:
            cuts.append(reach if in_motion else int(rests[rests > reach][0]))
    if cuts[-1] < last:
        cuts.append(last)
    if len(cuts) < 3:
        return (table,)
    spans = list(zip(cuts[:-1], cuts[1:], strict=True))
    return tuple(_table_part(table, *span, (k, len(spans))) for k, span in enumerate(spans, 1))


def part_files(file: FilePath, count: int) -> list[FilePath]:
    """Paths of the files: `part.csv` for one file, otherwise `part_01.csv`, `part_02.csv`, ..."""
    if count == 1:
        return [file]
    digits = max(2, len(str(count)))
    return [file.with_name(f"{file.stem}_{k:0{digits}}{file.suffix}") for k in range(1, count + 1)]


def describe_parts(parts: Sequence[SetPointTable], most: int | None) -> list[str]:
    """Sentences on files that have more than `most` points, and on files that end in motion."""
    sentences: list[str] = []
    long = [k for k, x in enumerate(parts, 1) if most is not None and len(x.t) > most]
    if long:
        worst = max(parts, key=lambda x: len(x.t))
        sentences.append(
            f"{len(long)} of {len(parts)} files of {worst.name} have more than {most} points, up "
            f"to {len(worst.t)}, because a file must end at rest, and the robot does not rest from "
            f"{worst.start_time:.3f} to {worst.start_time + worst.duration:.3f} s. Use a longer "
            "cycle, or insert a pause into the program."
        )
    moving = [k for k, x in enumerate(parts, 1) if not x.ends_at_rest]
    if moving:
        sentences.append(
            f"{len(moving)} of {len(parts)} files of {parts[0].name} end in motion. The controller "
            "must start the next file without a pause."
        )
    return sentences


def _find_rests(table: SetPointTable) -> BoolArray:
    """Mask of the inner points at which the motion rests or stops for a moment, (n,)."""
    still = np.all(np.abs(np.diff(table.q, axis=0)) <= REST_STEP, axis=1)
    rests = np.zeros(len(table.t), dtype=bool)
    rests[1:-1] = still[1:] & still[:-1]
    for stop in table.stops:
        rests[np.abs(table.t - stop).argmin()] = True
    rests[[0, -1]] = False
    return rests


def _table_part(table: SetPointTable, start: int, end: int, part: tuple[int, int]) -> SetPointTable:
    """Table of the points `start` to `end` with their events; its time starts at 0."""
    rows, first = slice(start, end + 1), float(table.t[start])
    begins, ends = part[0] == 1, part[0] == part[1]
    rests = _find_rests(table)
    changed: dict[str, Any] = {}
    for key in (*UNITS, "tool", "tool_rotation", "tool_speed"):
        values = getattr(table, key)
        if values is None:
            continue
        values = values[rows].copy()
        if key in ("dq", "ddq"):
            # A controller accepts an end at rest only if the velocity is exactly zero.
            if key == "dq" and rests[start]:
                values[0] = 0.0
            if rests[end]:
                values[-1] = 0.0
        changed[key] = values
    events = zip(table.events, table.point_of_events, strict=True)
    return dataclasses.replace(
        table,
        t=table.t[rows] - first,
        events=tuple(
            dataclasses.replace(
                x, t=max(x.t - first, -EVENT_TOLERANCE * table.cycle), due=x.due - first
            )
            for x, i in events
            if (i >= start or begins) and (i < end or ends)
        ),
        contours=tuple(
            (t - first, name)
            for t, name in table.contours
            if (t >= first or begins) and (t < table.t[end] or ends)
        ),
        stops=tuple(t - first for t in table.stops),
        analog={key: values[rows] for key, values in table.analog.items()},
        start_time=table.start_time + first,
        part=part,
        ends_at_rest=ends or bool(rests[end]),
        **changed,
    )
