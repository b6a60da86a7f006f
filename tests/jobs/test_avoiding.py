"""Runs keep clear: other configurations, rapids around obstacles, refusals."""

import dataclasses
import json
import pickle
import sys

import numpy as np
import pytest

import armcontour as ac
from armcontour.clearance import Cell
from armcontour.errors import Collision
from armcontour.frames import Frame
from armcontour.io import parse_job
from armcontour.io.summary import summarise_taught
from armcontour.jobs import RunPlan, teach
from armcontour.report import render_report
from armcontour.scene import ArmShapes, Box, Capsule, Cylinder, LinkShape, Obstacle, Scene

# Stand-ins of the links of a UR5e.
LINKS = (
    ("upper arm", 2, Capsule(radius=0.055, length=0.425), ([-0.2125, 0, 0.13], [0, np.pi / 2, 0])),
    ("forearm", 3, Capsule(radius=0.05, length=0.39), ([-0.195, 0, 0.01], [0, np.pi / 2, 0])),
    ("wrist 1", 4, Capsule(radius=0.045, length=0.06), ([0, 0, 0], [0, 0, 0])),
    ("wrist 3", 6, Capsule(radius=0.04, length=0.03), ([0, 0, -0.015], [0, 0, 0])),
)
TORCH = LinkShape(
    name="torch",
    link=6,
    shape=Cylinder(radius=0.005, length=0.1),
    place=Frame(position=[0, 0, 0.05]),
)
SHAPES = ArmShapes(
    shapes=tuple(
        LinkShape(name=name, link=k, shape=shape, place=Frame.rpy(*place))
        for name, k, shape, place in LINKS
    )
).with_tool([TORCH])
JOB = """
name: cell
title: two seams
arm: ur5e
path: {points: [[0.40, 0, 0.1], [0.45, 0, 0.1]]}
limits: {speed: 0.1}
servo: {kp: 25, kv: 150}
command_interval: 0.004
runs: {taught: {timing: {method: optimal}, compensation: {method: inverse}}}
"""


@pytest.fixture(scope="module")
def job() -> ac.Job:
    found = parse_job(JOB, source="test")
    arm = found.arm.with_tool(Frame(position=[0, 0, 0.1])).with_shapes(SHAPES)
    seams = [
        ac.Path.polyline([[x, -0.02, 0.1], [x, 0.02, 0.1]]).pointing([0, 0, -1])
        for x in (0.40, 0.50)
    ]
    program = ac.Program(
        moves=tuple(ac.Contour(path=x, name=f"seam {k}") for k, x in enumerate(seams))
    )
    return dataclasses.replace(found, arm=arm, path=program)


def wall(x: float, height: float, *, y: float = 0.0, width: float = 0.2) -> Scene:
    """A thin wall across x."""
    shape = Box(size=[0.01, width, height])
    place = Frame(position=[x, y, 0.08 + height / 2])
    return Scene(obstacles=(Obstacle(name="wall", shape=shape, place=place),))


def test_a_clear_job_says_so(job: ac.Job) -> None:
    (plan,) = teach(job).values()
    assert plan.clearance is not None and plan.clearance.kept
    assert plan.avoided == ()
    assert plan.clearance_note is not None and plan.clearance_note.startswith("Run taught: Clear: ")


def test_a_rapid_goes_around_a_wall(job: ac.Job) -> None:
    walled = dataclasses.replace(job, scene=wall(0.45, 0.06))
    (plan,) = teach(walled).values()
    assert plan.clearance is not None and plan.clearance.kept
    assert plan.avoided == ("1 rapid goes around what the direct way would come too near to",)
    (free,) = teach(job).values()
    assert plan.trajectory.duration > free.trajectory.duration
    # Contours stay the same, and the rapid starts and ends where they end and start.
    kinds = [x.kind for x in plan.trajectory.spans]
    assert kinds == ["contour", "rapid", "contour"]
    torch = job.arm.forward(plan.trajectory(np.linspace(0, plan.trajectory.duration, 2000)))
    inside = (np.abs(torch[:, 0] - 0.45) < 0.01) & (torch[:, 2] < 0.14)
    assert not inside.any()
    data = json.loads(summarise_taught(walled, {"taught": plan}))
    assert data["runs"]["taught"]["clearance"]["kept"] is True
    assert data["runs"]["taught"]["clearance"]["avoided"] == list(plan.avoided)


def test_collisions_are_refused_with_pair_place_and_time(job: ac.Job) -> None:
    blocked = dataclasses.replace(job, scene=wall(0.50, 0.06, width=0.02))
    with pytest.raises(Collision, match="contour seam 1: torch and wall touch, first at t = ") as e:
        teach(blocked)
    assert e.value.t is not None and e.value.point is not None and e.value.exit_code == 8
    assert abs(e.value.point[0] - 0.5) < 0.02
    ignored = dataclasses.replace(blocked, ignore_collisions=True)
    (plan,) = teach(ignored).values()
    assert any("collisions are ignored: torch and wall" in x for x in plan.warnings)
    # One cause, one sentence.
    assert plan.clearance_note is None
    assert plan.clearance is not None and not plan.clearance.kept


def post_at_elbow(job: ac.Job, free: RunPlan) -> ac.Job:
    """The job with a post where a plan has the elbow at its start."""
    elbow = job.arm.links(free.trajectory(0.0))[3]
    post = Obstacle(
        name="post", shape=Box(size=[0.06, 0.06, 0.06]), place=Frame(position=elbow + [0, 0, 0.03])
    )
    return dataclasses.replace(job, scene=Scene(obstacles=(post,)))


def test_the_first_contour_decides_before_all_are_timed(job: ac.Job, monkeypatch) -> None:
    (free,) = teach(job).values()
    monkeypatch.setattr("armcontour.jobs.avoiding.avoid", None)
    (plan,) = teach(post_at_elbow(job, free)).values()
    assert plan.clearance is not None and plan.clearance.kept
    assert plan.avoided == ("another configuration is taken, in which the contours are clear",)


def test_a_single_contour_is_followed_in_another_configuration(job: ac.Job) -> None:
    alone = dataclasses.replace(job, path=job.program.contours[0].path)
    (free,) = teach(alone).values()
    (plan,) = teach(post_at_elbow(alone, free)).values()
    assert plan.clearance is not None and plan.clearance.kept
    assert plan.avoided == ("another configuration is taken, in which the contours are clear",)


def test_contours_are_followed_in_another_configuration(job: ac.Job) -> None:
    (free,) = teach(job).values()
    (plan,) = teach(post_at_elbow(job, free)).values()
    assert plan.clearance is not None and plan.clearance.kept
    assert plan.avoided[0] == "another configuration is taken, in which the contours are clear"
    assert np.abs(plan.trajectory(0.0) - free.trajectory(0.0)).max() > 0.1
    assert job.arm.forward(plan.trajectory(0.0)) == pytest.approx([0.4, -0.02, 0.1], abs=1e-9)


def test_the_executed_motion_is_looked_at_too(job: ac.Job) -> None:
    study = ac.run(job)
    result = study.runs["taught"]
    assert result.executed_clearance is not None and result.executed_clearance.kept
    planned, executed = result.clearance, result.executed_clearance
    assert planned is not None
    assert executed.pairs[0].high == pytest.approx(planned.pairs[0].high, abs=1e-3)


def test_shapes_that_cannot_be_read_matter_where_a_scene_asks_for_clearance(job: ac.Job) -> None:
    def lacking() -> ArmShapes:
        raise ac.InvalidInput("The mesh is not there.")

    bare = dataclasses.replace(job, arm=job.arm.with_shapes(lacking))
    (plan,) = teach(bare).values()
    assert plan.clearance is None
    with pytest.raises(ac.InvalidInput, match="mesh is not there"):
        teach(dataclasses.replace(bare, scene=Scene()))


def test_without_its_library_no_clearance_is_a_warning(
    job: ac.Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "coal", None)
    (plan,) = teach(job).values()
    assert plan.clearance is None and plan.clearance_note is None
    assert [x for x in plan.warnings if "how near the arm comes to itself" in x and "pin" in x]
    with pytest.raises(ac.InvalidInput, match="coal"):
        teach(dataclasses.replace(job, scene=Scene()))


def test_an_arm_whose_shapes_nobody_knows_is_a_warning(job: ac.Job) -> None:
    (plan,) = teach(dataclasses.replace(job, arm=job.arm.with_shapes(None))).values()
    assert plan.clearance is None
    assert [x for x in plan.warnings if "shapes of its links are not known" in x]


def test_meshes_that_are_not_there_are_a_note_of_the_arm_and_no_warning(job: ac.Job) -> None:
    def lacking() -> ArmShapes:
        raise ac.InvalidInput("The mesh is not there.")

    (plan,) = teach(dataclasses.replace(job, arm=job.arm.with_shapes(lacking))).values()
    assert not [x for x in plan.warnings if "how near the arm comes to itself" in x]


def test_a_run_and_its_report_make_one_cell(job: ac.Job, monkeypatch) -> None:
    made = []
    own = Cell.__init__

    def count(self, arm, scene) -> None:
        made.append(scene)
        own(self, arm, scene)

    monkeypatch.setattr(Cell, "__init__", count)
    # A copy is another job, with a cell of its own.
    other = dataclasses.replace(job)
    study = ac.run(other)
    assert "clearance" in render_report(study)
    assert study.runs["taught"].executed_clearance is not None and len(made) == 1
    assert other.cell is other.cell and other.cell is not dataclasses.replace(other).cell


def test_a_job_with_a_cell_goes_to_other_processes_without_it(job: ac.Job) -> None:
    pairs = job.cell.pairs
    there = pickle.loads(pickle.dumps(job))
    assert [(x.first.name, x.second.name) for x in there.cell.pairs] == [
        (x.first.name, x.second.name) for x in pairs
    ]
    assert there.cell is not job.cell and there.cell.pairs


def test_obstacles_of_an_arm_in_the_plane_stand_where_its_paths_are():
    arm = ac.load_arm("pmk3s")
    path = ac.Path.polyline([(0.30, 0.20), (0.40, 0.20)])
    planar = parse_job(JOB.replace("ur5e", "pmk3s").replace(", 0.1]", "]"), source="test")
    planar = dataclasses.replace(planar, path=ac.Program.of(path))
    for fixed_to in ("base", "part"):
        post = Obstacle(
            name="post",
            shape=Box(size=[0.01, 0.01, 0.1]),
            place=Frame(position=[0.50, 0.15, 0.0]),
            fixed_to=fixed_to,
        )
        (plan,) = teach(dataclasses.replace(planar, scene=Scene(obstacles=(post,)))).values()
        (pair,) = (x for x in plan.clearance.pairs if {x.first, x.second} == {"link 2", "post"})
        # From the post to the stretch within the second link, over all of the motion.
        elbow, tool = arm.links(plan.trajectory(np.linspace(0, plan.trajectory.duration, 500)))[
            :, 1:
        ].swapaxes(0, 1)
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
scene: {boxes: [{name: clamp, at: [0.43, 0.1, 0.26], size: [10 mm, 200 mm, 40 mm]}]}
runs: {taught: {}}
"""


def test_a_tool_without_shapes_is_a_capsule_from_the_flange() -> None:
    with pytest.raises(Collision, match="tool and clamp touch"):
        teach(parse_job(CLAMPED.replace("SHAPES", "")))
    far = CLAMPED.replace("0.43, 0.1, 0.26", "0.43, 0.4, 0.26")
    clear = teach(parse_job(far.replace("SHAPES", "")))["taught"]
    assert clear.clearance is not None and clear.clearance.kept
    assert any("capsule" in x for x in clear.avoided)
    # Own shapes, or none at all, take its place.
    for shapes, said in ((", shapes: {}", "no shape"), (
        ", shapes: {spheres: [{name: tip, at: [0, 0, 150 mm], radius: 5 mm}]}", "")):  # fmt: skip
        plan = teach(parse_job(far.replace("SHAPES", shapes)))["taught"]
        assert plan.clearance is not None
        assert [said in x for x in plan.avoided if "tool" in x] == ([True] if said else [])
    thin = teach(parse_job(CLAMPED.replace("SHAPES", ", shapes: {}")))["taught"]
    assert "nothing looked at" in str(thin.clearance_note)


def test_where_none_keeps_clear_the_configuration_that_gets_farthest_is_refused(
    job: ac.Job,
) -> None:
    # A post stops the configuration that is tried first at the second seam, and a wall stops the
    # others at the third one.
    ends = [[[x, y - 0.02, 0.1], [x, y + 0.02, 0.1]] for x, y in ((0.4, 0), (0.4, 0.4), (0.5, 0))]
    moves = [
        ac.Contour(path=ac.Path.polyline(x).pointing([0, 0, -1]), name=f"seam {k}")
        for k, x in enumerate(ends)
    ]
    three = dataclasses.replace(job, path=ac.Program(moves=tuple(moves)))
    (free,) = teach(three).values()
    elbow = job.arm.links(free.trajectory(free.trajectory.contour_spans[1].t[0]))[3]
    post = Obstacle(
        name="post", shape=Box(size=[0.06, 0.06, 0.06]), place=Frame(position=elbow + [0, 0, 0.03])
    )
    both = Scene(obstacles=(post, *wall(0.50, 0.06, width=0.02).obstacles))
    with pytest.raises(Collision, match="seam 2: torch and wall touch"):
        teach(dataclasses.replace(three, scene=both))
