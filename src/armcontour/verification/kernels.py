"""Compiled search for the points at which a tool follows a path, and for the coverage error."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled
from armcontour.core.sampling import number_parts
from armcontour.geometry.kernels import Point, distance2, find_foot, point_at

# Distances that differ by less than this are equal [m]: coordinates are not more exact.
EQUAL = 1e-9
# Largest number of reachable path intervals; further ones join the last.
MAX_STRETCHES = 64
# Largest number of waiting halves in the search of a part for its farthest point, and precision of
# the distance [m].
MAX_HALVES, SURE = 64, 1e-10
# Approximate number of point-segment pairs per batch, to bound the memory.
PAIRS = 50_000


class FollowedTool(NamedTuple):
    """Tool points in order, with their path points."""

    points: FloatArray  # Tool points in order, padded to space [m], (n, 3) with n > 1
    distance: FloatArray  # Distances from their path points [m], (n,)
    s: FloatArray  # Arc lengths of their path points [m], (n,)
    sizes: FloatArray  # Lengths of the tool's chords [m], (n - 1,)
    later: FloatArray  # Smallest arc length of this and all later points [m], (n,)


class PathIntervals(NamedTuple):
    """Path intervals in which the tool can be, in order."""

    ends: FloatArray  # First and last arc lengths [m], (MAX_STRETCHES + 1, 2)
    first: IntArray  # Segments on which they begin, (MAX_STRETCHES + 1,)


@compiled(inner=True)
def _reachable_intervals(
    p: Point,
    rows: FloatArray,
    old: PathIntervals,
    count: int,
    new: PathIntervals,
    before: float,
    leash2: float,
) -> tuple[int, float, float, bool]:
    """Find the path intervals in which the tool can be at a point, and the nearest path point."""
    # Returns the number of new intervals, distance and arc length of the tool [m], and whether the
    # path point is at the start of an interval only because arc length must not decrease.
    new_count, best, nearest_s, held, done = 0, math.inf, 0.0, False, -1.0
    for k in range(count):
        low, high = old.ends[k, 0], old.ends[k, 1]
        begin, is_open = max(low, done), False
        for j in range(old.first[k], len(rows) if begin <= high else 0):
            base, length, curvature = rows[j, 11], rows[j, 10], rows[j, 9]
            if base + length < begin:
                continue
            foot = find_foot(p, rows[j])
            room = leash2 - foot.off2
            # A line has one foot point, a full circle two.
            laps, turn, nearest = 1, 0.0, foot.along
            # Half of the length within the leash around the foot point.
            half = math.sqrt(max(room, 0.0))
            if curvature != 0.0 and room >= 0.0:
                laps, turn = 2, 2 * math.pi / curvature
                nearest = math.atan2(foot.along, foot.across) / curvature
                # Squared distance of the farthest point of the circle, less that of the nearest.
                farthest2 = distance2(foot, curvature, turn / 2) - foot.off2
                fraction = room / farthest2 if room < farthest2 else 1.0
                half = 2 * math.asin(math.sqrt(fraction)) / curvature
            for lap in range(laps if room >= 0.0 else 0):
                centre = nearest + lap * turn
                x, y = max(centre - half, begin - base, 0.0), min(centre + half, length)
                if x > y:
                    continue
                if not (is_open and base + x <= done + EQUAL):
                    if base + x > high:
                        break
                    new.ends[new_count, 0], new.first[new_count] = base + x, j
                    new_count, is_open = min(new_count + 1, MAX_STRETCHES), True
                done = max(done, base + y)
                new.ends[new_count - 1, 1] = done
                arc = min(max(centre, x), y)
                d = math.sqrt(distance2(foot, curvature, arc - centre))
                # Of equally near points, the next one ahead is used.
                if d < best - EQUAL or (d <= best + EQUAL and nearest_s < before - EQUAL):
                    nearest_s = base + arc
                    # At the start of the interval, not at the end of a segment.
                    held = centre < x and x > 0.0 and base + x <= low + EQUAL
                best = min(best, d)
            if base + length >= high and not (is_open and done >= base + length - EQUAL):
                break
    return new_count, best, nearest_s, held


@compiled()
def follow(
    points: FloatArray, rows: FloatArray, start: float, leash: float, needed: int
) -> tuple[FloatArray, FloatArray, int, bool]:
    """Distances and arc lengths of the path points of a tool that never moves back on the path."""
    # At each point, the kernel keeps the intervals of the path that the tool can have reached if
    # its distance from its path point never exceeded `leash` [m] and its arc length never
    # decreased.
    # points (n, 3) [m], rows (segments, 15) from `pack_segments`. `start` [m] is at or after the
    # first path point. The first `needed` points must be followed, later ones until the tool leaves
    # the path.
    # Returns distances and arc lengths [m], (n,) each; the number of followed points; and whether
    # the path point of any point was restricted because arc length must not decrease.
    n, size = len(points), MAX_STRETCHES + 1
    distance, s = np.empty(n), np.empty(n)
    now = PathIntervals(np.empty((size, 2)), np.empty(size, np.intp))
    after = PathIntervals(np.empty((size, 2)), np.empty(size, np.intp))
    now.ends[0, 0], now.ends[0, 1], now.first[0] = 0.0, start, 0
    count, before, held = 1, 0.0, False
    for i in range(n):
        p = points[i, 0], points[i, 1], points[i, 2]
        count, best, before, point_held = _reachable_intervals(
            p, rows, now, count, after, before, leash * leash
        )
        if count == 0:
            return distance, s, i, held
        now, after = after, now
        distance[i], s[i] = best, before
        held = held or (point_held and i < needed)
    return distance, s, n, held


def find_places(
    points: FloatArray, rows: FloatArray, reach: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Indices of points, and arc lengths of nearest points and segment ends within `reach` [m]."""
    # points (n, 3) [m], rows (segments, 15) from `pack_segments`; an excess by rounding is
    # accepted.
    k, length, within = rows[:, 9], rows[:, 10], reach + EQUAL
    indices, arc_lengths = [np.empty(0, np.intp)], [np.empty(0)]
    for part in np.array_split(np.arange(len(points)), 1 + len(points) * len(rows) // PAIRS):
        p, limit = points[part, None], within[part, None]
        offset = p - rows[:, :3]
        along, across = (np.einsum("psa,sa->ps", offset, rows[:, i : i + 3]) for i in (3, 6))
        angle = np.arctan2(k * along, 1 - k * across)
        angle = np.where(angle < 0, angle + 2 * np.pi, angle)
        arc = np.where(k == 0, along, angle / np.where(k == 0, np.inf, k))
        arc = np.clip(arc, 0.0, length)
        half = k * arc / 2
        components = arc * np.sinc(2 * half / np.pi), arc * half * np.sinc(half / np.pi) ** 2
        foot = (
            offset
            - components[0][..., None] * rows[:, 3:6]
            - components[1][..., None] * rows[:, 6:9]
        )
        for gap, u in (
            (offset, np.zeros_like(arc)),
            (foot, arc),
            (p - rows[:, 12:15], np.broadcast_to(length, arc.shape)),
        ):
            i, j = np.nonzero(np.sqrt(np.einsum("psa,psa->ps", gap, gap)) <= limit)
            indices.append(part[i])
            arc_lengths.append(rows[j, 11] + u[i, j])
    return np.concatenate(indices), np.concatenate(arc_lengths)


@compiled(inner=True)
def _tool_distances(
    p: Point, q: Point, motion: FollowedTool, i: int, until: float, reach: float
) -> tuple[float, float, float]:
    """Distances of two path points from the tool's motion around its chord i [m], and a bound."""
    # The motion extends by `reach` on both sides of the chord, and until the tool has passed
    # `end_time` for the last time. The bound holds for all points on the line between them: it is
    # the distance of the end that is farther from a chord.
    a = b = bound = math.inf
    for step in (1, -1):
        j, gone, spare = i, 0.0, 0.0
        while 0 <= j < len(motion.sizes):
            returns = step > 0 and motion.later[j] < until
            if j != i and not returns and gone > reach:
                break
            # A chord is nearer than an earlier one by at most the length from there to its end.
            spare -= motion.sizes[j]
            if spare <= EQUAL:
                x = y = 0.0
                for point in (p, q):
                    dot = size2 = 0.0
                    for axis in range(3):
                        chord = motion.points[j + 1, axis] - motion.points[j, axis]
                        dot += (point[axis] - motion.points[j, axis]) * chord
                        size2 += chord * chord
                    fraction = min(max(dot / size2, 0.0), 1.0) if size2 > 0.0 else 0.0
                    total = 0.0
                    for axis in range(3):
                        chord = motion.points[j + 1, axis] - motion.points[j, axis]
                        total += (point[axis] - motion.points[j, axis] - fraction * chord) ** 2
                    x, y = y, math.sqrt(total)
                a, b, bound = min(a, x), min(b, y), min(bound, max(x, y))
                spare = min(x - a, y - b, max(x, y) - bound)
            gone = 0.0 if j == i or returns else gone + motion.sizes[j]
            j += step
    return a, b, bound


@compiled()
def _measure_parts(
    motion: FollowedTool,
    rows: FloatArray,
    order: IntArray,
    parts: IntArray,
    arc_lengths: FloatArray,
    bounds: FloatArray,
    distances: FloatArray,
    distance_s: FloatArray,
) -> None:
    """Largest distance from parts of the path to the tool, for each point that starts a step."""
    # A part is measured at its ends and halved while a bound exceeds the largest distance so far.
    # `parts` are the step, the segment, and whether the part is the last of its step, (m, 3).
    # Updates `distances` [m], -1 where nothing was measured, and their arc lengths `distance_s`,
    # (n,) each. The largest is at most SURE below that of the whole path.
    n = len(motion.points)
    halves, worst = np.empty((MAX_HALVES, 2)), -1.0
    for m in order:
        if bounds[m] <= worst + SURE:
            continue
        i, g, first, last = parts[m, 0], rows[parts[m, 1]], arc_lengths[m, 0], arc_lengths[m, 1]
        chord, size = min(i, n - 2), last - first
        p, q = point_at(g, first - g[11]), point_at(g, last - g[11])
        # Distances from this chord only.
        a, b, _ = _tool_distances(p, q, motion, chord, -math.inf, -1.0)
        reach = 2 * (max(a, b) + min(g[9] * size**2 / 8, size / 2))
        count, halves[0, 0], halves[0, 1] = 1, first, last
        while count:
            count -= 1
            first_s, last_s = halves[count, 0], halves[count, 1]
            p, q = point_at(g, first_s - g[11]), point_at(g, last_s - g[11])
            a, b, bound = _tool_distances(p, q, motion, chord, last, reach)
            # The end of the step is the path point of the next tool point.
            end_point = i + 1 if parts[m, 2] and last_s == last and i < n - 1 else i
            for d, arc_length, point in ((a, first_s, i), (b, last_s, end_point)):
                if d > distances[point]:
                    distances[point], distance_s[point] = d, arc_length
            worst = max(worst, a, b)
            # A distance changes by at most the change of arc length.
            apart = last_s - first_s
            bound = min(bound + g[9] * apart**2 / 8, (a + b + apart) / 2)
            middle = first_s + apart / 2
            if bound > worst + SURE and first_s < middle < last_s:
                halves[count, 0], halves[count, 1] = middle, last_s
                halves[count + 1, 0], halves[count + 1, 1] = first_s, middle
                count += 2


def measure_coverage(
    motion: FollowedTool, rows: FloatArray, begin: float, end: float
) -> tuple[FloatArray, FloatArray]:
    """Largest distance from the path to the tool, for the path interval of each tool step."""
    # Intervals are split at segment ends. The step from the point with the largest distance comes
    # first, because most others then need no measurement.
    # rows (rows, 15).
    # Returns distances [m], -1 without a measurement, and arc lengths [m], (n,) each. The first row
    # includes the path before the first tool point, the last row the path after the last.
    reached = np.maximum.accumulate(motion.s)
    low = np.append(begin, np.maximum(reached[1:], begin))
    high = np.append(np.minimum(np.maximum(reached[:-1], motion.s[1:]), end), end)
    starts, ends = rows[:, 11], rows[:, 11] + rows[:, 10]
    segment = np.minimum(np.searchsorted(ends, low, side="right"), len(rows) - 1)
    count = np.maximum(np.searchsorted(starts, high, side="left") - segment, 1)
    count[(low > high) | ((low == high) & (np.arange(len(low)) > 0))] = 0
    step, number = number_parts(count)
    k = segment[step] + number
    first, last = np.maximum(low[step], starts[k]), np.minimum(high[step], ends[k])
    # The distance of a part between two path points exceeds theirs by at most the sagitta.
    sag = np.minimum(rows[k, 9] * (last - first) ** 2 / 8, (last - first) / 2)
    after = np.minimum(step + 1, len(low) - 1)
    whole = (after > step) & (first == motion.s[step]) & (last == motion.s[after])
    bounds = np.where(
        whole, sag + np.maximum(motion.distance[step], motion.distance[after]), np.inf
    )
    worst = np.flatnonzero(step == np.argmax(motion.distance))
    order = np.concatenate([worst, np.arange(len(step))])
    parts = np.stack([step, k, last == high[step]], axis=1)
    arc_lengths, distances, distance_s = (
        np.stack([first, last], axis=1),
        np.full(len(low), -1.0),
        np.zeros(len(low)),
    )
    _measure_parts(motion, rows, order, parts, arc_lengths, bounds, distances, distance_s)
    return distances, distance_s
