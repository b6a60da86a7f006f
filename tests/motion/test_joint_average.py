"""Averages of joint positions: against brute force, and within the limits of what is averaged."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import JointAverage, SmoothedLaw


@pytest.fixture(scope="module")
def law(arm):
    bend = ac.Path.polyline([[0.30, 0.16], [0.34, 0.16], [0.34, 0.20]])
    limits = ac.Limits(speed=0.15, joint_acceleration=0.72)
    (found,) = ac.plan(ac.round_corners(bend, tolerance=2e-3), arm, limits, intervals=200).laws
    return found


def moving(law):
    return ac.Trajectory(laws=(law,), method="made up")


def averaged(law, first, second=0.0):
    way = SmoothedLaw(law=law, windows=(first, 0.0))
    found = JointAverage(law=law, window=first, way=way)
    if second:
        both = SmoothedLaw(law=law, windows=(first, second))
        found = JointAverage(law=found, window=second, way=both)
    return moving(found)


def test_positions_are_the_mean_over_the_window(law):
    window = 0.02
    plan, found = moving(law), averaged(law, window)
    assert found.duration == pytest.approx(plan.duration + window, abs=1e-12)
    shares = (np.arange(4000) + 0.5) / 4000
    for t in np.linspace(0.0, found.duration, 25):
        times = np.clip(t - window * shares, 0.0, plan.duration)
        np.testing.assert_allclose(found(t), plan(times).mean(axis=0), atol=1e-9)
        np.testing.assert_allclose(found(t, 1), plan(times, 1).mean(axis=0), atol=1e-6)


def test_joints_take_no_more_than_before_where_the_path_bends(law):
    """Averaging s(t) takes a third more beside the arc, averaging the joints takes nothing more."""
    plan, found = moving(law), averaged(law, 0.008)
    on_path = moving(SmoothedLaw(law=law, windows=(0.008, 0.0)))
    t = np.linspace(0.0, found.duration, 20_001)
    for order in (1, 2):
        most = np.abs(plan(np.linspace(0.0, plan.duration, 20_001), order)).max()
        assert np.abs(found(t, order)).max() <= most * (1 + 1e-9)
    assert np.abs(on_path(t, 2)).max() > 1.1 * 0.72


@pytest.mark.parametrize("second", [0.0, 0.005])
def test_velocities_and_accelerations_are_derivatives(law, second):
    found, h = averaged(law, 0.008, second), 1e-5
    t = np.linspace(0.05, found.duration - 0.05, 301)
    for order, near in ((1, 1e-5), (2, 5e-3)):
        slopes = (found(t + h, order - 1) - found(t - h, order - 1)) / (2 * h)
        np.testing.assert_allclose(found(t, order), slopes, atol=near)
    # Accelerations are continuous: they grow by no more than twice the limit in a window.
    steps = np.abs(np.diff(found(np.arange(0.0, found.duration, 1e-4), 2), axis=0)).max()
    assert steps <= 2 * 0.72 * 1e-4 / (second or 0.008) * 1.01


def test_the_tool_leaves_the_path_by_about_a_window_squared(arm, law):
    found, window = averaged(law, 0.01), 0.01
    t = np.linspace(0.0, found.duration, 5001)
    off = law.joint_path.tool_path.project(arm.tool_position(found(t))).distance.max()
    tool = arm.tool_acceleration(found(t), found(t, 1), found(t, 2))
    assert 0.0 < off <= 1.1 * np.linalg.norm(tool, axis=1).max() * window**2 / 24
