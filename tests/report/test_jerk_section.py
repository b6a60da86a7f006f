"""The section on jerk: what is drawn is the plan's and the execution's, within its limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from armcontour.io import parse_job
from armcontour.jobs import Study, run
from armcontour.report import render_report
from armcontour.report.sections import jerks, overview

JOB = """
name: jerk
arm: pmk3s
path: {points: [[0.35, 0.10], [0.36, 0.12]]}
limits: {joint_acceleration: 0.72 rad/s^2, joint_jerk: 7.2 rad/s^3}
servo: {kp: 25, kv: 150}
runs: {plain: {timing: {method: optimal}, compensation: {method: none}}}
"""


@pytest.fixture(scope="module")
def study() -> Study:
    job = parse_job(JOB)
    limits = job.runs[0].limits.replace(joint_jerk=[7.2, np.inf])
    return run(dataclasses.replace(job, runs=(dataclasses.replace(job.runs[0], limits=limits),)))


def test_joints_with_a_limit_are_drawn_with_it(study: Study) -> None:
    section = jerks(study)
    assert section is not None
    (figure,) = section.figures
    executed, planned = figure.data  # of joint 1 only
    assert [x.name for x in figure.data] == ["executed", "planned"]
    assert figure.layout.yaxis.title.text == "joint 1"
    assert {x.y0 for x in figure.layout.shapes} == {-7.2, 7.2}
    assert np.abs(planned.y).max() == pytest.approx(7.2, rel=1e-3)
    result = study.runs["plain"]
    assert np.abs(executed.y).max() == pytest.approx(result.evaluation.jerk[0], rel=1e-6)
    # A step of the plan has both of its sides at one time.
    steps = np.flatnonzero(np.diff(planned.x) == 0)
    assert np.abs(np.diff(planned.y))[steps].max() > 3.0
    assert figure.layout.yaxis.range[1] <= 2 * 7.2
    assert 'id="jerks"' in render_report(study)


def test_without_limits_there_is_no_section(study: Study) -> None:
    result = study.runs["plain"]
    free = dataclasses.replace(result.run, limits=result.run.limits.replace(joint_jerk=None))
    other = Study(job=study.job, runs={"plain": dataclasses.replace(result, run=free)})
    assert jerks(other) is None

    def labels(x: Study) -> list[str]:
        return [tile.label for _, tiles in overview(x).tiles for tile in tiles]

    assert set(labels(study)) - set(labels(other)) == {"joint jerk / limit"}
