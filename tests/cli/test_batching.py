"""The command `batch`: what it prints, and its exit codes."""

from __future__ import annotations

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


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "job.yaml").write_text(JOB)
    (tmp_path / "plan.yaml").write_text(PLAN)
    return tmp_path


def test_what_came_of_the_jobs_is_printed(command_in, folder):
    call = ("batch", "plan.yaml", "--out", "out", "--workers", "0")
    ended = command_in(folder, *call)
    assert ended.code == 0, ended.errors
    for words in ("plan: 4 jobs", "done", "refused", "Unreachable: 2", "report.html"):
        assert words in ended.out
    # Nothing is left to do, and lines of JSON say so.
    told = [json.loads(x) for x in command_in(folder, *call, "--json").out.splitlines()]
    (end,) = told
    assert end["end"]["statuses"] == {"done": 2, "refused": 2} and end["end"]["complete"]


def test_progress_comes_as_lines_of_json(command_in, folder):
    call = ("batch", "plan.yaml", "--out", "out", "--workers", "0", "--shard", "2/2", "--json")
    *told, end = [json.loads(x) for x in command_in(folder, *call).out.splitlines()]
    assert told[-1]["progress"]["done"] == told[-1]["progress"]["total"] == 2
    assert told[-1]["progress"]["statuses"] == {"refused": 2}
    assert told[-1]["progress"]["errors"] == {"Unreachable": 2}
    assert end["end"]["complete"] is False
    rest = command_in(
        folder, "batch", "plan.yaml", "--out", "out", "--workers", "0", "--shard", "1/3"
    )
    assert rest.code == 0 and "1 jobs have no result yet" in rest.out


def test_jobs_without_an_answer_have_an_exit_code(command_in, folder):
    (folder / "plan.yaml").write_text(PLAN + "limits: {memory: 1 MB}\n")
    ended = command_in(folder, "batch", "plan.yaml", "--out", "out", "--workers", "1")
    assert ended.code == 1 and "out of memory" in ended.out


@pytest.mark.parametrize(
    "options, words",
    [
        (("--shard", "x"), "--shard takes a number and how many there are, such as 3/64, not 'x'."),
        (("--shard", "0/3"), "no shard 0 of 3"),
        (("--cluster", "tcp://1", "--workers", "2"), "A cluster has its own workers"),
    ],
)
def test_wrong_options_are_one_sentence(command_in, folder, options, words):
    ended = command_in(folder, "batch", "plan.yaml", "--out", "out", *options)
    assert ended.code == 2 and words in ended.errors and ended.errors.count("\n") == 1
    assert not (folder / "out").exists()
