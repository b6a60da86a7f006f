"""Places of bodies against each other are those of the frames of their links."""

import numpy as np

import armcontour as ac
from armcontour.arms.chain import link_poses
from armcontour.clearance.distances import Distances
from armcontour.clearance.pairs import pairs_of
from armcontour.scene import Box, Obstacle, Scene


def test_distances_are_those_between_the_links_frames():
    """The nearest points, which are in the work frame, are as far apart as the distances say."""
    arm = ac.load_arm("ur5e").with_work(ac.Frame.rpy((0.1, 0.2, 0.3), (0.3, -0.2, 0.5)))
    block = Obstacle(
        name="block", shape=Box(size=(0.1, 0.2, 0.3)), place=ac.Frame(position=(0.6, 0.5, 0.2))
    )
    pairs, _ = pairs_of(arm, Scene(obstacles=(block,)))
    found = Distances(arm.chain, pairs)
    rng = np.random.default_rng(6)
    for q in rng.uniform(-2, 2, (5, 6)):
        every = np.arange(len(pairs))
        near = found.measure(q[None], np.zeros(len(pairs), dtype=np.intp), every)
        points = found.points(np.tile(q, (len(pairs), 1)))
        apart = near > 1e-3
        assert apart.sum() > 12
        np.testing.assert_allclose(
            np.linalg.norm(points[:, 0] - points[:, 1], axis=1)[apart], near[apart], atol=1e-6
        )
        # Each point lies in its body: within the ball that holds it.
        poses = link_poses(arm.chain, q[None])[0]
        for pair, ends in zip(pairs, points, strict=True):
            for body, point in zip((pair.first, pair.second), ends, strict=True):
                middle, radius = body.shape.ball
                there = body.place.position + body.place.rotation @ middle
                centre = poses[body.link, :, :3] @ there + poses[body.link, :, 3]
                assert np.linalg.norm(point - centre) <= radius + 1e-6
