"""Search for collision-free joint paths between two postures, for rapids around obstacles."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.motion import JointPath
from armcontour.verification.clearance.clearance import Cell

# Length that a rounding occupies on each line at its corner, as a share of half of the shorter
# line; tried in this order. With 0, the motion stops at the corners.
ROUNDED = (0.9, 0.5, 0.2, 0.0)
# Search for intermediate postures: length of one step of a tree [rad], margin of the sampled box
# around both ends [rad], and maximum number of checked lines.
STEP, AROUND, MAX_PIECES = 0.4, 1.5, 1500
# Number of attempted shortcuts between two postures of a path.
SHORTCUTS = 60


def connect(
    cell: Cell, first: FloatArray, last: FloatArray, ranges: tuple[FloatArray, FloatArray]
) -> JointPath | None:
    """Find a joint path between two postures that satisfies all margins; None if not found."""
    # Two trees of postures grow towards each other (RRT-Connect; Kuffner and LaValle, 2000). Every
    # line is proven to be collision-free. The result is deterministic.
    postures = _search(cell, first, last, ranges)
    return None if postures is None else path_through(cell, _shorten(cell, postures))


def path_through(cell: Cell, postures: FloatArray) -> JointPath | None:
    """Make a collision-free joint path through postures; None if no rounding is collision-free."""
    # postures: joint positions [rad], (n, dof).
    apart = np.append(True, np.abs(np.diff(postures, axis=0)).max(axis=1) > 1e-9)
    for share in ROUNDED if apart.sum() > 2 else ROUNDED[-1:]:
        path = round_postures(postures[apart], share)
        if cell.keeps(path):
            return path
    return None


def round_postures(postures: FloatArray, share: float) -> JointPath:
    """Make a joint path of straight lines between postures, with parabolas at the corners."""
    # share: a parabola occupies this share of half of the shorter line at its corner; 0 stops at
    # every corner.
    steps = np.diff(postures, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / lengths[:, None]
    cut = np.zeros(len(postures))
    cut[1:-1] = share * np.minimum(lengths[:-1], lengths[1:]) / 2
    rows, widths = [], []
    for k, (direction, length) in enumerate(zip(directions, lengths, strict=True)):
        line = length - cut[k] - cut[k + 1]
        rows.append([postures[k] + cut[k] * direction, line * direction, 0 * direction])
        widths.append(line)
        if cut[k + 1] > 0:
            r = cut[k + 1]
            # The parabola extends from r before to r after the corner and connects both directions.
            rows.append(
                [
                    postures[k + 1] - r * direction,
                    2 * r * direction,
                    r * (directions[k + 1] - direction),
                ]
            )
            widths.append(2 * r)
    coefficients = np.zeros((len(rows), 6, postures.shape[1]))
    coefficients[:, :3] = rows
    return JointPath(breaks=np.concatenate([[0.0], np.cumsum(widths)]), coefficients=coefficients)


def _search(
    cell: Cell, first: FloatArray, last: FloatArray, ranges: tuple[FloatArray, FloatArray]
) -> FloatArray | None:
    """Postures from the first to the last, connected by collision-free lines; None if not found."""
    low = np.maximum(np.minimum(first, last) - AROUND, ranges[0])
    high = np.minimum(np.maximum(first, last) + AROUND, ranges[1])
    random = np.random.default_rng(0)
    lines = _LineChecker(cell)
    trees = _Tree(first), _Tree(last)
    while lines.remaining > 0:
        goal = random.uniform(low, high)
        for a, b in (trees, trees[::-1]):
            reached = a.grow(goal, lines)
            if reached is None:
                continue
            met = b.grow(a.postures[reached], lines, whole=True)
            if met is not None and np.array_equal(b.postures[met], a.postures[reached]):
                ends = (a.trace_to_root(reached), b.trace_to_root(met))
                begin, end = ends if a is trees[0] else ends[::-1]
                return np.array([*begin[::-1], *end[1:]])
    return None


class _LineChecker:
    """Checker of straight lines in joint space, with a limited number of checks."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self.remaining = MAX_PIECES

    def is_clear(self, first: FloatArray, last: FloatArray) -> bool:
        """True if the line is collision-free; False if it is not or no checks are left."""
        self.remaining -= 1
        return self.remaining >= 0 and self._cell.keeps(JointPath.spline([first, last]))


class _Tree:
    """Postures connected to a root by collision-free lines."""

    def __init__(self, root: FloatArray) -> None:
        self.postures = [root]
        self.parents = [0]

    def grow(self, goal: FloatArray, lines: _LineChecker, *, whole: bool = False) -> int | None:
        """Grow towards a goal; index of the newest posture, None if no line is collision-free."""
        # Growth starts from the nearest posture. With `whole`, it continues to the goal; otherwise
        # it is one step.
        rows = np.array(self.postures)
        k = int(np.argmin(np.linalg.norm(rows - goal, axis=1)))
        newest: int | None = None
        while True:
            step = goal - self.postures[k]
            length = float(np.linalg.norm(step))
            if length == 0.0:
                return k
            ends = length <= STEP
            new = goal if ends else self.postures[k] + step * (STEP / length)
            if not lines.is_clear(self.postures[k], new):
                return newest
            self.postures.append(new)
            self.parents.append(k)
            k = newest = len(self.postures) - 1
            if ends or not whole:
                return newest

    def trace_to_root(self, k: int) -> list[FloatArray]:
        """Postures from posture k to the root of the tree."""
        postures = [self.postures[k]]
        while k:
            k = self.parents[k]
            postures.append(self.postures[k])
        return postures


def _shorten(cell: Cell, postures: FloatArray) -> FloatArray:
    """Replace detours by collision-free lines; returns the remaining postures."""
    random = np.random.default_rng(1)
    for _ in range(SHORTCUTS):
        if len(postures) < 3:
            break
        i, j = sorted(random.choice(len(postures), 2, replace=False).tolist())
        if j > i + 1 and cell.keeps(JointPath.spline([postures[i], postures[j]])):
            postures = np.concatenate([postures[: i + 1], postures[j:]])
    return postures
