"""Batches: rows of `run` for all combinations, with any executor."""

import csv
import json
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from tests.test_pool import Elsewhere

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import batch as module
from armcontour.files import parse_job

JOB = """\
name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 0.1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 10 ms
runs:
  only: {compensation: {method: pole_placement}, timing: {reserve: 2 %}}
  none: {compensation: {method: none}}
"""
REACHED = [[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]
FAR = [[0.30, 0.20], [0.33, 0.20], [0.93, 0.23]]
OVER = {"limits.speed": ["20 mm/s", 0.1], "path.points": [REACHED, FAR]}


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(JOB)
    return file


def test_a_row_of_a_batch_equals_the_results_of_run(file):
    progress_log = []
    result = ac.batch(file, OVER, workers=0, progress=progress_log.append)
    assert result.counts == {"done": 2, "refused": 2}
    assert [(x.job, x.run) for x in result.rows] == [
        (1, "only"), (1, "none"), (2, ""), (3, "only"), (3, "none"), (4, "")
    ]  # fmt: skip
    for row in result.rows:
        speed = row.values["limits.speed"]
        points = row.values["path.points"]
        text = JOB.replace("0.1 m/s", str(speed))
        job = parse_job(text.replace("[[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]", str(points)))
        if points == FAR:
            with pytest.raises(ac.Unreachable) as caught:
                ac.run(job)
            assert row.error == str(caught.value)
            continue
        expected = ac.run(job).figures[row.run]
        for name in ("kept", "duration", "off_drawing", "contour_error.max", "saturated"):
            assert row.data[name].value == expected[name].figure, name
    assert progress_log[-1].done == 1.0 and "4 of 4 jobs, 2 refused" in str(progress_log[-1])
    text = str(result)
    assert "Job 2: " in text and "NOT KEPT" in text and "limits.speed" in text


def test_every_executor_gives_the_same_rows_of_a_batch(file):
    table = ac.batch(file, OVER, workers=0).table()
    with ThreadPoolExecutor(2) as threads:
        assert ac.batch(file, OVER, executor=threads).table() == table
    with pytest.raises(InvalidInput, match="has its own workers"):
        ac.batch(file, OVER, executor=Elsewhere(), workers=2)


class Ending(Elsewhere):
    """Ends after some jobs, as a process that is killed."""

    _max_workers = 1

    def __init__(self, after):
        self.left = after

    def submit(self, fn, /, *args, **kwargs):
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def test_an_interrupted_batch_keeps_its_results(file, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        ac.batch(file, OVER, out, executor=Ending(2))
    lines = [json.loads(x) for x in (out / "results.jsonl").read_text().splitlines()]
    assert 1 <= len(lines) <= 2 and not (out / "results.csv").exists()
    assert lines[0]["job"] == 1 and lines[0]["values"]["limits.speed"] == "20 mm/s"
    result = ac.batch(file, OVER, tmp_path / "new", workers=0)
    rows = list(csv.DictReader((tmp_path / "new" / "results.csv").read_text().splitlines()))
    assert [x["job"] for x in rows] == ["1", "1", "2", "3", "3", "4"]
    assert float(rows[0]["duration [s]"]) == result.rows[0].data["duration"].value
    assert rows[2]["status"] == "refused" and rows[2]["error"] == result.rows[2].error
    assert json.loads(rows[0]["path.points"]) == REACHED and rows[1]["kept"] == "False"


def test_invalid_and_failed_jobs_are_rows_with_their_error(file, monkeypatch):
    result = ac.batch(file, {"limits.speed": ["20 mm/s", "fast"]}, workers=0)
    assert [x.status for x in result.rows] == ["done", "done", "invalid"]
    assert "limits.speed" in result.rows[2].error

    def fail(job):
        raise MemoryError("none left")

    monkeypatch.setattr(module, "run", fail)
    result = ac.batch(file, OVER, workers=0)
    assert result.counts == {"failed": 4} and result.rows[0].error == "MemoryError: none left"


def test_wrong_arguments_are_refused(file, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    speeds = {"limits.speed": [0.1]}
    for over, more, words in (
        ({"limits.sped": [0.1, 0.2]}, {}, "unknown key limits.sped"),
        ({"limits.speed": "0.1 m/s"}, {}, "over must be a list of values"),
        ({"limits.speed": []}, {}, "over has no values for 'limits.speed'"),
        (speeds, {"out": tmp_path / "other"}, "is not empty"),
        (speeds, {"out": file}, "Cannot write to the folder"),
    ):
        with pytest.raises(InvalidInput, match=words):
            ac.batch(file, over, workers=0, **more)
    assert sorted(x.name for x in (tmp_path / "other").iterdir()) == ["notes.txt"]
