"""A tool that leans within a cone around its required axis."""

import numpy as np
import pytest
from tests.files.tables import refusals
from tests.oracle.head_machine import angles
from tests.planning.test_four_axes import gantry, gantry_poses, urdf_arm
from tests.planning.tracing import cone_jobs
from tests.robot.test_positioner import angles_to_gravity, cell, saddle

import armcontour as ac
from armcontour.files import parse_job

CONE = np.radians(10)
LINE = ac.Path.polyline([(0.5, -0.4, 0.2), (0.5, 0.4, 0.2)])


@pytest.fixture(scope="module")
def arm():
    return cone_jobs.load_arm()


def test_a_cone_never_makes_a_plan_slower_and_is_never_exceeded(arm):
    ratios = []
    for seed in range(5):
        exact, leaning, angle = cone_jobs.compare(cone_jobs.random_path(seed), arm, CONE)
        assert angle <= CONE * (1 + 1e-9)
        ratios.append(leaning / exact)
    assert max(ratios) <= 1 + 1e-6
    assert np.median(ratios) < 0.9


def test_without_a_cone_nothing_changes(arm):
    path = cone_jobs.random_path(0)
    joint_path = ac.trace(path, arm)
    same = ac.trace(path.with_cone(CONE).with_cone(0.0), arm)
    np.testing.assert_array_equal(joint_path.coefficients, same.coefficients)
    assert cone_jobs.judge(path, joint_path)[1] < 1e-8


def test_line_through_the_singularity_of_the_wrist_is_as_fast_as_its_speed(arm):
    path = LINE.pointing((0.02, 1, -0.05)).with_cone(CONE)
    limited = arm.with_limits(arm.limits.replace(speed=0.25))
    planned = ac.plan(path, limited)
    assert planned.duration < path.length / 0.25 + 0.1
    (law,) = planned.laws
    distance, angle = cone_jobs.judge(path, law.joint_path)
    assert distance < 1e-9
    assert angle <= CONE


def test_a_leaning_tool_reaches_farther(arm):
    path = ac.Path.polyline([(-0.2, 1.29, 0.2), (0.2, 1.29, 0.2)]).pointing((0, 0, -1))
    with pytest.raises(ac.Unreachable):
        ac.trace(path, arm)
    distance, angle = cone_jobs.judge(path, ac.trace(path.with_cone(CONE), arm))
    assert distance < 1e-9
    assert 0 < angle <= CONE


def test_the_axis_of_the_leaning_tool_stays_near_gravity():
    tilt = np.radians(10)
    table = cell(tilt)
    path = saddle().with_cone(CONE)
    planned = ac.plan(path, table.with_limits(table.limits.replace(speed=0.1)))
    assert planned.duration < ac.plan(saddle(), table, ac.Limits(speed=0.1)).duration
    (law,) = planned.laws
    s = np.linspace(0, path.length, 3000)
    q = law.joint_path(s)
    assert angles_to_gravity(table, q).max() <= tilt
    axis = table.forward(q)[:, :3, 2]
    assert 0.01 < angles(axis, path.orientation(s)[:, :, 2]).max() <= CONE


def test_every_contour_of_a_program_leans_and_begins_where_the_last_one_ended(arm):
    paths = [cone_jobs.random_path(seed).with_cone(CONE) for seed in (1, 2)]
    joined = [ac.Contour(path=paths[0]), ac.Contour(path=paths[0].reversed())]
    apart = [ac.Contour(path=x) for x in paths]
    for contours in (joined, apart):
        program = ac.Program(moves=tuple(contours))
        planned = ac.plan(program, arm)
        exact = ac.plan(program.with_cone(0.0), arm)
        assert planned.duration < 0.95 * exact.duration
        for contour, span in zip(contours, planned.contour_spans, strict=True):
            motion = span.trajectory
            t = np.linspace(0, motion.duration, 800)
            points, axes = cone_jobs.tool_at(motion(t))
            s = np.clip(motion.s(t), 0, contour.path.length)
            assert np.linalg.norm(points - contour.path(s), axis=1).max() < 1e-9
            required = contour.path.orientation(s)[:, :, 2]
            assert angles(axes, required).max() <= CONE * (1 + 1e-9)
    # The second contour starts at the joint positions at which the first one ends.
    kinds = [x.kind for x in ac.plan(ac.Program(moves=tuple(joined)), arm).spans]
    assert kinds == ["contour", "contour"]


def test_a_cone_survives_what_is_made_of_a_path():
    path = ac.Path.polyline([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0.2, 0.1, 0)])
    coned = path.pointing((0, 0.1, -1)).with_cone(CONE)
    following = path.following_tangent((0, 0, 1), axis_only=True).with_cone(CONE)
    made = [
        coned.reversed(),
        coned.placed(ac.Frame(position=(0.1, 0, 0)), scale=2.0),
        coned
        + ac.Path.polyline([(0.2, 0.1, 0), (0.3, 0.1, 0)]).pointing((0, 0.1, -1)).with_cone(CONE),
        ac.round_corners(coned, tolerance=1e-3),
        ac.round_corners(following, tolerance=1e-3, angular_tolerance=0.05),
    ]
    assert [x.orientation.cone for x in made] == [CONE] * len(made)
    sharp = ac.Path.polyline([(0.2, 0.1, 0), (0.3, 0.1, 0)]).pointing((0, 0.1, -1))
    assert (coned + sharp).orientation.cone == 0.0


def test_cones_without_a_free_tool_axis_are_refused():
    whole = LINE.oriented(np.diag([1.0, -1.0, -1.0]))
    refusals(
        lambda x: x[0].with_cone(x[1]),
        [
            ((LINE, 0.1), "prescribes none"),
            ((whole, 0.1), "rotation about this axis must be free"),
            ((LINE.pointing((0, 0, -1)), 1.2), "must be from 0"),
            ((LINE.pointing((0, 0, -1)), -0.1), "must not be negative"),
        ],
    )


JOB = """
name: seam
arm: {name: ur10e, tool: {position: [0, 0, 0.15]}}
path:
  points: [[0.5, -0.3, 0.2], [0.55, -0.1, 0.3], [0.5, 0.05, 0.3], [0.6, 0.3, 0.2]]
  orientation:
    - {axis: [0, 0.4, -1], cone: 10 deg}
    - {axis: [0.3, 0.4, -1], cone: 10 deg}
    - {axis: [-0.2, -0.4, -1], cone: 10 deg}
    - {axis: [0, -0.4, -1], cone: 10 deg}
corners: {tolerance: 4 mm, angular_tolerance: 3 deg}
limits: {speed: 1 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {weld: {}}
"""


def run_of(text, **options):
    return ac.run(parse_job(text, **options)).runs["weld"]


def test_job_with_a_cone_shows_the_angle_used():
    run = run_of(JOB)
    exact = run_of(JOB.replace(", cone: 10 deg", ""))
    assert run.trajectory.duration < 0.95 * exact.trajectory.duration
    (row,) = [x for x in run.to_data().rows if x.name == "lean"]
    (law,) = run.trajectory.laws
    assert row.value == pytest.approx(
        cone_jobs.judge(run.path.contours[0].path, law.joint_path)[1], rel=1e-3
    )
    assert 0.01 < row.value <= CONE
    # The tool is inside the cone, so its orientation has no error.
    assert run.evaluation.orientation_error.max < 1e-6
    assert not [x for x in exact.to_data().rows if x.name == "lean"]


def test_cones_that_differ_are_refused():
    refusals(
        parse_job,
        [(JOB.replace("cone: 10 deg", "cone: 5 deg", 1), "cones from 5 to 10 deg")],
    )


WALL = """
name: wall
arm: {name: ur10e, tool: {position: [0, 0, 0.15]}}
path: {points: [[0.6, -0.2, 0.1], [0.6, 0.2, 0.1]], orientation: {axis: [0, 0, -1], cone: CONE}}
limits: {speed: 100 mm/s}
scene: {obstacles: [{type: box, name: wall, size: [0.02, 1.0, 0.6], at: [0.65, 0, 0.32]}]}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {weld: {}}
"""


def test_a_leaning_tool_avoids_an_obstacle():
    with pytest.raises(ac.Collision):
        run_of(WALL.replace("CONE", "0 deg"))
    run = run_of(WALL.replace("CONE", "10 deg"))
    (law,) = run.trajectory.laws
    distance, angle = cone_jobs.judge(run.path.contours[0].path, law.joint_path)
    assert distance < 1e-9
    assert 0 < angle <= CONE


def test_a_table_of_waypoints_with_axes_has_a_cone(tmp_path):
    (tmp_path / "seam.csv").write_text(
        "x [m],y [m],z [m],ax,ay,az\n0.5,-0.2,0.2,0,0.2,-1\n0.5,0.2,0.2,0,-0.2,-1\n"
    )
    text = (
        "{name: x, arm: ur10e, path: {file: seam.csv, orientation: {cone: 5 deg}}, "
        "servo: {kp: 25, kv: 150}, runs: {weld: {}}}"
    )
    job = parse_job(text, folder=tmp_path)
    (contour,) = job.path.contours
    assert contour.path.orientation.cone == pytest.approx(np.radians(5))


def test_a_resumed_job_keeps_the_leaning_tool():
    whole = run_of(JOB).trajectory
    text = JOB.replace("runs:", "process: {resume_at: 0.3}\nruns:")
    rest = run_of(text).trajectory
    (law,) = whole.laws
    (rest_law,) = rest.laws
    s = np.linspace(0, rest_law.joint_path.length, 200)
    along = s + law.joint_path.length - rest_law.joint_path.length
    np.testing.assert_allclose(rest_law.joint_path(s), law.joint_path(along), atol=2e-3)
    np.testing.assert_allclose(rest_law.joint_path(0.0), law.joint_path(along[0]), atol=1e-7)


def test_a_machine_with_one_tool_axis_follows_paths_whose_cone_contains_it(tmp_path):
    vertical = urdf_arm(tmp_path, gantry("0 0 1"))
    line = ac.Path.polyline([(-1, -1, 0.6), (1, 1, 0.6)])
    path = line.pointing((np.sin(np.radians(8)), 0, -np.cos(np.radians(8))))
    with pytest.raises(ac.Unreachable):
        ac.trace(path.with_cone(np.radians(7)), vertical)
    joint_path = ac.trace(path.with_cone(np.radians(9)), vertical)
    s = np.linspace(0, path.length, 200)
    poses = gantry_poses(joint_path(s), (0, 0, 1))
    np.testing.assert_allclose(poses[:, :3, 3], path(s), atol=1e-9)
    np.testing.assert_allclose(poses[:, :3, 2], np.tile([0, 0, -1.0], (200, 1)), atol=1e-12)
