"""The taught data that a robot has executed, compared with its job and with what was learned."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from soak.corner_job import CORNER_JOB

from armcontour.errors import InvalidInput
from armcontour.io import parse_job, write_taught
from armcontour.io.exports import export
from armcontour.io.lesson_file import write_lesson
from armcontour.io.taught_file import LESSON, read_taught
from armcontour.jobs.learning import plan_run
from armcontour.learning import LearnedRun, Lesson
from armcontour.motion import TaughtData


@pytest.fixture(scope="module")
def job():
    return parse_job(CORNER_JOB)


@pytest.fixture(scope="module")
def plan(job):
    return plan_run(job, None)


def learned(plan, step=1e-3):
    """A lesson whose set-points are those of the plan and a little more."""
    taught, zeros = plan.taught, np.zeros(2)
    run = LearnedRun(
        q=taught.q, error=np.zeros((5, 2)), noise=zeros, loop_noise=zeros, joint_rms=zeros,
        joint_max=zeros, tool_rms=0.0, tool_max=0.0,
    )  # fmt: skip
    return Lesson(
        period=taught.period,
        q=taught.q + step / 3,
        trajectory=taught.trajectory,
        method="learning",
        start_time=-taught.period,
        runs=(run,),
        predicted=0.0,
        bound=0.0,
        noise=0.0,
    )


def put(folder, job, taught, lesson=None):
    folder.mkdir(exist_ok=True)
    write_taught(folder / "taught.csv", taught, job.arm.joint_names)
    if lesson is not None:
        write_lesson(folder / LESSON, lesson)
    return folder / "taught.csv"


def test_without_a_history_it_is_the_taught_data_of_the_job(job, plan, tmp_path):
    assert read_taught(put(tmp_path, job, plan.taught), job, plan) is plan.taught


def test_degrees_with_few_digits_will_do(job, plan, tmp_path):
    file = tmp_path / "taught.csv"
    table = np.column_stack([plan.taught.t * 1e3, np.degrees(plan.taught.q)])
    np.savetxt(file, table, "%.4f", ",", header="t [ms],q1 [deg],q2 [deg]", comments="")
    assert read_taught(file, job, plan) is plan.taught


def test_an_export_begins_at_zero(job, plan, tmp_path):
    late = dataclasses.replace(plan, taught=changed(plan, by=0.0, start_time=-0.008))
    file = tmp_path / "export.csv"
    export(late.taught, file, arm=job.arm)
    assert read_taught(file, job, late) is late.taught


def test_with_a_history_it_is_the_lesson_to_the_last_bit(job, plan, tmp_path):
    lesson = learned(plan)
    found = read_taught(put(tmp_path, job, lesson, lesson), job, plan)
    assert isinstance(found, Lesson) and len(found.runs) == 1
    assert found.q.tobytes() == lesson.q.tobytes() and found.start_time == lesson.start_time


def changed(plan, where=slice(None), by=1e-6, **fields):
    q = plan.taught.q.copy()
    q[where] += by
    return TaughtData(**({"period": 0.004, "trajectory": plan.trajectory, "method": "x"}
                         | {"q": q} | fields))  # fmt: skip


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda p: changed(p, (50, 1)), ["joint 2 differs by 1e-06 rad", "t = 0.2 s", "corner"]),
        (lambda p: changed(p, by=0.0, q=p.taught.q[:-1]), ["set-points of 2 joints, not the"]),
        (lambda p: changed(p, by=0.0, period=0.005), ["at other times"]),
    ],
)
def test_other_set_points_are_refused(refuses, job, plan, tmp_path, make, words):
    file = put(tmp_path, job, make(plan))
    refuses(lambda: read_taught(file, job, plan), InvalidInput, "taught.csv", *words)


def test_a_history_of_other_set_points_is_refused(refuses, job, plan, tmp_path):
    lesson = learned(plan)
    file = put(tmp_path, job, plan.taught, lesson)
    refuses(lambda: read_taught(file, job, plan), InvalidInput, "lesson.npz beside it", "joint 1")


def test_a_history_of_another_job_is_refused(refuses, job, plan, tmp_path):
    lesson = learned(plan)
    other = dataclasses.replace(lesson.runs[0], q=lesson.runs[0].q + 1e-6)
    lesson = dataclasses.replace(lesson, runs=(other,))
    file = put(tmp_path, job, lesson, lesson)
    refuses(lambda: read_taught(file, job, plan), InvalidInput, "give the job as it was")


def test_a_folder_must_be_a_result(refuses, job, plan, tmp_path):
    put(tmp_path, job, plan.taught)
    refuses(lambda: read_taught(tmp_path, job, plan), InvalidInput, "holds no result")
