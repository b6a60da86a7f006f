"""`sweep`: certified durations for other tolerances and speeds."""

from dataclasses import replace
from functools import partial

from tests.corner_job import CORNER_JOB

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import parse_job

# Certified without a search: the plan at the full limit holds 0.1 mm.
JOB = CORNER_JOB.replace("[0.36, 0.20], [0.36, 0.24]", "[0.38, 0.20], [0.38, 0.26]")


def test_a_point_of_a_sweep_is_the_result_of_certify_or_its_refusal():
    job = parse_job(JOB)
    (only_run,) = job.runs
    wide, slow = ac.sweep(job, tolerances=[4e-3], speeds=[0.05])
    rounding = replace(only_run.rounding, tolerance=4e-3)
    for point, changed in (
        (wide, replace(only_run, rounding=rounding)),
        (slow, replace(only_run, limits=only_run.limits.replace(speed=0.05))),
    ):
        assert point.duration == ac.certify(replace(job, runs=(changed,))).duration
        assert point.refusal is None
    assert (wide.tolerance, wide.speed, slow.tolerance, slow.speed) == (4e-3, None, None, 0.05)
    assert slow.duration > 1.2 * wide.duration
    job = parse_job(JOB.replace("pole_placement", "none"))
    (fast,) = ac.sweep(job, speeds=[0.15], goal=ac.CertificateGoal(servo_error=2e-5, slowest=1.05))
    assert fast.duration is None and "largest contour error" in fast.refusal
    goal = ac.CertificateGoal(tolerance=2e-3)
    narrow, wide = ac.sweep(parse_job(JOB), tolerances=[1e-3, 3e-3], goal=goal)
    assert wide.duration < narrow.duration


def test_wrong_values_are_refused(refuses):
    job = parse_job(JOB)
    sharp = replace(job, runs=(replace(job.runs[0], rounding=None),))
    refuses(partial(ac.sweep, sharp, tolerances=[1e-3]), InvalidInput, "that rounds corners")
    refuses(partial(ac.sweep, job), InvalidInput, "requires values of tolerances or speeds")
    refuses(partial(ac.sweep, job, speeds=[-1.0]), InvalidInput, "above zero")
    refuses(
        partial(ac.certify, "job", goal=ac.CertificateGoal(servo_error=1e-5)),
        InvalidInput,
        "needs a Job",
    )
    refuses(
        partial(ac.certify, job, goal={"servo_error": 1e-5}),
        InvalidInput,
        "needs a CertificateGoal",
    )
