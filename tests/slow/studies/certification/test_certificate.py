"""Certificates of the paper's job, of which the searches take long."""

import pytest
from soak.certificates import until_rest
from tests.studies.certification.test_certificate import PAPER, job

import armcontour as ac
from armcontour.jobs import Uncertainty


@pytest.mark.parametrize(
    ("servo", "budget", "box", "slowest"),
    [
        ("", 1e-3, {"gains": 0.1}, 5.55),
        (", dead_time: 40 ms", 2e-6, {"dead_time": 2e-3, "dead_time_shared": True}, 5.36),
        (", dead_time: 40 ms", 0.6e-3, {"dead_time": 2e-3}, 5.40),
    ],
)
def test_robots_of_a_box(servo, budget, box, slowest):
    certificate = ac.certify(
        job(PAPER, servo=servo),
        goal=ac.CertificateGoal(servo_error=budget, box=Uncertainty(**box)),
    )
    assert certificate.duration <= slowest and certificate.worst.robots.max.max() <= budget


def test_no_error_exceeds_the_certified_one_until_all_joints_rest():
    assert [until_rest(seed) for seed in (1, 16)] == [[], []]
