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
do: teach
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
    told = [
        json.loads(x)
        for x in command_in(folder, *CALL, "--shard", "2/2", "--json").out.splitlines()
    ]
    progress, end = told[-2]["progress"], told[-1]["end"]
    assert progress["done"] == progress["total"] == 2
    assert progress["statuses"] == {"refused": 2} and progress["errors"] == {"Unreachable": 2}
    assert end["complete"] is False
    rest = command_in(folder, *CALL, "--shard", "1/3")
    assert rest.code == 0 and "1 jobs have no result yet" in rest.out
    ended = command_in(folder, *CALL)
    assert ended.code == 0, ended.errors
    for words in ("plan: 4 jobs", "done", "refused", "Unreachable: 2", "report.html"):
        assert words in ended.out
    # Nothing is left to do.
    (end,) = (json.loads(x) for x in command_in(folder, *CALL, "--json").out.splitlines())
    assert end["end"]["statuses"] == {"done": 2, "refused": 2} and end["end"]["complete"]


def test_jobs_without_an_answer_have_an_exit_code(command_in, folder, monkeypatch):
    def fail(*_):
        raise MemoryError

    monkeypatch.setattr("armcontour.batches.working.figures_of", fail)
    ended = command_in(folder, *CALL)
    assert ended.code == 1 and "out of memory" in ended.out


def test_wrong_options_are_refused(refused, folder):
    rows = [
        ("--shard x", ["--shard takes a number and how many there are, such as 3/64, not 'x'."]),
        ("--shard 0/3", ["no shard 0 of 3"]),
        ("--cluster tcp://1 --workers 2", ["A cluster has its own workers"]),
    ]
    assert refused(folder, rows, begin=("batch", "plan.yaml", "--out", "out")) == []
