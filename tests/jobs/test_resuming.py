"""Resumed jobs keep the configuration of the whole job."""

from dataclasses import replace

import numpy as np
import pytest
from docs.pages import run_command
from soak import resuming
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.errors import Collision
from armcontour.core.frames import Frame
from armcontour.files import parse_job
from armcontour.robot.scene import Box, Obstacle, Scene

# Angles of an arc around the base, which crosses the angle at which the inverse kinematics jumps.
BEFORE, AFTER = np.radians([30.0, 330.0])
RADIUS = 0.35
# A post that the arm touches on its approach to the middle of the seam, but not on that to its
# start: its distance above the elbow [m], and its size [m].
ABOVE_ELBOW = 0.06
POST = 0.04


@pytest.mark.parametrize(
    ("name", "shares"),
    [("planar", [0.03, 0.4]), ("spatial", [0.2, 0.9]), ("leads", [0.02, 0.6]), ("drawing", [0.7])],
)
def test_a_resumed_job_starts_with_the_joints_of_the_whole_job(name, shares):
    assert [resuming.judge(name, x) for x in shares] == [[] for _ in shares]


@needs_dynamics
def test_a_resumed_job_keeps_the_alternative_of_the_whole_job():
    assert resuming.judge("avoiding", 0.5) == []
    job, whole = resuming.whole_plan("avoiding")
    rest = resuming.plan_of(resuming.resume(job, 0.1))
    assert rest.avoided == whole.avoided and "another configuration" in rest.avoided[0]


def test_resumed_redundant_arm_follows_joint_path_of_whole_job():
    job, whole = resuming.whole_plan("spatial")
    rest = resuming.plan_of(resuming.resume(job, 0.23))
    begins = np.array([x.trajectory.s(x.trajectory.duration) for x in (whole, rest)])
    left = np.linspace(0.01, 0.16, 40)
    (a,), (b,) = (x.traced.joint_paths for x in (whole, rest))
    # The knots differ, so the free rotation about the tool axis differs slightly between them.
    np.testing.assert_allclose(a(begins[0] - left), b(begins[1] - left), atol=1e-4)


@pytest.mark.parametrize("configuration", ["positive", "negative"])
def test_whole_turns_and_a_given_branch_are_kept(configuration):
    job = replace(parse_job(resuming.PLANAR), configuration=configuration)
    angles = np.linspace(BEFORE, AFTER, 30)
    base = np.array([job.arm.base, 0.0])
    points = base + RADIUS * np.column_stack([np.cos(angles), np.sin(angles)])
    job = replace(job, path=ac.Path.polyline(points))
    whole = resuming.plan_of(job)
    ends = whole.trajectory(np.array([0.0, whole.trajectory.duration]))
    # The first joint passes half a turn.
    assert np.abs(ends[:, 0]).max() > np.pi
    resume_at = 0.95 * float(resuming.work_lengths(whole)[-1])
    rest = resuming.plan_of(resuming.resume(job, resume_at))
    joints, gap, _ = resuming.compare(whole, rest, resume_at)
    assert joints < resuming.SAME_JOINTS + resuming.JOINTS_PER_DISTANCE * gap


def test_resumed_job_applies_seed_to_start_of_whole_job():
    job = parse_job(resuming.LED)
    rest = resuming.plan_of(resuming.resume(job, 0.2))
    # Another turn of the base than without a seed.
    assert resuming.start_of_work(rest)[0] < -np.pi


def test_resumed_job_states_why_whole_job_has_no_plan():
    job = parse_job(resuming.PLANAR)
    far = ac.Path.polyline([[0.9, 0.9], [1.0, 0.9]])
    near = job.program.contours[0].path
    both = ac.Program(moves=(ac.Contour(path=far), ac.Contour(path=near)))
    rest = resuming.plan_of(resuming.resume(replace(job, path=both), far.length))
    (warning,) = (x for x in rest.warnings if "whole job has no plan" in x)
    assert "contour 1" in warning.casefold() and "reach" in warning
    assert not any("configuration of the whole job" in x for x in rest.remarks)


@needs_dynamics
def test_a_collision_in_the_kept_configuration_is_refused():
    job = parse_job(resuming.SEAM + "process: {approach: 150 mm}\n")
    elbow = job.arm.links(resuming.plan_of(resuming.resume(job, 0.1)).trajectory(0.0))[3]
    place = Frame(position=elbow + [0.0, 0.0, ABOVE_ELBOW])
    post = Obstacle(name="post", shape=Box(size=[POST, POST, POST]), place=place)
    blocked = replace(job, scene=Scene(obstacles=(post,)))
    assert resuming.plan_of(blocked).clearance.satisfied
    with pytest.raises(Collision, match="in the configuration of the whole job") as error:
        resuming.plan_of(resuming.resume(blocked, 0.1))
    assert "post" in str(error.value)


@pytest.mark.parametrize("name", ["planar", "leads", "drawing"])
def test_overlap_begins_in_the_configuration_of_the_whole_job(name):
    job, whole = resuming.whole_plan(name)
    resume_at = 0.6 * float(resuming.work_lengths(whole)[-1])
    resumed = resuming.resume(job, resume_at)
    rest = resuming.plan_of(replace(resumed, process=replace(resumed.process, rejoin=3e-3)))
    joints, gap, off_place = resuming.compare(whole, rest, resume_at - 3e-3)
    assert off_place < resuming.SAME_PLACE
    assert joints < resuming.SAME_JOINTS + resuming.JOINTS_PER_DISTANCE * gap
    left = resuming.work_lengths(whole)[-1] - resuming.work_lengths(rest)[-1]
    assert left == pytest.approx(resume_at - 3e-3, abs=1e-9)
    assert any("3 mm before" in x for x in rest.remarks)


def test_overlap_of_a_job_file_and_of_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = resuming.PLANAR + "process: {resume_at: 80 mm, rejoin: 5 mm}\n"
    (rest,) = ac.run(parse_job(text), simulate=False).runs.values()
    # The whole job, without these keys, starts at the drawn corner, and is there after 75 mm.
    (whole,) = resuming.plan_of(parse_job(resuming.PLANAR)).objective.contours
    np.testing.assert_allclose(whole.path(0.075), [0.36, 0.175], atol=1e-9)
    np.testing.assert_allclose(rest.objective.contours[0].path(0.0), [0.36, 0.175], atol=1e-9)
    (tmp_path / "job.yaml").write_text(resuming.PLANAR, encoding="utf-8")
    words = ["run", "job.yaml", "--out", "rest", "--resume-at", "80 mm", "--rejoin", "5 mm"]
    code, printed, _ = run_command(words)
    assert code == 0 and "5 mm before 80 mm" in " ".join(printed.split())
    planned = np.loadtxt(tmp_path / "rest/only/planned.csv", delimiter=",", skiprows=1)
    start = ac.load_arm("pmk3s").tool_position(planned[0, 1:3])
    np.testing.assert_allclose(start, [0.36, 0.175], atol=1e-6)


def test_the_command_line_keeps_the_configuration_and_says_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.yaml").write_text(resuming.PLANAR, encoding="utf-8")
    words = ["run", "job.yaml", "--out"]
    assert run_command([*words, "whole"])[0] == 0
    code, printed, _ = run_command([*words, "rest", "--resume-at", "80 mm"])
    assert code == 0 and "in the configuration of the whole job" in " ".join(printed.split())
    whole, rest = (
        np.loadtxt(tmp_path / x / "only" / "planned.csv", delimiter=",", skiprows=1)
        for x in ("whole", "rest")
    )
    arm = ac.load_arm("pmk3s")
    start = arm.tool_position(rest[0, 1:3])
    np.testing.assert_allclose(start, [0.36, 0.18], atol=1e-6)
    near = np.linalg.norm(arm.tool_position(whole[:, 1:3]) - start, axis=1).argmin()
    # Rows of the table are 0.1 mm apart.
    np.testing.assert_allclose(rest[0, 1:3], whole[near, 1:3], atol=2e-3)


AUTOMATIC_LEADS = """
name: holes
arm:
  name: ur5e
  tool: {position: [0, 0, 120 mm]}
seed: [0.2, -1.7, -2.4, -0.6, 1.6, 2.5]
path:
  file: holes.dxf
  frame: {position: [380 mm, -70 mm, 50 mm]}
  orientation: {axis: [0, 0, -1]}
process:
  lead_in: {length: auto, shape: arc}
  approach: 10 mm
  retract: 10 mm
limits: {speed: 60 mm/s, centripetal_acceleration: 1 m/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {timing: {method: optimal}}}
"""


def test_automatic_leads_of_the_rest_need_no_rapids(tmp_path):
    """The whole job has more moves after the place than the contours of which leads are found."""
    drawing = pytest.importorskip("ezdxf").new(units=4)
    for k in range(4):
        drawing.modelspace().add_circle((30.0 * k, 0.0), 5.0)
    drawing.saveas(tmp_path / "holes.dxf")
    job = parse_job(AUTOMATIC_LEADS, folder=tmp_path)
    whole = resuming.plan_of(job)
    circle = 2 * np.pi * 5e-3
    rest = resuming.plan_of(resuming.resume(job, 0.5 * circle))
    assert len(rest.objective.contours) == 4
    ends = [x.trajectory.contour_spans[-1].t[1] for x in (whole, rest)]
    q = [x.trajectory(t) for x, t in zip((whole, rest), ends, strict=True)]
    np.testing.assert_allclose(*q, atol=1e-6)
