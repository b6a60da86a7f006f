"""Width and frequency of the weaves that runs plan."""

import itertools

import numpy as np
import pytest
from tests.geometry.tables import each

from armcontour.core.render import plain
from armcontour.files.job_file import parse_job
from armcontour.jobs import advise
from armcontour.jobs.run_job import run

JOB = """\
name: weld
arm: pmk3s
path: {points: [[0.30, 0.20], [0.31, 0.20], [0.32, 0.201], [0.33, 0.203], [0.34, 0.206]]}
limits: {speed: 0.15 m/s, joint_acceleration: 20}
corners: {tolerance: 0.1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
process: {weave: {width: 3 mm, frequency: 2 Hz, speed: 6 mm/s}}
runs:
  only: {timing: {reserve: 2 %}}
"""


def test_a_run_reports_the_planned_weave():
    job = parse_job(JOB)
    plan = run(job, simulate=False).runs["only"]
    (weave,) = plan.weaves
    assert weave.width == pytest.approx((3e-3, 3e-3), rel=0.02)
    assert weave.frequency == pytest.approx((2.0, 2.0), rel=0.02)
    assert any(weave.sentence in x for x in plan.remarks) and not weave.differs
    assert not any("weaves" in x for x in plan.warnings)
    assert plain(plan.to_data())["weaves"][0]["left_out"] == 0.0


def test_a_resumed_weave_is_measured_on_the_rest_of_the_seam():
    text = JOB.replace("process: {", "process: {resume_at: 20 mm, ")
    plan = run(parse_job(text), simulate=False).runs["only"]
    assert (
        plan.trajectory.duration
        < run(parse_job(JOB), simulate=False).runs["only"].trajectory.duration
    )
    (weave,) = plan.weaves
    assert weave.width == pytest.approx((3e-3, 3e-3), rel=0.02)
    assert weave.frequency == pytest.approx((2.0, 2.0), rel=0.02)
    # Less than a wave remains, so there is nothing to measure.
    late = run(parse_job(JOB.replace("process: {", "process: {resume_at: 90 mm, ")), simulate=False)
    assert late.runs["only"].weaves == ()


ODD = (
    ("joint_acceleration: 20", "joint_acceleration: 0.5", "instead of 3 mm at 2 Hz"),
    ("[0.34, 0.206]", "[0.3301, 0.2033], [0.34, 0.2033]", "and omits"),
)


@each("old, new, word", ODD)
def test_a_warning_reports_a_weave_that_differs_from_the_requested_one(old, new, word):
    text = JOB.replace(old, new).replace("0.1 mm", "0.2 mm")
    assert text != JOB
    plan = run(parse_job(text), simulate=False).runs["only"]
    (weave,) = plan.weaves
    assert weave.differs and word in weave.sentence and weave.sentence in plan.warnings
    assert not any(weave.sentence in x for x in plan.remarks)


def test_middle_of_a_weave_that_leaves_the_lines_of_the_path_is_reported():
    # Both vertices turn by 20 degrees.
    bent = "[[0.30, 0.20], [0.33, 0.20], [0.358, 0.2103], [0.374, 0.2226]]"
    text = JOB[: JOB.index("path:")] + f"path: {{points: {bent}}}" + JOB[JOB.index("\nlimits") :]
    plan = run(parse_job(text), simulate=False).runs["only"]
    (weave,) = plan.weaves
    # The seam is compared with the lines by the distance of its points from them.
    corners = np.array([[0.30, 0.20], [0.33, 0.20], [0.358, 0.2103], [0.374, 0.2226]])
    seam = plan.path.contours[0].woven.seam
    points = seam(np.linspace(0, seam.length, 4001))
    distances = []
    for a, b in itertools.pairwise(corners):
        share = np.clip((points - a) @ (b - a) / np.sum((b - a) ** 2), 0, 1)
        distances.append(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    assert weave.deviation == pytest.approx(np.min(distances, axis=0).max(), rel=1e-2)
    assert weave.deviation > 0.5e-3 and weave.deviation_sentence in plan.warnings
    # The remedy of the warning: points on the lines, 1 mm from both vertices.
    straight = []
    for a, b in itertools.pairwise(corners):
        along = (b - a) / np.linalg.norm(b - a)
        straight += [a, a + 1e-3 * along, b - 1e-3 * along]
    points = [[round(float(x), 9) for x in p] for p in [*straight, corners[-1]]]
    plan = run(parse_job(text.replace(bent, str(points))), simulate=False).runs["only"]
    (weave,) = plan.weaves
    assert weave.deviation < 1e-5 and weave.deviation_sentence not in plan.warnings


def test_a_limiting_travel_speed_is_named_and_its_change_suggested():
    job = parse_job(JOB)
    result = run(job).runs["only"]
    limit = result.to_data()["time_limit"]
    assert limit.value == "assigned velocity" and "6 mm/s" in limit.note
    edits = {key: value for x in advise(job, result).improvements for key, value in x.edits}
    assert edits["process.weave.speed"] == pytest.approx(7.2e-3)
    capped = run(parse_job(JOB.replace("0.15 m/s", "5 mm/s"))).runs["only"]
    assert "mm/s" not in capped.to_data()["time_limit"].note


def advised(text, key):
    """The result of a job, and the value that advice has for a key of its weave."""
    job = parse_job(text)
    result = run(job).runs["only"]
    edits = {key: value for x in advise(job, result).improvements for key, value in x.edits}
    return result, edits[f"process.weave.{key}"]


def test_a_weave_is_named_as_the_cause_where_its_curves_limit_the_speed():
    """On the same line without a weave, joints reach their limits only at the ends."""
    slow = JOB.replace("joint_acceleration: 20", "joint_acceleration: 0.5")
    by_pitch = slow.replace("frequency: 2 Hz, speed: 6 mm/s", "pitch: 3 mm")
    straight = run(
        parse_job(slow.replace("weave: {width: 3 mm, frequency: 2 Hz, speed: 6 mm/s}", ""))
    )
    note = straight.runs["only"].to_data()["time_limit"].note
    for text, key, old in ((slow, "frequency", "2 Hz"), (by_pitch, "pitch", "3 mm")):
        result, value = advised(text, key)
        assert "weave" in result.to_data()["time_limit"].note and "weave" not in note
        changed = run(parse_job(text.replace(old, f"{value:.12g}"))).runs["only"]
        assert changed.trajectory.duration < 0.95 * result.trajectory.duration


def test_a_lower_frequency_is_suggested_if_the_robot_does_not_follow_the_weave():
    robot = JOB + "plant: {kp: 20 1/s, kv: 150 1/s}\n"
    error = run(parse_job(robot + "accuracy: 3 mm\n")).runs["only"].verdict.off_drawing
    text = f"{robot}accuracy: {0.9 * error:.9f}\n"
    result, value = advised(text, "frequency")
    assert result.kept is False and value < 2.0
    assert run(parse_job(text.replace("2 Hz", f"{value:.12g}"))).runs["only"].kept is True


def test_a_woven_seam_with_a_tool_axis_per_waypoint_is_executed_without_a_stop(tmp_path):
    angles = np.linspace(0, 2 * np.pi, 49)
    rows = ["x [mm],y [mm],z [mm],ax,ay,az"]
    for angle in angles.tolist():
        x = 60 * np.cos(angle)
        y = 45 * np.sin(angle)
        z = 6 * np.cos(2 * angle)
        leaning = f"{0.3 * np.cos(angle):.3f},{0.3 * np.sin(angle):.3f},-1"
        rows.append(f"{x:.3f},{y:.3f},{z:.3f},{leaning}")
    (tmp_path / "ring.csv").write_text("\n".join(rows))
    text = """\
name: ring
arm: {name: ur5e, tool: {position: [0, 0, 0.3]}, work: {position: [0.4, -0.1, 0.05]}}
path: {file: ring.csv}
process: {weave: {width: 4 mm, frequency: 1.5 Hz, speed: 6 mm/s}}
limits: {speed: 25 mm/s}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 8 ms
runs: {weld: {timing: {reserve: 2 %}}}
"""
    result = run(parse_job(text, folder=tmp_path)).runs["weld"]
    assert result.kept and result.stops_of_path == {} and result.full_stops == {}
    (weave,) = result.weaves
    assert weave.width == pytest.approx((4e-3, 4e-3), rel=0.02)
    assert weave.frequency == pytest.approx((1.5, 1.5), rel=0.02)
    assert "t = " in result.evaluation.to_data()["speed_ratio"].note
