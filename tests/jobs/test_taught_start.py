"""A taught start: the motion begins at joint positions, in whose configuration it continues."""

from dataclasses import replace

import numpy as np
import pytest
from docs.pages import run_command
from tests.controllers.simulated import Simulated
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.controllers import play
from armcontour.files import parse_job

PLANE = """
name: corner
arm: pmk3s
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.350, 0.200]]}
corners: {tolerance: 2 mm}
limits: {speed: 0.15 m/s, centripetal_acceleration: 0.09 m/s²}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {timing: {reserve: 20 %}}}
"""
RAIL = """
name: seam
arm:
  name: ur5e
  rail: {axis: [0, 1, 0], upper: 1 m, velocity: 1 m/s, acceleration: 2 m/s^2}
path: {points: [[-0.5, 0, 0.3], [-0.5, 0.2, 0.3]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.15 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {timing: {reserve: 50 %}}}
"""
# Positions of the rail and the arm with the elbow on either side.
UP = [0.2, 0.0, -1.5, 1.5, -1.5, -1.5, 0.0]
DOWN = [0.2, 0.0, -1.5, -1.5, -1.5, 1.5, 0.0]


def taught(text, joints, more=""):
    """The job with a start, read from its file and made in Python; they must be the same."""
    job = parse_job(f"{text}start_from: {{joints: {joints}}}\n{more}")
    assert np.array_equal(job.start_from, joints)
    python = replace(parse_job(text + more), start_from=joints)
    assert np.array_equal(python.start_from, job.start_from)
    return python


def only(job):
    return ac.run(job).runs["only"]


@pytest.mark.parametrize("elbow", [0.4, -0.4])
def test_the_plan_begins_at_the_start_in_its_configuration(elbow):
    start = [0.6, elbow]
    job = taught(PLANE, start)
    run = only(job)
    plan = run.trajectory
    assert np.array_equal(plan(0.0), start)
    rapid, contour = plan.spans
    assert (rapid.kind, contour.kind) == ("rapid", "contour")
    # The rapid is a straight line of the joints, within their limits, from rest to rest.
    t = np.linspace(*rapid.t, 200)
    q = plan(t)
    along = (q - q[0]) @ (q[-1] - q[0]) / np.sum((q[-1] - q[0]) ** 2)
    assert np.abs(q - q[0] - along[:, None] * (q[-1] - q[0])).max() < 1e-9
    assert (np.diff(along) > -1e-12).all()
    before = plan.sample(1e-3)
    assert 0.5 < np.abs(before.ddq[before.t < rapid.t[1]]).max() < 0.72 * 0.8 + 1e-6
    # The contour has the elbow on the side of the start, and follows the path.
    during = plan(np.linspace(*contour.t, 300))
    assert (np.sign(np.sin(during[:, 1])) == np.sign(elbow)).all()
    assert run.kept and run.evaluation.contour_error.max < 1e-4
    assert np.allclose(run.set_points.q[0], start, atol=1e-9)


def test_a_start_at_the_path_needs_no_rapid():
    free = only(parse_job(PLANE)).trajectory
    run = only(taught(PLANE, free(0.0).tolist()))
    assert run.trajectory.duration == pytest.approx(free.duration, rel=1e-9)
    assert [x.kind for x in run.trajectory.spans] == ["contour"]


@pytest.mark.parametrize(("start", "side"), [(UP, 1), (DOWN, -1)])
def test_external_axes_and_names_of_joints(start, side):
    job = taught(RAIL, start)
    plan = only(job).trajectory
    assert np.array_equal(plan(0.0), start)
    (contour,) = plan.contour_spans
    during = plan(np.linspace(*contour.t, 50))
    assert (np.sign(during[:, 3]) == side).all()
    named = dict(zip(job.arm.joint_names, start, strict=True))
    assert np.array_equal(parse_job(f"{RAIL}start_from: {{joints: {named}}}").start_from, start)
    degrees = [start[0], *(f"{x} deg" for x in np.degrees(start[1:]))]
    read = parse_job(f"{RAIL}start_from: {{joints: [{', '.join(map(str, degrees))}]}}")
    assert np.allclose(read.start_from, start, atol=1e-12)


def test_dwells_follow_the_rapid_and_a_resumed_job_keeps_its_configuration():
    job = taught(PLANE, [0.6, 0.4], "process: {dwell: 0.3 s}\n")
    assert [x.kind for x in only(job).trajectory.spans] == ["rapid", "dwell", "contour"]
    job = taught(PLANE, [0.6, 0.4], "process: {resume_at: 40 mm}\n")
    plan = only(job).trajectory
    whole = only(taught(PLANE, [0.6, 0.4])).trajectory
    assert np.array_equal(plan(0.0), [0.6, 0.4])
    (rest,) = plan.contour_spans
    path = ac.round_corners(job.program.contours[0].path, tolerance=2e-3)
    assert job.arm.tool_position(plan(rest.t[0])) == pytest.approx(path(0.04), abs=1e-6)
    assert np.abs(plan(plan.duration) - whole(whole.duration)).max() < 1e-9


@pytest.mark.parametrize(
    "more",
    [
        "process: {lead_in: {length: auto}}\n",
        "process: {lead_in: {length: 5 mm}, lead_out: {length: 5 mm}}\n",
        "certificate: {tolerance: 2 mm, servo_error: 0.1 mm}\n",
    ],
)
def test_leads_and_other_requirements_can_be_combined(more):
    run = only(taught(PLANE, [0.6, 0.4], more))
    assert np.array_equal(run.trajectory(0.0), [0.6, 0.4])
    assert [x.kind for x in run.trajectory.spans] == ["rapid", "contour"]


@pytest.mark.parametrize("shape", ["arc", "free"])
def test_shapes_of_corners_have_the_configuration_of_the_start(shape):
    text = PLANE.replace("{tolerance: 2 mm}", f"{{tolerance: 2 mm, shape: {shape}}}")
    plan = only(taught(text, [0.6, -0.4])).trajectory
    (contour,) = plan.contour_spans
    assert (np.sin(plan(np.linspace(*contour.t, 100))[:, 1]) < 0).all()


@pytest.mark.parametrize(
    ("text", "joints", "more", "words"),
    [
        (PLANE, "[0.6, 0.4, 0.2]", "", ["start_from.joints has 3 values", "2 joints"]),
        (RAIL, "[0, 0, -1.5, 1.5, -1.5, -1.5]", "", ["has 6 values", "7 joints"]),
        (PLANE, "{joint 1: 0.6}", "", ["start_from.joints names the joints", "joint 2"]),
        (PLANE, "[0.6 mm, 0.4]", "", ["start_from.joints", "rad"]),
        (RAIL, [-0.1, *UP[1:]], "", ["joint 1 (rail) is at -100 mm", "0 mm to 1000 mm"]),
        (RAIL, [*UP[:-1], 6.5], "", ["joint 7", "372 deg", "360 deg"]),
        (PLANE, "[0.6, 0.4]", "seed: [0.6, 0.4]\n", ["start_from", "seed"]),
        (RAIL, UP, f"seed: {UP}\n", ["start_from", "seed"]),
    ],
)
def test_wrong_starts_are_refused_with_their_key(text, joints, more, words, refuses):
    refuses(
        lambda: parse_job(f"{text}start_from: {{joints: {joints}}}\n{more}"),
        ac.InvalidInput,
        *words,
    )


def test_wrong_starts_are_refused_in_python(refuses):
    job = parse_job(RAIL)
    refuses(lambda: replace(job, start_from=UP[1:]), ac.InvalidInput, "start_from", "6", "7")
    refuses(
        lambda: replace(job, start_from=[-0.1, *UP[1:]]),
        ac.InvalidInput,
        "joint 1 (rail)",
        joint=0,
        needed=-0.1,
        allowed=0.0,
    )
    refuses(lambda: replace(job, start_from=UP, seed=UP), ac.InvalidInput, "seed")
    ends = replace(job, runs=(replace(job.runs[0], end_time=2.0),))
    refuses(lambda: replace(ends, start_from=UP), ac.InvalidInput, "end_time", "start_from")


def test_a_whole_turn_to_the_path_is_refused(refuses):
    """Degrees without a unit are rad; the arm's joints have no range."""
    job = taught(PLANE, [100.0, 0.4])
    refuses(lambda: ac.run(job), ac.InvalidInput, "joint 1", "whole turn", "units", joint=0)


def test_a_configuration_that_does_not_complete_the_first_contour_is_refused(refuses):
    """With the elbow on this side, the second joint would leave its range on the path."""
    text = PLANE.replace("limits: {", "limits: {joint_lower: [-3, -0.5], joint_upper: [3, 3], ")
    assert np.sin(only(parse_job(text)).trajectory(0.0)[1]) > 0
    job = taught(text, [0.6, -0.4])
    refuses(lambda: ac.run(job), ac.Unreachable, "in the configuration of start_from")


@needs_dynamics
def test_a_collision_on_the_way_from_the_start_is_refused(refuses):
    """An obstacle is on the way of the tool; without the start, the job is free of it."""
    free = only(parse_job(RAIL)).trajectory(0.0)
    above = free + [0.7, 0.0, -0.6, 0.3, 0.0, 0.0, 0.0]
    at = parse_job(RAIL).arm.tool_position(0.2 * free + 0.8 * above).tolist()
    obstacle = f"{{type: sphere, name: post, radius: 30 mm, at: {at}}}"
    job = parse_job(f"{RAIL}scene: {{obstacles: [{obstacle}]}}\n")
    assert only(job).trajectory.duration > 0
    refuses(
        lambda: ac.run(replace(job, start_from=above)), ac.Collision, "rapid to contour 1", "post"
    )


def test_play_begins_at_the_start():
    job = taught(PLANE, [0.6, 0.4])
    robot = Simulated(late=False, cycle=4e-3, acceleration=100.0, at=np.array([0.6, 0.4]))
    played = play(job, robot, execute=True, override=0.5)
    assert played.distance < 1e-9 and played.approach_speed is None
    assert played.kept, played.reason


def test_run_and_exports_begin_at_the_start(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.yaml").write_text(PLANE, encoding="utf-8")
    start = "start_from.joints=[40 deg, 20 deg]"
    words = ["run", "job.yaml", "--set", start, "--out", "out", "--export", "csv"]
    code, printed, errors = run_command(words)
    assert code == 0, errors
    table = np.genfromtxt(tmp_path / "out/only/set_points.csv", delimiter=",", names=True)
    first = [table[name][0] for name in table.dtype.names]
    assert any(np.allclose(first[k : k + 2], np.radians([40, 20])) for k in range(len(first)))
