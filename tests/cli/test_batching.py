"""The command `batch`: its output and its exit codes."""

import json

import pytest

JOB = """\
name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {}}
"""
PLAN = """\
job: job.yaml
do: compensate
over:
  limits.speed: [20 mm/s, 40 mm/s]
  path.points: [[[0.3, 0.2], [0.33, 0.2]], [[0.3, 0.2], [0.93, 0.2]]]
"""
CALL = ("batch", "plan.yaml", "--out", "out", "--workers", "0")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "job.yaml").write_text(JOB)
    (tmp_path / "plan.yaml").write_text(PLAN)
    return tmp_path


def test_results_and_progress_are_printed_and_lines_of_json(command_in, folder):
    events = [json.loads(x) for x in command_in(folder, *CALL, "--json").out.splitlines()]
    progress, end = events[-2]["progress"], events[-1]["end"]
    assert progress["done"] == progress["total"] == 4
    assert progress["statuses"] == {"done": 2, "refused": 2}
    assert progress["errors"] == end["errors"] == {"Unreachable": 2}
    ended = command_in(folder, *CALL)
    assert ended.code == 0, ended.errors
    for words in ("plan: 4 jobs", "done", "refused", "Unreachable: 2", "report.html"):
        assert words in ended.out


def test_jobs_that_fail_have_an_exit_code(command_in, folder, monkeypatch):
    def fail(*_):
        raise MemoryError

    monkeypatch.setattr("armcontour.batches.outcomes.figures_of", fail)
    ended = command_in(folder, *CALL)
    assert ended.code == 1 and "MemoryError: 2" in ended.out


def test_wrong_options_are_refused(refused, folder):
    rows = [("--cluster tcp://1 --workers 2", ["has its own workers"])]
    assert refused(folder, rows, begin=("batch", "plan.yaml", "--out", "out")) == []
