"""Exports of a run's taught data, and of what it was made from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armcontour.io import ResultFolder
    from armcontour.study import Job, RunResult

# Taught data is what the robot gets; the reference is the plan, without compensation.
TAUGHT, REFERENCE = "taught", "reference"


@dataclass(frozen=True, slots=True, kw_only=True)
class Exports:
    """What is to be exported of every run.

    Args:
        formats: Names of formats.
        templates: Names or files of templates.
        outputs: Digital outputs by names of events.
    """

    formats: tuple[str, ...] = ()
    templates: tuple[str, ...] = ()
    outputs: dict[str, int | str] | None = None

    def __bool__(self) -> bool:
        return bool(self.formats or self.templates)


def exports_of(formats: list[str], templates: list[str], outputs: list[str]) -> Exports:
    """What a command line asks for.

    Raises:
        InvalidInput: An unknown format, or an output that is not "event=number".
    """
    from armcontour.errors import InvalidInput
    from armcontour.io.exports import chosen_format

    for name in formats:
        chosen_format(FilePath(), name, "given" if name == "template" else None)
        if name == "template":
            raise InvalidInput("--export template needs its template: give it with --template.")
    found: dict[str, int | str] = {}
    for text in outputs:
        name, equals, number = text.partition("=")
        if not (name and equals and number):
            raise InvalidInput(
                f"--output must be an event and its output, such as tool=0: {text!r}."
            )
        found[name] = int(number) if number.isdecimal() else number
    return Exports(formats=tuple(formats), templates=tuple(templates), outputs=found or None)


def write_exports(folder: ResultFolder, job: Job, name: str, result: RunResult, x: Exports) -> None:
    """Export taught data and reference of one run into the folder of results."""
    from armcontour.io.exports import formats, tabulated, write_table

    endings = formats()
    targets: list[tuple[str, str, str | None]] = [(kind, endings[kind], None) for kind in x.formats]
    targets += [("template", _ending(text), text) for text in x.templates]
    for label, data, period in (
        (TAUGHT, result.taught, None),
        (REFERENCE, result.trajectory, result.run.period),
    ):
        table = tabulated(data, name=f"{job.name} {label}", arm=job.arm, period=period)
        for kind, ending, template in targets:
            write = partial(
                write_table,
                table,
                format=kind,
                template=template,
                outputs=x.outputs if kind in ("urscript", "template") else None,
            )
            folder.place(f"{name}/export/{label}{ending}", write)


def _ending(template: str) -> str:
    """The ending of what a template makes: of "kuka.src.j2" it is ".src"."""
    from armcontour.io.exports.template import SHIPPED

    file = SHIPPED.get(template, template)
    return FilePath(FilePath(file).name.removesuffix(".j2")).suffix or ".txt"
