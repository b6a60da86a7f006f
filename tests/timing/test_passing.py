"""When a motion passes a place, against the motion itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.geometry import Path
from armcontour.timing.passing import time_at

ARM = ac.load_arm("pmk3s")
LIMITS = ARM.limits.replace(speed=0.1, centripetal_acceleration=0.09)
OBJECTIVE = Path.polyline([[0.3, 0.1], [0.36, 0.1], [0.36, 0.14], [0.30, 0.12]])
ROUNDED = ac.round_corners(OBJECTIVE, tolerance=1e-3)
OPTIMAL = ac.plan(ROUNDED, ARM, LIMITS)
SHARP = ac.plan(OBJECTIVE, ARM, LIMITS)
MAC = ac.plan(ROUNDED, ARM, LIMITS.replace(speed=0.05), method="mac")
SHARP_MAC = ac.plan(OBJECTIVE, ARM, LIMITS.replace(speed=0.05), method="mac")


@given(st.floats(0, 1))
def test_the_tool_is_at_the_place_then(share: float) -> None:
    for trajectory, path in ((OPTIMAL, ROUNDED), (SHARP, OBJECTIVE)):
        s = share * path.length
        t = time_at(trajectory, ARM, path, s)
        assert 0 <= t <= trajectory.duration
        np.testing.assert_allclose(ARM.forward(trajectory(t)), path(s), atol=1e-9)


@given(st.floats(0, 1))
def test_a_law_without_s_is_abreast_of_the_place_then(share: float) -> None:
    for trajectory, path in ((MAC, ROUNDED), (SHARP_MAC, OBJECTIVE)):
        s = share * path.length
        t = time_at(trajectory, ARM, path, s)
        off = ARM.forward(trajectory(t)) - path(s)
        side = "left" if s > 0 else "right"
        assert abs(off @ path(s, 1, side=side)) < 1e-9
        assert np.linalg.norm(off) < 1e-4  # what "mac" leaves the path by


@pytest.mark.parametrize("trajectory", [SHARP, SHARP_MAC], ids=["optimal", "mac"])
def test_at_a_corner_where_the_tool_stands_it_is_when_it_comes_to_stand(
    trajectory: ac.Trajectory,
) -> None:
    for corner in OBJECTIVE.breaks[1:-1]:
        t = time_at(trajectory, ARM, OBJECTIVE, float(corner))
        np.testing.assert_allclose(ARM.forward(trajectory(t)), OBJECTIVE(corner), atol=1e-9)
        speed = np.linalg.norm(ARM.tool_velocity(trajectory(t), trajectory(t, 1, side="left")))
        assert speed < 1e-4


@pytest.mark.parametrize("trajectory", [OPTIMAL, MAC], ids=["optimal", "mac"])
def test_times_grow_with_the_place(trajectory: ac.Trajectory) -> None:
    places = np.linspace(0, ROUNDED.length, 60)
    times = [time_at(trajectory, ARM, ROUNDED, float(s)) for s in places]
    assert (np.diff(times) > 0).all()
    assert (times[0], times[-1]) == (0.0, trajectory.duration)
