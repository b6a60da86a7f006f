"""The conventional method, angular limits, given durations, and use of limits."""

import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.robot.limit_use import STILL_JOINT, States
from armcontour.robot.serial import SerialArm


def test_conventional_speed_is_constant_and_velocity_jumps_at_corners(arm, objective, conventional):
    assert conventional.duration == pytest.approx(objective.length / 0.04, rel=1e-12)
    t = np.linspace(0, conventional.duration, 4001)
    tool = arm.tool_position(conventional(t))
    np.testing.assert_allclose(tool, objective((0.04 * t).clip(0, objective.length)), atol=1e-8)
    velocity = arm.tool_velocity(conventional(t), conventional(t, 1))
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), 0.04, rtol=1e-6)
    corner_times = objective.stops[0] / 0.04
    for side in ("left", "right"):
        velocity = arm.tool_velocity(
            conventional(corner_times), conventional(corner_times, 1, side=side)
        )
        expected = 0.04 * objective(objective.stops[0], 1, side=side)
        np.testing.assert_allclose(velocity, expected, atol=1e-9)
    assert (np.abs(conventional([0.0, conventional.duration], 1)).max(axis=1) > 0.05).all()


def test_joint_limits_are_ignored_and_the_demand_is_reported(arm, objective, limits, conventional):
    tight = limits.replace(joint_acceleration=1e-6, joint_velocity=1e-6, speed=0.04)
    planned = ac.plan(objective, arm, tight, ac.Conventional())
    assert planned.duration == pytest.approx(9.0655, abs=1e-3)
    assert (planned.stretches[0].demand > 1e-6).all()
    (stretch,) = conventional.stretches
    assert (stretch.kind, stretch.t) == ("uniform", (0.0, conventional.duration))
    assert stretch.speed == pytest.approx(0.04, rel=1e-6)
    # Close past the base the joints' demand peaks over a few millimetres of a long line.
    path = ac.Path.polyline([(-0.2, 0.04), (0.45, 0.04)])
    peak = ac.plan(path, arm, limits.replace(speed=0.1), ac.Conventional())
    for planned in (conventional, peak):
        fine = np.abs(planned(np.linspace(0, planned.duration, 100_001), 2)).max(axis=0)
        np.testing.assert_allclose(planned.stretches[0].demand, fine, rtol=1e-3)


def test_conventional_timing_uses_the_speed_of_each_segment(arm, limits):
    path = ac.Path(
        segments=[
            ac.Line(start=(0.3, 0.2), end=(0.36, 0.2), segment_limits=ac.SegmentLimits(speed=0.02)),
            ac.Line(start=(0.36, 0.2), end=(0.36, 0.28)),
            ac.Line(
                start=(0.36, 0.28), end=(0.30, 0.28), segment_limits=ac.SegmentLimits(speed=9.0)
            ),
        ]
    )
    planned = ac.plan(path, arm, limits.replace(speed=0.04), ac.Conventional())
    assert planned.duration == pytest.approx(0.06 / 0.02 + 0.08 / 0.04 + 0.06 / 0.04)
    speed = [np.linalg.norm(arm.tool_velocity(planned(t), planned(t, 1))) for t in (1.0, 4.0, 6.0)]
    np.testing.assert_allclose(speed, [0.02, 0.04, 0.04], rtol=1e-6)


# Directions in which tools point.
DOWN = (0.0, 0.0, -1.0)
ASLANT = (0.4, 0.3, -1.0)


@pytest.fixture(scope="module")
def robot():
    return ac.load_arm("ur5e")


@pytest.fixture(scope="module")
def way(robot):
    points = [(0.4, -0.2, 0.4), (0.5, 0.2, 0.35), (0.45, 0.3, 0.5), (0.3, 0.3, 0.6)]
    held = ac.Path.polyline(points).pointing([DOWN, ASLANT, (0.3, 0.4, -1.0), (0.0, 0.6, -1.0)])
    return ac.trace(ac.round_corners(held, tolerance=0.01), robot)


def test_angular_limits_are_satisfied_between_the_points(way, robot):
    limits = robot.limits.replace(
        speed=0.5, angular_speed=0.6, angular_acceleration=2.0, joint_acceleration=None
    )
    for intervals in (200, 4000):
        planned = ac.plan(way, robot, limits, ac.Optimal(intervals=intervals))
        check = ac.check(planned, robot, limits, points=30)
        assert not check.violated, check.worst
        assert check["angular_speed"].ratio == pytest.approx(1, abs=1e-4)
        assert 0.998 < check["angular_acceleration"].ratio <= 1 + 1e-9
        names = {x.name for x in ac.explain(planned, robot, limits).bindings}
        assert {"angular speed", "angular acceleration"} <= names


def test_a_uniform_turn_takes_the_time_of_its_closed_form(robot):
    """Rest to rest by 2 sqrt(angle / limit); the polygon costs 0.06 % of it at most."""
    angle = 0.6
    down = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    turned = Rotation.from_rotvec([0.0, angle * 0.6, angle * 0.8]) * down
    line = ac.Path.polyline([(0.4, -0.1, 0.4), (0.4, 0.1, 0.4)]).oriented(
        Rotation.concatenate([down, turned])
    )
    limits = ac.Limits.only(angular_acceleration=1.5)
    planned = ac.plan(line, robot, limits)
    bare = 2 * np.sqrt(angle / 1.5)
    assert bare * (1 - 1e-9) < planned.duration < bare * (1 + 7e-4)


def test_a_tool_that_keeps_its_direction_is_not_limited(robot):
    line = ac.Path.polyline([(0.4, -0.1, 0.4), (0.4, 0.1, 0.4)]).pointing(DOWN)
    slow = robot.limits.replace(angular_speed=0.01, angular_acceleration=0.01)
    # Turning about the tool axis is free, so the tool may turn all the same: hold it.
    held = line.oriented(np.diag([1.0, -1.0, -1.0]))
    free = ac.plan(held, robot, robot.limits)
    assert ac.plan(held, robot, slow).duration == pytest.approx(free.duration, rel=1e-6)


def test_angular_limits_require_an_orientation(arm, rounded, limits, robot, refuses):
    joints = ac.JointPath.spline([np.zeros(6), np.ones(6)])
    for path, moving_arm, bare in ((rounded, arm, limits), (joints, robot, robot.limits)):
        for name in ("angular_speed", "angular_acceleration"):
            own_limits = bare.replace(**{name: 1.0})
            call = functools.partial(ac.plan, path, moving_arm, own_limits)
            refuses(call, ac.InvalidInput)


SPLINE = ac.JointPath.spline(np.random.default_rng(11).uniform(-2, 2, (5, 6)))


def test_a_path_takes_the_specified_duration_within_its_limits(
    rounded, arm, limits, worst_ratios, refuses
):
    fastest = ac.plan(rounded, arm, limits).duration
    for slower in (1.0, 1.37, 40.0):
        planned = ac.plan(rounded, arm, limits, ac.Optimal(duration=slower * fastest))
        assert planned.duration == pytest.approx(slower * fastest, rel=1e-12)
        assert all(x <= 1 + 1e-9 for x in worst_ratios(planned, limits, arm).values()), slower
        projection = rounded.project(
            arm.tool_position(planned(np.linspace(0, planned.duration, 2001)))
        )
        assert projection.distance.max() < 1e-7
        np.testing.assert_allclose(projection.s[[0, -1]], [0, rounded.length], atol=1e-7)
    # Velocities and accelerations agree with differences of the positions.
    planned = ac.plan(rounded, arm, limits, ac.Optimal(duration=9.0))
    step = 1e-6
    middle = (planned.breaks[:-1] + planned.breaks[1:]) / 2
    for order in (0, 1):
        rise = (planned(middle + step, order) - planned(middle - step, order)) / (2 * step)
        np.testing.assert_allclose(planned(middle, order + 1), rise, atol=1e-5)
    # Too short a duration names the fastest.
    refuses(
        lambda: ac.plan(rounded, arm, limits, ac.Optimal(duration=0.99 * fastest)),
        ac.NotRealizable,
        f"takes {fastest:.9g} s",
        limit="duration",
        needed=fastest,
        allowed=0.99 * fastest,
    )
    named = ac.plan(rounded, arm, limits, ac.Optimal(duration=float(f"{fastest:.9g}")))
    assert named.duration == pytest.approx(fastest, rel=2e-9)


def test_invalid_durations_are_refused(refuses):
    for options in (*({"duration": x} for x in (0.0, np.nan, 2e6)), {"start_speed": 0.01}):
        case = {"duration": 9.0} | options
        refuses(lambda x=case: ac.Optimal(**x), ac.InvalidInput)
    refuses(lambda: ac.Paper(duration=9.0), ac.InvalidInput, "duration")


def test_a_joint_path_with_a_point_at_rest_takes_the_specified_duration(worst_ratios):
    path = ac.JointPath.spline([(0.0, 0.0), (0.6, 1.1), (0.0, 0.0)], ends="clamped")
    limits = ac.Limits.only(joint_acceleration=[5.0, 8.0])
    planned = ac.plan(path, limits=limits, options=ac.Optimal(duration=3.0))
    assert planned.duration == pytest.approx(3.0, rel=1e-12)
    assert max(worst_ratios(planned, limits).values()) <= 1 + 1e-9


def test_all_contours_of_a_program_share_one_factor(arm, limits):
    lines = [ac.Path.polyline([(0.3, y), (0.36, y)]) for y in (0.1, 0.15)]
    program = ac.Program(
        moves=(ac.Contour(path=lines[0]), ac.Dwell(duration=0.25), ac.Contour(path=lines[1]))
    )
    fastest = ac.plan(program, arm, limits)
    planned = ac.plan(program, arm, limits, ac.Optimal(duration=2 * fastest.duration))
    assert planned.duration == pytest.approx(2 * fastest.duration, rel=1e-12)
    for fast, slow in zip(fastest.spans, planned.spans, strict=True):
        ratio = (slow.t[1] - slow.t[0]) / (fast.t[1] - fast.t[0])
        moved = sum(x.t[1] - x.t[0] for x in fastest.contour_spans)
        shared = 1 + fastest.duration / moved
        assert ratio == pytest.approx(shared if fast.kind == "contour" else 1.0, rel=1e-12)
    assert [x.kind for x in planned.spans] == ["contour", "dwell", "rapid", "contour"]
    assert not ac.check(planned, arm, limits, path=program).violated


def test_stretched_durations_respect_gravity_and_friction():
    """Viscous friction helps to brake; a slower motion is within the limits, too."""
    ur5e = ac.load_arm("ur5e")
    viscous = np.array([15.0, 15.0, 10.0, 3.0, 3.0, 2.0])
    robot = SerialArm(name="UR5e", chain=ur5e.chain.replace(viscous=viscous), limits=ur5e.limits)
    limits = ac.Limits.only(joint_torque=ur5e.limits.joint_torque, joint_velocity=3.0)
    fastest = ac.plan(SPLINE, robot, limits, ac.Optimal(intervals=500)).duration
    for slower in (1.0003, 1.5, 6.0):
        planned = ac.plan(
            SPLINE, robot, limits, ac.Optimal(intervals=500, duration=slower * fastest)
        )
        assert planned.duration == pytest.approx(slower * fastest, rel=1e-12)
        assert not ac.check(planned, robot, limits, points=30).violated, slower
        np.testing.assert_allclose(planned(planned.duration), SPLINE(SPLINE.length), atol=1e-12)


REACH = 0.250 + 0.215  # m, the PMK-3s stretched out
# Velocity, acceleration and jerk of the joint that moves, in three states.
DQ = np.array([2.0, -1.5, 0.0])  # rad/s
DDQ = np.array([0.3, -4.0, 5.0])  # rad/s²
DDDQ = np.array([7.0, 0.0, -3.0])  # rad/s³


def about_joint(arm, joint):
    """Only one joint moves; of the arm in the plane the elbow is straight."""
    rates = np.zeros((3, 3, arm.dof))
    rates[:, :, joint] = DQ, DDQ, DDDQ
    return States(arm, (np.zeros((3, arm.dof)), *rates))


def test_measured_tool_values_on_a_circle_have_the_closed_form(arm):
    for name, expected in (
        ("speed", REACH * np.abs(DQ)),
        # At rest there is no direction for a part of the acceleration to be at right angles to.
        ("centripetal_acceleration", REACH * DQ**2),
        ("tool_acceleration", REACH * np.hypot(DDQ, DQ**2)),
    ):
        bound = about_joint(arm, 0).measure(name)[0]
        np.testing.assert_allclose(bound, expected, rtol=1e-12, err_msg=name)
    states = about_joint(ac.load_arm("ur5e"), 5)
    for name, expected in (("angular_speed", DQ), ("angular_acceleration", DDQ)):
        np.testing.assert_allclose(states.measure(name)[0], np.abs(expected), rtol=1e-12)


def test_missing_columns_and_unknown_limits_are_refused(arm, refuses):
    states = about_joint(arm, 1)
    ratios = states.use("joint_jerk", ac.Limits.only(joint_jerk=[np.inf, 10.0])).ratio
    np.testing.assert_allclose(ratios, [[0, 0.7], [0, 0], [0, 0.3]], rtol=1e-12)
    without = States(arm, states.columns[:3])
    refuses(lambda: without.measure("joint_jerk"), ac.InvalidInput, "states with dddq")
    for name in ("sped", "joint_range"):
        refuses(lambda x=name: states.measure(x), ac.InvalidInput, repr(name))
    refuses(lambda: states.measure("angular_speed"), ac.InvalidInput, "a point without")


def test_each_direction_uses_its_own_acceleration_limit(arm):
    limits = ac.Limits.only(joint_acceleration=[[-2.0, 5.0]]).for_joints(2)
    states = about_joint(arm, 1)
    use = states.use("joint_acceleration", limits)
    np.testing.assert_allclose(use.ratio, [[0, 0.06], [0, 2.0], [0, 1.0]], rtol=1e-12)
    np.testing.assert_array_equal(use.limit[1], [5.0, 2.0])
    states = about_joint(arm, 0)
    for name in ("joint_velocity", "joint_acceleration", "speed"):
        assert not states.use(name, ac.Limits.only()).ratio.any()


def test_dry_friction_at_rest_has_the_most_favourable_value(arm):
    rough = arm.with_dynamics(coulomb=[3.0, 0.5])
    still = np.zeros((1, 2))
    slow = np.full((1, 2), 1.01 * STILL_JOINT)
    q = np.zeros((1, 2))
    ddq = np.array([[10.0, -10.0]])
    without = np.abs(arm.torque(q, still, ddq))
    helped = np.maximum(without - [3.0, 0.5], 0.0)
    for dq in (still, STILL_JOINT * np.ones((1, 2)), -STILL_JOINT * np.ones((1, 2))):
        bound = States(rough, (q, dq, ddq)).measure("joint_torque")[0]
        np.testing.assert_allclose(bound, helped, atol=1e-6)
    bound = States(rough, (q, slow, ddq)).measure("joint_torque")[0]
    np.testing.assert_allclose(bound, np.abs(rough.torque(q, slow, ddq)), rtol=1e-12)
