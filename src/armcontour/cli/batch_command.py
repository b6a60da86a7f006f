"""The command `batch`: runs a job for all combinations of values of its keys."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import Console

if TYPE_CHECKING:
    from armcontour.cli.options import BatchOptions, JobOptions


def batch_file(
    file: FilePath, out: FilePath, job_options: JobOptions, options: BatchOptions
) -> int:
    """Run all jobs, print and write their results; returns the exit code, 1 if some jobs failed."""
    from armcontour.cli.inputs import find_file, name_options, read_patch
    from armcontour.cli.progress_bars import share_progress
    from armcontour.core import staging
    from armcontour.core.errors import InvalidInput, error_context
    from armcontour.files import parse_set
    from armcontour.files.batch import FAILED, batch
    from armcontour.report import render_table

    patch, names = read_patch(job_options)
    over = {keys: [value] for keys, value in patch.items()}
    for text in options.over:
        with error_context("--over"):
            [(keys, values)] = parse_set(text).items()
            if not isinstance(values, list) or not values:
                raise InvalidInput(f"{text} has no list. Write 'KEY=[VALUE, VALUE]'.")
        over[keys] = values
    with share_progress() as progress, name_options(names):
        result = batch(
            find_file(file, job_options.cell),
            over,
            out,
            cell=job_options.cell,
            workers=options.workers,
            progress=progress,
        )
    header, *rows = result.cells()
    counts = ", ".join(f"{n} {status}" for status, n in result.counts.items())
    errors = [x.error for x in result.rows]
    if any(errors):
        header, rows = (*header, ""), [(*x, y) for x, y in zip(rows, errors, strict=True)]
    page = render_table(f"Batch of {result.title}", counts, header, rows)
    report = (out / "report.html").resolve()
    staging.write_atomically(report, lambda x: x.write_text(page, encoding="utf-8"))
    console = Console()
    header, *rows = result.cells()
    whole = range(1 + len(over))
    console.show_table(header, rows, title=f"{result.title}: {counts}", whole=whole)
    for line in result.errors():
        console.print(line)
    console.print(f"Table: {out / 'results.csv'}")
    console.print(f"Report: {report.as_uri()}")
    return int(FAILED in result.counts)
