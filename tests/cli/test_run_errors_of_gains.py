"""A run prints the estimated contour error of a robot with other gains."""

import json

import pytest

import armcontour as ac

JOB = """
name: corner
arm: pmk3s
path: {points: [[0.35, 0.1], [0.4, 0.1], [0.4, 0.14]]}
corners: {tolerance: 0.2 mm}
limits: {speed: 100 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {timing: {reserve: 2 %}}}
"""


def test_a_run_prints_and_writes_the_error_of_other_gains(command, tmp_path):
    job = tmp_path / "job.yaml"
    job.write_text(JOB)
    folder = tmp_path / "out"
    code, shown, errors = command("run", job, "--out", folder)
    assert code == 0, errors
    written = json.loads((folder / "summary.json").read_text())
    stated = written["runs"]["only"]["unknown_gains"]["max"]
    expected = ac.run(ac.read_job(job)).runs["only"].unknown_gains.max
    assert stated == pytest.approx(expected)
    (line,) = (x for x in shown.splitlines() if "gains 1 % off" in x)
    assert f"{1e3 * expected:.3g}" in line
