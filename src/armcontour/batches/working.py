"""What another process does with jobs of a plan: each one becomes an outcome."""

from __future__ import annotations

import faulthandler
import os
import pickle
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path as FilePath
from types import FrameType
from typing import Any, NamedTuple

from armcontour._executors import Engine
from armcontour._memory import machine_memory
from armcontour._process import end_at_once, is_other
from armcontour._warming import warm_for_run
from armcontour.batches.columns import CERTIFY, PLACE, TEACH, figures_of
from armcontour.batches.plan import Plan
from armcontour.errors import ArmContourError
from armcontour.jobs import Job

# What can come of a job: an answer, an error of this program, or what may not be the job's fault
# and is tried again.
DONE, REFUSED = ANSWERS = ("done", "refused")
FAILED = "failed"
KILLED, TIMED_OUT, OUT_OF_MEMORY = RETRIED = ("killed", "timed out", "out of memory")
STATUSES = (*ANSWERS, FAILED, *RETRIED)
# A job that does not end at its time although it is told to, as compiled code cannot be told, gets
# so much more [share, s]; then its process is ended.
PATIENCE = (0.25, 1.0)
# How much rather than another process the system ends one of these when memory runs out, 0 to 1000.
RATHER = "500"
# Share of the machine's memory that all processes together may take.
MEMORY = 0.8


class Outcome(NamedTuple):
    """What came of a job.

    Args:
        status: One of STATUSES.
        error: Name of the error; None for a job that is done.
        sentence: Its message.
        figures: The figures that the plan asks for; empty for a job that is not done.
        seconds: Time that the job took [s].
        worker: Machine and process that worked on it.
        tries: How often it was tried.
    """

    status: str
    error: str | None = None
    sentence: str | None = None
    figures: tuple[float | None, ...] = ()
    seconds: float = 0.0
    worker: str = ""
    tries: int = 1


# Index of a base, and values of the parameters.
Item = tuple[int, tuple[Any, ...]]


@dataclass(frozen=True)
class Work:
    """The work on jobs of a plan; it can be called in other processes.

    Args:
        packed: The plan without its samples, as bytes.
        share: Memory that each process may take by default [bytes]; None for no bound.
        mortal: Whether the process may be ended by a job that does not end.
        dimensions: Dimensions of arms for which the process has to compile functions, if nobody
            did so on its machine.
    """

    packed: bytes
    share: float | None
    mortal: bool
    dimensions: tuple[int, ...] = ()

    def prepare(self) -> None:
        """Have all that jobs need loaded in this process; a kill meanwhile is no job's fault."""
        plan = _prepare(self.packed, self.share, self.dimensions)
        if plan.work == CERTIFY:
            import armcontour.certification  # noqa: F401
        if plan.work == PLACE:
            import armcontour.placement  # noqa: F401
        import armcontour.jobs.study  # noqa: F401

    def __call__(self, items: Sequence[Item]) -> list[Outcome]:
        """Work on some jobs, one after the other.

        Args:
            items: The jobs.
        """
        plan = _prepare(self.packed, self.share, self.dimensions)
        return [self._outcome(plan, x) for x in items]

    def _outcome(self, plan: Plan, item: Item) -> Outcome:
        """Work on a job."""
        begin = time.perf_counter()
        try:
            with _ending(plan.time, mortal=self.mortal):
                found = Outcome(DONE, figures=_figures(plan, item))
        except ArmContourError as error:
            found = Outcome(REFUSED, type(error).__name__, str(error))
        except MemoryError:
            found = out_of_memory()
        except TimeUp:
            found = timed_out(plan.time)
        except SystemExit:
            found = killed()
        except Exception as error:
            found = Outcome(FAILED, type(error).__name__, f"{error}")
        return found._replace(seconds=time.perf_counter() - begin, worker=_worker())


class TimeUp(BaseException):
    """Raised inside a job whose time is over."""


def timed_out(seconds: float | None) -> Outcome:
    """The outcome of a job whose time is over."""
    return Outcome(
        TIMED_OUT,
        "TimeUp",
        f"The job did not end within {seconds:g} s: give it more with limits.time of the plan.",
    )


def out_of_memory() -> Outcome:
    """The outcome of a job that wants more memory than it may take."""
    return Outcome(
        OUT_OF_MEMORY,
        "MemoryError",
        "The job wants more memory than it may take: give it more with limits.memory of the plan, "
        "or work in fewer processes.",
    )


def killed() -> Outcome:
    """The outcome of a job whose process ended before it."""
    return Outcome(
        KILLED,
        "ProcessEnded",
        "The process of this job ended before the job did, each time: it crashed, or was killed, "
        "as when the memory of the machine runs out.",
    )


def _figures(plan: Plan, item: Item) -> tuple[float | None, ...]:
    """The figures of a job.

    Raises:
        ArmContourError: The job is refused.
    """
    which, values = item
    base = plan.bases[which]
    job = base.job(base.at(plan.keys, values), trust_xacro=plan.trust_xacro)
    return figures_of(_do(plan.work, job, base.run), plan.columns, plan.work)


def _do(work: str, job: Job, run: str | None) -> Any:
    """Do what the plan says with a job."""
    if work == CERTIFY:
        from armcontour.certification import certify

        return certify(job, run)
    if work == PLACE:
        from armcontour.placement import place

        # Others have jobs of their own.
        return place(job, run, processes=1)
    from armcontour.jobs import study

    if work == TEACH:
        return study.teach(job)[str(run)]
    return study.run(job).runs[str(run)]


@contextmanager
def _ending(seconds: float | None, *, mortal: bool) -> Iterator[None]:
    """Context that ends with `TimeUp` when the time is over, or else ends the process."""
    if seconds is None:
        yield
        return
    here = threading.current_thread() is threading.main_thread()
    told = here and hasattr(signal, "setitimer")
    if mortal:
        last = seconds * (1.0 + PATIENCE[0]) + PATIENCE[1]
        try:
            faulthandler.dump_traceback_later(last, exit=True, file=_nowhere())
        except RuntimeError:
            # There is no memory for another thread.
            raise MemoryError from None
    before: Any = signal.SIG_DFL
    if told:
        before = signal.signal(signal.SIGALRM, _raise)
        signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        if told:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)
        if mortal:
            faulthandler.cancel_dump_traceback_later()


def _raise(number: int, frame: FrameType | None) -> None:
    """Raise `TimeUp`."""
    raise TimeUp


@lru_cache(maxsize=1)
def _nowhere() -> int:
    """Descriptor of a file for what nobody reads."""
    return os.open(os.devnull, os.O_WRONLY)


@lru_cache(maxsize=2)
def _prepare(packed: bytes, share: float | None, dimensions: tuple[int, ...]) -> Plan:
    """The plan, in a process that is ready for its jobs; once in each process."""
    plan: Plan = pickle.loads(packed)
    if dimensions:
        end_at_once()
        with _alone():
            for x in dimensions:
                warm_for_run(x, lambda step: None)
    if is_other():
        with suppress(OSError):
            FilePath("/proc/self/oom_score_adj").write_text(RATHER)
        most = share if plan.memory is None else plan.memory
        if most is not None:
            _bound_memory(most)
    return plan


def _bound_memory(more: float) -> None:
    """Bound the memory that this process takes, where the system can do that.

    Args:
        more: Memory that it may take in addition to what it has [bytes].
    """
    if sys.platform != "linux":
        return
    import resource

    with suppress(OSError, ValueError):
        pages = int(FilePath("/proc/self/statm").read_text().split()[5])
        most = int(pages * os.sysconf("SC_PAGE_SIZE") + more)
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


@lru_cache(maxsize=1)
def _worker() -> str:
    """Machine and process."""
    return f"{socket.gethostname()}:{os.getpid()}"


@contextmanager
def _alone() -> Iterator[None]:
    """Context that one process of this machine is in at a time, where the system can do that."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    file = FilePath(tempfile.gettempdir()) / f"armcontour-{os.getuid()}.lock"
    handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def work_on(plan: Plan, engine: Engine, dimensions: Iterable[int]) -> Work:
    """The work on jobs of a plan.

    Args:
        plan: The plan.
        engine: Where the work is done.
        dimensions: Dimensions of the arms.
    """
    # Values come with each job.
    keys = tuple(replace(x, values=()) for x in plan.parameters)
    packed = pickle.dumps(replace(plan, parameters=keys, samples=None), protocol=5)
    here = engine.mortal and not engine.remote
    return Work(
        packed,
        _share(engine.workers) if here else None,
        engine.mortal,
        tuple(dimensions) if engine.remote else (),
    )


def _share(workers: int) -> float | None:
    """Memory that each process may take by default [bytes]; None where that is unknown."""
    memory = machine_memory() if sys.platform == "linux" else None
    return None if memory is None else MEMORY * memory / workers
