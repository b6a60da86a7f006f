"""Short open tours over contours, compiled: local search.

Every contour has options: a closed one places where it may begin, an open one its directions. An
option has a point of entry and a point of exit. Moves of the search are those of 2-opt and Or-opt;
Lin, Kernighan's double bridge with short parts leads out of local optima.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled

# Longest part of a tour that an Or-opt move carries elsewhere.
LONGEST_PART = 3
# Longest parts that are exchanged to leave a local optimum.
LONGEST_EXCHANGE = 30
# Up to this number of contours, an exchange also changes an option.
FEW = 30
# Changes of length below this share of a tour are rounding errors.
NO_GAIN = 1e-12


class Options(NamedTuple):
    """The options of n contours.

    Attributes:
        exits: Exits of all options, (m, 3).
        entries: Their entries, (m, 3).
        first: Index of the first option of every contour, and m, (n + 1,).
    """

    exits: FloatArray
    entries: FloatArray
    first: IntArray


class _Tour(NamedTuple):
    """A tour, whose positions count from 1.

    Attributes:
        order: The contour at each position, (n + 1,).
        option: The option of every contour, (n,).
        place: Position of every contour, (n,).
        at: The option at each position; -1 before the first one and after the last, (n + 2,).
        ahead: Length of the links up to each position, (n + 2,).
        back: The same if they run backwards, (n + 2,).
    """

    order: IntArray
    option: IntArray
    place: IntArray
    at: IntArray
    ahead: FloatArray
    back: FloatArray


@compiled(inner=True)
def distance(options: Options, a: int, b: int) -> float:
    """Distance from the exit of option a to the entry of option b; 0 if either is -1."""
    if a < 0 or b < 0:
        return 0.0
    x = options.exits[a, 0] - options.entries[b, 0]
    y = options.exits[a, 1] - options.entries[b, 1]
    z = options.exits[a, 2] - options.entries[b, 2]
    return math.sqrt(x * x + y * y + z * z)


@compiled(inner=True)
def _refresh(options: Options, tour: _Tour, first: int) -> None:
    """Set what follows from the order and the options, from a position on."""
    order, option, place, at, ahead, back = tour
    for k in range(first, len(at)):
        at[k] = -1
        if k < len(order):
            place[order[k]], at[k] = k, option[order[k]]
        ahead[k] = ahead[k - 1] + distance(options, at[k - 1], at[k])
        back[k] = back[k - 1] + distance(options, at[k], at[k - 1])


@compiled(inner=True, allocates=True)
def _carry(
    options: Options, parent: IntArray, tour: _Tour, start: int, end: int, to: int, least: float
) -> bool:
    """Carry a part of the tour elsewhere if that gains more than `least` and is allowed.

    Args:
        options: The options.
        parent: As in `search`.
        tour: The tour, changed if the move is made.
        start: Position of the part's first contour.
        end: Position of its last contour.
        to: Position after which it goes, forwards or backwards; after one of its own it stays.
        least: Smallest gain of length.
    """
    order, option, place, at, ahead, back = tour
    if start < 1 or end >= len(order):
        return False
    before, after, a, z = at[start - 1], at[end + 1], at[start], at[end]
    x, y = before, after
    gain = distance(options, before, a) + distance(options, z, after)
    if not start - 1 <= to <= end:
        x, y = at[to], at[to + 1]
        gain += distance(options, x, y) - distance(options, before, after)
    onward = gain - distance(options, x, a) - distance(options, z, y)
    backward = gain - distance(options, x, z) - distance(options, a, y)
    backward += ahead[end] - ahead[start] - back[end] + back[start]
    if max(onward, backward) <= least:
        return False
    # The part comes after the others, or before them.
    low, high, size = min(start, to + 1), max(end, to), end - start + 1
    old, part = order[low : high + 1].copy(), order[start : end + 1].copy()
    others = order[end + 1 : to + 1].copy() if to > end else order[to + 1 : start].copy()
    begin, middle = (to - size + 1, low) if to > end else (low, low + size)
    order[begin : begin + size] = part[::-1] if backward > onward else part
    order[middle : middle + len(others)] = others
    for k in range(low, high + 1):
        place[order[k]] = k
    for k in range(low, high + 1):
        p = parent[order[k]]
        if p >= 0 and place[p] < k:
            order[low : high + 1] = old
            _refresh(options, tour, low)
            return False
    _refresh(options, tour, low)
    return True


@compiled(inner=True, allocates=True)
def _improve_at(options: Options, parent: IntArray, near: IntArray, tour: _Tour, c: int) -> bool:
    """Make one move that shortens the tour at contour c; whether there was one."""
    order, option, place, at, ahead, _ = tour
    n, i = len(order) - 1, place[c]
    no_gain = NO_GAIN * (1 + ahead[-1])
    before, after = distance(options, at[i - 1], at[i]), distance(options, at[i], at[i + 1])
    least, best = before + after - no_gain, at[i]
    for o in range(options.first[c], options.first[c + 1]):
        d = distance(options, at[i - 1], o) + distance(options, o, at[i + 1])
        if d < least:
            least, best = d, o
    if best != at[i]:
        option[c] = best
        _refresh(options, tour, i)
        return True
    for m in near[c]:
        k, o = place[m], option[m]
        # A move gains only if it adds a link that is shorter than one that it removes.
        if min(distance(options, at[i], o), distance(options, o, at[i])) >= max(before, after):
            continue
        low, high = min(i, k), max(i, k)
        for start, end in ((low + 1, high), (low, high - 1)):
            if _carry(options, parent, tour, start, end, end, no_gain):
                return True
        for count in range(1, LONGEST_PART + 1):
            for start in range(i - count + 1, i + 1):
                for to in (k, k - 1):
                    if _carry(options, parent, tour, start, start + count - 1, to, no_gain):
                        return True
    # Ends of the tour are next to nothing.
    for start, end, to in ((1, i, i), (i, i, 0), (i, n, n), (i, i, n)):
        if _carry(options, parent, tour, start, end, to, no_gain):
            return True
    return False


@compiled()
def search(
    options: Options,
    parent: IntArray,
    near: IntArray,
    tour: IntArray,
    option: IntArray,
    numbers: IntArray,
) -> None:
    """Shorten a tour in place.

    Args:
        options: The options.
        parent: Contour that may only come after each contour, or -1, (n,).
        near: The nearest contours of every contour, (n, k).
        tour: The contours in order, (n,).
        option: The option of every contour, (n,).
        numbers: Random numbers for exchanges of parts from which the search goes on, (tries, 4).
    """
    n = len(tour)
    order, place = np.append(-1, tour), np.zeros(n, dtype=np.intp)
    now = _Tour(order, option.copy(), place, np.full(n + 2, -1), np.zeros(n + 2), np.zeros(n + 2))
    _refresh(options, now, 1)
    queue, queued, count = tour.copy(), np.ones(n, dtype=np.bool_), n
    least = np.inf
    for trial in range(len(numbers) + 1):
        if trial:
            number = numbers[trial - 1]
            i = 1 + number[0] % (n - 1)
            j = i + 1 + number[1] % min(LONGEST_EXCHANGE, n - i)
            k = j + 1 + number[2] % min(LONGEST_EXCHANGE, n + 1 - j)
            if not _carry(options, parent, now, i, j - 1, k - 1, -np.inf):
                continue
            if n <= FEW:
                c = order[i]
                first = options.first[c]
                now.option[c] = first + number[3] % (options.first[c + 1] - first)
                _refresh(options, now, i)
            for t in (i - 1, i, i + k - j - 1, i + k - j, k - 1, k):
                if 1 <= t <= n and not queued[order[t]]:
                    queue[count] = order[t]
                    queued[order[t]] = True
                    count += 1
        while count:
            count -= 1
            c = queue[count]
            queued[c] = False
            a, b = order[max(place[c] - 1, 1)], order[min(place[c] + 1, n)]
            if _improve_at(options, parent, near, now, c):
                # Contours that were next to it, and those that are now.
                for m in (a, b, order[max(place[c] - 1, 1)], order[min(place[c] + 1, n)], c):
                    if not queued[m]:
                        queue[count] = m
                        queued[m] = True
                        count += 1
        if now.ahead[-1] < least * (1 - NO_GAIN) - NO_GAIN:
            least = now.ahead[-1]
            tour[:], option[:] = order[1:], now.option
        else:
            order[1:], now.option[:] = tour, option
            _refresh(options, now, 1)
