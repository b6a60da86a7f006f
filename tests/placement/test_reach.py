"""Links bound the reach: no posture takes the tool out of the ball."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.placement.reach import beyond_links, longest_reach


@pytest.mark.parametrize("name", ["ur5e", "ur10e", "panda"])
@pytest.mark.parametrize("task", [5, 6])
def test_no_posture_leaves_the_ball(name, task):
    arm = ac.load_arm(name).with_tool(ac.Frame(position=[0.02, 0.0, 0.1]))
    rng = np.random.default_rng(1)
    points, rotations = arm.pose(rng.uniform(-np.pi, np.pi, (20_000, arm.dof)))
    point, middle, radius = longest_reach(arm.chain, task)
    far = np.linalg.norm(points + rotations @ point - middle, axis=1)
    # Nor is the ball much too large: a bound of the sum of all offsets would be.
    assert 0.8 * radius < far.max() <= radius + 1e-12


def test_distances_beyond_are_those_of_the_farthest_pose():
    arm = ac.load_arm("ur5e")
    _, middle, radius = longest_reach(arm.chain, 5)
    poses = np.zeros((2, 3, 4))
    poses[:, :, :3] = np.eye(3)
    poses[:, :, 3] = middle + np.array([[0.1, 0, 0], [2.0, 0, 0]])
    bases = np.zeros((2, 3, 4))
    bases[:, :, :3] = np.eye(3)
    bases[1, 0, 3] = 0.5
    np.testing.assert_allclose(beyond_links(arm.chain, 5, poses, bases), [2 - radius, 1.5 - radius])
