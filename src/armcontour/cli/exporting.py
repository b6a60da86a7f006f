"""Export taught data and reference trajectories of runs in the formats of the command line."""

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

# Labels of the set-points for the robot, and of the plan without compensation.
TAUGHT, REFERENCE = "taught", "reference"


@dataclass(frozen=True, slots=True, kw_only=True)
class Exports:
    """Formats in which every run is exported.

    Args:
        formats: Names of formats.
        templates: Names or files of templates.
        outputs: Digital outputs, by names of events.
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
        kind: Name of the format.
        ending: Ending of the file name.
        template: Name or file of the template, for the format "template".
    """

    kind: str
    ending: str
    template: str | None = None

    @property
    def option(self) -> str:
        """The option of the command line for this file, for messages."""
        if self.template is None:
            return f"--export {self.kind}"
        return f"--template {self.template}"

    def options(self, x: Exports) -> dict[str, Any]:
        """Keyword arguments of `write_table`."""
        takes = self.kind in ("urscript", "template")
        return {
            "format": self.kind,
            "template": self.template,
            "outputs": x.outputs if takes else None,
        }


def exports_of(x: ExportOptions) -> Exports:
    """Read the export options of a command line.

    Args:
        x: The options as text.

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
    """Refuse two exports that would be written to the same file."""
    from armcontour.errors import InvalidInput

    taken: dict[str, str] = {}
    for x in targets:
        if taken.get(x.ending) == x.option:
            raise InvalidInput(f"{x.option} is there twice: give it once.")
        if x.ending in taken:
            raise InvalidInput(
                f"{taken[x.ending]} and {x.option} would both be written to {TAUGHT}{x.ending}: "
                "leave one of them out, or give a template another ending, such as cell.txt.j2."
            )
        taken[x.ending] = x.option


def rehearse(job: Job, x: Exports, scratch: FilePath) -> None:
    """Write a table of two points in every chosen format, to find errors before the run.

    Args:
        job: The job.
        x: The formats.
        scratch: A folder for the files.

    Raises:
        InvalidInput: A format that cannot be written, or an output for an event that the job
            does not have.
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
                raise InvalidInput(f"Cannot try {target.option}: {error.strerror}.") from None


def _events_of(job: Job) -> list[Event]:
    """All events of a job, each name and value once."""
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
    """A table of two points with the joints and events of a job."""
    import numpy as np

    from armcontour.io.exports.table import Table
    from armcontour.motion import TimedEvent

    zeros = np.zeros((2, job.arm.dof))
    tool = job.arm.forward(zeros)
    point = tuple(tool[0].tolist())
    return Table(
        name=_title(job, REFERENCE),
        joint_names=job.arm.joint_names,
        period=period,
        t=np.array([0.0, period]),
        q=zeros,
        dq=zeros,
        ddq=zeros,
        events=tuple(
            TimedEvent(name=x.name, value=x.value, t=0.0, due=0.0, s=0.0, point=point)
            for x in events
        ),
        tool=tool,
    )


def _title(job: Job, label: str) -> str:
    """The title of a table inside its file."""
    return f"{job.name} {label}"


def write_exports(folder: ResultFolder, job: Job, name: str, result: RunPlan, x: Exports) -> None:
    """Export taught data and reference of one run to the result folder."""
    from armcontour.io.exports import make_table, write_table

    for label, data, period in (
        (TAUGHT, result.taught, None),
        (REFERENCE, result.trajectory, result.run.period),
    ):
        table = make_table(data, name=_title(job, label), arm=job.arm, period=period)
        for target in _targets(x.formats, x.templates):
            write = partial(write_table, table, **target.options(x))
            folder.place(f"{name}/export/{label}{target.ending}", write)


def _targets(names: Sequence[str], templates: Sequence[str]) -> list[Target]:
    """The files to write, in the order of the options."""
    from armcontour.io.exports import formats

    endings = formats()
    found = [Target(kind=kind, ending=endings[kind]) for kind in names]
    return found + [Target(kind="template", ending=_ending(x), template=x) for x in templates]


def _ending(template: str) -> str:
    """The ending of the file that a template makes, such as ".src" for "kuka.src.j2"."""
    from armcontour.io.exports.template import SHIPPED

    file = SHIPPED.get(template, template)
    return FilePath(FilePath(file).name.removesuffix(".j2")).suffix or ".txt"
