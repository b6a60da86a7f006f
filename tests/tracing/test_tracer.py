"""Tracing: the tool stays on the path, derivatives are right, and what cannot be traced."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac

BASE = (0.135, 0.0)
BRANCHES = ("positive", "negative")


def circle(center, radius, angle=2 * np.pi, phase=0.0):
    start = np.add(center, (radius * np.cos(phase), radius * np.sin(phase)))
    return ac.Path.from_segments([ac.Arc(start=start, center=center, angle=angle)])


PATHS = {
    "line": ac.Path.polyline([(0.35, 0.1), (0.41, 0.15)]),
    "close past the base": ac.Path.polyline([(-0.2, 0.05), (0.45, 0.05)]),
    "near the far edge": ac.Path.polyline([(0.135, 0.46), (0.30, 0.43)]),
    "full circle": circle((0.3, 0.2), 0.1),
    "around the base": circle(BASE, 0.3, 2 * np.pi, 2.0),
    "tiny": ac.Path.polyline([(0.3, 0.2), (0.3 + 1e-6, 0.2 + 1e-6)]),
    "micro-segments": ac.Path.polyline([(0.3, 0.2), (0.3000001, 0.2), (0.3000002, 0.201)]),
}


def inside(path, count):
    """Arc lengths between the joints of a path."""
    shares = (np.arange(count) + 0.5) / count
    return (path.breaks[:-1, None] + shares * path.lengths[:, None]).ravel()


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("name", PATHS)
def test_the_tool_stays_on_the_path(arm, name, branch):
    path = PATHS[name]
    traced = ac.trace(path, arm, branch=branch)
    s = np.linspace(0, path.length, 20011)
    off = np.linalg.norm(arm.forward(traced(s)) - path(s), axis=1)
    assert off.max() <= 1e-8
    assert traced.length == pytest.approx(path.length, rel=1e-14)
    np.testing.assert_array_equal(traced.stops, path.stops)
    assert traced.tool_path is path


@pytest.mark.parametrize("branch", BRANCHES)
def test_it_stays_on_the_papers_path(arm, rounded, branch):
    traced = ac.trace(rounded, arm, branch=branch)
    s = np.linspace(0, rounded.length, 20011)
    assert np.linalg.norm(arm.forward(traced(s)) - rounded(s), axis=1).max() <= 1e-8
    sign = 1 if branch == "positive" else -1
    assert (sign * traced(s)[:, 1] > 0).all()


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-10])
def test_the_tolerance_is_kept_and_not_overdone(arm, tolerance):
    path = PATHS["close past the base"]
    traced = ac.trace(path, arm, tolerance=tolerance)
    s = np.linspace(0, path.length, 20011)
    assert np.linalg.norm(arm.forward(traced(s)) - path(s), axis=1).max() <= tolerance
    finer = ac.trace(path, arm, tolerance=tolerance / 100)
    assert len(finer.breaks) > len(traced.breaks)


@pytest.mark.parametrize("name", ["line", "full circle", "around the base", "close past the base"])
def test_derivatives_agree_with_exact_kinematics(arm, name):
    path = PATHS[name]
    traced = ac.trace(path, arm, tolerance=1e-10)
    s = inside(path, 200)
    h = 1e-5
    # By differences of the closed-form inverse along the path itself.
    before, now, after = (np.unwrap(arm.inverse(path(s + k * h)), axis=0) for k in (-1, 0, 1))
    scale = np.abs(traced(s, 1)).max()
    np.testing.assert_allclose(traced(s, 1), (after - before) / (2 * h), atol=1e-5 * scale)
    second = (after - 2 * now + before) / h**2
    np.testing.assert_allclose(traced(s, 2), second, atol=1e-4 + 1e-3 * np.abs(second).max())


def test_the_turn_of_an_arc_jumps_in_the_second_derivative(arm, rounded, traced):
    at = rounded.breaks[1]
    left, right = traced(at, 2, side="left"), traced(at, 2, side="right")
    q, dq_ds = traced(at), traced(at, 1)
    np.testing.assert_allclose(traced(at, 1, side="left"), dq_ds, atol=1e-9)
    curvature = np.linalg.solve(arm.jacobian(q), rounded(at, 2, side="right"))
    np.testing.assert_allclose(right - left, curvature, rtol=1e-6)


def test_a_sharp_corner_is_two_sided(arm, objective):
    traced = ac.trace(objective, arm)
    for at in objective.stops:
        for side in ("left", "right"):
            tool = arm.jacobian(traced(at)) @ traced(at, 1, side=side)
            np.testing.assert_allclose(tool, objective(at, 1, side=side), atol=1e-9)


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("turns", [1, -1, 3])
def test_full_turns_are_unwrapped(arm, branch, turns):
    angle = np.sign(turns) * 2 * np.pi
    start = np.add(BASE, (0.3, 0.0))
    path = ac.Path.from_segments([ac.Arc(start=start, center=BASE, angle=angle)] * abs(turns))
    traced = ac.trace(path, arm, branch=branch)
    # Joint angles count clockwise: one circle about the base turns joint 1 and leaves joint 2.
    moved = traced(path.length) - traced(0.0)
    np.testing.assert_allclose(moved, (-2 * np.pi * turns, 0), atol=1e-9)
    s = np.linspace(0, path.length, 5001)
    assert np.abs(np.diff(traced(s), axis=0)).max() < 0.01


@pytest.mark.parametrize("phase", [0.0, 0.1, 1.0, 2.0])
def test_a_lone_circle_starts_with_a_sensible_grid(arm, phase):
    # Its vertices span nothing, or what rounding leaves: that must not set the grid.
    traced = ac.trace(circle((0.3, 0.2), 0.1, phase=phase), arm)
    assert len(traced.breaks) < 500


def test_out_of_reach_names_the_place(arm, refuses):
    path = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.9, 0.15)])
    with pytest.raises(ac.Unreachable) as caught:
        ac.trace(path, arm)
    error = caught.value
    assert str(error).startswith(f"At {error.s:.6g} m along the path: Point (")
    assert "out of reach of the arm PMK-3s" in str(error)
    assert error.index == 1 and error.limit == "reach"
    np.testing.assert_allclose(path(error.s), error.point, atol=1e-12)
    assert error.needed == pytest.approx(np.hypot(error.point[0] - 0.135, error.point[1]))
    assert error.allowed == pytest.approx(0.465) and error.needed > error.allowed


def test_a_short_stretch_out_of_reach_is_found(arm):
    # It dips 1 mm into the hole around the base, over a way shorter than the first knots' spacing.
    path = ac.Path.polyline([(-0.1, 0.034), (0.41, 0.034)])
    with pytest.raises(ac.Unreachable) as caught:
        ac.trace(path, arm)
    assert caught.value.s == pytest.approx(0.235, abs=0.01)
    assert "m along the path" in str(caught.value)


def test_the_edge_of_the_reach_is_singular(arm):
    path = ac.Path.polyline([(0.135, 0.3), (0.135, 0.465)])
    with pytest.raises(ac.Unreachable, match="singular") as caught:
        ac.trace(path, arm)
    assert caught.value.s == pytest.approx(0.165)
    assert caught.value.point == pytest.approx((0.135, 0.465))


def test_touching_the_edge_on_the_way_is_singular(arm):
    # A tangent to the outer edge: it stays within reach but for one point.
    path = ac.Path.polyline([(0.0, 0.465), (0.135, 0.465), (0.2, 0.3)])
    with pytest.raises(ac.Unreachable):
        ac.trace(path, arm)


@pytest.mark.parametrize(
    ("path", "options", "words"),
    [
        (
            ac.Path.polyline([(0.3, 0.2, 0.0), (0.4, 0.2, 0.0)]),
            {},
            ("path has 3 coordinates", "PMK-3s", "moves in 2"),
        ),
        (PATHS["line"], {"tolerance": 0.0}, ("tracing tolerance", "above zero")),
        (PATHS["line"], {"tolerance": np.nan}, ("tracing tolerance", "finite")),
        (PATHS["line"], {"branch": "up"}, ("branches positive, negative", "'up'")),
    ],
)
def test_refused(arm, path, options, words, refuses):
    refuses(lambda: ac.trace(path, arm, **options), ac.InvalidInput, *words)
