"""A trade-off from the command line, with progress."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armcontour.certification import Sweep, SweepPoint

# Columns of text where the output goes to a file or another program.
WIDTH = 120


def sweep_file(
    job_file: FilePath,
    run: str | None,
    out: FilePath,
    *,
    tolerances: str | None = None,
    speeds: str | None = None,
    force: bool = False,
    open_report: bool = False,
) -> None:
    """Sweep a job, print its points, and write them with their plot.

    Args:
        job_file: The job.
        run: Name of the run; by default the certificate's.
        out: Folder for summary.json and report.html.
        tolerances: Corner tolerances as text with units, separated by commas.
        speeds: Assigned velocities, likewise.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.

    Raises:
        ArmContourError: A job that cannot be used; nothing is written then.
    """
    from armcontour.cli.progress import shown
    from armcontour.io import ResultFolder, read_job, sweep_json

    job = read_job(job_file)
    asked, fast = _listed("tolerances", tolerances, "m"), _listed("speeds", speeds, "m/s")
    with ResultFolder(out, force=force) as folder:
        from armcontour.certification import sweep
        from armcontour.report import render_sweep

        with shown("sweeping") as progress:
            found = sweep(job, run, tolerances=asked, speeds=fast, progress=progress)
        folder.write("report.html", render_sweep(found))
        folder.write("summary.json", sweep_json(found, [*folder.files, "summary.json"]))
    report = (out / "report.html").resolve()
    _print(found, report)
    if open_report:
        import webbrowser

        webbrowser.open(report.as_uri())


def _listed(name: str, text: str | None, unit: str) -> list[float] | None:
    from armcontour.errors import InvalidInput
    from armcontour.io.units import parse

    if text is None:
        return None
    try:
        return [parse(x.strip(), unit) for x in text.split(",")]
    except ValueError as error:
        raise InvalidInput(f"--{name}: {error}.") from None


def _print(found: Sweep, report: FilePath) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDTH)
    table = Table(title=escape(f"{found.job.title}, run {found.run.name}"), title_justify="left")
    for name in ("tolerance [mm]", "speed [m/s]", "optimum [s]", "certified [s]", "error [mm]"):
        table.add_column(escape(name), justify="right")
    for x in (*found.tolerances, *found.speeds):
        table.add_row(*cells(x))
    console.print(table)
    for x in (*found.tolerances, *found.speeds):
        if x.refusal is not None:
            console.print(f"{', '.join(cells(x)[:2])}: {x.refusal}", markup=False, soft_wrap=True)
    console.print(f"Report: {report.as_uri()}", soft_wrap=True, highlight=False)


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
