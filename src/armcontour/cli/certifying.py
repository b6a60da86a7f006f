"""Certifying a job from the command line, with progress."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import Console, open_page

if TYPE_CHECKING:
    from armcontour.certification import Certificate
    from armcontour.evaluation import Evaluation
    from armcontour.jobs import Job


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
    memory: str | None = None,
    trust_xacro: bool = False,
) -> None:
    """Certify a job, print the certificate, and write it with its taught data.

    Args:
        job_file: The job.
        run: Name of the run; by default the certificate's.
        out: Folder for summary.json, report.html and the trajectories; None writes nothing.
        tolerance: Total tolerance as text with a unit, in the place of the job's.
        servo: Budget of the servo as text with a unit, in the place of the job's.
        force: Whether an earlier result there may be replaced.
        open_report: Whether to open the report in a browser.
        as_json: Whether to print the summary and not a table.
        memory: What the program may take, in the place of the job's.
        trust_xacro: Whether the job's arm may be a .xacro file, which is a program.

    Raises:
        ArmContourError: A job that cannot be used, or no plan that holds the goal; nothing is
            written then.
    """
    from contextlib import nullcontext

    from armcontour.cli.progress import search_progress
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder, read_job

    if out is None and (open_report or force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    job = with_memory(read_job(job_file, trust_xacro=trust_xacro), memory)
    lengths = {"tolerance": ("--total-tolerance", tolerance), "servo": ("--servo", servo)}
    overrides = {
        name: parse_option(option, text, "m")
        for name, (option, text) in lengths.items()
        if text is not None
    }
    with nullcontext() if out is None else ResultFolder(out, force=force) as folder:
        from armcontour.certification import certify

        with search_progress("certifying") as progress:
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


def parse_option(option: str, text: str, unit: str) -> float:
    """The quantity that an option gives, in its SI unit.

    Raises:
        InvalidInput: The text is no such quantity.
    """
    from armcontour.errors import InvalidInput
    from armcontour.io.units import parse

    try:
        return parse(text, unit)
    except ValueError as error:
        raise InvalidInput(f"{option}: {error}.") from None


def with_memory(job: Job, text: str | None) -> Job:
    """The job with another bound of its memory, as text with a unit.

    Raises:
        InvalidInput: Text that is no amount of memory.
    """
    from dataclasses import replace

    return job if text is None else replace(job, memory=parse_option("--memory", text, "byte"))


def _write(found: Certificate, folder: Any) -> None:
    """The plan, its taught data and what was held back; the report; the summary."""
    from armcontour.cli.running import write_motions
    from armcontour.io import certificate_json, held_csv
    from armcontour.report import render_report

    write_motions(folder, found.job, found.study.runs)
    folder.write("held.csv", held_csv(found))
    folder.write("report.html", render_report(found.study, certificate=found))
    folder.write("summary.json", certificate_json(found, [*folder.files, "summary.json"]))


def _print(found: Certificate, report: FilePath | None) -> None:
    console = Console()
    title = f"Certified: {found.job.title}, run {found.run.name}"
    console.show_table(["", ""], certified_rows(found), title=title)
    console.say(f"Holds for: {found.model}.")
    if report is not None:
        console.say(f"Report: {report.resolve().as_uri()}")


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
