"""Limits of jerk: closed forms, stops, speeds at the ends, and cases that once failed."""

import warnings

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicSpline
from soak.jerk import Sampled, ratios

import armcontour as ac

pytestmark = pytest.mark.filterwarnings("ignore:Limits of jerk add")
LINE = ac.JointPath.spline([(0.0,), (1.0,)], [0.0, 1.0])
# From rest over 1 rad to rest: 1.35 s, of which 0.1 s are each of the four ramps, 0.15 s each of
# the two stretches of full acceleration, and 0.65 s even motion.
LIMITS = ac.Limits.only(joint_velocity=[1.0], joint_acceleration=[4.0], joint_jerk=[40.0])
SPLINE = CubicSpline(np.linspace(0, 1, 5), np.random.default_rng(3).uniform(-1, 1, (5, 3)))
OF_SPLINE = ac.Limits.only(
    joint_velocity=[2.0] * 3, joint_acceleration=[5.0] * 3, joint_jerk=[50.0] * 3
)


@pytest.fixture(scope="module")
def ur5e():
    return ac.load_arm("ur5e")


def pieces(breaks):
    """The spline as a joint path of given pieces, each within one of its own."""
    breaks_array = np.array(breaks)
    coefficients = np.zeros((len(breaks_array) - 1, 6, 3))
    for i, (begin, end) in enumerate(zip(breaks_array[:-1], breaks_array[1:], strict=True)):
        k = min(int((begin + end) / 2 * 4), 3)
        for j in range(3):
            polynomial = Polynomial(SPLINE.c[::-1, k, j])
            moved = polynomial(Polynomial([begin - SPLINE.x[k], end - begin]))
            coefficients[i, : len(moved.coef), j] = moved.coef
    return ac.JointPath(breaks=breaks_array, coefficients=coefficients)


WHOLE = pieces(SPLINE.x)


def largest(planned, limits):
    """The largest use of any limit of a joint, by power series of the law and the path."""
    peaks = ratios(Sampled(planned.laws[0]), limits)
    return max(float(np.max(used / limit)) for used, limit in peaks.values())


def test_a_jerk_limited_plan_is_valid_after_any_iteration():
    durations = []
    for iterations in (1, 2, 5, 12, 150):
        trajectory = ac.plan(
            WHOLE,
            limits=OF_SPLINE,
            options=ac.Optimal(intervals=200, iterations=iterations),
        )
        assert largest(trajectory, OF_SPLINE) <= 1 + 1e-9
        durations.append(trajectory.duration)
    assert durations == sorted(durations, reverse=True)
    assert durations[0] > 1.2 * durations[-1]


def test_motion_rests_where_the_second_derivative_jumps():
    # A line that turns into a parabola: dq_ds is continuous at 0.5, the second derivative is not.
    coefficients = np.zeros((2, 6, 2))
    coefficients[0, :2] = [(0.0, 0.0), (0.5, 0.0)]
    coefficients[1, :3] = [(0.5, 0.0), (0.5, 0.0), (0.0, 0.4)]
    path = ac.JointPath(breaks=[0.0, 0.5, 1.0], coefficients=coefficients)
    limits = OF_SPLINE.replace(
        joint_velocity=[2.0] * 2, joint_acceleration=[5.0] * 2, joint_jerk=[50.0, np.inf]
    )
    # Only the second joint's derivative jumps, and its jerk is free.
    law = ac.plan(path, limits=limits).laws[0]
    assert law.speeds[1:-1].min() > 0
    law = ac.plan(path, limits=limits.replace(joint_jerk=[50.0, 50.0])).laws[0]
    np.testing.assert_allclose(law.s[1:-1][law.speeds[1:-1] == 0], [0.5])


def test_nonzero_end_speeds_are_refused_with_jerk_limits(refuses):
    for name in ("start_speed", "end_speed"):
        options = ac.Optimal(**{name: 0.05})
        refuses(lambda x=options: ac.plan(LINE, None, LIMITS, x), ac.InvalidInput, "limits of jerk")


def test_an_hour_of_motion_has_no_jumps_that_a_check_refuses(arm, rounded):
    # Accelerations would jump where lines and arcs meet, by what the jerk covers in 11 or 14 µs.
    for jerk in (0.4, 0.5):
        limits = arm.limits.replace(speed=1e-4, joint_jerk=jerk)
        planned = ac.plan(rounded, arm, limits)
        assert planned.duration > 3500
        assert ac.check(planned, arm, limits).verdict == "kept", jerk


@pytest.mark.parametrize(
    ("name", "seed", "jerk"),
    [("pmk3s", 0, 100), ("pmk3s", 1, 10), ("ur5e", 2, 50), ("panda", 3, 10)],
)
def test_tool_splines_are_passed_without_stops_as_fast_as_joint_splines(name, seed, jerk):
    rng = np.random.default_rng(seed)
    turn = np.linspace(0, rng.uniform(2, 5), int(rng.integers(5, 12)))
    radius = 0.06 * (1 + 0.25 * rng.normal(size=len(turn))).clip(0.5, 1.5)
    points = np.column_stack(
        [radius * np.cos(turn), radius * np.sin(turn), 0.02 * np.sin(3 * turn)]
    )
    arm = ac.load_arm(name)
    limits = arm.limits.replace(speed=np.inf)
    limits = limits.replace(joint_jerk=jerk * np.array(limits.joint_acceleration))
    durations = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        if arm.dof == 2:
            path = ac.Path.spline(points[:, :2] + [0.25, 0.2], tolerance=tolerance)
        else:
            path = ac.Path.spline(points + [0.4, 0.1, 0.4], tolerance=tolerance)
            path = path.oriented(np.diag([1.0, -1.0, -1.0]))
        traced = ac.trace(path, arm, limits=limits)
        planned = ac.plan(traced, arm, limits)
        assert ac.explain(planned, arm, limits).jerk_stops == ()
        durations.append(planned.duration)
    assert max(durations) < 1.001 * min(durations)
    joints = ac.JointPath.spline(traced(np.linspace(0, traced.breaks[-1], 200)))
    assert durations[1] < 1.01 * ac.plan(joints, arm, limits).duration


def test_a_warning_counts_the_stops_that_jerk_limits_add(arm):
    path = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3)])
    arcs = ac.round_corners(path, tolerance=5e-3)
    limits = arm.limits.replace(speed=0.15, joint_jerk=36.0)
    for motion in (arcs, ac.Program.from_path(arcs), ac.trace(arcs, arm)):
        with pytest.warns(UserWarning, match="2 full stops, the first at s = "):
            ac.plan(motion, arm, limits)
    # Without a limit of jerk, or with continuous curvature, there are none.
    with warnings.catch_warnings(action="error"):
        ac.plan(arcs, arm, limits.replace(joint_jerk=np.inf))
        ac.plan(ac.round_corners(path, tolerance=5e-3, continuity="curvature"), arm, limits)
