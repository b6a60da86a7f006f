"""The paper's job along its shaped path, executed: the bars of the fastest path in a tolerance."""

from __future__ import annotations

import pytest

import armcontour as ac

TOLERANCE = 5e-3
SLACK = 1e-5  # m, of the executed tool beyond the tolerance
SERVO = ac.ServoModel(kp=25, kv=150)
PERIOD = 4e-3
# One command interval of smoothing; the reserve is about what interpolated set-points add to
# accelerations, so that servos saturate for some milliseconds at most.
SMOOTHING, RESERVE = PERIOD, 0.012
MOST_DEMAND = 1.01


@pytest.mark.parametrize(("centripetal", "longest"), [(0.09, 4.80), (None, 4.45)])
def test_the_executed_tool_stays_within_the_tolerance(
    arm: ac.PlanarTwoLink, objective: ac.Path, centripetal: float | None, longest: float
) -> None:
    limits = ac.Limits(
        speed=0.15, joint_acceleration=0.72, centripetal_acceleration=centripetal
    ).for_joints(2)
    planned = ac.plan(
        objective,
        arm,
        limits,
        method="shaped",
        tolerance=TOLERANCE,
        smoothing=SMOOTHING,
        reserve=RESERVE,
    )
    assert planned.duration <= longest
    found = ac.check(
        planned, arm, limits, objective, deviation=TOLERANCE, missed=TOLERANCE, points=5
    )
    for name in ("path_deviation", "path_missed", "joint_acceleration"):
        assert found[name].ratio <= 1
    for method, plant in (
        ("inverse", ac.ServoPlant(arm, SERVO, limits)),
        ("inverse_dynamics", ac.RigidBodyPlant(arm, SERVO, limits)),
    ):
        taught = ac.compensate(planned, SERVO, method=method, period=PERIOD, arm=arm)
        executed = ac.execute(taught, plant, resolution=5e-4)
        result = ac.evaluate(executed, planned.path, objective=objective, limits=limits)
        assert result.objective_error is not None and result.objective_missed is not None
        # Every place of the tool near the objective, and every corner of it near the tool.
        assert result.objective_error.max <= TOLERANCE + SLACK
        assert result.objective_missed.max <= TOLERANCE + SLACK
        assert result.contour_error.max <= 2e-6
        if method == "inverse":
            assert executed.saturated_time.max() < 0.01
            assert result.demand_ratio.max() <= MOST_DEMAND
        else:
            assert not executed.saturated_time.any()
