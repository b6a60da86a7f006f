"""The commands `run` and `demo`: run jobs, and write and print the results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from armcontour import files, jobs, report
from armcontour.cli.command_execution import REPORT, SUMMARY, Outcome
from armcontour.cli.commands import Demo, Run
from armcontour.cli.console import table_lines
from armcontour.cli.export_command import refuse_unused_export_options, write_exports
from armcontour.cli.inputs import library_file, open_job
from armcontour.core.compilation import compile_for_run
from armcontour.core.progress import Progress, Step
from armcontour.core.render import cells, compare, lay_out, plain, text, verdict
from armcontour.core.result import VERDICT
from armcontour.files.exports.export_checks import check_exports
from armcontour.jobs.advice import with_advice
from armcontour.jobs.run_notes import unknown_notes

WRITING = Step(("writing the results",))
# Runs that the demo compares, by their names in the paper's job.
COMPARED = ("conventional", "proposed", "shaped")


def run(options: Run, folder: files.ResultFolder, progress: Progress) -> Outcome:
    """Run a job; the exit code is 1 if no run is kept."""
    job = open_job(options.job, options, progress)
    simulate = options.simulate
    # Exports are tested before the run, so that invalid options are rejected at once.
    refuse_unused_export_options(job, options.keys)
    check_exports(job)
    with compile_for_run(job.arm.dimension, progress):
        job_result = jobs.run(job, simulate=simulate, progress=progress)
        if simulate and options.changes is not False:
            job_result = with_advice(job_result, progress, complete=options.changes is True)
        progress(WRITING)
        if simulate or not job.export.formats:
            # Without simulation, the exports are written instead of the usual files.
            write_motions(folder, job, job_result.runs)
        written = []
        notes = []
        for name, result in job_result.runs.items():
            exported = write_exports(folder, job, name, result)
            written.append(exported)
            notes += exported.lines
        if simulate:
            folder.write(REPORT, report.render_report(job_result))
        else:
            notes.append(f"The run was not simulated. Set-points: {options.out.resolve()}")
    # Runs that are not kept may be there for comparison with a run that is kept.
    verdicts = {x.kept for x in job_result.runs.values()}
    code = int(False in verdicts and True not in verdicts)
    for exported in written:
        code = max([code, *(error.exit_code for error in exported.errors)])
    return Outcome(
        lines=[*_result_lines(job_result), *notes], page=plain(job_result.to_data()), code=code
    )


def demo(options: Demo, folder: files.ResultFolder, progress: Progress) -> Outcome:
    """Run two built-in jobs: the paper's job, and in a subfolder a plate."""
    paper = built_in_job()
    compared = tuple(replace(x, experiment=None) for x in paper.runs if x.name in COMPARED)
    plate = files.read_job(library_file("plate.yaml"))
    with compile_for_run(None, progress):
        job_results = {
            prefix: jobs.run(job, progress=progress)
            for prefix, job in {"": replace(paper, runs=compared), "plate/": plate}.items()
        }
        progress(WRITING)
        for prefix, job_result in job_results.items():
            files_before = len(folder.files)
            write_motions(folder, job_result.job, job_result.runs, prefix=prefix)
            written = [x.removeprefix(prefix) for x in folder.files[files_before:]]
            page = plain(job_result.to_data()) | {"files": [*written, SUMMARY]}
            folder.write(f"{prefix}{SUMMARY}", files.to_json(page))
        folder.write(REPORT, report.render_demo(list(job_results.values())))
    lines: list[str] = []
    for job_result in job_results.values():
        lines += _result_lines(job_result)
    return Outcome(lines=lines)


def built_in_job() -> jobs.Job:
    """Load the paper's job, which is part of the package."""
    return files.parse_job(library_file("paper.yaml").read_text("utf-8"), source="the built-in job")


def write_motions(
    folder: files.ResultFolder,
    job: jobs.Job,
    plans: Mapping[str, jobs.RunResult],
    *,
    prefix: str = "",
) -> None:
    """Write set-points, plan and torques of every run as CSV."""
    joints = job.arm.joint_names
    for name, result in plans.items():
        # The plan is sampled once for both files, because evaluating thousands of laws is slow.
        planned = result.trajectory.sample(result.run.cycle)
        set_points = partial(
            files.write_set_points, set_points=result.set_points, joint_names=joints
        )
        folder.write_with(f"{prefix}{name}/set_points.csv", set_points)
        plan = partial(
            files.write_planned,
            samples=planned,
            joint_names=joints,
            prismatic=job.arm.chain.prismatic,
        )
        folder.write_with(f"{prefix}{name}/planned.csv", plan)
        if job.arm.has_bodies:
            torque = partial(files.write_torque, samples=planned, arm=job.arm)
            folder.write_with(f"{prefix}{name}/torque.csv", torque)


def _result_lines(job_result: jobs.JobResult) -> Sequence[str]:
    """Return lines with verdict, values, remarks and warnings of each run."""
    job = job_result.job
    runs = job_result.figures
    servo = job.plant_servo.describe_with_source(job.arm.chain.prismatic)
    title = f"{job.title}, simulated with {servo}" if job_result.simulated else job.title
    if len(runs) == 1:
        lines = [title, *text(next(iter(runs.values()))).splitlines()]
    else:
        lines = table_lines(compare(runs), title)
        for data in runs.values():
            lines.append(verdict(data))
            for table in (x for x in data.tables if x.level == VERDICT):
                lines += lay_out("", cells(table)).splitlines()[1:]
    for result in job_result.runs.values():
        lines += result.remarks
    lines += [f"Warning: {x}" for x in jobs.warnings_of(job_result.runs.values())]
    lines += [f"Note: {x}" for x in job.arm.notes]
    has_experiment = any(x.run.experiment is not None for x in job_result.runs.values())
    if has_experiment and (assumed := job.arm.chain.assumed):
        lines.append(f"Masses: {assumed}")
    lines += unknown_notes(job_result.runs.values())
    return [*lines, next(iter(runs.values())).not_proven]
