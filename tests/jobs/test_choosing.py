"""The run that something is done with."""

from tests.corner_job import CORNER_JOB
from tests.geometry.tables import refused

from armcontour.io import parse_job
from armcontour.jobs.choosing import choose_run


def test_the_run_is_chosen_by_its_name_or_the_only_one():
    job = parse_job(CORNER_JOB + "  other: {compensation: {method: none}}\n")
    only, other = job.runs
    assert choose_run(job, "other", "learned") is other
    assert choose_run(job, None, "learned", [only]) is only
    refused(
        (lambda: choose_run(job, None, "placed"), "be placed, with --run (only, o"),
        (lambda: choose_run(job, "cut", "placed"), "no run 'cut'", "only, other"),
    )
