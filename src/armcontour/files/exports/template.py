"""Robot programs from jinja2 templates of the package or of the user, rendered in a sandbox."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path as FilePath
from pathlib import PurePath
from typing import Any, NoReturn

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import read_text
from armcontour.core.text import list_some
from armcontour.files.exports.export_table import POSITION_DECIMALS, SetPointTable
from armcontour.files.exports.identifiers import identifier
from armcontour.files.exports.slow_move import SLOW
from armcontour.motion import TimedEvent, TimedWait

ENDING = ".j2"
# Templates of the package by name.
BUILT_IN = {"kuka": "kuka.src.j2", "abb": "abb.mod.j2"}
# Number of points above which a program causes a warning. Such a program has about 1 MB; no
# controller is known to accept longer programs.
MAX_POINTS = 10_000
# Advice for longer programs of the templates of the package.
LONGER_CYCLE = "use a longer cycle (--cycle)"
# Events closer in time than this are simultaneous [s].
SAME_TIME = 1e-9
# Maximum length of a message in KRL and RAPID [characters].
LONGEST_MESSAGE = 80
# Variable with which a template states whether its controller executes each point at its time.
KEEPS_TIMES = "keeps_times"
# Largest number of events that a message lists.
MAX_NAMES = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotProgram:
    """Properties of a kind of robot program, for warnings about a program."""

    output: int | str  # Example of a digital output
    input: int | str  # Example of a digital input
    analog: int | str  # Example of an analog output
    substitute: str  # What the program contains instead of an event without an output
    advice: str  # How to shorten a program that is too long


# Programs of the templates of the package by name.
PROGRAMS = {
    "kuka": RobotProgram(output=17, input=5, analog=1, substitute="comments", advice=LONGER_CYCLE),
    "abb": RobotProgram(
        output="doTool",
        input="diClamp",
        analog="aoPower",
        substitute="comments",
        advice=LONGER_CYCLE,
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """Point of the table in templates."""

    number: int  # Number of the point, from 1
    t: float  # Time from the first point [s]
    q: tuple[float, ...]  # Joint positions [rad or m]
    q_deg: tuple[float, ...]  # Positions of the joints that are no external axes [deg]
    external: tuple[float, ...]  # Positions of the external axes [deg], prismatic ones in [mm]
    dq: tuple[float, ...] | None  # Joint velocities [rad/s]; None unless exported
    ddq: tuple[float, ...] | None  # Joint accelerations [rad/s²]; None unless exported
    analog: Mapping[str, float]  # Values of analog outputs by their names
    events: tuple[TimedEvent, ...]  # Events from this point until before the next point
    # The wait for an input at this point, after `events_before` and before `events`; or None
    wait: TimedWait | None
    events_before: tuple[TimedEvent, ...]  # Events at this point before its wait


class _Refused(Exception):
    """Error with the reason for which a template rejects a table."""


def render_template(
    table: SetPointTable,
    template: str | FilePath,
    outputs: Mapping[str, int | str],
    inputs: Mapping[str, int | str],
    *,
    file: str,
) -> str:
    """Render a template with the points of a table, and return the text of the program.

    Args:
        table: Points, events and analog values.
        template: Name of a built-in format, or path of a template.
        outputs: Outputs of events and analog outputs, by their names.
        inputs: Inputs of waits, by their names.
        file: Name of the program's file, without its extension.

    Raises:
        InvalidInput: The template does not exist, has wrong syntax or raises an error; or it
            rejects the table.
    """
    source, text = _read_template(template)
    if table.waits and "wait" not in text:
        raise InvalidInput(
            f"{source}: the template does not use wait, but {table.name!r} waits for "
            f"{table.waits[0].input} (process.wait). Write the wait of a point, or remove it."
        )
    variables = _variables(table, outputs, inputs, file)
    try:
        return str(_environment().from_string(text).render(variables))
    except _Refused as error:
        raise InvalidInput(f"{source}: {_error_text(error)}.") from None
    except Exception as error:  # A user's template can raise any exception.
        raise InvalidInput(f"{_error_line(error, source)}: {_error_text(error)}.") from None


def program_warnings(
    table: SetPointTable, program: RobotProgram, outputs: Mapping[str, int | str]
) -> list[str]:
    """Return warnings about a program: outputs that are not set, and too many points.

    Args:
        table: Points, events and analog values.
        program: What the controller's programs support, and examples for messages.
        outputs: Outputs of events and analog outputs, by their names.
    """
    sentences = []
    if len(table.t) > MAX_POINTS:
        sentences.append(
            f"the program has {len(table.t)} points, but a controller may reject more than "
            f"{MAX_POINTS}. To reduce them, {program.advice}, or divide the job."
        )
    unset = [x for x in table.analog if x not in outputs]
    if unset:
        sentences.append(
            f"the program does not set {list_some(unset, MAX_NAMES)}, because no analog output is "
            f"named. Name an output, such as outputs: {{{unset[0]}: {program.analog}}}."
        )
    unswitched = [x for x in table.events if x.name not in outputs]
    valued = {x.name: None for x in unswitched if not isinstance(x.value, bool)}
    switches = {x.name: None for x in unswitched if x.name not in valued}
    if switches:
        example = f"outputs: {{{next(iter(switches))}: {program.output}}}"
        sentences.append(
            f"the program does not switch {list_some(list(switches), MAX_NAMES)}, because no "
            f"output is named. It has {program.substitute} instead. Name an output, such as "
            f"{example}."
        )
    if valued:
        sentences.append(
            f"the program does not switch {list_some(list(valued), MAX_NAMES)}, because the "
            f"values are not on or off. It has {program.substitute} instead. For such values, "
            "write your own template."
        )
    return sentences


def wait_message(wait: TimedWait) -> str:
    """Return the message of a robot program whose input does not come in time.

    Raises:
        InvalidInput: A robot program does not support the name of the input.
    """
    message = f"{wait.input} did not come within {wait.within:.6g} s"
    is_plain = message.isascii() and message.isprintable() and not set('"\\') & set(message)
    if not is_plain or len(message) > LONGEST_MESSAGE:
        raise InvalidInput(
            f"A robot program cannot show the message {message!r}. Rename the input with ASCII "
            f"characters other than quotes and backslashes, such that the message has at most "
            f"{LONGEST_MESSAGE} characters."
        )
    return message


def ending_of_template(name: str) -> str:
    """Return the extension of the program of a template, such as ".src" for "house.src.j2"."""
    return PurePath(name.removesuffix(ENDING)).suffix or ".txt"


def write_template(
    table: SetPointTable,
    file: FilePath,
    template: str | FilePath,
    outputs: Mapping[str, int | str],
    inputs: Mapping[str, int | str],
) -> None:
    """Write the program that a template generates from a table.

    Args:
        table: As in `render_template`.
        file: File to write.
        template: As in `render_template`.
        outputs: As in `render_template`.
        inputs: As in `render_template`.

    Raises:
        InvalidInput: As in `render_template`.
    """
    text = render_template(table, template, outputs, inputs, file=file.stem)
    file.write_text(text, encoding="utf-8", newline="\n")


def _check_syntax(source: str, text: str) -> None:
    """Raise InvalidInput for a template with wrong syntax."""
    try:
        _environment().from_string(text)
    except Exception as error:  # jinja2 raises errors of several classes.
        raise InvalidInput(f"{_error_line(error, source)}: {_error_text(error)}.") from None


def template_keeps_times(template: str | FilePath) -> bool:
    """Return what a template states about its controller: `{% set keeps_times = true %}`, or false.

    Raises:
        InvalidInput: The template cannot be read, or does not state it.
    """
    from jinja2 import nodes

    source, text = _read_template(template)
    _check_syntax(source, text)
    for node in _environment().parse(text).find_all(nodes.Assign):
        is_statement = isinstance(node.target, nodes.Name) and node.target.name == KEEPS_TIMES
        if is_statement and isinstance(node.node, nodes.Const):
            return bool(node.node.value)
    raise InvalidInput(
        f"{source} must state whether the controller executes each point at its time. Write "
        f"{{% set {KEEPS_TIMES} = true %}}, or false if the controller plans the motion between "
        "the points, as with KRL and RAPID."
    )


def _read_template(template: str | FilePath) -> tuple[str, str]:
    """Return the file name and text of a template, from its name or path."""
    if isinstance(template, str) and template in BUILT_IN:
        # Templates of the package may be read where only some folders of the user may be.
        file = FilePath(__file__).parent / "templates" / BUILT_IN[template]
        return file.name, file.read_text(encoding="utf-8")
    file = FilePath(template)
    if isinstance(template, str) and file.suffix == "" and not os.path.exists(file):
        raise InvalidInput(
            f"There is no template {template!r}. Specify one of {', '.join(BUILT_IN)}, or a "
            f"file such as house{ENDING}."
        )
    return file.name, read_text(file, "template")


def _environment() -> Any:
    """Return the sandbox of jinja2, in which templates can read the table but no files."""
    from jinja2 import StrictUndefined
    from jinja2.sandbox import ImmutableSandboxedEnvironment

    environment = ImmutableSandboxedEnvironment(
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        newline_sequence="\n",
        autoescape=False,  # noqa: S701 - programs, not pages
    )
    environment.filters["fixed"] = _format_fixed
    environment.filters["degrees"] = lambda x: _map_numbers(math.degrees, x)
    environment.filters["times"] = lambda x, factor: _map_numbers(lambda y: y * factor, x)
    environment.filters["identifier"] = identifier
    environment.globals["refuse"] = _refuse
    return environment


def _variables(
    table: SetPointTable,
    outputs: Mapping[str, int | str],
    inputs: Mapping[str, int | str],
    file: str,
) -> dict[str, Any]:
    """Return the variables of a template by name."""
    points = _template_points(table)
    return {
        "name": table.name,
        "origin": table.origin,
        "servo": table.servo,
        "between": table.between,
        "file": file,
        "joint_names": table.joint_names,
        "arm_joints": tuple(x for k, x in enumerate(table.joint_names) if k not in table.external),
        "dof": table.dof,
        "cycle": table.cycle,
        "duration": table.duration,
        "start_time": table.start_time,
        "points": points,
        "slow": SLOW,
        "external": tuple(
            f"{table.joint_names[k]} ({'mm' if table.prismatic[k] else 'deg'})"
            for k in table.external
        ),
        "events": tuple(chain.from_iterable((*x.events_before, *x.events) for x in points)),
        "outputs": _plain_signals(outputs),
        "inputs": _plain_signals(inputs),
        "analog_off": dict(table.analog_off),
        "wait_message": wait_message,
    }


def _plain_signals(signals: Mapping[str, int | str]) -> dict[str, int | str]:
    """Return outputs or inputs with numbers of Python's class."""
    return {x: int(n) if isinstance(n, np.integer) else n for x, n in signals.items()}


def _template_points(table: SetPointTable) -> tuple[Point, ...]:
    """Return the points of a table, each with its events."""
    events: dict[int, list[TimedEvent]] = {}
    for event, i in zip(table.events, table.point_of_events, strict=True):
        events.setdefault(i, []).append(event)
    waits = dict(zip(table.point_of_waits, table.waits, strict=True))
    external = list(table.external)
    shown = np.where(table.prismatic, table.q * 1e3, np.degrees(table.q))
    arrays = {
        "q": table.q,
        "q_deg": np.delete(shown, external, axis=1),
        "external": shown[:, external],
        "dq": table.dq,
        "ddq": table.ddq,
    }
    rows: dict[str, Any] = {x: y if y is None else y.tolist() for x, y in arrays.items()}
    points = []
    for i, t in enumerate(table.t.tolist()):
        row = {key: x and tuple(x[i]) for key, x in rows.items()}
        analog = {key: float(values[i]) for key, values in table.analog.items()}
        wait = waits.get(i)
        events_of_point = events.get(i, [])
        before = [x for x in events_of_point if wait is not None and x.t <= wait.t + SAME_TIME]
        points.append(
            Point(
                number=i + 1,
                t=t,
                **row,
                analog=analog,
                events=tuple(events_of_point[len(before) :]),
                wait=wait,
                events_before=tuple(before),
            )
        )
    return tuple(points)


def _map_numbers(function: Any, value: Any) -> Any:
    """Apply a function to a number, or to each number of a sequence."""
    return function(value) if isinstance(value, int | float) else [function(y) for y in value]


def _format_fixed(value: float | Sequence[float], decimals: int = POSITION_DECIMALS) -> str:
    """Write a number, or several separated by commas, with a fixed number of decimals."""
    text = _map_numbers(lambda y: f"{y:.{decimals}f}", value)
    return text if isinstance(text, str) else ", ".join(text)


def _refuse(reason: str) -> NoReturn:
    """Reject the table with a reason; templates call this function as `refuse`."""
    raise _Refused(reason)


def _error_text(error: Exception) -> str:
    """Return the message of an error on one line, without the full stop at the end."""
    message = " ".join(str(error).split()).rstrip(".")
    return message or type(error).__name__


def _error_line(error: Exception, source: str) -> str:
    """Return the name of the template and number of the line in which an error occurred."""
    from jinja2 import TemplateSyntaxError

    if isinstance(error, TemplateSyntaxError):
        return f"{source}, line {error.lineno}"
    # jinja2 maps frames of the traceback to lines of the template.
    line = None
    step = error.__traceback__
    while step is not None:
        if step.tb_frame.f_code.co_filename == "<template>":
            line = step.tb_lineno
        step = step.tb_next
    return source if line is None else f"{source}, line {line}"
