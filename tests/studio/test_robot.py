"""The arm and its cell in space."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import armcontour as ac
from armcontour.frames import Frame
from armcontour.io import parse_job
from armcontour.scene import Box, Capsule, Cylinder, Mesh, Sphere
from armcontour.studio.robot import arm_frame, triangles_of

URDF = Path(__file__).parents[1] / "io" / "robots" / "data" / "robot.urdf"


class Bare:
    """As much of a job as the frame needs."""

    def __init__(self, arm, scene=None):
        self.arm, self.scene = arm, scene


def page_side(header, q):
    """Poses of the base, of all links and of the tool, as the page computes them."""
    at = np.array(header["base"])
    found = [at]
    for joint, angle in zip(header["joints"], q, strict=True):
        x, y, z = joint["axis"]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(4)
        turn[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        at = at @ joint["origin"] @ turn
        found.append(at)
    return [*found, at @ header["tool"]]


def arms():
    frame = Frame.rpy([0.3, -0.1, 0.2], [0.1, 0.2, 0.3])
    yield ac.load_arm("pmk3s")
    yield ac.load_arm("ur5e").with_work(frame).with_tool(Frame.rpy([0, 0.02, 0.1], [0, 0.5, 0]))
    yield ac.load_arm("panda")
    yield ac.load_arm(URDF, tip="tcp", locked={"lift": 0.2})


@pytest.mark.parametrize("arm", list(arms()), ids=lambda arm: arm.name)
def test_the_page_finds_the_tool_where_the_arm_has_it(arm):
    header = arm_frame(Bare(arm)).header
    random = np.random.default_rng(1)
    for q in random.uniform(-3, 3, (20, arm.dof)):
        tool = page_side(header, q)[-1]
        point = arm.forward(q)
        np.testing.assert_allclose(tool[: len(point), 3], point, rtol=0, atol=1e-12)
        if arm.dimension == 3:
            np.testing.assert_allclose(tool[:3, :3], arm.pose(q)[1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.array(header["base"]) @ header["work"], np.eye(4), atol=1e-12)


def test_links_are_where_clearance_has_them():
    from armcontour.arms.chain import link_poses

    arm = ac.load_arm("ur5e")
    header = arm_frame(Bare(arm)).header
    q = np.linspace(-2, 2, 6)
    found = np.array(page_side(header, q)[:-1])
    np.testing.assert_allclose(found[:, :3], link_poses(arm.chain, q[None])[0], atol=1e-12)
    assert [x["link"] for x in header["bodies"]] == [x.link for x in arm.shapes.shapes]


def volume(corners):
    """Volume inside closed triangles; above zero if they are seen from outside."""
    return np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        (Box(size=np.array([0.1, 0.2, 0.3])), 0.006),
        (Sphere(radius=0.1), 4 / 3 * np.pi * 1e-3),
        (Cylinder(radius=0.1, length=0.5), np.pi * 0.005),
        (Capsule(radius=0.1, length=0.5), np.pi * (0.005 + 4e-3 / 3)),
        (Mesh(points=np.concatenate([np.zeros((1, 3)), np.eye(3)])), 1 / 6),
        (
            Mesh(
                points=np.concatenate([np.zeros((1, 3)), np.eye(3)]),
                triangles=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
            ),
            1 / 6,
        ),
    ],
    ids=lambda x: type(x).__name__,
)
def test_triangles_close_the_shape(shape, size):
    found = triangles_of(shape)
    assert found.shape[1:] == (3, 3)
    assert volume(found) == pytest.approx(size, rel=0.03)
    middle, radius = shape.ball
    assert np.linalg.norm(found - middle, axis=2).max() <= radius * (1 + 1e-9)


@pytest.mark.parametrize(
    "shape",
    [
        Box(size=np.array([0.1, 0.2, 0.3])),
        Sphere(radius=0.1),
        Cylinder(radius=0.1, length=0.5),
        Capsule(radius=0.1, length=0.5),
    ],
    ids=lambda x: type(x).__name__,
)
def test_triangles_have_no_gaps_and_no_empty_ones(shape):
    found = np.round(triangles_of(shape), 12)
    across = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    assert np.linalg.norm(across, axis=1).min() > 1e-6
    # They are seen from outside, and each edge is one of two triangles, in both directions.
    assert (np.einsum("ij,ij->i", across, found.mean(axis=1)) > 0).all()
    edges = [tuple(map(tuple, x[[i, j]] + 0.0)) for x in found for i, j in ((0, 1), (1, 2), (2, 0))]
    assert len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)


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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
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
