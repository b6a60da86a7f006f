"""The command `certify`: certifies a job, and prints and writes the certificate."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import print_lines, show_table
from armcontour.core.progress import subprogress

if TYPE_CHECKING:
    from armcontour.cli.options import CertifyOptions, JobOptions
    from armcontour.studies.certification import Certificate


def certify_file(file: FilePath, job_options: JobOptions, options: CertifyOptions) -> int:
    """Certify a job, print and write the certificate; return 1 if it is not kept, else 0."""
    from armcontour.cli.inputs import open_job
    from armcontour.cli.progress_bars import show_progress
    from armcontour.core.errors import InvalidInput
    from armcontour.files import ResultFolder, certificate_json

    if options.out is None and options.force:
        raise InvalidInput("--force requires --out, the folder for the report.")
    with (
        nullcontext()
        if options.out is None
        else ResultFolder(options.out, force=options.force) as folder
    ):
        from armcontour.studies.certification import certify

        with show_progress("certifying") as progress:
            job = open_job(file, job_options, subprogress(progress, "reading"), options)
            certificate = certify(job, run=options.run_name, progress=progress)
        if folder is not None:
            _write(certificate, folder)
    if options.as_json:
        print(certificate_json(certificate), end="")
    else:
        _print_certificate(
            certificate, None if options.out is None else options.out / "report.html"
        )
    return int(not certificate.kept)


def _write(certificate: Certificate, folder: Any) -> None:
    """Write plan, set-points, report and summary of a certificate to a folder."""
    from armcontour.cli.run_command import write_motions
    from armcontour.files import certificate_json
    from armcontour.report import render_report

    write_motions(folder, certificate.job, certificate.study.runs)
    folder.write("report.html", render_report(certificate.study, certificate=certificate))
    folder.write("summary.json", certificate_json(certificate, [*folder.files, "summary.json"]))


def _print_certificate(certificate: Certificate, report: FilePath | None) -> None:
    """Print the certificate and its comparison with the uncertified plan, notes and warnings."""
    from armcontour.core.render import compare, text
    from armcontour.core.result import TABLE

    data = certificate.to_data()
    print_lines(*text(data).splitlines())
    header, *rows = compare(certificate.comparison, TABLE)
    show_table(["", *header[1:]], rows)
    print_lines(*data.notes, *certificate.result.remarks)
    print_lines(*(f"Warning: {x}" for x in data.warnings))
    print_lines(*(f"Note: {x}" for x in certificate.job.arm.notes))
    if report is not None:
        print_lines(f"Report: {report.resolve().as_uri()}")
