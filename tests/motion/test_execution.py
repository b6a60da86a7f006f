"""Executions: what follows from the joints' motion."""

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import stand_still


def test_tool_speed_and_saturation(arm):
    trajectory = ac.Trajectory(laws=(stand_still(np.zeros(2), 1.0),), method="hand")
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


def test_motion_between_results_is_known_at_steps_of_the_command_interval_only(conventional, arm):
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    plant = ac.ServoPlant(arm, servo, saturation="none")
    whole = ac.execute(ac.compensate(conventional, servo, method="none", period=4e-3), plant)
    here = np.array([7])
    assert len(whole.between(here)(whole.t[7:8] + 2e-4)) == 1
    names = ("t", "q", "dq", "ddq", "demand")
    for part, known in (
        (slice(0, None, 2), True),
        (slice(5, None), True),
        # Fewer than set-points, across a set-point, over a gap, a time twice.
        (slice(0, None, 20), False),
        (slice(0, None, 3), False),
        (slice(5, None, 2), False),
        (np.r_[0:8, 300:500], False),
        (np.r_[0, 0:300], False),
    ):
        cut = dataclasses.replace(whole, **{name: getattr(whole, name)[part] for name in names})
        assert (cut.between(here) is not None) == known, part
    assert dataclasses.replace(whole, plant=None).between(here) is None
