"""The section on learning: what it shows of real and of simulated runs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from soak.corner_job import CORNER_JOB

import armcontour as ac
from armcontour.io import parse_job
from armcontour.jobs.learning import LearningStudy, learn_run, plan_run
from armcontour.report import render_learning, sections
from armcontour.report.sections.learning import run_header, run_rows


@pytest.fixture(scope="module")
def real():
    """Learned from an ideal servo: the second run is made up of the first."""
    job = parse_job(CORNER_JOB.replace("pole_placement", "none"))
    plan = plan_run(job, None)
    executed = ac.execute(plan.taught, ac.ServoPlant(job.arm, job.servo), resolution=4e-3)
    lesson = learn_run(job, plan, plan.taught, executed)
    first = lesson.runs[0]
    second = dataclasses.replace(
        first, error=first.error / 10, joint_rms=first.joint_rms / 10, contour_rms=2e-6,
        contour_max=5e-6, predicted=3e-6, bound=4e-6, source="<b>run2</b>.csv",
    )  # fmt: skip
    lesson = dataclasses.replace(
        lesson, runs=(first, second), predicted=1e-6, bound=1.5e-6, noise=2e-7, finished=False
    )
    return LearningStudy(job=job, plan=plan, lesson=lesson)


def traces(figure):
    return {x.name: x for x in figure.data}


def test_error_over_runs_with_predictions_and_noise(real):
    figure = traces(sections.learning(real).figures[0])
    first = real.lesson.runs[0]
    np.testing.assert_allclose(figure["RMS"].y, [1e3 * first.contour_rms, 2e-3])
    np.testing.assert_allclose(figure["largest"].y, [1e3 * first.contour_max, 5e-3])
    predicted = figure["RMS that was predicted, and its bound"]
    assert list(predicted.x) == [2, 3]
    np.testing.assert_allclose(predicted.y, [3e-3, 1e-3])
    np.testing.assert_allclose(predicted.y + predicted.error_y.array, [4e-3, 1.5e-3])
    np.testing.assert_allclose(figure["does not repeat"].y, 2e-4, rtol=1e-6)


def test_a_bound_below_its_prediction_is_drawn_at_it(real):
    lesson = dataclasses.replace(real.lesson, bound=0.5e-6)
    section = sections.learning(dataclasses.replace(real, lesson=lesson))
    marks = traces(section.figures[0])["RMS that was predicted, and its bound"]
    assert (np.asarray(marks.error_y.array) >= 0).all()


def test_the_parts_of_joints_and_the_error_over_time(real):
    _, joints, over_time = sections.learning(real).figures
    for j, trace in enumerate(joints.data):
        assert trace.name == real.job.arm.joint_names[j]
        np.testing.assert_allclose(trace.y, [1e3 * x.joint_rms[j] for x in real.lesson.runs])
    before, after = over_time.data
    assert before.name.startswith("before learning: RMS")
    assert after.name == "run 2: RMS 0.002 mm, largest 0.005 mm"
    assert 0 < np.max(after.y) < np.max(before.y) / 3
    assert "as measured" in over_time.layout.title.text


def test_a_row_for_every_run_and_the_next(real):
    rows = run_rows(real)
    assert len({len(x) for x in [*rows, run_header(real)]}) == 1
    assert [x[0] for x in rows] == ["1: the execution", "2: <b>run2</b>.csv (best)", "next"]
    assert rows[2][1:] == ["", "", "0.00100", "0.00150", ""]
    done = dataclasses.replace(real, lesson=dataclasses.replace(real.lesson, finished=True))
    assert len(run_rows(done)) == 2
    figure = traces(sections.learning(done).figures[0])
    assert list(figure["RMS that was predicted, and its bound"].x) == [2]


def test_the_page_says_where_its_figures_come_from(real):
    page = render_learning(real)
    assert 'id="learning"' in page and "from logs of its robot" in page
    assert "&lt;b&gt;run2&lt;/b&gt;.csv" in page and "<b>run2" not in page
    assert "the servo is simulated" not in page and "What the encoders do not see" in page
