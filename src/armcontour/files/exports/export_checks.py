"""Checks of the exports of a job before its motion is planned."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path as FilePath

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import error_context
from armcontour.files.exports.export_table import REFERENCE, SetPointTable, regular_times
from armcontour.files.exports.formats import (
    TemplateFormat,
    check_inputs,
    check_outputs,
    ending_of,
    format_named,
)
from armcontour.files.exports.template import BUILT_IN, template_keeps_times
from armcontour.jobs import Job, Run
from armcontour.motion import TimedEvent, TimedWait
from armcontour.program import Event, Process
from armcontour.program.moves import events_of

# Number of points in a trial; a KUKA spline needs two.
TRIAL_POINTS = 3


def check_exports(job: Job) -> None:
    """Check that every run of a job can be exported in its formats, before the job is planned.

    A short motion with the arm, the events and the levels of the job is written in each built-in
    format. Of a template of the user, only the syntax and `keeps_times` are checked, because it may
    refuse this motion.

    Raises:
        InvalidInput: A format does not support the arm, the cycle, an output, a wait or the value
            of an event; an output belongs to no event, or an input to no wait; an input has no
            name; or a template cannot be read.
    """
    for kind in job.export.formats:
        check_export(job, kind)


def check_export(job: Job, kind: str, *, stem: str = REFERENCE, cycle: float | None = None) -> None:
    """Check that the runs of a job can be exported in a format; see `check_exports`.

    Args:
        job: The job.
        kind: Name of the format, or path of a template.
        stem: Name of the file without its ending.
        cycle: Time between points [s]; by default that of the job's exports.

    Raises:
        InvalidInput: As `check_exports`.
    """
    names = {*job.process.analog_names, *(x.name for x in _events(job))}
    check_outputs(job.export.outputs, names, option="export.outputs", owner="the job")
    awaited = {x.input for x in job.process.waits}
    check_inputs(job.export.inputs, awaited, option="export.inputs", owner="the job")
    format = format_named(kind, job.export)
    if isinstance(format, TemplateFormat) and kind not in BUILT_IN:
        template_keeps_times(kind)
        return
    with tempfile.TemporaryDirectory() as folder, error_context(f"export {kind}"):
        for run in job.runs:
            usual = None if format.needs_cycle_of_run else job.export.cycle
            table = _trial_table(job, run, cycle or usual or run.cycle)
            format.check(table)
            format.write(table, FilePath(folder) / f"{stem}{ending_of(kind)}")


def _trial_table(job: Job, run: Run, cycle: float) -> SetPointTable:
    """Return the table of a robot at rest that has all events and levels of a job."""
    levels = dict(_analog_levels(job.process))
    waits = tuple(_timed_waits(job, cycle))
    count = max([TRIAL_POINTS, len(waits) + 1, *(len(x) + 1 for x in levels.values())])
    rest = np.zeros((count, job.arm.dof))
    rest.setflags(write=False)
    return SetPointTable(
        name=f"{job.name} {run.name} {REFERENCE}",
        joint_names=job.arm.joint_names,
        cycle=cycle,
        t=regular_times(count, cycle),
        q=rest,
        dq=rest,
        ddq=rest,
        events=tuple(_timed(job)),
        waits=waits,
        analog={name: np.resize(x, count) for name, x in levels.items()},
        prismatic=job.arm.chain.prismatic or (),
        external=job.arm.chain.external,
    )


def _analog_levels(process: Process) -> Iterator[tuple[str, FloatArray]]:
    """Yield each analog output of a process: its name and its levels."""
    for name in process.analog_names:
        levels = set[float]()
        for variant in process.variants:
            for output in variant.analog:
                if output.name == name:
                    levels |= {output.rest, output.full, output.off}
        yield name, np.array(sorted(levels))


def _timed(job: Job) -> Iterator[TimedEvent]:
    """Yield each event of a job once per value, at time 0."""
    # True equals 1, but is another value of an output.
    distinct = {(x.name, type(x.value), x.value) for x in _events(job)}
    for name, _, value in sorted(distinct, key=str):
        yield TimedEvent(name=name, value=value, t=0.0, due=0.0, s=0.0, point=(0.0, 0.0, 0.0))


def _timed_waits(job: Job, cycle: float) -> Iterator[TimedWait]:
    """Yield each wait of a job, at one point each."""
    for i, wait in enumerate(job.process.waits):
        yield TimedWait(
            input=wait.input, within=wait.within, at=wait.at, t=i * cycle, rest=wait.rest
        )


def _events(job: Job) -> Iterator[Event]:
    """Yield the events of a job's program, and those that its process adds, unless it is off."""
    if job.process.off:
        return
    yield from events_of(job.program.moves)
    for variant in job.process.variants:
        yield from variant.events
        if variant.switch is not None:
            yield Event(variant.switch.name, variant.switch.value)
            yield Event(variant.switch.name, False)
