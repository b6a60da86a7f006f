"""Compiled search for the places at which a tool follows a path, and for what it leaves out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled
from armcontour.core.sampling import number_parts
from armcontour.geometry._segments import Point, distance2, find_foot, point_at

# Distances that differ by less than this are equal [m]: coordinates are not more exact.
EQUAL = 1e-9
# Stretches of the path that can be followed at a time; what is beyond joins the last one.
MOST_STRETCHES = 64
# Halves of a part that wait while it is searched for the place that is the farthest from the tool,
# and the precision of this distance [m].
MOST_HALVES, SURE = 64, 1e-10
# Number of pairs of a point and a segment that are looked at together, about, to bound the memory.
PAIRS = 50_000


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


class Stretches(NamedTuple):
    """Stretches of the path on which the tool can be, in order.

    Attributes:
        ends: Their first and last places [m], (MOST_STRETCHES + 1, 2).
        first: The segments on which they begin, (MOST_STRETCHES + 1,).
    """

    ends: FloatArray
    first: IntArray


@compiled(inner=True)
def _reach(
    p: Point,
    rows: FloatArray,
    old: Stretches,
    count: int,
    new: Stretches,
    before: float,
    leash2: float,
) -> tuple[int, float, float, bool]:
    """Find the stretches on which the tool can be at a point, and its nearest place on them.

    Args:
        p: The point [m].
        rows: As in `follow`.
        old: The stretches at the last point.
        count: Their number.
        new: Those at this point, updated.
        before: Place at the last point [m].
        leash2: Largest squared distance between tool and place [m²].

    Returns:
        The number of the new stretches, distance and place of the tool [m], and whether the place
        was held by the rule that places do not go back.
    """
    found, best, place, held, done = 0, math.inf, 0.0, False, -1.0
    for k in range(count):
        low, high = old.ends[k, 0], old.ends[k, 1]
        begin, is_open = max(low, done), False
        for j in range(old.first[k], len(rows) if begin <= high else 0):
            base, length, curvature = rows[j, 11], rows[j, 10], rows[j, 9]
            if base + length < begin:
                continue
            foot = find_foot(p, rows[j])
            room = leash2 - foot.off2
            # A line passes its foot once and a full circle twice.
            laps, turn, nearest = 1, 0.0, foot.along
            # Half the length around its foot in which the segment is within the leash.
            half = math.sqrt(max(room, 0.0))
            if curvature != 0.0 and room >= 0.0:
                laps, turn = 2, 2 * math.pi / curvature
                nearest = math.atan2(foot.along, foot.across) / curvature
                # Squared distance of the farthest place of the circle, less that of the nearest.
                most = distance2(foot, curvature, turn / 2) - foot.off2
                share = room / most if room < most else 1.0
                half = 2 * math.asin(math.sqrt(share)) / curvature
            for lap in range(laps if room >= 0.0 else 0):
                centre = nearest + lap * turn
                x, y = max(centre - half, begin - base, 0.0), min(centre + half, length)
                if x > y:
                    continue
                if not (is_open and base + x <= done + EQUAL):
                    if base + x > high:
                        break
                    new.ends[found, 0], new.first[found] = base + x, j
                    found, is_open = min(found + 1, MOST_STRETCHES), True
                done = max(done, base + y)
                new.ends[found - 1, 1] = done
                at = min(max(centre, x), y)
                d = math.sqrt(distance2(foot, curvature, at - centre))
                # Of equally near places, the next one ahead is followed.
                if d < best - EQUAL or (d <= best + EQUAL and place < before - EQUAL):
                    place = base + at
                    # Held at the first place of the stretch, not at the end of a segment.
                    held = centre < x and x > 0.0 and base + x <= low + EQUAL
                best = min(best, d)
            if base + length >= high and not (is_open and done >= base + length - EQUAL):
                break
    return found, best, place, held


@compiled()
def follow(
    points: FloatArray, rows: FloatArray, start: float, leash: float, needed: int
) -> tuple[FloatArray, FloatArray, int, bool]:
    """Nearest places that a tool can be at if it runs over the path without going back.

    At each point the stretches of the path are known that the tool can have reached if it never
    was further than the leash from its place, and its place never went back.

    Args:
        points: Tool points in order, padded to space [m], (n, 3).
        rows: Segments from `geometry.nearest.pack`, (segments, 15).
        start: The first place is at or before this one [m].
        leash: Largest distance between tool and place [m].
        needed: So many points must be followed; those after them, as long as they can.

    Returns:
        Distances [m] and places [m], (n,) each; how many points were followed; and whether the
        nearest place of any point was held by the rule that places do not go back.
    """
    n, size = len(points), MOST_STRETCHES + 1
    distance, s = np.empty(n), np.empty(n)
    now = Stretches(np.empty((size, 2)), np.empty(size, np.intp))
    after = Stretches(np.empty((size, 2)), np.empty(size, np.intp))
    now.ends[0, 0], now.ends[0, 1], now.first[0] = 0.0, start, 0
    count, before, held = 1, 0.0, False
    for i in range(n):
        p = points[i, 0], points[i, 1], points[i, 2]
        count, best, before, own_held = _reach(p, rows, now, count, after, before, leash * leash)
        if count == 0:
            return distance, s, i, held
        now, after = after, now
        distance[i], s[i] = best, before
        held = held or (own_held and i < needed)
    return distance, s, n, held


def find_places(
    points: FloatArray, rows: FloatArray, reach: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Nearest places of all segments within a distance of points, and ends of segments within it.

    Args:
        points: The points, padded to space [m], (n, 3).
        rows: Segments from `geometry.nearest.pack`, (segments, 15).
        reach: The distances; what is further by rounding counts, too [m], (n,).

    Returns:
        The number of the point of each place, and the places [m].
    """
    k, length, within = rows[:, 9], rows[:, 10], reach + EQUAL
    of, places = [np.empty(0, np.intp)], [np.empty(0)]
    for part in np.array_split(np.arange(len(points)), 1 + len(points) * len(rows) // PAIRS):
        p, near = points[part, None], within[part, None]
        offset = p - rows[:, :3]
        along, across = (np.einsum("psa,sa->ps", offset, rows[:, i : i + 3]) for i in (3, 6))
        angle = np.arctan2(k * along, 1 - k * across)
        angle = np.where(angle < 0, angle + 2 * np.pi, angle)
        at = np.where(k == 0, along, angle / np.where(k == 0, np.inf, k))
        at = np.clip(at, 0.0, length)
        half = k * at / 2
        there = at * np.sinc(2 * half / np.pi), at * half * np.sinc(half / np.pi) ** 2
        foot = offset - there[0][..., None] * rows[:, 3:6] - there[1][..., None] * rows[:, 6:9]
        for gap, u in (
            (offset, np.zeros_like(at)),
            (foot, at),
            (p - rows[:, 12:15], np.broadcast_to(length, at.shape)),
        ):
            i, j = np.nonzero(np.sqrt(np.einsum("psa,psa->ps", gap, gap)) <= near)
            of.append(part[i])
            places.append(rows[j, 11] + u[i, j])
    return np.concatenate(of), np.concatenate(places)


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
                x = y = 0.0
                for place in (p, q):
                    dot = size2 = 0.0
                    for axis in range(3):
                        chord = way.points[j + 1, axis] - way.points[j, axis]
                        dot += (place[axis] - way.points[j, axis]) * chord
                        size2 += chord * chord
                    share = min(max(dot / size2, 0.0), 1.0) if size2 > 0.0 else 0.0
                    total = 0.0
                    for axis in range(3):
                        chord = way.points[j + 1, axis] - way.points[j, axis]
                        total += (place[axis] - way.points[j, axis] - share * chord) ** 2
                    x, y = y, math.sqrt(total)
                a, b, most = min(a, x), min(b, y), min(most, max(x, y))
                spare = min(x - a, y - b, max(x, y) - most)
            gone = 0.0 if j == i or returns else gone + way.sizes[j]
            j += step
    return a, b, most


@compiled()
def _measure_parts(
    way: Way,
    rows: FloatArray,
    order: IntArray,
    parts: IntArray,
    places: FloatArray,
    bounds: FloatArray,
    far: FloatArray,
    where: FloatArray,
) -> None:
    """Largest distance from parts of the path to the tool, for each point that starts a step.

    A part is measured at its ends and halved while a bound exceeds the largest distance found so
    far.

    Args:
        way: The way of the tool.
        rows: Segments from `geometry.nearest.pack`, (segments, 15).
        order: The order in which parts are measured.
        parts: The step of the tool that passes each part, its segment, and whether the part is the
            step's last one, (m, 3).
        places: Arc lengths at which each part starts and ends [m], (m, 2).
        bounds: Bounds of the distances in each part [m], (m,).
        far: Distances [m], (n,), initially -1, which stays where no place is measured; updated. The
            largest distance is at most SURE below the largest of all places.
        where: Places of these distances [m], (n,); updated.
    """
    n = len(way.points)
    halves, worst = np.empty((MOST_HALVES, 2)), -1.0
    for m in order:
        if bounds[m] <= worst + SURE:
            continue
        i, g, first, last = parts[m, 0], rows[parts[m, 1]], places[m, 0], places[m, 1]
        chord, size = min(i, n - 2), last - first
        p, q = point_at(g, first - g[11]), point_at(g, last - g[11])
        # Distances from the chord alone.
        a, b, _ = _tool_distances(p, q, way, chord, -math.inf, -1.0)
        reach = 2 * (max(a, b) + min(g[9] * size**2 / 8, size / 2))
        count, halves[0, 0], halves[0, 1] = 1, first, last
        while count:
            count -= 1
            left, right = halves[count, 0], halves[count, 1]
            p, q = point_at(g, left - g[11]), point_at(g, right - g[11])
            a, b, most = _tool_distances(p, q, way, chord, last, reach)
            # The end of the step is the place of the next point.
            own = i + 1 if parts[m, 2] and right == last and i < n - 1 else i
            for d, place, point in ((a, left, i), (b, right, own)):
                if d > far[point]:
                    far[point], where[point] = d, place
            worst = max(worst, a, b)
            # A distance changes by no more than its place.
            apart = right - left
            most = min(most + g[9] * apart**2 / 8, (a + b + apart) / 2)
            middle = left + apart / 2
            if most > worst + SURE and left < middle < right:
                halves[count, 0], halves[count, 1] = middle, right
                halves[count + 1, 0], halves[count + 1, 1] = left, middle
                count += 2


def measure_coverage(
    way: Way, rows: FloatArray, begin: float, end: float
) -> tuple[FloatArray, FloatArray]:
    """Largest distance from the path to the tool, of the places passed from each point to the next.

    What the tool passes in one step is cut at joints between segments. The step from the point with
    the largest distance comes first, because most others need not be measured then.

    Args:
        way: The way of the tool.
        rows: Segments from `geometry.nearest.pack`, (rows, 15).
        begin: Places before this one do not count [m].
        end: Nor do places after this one [m].

    Returns:
        Distances [m], -1 where no place was measured, and places [m], (n,) each; the first row has
        what is before the first place, too, the last row what is after the last place.
    """
    reached = np.maximum.accumulate(way.s)
    low = np.append(begin, np.maximum(reached[1:], begin))
    high = np.append(np.minimum(np.maximum(reached[:-1], way.s[1:]), end), end)
    starts, ends = rows[:, 11], rows[:, 11] + rows[:, 10]
    segment = np.minimum(np.searchsorted(ends, low, side="right"), len(rows) - 1)
    count = np.maximum(np.searchsorted(starts, high, side="left") - segment, 1)
    count[(low > high) | ((low == high) & (np.arange(len(low)) > 0))] = 0
    step, number = number_parts(count)
    k = segment[step] + number
    first, last = np.maximum(low[step], starts[k]), np.minimum(high[step], ends[k])
    # No distance of a part between the places of two points exceeds theirs by more than its sag.
    sag = np.minimum(rows[k, 9] * (last - first) ** 2 / 8, (last - first) / 2)
    after = np.minimum(step + 1, len(low) - 1)
    whole = (after > step) & (first == way.s[step]) & (last == way.s[after])
    bounds = np.where(whole, sag + np.maximum(way.distance[step], way.distance[after]), np.inf)
    worst = np.flatnonzero(step == np.argmax(way.distance))
    order = np.concatenate([worst, np.arange(len(step))])
    parts = np.stack([step, k, last == high[step]], axis=1)
    places, far, where = (
        np.stack([first, last], axis=1),
        np.full(len(low), -1.0),
        np.zeros(len(low)),
    )
    _measure_parts(way, rows, order, parts, places, bounds, far, where)
    return far, where
