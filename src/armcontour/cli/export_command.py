"""Files for robot controllers: exports of a run, and the command `export` for a stored result."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from armcontour import files
from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Export
from armcontour.cli.inputs import naming_options_in_errors, read_patch, refuse_existing
from armcontour.cli.job_options import EXPORTED_POINTS, EXPORTS
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.progress import Progress
from armcontour.core.render import figure
from armcontour.core.text import capitalise, count_noun
from armcontour.files.exports import formats, make_table, predict_tolerances
from armcontour.files.exports.export_checks import REFERENCE
from armcontour.files.exports.export_table import SetPointTable
from armcontour.files.exports.template import BUILT_IN
from armcontour.files.file_keys import read_keys
from armcontour.jobs import Job, RunResult, analog_outputs
from armcontour.jobs.job import Exports
from armcontour.motion import SetPoints, Trajectory
from armcontour.motion.trajectory import COMMAND_SLACK
from armcontour.robot.limit_use import use_of
from armcontour.verification.evaluation import duration_row

# Label of exported set-points; that of the exported plan is REFERENCE.
SET_POINTS = "set_points"
# Label of a file with all motions of a run.
MOTIONS = "motions"
# Ratio of an exported acceleration to its limit above which a warning is given.
MAX_ACCELERATION_RATIO = 3.0


@dataclass(frozen=True, slots=True)
class Written:
    """Sentences about written files, with warnings, and the errors of files that are missing."""

    lines: list[str] = field(default_factory=list)
    errors: list[InvalidInput] = field(default_factory=list)


def refuse_unused_export_options(job: Job, options: Mapping[str, object]) -> None:
    """Raise InvalidInput for options of exports that are specified without --export.

    `options`: values of the options that set job keys, by the name of their parameter.
    """
    if job.export.formats:
        return
    for option in (*EXPORTS.options, *EXPORTED_POINTS.options):
        if options.get(option.parameter) not in (None, []):
            raise InvalidInput(f"{option.name} requires --export.")


def write_exports(folder: files.ResultFolder, job: Job, name: str, result: RunResult) -> Written:
    """Export set-points and plan of a run; a file that fails does not stop the others.

    Args:
        folder: Folder of the result.
        job: The job, whose `export` has the formats and their options.
        name: Name of the run, which is the name of its folder.
        result: Result of the run.
    """
    written = Written()
    warnings = dict[str, None]()
    for kind in job.export.formats:
        motions: list[tuple[str, SetPoints | Trajectory]] = [(REFERENCE, result.trajectory)]
        if formats.format_named(kind).has_all_motions:
            motions = [(MOTIONS, result.set_points)]
        elif kind not in BUILT_IN:
            # KUKA and ABB plan the motion between points, so that set-points are no use.
            motions.append((SET_POINTS, result.set_points))
        for motion_label, motion in motions:
            file = f"{name}/export/{motion_label}{formats.ending_of(kind)}"
            label = f"export {kind}, run {name}"
            try:
                table, sentences = _write_export(
                    folder, file, job, result, kind, motion_label, motion
                )
            except InvalidInput as error:
                written.errors.append(error)
                warnings[f"Warning: {label}: {file} was not written. {error}"] = None
                continue
            warnings |= {f"Warning: {label}: {x}": None for x in sentences}
            written.lines.append(f"Exported {file}: {count_noun(len(table.t), 'point')}.")
    written.lines.extend(warnings)
    return written


def _write_export(
    folder: files.ResultFolder,
    file: str,
    job: Job,
    result: RunResult,
    kind: str,
    motion_label: str,
    motion: SetPoints | Trajectory,
) -> tuple[SetPointTable, list[str]]:
    """Write a motion in a format; return its table, and warnings without label.

    - `file`: name of the file, relative to the result folder.
    - `kind`: name of the format, or path of a template.
    - `motion_label`: REFERENCE for the plan, SET_POINTS, or MOTIONS.
    """
    options = job.export
    format = formats.format_named(kind, options)
    format = format.with_motions(result.trajectory, job.arm, result.execution)
    cycle = None
    if motion_label == REFERENCE:
        requested = None if format.needs_cycle_of_run else options.cycle
        cycle = requested or result.run.cycle
    table = make_table(
        motion,
        name=f"{job.name} {result.run.name} {motion_label}",
        cycle=cycle,
        arm=job.arm,
        derivatives=options.derivatives,
        analog=analog_outputs(result.path, result.trajectory, job.process, result.run.limits),
    )
    format.check(table)
    sentences = list[str]()
    if isinstance(format, formats.RosYamlFormat):
        sentences += _acceleration_warnings(table, result)
        if motion_label == SET_POINTS and options.tolerances and result.execution is not None:
            tolerances = predict_tolerances(result.execution, options.tolerances)
            format = dataclasses.replace(format, tolerances=tolerances)
    table = format.select(table)
    folder.write_with(file, partial(format.write, table))
    return table, [*sentences, *format.describe(table)]


def export(options: Export, _: None, progress: Progress) -> Outcome:
    """Export the set-points of an earlier result for a robot controller."""
    file = options.file
    kind = options.format or formats.format_of(file)
    # Imported here, because `run` uses this module and reads no trajectory.
    from armcontour.files.trajectory_file import read_run

    run = read_run(options.result, options.run_name)
    patch, names = read_patch(options)
    signals = {"outputs": dict(run.outputs), "inputs": dict(run.inputs)}
    data = signals | {str(keys[-1]): x for keys, x in patch.items()}
    with naming_options_in_errors(names), error_context("export"):
        chosen = read_keys(Exports, {"formats": [kind], **data})
    format = formats.format_named(kind, chosen)
    if chosen.cycle is not None:
        raise InvalidInput("--cycle applies to run, because set-points have a fixed cycle.")
    table = run.set_points(derivatives=chosen.derivatives)
    known = {*formats.names_of(table), *run.analog}
    formats.check_outputs(
        formats.outputs_of(format), known, option="outputs", owner=f"the run {run.name}"
    )
    formats.check_inputs(
        formats.inputs_of(format),
        formats.table_inputs(table),
        option="inputs",
        owner=f"the run {run.name}",
    )
    format.check(table)
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
    """Warn if exported accelerations exceed command limits, or by far the joint limits."""
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
