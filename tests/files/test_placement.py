"""Placements as files: JSON, a table, and the job in its best place."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.dynamics_extra import needs_dynamics
from tests.files.tables import refusals

import armcontour as ac
from armcontour.files import parse_job, placed_job_text, placement_csv
from armcontour.robot.scene import Obstacle, Scene, Sphere

SQUARE = """\
# Not to be lost.
name: line
arm: ur5e
path:
  points: [[0.5, 0.0, 0.2], [0.56, 0.0, 0.2]]  # on the table
  orientation: {quaternion: [1, 0, 0, 0]}
limits: {speed: 0.25 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {compensated: {compensation: {method: inverse}}}
"""
PLANE = """\
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.36, 0.20]]}   # a line
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {compensation: {method: none}}}
"""


@pytest.fixture(scope="module")
def placed():
    return ac.place(parse_job(SQUARE), {"x": [0.0, 0.45, 0.9], "yaw": [0.0, 0.2]}, processes=1)


def written(placement, text=SQUARE, **options):
    return placed_job_text(placement, text, folder=Path(), to=Path(), **options)


def duration(job):
    return ac.plan(job.path, job.arm, job.runs[0].limits).duration


def test_the_placement_table_has_a_row_per_position(placed):
    rows = list(csv.DictReader(io.StringIO(placement_csv(placed))))
    assert [(float(x["x [m]"]), float(x["yaw [rad]"])) for x in rows] == [
        (0.0, 0.0), (0.0, 0.2), (0.45, 0.0), (0.45, 0.2), (0.9, 0.0), (0.9, 0.2)
    ]  # fmt: skip
    assert {x["refused by"] for x in rows[2:]} == {"reach"}
    assert all("the tool stays" in x["why not"].lower() and not x["duration [s]"] for x in rows[2:])
    assert [float(x["duration [s]"]) for x in rows[:2]] == placed.durations[0].tolist()


def test_the_job_file_gets_a_work_frame_and_keeps_its_comments():
    placement = ac.place(parse_job(SQUARE), {"x": [-0.1], "yaw": [0.1]})
    text = written(placement)
    common_lines = [x for x in text.splitlines() if x in SQUARE.splitlines()]
    assert common_lines == [x for x in SQUARE.splitlines() if not x.startswith("arm: ")]
    new = [x for x in text.splitlines() if x not in common_lines]
    assert new[0] == "arm:" and all(x.startswith("  ") for x in new[1:])
    again = parse_job(text)
    assert duration(again) == pytest.approx(placement.best.duration, rel=1e-5)
    bases = [x.arm.chain.base.matrix for x in (again, placement.placed())]
    np.testing.assert_allclose(*bases, atol=1e-12)
    position = yaml.safe_load(text)["arm"]["work"]["position"]
    assert position == [round(x, 12) for x in position]


def test_the_placed_path_of_a_planar_arm_gets_a_frame():
    text = PLANE
    for _ in range(2):
        # The second time on top of the first.
        placement = ac.place(parse_job(text), {"yaw": [0.2]})
        text = written(placement, text)
        again = parse_job(text)
        assert duration(again) == pytest.approx(placement.best.duration, rel=1e-5)
    (first, last) = parse_job(text).program.path.vertices
    assert np.arctan2(*(last - first)[::-1]) == pytest.approx(0.4)
    np.testing.assert_allclose((first + last) / 2, [0.33, 0.2], atol=1e-12)
    # It does not lift the path out of the plane.
    lifted = PLANE.replace("points:", "frame: {position: [0, 0, 0.1]}, points:")
    refusals(parse_job, [(lifted, "moves the drawing out of the plane")])


@needs_dynamics
def test_no_job_is_written_if_the_base_moves_among_obstacles():
    far = Obstacle(name="far", shape=Sphere(radius=0.1), place=ac.Frame(position=[0, 0, 3]))
    job = replace(parse_job(SQUARE), scene=Scene(obstacles=(far,)))
    placement = ac.place(job, {"x": [0.0]}, move="base")
    refusals(written, [(placement, "do not move with it")])


@needs_dynamics
def test_obstacles_move_with_a_placed_part_in_the_plane():
    text = PLANE + (
        "scene: {obstacles: [{type: sphere, name: pin, radius: 1 mm, at: [0.3, 0.3, 0],"
        " fixed_to: part}]}\n"
    )
    job = parse_job(text)
    placement = ac.place(job, {"x": [0.0, 0.05], "yaw": [0.1]})
    again = parse_job(written(placement, text))
    (there,) = again.scene.obstacles
    (moved,) = placement.placed().scene.obstacles
    np.testing.assert_allclose(there.place.position, moved.place.position, atol=1e-12)
    assert np.linalg.norm(moved.place.position - [0.3, 0.3, 0]) > 1e-3
