"""Closed contours: where they begin, and how far they are gone on with after their end."""

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

# Orientations at both ends that differ by no more are one [rad]: what adding up turns rounds.
SAME_HOLD = 1e-6
# An overlap hides where a contour begins; every time around has all of the contour's segments.
MOST_SEGMENTS = 1_000_000


def close_contour(contour: Contour, process: Process, *, led: bool) -> Contour:
    """A closed contour that begins where it should, with its overlap.

    Where it begins is meant if the program leads there, or something is switched on the way; and
    where the tool is held in another way at its end, nothing goes on from there.

    Args:
        contour: The contour, whose ends are one point.
        process: What is asked for.
        led: Whether the program itself leads to where it begins.

    Raises:
        InvalidInput: Another beginning or an overlap where the tool is held in another way at the
            end; another beginning where something is switched to and fro on the way and would not
            be as it is drawn; or a point of another dimension.
    """
    path, events = contour.path, contour.events
    goes_on = _goes_on(path)
    meant = process.begin == AUTO and (contour.keep_start or led or bool(events) or not goes_on)
    begin = _begin(path, DRAWN if meant else process.begin)
    moved = begin > REPEATED_POINT and path.length - begin > REPEATED_POINT
    if not goes_on and (moved or process.overlap > REPEATED_POINT):
        raise InvalidInput(
            f"{contour_called(contour, 0) if contour.name else 'A closed contour'} ends where it "
            "starts with the tool held in another way, so that it cannot go on from there: have it "
            "held alike at both ends, or leave out begin and overlap."
        )
    if moved:
        _refuse_cut_switching(contour, begin)
        path = join_paths([cut_path(path, begin, path.length), cut_path(path, 0.0, begin)])
        events = tuple(_move_event(x, begin, path.length) for x in events)
    once = path.length
    path = _gone_on(path, process.overlap)
    # What is switched at the end is so after the overlap.
    events = tuple(
        dataclasses.replace(x, s=path.length) if x.s >= once - REPEATED_POINT else x for x in events
    )
    return dataclasses.replace(contour, path=path, events=events, ring=True)


def _goes_on(path: Path) -> bool:
    """Whether the tool is held at the end of a closed path as it is at its start."""
    orientation = path.orientation
    if orientation is None:
        return True
    end, start = orientation(path.length, side="left"), orientation(0.0)
    if orientation.follows:
        # At a corner it turns with the tangent.
        corner = shortest(path(path.length, 1, side="left"), path(0.0, 1))
        end = exp(corner) @ end
    if orientation.axis_only:
        return bool(angle_between(end[:, 2], start[:, 2]) <= SAME_HOLD)
    return bool(np.linalg.norm(log(start @ end.T)) <= SAME_HOLD)


def _gone_on(path: Path, overlap: float) -> Path:
    """A closed path gone on with after its end, as often around as it takes.

    Raises:
        InvalidInput: More than MOST_SEGMENTS.
    """
    rounds = overlap / path.length
    if rounds * len(path) > MOST_SEGMENTS:
        raise InvalidInput(
            f"An overlap of {overlap:g} m goes {rounds:.3g} times around a contour of "
            f"{path.length:.4g} m, which makes more than {MOST_SEGMENTS} segments: take a shorter "
            "overlap."
        )
    parts, over = [path], overlap
    while over > REPEATED_POINT:
        more = min(over, path.length)
        parts.append(path if more == path.length else cut_path(path, 0.0, more))
        over -= more
    return join_paths(parts)


def _refuse_cut_switching(contour: Contour, begin: float) -> None:
    """Refuse to begin where something is switched that would then not be, until it comes again."""
    inner = {x.name for x in contour.events if 0 < x.s < contour.path.length - REPEATED_POINT}
    for name in sorted(inner):
        own = [x for x in contour.events if x.name == name]
        before = [x for x in own if x.s <= begin]
        # What holds at the drawn end, at the drawn start, and where it is to begin.
        at_ends = [own[-1], *(x for x in own[:1] if x.s <= REPEATED_POINT), *before[-1:]]
        if any(x.value != own[-1].value for x in at_ends):
            raise InvalidInput(
                f"{contour_called(contour, 0) if contour.name else 'A closed contour'} switches "
                f"{name} on its way, which would not be as it is drawn if it began at {begin:g} m: "
                "leave out begin, or give a place where it is switched as it is at the end.",
                s=begin,
            )


def _move_event(event: Event, begin: float, length: float) -> Event:
    """An event of a closed contour that begins elsewhere; what is at its ends stays there."""
    if event.s <= REPEATED_POINT or event.s >= length - REPEATED_POINT:
        return dataclasses.replace(event, s=0.0 if event.s <= REPEATED_POINT else length)
    return dataclasses.replace(event, s=(event.s - begin) % length)


def _begin(path: Path, begin: str | float | Sequence[float]) -> float:
    """Where on a closed path it is to begin [m]."""
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
    ends = path([0.0, path.length], 1, side="left")
    turn = np.linalg.norm(path(0.0, 1) - ends[1])
    if turn <= TANGENT_TOLERANCE:
        return 0.0
    longest = int(np.argmax(path.lengths))
    return float(path.breaks[longest] + path.lengths[longest] / 2)
