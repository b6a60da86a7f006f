"""Start point and overlap of closed contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.frames import angle_between, exp, log, shortest
from armcontour.geometry import Path
from armcontour.geometry.cutting import cut_path, join_paths
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.program.moves import Contour, Event, contour_called
from armcontour.program.process import AUTO, DRAWN, Process

# Orientations at both ends of a contour that differ by less than this count as equal: summed turns
# have rounding errors [rad].
SAME_HOLD = 1e-6
# Largest number of segments of a contour with its overlap, which repeats the contour's segments.
MOST_SEGMENTS = 1_000_000


def close_contour(contour: Contour, process: Process, *, led: bool) -> Contour:
    """A closed contour with the start point, the laps and the overlap of the process.

    An automatic start keeps the drawn start point if the contour's `keep_start` is true, a rapid,
    dwell or event leads to the contour, the contour has events, or its end orientations differ.

    Args:
        contour: The contour, which ends at its start point.
        process: Start point, passes and overlap.
        led: Whether a rapid, dwell or event of the program leads to the start of the contour.

    Raises:
        InvalidInput: A new start point or an overlap, though the tool orientations at the ends
            differ; a new start point that changes what is switched on along the contour; a start
            point of another dimension; or an overlap with too many segments.
    """
    start = find_start(contour, process, led=led)
    lap = contour.path.length
    more = (process.passes - 1) * lap + process.overlap
    if more > REPEATED_POINT:
        _refuse_turned_end(contour)
    contour = begin_at(contour, start)
    longer = _add_overlap(contour.path, more)
    events = (
        *_move_last_events(contour.events, lap, longer.length),
        *_repeat_events(contour.events, lap, process.passes),
    )
    return dataclasses.replace(contour, path=longer, events=events, ring=True)


def keeps_drawn_start(contour: Contour, *, led: bool) -> bool:
    """Whether an automatic start of a closed contour is the drawn one, as in `close_contour`."""
    return (
        contour.keep_start
        or led
        or bool(contour.events)
        or not _has_equal_end_orientations(contour.path)
    )


def find_start(contour: Contour, process: Process, *, led: bool) -> float:
    """Arc length at which a closed contour begins [m], as in `close_contour`."""
    keeps = process.begin == AUTO and keeps_drawn_start(contour, led=led)
    return _find_start(contour.path, DRAWN if keeps else process.begin)


def begin_at(contour: Contour, start: float) -> Contour:
    """A closed contour that begins at an arc length [m] of the drawn one.

    Raises:
        InvalidInput: As in `close_contour`.
    """
    path = contour.path
    if start <= REPEATED_POINT or path.length - start <= REPEATED_POINT:
        return contour
    _refuse_turned_end(contour)
    _refuse_cut_switching(contour, start)
    return dataclasses.replace(
        contour,
        path=join_paths([cut_path(path, start, path.length), cut_path(path, 0.0, start)]),
        events=tuple(_move_event(x, start, path.length) for x in contour.events),
    )


def _refuse_turned_end(contour: Contour) -> None:
    """Refuse a closed contour that ends with another tool orientation than it begins with."""
    if not _has_equal_end_orientations(contour.path):
        raise InvalidInput(
            f"{contour_called(contour, 0) if contour.name else 'A closed contour'} ends at its "
            "start point with another tool orientation, so that the tool cannot continue there: "
            "give both ends the same orientation, or leave out begin and overlap."
        )


def _move_last_events(events: tuple[Event, ...], drawn: float, end: float) -> tuple[Event, ...]:
    """Move events at the drawn end of a contour [m] to the end of its overlap [m]."""
    return tuple(
        dataclasses.replace(x, s=end) if x.s >= drawn - REPEATED_POINT else x for x in events
    )


def _repeat_events(events: tuple[Event, ...], lap: float, passes: int) -> list[Event]:
    """Events along the first lap of a contour [m], on the laps after it."""
    along = [x for x in events if REPEATED_POINT < x.s < lap - REPEATED_POINT]
    return [dataclasses.replace(x, s=x.s + k * lap) for k in range(1, passes) for x in along]


def _has_equal_end_orientations(path: Path) -> bool:
    """Whether the tool orientations at both ends of a closed path are equal."""
    orientation = path.orientation
    if orientation is None:
        return True
    if orientation.fixed and len(orientation) == 1 and not orientation.follows:
        return True
    end, start = orientation(path.length, side="left"), orientation(0.0)
    if orientation.follows:
        # At a corner the tool turns with the tangent.
        corner = shortest(path(path.length, 1, side="left"), path(0.0, 1))
        end = exp(corner) @ end
    if orientation.axis_only:
        return bool(angle_between(end[:, 2], start[:, 2]) <= SAME_HOLD)
    return bool(np.linalg.norm(log(start @ end.T)) <= SAME_HOLD)


def _add_overlap(path: Path, overlap: float) -> Path:
    """A closed path continued past its end by the overlap [m], several times around if needed.

    Raises:
        InvalidInput: The path gets more than MOST_SEGMENTS segments.
    """
    rounds = overlap / path.length
    if rounds * len(path) > MOST_SEGMENTS:
        raise InvalidInput(
            f"Overlap and further passes of {overlap:g} m go {rounds:.3g} times around a contour "
            f"of {path.length:.4g} m, which makes more than {MOST_SEGMENTS} segments: take a "
            "shorter overlap or fewer passes."
        )
    parts, rest = [path], overlap
    while rest > REPEATED_POINT:
        more = min(rest, path.length)
        parts.append(path if more == path.length else cut_path(path, 0.0, more))
        rest -= more
    return join_paths(parts)


def _refuse_cut_switching(contour: Contour, start: float) -> None:
    """Refuse a new start point that would change where an output is switched on along a contour.

    Raises:
        InvalidInput: An output has another value at the drawn start or the new start than at the
            drawn end.
    """
    inner = {x.name for x in contour.events if 0 < x.s < contour.path.length - REPEATED_POINT}
    for name in sorted(inner):
        own = [x for x in contour.events if x.name == name]
        before = [x for x in own if x.s <= start]
        # Events that set the values at the drawn end, the drawn start and the new start.
        at_ends = [own[-1], *(x for x in own[:1] if x.s <= REPEATED_POINT), *before[-1:]]
        if any(x.value != own[-1].value for x in at_ends):
            raise InvalidInput(
                f"{contour_called(contour, 0) if contour.name else 'A closed contour'} switches "
                f"{name} along its path, and would switch it at other places than drawn if it "
                f"started at {start:g} m: leave out begin, or start at a place where {name} has "
                "the same value as at the end.",
                s=start,
            )


def _move_event(event: Event, start: float, length: float) -> Event:
    """An event after the contour got a new start point; events at the ends stay at the ends."""
    if event.s <= REPEATED_POINT or event.s >= length - REPEATED_POINT:
        return dataclasses.replace(event, s=0.0 if event.s <= REPEATED_POINT else length)
    return dataclasses.replace(event, s=(event.s - start) % length)


def _find_start(path: Path, begin: str | float | Sequence[float]) -> float:
    """Arc length of the start point that `Process.begin` means on a closed path [m]."""
    if begin == DRAWN:
        return 0.0
    if isinstance(begin, tuple):
        point = np.array(begin)
        if len(point) != path.dimension:
            raise InvalidInput(
                f"begin is a point of {len(point)} coordinates, but contours have {path.dimension}."
            )
        return float(path.project(point[None]).s[0])
    if isinstance(begin, float):
        return begin % path.length
    last = slice(len(path) - 1, None)
    end = path.segments.at(last, path.lengths[last], 1)
    if np.linalg.norm(path.tangents[0] - end[0]) <= TANGENT_TOLERANCE:
        return 0.0
    longest = int(np.argmax(path.lengths))
    return float(path.breaks[longest] + path.lengths[longest] / 2)
