"""Which points are near which others: by a table of few distances, or by scipy's tree for many."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray, IntArray

# Largest number of distances in a table: 10 ms of work, where scipy's tree is loaded in 300 ms.
FEW = 250_000


def pairs_within(places: FloatArray, points: FloatArray, near: float) -> tuple[IntArray, IntArray]:
    """All pairs of a place and a point that are at most this far apart.

    Args:
        places: The places, (n, d).
        points: The points, (m, d).
        near: The distance.

    Returns:
        Indices of the places, sorted, and those of their points, (pairs,) each.
    """
    if len(places) * len(points) <= FEW:
        found = np.nonzero(_squares(places, points) <= near**2)
        return found[0], found[1]
    from scipy.spatial import cKDTree

    lists: Any = cKDTree(points).query_ball_point(places, near, return_sorted=True)
    owners = np.repeat(np.arange(len(places)), [len(x) for x in lists])
    return owners, np.concatenate(lists).astype(np.intp)


def nearest_points(
    places: FloatArray, points: FloatArray, count: int, within: float = np.inf
) -> IntArray:
    """The nearest points of every place, the nearest one first.

    Args:
        places: The places, (n, d).
        points: The points, (m, d).
        count: How many are wanted, at most m.
        within: Only points nearer than this count.

    Returns:
        Indices of points, m where there is none as near, (n, count).
    """
    if len(places) * len(points) <= FEW:
        squares = _squares(places, points)
        order = np.argsort(squares, axis=1, kind="stable")[:, :count]
        far = np.take_along_axis(squares, order, axis=1) >= within**2
        return np.where(far, len(points), order)
    from scipy.spatial import cKDTree

    # A list of numbers has two dimensions also where one is wanted.
    wanted = np.arange(1, count + 1)
    return np.asarray(cKDTree(points).query(places, k=wanted, distance_upper_bound=within)[1])


def group_points(points: FloatArray, near: float) -> IntArray:
    """Groups of points: from each one of a group to each other go steps of at most `near`.

    Args:
        points: The points, (n, d).
        near: Largest step.

    Returns:
        Numbers of the groups, in the order of their first points, (n,).
    """
    if len(points) ** 2 > FEW:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        n, pairs = len(points), cKDTree(points).query_pairs(near, output_type="ndarray")
        links = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n))
        return np.asarray(connected_components(links, directed=False)[1], dtype=np.intp)
    a, b = pairs_within(points, points, near)
    # Every point takes the first point that its neighbours know, until nothing changes.
    first, before = np.arange(len(points)), np.empty(0, dtype=np.intp)
    while not np.array_equal(first, before):
        before = first.copy()
        np.minimum.at(first, a, before[b])
        first = first[first]
    return np.unique(first, return_inverse=True)[1]


def _squares(places: FloatArray, points: FloatArray) -> FloatArray:
    """Squares of the distances of places and points, (n, m)."""
    return np.asarray(((places[:, None] - points[None]) ** 2).sum(axis=2))
