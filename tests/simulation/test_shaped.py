"""The execution of the paper's job along its shaped path stays in the tolerance."""

import dataclasses

import pytest

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS

TOLERANCE = 5e-3
SLACK = 1e-5  # m, of the executed tool beyond the tolerance
SERVO = ac.ServoModel(kp=25, kv=150)
CYCLE = 4e-3
# The reserve is about what interpolated set-points add to accelerations, so that servos saturate
# for some milliseconds at most.
SHAPED = ac.Shaped(tolerance=TOLERANCE, reserve=0.015)


@pytest.mark.parametrize(("centripetal", "longest"), [(0.09, 4.80), (None, 4.46)])
def test_the_executed_tool_stays_within_the_tolerance(arm, objective, centripetal, longest):
    limits = ac.Limits.only(
        speed=0.15, joint_acceleration=0.72, centripetal_acceleration=centripetal
    )
    limits = limits.for_joints(2)
    planned = ac.plan(objective, arm, limits, SHAPED)
    assert planned.duration <= longest
    allowed = {"deviation": TOLERANCE, "coverage_error": TOLERANCE}
    check = ac.check(planned, arm, limits, objective, **allowed, points=5)
    for name in ("path_deviation", "coverage_error", "joint_acceleration"):
        assert check[name].ratio <= 1
    free = dataclasses.replace(planned, limits=None)
    for method, plant, bound in (
        ("inverse", ac.ServoPlant(arm, SERVO, limits), 2e-6),
        ("inverse_dynamics", ac.RigidBodyPlant(arm, SERVO, limits), 5e-6),
    ):
        set_points = ac.compensate(free, SERVO, COMPENSATIONS[method](), cycle=CYCLE, arm=arm)
        executed = ac.simulate(set_points, plant, resolution=5e-4)
        result = ac.evaluate(executed, planned.path, objective=objective, limits=limits)
        # Every place of the tool near the objective, and every corner of it near the tool.
        assert result.objective_error.max <= TOLERANCE + SLACK
        assert result.objective_coverage_error.max <= TOLERANCE + SLACK
        assert result.contour_error.max <= bound
        if method == "inverse":
            assert executed.saturated_time.max() < 0.01
            assert result.demand_ratio.max() <= 1.01
        else:
            assert not executed.saturated_time.any()
