"""Inverse kinematics of control points, against finite differences."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.planning.shaping.kinematics import NearPath

DOWN = np.diag([1.0, -1.0, -1.0])
IN_SPACE = [(0.45, -0.05, 0.35), (0.52, 0.0, 0.38), (0.50, 0.06, 0.36)]
STEP = 1e-6


def near(name):
    """The inverse kinematics near three points, with the arc lengths and their path."""
    arm = ac.load_arm("ur5e" if name == "axis" else name)
    s = np.array([0.01, 0.05, 0.1])
    if arm.dimension == 2:
        path = ac.Path.polyline([(0.30, 0.15), (0.42, 0.15), (0.42, 0.25)])
        q = ac.trace(path, arm, configuration="positive")(s)
        return NearPath.along(q, arm, "positive", path, s), path, s
    path = ac.Path.polyline(IN_SPACE)
    path = path.pointing((0.0, 0.0, -1.0)) if name == "axis" else path.oriented(DOWN)
    return NearPath.along(ac.trace(path, arm)(s), arm, None, path, s), path, s


@pytest.fixture(scope="module", params=["pmk3s", "ur5e", "axis", "panda"])
def case(request):
    return near(request.param)


def test_the_tool_reaches_points_and_redundant_joints_stay_near_those_of_the_path(case):
    kinematics, path, s = case
    np.testing.assert_allclose(
        kinematics.solve(path(s), kinematics.q + 1e-3), kinematics.q, atol=1e-7
    )
    points = path(s) + 1e-3
    q = kinematics.solve(points, kinematics.q)
    np.testing.assert_allclose(kinematics.arm.tool_position(q), points, atol=1e-9)
    if path.orientation is not None:
        expected, actual = path.orientation(s), kinematics.arm.pose(q)[1]
        columns = slice(2, 3) if path.orientation.axis_only else slice(0, 3)
        np.testing.assert_allclose(actual[..., columns], expected[..., columns], atol=1e-8)
    with pytest.raises(ac.Unreachable):
        kinematics.solve(path(s) + 10.0, kinematics.q)
    assert (kinematics.free is None) == (kinematics.arm.dimension == 2)
    if kinematics.free is None:
        return
    assert kinematics.free.shape[1] == kinematics.arm.dof - (5 if path.orientation.axis_only else 6)
    q = kinematics.solve(path(s) + 1e-3, kinematics.q)
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", kinematics.free, q - kinematics.q), 0, atol=1e-9
    )


def test_steps_are_the_derivatives_of_the_solution(case):
    kinematics, path, s = case
    n = kinematics.arm.dimension
    way = np.broadcast_to(np.eye(n)[:, 1:], (3, n, n - 1))
    steps = kinematics.steps(kinematics.q, way)
    for j in range(way.shape[2]):
        up, down = (
            kinematics.solve(path(s) + x * way[:, :, j], kinematics.q) for x in (STEP, -STEP)
        )
        np.testing.assert_allclose(steps[:, :, j], (up - down) / (2 * STEP), rtol=1e-4, atol=1e-4)
