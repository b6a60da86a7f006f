"""Outputs that are on along contours only, except in the gaps that a program leaves."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program.moves import Contour, Event, Move
from armcontour.program.process import Process, Switch


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
        for name in self.names:
            drawn = [x for x in contour.events if x.name == name]
            switch = self.process.of_layer(contour.layer).switch
            switch = switch if switch is not None and switch.name == name else None
            state = self.states.get(name) if self.in_order else None
            if state is None and switch is not None:
                state = Event(name=name, value=not (drawn and drawn[0].value))
            own = [x for x in found if x.name == name]
            last = own[-1] if own else state
            if last is not None:
                self.states[name] = last
            found = [x for x in found if x.name != name]
            found += _confined(own, state, switch, name, contour.path.length)
        return dataclasses.replace(contour, events=tuple(found))


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
