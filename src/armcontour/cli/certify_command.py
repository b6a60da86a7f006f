"""The command `certify`: certifies a job, and prints and writes the certificate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from armcontour.cli.console import print_lines, print_report, result_folder, show_table
from armcontour.cli.inputs import open_job
from armcontour.cli.options import CertifyOptions, JobOptions, JobOrDrawing
from armcontour.cli.program import JUDGE, command
from armcontour.cli.progress_bars import show_progress

if TYPE_CHECKING:
    from armcontour.studies.certification import Certificate


@command(JUDGE, "certify job.yaml --total-tolerance '1 mm' --out certificate")
def certify(job: JobOrDrawing, job_options: JobOptions, options: CertifyOptions) -> int:
    """Find the fastest plan whose execution stays within a tolerance; exit code 4 without one."""
    from armcontour.files import certificate_json

    with result_folder(options) as folder:
        from armcontour.studies import certification

        with show_progress("certifying") as progress:
            opened = open_job(job, job_options, progress, options)
            certificate = certification.certify(opened, run=options.run_name, progress=progress)
        if folder is not None:
            _write(certificate, folder)
    if options.as_json:
        print(certificate_json(certificate), end="")
    else:
        _print(certificate)
        if options.out is not None:
            print_report(options.out)
    return int(not certificate.kept)


def _write(certificate: Certificate, folder: Any) -> None:
    """Write plan, set-points, report and summary of a certificate to a folder."""
    from armcontour.cli.run_command import write_motions
    from armcontour.files import certificate_json
    from armcontour.report import render_report

    write_motions(folder, certificate.job, certificate.study.runs)
    folder.write("report.html", render_report(certificate.study, certificate=certificate))
    folder.write("summary.json", certificate_json(certificate, [*folder.files, "summary.json"]))


def _print(certificate: Certificate) -> None:
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
