"""The conventional method: uniform tool speed, whatever the joints say."""

import numpy as np
import pytest

import armcontour as ac


def test_the_tool_moves_uniformly_and_velocity_jumps_at_corners(arm, objective, conventional):
    assert conventional.duration == pytest.approx(objective.length / 0.04, rel=1e-12)
    t = np.linspace(0, conventional.duration, 4001)
    tool = arm.forward(conventional(t))
    np.testing.assert_allclose(tool, objective((0.04 * t).clip(0, objective.length)), atol=1e-8)
    velocity = arm.tool_velocity(conventional(t), conventional(t, 1))
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), 0.04, rtol=1e-6)
    at = objective.stops[0] / 0.04
    for side in ("left", "right"):
        velocity = arm.tool_velocity(conventional(at), conventional(at, 1, side=side))
        expected = 0.04 * objective(objective.stops[0], 1, side=side)
        np.testing.assert_allclose(velocity, expected, atol=1e-9)
    assert (np.abs(conventional([0.0, conventional.duration], 1)).max(axis=1) > 0.05).all()


def test_joint_limits_are_not_planned_for_and_the_stretch_reports_the_demand(
    arm, objective, limits, conventional
):
    tight = limits.replace(joint_acceleration=1e-6, joint_velocity=1e-6, speed=0.04)
    planned = ac.plan(objective, arm, tight, method="conventional")
    assert planned.duration == pytest.approx(9.0655, abs=1e-3)
    assert (planned.stretches[0].demand > 1e-6).all()
    (stretch,) = conventional.stretches
    assert (stretch.kind, stretch.t) == ("uniform", (0.0, conventional.duration))
    assert stretch.speed == pytest.approx(0.04, rel=1e-6)
    # Close past the base the joints' demand peaks over a few millimetres of a long line.
    path = ac.Path.polyline([(-0.2, 0.04), (0.45, 0.04)])
    peak = ac.plan(path, arm, limits.replace(speed=0.1), method="conventional")
    for planned in (conventional, peak):
        fine = np.abs(planned(np.linspace(0, planned.duration, 100_001), 2)).max(axis=0)
        np.testing.assert_allclose(planned.stretches[0].demand, fine, rtol=1e-3)


def test_segments_have_their_own_speeds(arm, limits):
    path = ac.Path.from_segments(
        [
            ac.Line(start=(0.3, 0.2), end=(0.36, 0.2), demand=ac.Demand(speed=0.02)),
            ac.Line(start=(0.36, 0.2), end=(0.36, 0.28)),
            ac.Line(start=(0.36, 0.28), end=(0.30, 0.28), demand=ac.Demand(speed=9.0)),
        ]
    )
    planned = ac.plan(path, arm, limits.replace(speed=0.04), method="conventional")
    assert planned.duration == pytest.approx(0.06 / 0.02 + 0.08 / 0.04 + 0.06 / 0.04)
    speed = [np.linalg.norm(arm.tool_velocity(planned(t), planned(t, 1))) for t in (1.0, 4.0, 6.0)]
    np.testing.assert_allclose(speed, [0.02, 0.04, 0.04], rtol=1e-6)
