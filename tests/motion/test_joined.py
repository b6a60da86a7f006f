"""Motions of many laws, which are evaluated together: as each law alone says, at breaks too."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import JointPath, stand_still

LIMITS = ac.Limits(joint_velocity=[1.0, 2.0], joint_acceleration=[3.0, 2.0])


@pytest.fixture(scope="module")
def many():
    """A dozen laws along bent joint paths, of which each goes on from the last, and two pauses."""
    rng = np.random.default_rng(3)
    laws, q = [], np.zeros(2)
    for k in range(12):
        points = np.concatenate([[q], q + rng.uniform(-1, 1, (k % 4 + 1, 2))])
        laws += ac.plan(JointPath.spline(points), limits=LIMITS, intervals=40).laws
        q = points[-1]
        if k in (3, 7):
            laws.append(stand_still(q, 0.25))
    return ac.Trajectory(laws=tuple(laws), method="optimal")


def alone(many, t, order, side):
    """The value at one time, by the law that is found by looking at all of them."""
    inside = [
        (law, i, t - start)
        for law, start in zip(many.laws, many.starts[:-1], strict=True)
        for i, (a, b) in enumerate(zip(start + law.breaks, start + law.breaks[1:], strict=False))
        if (a <= t < b if side == "right" else a < t <= b)
    ]
    ((law, i, since),) = inside
    return law.on_interval(np.array([i]), np.array([since]), order)[0]


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("order", range(4))
def test_many_laws_are_as_each_alone(many, order, side):
    rng = np.random.default_rng(order)
    # In no order; at seams of laws and at breaks within them, where accelerations jump.
    inside = rng.choice(many.breaks[1:-1], 50), rng.uniform(0, many.duration, 58)
    t = rng.permutation(np.concatenate([many.starts[1:-1], *inside]))
    t = t[: len(t) // 3 * 3]
    expected = np.array([alone(many, x, order, side) for x in t])
    scale = np.abs(expected).max()
    np.testing.assert_allclose(many(t, order, side=side), expected, rtol=0, atol=1e-9 * scale)
    together = many.motion(t.reshape(3, -1), side=side)
    if order < 3:
        np.testing.assert_array_equal(together[order].reshape(-1, 2), many(t, order, side=side))


def test_many_times_are_evaluated_in_blocks(many, monkeypatch):
    t = np.linspace(0, many.duration, 500)
    np.testing.assert_array_equal(many(t, 2), [many(x, 2) for x in t])
    whole = many.motion(t)
    monkeypatch.setattr("armcontour.motion.trajectory.AT_ONCE", 97)
    np.testing.assert_array_equal(many.motion(t), whole)
