"""The command `place`: finds the best placement of the part of a job."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import Console, open_page
from armcontour.core.progress import subprogress

if TYPE_CHECKING:
    from armcontour.cli.options import JobOptions, PlaceOptions
    from armcontour.studies.placement import Placement

# File name of the job in its best placement.
JOB = "job.yaml"


def place_file(
    file: FilePath, out: FilePath, job_options: JobOptions, options: PlaceOptions
) -> None:
    """Place a job, print the best placement, and write maps, a table and the placed job."""
    from armcontour.cli.inputs import open_job
    from armcontour.cli.progress_bars import share_progress
    from armcontour.core.errors import InvalidInput
    from armcontour.core.pool import open_executor
    from armcontour.files import ResultFolder, placement_csv, placement_json
    from armcontour.studies.placement import place

    # By default, `place` uses several processes if there are many placements.
    by_number = options.workers is None
    with (
        nullcontext() if by_number else open_executor(options.workers) as executor,
        ResultFolder(out, force=options.force) as folder,
    ):
        from armcontour.report import render_placement

        with share_progress() as progress:
            job = open_job(file, job_options, subprogress(progress, "reading"), options)
            if job.placement is None or not job.placement.over:
                raise InvalidInput(
                    "place requires --over for each axis of the search, such as 'x: -300 mm .. 300 "
                    "mm, 25', or the key placement.over of the job."
                )
            placement = place(job, run=options.run_name, executor=executor, progress=progress)
        folder.write("report.html", render_placement(placement))
        folder.write("placement.csv", placement_csv(placement))
        unwritten = ""
        try:
            folder.write(JOB, _job_text(placement, file, out, job_options))
        except InvalidInput as error:
            unwritten = str(error)
        files = [*folder.files, "summary.json"]
        folder.write("summary.json", placement_json(placement, files))
    report = (out / "report.html").resolve()
    _print_placement(placement, report, None if unwritten else out / JOB, unwritten)
    if options.open_report:
        open_page(report)


def _job_text(placement: Placement, file: FilePath, out: FilePath, options: JobOptions) -> str:
    """Text of the job file with the part in its best placement."""
    from armcontour.cli.inputs import is_job, read_patch
    from armcontour.files import placed_job_text
    from armcontour.files.cell import drawing_text
    from armcontour.files.job_file import job_text

    if is_job(file):
        text, folder = job_text(file), file.parent
    else:
        text, folder = drawing_text(str(options.cell), file, out), out
    patch, _ = read_patch(options)
    return placed_job_text(placement, text, folder=folder, to=out, patch=patch)


def _print_placement(
    placement: Placement, report: FilePath, job: FilePath | None, unwritten: str
) -> None:
    """Print the best placement, its comparison with the original one, notes and written files."""
    from armcontour.core.render import compare, text
    from armcontour.core.result import TABLE

    console = Console()
    for line in text(placement.to_data()).splitlines():
        console.print(line)
    header, *rows = compare(placement.comparison, TABLE, texts=True)
    console.show_table(["", *header[1:]], rows)
    notes = [*placement.notes, *placement.job.arm.notes, *([unwritten] if unwritten else [])]
    for note in notes:
        console.print(f"Note: {note}")
    if job is not None:
        console.print(f"Job: {job}")
    console.print(f"Report: {report.as_uri()}")
