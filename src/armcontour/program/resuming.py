"""The rest of a program that is resumed at an arc length, with outputs restored."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.geometry.cutting import cut_path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program.moves import Contour, Event, Program


def resume(
    program: Program, from_s: float, *, keeps_lead: Callable[[Contour, Event], bool]
) -> tuple[Program, Contour | None]:
    """The rest of a program, and the part of the resumed contour before the arc length.

    Outputs switched before the arc length are switched again: at the arc length if they were
    switched on the same contour, else before the first move.

    Args:
        program: The program.
        from_s: Arc length at which to resume, over all contours [m].
        keeps_lead: Whether an event of a contour keeps its time advance when it is switched again.

    Returns:
        The rest of the program, and the part of its first contour before the arc length; None if
        the program resumes at the start of a contour.

    Raises:
        InvalidInput: The arc length is not below the length of all contours.
    """
    if from_s == 0:
        return program, None
    if from_s >= program.length - REPEATED_POINT:
        raise InvalidInput(
            f"The program is to be resumed at {from_s:g} m, but its contours are "
            f"{program.length:.9g} m long together.",
            s=from_s,
            allowed=program.length,
        )
    # The end of a contour counts as the start of the next one.
    which = int(np.searchsorted(program.breaks, from_s + REPEATED_POINT, side="right")) - 1
    s = max(from_s - float(program.breaks[which]), 0.0)
    number = -1
    switched: dict[str, Event] = {}
    for i, move in enumerate(program.moves):
        if isinstance(move, Event):
            switched[move.name] = dataclasses.replace(move, s=0.0, lead_time=0, lead_distance=0)
        if not isinstance(move, Contour):
            continue
        number += 1
        if number < which:
            for x in move.events:
                switched[x.name] = dataclasses.replace(x, s=0.0, lead_time=0, lead_distance=0)
            continue
        rest = _cut_after(move, s, keeps_lead)
        moves = (*switched.values(), rest, *program.moves[i + 1 :])
        resumed = dataclasses.replace(program, moves=moves)
        return resumed, (_cut_before(move, s) if s > REPEATED_POINT else None)
    raise AssertionError("the arc length is within the contours")


def _cut_after(contour: Contour, s: float, keeps_lead: Callable[[Contour, Event], bool]) -> Contour:
    """The part of a contour after arc length s, with outputs restored at its start."""
    if s <= REPEATED_POINT:
        return contour
    last: dict[str, Event] = {}
    for x in contour.events:
        if x.s <= s + REPEATED_POINT:
            # Outputs keep the order of their last events.
            last.pop(x.name, None)
            lead = x.lead_time if keeps_lead(contour, x) else 0.0
            last[x.name] = dataclasses.replace(x, s=0.0, lead_time=lead, lead_distance=0.0)
    later = [dataclasses.replace(x, s=x.s - s) for x in contour.events if x.s > s + REPEATED_POINT]
    return dataclasses.replace(
        contour,
        path=cut_path(contour.path, s, contour.path.length),
        events=(*last.values(), *later),
    )


def _cut_before(contour: Contour, s: float) -> Contour:
    """The part of a contour before arc length s, without events."""
    return Contour(path=cut_path(contour.path, 0.0, s), name=contour.name, layer=contour.layer)
