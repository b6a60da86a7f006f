"""Trajectories and executions."""

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import LapLaw, LawPhase


def lap(duration, q, dq, ddq):
    """One lap with constant acceleration: q + dq t + ddq t² / 2."""
    q, dq, ddq = (np.atleast_2d(np.asarray(x, float)) for x in (q, dq, ddq))
    end = q + duration * (dq + duration * ddq / 2)
    return LapLaw(breaks=np.array([0.0, duration]), q=np.concatenate([q, end]), dq=dq, ddq=ddq)


def stretch(t=(0.0, 1.0)):
    return LawPhase(name="x", kind="MAC", t=t, s=(0.0, 1.0), demand=np.ones(2), speed=1.0)


@pytest.fixture
def bent():
    """Two laws: joint 1 accelerates for 2 s, then rests; joint 2 moves forth, then back."""
    laws = lap(2.0, (0, 0), (0, 1), (1, 0)), lap(1.0, (2, 2), (0, -1), (0, 0))
    return ac.Trajectory(laws=laws, method="hand")


def test_values_on_both_sides_of_breaks_are_those_computed_by_hand(bent):
    assert bent.duration == 3.0 and bent.dof == 2
    np.testing.assert_allclose(bent([0.0, 1.0, 2.0, 3.0]), [(0, 0), (0.5, 1), (2, 2), (2, 1)])
    for t, order, side, value in (
        (1.0, 1, "right", (1, 1)),
        (1.0, 2, "right", (1, 0)),
        (2.0, 0, "left", (2, 2)),
        (2.0, 1, "left", (2, 1)),
        (2.0, 1, "right", (0, -1)),
        (2.0, 2, "left", (1, 0)),
        (2.0, 2, "right", (0, 0)),
        # At both ends, `side` has no effect.
        (0.0, 1, "left", (0, 1)),
        (3.0, 1, "right", (0, -1)),
    ):
        np.testing.assert_allclose(bent(t, order, side=side), value)
    np.testing.assert_array_equal(bent(3 * (1 + 2e-16)), bent(3.0))
    assert bent(0.5).shape == (2,) and bent([]).shape == (0, 2)
    assert bent(np.zeros((3, 4)), 2).shape == (3, 4, 2)
    law = LapLaw(
        breaks=np.array([0.0, 1.0, 2.0]),
        q=np.array([[0.0], [1.0], [1.0]]),
        dq=np.array([[1.0], [0.0]]),
        ddq=np.zeros((2, 1)),
    )
    inner = ac.Trajectory(laws=(law,), method="hand")
    assert inner(1.0, 1, side="left") == 1.0 and inner(1.0, 1) == 0.0


def test_the_last_sample_is_at_the_end_of_the_trajectory(bent):
    np.testing.assert_array_equal(bent.breaks, [0, 2, 3])
    np.testing.assert_array_equal(bent.switching_points, [0])
    named = dataclasses.replace(bent, stretches=(stretch((0.0, 2.0)), stretch((2.0, 3.0))))
    np.testing.assert_array_equal(named.switching_points, [0, 2, 3])
    samples = bent.sample(0.7)
    np.testing.assert_allclose(samples.t, [0, 0.7, 1.4, 2.1, 2.8, 3.0])
    np.testing.assert_array_equal(samples.dq, bent(samples.t, 1))
    np.testing.assert_array_equal(samples.ddq, bent(samples.t, 2))
    np.testing.assert_allclose(bent.sample(1.5).t, [0, 1.5, 3.0])  # the end is not doubled
    np.testing.assert_allclose(bent.sample(10.0).t, [0, 3.0])


def test_invalid_trajectories_and_set_points_are_refused(bent, refuses):
    for t in (-1e-6, 3.001, np.nan):
        refuses(lambda t=t: bent([1.0, t]), ac.InvalidInput, "3 s", t=t, allowed=3.0)
    good = {"cycle": 0.1, "q": np.zeros((4, 2)), "trajectory": bent, "method": "none"}
    np.testing.assert_allclose(ac.SetPoints(**good).t, [0, 0.1, 0.2, 0.3])
    changes = [{"cycle": x} for x in (0.0, np.nan)] + [{"start_time": x} for x in (0.1, np.nan)]
    changes += [{"q": x} for x in (np.zeros((0, 2)), np.zeros(3), np.array([[0.0, np.inf]]))]
    for call in (
        lambda: ac.Trajectory(laws=(), method="none"),
        *(lambda order=order: bent(0.0, order) for order in (-1, 4, 1.5)),
        *(lambda cycle=cycle: bent.sample(cycle) for cycle in (0.0, -1.0, np.nan)),
        *(lambda change=change: ac.SetPoints(**good | change) for change in changes),
    ):
        refuses(call, ac.InvalidInput)


def test_an_execution_is_interpolated_only_at_multiples_of_its_interval(conventional, arm):
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    plant = ac.ServoPlant(arm, servo, saturation="none")
    free = dataclasses.replace(conventional, limits=None)
    whole = ac.simulate(ac.compensate(free, servo, ac.NoCompensation(), cycle=4e-3), plant)
    interval = np.array([7])
    assert len(whole.between(interval)(whole.t[7:8] + 2e-4)) == 1
    names = ("t", "q", "dq", "ddq", "demand")
    for part, is_known in (
        (slice(0, None, 2), True),
        (slice(5, None), True),
        # Rejected: larger than the cycle, across a set-point, with a gap, with a repeated time.
        (slice(0, None, 20), False),
        (slice(0, None, 3), False),
        (slice(5, None, 2), False),
        (np.r_[0:8, 300:500], False),
        (np.r_[0, 0:300], False),
    ):
        cut = dataclasses.replace(whole, **{name: getattr(whole, name)[part] for name in names})
        assert (cut.between(interval) is not None) == is_known, part
    assert dataclasses.replace(whole, plant=None).between(interval) is None


def test_a_law_that_starts_late_has_both_sides_of_its_breaks():
    # For few breaks, (start + break) - start equals the break; some are rounded up, others down.
    random = np.random.default_rng(0)
    breaks = np.append(0.0, np.cumsum(random.uniform(0.5e-3, 2e-3, 400)))
    starts = 1.0 / 3.0 + 33.0
    numbers = np.arange(400.0)[:, None]
    law = LapLaw(breaks=breaks, q=np.zeros((401, 1)), dq=np.zeros((400, 1)), ddq=numbers)
    trajectory = ac.Trajectory(laws=(lap(starts, (0,), (0,), (0,)), law), method="hand")
    joints = trajectory.breaks[1:]
    rounded = joints - starts
    assert (rounded < breaks).sum() > 50 and (rounded > breaks).sum() > 50
    np.testing.assert_array_equal(trajectory(joints[:-1], 2), numbers)
    np.testing.assert_array_equal(trajectory(joints[1:], 2, side="left"), numbers)
