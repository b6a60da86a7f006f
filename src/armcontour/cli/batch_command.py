"""The command `batch`: runs all jobs of a plan, and shows progress and results."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import Console, open_page
from armcontour.cli.progress_bars import batch_progress

if TYPE_CHECKING:
    from armcontour.batches import Batch, BatchProgress
    from armcontour.cli.options import BatchOptions
    from armcontour.core.progress import Progress

# Minimum time between two progress lines of JSON [s].
EVERY = 1.0


def batch_file(plan: FilePath, out: FilePath, options: BatchOptions) -> int:
    """Run all jobs of a plan; returns the exit code, 1 if some jobs failed."""
    from armcontour.batches import batch

    with _shown(options.as_json) as (progress, compiling):
        result = batch(
            plan,
            out,
            workers=options.workers,
            cluster=options.cluster,
            retry=options.retry,
            progress=progress,
            compiling=compiling,
        )
    report = (out / "report.html").resolve()
    if options.as_json:
        _print_json({"end": _end(result)})
    else:
        _print_batch(result, report)
    if options.open_report and report.exists():
        open_page(report)
    return int("failed" in result.counts)


@contextmanager
def _shown(as_json: bool) -> Iterator[tuple[Callable[[BatchProgress], None], Progress]]:
    """Context that shows progress as a bar or as JSON; yields the functions that update it."""
    if not as_json:
        with batch_progress() as functions:
            yield functions
        return
    last = -EVERY

    def say(progress: BatchProgress) -> None:
        nonlocal last
        if progress.seconds - last >= EVERY or progress.done == progress.total:
            last = progress.seconds
            _print_json({"progress": describe(progress)})

    yield say, lambda step: None


def describe(progress: BatchProgress) -> dict[str, object]:
    """Progress of a batch as a mapping for JSON."""
    return {
        "done": progress.done,
        "total": progress.total,
        "before": progress.before,
        "seconds": round(progress.seconds, 3),
        "rate": round(progress.rate, 4),
        "left": None if progress.left is None else round(progress.left, 1),
        "statuses": progress.statuses,
        "errors": progress.errors,
    }


def _end(batch: Batch) -> dict[str, object]:
    """Result of a batch as a mapping for JSON."""
    return {
        "batch": batch.plan.name,
        "folder": str(batch.folder),
        "statuses": dict(batch.counts),
        "errors": dict(batch.errors),
    }


def _print_json(data: object) -> None:
    """Print data as a line of JSON."""
    sys.stdout.write(json.dumps(data) + "\n")
    sys.stdout.flush()


def _print_batch(batch: Batch, report: FilePath) -> None:
    """Print the numbers of jobs and errors of a batch, and the address of its report."""
    console = Console()
    rows = [[name, str(n)] for name, n in batch.counts.items()]
    console.show_table(["jobs", "number"], rows, title=f"{batch.plan.name}: {len(batch.plan)} jobs")
    for name, n in batch.errors.items():
        console.print(f"{name}: {n}")
    console.print(f"Report: {report.as_uri()}")
