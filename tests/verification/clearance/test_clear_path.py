"""Joint paths around obstacles."""

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.motion import JointPath
from armcontour.robot.scene import ArmShapes, Box, LinkShape, Margins, Obstacle, Scene, Sphere
from armcontour.verification.clearance import Cell
from armcontour.verification.clearance.clear_path import connect, path_through, round_postures

pytestmark = needs_dynamics

ARM = ac.load_arm("ur5e").with_shapes(
    ArmShapes(shapes=(LinkShape(name="end", link=6, shape=Sphere(radius=0.03)),))
)
A = np.array([-0.3, -1.2, 1.5, -1.8, -1.57, 0.0])
B = np.array([0.5, -1.2, 1.5, -1.8, -1.57, 0.0])
RANGES = ARM.limits.joint_range(6)


def cell_with(size):
    """A wall in the middle between both postures."""
    middle = ARM.with_tool(Frame()).tool_position((A + B) / 2)
    wall = Obstacle(name="wall", shape=Box(size=size), place=Frame(position=middle))
    return Cell(ARM, Scene(obstacles=(wall,), margins=Margins(environment=0.005)))


def test_a_way_around_a_wall_is_found_and_clear():
    cell = cell_with([0.3, 0.05, 0.5])
    assert not cell.keeps(JointPath.spline([A, B]))
    path = connect(cell, A, B, RANGES)
    assert np.allclose(path(path.breaks[[0, -1]]), [A, B], atol=1e-12)
    assert cell.check(path).satisfied
    # At many places, the ball is where the bounds say that it may be.
    q = path(np.linspace(0.0, path.breaks[-1], 500))
    middle = ARM.with_tool(Frame()).tool_position((A + B) / 2)
    outside = np.abs(ARM.with_tool(Frame()).tool_position(q) - middle) - [0.15, 0.025, 0.25]
    assert (np.linalg.norm(np.maximum(outside, 0.0), axis=1) >= 0.035 - 1e-9).all()
    again = connect(cell, A, B, RANGES)
    assert np.array_equal(again.coefficients, path.coefficients)


def test_no_way_is_none(monkeypatch):
    monkeypatch.setattr("armcontour.verification.clearance.clear_path.MAX_PIECES", 30)
    closed = cell_with([3.0, 0.05, 3.0])
    assert connect(closed, A, B, RANGES) is None


def test_rounded_postures_are_smooth():
    postures = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]])
    path = round_postures(postures, 0.5)
    assert len(path.stops) == 0
    assert path(path.breaks[[0, -1]]) == pytest.approx(postures[[0, -1]])
    speeds = np.linalg.norm(path(np.linspace(0, path.breaks[-1], 200), 1), axis=1)
    assert (speeds <= 1 + 1e-12).all() and speeds.min() >= np.sqrt(0.5) - 1e-12
    assert len(round_postures(postures, 0.0).stops) == 2
    free = Cell(ARM, Scene())
    path = path_through(free, np.array([A, A + 0.1, B]))
    assert len(path.stops) == 0
