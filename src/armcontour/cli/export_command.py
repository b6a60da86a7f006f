"""Files for robot controllers: exports of a run, and the command `export` for a stored result."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import partial

import numpy as np

from armcontour import files
from armcontour.cli.commands import Export
from armcontour.cli.execution import Outcome
from armcontour.cli.inputs import name_options, option_of, read_patch
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.progress import Progress
from armcontour.core.render import figure
from armcontour.core.text import capitalise, count_noun
from armcontour.files.exports import RosYamlFormat, URScriptFormat, make_table, predict_tolerances
from armcontour.files.exports.formats import (
    ExportFormat,
    check_outputs,
    format_named,
    format_of,
    names_of,
    outputs_of,
    write_destination,
)
from armcontour.files.exports.table import SetPointTable
from armcontour.files.exports.template import BUILT_IN
from armcontour.files.keys import read_keys
from armcontour.files.trajectory_file import read_run
from armcontour.jobs import Job, RunResult, analog_outputs
from armcontour.jobs.exports import Exports, ending_of
from armcontour.motion import SetPoints, Trajectory
from armcontour.motion.trajectory import COMMAND_SLACK
from armcontour.program import Contour, Event
from armcontour.robot.limit_use import use_of
from armcontour.verification.evaluation import duration_row

# Labels of exported set-points, and of the exported plan (without compensation).
SET_POINTS, REFERENCE = "set_points", "reference"
# Ratio of an exported acceleration to its limit above which a warning is given.
MAX_ACCELERATION_RATIO = 3.0


def check_exports(job: Job, options: Mapping[str, object]) -> None:
    """Raise InvalidInput for options without --export, unknown outputs, and invalid templates.

    `options` are the options that set job keys, by name.
    """
    formats = [format_named(x, job.export) for x in job.export.formats]
    if not formats:
        exports = {x.name for x in dataclasses.fields(Exports)}
        for name in (x for x, value in options.items() if x in exports and value is not None):
            raise InvalidInput(f"{option_of(name)} requires --export.")
        return
    names = {*job.process.analog_names}
    for variant in job.process.variants:
        names |= {x.name for x in variant.events}
        names |= {variant.switch.name} if variant.switch is not None else set()
    for move in job.program.moves:
        names |= {move.name} if isinstance(move, Event) else set()
        names |= {x.name for x in move.events} if isinstance(move, Contour) else set()
    check_outputs(job.export.outputs, names, option="export.outputs", owner="the job")


def write_exports(folder: files.ResultFolder, job: Job, name: str, result: RunResult) -> list[str]:
    """Export set-points and plan of a run; returns sentences about the files, and warnings."""
    analog = analog_outputs(result.path, result.trajectory, job.process, result.run.limits)
    written, warnings, options = list[str](), dict[str, None](), job.export
    for kind in options.formats:
        format, label = format_named(kind, options), f"export {kind}"
        # A URScript program needs the cycle of the run.
        cycle = None if isinstance(format, URScriptFormat) else options.cycle
        motions: dict[str, tuple[SetPoints | Trajectory, float | None]] = {
            REFERENCE: (result.trajectory, cycle or result.run.cycle)
        }
        # KUKA and ABB plan the motion between points, so that set-points are no use.
        motions |= {} if kind in BUILT_IN else {SET_POINTS: (result.set_points, None)}
        for what, (motion, step) in motions.items():
            table = make_table(
                motion,
                name=f"{job.name} {what}",
                cycle=step,
                joint_names=job.arm.joint_names,
                derivatives=options.derivatives,
                analog=analog,
            )
            sentences = list[str]()
            if isinstance(format, RosYamlFormat):
                sentences += _acceleration_warnings(table, result)
                if step is None and options.tolerances and result.execution is not None:
                    tolerances = predict_tolerances(result.execution, options.tolerances)
                    format = dataclasses.replace(format, tolerances=tolerances)
            file = f"{name}/export/{what}{ending_of(kind)}"
            with error_context(label):
                table = _written_points(format, table)
                folder.place(file, partial(format.write, table))
            sentences += format.describe(table)
            warnings |= {f"Warning: {label}, run {name}: {x}": None for x in sentences}
            written.append(f"Exported {file}: {count_noun(len(table.t), 'point')}.")
    return [*written, *warnings]


def export(options: Export, _: None, progress: Progress) -> Outcome:
    """Export the set-points or the plan of an earlier result for a robot controller."""
    file, reference = options.file, options.reference
    kind = options.format or format_of(file)
    run = read_run(options.result, options.run_name)
    patch, names = read_patch(options)
    data = {"outputs": dict(run.outputs)} | {str(keys[-1]): x for keys, x in patch.items()}
    with name_options(names), error_context("export"):
        chosen = read_keys(Exports, {"formats": [kind], **data})
    format = format_named(kind, chosen)
    if chosen.cycle is not None and not reference:
        raise InvalidInput("--cycle requires --reference, because set-points have a fixed cycle.")
    table = (
        run.reference(chosen.cycle, derivatives=chosen.derivatives)
        if reference
        else run.set_points(derivatives=chosen.derivatives)
    )
    known = {*names_of(table), *run.analog}
    check_outputs(outputs_of(format), known, option="outputs", owner=f"the run {run.name}")
    table = _written_points(format, table)
    if not options.force and file.exists():
        raise InvalidInput(
            f"{file} already exists. Choose another name, or add --force to replace it."
        )
    write_destination(file, partial(format.write, table))
    lines = [f"Warning: {capitalise(x)}" for x in format.describe(table)]
    if run.analog:
        lines.append(
            f"The analog outputs {', '.join(run.analog)} are not exported, because a stored result "
            "does not contain their values. Export them with armcontour run."
        )
    what, size = REFERENCE if reference else SET_POINTS, count_noun(len(table.t), "point")
    motion = figure(duration_row(table.duration))
    return Outcome(lines=[*lines, f"Exported {what} of run {run.name}: {size}, {motion}: {file}"])


def _written_points(format: ExportFormat, table: SetPointTable) -> SetPointTable:
    """Table of the points that a format writes: all, or fewer within a tolerance."""
    return format.select(table) if isinstance(format, RosYamlFormat) else table


def _acceleration_warnings(table: SetPointTable, result: RunResult) -> list[str]:
    """Warning if exported accelerations exceed command limits, or by far the joint limits."""
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
