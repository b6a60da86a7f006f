"""Compiled search for the places at which a tool follows a path, and for what it leaves out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Distances that differ by less than this are equal [m]: coordinates are not more exact.
EQUAL = 1e-9
# Stretches of the path that can be followed at a time; what is beyond joins the last one.
MOST_STRETCHES = 64
# Halves of a stretch that wait while it is searched for the place that is the farthest from the
# tool, and the precision of this distance [m].
MOST_HALVES, SURE = 64, 1e-10


class _Foot(NamedTuple):
    """A point seen from a segment.

    Its distance from the segment's line or full circle (`off2` is the part that no place on the
    segment makes smaller, squared), where the foot is along the line [m] or around the circle
    [rad], and the product of both radii for an arc; 0 for a line.
    """

    off2: float
    at: float
    product: float


@compiled(inner=True)
def _see(p: FloatArray, g: FloatArray) -> _Foot:
    """A point as a segment sees it."""
    along = 0.0
    across = 0.0
    for axis in range(3):
        gap = p[axis] - g[axis]
        along += gap * g[3 + axis]
        across += gap * g[6 + axis]
    k = g[9]
    off2 = 0.0
    for axis in range(3):
        gap = p[axis] - g[axis] - along * g[3 + axis]
        if k != 0.0:
            gap -= across * g[6 + axis]
        off2 += gap * gap
    if k == 0.0:
        return _Foot(off2, along, 0.0)
    radius = 1 / k
    own = math.hypot(along, radius - across)
    # Difference of both radii without cancellation.
    radial = (2 * radius * across - along * along - across * across) / (radius + own)
    return _Foot(off2 + radial * radial, math.atan2(k * along, 1 - k * across), radius * own)


@compiled(inner=True)
def _distance2(foot: _Foot, g: FloatArray, u: float) -> float:
    """Squared distance to the place `u` along a segment [m²]."""
    if g[9] == 0.0:
        return foot.off2 + (u - foot.at) ** 2
    return foot.off2 + 4 * foot.product * math.sin((g[9] * u - foot.at) / 2) ** 2


@compiled(inner=True)
def _reach(foot: _Foot, g: FloatArray, leash2: float) -> tuple[float, float, float]:
    """Half the length around its foot in which a segment is within the leash, the foot, a turn.

    All in metres along the segment; a negative half is nothing, and the turn of a line is 0.
    """
    k = g[9]
    room = leash2 - foot.off2
    if room < 0.0:
        return -1.0, 0.0, 0.0
    if k == 0.0:
        return math.sqrt(room), foot.at, 0.0
    turn = 2 * math.pi / k
    share = room / (4 * foot.product) if foot.product > 0.0 else 1.0
    half = turn / 2 if share >= 1.0 else 2 * math.asin(math.sqrt(share)) / k
    return half, foot.at / k, turn


@compiled(inner=True)
def _prefer(s: float, other: float, before: float) -> bool:
    """Whether a place is followed rather than an equally near one: the next one ahead."""
    ahead, also = s >= before - EQUAL, other >= before - EQUAL
    if ahead != also:
        return ahead
    return s < other if ahead else s > other


@compiled()
def follow(
    points: FloatArray, geometry: FloatArray, start: float, leash: float, needed: int
) -> tuple[FloatArray, FloatArray, int, bool]:
    """Nearest places that a tool can be at if it runs over the path without going back.

    At each point the stretches of the path are known that the tool can have reached if it never
    was further than the leash from its place, and its place never went back.

    Args:
        points: Tool points in order, padded to space [m], (n, 3).
        geometry: Segments from `geometry.nearest.pack`, (segments, 12).
        start: The first place is at or before this one [m].
        leash: Largest distance between tool and place [m].
        needed: So many points must be followed; those after them, as long as they can.

    Returns:
        Distances [m] and places [m], (n,) each; how many points were followed; and whether the
        nearest place of any point was held by the rule that places do not go back.
    """
    n = len(points)
    distance, s = np.empty(n), np.empty(n)
    low, high = np.empty(MOST_STRETCHES), np.empty(MOST_STRETCHES)
    first = np.empty(MOST_STRETCHES, np.intp)
    new_low, new_high = np.empty(MOST_STRETCHES), np.empty(MOST_STRETCHES)
    new_first = np.empty(MOST_STRETCHES, np.intp)
    count, low[0], high[0], first[0] = 1, 0.0, start, 0
    before, held, leash2 = 0.0, False, leash * leash
    for i in range(n):
        p = points[i]
        found = 0
        best, place, best_held = math.inf, 0.0, False
        done = -1.0
        for k in range(count):
            begin = max(low[k], done)
            if begin > high[k]:
                continue
            is_open = False
            j = first[k]
            while j < len(geometry):
                g = geometry[j]
                base, length = g[11], g[10]
                if base + length < begin:
                    j += 1
                    continue
                foot = _see(p, g)
                half, middle, turn = _reach(foot, g, leash2)
                for lap in range(0 if half < 0.0 else 1 if turn == 0.0 else 2):
                    centre = middle + lap * turn
                    x = max(centre - half, begin - base, 0.0)
                    y = min(centre + half, length)
                    if x > y:
                        continue
                    if not (is_open and base + x <= done + EQUAL):
                        if base + x > high[k]:
                            break
                        if found < MOST_STRETCHES:
                            new_low[found], new_first[found] = base + x, j
                            found += 1
                        is_open = True
                    done = max(done, base + y)
                    new_high[found - 1] = done
                    at = min(max(centre, x), y)
                    d = math.sqrt(_distance2(foot, g, at))
                    if d < best - EQUAL or (
                        d <= best + EQUAL and _prefer(base + at, place, before)
                    ):
                        place = base + at
                        # Held at the first place of the stretch, not at the end of a segment.
                        best_held = centre < x and x > 0.0 and base + x > new_low[found - 1] - EQUAL
                        best_held = best_held and base + x <= low[k] + EQUAL
                    best = min(best, d)
                if base + length >= high[k] and not (is_open and done >= base + length - EQUAL):
                    break
                j += 1
        if found == 0:
            return distance, s, i, held
        count = found
        low, new_low = new_low, low
        high, new_high = new_high, high
        first, new_first = new_first, first
        distance[i], s[i] = best, place
        if i < needed:
            held = held or best_held
        before = place
    return distance, s, n, held


@compiled()
def find_places(
    points: FloatArray, geometry: FloatArray, reach: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Nearest places of all segments within a distance of points, and ends of segments within it.

    Args:
        points: The points, padded to space [m], (n, 3).
        geometry: Segments from `geometry.nearest.pack`, (segments, 12).
        reach: The distances; what is further by rounding counts, too [m], (n,).

    Returns:
        The number of the point of each place, and the places [m].
    """
    of, places = np.empty(0, np.intp), np.empty(0)
    for write in range(2):
        count = 0
        for i in range(len(points)):
            reach2 = (reach[i] + EQUAL) ** 2
            for j in range(len(geometry)):
                g = geometry[j]
                foot = _see(points[i], g)
                if foot.off2 > reach2:
                    continue
                k, length = g[9], g[10]
                at = foot.at if k == 0.0 else foot.at / k
                if k != 0.0 and at < 0.0:
                    at += 2 * math.pi / k
                for u in (0.0, at, length):
                    if 0.0 <= u <= length and _distance2(foot, g, u) <= reach2:
                        if write:
                            of[count], places[count] = i, g[11] + u
                        count += 1
        if not write:
            of, places = np.empty(count, np.intp), np.empty(count)
    return of, places


@compiled(inner=True)
def _place(g: FloatArray, u: float, out: FloatArray) -> None:
    """The point at the distance u along a segment."""
    angle = g[9] * u
    along, across = u, 0.0
    if g[9] != 0.0:
        half = math.sin(angle / 2)
        along, across = math.sin(angle) / g[9], 2 * half * half / g[9]
    for axis in range(3):
        out[axis] = g[axis] + along * g[3 + axis] + across * g[6 + axis]


@compiled(inner=True)
def _chord_distance2(p: FloatArray, a: FloatArray, b: FloatArray) -> float:
    """Squared distance from a point to the line between two others."""
    dot, size = 0.0, 0.0
    for axis in range(3):
        dot += (p[axis] - a[axis]) * (b[axis] - a[axis])
        size += (b[axis] - a[axis]) ** 2
    share = min(max(dot / size, 0.0), 1.0) if size > 0.0 else 0.0
    total = 0.0
    for axis in range(3):
        total += (p[axis] - a[axis] - share * (b[axis] - a[axis])) ** 2
    return total


@compiled(inner=True)
def _step_size(points: FloatArray, i: int) -> float:
    """Length of the tool's chord i [m]."""
    return math.sqrt(
        (points[i + 1, 0] - points[i, 0]) ** 2
        + (points[i + 1, 1] - points[i, 1]) ** 2
        + (points[i + 1, 2] - points[i, 2]) ** 2
    )


@compiled(inner=True)
def _tool_distances(
    ends: FloatArray,
    points: FloatArray,
    sizes: FloatArray,
    later: FloatArray,
    i: int,
    until: float,
    reach: float,
) -> tuple[float, float, float]:
    """Distances of two places of the path from the tool's way around its chord i.

    The way is as long as `reach` on both sides of the chord, and all of it until the tool is past
    `until` for good.

    Args:
        ends: The places as points [m], (2, 3).
        points: Tool points, (n, 3).
        sizes: Lengths of the tool's chords [m], (n - 1,).
        later: Lowest place of the tool from each point on [m], (n,).
        i: The chord at which the tool passes the places first.
        until: A place as an arc length [m].
        reach: Length of the way on each side [m].

    Returns:
        Both distances [m], and a bound of the distances of all points between `ends` on a line:
        from each chord, one of the ends is the farthest.
    """
    a = b = most = math.inf
    for step in (1, -1):
        j, way, spare = i, 0.0, 0.0
        while 0 <= j < len(sizes):
            returns = step > 0 and later[j] < until
            if j != i and not returns and way > reach:
                break
            # A chord is nearer than an earlier one by no more than the way from there to its end.
            spare -= sizes[j]
            if spare <= EQUAL:
                x = math.sqrt(_chord_distance2(ends[0], points[j], points[j + 1]))
                y = math.sqrt(_chord_distance2(ends[1], points[j], points[j + 1]))
                a, b, most = min(a, x), min(b, y), min(most, max(x, y))
                spare = min(x - a, y - b, max(x, y) - most)
            way = 0.0 if j == i or returns else way + sizes[j]
            j += step
    return a, b, most


@compiled()
def measure_missed(
    points: FloatArray,
    distance: FloatArray,
    s: FloatArray,
    geometry: FloatArray,
    begin: float,
    end: float,
) -> tuple[FloatArray, FloatArray]:
    """Largest distance from the path to the tool, of the places passed from each point to the next.

    What the tool passes in one step is cut at joints between segments. A stretch is measured at
    its ends and halved while a bound exceeds the largest distance found so far. Not measured are
    stretches between the places of two points if no larger distance is possible there.

    Args:
        points: Tool points in order, padded to space [m], (n, 3) with n > 1.
        distance: Their distances from their places [m], (n,).
        s: Their places [m], (n,).
        geometry: Segments from `geometry.nearest.pack`, (segments, 12).
        begin: Places before this one do not count [m].
        end: Nor do places after this one [m].

    Returns:
        Distances [m] and where they are [m], (n,) each; the first row has what is before the first
        place, too, the last row what is after the last place. -1 where no place was measured. The
        largest distance is at most SURE below the largest of all places.
    """
    n = len(points)
    far, where, sizes, later = np.empty(n), np.empty(n), np.empty(n - 1), np.empty(n)
    for i in range(n - 1, -1, -1):
        far[i], where[i], later[i] = -1.0, 0.0, s[i]
        if i < n - 1:
            sizes[i], later[i] = _step_size(points, i), min(s[i], later[i + 1])
    ends, halves = np.empty((2, 3)), np.empty((MOST_HALVES, 2))
    worst = -1.0
    # The point with the largest distance first: most other stretches need not be measured then.
    top = int(np.argmax(distance))
    j, reached = 0, s[0]
    for turn in range(n + 1):
        i = turn - 1
        if turn == 0:
            i, j, reached = top, 0, s[: top + 1].max()
        elif turn == 1:
            j, reached = 0, s[0]
        reached = max(reached, s[i])
        low = begin if i == 0 else max(reached, begin)
        high = end if i == n - 1 else min(max(reached, s[i + 1]), end)
        if low > high or (low == high and i > 0):
            continue
        while j < len(geometry) - 1 and geometry[j, 11] + geometry[j, 10] <= low:
            j += 1
        chord = min(i, n - 2)
        for k in range(j, len(geometry)):
            g = geometry[k]
            first, last = max(low, g[11]), min(high, g[11] + g[10])
            if first >= last and k > j:
                break
            sag = min(g[9] * (last - first) ** 2 / 8, (last - first) / 2)
            if i < n - 1 and first == s[i] and last == s[i + 1]:
                bound = sag + max(distance[i], distance[i + 1])
                if bound <= worst + SURE:
                    break
            _place(g, first - g[11], ends[0])
            _place(g, last - g[11], ends[1])
            a2 = _chord_distance2(ends[0], points[chord], points[chord + 1])
            b2 = _chord_distance2(ends[1], points[chord], points[chord + 1])
            reach = 2 * (math.sqrt(max(a2, b2)) + sag)
            halves[0, 0], halves[0, 1], count = first, last, 1
            while count:
                count -= 1
                left, right = halves[count, 0], halves[count, 1]
                _place(g, left - g[11], ends[0])
                _place(g, right - g[11], ends[1])
                a, b, most = _tool_distances(ends, points, sizes, later, chord, last, reach)
                if a > far[i]:
                    far[i], where[i] = a, left
                # The end of the step is the place of the next point.
                own = i + 1 if right == high and i < n - 1 else i
                if b > far[own]:
                    far[own], where[own] = b, right
                worst = max(worst, a, b)
                apart = right - left
                # A distance changes by no more than its place.
                most = min(most + g[9] * apart**2 / 8, (a + b + apart) / 2)
                middle = left + apart / 2
                if most > worst + SURE and left < middle < right:
                    halves[count, 0], halves[count, 1] = middle, right
                    halves[count + 1, 0], halves[count + 1, 1] = left, middle
                    count += 2
    return far, where
