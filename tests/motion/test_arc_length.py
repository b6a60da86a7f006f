"""Arc length over time of every kind of trajectory, against the motion of the tool itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.geometry import Path
from armcontour.motion import LapLaw, Method, PathLaw, Rates, Span, smooth
from armcontour.program import Contour, Dwell, Program

ARM = ac.load_arm("pmk3s")
LIMITS = ARM.limits.replace(speed=0.1, centripetal_acceleration=0.09)
SLOW = LIMITS.replace(speed=0.05)
POINTS = [[0.3, 0.1], [0.36, 0.1], [0.36, 0.14], [0.30, 0.12]]
OBJECTIVE = Path.polyline(POINTS)
ROUNDED = ac.round_corners(OBJECTIVE, tolerance=1e-3)
OTHER = ac.round_corners(Path.polyline([[0.3, 0.2], [0.35, 0.2], [0.35, 0.25]]), tolerance=1e-3)
PROGRAM = Program(moves=(Contour(path=ROUNDED), Dwell(duration=0.25), Contour(path=OTHER)))
LENGTH = ROUNDED.length + OTHER.length
# The line at half the speed of the one before: the speed jumps under uniform speed.
UNEVEN = Path.from_segments(
    [
        ac.Line(start=[0.3, 0.1], end=[0.34, 0.1]),
        ac.Line(start=[0.34, 0.1], end=[0.4, 0.1], demand=ac.Demand(speed=0.025)),
    ]
)
# What "mac" leaves a line by between its knots makes the tool's way longer by less [m].
ASIDE = 1e-6
NAMES = [
    *("optimal", "optimal, sharp", "smoothed", "smoothed once", "smoothed, sharp"),
    *("mac", "mac, sharp", "conventional", "conventional, uneven"),
    *("program, optimal", "program, mac", "program, conventional"),
]


@cache
def plan(name: str) -> ac.Trajectory:
    """A trajectory of every kind of law; those of programs have a rapid and a dwell."""
    makers: dict[str, Callable[[], ac.Trajectory]] = {
        "optimal": lambda: ac.plan(ROUNDED, ARM, LIMITS, intervals=400),
        "optimal, sharp": lambda: ac.plan(OBJECTIVE, ARM, LIMITS, intervals=400),
        "smoothed": lambda: smooth(plan("optimal"), 0.02, 0.01),
        "smoothed once": lambda: smooth(plan("optimal"), 0.02),
        "smoothed, sharp": lambda: smooth(plan("optimal, sharp"), 0.02, 0.01),
        "mac": lambda: ac.plan(ROUNDED, ARM, SLOW, method="mac"),
        "mac, sharp": lambda: ac.plan(OBJECTIVE, ARM, SLOW, method="mac"),
        "conventional": lambda: ac.plan(ROUNDED, ARM, SLOW, method="conventional"),
        "conventional, uneven": lambda: ac.plan(UNEVEN, ARM, SLOW, method="conventional"),
        "program, optimal": lambda: ac.plan(PROGRAM, ARM, LIMITS),
        "program, mac": lambda: ac.plan(PROGRAM, ARM, SLOW, method="mac"),
        "program, conventional": lambda: ac.plan(PROGRAM, ARM, SLOW, method="conventional"),
    }
    return makers[name]()


def length_of(name: str) -> float:
    if name.startswith("program"):
        return LENGTH
    if name.endswith("uneven"):
        return UNEVEN.length
    return (OBJECTIVE if name.endswith("sharp") else ROUNDED).length


@cache
def knots(name: str) -> np.ndarray:
    """Times between which the joints move smoothly, and so finely that quadrature is exact."""
    breaks = plan(name).breaks
    return np.unique(np.concatenate([breaks, np.linspace(0, breaks[-1], 20_001)]))


@cache
def gone(name: str) -> np.ndarray:
    """How far the tool has gone along contours at the knots, by quadrature of its speed [m]."""
    trajectory, t = plan(name), knots(name)
    x, weights = np.polynomial.legendre.leggauss(4)
    middle, half = (t[:-1] + t[1:]) / 2, np.diff(t) / 2
    at = middle[:, None] + half[:, None] * x
    speed = np.linalg.norm(ARM.tool_velocity(trajectory(at), trajectory(at, 1)), axis=-1)
    way = (speed @ weights) * half
    for span in trajectory.spans:
        if span.kind != "contour":
            way[(middle > span.t[0]) & (middle < span.t[1])] = 0.0
    return np.concatenate([[0.0], np.cumsum(way)])


@pytest.mark.parametrize("name", NAMES)
def test_s_is_how_far_the_tool_has_gone(name: str) -> None:
    found = plan(name).s(knots(name))
    np.testing.assert_allclose(found, gone(name), atol=ASIDE if "mac" in name else 1e-8)
    assert found[0] == pytest.approx(0, abs=1e-15)
    assert found[-1] == pytest.approx(length_of(name), abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
@given(share=st.floats(0, 1))
def test_the_time_at_a_place_is_when_the_motion_is_there(name: str, share: float) -> None:
    trajectory = plan(name)
    s = share * length_of(name)
    for side in ("left", "right"):
        t = float(trajectory.time_at(s, side=side))
        assert 0 <= t <= trajectory.duration
        assert float(trajectory.s(t)) == pytest.approx(s, abs=1e-12)
        # Next to a stop the speed is the root of a way that is known up to rounding.
        speed = float(trajectory.s(t, 1, side=side))
        assert float(trajectory.speed_at(s, side=side)) == pytest.approx(speed, abs=1e-7)
    earlier, later = (float(trajectory.time_at(s, side=x)) for x in ("left", "right"))
    assert earlier <= later + 1e-12


@pytest.mark.parametrize("name", NAMES)
@given(share=st.floats(0, 1))
def test_where_the_motion_moves_a_place_has_one_time(name: str, share: float) -> None:
    trajectory = plan(name)
    t = share * trajectory.duration
    for side in ("left", "right"):
        speed = float(trajectory.s(t, 1, side=side))
        if speed > 1e-3:
            found = float(trajectory.time_at(trajectory.s(t), side=side))
            assert found == pytest.approx(t, abs=1e-12 / speed)


@pytest.mark.parametrize("name", NAMES)
@given(shares=st.lists(st.floats(0, 1), min_size=2, max_size=20))
def test_s_never_falls(name: str, shares: list[float]) -> None:
    trajectory = plan(name)
    t = np.sort(shares) * trajectory.duration
    for first, last in (("left", "left"), ("right", "right"), ("left", "right")):
        s, after = trajectory.s(t[:-1], side=first), trajectory.s(t[1:], side=last)
        assert (after - s >= -1e-15).all()
    assert (trajectory.s(t, 1) >= -1e-12).all()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", NAMES)
@given(number=st.floats(0, 1), share=st.floats(0.2, 0.8))
def test_rates_are_differences_of_s(name: str, order: int, number: float, share: float) -> None:
    trajectory = plan(name)
    breaks = trajectory.breaks
    k = min(int(number * (len(breaks) - 1)), len(breaks) - 2)
    width = breaks[k + 1] - breaks[k]
    t, h = breaks[k] + share * width, min(0.05 * width, 1e-4)
    wide, narrow = (
        float(np.diff(trajectory.s([t - x, t + x], order - 1))[0]) / (2 * x) for x in (h, h / 2)
    )
    # Both differences are off by their widths squared; together they are not.
    expected = (4 * narrow - wide) / 3
    rounding = (1e-15 if order == 1 else 1e-14) / h
    assert float(trajectory.s(t, order)) == pytest.approx(expected, rel=1e-6, abs=1e-8 + rounding)


@pytest.mark.parametrize(
    ("name", "path"),
    [("optimal", ROUNDED), ("optimal, sharp", OBJECTIVE), ("smoothed, sharp", OBJECTIVE)],
)
@given(share=st.floats(0, 1))
def test_the_tool_is_at_the_place_then(name: str, path: Path, share: float) -> None:
    s = share * path.length
    trajectory = plan(name)
    point = ARM.forward(trajectory(trajectory.time_at(s)))
    np.testing.assert_allclose(point, path(s), atol=1e-9)


@pytest.mark.parametrize(("name", "path"), [("mac", ROUNDED), ("mac, sharp", OBJECTIVE)])
@given(share=st.floats(0, 1))
def test_laps_are_abreast_of_the_place_then(name: str, path: Path, share: float) -> None:
    s = share * path.length
    trajectory = plan(name)
    off = ARM.forward(trajectory(trajectory.time_at(s))) - path(s)
    assert abs(off @ path(s, 1, side="left" if s > 0 else "right")) < 1e-9
    assert np.linalg.norm(off) < 1e-4  # what "mac" leaves the path by


@pytest.mark.parametrize("name", ["optimal, sharp", "smoothed, sharp", "mac, sharp"])
def test_at_a_corner_the_motion_stands_and_its_acceleration_has_two_sides(name: str) -> None:
    trajectory = plan(name)
    corners = OBJECTIVE.breaks[1:-1]
    t = trajectory.time_at(corners)
    np.testing.assert_allclose(ARM.forward(trajectory(t)), OBJECTIVE(corners), atol=1e-9)
    for side in ("left", "right"):
        speed = trajectory.s(t, 1, side=side)
        np.testing.assert_allclose(speed, 0, atol=1e-4)
        np.testing.assert_allclose(trajectory.speed_at(corners, side=side), speed, atol=1e-6)
    if "smoothed" not in name:
        assert (trajectory.s(t, 2, side="left") < -0.01).all()
        assert (trajectory.s(t, 2, side="right") > 0.01).all()


def test_a_speed_that_jumps_has_two_sides() -> None:
    trajectory = plan("conventional, uneven")
    vertex = UNEVEN.breaks[1]
    assert float(trajectory.speed_at(vertex, side="left")) == 0.05
    assert float(trajectory.speed_at(vertex)) == 0.025
    t = float(trajectory.time_at(vertex))
    assert t == pytest.approx(0.04 / 0.05)
    sides = [float(trajectory.s(t, 1, side=x)) for x in ("left", "right")]
    assert sides == pytest.approx([0.05, 0.025])


@pytest.mark.parametrize("method", ["optimal", "mac", "conventional"])
def test_in_rapids_and_dwells_of_a_program_s_stands_still(method: str) -> None:
    trajectory = plan(f"program, {method}")
    first, second = trajectory.contour_spans
    kinds = [x.kind for x in trajectory.spans]
    assert kinds == ["contour", "dwell", "rapid", "contour"]
    between = ROUNDED.length
    assert float(trajectory.time_at(between)) == pytest.approx(first.t[1], abs=1e-12)
    assert float(trajectory.time_at(between, side="right")) == pytest.approx(second.t[0], abs=1e-12)
    t = np.linspace(first.t[1], second.t[0], 50)
    np.testing.assert_allclose(trajectory.s(t), between, atol=1e-15)
    for order in (1, 2):
        assert (trajectory.s(t[1:-1], order) == 0).all()
    # The tool itself is far away from where it was, and moves.
    q, dq = trajectory(t), trajectory(t, 1)
    assert np.linalg.norm(ARM.tool_velocity(q, dq), axis=1).max() > 0.05


@pytest.mark.parametrize("method", ["optimal", "mac", "conventional"])
def test_a_program_may_stand_at_both_of_its_ends(method: str) -> None:
    moves = (Dwell(duration=0.1), Contour(path=ROUNDED), Dwell(duration=0.2))
    trajectory = ac.plan(Program(moves=moves), ARM, SLOW, method=method)
    ends = np.array([0.0, ROUNDED.length])
    (contour,) = trajectory.contour_spans
    assert trajectory.time_at(ends).tolist() == pytest.approx([0.0, contour.t[1]], abs=1e-12)
    later = trajectory.time_at(ends, side="right")
    assert later.tolist() == pytest.approx([contour.t[0], trajectory.duration], abs=1e-12)
    assert contour.t[0] == 0.1 and trajectory.duration == pytest.approx(contour.t[1] + 0.2)
    assert float(trajectory.speed_at(0.0, side="left")) == 0
    assert float(trajectory.speed_at(ROUNDED.length)) == 0


@pytest.mark.parametrize("method", ["optimal", "mac", "conventional"])
def test_a_program_counts_on_where_its_contours_do(method: str) -> None:
    trajectory = plan(f"program, {method}")
    for span in trajectory.contour_spans:
        assert span.trajectory is not None
        s = np.linspace(0, span.s[1] - span.s[0], 30)[1:-1]
        own = span.t[0] + span.trajectory.time_at(s)
        np.testing.assert_allclose(trajectory.time_at(span.s[0] + s), own, rtol=1e-12)
        speed = span.trajectory.speed_at(s)
        np.testing.assert_allclose(trajectory.speed_at(span.s[0] + s), speed, rtol=1e-9)


@pytest.mark.parametrize("name", ["optimal", "smoothed", "mac", "program, mac"])
def test_answers_have_the_shape_of_the_question(name: str) -> None:
    trajectory = plan(name)
    for shape in ((), (3,), (2, 3), (0,)):
        share = np.full(shape, 0.3)
        for order in (0, 1, 2):
            assert trajectory.s(share * trajectory.duration, order).shape == shape
        assert trajectory.time_at(share * ROUNDED.length).shape == shape
        assert trajectory.speed_at(share * ROUNDED.length).shape == shape
    places = np.array([0.9, 0.1, 0.5]) * ROUNDED.length
    times = [float(trajectory.time_at(s)) for s in places]
    assert trajectory.time_at(places).tolist() == times


# --- refusals


@pytest.mark.parametrize("name", ["time_at", "speed_at"])
def test_arc_lengths_outside_the_path_are_refused(name: str, refuses) -> None:
    trajectory = plan("optimal")
    end = f"{ROUNDED.length:.9g} m"
    for s in (-1e-3, 0.2, [0.01, 0.2]):
        refuses(lambda s=s: getattr(trajectory, name)(s), ac.InvalidInput, "Arc length", end)
    refuses(lambda: getattr(trajectory, name)("far"), ac.InvalidInput, "s must be numbers in m")
    refuses(lambda: getattr(trajectory, name)(np.nan), ac.InvalidInput, "finite")
    refuses(lambda: getattr(trajectory, name)(0.0, side="up"), ac.InvalidInput, "left or right")


def test_times_and_orders_that_there_are_not_are_refused(refuses) -> None:
    trajectory = plan("mac")
    refuses(lambda: trajectory.s(-1.0), ac.InvalidInput, "Time -1 s", "outside the trajectory")
    refuses(lambda: trajectory.s(0.0, 4), ac.InvalidInput, "from 0 to 3, but is 4")
    refuses(lambda: trajectory.s(0.0, side="up"), ac.InvalidInput, "left or right")
    refuses(lambda: trajectory.s("soon"), ac.InvalidInput, "t must be numbers in s, not text")
    refuses(lambda: trajectory("soon"), ac.InvalidInput, "t must be numbers in s, not text")


def test_a_motion_without_a_path_has_no_arc_length(refuses) -> None:
    still = np.zeros((1, 2))
    law = LapLaw(breaks=np.array([0.0, 1.0]), q=np.zeros((2, 2)), dq=still, ddq=still)
    by_hand = ac.Trajectory(laws=(plan("optimal").laws[0], law), method="by hand")
    for ask in (by_hand.s, by_hand.time_at, by_hand.speed_at):
        refuses(lambda ask=ask: ask(0.0), ac.InvalidInput, "Law 2", "plan it along a path")


def test_motions_along_several_paths_have_no_one_arc_length(refuses) -> None:
    laws = plan("optimal").laws * 2
    both = ac.Trajectory(laws=laws, method="by hand")
    refuses(lambda: both.s(0.0), ac.InvalidInput, "Law 2", "0.161 m", "away from the end of law 1")


def test_spans_that_are_not_the_trajectorys_are_refused(refuses) -> None:
    program, other = plan("program, optimal"), plan("program, mac")
    for spans in (program.spans[:-1], program.spans[1:], other.spans, program.spans * 2):
        refuses(
            lambda spans=spans: dataclasses.replace(program, spans=spans),
            ac.InvalidInput,
            "spans of a trajectory must have",
        )
    dwell = Span(move=0, kind="dwell", t=(0.0, 1.0))
    refuses(lambda: dataclasses.replace(program, spans=(dwell,)), ac.InvalidInput, "all of its")


def test_rates_that_do_not_fit_are_refused(refuses) -> None:
    (law,) = plan("optimal").laws
    assert isinstance(law, PathLaw)
    for rates in (np.zeros((4, 3)), Rates(*np.zeros((4, 2))), Rates(0.0, 0.0, 0.0, 0.0)):
        refuses(lambda x=rates: dataclasses.replace(law, rates=x), ac.InvalidInput, "needs Rates")


def test_methods_are_known_by_their_names() -> None:
    assert plan("optimal").method is Method.OPTIMAL
    assert plan("program, mac").method is Method.MAC
    assert plan("conventional").method is Method.CONVENTIONAL
    assert plan("smoothed").method == "optimal, smoothed"
    assert f"{plan('mac').method}" == "mac"
    assert repr(plan("mac")).startswith("Trajectory('mac', ")
