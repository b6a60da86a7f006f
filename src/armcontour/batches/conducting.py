"""Has an executor work on many jobs: in chunks, with retries of what is not a job's own fault."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass
from itertools import islice
from typing import Any

from armcontour._executors import Watch, is_lost, is_out_of_memory, not_able
from armcontour._process import ProcessEnded
from armcontour.batches.working import (
    RETRIED,
    Item,
    Outcome,
    killed,
    out_of_memory,
    timed_out,
)
from armcontour.errors import ExecutionError

# Work of a chunk [s]: sending one takes about a millisecond, and a lost one is soon done again.
CHUNK = 0.5
# Largest number of jobs in a chunk.
MOST = 1000
# Chunks for each worker that are under way: one in work, one that waits.
AHEAD = 2
# How much the last chunk counts in the mean time of a job.
NEWEST = 0.3
# How often a job is tried, if its process ends, it does not end or memory runs out.
TRIES = 3

Numbered = tuple[int, Item]


@dataclass
class _Chunk:
    """Jobs that are sent together, all tried equally often before."""

    jobs: Sequence[Numbered]
    tries: int = 0


def conduct(
    executor: Executor,
    work: Callable[[Sequence[Item]], list[Outcome]],
    jobs: Iterable[Numbered],
    *,
    workers: int,
    take: Callable[[int, Outcome], None],
    tick: Callable[[], None] = lambda: None,
    time: float | None = None,
) -> None:
    """Have an executor work on jobs.

    A job whose process ends, whose time is over or whose memory runs out is tried again, alone in
    the end, so that it costs only itself.

    Args:
        executor: Where the work is done.
        work: The work on some jobs; it can be pickled.
        jobs: The jobs with their numbers.
        workers: Number of workers of the executor.
        take: Called with the number of a job and what came of it, in any order.
        tick: Called now and then, after what was done was taken.
        time: Longest time of one job [s]; None without a bound.

    Raises:
        ExecutionError: The executor takes no work, its workers cannot do any, or none is left.
    """
    watch = Watch(executor)
    left, again = iter(jobs), deque[_Chunk]()
    away: dict[Future[list[Outcome]], _Chunk] = {}
    mean = CHUNK
    while True:
        while len(away) < AHEAD * workers:
            size = max(1, int(min(MOST, CHUNK / max(mean, CHUNK / MOST))))
            chunk = again.popleft() if again else _Chunk(list(islice(left, size)))
            if not chunk.jobs:
                break
            away[_submit(executor, work, chunk)] = chunk
        if not away:
            return
        for future in watch.wait(away):
            chunk = away.pop(future)
            error = _lost(future)
            if error is None:
                outcomes = future.result()
                again += _settle(chunk, outcomes, take)
                each = sum(x.seconds for x in outcomes) / len(outcomes)
                mean += NEWEST * (each - mean)
            else:
                again += _split(chunk, error, time, take)
        tick()


def _submit(
    executor: Executor, work: Callable[[Sequence[Item]], list[Outcome]], chunk: _Chunk
) -> Future[list[Outcome]]:
    """Give a chunk to the executor."""
    try:
        return executor.submit(work, [item for _, item in chunk.jobs])
    except (BrokenExecutor, RuntimeError, OSError) as error:
        raise ExecutionError(
            f"The executor takes no more jobs ({type(error).__name__}: {error}): what is done "
            "stays done, so start the batch again, and it goes on."
        ) from None


def _lost(future: Future[Any]) -> BaseException | None:
    """Why a chunk has no outcomes; None if it has.

    Raises:
        ExecutionError: Its worker cannot work on jobs at all.
    """
    try:
        future.result()
    except (Exception, CancelledError) as error:
        if is_lost(error):
            return error
        if is_out_of_memory(error):
            return MemoryError()
        raise not_able(error) from None
    return None


def _settle(
    chunk: _Chunk, outcomes: Sequence[Outcome], take: Callable[[int, Outcome], None]
) -> list[_Chunk]:
    """Take what came of the jobs of a chunk; returns those to be tried again."""
    again = []
    for job, outcome in zip(chunk.jobs, outcomes, strict=True):
        tries = chunk.tries + 1
        if outcome.status in RETRIED and tries < TRIES:
            again.append(_Chunk([job], tries))
        else:
            take(job[0], outcome._replace(tries=tries))
    return again


def _split(
    chunk: _Chunk, error: BaseException, time: float | None, take: Callable[[int, Outcome], None]
) -> list[_Chunk]:
    """Halves of a chunk that was lost; a single job is tried again, or given up."""
    if len(chunk.jobs) > 1:
        middle = len(chunk.jobs) // 2
        return [_Chunk(chunk.jobs[:middle], chunk.tries), _Chunk(chunk.jobs[middle:], chunk.tries)]
    outcome = killed()
    after = error.after if isinstance(error, ProcessEnded) else None
    if isinstance(error, MemoryError):
        outcome = out_of_memory()
    elif time is not None and after is not None and after >= time:
        outcome = timed_out(time)._replace(seconds=after)
    return _settle(chunk, [outcome], take)
