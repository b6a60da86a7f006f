"""The report's section on clearance."""

import dataclasses

import armcontour as ac
from armcontour.frames import Frame
from armcontour.io import parse_job
from armcontour.report.sections import clearance
from armcontour.scene import (
    ArmShapes,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    LinkShape,
    Mesh,
    Obstacle,
    Scene,
    Sphere,
)

JOB = """
name: seam
title: a seam
arm: ur5e
path: {points: [[0.40, 0, 0.1], [0.45, 0, 0.1]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.1}
servo: {kp: 25, kv: 150}
command_interval: 0.004
runs: {taught: {timing: {method: optimal}, compensation: {method: inverse}}}
"""


def test_distances_pairs_and_the_nearest_posture_are_shown() -> None:
    plain = parse_job(JOB, source="test")
    assert clearance(ac.run(plain)) is None or plain.arm.shapes is not None
    tetrahedron = Mesh(points=[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    shapes = ArmShapes(
        shapes=(
            LinkShape(name="forearm", link=3, shape=Capsule(radius=0.05, length=0.3)),
            LinkShape(name="wrist", link=6, shape=Cylinder(radius=0.04, length=0.05)),
            LinkShape(name="tip", link=6, shape=Sphere(radius=0.01), tool=True),
        )
    )
    obstacles = (
        Obstacle(name="floor", shape=HalfSpace(), place=Frame(position=[0, 0, -0.4])),
        Obstacle(name="box", shape=Box(size=[0.1, 0.1, 0.1]), place=Frame(position=[0.6, 0.3, 0])),
        Obstacle(name="wedge", shape=tetrahedron, place=Frame(position=[0.6, -0.4, 0])),
    )
    job = dataclasses.replace(
        plain, arm=plain.arm.with_shapes(shapes), scene=Scene(obstacles=obstacles)
    )
    section = clearance(ac.run(job))
    assert section is not None
    over_time, posture = section.figures
    assert {"links and cell, planned", "links and cell, executed"} <= {
        x.name for x in over_time.data
    }
    # The posture is that of the least distance from an obstacle, which is named with its distance.
    names = [x.name for x in posture.data if x.type == "scatter3d"]
    assert any(x.split(", ")[1].split(":")[0] in ("floor", "box", "wedge") for x in names[1:])
    bodies = {x.name for x in posture.data if x.type == "mesh3d"}
    assert bodies == {"forearm", "wrist", "tip", "floor", "box", "wedge"}
    (table,) = section.tables
    assert all(row[-2] == "kept" for row in table.rows) and len(table.rows) > 3
    assert any(x.startswith("Run taught: Clear: ") for x in section.notes)
    assert any(x.startswith("Pairs that are not looked at: ") for x in section.notes)
