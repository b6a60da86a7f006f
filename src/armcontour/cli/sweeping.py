"""A trade-off from the command line, with progress."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import Console, open_page

if TYPE_CHECKING:
    from armcontour.certification import Sweep, SweepPoint


def sweep_file(
    job_file: FilePath,
    run: str | None,
    out: FilePath,
    *,
    tolerances: str | None = None,
    speeds: str | None = None,
    memory: str | None = None,
    force: bool = False,
    open_report: bool = False,
    trust_xacro: bool = False,
) -> None:
    """Sweep a job, print its points, and write them with their plot.

    Args:
        job_file: The job.
        run: Name of the run; by default the certificate's.
        out: Folder for summary.json and report.html.
        tolerances: Corner tolerances as text with units, separated by commas.
        speeds: Assigned velocities as text with units, separated by commas.
        memory: What the program may take, in the place of the job's.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.
        trust_xacro: Whether the job's arm may be a .xacro file, which is a program.

    Raises:
        ArmContourError: A job that cannot be used; nothing is written then.
    """
    from armcontour.cli.certifying import with_memory
    from armcontour.cli.progress import search_progress
    from armcontour.io import ResultFolder, read_job, sweep_json

    job = with_memory(read_job(job_file, trust_xacro=trust_xacro), memory)
    asked, fast = _listed("--tolerances", tolerances, "m"), _listed("--speeds", speeds, "m/s")
    with ResultFolder(out, force=force) as folder:
        from armcontour.certification import sweep
        from armcontour.report import render_sweep

        with search_progress("sweeping") as progress:
            found = sweep(job, run, tolerances=asked, speeds=fast, progress=progress)
        folder.write("report.html", render_sweep(found))
        folder.write("summary.json", sweep_json(found, [*folder.files, "summary.json"]))
    report = (out / "report.html").resolve()
    _print(found, report)
    if open_report:
        open_page(report)


def _listed(option: str, text: str | None, unit: str) -> list[float] | None:
    from armcontour.cli.certifying import parse_option

    if text is None:
        return None
    return [parse_option(option, x.strip(), unit) for x in text.split(",")]


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
