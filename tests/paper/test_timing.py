"""The paper's method in the plane and in space, and its refusals."""

import numpy as np
import pytest
from scipy.optimize import brentq

import armcontour as ac

LINK = 0.25  # m, length of both links
LIMIT = 0.72  # rad/s², of both joints
# Distances of the ends of the path from the first joint [m].
NEAR = 0.2
FAR = 0.4


@pytest.fixture(scope="module")
def scissors():
    """Equal links: on a line through the base joint 2 turns twice as fast as joint 1, always."""
    limits = ac.Limits.only(joint_acceleration=LIMIT)
    return ac.PlanarTwoLink(name="scissors", base=0.0, links=(LINK, LINK), limits=limits)


def elbow(distance):
    return 2 * np.arccos(distance / (2 * LINK))


def tool_speed(planned, arm, t):
    return np.linalg.norm(arm.tool_velocity(planned(t), planned(t, 1)), axis=-1)


def assert_accelerations_kept(planned, limit=LIMIT):
    t = np.linspace(0, planned.duration, 20001)
    assert (np.abs(planned(t, 2)) <= limit * (1 + 1e-6)).all()


def kinds(planned):
    return [x.kind for x in planned.stretches]


@pytest.mark.parametrize("outward", [True, False])
def test_a_short_line_has_the_triangle_in_closed_form(scissors, outward):
    ends = [(0, NEAR), (0, FAR)]
    path = ac.Path.polyline(ends if outward else ends[::-1])
    planned = ac.plan(path, scissors, scissors.limits.replace(speed=9.0), ac.Paper(knots=600))
    way = elbow(NEAR) - elbow(FAR)
    assert planned.duration == pytest.approx(2 * np.sqrt(way / LIMIT), rel=1e-5)
    assert kinds(planned) == ["MAC", "MDC"]
    # Full acceleration of joint 2 throughout, but for the one lap in which the passes meet.
    t = np.linspace(0, planned.duration, 10001)
    assert np.isclose(np.abs(planned(t, 2)[:, 1]), LIMIT, rtol=1e-6).mean() > 0.99
    assert planned.stretches[0].t[1] == pytest.approx(planned.duration / 2, rel=1e-3)


@pytest.mark.parametrize("speed", [0.03, 0.06, 0.1])
def test_a_long_line_has_the_trapezoid_in_closed_form(scissors, speed):
    path = ac.Path.polyline([(0, NEAR), (0, FAR)])
    knots = 2000
    limits = scissors.limits.replace(speed=speed)
    planned = ac.plan(path, scissors, limits, ac.Paper(knots=knots))

    def too_fast(t, start, sign):
        q2 = elbow(start) - sign * LIMIT * t**2 / 2
        return LINK * np.sin(q2 / 2) * LIMIT * t - speed

    up = brentq(too_fast, 0, 1, (NEAR, 1))
    down = brentq(too_fast, 0, 1, (FAR, -1))
    reached = 2 * LINK * np.cos((elbow(NEAR) - LIMIT * up**2 / 2) / 2)
    remaining_way = 2 * LINK * np.cos((elbow(FAR) + LIMIT * down**2 / 2) / 2)
    middle = (remaining_way - reached) / speed
    expected = up + middle + down
    # The middle path starts at the last knot before the assigned velocity: at most one lap below.
    below = np.sqrt(speed**2 - 2 * LINK * LIMIT * (FAR - NEAR) / knots)
    assert expected * (1 - 1e-5) < planned.duration < expected + middle * (speed / below - 1)
    assert kinds(planned) == ["MAC", "AVC", "MDC"]
    times = np.diff(planned.switching_points)
    near = speed / below - 1 + 1e-3
    np.testing.assert_allclose(times, [up, middle, down], rtol=near)
    assert below <= tool_speed(planned, scissors, planned.duration / 2) <= speed * (1 + 1e-6)


def test_the_papers_job_satisfies_every_limit_and_one_joint_is_at_its_limit(
    arm, rounded, limits, mac
):
    for knots in (8, 50, 600, None):
        planned = ac.plan(rounded, arm, limits, ac.Paper(knots=knots))
        t = np.linspace(0, planned.duration, 20001)
        assert tool_speed(planned, arm, t).max() <= limits.speed * (1 + 1e-6), knots
        assert_accelerations_kept(planned, limits.joint_acceleration)
        ends = np.array([0.0, planned.duration])
        assert tool_speed(planned, arm, ends).max() < 1e-9
        np.testing.assert_allclose(
            arm.tool_position(planned(ends)), rounded.vertices[[0, -1]], atol=1e-9
        )
    # Sec. IV-C of the paper claims it; a meeting lap is the only exception.
    for stretch in mac.stretches:
        t = np.linspace(*stretch.t, 402)[1:-1]
        top = (np.abs(mac(t, 2)) / limits.joint_acceleration).max(axis=1)
        if stretch.kind in ("MAC", "MDC"):
            assert (top > 1 - 1e-6).mean() > 0.97, stretch.name
        else:
            assert top.max() < 0.9, stretch.name


def test_the_paper_job_is_continuous_and_divided_at_its_switching_points(arm, rounded, mac):
    breaks = mac.breaks[1:-1]
    np.testing.assert_allclose(mac(breaks, side="left"), mac(breaks), atol=1e-12)
    jumps = np.abs(mac(breaks, 1) - mac(breaks, 1, side="left")).max(axis=1)
    # The laps hand over velocities along the path; the rest is of third order in their time.
    assert jumps.max() < 2e-3 and np.median(jumps) < 1e-5
    projection = rounded.project(arm.tool_position(mac(np.linspace(0, mac.duration, 20001))))
    assert projection.distance.max() < 1e-6 and np.diff(projection.s).min() > -1e-9
    s, t = (np.array([getattr(x, name) for x in mac.stretches]) for name in ("s", "t"))
    assert t[0, 0] == 0 and s[0, 0] == 0
    np.testing.assert_allclose([t[-1, 1], s[-1, 1]], [mac.duration, rounded.length], rtol=1e-12)
    np.testing.assert_array_equal(t[:-1, 1], t[1:, 0])
    np.testing.assert_allclose(s[:-1, 1], s[1:, 0], atol=1e-12)
    expected = "line 1 MAC, line 1 MDC, corner 1 corner, line 2 MAC, line 2 AVC, line 2 MDC, "
    expected += "corner 2 corner, line 3 MAC, line 3 MDC"
    assert ", ".join(f"{x.name} {x.kind}" for x in mac.stretches) == expected
    assert len(mac.switching_points) == 10  # P0 to P9


def test_corners_are_passed_at_their_own_speed(arm, rounded, limits, mac):
    corners = [x for x in mac.stretches if x.kind == "corner"]
    for number, stretch in enumerate(corners):
        t = np.linspace(*stretch.t, 102)[1:-1]
        speed = rounded.corners.speed[number]
        ends = (rounded.corners.start, rounded.corners.end)
        np.testing.assert_allclose(tool_speed(mac, arm, t), speed, rtol=1e-6)
        np.testing.assert_allclose(stretch.s, [x[number] for x in ends], atol=1e-12)
    # A wide one is not run faster than assigned. docs/method.md: (16) also needs v_t <= v_a.
    path = ac.round_corners(ac.Path.polyline([(0.2, 0.3), (0.3, 0.3), (0.36, 0.2)]), tolerance=5e-3)
    slow = limits.replace(speed=0.02, centripetal_acceleration=np.inf)
    (corner,) = (x for x in ac.plan(path, arm, slow, ac.Paper()).stretches if x.kind == "corner")
    assert corner.speed == pytest.approx(0.02, rel=1e-6)


def test_a_sharp_corner_is_a_stop_and_a_straight_vertex_is_passed_at_speed(arm, objective, limits):
    planned = ac.plan(objective, arm, limits, ac.Paper(knots=200))
    stop_times = [x.t[1] for x in planned.stretches if x.s[1] in objective.stops]
    assert len(stop_times) == 2
    np.testing.assert_allclose(tool_speed(planned, arm, np.array(stop_times)), 0, atol=1e-9)
    # docs/method.md, where the method falls short, 4: 5.23 s, less than with rounded corners.
    assert planned.duration == pytest.approx(5.23, abs=0.01)
    places = [(0.30, 0.2), (0.34, 0.2), (0.38, 0.2)]
    paths = ac.Path.polyline(places[::2]), ac.Path.polyline(places)
    one, two = (ac.plan(x, arm, limits, ac.Paper(knots=800)) for x in paths)
    assert two.duration == pytest.approx(one.duration, rel=1e-3)
    passing = next(x.t[1] for x in two.stretches if x.s[1] == pytest.approx(0.04))
    assert tool_speed(two, arm, passing) > 0.05


def test_a_short_line_reduces_the_speed_of_its_corner(arm, limits):
    # A right angle with a corner error of 5 mm takes 12.07 mm of each line.
    ell = [(0.36 - 0.0123, 0.2), (0.36, 0.2), (0.36, 0.26)]
    steps = [(0.30, 0.2), (0.36, 0.2), (0.36, 0.2135), (0.30, 0.2135)]
    for points, tolerance, lowered in (
        (ell, 5e-3, 0),
        (ell[::-1], 5e-3, 0),
        (steps, [5e-4, 5e-3], 1),
        (steps[::-1], [5e-3, 5e-4], 0),
    ):
        path = ac.round_corners(ac.Path.polyline(points), tolerance=tolerance)
        assert not path.corners.shrunk.any()
        planned = ac.plan(path, arm, limits, ac.Paper(knots=100))
        nominal = np.sqrt(0.09 * path.corners.radius)
        corner_speeds = np.array([x.speed for x in planned.stretches if x.kind == "corner"])
        assert corner_speeds[lowered] < 0.6 * nominal[lowered], points
        others = (np.delete(x, lowered) for x in (corner_speeds, nominal))
        np.testing.assert_allclose(*others, rtol=1e-5)
        assert_accelerations_kept(planned, limits.joint_acceleration)
        # The acceleration along the line only suffices to change from one speed to the other.
        breaks = planned.breaks[1:-1]
        assert np.abs(planned(breaks, 1) - planned(breaks, 1, side="left")).max() < 2e-3, points


def test_passes_that_meet_between_two_knots_satisfy_the_limit(arm, limits):
    # The end is moved by less than a lap, so that the passes meet anywhere between two knots.
    for seed in range(30):
        path = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15 + 1e-4 * seed)])
        planned = ac.plan(path, arm, limits, ac.Paper(knots=20))
        assert kinds(planned) == ["MAC", "MDC"], seed
        assert_accelerations_kept(planned, limits.joint_acceleration)


def test_the_paper_method_reaches_the_speed_of_each_segment(arm, objective, limits):
    points = objective.vertices
    lines = [
        ac.Line(start=points[i], end=points[i + 1], segment_limits=ac.SegmentLimits(speed=x))
        for i, x in enumerate((0.03, 0.06, None))
    ]
    rounded = ac.round_corners(ac.Path(segments=lines), tolerance=5e-3)
    top = {}
    for x in ac.plan(rounded, arm, limits, ac.Paper(knots=600)).stretches:
        top[x.name] = max(top.get(x.name, 0.0), x.speed)
    for name, assigned, near in (
        ("line 1", 0.03, 2e-3),
        ("line 2", 0.06, 1e-2),
        ("corner 1", 0.03, 1),
    ):
        assert assigned * (1 - near) <= top[name] <= assigned * (1 + 1e-6)
    assert 0.06 < top["line 3"] <= 0.15


def test_a_joint_that_reverses_too_late_is_not_realizable(arm, limits):
    path = ac.Path.polyline([(-0.065, 0.300), (0.335, 0.300)])
    with pytest.raises(
        ac.NotRealizable, match="line 1 at 0.1329 m .* does not look ahead"
    ) as caught:
        ac.plan(path, arm, limits.replace(speed=0.3), ac.Paper())
    error = caught.value
    assert error.s == pytest.approx(0.133, abs=1e-3)
    assert error.joint == 1 and error.limit == "joint_acceleration"
    assert error.needed > error.allowed == 0.72
    np.testing.assert_allclose(error.point, path(error.s), atol=1e-7)
    # At half the speed it is.
    planned = ac.plan(path, arm, limits.replace(speed=0.15), ac.Paper())
    assert_accelerations_kept(planned, limits.joint_acceleration)
    t = np.linspace(0, planned.duration, 20001)
    assert np.ptp(np.sign(planned(t, 1)[:, 1])) == 2  # joint 2 does turn round


def test_corners_above_a_joint_limit_and_arcs_at_the_ends_are_not_realizable(arm, limits, rounded):
    arc = ac.Arc(start=(0.4, 0.2), center=(0.4, 0.25), angle=np.pi / 2)
    before = ac.Line(start=(0.35, 0.2), end=(0.4, 0.2))
    after = ac.Line(start=(0.45, 0.25), end=(0.45, 0.28))
    ring = ac.Arc(start=(0.4, 0.2), center=(0.3, 0.2), angle=2 * np.pi)
    for segments, s in (([arc, after], 0.0), ([before, arc], 0.05), ([ring], 0.0)):
        with pytest.raises(ac.NotRealizable) as caught:
            ac.plan(ac.Path(segments=segments), arm, limits, ac.Paper())
        assert caught.value.s == pytest.approx(s)
        np.testing.assert_allclose(caught.value.point, (0.4, 0.2), atol=1e-12)
    with pytest.raises(ac.NotRealizable, match="On corner") as caught:
        ac.plan(rounded, arm, limits.replace(centripetal_acceleration=0.3), ac.Paper())
    error = caught.value
    assert error.limit == "joint_acceleration" and error.needed > error.allowed == 0.72
    assert error.joint in (0, 1) and error.t > 0


def test_joint_velocities_are_checked(arm, rounded, limits, mac):
    peak = np.abs(mac(np.linspace(0, mac.duration, 20001), 1)).max(axis=0)

    def planned(share):
        changed_limits = limits.replace(joint_velocity=peak * share)
        return ac.plan(rounded, arm, changed_limits, ac.Paper(knots=600))

    assert planned(1.001).duration == mac.duration
    with pytest.raises(ac.NotRealizable) as caught:
        planned(0.99)
    assert caught.value.limit == "joint_velocity"
    assert caught.value.needed > caught.value.allowed


POINTS = np.array([[0.45, -0.15, 0.4], [0.5, 0.15, 0.4], [0.4, 0.2, 0.55]])


@pytest.fixture(scope="module")
def robot():
    return ac.load_arm("ur5e")


def path(points=POINTS):
    held = ac.Path.polyline(points).oriented(np.diag([1.0, -1.0, -1.0]))
    return ac.round_corners(held, tolerance=0.01)


@pytest.mark.parametrize("name", ["ur5e", "ur10e", "panda"])
def test_arms_with_six_and_seven_joints_are_planned(name):
    robot = ac.load_arm(name)
    limits = robot.limits.replace(speed=0.2, centripetal_acceleration=0.5, joint_jerk=np.inf)
    way = ac.trace(path(), robot)
    planned = ac.plan(way, robot, limits, ac.Paper())
    used = {x.name: x.ratio for x in ac.check(planned, robot, limits, points=5).uses}
    # Other joints' velocities step at knots, and the traced path has its play.
    assert used.pop("velocity_step") < 10
    assert max(used.values()) < 1 + 1e-4
    assert planned.duration >= ac.plan(way, robot, limits).duration * (1 - 1e-6)
