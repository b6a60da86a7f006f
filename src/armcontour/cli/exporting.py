"""Exports of a run's taught data, and of what it was made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armcontour.cli.options import ExportOptions
    from armcontour.io import ResultFolder
    from armcontour.io.exports.table import Table
    from armcontour.jobs import Job, RunPlan
    from armcontour.program import Event

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One file of an export.

    Args:
        kind: Its format.
        ending: Of its name.
        template: Of the format "template".
    """

    kind: str
    ending: str
    template: str | None = None

    @property
    def asked(self) -> str:
        """How the command line asks for it."""
        if self.template is None:
            return f"--export {self.kind}"
        return f"--template {self.template}"

    def options(self, x: Exports) -> dict[str, Any]:
        """Arguments of `write_table`."""
        takes = self.kind in ("urscript", "template")
        return {
            "format": self.kind,
            "template": self.template,
            "outputs": x.outputs if takes else None,
        }


def exports_of(x: ExportOptions) -> Exports:
    """What a command line asks for.

    Args:
        x: As text.

    Raises:
        InvalidInput: An unknown format, or an output that is not "event=number".
    """
    from armcontour.errors import InvalidInput
    from armcontour.io.exports import chosen_format

    formats, templates, outputs = x.export or [], x.template or [], x.output or []
    for name in formats:
        chosen_format(FilePath(), name, "given" if name == "template" else None)
        if name == "template":
            raise InvalidInput("--export template needs its template: give it with --template.")
    if outputs and not ("urscript" in formats or templates):
        raise InvalidInput("--output goes with --export urscript or with --template.")
    found: dict[str, int | str] = {}
    for text in outputs:
        name, equals, number = text.partition("=")
        if not (name and equals and number):
            raise InvalidInput(
                f"--output must be an event and its output, such as tool=0: {text!r}."
            )
        if name in found:
            raise InvalidInput(f"--output gives the event {name!r} two outputs: give it one.")
        found[name] = int(number) if number.isdecimal() else number
    _refuse_same_files(_targets(formats, templates))
    return Exports(formats=tuple(formats), templates=tuple(templates), outputs=found or None)


def _refuse_same_files(targets: list[Target]) -> None:
    """Refuse two exports of which one would replace the other."""
    from armcontour.errors import InvalidInput

    taken: dict[str, str] = {}
    for x in targets:
        if taken.get(x.ending) == x.asked:
            raise InvalidInput(f"{x.asked} is there twice: give it once.")
        if x.ending in taken:
            raise InvalidInput(
                f"{taken[x.ending]} and {x.asked} would both be written to {TAUGHT}{x.ending}: "
                "leave one of them out, or give a template another ending, such as cell.txt.j2."
            )
        taken[x.ending] = x.asked


def rehearse(job: Job, x: Exports, scratch: FilePath) -> None:
    """Write a table of two points in every format that the user chose, and throw it away.

    Args:
        job: The job.
        x: The formats.
        scratch: A folder for the files.

    Raises:
        InvalidInput: What cannot be exported whatever the run will come to, or an output of an
            event that the job has not.
    """
    from armcontour.errors import InvalidInput
    from armcontour.io.exports import refuse_unknown_outputs, write_table

    events = _events_of(job)
    refuse_unknown_outputs(
        x.outputs or {}, (event.name for event in events), option="--output", owner="the job"
    )
    for period in dict.fromkeys(run.period for run in job.runs):
        table = _two_points(job, period, events)
        for target in _targets(x.formats, x.templates):
            place = scratch / f"rehearsal{target.ending}"
            try:
                write_table(table, place, **target.options(x))
            except OSError as error:
                raise InvalidInput(f"Cannot try {target.asked}: {error.strerror}.") from None


def _events_of(job: Job) -> list[Event]:
    """What a job switches, each name and value once."""
    from armcontour.program import Contour, Event

    found = list(job.process.events)
    if job.process.switch is not None:
        found += [Event(name=job.process.switch.name, value=x) for x in (True, False)]
    for move in job.program.moves:
        if isinstance(move, Event):
            found.append(move)
        elif isinstance(move, Contour):
            found += move.events
    return list({(x.name, type(x.value), x.value): x for x in found}.values())


def _two_points(job: Job, period: float, events: Sequence[Event]) -> Table:
    """The shortest table that a run of the job could come to."""
    import numpy as np

    from armcontour.io.exports.table import Table
    from armcontour.motion import TimedEvent

    still = np.zeros((2, job.arm.dof))
    tool = job.arm.forward(still)
    point = tuple(tool[0].tolist())
    return Table(
        name=_titled(job, REFERENCE),
        joint_names=job.arm.joint_names,
        period=period,
        t=np.array([0.0, period]),
        q=still,
        dq=still,
        ddq=still,
        events=tuple(
            TimedEvent(name=x.name, value=x.value, t=0.0, due=0.0, s=0.0, point=point)
            for x in events
        ),
        tool=tool,
    )


def _titled(job: Job, label: str) -> str:
    """What a table is called inside."""
    return f"{job.name} {label}"


def write_exports(folder: ResultFolder, job: Job, name: str, result: RunPlan, x: Exports) -> None:
    """Export taught data and reference of one run into the folder of results."""
    from armcontour.io.exports import make_table, write_table

    for label, data, period in (
        (TAUGHT, result.taught, None),
        (REFERENCE, result.trajectory, result.run.period),
    ):
        table = make_table(data, name=_titled(job, label), arm=job.arm, period=period)
        for target in _targets(x.formats, x.templates):
            write = partial(write_table, table, **target.options(x))
            folder.place(f"{name}/export/{label}{target.ending}", write)


def _targets(names: Sequence[str], templates: Sequence[str]) -> list[Target]:
    """What is to be written, in the order that it was asked for."""
    from armcontour.io.exports import formats

    endings = formats()
    found = [Target(kind=kind, ending=endings[kind]) for kind in names]
    return found + [Target(kind="template", ending=_ending(x), template=x) for x in templates]


def _ending(template: str) -> str:
    """The ending of what a template makes: of "kuka.src.j2" it is ".src"."""
    from armcontour.io.exports.template import SHIPPED

    file = SHIPPED.get(template, template)
    return FilePath(FilePath(file).name.removesuffix(".j2")).suffix or ".txt"
