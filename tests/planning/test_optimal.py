"""The optimal planner: closed forms, limits between grid points, and vanishing derivatives."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.special import gamma

import armcontour as ac
from armcontour.planning import optimal_timing
from armcontour.planning.constraints import SecondOrder, constraints_of, limits_on
from armcontour.planning.path_grid import place_grid
from armcontour.planning.topp.grid_plan import plan_on_grid
from armcontour.planning.topp.plan_rules import FOUND, Rules
from armcontour.planning.topp.sampled_joint_path import SampledJointPath

LEAK = 1e-9  # by how much, relatively, a limit may be exceeded anywhere
LINE = ((-0.065, 0.300), (0.335, 0.300))  # docs/method.md, "where the method falls short", 1
ACCELERATION = 0.3  # m/s²
RADIUS = 0.05  # m


def robot(dof, **limits):
    """As much of an arm as a joint path needs."""
    return SimpleNamespace(dof=dof, limits=ac.Limits.only(**limits))


@pytest.fixture
def assert_within_limits(worst_ratios):
    """Judges a plan: nothing is exceeded, and given limits bind somewhere. Returns the plan."""

    def judge(planned, limits, arm=None, *, binds=(), near=1e-5, **options):
        ratios = worst_ratios(planned, limits, arm, **options)
        assert ratios, "nothing was judged"
        broken = {name: ratio - 1 for name, ratio in ratios.items() if ratio > 1 + LEAK}
        assert not broken
        assert all(ratios[name] > 1 - near for name in binds), ratios
        return planned

    return judge


@pytest.fixture(scope="module")
def planned(traced, arm, limits):
    return ac.plan(traced, arm, limits)


def test_the_paper_job_satisfies_several_sets_of_limits(
    planned, rounded, arm, limits, mac, assert_within_limits, traced
):
    # The true optimum is 5.32606 s; shorter means a leak.
    assert 5.3260 <= planned.duration <= 5.3263
    assert planned.method == "optimal"
    binds = ("joint_acceleration", "speed", "centripetal_acceleration")
    assert_within_limits(planned, limits, arm, binds=binds)
    assert ac.plan(rounded, arm, limits).duration == planned.duration
    # docs/method.md: MAC is optimal on this job, to 1e-5; with laps of finite size it is shorter as
    # much as it leaves a corner early.
    assert planned.duration == pytest.approx(mac.duration, rel=2e-4)
    free = limits.replace(centripetal_acceleration=np.inf)
    # docs/method.md gives 4.825 s; printed to three digits.
    assert assert_within_limits(ac.plan(traced, arm, free), free, arm).duration == pytest.approx(
        4.825, abs=5e-4
    )
    for name, value in (("joint_velocity", (0.3, 0.25)), ("tool_acceleration", 0.1)):
        changed_limits = limits.replace(**{name: value})
        assert_within_limits(
            ac.plan(traced, arm, changed_limits), changed_limits, arm, binds=(name,)
        )


def test_the_tool_stays_on_the_path_and_never_reverses(planned, rounded, arm):
    t = np.linspace(0, planned.duration, 20001)
    ends = [0.0, planned.duration]
    projection = rounded.project(arm.tool_position(planned(t)))
    assert projection.distance.max() < 1e-7 and np.diff(projection.s).min() > -1e-9
    np.testing.assert_allclose(
        arm.tool_position(planned(ends)), rounded.vertices[[0, -1]], atol=1e-8
    )
    np.testing.assert_allclose(planned(ends, 1), 0, atol=1e-9)
    breaks = planned.breaks[1:-1]
    for order, near in ((0, 1e-12), (1, 1e-7)):
        np.testing.assert_allclose(
            planned(breaks, order, side="left"), planned(breaks, order), atol=near
        )


def test_optimal_plans_the_line_on_which_the_papers_method_fails(arm, assert_within_limits):
    fast = arm.limits.replace(speed=0.3)
    path = ac.Path.polyline(LINE)
    with pytest.raises(ac.NotRealizable):
        ac.plan(path, arm, fast, ac.Paper())
    planned = assert_within_limits(ac.plan(path, arm, fast), fast, arm)
    t = np.linspace(0, planned.duration, 2001)
    assert np.ptp(np.sign(planned(t, 1)[:, 1])) == 2  # joint 2 does turn round
    # With the reversal on a grid point, next to one, and between two.
    for intervals in (2, 10, 17, 50, 113, 300, 398):
        coarse = assert_within_limits(
            ac.plan(path, arm, fast, ac.Optimal(intervals=intervals)), fast, arm
        )
        assert 1 <= coarse.duration / planned.duration < 1.02, intervals
    # The path acceleration is a difference of ds² over half a micrometre here.
    assert_within_limits(
        ac.plan(path, arm, fast, ac.Optimal(intervals=400_000)), fast, arm, places=1
    )


def straight(direction, limits, **options):
    """A straight way in joint space of the given extent, planned."""
    path = ac.JointPath.spline([np.zeros(len(direction)), np.asarray(direction, float)])
    return ac.plan(path, robot(len(direction)), ac.Limits.only(**limits), ac.Optimal(**options))


def trapezoid(length, up, down, top=np.inf, begin=0.0, end=0.0):
    """Time over a length with path accelerations `up` and `down` and a top speed."""
    peak = np.sqrt((2 * length * up * down + down * begin**2 + up * end**2) / (up + down))
    peak = min(peak, top)
    way = length - (peak**2 - begin**2) / (2 * up) - (peak**2 - end**2) / (2 * down)
    return (peak - begin) / up + (peak - end) / down + way / peak


WAYS = {
    "one joint": ([2.0], [1.5], [1.5]),
    "one joint, uneven": ([2.0], [1.5], [0.4]),
    "backwards": ([-2.0], [1.5], [0.4]),
    "two joints, opposite": ([1.0, -0.7], [1.5, 0.9], [0.4, 2.0]),
    "three joints": ([0.1, 3.0, -1.0], [0.2, 1.0, 2.0], [0.3, 2.0, 0.5]),
}


@pytest.mark.parametrize("top", [None, 0.5])
def test_the_duration_of_a_straight_joint_path_has_the_closed_form(top, assert_within_limits):
    for way, (direction, acceleration, deceleration) in WAYS.items():
        limits = {"joint_acceleration": np.stack([-np.array(deceleration), acceleration], axis=1)}
        length = np.linalg.norm(direction)
        speed = np.inf
        if top is not None:
            forth = np.array(direction)[:, None] > 0
            limits["joint_velocity"] = np.where(forth, (-9.0, top), (-top, 9.0))
            speed = (top * length / np.abs(direction)).min()
        e = np.array(direction) / length
        both = np.array([acceleration, deceleration])
        up, down = (np.min(np.where(e > 0, *x) / np.abs(e)) for x in (both, both[::-1]))
        planned = assert_within_limits(straight(direction, limits), ac.Limits.only(**limits))
        # The interval in which the profile turns loses less than its own share.
        expected = trapezoid(length, up, down, speed)
        assert planned.duration == pytest.approx(expected, rel=1e-6), way


def test_start_and_end_speeds_are_respected(assert_within_limits, refuses):
    # 2 rad at 1.0 rad/s² up and down: from 2 rad/s the arm can just stop.
    limits = {"joint_acceleration": [1.0]}
    for begin, end in ((0.3, 0.0), (0.0, 0.7), (0.4, 0.9), (1.0, 1.0), (2.0, 0.0)):
        planned = straight([2.0], limits, start_speed=begin, end_speed=end)
        assert_within_limits(planned, ac.Limits.only(**limits))
        expected = trapezoid(2.0, 1.0, 1.0, np.inf, begin, end)
        assert planned.duration == pytest.approx(expected, rel=1e-6)
        velocities = planned([0.0, planned.duration], 1)[:, 0]
        np.testing.assert_allclose(velocities, [begin, end], atol=1e-9)
    # Too long to stop, not to be reached, above a velocity limit.
    limits["joint_velocity"] = [5.0]
    for end, s in (("start", 0.0), ("end", 2.0)):
        for speed in (2.1, 5.5):
            refuses(
                lambda x={f"{end}_speed": speed}: straight([2.0], limits, **x),
                ac.NotRealizable,
                f"The {end} speed of {speed} m/s is too high",
                "allow about 2 m/s",
                **{"s": s, "limit": f"{end} speed", "needed": speed, "allowed": 2.0},
            )


def circle():
    start = (0.35 + RADIUS, 0.2)
    center = (0.35, 0.2)
    return ac.Path(segments=[ac.Arc(start=start, center=center, angle=2 * np.pi)])


# (ds²/R)² + dds² = a² makes ds² = a R sin(2 s / R), up to sqrt(a R) an eighth of a turn on; the
# quarter of the lemniscate's length is the time of that, in units of sqrt(R / a).
LEMNISCATE = gamma(0.25) ** 2 / (2 * np.sqrt(2 * np.pi))


def test_tool_acceleration_is_reached_on_a_line_and_a_circle(arm, assert_within_limits):
    only = ac.Limits.only(tool_acceleration=ACCELERATION)
    line = [(0.3, 0.2), (0.4, 0.25)]
    path = ac.Path.polyline(line)
    trajectory = assert_within_limits(ac.plan(path, arm, only), only, arm).duration
    # Tracing leaves the tool's derivatives a few millionths of play.
    assert trajectory == pytest.approx(2 * np.sqrt(path.length / ACCELERATION), rel=1e-5)
    expected = (LEMNISCATE + 1.5 * np.pi) * np.sqrt(RADIUS / ACCELERATION)
    for intervals, within in ((100, 2e-3), (500, 1e-4), (None, 1e-5)):
        trajectory = ac.plan(circle(), arm, only, ac.Optimal(intervals=intervals))
        assert_within_limits(trajectory, only, arm, binds=("tool_acceleration",), near=1e-6)
        assert 1 - 1e-9 <= trajectory.duration / expected < 1 + within
    # At an assigned velocity.
    speed = 0.1
    both = only.replace(speed=speed)
    turned = RADIUS / 2 * np.arcsin(speed**2 / (ACCELERATION * RADIUS))

    def pace(r):  # the root at rest is taken out by s = r², ds = 2 r dr
        return 2 * r / np.sqrt(ACCELERATION * RADIUS * np.sin(2 * r * r / RADIUS))

    ramp, _ = quad(pace, 0, np.sqrt(turned))
    expected = 2 * ramp + (2 * np.pi * RADIUS - 2 * turned) / speed
    trajectory = assert_within_limits(ac.plan(circle(), arm, both), both, arm).duration
    assert trajectory == pytest.approx(expected, rel=1e-5)


def test_circles_and_rounded_corners_reach_their_centripetal_acceleration(
    arm, assert_within_limits, rounded
):
    both = ac.Limits.only(centripetal_acceleration=0.2, joint_acceleration=100.0)
    planned = assert_within_limits(ac.plan(circle(), arm, both), both, arm)
    middle = planned(planned.duration / 2), planned(planned.duration / 2, 1)
    top = np.linalg.norm(arm.tool_velocity(*middle))
    assert top == pytest.approx(np.sqrt(0.2 * RADIUS), rel=1e-5)
    only = ac.Limits.only(tool_acceleration=ACCELERATION, speed=0.15)
    planned = assert_within_limits(ac.plan(rounded, arm, only), only, arm)
    corners = np.sqrt(ACCELERATION * np.array(rounded.corners.radius))
    speeds = planned.speed_at((rounded.corners.start + rounded.corners.end) / 2)
    # Never faster than the arc allows, and nearly so fast in the middle of it.
    assert (speeds <= corners * (1 + LEAK)).all()
    np.testing.assert_allclose(speeds, corners, rtol=1e-3)


STOPPING = {
    "sharp corners": [(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)],
    "there and back": [(0.3, 0.2), (0.4, 0.2), (0.3, 0.2)],
    "a hair's breadth": [(0.3, 0.2), (0.4, 0.2), (0.4, 0.2 + 1e-6), (0.3, 0.2 + 1e-6)],
}


@pytest.mark.parametrize("name", STOPPING)
def test_the_tool_rests_at_sharp_corners(arm, limits, name, assert_within_limits):
    points = STOPPING[name]
    planned = ac.plan(ac.Path.polyline(points), arm, limits)
    assert_within_limits(planned, limits.replace(centripetal_acceleration=np.inf), arm)
    vertices = np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))[:-1]
    law = planned.laws[0]
    for s in vertices:
        k = int(np.searchsorted(law.s, s - 1e-12))
        assert law.s[k] == pytest.approx(s, abs=1e-12)
        for side in ("left", "right"):
            q, dq = (planned(law.breaks[k], order, side=side) for order in (0, 1))
            assert np.linalg.norm(arm.tool_velocity(q, dq)) < 1e-9
    # The whole is the sum of its lines, each from rest to rest.
    pairs = zip(points[:-1], points[1:], strict=True)
    alone = sum(ac.plan(ac.Path.polyline(x), arm, limits).duration for x in pairs)
    assert planned.duration == pytest.approx(alone, rel=1e-4)
    # docs/method.md: stopping dead at each exact corner takes about 5.23 s.
    assert name != "sharp corners" or planned.duration == pytest.approx(5.23, abs=0.01)


def test_optimal_timing_uses_segment_speeds(arm, objective, limits, assert_within_limits):
    points = objective.vertices
    lines = [
        ac.Line(start=points[k], end=points[k + 1], segment_limits=ac.SegmentLimits(speed=v))
        for k, v in enumerate((0.03, 0.06, None))
    ]
    path = ac.round_corners(ac.Path(segments=lines), tolerance=5e-3)
    planned = assert_within_limits(ac.plan(path, arm, limits), limits, arm)
    s = planned.s(planned.breaks)
    speed = planned.s(planned.breaks, 1)
    segment = path.locate((s[:-1] + s[1:]) / 2)
    top = np.array([speed[:-1][segment == k].max() for k in range(5)])
    np.testing.assert_allclose(top[[0, 2]], [0.03, 0.06], rtol=1e-5)
    assert 0.06 < top[4] <= 0.15


def test_a_general_constraint_equal_to_joint_acceleration_gives_the_same_plan(
    traced, arm, limits, planned, assert_within_limits
):
    def coefficients(s, side):
        first = traced(s, 1, side=side)
        second = traced(s, 2, side=side)
        return first, second, np.zeros_like(first)

    constraint = SecondOrder("made-up torque", coefficients, [-0.72] * 2, [0.72] * 2, joints=True)
    free = limits.replace(joint_acceleration=50.0)
    again = assert_within_limits(
        ac.plan(traced, arm, free, ac.Optimal(constraints=[constraint])), limits, arm
    )
    assert again.duration == pytest.approx(planned.duration, rel=1e-5)


def test_gravity_helps_one_direction_and_is_refused_above_the_limit(refuses):
    def gravity(weight):
        """A joint that has to hold its weight."""

        def coefficients(s, side):
            one = np.ones((len(s), 1))
            return one, 0 * one, weight * one

        constraint = SecondOrder("torque", coefficients, [-1.0], [1.0], joints=True)
        return straight([2.0], {"joint_acceleration": [50.0]}, constraints=[constraint])

    assert gravity(0.4).duration == pytest.approx(trapezoid(2.0, 0.6, 1.4), rel=1e-6)
    for weight in (1.2, -1.2):
        data = {"joint": 0, "limit": "torque", "needed": weight, "allowed": np.sign(weight)}
        refuses(lambda x=weight: gravity(x), ac.NotRealizable, "even at rest", s=0.0, **data)


def test_unsupported_limits_and_paths_are_refused(rounded, traced, arm, limits, refuses):
    only = ac.Limits.only(speed=0.1, centripetal_acceleration=0.1)
    refuses(lambda: ac.plan(rounded, arm, only), ac.InvalidInput, "joint_acceleration")
    spline = ac.JointPath.spline([(0.1, 1.0), (0.2, 1.1), (0.5, 1.0)])
    for name in ("speed", "tool_acceleration", "centripetal_acceleration"):
        changed_limits = arm.limits.replace(**{name: 0.1})
        refuses(
            lambda x=changed_limits: ac.plan(spline, arm, x), ac.InvalidInput, "need a tool path"
        )


def random_spline(seed):
    rng = np.random.default_rng(seed)
    dof = int(rng.integers(2, 8))
    points = rng.uniform(-2, 2, (int(rng.integers(3, 9)), dof))
    limits = ac.Limits.only(
        joint_velocity=rng.uniform(0.5, 3, dof), joint_acceleration=rng.uniform(0.5, 5, dof)
    )
    return ac.JointPath.spline(points), robot(dof), limits


def collocated(path, any_arm, limits, intervals=None):
    """Duration of the optimum whose limits hold at the ends of the intervals only.

    That is the planner's own first pass: no margins and a path acceleration that is constant on
    every interval.
    """
    on = SampledJointPath(place_grid(path, intervals))
    active = constraints_of(path, any_arm, limits.for_joints(path.dof))
    x = plan_on_grid(on.intervals, limits_on(on, active), Rules(tries=1)).x
    return float(np.sum(2 * on.grid.width / (np.sqrt(x[:-1]) + np.sqrt(x[1:]))))


# Keeping the limits between the points may cost this much; so it does on the default grid.
# A coarse grid pays more where a joint with next to no inertia sets the pace.
@pytest.mark.parametrize(("intervals", "cost"), [(4000, 1e-4), (1000, 1e-3)])
def test_margins_between_grid_points_cost_little_time(traced, arm, limits, intervals, cost):
    jobs = [(traced, arm, limits)] if intervals == 4000 else []
    for k, job in enumerate([*jobs, *(random_spline(seed) for seed in range(60))]):
        bare = collocated(*job, intervals)
        assert ac.plan(*job, ac.Optimal(intervals=intervals)).duration < bare * (1 + cost), k


@pytest.mark.parametrize("jerk", [None, 20.0])
def test_a_mirrored_path_with_exchanged_bounds_takes_the_same_time(assert_within_limits, jerk):
    rng = np.random.default_rng(700036000)
    points = np.cumsum(rng.normal(size=(6, 3)), axis=0)
    bounds = {"joint_velocity": (0.3, 2), "joint_acceleration": (0.5, 5)}
    bounds_by_name = {name: rng.uniform(*x, (3, 2)) * (-1, 1) for name, x in bounds.items()}
    limits = ac.Limits.only(joint_jerk=jerk, **bounds_by_name)
    mirrored = limits.replace(**{name: -x[:, ::-1] for name, x in bounds_by_name.items()})
    planned = ac.plan(ac.JointPath.spline(points), robot(3), limits)
    other = ac.plan(ac.JointPath.spline(-points), robot(3), mirrored)
    assert other.duration == pytest.approx(planned.duration, rel=1e-9)
    assert_within_limits(planned, limits)
    low, high = limits.velocity_bounds(3)
    dq = planned(np.linspace(0, planned.duration, 20001), 1)
    # Each direction is limited somewhere by its own bound.
    assert ((dq / low).max(), (dq / high).max()) == pytest.approx((1, 1), abs=1e-2)
    smaller = np.minimum(-low, high)
    slow = ac.plan(ac.JointPath.spline(points), robot(3), limits.replace(joint_velocity=smaller))
    assert slow.duration > 1.02 * planned.duration


def one_joint(seed):
    """A path of one joint whose dq_ds varies by a factor of ten and more, and a rest."""
    rng = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(10 ** rng.uniform(-1, 0, 4))])
    q = rng.uniform(-1, 1, (5, 1))
    slopes = rng.normal(0, 4, (5, 1))
    none = np.zeros((4, 1))
    ends = (q[:-1], slopes[:-1], none), (q[1:], slopes[1:], none)
    path = ac.JointPath.hermite(breaks, *ends)
    return ac.JointPath(breaks=path.breaks, coefficients=path.coefficients, stops=breaks[2:3])


def turns_of(path):
    """Positions of a joint at its ends, stops and turns."""
    extremes = []
    for i, c in enumerate(path.coefficients[:, :, 0]):
        piece = np.polynomial.Polynomial(c)
        roots = piece.deriv().roots()
        inner = np.sort(roots.real[(abs(roots.imag) < 1e-9) & (0 < roots.real) & (roots.real < 1)])
        begins = i == 0 or path.breaks[i] in path.stops
        extremes += [*([c[0]] if begins else []), *piece(inner)]
    return np.array([*extremes, path.coefficients[-1, :, 0].sum()])


@pytest.mark.parametrize("seed", range(25))
def test_one_joint_moves_as_fast_along_an_uneven_as_along_an_even_path(seed):
    path = one_joint(seed)
    acceleration = 2.0
    best = (2 * np.sqrt(abs(np.diff(turns_of(path))) / acceleration)).sum()
    planned = ac.plan(path, limits=ac.Limits.only(joint_acceleration=acceleration))
    assert best * (1 - 1e-9) <= planned.duration <= best * (1 + 1e-3)


def test_a_limit_that_no_grid_resolves_is_refused_in_bounded_memory(refuses):
    places = []

    def rough(s, side):
        places.append(len(s))
        return (1 + 0.5 * np.sin(1e9 * s))[:, None], np.zeros((len(s), 1)), np.zeros((len(s), 1))

    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.5)])
    limits = ac.Limits(joint_acceleration=1.0)
    constraints = [SecondOrder("rough", rough, [-1.0], [1.0])]
    refuses(
        lambda: ac.plan(path, limits=limits, options=ac.Optimal(constraints=constraints)),
        ac.NotRealizable,
        "grid",
    )
    # Refined without a bound, 4000 intervals grow to more than a million.
    assert 10_000 < max(places) < 700_000


def test_a_path_with_more_points_than_a_grid_is_refined_for_loss_is_planned(
    monkeypatch, worst_ratios
):
    # As with 45,000 points and the usual numbers.
    monkeypatch.setattr(optimal_timing, "MAX_REFINED", 3000)
    monkeypatch.setattr(optimal_timing, "MAX_REFINED_OF_JOINTS", 60_000)
    points = np.cumsum(np.random.default_rng(70001).normal(size=(900, 6)), 0) * 0.05
    limits = ac.Limits(joint_velocity=2.0, joint_acceleration=10.0)
    planned = ac.plan(ac.JointPath.spline(points), limits=limits)
    assert max(worst_ratios(planned, limits).values()) <= 1 + 1e-9


def test_refusal_of_end_speed_states_allowed_speed_only_for_given_tool_rotation(refuses):
    arm = ac.load_arm("ur5e")
    line = ac.Path.polyline([(0.4, -0.15, 0.2), (0.6, -0.15, 0.2)])
    options = ac.Optimal(end_speed=5.0)
    given = line.oriented([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)])
    with pytest.raises(ac.NotRealizable, match="end speed of 5 m/s .* allow about") as caught:
        ac.plan(given, arm, options=options)
    # The figure holds.
    speed = 0.999 * caught.value.allowed
    assert ac.plan(given, arm, options=ac.Optimal(end_speed=speed)).duration > 0
    free = line.pointing((0, 0, -1))
    refuses(
        lambda: ac.plan(free, arm, options=options),
        ac.NotRealizable,
        "rotation about the tool axis",
        "Lower it",
        allowed=None,
    )


@pytest.mark.parametrize("intervals", [500, 4000, 12_000])
def test_the_time_lost_by_a_grid_is_estimated_within_a_factor_of_three(intervals):
    ratios = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        path = ac.JointPath.spline(rng.uniform(-2, 2, (6, 6)), np.linspace(0, 1, 6))
        velocity = rng.uniform(1, 3, 6)
        acceleration = rng.uniform(1, 5, 6)
        limits = ac.Limits(joint_velocity=velocity, joint_acceleration=acceleration)
        on = SampledJointPath(place_grid(path, intervals))
        active = constraints_of(path, None, limits)
        rules = Rules(max_margin=0.02, estimates_loss=True)
        plan = plan_on_grid(on.intervals, limits_on(on, active), rules)
        assert plan.outcome == FOUND
        fine = ac.plan(path, limits=limits, options=ac.Optimal(intervals=200_000)).duration
        ratios.append(plan.lost_time / (plan.duration - fine))
    # Where dq_ds of a joint vanishes, the estimate for one interval can be far too large.
    assert min(ratios) > 0.7
    assert np.median(ratios) < 3


@pytest.mark.parametrize(("intervals", "loss"), [(300, 1 / 300), (1000, 1e-3), (None, 3e-5)])
def test_plan_of_many_points_loses_no_more_than_allowed_and_satisfies_limits(intervals, loss):
    # On so few intervals, margins take up to a tenth of a limit, so the grid is refined.
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.5, 0.5, (50, 7))
    at = np.linspace(0, 1, 50)
    velocity = rng.uniform(0.9, 1.1, (7, 2)) * [-1.0, 1.0]
    acceleration = rng.uniform(0.9, 1.1, (7, 2)) * [-5.0, 5.0]
    limits = ac.Limits(joint_velocity=velocity, joint_acceleration=acceleration)
    path = ac.JointPath.spline(points, at)
    planned = ac.plan(path, limits=limits, options=ac.Optimal(intervals=intervals))
    fine = ac.plan(path, limits=limits, options=ac.Optimal(intervals=100_000))
    assert -1e-7 < planned.duration / fine.duration - 1 < loss

    # The joints are those of SciPy's spline, moved by the time law.
    spline = CubicSpline(at, points, bc_type="natural")
    law = planned.laws[0]
    t = np.linspace(0, planned.duration, 20_000)
    i = np.clip(np.searchsorted(law.breaks, t, side="right") - 1, 0, len(law.breaks) - 2)
    s, ds, dds = (law.path_position(i, t, order) for order in range(3))
    dq = spline(s, 1) * ds[:, None]
    ddq = spline(s, 1) * dds[:, None] + spline(s, 2) * (ds**2)[:, None]
    use = max((dq / velocity[:, :1].T).max(), (dq / velocity[:, 1:].T).max())
    assert use < 1 + LEAK
    use = max((ddq / acceleration[:, :1].T).max(), (ddq / acceleration[:, 1:].T).max())
    assert 1 - 1e-3 < use < 1 + LEAK
