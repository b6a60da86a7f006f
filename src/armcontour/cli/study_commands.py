"""The commands `place` and `batch`: many plans or runs of one job."""

from __future__ import annotations

import re
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated

import typer

from armcontour.cli.console import print_lines, print_report, show_table
from armcontour.cli.inputs import (
    find_file,
    is_job,
    name_options,
    open_job,
    read_option,
    read_patch,
)
from armcontour.cli.options import BatchOptions, JobOptions, JobOrDrawing, Out, PlaceOptions
from armcontour.cli.program import PREPARE, RUN, command
from armcontour.cli.progress_bars import show_progress

if TYPE_CHECKING:
    from armcontour.core.checks import FloatArray
    from armcontour.studies.placement import Placement

# File name of the job in its best place.
JOB = "job.yaml"


@command(PREPARE, "place gasket.dxf --cell ur5e --x '-300 mm .. 300 mm, 25' --out place")
def place(job: JobOrDrawing, out: Out, job_options: JobOptions, options: PlaceOptions) -> int:
    """Plan a job at every place of a grid of its part: writes a map, a table, and the best job.

    Exit codes: 0 done, 1 done but no place is feasible; others as for errors.
    """
    from armcontour.core.errors import InvalidInput
    from armcontour.files import ResultFolder, placement_csv
    from armcontour.files.result_folder import data_json
    from armcontour.studies import placement as study

    texts = {name: getattr(options, name) for name in study.AXES}
    grid = {name: read_axis(name, x) for name, x in texts.items() if x is not None}
    if not grid:
        raise InvalidInput(
            "place requires an axis of the grid, such as --x '-300 mm .. 300 mm, 25'."
        )
    with ResultFolder(out, force=options.force) as folder:
        from armcontour.report import render_placement

        with show_progress() as progress:
            opened = open_job(job, job_options, progress)
            placement = study.place(
                opened,
                grid,
                move=options.move,
                run=options.run_name,
                processes=1 if options.workers == 0 else options.workers,
                progress=progress,
            )
        folder.write("report.html", render_placement(placement))
        folder.write("placement.csv", placement_csv(placement))
        notes = [*placement.to_data().notes, *opened.arm.notes]
        if placement.best is not None:
            try:
                folder.write(JOB, _job_text(placement, job, out, job_options))
            except InvalidInput as error:
                notes.append(str(error))
        data = placement.to_data([*folder.files, "summary.json"])
        folder.write("summary.json", data_json(data))
    print_lines(*str(placement).splitlines(), *(f"Note: {x}" for x in notes))
    if JOB in folder.files:
        print_lines(f"Job: {out / JOB}")
    print_report(out)
    return int(placement.best is None)


def read_axis(name: str, text: str) -> FloatArray:
    """Read an axis such as "-300 mm .. 300 mm, 25"; a whole turn omits the last value."""
    import numpy as np

    from armcontour.core.errors import InvalidInput
    from armcontour.core.quantities import Angle, Length

    option, kind = f"--{name}", Angle if name == "yaw" else Length
    match = re.fullmatch(r"(.+?)\.\.(.+),\s*([1-9]\d{0,5})", text.strip())
    if match is None:
        raise InvalidInput(
            f"{option} requires a range and a number of values, such as '-300 mm .. 300 mm, 25', "
            f"not {text!r}."
        )
    low, high = (read_option(option, x, kind) or 0.0 for x in match.groups()[:2])
    whole = name == "yaw" and abs(abs(high - low) - 2 * np.pi) < 1e-9
    # Without rounding, steps have rounding errors, for example at 0.
    return np.round(np.linspace(low, high, int(match[3]), endpoint=not whole), 12) + 0.0


def _job_text(placement: Placement, file: FilePath, out: FilePath, options: JobOptions) -> str:
    """Text of the job file with the part in its best place."""
    from armcontour.files import placed_job_text
    from armcontour.files.cell import drawing_text
    from armcontour.files.job_file import job_text

    if is_job(file):
        text, folder = job_text(file), file.parent
    else:
        text, folder = drawing_text(str(options.cell), file, out), out
    patch, _ = read_patch(options)
    return placed_job_text(placement, text, folder=folder, to=out, patch=patch)


@command(RUN, "batch job.yaml --over 'corners.tolerance=[0.1 mm, 1 mm]' --out results")
def batch(
    job: JobOrDrawing,
    out: Annotated[
        FilePath,
        typer.Option("--out", "-o", help="New folder for the results."),
    ],
    options: BatchOptions,
    job_options: JobOptions,
) -> int:
    """Run a job for all combinations of values of its keys.

    Exit codes: 0 every job is done or refused; 1 some jobs failed; 2 no job is valid.
    """
    from armcontour.core import staging
    from armcontour.core.errors import InvalidInput, error_context
    from armcontour.files import batch as study
    from armcontour.files import parse_set
    from armcontour.report import render_table

    patch, names = read_patch(job_options)
    over = {keys: [value] for keys, value in patch.items()}
    for text in options.over:
        with error_context("--over"):
            [(keys, values)] = parse_set(text).items()
            if not isinstance(values, list) or not values:
                raise InvalidInput(f"{text} has no list. Write 'KEY=[VALUE, VALUE]'.")
        over[keys] = values
    with show_progress() as progress, name_options(names):
        result = study.batch(
            find_file(job, job_options.cell),
            over,
            out,
            cell=job_options.cell,
            workers=options.workers,
            progress=progress,
        )
    header, *rows = cells = result.cells()
    counts = ", ".join(f"{n} {status}" for status, n in result.counts.items())
    errors = [x.error for x in result.rows]
    if any(errors):
        header, rows = (*header, ""), [(*x, y) for x, y in zip(rows, errors, strict=True)]
    page = render_table(f"Batch of {result.title}", counts, header, rows)
    report = out / "report.html"
    staging.write_atomically(report, lambda x: x.write_text(page, encoding="utf-8"))
    show_table(cells[0], cells[1:], title=f"{result.title}: {counts}", names=1 + len(over))
    print_lines(*result.errors(), f"Table: {out / 'results.csv'}")
    print_report(out)
    return int(study.FAILED in result.counts)
