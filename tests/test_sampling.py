"""Values between samples."""

import numpy as np

from armcontour._sampling import interpolate


def test_columns_go_on_straight_lines_and_stay_beyond_their_ends():
    values = np.array([[0.0, 5.0], [1.0, 3.0], [3.0, 3.0]])
    found = interpolate(np.array([-1.0, 0.5, 1.0, 3.0, 9.0]), np.array([0.0, 1.0, 5.0]), values)
    expected = [[0.0, 5.0], [0.5, 4.0], [1.0, 3.0], [2.0, 3.0], [3.0, 3.0]]
    np.testing.assert_array_equal(found, expected)
