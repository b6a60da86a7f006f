"""Compiled search for the path points of a tool that follows a path, and coverage error."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernel_cache import compiled
from armcontour.geometry.kernels import Foot, Point, distance2, find_foot, point_at

# Distances that differ by less than this are equal, because coordinates are not more accurate [m].
EQUAL = 1e-9
# Largest number of reachable path intervals; further intervals are merged with the last one.
MAX_STRETCHES = 64
# Search of a path part for the point farthest from the tool: largest number of subintervals on the
# stack.
MAX_SUBINTERVALS = 64
# Search of a path part for the point farthest from the tool: accuracy of the distance [m].
DISTANCE_ACCURACY = 1e-10
# Approximate number of point-segment pairs per batch, to bound the memory.
PAIRS_AT_ONCE = 50_000


class FollowedTool(NamedTuple):
    """Tool points in order, with their path points and the chords between them."""

    points: FloatArray  # Tool points, padded to three coordinates [m], (n, 3) with n > 1
    distance: FloatArray  # Distances of the tool points from their path points [m], (n,)
    s: FloatArray  # Arc lengths of the path points [m], (n,)
    sizes: FloatArray  # Lengths of the tool's chords [m], (n - 1,)
    later: FloatArray  # Smallest arc length of a path point and all later ones [m], (n,)


class PathIntervals(NamedTuple):
    """Intervals of the path that the tool can have reached, in order."""

    ends: FloatArray  # First and last arc lengths [m], (MAX_STRETCHES + 1, 2)
    first: IntArray  # Segments on which the intervals begin, (MAX_STRETCHES + 1,)


class _Reach(NamedTuple):
    """Part of a segment, or of its circle, within the leash of a point, which is symmetric."""

    nearest: float  # Arc length of its middle, the nearest point [m]
    half: float  # Half of its length [m]
    turn: float  # Length of the circle [m]; 0 on a line
    laps: int  # Number of middles: 2 on a circle, 1 on a line, 0 if no point is within the leash


class _PathPoint(NamedTuple):
    """Path point of a tool point."""

    distance: float  # [m]
    s: float  # Arc length [m]
    # True if it is the start of an interval only because arc length must not decrease
    held: bool


class FollowedPoints(NamedTuple):
    """Path points of tool points."""

    distance: FloatArray  # Distance of each path point [m], (n,)
    s: FloatArray  # Arc length of each path point [m], (n,)
    followed: int  # Number of tool points that were followed
    held: bool  # True if any path point was restricted because arc length must not decrease


@compiled(inner=True)
def _part_within(foot: Foot, curvature: float, leash2: float) -> _Reach:
    """Part of a line or circle at most the leash from a point, given the point's foot point."""
    room = leash2 - foot.off2
    if not room >= 0.0:
        return _Reach(foot.along, 0.0, 0.0, 0)
    if curvature == 0.0:
        return _Reach(foot.along, math.sqrt(room), 0.0, 1)
    turn = 2 * math.pi / curvature
    nearest = math.atan2(foot.along, foot.across) / curvature
    # The squared distance of a point of the circle exceeds the smallest one by farthest2 times the
    # squared sine of half its angle from the foot point.
    farthest2 = distance2(foot, curvature, turn / 2) - foot.off2
    fraction = room / farthest2 if room < farthest2 else 1.0
    return _Reach(nearest, 2 * math.asin(math.sqrt(fraction)) / curvature, turn, 2)


@compiled(inner=True)
def _reachable_intervals(
    p: Point,
    rows: FloatArray,
    old: PathIntervals,
    count: int,
    new: PathIntervals,
    before: float,
    leash2: float,
) -> tuple[int, _PathPoint]:
    """Find the path intervals that the tool can reach at point p, and the nearest path point.

    From each point of an old interval, the tool may move ahead on the path as long as the path is
    within the leash. Returns the number of new intervals and the path point.

    - `rows`: segments from `pack_segments`, (segments, 15).
    - `old`, `count`: intervals of the previous tool point, and their number.
    - `new`: intervals of this tool point, output.
    - `before`: arc length of the previous path point [m].
    - `leash2`: square of the largest distance [m²].
    """
    new_count = 0
    point = _PathPoint(math.inf, 0.0, False)
    done = -1.0
    for k in range(count):
        low, high = old.ends[k, 0], old.ends[k, 1]
        begin = max(low, done)
        # True while the last new interval may continue on the next segment
        is_open = False
        for j in range(old.first[k], len(rows) if begin <= high else 0):
            base = rows[j, 11]
            length = rows[j, 10]
            curvature = rows[j, 9]
            if base + length < begin:
                continue
            foot = find_foot(p, rows[j])
            reach = _part_within(foot, curvature, leash2)
            for lap in range(reach.laps):
                # Part of the segment from x to y, around a nearest point
                centre = reach.nearest + lap * reach.turn
                x = max(centre - reach.half, begin - base, 0.0)
                y = min(centre + reach.half, length)
                if x > y:
                    continue
                # It continues the open interval, or begins a new one, if the tool can get there.
                if not (is_open and base + x <= done + EQUAL):
                    if base + x > high:
                        break
                    new.ends[new_count, 0] = base + x
                    new.first[new_count] = j
                    new_count = min(new_count + 1, MAX_STRETCHES)
                    is_open = True
                done = max(done, base + y)
                new.ends[new_count - 1, 1] = done
                # Its nearest point; of equally near ones, the next one ahead of `before`
                arc = min(max(centre, x), y)
                d = math.sqrt(distance2(foot, curvature, arc - centre))
                is_equal = d <= point.distance + EQUAL
                if d < point.distance - EQUAL or (is_equal and point.s < before - EQUAL):
                    # The start of a segment alone does not restrict the path point.
                    held = centre < x and x > 0.0 and base + x <= low + EQUAL
                    point = _PathPoint(min(point.distance, d), base + arc, held)
                else:
                    point = _PathPoint(min(point.distance, d), point.s, point.held)
            # Beyond the old interval, the next segment is reached only through this one's end.
            if base + length >= high and not (is_open and done >= base + length - EQUAL):
                break
    return new_count, point


@compiled()
def follow(
    points: FloatArray, rows: FloatArray, start: float, leash: float, needed: int
) -> FollowedPoints:
    """Find the path points of a tool that never moves back on the path.

    At each point, the kernel stores the intervals of the path that the tool can have reached if its
    distance from the path point never exceeded `leash` [m] and arc length never decreased.

    The first path point is at or before `start` [m]. The first `needed` points must be followed,
    later points only until the tool leaves the path; `held` ignores them.

    - `points`: tool points in order [m], (n, 3).
    - `rows`: segments from `pack_segments`, (segments, 15).
    """
    n = len(points)
    size = MAX_STRETCHES + 1
    distance = np.empty(n)
    s = np.empty(n)
    old = PathIntervals(np.empty((size, 2)), np.empty(size, np.intp))
    new = PathIntervals(np.empty((size, 2)), np.empty(size, np.intp))
    old.ends[0, 0] = 0.0
    old.ends[0, 1] = start
    old.first[0] = 0
    count = 1
    before = 0.0
    held = False
    for i in range(n):
        p = points[i, 0], points[i, 1], points[i, 2]
        count, point = _reachable_intervals(p, rows, old, count, new, before, leash * leash)
        if count == 0:
            return FollowedPoints(distance, s, i, held)
        old, new = new, old
        distance[i] = point.distance
        s[i] = before = point.s
        held = held or (point.held and i < needed)
    return FollowedPoints(distance, s, n, held)


@compiled()
def find_tops(
    t: FloatArray, values: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Find the intervals in which the values may exceed those at both ends.

    Returns the indices of their first samples; where the kink and the top of the parabola are, as
    fractions of the interval; and bounds of the values, (m,) each. The bound is the value of a
    kink: the intersection of the lines through the two samples before and through the two samples
    after the interval. A parabola rises a quarter as much.

    - `t`, `values`: increasing times [s] and values at them, (n,) each.
    """
    last = len(t) - 2
    slopes = np.empty(last + 1)
    for i in range(last + 1):
        slopes[i] = (values[i + 1] - values[i]) / (t[i + 1] - t[i])
    top = np.empty(last + 2, np.intp)
    kink = np.empty(last + 2)
    parabola_top = np.empty(last + 2)
    bound = np.empty(last + 2)
    count = 0
    for i in range(last + 1):
        is_end = i == 0 or i == last
        if not is_end and not (values[i] > values[i - 1] and values[i + 2] < values[i + 1]):
            continue
        # Slopes of the intervals before (a) and after (b). Beyond the ends, the curvature is
        # assumed to be that of the adjacent interval.
        slope = slopes[i]
        a = slopes[i - 1] if i > 0 else 2 * slope - slopes[min(1, last)]
        b = slopes[i + 1] if i < last else 2 * slope - slopes[max(last - 1, 0)]
        if not (a > 0.0 and b < 0.0):
            continue
        width = t[i + 1] - t[i]
        top[count] = i
        kink[count] = min(max((slope - b) / (a - b), 0.0), 1.0)
        parabola_top[count] = min(max(0.5 + 2 * slope / (a - b), 0.0), 1.0)
        highest_end = max(values[i], values[i + 1])
        bound[count] = max(values[i] + a * width * kink[count], highest_end)
        count += 1
    return top[:count], kink[:count], parabola_top[:count], bound[:count]


@compiled()
def find_candidates(
    t: FloatArray, values: FloatArray, threshold: float
) -> tuple[IntArray, FloatArray]:
    """Find the intervals in which the values may exceed a threshold.

    Returns the indices of their first samples, and bounds of the values, (m,) each. An interval may
    be found twice, for two reasons.

    - `t`, `values`: increasing times [s] and values at them, (n,) each with n > 2.
    """
    n = len(values)
    top, _, _, top_bound = find_tops(t, values)
    index = np.empty(len(top) + n, np.intp)
    bound = np.empty(len(top) + n)
    count = 0
    for k in range(len(top)):
        # Without a sample that counts, the threshold is no number, and all tops are searched.
        if not top_bound[k] <= threshold:
            index[count] = top[k]
            bound[count] = top_bound[k]
            count += 1
    # Where the second difference changes its sign, the samples do not resolve the ripple.
    curvature = (values[2] - values[1]) - (values[1] - values[0])
    for i in range(n - 1):
        before = curvature
        if 0 < i < n - 2:
            curvature = (values[i + 2] - values[i + 1]) - (values[i + 1] - values[i])
        ripple = max(values[i], values[i + 1]) + (abs(before) + abs(curvature)) / 4
        if ripple > threshold and before * curvature <= 0.0:
            index[count] = i
            bound[count] = ripple
            count += 1
    return index[:count], bound[:count]


def find_path_points(
    points: FloatArray, rows: FloatArray, reach: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Find all path points near each point: indices of points, and arc lengths [m], (m,) each.

    They are the foot points and the ends of segments within a distance.

    - `points`: tool points [m], (n, 3).
    - `rows`: segments from `pack_segments`, (segments, 15).
    - `reach`: largest distance of each point [m], (n,).
    """
    k = rows[:, 9]
    length = rows[:, 10]
    within = reach + EQUAL
    indices = [np.empty(0, np.intp)]
    arc_lengths = [np.empty(0)]
    for part in np.array_split(
        np.arange(len(points)), 1 + len(points) * len(rows) // PAIRS_AT_ONCE
    ):
        p = points[part, None]
        limit = within[part, None]
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
    """Return the distances of path points p and q from the tool near chord i [m], and a bound.

    The searched motion extends by `reach` on both sides of the chord, and until the tool has passed
    `until` for the last time. The bound holds for all points on the line from p to q: it is the
    smallest value, over all chords, of the larger of the distances of p and q from the chord.
    """
    a = b = bound = math.inf
    for step in (1, -1):
        j = i
        gone = 0.0
        spare = 0.0
        while 0 <= j < len(motion.sizes):
            returns = step > 0 and motion.later[j] < until
            if j != i and not returns and gone > reach:
                break
            # Skip chords that cannot be nearer: the next chord is nearer by at most the tool's
            # travel to its far end.
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
                    x = y
                    y = math.sqrt(total)
                a = min(a, x)
                b = min(b, y)
                bound = min(bound, max(x, y))
                spare = min(x - a, y - b, max(x, y) - bound)
            gone = 0.0 if j == i or returns else gone + motion.sizes[j]
            j += step
    return a, b, bound


@compiled(inner=True)
def _measure_part(
    motion: FollowedTool,
    segment: FloatArray,
    i: int,
    ends: tuple[float, float],
    next_point: int,
    worst: float,
    halves: FloatArray,
    distances: FloatArray,
    distance_s: FloatArray,
) -> float:
    """Measure the distances from a part of the path to the tool; return the largest of all [m].

    The part is measured at its ends, and halved while its bound exceeds the largest distance so
    far. The largest distance found is at most DISTANCE_ACCURACY below the largest distance of the
    part.

    - `segment`: row of `pack_segments`.
    - `i`: index of the tool point before the part.
    - `ends`: first and last arc length of the part [m].
    - `next_point`: index of the tool point to which the end of the part belongs.
    - `worst`: largest distance so far [m].
    - `halves`: memory for subintervals, (MAX_SUBINTERVALS, 2).
    - `distances`, `distance_s`: output, see `measure_coverage`.
    """
    first, last = ends
    chord = min(i, len(motion.points) - 2)
    size = last - first
    p = point_at(segment, first - segment[11])
    q = point_at(segment, last - segment[11])
    # Range of chords to search: the distances from this chord alone bound it.
    a, b, _ = _tool_distances(p, q, motion, chord, -math.inf, -1.0)
    reach = 2 * (max(a, b) + min(segment[9] * size**2 / 8, size / 2))
    # Depth-first search by halving
    count = 1
    halves[0, 0] = first
    halves[0, 1] = last
    while count:
        count -= 1
        first_s = halves[count, 0]
        last_s = halves[count, 1]
        p = point_at(segment, first_s - segment[11])
        q = point_at(segment, last_s - segment[11])
        a, b, bound = _tool_distances(p, q, motion, chord, last, reach)
        end_point = next_point if last_s == last else i
        for d, arc_length, point in ((a, first_s, i), (b, last_s, end_point)):
            if d > distances[point]:
                distances[point] = d
                distance_s[point] = arc_length
        worst = max(worst, a, b)
        # The distance from the tool changes by at most the change of arc length.
        apart = last_s - first_s
        bound = min(bound + segment[9] * apart**2 / 8, (a + b + apart) / 2)
        middle = first_s + apart / 2
        if bound > worst + DISTANCE_ACCURACY and first_s < middle < last_s:
            halves[count, 0] = middle
            halves[count, 1] = last_s
            halves[count + 1, 0] = first_s
            halves[count + 1, 1] = middle
            count += 2
    return worst


@compiled(inner=True)
def _segment_of(rows: FloatArray, s: float) -> int:
    """Return the first segment of `pack_segments` that ends after an arc length [m], or the last.

    - `rows`: segments from `pack_segments`, (segments, 15).
    """
    low = 0
    high = len(rows) - 1
    while low < high:
        middle = (low + high) // 2
        if rows[middle, 11] + rows[middle, 10] <= s:
            low = middle + 1
        else:
            high = middle
    return low


@compiled()
def measure_coverage(
    motion: FollowedTool, rows: FloatArray, begin: float, end: float
) -> tuple[FloatArray, FloatArray]:
    """Measure the largest distance from the path to the tool, for the path interval of each step.

    The path interval of a step is split at segment ends. The step with the largest known distance
    is measured first, because most other steps then need no measurement.

    Returns distances [m], -1 if not measured, and arc lengths [m], (n,) each. The first row
    includes the path before the first tool point, the last row the path after the last tool point.

    - `rows`: segments from `pack_segments`, (segments, 15).
    - `begin`, `end`: arc lengths between which the path is measured [m].
    """
    n = len(motion.points)
    distances = np.full(n, -1.0)
    distance_s = np.zeros(n)
    halves = np.empty((MAX_SUBINTERVALS, 2))
    reached = np.empty(n)
    farthest = 0
    for i in range(n):
        reached[i] = max(reached[i - 1], motion.s[i]) if i > 0 else motion.s[i]
        if motion.distance[i] > motion.distance[farthest]:
            farthest = i
    worst = -1.0
    for turn in range(n + 1):
        i = turn - 1 if turn > 0 else farthest
        # Path interval of the step
        low = max(reached[i], begin) if i > 0 else begin
        high = min(reached[i + 1], end) if i < n - 1 else end
        if low > high or (low == high and i > 0):
            continue
        # Its parts on successive segments
        k = _segment_of(rows, low)
        while True:
            first = max(low, rows[k, 11])
            last = min(high, rows[k, 11] + rows[k, 10])
            bound = math.inf
            if i < n - 1 and first == motion.s[i] and last == motion.s[i + 1]:
                # Between two path points, the distance exceeds the distances at both by at most the
                # sagitta.
                sag = min(rows[k, 9] * (last - first) ** 2 / 8, (last - first) / 2)
                bound = sag + max(motion.distance[i], motion.distance[i + 1])
            if bound > worst + DISTANCE_ACCURACY:
                # The end of the last part of a step is the path point of the next tool point.
                next_point = i + 1 if last == high and i < n - 1 else i
                part = first, last
                worst = _measure_part(
                    motion, rows[k], i, part, next_point, worst, halves, distances, distance_s
                )
            k += 1
            if k == len(rows) or rows[k, 11] >= high:
                break
    return distances, distance_s
