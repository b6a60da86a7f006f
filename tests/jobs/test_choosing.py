"""The run that something is done with."""

from soak.corner_job import CORNER_JOB

from armcontour.errors import InvalidInput
from armcontour.io import parse_job
from armcontour.jobs.choosing import choose_run

TWO_RUNS = CORNER_JOB + "  other: {compensation: {method: none}}\n"


def test_the_run_is_chosen_by_its_name_or_the_only_one(refuses):
    job = parse_job(TWO_RUNS)
    only, other = job.runs
    assert choose_run(job, "other", "learned") is other
    assert choose_run(job, None, "learned", [only]) is only
    refuses(lambda: choose_run(job, None, "placed"), InvalidInput, "be placed, with --run (only, o")
    refuses(lambda: choose_run(job, "cut", "placed"), InvalidInput, "no run 'cut'", "only, other")
