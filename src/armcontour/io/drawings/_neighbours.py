"""Points near other points: by all distances where these are few, else by SciPy's tree.

SciPy takes a third of a second to load, which is much for a drawing of a few contours.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray

# All distances of so many points are computed at once.
FEW = 400


def pairs_within(points: FloatArray, distance: float) -> IntArray:
    """Pairs of points that are at most so far apart, each once, (m, 2).

    Args:
        points: The points, (n, dimension).
        distance: Their largest distance.
    """
    if len(points) <= FEW:
        return np.argwhere(np.triu(_distances(points, points) <= distance, 1))
    from scipy.spatial import cKDTree

    found: IntArray = cKDTree(points).query_pairs(distance, output_type="ndarray")
    return found


def nearest_few(
    points: FloatArray, queries: FloatArray, count: int, distance: float
) -> tuple[IntArray, IntArray]:
    """The nearest points of each query that are less than a distance away.

    Args:
        points: The points, (n, dimension).
        queries: Where points are looked for, (m, dimension).
        count: Largest number of points for each query.
        distance: Upper bound of their distances.

    Returns:
        Indices of queries, and of points near them, (k,) each.
    """
    count = min(count, len(points))
    if max(len(points), len(queries)) <= FEW:
        apart = _distances(queries, points)
        nearest = np.argsort(apart, axis=1, kind="stable")[:, :count]
        near = np.take_along_axis(apart, nearest, axis=1) < distance
    else:
        from scipy.spatial import cKDTree

        among = [*range(1, count + 1)]
        found = cKDTree(points).query(queries, k=among, distance_upper_bound=distance)
        nearest = np.asarray(found[1])
        near = nearest < len(points)
    return np.nonzero(near)[0], nearest[near]


def _distances(first: FloatArray, second: FloatArray) -> FloatArray:
    """Distances of all points from all others, (n, m)."""
    return np.asarray(np.linalg.norm(first[:, None] - second, axis=2))


def join_pairs(pairs: IntArray, count: int) -> IntArray:
    """The group of each of so many things of which pairs are joined: its least member, (count,).

    Args:
        pairs: The pairs, (m, 2).
        count: Number of things.
    """
    group = np.arange(count)
    while True:
        least = group[pairs].min(axis=1)
        if (group[pairs] == least[:, None]).all():
            return group
        # Groups are joined by their least members, and members then follow these.
        np.minimum.at(group, group[pairs].ravel(), np.repeat(least, 2))
        while not np.array_equal(group, group[group]):
            group = group[group]
