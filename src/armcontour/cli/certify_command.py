"""The command `certify`: certifies a job, and writes and prints the certificate."""

from __future__ import annotations

from armcontour import files, report
from armcontour.cli.commands import Certify
from armcontour.cli.console import table_lines
from armcontour.cli.execution import REPORT, Outcome
from armcontour.cli.inputs import open_job
from armcontour.cli.run_command import write_motions
from armcontour.core.progress import Progress
from armcontour.core.render import compare, text
from armcontour.core.result import TABLE
from armcontour.files.study_files import certificate_page
from armcontour.studies import certification


def certify(options: Certify, folder: files.ResultFolder | None, progress: Progress) -> Outcome:
    """Find the fastest plan whose execution stays within a tolerance."""
    job = open_job(options.job, options, progress)
    certificate = certification.certify(job, run=options.run_name, progress=progress)
    if folder is not None:
        write_motions(folder, job, certificate.study.runs)
        page = report.render_report(certificate.study, certificate=certificate)
        folder.write(REPORT, page)
    data = certificate.to_data()
    lines = [
        *text(data).splitlines(),
        *table_lines(compare(certificate.comparison, TABLE)),
        *data.notes,
        *certificate.result.remarks,
        *(f"Warning: {x}" for x in data.warnings),
        *(f"Note: {x}" for x in certificate.job.arm.notes),
    ]
    code = int(not certificate.kept)
    return Outcome(lines=lines, page=certificate_page(certificate), code=code)
