"""Runs avoid collisions: other configurations, raised rapids, refusals."""

import dataclasses
import pickle
import sys

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics
from tests.geometry.tables import refused

import armcontour as ac
from armcontour.core.errors import Collision
from armcontour.core.frames import Frame
from armcontour.core.render import plain
from armcontour.files import parse_job
from armcontour.jobs import JobResult, run
from armcontour.robot.scene import ArmShapes, Box, Capsule, Cylinder, LinkShape, Obstacle, Scene

# Stand-ins of the links of a UR5e.
LINKS = (
    ("upper arm", 2, Capsule(radius=0.055, length=0.425), ([-0.2125, 0, 0.13], [0, np.pi / 2, 0])),
    ("forearm", 3, Capsule(radius=0.05, length=0.39), ([-0.195, 0, 0.01], [0, np.pi / 2, 0])),
    ("wrist 1", 4, Capsule(radius=0.045, length=0.06), ([0, 0, 0], [0, 0, 0])),
    ("wrist 3", 6, Capsule(radius=0.04, length=0.03), ([0, 0, -0.015], [0, 0, 0])),
    ("torch", 6, Cylinder(radius=0.005, length=0.1), ([0, 0, 0.05], [0, 0, 0])),
)
*BODY, TORCH = (
    LinkShape(name=name, link=k, shape=shape, place=Frame.rpy(*place))
    for name, k, shape, place in LINKS
)
SHAPES = ArmShapes(shapes=tuple(BODY)).with_tool([TORCH])
JOB = """
name: cell
title: two seams
arm: ur5e
path: {points: [[0.40, 0, 0.1], [0.45, 0, 0.1]]}
limits: {speed: 0.1}
servo: {kp: 25, kv: 150}
cycle: 0.004
runs: {compensated: {timing: {method: optimal}, compensation: {method: inverse}}}
"""
OTHER = "the arm uses another configuration, because the contours are collision-free in it"


def seams(*places):
    """Contours of 40 mm along y at these places."""
    ends = [[[x, y - 0.02, 0.1], [x, y + 0.02, 0.1]] for x, y in places]
    paths = [ac.Path.polyline(x).pointing([0, 0, -1]) for x in ends]
    contours = (ac.Contour(path=x, name=f"seam {k}") for k, x in enumerate(paths))
    return ac.Program(moves=tuple(contours))


@pytest.fixture(scope="module")
def job():
    parsed = parse_job(JOB, source="test")
    arm = parsed.arm.with_tool(Frame(position=[0, 0, 0.1])).with_shapes(SHAPES)
    return dataclasses.replace(parsed, arm=arm, path=seams((0.40, 0), (0.50, 0)))


def plan_of(job, **changed):
    (plan,) = run(dataclasses.replace(job, **changed), simulate=False).runs.values()
    return plan


@pytest.fixture(scope="module")
def free(job):
    return plan_of(job)


def box(name, size, position, **values):
    place = Frame(position=position)
    return Obstacle(name=name, shape=Box(size=size), place=place, **values)


def wall(x, width=0.2):
    """A thin wall of 60 mm across x."""
    return Scene(obstacles=(box("wall", [0.01, width, 0.06], [x, 0.0, 0.11]),))


def post_at_elbow(job, plan, t=0.0):
    """A post at the position of the elbow at time t of a plan."""
    elbow = job.arm.links(plan.trajectory(t))[3]
    return Scene(obstacles=(box("post", [0.06, 0.06, 0.06], elbow + [0, 0, 0.03]),))


@needs_dynamics
def test_a_rapid_through_a_wall_is_refused_and_approach_and_retract_raise_it(job, free):
    assert free.clearance.satisfied and free.avoided == ()
    walled = dataclasses.replace(job, scene=wall(0.45))
    with pytest.raises(Collision, match=r"rapid after .*process\.approach and process\.retract"):
        run(walled, simulate=False)
    plan = plan_of(walled, process=ac.Process(approach=0.06, retract=0.06))
    assert plan.clearance.satisfied and plan.avoided == ()
    assert plan.trajectory.duration > free.trajectory.duration
    torch = job.arm.tool_position(plan.trajectory(np.linspace(0, plan.trajectory.duration, 2000)))
    inside = (np.abs(torch[:, 0] - 0.45) < 0.01) & (torch[:, 2] < 0.14)
    assert not inside.any()
    data = plain(JobResult(job=walled, runs={"compensated": plan}).to_data())["runs"][
        "compensated"
    ]["clearance"]
    assert data["kept"] is True


@needs_dynamics
def test_collisions_are_refused_with_pair_position_and_time(job):
    blocked = dataclasses.replace(job, scene=wall(0.50, width=0.02))
    with pytest.raises(Collision, match=r"\(seam 1\): torch and wall touch, first at t = ") as e:
        run(blocked, simulate=False)
    assert e.value.t is not None and e.value.exit_code == 8
    assert abs(e.value.point[0] - 0.5) < 0.02


@needs_dynamics
def test_contours_avoid_a_collision_by_another_configuration(job, free, monkeypatch):
    alone = dataclasses.replace(job, path=job.program.contours[0].path)
    single = plan_of(alone, scene=post_at_elbow(alone, plan_of(alone)))
    assert single.clearance.satisfied and single.avoided == (OTHER,)
    # The first contour decides before all are timed.
    monkeypatch.setattr("armcontour.jobs.alternatives.find_starts", None)
    plan = plan_of(job, scene=post_at_elbow(job, free))
    assert plan.clearance.satisfied and plan.avoided == (OTHER,)
    assert np.abs(plan.trajectory(0.0) - free.trajectory(0.0)).max() > 0.1
    assert job.arm.tool_position(plan.trajectory(0.0)) == pytest.approx([0.4, -0.02, 0.1], abs=1e-9)


def test_unknown_and_unreadable_shapes_are_reported(job):
    def lacking():
        raise ac.InvalidInput("The mesh is not there.")

    bare = dataclasses.replace(job, arm=job.arm.with_shapes(lacking))
    plan = plan_of(bare)
    assert plan.clearance is None
    assert not [x for x in plan.warnings if "self-collision is not checked" in x]
    # They matter where a scene asks for clearance.
    refused((lambda: plan_of(bare, scene=Scene()), "mesh is not there"))
    plan = plan_of(job, arm=job.arm.with_shapes(None))
    assert plan.clearance is None
    assert [x for x in plan.warnings if "links are unknown" in x]


def test_a_missing_clearance_library_causes_a_warning(job, monkeypatch):
    monkeypatch.setitem(sys.modules, "coal", None)
    plan = plan_of(job)
    assert plan.clearance is None
    assert [x for x in plan.warnings if "self-collision is not checked" in x and "[dynamics]" in x]
    refused((lambda: plan_of(job, scene=Scene()), "coal", "[dynamics]"))


@needs_dynamics
def test_the_executed_motion_is_also_checked(job):
    job_result = ac.run(job)
    result = job_result.runs["compensated"]
    planned = result.clearance
    executed = result.executed_clearance
    assert executed.satisfied
    assert executed.pairs[0].high == pytest.approx(planned.pairs[0].high, abs=1e-3)
    # The job goes to other processes without its cell.
    there = pickle.loads(pickle.dumps(job))
    names = [[(x.first.name, x.second.name) for x in y.cell.pairs] for y in (job, there)]
    assert names[0] == names[1] and there.cell is not job.cell and there.cell.pairs


@needs_dynamics
def test_obstacles_of_a_planar_arm_have_the_coordinates_of_its_path():
    arm = ac.load_arm("pmk3s")
    path = ac.Path.polyline([(0.30, 0.20), (0.40, 0.20)])
    planar = parse_job(JOB.replace("ur5e", "pmk3s").replace(", 0.1]", "]"), source="test")
    for fixed_to in ("base", "part"):
        post = box("post", [0.01, 0.01, 0.1], [0.50, 0.15, 0.0], fixed_to=fixed_to)
        plan = plan_of(planar, path=ac.Program.from_path(path), scene=Scene(obstacles=(post,)))
        (pair,) = (x for x in plan.clearance.pairs if {x.first, x.second} == {"link 2", "post"})
        # From the post to the stretch within the second link, over all of the motion.
        q = plan.trajectory(np.linspace(0, plan.trajectory.duration, 500))
        elbow, tool = arm.links(q)[:, 1:].swapaxes(0, 1)
        along = np.linspace(0, 1 - 0.03 / 0.215, 300)[:, None, None]
        corners = np.abs(elbow + along * (tool - elbow) - [0.50, 0.15]) - 0.005
        brute = np.linalg.norm(np.maximum(corners, 0), axis=-1).min() - 0.03
        assert pair.low - 1e-4 <= brute <= pair.high + 1e-4


CLAMPED = """
name: cut
arm: {name: ur5e, tool: {position: [0, 0, 180 mm]SHAPES}}
path: {points: [[0.40, 0.1, 0.15], [0.45, 0.1, 0.15]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.1, joint_acceleration: 5}
servo: {kp: 25, kv: 150}
scene: {obstacles: [{type: box, name: clamp, at: [0.43, 0.1, 0.26], size: [10 mm, 200 mm, 40 mm]}]}
runs: {compensated: {}}
"""


@needs_dynamics
def test_a_tool_without_shapes_is_a_capsule_from_the_flange():
    def clamped(text, shapes):
        return plan_of(parse_job(text.replace("SHAPES", shapes)))

    refused((lambda: clamped(CLAMPED, ""), "tool and clamp touch"), kind=Collision)
    far = CLAMPED.replace("0.43, 0.1, 0.26", "0.43, 0.4, 0.26")
    clear = clamped(far, "")
    assert clear.clearance.satisfied and any("capsule" in x for x in clear.avoided)
    # Specified shapes, or an empty list, replace it.
    tip = ", shapes: [{type: sphere, name: tip, at: [0, 0, 150 mm], radius: 5 mm}]"
    assert not [x for x in clamped(far, tip).avoided if "tool" in x]
    thin = clamped(CLAMPED, ", shapes: []")
    assert ["no shape" in x for x in thin.avoided if "tool" in x] == [True]
    assert any("clearance of the tool is not checked" in x for x in thin.remarks)


ELBOW = """
name: elbow
arm: {name: ur10e, tool: {position: [0, 0, 150 mm]}, work: {position: [0.65, 0.10, 0.05]}}
path:
  points: [[-0.02, 0.02, 0], [0.02, 0.02, 0], [0.02, 0.08, 0], [-0.02, 0.08, 0]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 40 mm/s, centripetal_acceleration: 1 m/s^2, joint_acceleration: 4 rad/s^2}
corners: {tolerance: 0.1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {cut: {timing: {reserve: 5 %}}}
"""


def lowest(result, job):
    """The lowest place of the axes of all joints beyond the second, from the base [m]."""
    motion = result.trajectory(np.linspace(0, result.trajectory.duration, 500))
    height = job.arm.links(motion)[..., 2] - job.arm.chain.base.position[2]
    return float(height[:, 3:-1].min())


@pytest.fixture(scope="module")
def below():
    """The fastest clear plan of that job, of which the elbow is below the base."""
    job = parse_job(f"{ELBOW}scene: {{floor: none}}\n", source="test")
    (run_result,) = run(job, simulate=False).runs.values()
    assert lowest(run_result, job) == pytest.approx(-0.25, abs=0.1)
    assert run_result.clearance.below == () and not any(
        "below the base" in x for x in run_result.warnings
    )
    return run_result.trajectory


@needs_dynamics
def test_configurations_that_stay_above_the_base_are_preferred(below):
    job = parse_job(ELBOW, source="test")
    (run_result,) = run(job, simulate=False).runs.values()
    assert lowest(run_result, job) > 0 and run_result.clearance.below == ()
    assert below.duration < run_result.trajectory.duration
    assert not any("below the base" in x for x in run_result.warnings)
    start = dataclasses.replace(job, seed=below(0.0))
    (low,) = run(start, simulate=False).runs.values()
    sentence = low.clearance.below_base
    assert any(sentence in x for x in low.warnings)
    (page,) = plain(JobResult(job=start, runs={"cut": low}).to_data())["runs"].values()
    assert page["clearance"]["below_base"] == sentence
