"""The command `sweep`: certify a job for several tolerances and speeds."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour._progress import under
from armcontour.cli.console import Console, open_page
from armcontour.cli.quantities import read_option, read_option_list

if TYPE_CHECKING:
    from armcontour.certification import Sweep, SweepPoint
    from armcontour.cli.options import JobOptions, SweepOptions


def sweep_file(file: FilePath, out: FilePath, job_options: JobOptions, x: SweepOptions) -> None:
    """Sweep a job, print its points, and write them with a plot.

    Args:
        file: A job file, or a drawing.
        out: Folder for summary.json, sweep.csv and report.html.
        job_options: Options that replace values of the job.
        x: Options of the command.

    Raises:
        ArmContourError: An invalid job; then nothing is written.
    """
    from armcontour._quantities import Speed, Tolerance
    from armcontour.cli.opening import open_job
    from armcontour.cli.progress import search_progress
    from armcontour.cli.sharing import open_executor
    from armcontour.io import ResultFolder, sweep_csv, sweep_json

    corners = read_option_list("--tolerances", x.tolerances, Tolerance)
    speeds = read_option_list("--speeds", x.speeds, Speed)
    servo = read_option("--servo", x.servo, Tolerance)
    with (
        open_executor(x.workers, x.cluster) as executor,
        ResultFolder(out, force=x.force) as folder,
    ):
        from armcontour.certification import sweep
        from armcontour.certification.certifying import goal_of
        from armcontour.report import render_sweep

        with search_progress("sweeping") as progress:
            job = open_job(file, job_options, under(progress, "reading"))
            found = sweep(
                job,
                x.run_name,
                tolerances=corners,
                speeds=speeds,
                shapes=None if x.shapes is None else [y.strip() for y in x.shapes.split(",")],
                certified=x.certified,
                # In this process every trial of a point is told.
                executor=None if x.workers == 0 else executor,
                goal=None if servo is None else goal_of(job, servo=servo),
                progress=progress,
            )
        folder.write("report.html", render_sweep(found))
        folder.write("sweep.csv", sweep_csv(found))
        folder.write("summary.json", sweep_json(found, [*folder.files, "summary.json"]))
    report = (out / "report.html").resolve()
    _print(found, report)
    if x.open_report:
        open_page(report)


def _print(found: Sweep, report: FilePath) -> None:
    """Print a table of the points, and why points were refused."""
    console = Console()
    points = (*found.tolerances, *found.speeds)
    console.show_table(
        ["corners", "tolerance [mm]", "speed [m/s]", "optimum [s]", "certified [s]", "error [mm]"],
        [cells(x) for x in points],
        title=f"{found.job.title}, run {found.run.name}",
    )
    for x in points:
        if x.refusal is not None:
            console.say(f"{', '.join(filter(None, cells(x)[:3]))}: {x.refusal}")
    if found.iterations is not None:
        console.say(f"Note: shapes are found in at most {found.iterations} iterations per point.")
    for note in found.job.arm.notes:
        console.say(f"Note: {note}")
    console.say(f"Report: {report.as_uri()}")


def cells(x: SweepPoint) -> list[str]:
    """A point as cells: shape, tolerance, speed, optimum, certified time, contour error."""

    def shown(value: float | None, scale: float, digits: str) -> str:
        return "" if value is None else format(value * scale, digits)

    return [
        x.shape or "",
        shown(x.tolerance, 1e3, ".4g"),
        shown(x.speed, 1, ".4g"),
        shown(x.optimum, 1, ".4f"),
        "refused" if x.refusal is not None else shown(x.duration, 1, ".4f"),
        shown(x.contour_error, 1e3, ".5f"),
    ]
