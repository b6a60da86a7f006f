"""Compiled search for the largest error, and for the nearest tool point, between samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernel_cache import compiled
from armcontour.robot.kernels import tool_motion
from armcontour.verification.error_profile import (
    CLOSER_SEARCHES,
    END_DISTANCE,
    ERROR_ROUNDING,
    GRID,
    KINK_MARGIN,
    LEASH_FACTOR,
    MAX_CUTS,
    PEAK_EXCESS,
    SEARCH_PARTS,
    SHORTEST_LENGTH,
    STEP_RATIO,
)
from armcontour.verification.path_points import find_tops, follow


class ToolPath(NamedTuple):
    """Tool motion between samples: the nodes of a `FineMotion`, and the arm's links."""

    t: FloatArray  # Times of the nodes [s], (n,)
    q: FloatArray  # Joint positions [rad], (n, dof)
    before: FloatArray  # Joint velocities before each node [rad/s], (n, dof)
    after: FloatArray  # Joint velocities after each node [rad/s], (n, dof)
    ddq: FloatArray  # Joint accelerations [rad/s²], (n, dof); (0, dof) for cubics
    links: FloatArray  # `Arm.link_table`
    dimension: int  # Number of coordinates of the tool, 2 or 3


class Searched(NamedTuple):
    """Result of a search: an error above the given one, if `found`."""

    found: bool
    t: float  # Time [s]
    value: float  # Error [m]
    s: float  # Arc length [m]


@compiled(inner=True, allocates=True)
def tool_points(motion: ToolPath, times: FloatArray) -> FloatArray:
    """Return tool points in space at times between the first and the last node [m], (n, 3)."""
    dof = motion.q.shape[1]
    last = len(motion.t) - 2
    q = np.empty((len(times), dof))
    for k in range(len(times)):
        i = 0
        while i < last and motion.t[i + 1] <= times[k]:
            i += 1
        h = motion.t[i + 1] - motion.t[i]
        x = (times[k] - motion.t[i]) / h
        for j in range(dof):
            # Coefficients of 1 to x⁵ from values and derivatives at both ends, as in `quintic`
            a0 = motion.q[i, j]
            a1 = h * motion.after[i, j]
            rise = motion.q[i + 1, j] - a0
            end_slope = h * motion.before[i + 1, j]
            if len(motion.ddq) == 0:
                a3 = a1 + end_slope - 2 * rise
                q[k, j] = a0 + x * (a1 + x * (rise - a1 - a3 + x * a3))
                continue
            a2 = h * h * motion.ddq[i, j] / 2
            value = rise - a1 - a2
            slope = end_slope - a1 - 2 * a2
            curvature = h * h * motion.ddq[i + 1, j] - 2 * a2
            a3 = 10 * value - 4 * slope + curvature / 2
            a4 = -15 * value + 7 * slope - curvature
            a5 = 6 * value - 3 * slope + curvature / 2
            q[k, j] = a0 + x * (a1 + x * (a2 + x * (a3 + x * (a4 + x * a5))))
    poses = tool_motion(motion.links, 0, q, q, q, q)
    points = np.zeros((len(times), 3))
    for k in range(len(times)):
        for axis in range(motion.dimension):
            points[k, axis] = poses[k, 4 * axis + 3]
    return points


@compiled(inner=True, allocates=True)
def near_path(
    points: FloatArray, rows: FloatArray, low: float, high: float, distance_bound: float
) -> tuple[FloatArray, FloatArray]:
    """Return distances and arc lengths of points between two followed ones, see `Followed.near`.

    - `points`: tool points in order [m], (n, 3).
    - `rows`: segments from `pack_segments`, (segments, 15).
    - `low`, `high`: arc lengths of both followed points, in order [m].
    - `distance_bound`: the larger distance of both followed points from the path [m].
    """
    n = len(points)
    travel2 = 0.0
    for k in range(n):
        square = 0.0
        for axis in range(3):
            square += (points[k, axis] - points[0, axis]) ** 2
        travel2 = max(travel2, square)
    travel = np.sqrt(travel2)
    leash = LEASH_FACTOR * max(distance_bound, travel, SHORTEST_LENGTH)
    farthest = rows[-1, 11] + rows[-1, 10] + 2 * (distance_bound + travel)
    while True:
        first = max(_count_begun(rows, low - leash) - 1, 0)
        last = _count_begun(rows, high + leash)
        part = rows[first:last]
        found = follow(points, part, high + leash, leash, n)
        if leash > farthest or (found.followed >= n and not found.held):
            return found.distance, found.s
        leash *= 2


@compiled(inner=True)
def _count_begun(rows: FloatArray, s: float) -> int:
    """Return how many segments of `pack_segments` begin at or before an arc length [m]."""
    low = 0
    high = len(rows)
    while low < high:
        middle = (low + high) // 2
        if rows[middle, 11] <= s:
            low = middle + 1
        else:
            high = middle
    return low


@compiled()
def search_interval(
    motion: ToolPath,
    rows: FloatArray,
    low: float,
    high: float,
    distance_bound: float,
    begin: float,
    end: float,
    best: float,
) -> Searched:
    """Find a distance from the path above `best` [m] between two times [s].

    The interval is sampled, and then sampled again near the kink and the top of each parabola that
    may exceed the largest distance so far.

    - other arguments: as of `near_path`.
    """
    peak = Searched(False, 0.0, best, 0.0)
    t = np.empty(0)
    values = np.empty(0)
    times = np.empty(SEARCH_PARTS + 1)
    for k in range(SEARCH_PARTS + 1):
        times[k] = begin + (end - begin) * (k / SEARCH_PARTS)
    for _ in range(MAX_CUTS):
        # Measure the new times
        distance, s = near_path(tool_points(motion, times), rows, low, high, distance_bound)
        largest = 0
        for k in range(len(times)):
            if distance[k] > distance[largest]:
                largest = k
        if distance[largest] > best:
            best = distance[largest]
            peak = Searched(True, times[largest], best, s[largest])
        # Merge them with the others
        t, values = _merge(t, values, times, distance)
        # Choose times near possible tops
        top, kink, parabola_top, bound = find_tops(t, values)
        smallest = SEARCH_PARTS * 4 * (np.nextafter(t[-1], np.inf) - t[-1])
        chosen = np.empty(6 * len(top))
        count = 0
        for m in range(len(top)):
            width = t[top[m] + 1] - t[top[m]]
            threshold = best + PEAK_EXCESS * abs(best) + ERROR_ROUNDING
            if bound[m] > threshold and width > smallest:
                for guess in (kink[m], parabola_top[m]):
                    for shift in (0.0, -KINK_MARGIN, KINK_MARGIN):
                        place = min(max(guess + shift, END_DISTANCE), 1 - END_DISTANCE)
                        count = _insert(chosen, count, t[top[m]] + width * place)
        if count == 0:
            break
        times = chosen[:count]
    return peak


@compiled(inner=True, allocates=True)
def _merge(
    t: FloatArray, values: FloatArray, new_t: FloatArray, new_values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Merge two samples of a function, each of which has its times in order."""
    n = len(t) + len(new_t)
    merged_t = np.empty(n)
    merged_values = np.empty(n)
    i = 0
    j = 0
    for k in range(n):
        if j == len(new_t) or (i < len(t) and t[i] <= new_t[j]):
            merged_t[k] = t[i]
            merged_values[k] = values[i]
            i += 1
        else:
            merged_t[k] = new_t[j]
            merged_values[k] = new_values[j]
            j += 1
    return merged_t, merged_values


@compiled(inner=True)
def _insert(ordered: FloatArray, count: int, value: float) -> int:
    """Insert a value among the first `count` ones, which are in order, unless it is among them.

    Returns how many there are then.
    """
    place = count
    while place > 0 and ordered[place - 1] > value:
        place -= 1
    if place > 0 and ordered[place - 1] == value:
        return count
    for k in range(count, place, -1):
        ordered[k] = ordered[k - 1]
    ordered[place] = value
    return count + 1


@compiled()
def nearest_between(
    motion: ToolPath, point: FloatArray, begins: FloatArray, ends: FloatArray
) -> float:
    """Return the smallest squared distance from a point to the tool in some intervals [m²].

    Each interval is searched like a function in `maximize_smooth`.

    - `point`: position, (3,) [m].
    - `begins`, `ends`: times of the intervals [s], (m,) each.
    """
    smallest = np.inf
    square = np.empty(GRID + 1)
    times = np.empty(GRID + 1)
    for m in range(len(begins)):
        begin = begins[m]
        end = ends[m]
        step = (end - begin) / GRID
        for k in range(GRID + 1):
            times[k] = begin + (end - begin) * (k / GRID)
        for _ in range(CLOSER_SEARCHES):
            points = tool_points(motion, times)
            nearest = 0
            for k in range(GRID + 1):
                square[k] = 0.0
                for axis in range(3):
                    square[k] += (points[k, axis] - point[axis]) ** 2
                if square[k] < square[nearest]:
                    nearest = k
            smallest = min(smallest, square[nearest])
            k = min(max(nearest, 1), GRID - 1)
            curvature = square[k - 1] + square[k + 1] - 2 * square[k]
            shift = 0.0
            if curvature > 0.0:
                shift = (square[k - 1] - square[k + 1]) / (2 * curvature)
            middle = times[k] + min(max(shift, -1.0), 1.0) * step
            step = step / STEP_RATIO
            for k in range(GRID + 1):
                times[k] = min(max(middle + step * (k - GRID / 2), begin), end)
    return smallest
