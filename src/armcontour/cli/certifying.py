"""Certifying a job from the command line, with progress."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import Console, open_page

if TYPE_CHECKING:
    from armcontour.certification import Budget, Certificate
    from armcontour.evaluation import Evaluation
    from armcontour.jobs import Job


CONTOURS = (
    "contour",
    "start [s]",
    "motion [s]",
    "cost [s]",
    "error [mm]",
    "allowed [mm]",
    "left [mm]",
)


def certify_job(
    read: Callable[[Callable[[float], None]], Job],
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
        read: Gives the job; called with what is to be told of the share that is read.
        run: Name of the run; by default the certificate's.
        out: Folder for summary.json, report.html and the trajectories; None writes nothing.
        tolerance: Total tolerance as text with a unit, in the place of the job's.
        servo: Budget of the servo as text with a unit, in the place of the job's.
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
    from armcontour.io import ResultFolder

    if out is None and (open_report or force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    lengths = {
        "tolerance": length_of("--total-tolerance", tolerance),
        "servo": length_of("--servo", servo),
    }
    overrides = {name: value for name, value in lengths.items() if value is not None}
    with nullcontext() if out is None else ResultFolder(out, force=force) as folder:
        from armcontour.certification import certify

        with shown("certifying") as progress:
            progress("reading")
            job = read(lambda share: progress(f"reading, {share:.0%}"))
            found = certify(job, run, progress=progress, **overrides)
        if folder is not None:
            _write(found, folder)
    if as_json:
        from armcontour.io import certificate_json

        print(certificate_json(found), end="")
    else:
        _print(found, None if out is None else out / "report.html")
    if open_report and out is not None:
        open_page(out / "report.html")


def length_of(option: str, text: str | None) -> float | None:
    """The length that an option gives [m]; None without the option.

    Raises:
        InvalidInput: The text is not a length.
    """
    from armcontour.errors import InvalidInput
    from armcontour.io.units import parse

    try:
        return None if text is None else parse(text, "m")
    except ValueError as error:
        raise InvalidInput(f"{option}: {error}.") from None


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
    console = Console()
    title = f"Certified: {found.job.title}, run {found.run.name}"
    console.show_table(["", ""], certified_rows(found), title=title)
    if len(found.contours) > 1:
        console.show_table(CONTOURS, contour_rows(found), title="Contours")
    console.say(f"Holds for: {found.model}.")
    if report is not None:
        console.say(f"Report: {report.resolve().as_uri()}")


def certified_rows(found: Certificate) -> list[tuple[str, str]]:
    """A certificate as names and values; parts of the error are of the contour with least left."""
    budget, e, worst = found.budget, found.evaluation, found.worst
    rows = [
        ("motion", f"{found.duration:.4f} s"),
        ("at rest after", f"{e.settled:.3f} s"),
        ("uncertified optimum", f"{found.uncertified.duration:.4f} s"),
    ]
    if len(found.contours) > 1:
        rows.append(("contours", f"{len(found.contours)}, all certified"))
        rows.append(("least left on", worst.name))
    rows += [
        ("rounding", f"{budget.rounding * 1e3:.5f} mm"),
        ("servo", f"{budget.servo * 1e3:.5f} mm"),
        ("command interval", f"{budget.sampling * 1e3:.5f} mm"),
    ]
    if found.corners is not None:
        rows.append(("worst robot of the box", f"{budget.box * 1e3:.5f} mm"))
    rows += [
        ("left", f"{budget.left * 1e3:.5f} mm"),
        ("contour error, RMS", f"{e.contour_error.rms * 1e3:.5f} mm"),
        ("acceleration derated, mean", ", ".join(f"{x:.2%}" for x in found.headroom)),
        ("demand / limit", f"{e.demand_ratio.max():.6f}"),
        ("saturated", ", ".join(f"{x:.1%}" for x in e.saturated)),
    ]
    if found.pauses > 0:
        rows.append(("pauses after rapids", f"{found.pauses:.4f} s"))
    if found.experiment is not None:
        rows.append(("on rigid bodies, largest", _largest(found.experiment.evaluation)))
    return rows


def contour_rows(found: Certificate) -> list[tuple[str, ...]]:
    """The contours of a certificate, a row each, and one for the whole."""
    rows = [
        (
            x.name,
            f"{x.t[0]:.3f}",
            f"{x.duration:.4f}",
            f"{x.duration - x.optimum:+.4f}",
            *_errors(x.budget),
        )
        for x in found.contours
    ]
    whole = ("whole program", "0.000", f"{found.duration:.4f}", f"{found.cost:+.4f}")
    return [*rows, (*whole, *_errors(found.budget))]


def _errors(budget: Budget) -> tuple[str, str, str]:
    return (
        f"{budget.executed * 1e3:.5f}",
        f"{budget.servo_allowed * 1e3:.5g}",
        f"{budget.left * 1e3:.5f}",
    )


def _largest(e: Evaluation) -> str:
    return f"{e.contour_error.max * 1e3:.5f} mm"
