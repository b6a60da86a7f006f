"""Which run of a job something is done with."""

from __future__ import annotations

from collections.abc import Sequence

from armcontour.errors import InvalidInput
from armcontour.jobs.job import Job, Run


def find_run(job: Job, name: str) -> Run:
    """The run of a name.

    Raises:
        InvalidInput: There is no such run.
    """
    for run in job.runs:
        if run.name == name:
            return run
    names = ", ".join(x.name for x in job.runs)
    raise InvalidInput(f"The job {job.name} has no run {name!r}: its runs are {names}.")


def choose_run(job: Job, name: str | None, done: str, among: Sequence[Run] = ()) -> Run:
    """The run of a name, or the only run.

    Args:
        job: The job.
        name: Name of the run; None for the only one.
        done: What is done with it, as in "certified".
        among: Runs that come into question without a name, if there are any; all by default.

    Raises:
        InvalidInput: There is no such run, or there are several.
    """
    if name is not None:
        return find_run(job, name)
    able = among or job.runs
    if len(able) > 1:
        names = ", ".join(x.name for x in able)
        raise InvalidInput(
            f"The job {job.name} has several runs: say which one is to be {done}, with --run "
            f"({names})."
        )
    return able[0]
