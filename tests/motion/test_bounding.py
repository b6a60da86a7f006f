"""Bounds of what laws take of limits: at most, at any time, and no looser than they need to be."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import SmoothedLaw, largest_shares, smooth
from armcontour.motion._bounding import path_rates

# The peaks of the laws below are above the largest value at dense places by less.
NEAR = 1e-5


def planned(jerk):
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline([(0.45, -0.1, 0.2), (0.6, 0.1, 0.25), (0.4, 0.2, 0.3)])
    continuity = "tangent" if jerk is None else "curvature"
    path = ac.round_corners(path, tolerance=5e-3, continuity=continuity)
    limits = ac.Limits(speed=0.2, joint_acceleration=2.0, joint_jerk=jerk)
    return ac.plan(path.oriented(np.diag([1, -1, -1])), arm, limits, intervals=200)


@pytest.fixture(
    scope="module",
    params=[
        (None, ()),
        (None, (8e-3,)),
        (None, (4e-3, 4e-3)),
        (None, (30e-3, 7e-3)),
        (20.0, ()),
        (20.0, (30e-3, 7e-3)),
    ],
    ids=str,
)
def case(request):
    """A law, and limits that it takes in full."""
    jerk, windows = request.param
    plan = planned(jerk)
    law = (smooth(plan, *windows) if windows else plan).laws[0]
    return law, *limits_of(law)


def dense(law):
    """The largest of every joint's states and of ds, at 60 places of every interval, (4, ...)."""
    shares = (1 - np.cos(np.linspace(0, np.pi, 60))) / 2
    i = np.repeat(np.arange(len(law.breaks) - 1), 60)
    width = np.diff(law.breaks)[:, None]
    t = np.clip((law.breaks[:-1, None] + width * shares).ravel(), law.breaks[i], law.breaks[i + 1])
    ddq = law.on_interval(i, t, 2)
    dq = np.abs(law.on_interval(i, t, 1))
    return ddq.max(axis=0), -ddq.min(axis=0), dq.max(axis=0), law.path_position(i, t, 1).max()


def limits_of(law):
    """Limits that the densest look at a law takes in full, each by a joint of its own or by ds."""
    up, down, pace, ds = dense(law)
    pieces = len(law.joint_path.breaks) - 1
    # A joint that stands still takes rounding only.
    return np.maximum([up, down, pace], 1e-4), np.tile([ds, 2 * ds], (pieces, 1))


def test_what_is_taken_in_full_is_proven_up_to_what_a_dense_look_misses(case):
    law, limits, speeds = case
    found = largest_shares(law, limits, speeds, 1 + NEAR)
    assert (found <= 1 + NEAR).all()
    assert found == pytest.approx([1, 1, 1, 1, 0.5], rel=2e-3)
    # At random times it is no more.
    t = np.random.default_rng(0).uniform(0, law.breaks[-1], 50_000)
    i = np.clip(np.searchsorted(law.breaks, t) - 1, 0, len(law.breaks) - 2)
    ddq = law.on_interval(i, t, 2)
    assert (ddq / limits[0]).max() <= 1 + NEAR and (-ddq / limits[1]).max() <= 1 + NEAR
    assert (np.abs(law.on_interval(i, t, 1)) / limits[2]).max() <= 1 + NEAR
    assert (law.path_position(i, t, 1) / speeds[0, 0]).max() <= max(1 + NEAR, found[3])
    none = np.full_like(limits, np.inf), np.full_like(speeds, np.inf)
    np.testing.assert_array_equal(largest_shares(law, *none, 1.0), 0.0)


def test_a_peak_above_is_found_where_the_middles_of_intervals_miss_it(case):
    law, limits, speeds = case
    for k, name in enumerate(("acceleration", "deceleration", "velocity", "speed", "bent")):
        # All others are out of reach.
        wide = [100 * limits, 100 * speeds]
        (wide[0] if k < 3 else wide[1].T)[k % 3] = (limits if k < 3 else speeds.T)[k % 3]
        full = 0.5 if k == 4 else 1.0
        assert largest_shares(law, *wide, (1 - 1e-7) * full)[k] > (1 - 1e-7) * full, name
        assert largest_shares(law, *wide, (1 + NEAR) * full)[k] <= (1 + NEAR) * full, name


def test_rates_are_the_third_and_fourth_derivative_of_the_arc_length(case):
    law = case[0]
    base, windows = (law.law, law.windows) if isinstance(law, SmoothedLaw) else (law, (0.0, 0.0))
    i = np.arange(len(law.breaks) - 1)
    width = np.diff(law.breaks)
    i, width = i[width > 1e-4], width[width > 1e-4]
    middle, step = law.breaks[i] + 0.37 * width, 0.2 * width
    found = path_rates(middle, step, base.breaks, base.rates, windows)
    third = [law.path_position(i, middle + sign * step, 3) for sign in (-1, 0, 1)]
    size = np.abs(third[1]).max()
    np.testing.assert_allclose(found[:, 0], third[1], rtol=1e-9, atol=1e-9 * size)
    change, rounding = third[2] - third[0], 1e-8 * size
    assert (np.abs(change - 2 * step * found[:, 1]) <= 2 * step**2 * found[:, 2] + rounding).all()


@pytest.mark.parametrize("jerk", [None, 10.0])
def test_long_intervals_lose_no_peak(jerk):
    # Few and long intervals, on which a bound has to make up for what its polynomial leaves out.
    random = np.random.default_rng(1)
    arm = ac.load_arm("ur5e")
    limits = ac.Limits(joint_acceleration=2.0, joint_velocity=1.0, joint_jerk=jerk)
    for k in range(6 if jerk is None else 3):
        joint_path = ac.JointPath.spline(random.uniform(-1.5, 1.5, (4, 6)))
        plan = ac.plan(joint_path, arm, limits, intervals=12)
        for windows in ((), (0.3,), (0.2, 0.1)):
            law = (smooth(plan, *windows) if windows else plan).laws[0]
            full, speeds = limits_of(law)
            for row in range(3):
                only = np.full((3, 6), 1e3)
                only[row] = full[row]
                found = largest_shares(law, only, 100 * speeds, 1 - 1e-7)
                assert found[row] > 1 - 1e-7, (k, windows, row)
            found = largest_shares(law, 100 * full, speeds, 1 - 1e-7)
            assert found[3] > 1 - 1e-7, (k, windows)
