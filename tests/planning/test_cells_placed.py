"""Cells with external axes: a rail on its floor, and bases that are placed beside a positioner."""

from dataclasses import replace

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics
from tests.own_kinematics import inverse, shift, slide, turn

import armcontour as ac
from armcontour.core.errors import Collision
from armcontour.files import parse_job
from armcontour.robot import Payload
from armcontour.robot.scene import ArmShapes, Box, LinkShape, Obstacle, Scene, Sphere
from armcontour.studies.placement import place_job
from armcontour.verification.clearance import check_clearance

RAIL = """
name: seam
arm:
  name: ur10e
  rail: {axis: [0, 1, 0], lower: -1.5, upper: 1.5, velocity: 0.8, acceleration: 1.5}
path: {points: [[0.6, -0.5, 0.3], [0.6, 0.5, 0.3]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 100 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
scene: {floor: 0 mm}
runs: {w: {}}
"""
CELL = """
name: seam
arm:
  name: ur10e
  rail:
    {axis: [0, 1, 0], lower: -1, upper: 1, velocity: 0.8, acceleration: 1.5, origin: [0, 0, 0.1]}
  work: {position: [0.9, 0, 0.5]}
  positioner:
    axes:
      - {name: tilt, axis: [0, 1, 0], origin: [0.9, 0, 0.3], lower: -2, upper: 2, velocity: 1,
         acceleration: 2}
      - {name: turn, axis: [0, 0, 1], origin: [0.9, 0, 0.4], lower: -2, upper: 2, velocity: 1,
         acceleration: 2}
path: {points: [[0, -0.1, 0.1], [0, 0.1, 0.1]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 100 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {w: {}}
"""
MOVED = ac.Frame((0.1, -0.2, 0.05), turn((0, 0, 1), (0, 0, 0), 0.4)[0, :3, :3])


def cell_arm():
    """A UR10e on a rail beside a positioner with bodies."""
    usual = {"lower": -2.0, "upper": 2.0, "velocity": 1.0, "acceleration": 2.0, "mass": 20.0}
    tilt = ac.PositionerAxis(
        name="tilt",
        axis=(0, 1, 0),
        origin=(0.9, 0, 0.3),
        center=(0.8, 0.1, 0.2),
        inertia=np.diag([1.0, 2.0, 2.5]),
        **usual,
    )
    table = ac.PositionerAxis(name="turn", axis=(0, 0, 1), origin=(0.9, 0, 0.4), **usual)
    rail = ac.Rail(
        axis=(0, 1, 0), lower=-1, upper=1, velocity=1, acceleration=2, origin=(0, 0, 0.1)
    )
    part = Payload(mass=5.0, center=(0.01, 0.02, 0.1))
    arm = ac.load_arm("ur10e").with_rail(rail)
    arm = arm.with_positioner(ac.Positioner(axes=(tilt, table), part=part))
    return arm.with_work((0.9, 0.0, 0.5))


def part_pose(q):
    """Poses of the part in the frame of the rail, (n, 4, 4)."""
    tilted = turn((0, 1, 0), (0.9, 0, 0.3), q[:, 1])
    return tilted @ turn((0, 0, 1), (0.9, 0, 0.4), q[:, 0]) @ shift((0.9, 0, 0.5))


def moved_poses(q):
    """Tool poses in the frame of the part after the rail has moved, (n, 4, 4)."""
    tool = slide((0, 1, 0), q[:, 2]) @ shift((0, 0, 0.1)) @ ac.load_arm("ur10e").forward(q[:, 3:])
    moved = shift((0.9, 0, 0.5)) @ MOVED.homogeneous @ shift((-0.9, 0, -0.5))
    return inverse(part_pose(q)) @ moved @ tool


def postures(count=6):
    return np.random.default_rng(0).uniform(-1, 1, (count, 9))


@needs_dynamics
def test_a_rail_on_its_floor_is_no_collision():
    result = ac.run(parse_job(RAIL)).runs["w"]
    assert result.clearance.satisfied
    left_out = {frozenset((x.first, x.second)) for x in result.clearance.left_out}
    assert frozenset(("floor", "base_link_inertia")) in left_out
    # Links that can reach the floor are still checked.
    checked = {x.second for x in result.clearance.pairs if x.first == "floor"}
    assert "forearm_link" in checked
    low = RAIL.replace("0.3]", "-0.05]").replace("floor: 0 mm", "floor: 0 mm, margins: {tool: 0}")
    with pytest.raises(Collision):
        ac.run(parse_job(low))


@needs_dynamics
def test_a_carriage_that_descends_to_the_floor_is_checked():
    slope = ac.Rail(axis=(0, 1, -0.1), lower=-1, upper=1, velocity=1, acceleration=2)
    foot = LinkShape(name="foot", link=1, shape=Box(size=np.array([0.2, 0.2, 0.1])))
    floor = Scene(floor=-0.1)
    arm = ac.load_arm("ur10e").with_rail(slope).with_shapes(ArmShapes(shapes=(foot,)))
    pairs = check_clearance(still(arm, 0.0), arm, floor).pairs
    assert [(x.first, x.second) for x in pairs] == [("floor", "foot")]
    drop = 0.1 / np.sqrt(1.01)
    assert pairs[0].high == pytest.approx(0.1 - 0.05, abs=1e-5)
    assert check_clearance(still(arm, 0.9), arm, floor).pairs[0].high == pytest.approx(
        0.05 - 0.9 * drop, abs=1e-5
    )


def still(arm, position):
    """A short joint path at a position of the rail."""
    q = np.zeros((2, arm.dof))
    q[:, 0] = position
    q[1, -1] = 0.01
    return ac.JointPath.hermite(
        np.array([0.0, 1.0]),
        (q[:1], q[1:] - q[:1], 0 * q[:1]),
        (q[1:], q[1:] - q[:1], 0 * q[:1]),
    )


def test_base_beside_a_positioner_moves():
    arm = cell_arm()
    q = postures()
    tool = slide((0, 1, 0), q[:, 2]) @ shift((0, 0, 0.1)) @ ac.load_arm("ur10e").forward(q[:, 3:])
    np.testing.assert_allclose(arm.forward(q), inverse(part_pose(q)) @ tool, atol=1e-12)
    moved = arm.with_base_moved(MOVED)
    np.testing.assert_allclose(moved.forward(q), moved_poses(q), atol=1e-12)
    # The arm and the positioner move as before, so their torques do not change.
    torques = [x.torque(q, q, 2 * q) for x in (arm, moved)]
    np.testing.assert_allclose(*torques, atol=1e-9)


@needs_dynamics
def test_bodies_of_a_cell_keep_their_distances_to_the_axis_that_carries_them():
    arm = cell_arm()
    shapes = tuple(
        LinkShape(
            name=f"ball {k}", link=k, shape=Sphere(radius=0.01), place=ac.Frame((0.1, 0.2, k))
        )
        for k in range(4)
    )
    arm = arm.with_shapes(ArmShapes(shapes=shapes))
    moved = arm.with_base_moved(MOVED)
    scene = Scene(floor="none")
    own = {}
    for called, chosen in (("before", arm), ("after", moved)):
        pairs = check_clearance(still(chosen, 0.0), chosen, scene).pairs
        own[called] = {(x.first, x.second): x.high for x in pairs}
    # Balls 0 and 1 are on the positioner; 2 is on the floor, and 3 on the rail, with the base.
    key = ("ball 1", "ball 3")
    assert own["before"][key] != pytest.approx(own["after"][key], abs=1e-3)
    for one, other in own["before"]:
        together = {one, other} <= {"ball 0", "ball 1"} or {one, other} <= {"ball 2", "ball 3"}
        if together:
            assert own["before"][one, other] == pytest.approx(own["after"][one, other], abs=1e-6)


def test_place_moves_the_base_beside_a_positioner():
    job = parse_job(CELL)
    job = replace(job, arm=job.arm.with_shapes(None))
    grid = {"x": [-0.1, 0.1], "yaw": [0.0, 0.3]}
    placement = ac.place(job, grid, move="base", processes=1)
    assert len(placement.places) == 4 and placement.best is not None
    placed = place_job(job, MOVED, "base")
    trajectory = ac.run(placed).runs["w"].trajectory
    q = trajectory(np.linspace(0, trajectory.duration, 501))
    points = moved_poses(q)[:, :3, 3]
    np.testing.assert_allclose(points[:, [0, 2]], np.tile([0, 0.1], (501, 1)), atol=1e-9)
    np.testing.assert_allclose(points[[0, -1], 1], [-0.1, 0.1], atol=1e-9)


@needs_dynamics
def test_obstacles_of_the_cell_stay_where_they_are():
    job = parse_job(CELL)
    ball = Obstacle(name="ball", shape=Sphere(radius=0.05), place=ac.Frame((0.3, 0.4, 0.5)))
    job = replace(job, scene=Scene((ball,)))
    placed = place_job(job, MOVED, "base")
    (at,) = placed.scene.obstacles
    # In the work frame with the positioner at 0.
    before = shift((-0.9, 0, -0.5)) @ [0.3, 0.4, 0.5, 1.0]
    base = MOVED.homogeneous @ shift((-0.9, 0, -0.5))
    np.testing.assert_allclose(base @ [*at.place.position, 1.0], before, atol=1e-12)
