"""`--workers` and `--cluster`; tests/slow/cli compares the results of all of them."""

import pytest

JOB = """\
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.32, 0.20], [0.32, 0.21]]}
limits: {speed: 0.15 m/s, joint_acceleration: 2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {compensation: {method: inverse}}}
"""
OVER = ("--over", "x: -30 mm .. 30 mm, 3", "--no-refine")


@pytest.fixture
def job(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(JOB, encoding="utf-8")
    return file


def test_results_do_not_depend_on_the_workers(command, job, tmp_path):
    tables = []
    for count in (0, 1):
        out = tmp_path / str(count)
        ended = command("place", job, "--out", out, *OVER, "--workers", count)
        assert ended.code == 0, ended.errors
        tables.append((out / "placement.csv").read_bytes())
    assert tables[0] and tables[0] == tables[1]


def test_wrong_options_are_refused(job, refused, tmp_path):
    both = ("--cluster", "tcp://127.0.0.1:1", "--workers", 2)
    rows = [(("place", job, "--out", "out", *OVER, *both), ["has its own workers"])]
    assert refused(tmp_path, rows, codes=(2,)) == []
