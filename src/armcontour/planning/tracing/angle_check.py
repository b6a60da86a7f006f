"""Check that an angle along a joint path stays below a limit, at any point of the path."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray

# Possible change of the angle between two points from which the bound counts as the angle [rad]
FINEST_CHANGE = 1e-6


class LargestAngle(NamedTuple):
    """An angle that exceeds its limit."""

    s: float  # Arc length [m]
    angle: float  # The angle [rad]


def find_excess(
    s: FloatArray, change: FloatArray, angles: Callable[[FloatArray], FloatArray], limit: float
) -> LargestAngle | None:
    """Return a place at which an angle exceeds its limit; None if it does so nowhere.

    Between two points, at which the angle is a and b and between which it changes by at most c, the
    angle is at most (a + b + c) / 2. Intervals whose bound exceeds the limit are halved.

    - `s`: arc lengths that divide the path into intervals [m], (n,).
    - `change`: largest possible change of the angle from the start to them, (n,) [rad]; between
      them it is linear.
    - `angles`: returns the angles at arc lengths [rad], (m,) -> (m,).
    - `limit`: largest allowed angle [rad].
    """
    known = angles(s)
    # Rows: arc lengths of both ends, angles at both ends, and largest change between them.
    intervals = np.stack([s[:-1], s[1:], known[:-1], known[1:], np.diff(change)])
    while True:
        begin, end, first, last, inside = intervals
        bound = (first + last + inside) / 2
        largest = np.where(inside > FINEST_CHANGE, np.maximum(first, last), bound)
        if (largest > limit).any():
            k = int(np.argmax(largest))
            place = begin[k] if first[k] > last[k] else end[k]
            return LargestAngle(float(place), float(largest[k]))
        begin, end, first, last, inside = intervals[:, bound > limit]
        if not len(begin):
            return None
        middle = (begin + end) / 2
        angle = angles(middle)
        half = inside / 2
        halves = [begin, middle, first, angle, half], [middle, end, angle, last, half]
        intervals = np.concatenate([np.stack(x) for x in halves], axis=1)
