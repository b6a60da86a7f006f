"""Files of lessons: exact, and refused where they are not what they say."""

from __future__ import annotations

import dataclasses
import json
import zipfile

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.io.lesson_file import read_lesson, write_lesson
from armcontour.learning import LearnedRun, Lesson


@pytest.fixture(scope="module")
def plan():
    arm = ac.load_arm("pmk3s")
    path = ac.Path.polyline([(0.30, 0.20), (0.32, 0.20)])
    return ac.plan(path, arm, arm.limits.replace(speed=0.1), intervals=20)


def made(plan, runs=2):
    random = np.random.default_rng(1)
    q = random.standard_normal((30, 2)) / 3

    def run(k):
        return LearnedRun(
            q=q + k * np.pi,
            error=random.standard_normal((40, 2)),
            noise=np.array([1e-5, 2e-5]) / 3,
            loop_noise=np.array([3e-5, 4e-5]) / 7,
            joint_rms=random.random(2),
            joint_max=random.random(2),
            tool_rms=0.1 / 3,
            tool_max=0.2 / 3,
            contour_rms=None if k else 1 / 7,
            predicted=1 / 9 if k else None,
            offset=-100 / 3,
            source="run, 'ü'.csv",
        )

    return Lesson(
        period=0.004,
        q=q,
        trajectory=plan,
        method="learning",
        start_time=-0.004,
        runs=tuple(run(k) for k in range(runs)),
        predicted=1 / 3,
        bound=2 / 3,
        noise=1e-7 / 3,
        setbacks=1,
        reason="because",
    )


def same(first, second):
    for x in dataclasses.fields(first):
        a, b = getattr(first, x.name), getattr(second, x.name)
        if x.name == "runs":
            assert len(a) == len(b)
            for one, other in zip(a, b, strict=True):
                same(one, other)
        elif isinstance(a, np.ndarray):
            assert a.dtype == b.dtype and a.tobytes() == b.tobytes()
        else:
            assert a == b and type(a) is type(b), x.name


def test_a_lesson_comes_back_to_the_last_bit(plan, tmp_path):
    lesson = made(plan)
    write_lesson(tmp_path / "a.npz", lesson)
    found = read_lesson(tmp_path / "a.npz", plan)
    same(lesson, found)
    write_lesson(tmp_path / "b.npz", found)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_numpy_reads_it_too(plan, tmp_path):
    lesson = made(plan)
    write_lesson(tmp_path / "a.npz", lesson)
    with np.load(tmp_path / "a.npz") as found:
        np.testing.assert_array_equal(found["q"], lesson.q)
        np.testing.assert_array_equal(found["run 2: error"], lesson.runs[1].error)


def rewritten(file, change):
    """The file with its text, or an array, changed."""
    with zipfile.ZipFile(file) as source:
        parts = {x: source.read(x) for x in source.namelist()}
    change(parts)
    with zipfile.ZipFile(file, "w") as target:
        for name, content in parts.items():
            target.writestr(name, content)


def other(**values):
    def change(parts):
        about = json.loads(parts["about.json"])
        parts["about.json"] = json.dumps(about | values).encode()

    return change


def other_run(**values):
    def change(parts):
        about = json.loads(parts["about.json"])
        about["runs"][0] |= values
        parts["about.json"] = json.dumps(about).encode()

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (other(version=99), ["version 99", "reads version 1"]),
        (other(runs=[]), ["a.npz", "at least one run"]),
        (other_run(tool_rms="large"), ["damaged"]),
        (other_run(tool_rms=float("nan")), ["damaged"]),
        (other_run(unknown=1.0), ["damaged"]),
        (lambda parts: parts.pop("q.npy"), ["damaged"]),
        (lambda parts: parts.update({"q.npy": b"\x93NUMPY garbage"}), ["damaged"]),
        (lambda parts: parts.pop("about.json"), ["damaged"]),
    ],
)
def test_damaged_files_are_refused(refuses, plan, tmp_path, change, words):
    file = tmp_path / "a.npz"
    write_lesson(file, made(plan))
    rewritten(file, change)
    refuses(lambda: read_lesson(file, plan), InvalidInput, *words)


def test_other_files_are_refused(refuses, plan, tmp_path):
    file = tmp_path / "a.npz"
    refuses(lambda: read_lesson(file, plan), InvalidInput, "There is no file of learning")
    file.write_text("t,q1\n")
    refuses(lambda: read_lesson(file, plan), InvalidInput, "no file of learning")
