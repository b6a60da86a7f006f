"""Compiled search for the places at which a tool follows a path, and for what it leaves out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.geometry._segments import Foot, Point, distance2, find_foot, point_at

# Distances that differ by less than this are equal [m]: coordinates are not more exact.
EQUAL = 1e-9
# Stretches of the path that can be followed at a time; what is beyond joins the last one.
MOST_STRETCHES = 64
# Halves of a stretch that wait while it is searched for the place that is the farthest from the
# tool, and the precision of this distance [m].
MOST_HALVES, SURE = 64, 1e-10


class Way(NamedTuple):
    """The way of the tool.

    Attributes:
        points: Tool points in order, padded to space [m], (n, 3) with n > 1.
        distance: Their distances from their places [m], (n,).
        s: Their places on the path [m], (n,).
        sizes: Lengths of the tool's chords [m], (n - 1,).
        later: Lowest place of the tool from each point on [m], (n,).
    """

    points: FloatArray
    distance: FloatArray
    s: FloatArray
    sizes: FloatArray
    later: FloatArray


class Missed(NamedTuple):
    """Largest distances from the path to the tool [m] and their places [m], (n,) each."""

    far: FloatArray
    where: FloatArray


@compiled(inner=True)
def _reach(foot: Foot, k: float, leash2: float) -> tuple[float, int]:
    """Half the length around its foot in which a segment is within the leash, and the laps of it.

    A line passes its foot once and a full circle twice: there are no laps out of the leash.
    """
    room = leash2 - foot.off2
    if room < 0.0:
        return -1.0, 0
    if k == 0.0:
        return math.sqrt(room), 1
    share = room / (4 * foot.product) if foot.product > 0.0 else 1.0
    return (math.pi / k if share >= 1.0 else 2 * math.asin(math.sqrt(share)) / k), 2


@compiled(inner=True)
def _prefer(s: float, other: float, before: float) -> bool:
    """Whether a place is followed rather than an equally near one: the next one ahead."""
    ahead, also = s >= before - EQUAL, other >= before - EQUAL
    if ahead != also:
        return ahead
    return s < other if ahead else s > other


@compiled()
def follow(
    points: FloatArray, rows: FloatArray, start: float, leash: float, needed: int
) -> tuple[FloatArray, FloatArray, int, bool]:
    """Nearest places that a tool can be at if it runs over the path without going back.

    At each point the stretches of the path are known that the tool can have reached if it never
    was further than the leash from its place, and its place never went back.

    Args:
        points: Tool points in order, padded to space [m], (n, 3).
        rows: Segments from `geometry.nearest.pack`, (segments, 17).
        start: The first place is at or before this one [m].
        leash: Largest distance between tool and place [m].
        needed: So many points must be followed; those after them, as long as they can.

    Returns:
        Distances [m] and places [m], (n,) each; how many points were followed; and whether the
        nearest place of any point was held by the rule that places do not go back.
    """
    n = len(points)
    distance, s = np.empty(n), np.empty(n)
    # First and last places of the stretches, now and at the next point; and their first segments.
    ends, new_ends = np.empty((MOST_STRETCHES, 2)), np.empty((MOST_STRETCHES, 2))
    first, new_first = np.empty(MOST_STRETCHES, np.intp), np.empty(MOST_STRETCHES, np.intp)
    count, ends[0, 0], ends[0, 1], first[0] = 1, 0.0, start, 0
    before, held, leash2 = 0.0, False, leash * leash
    for i in range(n):
        p = points[i, 0], points[i, 1], points[i, 2]
        found = 0
        best, place, best_held = math.inf, 0.0, False
        done = -1.0
        for k in range(count):
            low, high = ends[k, 0], ends[k, 1]
            begin = max(low, done)
            if begin > high:
                continue
            is_open = False
            j = first[k]
            while j < len(rows):
                g = rows[j]
                base, length = g[11], g[10]
                if base + length < begin:
                    j += 1
                    continue
                foot = find_foot(p, g)
                half, laps = _reach(foot, g[9], leash2)
                for lap in range(laps):
                    centre = foot.at + lap * 2 * math.pi / g[9] if lap else foot.at
                    x = max(centre - half, begin - base, 0.0)
                    y = min(centre + half, length)
                    if x > y:
                        continue
                    if not (is_open and base + x <= done + EQUAL):
                        if base + x > high:
                            break
                        if found < MOST_STRETCHES:
                            new_ends[found, 0], new_first[found] = base + x, j
                            found += 1
                        is_open = True
                    done = max(done, base + y)
                    new_ends[found - 1, 1] = done
                    at = min(max(centre, x), y)
                    d = math.sqrt(distance2(foot, g[9], at))
                    if d < best - EQUAL or (
                        d <= best + EQUAL and _prefer(base + at, place, before)
                    ):
                        place = base + at
                        # Held at the first place of the stretch, not at the end of a segment.
                        best_held = (
                            centre < x and x > 0.0 and base + x > new_ends[found - 1, 0] - EQUAL
                        )
                        best_held = best_held and base + x <= low + EQUAL
                    best = min(best, d)
                if base + length >= high and not (is_open and done >= base + length - EQUAL):
                    break
                j += 1
        if found == 0:
            return distance, s, i, held
        count = found
        ends, new_ends = new_ends, ends
        first, new_first = new_first, first
        distance[i], s[i] = best, place
        if i < needed:
            held = held or best_held
        before = place
    return distance, s, n, held


@compiled()
def find_places(
    points: FloatArray, rows: FloatArray, reach: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Nearest places of all segments within a distance of points, and ends of segments within it.

    Args:
        points: The points, padded to space [m], (n, 3).
        rows: Segments from `geometry.nearest.pack`, (segments, 17).
        reach: The distances; what is further by rounding counts, too [m], (n,).

    Returns:
        The number of the point of each place, and the places [m].
    """
    of, places = np.empty(0, np.intp), np.empty(0)
    for write in range(2):
        count = 0
        for i in range(len(points)):
            p, reach2 = (points[i, 0], points[i, 1], points[i, 2]), (reach[i] + EQUAL) ** 2
            for j in range(len(rows)):
                foot, k, length = find_foot(p, rows[j]), rows[j, 9], rows[j, 10]
                if foot.off2 > reach2:
                    continue
                at = foot.at + 2 * math.pi / k if k != 0.0 and foot.at < 0.0 else foot.at
                for u in (0.0, at, length):
                    if 0.0 <= u <= length and distance2(foot, k, u) <= reach2:
                        if write:
                            of[count], places[count] = i, rows[j, 11] + u
                        count += 1
        if not write:
            of, places = np.empty(count, np.intp), np.empty(count)
    return of, places


@compiled(inner=True)
def _chord_distance(p: Point, points: FloatArray, j: int) -> float:
    """Distance from a point to chord j of the tool's way [m]."""
    a, b = points[j], points[j + 1]
    dot, size = 0.0, 0.0
    for axis in range(3):
        dot += (p[axis] - a[axis]) * (b[axis] - a[axis])
        size += (b[axis] - a[axis]) ** 2
    share = min(max(dot / size, 0.0), 1.0) if size > 0.0 else 0.0
    total = 0.0
    for axis in range(3):
        total += (p[axis] - a[axis] - share * (b[axis] - a[axis])) ** 2
    return math.sqrt(total)


@compiled(inner=True)
def _tool_distances(
    p: Point, q: Point, way: Way, i: int, until: float, reach: float
) -> tuple[float, float, float]:
    """Distances of two places of the path from the tool's way around its chord i.

    The way is as long as `reach` on both sides of the chord, and all of it until the tool is past
    `until` for good.

    Args:
        p: The first place as a point [m].
        q: The second one.
        way: The way of the tool.
        i: The chord at which the tool passes the places first.
        until: A place as an arc length [m].
        reach: Length of the way on each side [m].

    Returns:
        Both distances [m], and a bound of the distances of all points between both on a line: from
        each chord, one of the ends is the farthest.
    """
    a = b = most = math.inf
    for step in (1, -1):
        j, gone, spare = i, 0.0, 0.0
        while 0 <= j < len(way.sizes):
            returns = step > 0 and way.later[j] < until
            if j != i and not returns and gone > reach:
                break
            # A chord is nearer than an earlier one by no more than the way from there to its end.
            spare -= way.sizes[j]
            if spare <= EQUAL:
                x, y = _chord_distance(p, way.points, j), _chord_distance(q, way.points, j)
                a, b, most = min(a, x), min(b, y), min(most, max(x, y))
                spare = min(x - a, y - b, max(x, y) - most)
            gone = 0.0 if j == i or returns else gone + way.sizes[j]
            j += step
    return a, b, most


@compiled(inner=True)
def _search_part(
    g: FloatArray, halves: FloatArray, i: int, high: float, way: Way, missed: Missed, worst: float
) -> float:
    """Search a part of a segment for the place that is the farthest from the tool.

    Args:
        g: The segment.
        halves: Parts that wait as arc lengths; the first one is the part [m], (MOST_HALVES, 2).
        i: The step of the tool that passes the part.
        high: End of what the step passes [m].
        way: The way of the tool.
        missed: What was found, updated.
        worst: Largest distance so far [m].

    Returns:
        The largest distance [m].
    """
    n = len(way.points)
    chord, last = min(i, n - 2), halves[0, 1]
    p, q = point_at(g, halves[0, 0] - g[11]), point_at(g, last - g[11])
    size = last - halves[0, 0]
    reach = max(_chord_distance(p, way.points, chord), _chord_distance(q, way.points, chord))
    reach = 2 * (reach + min(g[9] * size**2 / 8, size / 2))
    count = 1
    while count:
        count -= 1
        left, right = halves[count, 0], halves[count, 1]
        p, q = point_at(g, left - g[11]), point_at(g, right - g[11])
        a, b, most = _tool_distances(p, q, way, chord, last, reach)
        if a > missed.far[i]:
            missed.far[i], missed.where[i] = a, left
        # The end of the step is the place of the next point.
        own = i + 1 if right == high and i < n - 1 else i
        if b > missed.far[own]:
            missed.far[own], missed.where[own] = b, right
        worst = max(worst, a, b)
        # A distance changes by no more than its place.
        apart = right - left
        most = min(most + g[9] * apart**2 / 8, (a + b + apart) / 2)
        middle = left + apart / 2
        if most > worst + SURE and left < middle < right:
            halves[count, 0], halves[count, 1] = middle, right
            halves[count + 1, 0], halves[count + 1, 1] = left, middle
            count += 2
    return worst


@compiled()
def measure_missed(way: Way, rows: FloatArray, begin: float, end: float) -> Missed:
    """Largest distance from the path to the tool, of the places passed from each point to the next.

    What the tool passes in one step is cut at joints between segments. A stretch is measured at
    its ends and halved while a bound exceeds the largest distance found so far. Not measured are
    stretches between the places of two points if no larger distance is possible there.

    Args:
        way: The way of the tool.
        rows: Segments from `geometry.nearest.pack`, (segments, 17).
        begin: Places before this one do not count [m].
        end: Nor do places after this one [m].

    Returns:
        Distances and places; the first row has what is before the first place, too, the last row
        what is after the last place. -1 where no place was measured. The largest distance is at
        most SURE below the largest of all places.
    """
    s, n = way.s, len(way.s)
    missed, halves = Missed(np.full(n, -1.0), np.zeros(n)), np.empty((MOST_HALVES, 2))
    worst = -1.0
    # The point with the largest distance first: most other stretches need not be measured then.
    top = int(np.argmax(way.distance))
    j, reached = 0, s[0]
    for turn in range(n + 1):
        i = top if turn == 0 else turn - 1
        if turn < 2:
            j, reached = 0, s[: i + 1].max()
        reached = max(reached, s[i])
        low = begin if i == 0 else max(reached, begin)
        high = end if i == n - 1 else min(max(reached, s[i + 1]), end)
        if low > high or (low == high and i > 0):
            continue
        while j < len(rows) - 1 and rows[j, 11] + rows[j, 10] <= low:
            j += 1
        for k in range(j, len(rows)):
            g = rows[k]
            first, last = max(low, g[11]), min(high, g[11] + g[10])
            if first >= last and k > j:
                break
            if i < n - 1 and first == s[i] and last == s[i + 1]:
                sag = min(g[9] * (last - first) ** 2 / 8, (last - first) / 2)
                if sag + max(way.distance[i], way.distance[i + 1]) <= worst + SURE:
                    break
            halves[0, 0], halves[0, 1] = first, last
            worst = _search_part(g, halves, i, high, way, missed, worst)
    return missed
