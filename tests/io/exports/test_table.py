"""Tables: time from the first point, derivatives of set-points, and what is refused."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicSpline
from tests.io.tables import refusals

import armcontour as ac
from armcontour.io import read_trajectory
from armcontour.io.exports import make_table, write_table
from armcontour.motion import TimedEvent

PERIOD = 0.004
JERK = 7.2  # rad/s³


def joined(samples, orders):
    """What a controller makes of points: cubics of two orders, quintics of three."""
    given_of = np.stack([samples.q, samples.dq, samples.ddq][:orders], axis=1)
    return BPoly.from_derivatives(samples.t, given_of)


def rest_to_rest(t):
    return np.stack([np.cos(3 * t), 2 * np.cos(6 * t)], axis=1)


def test_time_counts_from_the_first_set_point_and_that_of_events_too(taught):
    data = taught(np.zeros((30, 2)), start_time=-3 * PERIOD)
    found = make_table(data, name="x")
    assert found.t[0] == 0 and found.start_time == -3 * PERIOD
    np.testing.assert_allclose(found.t + found.start_time, data.t, rtol=0, atol=1e-15)
    for before, after in zip(data.trajectory.events, found.events, strict=True):
        assert after.t == pytest.approx(before.t + 3 * PERIOD, abs=1e-15)
        assert after.due == pytest.approx(before.due + 3 * PERIOD, abs=1e-15)
        assert (after.name, after.value, after.s) == (before.name, before.value, before.s)


def test_a_trajectory_is_sampled_with_its_own_derivatives(conventional, arm):
    found = make_table(conventional, name="x", arm=arm, period=0.05)
    np.testing.assert_array_equal(found.q, conventional(found.t))
    np.testing.assert_array_equal(found.dq, conventional(found.t, 1))
    np.testing.assert_array_equal(found.ddq, conventional(found.t, 2))
    np.testing.assert_allclose(found.tool, arm.forward(found.q), atol=1e-15)
    assert found.t[-1] == conventional.duration and found.joint_names == arm.joint_names


@given(seed=st.integers(0, 10_000), count=st.integers(2, 40))
def test_cubic_and_quintic_controllers_run_the_same_curve_through_all_set_points(
    conventional, seed, count
):
    q = np.random.default_rng(seed).normal(size=(count, 2))
    data = ac.TaughtData(period=PERIOD, q=q, trajectory=conventional, method="none")
    found = make_table(data, name="x")
    t = np.linspace(0, found.t[-1], 501)
    np.testing.assert_allclose(joined(found, 2)(t), joined(found, 3)(t), atol=1e-11)
    np.testing.assert_allclose(joined(found, 3)(found.t), q, atol=1e-12)
    assert not found.dq[[0, -1]].any()


def test_the_curve_through_set_points_is_of_fourth_order(taught):
    errors = []
    for count in (101, 201):
        t = np.linspace(0, np.pi / 3, count)
        data = dataclasses.replace(taught(rest_to_rest(t)), period=t[1])
        dense = np.linspace(0, t[-1], 5000)
        curve = joined(make_table(data, name="x"), 3)
        errors.append(np.abs(curve(dense) - rest_to_rest(dense)).max())
    assert errors[0] < 1e-6
    assert 12 < errors[0] / errors[1] < 20


@pytest.fixture(scope="module")
def smooth():
    path = ac.Path.from_segments([ac.Arc(start=(0.40, 0.25), center=(0.35, 0.25), angle=1.0)])
    return ac.plan(path, ac.load_arm("pmk3s"), ac.Limits(joint_acceleration=0.72, joint_jerk=JERK))


def test_a_plan_with_a_limit_of_jerk_keeps_it_from_point_to_point(smooth, tmp_path):
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    taught = ac.compensate(smooth, servo, method="none", period=PERIOD)
    for data, period in ((smooth, PERIOD), (taught, None)):
        found = make_table(data, name="x", period=period)
        at = np.minimum(found.t, smooth.duration)
        np.testing.assert_allclose(found.dq, smooth(at, 1), atol=1e-12)
        np.testing.assert_allclose(found.ddq, smooth(at, 2), atol=1e-12)
        steps = np.abs(np.diff(found.ddq, axis=0)) / np.diff(found.t)[:, None]
        assert 0.99 * JERK < steps.max() <= JERK * (1 + 1e-9)
        assert np.abs(found.ddq[[0, -1]]).max() < 1e-12
        # Between points, a controller of quintics is within a nanoradian of the plan.
        dense = np.linspace(0, smooth.duration, 3001)
        np.testing.assert_allclose(joined(found, 3)(dense), smooth(dense), atol=1e-9)
        write_table(found, tmp_path / "a.yaml", format="ros-yaml")
        again = read_trajectory(tmp_path / "a.yaml", found.joint_names)
        np.testing.assert_allclose(again.ddq, found.ddq, atol=1e-11)
    # Where it is to join points by cubics, velocities are those of the spline, as before.
    found = make_table(taught, name="x", derivatives=1)
    spline = CubicSpline(taught.t, taught.q, bc_type="clamped")
    np.testing.assert_allclose(found.dq, spline(taught.t, 1), atol=1e-12)


def test_derivatives_are_left_out_from_the_highest_on(taught):
    for n in (0, 1, 2):
        found = make_table(taught(np.ones((5, 2))), name="x", derivatives=n)
        assert [found.dq is not None, found.ddq is not None] == [n > 0, n > 1]
    # One set-point is at rest.
    found = make_table(taught(np.ones((1, 2))), name="x")
    assert not found.dq.any() and not found.ddq.any() and found.duration == 0


def test_an_event_belongs_to_the_last_point_at_or_before_it(table, taught):
    found = table(count=9)
    assert found.point_of_events == [0, 1, 1, 3, 8]
    assert found.events[3].t < found.t[3]  # by rounding only, so that it is on the point
    # An event before the plan is kept where the command leads.
    data = taught(np.zeros((9, 2)), start_time=-0.008, events=early(-0.005))
    assert make_table(data, name="x").events[0].t == pytest.approx(0.003, abs=1e-15)


def test_joint_names_come_from_the_caller_the_arm_or_are_numbered(taught, arm):
    data = taught(np.zeros((3, 2)))
    assert make_table(data, name="x").joint_names == ("joint 1", "joint 2")
    assert make_table(data, name="x", arm=arm).joint_names == arm.joint_names
    assert make_table(data, name="x", arm=arm, joint_names=["a", "b"]).joint_names == ("a", "b")


def early(t):
    return (TimedEvent(name="gas", value=True, t=t, due=0.0, s=0.0, point=(0.0, 0.0)),)


def test_refuses_what_cannot_be_a_table(taught, conventional, arm):
    data, three = taught(np.zeros((3, 2))), taught(np.zeros((3, 3)))
    late = taught(np.zeros((3, 2)), events=early(-0.05))
    table = [
        ((data, {"period": 0.008}), "its own interval of 0.004 s"),
        ((data, {"period": "often"}), "period must be numbers in s"),
        ((conventional, {}), "give a period"),
        ((conventional, {"period": -1.0}), "above zero"),
        ((three, {"arm": arm}), "has 2 joints, but 'x' has 3"),
        ((data, {"joint_names": ["a", "b", "c"]}), "2 joints, but 3 joint names"),
        ((data, {"joint_names": ["a", "a"]}), "'a' is there twice"),
        ((data, {"joint_names": ["a", "b\nc"]}), "one line of text"),
        ((data, {"joint_names": ["a", "b" * 81]}), "81 characters, more than 80"),
        ((data, {"derivatives": 3}), "from 0 to 2"),
        (([1, 2], {}), "not list"),
        ((late, {}), "0.05 s before the first set-point"),
    ]
    refusals(lambda x: make_table(x[0], name="x", **x[1]), table)


def test_refuses_arrays_that_do_not_fit(table):
    good = table()
    changes = [
        ({"dq": good.q[:-1]}, "dq of 'part 7' has shape"),
        ({"tool": good.q}, "tool of 'part 7' has shape"),
        ({"t": good.t[::-1]}, "start at zero and increase"),
        ({"q": good.q * np.nan}, "finite"),
        ({"name": "two\nlines"}, "one line of text"),
        ({"t": 0.0}, "t of 'part 7'"),
        ({"q": 0.0}, "q of 'part 7' ... shape"),
    ]
    refusals(lambda x: dataclasses.replace(good, **x), changes)
