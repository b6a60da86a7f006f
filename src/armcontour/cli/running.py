"""Running a job from the command line, with progress."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.exporting import Exports, write_exports
from armcontour.cli.progress import job_progress

if TYPE_CHECKING:
    from armcontour.evaluation import Evaluation
    from armcontour.study import Job, RunResult, Study

# Columns of text where the output goes to a file or another program.
WIDTH = 120


def built_in_job() -> Job:
    """The paper's job, as shipped."""
    from armcontour.io import parse_job

    file = resources.files("armcontour.study") / "library" / "paper.yaml"
    return parse_job(file.read_text(encoding="utf-8"), source="the built-in job")


def run_job(
    read: Callable[[Callable[[float], None]], Job],
    out: FilePath,
    *,
    force: bool = False,
    open_report: bool = False,
    exports: Exports | None = None,
) -> None:
    """Read a job, run it, and write its results.

    Args:
        read: Gives the job; called with what is to be told of the share that is read.
        out: Folder for the results.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.
        exports: What is to be exported of every run.

    Raises:
        ArmContourError: As the steps raise it; nothing is written then.
    """
    # Only then the heavy part, so that the folder and the job are refused at once.
    from armcontour.io import ResultFolder, planned_csv, summary, taught_csv, torque_csv

    with ResultFolder(out, force=force) as folder, job_progress() as progress:
        job = read(progress.share)
        from armcontour.report import render_report
        from armcontour.study import run, steps_of

        progress.planned(job, [steps_of(x) for x in job.runs])
        study = run(
            job,
            progress=lambda name, what: progress.begin(f"{name}: {what}", what),
            done=progress.share,
        )
        progress.begin("writing the results", "writing")
        for name, result in study.runs.items():
            folder.write(f"{name}/taught.csv", taught_csv(result.taught, job.arm.joint_names))
            plan, period = result.trajectory, result.run.period
            folder.write(f"{name}/planned.csv", planned_csv(plan, period, job.arm.joint_names))
            if job.arm.has_bodies:
                folder.write(f"{name}/torque.csv", torque_csv(plan, job.arm, period))
            if exports:
                write_exports(folder, job, name, result, exports)
        folder.write("report.html", render_report(study))
        folder.write("summary.json", summary(study, [*folder.files, "summary.json"]))
    report = (out / "report.html").resolve()
    _print_results(study, report)
    if open_report:
        import webbrowser

        webbrowser.open(report.as_uri())


def _print_results(study: Study, report: FilePath) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from armcontour.study.quantities import assumed

    tried = any(x.run.experiment is not None for x in study.runs.values())
    headings = ["motion [s]", "at rest [s]", "RMS error [mm]", "largest [mm]", "demand / limit"]
    if tried:
        headings += ["experiment: RMS error [mm]", "largest [mm]"]
    table = Table(title=escape(study.job.title), title_justify="left")
    table.add_column("run")
    for name in headings:
        table.add_column(escape(name), justify="right")
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
        table.add_row(name, *cells)
    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDTH)
    console.print(table)
    lines = []
    for name, result in study.runs.items():
        if result.failure is not None:
            lines.append(f"Run {name}: {result.failure}")
        lines += [f"Warning: {x}" for x in result.warnings]
    if tried and (rests_on := assumed(study.job.arm)):
        lines.append(f"Masses: {rests_on}")
    for text in (*lines, f"Report: {report.as_uri()}"):
        console.print(text, soft_wrap=True, highlight=False, markup=False)


def _tried(result: RunResult) -> list[str]:
    """The cells of an experiment: its errors, or that it failed."""
    if result.failure is not None:
        return ["failed", "failed"]
    return ["", ""] if result.experiment is None else _errors(result.experiment.evaluation)


def _errors(e: Evaluation) -> list[str]:
    return [f"{e.contour_error.rms * 1e3:.4f}", f"{e.contour_error.max * 1e3:.4f}"]
