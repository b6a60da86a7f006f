"""Tool axes that turn smoothly: within the angle, as smooth as the true ones, and closed."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.geometry.tables import each, refused

from armcontour.frames import angle_between
from armcontour.geometry.smooth_axes import smooth_axes


def ring(n, noise, *, closed=True, seed=1):
    """Points of a circle, or of nearly one, with tilted axes: true ones and ones with errors."""
    rng = np.random.default_rng(seed)
    turn = np.linspace(0, 2 * np.pi if closed else 6.0, n)
    points = 0.1 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    true = np.stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), 0 * turn - 1], axis=1)
    axes = true + rng.normal(scale=noise, size=true.shape)
    if closed:
        points[-1], axes[-1] = points[0], axes[0]
    return points, *(x / np.linalg.norm(x, axis=1)[:, None] for x in (true, axes))


def bends(axes):
    return np.sqrt((np.diff(axes, 2, axis=0) ** 2).sum(axis=1).mean())


@each("closed", [True, False])
def test_errors_go_and_turns_stay(closed):
    points, true, axes = ring(400, 3e-3, closed=closed)
    largest = angle_between(axes, true).max()
    found = smooth_axes(points, axes, largest)
    assert angle_between(found, axes).max() <= largest
    # The true axes are among those that are allowed, so that the smoothest bend no more.
    assert bends(found) < 1.05 * bends(true) < 0.1 * bends(axes)
    if closed:
        np.testing.assert_array_equal(found[0], found[-1])
        before, after = found[-1] - found[-2], found[1] - found[0]
        assert np.linalg.norm(after - before) < 3 * bends(true)


@given(
    st.integers(3, 60), st.floats(0.0, 0.3), st.floats(1e-4, 0.5), st.booleans(), st.integers(0, 99)
)
@settings(max_examples=20)
def test_no_axis_turns_by_more_than_the_angle(n, noise, tolerance, closed, seed):
    points, _, axes = ring(max(n, 5) if closed else n, noise, closed=closed, seed=seed)
    # Rows at uneven distances.
    points[1] += 0.9 * (points[2] - points[1])
    found = smooth_axes(points, axes, tolerance)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-12)
    assert angle_between(found, axes).max() <= tolerance


def test_what_is_not_to_be_smoothed_is_kept():
    points, true, axes = ring(20, 0.0)
    for few, tolerance in ((2, 0.1), (20, 0.0)):
        found = smooth_axes(points[:few], true[:few], tolerance)
        np.testing.assert_allclose(found, true[:few], atol=1e-15)
    refused(
        (lambda: smooth_axes(np.zeros((20, 3)), axes, 0.1), "points that differ"),
        (lambda: smooth_axes(points, 0 * axes, 0.1), "with a length"),
    )
