"""Quadratic programs of long paths, solved in chunks of a few corners by several threads.

Two nodes between chunks stay as they are, so that no row touches two chunks. Their places change
from iteration to iteration, so that all nodes move in the end. Chunks do not depend on the number
of threads, nor do results.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.timing.shaping._quadratic import solve_program

# Paths of more corners and rests than this are long.
LONG = 40
# Corners of a chunk, and by how many the cuts move from one iteration to the next.
CORNERS, SHIFT = 8, 3


def is_long(group: IntArray) -> bool:
    """Whether a path is long.

    Args:
        group: Number of the corner or rest that each node is nearest to, ascending, (n,).
    """
    return bool(group[-1] >= LONG)


def place_cuts(group: IntArray, iteration: int, *, whole: bool = False) -> IntArray:
    """The first of both nodes that stay between chunks, none where the path is not long, (m,).

    Args:
        group: Number of the corner or rest that each node is nearest to, ascending, (n,).
        iteration: Number of the iteration.
        whole: Whether a long path is not cut either.
    """
    if whole or not is_long(group):
        return np.zeros(0, dtype=np.intp)
    first = 1 + SHIFT * iteration % CORNERS
    cuts = np.searchsorted(group, np.arange(first, int(group[-1]) + 1, CORNERS))
    # A chunk, and its first and last node, need room.
    return np.asarray(cuts[(cuts > 2) & (cuts < len(group) - 4)])


def solve_in_chunks(
    cost: FloatArray,
    rows: FloatArray,
    bounds: FloatArray,
    weight: FloatArray,
    cuts: IntArray,
    threads: int | None = None,
) -> FloatArray:
    """Solve the programs of all chunks; the others' unknowns are zero meanwhile, (n, k).

    Args:
        cost: As in `solve_program`.
        rows: As in `solve_program`.
        bounds: As in `solve_program`.
        weight: As in `solve_program`.
        cuts: The first of both nodes that stay between chunks, (m,).
        threads: Number of threads; by default that of processors.
    """
    if not len(cuts):
        return solve_program(cost, rows, bounds, weight)[0]
    n, k = cost.shape
    begins, ends = np.append(0, cuts + 1), np.append(cuts + 1, n)

    def solve(begin: int, end: int) -> FloatArray:
        """The unknowns of a chunk, whose first and last node stay."""
        part = slice(begin, end)
        own_cost, own = cost[part].copy(), rows[part].copy()
        if begin > 0:
            own_cost[0], own[0, :, : 2 * k], own[1, :, :k] = 0.0, 0.0, 0.0
        if end < n:
            own_cost[-1], own[-1, :, k:], own[-2, :, 2 * k :] = 0.0, 0.0, 0.0
        x, _ = solve_program(own_cost, own, bounds[part], weight[part])
        # A chunk without a solution stays as it is.
        return x if np.isfinite(x).all() else np.zeros_like(x)

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        return np.concatenate(list(pool.map(solve, begins.tolist(), ends.tolist())))
