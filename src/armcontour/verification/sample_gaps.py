"""Gaps in sampled motions: intervals in which samples are missing, so the motion is unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.motion.log_checks import GAP

# With fewer intervals, the usual interval is unknown: these are waypoints, not a log.
FEWEST_LOG_INTERVALS = 20
# Number of intervals on either side of a gap whose median is the usual interval there.
NEIGHBOURS = 10
# Fraction of the intervals that are ordinary, and factor of their excess over the median that is
# still ordinary. For events at random times, the excess over this is below 1e-5.
ORDINARY = 0.95
EXCESS = 5.0
# The intervals of a log are uneven if the longest ordinary one exceeds the median by this factor.
# The gaps of an uneven log exceed all of its other intervals by the same factor.
UNEVEN_INTERVALS = 2.0
# Factor of the largest movement in an ordinary interval that an uneven log may have in a long one.
# A log that is written when a joint has moved has long intervals while the joints are slow.
MOVED = 2.0
# The arm rests in a gap if no joint moves in it by more than this fraction of its travel, or this
# multiple of its noise, and if it moves in the intervals before and after by at most SLOW_MOVEMENT
# times its largest ordinary movement. A periodic motion also returns to its position, but moves
# there.
REST_MOVEMENT = 1e-4
REST_NOISE_FACTOR = 6.0
SLOW_MOVEMENT = 0.05
# Factor of the median of the third differences of white noise that gives its standard deviation.
NOISE_OF_MEDIAN = 1.4826 / np.sqrt(20)


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleGap:
    """An interval in which samples are missing.

    Args:
        start: Time of the last sample before the gap [s].
        end: Time of the first sample after the gap [s].
        row: Number of the last sample before the gap, from 1.
        line: Line of this sample in its file; None without a file.
        at_rest: Whether the arm is at rest at the same position before and after the gap.
    """

    start: float
    end: float
    row: int
    line: int | None
    at_rest: bool

    @property
    def place(self) -> str:
        """The last sample before the gap, for messages."""
        return f"row {self.row}" if self.line is None else f"line {self.line}"


def find_gaps(
    t: FloatArray, q: FloatArray, error: FloatArray, lines: IntArray | None = None
) -> tuple[SampleGap, ...]:
    """Find the intervals that are much longer than the usual interval of a log.

    The usual interval is the median. An interval is a gap if it exceeds GAP times the median of all
    intervals and of the intervals just before and after it, so a log may change its rate. In a log
    with uneven intervals, it must also exceed the ordinary ones by far, and a joint must move
    farther in it than in any of these.

    - `t`: increasing times [s], (n,).
    - `q`: joint positions [rad], (n, dof).
    - `error`: bounds on the errors of the positions [rad], (dof,).
    - `lines`: lines of the samples in their file, (n,).
    """
    steps = np.diff(t)
    if len(steps) < FEWEST_LOG_INTERVALS:
        return ()
    median = float(np.median(steps))
    longest = float(np.quantile(steps, ORDINARY))
    limit = max(GAP * median, median + EXCESS * (longest - median))
    uneven = longest > UNEVEN_INTERVALS * median
    if uneven:
        ordered = np.sort(steps)
        jumps = np.flatnonzero(
            (ordered[1:] > limit) & (ordered[1:] > UNEVEN_INTERVALS * ordered[:-1])
        )
        limit = float(ordered[jumps[0]] if len(jumps) else ordered[-1])
    gaps = steps > limit
    for i in np.flatnonzero(gaps).tolist():
        before = steps[max(0, i - NEIGHBOURS) : i]
        after = steps[i + 1 : i + 1 + NEIGHBOURS]
        local = max(float(np.median(x)) for x in (before, after) if len(x))
        gaps[i] = steps[i] > GAP * local
    travel = np.abs(np.diff(q, axis=0))
    longest_travel = travel[steps <= limit].max(axis=0)
    if uneven:
        gaps &= (travel > MOVED * longest_travel).any(axis=1)
    resting = _find_rests(q, travel, longest_travel, error)
    return tuple(
        SampleGap(
            start=float(t[i]),
            end=float(t[i + 1]),
            row=i + 1,
            line=None if lines is None else int(lines[i]),
            at_rest=bool(resting[i]),
        )
        for i in np.flatnonzero(gaps).tolist()
    )


def _find_rests(
    q: FloatArray, travel: FloatArray, longest_travel: FloatArray, error: FloatArray
) -> BoolArray:
    """Return the mask of the intervals in which the arm rests, except for noise, (n - 1,).

    - `q`, `error`: as for `find_gaps`.
    - `travel`: travel of each joint in every interval [rad], (n - 1, dof).
    - `longest_travel`: longest travel of each joint in an interval without a gap [rad], (dof,).
    """
    noise = REST_NOISE_FACTOR * NOISE_OF_MEDIAN * np.median(np.abs(np.diff(q, 3, axis=0)), axis=0)
    rest_travel = np.maximum(REST_MOVEMENT * np.ptp(q, axis=0), noise) + 2 * error
    slow = (travel <= np.maximum(rest_travel, SLOW_MOVEMENT * longest_travel)).all(axis=1)
    around = np.pad(slow, 1, constant_values=True)
    resting: BoolArray = (travel <= rest_travel).all(axis=1) & around[:-2] & around[2:]
    return resting
