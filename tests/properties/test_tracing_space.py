"""Any path in space is traced within its tolerance or refused with a reason."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.core.frames import Frame, log
from armcontour.planning.tracing import trace_all

DOWN = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
REACH = {"ur5e": 0.35, "panda": 0.3, "ur10e": 0.5}
KINDS = ["held", "per waypoint", "axis per waypoint", "pointing", "following", "axis following"]
TORCH = Frame.rpy([0.05, 0, 0.15], [0, 0.7, 0])
# Tests of random paths.
BATCHES = 2
# Random paths per test.
PATHS = 7


def random_path(rng, reach):
    """A path somewhere around the arm, with what user files have in them."""
    center = rng.uniform([-1, -1, 0], [1, 1, 1])
    center *= rng.uniform(0.8, 1.4) * reach / np.linalg.norm(center[:2])
    center[2] = rng.uniform(0, 0.5)
    size = 10.0 ** rng.uniform(-2.5, -0.5)
    n = int(rng.integers(2, 8))
    points = center + size * rng.uniform(-1, 1, (n, 3))
    for i in range(1, n):
        kind = rng.random()
        if kind < 0.08:  # repeated
            points[i] = points[i - 1]
        elif kind < 0.15:  # micro-segment
            points[i] = points[i - 1] + 10.0 ** rng.uniform(-8, -4) * rng.normal(size=3)
        elif kind < 0.22 and i > 1:  # straight on
            points[i] = points[i - 1] + rng.uniform(0.2, 2) * (points[i - 1] - points[i - 2])
        elif kind < 0.25 and i > 1:  # straight back
            points[i] = points[i - 2]
    shape = rng.choice(["lines", "spline", "arc"], p=[0.5, 0.25, 0.25])
    if shape == "spline":
        return ac.Path.spline(points, tolerance=1e-5), size
    if shape == "arc":
        start, via, end = center + size * rng.uniform(-1, 1, (3, 3))
        return ac.Path(segments=[ac.Arc.through(start, via, end)]), size
    return ac.Path.polyline(points), size


def with_orientation(rng, path):
    held = Rotation.from_rotvec(0.5 * rng.normal(size=3)) * DOWN
    count = len(path.waypoints)
    kind = rng.choice(KINDS)
    turns = Rotation.from_rotvec(10.0 ** rng.uniform(-3, -0.3) * rng.normal(size=(count, 3)))
    if kind == "held":
        return path.oriented(held)
    if kind in ("per waypoint", "axis per waypoint"):
        return path.oriented(turns * held, axis_only=kind == "axis per waypoint")
    if kind == "pointing":
        return path.pointing(held.as_matrix()[:, 2] + 0.2 * rng.normal(size=(count, 3)))
    return path.following_tangent(rng.normal(size=3), axis_only=kind == "axis following")


def judge(arm, path, traced):
    """Every promise of a joint path, at random places and at its knots."""
    s = np.concatenate([np.random.default_rng(0).uniform(0, path.length, 300), traced.breaks])
    q = traced(s)
    points, rotations = arm.pose(q)
    assert np.linalg.norm(points - path(s), axis=1).max() < 2e-10
    expected = path.orientation(s)
    if path.orientation.axis_only:
        errors = np.linalg.norm(rotations[:, :, 2] - expected[:, :, 2], axis=1)
    else:
        errors = np.linalg.norm(log(rotations @ np.swapaxes(expected, 1, 2)), axis=1)
    assert errors.max() < 3e-9
    lower, upper = arm.limits.joint_range(arm.dof)
    assert (q >= lower - 1e-8).all() and (q <= upper + 1e-8).all()
    assert set(path.stops) <= set(traced.stops)


@pytest.mark.parametrize("batch", range(BATCHES))
def test_random_paths_are_traced_or_refused_with_a_reason(batch):
    traced = 0
    for seed in range(PATHS):
        rng = np.random.default_rng([batch, seed])
        name = rng.choice(list(REACH))
        arm = ac.load_arm(name)
        if rng.random() < 0.4:
            arm = arm.with_tool(TORCH)
        try:
            path, size = random_path(rng, REACH[name])
            path = with_orientation(rng, path)
            tolerance = rng.choice([0.0, size * 10.0 ** rng.uniform(-3, 0)])
            angular = 10.0 ** rng.uniform(-4, -0.3)
            path = ac.round_corners(path, tolerance=tolerance, angular_tolerance=angular)
            candidates = trace_all(path, arm)
        except ac.ArmContourError as error:
            message = str(error)
            assert message.endswith(".") and "\n" not in message and "nan" not in message
            if isinstance(error, ac.Unreachable):
                assert error.s is not None and error.point is not None
                assert message.count(". ")  # the last sentence states a remedy
            continue
        for x in candidates:
            judge(arm, path, x)
        traced += 1
    assert traced > 0.4 * PATHS


def test_turn_within_nanometres_is_refused_at_its_arc_length():
    arm = ac.load_arm("ur5e")
    points = [(0.4, 0, 0.4), (0.5, 0, 0.4), (0.5, 3e-9, 0.4), (0.5, 0.1, 0.4)]
    turns = DOWN * Rotation.from_rotvec([[0, 0, 0], [0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])
    path = ac.Path.polyline(points).oriented(turns)
    path = ac.round_corners(path, tolerance=1e-3, angular_tolerance=0.1)
    with pytest.raises(ac.Unreachable) as caught:
        ac.trace(path, arm)
    assert caught.value.s == pytest.approx(0.1, abs=1e-6)
