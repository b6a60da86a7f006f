"""Joint paths along which dq_ds vanishes: closed forms, and limits at any time."""

import functools
from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac

LINE_1 = np.array(
    [-0.00038593, 0.00013093, 0.00064752, 0.00116383, 0.00167987]
    + [0.00219563, 0.00271112, 0.00322633, 0.00374127, 0.00425594]
)
LINE_26 = np.array(
    [-3.85929168e-04, -2.13610365e-04, -4.13223272e-05, 1.30934967e-04, 3.03161539e-04]
    + [4.75357412e-04, 6.47522605e-04, 8.19657141e-04, 9.91761041e-04, 1.16383433e-03]
)


def second_joint(*values):
    return np.array([[0.0, x, 0.0] for x in values])


# toppra's own robustness suite (hungpham2511/toppra, problem_suite_1.yaml): waypoints, at even
# parameters from 0 to 1, and limits of velocity and acceleration.
SUITE = {
    "small_joint_1": (np.tile(LINE_1[:, None], 3), [100.0] * 3, [100.0] * 3),
    "small_joint_2": (second_joint(0, 1e-5, 0), [100, 1e4, 100], [100, 1e4, 100]),
    "small_joint_3": (second_joint(0, 1e-7, 0), [100, 1e3, 100], [100, 1e3, 100]),
    "issue26": (np.tile(LINE_26[:, None], 3), [1e3] * 3, [1e3, 2e3, 1e4]),
    "two_points_1": (second_joint(0, 1), [100.0] * 3, [100.0] * 3),
    "two_points_2": (second_joint(0, 1e-4), [100.0] * 3, [100.0] * 3),
}


def from_rest_to_rest(way, velocity, acceleration):
    """Shortest time of joints that move together along one line [s]: a ramp up and a ramp down."""
    way = np.abs(way)
    scale = way > 0
    a, v = (np.min(np.array(x)[scale] / way[scale]) for x in (acceleration, velocity))
    assert v * v >= a  # the speed limit is not reached
    return 2 / np.sqrt(a)


@pytest.mark.parametrize("name", SUITE)
def test_the_robustness_suite_of_toppra_is_planned(name, worst_ratios):
    points, velocity, acceleration = SUITE[name]
    path = ac.JointPath.spline(points, np.linspace(0, 1, len(points)), ends="clamped")
    limits = ac.Limits.only(joint_velocity=velocity, joint_acceleration=acceleration)
    planned = ac.plan(path, limits=limits)
    # These are straight lines of the joints: there and back again in the second and third.
    turns = points[[0, 1, 2]] if name in ("small_joint_2", "small_joint_3") else points[[0, -1]]
    best = sum(from_rest_to_rest(x, velocity, acceleration) for x in np.diff(turns, axis=0))
    assert 1 - 1e-12 <= planned.duration / best < 1 + 1e-4
    np.testing.assert_allclose(planned([0, planned.duration]), points[[0, -1]], atol=1e-15)
    np.testing.assert_allclose(planned([0, planned.duration], 1), 0, atol=1e-12)
    ratios = worst_ratios(planned, limits)
    assert 1 - 1e-6 < ratios["joint_acceleration"] <= 1 + 1e-9
    assert ratios["joint_velocity"] <= 1


WAY = np.array([0.3, -1.1, 0.7])


def cubic_at_a_break(way_before, way_after):
    """A path that ends its first piece, and begins the second, like the cube of its parameter."""
    coefficients = np.zeros((2, 6, 3))
    coefficients[0, :4] = np.array([-1.0, 3.0, -3.0, 1.0])[:, None] * way_before
    coefficients[1, 3] = way_after
    return ac.JointPath(breaks=[-1.0, 0.0, 1.0], coefficients=coefficients)


def test_a_line_that_rests_at_a_point_in_its_parameter_is_planned_as_a_line():
    limits = ac.Limits.only(joint_acceleration=2.0, joint_velocity=50.0)
    planned = ac.plan(cubic_at_a_break(WAY, WAY), limits=limits)
    best = from_rest_to_rest(2 * WAY, [50.0] * 3, [2.0] * 3)
    assert 1 - 1e-12 <= planned.duration / best < 1 + 1e-4


def test_a_bent_joint_path_that_rests_at_a_point_is_refused(refuses):
    path = cubic_at_a_break(WAY, WAY)
    coefficients = np.array(path.coefficients)
    coefficients[0, 5] = [0.1, 0.0, 0.0]
    coefficients[1] += [[-0.0] * 3, *[[0.0] * 3] * 3, [0.0, 0.1, 0.0], [0.0] * 3]
    coefficients[1, 0, 0] = 0.1
    bent = ac.JointPath(breaks=path.breaks, coefficients=coefficients)
    limits = ac.Limits.only(joint_acceleration=2.0, joint_velocity=50.0)
    refuses(lambda: ac.plan(bent, limits=limits), ac.NotRealizable, "At s = ", "too uneven")


def test_joint_paths_with_a_part_without_motion_are_refused(refuses):
    limits = ac.Limits.only(joint_acceleration=2.0)
    still = np.zeros((3, 6, 1))
    still[0, 1] = 1.0
    still[1:, 0] = 1.0
    still[2, 1] = 1.0
    path = ac.JointPath(breaks=[0.0, 1.0, 2.0, 3.0], coefficients=still)
    still[:, 1] = 0.0
    still[:, 0] = 1.0
    nothing = ac.JointPath(breaks=[0.0, 1.0, 2.0, 3.0], coefficients=still)
    bent, flat = (
        make_path([(0.0, 0.0), (1.0, 2.0)]) for make_path in (ac.JointPath.spline, ac.Path.polyline)
    )
    for motion, motion_limits, words in (
        (path, limits, "No joint moves from s = 1 to"),
        (nothing, limits, "No joint moves"),
        # Without an arm.
        (bent, limits.replace(joint_torque=1.0), "masses of an arm"),
        (bent, None, "needs an Arm"),
        (flat, ac.Limits.only(speed=1.0), "needs an Arm"),
    ):
        call = functools.partial(ac.plan, motion, limits=motion_limits)
        refuses(call, ac.InvalidInput, words)


def hermite(breaks, q, dq_ds, d2q_ds2):
    values = [np.reshape(x, (len(breaks), -1)) for x in (q, dq_ds, d2q_ds2)]
    begin, end = (tuple(x[part] for x in values) for part in (slice(-1), slice(1, None)))
    return ac.JointPath.hermite(np.array(breaks), begin, end)


def test_a_reversal_at_a_break_is_planned_with_a_jerk_limit(recwarn, worst_ratios):
    s = np.linspace(0, 1, 8)
    v = s[3]
    jerk = 50.0
    path = hermite(s, -0.4 * (s - v) ** 2, -0.8 * (s - v), np.full(8, -0.8))
    limits = ac.Limits(joint_velocity=1.0, joint_acceleration=5.0, joint_jerk=jerk)
    planned = ac.plan(path, limits=limits)
    # There and back, each from rest to rest: with four times the jerk, and with a constant phase.
    # The joint turns back at full acceleration, so the plan is faster.
    short = 0.4 * v**2
    long = 0.4 * (1 - v) ** 2
    stopped = 4 * (short / 2 / jerk) ** (1 / 3) + 0.1 + np.sqrt(0.01 + 4 * long / 5.0)
    assert planned.duration < 0.9 * stopped
    assert max(worst_ratios(planned, limits).values()) <= 1 + 1e-9
    times = np.linspace(0, planned.duration, 10_001)
    assert np.abs(planned(times, 3)).max() <= jerk * (1 + 1e-9)
    assert (
        not recwarn.list
        and ac.explain(planned, SimpleNamespace(dof=1, limits=limits)).jerk_stops == ()
    )
