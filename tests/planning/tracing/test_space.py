"""Tracing in space: exact knots, all configurations, redundancy, and refusals."""

import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.core.frames import Frame, exp, log
from armcontour.planning.tracing import trace_all
from armcontour.robot import Chain, SerialArm
from armcontour.robot.inverse_kinematics import configurations

DOWN = np.diag([1.0, -1.0, -1.0])
POINTS = [(0.4, -0.2, 0.3), (0.5, -0.1, 0.35), (0.5, 0.2, 0.3), (0.4, 0.25, 0.4)]
# A torch of 0.2 m, bent by 45°.
TORCH = Frame.rpy([0.085, 0, 0.165], [0, np.pi / 4, 0])


@pytest.fixture(scope="module")
def ur5e():
    return ac.load_arm("ur5e")


@pytest.fixture(scope="module")
def panda():
    return ac.load_arm("panda")


def paths():
    base = ac.Path.polyline(POINTS)
    turns = Rotation.from_rotvec([[0, 0, 0], [0.2, 0.1, 0.3], [0, 0.3, 0.1], [0.1, 0, -0.2]])
    curve = ac.Path.spline(POINTS, tolerance=1e-5)
    kinds = {
        "held": base.oriented(DOWN),
        "per waypoint": base.oriented(turns * Rotation.from_matrix(DOWN)),
        "following": base.following_tangent([0, 0, 1]),
        "axis": base.pointing([0.1, 0, -1]),
        "axis per waypoint": base.pointing([(0, 0, -1), (0.2, 0, -1), (0, 0.2, -1), (0, 0, -1)]),
        "axis following": base.following_tangent([0, 0, 1], axis_only=True),
        "spline": curve.following_tangent([0, 0, 1], axis_only=True),
    }
    return {
        name: ac.round_corners(path, tolerance=0.01, angular_tolerance=0.1)
        for name, path in kinds.items()
    } | {"stopping": base.pointing([(0, 0, -1), (0.2, 0, -1), (0, 0.2, -1), (0, 0, -1)])}


PATHS = paths()
CASES = [("ur5e", x) for x in PATHS] + [("panda", x) for x in PATHS]
CASES += [("ur10e", "per waypoint"), ("ur10e", "axis per waypoint")]


def off_path(arm, path, traced, s, sides="right"):
    """How far the tool is from its place and its orientation [m], [rad]."""
    q = traced(s, side=sides)
    points, rotations = arm.pose(q)
    expected = path.orientation(s, side=sides)
    if path.orientation.axis_only:
        turned = np.linalg.norm(rotations[:, :, 2] - expected[:, :, 2], axis=1)
    else:
        turned = np.linalg.norm(log(rotations @ np.swapaxes(expected, 1, 2)), axis=1)
    return np.linalg.norm(points - path(s), axis=1).max(), turned.max()


def places(path, traced):
    random = np.random.default_rng(0).uniform(0, path.length, 1000)
    return np.concatenate([random, traced.breaks])


def is_on_path(arm, path, traced):
    return max(off_path(arm, path, traced, places(path, traced))) < 2e-9


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_the_tool_stays_on_its_path_and_the_joints_in_their_ranges(name, kind):
    arm = ac.load_arm(name)
    path = PATHS[kind]
    candidates = trace_all(path, arm)
    lower, upper = arm.limits.joint_range(arm.dof)
    for traced in candidates:
        point, turn = off_path(arm, path, traced, places(path, traced))
        assert point < 2e-10 and turn < 2e-9
        # At knots it is exact, from both sides.
        for side in ("left", "right"):
            point, turn = off_path(arm, path, traced, traced.breaks, side)
            assert point < 1e-12 and turn < 1e-12
        q = traced(places(path, traced))
        assert (q >= lower).all() and (q <= upper).all()
        inner = traced.breaks[1:-1]
        jump = np.abs(traced(inner) - traced(inner, side="left")).max()
        assert jump < 1e-9
    # They are different, and the first is the shortest.
    middle = np.array([x(path.length / 2) for x in candidates])
    apart = np.abs(middle[:, None] - middle[None]).max(axis=2) + 10 * np.eye(len(candidates))
    assert apart.min() > 1e-3
    # Derivatives are those of the joint positions and of the tool.
    traced = ac.trace(path, arm)
    np.testing.assert_array_equal(traced.breaks, candidates[0].breaks)
    for side, sign in (("left", -1), ("right", 1)):
        s = traced.breaks[1:] if side == "left" else traced.breaks[:-1]
        q, dq, ddq = (traced(s, k, side=side) for k in range(3))
        # The tool's velocity and acceleration over arc length, by the arm's own Jacobian.
        twist = arm.tool_twist(q, dq)
        change = arm.tool_twist_rate(q, dq, ddq)
        size = 1 + np.abs(change).max()
        np.testing.assert_allclose(twist[:, :3], path(s, 1, side=side), atol=1e-9)
        np.testing.assert_allclose(change[:, :3], path(s, 2, side=side), atol=1e-9 * size)
        rate, bend = path.orientation.rates(s, side=side)
        twists = [(twist[:, 3:], change[:, 3:]), (rate, bend)]
        if path.orientation.axis_only:
            # How the tool axis moves: turning about itself does not count.
            axis = path.orientation(s, side=side)[:, :, 2]
            moves = [np.cross(w, axis) for w, _ in twists]
            bends = [np.cross(b, axis) + np.cross(w, np.cross(w, axis)) for w, b in twists]
        else:
            moves, bends = zip(*twists, strict=True)
        np.testing.assert_allclose(*moves, atol=1e-9 * (1 + np.abs(rate).max()))
        np.testing.assert_allclose(*bends, atol=1e-9 * size)
        # And they are derivatives of the joint positions that are returned.
        h = 1e-3 * np.diff(traced.breaks)[:, None] * sign
        before = traced(s)
        after = traced(s + h[:, 0])
        cubic = np.abs(after - before - h * dq - h**2 / 2 * ddq).max()
        assert cubic < 1e-6 * max(1.0, np.abs(h**2 * ddq).max())


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_redundant_joints_move_smoothly_between_stops(name):
    arm = ac.load_arm(name)
    for kind in ("axis per waypoint", "axis following", "stopping"):
        path = PATHS[kind]
        traced = ac.trace(path, arm)
        inner = traced.breaks[1:-1]
        moving = inner[~np.isin(inner, path.stops)]
        # The second derivative jumps only where the path's own curvature or rate of turning does.
        plain = moving[~np.isin(moving, np.union1d(path.breaks, path.orientation.breaks))]
        assert len(plain) > 20
        for order, s in ((1, moving), (2, plain)):
            before, right = (traced(s, order, side=side) for side in ("left", "right"))
            near = (1e-9 if order == 1 else 1e-8) * (1 + np.abs(before).max())
            np.testing.assert_allclose(before, right, atol=near, err_msg=kind)
        np.testing.assert_array_equal(traced.stops, path.stops)
        assert (len(path.stops) > 0) == (kind == "stopping")


def test_a_seed_selects_the_configuration_and_the_turn(ur5e):
    path = PATHS["held"]
    candidates = trace_all(path, ur5e)
    assert len(candidates) == 8
    for traced in candidates:
        start = traced(0.0) + 0.02
        np.testing.assert_allclose(ac.trace(path, ur5e, seed=start)(0.0), traced(0.0), atol=1e-9)
    # Six of the joints turn by two turns, so that the start may be another turn away.
    start = candidates[0](0.0)
    start[5] += -2 * np.pi if start[5] > 0 else 2 * np.pi
    again = ac.trace(path, ur5e, seed=start)
    np.testing.assert_allclose(again(0.0), start, atol=1e-9)
    np.testing.assert_allclose(again(path.length)[:5], candidates[0](path.length)[:5], atol=1e-9)


def test_a_refused_seed_names_one_that_works(ur5e, refuses):
    path = ac.Path.polyline([(0.8, 0, 0.3), (0.75, 0, 0.3)]).oriented(DOWN)
    pose = np.column_stack([DOWN, path(0.0)])
    random = np.random.default_rng(0)
    starts = (random.uniform(-np.pi, np.pi, 6) for _ in range(500))
    start = next(q for q in starts if len(configurations(ur5e, pose, 6, q)) == 0)
    with pytest.raises(ac.Unreachable, match="From the given seed") as caught:
        ac.trace(path, ur5e, seed=start)
    error = caught.value
    assert error.limit == "seed" and error.s == 0 and error.needed > 0.1
    np.testing.assert_allclose(error.point, (0.8, 0, 0.3))
    better = [float(x) for x in str(error).split("such as (")[1].split(")")[0].split(",")]
    np.testing.assert_allclose(ac.trace(path, ur5e, seed=better)(0.0), better, atol=1e-4)
    refuses(lambda: ac.trace(path, ur5e, seed=[0.0] * 5), ac.InvalidInput)
    degrees = (0, -90, 90, -90, -90, 0)
    refuses(lambda: ac.trace(path, ur5e, seed=degrees), ac.InvalidInput, joint=1)


def test_a_waypoint_one_millimetre_out_of_reach_is_refused(ur5e):
    """How far the arm gets along x with the tool down, in any configuration, by bisection."""
    edge = 0.6
    high = 1.2
    for _ in range(40):
        middle = (edge + high) / 2
        pose = np.column_stack([DOWN, [middle, 0, 0.3]])
        edge, high = (middle, high) if len(configurations(ur5e, pose, 6)) else (edge, middle)
    beyond = (edge + 1e-3, 0, 0.3)
    path = ac.Path.polyline([(0.5, 0, 0.3), beyond, (0.5, 0.1, 0.3)])
    with pytest.raises(ac.Unreachable, match="out of reach of the arm UR5e") as caught:
        ac.trace(path.oriented(DOWN), ur5e)
    error = caught.value
    assert error.limit == "reach" and error.allowed == 0
    assert error.needed == pytest.approx(1e-3, rel=0.1)  # it may turn by a little for it
    assert error.s == pytest.approx(edge - 0.5, abs=1e-5) and f"From {error.s:.6g} m" in str(error)
    np.testing.assert_allclose(error.point, beyond, atol=1e-9)
    with pytest.raises(ac.Unreachable, match="At 0 m along the path") as caught:
        ac.trace(ac.Path.polyline([beyond, (0.5, 0, 0.3)]).oriented(DOWN), ur5e)
    assert caught.value.needed == pytest.approx(1e-3, rel=0.1)
    # Ten micrometres inside, the arm goes there: fast in its joints, but it goes.
    path = ac.Path.polyline([(0.5, 0, 0.3), (edge - 1e-5, 0, 0.3)]).oriented(DOWN)
    traced = ac.trace(path, ur5e)
    assert is_on_path(ur5e, path, traced) and np.abs(traced(path.length, 1)).max() > 100


def test_the_wrist_turns_fast_near_its_singularity_and_a_path_through_it_is_refused(ur5e):
    q = np.array([0.3, -1.2, 1.5, -0.6, 0.0, 0.4])  # the fifth joint at zero: two axes in line
    point, rotation = ur5e.pose(q)
    lost = np.linalg.svd(ur5e.jacobian(q))[0][:, -1]  # what the tool cannot do there
    ends = 0.05 * np.array([[-1.0], [1.0]])
    points = point + ends * lost[:3]
    turns = exp(ends * lost[3:]) @ rotation
    fastest = []
    start = None
    for aside in (1e-2, 1e-3, 1e-4):
        beside = ac.Path.polyline(points + [0, 0, aside])
        path = beside.oriented(exp(aside * np.cross(lost[3:], [0.3, 0.4, 0.5])) @ turns)
        candidates = trace_all(path, ur5e)
        assert len(candidates) == 8
        assert is_on_path(ur5e, path, candidates[-1])
        fastest.append(np.abs(candidates[-1](places(path, candidates[-1]), 1)).max())
        start = candidates[-1](0.0)
    assert fastest[1] > 5 * fastest[0] and fastest[2] > 5 * fastest[1] > 1e4
    # Exactly through it, four of the eight configurations get to the end, and this is not one.
    through = ac.Path.polyline(points).oriented(turns)
    assert len(trace_all(through, ur5e)) == 4
    with pytest.raises(ac.Unreachable, match="singular") as caught:
        ac.trace(through, ur5e, seed=start)
    error = caught.value
    assert error.limit == "singularity"
    assert error.s == pytest.approx(through.length / 2, abs=0.003)


def test_an_arm_with_five_joints_follows_a_tool_axis_but_no_orientation(refuses):
    random = np.random.default_rng(1)
    axes = random.normal(size=(5, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turns = exp(random.normal(size=(5, 3)))
    positions = 0.3 * random.normal(size=(5, 3))
    chain = Chain(joints=tuple("abcde"), rotations=turns, positions=positions, axes=axes)
    arm = SerialArm(name="five", chain=chain, limits=ac.Limits.only(joint_velocity=1.0))
    points, rotations = arm.pose(np.array([[0.3, 0.2, 0.5, 0.7, 0.1], [0.35, 0.25, 0.5, 0.7, 0.1]]))
    path = ac.Path.polyline(points)
    refuses(lambda: ac.trace(path.oriented(rotations), arm), ac.InvalidInput, "5 joints", "6")
    pointed = path.pointing(rotations[:, :, 2])
    candidates = trace_all(pointed, arm)
    assert len(candidates) >= 1 and all(is_on_path(arm, pointed, x) for x in candidates)


def test_invalid_orientations_and_corners_are_refused(ur5e, refuses):
    path = ac.Path.polyline(POINTS)
    sharp = path.following_tangent([0, 0, 1])
    # The message does not suggest rounding for a corner that rounding left sharp.
    begin = (0.4, 0, 0.2)
    turn = (0.4 + 0.1 * np.sin(1), 0.1 - 0.1 * np.cos(1), 0.2)
    arc = ac.Arc(start=begin, center=(0.4, 0.1, 0.2), angle=1.0, normal=(0, 0, 1))
    lifted = ac.Path(segments=[arc, ac.Line(start=turn, end=(0.5, 0, 0.3))])
    lifted = lifted.following_tangent([0, 0, 1])
    lifted = ac.round_corners(lifted, tolerance=1e-3, angular_tolerance=0.1)
    parallel = {
        "axes": np.tile([0.0, 0.0, 1.0], (3, 1)),
        "rotations": np.tile(np.eye(3), (3, 1, 1)),
    }
    parallel["positions"] = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0, 0]])

    def flat_arm(n):
        """Return an arm with the first joints of `parallel`."""
        values = {name: x[:n] for name, x in parallel.items()}
        chain = Chain(joints=tuple("abc"[:n]), **values)
        return SerialArm(name="flat", chain=chain, limits=ac.Limits())

    two = flat_arm(2)
    scara = flat_arm(3)
    level = ac.Path.polyline([(0.50, 0.10, 0.0), (0.55, 0.15, 0.0)])
    for motion, arm, options, words, data in (
        (path, ur5e, {}, "path.oriented", {}),
        (ac.Path.polyline([(0.4, 0), (0.5, 0)]), ur5e, {}, "2 coordinates", {}),
        (sharp, ur5e, {}, "Round the corner", {"s": sharp.breaks[1], "point": POINTS[1]}),
        (lifted, ur5e, {}, "do not lie in one plane", {}),
        (path.oriented(DOWN), ur5e, {"configuration": "up"}, "no named branches", {}),
        (level, two, {}, "2 joints", {}),
        (level, scara, {}, "parallel", {}),
    ):
        call = functools.partial(ac.trace, motion, arm, **options)
        refuses(call, ac.InvalidInput, words, **data)


def test_sharp_corners_are_stops_and_corners_next_to_arcs_are_rounded(ur5e):
    path = ac.Path.polyline(POINTS).oriented(DOWN)
    traced = ac.trace(path, ur5e)
    np.testing.assert_array_equal(traced.stops, path.breaks[1:-1])
    before, after = (traced(path.breaks[1], 1, side=side) for side in ("left", "right"))
    assert np.abs(before - after).max() > 0.1
    line = ac.Line(start=(0.4, -0.1, 0.2), end=(0.5, -0.1, 0.2))
    arc = ac.Arc.through((0.5, -0.1, 0.2), (0.57, -0.08, 0.2), (0.6, 0.0, 0.2))
    path = ac.Path(segments=[line, arc]).following_tangent((0, 0, 1))
    rounded = ac.round_corners(path, tolerance=1e-3, angular_tolerance=0.02)
    assert len(ac.trace(rounded, ur5e).stops) == 0
    with pytest.raises(ac.InvalidInput, match="at a sharp corner. Round the corner"):
        ac.trace(path, ur5e)


def test_a_weld_seam_around_a_tube_requires_a_free_tool_axis(ur5e):
    arm = ur5e.with_tool(TORCH)
    center = np.array([0.45, 0.0, 0.35])
    up = np.array([0.0, 0.0, 1.0])
    seam = ac.Path(
        segments=[ac.Arc.circle(start=center + 0.08 * up, center=center, normal=(0, 1, 0))]
    )
    with pytest.raises(ac.Unreachable, match="out of reach") as caught:
        ac.trace(seam.following_tangent(up), arm)
    assert caught.value.s / seam.length == pytest.approx(0.62, abs=0.01)
    free = seam.following_tangent(up, axis_only=True)
    candidates = trace_all(free, arm)
    assert len(candidates) >= 6
    s = np.linspace(0, seam.length, 500)
    lower, upper = arm.limits.joint_range(6)
    for traced in candidates:
        points, rotations = arm.pose(traced(s))
        inward = center - points
        np.testing.assert_allclose(np.linalg.norm(inward, axis=1), 0.08, atol=1e-9)
        np.testing.assert_allclose(rotations[:, :, 2], inward / 0.08, atol=1e-8)
        assert (traced(s) >= lower).all() and (traced(s) <= upper).all()
