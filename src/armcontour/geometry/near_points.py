"""Neighbour search among points: by a table of all distances for few points, or by SciPy's tree."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray, IntArray

# Largest number of distances in a table. A table of this size takes 10 ms, and the import of
# SciPy's tree takes 300 ms.
MAX_TABLE = 250_000


def pairs_within(queries: FloatArray, points: FloatArray, near: float) -> tuple[IntArray, IntArray]:
    """Indices of queries and points of all pairs within the distance `near`, (pairs,) each."""
    # The indices of the queries are sorted.
    if len(queries) * len(points) <= MAX_TABLE:
        indices = np.nonzero(_squares(queries, points) <= near**2)
        return indices[0], indices[1]
    from scipy.spatial import cKDTree

    lists: Any = cKDTree(points).query_ball_point(queries, near, return_sorted=True)
    owners = np.repeat(np.arange(len(queries)), [len(x) for x in lists])
    return owners, np.concatenate(lists).astype(np.intp)


def nearest_points(
    queries: FloatArray, points: FloatArray, count: int, within: float = np.inf
) -> IntArray:
    """Indices of the nearest points of every query, the nearest first, (n, count).

    The index is m where no further point is closer than `within`.

    - `queries`: the query points, (n, d).
    - `points`: the points, (m, d).
    - `count`: number of points per query, at most m.
    """
    if len(queries) * len(points) <= MAX_TABLE:
        squares = _squares(queries, points)
        order = np.argsort(squares, axis=1, kind="stable")[:, :count]
        beyond = np.take_along_axis(squares, order, axis=1) >= within**2
        return np.where(beyond, len(points), order)
    from scipy.spatial import cKDTree

    # With an array of ranks, the result has two dimensions even for a single rank.
    ranks = np.arange(1, count + 1)
    return np.asarray(cKDTree(points).query(queries, k=ranks, distance_upper_bound=within)[1])


def group_points(points: FloatArray, near: float) -> IntArray:
    """Group number of each point, (n,); steps of at most `near` connect the points of a group."""
    # Groups are numbered in the order of their first points.
    if len(points) ** 2 > MAX_TABLE:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        n, pairs = len(points), cKDTree(points).query_pairs(near, output_type="ndarray")
        links = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n))
        return np.asarray(connected_components(links, directed=False)[1], dtype=np.intp)
    a, b = pairs_within(points, points, near)
    # The label of every point becomes the smallest label of its neighbours, until no label changes.
    first, before = np.arange(len(points)), np.empty(0, dtype=np.intp)
    while not np.array_equal(first, before):
        before = first.copy()
        np.minimum.at(first, a, before[b])
        first = first[first]
    return np.unique(first, return_inverse=True)[1]


def _squares(queries: FloatArray, points: FloatArray) -> FloatArray:
    """Squared distances between queries and points, (n, m)."""
    return np.asarray(((queries[:, None] - points[None]) ** 2).sum(axis=2))
