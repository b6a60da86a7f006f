"""The arm and its cell in space."""

import subprocess
import sys

import numpy as np
import pytest

from armcontour.io import parse_job
from armcontour.scene import Box, Capsule, Cylinder, Mesh, Sphere
from armcontour.studio.robot import arm_frame, triangles_of


def volume(corners):
    """Volume inside closed triangles; above zero if they are seen from outside."""
    return np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6


def test_triangles_close_shapes_without_gaps():
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    for shape, size in (
        (Box(size=np.array([0.1, 0.2, 0.3])), 0.006),
        (Sphere(radius=0.1), 4 / 3 * np.pi * 1e-3),
        (Cylinder(radius=0.1, length=0.5), np.pi * 0.005),
        (Capsule(radius=0.1, length=0.5), np.pi * (0.005 + 4e-3 / 3)),
        (Mesh(points=corners), 1 / 6),
        (Mesh(points=corners, triangles=triangles), 1 / 6),
    ):
        found = triangles_of(shape)
        assert found.shape[1:] == (3, 3)
        assert volume(found) == pytest.approx(size, rel=0.03), shape
        middle, radius = shape.ball
        assert np.linalg.norm(found - middle, axis=2).max() <= radius * (1 + 1e-9), shape
        if isinstance(shape, Mesh):
            continue
        found = np.round(found, 12)
        across = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
        assert np.linalg.norm(across, axis=1).min() > 1e-6, shape
        # They are seen from outside, and each edge is one of two triangles, in both directions.
        assert (np.einsum("ij,ij->i", across, found.mean(axis=1)) > 0).all(), shape
        sides = ((0, 1), (1, 2), (2, 0))
        edges = [tuple(map(tuple, x[[i, j]] + 0.0)) for x in found for i, j in sides]
        assert len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges), shape


def test_the_first_plan_of_a_studio_loads_no_library_for_shapes():
    code = (
        "import sys\n"
        "from armcontour.studio.opening import open_session\n"
        "from tests.studio.talking import NoLane\n"
        "session = open_session(None, slow=NoLane)\n"
        "session.begin()\n"
        "assert session.display.screen.planned is not None\n"
        "print(*sorted({'scipy.spatial', 'scipy.linalg', 'scipy.special'} & set(sys.modules)))\n"
        "session.close()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "\n", (done.stdout, done.stderr)


SCENE = """
name: cell
arm: {name: ur5e, work: {position: [0.4, 0, 0.1]}}
path: {points: [[0, 0, 0], [0.1, 0, 0]], orientation: {axis: [0, 0, -1]}}
scene:
  boxes: [{name: vice, size: [100 mm, 100 mm, 50 mm], at: [0, 0, 50 mm], fixed_to: part}]
  halfspaces: [{name: table, at: [0.2, 0, -20 mm]}]
servo: {kp: 25, kv: 150}
runs: {one: {}}
"""


def test_obstacles_stand_in_the_frame_of_the_base():
    frame = arm_frame(parse_job(SCENE))
    bodies = {x["name"]: x for x in frame.header["bodies"]}
    vice, table = bodies["vice"], bodies["table"]
    assert (vice["link"], vice["colour"], table["colour"]) == (0, "part", "table")
    np.testing.assert_allclose(np.array(vice["at"])[:3, 3], [0.4, 0, 0.15], atol=1e-12)
    corners = frame.arrays[table["triangles"]].reshape(-1, 3) @ np.array(table["at"])[:3, :3].T
    corners = corners + np.array(table["at"])[:3, 3]
    # Its top is the plane, and it reaches around the arm.
    assert corners[:, 2].max() == pytest.approx(-0.02, abs=1e-6)
    assert corners[:, :2].min() == pytest.approx(-corners[:, :2].max(), abs=1e-6)
    assert corners[:, 0].max() > 1.0
