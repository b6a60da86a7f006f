"""Stops of a pierce are reported as such, and its height is no lead."""

from tests.geometry.tables import each

from armcontour.files.job_file import parse_job
from armcontour.jobs.run_job import run

JOB = """\
name: cut
arm: {name: ur5e, work: {position: [0.4, -0.05, 0.2]}}
path:
  points: [[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0], [0, 0, 0]]
  orientation: {axis: [0, 0, -1]}
process:
  approach: 10 mm
  pierce: {time: 100 ms, height: 2 mm}
  switch: {name: laser}
limits: {speed: 50 mm/s}
corners: {tolerance: 0.2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {}}
"""


@each("corners, stops", [("0.2 mm", {}), ("0 mm", {"tolerance zero": 3})])
def test_the_stop_at_the_end_of_a_pierce_is_named(corners, stops):
    text = JOB.replace("tolerance: 0.2 mm", f"tolerance: {corners}")
    result = run(parse_job(text), simulate=False).runs["only"]
    assert result.stops_of_path == {"after the pierce": 1, **stops}
    plain = run(parse_job(text.replace("  pierce: {time: 100 ms, height: 2 mm}\n", "")))
    assert plain.runs["only"].stops_of_path == stops


def test_the_length_of_a_lead_is_without_the_pierce_height():
    lead = "process:\n  lead_in: {length: 3 mm, shape: arc, active: true}"
    fast = JOB.replace("process:", lead).replace("speed: 50", "speed: 500")
    (warning,) = [x for x in run(parse_job(fast)).runs["only"].warnings if "lead" in x]
    assert "3 mm" in warning
    assert "5 mm" not in warning
