"""Runs that are added, removed and made of pins."""

from armcontour._yaml import load
from armcontour.io import parse_job
from armcontour.io.job_edits import change_data, change_text
from armcontour.studio.variants import remove_run

JOB = """\
name: a
arm: pmk3s
path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.26]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  first: {compensation: {method: none}}
  second: {}
experiment: {runs: [first, second]}
certificate: {tolerance: 9 mm, run: second}
placement: {every: true, run: second}
published:
  source: a
  runs: {first: {}, second: {duration: 1 s}}
  time_stamps: {run: second, values: []}
"""


def test_a_run_is_removed_with_all_that_names_it() -> None:
    data = load(JOB, "")
    changes = remove_run(data, "second")
    gone = change_data(data, changes)
    assert list(gone["runs"]) == ["first"] and gone["experiment"] == {"runs": ["first"]}
    assert gone["certificate"] == {"tolerance": "9 mm"} and gone["placement"] == {"every": True}
    assert gone["published"] == {"source": "a", "runs": {"first": {}}}
    # So the job is one still.
    assert [x.name for x in parse_job(change_text(JOB, changes)).runs] == ["first"]
    # Where nothing names it, only the run goes.
    kept = change_data(data, remove_run(data, "first"))
    assert kept["certificate"] == data["certificate"]
    assert kept["published"]["time_stamps"] == data["published"]["time_stamps"]
