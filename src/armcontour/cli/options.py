"""Options that commands take together: dataclasses whose fields are options."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, get_type_hints

import typer


def grouped(command: Callable[..., Any]) -> Callable[..., Any]:
    """A command that takes the fields of its parameters that are dataclasses as options.

    Args:
        command: A function; its parameters are annotated as typer wants them, or dataclasses whose
            fields are.
    """
    hints = get_type_hints(command, include_extras=True)
    groups = {k: x for k, x in hints.items() if isinstance(x, type) and is_dataclass(x)}

    @wraps(command)
    def call(**options: Any) -> Any:
        for name, of in groups.items():
            options[name] = of(**{x.name: options.pop(x.name) for x in fields(of)})
        return command(**options)

    found: list[inspect.Parameter] = []
    for x in inspect.signature(command).parameters.values():
        of = groups.get(x.name)
        known = hints if of is None else get_type_hints(of, include_extras=True)
        found += [
            y.replace(annotation=known[y.name], kind=inspect.Parameter.KEYWORD_ONLY)
            for y in ([x] if of is None else inspect.signature(of).parameters.values())
        ]
    call.__annotations__ = {x.name: x.annotation for x in found}
    call.__signature__ = inspect.Signature(found)  # type: ignore[attr-defined]
    return call


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOptions:
    """What the command line says of a job and its drawing in the place of the file."""

    units: Annotated[
        str | None, typer.Option("--units", help="Unit of the drawing, such as mm.")
    ] = None
    scale: Annotated[
        float | None, typer.Option("--scale", help="Factor of all lengths of the drawing.")
    ] = None
    at: Annotated[
        str | None,
        typer.Option("--at", help="Origin of the drawing, such as '300 mm, 0 mm, 100 mm'."),
    ] = None
    turn: Annotated[
        str | None, typer.Option("--turn", help="Roll, pitch, yaw of the drawing: '0, 0, 90 deg'.")
    ] = None
    layer: Annotated[
        list[str] | None, typer.Option("--layer", help="Only this layer; may be repeated.")
    ] = None
    contour: Annotated[
        list[str] | None, typer.Option("--contour", help="Only this contour; may be repeated.")
    ] = None
    flat: Annotated[bool, typer.Option("--flat", help="Leave z out.")] = False
    skip_unknown: Annotated[
        bool, typer.Option("--skip-unknown", help="Skip what the reader does not know.")
    ] = False
    speed: Annotated[
        str | None, typer.Option("--speed", help="Assigned velocity, such as '50 mm/s'.")
    ] = None
    tolerance: Annotated[
        str | None, typer.Option("--tolerance", help="Corner error, such as '0.2 mm'.")
    ] = None
    from_s: Annotated[
        str | None,
        typer.Option("--from-s", help="Resume where the contours are so long: '1.25 m'."),
    ] = None
    memory: Annotated[
        str | None, typer.Option("--memory", help="What the program may take, such as '4 GB'.")
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """What is to be exported of every run."""

    export: Annotated[
        list[str] | None,
        typer.Option(
            "--export",
            help="Format of taught data: csv, parquet, npz, ros-yaml, mcap, urscript; may be "
            "repeated.",
        ),
    ] = None
    template: Annotated[
        list[str] | None,
        typer.Option("--template", help="Export by a template: kuka, abb, or a .j2 file."),
    ] = None
    output: Annotated[
        list[str] | None,
        typer.Option("--output", help="Digital output of an event in exports: tool=0."),
    ] = None
