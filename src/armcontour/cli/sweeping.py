"""A trade-off from the command line, with progress."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import Console, open_page

if TYPE_CHECKING:
    from armcontour.certification import Sweep, SweepPoint
    from armcontour.jobs import Job


def sweep_job(
    read: Callable[[Callable[[float], None]], Job],
    run: str | None,
    out: FilePath,
    *,
    tolerances: str | None = None,
    speeds: str | None = None,
    servo: str | None = None,
    force: bool = False,
    open_report: bool = False,
) -> None:
    """Sweep a job, print its points, and write them with their plot.

    Args:
        read: Gives the job; called with what is to be told of the share that is read.
        run: Name of the run; by default the certificate's.
        out: Folder for summary.json and report.html.
        tolerances: Corner tolerances as text with units, separated by commas.
        speeds: Assigned velocities as text with units, separated by commas.
        servo: Budget of the servo as text with a unit, in the place of the job's.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.

    Raises:
        ArmContourError: A job that cannot be used; nothing is written then.
    """
    from armcontour.cli.certifying import length_of
    from armcontour.cli.progress import shown
    from armcontour.io import ResultFolder, sweep_json

    budget = length_of("--servo", servo)
    overrides = {} if budget is None else {"servo": budget}
    asked, fast = _listed("tolerances", tolerances, "m"), _listed("speeds", speeds, "m/s")
    with ResultFolder(out, force=force) as folder:
        from armcontour.certification import sweep
        from armcontour.report import render_sweep

        with shown("sweeping") as progress:
            progress("reading")
            job = read(lambda share: progress(f"reading, {share:.0%}"))
            found = sweep(job, run, tolerances=asked, speeds=fast, progress=progress, **overrides)
        folder.write("report.html", render_sweep(found))
        folder.write("summary.json", sweep_json(found, [*folder.files, "summary.json"]))
    report = (out / "report.html").resolve()
    _print(found, report)
    if open_report:
        open_page(report)


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
