"""Arc length over time of all trajectories, compared with the motion of the tool."""

import dataclasses
from functools import cache

import numpy as np
import pytest

import armcontour as ac
from armcontour.geometry import Path
from armcontour.jobs.methods import TIMINGS
from armcontour.motion import Rates, Span, dwell_law
from armcontour.program import Contour, Dwell, Program

ARM = ac.load_arm("pmk3s")
LIMITS = ARM.limits.replace(speed=0.1, centripetal_acceleration=0.09)
SLOW = LIMITS.replace(speed=0.05)
OBJECTIVE = Path.polyline([[0.3, 0.1], [0.36, 0.1], [0.36, 0.14], [0.30, 0.12]])
ROUNDED = ac.round_corners(OBJECTIVE, tolerance=1e-3)
OTHER = ac.round_corners(Path.polyline([[0.3, 0.2], [0.35, 0.2], [0.35, 0.25]]), tolerance=1e-3)
PROGRAM = Program(moves=(Contour(path=ROUNDED), Dwell(duration=0.25), Contour(path=OTHER)))
# The line at half the speed of the one before: the speed jumps under uniform speed.
UNEVEN = Path(
    segments=[
        ac.Line(start=[0.3, 0.1], end=[0.34, 0.1]),
        ac.Line(start=[0.34, 0.1], end=[0.4, 0.1], segment_limits=ac.SegmentLimits(speed=0.025)),
    ]
)
# What "paper" leaves a line by between its knots makes the tool's way longer by less [m].
ASIDE = 1e-6
# A trajectory of every kind of law; those of programs have a rapid and a dwell.
MAKERS = {
    "optimal": lambda: ac.plan(ROUNDED, ARM, LIMITS, ac.Optimal(intervals=400)),
    "optimal, sharp": lambda: ac.plan(OBJECTIVE, ARM, LIMITS, ac.Optimal(intervals=400)),
    "paper": lambda: ac.plan(ROUNDED, ARM, SLOW, ac.Paper()),
    "paper, sharp": lambda: ac.plan(OBJECTIVE, ARM, SLOW, ac.Paper()),
    "conventional": lambda: ac.plan(ROUNDED, ARM, SLOW, ac.Conventional()),
    "conventional, uneven": lambda: ac.plan(UNEVEN, ARM, SLOW, ac.Conventional()),
    "program, optimal": lambda: ac.plan(PROGRAM, ARM, LIMITS, ac.Optimal(intervals=400)),
    "program, paper": lambda: ac.plan(PROGRAM, ARM, SLOW, ac.Paper()),
    "program, conventional": lambda: ac.plan(PROGRAM, ARM, SLOW, ac.Conventional()),
}
SHARES = np.concatenate(
    [[0, 1, 0.5, 5e-324, 1e-300, 1e-16, 1 - 2**-53], np.random.default_rng(0).random(200)]
)
plan = cache(lambda name: MAKERS[name]())


def path_of(name):
    if name.endswith("uneven"):
        return UNEVEN
    return OBJECTIVE if name.endswith("sharp") else ROUNDED


def places_of(name):
    """Arc lengths: anywhere, next to both ends and at all joints of the path."""
    if name.startswith("program"):
        return np.append(SHARES * (ROUNDED.length + OTHER.length), ROUNDED.length)
    path = path_of(name)
    return np.concatenate([SHARES * path.length, path.breaks])


@pytest.fixture(params=MAKERS)
def case(request):
    return request.param, plan(request.param)


def test_the_arc_length_of_a_motion_is_the_length_of_its_tool_path(case):
    """By quadrature of the speed on contours, between times so near that it is exact."""
    name, trajectory = case
    breaks = trajectory.breaks
    t = np.unique(np.concatenate([breaks, np.linspace(0, breaks[-1], 10_001)]))
    x, weights = np.polynomial.legendre.leggauss(4)
    middle = (t[:-1] + t[1:]) / 2
    half = np.diff(t) / 2
    times = middle[:, None] + half[:, None] * x
    speed = np.linalg.norm(ARM.tool_velocity(trajectory(times), trajectory(times, 1)), axis=-1)
    way = (speed @ weights) * half
    for span in trajectory.spans:
        if span.kind != "contour":
            way[(middle > span.t[0]) & (middle < span.t[1])] = 0.0
    s = trajectory.s(t)
    gone = np.concatenate([[0.0], np.cumsum(way)])
    np.testing.assert_allclose(s, gone, atol=ASIDE if "paper" in name else 1e-8)
    np.testing.assert_allclose(s[[0, -1]], [0, places_of(name).max()], atol=1e-12)
    # It never falls.
    t = np.sort(np.concatenate([SHARES * trajectory.duration, breaks]))
    for first, last in (("left", "left"), ("right", "right"), ("left", "right")):
        rise = trajectory.s(t[1:], side=last) - trajectory.s(t[:-1], side=first)
        assert (rise >= -1e-15).all(), (first, last)
    assert (trajectory.s(t, 1) >= -1e-12).all()


def test_time_at_is_the_inverse_of_the_arc_length(case):
    name, trajectory = case
    s = places_of(name)
    sides = []
    for side in ("left", "right"):
        t = trajectory.time_at(s, side=side)
        assert ((t >= 0) & (t <= trajectory.duration)).all()
        np.testing.assert_allclose(trajectory.s(t), s, atol=1e-12, rtol=0)
        # Next to a stop the speed is the root of a way that is known up to rounding.
        speed_by_place = trajectory.speed_at(s, side=side)
        speed_by_time = trajectory.s(t, 1, side=side)
        np.testing.assert_allclose(speed_by_place, speed_by_time, atol=1e-7, rtol=1e-6)
        sides.append(t)
        # Where the motion moves, a place has one time.
        t = SHARES * trajectory.duration
        speed = trajectory.s(t, 1, side=side)
        t = t[speed > 1e-3]
        speed = speed[speed > 1e-3]
        assert len(t) > 100
        errors = np.abs(trajectory.time_at(trajectory.s(t), side=side) - t)
        assert (errors <= np.maximum(1e-12 / speed, 1e-6 * t)).all()
    assert (sides[0] <= sides[1] + 1e-12).all()


@pytest.mark.parametrize("kind", ["optimal", "paper"])
def test_the_tool_is_at_the_point_of_the_path_at_time_at(kind):
    for name in (kind, f"{kind}, sharp"):
        path = path_of(name)
        trajectory = plan(name)
        s = places_of(name)
        errors = ARM.tool_position(trajectory(trajectory.time_at(s))) - path(s)
        # Laps are abreast of the place, and leave it by little.
        along = [path(s[mask], 1, side=x) for x, mask in (("left", s > 0), ("right", s == 0))]
        both = np.concatenate([errors[s > 0], errors[s == 0]])
        assert np.abs(np.sum(both * np.concatenate(along), axis=1)).max() < 1e-9
        assert np.linalg.norm(errors, axis=1).max() < (1e-4 if kind == "paper" else 1e-9)
    corners = OBJECTIVE.breaks[1:-1]
    t = trajectory.time_at(corners)
    np.testing.assert_allclose(ARM.tool_position(trajectory(t)), OBJECTIVE(corners), atol=1e-9)
    for side, sign in (("left", -1), ("right", 1)):
        speed = trajectory.s(t, 1, side=side)
        np.testing.assert_allclose(speed, 0, atol=1e-4)
        np.testing.assert_allclose(trajectory.speed_at(corners, side=side), speed, atol=1e-6)
        # The acceleration has two sides there.
        assert (sign * trajectory.s(t, 2, side=side) > 0.01).all()


@pytest.mark.parametrize("method", TIMINGS)
def test_the_arc_length_of_a_program_increases_on_contours_only(method):
    trajectory = plan(f"program, {method}")
    first, second = trajectory.contour_spans
    assert [x.kind for x in trajectory.spans] == ["contour", "dwell", "rapid", "contour"]
    between = ROUNDED.length
    ends = (first.t[1], second.t[0])
    limits_of_rest = [float(trajectory.time_at(between, side=x)) for x in ("left", "right")]
    assert limits_of_rest == pytest.approx(ends, abs=1e-12)
    t = np.linspace(*ends, 50)
    np.testing.assert_allclose(trajectory.s(t), between, atol=1e-15)
    assert not trajectory.s(t[1:-1], 1).any() and not trajectory.s(t[1:-1], 2).any()
    # The tool itself is far away from where it was, and moves.
    assert np.linalg.norm(ARM.tool_velocity(trajectory(t), trajectory(t, 1)), axis=1).max() > 0.05
    for span in trajectory.contour_spans:
        s = np.linspace(0, span.s[1] - span.s[0], 30)[1:-1]
        times = span.t[0] + span.trajectory.time_at(s)
        np.testing.assert_allclose(trajectory.time_at(span.s[0] + s), times, rtol=1e-12)
        speed = span.trajectory.speed_at(s)
        np.testing.assert_allclose(trajectory.speed_at(span.s[0] + s), speed, rtol=1e-9)


def test_invalid_times_and_arc_lengths_are_refused(refuses):
    one = plan("optimal")
    mac = plan("paper")
    program = plan("program, optimal")
    (law,) = one.laws
    dwell = Span(move=0, kind="dwell", t=(0.0, 1.0))
    still = ac.Trajectory(laws=(law, dwell_law(np.zeros(2), 1.0)), method="by hand")
    spans = program.spans[:-1], program.spans[1:], plan("program, paper").spans, program.spans * 2
    calls = [
        *(lambda ask=ask, s=s: ask(s) for ask in (one.time_at, one.speed_at)
          for s in (-1e-3, 0.2, [0.01, 0.2], "far", np.nan)),
        *(lambda ask=ask: ask(0.0, side="up") for ask in (one.time_at, one.speed_at, mac.s)),
        *(lambda t=t: mac.s(t) for t in (-1.0, "soon")),
        lambda: mac.s(0.0, 4),
        lambda: mac("soon"),
        # A motion without a path, and one along two of them.
        *(lambda ask=ask: ask(0.0) for ask in (still.s, still.time_at, still.speed_at)),
        lambda: ac.Trajectory(laws=one.laws * 2, method="by hand").s(0.0),
        *(lambda x=x: dataclasses.replace(program, spans=x) for x in (*spans, (dwell,))),
        *(lambda x=x: dataclasses.replace(law, rates=x)
          for x in (np.zeros((4, 3)), Rates(*np.zeros((4, 2))), Rates(0.0, 0.0, 0.0, 0.0))),
    ]  # fmt: skip
    for call in calls:
        refuses(call, ac.InvalidInput)


@pytest.mark.parametrize("order", [1, 2])
def test_rates_of_the_arc_length_agree_with_differences(order):
    for name in MAKERS:
        trajectory = plan(name)
        rng = np.random.default_rng(1)
        widths = np.diff(trajectory.breaks)
        k = np.unique([0, len(widths) - 1, *rng.integers(0, len(widths), 100)])
        t = trajectory.breaks[k] + rng.uniform(0.2, 0.8, len(k)) * widths[k]
        h = np.minimum(0.05 * widths[k], 1e-4)
        wide, narrow = (
            np.diff(trajectory.s(np.stack([t - x, t + x]), order - 1), axis=0)[0] / (2 * x)
            for x in (h, h / 2)
        )
        # Both differences are off by their widths squared; together they are not.
        expected = (4 * narrow - wide) / 3
        near = np.maximum(1e-6 * expected, 1e-8 + (1e-15 if order == 1 else 1e-14) / h)
        assert (np.abs(trajectory.s(t, order) - expected) <= near).all(), name
