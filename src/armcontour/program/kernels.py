"""Compiled local search for a short open tour over contours.

Every contour has options: start points of a closed contour, or directions of an open contour. An
option has an entry point and an exit point. The moves of the search are 2-opt and Or-opt. To leave
a local optimum, the search exchanges two short parts (double bridge of Lin and Kernighan).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled

# Largest number of contours that an Or-opt move relocates.
LONGEST_PART = 3
# Largest number of contours in each of two parts that are exchanged to leave a local optimum.
LONGEST_EXCHANGE = 30
# Up to this number of contours, an exchange also changes an option.
FEW_CONTOURS = 30
# Changes of length below this fraction of the length of a tour are rounding errors.
NO_GAIN = 1e-12


class TourOptions(NamedTuple):
    """Entry and exit points of the m options of n contours."""

    exits: FloatArray  # Exit point of every option [m], (m, 3)
    entries: FloatArray  # Entry point of every option [m], (m, 3)
    first: IntArray  # Index of the first option of every contour, followed by m, (n + 1,)


class _Tour(NamedTuple):
    """A tour of n contours at the positions 1 to n."""

    order: IntArray  # Contour at each position, -1 at position 0, (n + 1,)
    option: IntArray  # Option of every contour, (n,)
    position: IntArray  # Position of every contour, (n,)
    chosen: IntArray  # Option at each position; -1 at the positions 0 and n + 1, (n + 2,)
    ahead: FloatArray  # Length of the links up to each position [m], (n + 2,)
    back: FloatArray  # Length of these links in the opposite direction [m], (n + 2,)


@compiled(inner=True)
def distance(options: TourOptions, a: int, b: int) -> float:
    """Distance from the exit of option a to the entry of option b [m]; 0 if either is -1."""
    if a < 0 or b < 0:
        return 0.0
    x = options.exits[a, 0] - options.entries[b, 0]
    y = options.exits[a, 1] - options.entries[b, 1]
    z = options.exits[a, 2] - options.entries[b, 2]
    return math.sqrt(x * x + y * y + z * z)


@compiled(inner=True)
def _update_tour(options: TourOptions, tour: _Tour, first: int) -> None:
    """Recompute `position`, `chosen`, `ahead` and `back` of a tour from position `first` on."""
    order, option, position, chosen, ahead, back = tour
    for k in range(first, len(chosen)):
        chosen[k] = -1
        if k < len(order):
            position[order[k]], chosen[k] = k, option[order[k]]
        ahead[k] = ahead[k - 1] + distance(options, chosen[k - 1], chosen[k])
        back[k] = back[k - 1] + distance(options, chosen[k], chosen[k - 1])


@compiled(inner=True, allocates=True)
def _relocate_part(
    options: TourOptions,
    parent: IntArray,
    tour: _Tour,
    start: int,
    end: int,
    to: int,
    threshold: float,
) -> bool:
    """Move a part of the tour behind a position if allowed and the gain exceeds `threshold`."""
    # `start`, `end`: first and last position of the part; `to`: the position; if it is inside the
    # part, the part is reversed in place. Returns true if the part was moved.
    order, option, position, chosen, ahead, back = tour
    if start < 1 or end >= len(order):
        return False
    before, after, a, z = chosen[start - 1], chosen[end + 1], chosen[start], chosen[end]
    x, y = before, after
    gain = distance(options, before, a) + distance(options, z, after)
    if not start - 1 <= to <= end:
        x, y = chosen[to], chosen[to + 1]
        gain += distance(options, x, y) - distance(options, before, after)
    onward = gain - distance(options, x, a) - distance(options, z, y)
    backward = gain - distance(options, x, z) - distance(options, a, y)
    backward += ahead[end] - ahead[start] - back[end] + back[start]
    if max(onward, backward) <= threshold:
        return False
    # The part and the contours between it and the new position exchange their places.
    low, high, size = min(start, to + 1), max(end, to), end - start + 1
    old, part = order[low : high + 1].copy(), order[start : end + 1].copy()
    others = order[end + 1 : to + 1].copy() if to > end else order[to + 1 : start].copy()
    begin, middle = (to - size + 1, low) if to > end else (low, low + size)
    order[begin : begin + size] = part[::-1] if backward > onward else part
    order[middle : middle + len(others)] = others
    for k in range(low, high + 1):
        position[order[k]] = k
    for k in range(low, high + 1):
        p = parent[order[k]]
        if p >= 0 and position[p] < k:
            order[low : high + 1] = old
            _update_tour(options, tour, low)
            return False
    _update_tour(options, tour, low)
    return True


@compiled(inner=True, allocates=True)
def _improve_contour(
    options: TourOptions, parent: IntArray, near: IntArray, tour: _Tour, c: int
) -> bool:
    """Make one move that shortens the tour at contour c; returns true if there is such a move."""
    order, option, position, chosen, ahead, _ = tour
    n, i = len(order) - 1, position[c]
    no_gain = NO_GAIN * (1 + ahead[-1])
    before, after = (
        distance(options, chosen[i - 1], chosen[i]),
        distance(options, chosen[i], chosen[i + 1]),
    )
    shortest, best = before + after - no_gain, chosen[i]
    for o in range(options.first[c], options.first[c + 1]):
        d = distance(options, chosen[i - 1], o) + distance(options, o, chosen[i + 1])
        if d < shortest:
            shortest, best = d, o
    if best != chosen[i]:
        option[c] = best
        _update_tour(options, tour, i)
        return True
    for m in near[c]:
        k, o = position[m], option[m]
        # A move gains only if it adds a link that is shorter than one that it removes.
        if min(distance(options, chosen[i], o), distance(options, o, chosen[i])) >= max(
            before, after
        ):
            continue
        low, high = min(i, k), max(i, k)
        for start, end in ((low + 1, high), (low, high - 1)):
            if _relocate_part(options, parent, tour, start, end, end, no_gain):
                return True
        for count in range(1, LONGEST_PART + 1):
            for start in range(i - count + 1, i + 1):
                for to in (k, k - 1):
                    if _relocate_part(options, parent, tour, start, start + count - 1, to, no_gain):
                        return True
    # Moves to the ends of the tour, where no neighbouring contour exists.
    for start, end, to in ((1, i, i), (i, i, 0), (i, n, n), (i, i, n)):
        if _relocate_part(options, parent, tour, start, end, to, no_gain):
            return True
    return False


@compiled()
def shorten_tour(
    options: TourOptions,
    parent: IntArray,  # Contour that each contour must precede, or -1, (n,)
    near: IntArray,  # Indices of the nearest contours of every contour, (n, k)
    tour: IntArray,  # Indices of the contours in order, (n,)
    option: IntArray,  # Option of every contour, (n,)
    numbers: IntArray,
) -> None:
    """Shorten a tour; writes the new order and options to `tour` and `option`."""
    # `numbers`: random numbers that determine the exchanges of parts, (tries, 4).
    n = len(tour)
    order, position = np.append(-1, tour), np.zeros(n, dtype=np.intp)
    now = _Tour(
        order, option.copy(), position, np.full(n + 2, -1), np.zeros(n + 2), np.zeros(n + 2)
    )
    _update_tour(options, now, 1)
    queue, queued, count = tour.copy(), np.ones(n, dtype=np.bool_), n
    shortest = np.inf
    for trial in range(len(numbers) + 1):
        if trial:
            number = numbers[trial - 1]
            i = 1 + number[0] % (n - 1)
            j = i + 1 + number[1] % min(LONGEST_EXCHANGE, n - i)
            k = j + 1 + number[2] % min(LONGEST_EXCHANGE, n + 1 - j)
            if not _relocate_part(options, parent, now, i, j - 1, k - 1, -np.inf):
                continue
            if n <= FEW_CONTOURS:
                c = order[i]
                first = options.first[c]
                now.option[c] = first + number[3] % (options.first[c + 1] - first)
                _update_tour(options, now, i)
            for t in (i - 1, i, i + k - j - 1, i + k - j, k - 1, k):
                if 1 <= t <= n and not queued[order[t]]:
                    queue[count] = order[t]
                    queued[order[t]] = True
                    count += 1
        while count:
            count -= 1
            c = queue[count]
            queued[c] = False
            a, b = order[max(position[c] - 1, 1)], order[min(position[c] + 1, n)]
            if _improve_contour(options, parent, near, now, c):
                # The contour itself, and its neighbours before and after the move.
                for m in (a, b, order[max(position[c] - 1, 1)], order[min(position[c] + 1, n)], c):
                    if not queued[m]:
                        queue[count] = m
                        queued[m] = True
                        count += 1
        if now.ahead[-1] < shortest * (1 - NO_GAIN) - NO_GAIN:
            shortest = now.ahead[-1]
            tour[:], option[:] = order[1:], now.option
        else:
            order[1:], now.option[:] = tour, option
            _update_tour(options, now, 1)
