"""Tool speed as a share of what is assigned at the tool's place."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.evaluation.following import follow_path
from armcontour.evaluation.speed_shares import measure_shares

FAST, SLOW, JOINT = 0.1, 0.02, 0.05


def path(first=FAST, last=SLOW):
    ends = [(0.0, 0.0), (JOINT, 0.0), (0.1, 0.0)]
    return ac.Path.from_segments(
        ac.Line(start=a, end=b, demand=ac.Demand(speed=v))
        for a, b, v in zip(ends[:-1], ends[1:], (first, last), strict=True)
    )


def braking(late, acceleration=0.5, period=1e-3, off=0.0):
    """Tool points and speeds that come down from FAST to SLOW, `late` behind the joint [m]."""
    length = (FAST**2 - SLOW**2) / (2 * acceleration)
    s = np.linspace(0, 0.1, 200_001)
    begin = JOINT + late - length
    speed = np.sqrt(np.clip(FAST**2 - 2 * acceleration * (s - begin), SLOW**2, FAST**2))
    t = np.append(0, np.cumsum(np.diff(s) / speed[:-1]))
    at = np.arange(0, t[-1], period)
    place = np.interp(at, t, s)
    return np.stack([place, np.full(len(at), off)], axis=1), np.interp(place, s, speed)


@pytest.mark.parametrize("late", [0.0, 1e-3, 3.3e-3])
def test_the_speed_where_the_tool_passes_into_a_slow_segment_counts(late):
    tool, speed = braking(late)
    found = measure_shares(path(), follow_path(path(), tool), speed, None)
    at_joint = np.sqrt(SLOW**2 + 2 * 0.5 * late)
    # Between two samples: at these alone, up to half a sample's braking would not be seen.
    assert found.max() == pytest.approx(at_joint / SLOW, rel=2e-3)


def test_a_tool_that_starts_early_is_too_fast_on_the_slow_segment():
    tool, speed = braking(2e-3)
    back = path(SLOW, FAST)
    tool = np.stack([0.1 - tool[::-1, 0], tool[::-1, 1]], axis=1)
    found = measure_shares(back, follow_path(back, tool), speed[::-1], None)
    assert found.max() == pytest.approx(np.sqrt(SLOW**2 + 2 * 0.5 * 2e-3) / SLOW, rel=2e-3)


def test_next_to_a_joint_as_near_as_the_tool_is_to_the_path_the_larger_speed_counts():
    tool, speed = braking(1e-3, off=1e-3)
    within = measure_shares(path(), follow_path(path(), tool), speed, None)
    assert within.max() == pytest.approx(1.0, abs=2e-3)
    tool, speed = braking(3e-3, off=1e-3)
    beyond = measure_shares(path(), follow_path(path(), tool), speed, None)
    assert beyond.max() == pytest.approx(np.sqrt(SLOW**2 + 2 * 0.5 * 2e-3) / SLOW, rel=2e-3)


def test_limits_of_the_path_and_peaks_between_samples():
    tool, speed = braking(0.0)
    shares = measure_shares(path(), follow_path(path(), tool), speed, 0.05)
    assert shares.max() == pytest.approx(FAST / 0.05, rel=1e-3)
    free = ac.Path.polyline([(0, 0), (0.1, 0)])
    assert not measure_shares(free, follow_path(free, tool), speed, None).any()
    line = ac.Path.polyline([(0, 0), (0.1, 0)])
    t = np.arange(0, 1, 0.02)
    tool = np.stack([0.1 * t, 0 * t], axis=1)
    # A parabola and a kink, both with a peak of 0.1 m/s between two samples.
    for speed in (0.1 - (t - 0.511) ** 2, 0.1 - 0.2 * np.abs(t - 0.511)):
        listed = measure_shares(line, follow_path(line, tool), speed, 0.1)
        bound = measure_shares(line, follow_path(line, tool), speed, 0.1, between=True)
        assert listed.max() < 1 <= bound.max() < 1 + 0.04
