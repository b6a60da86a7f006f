"""URScript programs, which move a robot of Universal Robots along its set-points."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path as FilePath

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.files.exports.export_table import (
    SetPointTable,
    fixed_form,
    format_rows,
    write_pieces,
)
from armcontour.files.exports.identifiers import identifier
from armcontour.files.exports.slow_move import SLOW
from armcontour.files.exports.template import SAME_TIME, wait_message
from armcontour.motion import Servoj, TimedEvent, TimedWait

JOINTS = 6
# Cycle of the controllers [s]; older controllers have a cycle of four times this value.
CONTROLLER_CYCLE = 0.002
# Number of standard digital outputs of a control box.
OUTPUTS = 8
# Number of standard digital inputs of a control box.
INPUTS = 8
# Maximum length of a program name that all versions of the controller accept [characters], as in
# UR's client library.
LONGEST_NAME = 31
# Duration for which the last set-point is commanded, so that the servo reaches it [s].
HOLD = 0.5

# Decimals of the level of an analog output.
LEVEL_DECIMALS = 4
# Relative difference up to which a cycle counts as a multiple of the controller's cycle.
CYCLE_ROUNDING = 1e-9
# Number of standard analog outputs of a control box.
ANALOG_OUTPUTS = 2
# Format of the level of an analog output, from 0 to 1.
LEVEL = "%.4f"
# Largest rounding error of LEVEL: a level may be outside 0 to 1 by at most this.
SAME_LEVEL = 5e-5

# Begin of a program. Over a socket, the controller requires `def` in the first line.
PROGRAM_HEAD = """\
def {program}():
  # {title}: {count} set-points, every {cycle} s, for {duration} s
{origin}{servo}  # Joint positions in rad: {joints}
  # Set the speed slider to 100 %, so that the robot follows the times of the set-points.
  # Parameters of the servo: use the values with which its model was identified.
  lookahead = {servoj.lookahead:.12g}
  gain = {servoj.gain:.12g}
  # Slow move to the first set-point; make sure that there are no obstacles.
  movej([{first}], a={slow.joint_acceleration}, v={slow.joint_speed})
"""
# A wait for an input. While the robot waits, it holds the set-point of its rest.
WAIT = """\
  # Wait for {input} at rest, at most {within} s
  cycles = 0
  while not get_standard_digital_in({number}):
    if cycles >= {count}:
{switch_off}      stopj(2.0)
      popup("{message}", title="armcontour", error=True, blocking=True)
      halt
    end
  {hold}
    cycles = cycles + 1
  end
"""


def write_urscript(
    table: SetPointTable,
    file: FilePath,
    outputs: Mapping[str, int | str],
    inputs: Mapping[str, int | str],
    *,
    call: bool,
    servoj: Servoj,
) -> None:
    """Write a URScript program: a slow move to the start, then one `servoj` per set-point.

    The program is one function from the first to the last line, because the controller requires
    this of a program over a socket (script manual, "Connecting to URControl").

    An event is executed at the nearest set-point, at most half a cycle before or after its time; a
    comment states the exact time. The interval before the last sample of a trajectory is always a
    whole cycle, even if the time of the sample is earlier. An event with a digital output switches
    the output on or off; any other event writes a message by `textmsg`. An analog output with a
    number is set at each set-point at which its level changes. A wait for an input repeats the
    set-point of its rest until the input is on.
    """
    _check_table(table)
    cycle = f"{table.cycle:.12g}"
    angles = fixed_form(table.decimals, JOINTS)
    point = f"  servoj([{angles}], 0, 0, {cycle}, lookahead, gain)\n"
    numbers = [angles % tuple(q) for q in (table.q[0], table.q[-1])]
    program = identifier(f"armcontour_{table.name}", LONGEST_NAME)
    head = PROGRAM_HEAD.format(
        program=program,
        title=table.name,
        origin=f"  # {table.origin}\n" if table.origin else "",
        servo=f"  # Compensated: {table.servo}\n" if table.servo else "",
        count=len(table.q),
        cycle=cycle,
        duration=f"{table.duration:.12g}",
        joints=", ".join(table.joint_names),
        first=numbers[0],
        slow=SLOW,
        servoj=servoj,
    )
    # Computed before the file is opened, because an invalid event raises an error.
    lines = _lines_between(table, outputs, inputs, point)
    commands = _commands(table, lines, point, numbers[1])
    end = "  stopj(2.0)\nend\n" + (f"\n{program}()\n" if call else "")
    write_pieces(file, chain([head], commands, [end]))


@dataclass(frozen=True, slots=True)
class _Line:
    """Commands between the set-points of a program.

    - `cycle`: index of the set-point at whose time they are executed.
    - `text`: the commands.
    - `waits_before`: number of waits that come before them.
    - `is_wait`: whether they wait for an input.
    """

    cycle: int
    text: str
    waits_before: int = 0
    is_wait: bool = False


def _lines_between(
    table: SetPointTable,
    outputs: Mapping[str, int | str],
    inputs: Mapping[str, int | str],
    point: str,
) -> list[_Line]:
    """Return the commands that switch outputs and wait for inputs, in their order.

    - `point`: format of the servoj command for a row of joint positions.
    """
    analog = {x: n for x, n in outputs.items() if x in table.analog}
    digital = _digital_outputs(table, {x: n for x, n in outputs.items() if x not in analog})
    # A program waits after two set-points of the rest, so that the last step is zero.
    holds = [i + 2 for i in table.point_of_waits]
    lines = list[_Line]()
    for event in table.events:
        count = sum(x.t < event.t - SAME_TIME for x in table.waits)
        cycle_of_event = max([round(event.t / table.cycle), *holds[:count]])
        lines.append(_Line(cycle_of_event, _set_output(event, digital), count))
    for name, number in analog.items():
        output = _analog_number(name, number)
        _check_levels(name, np.append(table.analog[name], table.analog_off[name]))
        lines += _set_levels(output, table.analog[name])
    numbers = _digital_inputs(inputs)
    switch_off = _switch_off(table, digital, analog)
    for count, (wait, i) in enumerate(zip(table.waits, holds, strict=True)):
        hold = point % tuple(table.q[i - 1].tolist())
        text = _wait_for(wait, numbers, hold, table.cycle, switch_off)
        lines.append(_Line(i, text, count, is_wait=True))
    return sorted(lines, key=lambda x: (x.cycle, x.waits_before, x.is_wait))


def _commands(table: SetPointTable, lines: Sequence[_Line], point: str, last: str) -> Iterator[str]:
    """Yield servoj commands and other lines in the order of their times.

    - `lines`: other lines, in their order.
    - `point`: format of the servoj command for a row of joint positions.
    - `last`: the last joint positions as text.
    """
    # Number of cycles whose commands were yielded.
    done = 0
    count = len(table.q)
    for line in lines:
        # A servoj takes one cycle, so that the next line is executed at the time of the next
        # set-point.
        cycle = line.cycle
        yield from format_rows(point, table.q[done : min(cycle, count)])
        if cycle > max(done, count):
            yield _repeat_last(last, (cycle - max(done, count)) * table.cycle)
        yield line.text
        done = max(done, cycle)
    yield from format_rows(point, table.q[done:])
    yield _repeat_last(last, HOLD)


def per_format(name: str, output: int | str) -> str:
    """Return the advice for an output of another format."""
    return f"Outputs can differ by format, such as outputs: {{{name}: {{urscript: {output}}}}}."


def _repeat_last(last: str, duration: float) -> str:
    """Return the command that holds the last set-point for a duration [s]."""
    return f"  servoj([{last}], 0, 0, {duration:.12g}, lookahead, gain)\n"


def _analog_number(name: str, number: int | str) -> int:
    """Return the number of a standard analog output, from a number or a name such as "AO0"."""
    names = {f"AO{k}": k for k in range(ANALOG_OUTPUTS)}
    value = names.get(number) if isinstance(number, str) else number
    if value is None or isinstance(value, bool) or value not in names.values():
        raise InvalidInput(
            f"The analog output of {name} must be AO0 or AO1, but is {number!r}. "
            f"{per_format(name, 'AO0')}"
        )
    return int(value)


def _check_levels(name: str, values: FloatArray) -> None:
    """Raise InvalidInput for values of an analog output outside its range."""
    low, high = float(values.min()), float(values.max())
    if not -SAME_LEVEL <= low <= high <= 1.0 + SAME_LEVEL:
        raise InvalidInput(
            f"The analog output {name} has values from {low:.6g} to {high:.6g}, but URScript "
            "allows levels from 0 to 1 (the range of the output). Scale rest, full and off.",
            needed=high,
            allowed=1.0,
        )


def _set_levels(number: int, values: FloatArray) -> list[_Line]:
    """Return the commands that set an analog output."""
    levels = np.round(np.clip(values, 0.0, 1.0), LEVEL_DECIMALS)
    changes = np.flatnonzero(np.diff(levels, prepend=np.nan) != 0).tolist()
    return [
        _Line(i, f"  set_standard_analog_out({number}, {LEVEL % levels[i]})\n") for i in changes
    ]


def _set_output(event: TimedEvent, outputs: Mapping[str, int]) -> str:
    """Return the command that switches the output of an event, or writes a message without one."""
    comment = f"  # {event.text} at {event.t:.6f} s\n"
    if event.name in outputs:
        state = "True" if event.value is not False else "False"
        return f"  set_standard_digital_out({outputs[event.name]}, {state}){comment}"
    value = (
        {True: "on", False: "off"}[event.value] if isinstance(event.value, bool) else event.value
    )
    message = f"{event.name}={value}"
    # String literals of URScript have no escape sequences.
    if not message.isprintable() or any(x in message for x in '"\\'):
        raise InvalidInput(
            f"URScript does not support the text of the event {event.text}. Its name and value "
            "must be one line without quotes and backslashes."
        )
    return f'  textmsg("{message}"){comment}'


def _switch_off(
    table: SetPointTable, digital: Mapping[str, int], analog: Mapping[str, int | str]
) -> str:
    """Return the commands that switch all outputs of a program off."""
    commands = [f"      set_standard_digital_out({n}, False)\n" for n in digital.values()]
    for name, number in analog.items():
        level = LEVEL % table.analog_off[name]
        commands.append(f"      set_standard_analog_out({_analog_number(name, number)}, {level})\n")
    return "".join(commands)


def _wait_for(
    wait: TimedWait, inputs: Mapping[str, int], hold: str, cycle: float, switch_off: str
) -> str:
    """Return the commands that wait for an input, and end the program if it does not come.

    - `inputs`: numbers of the digital inputs by name.
    - `hold`: command that repeats the set-point of the rest for one cycle.
    - `switch_off`: commands that switch all outputs off.
    """
    return WAIT.format(
        input=wait.input,
        number=inputs[wait.input],
        within=f"{wait.within:.6g}",
        count=math.ceil(wait.within / cycle * (1 - CYCLE_ROUNDING)),
        message=wait_message(wait),
        hold=hold.rstrip("\n"),
        switch_off=switch_off,
    )


def _digital_inputs(inputs: Mapping[str, int | str]) -> dict[str, int]:
    """Check the digital inputs of waits; return their numbers by name."""
    numbers: dict[str, int] = {}
    for name, number in inputs.items():
        if isinstance(number, bool) or not isinstance(number, int | np.integer):
            raise InvalidInput(
                f"The input {name} must be a number, but is {number!r}. Inputs can differ by "
                f"format, such as inputs: {{{name}: {{urscript: 0}}}}."
            )
        if not 0 <= number < INPUTS:
            raise InvalidInput(f"The input {name} must be from 0 to {INPUTS - 1}, but is {number}.")
        numbers[name] = int(number)
    return numbers


def _check_table(table: SetPointTable) -> None:
    """Check that URScript can represent a table."""
    if table.external:
        raise InvalidInput(
            f"URScript cannot move external axes, but {table.name!r} has {len(table.external)} "
            "(rail, gantry or positioner), even if they are held. Plan with an arm without them, "
            "or choose a format with external axes: kuka, abb, ros-yaml or csv."
        )
    if table.dof != JOINTS:
        raise InvalidInput(
            f"URScript requires an arm with {JOINTS} joints, but {table.name!r} has {table.dof}. "
            "Choose another format.",
            needed=float(table.dof),
            allowed=float(JOINTS),
        )
    cycles = table.cycle / CONTROLLER_CYCLE
    if round(cycles) < 1 or not math.isclose(cycles, round(cycles), rel_tol=CYCLE_ROUNDING):
        raise InvalidInput(
            f"URScript requires a cycle that is a multiple of {CONTROLLER_CYCLE * 1e3:g} ms, but "
            f"the cycle of {table.name!r} is {table.cycle * 1e3:g} ms. Choose another cycle.",
            needed=table.cycle,
            allowed=CONTROLLER_CYCLE,
        )


def _digital_outputs(table: SetPointTable, outputs: Mapping[str, int | str]) -> dict[str, int]:
    """Check the digital outputs of events; return their numbers by name of the event."""
    numbers: dict[str, int] = {}
    for name, number in outputs.items():
        if isinstance(number, bool) or not isinstance(number, int | np.integer):
            raise InvalidInput(
                f"The output of {name} must be a number, but is {number!r}. {per_format(name, 0)}"
            )
        if not 0 <= number < OUTPUTS:
            raise InvalidInput(
                f"The output of {name} must be from 0 to {OUTPUTS - 1}, but is {number}."
            )
        numbers[name] = int(number)
    for event in table.events:
        # A text such as "reverse" or "mist" means on; a digital output cannot represent a number.
        if event.name in numbers and not isinstance(event.value, bool | str):
            raise InvalidInput(
                f"The event {event.name} has the value {json.dumps(event.value)}, but a digital "
                "output has only the values on and off. Remove the output of this event."
            )
    return numbers
