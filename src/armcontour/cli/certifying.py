"""The command `certify`: certify a job, print and write the certificate."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import Console, open_page
from armcontour.core.progress import subprogress

if TYPE_CHECKING:
    from armcontour.cli.options import CertifyOptions, JobOptions
    from armcontour.jobs import CertificateGoal
    from armcontour.studies.certification import Certificate


def certify_file(file: FilePath, job_options: JobOptions, x: CertifyOptions) -> None:
    """Certify a job, print the certificate, and write it with its set-points.

    Args:
        file: A job file, or a drawing.

        job_options: Options that replace values of the job.
        x: Options of the command; the folder gets summary.json, report.html and trajectories.

    Raises:
        ArmContourError: An invalid job, or no plan that meets the goal; then nothing is written.
    """
    from armcontour.cli.opening import open_job
    from armcontour.cli.progress import search_progress
    from armcontour.core.errors import InvalidInput
    from armcontour.core.pool import open_executor
    from armcontour.files import ResultFolder, certificate_json

    if x.out is None and (x.open_report or x.force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    shared = x.workers is not None or x.cluster is not None
    with (
        open_executor(x.workers, x.cluster) if shared else nullcontext() as executor,
        nullcontext() if x.out is None else ResultFolder(x.out, force=x.force) as folder,
    ):
        from armcontour.studies.certification import certify
        from armcontour.studies.certification.certifying import goal_of

        with search_progress("certifying") as progress:
            job = open_job(file, job_options, subprogress(progress, "reading"), x)
            if shared:
                _refuse_nothing_shared(goal_of(job))
            found = certify(job, x.run_name, executor=executor, progress=progress)
        if folder is not None:
            _write(found, folder)
    if x.as_json:
        print(certificate_json(found), end="")
    else:
        _print(found, None if x.out is None else x.out / "report.html")
    if x.open_report and x.out is not None:
        open_page(x.out / "report.html")


def _refuse_nothing_shared(goal: CertificateGoal) -> None:
    """Refuse `--workers` and `--cluster` for a certificate that has no work for them.

    Raises:
        InvalidInput: No robots of a box are executed as rigid bodies.
    """
    from armcontour.core.errors import InvalidInput

    if goal.plant != "rigid_body" or goal.box is None:
        raise InvalidInput(
            "--workers and --cluster share robots of a box that are executed as rigid bodies, and "
            "this certificate executes none: leave them out, or give the job's certificate a box "
            "and plant: rigid_body."
        )


def _write(found: Certificate, folder: Any) -> None:
    """Write the plan, its set-points, the derating, the report and the summary."""
    from armcontour.cli.running import write_motions
    from armcontour.files import certificate_json, derating_csv
    from armcontour.report import render_report

    write_motions(folder, found.job, found.study.runs)
    folder.write("derating.csv", derating_csv(found))
    folder.write("report.html", render_report(found.study, certificate=found))
    folder.write("summary.json", certificate_json(found, [*folder.files, "summary.json"]))


def _print(found: Certificate, report: FilePath | None) -> None:
    """Print the certificate, beside the uncertified plan, with its notes and warnings."""
    from armcontour.core.render import compare, text
    from armcontour.core.result import TABLE

    console, data = Console(), found.to_data()
    for line in text(data).splitlines():
        console.say(line)
    header, *rows = compare(found.comparison, TABLE)
    console.show_table(["", *header[1:]], rows)
    for line in (*data.notes, *found.result.remarks):
        console.say(line)
    for line in data.warnings:
        console.say(f"Warning: {line}")
    for line in found.job.arm.notes:
        console.say(f"Note: {line}")
    if report is not None:
        console.say(f"Report: {report.resolve().as_uri()}")
