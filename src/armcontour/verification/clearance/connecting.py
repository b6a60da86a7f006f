"""Joint paths between two postures that keep clear of everything: rapids around obstacles."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.motion import JointPath
from armcontour.verification.clearance.clearance import Cell

# Corners of a path through postures are rounded over these shares of half of what is between two
# postures; without any the motion stops there.
ROUNDED = (0.9, 0.5, 0.2, 0.0)
# The search for postures between: how far a branch grows at once [rad], how far around the two ends
# postures are tried [rad], and how many pieces of motion are looked at before it is given up.
STEP, AROUND, MOST_PIECES = 0.4, 1.5, 1500
# So often, two postures of a path are connected directly in the place of what is between them.
SHORTCUTS = 60


def connect(
    cell: Cell, first: FloatArray, last: FloatArray, ranges: tuple[FloatArray, FloatArray]
) -> JointPath | None:
    """A joint path between two postures along which the arm keeps its margins; None if not found.

    Two trees of postures grow towards each other (RRT-Connect; Kuffner and LaValle, 2000). Every
    piece of them is proven to be clear. The same input gives the same path.

    Args:
        cell: The arm and its cell.
        first: The first posture [rad], (dof,).
        last: The last posture [rad], (dof,).
        ranges: Lowest and highest joint positions [rad], (dof,) each.
    """
    found = _search(cell, first, last, ranges)
    return None if found is None else through(cell, _shorten(cell, found))


def through(cell: Cell, postures: FloatArray) -> JointPath | None:
    """A joint path through postures with rounded corners that keeps clear; None if there is none.

    Args:
        cell: The arm and its cell.
        postures: The postures [rad], (n, dof).
    """
    apart = np.append(True, np.abs(np.diff(postures, axis=0)).max(axis=1) > 1e-9)
    for share in ROUNDED if apart.sum() > 2 else ROUNDED[-1:]:
        path = round_postures(postures[apart], share)
        if cell.keeps(path):
            return path
    return None


def round_postures(postures: FloatArray, share: float) -> JointPath:
    """Straight lines in joint space between postures, with parabolas at the corners.

    Args:
        postures: The postures, no two in a row the same [rad], (n, dof).
        share: How much of half of each line its parabolas take; 0 stops at every corner.
    """
    steps = np.diff(postures, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    ways = steps / lengths[:, None]
    cut = np.zeros(len(postures))
    cut[1:-1] = share * np.minimum(lengths[:-1], lengths[1:]) / 2
    rows, widths = [], []
    for k, (way, length) in enumerate(zip(ways, lengths, strict=True)):
        line = length - cut[k] - cut[k + 1]
        rows.append([postures[k] + cut[k] * way, line * way, 0 * way])
        widths.append(line)
        if cut[k + 1] > 0:
            r = cut[k + 1]
            # From r before the corner to r after it; dq_ds turns from one way to the next.
            rows.append([postures[k + 1] - r * way, 2 * r * way, r * (ways[k + 1] - way)])
            widths.append(2 * r)
    coefficients = np.zeros((len(rows), 6, postures.shape[1]))
    coefficients[:, :3] = rows
    return JointPath(breaks=np.concatenate([[0.0], np.cumsum(widths)]), coefficients=coefficients)


def _search(
    cell: Cell, first: FloatArray, last: FloatArray, ranges: tuple[FloatArray, FloatArray]
) -> FloatArray | None:
    """Postures from the first to the last one with clear lines between them; None if not found."""
    low = np.maximum(np.minimum(first, last) - AROUND, ranges[0])
    high = np.minimum(np.maximum(first, last) + AROUND, ranges[1])
    random = np.random.default_rng(0)
    lines = _Lines(cell)
    trees = _Tree(first), _Tree(last)
    while lines.left > 0:
        goal = random.uniform(low, high)
        for a, b in (trees, trees[::-1]):
            reached = a.grow(goal, lines)
            if reached is None:
                continue
            met = b.grow(a.postures[reached], lines, whole=True)
            if met is not None and np.array_equal(b.postures[met], a.postures[reached]):
                ends = (a.back(reached), b.back(met))
                begin, rest = ends if a is trees[0] else ends[::-1]
                return np.array([*begin[::-1], *rest[1:]])
    return None


class _Lines:
    """Straight lines in joint space, of which a limited number is looked at.

    Args:
        cell: The arm and its cell.

    Attributes:
        left: How many more are looked at.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self.left = MOST_PIECES

    def clear(self, first: FloatArray, last: FloatArray) -> bool:
        """Whether the line between two postures is clear; none is after the last one looked at."""
        self.left -= 1
        return self.left >= 0 and self._cell.keeps(JointPath.spline([first, last]))


class _Tree:
    """Postures that can be reached from a root on clear lines.

    Args:
        root: The root [rad], (dof,).
    """

    def __init__(self, root: FloatArray) -> None:
        self.postures = [root]
        self.parents = [0]

    def grow(self, goal: FloatArray, lines: _Lines, *, whole: bool = False) -> int | None:
        """Grow from the nearest posture towards a goal; index of the last new posture, or None.

        Args:
            goal: The goal [rad], (dof,).
            lines: The lines of the search.
            whole: Whether to go on until the goal, not for one step only.
        """
        rows = np.array(self.postures)
        k = int(np.argmin(np.linalg.norm(rows - goal, axis=1)))
        found: int | None = None
        while True:
            way = goal - self.postures[k]
            length = float(np.linalg.norm(way))
            if length == 0.0:
                return k
            ends = length <= STEP
            new = goal if ends else self.postures[k] + way * (STEP / length)
            if not lines.clear(self.postures[k], new):
                return found
            self.postures.append(new)
            self.parents.append(k)
            k = found = len(self.postures) - 1
            if ends or not whole:
                return found

    def back(self, k: int) -> list[FloatArray]:
        """Postures from one of the tree to its root."""
        found = [self.postures[k]]
        while k:
            k = self.parents[k]
            found.append(self.postures[k])
        return found


def _shorten(cell: Cell, postures: FloatArray) -> FloatArray:
    """The same way with detours left out, where the direct line is clear."""
    random = np.random.default_rng(1)
    for _ in range(SHORTCUTS):
        if len(postures) < 3:
            break
        i, j = sorted(random.choice(len(postures), 2, replace=False).tolist())
        if j > i + 1 and cell.keeps(JointPath.spline([postures[i], postures[j]])):
            postures = np.concatenate([postures[: i + 1], postures[j:]])
    return postures
