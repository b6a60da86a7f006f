"""Files for robot controllers: exports of a run, and the command `export` for a stored result."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import partial

import numpy as np

from armcontour import files
from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Export
from armcontour.cli.inputs import name_options, option_of, read_patch, refuse_existing
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.progress import Progress
from armcontour.core.render import figure
from armcontour.core.text import capitalise, count_noun
from armcontour.files.exports import formats, make_table, predict_tolerances
from armcontour.files.exports.export_table import SetPointTable
from armcontour.files.exports.template import BUILT_IN
from armcontour.files.file_keys import read_keys
from armcontour.jobs import Job, RunResult, analog_outputs
from armcontour.jobs.job import Exports, ending_of
from armcontour.motion import SetPoints, Trajectory
from armcontour.motion.trajectory import COMMAND_SLACK
from armcontour.program.moves import events_of
from armcontour.robot.limit_use import use_of
from armcontour.verification.evaluation import duration_row

# Label of exported set-points.
SET_POINTS = "set_points"
# Label of the exported plan, which has no compensation.
REFERENCE = "reference"
# Ratio of an exported acceleration to its limit above which a warning is given.
MAX_ACCELERATION_RATIO = 3.0


def check_exports(job: Job, options: Mapping[str, object]) -> None:
    """Raise InvalidInput for options without --export, unknown outputs, and invalid templates.

    `options` are the options that set job keys, by name.
    """
    for name in job.export.formats:
        # Templates are read, so that errors in them are found before the run.
        formats.format_named(name, job.export)
    if not job.export.formats:
        exports = {x.name for x in dataclasses.fields(Exports)}
        for name, value in options.items():
            if name in exports and value is not None:
                raise InvalidInput(f"{option_of(name)} requires --export.")
        return
    names = {*job.process.analog_names}
    names |= {x.name for x in events_of(job.program.moves)}
    for variant in job.process.variants:
        switches = () if variant.switch is None else (variant.switch,)
        names |= {x.name for x in (*variant.events, *switches)}
    formats.check_outputs(job.export.outputs, names, option="export.outputs", owner="the job")


def write_exports(folder: files.ResultFolder, job: Job, name: str, result: RunResult) -> list[str]:
    """Export set-points and plan of a run; returns sentences about the files, and warnings."""
    analog = analog_outputs(result.path, result.trajectory, job.process, result.run.limits)
    written = list[str]()
    warnings = dict[str, None]()
    options = job.export
    for kind in options.formats:
        format = formats.format_named(kind, options)
        label = f"export {kind}"
        # A URScript program needs the cycle of the run.
        cycle = None if isinstance(format, formats.URScriptFormat) else options.cycle
        motions: dict[str, tuple[SetPoints | Trajectory, float | None]] = {
            REFERENCE: (result.trajectory, cycle or result.run.cycle)
        }
        # KUKA and ABB plan the motion between points, so that set-points are no use.
        motions |= {} if kind in BUILT_IN else {SET_POINTS: (result.set_points, None)}
        for what, (motion, step) in motions.items():
            table = make_table(
                motion,
                name=f"{job.name} {name} {what}",
                cycle=step,
                arm=job.arm,
                derivatives=options.derivatives,
                analog=analog,
            )
            sentences = list[str]()
            if isinstance(format, formats.RosYamlFormat):
                sentences += _acceleration_warnings(table, result)
                if step is None and options.tolerances and result.execution is not None:
                    tolerances = predict_tolerances(result.execution, options.tolerances)
                    format = dataclasses.replace(format, tolerances=tolerances)
            file = f"{name}/export/{what}{ending_of(kind)}"
            with error_context(label):
                table = format.select(table)
                folder.write_with(file, partial(format.write, table))
            sentences += format.describe(table)
            warnings |= {f"Warning: {label}, run {name}: {x}": None for x in sentences}
            written.append(f"Exported {file}: {count_noun(len(table.t), 'point')}.")
    return [*written, *warnings]


def export(options: Export, _: None, progress: Progress) -> Outcome:
    """Export the set-points of an earlier result for a robot controller."""
    file = options.file
    kind = options.format or formats.format_of(file)
    # Imported here, because `run` uses this module and reads no trajectory.
    from armcontour.files.trajectory_file import read_run

    run = read_run(options.result, options.run_name)
    patch, names = read_patch(options)
    data = {"outputs": dict(run.outputs)} | {str(keys[-1]): x for keys, x in patch.items()}
    with name_options(names), error_context("export"):
        chosen = read_keys(Exports, {"formats": [kind], **data})
    format = formats.format_named(kind, chosen)
    if chosen.cycle is not None:
        raise InvalidInput("--cycle applies to run, because set-points have a fixed cycle.")
    table = run.set_points(derivatives=chosen.derivatives)
    known = {*formats.names_of(table), *run.analog}
    formats.check_outputs(
        formats.outputs_of(format), known, option="outputs", owner=f"the run {run.name}"
    )
    table = format.select(table)
    refuse_existing(file, options.force)
    formats.write_destination(file, partial(format.write, table))
    lines = [f"Warning: {capitalise(x)}" for x in format.describe(table)]
    if run.analog:
        lines.append(
            f"The analog outputs {', '.join(run.analog)} are not exported, because a stored result "
            "does not contain their values. Export them with armcontour run."
        )
    size = count_noun(len(table.t), "point")
    motion = figure(duration_row(table.duration))
    line = f"Exported {SET_POINTS} of run {run.name}: {size}, {motion}: {file}"
    return Outcome(lines=[*lines, line])


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
    return [
        "a controller that follows the exported accelerations requires up to "
        f"{ratio[joint]:.3g} times the acceleration limit of {table.joint_names[joint]}. Set "
        "command_limits.joint_acceleration, and export without derivatives."
    ]
