"""Switches outputs off during rapids: off at the end of a contour, on at the start of the next."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from armcontour.program.moves import Contour, Event, Move


def switch_off_between(moves: Sequence[Move], names: Sequence[str]) -> list[Move]:
    """The moves with some outputs off between contours, and on again with their former values.

    Args:
        moves: Contours with rapids, dwells and events between them.
        names: Names of the outputs to switch off between contours.
    """
    result = list(moves)
    for name in names:
        state: Event | None = None
        kept: list[Move] = []
        for x in result:
            if isinstance(x, Event) and x.name == name:
                # The event takes effect at the start of the next contour.
                state = x
                continue
            if isinstance(x, Contour):
                x, state = _confine_switching(x, name, state)
            kept.append(x)
        result = kept
    return result


def _confine_switching(
    contour: Contour, name: str, state: Event | None
) -> tuple[Contour, Event | None]:
    """A contour that sets an output at its start and switches it off at its end.

    Args:
        contour: The contour.
        name: Name of the output.
        state: The last event of the output before the contour, if any.

    Returns:
        The contour with added events, and the last event of the output before it is switched off.
    """
    events = list(contour.events)
    own = [x for x in events if x.name == name]
    if state is not None and state.value is not False and not (own and own[0].s == 0):
        events.insert(0, dataclasses.replace(state, s=0.0))
    last = own[-1] if own else state
    end = contour.path.length
    if last is not None and last.value is not False:
        events.append(Event(name=name, value=False, s=end))
    return dataclasses.replace(contour, events=tuple(events)), last
