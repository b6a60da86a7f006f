"""Certificates satisfy segment speeds and reach every part of the path."""

from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac
from armcontour.files import certificate_page, parse_job
from armcontour.jobs.methods import COMPENSATIONS

JOB = """
name: own
arm: pmk3s
seed: [0, 1]
path: {{points: [[0.30, 0.20], [0.33, 0.20], [0.30, 0.20]]}}
limits: {{speed: 0.2 m/s, joint_acceleration: 3 rad/s^2}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
cycle: 4 ms
runs:
  only: {{compensation: {{method: {method}}}}}
certificate: {{servo_error: {servo}}}
"""
# Where the three segments of a line along x begin and end [m].
ENDS = [0.300, 0.312, 0.318, 0.330]
# Their assigned speeds [m/s].
SPEEDS = [0.15, 0.02, 0.10]


def job_of_own_speeds(method):
    path = ac.Path(
        segments=[
            ac.Line(start=(a, 0.2), end=(b, 0.2), segment_limits=ac.SegmentLimits(speed=v))
            for a, b, v in zip(ENDS[:-1], ENDS[1:], SPEEDS, strict=True)
        ]
    )
    return replace(parse_job(JOB.format(method=method, servo="2 mm")), path=path)


def executed(certificate):
    plant = ac.ServoPlant(
        certificate.job.arm, certificate.job.plant_servo, certificate.result.run.limits
    )
    return ac.simulate(certificate.set_points, plant, resolution=2e-5)


def written(certificate):
    return certificate_page(certificate)["certificate"]["contours"][0]


@pytest.mark.parametrize("method", ["none", "pole_placement"])
def test_the_tool_respects_the_speed_of_every_segment(method):
    job = job_of_own_speeds(method)
    certificate = ac.certify(job)
    execution = executed(certificate)
    # On a line along x the place is x; a tool that is off the path is somewhere as near as that.
    x = execution.tool[:, 0]
    distances = np.abs(execution.tool[:, 1] - 0.2)
    around = [np.searchsorted(ENDS[1:-1], y) for y in (x - distances, x + distances)]
    assigned = np.max([np.array(SPEEDS)[i] for i in around], axis=0)
    assert (execution.tool_speed / assigned).max() <= 1.001
    # Nothing is held back needlessly far.
    assert (execution.tool_speed / assigned).max() > 0.999
    assert certificate.duration < 1.15 * certificate.uncertified.duration
    contour = written(certificate)
    assert contour["speed_ratio"] == certificate.contours[0].speed_ratio <= 1.001
    # The uncertified plan was not.
    set_points = ac.compensate(
        ac.plan(job.path, job.arm, certificate.result.run.limits),
        job.servo,
        COMPENSATIONS[method](),
        cycle=4e-3,
    )
    fast = executed(replace(certificate, result=replace(certificate.result, set_points=set_points)))
    fast = ac.evaluate(fast, job.path, limits=certificate.result.run.limits)
    assert fast.speed_ratio > 1.05


def test_a_tool_above_its_speed_is_named_in_the_refusal():
    with pytest.raises(ac.NotRealizable, match="compensate the lag of the servo") as refused:
        job = job_of_own_speeds("none")
        ac.certify(job, goal=replace(job.certificate, slowest=1.03))
    assert refused.value.limit == "speed"
    assert refused.value.needed > refused.value.allowed == 1.001


def test_the_tip_of_a_turn_back_is_reached_within_the_budget():
    certificate = ac.certify(parse_job(JOB.format(method="none", servo="0.05 mm")))
    tip = np.linalg.norm(executed(certificate).tool - [0.33, 0.2], axis=1).min()
    assert 0.045e-3 < tip <= 0.05e-3
    contour = certificate.contours[0]
    assert contour.coverage_error.max == pytest.approx(tip, rel=1e-3)
    assert contour.coverage_error.s_max == pytest.approx(0.03)
    assert (
        contour.error.max < contour.coverage_error.max == pytest.approx(certificate.budget.executed)
    )
    assert written(certificate)["coverage_error"]["max"] == contour.coverage_error.max
    assert certificate.uncertified.contour_error[0] > 0.2e-3
