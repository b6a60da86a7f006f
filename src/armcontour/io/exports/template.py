"""Programs for any controller, from templates: ours or the user's, run where they do no harm."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import Any, NoReturn

import numpy as np

from armcontour._files import read_text
from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.exports.table import Table
from armcontour.io.exports.text import DECIMALS, event_words

ENDING = ".j2"
SHIPPED = {"abb": "abb.mod.j2", "kuka": "kuka.src.j2"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Switch:
    """An event as templates see it: as `TimedEvent`, and `text`, such as "tool=on"."""

    name: str
    value: bool | float | str
    t: float
    due: float
    s: float
    point: tuple[float, ...]
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A row of the table as templates see it.

    Args:
        number: From 1.
        t: Time from the first point [s].
        q, q_deg: Joint positions [rad], [deg].
        dq, ddq: Their velocities and accelerations; None where the table has none.
        tool: Tool point [m]; None without an arm.
        events: What is switched from here on, before the next point.
    """

    number: int
    t: float
    q: tuple[float, ...]
    q_deg: tuple[float, ...]
    dq: tuple[float, ...] | None
    ddq: tuple[float, ...] | None
    tool: tuple[float, ...] | None
    events: tuple[Switch, ...]


class _Refused(Exception):
    """What a template says of a table that it is not for."""


def templates() -> tuple[str, ...]:
    """Names of the templates that come with the package."""
    return tuple(SHIPPED)


def template_of(
    table: Table, template: str | FilePath, outputs: Mapping[str, int | str] | None = None
) -> str:
    """A template filled with the table.

    Args:
        table: The table.
        template: "kuka" or "abb", or a jinja2 file of one's own.
        outputs: What is at `outputs` in the template: outputs by names of events.

    Raises:
        InvalidInput: No such template, one that is wrong, or one that refuses the table; names the
            template and the line.
    """
    source, text, folder = _read(template)
    environment = _environment(folder)
    variables = _variables(table, outputs or {})
    try:
        return str(environment.from_string(text).render(variables))
    except _Refused as error:
        raise InvalidInput(f"{source}: {_sentence(error)}.") from None
    except Exception as error:  # what a user's template does wrong can be anything
        raise InvalidInput(f"{_place(error, source)}: {_sentence(error)}.") from None


def write_template(
    table: Table,
    file: FilePath,
    template: str | FilePath,
    outputs: Mapping[str, int | str] | None = None,
) -> None:
    """Write `template_of` to a file."""
    file.write_text(template_of(table, template, outputs), encoding="utf-8", newline="\n")


def _read(template: str | FilePath) -> tuple[str, str, FilePath]:
    """Name, text and folder of a template."""
    if isinstance(template, str) and template in SHIPPED:
        place = FilePath(__file__).parent / "templates" / SHIPPED[template]
    else:
        place = FilePath(template)
        if isinstance(template, str) and place.suffix == "" and not os.path.exists(place):
            raise InvalidInput(
                f"There is no template {template!r}: give one of {', '.join(SHIPPED)}, or a file "
                f"such as house{ENDING}."
            )
    return place.name, read_text(place, "template"), place.parent


def _beside(folder: FilePath, name: str) -> str:
    """The text of a template that another one names.

    Raises:
        InvalidInput: It lies elsewhere than in the folder, or cannot be read.
        TemplateNotFound: There is none.
    """
    from jinja2 import TemplateNotFound
    from jinja2.loaders import split_template_path

    # Refuses names that begin elsewhere or go up.
    place = folder.joinpath(*split_template_path(name))
    if not os.path.lexists(place):
        raise TemplateNotFound(name)
    place = FilePath(os.path.realpath(place))
    if not place.is_relative_to(os.path.realpath(folder)):
        raise InvalidInput(
            f"the template {show(name)} is a link that leads out of the folder of templates"
        )
    return read_text(place, "template")


def _environment(folder: FilePath) -> Any:
    """Where templates run: they see the table and what lies beside them, and change nothing."""
    from jinja2 import FunctionLoader, StrictUndefined
    from jinja2.sandbox import ImmutableSandboxedEnvironment

    environment = ImmutableSandboxedEnvironment(
        loader=FunctionLoader(partial(_beside, folder)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        newline_sequence="\n",
        autoescape=False,  # noqa: S701 - programs, not pages
    )
    environment.filters["fixed"] = _fixed
    environment.filters["degrees"] = lambda x: _each(math.degrees, x)
    environment.filters["times"] = lambda x, factor: _each(lambda y: y * factor, x)
    environment.filters["identifier"] = _identifier
    environment.globals["refuse"] = _refuse
    return environment


def _variables(table: Table, outputs: Mapping[str, int | str]) -> dict[str, Any]:
    points = _points(table)
    return {
        "name": table.name,
        "joint_names": table.joint_names,
        "dof": table.dof,
        "period": table.period,
        "duration": table.duration,
        "start_time": table.start_time,
        "points": points,
        "events": tuple(x for point in points for x in point.events),
        "outputs": dict(outputs),
    }


def _points(table: Table) -> tuple[Point, ...]:
    switches: dict[int, list[Switch]] = {}
    for x, i in zip(table.events, table.point_of_events, strict=True):
        switches.setdefault(i, []).append(
            Switch(
                name=x.name,
                value=x.value,
                t=x.t,
                due=x.due,
                s=x.s,
                point=x.point,
                text=event_words(x),
            )
        )
    count = len(table.t)
    arrays = (table.q, np.degrees(table.q), table.dq, table.ddq, table.tool)
    rows = zip(*(_tuples(x, count) for x in arrays), strict=True)
    return tuple(
        Point(
            number=i + 1,
            t=t,
            q=q or (),
            q_deg=degrees or (),
            dq=dq,
            ddq=ddq,
            tool=tool,
            events=tuple(switches.get(i, ())),
        )
        for i, (t, (q, degrees, dq, ddq, tool)) in enumerate(
            zip(table.t.tolist(), rows, strict=True)
        )
    )


def _tuples(values: Any, count: int) -> list[tuple[float, ...] | None]:
    return [None] * count if values is None else [tuple(x) for x in values.tolist()]


def _each(function: Any, x: Any) -> Any:
    return function(x) if isinstance(x, int | float) else [function(y) for y in x]


def _fixed(x: float | Sequence[float], decimals: int = DECIMALS) -> str:
    """Numbers with so many decimals; several with commas between."""
    found = _each(lambda y: f"{y:.{decimals}f}", x)
    return found if isinstance(found, str) else ", ".join(found)


def _identifier(text: str) -> str:
    """Text as a name in a program: letters, digits and underscores of ASCII, no digit first."""
    plain = "".join(x if x.isascii() and x.isalnum() else "_" for x in text)
    return f"_{plain}" if plain[:1].isdigit() else plain


def _refuse(reason: str) -> NoReturn:
    raise _Refused(reason)


def _sentence(error: Exception) -> str:
    """What an error says, on one line and without its full stop."""
    from jinja2 import TemplateNotFound

    if isinstance(error, TemplateNotFound):
        return f"there is no template {error.name!r} beside it"
    said = " ".join(str(error).split()).rstrip(".")
    return said or type(error).__name__


def _place(error: Exception, source: str) -> str:
    """The template and its line; jinja2 gives tracebacks the lines of templates."""
    from jinja2 import TemplateSyntaxError

    if isinstance(error, TemplateSyntaxError):
        return f"{error.name or source}, line {error.lineno}"
    found, step = None, error.__traceback__
    while step is not None:
        if step.tb_frame.f_code.co_filename == "<template>":
            found = step.tb_lineno
        step = step.tb_next
    return source if found is None else f"{source}, line {found}"
