"""MAC on random polylines: either a plan that keeps every limit between knots, or a clear no."""

import numpy as np
import pytest

import armcontour as ac


def random_job(rng):
    points = rng.uniform((0.15, 0.08), (0.42, 0.32), size=(int(rng.integers(2, 6)), 2))
    if rng.random() < 0.2:  # a short line among long ones
        points[1] = points[0] + rng.uniform(-2e-3, 2e-3, 2)
    rounded = ac.round_corners(ac.Path.polyline(points), tolerance=10 ** rng.uniform(-3.5, -2))
    limits = ac.Limits(
        joint_acceleration=rng.uniform(0.4, 2.0, 2),
        speed=rng.uniform(0.03, 0.25),
        centripetal_acceleration=rng.uniform(0.03, 0.2),
    )
    return rounded, limits, int(rng.integers(40, 200))


@pytest.mark.parametrize("batch", range(2))
def test_random_polylines(arm, batch):
    rng = np.random.default_rng(batch)
    planned_ones = refused_ones = 0
    for _ in range(40):
        path, limits, knots = random_job(rng)
        try:
            planned = ac.plan(path, arm, limits, method="mac", knots=knots)
        except ac.NotRealizable as error:
            assert 0 <= error.s <= path.length
            if "at rest next to an arc" in str(error):  # the arc used up the first or last line
                assert 0 in path.corners.start or path.length in path.corners.end
                continue
            # Laps of full acceleration keep the limit by construction, or stop and say so.
            assert "(MAC)" not in str(error) and "(MDC)" not in str(error)
            assert error.limit == "joint_acceleration" and error.joint in (1, 2)
            assert error.needed > error.allowed
            refused_ones += 1
            continue
        planned_ones += 1
        breaks = planned.breaks
        t = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0.05, 0.95, 10)).ravel()
        q, dq, ddq = (planned(t, order) for order in (0, 1, 2))
        assert (np.abs(ddq) <= limits.joint_acceleration * (1 + 1e-6)).all()
        speed = np.linalg.norm(arm.tool_velocity(q, dq), axis=1)
        # Tracing leaves the tool 1e-8 m of play, and its speed a few millionths.
        assert speed.max() <= limits.speed * (1 + 1e-5)
        found = path.project(arm.forward(q))
        assert found.distance.max() < 2e-5
        inner = breaks[1:-1]
        np.testing.assert_allclose(planned(inner, side="left"), planned(inner), atol=1e-9)
        assert np.abs(planned([0.0, planned.duration], 1)).max() < 1e-9
        ends = arm.forward(planned([0.0, planned.duration]))
        np.testing.assert_allclose(ends, path.vertices[[0, -1]], atol=1e-7)
        assert planned.duration > path.length / limits.speed
        demand = np.max([x.demand for x in planned.stretches], axis=0)
        assert (demand >= np.abs(ddq).max(axis=0) * (1 - 1e-3)).all()
    assert planned_ones >= 10 and refused_ones >= 1
