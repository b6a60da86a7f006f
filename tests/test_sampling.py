"""Values between samples."""

import numpy as np

from armcontour._sampling import interpolate


def test_columns_go_on_straight_lines_and_stay_beyond_their_ends():
    values = np.array([[0.0, 5.0], [1.0, 3.0], [3.0, 3.0]])
    found = interpolate(np.array([-1.0, 0.5, 1.0, 3.0, 9.0]), np.array([0.0, 1.0, 5.0]), values)
    expected = [[0.0, 5.0], [0.5, 4.0], [1.0, 3.0], [2.0, 3.0], [3.0, 3.0]]
    np.testing.assert_array_equal(found, expected)


def test_parts_of_long_motions_have_the_values_of_the_whole():
    rng = np.random.default_rng(0)
    for _ in range(300):
        t = np.sort(rng.uniform(0, 1, rng.integers(1, 30)))
        values = rng.normal(size=(len(t), 2))
        pool = np.concatenate([t, rng.uniform(-0.5, 1.5, 5)])
        at = rng.choice(pool, rng.integers(1, 6))
        expected = np.stack([np.interp(at, t, x) for x in values.T], axis=1)
        assert (interpolate(at, t, values) == expected).all()
    assert interpolate(np.empty(0), t, values).shape == (0, 2)
