"""Few points and many give the same neighbours and groups."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from armcontour.geometry import near_points
from armcontour.geometry.near_points import group_points, nearest_points, pairs_within

# On a grid, so that many points coincide and many distances are equal.
POINTS = st.integers(1, 40).flatmap(
    lambda n: arrays(np.float64, (n, 2), elements=st.integers(0, 12).map(float))
)


def both_ways(call):
    """What a table of distances gives, and what the tree gives."""
    table = call()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(near_points, "FEW", 0)
        return table, call()


@given(POINTS, POINTS, st.floats(0.5, 4.0))
def test_pairs_are_those_of_the_tree(places, points, near):
    table, tree = both_ways(lambda: pairs_within(places, points, near))
    assert np.array_equal(table, tree)
    for i, k in zip(*table, strict=True):
        assert np.linalg.norm(places[i] - points[k]) <= near + 1e-12


@given(POINTS, POINTS, st.integers(1, 5), st.sampled_from([1.0, 2.5, np.inf]))
def test_the_nearest_points_are_as_near_as_those_of_the_tree(places, points, count, within):
    count = min(count, len(points))
    for found in both_ways(lambda: nearest_points(places, points, count, within)):
        assert found.shape == (len(places), count)
        distances = np.linalg.norm(places[:, None] - points[None], axis=2)
        wanted = np.sort(distances, axis=1)[:, :count]
        wanted = np.where(wanted < within, wanted, np.inf)
        padded = np.append(distances, np.full((len(places), 1), np.inf), axis=1)
        # Of points that are equally far any may be found.
        assert np.allclose(np.take_along_axis(padded, found, axis=1), wanted)


@given(POINTS, st.floats(0.5, 4.0))
def test_groups_are_those_of_the_graph(points, near):
    table, tree = both_ways(lambda: group_points(points, near))
    assert np.array_equal(table, tree)


def test_a_long_chain_is_one_group_and_no_points_have_none():
    chain = np.column_stack([np.random.default_rng(3).permutation(400), np.zeros(400)])
    assert not group_points(chain, 1.0).any()
    assert len(set(group_points(chain, 0.9))) == 400
    none = np.empty((0, 2))
    assert len(group_points(none, 1.0)) == 0 and len(pairs_within(none, none, 1.0)[0]) == 0
