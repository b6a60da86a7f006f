"""Files for robot controllers: exports of a run, and the command `export` for a stored result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from armcontour import files
from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Export
from armcontour.cli.inputs import naming_options_in_errors, read_patch, refuse_existing
from armcontour.cli.job_options import EXPORTED_POINTS, EXPORTS
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.progress import Progress
from armcontour.core.render import figure, number
from armcontour.core.text import capitalise, count_noun
from armcontour.files.exports import formats
from armcontour.files.exports.exporting import SET_POINTS, Exporter
from armcontour.files.file_keys import read_keys
from armcontour.jobs import Job, RunResult
from armcontour.jobs.job import Exports
from armcontour.verification.evaluation import duration_row


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
        exporter = Exporter(formats.format_named(kind, job.export))
        for motion_label, motion in exporter.motions(result):
            file = f"{name}/export/{motion_label}{formats.ending_of(kind)}"
            label = f"export {kind}, run {name}"
            try:
                prepared = exporter.prepare_run(job, result, motion_label, motion)
                folder.write_with(file, prepared.write_directly)
            except InvalidInput as error:
                written.errors.append(error)
                warnings[f"Warning: {label}: {file} was not written. {error}"] = None
                continue
            warnings |= {f"Warning: {label}: {x}": None for x in prepared.warnings}
            written.lines.append(f"Exported {file}: {count_noun(len(prepared.table.t), 'point')}.")
    written.lines.extend(warnings)
    return written


def export(options: Export, _: None, progress: Progress) -> Outcome:
    """Export the set-points of an earlier result for a robot controller."""
    file = options.file
    kind = options.format or formats.format_of(file)
    # Imported here, because `run` uses this module and reads no trajectory.
    from armcontour.files.trajectory_file import read_run

    run = read_run(options.result, options.run_name)
    patch, names = read_patch(options)
    of_job = {"outputs": run.outputs, "inputs": run.inputs, "servoj": run.servoj}
    data = of_job | {str(keys[-1]): x for keys, x in patch.items()}
    with naming_options_in_errors(names), error_context("export"):
        chosen = read_keys(Exports, {"formats": [kind], **data})
    format = formats.format_named(kind, chosen)
    if chosen.cycle is not None:
        raise InvalidInput("--cycle applies to run, because set-points have a fixed cycle.")
    stored = run.set_points if format.keeps_times else run.plan
    table = stored(derivatives=chosen.derivatives)
    prepared = Exporter(format).prepare_table(table, f"the run {run.name}", run.analog)
    table = prepared.table
    refuse_existing(file, options.force)
    prepared.write(file)
    lines = [f"Warning: {capitalise(x)}" for x in prepared.warnings]
    if not format.keeps_times:
        lines.append(
            f"Warning: The points are every {number(run.cycle, 's')}. How far the controller may "
            "leave the path between them is not judged, because a stored result does not contain "
            f"the arm. armcontour run JOB --export {kind} judges it, and chooses the interval."
        )
    if run.analog:
        lines.append(
            f"The analog outputs {', '.join(run.analog)} are not exported, because a stored result "
            "does not contain their values. Export them with armcontour run."
        )
    size = count_noun(len(table.t), "point")
    motion = figure(duration_row(table.duration))
    motion_label = SET_POINTS if format.keeps_times else "the plan"
    line = f"Exported {motion_label} of run {run.name}: {size}, {motion}: {file}"
    return Outcome(lines=[*lines, line])
