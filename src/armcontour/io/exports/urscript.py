"""URScript: a program that moves a robot of Universal Robots along its set-points."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path as FilePath

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.io.exports.table import Table
from armcontour.io.exports.text import FIXED, event_words, filled
from armcontour.motion import TimedEvent

JOINTS = 6
# Its controllers take set-points 500 times a second; older ones every fourth time.
CYCLE = 0.002
# Standard digital outputs of its control boxes.
OUTPUTS = 8
# The last set-point is held for so long, until the servo has caught up [s].
HOLD = 0.5

HEAD = """\
# {title}: {count} set-points, every {period} s, for {duration} s
# Joint positions in rad: {joints}
def armcontour():
  # These shape the servo: take the values for which its model was identified.
  lookahead = 0.1
  gain = 300
  # Slowly to the first set-point; see that the way to it is free.
  movej([{first}], a=0.3, v=0.2)
"""


def urscript_of(table: Table, outputs: Mapping[str, int | str] | None = None) -> str:
    """The table as a program: slowly to the first set-point, then one `servoj` per set-point.

    An event comes between the two set-points that it is nearest to, at most half an interval off;
    its very time stands after it as a comment. The last sample of a trajectory comes a whole
    interval after the one before it, even if its own time is earlier. On and off set the digital
    output that is given for the event's name; any other event is only told, by `textmsg`.

    Args:
        table: The table of an arm with six joints.
        outputs: Standard digital outputs, 0 to 7, by names of events.

    Raises:
        InvalidInput: Another number of joints, an interval that is not of whole cycles of 2 ms, an
            output that there is not, or an event that cannot be written.
    """
    _check(table)
    wanted = _outputs(table, outputs or {})
    period = f"{table.period:.12g}"
    point = f"  servoj([{', '.join([FIXED] * JOINTS)}], 0, 0, {period}, lookahead, gain)\n"
    numbers = [", ".join(FIXED % x for x in q) for q in (table.q[0], table.q[-1])]
    head = HEAD.format(
        title=table.name,
        count=len(table.q),
        period=period,
        duration=f"{table.duration:.12g}",
        joints=", ".join(table.joint_names),
        first=numbers[0],
    )
    text = head + "".join(_merged(table, wanted, point, numbers[1]))
    return f"{text}  stopj(2.0)\nend\n\narmcontour()\n"


def write_urscript(
    table: Table, file: FilePath, outputs: Mapping[str, int | str] | None = None
) -> None:
    """Write `urscript_of` to a file."""
    file.write_text(urscript_of(table, outputs), encoding="utf-8", newline="\n")


def _merged(table: Table, outputs: Mapping[str, int], point: str, last: str) -> Iterator[str]:
    """The set-points and events in the order of their times, and what comes after the end."""
    done, count = 0, len(table.q)
    for event in table.events:
        # A servoj that starts at a set-point's time lasts for one interval, so that the line after
        # it runs at the time of the next.
        before = round(event.t / table.period)
        yield from filled(point, table.q[done : min(before, count)])
        if before > max(done, count):
            yield _held(last, (before - max(done, count)) * table.period)
        yield _set_output(event, outputs)
        done = max(done, before)
    yield from filled(point, table.q[done:])
    yield _held(last, HOLD)


def _held(last: str, duration: float) -> str:
    return f"  servoj([{last}], 0, 0, {duration:.12g}, lookahead, gain)\n"


def _set_output(event: TimedEvent, outputs: Mapping[str, int]) -> str:
    words, at = event_words(event), f"  # {event_words(event)} at {FIXED % event.t} s\n"
    if event.name in outputs:
        state = "True" if event.value is not False else "False"
        return f"  set_standard_digital_out({outputs[event.name]}, {state}){at}"
    said = f"{event.name}={event.value}" if isinstance(event.value, str) else words
    # URScript knows no escapes in text.
    if not said.isprintable() or any(x in said for x in '"\\'):
        raise InvalidInput(
            f"URScript cannot say the event {words}: give it a name and a value of one line "
            "without quotes and backslashes."
        )
    return f'  textmsg("{said}"){at}'


def _check(table: Table) -> None:
    if table.dof != JOINTS:
        raise InvalidInput(
            f"URScript is for arms with {JOINTS} joints, but {table.name!r} has {table.dof}: "
            "choose another format.",
            needed=float(table.dof),
            allowed=float(JOINTS),
        )
    cycles = table.period / CYCLE
    if round(cycles) < 1 or not math.isclose(cycles, round(cycles), rel_tol=1e-9):
        raise InvalidInput(
            f"URScript runs a servoj for whole cycles of {CYCLE * 1e3:g} ms, but the set-points of "
            f"{table.name!r} come every {table.period * 1e3:g} ms: choose another "
            "command interval.",
            needed=table.period,
            allowed=CYCLE,
        )


def _outputs(table: Table, outputs: Mapping[str, int | str]) -> dict[str, int]:
    """The outputs of events, checked."""
    found: dict[str, int] = {}
    for name, number in outputs.items():
        if isinstance(number, bool) or not isinstance(number, int | np.integer):
            raise InvalidInput(f"The output of {name} must be a number, but is {number!r}.")
        if not 0 <= number < OUTPUTS:
            raise InvalidInput(
                f"The output of {name} must be from 0 to {OUTPUTS - 1}, but is {number}."
            )
        found[name] = int(number)
    for event in table.events:
        # "reverse" or "mist" is on; a number would be lost.
        if event.name in found and not isinstance(event.value, bool | str):
            raise InvalidInput(
                f"The event {event.name} switches to {json.dumps(event.value)}, but a digital "
                "output is only on or off: leave its output out."
            )
    return found
