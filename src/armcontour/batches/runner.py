"""`batch`, which runs all jobs of a plan and stores their results."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any

from armcontour.batches.outcomes import Outcome, Results, Work, process_ended
from armcontour.batches.plan import Plan, read_plan
from armcontour.core.compilation import compile_kernels
from armcontour.core.fields import checked
from armcontour.core.pool import InProcess, TaskQueue, open_executor
from armcontour.core.progress import Progress
from armcontour.core.text import count_noun, digits, format_table


@dataclass(frozen=True, slots=True)
class BatchProgress:
    """Progress of a batch.

    Args:
        total: Number of jobs of the batch.
        done: Number of jobs with a result.
        before: Number of jobs with a result when the batch started.
        seconds: Time since the start [s].
        statuses: Number of the jobs since the start, by status.
        errors: Number of the jobs since the start, by name of the error.
    """

    total: int
    done: int
    before: int
    seconds: float
    statuses: Mapping[str, int]
    errors: Mapping[str, int]

    def __str__(self) -> str:
        """Number of finished jobs, rate, remaining time and results."""
        remaining = "" if self.left is None else f", {digits(self.left)} s left"
        return format_table(
            f"{self.done} of {count_noun(self.total, 'job')} done",
            [
                ("rate", f"{digits(self.rate)} jobs/s{remaining}"),
                ("results", ", ".join(f"{n} {x}" for x, n in self.statuses.items())),
                ("errors", ", ".join(f"{n} {x}" for x, n in self.errors.items())),
            ],
        )

    @property
    def rate(self) -> float:
        """Finished jobs per second since the start of the batch; 0 at the start."""
        return (self.done - self.before) / self.seconds if self.seconds > 0 else 0.0

    @property
    def left(self) -> float | None:
        """Remaining time at the present rate [s]; None if the rate is 0."""
        return (self.total - self.done) / self.rate if self.rate > 0 else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """Results of many jobs.

    Args:
        plan: The plan.
        folder: The folder with the results.
        rows: Results in the order of the jobs: values by column.
    """

    plan: Plan
    folder: FilePath
    rows: Sequence[Mapping[str, Any]] = field(repr=False)

    @property
    def counts(self) -> dict[str, int]:
        """Number of jobs by their status: "done", "refused" or "failed"."""
        return dict(Counter(x["status"] for x in self.rows))

    @property
    def errors(self) -> dict[str, int]:
        """Number of jobs by the name of their error, the most frequent first."""
        return dict(Counter(x["error"] for x in self.rows if x["error"]).most_common())

    def table(self) -> dict[str, list[Any]]:
        """Columns of the results: a list of values per column name."""
        return {name: [x[name] for x in self.rows] for name in self.rows[0]}

    def __str__(self) -> str:
        """Numbers of jobs by status and error, and the folder."""
        return format_table(
            f"Batch {self.plan.name}: {count_noun(len(self.plan), 'job')}",
            [
                *((status, str(n)) for status, n in self.counts.items()),
                *((f"error {name}", str(n)) for name, n in self.errors.items()),
                ("folder", str(self.folder)),
            ],
        )

    def __repr__(self) -> str:
        """Name, number of jobs and numbers by status."""
        counts = ", ".join(f"{n} {x}" for x, n in self.counts.items())
        return f"Batch({self.plan.name!r}, {len(self.plan)} jobs: {counts})"


@checked
def batch(
    plan: str | FilePath | Mapping[str, Any],
    out: str | FilePath,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    executor: Executor | None = None,
    retry: bool = False,
    progress: Callable[[BatchProgress], None] | None = None,
    compiling: Progress | None = None,
) -> Batch:
    """Run all jobs of a plan; an interrupted batch continues.

    An error of a job is a result, too: a row with the message. Each row is written to the file
    `results.jsonl` as soon as it exists; table and page are written when all jobs have a result.

    >>> done = ac.batch("plan.yaml", "out", workers=0)
    >>> [row["status"] for row in done.rows]
    ['done']

    Args:
        plan: A plan file (YAML), or its data; the guide on batches explains its keys.
        out: Folder for the results: a new one, or that of an earlier run of this plan.
        workers: Number of processes on this machine; by default one per processor. 0 works in
            this process.
        cluster: Address of a Dask scheduler whose workers run the jobs.
        executor: Your own executor.
        retry: Whether failed jobs are repeated.
        progress: Called after each job with the progress of the batch.
        compiling: Called while functions are compiled, before the work starts.

    Raises:
        InvalidInput: A wrong plan, two equal jobs, or a folder with other files.
        ExecutionError: The executor accepts no work, or lost its workers; finished results remain.
    """
    parsed = read_plan(plan)
    with (
        open_executor(workers, cluster, executor) as opened,
        Results(FilePath(out), parsed) as results,
    ):
        remaining = results.remaining(retry=retry)
        if remaining:
            if not isinstance(opened, InProcess):
                # Compile here first; otherwise several processes would compile the same functions.
                for dimension in {x.dimension for x in parsed.bases}:
                    compile_kernels("plane" if dimension == 2 else "space", compiling)
            _work(parsed, remaining, opened, results, progress or (lambda tally: None))
        return Batch(plan=parsed, folder=results.folder, rows=results.finish())


def _work(
    plan: Plan,
    remaining: Sequence[int],
    executor: Executor,
    results: Results,
    progress: Callable[[BatchProgress], None],
) -> None:
    """Run the jobs with the indices `remaining`, and store their outcomes."""
    statuses, errors = Counter[str](), Counter[str]()
    before, begin = len(plan) - len(remaining), time.monotonic()
    with TaskQueue[int, Outcome](Work(plan), executor, process_ended) as queue:
        waiting = iter(remaining)
        while statuses.total() < len(remaining):
            while len(queue) < queue.ahead and (index := next(waiting, None)) is not None:
                queue.give(index)
            for index, outcome in queue.take():
                results.add(index, outcome)
                statuses[outcome.status] += 1
                if outcome.error is not None:
                    errors[outcome.error] += 1
                progress(
                    BatchProgress(
                        total=len(plan),
                        done=before + statuses.total(),
                        before=before,
                        seconds=time.monotonic() - begin,
                        statuses=dict(statuses),
                        errors=dict(errors.most_common()),
                    )
                )
