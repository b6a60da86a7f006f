"""Laws of motion against parabolas and the chain rule."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import armcontour as ac
from armcontour.motion import LapLaw, PathLaw, Rates


def test_laps_are_parabolas_21():
    laps = LapLaw(
        breaks=np.array([0.0, 2.0, 3.0]),
        q=np.array([[0.0, 1.0], [4.0, 1.0], [6.0, 0.0]]),
        dq=np.array([[1.0, 0.0], [3.0, 0.0]]),
        ddq=np.array([[1.0, 0.0], [-2.0, -2.0]]),
    )
    i, t = np.array([0, 0, 1, 1]), np.array([0.5, 2.0, 2.0, 2.5])
    for order, expected in enumerate(
        (
            [(0.625, 1), (4, 1), (4, 1), (4 + 1.5 - 0.25, 0.75)],
            [(1.5, 0), (3, 0), (3, 0), (2, -1)],
            [(1, 0), (1, 0), (-2, -2), (-2, -2)],
        )
    ):
        np.testing.assert_allclose(laps.on_interval(i, t, order), expected)


PATH = ac.JointPath.spline(np.random.default_rng(0).normal(size=(7, 2)), np.linspace(0, 1.2, 7))


def path_law(rates, path=PATH, breaks=(0.0, 1.0, 2.0), s=(0.0, 0.6, 1.2)):
    """Two intervals of 1 s, over the first and the second half of the path."""
    rates = Rates(*np.transpose(rates), jerk=np.zeros(len(rates)))
    return PathLaw(joint_path=path, breaks=np.array(breaks), s=np.array(s), rates=rates)


def test_a_path_law_follows_its_path_by_the_chain_rule_on_its_own_side_of_joints():
    # Uniform acceleration, then uniform braking.
    law = path_law([[0.2, 0.8, 0.0], [1.0, -0.8, 0.0]])
    s_of = [Polynomial([0.0, 0.2, 0.4]), Polynomial([0.6, 1.0, -0.4])]
    for k in (0, 1):
        t, i = np.linspace(k, k + 1, 21), np.full(21, k)
        for order in range(3):
            expected = s_of[k].deriv(order)(t - k)
            np.testing.assert_allclose(law.path_position(i, t, order), expected, atol=1e-13)
        np.testing.assert_allclose(law.on_interval(i, t, 0), PATH(s_of[k](t - k)), atol=1e-12)
    # Acceleration that changes on the way, slow enough to stay inside the interval.
    law, h = path_law([[0.2, 0.3, 0.2], [0.5, -0.1, -0.3]]), 1e-6
    t = np.array([0.11, 0.37, 0.83, 1.21, 1.57, 1.93])
    i = (t > 1).astype(int)
    for order in (1, 2):
        for value, near in ((law.path_position, 1e-8), (law.on_interval, 1e-7)):
            after, before = (value(i, t + x, order - 1) for x in (h, -h))
            np.testing.assert_allclose(value(i, t, order), (after - before) / (2 * h), atol=near)
        assert np.ptp(law.path_position(i, t, order)[:3]) > 0.05
    # Both sides of a kink at s = 1: at the common time each interval keeps its own side.
    coefficients = np.zeros((2, 6, 1))
    coefficients[:, :2, 0] = [(0.0, 1.0), (1.0, -5.0)]
    path = ac.JointPath(breaks=np.array([0.0, 1.0, 2.0]), coefficients=coefficients)
    law = path_law([[0.3, 0, 0]] * 2, path, (0.0, 1 / 0.3, 2 / 0.3), (0.0, 1.0, 2.0))
    at = np.array([1 / 0.3, 1 / 0.3])
    np.testing.assert_allclose(law.on_interval(np.array([0, 1]), at, 1), [[0.3], [-1.5]])


def test_breaks_in_disorder_are_refused():
    line = ac.JointPath.spline([(0.0,), (1.0,)])
    for breaks in ([0.0], [1.0, 2.0], [0.0, 1.0, 1.0], [0.0, 2.0, 1.0]):
        n = len(breaks)
        arrays = {"q": np.zeros((n, 1)), "dq": np.zeros((n - 1, 1)), "ddq": np.zeros((n - 1, 1))}
        with pytest.raises(ac.InvalidInput, match="start at 0 and increase"):
            LapLaw(breaks=np.array(breaks), **arrays)
        with pytest.raises(ac.InvalidInput, match="start at 0 and increase"):
            path_law(np.zeros((n - 1, 3)), line, breaks, np.zeros(n))
