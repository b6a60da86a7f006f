"""A program with what its process asks for around the contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.geometry import Demand, Path
from armcontour.geometry.cutting import cut_path, join_paths
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program.closed_contours import close_contour
from armcontour.program.leads import WASTE, lead_path
from armcontour.program.moves import Contour, Dwell, Event, Move, Program, Rapid
from armcontour.program.off_between import switch_off_between
from armcontour.program.process import Lead, Leads, Process
from armcontour.program.rapids import is_meant, last_end, leading_away, next_rapid, reroute
from armcontour.program.resuming import resume
from armcontour.program.scrap_side import waste_sides


def prepare(program: Program, process: Process, lengths: Sequence[Leads] | None = None) -> Program:
    """The program with what the process asks for around its contours.

    Args:
        program: Contours, as they are drawn.
        process: What is asked for.
        lengths: Of automatic leads, one per contour that is left; needed if there are any.

    Raises:
        InvalidInput: A place to resume that the program has not, a layer that it has not, a lead
            that has no direction, or heights in the plane.
    """
    _refuse_unknown_layers(program, process.layers)
    if process.approach or process.retract:
        _refuse_plane(program)
    program = _reorder(program, process.order)
    begun: list[Move] = [
        _start_contour(x, process, is_meant(program.moves, i)) if isinstance(x, Contour) else x
        for i, x in enumerate(program.moves)
    ]
    away = leading_away(program.moves)
    sides = _sides(program.contours, process)
    begun = switch_off_between(begun, process.off_between)
    program, run_in = resume(
        dataclasses.replace(program, moves=tuple(begun)),
        process.from_s,
        run_in=process.lead_in is not None,
    )
    if process.automatic and (lengths is None or len(lengths) != len(program.contours)):
        raise InvalidInput(
            f"Leads of automatic length need {len(program.contours)} lengths, one per contour, "
            f"but there are {0 if lengths is None else len(lengths)}: run a job, which finds them, "
            "or give the leads a length."
        )
    sides = sides[len(sides) - len(program.contours) :]
    result: list[Move] = []
    # Where the moves of the program are among the result's.
    places: list[int] = []
    number = 0
    for i, move in enumerate(program.moves):
        places.append(len(result))
        if isinstance(move, Rapid) and move in away:
            move = reroute(move, start=last_end(result))
        if not isinstance(move, Contour):
            result.append(move)
            continue
        asked = _lengths(process, lengths, number)
        contour = _around(move, process, asked, run_in if number == 0 else None, sides[number])
        before = next_rapid(program.moves, range(i - 1, -1, -1))
        if before is not None:
            at = places[before]
            result[at] = reroute(result[at], end=contour.path(0.0))
        followed = next_rapid(program.moves, range(i + 1, len(program.moves))) is not None
        around = _between(contour, process, linked=before is not None, followed=followed)
        if process.dwell:
            around.insert(around.index(contour), Dwell(duration=process.dwell))
        result += around
        number += 1
    return dataclasses.replace(program, moves=tuple(result))


def _lengths(process: Process, lengths: Sequence[Leads] | None, number: int) -> Leads:
    given = Leads() if lengths is None else lengths[number]

    def of(lead: Lead | None, automatic: float) -> float:
        if lead is None:
            return 0.0
        return automatic if lead.length is None else lead.length

    return Leads(before=of(process.lead_in, given.before), after=of(process.lead_out, given.after))


def _refuse_unknown_layers(program: Program, layers: Mapping[str, Demand]) -> None:
    known = {x.layer for x in program.contours}
    for name in layers:
        if name not in known:
            listed = ", ".join(repr(x) for x in sorted(known)[:12])
            raise InvalidInput(
                f"{program.source or 'The program'} has no contour on a layer {name!r}, only on "
                f"{listed}."
            )


def _refuse_plane(program: Program) -> None:
    if program.dimension == 2:
        raise InvalidInput(
            "approach and retract go up and down, which a program in the plane cannot: leave them "
            "out, or use an arm in space."
        )


def _demanding(contour: Contour, demand: Demand | None) -> Contour:
    """The contour with what its layer demands where its segments demand nothing."""
    if demand is None:
        return contour
    path = contour.path
    speeds, tolerances = (
        values if given is None else np.where(np.isnan(values), given, values)
        for values, given in (
            (path.speeds, demand.speed),
            (path.tolerances, demand.tolerance),
        )
    )
    # What a Demand holds was checked.
    segments = path.segments.replace(speeds=speeds, tolerances=tolerances, checked=True)
    return dataclasses.replace(contour, path=dataclasses.replace(path, segments=segments))


def _reorder(program: Program, order: str) -> Program:
    """The contours in the order that is asked for; what stands between them goes with the next."""
    if order == "drawn":
        return program
    for x in program.moves:
        if not isinstance(x, Contour):
            raise InvalidInput(
                "The order 'nearest' is for drawings: this program has rapids, dwells or events "
                "between its contours, whose order has a meaning."
            )
    contours = program.contours
    begins = np.array([x.path(0.0) for x in contours])
    left = np.ones(len(contours), dtype=bool)
    taken, at = [contours[0]], 0
    while len(taken) < len(contours):
        left[at] = False
        here = taken[-1].path(taken[-1].path.length)
        away = np.linalg.norm(begins - here, axis=1)
        at = int(np.argmin(np.where(left, away, np.inf)))
        taken.append(contours[at])
    return dataclasses.replace(program, moves=tuple(taken))


def _start_contour(contour: Contour, process: Process, led: bool) -> Contour:
    """A contour with what its layer demands and the events that all get, begun where it is to be.

    Args:
        contour: The contour.
        process: What is asked for.
        led: Whether the program itself leads to where it begins.

    Raises:
        InvalidInput: An event beyond its end.
    """
    contour = _demanding(contour, process.layers.get(contour.layer))
    if contour.closed:
        contour = close_contour(contour, process, led=led)
    path = contour.path
    for x in process.events:
        if x.s > path.length + REPEATED_POINT:
            raise InvalidInput(
                f"The event {x.name} is to come at {x.s:g} m of every contour, but the contour "
                f"{contour.name} is {path.length:g} m long.",
                s=x.s,
                allowed=path.length,
            )
    return dataclasses.replace(contour, events=(*contour.events, *process.events))


def _sides(contours: Sequence[Contour], process: Process) -> list[str]:
    """The side on which the waste of every contour is, if any lead asks for it."""
    asked = any(x is not None and x.side == WASTE for x in (process.lead_in, process.lead_out))
    return waste_sides(contours, process.up) if asked else ["left"] * len(contours)


def _around(
    contour: Contour, process: Process, leads: Leads, run_in: Contour | None, waste: str
) -> Contour:
    """A contour with its leads, and with what is switched at its ends."""
    path, events = contour.path, list(contour.events)
    if process.switch is not None:
        on, off = process.switch.on_lead, process.switch.off_lead
        events.append(Event(name=process.switch.name, value=True, s=0.0, lead_time=on))
        events.append(Event(name=process.switch.name, value=False, s=path.length, lead_time=off))
    before = 0.0
    parts = [path]
    if process.lead_in is not None and leads.before > REPEATED_POINT:
        lead = _lead_in(path, process, process.lead_in, leads.before, run_in, waste)
        before = lead.length
        parts.insert(0, lead)
    if process.lead_out is not None and leads.after > REPEATED_POINT:
        shape, side = process.lead_out.shape, _side(process.lead_out, waste)
        parts.append(lead_path(path, leads.after, shape, side, process.up, after=True))
    return dataclasses.replace(
        contour,
        path=join_paths(parts),
        events=tuple(dataclasses.replace(x, s=x.s + before) for x in events),
        work=(before, before + path.length),
    )


def _side(lead: Lead, waste: str) -> str:
    return waste if lead.side == WASTE else lead.side


def _lead_in(
    path: Path, process: Process, lead: Lead, length: float, run_in: Contour | None, waste: str
) -> Path:
    """What comes before a path: where it is resumed, what comes before it on its contour."""
    if run_in is not None and run_in.path.length >= length:
        return cut_path(run_in.path, run_in.path.length - length, run_in.path.length)
    return lead_path(path, length, lead.shape, _side(lead, waste), process.up, after=False)


def _between(contour: Contour, process: Process, *, linked: bool, followed: bool) -> list[Move]:
    """A contour with its way down and up; neither where a rapid of the program goes already."""
    path = contour.path
    result: list[Move] = [contour]
    if process.approach and not linked:
        result.insert(0, Rapid(path=_vertical(path, 0.0, process.up * process.approach, down=True)))
    if process.retract and not followed:
        up = process.up * process.retract
        result.append(Rapid(path=_vertical(path, path.length, up, down=False)))
    return result


def _vertical(path: Path, s: float, up: FloatArray, *, down: bool) -> Path:
    """The line above a place of a path, with the tool held as it is there."""
    here = path(s)
    ends = [here + up, here] if down else [here, here + up]
    line = Path.polyline(ends)
    if path.orientation is None:
        return line
    side = "right" if s == 0 else "left"
    held = path.orientation(s, side=side)
    return line.oriented(held, axis_only=path.orientation.axis_only)
