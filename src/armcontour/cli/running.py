"""Running a job from the command line, with progress."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour._progress import Progress, Step, under
from armcontour.cli.console import Console, open_page
from armcontour.cli.exporting import Exports, rehearse, write_exports
from armcontour.cli.progress import job_progress

if TYPE_CHECKING:
    from armcontour.evaluation import Evaluation
    from armcontour.io import ResultFolder
    from armcontour.jobs import Job, RunPlan, RunResult, Study

WRITING = Step(("writing the results",))


def built_in_job() -> Job:
    """The paper's job, as shipped."""
    from armcontour.io import parse_job

    file = resources.files("armcontour.jobs") / "library" / "paper.yaml"
    return parse_job(file.read_text(encoding="utf-8"), source="the built-in job")


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
        read: Gives the job; called with what hears how far it is.
        out: Folder for the results.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.
        exports: What is to be exported of every run.
        simulate: Whether the servo is simulated, and a report written.

    Raises:
        ArmContourError: As the steps raise it; nothing is written then.
    """
    # Only then the heavy part, so that the folder and the job are refused at once.
    from armcontour.io import ResultFolder
    from armcontour.io.summary import summarise_taught, summary

    with ResultFolder(out, force=force) as folder, job_progress() as progress:
        job = read(under(progress, "reading"))
        if exports:
            # What cannot be exported is refused before the run.
            rehearse(job, exports, folder.scratch)
        from armcontour.jobs import run, steps_of, teach

        steps = [step for x in job.runs for step in steps_of(x, simulated=simulate)]
        progress.expect([*steps, WRITING.names[0]])
        if simulate:
            from armcontour.report import render_report

            study = run(job, progress=progress)
            progress(WRITING)
            write_motions(folder, job, study.runs)
            _write_exports(folder, job, study.runs, exports)
            folder.write("report.html", render_report(study))
            folder.write("summary.json", summary(study, [*folder.files, "summary.json"]))
        else:
            plans = teach(job, progress=progress)
            progress(WRITING)
            # Who asks for formats wants nothing else.
            if not exports:
                write_motions(folder, job, plans)
            _write_exports(folder, job, plans, exports)
            files = [*folder.files, "summary.json"]
            folder.write("summary.json", summarise_taught(job, plans, files))
    if not simulate:
        _print_plans(plans, out)
        return
    report = (out / "report.html").resolve()
    _print_results(study, report)
    if open_report:
        open_page(report)


def write_motions(
    folder: ResultFolder,
    job: Job,
    plans: Mapping[str, RunPlan],
) -> None:
    """What every run tells the robot, as CSV."""
    from armcontour.io import planned_csv, taught_csv, torque_csv

    names = job.arm.joint_names
    for name, result in plans.items():
        folder.write(f"{name}/taught.csv", taught_csv(result.taught, names))
        plan, period = result.trajectory, result.run.period
        folder.write(f"{name}/planned.csv", planned_csv(plan, period, names))
        if job.arm.has_bodies:
            folder.write(f"{name}/torque.csv", torque_csv(plan, job.arm, period))


def _write_exports(
    folder: ResultFolder, job: Job, plans: Mapping[str, RunPlan], exports: Exports | None
) -> None:
    """The same as it is asked for."""
    for name, result in plans.items():
        if exports:
            write_exports(folder, job, name, result, exports)


def _print_plans(plans: Mapping[str, RunPlan], out: FilePath) -> None:
    """What was taught, of runs that are not simulated."""
    console = Console()
    for name, x in plans.items():
        console.say(
            f"Run {name}: {x.trajectory.duration:.4f} s, {len(x.taught.q)} set-points every "
            f"{x.run.period:g} s; not simulated."
        )
        for warning in x.warnings:
            console.say(f"Warning: {warning}")
    console.say(f"Taught data: {out.resolve()}")


def _print_results(study: Study, report: FilePath) -> None:
    from armcontour.jobs.quantities import assumed_numbers

    tried = any(x.run.experiment is not None for x in study.runs.values())
    headings = ["motion [s]", "at rest [s]", "RMS error [mm]", "largest [mm]", "demand / limit"]
    if tried:
        headings += ["experiment: RMS error [mm]", "largest [mm]"]
    rows = []
    for name, result in study.runs.items():
        e = result.evaluation
        cells = [
            f"{e.duration:.4f}",
            f"{e.settled:.3f}",
            *_errors(e),
            f"{e.demand_ratio.max():.4f}",
        ]
        if tried:
            cells += _tried(result)
        rows.append([name, *cells])
    console = Console()
    console.show_table(["run", *headings], rows, title=study.job.title)
    lines = []
    for name, result in study.runs.items():
        if result.failure is not None:
            lines.append(f"Run {name}: {result.failure}")
        lines += [f"Warning: {x}" for x in result.warnings]
    if tried and (rests_on := assumed_numbers(study.job.arm)):
        lines.append(f"Masses: {rests_on}")
    for text in (*lines, f"Report: {report.as_uri()}"):
        console.say(text)


def _tried(result: RunResult) -> list[str]:
    """The cells of an experiment: its errors, or that it failed."""
    if result.failure is not None:
        return ["failed", "failed"]
    return ["", ""] if result.experiment is None else _errors(result.experiment.evaluation)


def _errors(e: Evaluation) -> list[str]:
    return [f"{e.contour_error.rms * 1e3:.4f}", f"{e.contour_error.max * 1e3:.4f}"]
