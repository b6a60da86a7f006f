"""Metrics of an execution besides its errors: sides, overshoot, utilisation, ratios of the plan."""

import numpy as np
import pytest

import armcontour as ac


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("pmk3s")


def executed(arm, tool, period, planned):
    """An execution whose tool goes through given points at regular times."""
    q = arm.inverse(tool)
    dq = np.gradient(q, period, axis=0)
    return ac.Execution(
        arm=arm,
        taught=ac.TaughtData(period=period, q=q, trajectory=planned, method="none"),
        t=np.arange(len(q)) * period,
        q=q,
        dq=dq,
        ddq=np.zeros_like(q),
        demand=np.zeros_like(q),
        demand_range=np.zeros((2, 2)),
        saturated_time=np.zeros(2),
    )


def test_the_contour_error_is_signed_in_the_plane(arm):
    path = ac.Path.polyline([(0.30, 0.20), (0.40, 0.20), (0.40, 0.30)])
    planned = ac.plan(path, arm, arm.limits.replace(speed=0.1))
    tool = np.array([(0.31, 0.201), (0.35, 0.198), (0.399, 0.25), (0.403, 0.28), (0.402, 0.199)])
    period = planned.duration / (len(tool) - 1)
    error = ac.evaluate(executed(arm, tool, period, planned), path).contour_error
    assert error.signed is not None
    expected = [1e-3, -2e-3, 1e-3, -3e-3, -np.hypot(2e-3, 1e-3)]
    np.testing.assert_allclose(error.signed[:5], expected, atol=1e-12)
    np.testing.assert_allclose(np.abs(error.signed), error.values, atol=1e-15)


def test_overshoot_knows_the_segments_own_speeds(arm):
    slow = ac.Demand(speed=0.05)
    path = ac.Path.from_segments(
        [
            ac.Line(start=(0.30, 0.20), end=(0.35, 0.20)),
            ac.Line(start=(0.35, 0.20), end=(0.40, 0.20), demand=slow),
        ]
    )
    limits = arm.limits.replace(speed=0.1)
    planned = ac.plan(path, arm, limits)
    period = planned.duration / 400
    tool = np.column_stack([np.linspace(0.30, 0.40, 401), np.full(401, 0.20)])
    found = ac.evaluate(executed(arm, tool, period, planned), path, limits=limits)
    speed = 0.10 / planned.duration
    assert found.path_velocity == pytest.approx(speed, rel=1e-3)
    assert found.speed_overshoot == pytest.approx(max(speed - 0.05, 0.0), abs=1e-4)


def test_the_papers_job_uses_its_joints_and_keeps_its_limits(arm):
    objective = ac.Path.polyline([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
    rounded = ac.round_corners(objective, tolerance=5e-3)
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
    planned = ac.plan(rounded, arm, limits)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    taught = ac.compensate(planned, servo, method="pole_placement", period=2e-4)
    executed = ac.execute(taught, ac.ServoPlant(arm, servo))
    found = ac.evaluate(executed, rounded, limits=limits, limit_use=True)
    # Lines 1 and 3 and line 2 beside its middle run at a joint's limit: all but the corners and the
    # middle, which take 1.136 and 0.571 of 5.326 s.
    assert found.utilisation == pytest.approx(1 - (1.136 + 0.571) / 5.326, abs=0.06)
    names = {"joint_acceleration", "speed", "centripetal_acceleration"}
    assert set(found.limit_ratios) == names
    assert all(0.999 < x <= 1 + 1e-9 for x in found.limit_ratios.values())
    assert found.speed_overshoot <= 1e-9
    # Nobody pays for what was not asked for.
    errors = ac.evaluate(executed, rounded, limits=limits)
    assert errors.utilisation is None and errors.limit_ratios is None
    assert errors.contour_error.rms == found.contour_error.rms
