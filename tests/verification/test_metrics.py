"""Metrics of an execution: errors, corners, speeds, jerk and use of limits."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.verification.contour_errors import corner_deviations, measure_speed_ratios
from armcontour.verification.error_profile import follow_path


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("pmk3s")


def executed(arm, tool, cycle, planned):
    """An execution whose tool goes through given points at regular times."""
    q = arm.joint_position(tool)
    dq = np.gradient(q, cycle, axis=0)
    return ac.Execution(
        arm=arm,
        set_points=ac.SetPoints(cycle=cycle, q=q, trajectory=planned, method="none"),
        t=np.arange(len(q)) * cycle,
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
    cycle = planned.duration / (len(tool) - 1)
    error = ac.evaluate(executed(arm, tool, cycle, planned), path).contour_error
    assert error.signed is not None
    expected = [1e-3, -2e-3, 1e-3, -3e-3, -np.hypot(2e-3, 1e-3)]
    np.testing.assert_allclose(error.signed[:5], expected, atol=1e-12)
    np.testing.assert_allclose(np.abs(error.signed), error.values, atol=1e-15)


def test_the_speed_overshoot_is_relative_to_the_speed_of_the_segment(arm):
    slow = ac.SegmentLimits(speed=0.05)
    path = ac.Path(
        segments=[
            ac.Line(start=(0.30, 0.20), end=(0.35, 0.20)),
            ac.Line(start=(0.35, 0.20), end=(0.40, 0.20), segment_limits=slow),
        ]
    )
    limits = arm.limits.replace(speed=0.1)
    planned = ac.plan(path, arm, limits)
    cycle = planned.duration / 400
    tool = np.column_stack([np.linspace(0.30, 0.40, 401), np.full(401, 0.20)])
    evaluation = ac.evaluate(executed(arm, tool, cycle, planned), path, limits=limits)
    speed = 0.10 / planned.duration
    assert evaluation.path_velocity == pytest.approx(speed, rel=1e-3)
    assert evaluation.speed_overshoot == pytest.approx(max(speed - 0.05, 0.0), abs=1e-4)
    # The tool passes from the fast to the slow half in the middle of the motion.
    peak = evaluation.speed_peak
    assert peak.ratio == evaluation.speed_ratio == pytest.approx(speed / 0.05, rel=1e-3)
    assert peak.assigned == pytest.approx(0.05) and peak.speed == pytest.approx(speed, rel=1e-3)
    assert 0.45 * planned.duration <= peak.t <= planned.duration


def test_without_an_assigned_velocity_no_place_has_the_largest_ratio(arm):
    path = ac.Path.polyline([(0.30, 0.20), (0.40, 0.20)])
    planned = ac.plan(path, arm)
    tool = np.column_stack([np.linspace(0.30, 0.40, 401), np.full(401, 0.20)])
    evaluation = ac.evaluate(executed(arm, tool, planned.duration / 400, planned), path)
    assert evaluation.speed_peak is None and np.isnan(evaluation.speed_ratio)


def test_the_paper_job_reaches_but_does_not_exceed_its_limits(arm):
    objective = ac.Path.polyline([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
    rounded = ac.round_corners(objective, tolerance=5e-3)
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
    planned = ac.plan(rounded, arm, limits)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    set_points = ac.compensate(planned, servo, ac.PolePlacement(), cycle=2e-4)
    executed = ac.simulate(set_points, ac.ServoPlant(arm, servo))
    evaluation = ac.evaluate(executed, rounded, limits=limits, limit_use=True)
    # A joint limit is active except at the corners and in the middle of line 2, which take 1.136
    # and 0.571 of 5.326 s.
    assert evaluation.time_at_limit == pytest.approx(1 - (1.136 + 0.571) / 5.326, abs=0.06)
    names = {"joint_acceleration", "speed", "centripetal_acceleration"}
    assert set(evaluation.limit_ratios) == names
    assert all(0.999 < x <= 1 + 1e-9 for x in evaluation.limit_ratios.values())
    assert evaluation.speed_overshoot <= 1e-9
    # Without `limit_use`, the ratios are not computed.
    errors = ac.evaluate(executed, rounded, limits=limits)
    assert errors.time_at_limit is None and errors.limit_ratios is None
    assert errors.contour_error.rms == evaluation.contour_error.rms


RIGHT_ANGLE = ac.Path.polyline([(0, 0), (1, 0), (1, 1)])


def dense(points, count=401):
    """Samples along straight lines through points."""
    path = ac.Path.polyline(points)
    return path(np.unique(np.concatenate([np.linspace(0, path.length, count), path.breaks])))


def test_cornering_deviations_are_those_computed_by_hand():
    (corners,) = corner_deviations(dense([(0, 0), (1, 0), (1, 1)]), RIGHT_ANGLE)
    assert corners.vertex == 1 and corners.point == (1.0, 0.0)
    assert corners.rounding == 0.0 and corners.overshoot == 0.0
    # A chamfer from 20 mm before to 20 mm after misses the corner by 20 mm / sqrt(2).
    tool = dense([(0, 0), (0.98, 0), (1, 0.02), (1, 1)], 8001)
    (corners,) = corner_deviations(tool, RIGHT_ANGLE)
    assert corners.rounding == pytest.approx(0.02 / np.sqrt(2), rel=1e-3)
    assert corners.overshoot == 0.0
    # 30 mm too far, back on the line 0.1 m later: beyond the leaving line, through the corner.
    tool = dense([(0, 0), (1.03, 0), (1, 0.1), (1, 1)])
    (corners,) = corner_deviations(tool, RIGHT_ANGLE)
    assert corners.overshoot == pytest.approx(0.03)
    assert corners.rounding < 2e-3
    path = ac.Path.polyline([(0, 0, 0), (1, 0, 0), (1, 0, 1)])
    (corners,) = corner_deviations(dense([(0, 0, 0), (1.01, 0, 0), (1.01, 0, 1)]), path)
    assert corners.overshoot == pytest.approx(0.01)
    path = ac.Path.polyline([(0, 0), (1, 0), (0.2, 0)])
    (corners,) = corner_deviations(dense([(0, 0), (1.02, 0), (0.2, 0)]), path)
    assert corners.overshoot == pytest.approx(0.02)
    path = ac.round_corners(RIGHT_ANGLE, tolerance=0.01)
    assert corner_deviations(dense([(0, 0), (1, 0)]), path) == ()


def test_overshoot_is_measured_across_the_leaving_line():
    for turn in (0.5, 1.0, 2.0, 2.8, -1.2):
        leaving = np.array([np.cos(turn), np.sin(turn)])
        path = ac.Path.polyline([(-1, 0), (0, 0), tuple(leaving)])
        beyond = np.array([np.sin(turn), -np.cos(turn)]) * np.sign(turn)
        tool = np.concatenate([dense([(-1, 0), (0, 0)]), 0.1 * leaving + np.outer([0.01], beyond)])
        (corners,) = corner_deviations(tool, path)
        assert corners.overshoot == pytest.approx(0.01, rel=1e-9), turn


FAST = 0.1  # m/s, assigned to the first of two segments
SLOW = 0.02  # m/s, assigned to the second one
JOINT = 0.05  # m, where they meet on the x axis


def path(first=FAST, last=SLOW):
    ends = [(0.0, 0.0), (JOINT, 0.0), (0.1, 0.0)]
    return ac.Path(
        segments=[
            ac.Line(start=a, end=b, segment_limits=ac.SegmentLimits(speed=v))
            for a, b, v in zip(ends[:-1], ends[1:], (first, last), strict=True)
        ]
    )


def braking(delay_length, acceleration=0.5, cycle=1e-3, lateral=0.0):
    """Tool points and speeds from FAST to SLOW, `delay_length` behind the joint [m]."""
    length = (FAST**2 - SLOW**2) / (2 * acceleration)
    s = np.linspace(0, 0.1, 200_001)
    begin = JOINT + delay_length - length
    speed = np.sqrt(np.clip(FAST**2 - 2 * acceleration * (s - begin), SLOW**2, FAST**2))
    t = np.append(0, np.cumsum(np.diff(s) / speed[:-1]))
    times = np.arange(0, t[-1], cycle)
    place = np.interp(times, t, s)
    return np.stack([place, np.full(len(times), lateral)], axis=1), np.interp(place, s, speed)


@pytest.mark.parametrize("delay_length", [0.0, 1e-3, 3.3e-3])
def test_the_speed_at_the_entry_to_a_slow_segment_counts(delay_length):
    tool, speed = braking(delay_length)
    ratios = measure_speed_ratios(path(), follow_path(path(), tool), speed, None)
    at_joint = np.sqrt(SLOW**2 + 2 * 0.5 * delay_length)
    # Between two samples: at these alone, up to half a sample's braking would not be seen.
    assert ratios.max() == pytest.approx(at_joint / SLOW, rel=2e-3)


def test_speed_ratios_include_peaks_between_samples():
    tool, speed = braking(0.0)
    shares = measure_speed_ratios(path(), follow_path(path(), tool), speed, 0.05)
    assert shares.max() == pytest.approx(FAST / 0.05, rel=1e-3)
    free = ac.Path.polyline([(0, 0), (0.1, 0)])
    assert not measure_speed_ratios(free, follow_path(free, tool), speed, None).any()
    line = ac.Path.polyline([(0, 0), (0.1, 0)])
    t = np.arange(0, 1, 0.02)
    tool = np.stack([0.1 * t, 0 * t], axis=1)
    # A parabola and a kink, both with a peak of 0.1 m/s between two samples.
    for speed in (0.1 - (t - 0.511) ** 2, 0.1 - 0.2 * np.abs(t - 0.511)):
        listed = measure_speed_ratios(line, follow_path(line, tool), speed, 0.1)
        bound = measure_speed_ratios(line, follow_path(line, tool), speed, 0.1, between=True)
        assert listed.max() < 1 <= bound.max() < 1 + 0.04
