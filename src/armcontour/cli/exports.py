"""Export of set-points and plans of a run or of a stored result."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated

import typer

from armcontour.cli.console import print_lines
from armcontour.cli.inputs import name_options, read_patch
from armcontour.cli.options import StoredExportOptions
from armcontour.cli.program import ROBOT, command
from armcontour.core.file_access import MEGABYTE
from armcontour.core.text import count_noun, digits

if TYPE_CHECKING:
    from armcontour.files import ResultFolder
    from armcontour.files.exports.formats import ExportFormat
    from armcontour.files.exports.table import SetPointTable
    from armcontour.jobs import Job, RunResult
    from armcontour.program import Event

# Labels of exported set-points, and of the exported plan (without compensation).
SET_POINTS, REFERENCE = "set_points", "reference"
# Ratio of an exported acceleration to its limit above which a warning is given.
MAX_ACCELERATION_RATIO = 3.0


def refuse_unused(options: Mapping[str, object], job: Job) -> None:
    """Raise InvalidInput if an option of exports is given, but the job exports nothing."""
    from armcontour.core.errors import InvalidInput

    for name, value in options.items():
        if value not in (None, []) and not job.export.formats:
            raise InvalidInput(f"--{name.replace('_', '-')} requires --export.")


def refuse_outputs(job: Job) -> None:
    """Raise InvalidInput if the outputs of exports name an unknown event or analog output."""
    from armcontour.files.exports.formats import check_outputs

    names = {*(event.name for event in _events_of(job)), *job.process.analog_names}
    check_outputs(job.export.outputs, names, option="export.outputs", owner="the job")
    # Templates are read, so that errors in them are found before the run.
    _formats(job)


def _formats(job: Job) -> list[tuple[str, ExportFormat]]:
    """Formats of a job, each with its label for messages."""
    from armcontour.files.exports.formats import format_named

    return [(f"export {x}", format_named(x, job.export)) for x in job.export.formats]


def _cycle(format: ExportFormat, job: Job, own: float) -> float:
    """Time between points of the plan in a file [s]; `own` is the cycle of the run."""
    return own if format.kind == "urscript" or job.export.cycle is None else job.export.cycle


def _supported(format: ExportFormat, table: SetPointTable) -> SetPointTable:
    """The table, without analog outputs if the format does not support them."""
    from armcontour.files.exports.formats import WITH_ANALOG

    return table if isinstance(format, WITH_ANALOG) else dataclasses.replace(table, analog={})


def _events_of(job: Job) -> list[Event]:
    """Events of a job; each combination of name and value occurs once."""
    from armcontour.program import Contour, Event

    events: list[Event] = []
    for variant in job.process.variants:
        events += variant.events
        if variant.switch is not None:
            events += [
                Event(name=variant.switch.name, value=x) for x in (variant.switch.value, False)
            ]
    for move in job.program.moves:
        if isinstance(move, Event):
            events.append(move)
        elif isinstance(move, Contour):
            events += move.events
    return list({(x.name, type(x.value), x.value): x for x in events}.values())


def write_exports(folder: ResultFolder, job: Job, name: str, result: RunResult) -> list[str]:
    """Export set-points and plan of a run; returns sentences about the files, and warnings."""
    from armcontour.core.errors import error_context
    from armcontour.files.exports import make_table
    from armcontour.files.exports.formats import RosYamlFormat
    from armcontour.files.exports.ros import predict_tolerances
    from armcontour.files.exports.template import BUILT_IN
    from armcontour.jobs import analog_outputs
    from armcontour.jobs.exports import ending_of

    analog = analog_outputs(result.path, result.trajectory, job.process, result.run.limits)
    written, warnings = list[str](), list[str]()
    for (label, format), kind in zip(_formats(job), job.export.formats, strict=True):
        # KUKA and ABB plan the motion between points, so that set-points are no use.
        used = [REFERENCE] if format.label in BUILT_IN else [REFERENCE, SET_POINTS]
        sentences = dict[str, None]()
        for what in used:
            table = make_table(
                result.set_points if what == SET_POINTS else result.trajectory,
                name=f"{job.name} {what}",
                cycle=None if what == SET_POINTS else _cycle(format, job, result.run.cycle),
                joint_names=job.arm.joint_names,
                derivatives=job.export.derivatives,
                analog=analog,
            )
            final = format
            if isinstance(format, RosYamlFormat):
                if table.ddq is not None:
                    sentences |= dict.fromkeys(_describe_jumps(table, result))
                with error_context(label):
                    table = format.select(table)
                factor, executed = job.export.tolerances, result.execution
                if what == SET_POINTS and factor is not None and executed is not None:
                    tolerances = predict_tolerances(executed, factor)
                    final = dataclasses.replace(format, tolerances=tolerances)
            supported = _supported(format, table)
            if len(supported.analog) < len(table.analog):
                sentences[f"the format does not support analog outputs ({', '.join(analog)})."] = (
                    None
                )
            sentences |= dict.fromkeys(format.describe(supported))
            file = f"{name}/export/{what}{ending_of(kind)}"
            sizes: list[int] = []

            def write(
                path: FilePath,
                final: ExportFormat = final,
                table: SetPointTable = supported,
                sizes: list[int] = sizes,
            ) -> None:
                final.write(table, path)
                sizes.append(path.stat().st_size)

            with error_context(label):
                folder.place(file, write)
            written.append(f"Exported {file}: {_size(table, sizes[0])}.")
        warnings += [f"Warning: {label}, run {name}: {x}" for x in sentences]
    return [*written, *warnings]


def _size(table: SetPointTable, size: int) -> str:
    """Text with the number of points and the size of a file."""
    return f"{count_noun(len(table.t), 'point')}, {digits(max(size / MEGABYTE, 1e-3), 2)} MB"


def _describe_jumps(table: SetPointTable, result: RunResult) -> Sequence[str]:
    """Warning if exported accelerations exceed command limits, or by far the joint limits."""
    import numpy as np

    from armcontour.motion.trajectory import COMMAND_SLACK
    from armcontour.robot.limit_use import use_of

    commands = table.command_limits
    limits = result.run.limits if commands is None else commands
    if table.ddq is None or limits.joint_acceleration is None:
        return []
    ratio = use_of("joint_acceleration", limits, table.ddq).largest
    joint = int(np.argmax(ratio))
    if ratio[joint] < (MAX_ACCELERATION_RATIO if commands is None else 1 + COMMAND_SLACK):
        return []
    remedy = "Set command_limits.joint_acceleration to limit the set-points."
    if commands is not None:
        remedy = "Without derivatives, files have only positions, which satisfy command_limits."
    return [
        "a controller that follows the exported accelerations requires up to "
        f"{ratio[joint]:.3g} times the acceleration limit of {table.joint_names[joint]}. {remedy}"
    ]


@command(ROBOT, "export gasket gasket.script")
def export(
    result: Annotated[
        FilePath, typer.Argument(help="Folder of a result, of `run`, `certify` or `learn`.")
    ],
    file: Annotated[
        FilePath, typer.Argument(help="File to write; its extension determines the format.")
    ],
    options: StoredExportOptions,
) -> None:
    """Export the set-points or the plan of an earlier result for a robot controller."""
    from armcontour.core.errors import InvalidInput, error_context
    from armcontour.core.render import figure
    from armcontour.core.text import capitalise
    from armcontour.files.exports.formats import (
        RosYamlFormat,
        check_outputs,
        format_named,
        format_of,
        names_of,
        outputs_of,
        write_destination,
    )
    from armcontour.files.keys import read_keys
    from armcontour.files.trajectory_file import read_run
    from armcontour.jobs.exports import Exports
    from armcontour.verification.evaluation import duration_row

    kind = options.format or format_of(file)
    run = read_run(result, options.run_name)
    patch, names = read_patch(options)
    with name_options(names):
        data = {str(keys[-1]): value for keys, value in patch.items()}
        data = {"formats": [kind], "outputs": dict(run.outputs), **data}
        with error_context("export"):
            chosen: Exports = read_keys(Exports, data)
    format = format_named(kind, chosen)
    if chosen.cycle is not None and not options.reference:
        raise InvalidInput("--cycle requires --reference, because set-points have a fixed cycle.")
    table = (
        run.reference(chosen.cycle, derivatives=chosen.derivatives)
        if options.reference
        else run.set_points(derivatives=chosen.derivatives)
    )
    check_outputs(
        outputs_of(format),
        {*names_of(table), *run.analog},
        option="outputs",
        owner=f"the run {run.name}",
    )
    if isinstance(format, RosYamlFormat):
        table = format.select(table)
    if not options.force and file.exists():
        raise InvalidInput(
            f"{file} already exists. Choose another name, or add --force to replace it."
        )
    write_destination(file, lambda path: format.write(table, path))
    print_lines(*(f"Warning: {capitalise(x)}" for x in format.describe(table)))
    label = REFERENCE if options.reference else SET_POINTS
    if run.analog:
        print_lines(
            f"The analog outputs {', '.join(run.analog)} are not exported, because a stored result "
            "does not contain their values. Export them with armcontour run."
        )
    motion = figure(duration_row(table.duration))
    size = _size(table, file.stat().st_size)
    print_lines(f"Exported {label} of run {run.name}: {size}, {motion}: {file}")
