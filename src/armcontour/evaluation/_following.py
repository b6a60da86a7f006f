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
# A stretch of the path that is passed in one step is looked at in so many places if it may be
# farther from the tool than its ends, as it is longer than LONG steps of the tool or as its ends
# are nearer to another step.
PLACES = 64
LONG = 4.0
# The farthest place between them is searched for to this share of what is between them.
FINE = 1e-7


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
def _tool_distance(
    p: FloatArray, x: float, points: FloatArray, sizes: FloatArray, later: FloatArray, i: int
) -> float:
    """Distance from a place of the path to the tool's way around its chord i.

    Looked at is twice as much of the way as the chord is far from the place, to both sides, and all
    of it until the tool is past the place for good.

    Args:
        p: The place as a point [m], (3,).
        x: The place as an arc length [m].
        points: Tool points, (n, 3).
        sizes: Lengths of the tool's chords [m], (n - 1,).
        later: Lowest place of the tool from each point on [m], (n,).
        i: The chord at which the tool passes the place first.
    """
    first2 = _chord_distance2(p, points[i], points[i + 1])
    first = best = math.sqrt(first2)
    for step in (1, -1):
        j, way = i + step, 0.0
        # A chord is nearer than an earlier one by no more than the way from there to its end.
        spare = first - best
        while 0 <= j <= len(points) - 2:
            returns = step > 0 and later[j] < x
            if not returns and way * way > 4 * first2:
                break
            spare -= sizes[j]
            if spare <= EQUAL:
                distance = math.sqrt(_chord_distance2(p, points[j], points[j + 1]))
                best = min(best, distance)
                spare = distance - best
            way = 0.0 if returns else way + sizes[j]
            j += step
    return best


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

    Looked at are every joint between segments, places between them that may be farther away,
    and the place of a point, unless another distance is known that is at least the point's own:
    its place is no further from the tool than that.

    Args:
        points: Tool points in order, padded to space [m], (n, 3) with n > 1.
        distance: Their distances from their places [m], (n,).
        s: Their places [m], (n,).
        geometry: Segments from `geometry.nearest.pack`, (segments, 12).
        begin: Places before this one do not count [m].
        end: Nor do places after this one [m].

    Returns:
        Distances [m] and where they are [m], (n,) each; the first row has what is before the first
        place, too, the last row what is after the last place. -1 where no place was looked at.
    """
    n = len(points)
    far, where, sizes, later = np.empty(n), np.empty(n), np.empty(n - 1), np.empty(n)
    for i in range(n - 1, -1, -1):
        far[i], where[i], later[i] = -1.0, 0.0, s[i]
        if i < n - 1:
            sizes[i], later[i] = _step_size(points, i), min(s[i], later[i + 1])
    p = np.empty(3)
    worst = -1.0
    # Joints and long stretches first: most other places need not be looked at then.
    for now_regular in (False, True):
        j, reached = 0, s[0]
        for i in range(n):
            reached = max(reached, s[i])
            low = begin if i == 0 else max(reached, begin)
            high = end if i == n - 1 else min(max(reached, s[i + 1]), end)
            if low > high:
                continue
            while j < len(geometry) - 1 and geometry[j, 11] + geometry[j, 10] < low:
                j += 1
            chord = min(i, n - 2)
            long = LONG * sizes[chord] + EQUAL
            regular = 0 < i < n - 1 and high - low <= long
            regular = regular and (high == low or high < geometry[j, 11] + geometry[j, 10])
            if regular != now_regular or (regular and distance[i] <= worst):
                continue
            k, at = j, low
            while True:
                g = geometry[k]
                until = min(high, g[11] + g[10])
                apart, least = (until - at) / PLACES, max(worst, far[i])
                # From a straight stretch the chord is the farthest at one of its ends.
                most = g[9] * (until - at) ** 2
                for here in (at, until):
                    _place(g, here - g[11], p)
                    most = max(
                        most,
                        g[9] * (until - at) ** 2
                        + math.sqrt(_chord_distance2(p, points[chord], points[chord + 1])),
                    )
                parts = PLACES if until - at > long or most > least + EQUAL else 1
                before, last = -1.0, -1.0
                for part in range(parts + 1):
                    here = at + (until - at) * part / parts
                    _place(g, here - g[11], p)
                    d = _tool_distance(p, here, points, sizes, later, chord)
                    # Between two places a peak is higher than both by half of what is between them.
                    if part > 1 and last >= max(before, d) and last + apart / 2 > least:
                        left, right, top = here - 2 * apart, here, 0.0
                        while right - left > FINE * apart:
                            third = (right - left) / 3
                            _place(g, left + third - g[11], p)
                            top = _tool_distance(p, left + third, points, sizes, later, chord)
                            _place(g, right - third - g[11], p)
                            other = _tool_distance(p, right - third, points, sizes, later, chord)
                            if top < other:
                                left, top = left + third, other
                            else:
                                right -= third
                        if top > far[i]:
                            far[i], where[i] = top, (left + right) / 2
                    before, last = last, d
                    # The end of the step is the place of the next point.
                    if part == parts and until == high and i < n - 1:
                        break
                    if d > far[i]:
                        far[i], where[i] = d, here
                if until >= high or k == len(geometry) - 1:
                    break
                k, at = k + 1, until
            worst = max(worst, far[i])
    return far, where
