"""The arm among its cell, upright: in the coordinates of its base, whatever the work frame."""

import numpy as np
import pytest

from armcontour.arms import SerialArm
from armcontour.io import parse_job
from armcontour.jobs import Job
from armcontour.report.sections.bodies import draw_surroundings, seen_from_base

JOB = """
name: tilted
arm: {name: ur5e, work: {position: [0.4, 0.1, 0.3], rpy: [0.3, -0.4, 1.0]}}
path: {points: [[0, 0, 0], [0.05, 0, 0]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.1}
servo: {kp: 25, kv: 150}
runs: {taught: {}}
"""
SCENE = """
scene:
  halfspaces: [{name: table}]
  boxes: [{name: block, fixed_to: part, at: [0.1, 0, 0], size: [0.02, 0.02, 0.02]}]
"""
Q = np.array([[0.3, -1.2, 1.4, -1.0, -1.5, 0.2]])


@pytest.fixture(scope="module")
def job() -> Job:
    return parse_job(JOB + SCENE)


def test_links_are_those_of_the_arm_in_its_own_base(job: Job) -> None:
    own = parse_job(JOB.replace(", work: {position: [0.4, 0.1, 0.3], rpy: [0.3, -0.4, 1.0]}", ""))
    for arm in (job.arm, own.arm):
        assert isinstance(arm, SerialArm)
    np.testing.assert_allclose(
        seen_from_base(job.arm, job.arm.links(Q)), own.arm.links(Q) * 1e3, atol=1e-9
    )
    assert np.abs(seen_from_base(job.arm, job.arm.links(Q))[0, 0]).max() < 1e-9


def test_obstacles_and_the_base_stand_around_it(job: Job) -> None:
    links = seen_from_base(job.arm, job.arm.links(Q))[0]
    found = {trace.name: points for trace, points in draw_surroundings(job, links)}
    table, block = found["table"], found["block"]
    # The table is that of the base; its plate is larger than the arm, which stands on it.
    assert table[:, 2].max() == pytest.approx(0, abs=1e-9) and np.ptp(table[:, 0]) > np.ptp(
        links[:, 0]
    )
    middle = job.arm.chain.base.inverse.position + job.arm.chain.base.inverse.rotation @ [0.1, 0, 0]
    np.testing.assert_allclose(block.mean(axis=0), middle * 1e3, atol=1e-9)
    assert found["base_link_inertia"][:, 2].min() > -5


def test_without_obstacles_there_is_the_plane_of_the_base() -> None:
    found = dict(
        (trace.name, points)
        for trace, points in draw_surroundings(
            parse_job(JOB), np.array([[0, 0, 9.0], [400, 90, 5]])
        )
    )
    plane = found["plane of the base"]
    assert (plane[:, 2] == 0).all() and np.ptp(plane[:, :2], axis=0).tolist() == [400, 90]
