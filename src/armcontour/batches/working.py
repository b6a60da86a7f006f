"""What is done with a job of a plan, here or in another process: it becomes an outcome."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

from armcontour.batches.columns import CERTIFY, PLACE, TEACH, figures_of
from armcontour.batches.plan import Plan
from armcontour.core.errors import ArmContourError
from armcontour.jobs import Job

# What can come of a job: figures, a refusal by this library, or neither, which may be tried again.
DONE, REFUSED, FAILED = STATUSES = ("done", "refused", "failed")


class Outcome(NamedTuple):
    """What came of a job.

    Args:
        status: One of STATUSES.
        error: Name of the error; None for a job that is done.
        sentence: Its message.
        figures: The figures that the plan asks for; empty for a job that is not done.
        seconds: Time that the job took [s].
    """

    status: str
    error: str | None = None
    sentence: str | None = None
    figures: tuple[float | None, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True)
class Work:
    """The work on jobs of a plan; it can be called in other processes.

    Args:
        plan: The plan.
    """

    plan: Plan

    def __call__(self, index: int) -> Outcome:
        """Work on the job of an index."""
        begin = time.perf_counter()
        try:
            base = self.plan.bases[self.plan.base(index)]
            job = base.job(self.plan.data(index), trust_xacro=self.plan.trust_xacro)
            found = _do(self.plan.work, job, base.run)
            outcome = Outcome(DONE, figures=figures_of(found, self.plan.columns, self.plan.work))
        except ArmContourError as error:
            outcome = Outcome(REFUSED, type(error).__name__, str(error))
        except Exception as error:
            outcome = Outcome(FAILED, type(error).__name__, str(error))
        return outcome._replace(seconds=time.perf_counter() - begin)


def killed() -> Outcome:
    """The outcome of a job whose process ended before it."""
    return Outcome(
        FAILED,
        "ProcessEnded",
        "The process of this job ended before the job did: it crashed, or was killed, as when the "
        "memory of the machine runs out.",
    )


def _do(work: str, job: Job, run: str | None) -> Any:
    """Do what the plan says with a job."""
    if work == CERTIFY:
        from armcontour.studies.certification import certify

        return certify(job, run)
    if work == PLACE:
        from armcontour.studies.placement import place

        # Others have jobs of their own.
        return place(job, run=run, processes=1)
    from armcontour import jobs

    return jobs.run(job, simulate=work != TEACH).runs[str(run)]
