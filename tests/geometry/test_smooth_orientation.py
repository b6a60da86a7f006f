"""Tool orientation along paths of continuous curvature: exact, continuous derivatives."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.geometry.tables import each

import armcontour as ac
from armcontour.core.frames import angle_between, log

POINTS = [(0.4, 0.0, 0.2), (0.5, 0.0, 0.2), (0.5, 0.1, 0.2), (0.4, 0.1, 0.2), (0.3, 0.1, 0.2)]
DOWN = np.diag([1.0, -1.0, -1.0])
TURNS = Rotation.from_euler("zx", [(0, 0), (0.3, 0.1), (0.2, -0.2), (0.6, 0), (0.9, 0.2)])


def oriented(kind):
    path = ac.Path.polyline(POINTS)
    if kind == "follows":
        return path.following_tangent((0, 0, 1))
    return path.oriented(TURNS.as_matrix() @ DOWN, axis_only=kind == "axis")


@pytest.fixture(scope="module", params=["turns", "axis", "follows"])
def smooth(request):
    return ac.round_corners(
        oriented(request.param), tolerance=5e-3, continuity="curvature", angular_tolerance=0.1
    )


def test_the_derivative_of_the_angular_rate_does_not_jump(smooth):
    o = smooth.orientation
    breaks = o.breaks[1:-1]
    size = np.abs(o.rates(np.linspace(0, smooth.length, 999))).max(axis=(1, 2))
    for k in range(2):
        jump = o.rates(breaks, side="left")[k] - o.rates(breaks)[k]
        assert np.abs(jump).max() < 1e-11 * size[k]
    assert len(smooth.stops) == 0


@each("allowed", [0.02, 0.1])
@each("kind", ["turns", "axis"])
def test_the_angular_error_reaches_but_does_not_exceed_its_tolerance(kind, allowed):
    path = oriented(kind)
    rounded = ac.round_corners(
        path, tolerance=0.04, continuity="curvature", angular_tolerance=allowed
    )
    c = rounded.corners
    expected = path.orientation.starts[1:3]
    rotations = rounded.orientation((c.start + c.end) / 2)
    errors = np.linalg.norm(log(rotations @ np.swapaxes(expected, 1, 2)), axis=1)
    if kind == "axis":
        errors = angle_between(rotations[:, :, 2], expected[:, :, 2])
    np.testing.assert_allclose(errors, c.angular_error, atol=1e-12)
    assert (errors <= allowed + 1e-12).all()
    # At 0.1 rad, the corners have no room to use the whole tolerance.
    assert errors.max() > 0.8 * allowed or allowed == 0.1
