"""The optimal planner: the paper's job, closed forms, every limit between the points, refusals."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gamma

import armcontour as ac
from armcontour.timing import optimal
from armcontour.timing.constraints import JointDerivatives, SecondOrder
from armcontour.timing.grid import place_grid

LEAK = 1e-9  # by how much, relatively, a limit may be exceeded anywhere
LINE = ((-0.065, 0.300), (0.335, 0.300))  # docs/method.md, "where the method falls short", 1
ACCELERATION = 0.3  # m/s²


def robot(dof, **limits):
    """As much of an arm as a joint path needs."""
    return SimpleNamespace(dof=dof, limits=ac.Limits(**limits))


def assert_kept(ratios):
    assert ratios, "nothing was judged"
    broken = {name: ratio - 1 for name, ratio in ratios.items() if ratio > 1 + LEAK}
    assert not broken


@pytest.fixture(scope="module")
def planned(traced, arm, limits):
    return ac.plan(traced, arm, limits)


# --- the paper's job


def test_the_papers_job(planned, arm, limits, worst_ratios):
    # The true optimum is 5.32606 s; shorter means a leak.
    assert 5.3260 <= planned.duration <= 5.3263
    assert planned.method == "optimal"
    ratios = worst_ratios(planned, limits, arm)
    assert_kept(ratios)
    assert set(ratios) == {"joint_acceleration", "speed", "centripetal_acceleration"}
    assert min(ratios.values()) > 1 - 1e-5  # all three do bind somewhere


def test_the_papers_job_without_the_centripetal_bound(traced, arm, limits, worst_ratios):
    free = limits.replace(centripetal_acceleration=None)
    planned = ac.plan(traced, arm, free)
    # docs/method.md gives 4.825 s; printed to three digits.
    assert planned.duration == pytest.approx(4.825, abs=5e-4)
    assert_kept(worst_ratios(planned, free, arm))


def test_it_is_the_default_method(rounded, arm, limits, planned):
    assert ac.plan(rounded, arm, limits).duration == planned.duration


def test_it_is_no_slower_than_the_papers_method(planned, mac):
    # docs/method.md: MAC is optimal on this job, to 1e-5; with laps of finite size it is shorter as
    # much as it leaves a corner early.
    assert planned.duration == pytest.approx(mac.duration, rel=2e-4)


def test_the_tool_stays_on_the_path_and_goes_one_way(planned, rounded, arm):
    t = np.linspace(0, planned.duration, 20001)
    found = rounded.project(arm.forward(planned(t)))
    assert found.distance.max() < 1e-7
    assert np.diff(found.s).min() > -1e-9
    ends = planned([0.0, planned.duration])
    np.testing.assert_allclose(arm.forward(ends), rounded.vertices[[0, -1]], atol=1e-8)
    np.testing.assert_allclose(planned([0.0, planned.duration], 1), 0, atol=1e-9)


def test_positions_and_velocities_are_continuous(planned):
    at = planned.breaks[1:-1]
    for order, tolerance in ((0, 1e-12), (1, 1e-7)):
        np.testing.assert_allclose(
            planned(at, order, side="left"), planned(at, order), atol=tolerance
        )


def test_joint_velocities_too(traced, arm, limits, worst_ratios):
    slow = limits.replace(joint_velocity=(0.3, 0.25))
    planned = ac.plan(traced, arm, slow)
    ratios = worst_ratios(planned, slow, arm)
    assert_kept(ratios)
    assert ratios["joint_velocity"] > 1 - 1e-5


def test_tool_acceleration_on_the_papers_job(traced, arm, limits, worst_ratios):
    gentle = limits.replace(tool_acceleration=0.1)
    planned = ac.plan(traced, arm, gentle)
    ratios = worst_ratios(planned, gentle, arm)
    assert_kept(ratios)
    assert ratios["tool_acceleration"] > 1 - 1e-5


# --- where a joint turns round


def test_the_line_on_which_the_papers_method_breaks_its_limit(arm, worst_ratios):
    fast = arm.limits.replace(speed=0.3)
    path = ac.Path.polyline(LINE)
    with pytest.raises(ac.NotRealizable):
        ac.plan(path, arm, fast, method="mac")
    planned = ac.plan(path, arm, fast)
    assert_kept(worst_ratios(planned, fast, arm))
    t = np.linspace(0, planned.duration, 2001)
    assert np.ptp(np.sign(planned(t, 1)[:, 1])) == 2  # joint 2 does turn round


# With the reversal on a grid point, next to one, and between two.
@pytest.mark.parametrize("intervals", [2, 10, 17, 50, 113, 300, 398])
def test_coarse_grids_over_a_reversal(arm, intervals, worst_ratios):
    fast = arm.limits.replace(speed=0.3)
    path = ac.Path.polyline(LINE)
    planned = ac.plan(path, arm, fast, intervals=intervals)
    assert_kept(worst_ratios(planned, fast, arm))
    assert 1 <= planned.duration / ac.plan(path, arm, fast).duration < 1.02


# --- closed forms: joints


def straight(direction, limits, **options):
    """A straight way in joint space of the given extent, planned."""
    path = ac.JointPath.spline([np.zeros(len(direction)), np.asarray(direction, float)])
    return ac.plan(path, robot(len(direction)), ac.Limits(**limits), **options)


def trapezoid(length, up, down, top=np.inf, begin=0.0, end=0.0):
    """Time over a length with path accelerations `up` and `down` and a top speed."""
    peak = np.sqrt((2 * length * up * down + down * begin**2 + up * end**2) / (up + down))
    peak = min(peak, top)
    way = length - (peak**2 - begin**2) / (2 * up) - (peak**2 - end**2) / (2 * down)
    return (peak - begin) / up + (peak - end) / down + way / peak


def path_bounds(direction, acceleration, deceleration):
    """Largest path acceleration and deceleration of a straight way."""
    e = np.asarray(direction) / np.linalg.norm(direction)
    up = np.where(e > 0, acceleration, deceleration) / np.abs(e)
    down = np.where(e > 0, deceleration, acceleration) / np.abs(e)
    return up.min(), down.min()


WAYS = {
    "one joint": ([2.0], [1.5], [1.5]),
    "one joint, uneven": ([2.0], [1.5], [0.4]),
    "backwards": ([-2.0], [1.5], [0.4]),
    "two joints, opposite": ([1.0, -0.7], [1.5, 0.9], [0.4, 2.0]),
    "three joints": ([0.1, 3.0, -1.0], [0.2, 1.0, 2.0], [0.3, 2.0, 0.5]),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("top", [None, 0.5])
def test_a_straight_way_in_joint_space(way, top, worst_ratios):
    direction, acceleration, deceleration = WAYS[way]
    limits = {"joint_acceleration": acceleration, "joint_deceleration": deceleration}
    length = np.linalg.norm(direction)
    speed = np.inf
    if top is not None:
        limits["joint_velocity"] = [top] * len(direction)
        speed = (top * length / np.abs(direction)).min()
    planned = straight(direction, limits)
    up, down = path_bounds(direction, acceleration, deceleration)
    # The interval in which the profile turns loses less than its own share.
    assert planned.duration == pytest.approx(trapezoid(length, up, down, speed), rel=1e-6)
    assert_kept(worst_ratios(planned, ac.Limits(**limits)))


@pytest.mark.parametrize(
    ("begin", "end"), [(0.3, 0.0), (0.0, 0.7), (0.4, 0.9), (1.0, 1.0), (2.0, 0.0)]
)
def test_start_and_end_speeds(begin, end, worst_ratios):
    # 2 rad at 1.0 rad/s² up and down: from 2 rad/s the arm can just stop.
    limits = {"joint_acceleration": [1.0]}
    planned = straight([2.0], limits, start_speed=begin, end_speed=end)
    assert planned.duration == pytest.approx(trapezoid(2.0, 1.0, 1.0, np.inf, begin, end), rel=1e-6)
    found = planned([0.0, planned.duration], 1)[:, 0]
    np.testing.assert_allclose(found, [begin, end], atol=1e-9)
    assert_kept(worst_ratios(planned, ac.Limits(**limits)))


SPEEDS = {
    "start, too long to stop": ({"start_speed": 2.1}, "start speed", 0.0, 2.1, 2.0),
    "start, above a velocity limit": ({"start_speed": 5.5}, "start speed", 0.0, 5.5, 2.0),
    "end, cannot be reached": ({"end_speed": 2.1}, "end speed", 2.0, 2.1, 2.0),
    "end, above a velocity limit": ({"end_speed": 5.5}, "end speed", 2.0, 5.5, 2.0),
}


@pytest.mark.parametrize("case", SPEEDS)
def test_speeds_that_cannot_be_had_are_refused(case, refuses):
    options, limit, s, needed, allowed = SPEEDS[case]
    limits = {"joint_acceleration": [1.0], "joint_velocity": [5.0]}
    refuses(
        lambda: straight([2.0], limits, **options),
        ac.NotRealizable,
        f"The {limit} of {needed} m/s is too high",
        f"allow {allowed:g} m/s",
        s=s,
        limit=limit,
        needed=needed,
        allowed=allowed,
    )


# --- closed forms: tool


def test_tool_acceleration_on_a_line(arm, worst_ratios):
    path = ac.Path.polyline([(0.3, 0.2), (0.4, 0.25)])
    only = ac.Limits(tool_acceleration=ACCELERATION)
    planned = ac.plan(path, arm, only)
    # Tracing leaves the tool's derivatives a few millionths of play.
    assert planned.duration == pytest.approx(2 * np.sqrt(path.length / ACCELERATION), rel=1e-5)
    assert_kept(worst_ratios(planned, only, arm))


RADIUS = 0.05  # m


def circle():
    center = (0.35, 0.2)
    start = (center[0] + RADIUS, center[1])
    return ac.Path.from_segments([ac.Arc(start=start, center=center, angle=2 * np.pi)])


# (ds²/R)² + dds² = a² makes ds² = a R sin(2 s / R), up to sqrt(a R) an eighth of a turn on; the
# quarter of the lemniscate's length is the time of that, in units of sqrt(R / a).
LEMNISCATE = gamma(0.25) ** 2 / (2 * np.sqrt(2 * np.pi))


@pytest.mark.parametrize(("intervals", "within"), [(100, 2e-3), (500, 1e-4), (None, 1e-5)])
def test_tool_acceleration_on_a_circle(arm, intervals, within, worst_ratios):
    only = ac.Limits(tool_acceleration=ACCELERATION)
    planned = ac.plan(circle(), arm, only, intervals=intervals)
    expected = (LEMNISCATE + 1.5 * np.pi) * np.sqrt(RADIUS / ACCELERATION)
    assert 1 - 1e-9 <= planned.duration / expected < 1 + within
    ratios = worst_ratios(planned, only, arm)
    assert_kept(ratios)
    assert ratios["tool_acceleration"] > 1 - 1e-6


def test_tool_acceleration_on_a_circle_at_an_assigned_velocity(arm, worst_ratios):
    speed = 0.1
    both = ac.Limits(tool_acceleration=ACCELERATION, speed=speed)
    planned = ac.plan(circle(), arm, both)
    turned = RADIUS / 2 * np.arcsin(speed**2 / (ACCELERATION * RADIUS))
    # With v = speed sin(p)^(1/2) ... the root at rest is taken out by s = r², ds = 2 r dr.
    ramp, _ = quad(
        lambda r: 2 * r / np.sqrt(ACCELERATION * RADIUS * np.sin(2 * r * r / RADIUS)),
        0,
        np.sqrt(turned),
    )
    expected = 2 * ramp + (2 * np.pi * RADIUS - 2 * turned) / speed
    assert planned.duration == pytest.approx(expected, rel=1e-5)
    assert_kept(worst_ratios(planned, both, arm))


def test_a_circle_at_its_centripetal_limit(arm, worst_ratios):
    both = ac.Limits(centripetal_acceleration=0.2, joint_acceleration=100.0)
    planned = ac.plan(circle(), arm, both)
    top = np.sqrt(0.2 * RADIUS)
    middle = planned(planned.duration / 2), planned(planned.duration / 2, 1)
    assert np.linalg.norm(arm.tool_velocity(*middle)) == pytest.approx(top, rel=1e-5)
    assert_kept(worst_ratios(planned, both, arm))


def test_rounded_corners_under_tool_acceleration(rounded, arm, worst_ratios):
    only = ac.Limits(tool_acceleration=ACCELERATION, speed=0.15)
    planned = ac.plan(rounded, arm, only)
    ratios = worst_ratios(planned, only, arm)
    assert_kept(ratios)
    corners = [np.sqrt(ACCELERATION * r) for r in rounded.corners.radius]
    place = (rounded.corners.start + rounded.corners.end) / 2
    found = planned.speed_at(place)
    # Never faster than the arc allows, and nearly so fast in the middle of it.
    assert (found <= np.array(corners) * (1 + LEAK)).all()
    np.testing.assert_allclose(found, corners, rtol=1e-3)


# --- stops and speeds of segments


def speed_at(planned, arm, s):
    """Tool speed on both sides of a place."""
    law = planned.laws[0]
    k = int(np.searchsorted(law.s, s - 1e-12))
    t = law.breaks[k]
    assert law.s[k] == pytest.approx(s, abs=1e-12)
    return [
        float(np.linalg.norm(arm.tool_velocity(planned(t, side=x), planned(t, 1, side=x))))
        for x in ("left", "right")
    ]


STOPPING = {
    "sharp corners": [(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)],
    "there and back": [(0.3, 0.2), (0.4, 0.2), (0.3, 0.2)],
    "a hair's breadth": [(0.3, 0.2), (0.4, 0.2), (0.4, 0.2 + 1e-6), (0.3, 0.2 + 1e-6)],
}


@pytest.mark.parametrize("points", STOPPING.values(), ids=STOPPING)
def test_it_rests_at_sharp_corners(arm, limits, points, worst_ratios):
    path = ac.Path.polyline(points)
    planned = ac.plan(path, arm, limits)
    at = np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))[:-1]
    assert len(at) == len(points) - 2
    for s in at:
        assert max(speed_at(planned, arm, s)) < 1e-9
    assert_kept(worst_ratios(planned, limits.replace(centripetal_acceleration=None), arm))
    # The whole is the sum of its lines, each from rest to rest.
    pairs = zip(points[:-1], points[1:], strict=True)
    alone = sum(ac.plan(ac.Path.polyline(x), arm, limits).duration for x in pairs)
    assert planned.duration == pytest.approx(alone, rel=1e-4)


def test_stops_in_the_papers_job(arm, objective, limits):
    # docs/method.md: stopping dead at each exact corner takes about 5.23 s.
    assert ac.plan(objective, arm, limits).duration == pytest.approx(5.23, abs=0.01)


def test_segments_have_their_own_speeds(arm, objective, limits, worst_ratios):
    speeds = (0.03, 0.06, None)
    points = objective.vertices
    path = ac.round_corners(
        ac.Path.from_segments(
            [
                ac.Line(start=points[i], end=points[i + 1], demand=ac.Demand(speed=speeds[i]))
                for i in range(3)
            ]
        ),
        tolerance=5e-3,
    )
    planned = ac.plan(path, arm, limits)
    assert_kept(worst_ratios(planned, limits, arm))
    s, speed = planned.s(planned.breaks), planned.s(planned.breaks, 1)
    segment = path.locate((s[:-1] + s[1:]) / 2)
    top = np.array([speed[:-1][segment == k].max() for k in range(5)])
    np.testing.assert_allclose(top[[0, 2]], [0.03, 0.06], rtol=1e-5)
    assert 0.06 < top[4] <= 0.15


# --- second-order constraints


def as_second_order(traced, bound):
    """Joint acceleration in the general form."""

    def coefficients(s, side):
        first, second = traced(s, 1, side=side), traced(s, 2, side=side)
        return first, second, np.zeros_like(first)

    return SecondOrder("made-up torque", coefficients, [-bound] * 2, [bound] * 2, joints=True)


def test_joint_acceleration_in_the_general_form(traced, arm, limits, planned, worst_ratios):
    free = limits.replace(joint_acceleration=50.0)
    again = ac.plan(traced, arm, free, constraints=[as_second_order(traced, 0.72)])
    assert again.duration == pytest.approx(planned.duration, rel=1e-5)
    assert_kept(worst_ratios(again, limits, arm))


def gravity(weight, bound):
    """A joint that has to hold its weight."""

    def coefficients(s, side):
        one = np.ones((len(s), 1))
        return one, 0 * one, weight * one

    return SecondOrder("torque", coefficients, [-bound], [bound], joints=True)


def test_gravity_helps_one_way_and_hinders_the_other():
    planned = straight([2.0], {"joint_acceleration": [50.0]}, constraints=[gravity(0.4, 1.0)])
    assert planned.duration == pytest.approx(trapezoid(2.0, 0.6, 1.4), rel=1e-6)


@pytest.mark.parametrize(("weight", "allowed"), [(1.2, 1.0), (-1.2, -1.0)])
def test_a_weight_that_the_arm_cannot_hold(weight, allowed, refuses):
    refuses(
        lambda: straight([2.0], {"joint_acceleration": [50.0]}, constraints=[gravity(weight, 1.0)]),
        ac.NotRealizable,
        "joint 1 torque",
        "even at rest",
        s=0.0,
        joint=1,
        limit="torque",
        needed=weight,
        allowed=allowed,
    )


# --- refusals


def test_something_must_limit_the_acceleration(rounded, arm, refuses):
    only = ac.Limits(speed=0.1, centripetal_acceleration=0.1)
    refuses(
        lambda: ac.plan(rounded, arm, only),
        ac.InvalidInput,
        "joint_acceleration, joint_torque or tool_acceleration",
    )


@pytest.mark.parametrize("name", ["speed", "tool_acceleration", "centripetal_acceleration"])
def test_limits_of_the_tool_need_a_tool_path(arm, name, refuses):
    spline = ac.JointPath.spline([(0.1, 1.0), (0.2, 1.1), (0.5, 1.0)])
    refuses(
        lambda: ac.plan(spline, arm, arm.limits.replace(**{name: 0.1})),
        ac.InvalidInput,
        "need a tool path",
    )


def test_grid_points_off_the_path_are_refused(traced, arm, limits, refuses):
    for points in (np.array([-0.1, 0.1]), np.array([0.1, 1.0]), np.zeros((2, 2))):
        refuses(
            lambda points=points: ac.plan(traced, arm, limits, grid=points),
            ac.InvalidInput,
            "Grid points must be one row",
        )


# --- grids


def test_a_grid_of_ones_own(traced, arm, limits, planned, worst_ratios):
    own = ac.plan(traced, arm, limits, grid=np.linspace(0, traced.length, 3001))
    assert_kept(worst_ratios(own, limits, arm))
    assert own.duration == pytest.approx(planned.duration, rel=1e-4)
    assert np.isin(traced.breaks, own.laws[0].s).all()


@pytest.mark.parametrize(("intervals", "within"), [(50, 2e-2), (500, 1e-3), (50_000, 1e-4)])
def test_coarse_and_fine_grids(traced, arm, limits, planned, intervals, within, worst_ratios):
    other = ac.plan(traced, arm, limits, intervals=intervals)
    places = 50 if intervals < 10_000 else 4
    assert_kept(worst_ratios(other, limits, arm, places=places))
    assert other.duration == pytest.approx(planned.duration, rel=within)
    assert other.duration > 5.3260  # docs/method.md


def test_rounding_breaks_no_limit_on_a_huge_grid(arm, worst_ratios):
    # The path acceleration is a difference of ds² over half a micrometre here.
    fast = arm.limits.replace(speed=0.3)
    planned = ac.plan(ac.Path.polyline(LINE), arm, fast, intervals=400_000)
    assert_kept(worst_ratios(planned, fast, arm, places=1))


def random_spline(seed):
    rng = np.random.default_rng(seed)
    dof = int(rng.integers(2, 8))
    points = rng.uniform(-2, 2, (int(rng.integers(3, 9)), dof))
    limits = ac.Limits(
        joint_velocity=rng.uniform(0.5, 3, dof), joint_acceleration=rng.uniform(0.5, 5, dof)
    )
    return ac.JointPath.spline(points), robot(dof), limits


@pytest.mark.parametrize("seed", range(10))
def test_the_default_grid_costs_little(seed):
    """At most 0.1 % over a grid 10 times finer; it is below 0.03 %."""
    path, any_arm, limits = random_spline(seed)
    planned = ac.plan(path, any_arm, limits)
    finer = ac.plan(path, any_arm, limits, intervals=40_000)
    assert 1 - 1e-6 < planned.duration / finer.duration < 1 + 5e-4


def test_the_default_grid_costs_little_on_the_papers_job(traced, arm, limits, planned):
    finer = ac.plan(traced, arm, limits, intervals=40_000)
    assert 1 - 1e-6 < planned.duration / finer.duration < 1 + 1e-4


def collocated(path, any_arm, limits, intervals=None):
    """Duration of the optimum whose limits hold at the ends of the intervals only.

    That is the planner's own first pass: no margins and a path acceleration that is constant on
    every interval.
    """
    grid = place_grid(path, intervals)
    active = optimal.constraints_of(path, any_arm, limits.for_joints(path.dof))
    x = optimal.Problem(grid, JointDerivatives.on(grid), active).solve(0.0, 0.0)
    return float(np.sum(2 * grid.width / (np.sqrt(x[:-1]) + np.sqrt(x[1:]))))


# Keeping the limits between the points may cost this much; so it does on the default grid.
# A coarse grid pays more where a joint with next to no inertia sets the pace.
GUARANTEE = {4000: 1e-4, 1000: 1e-3}


def test_the_guarantee_costs_little_on_the_papers_job(traced, arm, limits, planned):
    assert planned.duration < collocated(traced, arm, limits) * (1 + GUARANTEE[4000])


@pytest.mark.parametrize("intervals", GUARANTEE)
@pytest.mark.parametrize("batch", range(4))
def test_the_guarantee_costs_little(batch, intervals):
    for seed in range(25 * batch, 25 * batch + 25):
        path, any_arm, limits = random_spline(seed)
        planned = ac.plan(path, any_arm, limits, intervals=intervals)
        bare = collocated(path, any_arm, limits, intervals)
        assert planned.duration < bare * (1 + GUARANTEE[intervals]), seed


@pytest.mark.parametrize("intervals", [None, 30, 200, 700])
@pytest.mark.parametrize("curved", [False, True])
def test_motions_from_rest_to_rest_are_planned_as_in_general(monkeypatch, intervals, curved):
    ur5e = ac.load_arm("ur5e")
    start = np.radians([0, -90, 90, -90, -90, 0])
    if curved:
        center = ur5e.forward(start) + [0.01, 0, 0]
        arc = ac.Arc(start=center - [0.01, 0, 0], center=center, angle=2 * np.pi, normal=(0, 0, 1))
        path = ac.trace(ac.Path.from_segments([arc]).pointing((0, 0, -1)), ur5e, start=start)
        limits = ur5e.limits.replace(speed=0.1, centripetal_acceleration=2.0)
    else:
        path = ac.JointPath.spline([start, start + [0.4, 0.2, -0.1, 0.1, 0, 1]])
        limits = ur5e.limits.of_joints
    quick, found = optimal.solve_from_rest, []

    def record(*args):
        found.append(quick(*args))
        return found[-1]

    monkeypatch.setattr(optimal, "solve_from_rest", record)
    (law,) = ac.plan(path, ur5e, limits, intervals=intervals).laws
    assert found == [law]
    monkeypatch.setattr(optimal, "solve_from_rest", lambda *args: None)
    (general,) = ac.plan(path, ur5e, limits, intervals=intervals).laws
    for name in ("s", "breaks"):
        assert np.array_equal(getattr(law, name), getattr(general, name))
    assert all(np.array_equal(x, y) for x, y in zip(law.rates, general.rates, strict=True))


# --- sizes


@pytest.mark.parametrize("step", [1e-6, 1e-5, 1e-4, 1e-2])
def test_micro_segments(arm, step, worst_ratios):
    x = 0.30 + step * np.arange(11)
    y = 0.2 + step / 2 * (np.arange(11) % 2)
    sharp = ac.Path.polyline(np.stack([x, y], axis=1))
    any_speed = arm.limits.replace(speed=0.1)
    for path in (sharp, ac.round_corners(sharp, tolerance=step / 10)):
        planned = ac.plan(path, arm, any_speed)
        assert_kept(worst_ratios(planned, any_speed, arm, places=10))
    assert planned.duration < ac.plan(sharp, arm, any_speed).duration


@pytest.mark.parametrize("size", [1e-9, 1e-4, 1e4, 1e9])
def test_any_size_of_s_will_do(size, worst_ratios):
    rng = np.random.default_rng(3)
    points = rng.uniform(-2, 2, (5, 3))
    limits = ac.Limits(joint_velocity=[1.0] * 3, joint_acceleration=[2.0] * 3)
    s = np.array([0.0, 1.0, 2.5, 3.0, 4.0])
    usual = ac.plan(ac.JointPath.spline(points, s), robot(3), limits)
    planned = ac.plan(ac.JointPath.spline(points, s * size), robot(3), limits)
    assert planned.duration == pytest.approx(usual.duration, rel=1e-9)
    assert_kept(worst_ratios(planned, limits, places=5))


def plan_what_is_allowed(path, arm, limits, **options):
    """Plan with the speeds that refusals name; the number of refusals, and the plan."""
    for refusals in range(3):
        try:
            return refusals, ac.plan(path, arm, limits, **options)
        except ac.NotRealizable as error:
            name = error.limit.replace(" ", "_")
            assert error.allowed < options[name]
            options[name] = error.allowed
    raise AssertionError("what was allowed was refused")


@pytest.mark.parametrize("seed", range(40))
def test_a_speed_that_a_refusal_names_is_had(seed, worst_ratios):
    """Coarse grids, whose margins change with the speed; each end depends on the other."""
    rng = np.random.default_rng([seed, 700035892])
    points = np.cumsum(rng.normal(size=(int(rng.integers(3, 8)), 4)), axis=0)
    limits = ac.Limits(
        joint_acceleration=rng.uniform(0.3, 3, 4), joint_deceleration=rng.uniform(0.1, 0.5, 4)
    )
    speeds = {"start_speed": 10 ** rng.uniform(-1, 1), "end_speed": 10 ** rng.uniform(-1, 1)}
    path, intervals = ac.JointPath.spline(points), int(rng.integers(5, 20))
    refusals, planned = plan_what_is_allowed(path, robot(4), limits, intervals=intervals, **speeds)
    assert refusals <= 2
    assert_kept(worst_ratios(planned, limits))
