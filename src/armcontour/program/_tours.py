"""Short open tours over contours, compiled: local search, and the best places.

Every contour has options: a closed one places where it may begin, an open one its directions. An
option has a point of entry and a point of exit. Moves of the search are those of 2-opt and Or-opt;
Lin, Kernighan's double bridge with short parts leads out of local optima.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Longest part of a tour that an Or-opt move carries elsewhere.
LONGEST_PART = 3
# Longest parts that are exchanged to leave a local optimum.
LONGEST_EXCHANGE = 30
# Up to this number of contours, an exchange also changes an option, and all are chosen anew after
# it.
FEW = 30
# Changes of length below this share of a tour are rounding errors.
NO_GAIN = 1e-12


@compiled(inner=True)
def distance(exits: FloatArray, a: int, entries: FloatArray, b: int) -> float:
    """Distance from the exit of option a to the entry of option b; 0 if either is -1."""
    if a < 0 or b < 0:
        return 0.0
    x = exits[a, 0] - entries[b, 0]
    y = exits[a, 1] - entries[b, 1]
    z = exits[a, 2] - entries[b, 2]
    return float(np.sqrt(x * x + y * y + z * z))


@compiled()
def tour_length(exits: FloatArray, entries: FloatArray, tour: IntArray, option: IntArray) -> float:
    """Length of all links of a tour."""
    total = 0.0
    for k in range(len(tour) - 1):
        total += distance(exits, option[tour[k]], entries, option[tour[k + 1]])
    return total


@compiled()
def nearest_tour(
    exits: FloatArray, entries: FloatArray, first: IntArray, parent: IntArray, begin: int
) -> tuple[IntArray, IntArray]:
    """The tour that goes on to the nearest option of the contours left, and its options.

    Args:
        exits: Exits of all options, (m, 3).
        entries: Their entries, (m, 3).
        first: Index of the first option of every contour, and m, (n + 1,).
        parent: Contour that may only come after each contour, or -1, (n,).
        begin: The first contour, if nothing has to come before it; else the first such one.
    """
    n = len(first) - 1
    waits = np.zeros(n, dtype=np.intp)
    for c in range(n):
        if parent[c] >= 0:
            waits[parent[c]] += 1
    left = np.ones(n, dtype=np.bool_)
    tour, option = np.empty(n, dtype=np.intp), first[:n].copy()
    while waits[begin] > 0:
        begin = (begin + 1) % n
    chosen = begin
    for k in range(n):
        if k > 0:
            least, last = np.inf, option[tour[k - 1]]
            for c in range(n):
                if not left[c] or waits[c] > 0:
                    continue
                for o in range(first[c], first[c + 1]):
                    d = distance(exits, last, entries, o)
                    if d < least:
                        least, chosen, option[c] = d, c, o
        tour[k] = chosen
        left[chosen] = False
        if parent[chosen] >= 0:
            waits[parent[chosen]] -= 1
    return tour, option


@compiled()
def choose_options(
    exits: FloatArray, entries: FloatArray, first: IntArray, tour: IntArray, option: IntArray
) -> None:
    """Set the options with which a tour is the shortest in its order, by dynamic programming."""
    n, m = len(tour), len(exits)
    cost, before = np.zeros(m), np.full(m, -1, dtype=np.intp)
    for k in range(1, n):
        p, c = tour[k - 1], tour[k]
        for o in range(first[c], first[c + 1]):
            least = np.inf
            for q in range(first[p], first[p + 1]):
                d = cost[q] + distance(exits, q, entries, o)
                if d < least:
                    least, before[o] = d, q
            cost[o] = least
    c = tour[n - 1]
    at = first[c] + np.argmin(cost[first[c] : first[c + 1]])
    for k in range(n - 1, -1, -1):
        option[tour[k]] = at
        at = before[at]


@compiled(inner=True)
def _refresh(state: Any) -> None:
    """Set the positions, and the lengths of links up to each position in both directions."""
    exits, entries, _, _, _, tour, option, place, ahead, back = state
    place[tour[0]] = 0
    for k in range(1, len(tour)):
        a, b = option[tour[k - 1]], option[tour[k]]
        place[tour[k]] = k
        ahead[k] = ahead[k - 1] + distance(exits, a, entries, b)
        back[k] = back[k - 1] + distance(exits, b, entries, a)


@compiled(inner=True)
def _at(state: Any, k: int) -> int:
    """The option at position k of the tour; -1 before its start and after its end."""
    tour, option = state[5], state[6]
    return option[tour[k]] if 0 <= k < len(tour) else -1


@compiled(inner=True)
def _may_swap(state: Any, i: int, j: int, k: int) -> bool:
    """Whether the parts i to j-1 and j to k-1 of the tour may change places."""
    parent, tour, place = state[3], state[5], state[7]
    for t in range(i, j):
        p = parent[tour[t]]
        if p >= 0 and j <= place[p] < k:
            return False
    return True


@compiled(inner=True)
def _may_reverse(state: Any, i: int, j: int) -> bool:
    """Whether the part i to j of the tour may be run backwards."""
    parent, tour, place = state[3], state[5], state[7]
    for t in range(i, j + 1):
        p = parent[tour[t]]
        if p >= 0 and i <= place[p] <= j:
            return False
    return True


@compiled(inner=True, allocates=True)
def _swap(tour: IntArray, i: int, j: int, k: int) -> None:
    """Exchange the parts i to j-1 and j to k-1 of a tour."""
    part = tour[i:j].copy()
    tour[i : i + k - j] = tour[j:k].copy()
    tour[i + k - j : k] = part


@compiled(inner=True)
def _try_option(state: Any, c: int) -> bool:
    """Take the best option of a contour between its neighbours; whether it is a better one."""
    exits, entries, first, _, _, _, option, place, ahead, _ = state
    before, after = _at(state, place[c] - 1), _at(state, place[c] + 1)
    now = distance(exits, before, entries, option[c]) + distance(exits, option[c], entries, after)
    least, best = now - NO_GAIN * (1 + ahead[-1]), option[c]
    for o in range(first[c], first[c + 1]):
        d = distance(exits, before, entries, o) + distance(exits, o, entries, after)
        if d < least:
            least, best = d, o
    if best == option[c]:
        return False
    option[c] = best
    _refresh(state)
    return True


@compiled(inner=True, allocates=True)
def _try_reversal(state: Any, i: int, j: int) -> bool:
    """Run the part i to j of the tour backwards if that is shorter; whether it was."""
    exits, entries, _, _, _, tour, _, _, ahead, back = state
    a, b, c, d = _at(state, i - 1), _at(state, i), _at(state, j), _at(state, j + 1)
    gain = distance(exits, a, entries, b) + distance(exits, c, entries, d) + ahead[j] - ahead[i]
    gain -= distance(exits, a, entries, c) + distance(exits, b, entries, d) + back[j] - back[i]
    if gain <= NO_GAIN * (1 + ahead[-1]) or not _may_reverse(state, i, j):
        return False
    tour[i : j + 1] = tour[i : j + 1][::-1].copy()
    _refresh(state)
    return True


@compiled(inner=True, allocates=True)
def _try_carrying(state: Any, i: int, j: int, p: int) -> bool:
    """Carry the part i to j to between p and p + 1, forwards or backwards, if that is shorter."""
    exits, entries, _, _, _, tour, _, _, ahead, back = state
    before, start, end, after = _at(state, i - 1), _at(state, i), _at(state, j), _at(state, j + 1)
    x, y = _at(state, p), _at(state, p + 1)
    gain = distance(exits, before, entries, start) + distance(exits, end, entries, after)
    gain += distance(exits, x, entries, y) - distance(exits, before, entries, after)
    onward = gain - distance(exits, x, entries, start) - distance(exits, end, entries, y)
    turned = gain - distance(exits, x, entries, end) - distance(exits, start, entries, y)
    turned += ahead[j] - ahead[i] - back[j] + back[i]
    if max(onward, turned) <= NO_GAIN * (1 + ahead[-1]):
        return False
    if not (_may_swap(state, i, j + 1, p + 1) if p > j else _may_swap(state, p + 1, i, j + 1)):
        return False
    if turned > onward:
        if _may_reverse(state, i, j):
            tour[i : j + 1] = tour[i : j + 1][::-1].copy()
        elif onward <= NO_GAIN * (1 + ahead[-1]):
            return False
    if p > j:
        _swap(tour, i, j + 1, p + 1)
    else:
        _swap(tour, p + 1, i, j + 1)
    _refresh(state)
    return True


@compiled(inner=True, allocates=True)
def _improve_at(state: Any, c: int) -> bool:
    """Make one move that shortens the tour at a contour; whether there was one."""
    exits, entries, _, _, near, tour, option, place, _, _ = state
    if _try_option(state, c):
        return True
    n, i = len(tour), place[c]
    before = distance(exits, _at(state, i - 1), entries, option[c])
    after = distance(exits, option[c], entries, _at(state, i + 1))
    for m in near[c]:
        k = place[m]
        link = min(
            distance(exits, option[c], entries, option[m]),
            distance(exits, option[m], entries, option[c]),
        )
        # A move gains only if it adds a link that is shorter than one that it removes.
        if link < max(before, after) and _bring_together(state, i, k):
            return True
    # Ends of the tour are next to nothing.
    return (i > 0 and (_try_reversal(state, 0, i) or _try_carrying(state, i, i, -1))) or (
        i < n - 1 and (_try_reversal(state, i, n - 1) or _try_carrying(state, i, i, n - 1))
    )


@compiled(inner=True, allocates=True)
def _bring_together(state: Any, i: int, k: int) -> bool:
    """Make one move after which what is at positions i and k is adjacent; whether it is shorter."""
    n = len(state[5])
    low, high = min(i, k), max(i, k)
    if high > low + 1 and (
        _try_reversal(state, low + 1, high) or _try_reversal(state, low, high - 1)
    ):
        return True
    for count in range(1, LONGEST_PART + 1):
        for start in (i, i - count + 1):
            end = start + count - 1
            if start < 0 or end >= n or start <= k <= end or (count == 1 and start != i):
                continue
            for p in (k, k - 1):
                if (p < start - 1 or p > end) and _try_carrying(state, start, end, p):
                    return True
    return False


@compiled(inner=True, allocates=True)
def _improve(state: Any, queue: IntArray, count: int, queued: Any) -> None:
    """Make moves at the contours in the queue, and at what they touch, until none is shorter."""
    tour, place = state[5], state[7]
    n = len(tour)
    while count > 0:
        count -= 1
        c = queue[count]
        queued[c] = False
        while True:
            i = place[c]
            low, high = max(i - 1, 0), min(i + 1, n - 1)
            a, b = tour[low], tour[high]
            if not _improve_at(state, c):
                break
            # Contours that were next to it, and those that are now.
            i = place[c]
            for m in (a, b, tour[max(i - 1, 0)], tour[min(i + 1, n - 1)]):
                if m != c and not queued[m]:
                    queue[count] = m
                    queued[m] = True
                    count += 1


@compiled()
def search(
    exits: FloatArray,
    entries: FloatArray,
    first: IntArray,
    parent: IntArray,
    near: IntArray,
    tour: IntArray,
    option: IntArray,
    tries: int,
) -> None:
    """Shorten a tour in place.

    Args:
        exits: Exits of all options, (m, 3).
        entries: Their entries, (m, 3).
        first: Index of the first option of every contour, and m, (n + 1,).
        parent: Contour that may only come after each contour, or -1, (n,).
        near: The nearest contours of every contour, (n, k).
        tour: The contours in order, (n,).
        option: The option of every contour, (n,).
        tries: Number of exchanges of two parts from which the search goes on.
    """
    n = len(tour)
    state = (
        exits, entries, first, parent, near, tour, option,
        np.zeros(n, dtype=np.intp), np.zeros(n), np.zeros(n),
    )  # fmt: skip
    _refresh(state)
    queue, queued = tour.copy(), np.ones(n, dtype=np.bool_)
    _improve(state, queue, n, queued)
    best, best_option, least = tour.copy(), option.copy(), state[8][n - 1]
    # Numbers of a fixed sequence, so that the same program has the same order.
    seed = np.uint64(88172645463325252)
    for _ in range(tries):
        numbers = np.empty(4, dtype=np.intp)
        for k in range(4):
            seed ^= seed << np.uint64(13)
            seed ^= seed >> np.uint64(7)
            seed ^= seed << np.uint64(17)
            numbers[k] = np.intp((seed >> np.uint64(11)) % np.uint64(1 << 30))
        i = numbers[0] % (n - 1)
        j = i + 1 + numbers[1] % min(LONGEST_EXCHANGE, n - 1 - i)
        k = j + 1 + numbers[2] % min(LONGEST_EXCHANGE, n - j)
        if not _may_swap(state, i, j, k):
            continue
        _swap(tour, i, j, k)
        c = tour[i]
        if n <= FEW:
            option[c] = first[c] + numbers[3] % (first[c + 1] - first[c])
        _refresh(state)
        count = 0
        for t in (i - 1, i, i + k - j - 1, i + k - j, k - 1, k):
            if 0 <= t < n and not queued[tour[t]]:
                queue[count] = tour[t]
                queued[tour[t]] = True
                count += 1
        _improve(state, queue, count, queued)
        if n <= FEW:
            choose_options(exits, entries, first, tour, option)
            _refresh(state)
        if state[8][n - 1] < least - NO_GAIN * (1 + least):
            least = state[8][n - 1]
            best[:], best_option[:] = tour, option
        else:
            tour[:], option[:] = best, best_option
            _refresh(state)
    choose_options(exits, entries, first, tour, option)
