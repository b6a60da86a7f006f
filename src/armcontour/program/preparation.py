"""Preparation of a program: start points, leads, overlaps, approaches and events of a process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.checks import LONGEST_NAME, FloatArray
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.fields import checked
from armcontour.core.text import count_noun, shorten
from armcontour.geometry import Path, SegmentLimits
from armcontour.geometry.path import cut_path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.weave import Weave, weave_seam
from armcontour.program.contour_order import close_contour, direct_contours, order_contours
from armcontour.program.execution_choice import chosen_contours, leave_out
from armcontour.program.moves import (
    AT_START,
    SWITCHED_ON,
    Contour,
    Dwell,
    Event,
    Move,
    Program,
    Rapid,
    Value,
    contour_called,
    events_of,
    find_departing_rapids,
    has_intended_start,
    last_end,
    next_rapid,
    put_on_path,
    reroute,
)
from armcontour.program.process import Lead, Leads, Process, Switch
from armcontour.program.tabs import add_tabs

if TYPE_CHECKING:
    from armcontour.program.leads import LeadPlacement

# Lead times of events that differ by at most this are equal [s].
SAME_TIME = 1e-9
# Tag of the line down from the height of a pierce.
PIERCE = "pierce"


@checked
def prepare(
    program: Path | Program, process: Process, lengths: Sequence[Leads] | None = None
) -> Program:
    """Add start points, leads, overlaps, approaches and events of the process to a program.

    >>> part = ac.Program(moves=(ac.Contour(path=path),))
    >>> [type(move).__name__ for move in ac.prepare(part, ac.Process(dwell=0.2)).moves]
    ['Dwell', 'Contour']

    Args:
        program: The program as drawn, or a path.
        process: Requirements of the process.
        lengths: Lengths of automatic leads, one item per contour that is executed.

    Raises:
        InvalidInput: `resume_at` is not less than the length of the program, a layer or a contour
            of `only` does not exist, a lead has no side, lengths of leads are missing, or a program
            in the plane has an approach, a retract or the height of a pierce.
    """
    program = Program.from_path(program)
    check_process(program, process)
    left_out_before = len(program.left_out)
    program = arrange_contours(program, process)
    departing_rapids = find_departing_rapids(program.moves)
    started = _start_contours(program, process)
    placement = None
    if process.leads:
        from armcontour.program.leads import LeadPlacement

        placement = LeadPlacement(started.drawn, process, program.left_out[left_out_before:])
    program = replace(program, moves=started.moves)
    chosen = chosen_contours(program.contours, process.only)
    program, run_in = resume_program(program, process)
    # Indices among all contours of those that are executed.
    executed = list(range(len(chosen)))[-len(program.contours) :]
    if process.only:
        is_executed = [chosen[i] for i in executed]
        run_in = run_in if is_executed[0] else None
        executed = [i for i in executed if chosen[i]]
        program = _leave_out(program, is_executed, process, departing_rapids)
    _check_lengths(program, process, lengths)
    contours = _add_all_leads(program, process, lengths, run_in, placement, executed)
    moves = _link_moves(program.moves, contours, process, departing_rapids)
    if process.off:
        moves = _without_outputs(moves)
    if process.rapid_speed is not None:
        moves = _limit_rapids(moves, process.rapid_speed)
    notes = list(program.notes)
    if placement is not None:
        notes += placement.notes
    if started.tool_changes:
        notes.append(_describe_tool_changes(started.tool_changes))
    program = replace(
        program, moves=tuple(moves), notes=tuple(notes), rapid_speed=process.rapid_speed
    )
    return program.placed(process.lift * process.up) if process.lift else program


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _StartedProgram:
    """A program whose contours begin at their start points.

    Args:
        moves: The moves, without the events that were added to contours.
        drawn: The contours before start points and overlaps were applied, one per pass.
        tool_changes: Number of tool changes after the first contour.
    """

    moves: tuple[Move, ...]
    drawn: list[Contour]
    tool_changes: int


def _start_contours(program: Program, process: Process) -> _StartedProgram:
    """Apply passes, start points, overlaps and events to the contours of a program."""
    output_states = OutputStates(program.moves, process)
    moves: list[Move] = []
    drawn: list[Contour] = []
    tool_changes = 0
    for i, move in enumerate(program.moves):
        if isinstance(move, Contour):
            contour_process = process.of_contour(move)
            called = contour_called(move, len(drawn))
            passes = _repeat_open_contour(move, contour_process.passes)
            drawn += passes
            led = has_intended_start(program.moves, i)
            contour = _start_contour(move, contour_process, led, called, output_states)
            moves += [replace(contour, name=drawn_pass.name) for drawn_pass in passes]
        elif isinstance(move, Event) and move.changes_tool:
            moves.append(move)
            tool_changes += bool(drawn)
        elif not (isinstance(move, Event) and output_states.record_event(move)):
            moves.append(move)
    return _StartedProgram(moves=tuple(moves), drawn=drawn, tool_changes=tool_changes)


def _check_lengths(program: Program, process: Process, lengths: Sequence[Leads] | None) -> None:
    """Raise InvalidInput unless there are lengths of automatic leads for all contours."""
    count = 0 if lengths is None else len(lengths)
    if count != len(program.contours) and (process.automatic or lengths is not None):
        raise InvalidInput(
            f"Leads of automatic length need {len(program.contours)} lengths, one per contour, "
            f"but got {count}. Run a job, which determines the lengths, or specify the length of "
            "the leads."
        )


def _add_all_leads(
    program: Program,
    process: Process,
    lengths: Sequence[Leads] | None,
    run_in: Contour | None,
    placement: LeadPlacement | None,
    executed: Sequence[int],
) -> list[Contour]:
    """Return the contours of a program with their leads.

    - `lengths`: lengths of automatic leads, one item per contour.
    - `run_in`: part of the first contour before the point at which the program resumes.
    - `executed`: indices of the contours in the whole program.
    """
    contours: list[Contour] = []
    for k, contour in enumerate(program.contours):
        contour_process = process.of_contour(contour)
        leads = _lead_lengths(contour_process, lengths, k)
        begin = run_in if k == 0 else None
        contours.append(_add_leads(contour, contour_process, leads, begin, placement, executed[k]))
    return contours


def _leave_out(
    program: Program, is_executed: Sequence[bool], process: Process, departing_rapids: set[Rapid]
) -> Program:
    """Return the program with the contours that are executed only.

    Raises InvalidInput if none is left.
    """
    if not any(is_executed):
        raise InvalidInput(
            f"only chooses contours that end before resume_at, {process.resume_at:g} m, so "
            "that nothing is left to execute. Remove one of them.",
            s=process.resume_at,
        )
    if not program.work_starts:
        program = replace(program, work_starts=tuple(program.breaks[:-1].tolist()))
    return leave_out(program, is_executed, process.up, departing_rapids)


def _limit_rapids(moves: Sequence[Move], speed: float) -> list[Move]:
    """Set the speed [m/s] of all rapids whose path is specified."""
    limit = SegmentLimits(speed=speed)
    limited = list[Move]()
    for move in moves:
        if isinstance(move, Rapid) and move.path is not None:
            move = Rapid(path=set_limits(move.path, limit))
        limited.append(move)
    return limited


def _describe_tool_changes(count: int) -> str:
    """Return the note on tool changes between contours."""
    return (
        f"the program has {count_noun(count, 'tool change')}. The tool stops there, but the plan "
        "contains no time for the change, and the same tool frame before and after it. For other "
        "tools, divide the program into one file per tool."
    )


def check_process(program: Program, process: Process) -> None:
    """Raise InvalidInput for a layer that does not exist, or a vertical motion in the plane."""
    available = {x.layer for x in program.contours}
    for name in (*process.layers, *process.by_layer):
        if name not in available:
            listed = ", ".join(repr(x) for x in sorted(available)[:12])
            raise InvalidInput(
                f"{program.source or 'The program'} has no contour on a layer {name!r}, only on "
                f"{listed}."
            )
    pierces = any(x.pierce is not None and x.pierce.height for x in process.variants)
    heights = (process.approach, process.retract, process.lift)
    if program.dimension == 2 and (any(heights) or pierces):
        raise InvalidInput(
            "approach, retract, lift and the height of a pierce are vertical, which a program in "
            "the plane does not support. Remove them, or use an arm in space."
        )


def arrange_contours(program: Program, process: Process) -> Program:
    """Apply direction, kerf and order of a process to the contours of a drawn program.

    Args:
        program: The program as it is drawn.
        process: Requirements of the process.

    Raises:
        InvalidInput: An order is specified for a program with rapids, dwells or events, a
            direction for a contour with events, or a kerf that does not fit a contour.
    """
    program = direct_contours(program, process)
    if any(x.kerf for x in process.variants):
        from armcontour.program.kerf import apply_kerf

        program = apply_kerf(program, process)
    return order_contours(program, process)


def _repeat_open_contour(contour: Contour, passes: int) -> list[Contour]:
    """Return one contour per pass of an open contour, with the number of the pass in its name.

    A closed contour is returned alone, because its passes are laps.
    """
    # `passes` is checked first, because `closed` takes longer.
    if passes == 1 or contour.closed:
        return [contour]
    suffixes = [f" ({k})" for k in range(2, passes + 1)] if contour.name else [""] * (passes - 1)
    names = [f"{shorten(contour.name, LONGEST_NAME - len(x))}{x}" for x in suffixes]
    return [contour, *(replace(contour, name=x) for x in names)]


def _link_moves(
    moves: Sequence[Move],
    contours: Sequence[Contour],
    process: Process,
    departing_rapids: set[Rapid],
) -> list[Move]:
    """Return the moves with prepared contours, and with their approaches, retracts and dwells.

    The end points of rapids move to the new ends of the contours.

    - `contours`: the prepared contours, in the order of the contours among `moves`.
    - `departing_rapids`: rapids that start at the end of the contour before them.
    """
    result: list[Move] = []
    # Where each move of the program begins in `result`.
    positions: list[int] = []
    number = 0
    for i, move in enumerate(moves):
        positions.append(len(result))
        if isinstance(move, Rapid) and move in departing_rapids:
            move = reroute(move, start=last_end(result))
        if not isinstance(move, Contour):
            result.append(move)
            continue
        contour = contours[number]
        previous_rapid = next_rapid(moves, range(i - 1, -1, -1))
        if previous_rapid is not None:
            k = positions[previous_rapid]
            result[k] = reroute(result[k], end=contour.path(0.0))
        followed = next_rapid(moves, range(i + 1, len(moves))) is not None
        linked = previous_rapid is not None
        contour_moves = _add_heights(contour, process, linked=linked, followed=followed)
        rests, begun = _rest_before(contour, process.of_contour(contour), number)
        k = contour_moves.index(contour)
        contour_moves[k : k + 1] = [*rests, begun]
        if rests and not k and not linked and number:
            # The tool moves to the contour before it rests there.
            contour_moves.insert(0, Rapid())
        result += contour_moves
        number += 1
    return result


def _rest_before(contour: Contour, process: Process, number: int) -> tuple[list[Move], Contour]:
    """Return what happens at rest before a contour, and the contour without these events.

    The order is: waits with the process off, dwell, switching on, waits for the process, pierce.

    - `process`: the process of this contour.
    - `number`: index of the contour, for messages.
    """
    if process.off:
        return _dwells(process.dwell), contour
    pierce = 0.0 if process.pierce is None else process.pierce.time
    waits = process.waits_at(AT_START)
    rests: list[Move] = [Dwell(duration=x.rest, wait=x) for x in waits]
    late_waits = process.waits_at(SWITCHED_ON)
    if not late_waits:
        dwell = process.dwell + pierce
        if waits:
            # No event may be due before the wait.
            dwell = max([dwell, *(x.lead_time for x in contour.events)])
        return [*rests, *_dwells(dwell)], contour
    at_start = [x for x in contour.events if x.s <= REPEATED_POINT]
    assert process.switch is not None
    switch = next((x for x in at_start if x.name == process.switch.name and x.value), None)
    if switch is None:
        raise InvalidInput(
            f"The robot waits for {late_waits[0].input} at the start of "
            f"{contour_called(contour, number)} after {process.switch.name} is switched on, but "
            "this contour does not switch it on at its start. Set at: start in wait, or remove "
            "the wait from this contour."
        )
    # Events that are due before the process is switched on, or together with it.
    before = [x for x in at_start if x.lead_time >= switch.lead_time - SAME_TIME]
    events = tuple(x for x in contour.events if x not in before)
    contour = replace(contour, events=events)
    switching = [replace(x, s=0.0, lead_time=x.lead_time - switch.lead_time) for x in before]
    rests += _dwells(max([process.dwell, *(x.lead_time for x in switching)]))
    rests += [*sorted(switching, key=lambda x: -x.lead_time)]
    rests += [Dwell(duration=x.rest, wait=x) for x in late_waits]
    return [*rests, *_dwells(max([switch.lead_time, *(x.lead_time for x in events)]))], contour


def _dwells(duration: float) -> list[Move]:
    """Return a dwell of a duration [s], or no move for 0 and below."""
    return [Dwell(duration=duration)] if duration > 0 else []


def _without_outputs(moves: Sequence[Move]) -> list[Move]:
    """Remove the events that switch outputs; the tool still stops at tool changes."""
    kept = list[Move]()
    for move in moves:
        if isinstance(move, Contour):
            kept.append(replace(move, events=()))
        elif not isinstance(move, Event) or move.changes_tool:
            kept.append(move)
    return kept


def _lead_lengths(process: Process, lengths: Sequence[Leads] | None, number: int) -> Leads:
    """Return the process's lead lengths of contour `number` [m], or else those in `lengths`."""
    automatic = Leads() if lengths is None else lengths[number]
    return Leads(
        before=_lead_length(process.lead_in, automatic.before),
        after=_lead_length(process.lead_out, automatic.after),
    )


def _lead_length(lead: Lead | None, automatic: float) -> float:
    """Return the length of a lead [m], `automatic` if none is specified, or 0 without a lead."""
    if lead is None:
        return 0.0
    return automatic if lead.length is None else lead.length


def set_limits(path: Path, segment_limits: SegmentLimits, *, override: bool = False) -> Path:
    """Set the speed and tolerance of a path's segments that have none.

    - `override`: true to set those of all segments.
    """
    speeds = _fill_in(path.speeds, segment_limits.speed, override)
    tolerances = _fill_in(path.tolerances, segment_limits.tolerance, override)
    # `SegmentLimits` has checked the values, so the segments count as checked.
    segments = path.segments.replace(speeds=speeds, tolerances=tolerances, checked=True)
    return replace(path, segments=segments)


def _fill_in(values: FloatArray, limit: float | None, override: bool) -> FloatArray:
    """Return values in which a limit replaces missing values, or with `override` all values.

    - `values`: one value per segment, NaN if missing, (n,).
    - `limit`: the limit; None to keep the values.
    """
    if limit is None:
        return values
    return np.where(np.isnan(values) | override, limit, values)


def _start_contour(
    contour: Contour, process: Process, led: bool, called: str, output_states: OutputStates
) -> Contour:
    """Apply start point, overlap, layer limits, events, tabs and weave to a contour.

    - `led`: true if a rapid, dwell or event leads to the start of the contour.
    - `called`: name of the contour, for messages.
    """
    segment_limits = process.layers.get(contour.layer)
    if segment_limits is not None:
        path = set_limits(contour.path, segment_limits)
        contour = replace(contour, path=path)
    closed = contour.closed
    lap = contour.path.length
    if closed:
        contour = close_contour(contour, process, led=led, outputs=output_states.current_values)
    path = contour.path
    for event in process.events:
        if event.s > path.length + REPEATED_POINT:
            raise InvalidInput(
                f"The event {event.name} is at {event.s:g} m of every contour, but {called} is "
                f"only {path.length:g} m long.",
                s=event.s,
                allowed=path.length,
            )
    contour = output_states.add_switching(contour, process.events)
    if closed:
        contour = add_tabs(contour, process, lap)
    return contour if process.weave is None else _weave(contour, process.weave)


def _weave(contour: Contour, weave: Weave) -> Contour:
    """Weave along a contour; events stay at the same fraction of the length."""
    with error_context(f"weave of {contour_called(contour, 0) if contour.name else 'a contour'}"):
        path, woven = weave_seam(contour.path, weave)
    scale = partial(np.multiply, path.length / contour.path.length)
    return put_on_path(contour, path, scale, ring=contour.closed, woven=woven)


def _add_leads(
    contour: Contour,
    process: Process,
    leads: Leads,
    run_in: Contour | None,
    placement: LeadPlacement | None,
    number: int,
) -> Contour:
    """Add the leads, and the line down from the pierce height, to a contour.

    - `run_in`: part of a resumed contour before its new start, which serves as lead-in if it is
      long enough.
    - `number`: index of the contour in `placement`.
    """
    path = contour.path
    before = 0.0
    parts = [path]
    if process.lead_in is not None and leads.before > REPEATED_POINT:
        if run_in is not None and run_in.path.length >= leads.before:
            end = run_in.path.length
            lead = cut_path(run_in.path, end - leads.before, end)
        else:
            assert placement is not None
            lead = placement.place_lead(number, path, process.lead_in, leads.before, after=False)
        before = lead.length
        parts.insert(0, lead)
    if placement and process.lead_out is not None and leads.after > REPEATED_POINT:
        parts.append(placement.place_lead(number, path, process.lead_out, leads.after, after=True))
    if process.pierce is not None and process.pierce.height > REPEATED_POINT:
        # The tolerance is 0, because rounding of the corner at the end of the line would cut off
        # the start of the contour.
        speed = None if np.isnan(path.speeds[0]) else float(path.speeds[0])
        drop = SegmentLimits(speed=speed, tolerance=0.0, tag=PIERCE)
        down = _axial_line(parts[0], 0.0, process.pierce.height, process.up, drop)
        parts.insert(0, down)
        before += parts[0].length
    whole = parts[0].joined(*parts[1:])
    work = (before, before + path.length)
    events = tuple(_move_to_lead(x, process, work, whole.length) for x in contour.events)
    return replace(contour, path=whole, events=events, work=work)


def _move_to_lead(event: Event, process: Process, work: tuple[float, float], end: float) -> Event:
    """Move an event to a contour with leads; switch events move to the ends of active leads.

    - `work`: arc lengths at which the lead-in ends and the lead-out begins [m].
    - `end`: length of the contour with leads [m].
    """
    moved = replace(event, s=event.s + work[0])
    if process.switch is None or event.name != process.switch.name:
        return moved
    if event.value and event.s <= REPEATED_POINT:
        pierce_time = 0.0 if process.pierce is None else process.pierce.time
        s = 0.0 if process.begins_on else moved.s
        return replace(event, s=s, lead_time=event.lead_time + pierce_time)
    if process.ends_on and not event.value and moved.s >= work[1] - REPEATED_POINT:
        return replace(moved, s=end)
    return moved


def _add_heights(contour: Contour, process: Process, *, linked: bool, followed: bool) -> list[Move]:
    """Return a contour with its approach and retract, as moves in order.

    - `linked`: true if a rapid with a path leads to the contour, so it needs no approach.
    - `followed`: true if a rapid with a path follows the contour, so it needs no retract.
    """
    path = contour.path
    pierce = process.of_contour(contour).pierce
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
    """Make a line down to a point of a path, along the tool axis, or along `up` without one.

    - `s`: arc length of the point [m].
    - `height`: length of the line [m].
    """
    end = path(s)
    orientation = path.orientation
    if orientation is None:
        return Path.polyline([end + height * up, end], segment_limits=segment_limits)
    rotation = orientation(s, side="right" if s == 0 else "left")
    line = Path.polyline([end - height * rotation[:, 2], end], segment_limits=segment_limits)
    oriented = line.oriented(rotation, axis_only=orientation.axis_only)
    return oriented.with_cone(orientation.cone)


def resume_program(program: Program, process: Process) -> tuple[Program, Contour | None]:
    """Return the rest of a resumed program, and its first contour's part before that.

    The rest begins by `rejoin` before `resume_at`, but not before the contour. Outputs that are
    switched before the rest are switched again: at its start if they are switched on the same
    contour, or else before the first move. The second result is None if the rest begins at the
    start of a contour.
    """
    resume_at = process.resume_at
    if resume_at == 0:
        return program, None
    if resume_at >= program.length - REPEATED_POINT:
        raise InvalidInput(
            f"The arc length at which the program is resumed must be less than the length of all "
            f"contours, {program.length:.9g} m, but is {resume_at:g} m.",
            s=resume_at,
            allowed=program.length,
        )
    index, s = find_resumed_place(program.breaks, process)
    contour = program.contours[index]
    moves = program.moves
    i = [k for k, x in enumerate(moves) if isinstance(x, Contour)][index]
    switched = {x.name: replace(x, s=0.0, lead_time=0) for x in events_of(moves[:i])}
    remaining = _cut_after(contour, s, process.of_contour(contour))
    resumed = replace(
        program,
        moves=(*switched.values(), remaining, *moves[i + 1 :]),
        work_starts=(float(program.breaks[index]) + s, *program.breaks[index + 1 : -1].tolist()),
    )
    if s <= REPEATED_POINT:
        return resumed, None
    before = cut_path(contour.path, 0.0, s)
    return resumed, Contour(path=before, name=contour.name, layer=contour.layer)


def find_resumed_place(breaks: FloatArray, process: Process) -> tuple[int, float]:
    """Find where the rest of a program begins: the index of the contour, and the arc length on it.

    - `breaks`: arc lengths at which the contours start, and the end of the last one [m].
    - `process`: the process with `resume_at`, before the end, and `rejoin`.
    """
    # The end of a contour counts as the start of the next contour.
    index = int(np.searchsorted(breaks, process.resume_at + REPEATED_POINT, side="right")) - 1
    s = max(process.resume_at - float(breaks[index]) - process.rejoin, 0.0)
    return index, s


def _cut_after(contour: Contour, s: float, process: Process) -> Contour:
    """Return the part of a contour after arc length s [m], with its outputs set at its start."""
    if s <= REPEATED_POINT:
        return contour
    last_events: dict[str, Event] = {}
    switch_name = process.switch and process.switch.name
    for event in contour.events:
        if event.s <= s + REPEATED_POINT:
            # The outputs in `last_events` are in the order of their last events.
            last_events.pop(event.name, None)
            switches_on = event.name == switch_name and event.value
            keeps_lead_time = process.lead_in is not None or switches_on
            lead_time = event.lead_time if keeps_lead_time else 0.0
            last_events[event.name] = replace(event, s=0.0, lead_time=lead_time)
    later = [replace(x, s=x.s - s) for x in contour.events if x.s > s + REPEATED_POINT]
    return replace(
        contour,
        path=cut_path(contour.path, s, contour.path.length),
        events=(*last_events.values(), *later),
    )


class OutputStates:
    """Values of the outputs of `switch` and `off_between`, updated from contour to contour.

    - `moves`: the moves of the program.
    - `process`: the process that switches these outputs.
    """

    def __init__(self, moves: Sequence[Move], process: Process) -> None:
        switches = (x.switch.name for x in process.variants if x.switch is not None)
        # Names of the outputs that are off between contours.
        self.names = tuple(dict.fromkeys([*switches, *process.off_between]))
        self.process = process
        # Contours of a drawing can be reordered, so outputs keep no value from contour to contour.
        self.in_order = any(not isinstance(x, Contour) for x in moves)
        # Current value of each output that the program has switched.
        self.current_values: dict[str, Value] = {}
        # Last event of each output in `names`, whose value applies from the next contour's start.
        self.last_events = _initial_off_events(moves) if self.in_order else {}

    def record_event(self, event: Event) -> bool:
        """Record an event between contours; true if it applies from the next contour's start on."""
        self.current_values[event.name] = event.value
        if event.name in self.names:
            self.last_events[event.name] = event
        return event.name in self.names

    def add_switching(self, contour: Contour, events: Sequence[Event]) -> Contour:
        """Add events to a contour, so that the outputs are off before and after the contour.

        - `contour`: the contour from its start point, with laps and overlap.
        - `events`: events of the process for the contour.
        """
        all_events = sorted((*contour.events, *events), key=lambda x: x.s)
        self.current_values |= {x.name: x.value for x in all_events}
        contour_switch = self.process.of_contour(contour).switch
        confined: list[Event] = []
        for name in self.names:
            switch = contour_switch
            if switch is not None and switch.name != name:
                switch = None
            initial_event = self.last_events.get(name) if self.in_order else None
            if initial_event is None and switch is not None:
                first_value = next((x.value for x in contour.events if x.name == name), False)
                initial_event = Event(name=name, value=not first_value)
            output_events = [x for x in all_events if x.name == name]
            last_event = output_events[-1] if output_events else initial_event
            if last_event is not None:
                self.last_events[name] = last_event
            confined += _confine_output(
                output_events, initial_event, switch, name, contour.path.length
            )
        other_events = [x for x in all_events if x.name not in self.names]
        return replace(contour, events=(*other_events, *confined))


def _initial_off_events(moves: Sequence[Move]) -> dict[str, Event]:
    """Return an event with the value off for each output that is first switched on, by name.

    Such an output is off before this first event. Tool changes are no outputs.
    """
    moves = [x for x in moves if not (isinstance(x, Event) and x.changes_tool)]
    first_events: dict[str, Event] = {}
    for event in events_of(moves):
        first_events.setdefault(event.name, event)
    return {name: replace(x, value=False) for name, x in first_events.items() if x.value}


def _confine_output(
    events: Sequence[Event],
    initial_event: Event | None,
    switch: Switch | None,
    name: str,
    end: float,
) -> list[Event]:
    """Return an output's events along a contour, outside which it is off.

    - `events`: events of the output along the contour, in order.
    - `initial_event`: event with the value at the start if no event at the start sets it, or None.
    - `switch`: switch of the process if it has this output, or None.
    - `name`: name of the output.
    - `end`: length of the contour [m].
    """
    changes: list[Event] = []
    if initial_event is not None and not (events and events[0].s <= REPEATED_POINT):
        events = [replace(initial_event, s=0.0), *events]
    events = [x for x in events if x.s < end - REPEATED_POINT]
    value_before: object = False
    for event in (*events, Event(name=name, value=False, s=end)):
        if switch is not None:
            event = replace(event, value=switch.value) if event.value is True else event
            if not event.lead_time:
                lead = switch.on_lead if event.value else switch.off_lead
                event = replace(event, lead_time=lead)
        # True and 1 are different values.
        if (type(event.value), event.value) != (type(value_before), value_before):
            changes.append(event)
            value_before = event.value
    return changes
