"""When samples of a motion are on which contour of a program: samples do not say so themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.program import Program, contour_called

# A tool that is nearer to an end of a contour than this share of its length and this distance [m]
# visits that end; or nearer than half as far again as it ever comes.
NEAR_SHARE = 0.05
NEAR = 1e-3
AGAIN = 1.5
# What the tool draws from one end of a contour to the other is between these shares of its length:
# chords between samples are shorter, noise of measured samples makes it longer.
DRAWN = (0.5, 1.5)


@dataclass(frozen=True, slots=True)
class _Window:
    """Samples `first` to `last`, and the largest distance of this motion and those before."""

    first: int
    last: int
    worst: float
    before: _Window | None


def find_windows(tool: FloatArray, program: Program) -> list[tuple[int, int]]:
    """First and last sample on every contour of a program, in order.

    Of all ways to find the contours one after the other in the samples, the one whose largest
    distance between tool and contours is smallest: whatever is found to be too far is so.

    Args:
        tool: Tool points [m], (n, dimension).
        program: The program; between its contours the tool may go anywhere.

    Raises:
        InvalidInput: A contour that the tool does not follow from its start to its end.
    """
    drawn = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tool, axis=0), axis=1)))
    known: list[_Window] = []
    for number, contour in enumerate(program.contours):
        earliest = min((x.last for x in known), default=0)
        found = [
            window
            for first, last in _candidates(tool, drawn, contour.path, earliest)
            if (window := _after(known, tool, contour.path, first, last, number == 0)) is not None
        ]
        if not found:
            raise InvalidInput(
                f"The tool does not follow {contour_called(contour, number)} from its start to its "
                "end: give the trajectory of the whole program, in the order in which the job has "
                "its contours."
            )
        known = found
    best: _Window | None = min(known, key=lambda x: x.worst)
    windows = []
    while best is not None:
        windows.append((best.first, best.last))
        best = best.before
    return windows[::-1]


def _candidates(
    tool: FloatArray, drawn: FloatArray, path: Path, earliest: int
) -> list[tuple[int, int]]:
    """Pairs of samples at the start and at the end of a path, between which its length is drawn."""
    ends = path([0.0, path.length])
    starts = _visits(tool, ends[0], path.length, earliest)
    stops = _visits(tool, ends[1], path.length, earliest)
    low, high = (share * path.length for share in DRAWN)
    return [
        (first, last)
        for first in (last for _, last in starts)
        for last in (first for first, _ in stops)
        if last > first and low <= drawn[last] - drawn[first] <= high
    ]


def _visits(
    tool: FloatArray, point: FloatArray, length: float, earliest: int
) -> list[tuple[int, int]]:
    """The first and the last nearest sample of every visit of the tool to a point."""
    off = np.linalg.norm(tool[earliest:] - point, axis=1)
    if not len(off):
        return []
    near = off <= max(min(NEAR, NEAR_SHARE * length), AGAIN * float(off.min()))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(np.int8)))
    found = []
    for begin, end in edges.reshape(-1, 2).tolist():
        here = off[begin:end]
        nearest = np.flatnonzero(here <= here.min() * (1 + 1e-9)) + begin + earliest
        found.append((int(nearest[0]), int(nearest[-1])))
    return found


def _after(
    known: list[_Window], tool: FloatArray, path: Path, first: int, last: int, is_first: bool
) -> _Window | None:
    """A window after the best one of the contour before; None if there is none before it."""
    before = min((x for x in known if x.last <= first), key=lambda x: x.worst, default=None)
    if before is None and not is_first:
        return None
    worst = float(path.project(tool[first : last + 1]).distance.max())
    return _Window(first, last, max(worst, 0.0 if before is None else before.worst), before)
