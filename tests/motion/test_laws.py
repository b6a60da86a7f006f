"""Laws of motion against parabolas and the chain rule."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import armcontour as ac
from armcontour.motion import LapLaw, PathLaw, Rates

LAPS = LapLaw(
    breaks=np.array([0.0, 2.0, 3.0]),
    q=np.array([[0.0, 1.0], [4.0, 1.0], [6.0, 0.0]]),
    dq=np.array([[1.0, 0.0], [3.0, 0.0]]),
    ddq=np.array([[1.0, 0.0], [-2.0, -2.0]]),
)


def test_laps_are_parabolas_21():
    i = np.array([0, 0, 1, 1])
    t = np.array([0.5, 2.0, 2.0, 2.5])
    np.testing.assert_allclose(
        LAPS.on_interval(i, t, 0), [(0.625, 1), (4, 1), (4, 1), (4 + 1.5 - 0.25, 0.75)]
    )
    np.testing.assert_allclose(LAPS.on_interval(i, t, 1), [(1.5, 0), (3, 0), (3, 0), (2, -1)])
    np.testing.assert_allclose(LAPS.on_interval(i, t, 2), [(1, 0), (1, 0), (-2, -2), (-2, -2)])


PATH = ac.JointPath.spline(np.random.default_rng(0).normal(size=(7, 2)), np.linspace(0, 1.2, 7))


def path_law(rates):
    """Two intervals of 1 s, over the first and the second half of the path."""
    return PathLaw(
        joint_path=PATH,
        breaks=np.array([0.0, 1.0, 2.0]),
        s=np.array([0.0, 0.6, 1.2]),
        rates=Rates(*np.transpose(rates), jerk=np.zeros(len(rates))),
    )


def test_a_path_law_follows_its_path():
    # Uniform acceleration, then uniform braking.
    law = path_law([[0.2, 0.8, 0.0], [1.0, -0.8, 0.0]])
    s_of = [Polynomial([0.0, 0.2, 0.4]), Polynomial([0.6, 1.0, -0.4])]
    for k in (0, 1):
        t = np.linspace(k, k + 1, 21)
        i = np.full(21, k)
        for order in range(3):
            expected = s_of[k].deriv(order)(t - k) if order else s_of[k](t - k)
            np.testing.assert_allclose(law.path_position(i, t, order), expected, atol=1e-13)
        np.testing.assert_allclose(law.on_interval(i, t, 0), PATH(s_of[k](t - k)), atol=1e-12)


# Acceleration that changes on the way, slow enough to stay inside the interval.
UNEVEN = path_law([[0.2, 0.3, 0.2], [0.5, -0.1, -0.3]])
INSIDE = np.array([0.11, 0.37, 0.83, 1.21, 1.57, 1.93])


@pytest.mark.parametrize("order", [1, 2])
def test_a_path_laws_rates_belong_together(order):
    h, i = 1e-6, (INSIDE > 1).astype(int)
    after, before = (UNEVEN.path_position(i, INSIDE + k * h, order - 1) for k in (1, -1))
    found = UNEVEN.path_position(i, INSIDE, order)
    np.testing.assert_allclose(found, (after - before) / (2 * h), atol=1e-8)
    assert np.ptp(found[:3]) > 0.05


@pytest.mark.parametrize("order", [1, 2])
def test_a_path_law_keeps_the_chain_rule(order):
    h, i = 1e-6, (INSIDE > 1).astype(int)
    after, before = (UNEVEN.on_interval(i, INSIDE + k * h, order - 1) for k in (1, -1))
    found = UNEVEN.on_interval(i, INSIDE, order)
    np.testing.assert_allclose(found, (after - before) / (2 * h), atol=1e-7)


def test_a_path_law_does_not_cross_a_joint_by_rounding():
    # Both sides of a kink at s = 1: at the common time each interval keeps its own side.
    path = ac.JointPath(
        breaks=np.array([0.0, 1.0, 2.0]),
        coefficients=np.array([[[0.0], [1.0], [0], [0], [0], [0]], [[1.0], [-5.0]] + [[0]] * 4]),
    )
    law = PathLaw(
        joint_path=path,
        breaks=np.array([0.0, 1 / 0.3, 2 / 0.3]),
        s=np.array([0.0, 1.0, 2.0]),
        rates=Rates(*np.array([[0.3, 0.3], [0, 0], [0, 0], [0, 0]])),
    )
    at = np.array([1 / 0.3, 1 / 0.3])
    np.testing.assert_allclose(law.on_interval(np.array([0, 1]), at, 1), [[0.3], [-1.5]])


@pytest.mark.parametrize("breaks", [[0.0], [1.0, 2.0], [0.0, 1.0, 1.0], [0.0, 2.0, 1.0]])
def test_breaks_in_disorder_are_refused(breaks, refuses):
    n = len(breaks)
    arrays = {"q": np.zeros((n, 1)), "dq": np.zeros((n - 1, 1)), "ddq": np.zeros((n - 1, 1))}
    words = ("breaks of a law", "start at 0 and increase")
    refuses(lambda: LapLaw(breaks=np.array(breaks), **arrays), ac.InvalidInput, *words)
    refuses(
        lambda: PathLaw(
            joint_path=ac.JointPath.spline([(0.0,), (1.0,)]),
            breaks=np.array(breaks),
            s=np.zeros(n),
            rates=Rates(*np.zeros((4, n - 1))),
        ),
        ac.InvalidInput,
        *words,
    )
