"""Monotone interpolation, compared with SciPy's."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from armcontour.core.pchip import interpolate_monotone, monotone_slopes

PLACES = np.array([0.0, 0.2, 0.5, 0.6, 1.5, 1.7, 3.0])
AT = np.linspace(0.0, 3.0, 301)
SHAPES = {
    "line": PLACES,
    "waves": np.sin(3 * PLACES),
    "steps": np.array([0.0, 0.0, 1.0, 1.0, 2.0, 1.0, 1.0]),
    "turning ends": np.array([0.0, 1.0, -9.0, 2.0, 9.0, 8.0, 9.0]),
    "tiny": np.array([0.0, 1e-310, 1.0, 2.0, 2.0 + 1e-15, 3.0, 3.0]),
    "columns": np.sin(PLACES[:, None, None] * np.array([[1.0, 5.0, 9.0], [2.0, 4.0, 8.0]])),
}
# A planned path that has more knots than stations, between which the joint path is interpolated.
PLANNED = """
import sys
import numpy as np
import armcontour as ac
x = np.linspace(0.4, 0.5, 400)
points = np.column_stack([x, 0.01 * np.sin(100 * x), np.full(400, 0.2)])
path = ac.Path.polyline(points).pointing([0, 0, -1])
ac.plan(ac.round_corners(path, tolerance=1e-4), "ur5e", ac.Limits(speed=0.1))
sys.exit(2 if "scipy.interpolate" in sys.modules else 0)
"""


@pytest.mark.parametrize("values", SHAPES.values(), ids=SHAPES.keys())
def test_values_and_slopes_are_those_of_scipy(values):
    # SciPy warns of the overflow in a division by a tiny step.
    with np.errstate(over="ignore"):
        expected = PchipInterpolator(PLACES, values)
    # Both compute the same terms in the same order.
    np.testing.assert_array_equal(interpolate_monotone(PLACES, values, AT), expected(AT))
    # SciPy's slope at the last place is that of the cubic at its end, with rounding errors.
    scale = np.abs(np.diff(values, axis=0)).max() / 0.1
    slopes = monotone_slopes(PLACES, values)
    np.testing.assert_allclose(slopes, expected(PLACES, 1), atol=1e-14 * scale)


def test_two_places_are_joined_by_a_line():
    found = interpolate_monotone(np.array([1.0, 3.0]), np.array([2.0, 6.0]), np.array([1.0, 2.5]))
    assert found.tolist() == [2.0, 5.0]


def test_planning_contours_does_not_load_scipy_interpolate():
    assert subprocess.run([sys.executable, "-c", PLANNED], check=False).returncode == 0
