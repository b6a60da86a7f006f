"""A trade-off from the command line, with progress."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import Console, open_page
from armcontour.cli.quantities import read_option, read_option_list

if TYPE_CHECKING:
    from armcontour.certification import Sweep, SweepPoint
    from armcontour.cli.options import SweepOptions


def sweep_file(job_file: FilePath, out: FilePath, x: SweepOptions) -> None:
    """Sweep a job, print its points, and write them with their plot.

    Args:
        job_file: The job.
        out: Folder for summary.json and report.html.
        x: What is swept.

    Raises:
        ArmContourError: A job that cannot be used; nothing is written then.
    """
    from armcontour._quantities import Length, Memory, Speed
    from armcontour.cli.progress import search_progress
    from armcontour.io import ResultFolder, read_job, sweep_json
    from armcontour.io.job_overrides import JobOverrides

    corners = read_option_list("--tolerances", x.tolerances, Length)
    speeds = read_option_list("--speeds", x.speeds, Speed)
    memory = JobOverrides(memory=read_option("--memory", x.memory, Memory))
    job = read_job(job_file, overrides=memory, trust_xacro=x.trust_xacro)
    with ResultFolder(out, force=x.force) as folder:
        from armcontour.certification import sweep
        from armcontour.report import render_sweep

        with search_progress("sweeping") as progress:
            found = sweep(job, x.run_name, tolerances=corners, speeds=speeds, progress=progress)
        folder.write("report.html", render_sweep(found))
        folder.write("summary.json", sweep_json(found, [*folder.files, "summary.json"]))
    report = (out / "report.html").resolve()
    _print(found, report)
    if x.open_report:
        open_page(report)


def _print(found: Sweep, report: FilePath) -> None:
    console = Console()
    points = (*found.tolerances, *found.speeds)
    console.show_table(
        ["tolerance [mm]", "speed [m/s]", "optimum [s]", "certified [s]", "error [mm]"],
        [cells(x) for x in points],
        title=f"{found.job.title}, run {found.run.name}",
        left=(),
    )
    for x in points:
        if x.refusal is not None:
            console.say(f"{', '.join(cells(x)[:2])}: {x.refusal}")
    console.say(f"Report: {report.as_uri()}")


def cells(x: SweepPoint) -> list[str]:
    """A point as text: tolerance, speed, optimum, certified time, contour error."""

    def shown(value: float | None, scale: float, digits: str) -> str:
        return "" if value is None else format(value * scale, digits)

    return [
        shown(x.tolerance, 1e3, ".4g"),
        shown(x.speed, 1, ".4g"),
        shown(x.optimum, 1, ".4f"),
        "refused" if x.duration is None else f"{x.duration:.4f}",
        shown(x.contour_error, 1e3, ".5f"),
    ]
