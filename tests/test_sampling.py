"""Values between samples."""

import numpy as np

from armcontour._sampling import interpolate


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
