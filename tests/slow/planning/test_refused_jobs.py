"""Of 200 jobs with one narrow range or one held axis, at least 190 refusals name it.

`python -m tests.slow.planning.test_refused_jobs` prints a table of the jobs and what is named.
"""

import time

from tests.planning.tracing.refused_jobs import KINDS, reason, refused_job, singular_job

# Number of jobs per kind, of which there are six.
JOBS = 34
SINGULAR = 50


def some(make, count):
    """Yield a number of jobs of the first seeds that make one."""
    seed = 0
    while count:
        job = make(seed)
        seed += 1
        if job is not None:
            count -= 1
            yield job


def test_narrow_ranges_and_held_axes_are_named():
    missed = []
    for kind in KINDS:
        for job in some(lambda seed, kind=kind: refused_job(kind, seed), JOBS):
            if not job.is_named:
                missed.append(f"{job.kind} {job.seed}: {job.error}")
    assert len(missed) <= 10, "\n".join(missed)


def test_singularities_are_named():
    for path, _, error in some(singular_job, SINGULAR):
        assert error.limit == "singularity", error
        assert abs(error.s / path.length - 0.5) < 0.05, error


def print_table():
    """Print what the refusals name, whether their remedies work, and their time."""
    for kind in KINDS:
        named = works = 0
        for job in some(lambda seed, kind=kind: refused_job(kind, seed), JOBS):
            start = time.process_time()
            reason(job.path, job.arm)
            seconds = time.process_time() - start
            mark = "missed"
            if job.is_named:
                named += 1
                mark = "named"
                if job.remedies() and not job.wrong_remedies():
                    works += 1
                    mark = "named, remedies work"
            print(f"{kind:12} {job.seed:4} {job.name:20} {job.change:34} {mark:21} {seconds:.2f} s")
            print(f"    {job.error}")
        print(f"{kind}: {named} of {JOBS} named; of {works} the remedies work")
    singular = [job[2].limit for job in some(singular_job, SINGULAR)]
    print(f"singularities: {singular.count('singularity')} of {SINGULAR} named")


if __name__ == "__main__":
    print_table()
