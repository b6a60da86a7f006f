"""Trajectories: one continuous law from many, two-sided at breaks; and what flows after them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import LapLaw, Law, Samples, Stretch


def lap(duration, q, dq, ddq):
    """One lap of one joint pair that moves as q + dq t + ddq t² / 2."""
    q, dq, ddq = (np.atleast_2d(np.asarray(x, float)) for x in (q, dq, ddq))
    end = q + duration * (dq + duration * ddq / 2)
    return LapLaw(breaks=np.array([0.0, duration]), q=np.concatenate([q, end]), dq=dq, ddq=ddq)


@pytest.fixture
def bent():
    """Two laws: joint 1 speeds up for 2 s, then stands; joint 2 moves on, then back."""
    return ac.Trajectory(
        laws=(lap(2.0, (0, 0), (0, 1), (1, 0)), lap(1.0, (2, 2), (0, -1), (0, 0))), method="hand"
    )


def test_values_by_hand(bent):
    assert bent.duration == 3.0 and bent.dof == 2
    np.testing.assert_allclose(bent([0.0, 1.0, 2.0, 3.0]), [(0, 0), (0.5, 1), (2, 2), (2, 1)])
    np.testing.assert_allclose(bent(1.0, 1), (1, 1))
    np.testing.assert_allclose(bent(1.0, 2), (1, 0))


def test_both_sides_of_a_break(bent):
    np.testing.assert_allclose(bent(2.0, 1, side="left"), (2, 1))
    np.testing.assert_allclose(bent(2.0, 1, side="right"), (0, -1))
    np.testing.assert_allclose(bent(2.0, 2, side="left"), (1, 0))
    np.testing.assert_allclose(bent(2.0, 2), (0, 0))
    np.testing.assert_array_equal(bent(2.0, side="left"), bent(2.0))


def test_at_the_ends_both_sides_are_the_inner_one(bent):
    for at in (0.0, 3.0):
        np.testing.assert_array_equal(bent(at, 1, side="left"), bent(at, 1, side="right"))


def test_both_sides_of_a_break_within_a_law():
    law = LapLaw(
        breaks=np.array([0.0, 1.0, 2.0]),
        q=np.array([[0.0], [1.0], [1.0]]),
        dq=np.array([[1.0], [0.0]]),
        ddq=np.zeros((2, 1)),
    )
    trajectory = ac.Trajectory(laws=(law,), method="hand")
    assert trajectory(1.0, 1, side="left") == 1.0 and trajectory(1.0, 1) == 0.0


def test_both_sides_of_every_break_of_a_law_that_starts_late():
    # The sum of start and break, less the start, is the break on few of them: it is rounded up on
    # some, and down on others.
    random = np.random.default_rng(0)
    breaks = np.append(0.0, np.cumsum(random.uniform(0.5e-3, 2e-3, 400)))
    starts, numbers = 1.0 / 3.0 + 33.0, np.arange(400.0)[:, None]
    law = LapLaw(breaks=breaks, q=np.zeros((401, 1)), dq=np.zeros((400, 1)), ddq=numbers)
    late = ac.Trajectory(laws=(lap(starts, (0,), (0,), (0,)), law), method="hand")
    at = late.breaks[1:]
    rounded = at - starts
    assert (rounded < breaks).sum() > 50 and (rounded > breaks).sum() > 50
    np.testing.assert_array_equal(late(at[:-1], 2), numbers)
    np.testing.assert_array_equal(late(at[1:], 2, side="left"), numbers)


def test_breaks_and_switching_points(bent):
    np.testing.assert_array_equal(bent.breaks, [0, 2, 3])
    np.testing.assert_array_equal(bent.switching_points, [0])

    def stretch(t):
        return Stretch(name="x", kind="MAC", t=t, s=(0.0, 1.0), demand=np.ones(2), speed=1.0)

    named = dataclasses.replace(bent, stretches=(stretch((0.0, 2.0)), stretch((2.0, 3.0))))
    np.testing.assert_array_equal(named.switching_points, [0, 2, 3])


def test_shapes_follow_the_argument(bent):
    assert bent(0.5).shape == (2,)
    assert bent(np.zeros((3, 4)), 2).shape == (3, 4, 2)
    assert bent([]).shape == (0, 2)


def test_sample_ends_at_the_end(bent):
    samples = bent.sample(0.7)
    np.testing.assert_allclose(samples.t, [0, 0.7, 1.4, 2.1, 2.8, 3.0])
    np.testing.assert_array_equal(samples.dq, bent(samples.t, 1))
    np.testing.assert_array_equal(samples.ddq, bent(samples.t, 2))
    np.testing.assert_allclose(bent.sample(1.5).t, [0, 1.5, 3.0])  # the end is not doubled
    np.testing.assert_allclose(bent.sample(10.0).t, [0, 3.0])


@pytest.mark.parametrize("t", [-1e-6, 3.001, np.nan])
def test_outside_is_refused(bent, t, refuses):
    refuses(
        lambda: bent([1.0, t]), ac.InvalidInput, "outside the trajectory", "3 s", t=t, allowed=3.0
    )


def test_rounding_beyond_the_end_is_not_outside(bent):
    np.testing.assert_array_equal(bent(3 * (1 + 2e-16)), bent(3.0))


def test_rest_before_and_after(bent):
    t = np.array([-1.0, 0.0, 0.5, 2.0, 3.0, 4.0])
    expected = bent(np.clip(t, 0, 3)), bent(np.clip(t, 0, 3), 1), bent(np.clip(t, 0, 3), 2)
    for values in expected[1:]:
        values[[0, -1]] = 0.0
    for order, values in enumerate(bent.motion_with_rests(t)):
        np.testing.assert_array_equal(values, expected[order])
        np.testing.assert_array_equal(values, bent.with_rests(t, order))


@pytest.mark.parametrize("order", [-1, 4, 1.5])
def test_other_orders_are_refused(bent, order, refuses):
    refuses(lambda: bent(0.0, order), ac.InvalidInput, "from 0 to 3", str(order))


def test_a_trajectory_of_nothing_is_refused(refuses):
    refuses(lambda: ac.Trajectory(laws=(), method="none"), ac.InvalidInput, "at least one law")


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan])
def test_a_period_that_is_none_is_refused(bent, period, refuses):
    refuses(lambda: bent.sample(period), ac.InvalidInput, "sampling period")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"period": 0.0}, ("command interval", "above zero")),
        ({"period": np.nan}, ("command interval", "finite")),
        ({"q": np.zeros((0, 2))}, ("at least one row",)),
        ({"q": np.zeros(3)}, ("one per joint",)),
        ({"q": np.array([[0.0, np.inf]])}, ("set-points", "finite")),
        ({"start_time": 0.1}, ("start_time", "above zero", "0.1 s")),
        ({"start_time": np.nan}, ("start_time", "finite")),
    ],
)
def test_taught_data_refuses(bent, change, words, refuses):
    good = {"period": 0.1, "q": np.zeros((4, 2)), "trajectory": bent, "method": "none"}
    np.testing.assert_allclose(ac.TaughtData(**good).t, [0, 0.1, 0.2, 0.3])
    refuses(lambda: ac.TaughtData(**good | change), ac.InvalidInput, *words)


def arrays_of(value):
    return {
        f.name: getattr(value, f.name)
        for f in dataclasses.fields(value)
        if isinstance(getattr(value, f.name), np.ndarray)
    }


def test_everything_that_flows_copies_and_locks_its_arrays(arm, bent):
    given = {
        "t": np.zeros(3), "q": np.ones((3, 2)), "dq": np.ones((3, 2)), "ddq": np.ones((3, 2)),
        "demand": np.ones((3, 2)), "demand_range": np.ones((2, 2)), "saturated_time": np.ones(2),
    }  # fmt: skip
    taught = ac.TaughtData(period=0.1, q=given["q"], trajectory=bent, method="none")
    made = [
        (Samples(**{k: given[k] for k in ("t", "q", "dq", "ddq")}), 4),
        (taught, 1),
        (ac.Execution(arm=arm, taught=taught, **given), 7),
        (
            Stretch(name="x", kind="y", t=(0, 1), s=(0, 1), demand=np.ones(2), speed=1.0),
            1,
        ),
        (bent, 2),
        (bent.laws[0], 4),
    ]
    for value, count in made:
        arrays = arrays_of(value)
        assert len(arrays) == count, type(value)
        for name, array in arrays.items():
            assert not array.flags.writeable, (type(value), name)
            assert not any(np.shares_memory(array, x) for x in given.values())
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, next(iter(arrays)), None)


def test_laws_of_users_may_give_any_arrays():
    class Still(Law):
        breaks = np.array([0.0, 1.0])

        def on_interval(self, i, t, order):
            return np.broadcast_to(np.float32([0.5, 0.25]), (len(t), 2))

    found = ac.Trajectory(laws=(Still(),), method="hand")(np.linspace(0, 1, 5))
    assert found.dtype == np.float64 and found.flags.writeable and found.flags.owndata
    np.testing.assert_array_equal(found, np.tile([0.5, 0.25], (5, 1)))
