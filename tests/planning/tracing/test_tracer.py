"""Traced paths: tolerances, knots, curvature, and ranges of joints."""

import numpy as np
import pytest

import armcontour as ac

BASE = (0.135, 0.0)
BRANCHES = {"positive": 1, "negative": -1}


def circle(center, radius, phase=0.0):
    start = np.add(center, (radius * np.cos(phase), radius * np.sin(phase)))
    return ac.Path(segments=[ac.Arc(start=start, center=center, angle=2 * np.pi)])


PATHS = {
    "line": ac.Path.polyline([(0.35, 0.1), (0.41, 0.15)]),
    "close past the base": ac.Path.polyline([(-0.2, 0.05), (0.45, 0.05)]),
    "near the far edge": ac.Path.polyline([(0.135, 0.46), (0.30, 0.43)]),
    "full circle": circle((0.3, 0.2), 0.1),
    "around the base": circle(BASE, 0.3, 2.0),
    "tiny": ac.Path.polyline([(0.3, 0.2), (0.3 + 1e-6, 0.2 + 1e-6)]),
    "micro-segments": ac.Path.polyline([(0.3, 0.2), (0.3000001, 0.2), (0.3000002, 0.201)]),
}


def off_path(arm, path, traced):
    s = np.linspace(0, path.length, 20011)
    return np.linalg.norm(arm.tool_position(traced(s)) - path(s), axis=1).max()


@pytest.mark.parametrize("configuration", BRANCHES)
def test_the_tool_stays_on_the_path(arm, rounded, configuration):
    for name, path in (PATHS | {"paper": rounded}).items():
        traced = ac.trace(path, arm, configuration=configuration)
        assert off_path(arm, path, traced) <= 1e-8, name
        assert traced.length == pytest.approx(path.length, rel=1e-14), name
        np.testing.assert_array_equal(traced.stops, path.stops)
        assert traced.tool_path is path
    assert (BRANCHES[configuration] * traced(traced.breaks)[:, 1] > 0).all()


def test_derivatives_of_the_joint_path_agree_with_exact_kinematics(arm):
    for name in ("line", "full circle", "around the base", "close past the base"):
        path = PATHS[name]
        h = 1e-5
        traced = ac.trace(path, arm, tolerance=1e-10)
        s = (path.breaks[:-1, None] + (np.arange(200) + 0.5) / 200 * path.lengths[:, None]).ravel()
        # By differences of the closed-form inverse along the path itself.
        before, now, after = (
            np.unwrap(arm.joint_position(path(s + k * h)), axis=0) for k in (-1, 0, 1)
        )
        first = (after - before) / (2 * h)
        second = (after - 2 * now + before) / h**2
        for k, expected, near in ((1, first, 1e-5), (2, second, 1e-3)):
            near = near * np.abs(expected).max() + (k - 1) * 1e-4
            np.testing.assert_allclose(traced(s, k), expected, atol=near, err_msg=name)


def test_corners_are_two_sided_and_the_turn_of_an_arc_jumps_in_the_second_derivative(
    arm, rounded, traced, objective
):
    s = rounded.breaks[1]
    q = traced(s)
    jump = traced(s, 2) - traced(s, 2, side="left")
    np.testing.assert_allclose(traced(s, 1, side="left"), traced(s, 1), atol=1e-9)
    curvature = np.linalg.solve(arm.tool_jacobian(q), rounded(s, 2, side="right"))
    np.testing.assert_allclose(jump, curvature, rtol=1e-6)
    sharp = ac.trace(objective, arm)
    for s in objective.stops:
        for side in ("left", "right"):
            tool = arm.tool_jacobian(sharp(s)) @ sharp(s, 1, side=side)
            np.testing.assert_allclose(tool, objective(s, 1, side=side), atol=1e-9)


@pytest.mark.parametrize("configuration", BRANCHES)
def test_full_turns_are_unwrapped(arm, configuration):
    for turns in (1, -1, 3):
        angle = np.sign(turns) * 2 * np.pi
        start = np.add(BASE, (0.3, 0.0))
        path = ac.Path(segments=[ac.Arc(start=start, center=BASE, angle=angle)] * abs(turns))
        traced = ac.trace(path, arm, configuration=configuration)
        # Joint angles count clockwise: one circle about the base turns joint 1, leaves joint 2.
        moved = traced(path.length) - traced(0.0)
        np.testing.assert_allclose(moved, (-2 * np.pi * turns, 0), atol=1e-9)
        s = np.linspace(0, path.length, 5001)
        assert np.abs(np.diff(traced(s), axis=0)).max() < 0.01
    # The vertices of a lone circle span nothing, or what rounding leaves: they set no grid.
    for phase in (0.0, 0.1, 1.0, 2.0):
        assert len(ac.trace(circle((0.3, 0.2), 0.1, phase), arm).breaks) < 500


def test_unreachable_points_are_found_and_named(arm):
    path = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.9, 0.15)])
    with pytest.raises(ac.Unreachable) as caught:
        ac.trace(path, arm)
    error = caught.value
    assert str(error).startswith(f"At {error.s:.6g} m along the path: Point (")
    assert error.index == 1 and error.limit == "reach"
    np.testing.assert_allclose(path(error.s), error.point, atol=1e-12)
    assert error.needed == pytest.approx(np.hypot(error.point[0] - 0.135, error.point[1]))
    assert error.allowed == pytest.approx(0.465) and error.needed > error.allowed
    for points, s, near, words in (
        # 1 mm into the hole around the base, over a way shorter than the first knots' spacing.
        ([(-0.1, 0.034), (0.41, 0.034)], 0.235, 0.01, "m along the path"),
        # To the edge of the reach.
        ([(0.135, 0.3), (0.135, 0.465)], 0.165, 1e-7, "singular"),
        # A tangent to the outer edge: it stays within reach but for one point.
        ([(0.0, 0.465), (0.135, 0.465), (0.2, 0.3)], None, None, None),
    ):
        with pytest.raises(ac.Unreachable, match=words) as caught:
            ac.trace(ac.Path.polyline(points), arm)
        assert s is None or caught.value.s == pytest.approx(s, abs=near)


def test_wrong_paths_and_options_are_refused(arm, refuses):
    line = PATHS["line"]
    for path, options in (
        (ac.Path.polyline([(0.3, 0.2, 0.0), (0.4, 0.2, 0.0)]), {}),
        (line, {"tolerance": 0.0}),
        (line, {"tolerance": np.nan}),
        (line, {"configuration": "up"}),
    ):
        refuses(lambda x=path, y=options: ac.trace(x, arm, **y), ac.InvalidInput)


DOWN = np.diag([1.0, -1.0, -1.0])
POINTS = [(0.40, 0.0, 0.2), (0.5, 0.0, 0.2), (0.5, 0.1, 0.2), (0.4, 0.1, 0.25)]


def paths():
    path = ac.Path.polyline(POINTS)
    turned = [ac.core.frames.from_rpy((0.1 * i, 0, 0.2 * i)) @ DOWN for i in range(4)]
    flat = ac.Path.polyline([(*x[:2], 0.2) for x in POINTS])
    return {
        "fixed": path.oriented(DOWN),
        "turning": path.oriented(turned),
        "axis": path.pointing([(0, 0, -1), (0, 0.1, -1), (0.1, 0.1, -1), (0, 0.3, -1)]),
        "following": flat.following_tangent((0, 0, 1)),
    }
