"""Fewer points of long rows."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from armcontour.studio.thinning import bends, thin


@given(
    count=st.integers(1, 3000),
    most=st.integers(20, 400),
    seed=st.integers(0, 100),
    heavy=st.floats(0, 1),
)
def test_what_stands_out_is_kept(count, most, seed, heavy):
    random = np.random.default_rng(seed)
    rows = list(random.normal(size=(2, count)))
    weight = random.uniform(size=count) * (random.uniform(size=count) < heavy)
    weight[random.integers(count)] = np.inf
    kept = thin(weight, rows, most)
    assert (np.diff(kept) > 0).all() and kept[0] == 0 and kept[-1] == count - 1
    assert len(kept) <= max(most + 20, 0) or count <= most
    if count <= most:
        assert len(kept) == count
    assert int(np.argmax(weight)) in kept
    for row in rows:
        assert {int(row.argmin()), int(row.argmax())} <= set(kept.tolist())
    # Of those that only a part of fits, the heavy ones are kept.
    left = np.setdiff1d(np.arange(count), kept)
    if len(left) and (weight > 0).sum() <= most // 2:
        assert (weight[left] == 0).all()


def test_a_bend_is_the_distance_from_the_line_through_its_neighbours():
    points = np.array([[0.0, 0], [1, 0], [2, 0], [2, 3], [2, 3]])
    np.testing.assert_allclose(bends(points), [0, 0, 3 / np.sqrt(10), 0, 0], atol=1e-15)
    assert bends(points[:2]).tolist() == [0, 0]
