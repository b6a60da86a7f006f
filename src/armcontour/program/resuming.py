"""A program resumed at a place: what is left of it, and what had been switched before."""

from __future__ import annotations

import dataclasses

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.geometry.cutting import cut_path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program.moves import Contour, Event, Program


def resume(program: Program, from_s: float, *, run_in: bool) -> tuple[Program, Contour | None]:
    """What is left of a program from a place on, and the contour that place is on, whole.

    What was switched before it is switched again: at the place itself where it was on the same
    contour, else before anything moves. It leads by what it did if there is a run-in.

    Args:
        program: The program.
        from_s: Arc length of all contours together [m].
        run_in: Whether a lead comes before that place.
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
    # A place that is the end of a contour is the beginning of the next one.
    which = int(np.searchsorted(program.breaks, from_s + REPEATED_POINT, side="right")) - 1
    place = max(from_s - float(program.breaks[which]), 0.0)
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
        rest = _behind(move, place, run_in)
        kept = (*switched.values(), rest, *program.moves[i + 1 :])
        found = dataclasses.replace(program, moves=kept)
        return found, (_until(move, place) if place > REPEATED_POINT else None)
    raise AssertionError("the place was found among the contours")


def _behind(contour: Contour, place: float, run_in: bool) -> Contour:
    """A contour from a place on."""
    if place <= REPEATED_POINT:
        return contour
    last: dict[str, Event] = {}
    for x in contour.events:
        if x.s <= place + REPEATED_POINT:
            # In the order in which it was switched last.
            last.pop(x.name, None)
            lead = x.lead_time if run_in else 0.0
            last[x.name] = dataclasses.replace(x, s=0.0, lead_time=lead, lead_distance=0.0)
    later = [
        dataclasses.replace(x, s=x.s - place)
        for x in contour.events
        if x.s > place + REPEATED_POINT
    ]
    return dataclasses.replace(
        contour,
        path=cut_path(contour.path, place, contour.path.length),
        events=(*last.values(), *later),
    )


def _until(contour: Contour, place: float) -> Contour:
    return Contour(path=cut_path(contour.path, 0.0, place), name=contour.name, layer=contour.layer)
