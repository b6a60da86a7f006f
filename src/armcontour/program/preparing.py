"""Preparation of a program: adds the requirements of the process to its contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import LONGEST_NAME, FloatArray
from armcontour.core.describing import count_noun
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.fields import checked
from armcontour.core.text import shorten
from armcontour.geometry import Path, SegmentLimits
from armcontour.geometry.cutting import cut_path, join_paths
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.weaving import weave_seam
from armcontour.program.moves import (
    Contour,
    Dwell,
    Event,
    Move,
    Program,
    Rapid,
    contour_called,
    is_meant,
    last_end,
    leading_away,
    next_rapid,
    reroute,
)
from armcontour.program.ordering import close_contour, direct_contours, order_contours
from armcontour.program.process import MOST_TABS, Lead, Leads, Process, Switch, Tabs, Weave

if TYPE_CHECKING:
    from armcontour.program.kerf import LeadPlacement

# Tag of the way from the height of a pierce.
PIERCE = "pierce"
# Free length between a tab and a corner, the start point or another tab, in widths of a tab.
CLEAR = 1.0
# Smaller turns are those of curves that are drawn as polylines, on which tabs may lie [rad].
CORNER = np.radians(20)


@checked
def prepare(
    program: Path | Program, process: Process, lengths: Sequence[Leads] | None = None
) -> Program:
    """The program with start points, leads, overlaps, approaches and events of the process.

    Args:
        program: The program as it is drawn, or a path.
        process: Requirements of the process.
        lengths: Lengths of leads without a given length, one item per contour after `resume_at`.

    Raises:
        InvalidInput: `resume_at` is past the end of the program, a layer does not exist, a lead has
            no side, lengths of leads are missing, or a program in the plane has an approach, a
            retract or the height of a pierce.
    """
    program = Program.of(program, "prepare needs a Path or a Program")
    if lengths is not None:
        lengths = checks.check_sequence("lengths", lengths, Leads, "Leads")
    check_process(program, process)
    program = arrange(program, process)
    rapids_away = leading_away(program.moves)
    switching = Switching(program.moves, process)
    moves: list[Move] = []
    drawn: list[Contour] = []
    changes = 0
    for i, x in enumerate(program.moves):
        if isinstance(x, Contour):
            own, called = process.of_layer(x.layer), contour_called(x, len(drawn))
            passes = _pass_again(x, own.passes)
            drawn += passes
            x = _start_contour(x, own, is_meant(program.moves, i), called, switching)
            moves += [dataclasses.replace(x, name=y.name) for y in passes]
        elif isinstance(x, Event) and x.changes_tool:
            moves.append(x)
            changes += bool(drawn)
            if drawn and process.tool_change is not None:
                moves.append(Dwell(duration=process.tool_change))
        elif not (isinstance(x, Event) and switching.takes(x)):
            moves.append(x)
    placement = None
    if process.leads:
        from armcontour.program.kerf import LeadPlacement

        placement = LeadPlacement(drawn, process)
    program = dataclasses.replace(program, moves=tuple(moves))
    program, run_in = resume(program, process.resume_at, keeps_lead=partial(_keeps_lead, process))
    given = 0 if lengths is None else len(lengths)
    if given != len(program.contours) and (process.automatic or lengths is not None):
        raise InvalidInput(
            f"Leads of automatic length need {len(program.contours)} lengths, one per contour, "
            f"but there are {given}: run a job, which finds them, or give the leads a length."
        )
    contours: list[Contour] = []
    for k, x in enumerate(program.contours, len(drawn) - len(program.contours)):
        own = process.of_layer(x.layer)
        leads = _lead_lengths(own, lengths, len(contours))
        contours.append(_add_leads(x, own, leads, run_in if not contours else None, placement, k))
    result = _link(program.moves, contours, process, rapids_away)
    notes = (*program.notes, *(() if placement is None else placement.notes))
    if changes and process.tool_change is None:
        notes = (*notes, _untimed(changes))
    speed = process.rapid_speed
    if speed is not None:
        result = [_slow(x, speed) if isinstance(x, Rapid) else x for x in result]
    return dataclasses.replace(program, moves=tuple(result), notes=notes, rapid_speed=speed)


def _untimed(changes: int) -> str:
    """A note on tool changes that take no time."""
    return (
        f"no time is stated for {count_noun(changes, 'tool change')}, so the program goes on "
        "at once: give process.tool_change, such as 5 s."
    )


def _slow(rapid: Rapid, speed: float) -> Rapid:
    """A rapid whose path has a largest speed, where it has none [m/s]."""
    path = rapid.path
    return rapid if path is None else Rapid(path=_with_limits(path, SegmentLimits(speed=speed)))


def check_process(program: Program, process: Process) -> None:
    """Refuse a process that the program as it is drawn cannot have.

    Args:
        program: The program as it is drawn.
        process: Requirements of the process.

    Raises:
        InvalidInput: A layer does not exist, or a program in the plane has an approach, a retract
            or the height of a pierce.
    """
    _refuse_unknown_layers(program, (*process.layers, *process.by_layer))
    pierces = any(x.pierce is not None and x.pierce.height for x in process.variants)
    if process.approach or process.retract or pierces:
        _refuse_plane(program)


def arrange(program: Program, process: Process) -> Program:
    """The program as it is drawn, with direction, kerf and order of the process.

    Args:
        program: The program as it is drawn.
        process: Requirements of the process.

    Raises:
        InvalidInput: A given order for a program with rapids, dwells or events, a direction for a
            contour with events, or a kerf that does not fit a contour.
    """
    program = direct_contours(program, process)
    if any(x.kerf for x in process.variants):
        from armcontour.program.kerf import apply_kerf

        program = apply_kerf(program, process)
    return order_contours(program, process)


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


def _add_limits(contour: Contour, segment_limits: SegmentLimits | None) -> Contour:
    """The contour with speed and tolerance of its layer on segments that have none."""
    if segment_limits is None:
        return contour
    return dataclasses.replace(contour, path=_with_limits(contour.path, segment_limits))


def _with_limits(path: Path, segment_limits: SegmentLimits) -> Path:
    """A path with speed and tolerance on segments that have none."""
    speeds, tolerances = (
        values if given is None else np.where(np.isnan(values), given, values)
        for values, given in (
            (path.speeds, segment_limits.speed),
            (path.tolerances, segment_limits.tolerance),
        )
    )
    # `SegmentLimits` have checked its values, so the segments stay checked.
    segments = path.segments.replace(speeds=speeds, tolerances=tolerances, checked=True)
    return dataclasses.replace(path, segments=segments)


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
    contour = _add_limits(contour, process.layers.get(contour.layer))
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
    with error_context(f"weave of {contour_called(contour, 0) if contour.name else 'a contour'}"):
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
    placement: LeadPlacement | None,
    number: int,
) -> Contour:
    """A contour with its leads.

    Args:
        contour: The contour.
        process: Requirements of the process.
        leads: Lengths of the leads.
        run_in: Part of the contour before `resume_at`, which serves as lead-in if it is long
            enough.
        placement: Where leads are laid; None without leads.
        number: Number of the contour there.
    """
    path, before = contour.path, 0.0
    parts = [path]
    if process.lead_in is not None and leads.before > REPEATED_POINT:
        if run_in is not None and run_in.path.length >= leads.before:
            end = run_in.path.length
            lead = cut_path(run_in.path, end - leads.before, end)
        else:
            assert placement is not None
            lead = placement.lay(number, path, process.lead_in, leads.before, after=False)
        before = lead.length
        parts.insert(0, lead)
    if placement and process.lead_out is not None and leads.after > REPEATED_POINT:
        parts.append(placement.lay(number, path, process.lead_out, leads.after, after=True))
    if process.pierce is not None and process.pierce.height > REPEATED_POINT:
        # Rounding the corner at its end would cut the start of the contour off.
        speed = None if np.isnan(path.speeds[0]) else float(path.speeds[0])
        drop = SegmentLimits(speed=speed, tolerance=0.0, tag=PIERCE)
        down = _axial_line(parts[0], 0.0, process.pierce.height, process.up, drop)
        parts.insert(0, down)
        before += parts[0].length
    whole, work = join_paths(parts), (before, before + path.length)
    events = tuple(_move_to_lead(x, process, work, whole.length) for x in contour.events)
    return dataclasses.replace(contour, path=whole, events=events, work=work)


def _move_to_lead(event: Event, process: Process, work: tuple[float, float], end: float) -> Event:
    """An event on a contour with leads; switching at its ends moves to the ends of active leads.

    Args:
        event: The event on the contour without leads.
        process: Requirements of the process.
        work: Arc lengths at which the contour starts and ends between its leads [m].
        end: Length of the contour with its leads [m].
    """
    moved = dataclasses.replace(event, s=event.s + work[0])
    if process.switch is None or event.name != process.switch.name:
        return moved
    if event.value and event.s <= REPEATED_POINT:
        wait = 0.0 if process.pierce is None else process.pierce.time
        s = 0.0 if process.begins_on else moved.s
        return dataclasses.replace(event, s=s, lead_time=event.lead_time + wait)
    if process.ends_on and not event.value and moved.s >= work[1] - REPEATED_POINT:
        return dataclasses.replace(moved, s=end)
    return moved


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
    segment_limits = SegmentLimits(speed=process.approach_speed)
    height = process.approach - (0.0 if pierce is None else pierce.height)
    if height > REPEATED_POINT and not linked:
        line = _axial_line(path, 0.0, height, process.up, segment_limits)
        result.insert(0, Rapid(path=line))
    if process.retract and not followed:
        line = _axial_line(path, path.length, process.retract, process.up, segment_limits)
        result.append(Rapid(path=line.reversed()))
    return result


def _axial_line(
    path: Path, s: float, height: float, up: FloatArray, segment_limits: SegmentLimits
) -> Path:
    """The line along the tool axis to arc length s of a path, with the orientation there.

    Without a required tool axis it is along `up`.

    Args:
        path: The path.
        s: The arc length, 0 or the length of the path [m].
        height: Length of the line [m].
        up: Upward direction, (3,).
        segment_limits: Speed and tolerance of the line.
    """
    end, given = path(s), path.orientation
    if given is None:
        return Path.polyline([end + height * up, end], segment_limits=segment_limits)
    rotation = given(s, side="right" if s == 0 else "left")
    line = Path.polyline([end - height * rotation[:, 2], end], segment_limits=segment_limits)
    return line.oriented(rotation, axis_only=given.axis_only)


def resume(
    program: Program, resume_at: float, *, keeps_lead: Callable[[Contour, Event], bool]
) -> tuple[Program, Contour | None]:
    """The rest of a program, and the part of the resumed contour before the arc length.

    Outputs switched before the arc length are switched again: at the arc length if they were
    switched on the same contour, else before the first move.

    Args:
        program: The program.
        resume_at: Arc length at which to resume, over all contours [m].
        keeps_lead: Whether an event of a contour keeps its time advance when it is switched again.

    Returns:
        The rest of the program, and the part of its first contour before the arc length; None if
        the program resumes at the start of a contour.

    Raises:
        InvalidInput: The arc length is not below the length of all contours.
    """
    if resume_at == 0:
        return program, None
    if resume_at >= program.length - REPEATED_POINT:
        raise InvalidInput(
            f"The program is to be resumed at {resume_at:g} m, but its contours are "
            f"{program.length:.9g} m long together.",
            s=resume_at,
            allowed=program.length,
        )
    # The end of a contour counts as the start of the next one.
    which = int(np.searchsorted(program.breaks, resume_at + REPEATED_POINT, side="right")) - 1
    s = max(resume_at - float(program.breaks[which]), 0.0)
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


class Switching:
    """State of the outputs of `switch` and `off_between`, from one contour to the next.

    Args:
        moves: The moves of the program.
        process: Requirements of the process.
    """

    def __init__(self, moves: Sequence[Move], process: Process) -> None:
        switches = (x.switch.name for x in process.variants if x.switch is not None)
        self.names = tuple(dict.fromkeys([*switches, *process.off_between]))
        self.process = process
        # Contours of a drawing can be reordered, so that none depends on the one before it.
        self.in_order = any(not isinstance(x, Contour) for x in moves)
        self.states: dict[str, Event] = {}
        known: set[str] = set()
        for x in moves if self.in_order else ():
            if isinstance(x, Event) and x.changes_tool:
                continue
            for event in x.events if isinstance(x, Contour) else [x]:
                if isinstance(event, Event) and event.name not in known:
                    known.add(event.name)
                    # An output that is first switched on is off before.
                    if event.value:
                        self.states[event.name] = dataclasses.replace(event, value=False)

    def takes(self, event: Event) -> bool:
        """Whether an event between contours takes effect at the start of the next contour."""
        if event.name in self.names:
            self.states[event.name] = event
        return event.name in self.names

    def confine(self, contour: Contour, events: Sequence[Event]) -> Contour:
        """A contour with events of the process, whose outputs are off at both of its ends.

        Args:
            contour: The contour from its start point, with laps and overlap.
            events: Events of the process on the contour.
        """
        found = sorted((*contour.events, *events), key=lambda x: x.s)
        layer = self.process.of_layer(contour.layer).switch
        confined: list[Event] = []
        for name in self.names:
            switch = layer if layer is not None and layer.name == name else None
            state = self.states.get(name) if self.in_order else None
            if state is None and switch is not None:
                drawn = next((x.value for x in contour.events if x.name == name), False)
                state = Event(name=name, value=not drawn)
            own = [x for x in found if x.name == name]
            last = own[-1] if own else state
            if last is not None:
                self.states[name] = last
            confined += _confined(own, state, switch, name, contour.path.length)
        others = [x for x in found if x.name not in self.names]
        return dataclasses.replace(contour, events=(*others, *confined))


def _confined(
    own: Sequence[Event], state: Event | None, switch: Switch | None, name: str, end: float
) -> list[Event]:
    """Events of one output of a contour that begins and ends with the output off.

    Args:
        own: The events along the contour, by arc length.
        state: The last event before the contour, if any.
        switch: Value and leads of events that have none, if any.
        name: Name of the output.
        end: Length of the contour [m].
    """
    kept: list[Event] = []
    if state is not None and not (own and own[0].s <= REPEATED_POINT):
        own = [dataclasses.replace(state, s=0.0), *own]
    own = [x for x in own if x.s < end - REPEATED_POINT]
    before: object = False
    for x in (*own, Event(name=name, value=False, s=end)):
        if switch is not None:
            x = dataclasses.replace(x, value=switch.value) if x.value is True else x
            if not (x.lead_time or x.lead_distance):
                lead = switch.on_lead if x.value else switch.off_lead
                x = dataclasses.replace(x, lead_time=lead)
        if (type(x.value), x.value) != (type(before), before):
            kept.append(x)
            before = x.value
    return kept


def add_tabs(contour: Contour, process: Process, lap: float) -> Contour:
    """A closed contour whose process is switched off at tabs, at the same places of every lap.

    Args:
        contour: The contour from its start point, with laps and overlap.
        process: Tabs and switch; a process without tabs leaves the contour as it is.
        lap: Length of one lap [m].

    Raises:
        InvalidInput: The contour has no room for its tabs.
    """
    if process.tabs is None:
        return contour
    assert process.switch is not None
    switch, width = process.switch, process.tabs.width
    end = contour.path.length
    events = list(contour.events)
    own = [x for x in events if x.name == switch.name]
    first = find_tabs(contour, process.tabs, lap)
    laps = np.arange(int(np.ceil(end / lap))) * lap
    for s in (laps[:, None] + first).ravel().tolist():
        off, on = s - width / 2, min(s + width / 2, end)
        events = [x for x in events if x.name != switch.name or not off <= x.s < on]
        for place, lead in ((off, switch.off_lead), (on, switch.on_lead)):
            # The output stays off in gaps of the program that begin or end on the tab.
            value = next((x.value for x in reversed(own) if x.s <= place), False)
            if value and place < end:
                value = value if place == on else False
                events.append(Event(name=switch.name, value=value, s=place, lead_time=lead))
    return dataclasses.replace(contour, events=tuple(events))


def find_tabs(contour: Contour, tabs: Tabs, lap: float) -> FloatArray:
    """Arc lengths of the middles of tabs on the first lap [m], (tabs,).

    Tabs are as far from each other as corners and the start point allow: those that would lie on
    one of them are moved beside it.

    Raises:
        InvalidInput: The contour has no room for its tabs.
    """
    width = tabs.width
    count = tabs.count or _count(contour, tabs.spacing or lap, lap)
    wanted = (np.arange(count) + 0.5) * lap / count
    corners = _corners(contour.path, lap)
    margin = (0.5 + CLEAR) * width
    low, high = corners[:-1] + margin, corners[1:] - margin
    free = low <= high
    moved = np.clip(wanted[:, None], low[free], high[free])
    places = np.empty(0)
    if free.any():
        nearest = np.argmin(np.abs(moved - wanted[:, None]), axis=1)
        places = np.sort(moved[np.arange(count), nearest])
    if not free.any() or (np.diff(places) < (1 + CLEAR) * width).any():
        raise InvalidInput(
            f"{_called(contour)} of {lap * 1e3:.4g} mm "
            f"has no room for {count} tab{'s' if count > 1 else ''} of {width * 1e3:.4g} mm, which "
            "keep a width free to corners, to the start point and to each other: take fewer or "
            "narrower ones, or leave them out with by_layer.",
            allowed=lap,
            needed=2 * count * width,
        )
    return places


def _count(contour: Contour, spacing: float, lap: float) -> int:
    """The number of tabs of a lap with a spacing [m].

    Raises:
        InvalidInput: There are more than MOST_TABS.
    """
    count = max(1, round(lap / spacing))
    if count > MOST_TABS:
        raise InvalidInput(
            f"{_called(contour)} of {lap * 1e3:.4g} mm would have {count:.4g} tabs with a spacing "
            f"of {spacing * 1e3:.4g} mm, more than {MOST_TABS}: take a larger spacing.",
            needed=count,
            allowed=MOST_TABS,
        )
    return count


def _called(contour: Contour) -> str:
    """What messages call a contour."""
    return contour_called(contour, 0) if contour.name else "A contour"


def _corners(path: Path, lap: float) -> FloatArray:
    """Arc lengths of start, corners and end of the first lap of a path [m]."""
    inner = path.breaks[1:-1][path.turns > CORNER]
    return np.concatenate([[0.0], inner[inner < lap], [lap]])
