"""Whether a motion keeps to its own part of a path: a monotone matching, found by brute force.

Places on the path are matched to the motion's points in order, neither ever going back, so that
all pairs are within the tolerance (after Alt and Godau, "Computing the Fréchet distance between two
polygonal curves"). What a point may be matched to decides which pieces of the path are its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

# Arcs of fewer than so many radians meet a disc in one stretch at most, near enough.
QUARTER = np.pi / 2


@dataclass(frozen=True)
class Pieces:
    """Lines and arcs in order, each with a tolerance: columns of n rows [m, 1/m].

    `joints` holds the tolerance at the end of every piece, as far as a motion must come that near.
    """

    starts: np.ndarray
    tangents: np.ndarray
    normals: np.ndarray
    bends: np.ndarray
    lengths: np.ndarray
    bands: np.ndarray
    joints: np.ndarray
    ends: np.ndarray

    def __len__(self):
        return len(self.lengths)

    @property
    def columns(self):
        """What the compiled functions take."""
        return self.starts, self.tangents, self.normals, self.bends, self.lengths, self.bands


def cut(path, cuts, bands, joints):
    """Pieces of a path, cut at vertices, at `cuts` [m], and where arcs are long.

    Args:
        path: The path.
        cuts: Further places to cut at [m].
        bands: Tolerance [m] by the middles of pieces [m].
        joints: Tolerance [m] by the ends of pieces [m].
    """
    bounds = [path.breaks, cuts[(cuts > 0) & (cuts < path.length)]]
    for i in np.flatnonzero(path.curvatures * path.lengths > QUARTER):
        count = math.ceil(path.curvatures[i] * path.lengths[i] / QUARTER)
        bounds.append(np.linspace(path.breaks[i], path.breaks[i + 1], count + 1))
    at = np.unique(np.concatenate(bounds))
    # What a rounding error cuts off is no piece, unless it is a segment of the path.
    stays = np.isin(at, path.breaks)
    at = at[stays | (np.append(np.diff(at), np.inf) > 1e-12)]
    i = path.locate((at[:-1] + at[1:]) / 2)
    u = at[:-1] - path.breaks[i]
    angle = (path.curvatures[i] * u)[:, None]
    tangents = np.cos(angle) * path.tangents[i] + np.sin(angle) * path.normals[i]
    normals = np.cos(angle) * path.normals[i] - np.sin(angle) * path.tangents[i]
    points = path(at)
    return Pieces(
        starts=points[:-1],
        tangents=tangents,
        normals=normals,
        bends=np.array(path.curvatures[i]),
        lengths=np.diff(at),
        bands=bands((at[:-1] + at[1:]) / 2),
        joints=joints(at[1:]),
        ends=points[1:],
    )


@dataclass(frozen=True)
class Matching:
    """Own pieces of every point: from `first` to `last`, (m,); `lost` is -1, or a lost point."""

    first: np.ndarray
    last: np.ndarray
    lost: int


def match(points, pieces):
    """Match the points of a motion, densely sampled, to the pieces of a path.

    Points are off by as much as they are apart when they are matched, for what lies between them
    may be nearer; their exact distances from their own pieces are for `excess`.
    """
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    slack = np.maximum(np.append(step, 0.0), np.append(0.0, step)) + 1e-9
    first, last, lost = _run(points, slack, *pieces.columns, pieces.ends, pieces.joints)
    if lost >= 0:
        return Matching(first, last, lost)
    back = _reverse(pieces)
    last_b, first_b, lost_b = _run(points[::-1], slack[::-1], *back.columns, back.ends, back.joints)
    n = len(pieces) - 1
    first_b, last_b = n - first_b[::-1], n - last_b[::-1]
    if lost_b >= 0:
        return Matching(first, last, len(points) - 1 - lost_b)
    first, last = np.maximum(first, first_b), np.minimum(last, last_b)
    wrong = np.flatnonzero(first > last)
    return Matching(first, last, int(wrong[0]) if len(wrong) else -1)


def _reverse(pieces):
    angle = (pieces.bends * pieces.lengths)[:, None]
    tangents = np.cos(angle) * pieces.tangents + np.sin(angle) * pieces.normals
    normals = np.cos(angle) * pieces.normals - np.sin(angle) * pieces.tangents
    return Pieces(
        starts=pieces.ends[::-1].copy(),
        tangents=-tangents[::-1],
        normals=normals[::-1].copy(),
        bends=pieces.bends[::-1].copy(),
        lengths=pieces.lengths[::-1].copy(),
        bands=pieces.bands[::-1].copy(),
        joints=np.append(pieces.joints[:-1][::-1], pieces.bands[0]),
        ends=pieces.starts[::-1].copy(),
    )


def excess(points, pieces, matching):
    """By how much the points are farther from their own pieces than these allow [m], (m,)."""
    return _excess(points, *pieces.columns, matching.first, matching.last)


def apart(points, targets, first, last, at):
    """Smallest distances [m] of `targets` from points whose own pieces include `at`, (k,).

    Args:
        points: Points of the motion, (m, dimension).
        targets: Points to come near, (k, dimension).
        first: First own pieces of the points, (m,).
        last: Last own pieces of the points, (m,).
        at: Pieces that end at the targets, increasing, (k,).

    Returns:
        The distances [m], (k,), and the points that are the nearest, (k,).
    """
    return _apart(points, targets, first, last, at)


@njit(cache=True)
def _free(x, start, tangent, normal, bend, length, band):
    """Stretch of a piece within `band` of x: distances from its start; empty if low > high."""
    w = x - start
    along = np.dot(w, tangent)
    if bend == 0.0:
        # As a difference of squares, a small distance is lost in a large one.
        off = w - along * tangent
        room = band * band - np.dot(off, off)
        if room < 0:
            return 1.0, 0.0
        half = math.sqrt(room)
        return max(along - half, 0.0), min(along + half, length)
    across = np.dot(w, normal)
    out = w - along * tangent - across * normal
    radius = 1.0 / bend
    turned = math.atan2(along, radius - across)
    from_center = math.hypot(along, radius - across)
    radial = (along * along + across * across - 2 * across * radius) / (from_center + radius)
    room = band * band - np.dot(out, out) - radial * radial
    if room < 0:
        return 1.0, 0.0
    share = room / (4 * max(from_center, 1e-300) * radius)
    half = math.pi if share >= 1 else 2 * math.asin(math.sqrt(share))
    sweep = length * bend
    low, high = 1.0, 0.0
    for k in range(-1, 2):
        a = max(turned + 2 * math.pi * k - half, 0.0)
        b = min(turned + 2 * math.pi * k + half, sweep)
        if a <= b:
            low, high = (a, b) if low > high else (min(low, a), max(high, b))
    return low * radius, high * radius


@njit(cache=True)
def _distance(x, start, tangent, normal, bend, length, end):
    """Distance from a piece."""
    w = x - start
    along = np.dot(w, tangent)
    ends = math.sqrt(min(np.dot(w, w), np.dot(x - end, x - end)))
    if bend == 0.0:
        if along < 0 or along > length:
            return ends
        off = w - along * tangent
        return math.sqrt(np.dot(off, off))
    across = np.dot(w, normal)
    out = w - along * tangent - across * normal
    radius = 1.0 / bend
    turned = math.atan2(along, radius - across) % (2 * math.pi)
    if turned > length * bend:
        return ends
    from_center = math.hypot(along, radius - across)
    radial = (along * along + across * across - 2 * across * radius) / (from_center + radius)
    return math.sqrt(radial * radial + np.dot(out, out))


@njit(cache=True)
def _run(points, slack, starts, tangents, normals, bends, lengths, bands, ends, joints):
    """First and last piece that each point can be matched to after those before; or one lost."""
    m, n = len(points), len(lengths)
    first, last = np.zeros(m, dtype=np.int64), np.zeros(m, dtype=np.int64)
    low = np.full(n, np.inf)
    high = np.full(n, -np.inf)
    low[0], high[0] = 0.0, 0.0
    begin, until = 0, 0
    for j in range(m):
        x = points[j]
        reached = False
        found_begin, found_until = -1, -1
        k = begin
        while k < n and (k <= until or reached):
            near = bands[k] + slack[j]
            a, b = _free(x, starts[k], tangents[k], normals[k], bends[k], lengths[k], near)
            lowest = np.inf
            if a <= b:
                if reached:
                    lowest = a
                elif max(a, low[k]) <= min(b, high[k]):
                    lowest = max(a, low[k])
            low[k] = lowest
            high[k] = b if lowest < np.inf else -np.inf
            if lowest < np.inf:
                found_begin = k if found_begin < 0 else found_begin
                found_until = k
            gap = x - ends[k]
            reached = (lowest < np.inf) and math.sqrt(np.dot(gap, gap)) <= joints[k] + slack[j]
            k += 1
        if found_begin < 0:
            return first, last, j
        for i in range(begin, found_begin):
            low[i], high[i] = np.inf, -np.inf
        begin, until = found_begin, found_until
        first[j], last[j] = begin, until
    return first, last, -1 if until == n - 1 else m - 1


@njit(cache=True)
def _excess(points, starts, tangents, normals, bends, lengths, bands, first, last):
    m = len(points)
    found = np.empty(m)
    for j in range(m):
        best = np.inf
        for k in range(first[j], last[j] + 1):
            angle = bends[k] * lengths[k]
            if bends[k] == 0.0:
                end = starts[k] + lengths[k] * tangents[k]
            else:
                across = 2 * math.sin(angle / 2) ** 2 / bends[k]
                end = starts[k] + math.sin(angle) / bends[k] * tangents[k] + across * normals[k]
            off = _distance(
                points[j], starts[k], tangents[k], normals[k], bends[k], lengths[k], end
            )
            best = min(best, off - bands[k])
        found[j] = best
    return found


@njit(cache=True)
def _apart(points, targets, first, last, at):
    distance = np.full(len(targets), np.inf)
    nearest = np.zeros(len(targets), dtype=np.int64)
    for j in range(len(points)):
        k = np.searchsorted(at, first[j] - 1)
        while k < len(at) and at[k] <= last[j]:
            gap = points[j] - targets[k]
            off = math.sqrt(np.dot(gap, gap))
            if off < distance[k]:
                distance[k], nearest[k] = off, j
            k += 1
    return distance, nearest
