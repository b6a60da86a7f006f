"""Certifying a job from the command line, with progress."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armcontour.certification import Certificate
    from armcontour.evaluation import Evaluation

# Columns of text where the output goes to a file or another program.
WIDTH = 120


def certify_file(
    job_file: FilePath,
    run: str | None,
    out: FilePath | None,
    *,
    tolerance: str | None = None,
    servo: str | None = None,
    force: bool = False,
    open_report: bool = False,
    as_json: bool = False,
) -> None:
    """Certify a job, print the certificate, and write it with its taught data.

    Args:
        job_file: The job.
        run: Name of the run; by default the certificate's.
        out: Folder for summary.json, report.html and the trajectories; None writes nothing.
        tolerance: Total tolerance as text with a unit, in the place of the job's.
        servo: Budget of the servo, likewise.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.
        as_json: Whether to print the summary and not a table.

    Raises:
        ArmContourError: A job that cannot be used, or no plan that holds the goal; nothing is
            written then.
    """
    from contextlib import nullcontext

    from armcontour.cli.progress import shown
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder, read_job

    if out is None and (open_report or force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    job = read_job(job_file)
    overrides = _lengths(tolerance=tolerance, servo=servo)
    with nullcontext() if out is None else ResultFolder(out, force=force) as folder:
        from armcontour.certification import certify

        with shown("certifying") as progress:
            found = certify(job, run, progress=progress, **overrides)
        if folder is not None:
            _write(found, folder)
    if as_json:
        from armcontour.io import certificate_json

        print(certificate_json(found), end="")
    else:
        _print(found, None if out is None else out / "report.html")
    if open_report and out is not None:
        import webbrowser

        webbrowser.open((out / "report.html").resolve().as_uri())


def _lengths(**given: str | None) -> dict[str, float]:
    """Lengths of options [m].

    Raises:
        InvalidInput: Text that is no length.
    """
    from armcontour.errors import InvalidInput
    from armcontour.io.units import parse

    found = {}
    for name, text in given.items():
        if text is None:
            continue
        try:
            found[name] = parse(text, "m")
        except ValueError as error:
            raise InvalidInput(f"--{name}: {error}.") from None
    return found


def _write(found: Certificate, folder: Any) -> None:
    """The plan, its taught data and what was held back; the report; the summary."""
    from armcontour.io import certificate_json, held_csv, planned_csv, taught_csv, torque_csv
    from armcontour.report import render_report

    arm, name = found.job.arm, found.run.name
    folder.write(f"{name}/taught.csv", taught_csv(found.taught, arm.joint_names))
    period = found.run.period
    folder.write(f"{name}/planned.csv", planned_csv(found.trajectory, period, arm.joint_names))
    if arm.has_bodies:
        folder.write(f"{name}/torque.csv", torque_csv(found.trajectory, arm, period))
    folder.write("held.csv", held_csv(found))
    folder.write("report.html", render_report(found.study, certificate=found))
    folder.write("summary.json", certificate_json(found, [*folder.files, "summary.json"]))


def _print(found: Certificate, report: FilePath | None) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(
        title=escape(f"Certified: {found.job.title}, run {found.run.name}"), title_justify="left"
    )
    table.add_column("")
    table.add_column("", justify="right")
    for name, value in certified_rows(found):
        table.add_row(name, value)
    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDTH)
    console.print(table)
    console.print(f"Holds for: {found.model}.", soft_wrap=True, highlight=False, markup=False)
    if report is not None:
        console.print(f"Report: {report.resolve().as_uri()}", soft_wrap=True, highlight=False)


def certified_rows(found: Certificate) -> list[tuple[str, str]]:
    """A certificate as names and values."""
    budget, e = found.budget, found.evaluation
    rows = [
        ("motion", f"{found.duration:.4f} s"),
        ("at rest after", f"{e.settled:.3f} s"),
        ("uncertified optimum", f"{found.uncertified.duration:.4f} s"),
        ("rounding", f"{budget.rounding * 1e3:.5f} mm"),
        ("servo", f"{budget.servo * 1e3:.5f} mm"),
        ("command interval", f"{budget.sampling * 1e3:.5f} mm"),
    ]
    if found.corners is not None:
        rows.append(("worst robot of the box", f"{budget.box * 1e3:.5f} mm"))
    rows += [
        ("left", f"{budget.left * 1e3:.5f} mm"),
        ("contour error, RMS", f"{e.contour_error.rms * 1e3:.5f} mm"),
        ("acceleration held back, mean", ", ".join(f"{x:.2%}" for x in found.headroom)),
        ("demand / limit", f"{e.demand_ratio.max():.6f}"),
        ("saturated", ", ".join(f"{x:.1%}" for x in e.saturated)),
    ]
    if found.experiment is not None:
        rows.append(("on rigid bodies, largest", _largest(found.experiment.evaluation)))
    return rows


def _largest(e: Evaluation) -> str:
    return f"{e.contour_error.max * 1e3:.5f} mm"
