"""Executions: what follows from the joints' motion."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import LapLaw


def test_tool_speed_and_saturation(arm):
    law = LapLaw(
        breaks=np.array([0.0, 1.0]), q=np.zeros((2, 2)), dq=np.zeros((1, 2)), ddq=np.zeros((1, 2))
    )
    trajectory = ac.Trajectory(laws=(law,), method="hand")
    executed = ac.Execution(
        arm=arm,
        taught=ac.TaughtData(period=1.0, q=np.zeros((2, 2)), trajectory=trajectory, method="none"),
        t=np.array([0.0, 1.0]),
        q=np.array([[0.0, 0.0], [0.0, np.pi / 2]]),
        dq=np.array([[1.0, 0.0], [0.0, 1.0]]),
        ddq=np.array([[0.72, -0.5], [-0.72, 0.0]]),
        demand=np.array([[3.0, -0.5], [-0.73, 0.0]]),
        demand_range=np.ones((2, 2)),
        saturated_time=np.zeros(2),
    )
    np.testing.assert_allclose(executed.tool, [(0.135, 0.465), (0.35, 0.25)], atol=1e-15)
    assert executed.tool_speed == pytest.approx([0.465, 0.215])
    assert executed.saturated.tolist() == [[True, False], [True, False]]
