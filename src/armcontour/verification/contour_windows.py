"""Assignment of samples of a motion to the contours of a program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.program import Program, contour_called

# The tool visits an end of a contour if its distance from the end is at most NEAR_SHARE of the
# contour's length and at most NEAR [m], or at most AGAIN times the smallest distance of all
# samples.
NEAR_SHARE = 0.05
NEAR = 1e-3
AGAIN = 1.5
# Range of the tool's travel along a contour, relative to the contour's length. Chords between
# samples shorten the travel, measurement noise lengthens it.
DRAWN = (0.5, 1.5)


@dataclass(frozen=True, slots=True)
class _Window:
    """Samples `first` to `last` on a contour, linked to the window of the previous contour."""

    first: int  # First sample on the contour
    last: int  # Last sample on the contour
    worst: float  # Largest distance between tool and contour in this and all previous windows [m]
    before: _Window | None  # Window of the previous contour; None for the first contour


def find_windows(tool: FloatArray, program: Program) -> list[tuple[int, int]]:
    """Find the first and the last sample on every contour of a program, in order."""
    # The result minimizes the largest distance between tool and contours over all assignments in
    # the order of the contours. If the result exceeds a permitted distance, so does every other
    # assignment. tool: tool points [m], (n, dimension).
    travel = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tool, axis=0), axis=1)))
    previous: list[_Window] = []
    for number, contour in enumerate(program.contours):
        earliest = min((x.last for x in previous), default=0)
        windows_here = []
        for first, last in _find_candidates(tool, travel, contour.path, earliest):
            # Best window of the previous contour that ends before this window begins.
            early = (x for x in previous if x.last <= first)
            before = min(early, key=lambda x: x.worst, default=None)
            if before is not None or number == 0:
                worst = float(contour.path.project(tool[first : last + 1]).distance.max())
                worst = max(worst, 0.0 if before is None else before.worst)
                windows_here.append(_Window(first, last, worst, before))
        if not windows_here:
            raise InvalidInput(
                f"The tool does not follow {contour_called(contour, number)} from its start to its "
                "end. Check the trajectory of the whole program, with the contours in the order of "
                "the job."
            )
        previous = windows_here
    best: _Window | None = min(previous, key=lambda x: x.worst)
    windows = []
    while best is not None:
        windows.append((best.first, best.last))
        best = best.before
    return windows[::-1]


def _find_candidates(
    tool: FloatArray, travel: FloatArray, path: Path, earliest: int
) -> list[tuple[int, int]]:
    """Find pairs of samples, at both ends of a path, with a tool travel of about its length."""
    ends = path([0.0, path.length])
    starts = _find_visits(tool, ends[0], path.length, earliest)
    stops = _find_visits(tool, ends[1], path.length, earliest)
    low, high = (share * path.length for share in DRAWN)
    return [
        (first, last)
        for first in (last for _, last in starts)
        for last in (first for first, _ in stops)
        if last > first and low <= travel[last] - travel[first] <= high
    ]


def _find_visits(
    tool: FloatArray, point: FloatArray, length: float, earliest: int
) -> list[tuple[int, int]]:
    """Find the first and the last nearest sample of each visit of the tool to a point."""
    distance = np.linalg.norm(tool[earliest:] - point, axis=1)
    if not len(distance):
        return []
    near = distance <= max(min(NEAR, NEAR_SHARE * length), AGAIN * float(distance.min()))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(np.int8)))
    visits = []
    for first, after in edges.reshape(-1, 2).tolist():
        visit = distance[first:after]
        nearest = np.flatnonzero(visit <= visit.min() * (1 + 1e-9)) + first + earliest
        visits.append((int(nearest[0]), int(nearest[-1])))
    return visits
