"""The command `run`: run a job, print and write the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour._progress import Progress, Step, under
from armcontour._threads import do_both
from armcontour.cli.console import Console, open_page
from armcontour.cli.exporting import Exports, rehearse, write_exports
from armcontour.cli.progress import job_progress

if TYPE_CHECKING:
    from armcontour.evaluation import Evaluation
    from armcontour.io import ResultFolder
    from armcontour.jobs import Job, RunPlan, RunResult, Study

WRITING = Step(("writing the results",))


def run_demo(out: FilePath, *, force: bool, open_report: bool) -> None:
    """Run the built-in job, and say what an extra would add to it.

    Args:
        out: Folder for the results.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.

    Raises:
        ArmContourError: The folder cannot be used.
    """
    left_out: list[str] = []

    def read(progress: Progress) -> Job:
        from armcontour.execution.rigid_body_plant import can_simulate

        job = built_in_job()
        if can_simulate():
            return job
        alone, runs = without_bodies(job)
        left_out.extend(runs)
        return alone

    run_job(read, out, force=force, open_report=open_report)
    if left_out:
        Console().say(
            "Left out: how all runs do on the arm's rigid bodies, and the run "
            f"{' and '.join(left_out)}, which only these judge; both need MuJoCo: pip install "
            "'armcontour[experiment]'."
        )


def built_in_job() -> Job:
    """The paper's job, which is a part of the package."""
    from armcontour.io import parse_job

    file = resources.files("armcontour.jobs") / "library" / "paper.yaml"
    return parse_job(file.read_text(encoding="utf-8"), source="the built-in job")


def without_bodies(job: Job) -> tuple[Job, list[str]]:
    """A job without experiments, and without runs that nothing else judges.

    Args:
        job: The job.

    Returns:
        What is left of it, and the names of the runs that are not.
    """
    kept = [x for x in job.runs if x.compensation != "inverse_dynamics"]
    lost = [x.name for x in job.runs if x not in kept]
    return replace(job, runs=tuple(replace(x, experiment=None) for x in kept)), lost


def run_job(
    read: Callable[[Progress], Job],
    out: FilePath,
    *,
    force: bool = False,
    open_report: bool = False,
    exports: Exports | None = None,
    simulate: bool = True,
) -> None:
    """Read a job, run it, and write its results.

    Args:
        read: Reads the job; called with a function that takes the progress.
        out: Folder for the results.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.
        exports: Formats in which every run is exported.
        simulate: Whether to simulate the servo and write a report.

    Raises:
        ArmContourError: An invalid job, or a run that fails; then nothing is written.
    """
    # Heavy imports come later, so that a wrong folder or job is refused at once.
    from armcontour._warming import warm_for_run
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder
    from armcontour.io.summary import summarise_taught, summary

    if open_report and not simulate:
        raise InvalidInput("--open opens the report of a simulation: leave --no-simulation out.")
    with ResultFolder(out, force=force) as folder, job_progress() as progress:
        job = read(under(progress, "reading"))
        if exports:
            # An export that cannot be written is refused before the run.
            rehearse(job, exports, folder.scratch)
        with warm_for_run(job.arm.dimension, progress):
            from armcontour.jobs import run, steps_of, teach, warnings_of

            steps = [step for x in job.runs for step in steps_of(x, simulated=simulate)]
            progress.expect([*steps, WRITING.names[0]])
            if simulate:
                from armcontour.report import render_report

                study = run(job, progress=progress)
                progress(WRITING)
                write = partial(_write_plans, folder, job, study.runs, exports)
                notes, page = do_both(write, partial(render_report, study))
                folder.write("report.html", page)
                folder.write("summary.json", summary(study, [*folder.files, "summary.json"]))
            else:
                plans = teach(job, progress=progress)
                progress(WRITING)
                # With formats chosen, no other files are written.
                motions = not exports
                write = partial(_write_plans, folder, job, plans, exports, motions=motions)
                # Warnings are looked for once: the summary has them, and they are printed.
                notes, _ = do_both(write, partial(warnings_of, plans.values()))
                files = [*folder.files, "summary.json"]
                folder.write("summary.json", summarise_taught(job, plans, files))
    if not simulate:
        _print_plans(job, plans, out, notes)
        return
    report = (out / "report.html").resolve()
    _print_results(study, report, notes)
    if open_report:
        open_page(report)


def write_motions(
    folder: ResultFolder,
    job: Job,
    plans: Mapping[str, RunPlan],
) -> None:
    """Write taught data, plan and torques of every run as CSV."""
    from armcontour.io import write_planned, write_taught, write_torque

    names = job.arm.joint_names
    for name, result in plans.items():
        # Thousands of laws take long to evaluate: once for both files.
        planned = result.trajectory.sample(result.run.period)
        taught = partial(write_taught, taught=result.taught, joint_names=names)
        folder.place(f"{name}/taught.csv", taught)
        plan = partial(write_planned, x=planned, joint_names=names)
        folder.place(f"{name}/planned.csv", plan)
        if job.arm.has_bodies:
            torque = partial(write_torque, x=planned, arm=job.arm)
            folder.place(f"{name}/torque.csv", torque)


def _write_plans(
    folder: ResultFolder,
    job: Job,
    plans: Mapping[str, RunPlan],
    exports: Exports | None,
    *,
    motions: bool = True,
) -> list[str]:
    """Write the motions of every run, if they are wanted, and its exports; returns warnings."""
    if motions:
        write_motions(folder, job, plans)
    if not exports:
        return []
    found = [write_exports(folder, job, name, plan, exports) for name, plan in plans.items()]
    return [warning for of_run in found for warning in of_run]


def _print_plans(
    job: Job, plans: Mapping[str, RunPlan], out: FilePath, notes: Sequence[str]
) -> None:
    """Print duration and set-points of runs that are not simulated."""
    from armcontour.jobs import warnings_of

    console = Console()
    for name, x in plans.items():
        console.say(
            f"Run {name}: {x.trajectory.duration:.4f} s, {len(x.taught.q)} set-points every "
            f"{x.run.period:g} s; not simulated."
        )
        for note in x.remarks:
            console.say(note)
    for note in (*warnings_of(plans.values()), *notes):
        console.say(f"Warning: {note}")
    for note in job.arm.notes:
        console.say(f"Note: {note}")
    console.say(f"Taught data: {out.resolve()}")


def _print_results(study: Study, report: FilePath, notes: Sequence[str]) -> None:
    """Print a table of all runs, warnings, and where the report is."""
    from armcontour.jobs import warnings_of
    from armcontour.jobs.quantities import assumed_numbers, unknown_notes

    has_experiment = any(x.run.experiment is not None for x in study.runs.values())
    headings = ["motion [s]", "at rest [s]", "RMS error [mm]", "largest [mm]", "demand / limit"]
    jerks = any(x.run.limits.joint_jerk is not None for x in study.runs.values())
    if jerks:
        headings.append("jerk / limit")
    misses = any(_misses(x.evaluation) for x in study.runs.values())
    if misses:
        headings.append("path missed [mm]")
    if has_experiment:
        headings += ["experiment: RMS error [mm]", "largest [mm]"]
    rows = []
    for name, result in study.runs.items():
        e = result.evaluation
        cells = [
            f"{e.duration:.4f}",
            f"{e.settled:.3f}",
            *_errors(e),
            # Without limits of acceleration there is nothing to compare with.
            "-" if result.run.limits.joint_acceleration is None else f"{e.demand_ratio.max():.4f}",
        ]
        if jerks:
            unlimited = result.run.limits.joint_jerk is None
            cells.append("-" if unlimited else f"{e.jerk_ratio.max():.4f}")
        if misses:
            cells.append(f"{e.missed.max * 1e3:.4f}")
        if has_experiment:
            cells += _experiment_errors(result)
        rows.append([name, *cells])
    console = Console()
    console.show_table(["run", *headings], rows, title=study.job.title)
    lines = []
    for name, result in study.runs.items():
        if result.failure is not None:
            lines.append(f"Run {name}: {result.failure}")
        lines += result.remarks
    lines += [f"Warning: {x}" for x in (*warnings_of(study.runs.values()), *notes)]
    lines += [f"Note: {x}" for x in study.job.arm.notes]
    if has_experiment and (assumed := assumed_numbers(study.job.arm)):
        lines.append(f"Masses: {assumed}")
    lines += unknown_notes(study)
    for text in (*lines, f"Report: {report.as_uri()}"):
        console.say(text)


def _misses(e: Evaluation) -> bool:
    """Whether the tool misses parts of the path by more than it is off the path anywhere."""
    return e.missed.max > e.contour_error.max * (1 + 1e-3)


def _experiment_errors(result: RunResult) -> list[str]:
    """Errors of an experiment as cells, or that the experiment failed."""
    if result.failure is not None:
        return ["failed", "failed"]
    return ["", ""] if result.experiment is None else _errors(result.experiment.evaluation)


def _errors(e: Evaluation) -> list[str]:
    """RMS and largest contour error [mm], as text."""
    return [f"{e.contour_error.rms * 1e3:.4f}", f"{e.contour_error.max * 1e3:.4f}"]
