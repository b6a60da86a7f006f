"""What is on over rapids and shall not be: off where a contour ends, on where the next begins."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from armcontour.program.moves import Contour, Event, Move


def switch_off_between(moves: Sequence[Move], names: Sequence[str]) -> list[Move]:
    """The moves with some things off between contours, which come on again as they were.

    Args:
        moves: Contours and what is between them.
        names: Of what is to be off between them.
    """
    result = list(moves)
    for name in names:
        state: Event | None = None
        found: list[Move] = []
        for x in result:
            if isinstance(x, Event) and x.name == name:
                # It comes on with the contour after it, and is off till then.
                state = x
                continue
            if isinstance(x, Contour):
                x, state = _confine_switching(x, name, state)
            found.append(x)
        result = found
    return result


def _confine_switching(
    contour: Contour, name: str, state: Event | None
) -> tuple[Contour, Event | None]:
    """A contour with its own switching to what was on before it, and off at its end."""
    events = list(contour.events)
    own = [x for x in events if x.name == name]
    if state is not None and state.value is not False and not (own and own[0].s == 0):
        events.insert(0, dataclasses.replace(state, s=0.0))
    last = own[-1] if own else state
    end = contour.path.length
    if last is not None and last.value is not False:
        events.append(Event(name=name, value=False, s=end))
    return dataclasses.replace(contour, events=tuple(events)), last
