"""The commands `run` and `demo`: run jobs, and print and write the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import print_lines, print_report, show_table
from armcontour.cli.exports import refuse_outputs, refuse_unused, write_exports
from armcontour.cli.inputs import library_file, open_job
from armcontour.cli.options import ExportOptions, Force, JobOptions, JobOrDrawing, Out, RunOptions
from armcontour.cli.program import RUN, command
from armcontour.cli.progress_bars import show_progress
from armcontour.core.progress import Progress, Step

if TYPE_CHECKING:
    from armcontour.files import ResultFolder
    from armcontour.jobs import Job, JobResult, RunResult

WRITING = Step(("writing the results",))


# Names of the runs of the paper's job that the demo compares.
COMPARED = ("conventional", "proposed", "shaped")


@command(RUN, "run gasket.dxf --cell ur5e --out gasket --export urscript")
def run(
    job: JobOrDrawing,
    out: Out,
    options: RunOptions,
    job_options: JobOptions,
    exports: ExportOptions,
) -> int:
    """Run a job or a drawing: writes summary.json, report.html, and trajectories (CSV).

    Exit codes: 0 done, 1 done but no run is kept; others as for errors.
    """

    def read(progress: Progress) -> Job:
        opened = open_job(job, job_options, progress, exports)
        refuse_unused(exports.keys, opened)
        return opened

    return run_job(
        read, out, force=options.force, simulate=options.simulate, changes=options.changes
    )


@command(RUN, "demo")
def demo(out: Out = FilePath("demo"), force: Force = False) -> None:
    """Run two built-in jobs: the paper's job on the PMK-3s, and a plate that a UR5e cuts."""
    # The results of the paper's job are written to the folder itself, the results of the plate to a
    # subfolder. An earlier result of the demo is replaced if its files are unchanged.
    from armcontour.core.compilation import compile_for_run
    from armcontour.files import ResultFolder, read_job
    from armcontour.files.result_folder import data_json

    with (
        ResultFolder(out, force=force, replaces="demo") as folder,
        show_progress("running") as progress,
    ):
        jobs = {"": _compared_runs(), "plate/": read_job(library_file("plate.yaml"))}
        with compile_for_run(None, progress):
            from armcontour import jobs as engine
            from armcontour.report import render_demo

            studies = {name: engine.run(job, progress=progress) for name, job in jobs.items()}
            progress(WRITING)

            for name, study in studies.items():
                others = len(folder.files)
                write_motions(folder, study.job, study.runs, prefix=name)
                files = [x.removeprefix(name) for x in folder.files[others:]]
                folder.write(
                    f"{name}summary.json", data_json(study.to_data([*files, "summary.json"]))
                )
            folder.write("report.html", render_demo(list(studies.values())))
    for study in studies.values():
        _print_results(study, [])
    print_report(out)


def built_in_job() -> Job:
    """Load the paper's job, which is part of the package."""
    from armcontour.files import parse_job

    return parse_job(library_file("paper.yaml").read_text("utf-8"), source="the built-in job")


def _compared_runs() -> Job:
    """The paper's job with the compared runs of the demo, without experiments."""
    job = built_in_job()
    runs = tuple(replace(x, experiment=None) for x in job.runs if x.name in COMPARED)
    return replace(job, runs=runs)


def run_job(
    read: Callable[[Progress], Job],
    out: FilePath,
    *,
    force: bool = False,
    simulate: bool = True,
    changes: bool | None = None,
) -> int:
    """Read and run a job, print and write its results; return 1 if no run is kept, otherwise 0."""
    # Slow imports follow the checks, so that an invalid folder or job is rejected at once.
    from armcontour.core.compilation import compile_for_run
    from armcontour.files import ResultFolder
    from armcontour.files.result_folder import data_json

    with ResultFolder(out, force=force) as folder, show_progress("running") as progress:
        job = read(progress)
        if job.export.formats:
            # Exports are tested before the run, so that invalid options are rejected at once.
            refuse_outputs(job)
        with compile_for_run(job.arm.dimension, progress):
            from armcontour import jobs as engine
            from armcontour.jobs.advice import is_small, with_advice

            advises = simulate and (is_small(job) if changes is None else changes)
            study = engine.run(job, simulate=simulate, progress=progress)
            if advises:
                study = with_advice(study, progress)
            progress(WRITING)
            if simulate or not job.export.formats:
                # Without simulation, the exports are written instead of the usual files.
                write_motions(folder, job, study.runs)
            notes: list[str] = []
            for name, result in study.runs.items():
                notes += write_exports(folder, job, name, result)
            if simulate:
                from armcontour.report import render_report

                folder.write("report.html", render_report(study))
            folder.write("summary.json", data_json(study.to_data([*folder.files, "summary.json"])))
    _print_results(study, notes)
    if simulate:
        print_report(out)
    else:
        print_lines(f"The run was not simulated. Set-points: {out.resolve()}")
    # Runs that are not kept may be there for comparison with a run that is kept.
    verdicts = {x.kept for x in study.runs.values()}
    return int(False in verdicts and True not in verdicts)


def write_motions(
    folder: ResultFolder, job: Job, plans: Mapping[str, RunResult], *, prefix: str = ""
) -> None:
    """Write set-points, plan and torques of every run as CSV."""
    from armcontour.files import write_planned, write_set_points, write_torque

    names = job.arm.joint_names
    for name, result in plans.items():
        # The plan is sampled once for both files, because evaluating thousands of laws is slow.
        planned = result.trajectory.sample(result.run.cycle)
        set_points = partial(write_set_points, set_points=result.set_points, joint_names=names)
        folder.place(f"{prefix}{name}/set_points.csv", set_points)
        plan = partial(write_planned, samples=planned, joint_names=names)
        folder.place(f"{prefix}{name}/planned.csv", plan)
        if job.arm.has_bodies:
            torque = partial(write_torque, samples=planned, arm=job.arm)
            folder.place(f"{prefix}{name}/torque.csv", torque)


def _print_results(study: JobResult, notes: Sequence[str]) -> None:
    """Print verdict, values, remarks and warnings of each run."""
    from armcontour.core.render import cells, compare, lay_out, text, verdict
    from armcontour.core.result import VERDICT
    from armcontour.jobs import warnings_of
    from armcontour.jobs.plan_quantities import assumed_numbers
    from armcontour.jobs.run_notes import unknown_notes

    job, runs = study.job, study.figures
    title = f"{job.title}, simulated with {job.plant_servo}" if study.simulated else job.title
    if len(runs) == 1:
        print_lines(title, *text(next(iter(runs.values()))).splitlines())
    else:
        header, *rows = compare(runs)
        show_table(header, rows, title=title)
        for data in runs.values():
            print_lines(verdict(data))
            for table in (y for y in data.tables if y.level == VERDICT):
                print_lines(*lay_out("", cells(table)).splitlines()[1:])
    lines = [x for result in study.runs.values() for x in result.remarks]
    lines += [*(f"Warning: {x}" for x in warnings_of(study.runs.values())), *notes]
    lines += [f"Note: {x}" for x in job.arm.notes]
    has_experiment = any(x.run.experiment is not None for x in study.runs.values())
    if has_experiment and (assumed := assumed_numbers(job.arm)):
        lines.append(f"Masses: {assumed}")
    print_lines(*lines, *unknown_notes(study))
