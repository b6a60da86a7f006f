"""Preparation of a program: adds the requirements of the process to its contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

import numpy as np

from armcontour import _checks
from armcontour._checks import LONGEST_NAME, FloatArray
from armcontour._text import shorten
from armcontour.errors import InvalidInput, locate_errors
from armcontour.geometry import Demand, Path
from armcontour.geometry.cutting import cut_path, join_paths
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.weaving import weave_seam
from armcontour.program.closed_contours import close_contour
from armcontour.program.kerf import apply_kerf
from armcontour.program.moves import (
    Contour,
    Dwell,
    Event,
    Move,
    Program,
    Rapid,
    contour_called,
)
from armcontour.program.ordering import order_contours
from armcontour.program.process import Lead, Leads, Process, Weave
from armcontour.program.rapids import is_meant, last_end, leading_away, next_rapid, reroute
from armcontour.program.resuming import resume
from armcontour.program.scrap_side import LeadPlacement
from armcontour.program.switching import Switching
from armcontour.program.tabs import add_tabs

ANY_DEMAND = Demand()


def prepare(
    program: Path | Program, process: Process, lengths: Sequence[Leads] | None = None
) -> Program:
    """The program with start points, leads, overlaps, approaches and events of the process.

    Args:
        program: The program as it is drawn, or a path.
        process: Requirements of the process.
        lengths: Lengths of leads without a given length, one item per contour after `from_s`.

    Raises:
        InvalidInput: `from_s` is past the end of the program, a layer does not exist, a lead has no
            side, lengths of leads are missing, or a program in the plane has an approach, a retract
            or the height of a pierce.
    """
    program = Program.of(program, "prepare needs a Path or a Program")
    _checks.refuse_other("prepare", process, Process)
    _refuse_unknown_layers(program, (*process.layers, *process.by_layer))
    pierces = any(x.pierce is not None and x.pierce.height for x in process.variants)
    if process.approach or process.retract or pierces:
        _refuse_plane(program)
    program = arrange(program, process)
    rapids_away = leading_away(program.moves)
    switching = Switching(program.moves, process)
    moves: list[Move] = []
    drawn: list[Contour] = []
    for i, x in enumerate(program.moves):
        if isinstance(x, Contour):
            own, called = process.of_layer(x.layer), contour_called(x, len(drawn))
            passes = _pass_again(x, own.passes)
            drawn += passes
            x = _start_contour(x, own, is_meant(program.moves, i), called, switching)
            moves += [dataclasses.replace(x, name=y.name) for y in passes]
        elif not (isinstance(x, Event) and switching.takes(x)):
            moves.append(x)
    placement = LeadPlacement(drawn, process)
    program = dataclasses.replace(program, moves=tuple(moves))
    program, run_in = resume(program, process.from_s, keeps_lead=partial(_keeps_lead, process))
    if process.automatic and (lengths is None or len(lengths) != len(program.contours)):
        raise InvalidInput(
            f"Leads of automatic length need {len(program.contours)} lengths, one per contour, "
            f"but there are {0 if lengths is None else len(lengths)}: run a job, which finds them, "
            "or give the leads a length."
        )
    contours: list[Contour] = []
    for k, x in enumerate(program.contours, len(drawn) - len(program.contours)):
        own = process.of_layer(x.layer)
        leads = _lead_lengths(own, lengths, len(contours))
        contours.append(_add_leads(x, own, leads, run_in if not contours else None, placement, k))
    result = _link(program.moves, contours, process, rapids_away)
    notes = (*program.notes, *placement.notes)
    return dataclasses.replace(program, moves=tuple(result), notes=notes)


def arrange(program: Program, process: Process) -> Program:
    """The program as it is drawn, beside the contours by the kerf, and in the order of the process.

    Args:
        program: The program as it is drawn.
        process: Requirements of the process.

    Raises:
        InvalidInput: A given order for a program with rapids, dwells or events, or a kerf that does
            not fit a contour.
    """
    return order_contours(apply_kerf(program, process), process)


def _pass_again(contour: Contour, passes: int) -> list[Contour]:
    """An open contour as often as its layer has passes; a closed one runs in laps."""
    # Whether a contour is closed takes longer than all else here.
    if passes == 1 or contour.closed:
        return [contour]
    suffixes = [f" ({k})" for k in range(2, passes + 1)] if contour.name else [""] * (passes - 1)
    names = [f"{shorten(contour.name, LONGEST_NAME - len(x))}{x}" for x in suffixes]
    return [contour, *(dataclasses.replace(contour, name=x) for x in names)]


def _keeps_lead(process: Process, contour: Contour, event: Event) -> bool:
    """Whether an event that resuming switches again keeps its time advance."""
    own = process.of_layer(contour.layer)
    switched = own.switch is not None and own.switch.name == event.name
    return own.lead_in is not None or (switched and bool(event.value))


def _link(
    moves: Sequence[Move], contours: Sequence[Contour], process: Process, rapids_away: set[Rapid]
) -> list[Move]:
    """The moves with other contours, rapids to their new ends, approaches, retracts and dwells.

    Args:
        moves: The moves of the program.
        contours: One contour for each contour among the moves, with leads.
        process: Requirements of the process.
        rapids_away: Rapids that start at the end of the contour before them.
    """
    result: list[Move] = []
    # Index in `result` of each move of the program.
    places: list[int] = []
    number = 0
    for i, move in enumerate(moves):
        places.append(len(result))
        if isinstance(move, Rapid) and move in rapids_away:
            move = reroute(move, start=last_end(result))
        if not isinstance(move, Contour):
            result.append(move)
            continue
        contour = contours[number]
        before = next_rapid(moves, range(i - 1, -1, -1))
        if before is not None:
            k = places[before]
            result[k] = reroute(result[k], end=contour.path(0.0))
        followed = next_rapid(moves, range(i + 1, len(moves))) is not None
        added = _add_heights(contour, process, linked=before is not None, followed=followed)
        own = process.of_layer(contour.layer)
        dwell = own.dwell + (0.0 if own.pierce is None else own.pierce.time)
        if dwell:
            added.insert(added.index(contour), Dwell(duration=dwell))
        result += added
        number += 1
    return result


def _lead_lengths(process: Process, lengths: Sequence[Leads] | None, number: int) -> Leads:
    """Lengths of the leads of contour `number`: given by the process, else from `lengths`."""
    given = Leads() if lengths is None else lengths[number]

    def length_of(lead: Lead | None, automatic: float) -> float:
        if lead is None:
            return 0.0
        return automatic if lead.length is None else lead.length

    return Leads(
        before=length_of(process.lead_in, given.before),
        after=length_of(process.lead_out, given.after),
    )


def _refuse_unknown_layers(program: Program, layers: Sequence[str]) -> None:
    """Refuse layers on which the program has no contour.

    Raises:
        InvalidInput: A layer has no contour.
    """
    known = {x.layer for x in program.contours}
    for name in layers:
        if name not in known:
            listed = ", ".join(repr(x) for x in sorted(known)[:12])
            raise InvalidInput(
                f"{program.source or 'The program'} has no contour on a layer {name!r}, only on "
                f"{listed}."
            )


def _refuse_plane(program: Program) -> None:
    """Raise InvalidInput for a program in the plane, which has no heights."""
    if program.dimension == 2:
        raise InvalidInput(
            "approach, retract and the height of a pierce go up and down, which a program in the "
            "plane cannot: leave them out, or use an arm in space."
        )


def _add_demand(contour: Contour, demand: Demand | None) -> Contour:
    """The contour with speed and tolerance of its layer on segments that have none."""
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
    # A Demand has checked its values, so the segments stay checked.
    segments = path.segments.replace(speeds=speeds, tolerances=tolerances, checked=True)
    return dataclasses.replace(contour, path=dataclasses.replace(path, segments=segments))


def _start_contour(
    contour: Contour, process: Process, led: bool, called: str, switching: Switching
) -> Contour:
    """A contour with its start point, overlap, demand of its layer and events of the process.

    Args:
        contour: The contour.
        process: Requirements of the process.
        led: Whether a rapid, dwell or event of the program leads to the start of the contour.
        called: What messages call the contour.
        switching: State of the outputs before the contour.

    Raises:
        InvalidInput: An event is past the end of the contour, or as in `close_contour`.
    """
    contour = _add_demand(contour, process.layers.get(contour.layer))
    closed, lap = contour.closed, contour.path.length
    if closed:
        contour = close_contour(contour, process, led=led)
    path = contour.path
    for x in process.events:
        if x.s > path.length + REPEATED_POINT:
            raise InvalidInput(
                f"The event {x.name} is to come at {x.s:g} m of every contour, but {called} is "
                f"{path.length:g} m long.",
                s=x.s,
                allowed=path.length,
            )
    contour = switching.confine(contour, process.events)
    if closed:
        contour = add_tabs(contour, process, lap)
    return contour if process.weave is None else _weave(contour, process.weave, process.up)


def _weave(contour: Contour, weave: Weave, up: FloatArray) -> Contour:
    """A contour along which the tool weaves; events keep their share of the length.

    Raises:
        InvalidInput: The contour is too tight for the weave, or goes straight up.
    """
    with locate_errors(f"weave of {contour_called(contour, 0) if contour.name else 'a contour'}"):
        wishes = dataclasses.asdict(weave)
        path, woven = weave_seam(
            contour.path, up=up if wishes.pop("plane") == "frame" else None, **wishes
        )
    factor = path.length / contour.path.length
    events = tuple(dataclasses.replace(x, s=min(x.s * factor, path.length)) for x in contour.events)
    return dataclasses.replace(contour, path=path, events=events, ring=contour.closed, woven=woven)


def _add_leads(
    contour: Contour,
    process: Process,
    leads: Leads,
    run_in: Contour | None,
    placement: LeadPlacement,
    number: int,
) -> Contour:
    """A contour with its leads.

    Args:
        contour: The contour.
        process: Requirements of the process.
        leads: Lengths of the leads.
        run_in: Part of the contour before `from_s`, which serves as lead-in if it is long enough.
        placement: Where leads are laid.
        number: Number of the contour there.
    """
    path, before = contour.path, 0.0
    parts = [path]
    if process.lead_in is not None and leads.before > REPEATED_POINT:
        if run_in is not None and run_in.path.length >= leads.before:
            end = run_in.path.length
            lead = cut_path(run_in.path, end - leads.before, end)
        else:
            lead = placement.lay(number, path, process.lead_in, leads.before, after=False)
        before = lead.length
        parts.insert(0, lead)
    if process.lead_out is not None and leads.after > REPEATED_POINT:
        parts.append(placement.lay(number, path, process.lead_out, leads.after, after=True))
    if process.pierce is not None and process.pierce.height > REPEATED_POINT:
        # Rounding the corner at its end would cut the start of the contour off.
        speed = None if np.isnan(path.speeds[0]) else float(path.speeds[0])
        drop = Demand(speed=speed, tolerance=0.0)
        height = process.up * process.pierce.height
        parts.insert(0, _vertical(parts[0], 0.0, height, down=True, demand=drop))
        before += parts[0].length
    whole = join_paths(parts)
    wait = 0.0 if process.pierce is None else process.pierce.time
    events: list[Event] = []
    for x in contour.events:
        s, advance = x.s + before, x.lead_time
        if process.switch is not None and x.name == process.switch.name:
            if x.value and x.s <= REPEATED_POINT:
                s, advance = 0.0 if process.begins_on else s, advance + wait
            elif process.ends_on and not x.value and x.s >= path.length - REPEATED_POINT:
                s = whole.length
        events.append(dataclasses.replace(x, s=s, lead_time=advance))
    return dataclasses.replace(
        contour, path=whole, events=tuple(events), work=(before, before + path.length)
    )


def _add_heights(contour: Contour, process: Process, *, linked: bool, followed: bool) -> list[Move]:
    """A contour with its approach and retract.

    Args:
        contour: The contour.
        process: Requirements of the process.
        linked: Whether a rapid of the program leads to the contour, so that no approach is added.
        followed: Whether a rapid of the program leaves the contour, so that no retract is added.
    """
    path, pierce = contour.path, process.of_layer(contour.layer).pierce
    result: list[Move] = [contour]
    height = process.approach - (0.0 if pierce is None else pierce.height)
    if height > REPEATED_POINT and not linked:
        result.insert(0, Rapid(path=_vertical(path, 0.0, process.up * height, down=True)))
    if process.retract and not followed:
        up = process.up * process.retract
        result.append(Rapid(path=_vertical(path, path.length, up, down=False)))
    return result


def _vertical(
    path: Path, s: float, up: FloatArray, *, down: bool, demand: Demand = ANY_DEMAND
) -> Path:
    """The vertical line above the point at arc length s of a path, with the orientation there."""
    point = path(s)
    ends = [point + up, point] if down else [point, point + up]
    line = Path.polyline(ends, demand=demand)
    if path.orientation is None:
        return line
    side = "right" if s == 0 else "left"
    rotation = path.orientation(s, side=side)
    return line.oriented(rotation, axis_only=path.orientation.axis_only)
