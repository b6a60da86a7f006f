"""Entry point `batch`: work on all jobs of a plan, and keep what comes of them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any

from armcontour._checks import IntArray
from armcontour._describing import digits, line_up, several
from armcontour._executors import Engine, open_engine, refuse_unclear
from armcontour._progress import Progress
from armcontour._warming import warm_for_run
from armcontour.batches.conducting import conduct
from armcontour.batches.folder import BatchFolder, blocks, look
from armcontour.batches.ledger import Ledger
from armcontour.batches.plan import Plan, read_plan
from armcontour.batches.working import Outcome, Work, work_on
from armcontour.errors import InvalidInput

# Results wait so long until they are written [s], and so many. With the chunks that are in work and
# the time between two looks, a batch that is killed loses less than 5 s.
EVERY, ROWS = 2.5, 1000
# The page is written so often at most [s], and takes at most this share of the time.
PAGE_EVERY, PAGE_SHARE = 10.0, 0.02


@dataclass(frozen=True, slots=True)
class Tally:
    """How far a batch is.

    Args:
        total: Number of its jobs, or of those of its shard.
        done: How many of them have a result.
        before: How many of them had one when the batch started.
        seconds: Time since then [s].
        statuses: Number of the jobs since then by what came of them.
        errors: Number of the jobs since then by the name of their error.
        workers: Where the work is done.
    """

    total: int
    done: int
    before: int
    seconds: float
    statuses: Mapping[str, int]
    errors: Mapping[str, int]
    workers: str

    def __str__(self) -> str:
        """How many jobs are done, how fast, and what came of them."""
        left = "" if self.left is None else f", {digits(self.left)} s left"
        return line_up(
            f"{self.done} of {several(self.total, 'job')} done",
            [
                ("rate", f"{digits(self.rate)} jobs/s{left}"),
                ("results", ", ".join(f"{n} {x}" for x, n in self.statuses.items())),
                ("errors", ", ".join(f"{n} {x}" for x, n in self.errors.items())),
                ("workers", self.workers),
            ],
        )

    @property
    def rate(self) -> float:
        """Jobs in a second; 0 at the start."""
        return (self.done - self.before) / self.seconds if self.seconds > 0 else 0.0

    @property
    def left(self) -> float | None:
        """Time left at this rate [s]; None if unknown."""
        return (self.total - self.done) / self.rate if self.rate > 0 else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """Results of many jobs.

    Args:
        plan: The plan.
        folder: The folder with its results.
        counts: Number of jobs by their status: "done", "refused", "failed", "killed", "timed out",
            "out of memory".
        errors: Number of jobs by the name of their error.
    """

    plan: Plan
    folder: FilePath
    counts: Mapping[str, int]
    errors: Mapping[str, int]
    # Where each result stands; made when that is asked for.
    _ledger: Ledger | None = field(default=None, init=False, repr=False)

    @property
    def complete(self) -> bool:
        """Whether all jobs have a result; other shards may be at work."""
        return sum(self.counts.values()) == len(self.plan)

    def rows(self) -> Iterator[dict[str, Any]]:
        """The results, in the order of the jobs: values by the names of the columns."""
        for block in self.blocks():
            for row in zip(*block.values(), strict=True):
                yield dict(zip(block, row, strict=True))

    def table(self) -> dict[str, list[Any]]:
        """The results as columns, by their names."""
        found: dict[str, list[Any]] = {}
        for block in self.blocks():
            for name, values in block.items():
                found.setdefault(name, []).extend(values)
        return found

    def blocks(self) -> Iterator[dict[str, list[Any]]]:
        """The results as columns, some thousand jobs at a time."""
        ledger = self._ledger or Ledger(self.plan)
        object.__setattr__(self, "_ledger", ledger)
        look(self.folder, ledger)
        return blocks(ledger)

    def __str__(self) -> str:
        """What came of the jobs."""
        missing = len(self.plan) - sum(self.counts.values())
        return line_up(
            f"Batch {self.plan.name}: {several(len(self.plan), 'job')}",
            [
                *((status, str(n)) for status, n in self.counts.items()),
                ("without a result", str(missing) if missing else ""),
                *((f"error {name}", str(n)) for name, n in self.errors.items()),
                ("folder", str(self.folder)),
            ],
        )

    def __repr__(self) -> str:
        """Name, number of jobs and what came of them."""
        counts = ", ".join(f"{n} {x}" for x, n in self.counts.items())
        return f"Batch({self.plan.name!r}, {len(self.plan)} jobs: {counts or 'none done'})"


def batch(
    plan: str | FilePath | Mapping[str, Any],
    out: str | FilePath,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    executor: Executor | None = None,
    shard: tuple[int, int] | None = None,
    retry: bool = False,
    trust_xacro: bool = False,
    progress: Callable[[Tally], None] | None = None,
    compiling: Progress | None = None,
) -> Batch:
    """Work on all jobs of a plan; an interrupted batch goes on where it was.

    What a job cannot do is a result too: a row with the error's sentence. Results are on the disk
    at most 5 s after they are there, in `parts`, and in one file when all jobs have one.

    Args:
        plan: A plan file (YAML), or its data; the guide on batches explains its keys.
        out: The folder for results: a new one, or that of an earlier run of this plan.
        workers: Number of processes on this machine; by default one a processor. 0 works in this
            process, where no job can be ended from outside.
        cluster: Address of a Dask scheduler whose workers do the work.
        executor: An executor of your own that does it, with so many `workers`.
        shard: Number of a part of the jobs, from 1, and number of all parts, such as (3, 64): work
            on this part only. Several may write to one folder at the same time.
        retry: Whether jobs are tried again that are neither done nor refused.
        trust_xacro: Whether arms may be .xacro files, which are programs.
        progress: Called now and then with how far the batch is.
        compiling: Called while functions are compiled, before the work starts.

    Raises:
        InvalidInput: A wrong plan, two jobs that are the same, or a folder with other files.
        ExecutionError: The executor takes no work; what is done stays done.
    """
    refuse_unclear(workers, cluster, executor)
    part = _read_shard(shard)
    found = read_plan(plan, trust_xacro=trust_xacro)
    ledger = Ledger(found)
    with BatchFolder(FilePath(out), ledger, part) as folder:
        folder.look()
        todo = ledger.todo(part, retry=retry)
        if len(todo):
            folder.reopen()
            dimensions = _warm(found, compiling)
            with open_engine(workers=workers, cluster=cluster, executor=executor) as engine:
                recorder = _Recorder(folder, engine, len(todo), progress)
                _work(found, todo, engine, work_on(found, engine, dimensions), recorder)
        folder.finish()
        result = Batch(
            plan=found, folder=folder.folder, counts=ledger.counts(), errors=ledger.errors()
        )
        object.__setattr__(result, "_ledger", ledger)
        return result


def _read_shard(shard: tuple[int, int] | None) -> tuple[int, int]:
    """Number of a shard, from 0, and number of all.

    Raises:
        InvalidInput: There is no such shard.
    """
    if shard is None:
        return 0, 1
    number, count = shard
    if not 1 <= number <= count:
        raise InvalidInput(
            f"There is no shard {number} of {count}: shards are counted from 1, such as 3/64."
        )
    return number - 1, count


def _warm(plan: Plan, compiling: Progress | None) -> list[int]:
    """Compile what the jobs need, before several processes want it; returns arms' dimensions."""
    dimensions = sorted({x.dimension for x in plan.bases})
    for x in dimensions:
        warm_for_run(x, compiling or (lambda step: None))
    return dimensions


def _work(plan: Plan, todo: IntArray, engine: Engine, work: Work, recorder: _Recorder) -> None:
    """Have the jobs done that have no result; what came of them is kept after an error too."""
    try:
        conduct(
            engine.executor,
            work,
            ((k, (plan.base(k), plan.values(k))) for k in map(int, todo)),
            workers=engine.workers,
            take=recorder.take,
            tick=recorder.tick,
            time=plan.time,
        )
    finally:
        recorder.close()


class _Recorder:
    """Writes outcomes to parts, and tells how far the batch is.

    Args:
        folder: The folder of the batch.
        engine: Where the work is done.
        left: Number of jobs without a result.
        progress: Called with how far the batch is.
    """

    def __init__(
        self,
        folder: BatchFolder,
        engine: Engine,
        left: int,
        progress: Callable[[Tally], None] | None,
    ) -> None:
        self._folder, self._engine, self._progress = folder, engine, progress
        self._total = folder.total
        self._before = self._total - left
        self._done = 0
        self._statuses, self._errors = Counter[str](), Counter[str]()
        self._waiting: list[tuple[int, Outcome]] = []
        self._begin = self._written = self._paged = time.monotonic()
        self._page_took = 0.0

    def take(self, index: int, outcome: Outcome) -> None:
        """Take what came of a job."""
        self._waiting.append((index, outcome))
        self._done += 1
        self._statuses[outcome.status] += 1
        if outcome.error is not None:
            self._errors[outcome.error] += 1
        if len(self._waiting) >= ROWS:
            self._write()

    def tick(self) -> None:
        """Write what has waited long enough, and tell how far the batch is."""
        now = time.monotonic()
        if now - self._written >= EVERY:
            self._write()
        if self._progress is not None:
            self._progress(self.tally)
        if now - self._paged >= max(PAGE_EVERY, self._page_took / PAGE_SHARE):
            self._page()

    def close(self) -> None:
        """Write what is left."""
        self._write()
        if self._progress is not None:
            self._progress(self.tally)

    @property
    def tally(self) -> Tally:
        """How far the batch is."""
        return Tally(
            total=self._total,
            done=self._before + self._done,
            before=self._before,
            seconds=time.monotonic() - self._begin,
            statuses=dict(self._statuses),
            errors=dict(self._errors.most_common()),
            workers=self._engine.name,
        )

    def _write(self) -> None:
        """Write a part."""
        if self._waiting:
            self._folder.write(self._waiting)
            self._waiting = []
        self._written = time.monotonic()

    def _page(self) -> None:
        """Write the page of the results so far."""
        begin = time.monotonic()
        self._folder.show(self.tally.left)
        self._paged = time.monotonic()
        self._page_took = self._paged - begin
