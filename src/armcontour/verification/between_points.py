"""How far a controller may leave the path if it plans the motion between the points of a program.

KRL, RAPID and similar programs contain points of the plan, and their controllers do not publish how
they move between them. This module measures two motions through the points: straight lines in joint
space, as of MoveAbsJ, and the cubic spline of the joints over the times of the points, with
continuous acceleration and at rest at both ends, which stands for a spline such as PTP_SPLINE.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, Frozen, IntArray, kernel_array
from armcontour.core.kernel_cache import compiled
from armcontour.core.render import number
from armcontour.core.sampled_data import interpolate
from armcontour.core.text import short_repr
from armcontour.geometry.projection import pad_to_space
from armcontour.motion import JointPath, Trajectory, arm_of
from armcontour.robot import Arm

# Parts of each interval between two points. A peak between two parts is missed by at most 1/32 of
# the distance where the path has a corner, and by 1/1024 where it is smooth.
PARTS = 32
# The nearest point of the other motion is searched this many intervals before and after.
NEARBY = 2
# Number of intervals that are measured at once, which limits the memory.
INTERVALS_AT_ONCE = 3000
# A wait begins at the first point that is later than its time minus this fraction of the interval.
SAME_TIME = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BetweenPoints(Frozen):
    """Distances between the planned tool path and the motions through the points of a program.

    They cover the whole plan, with rapids, leads and pierces. Index k is of the interval between
    the points k and k + 1.

    Args:
        interval: Time between two points [s]; the last interval may be shorter.
        t: Times of the points in the plan [s], (n,).
        lines: Largest distance from straight lines in joint space to the path [m], (n - 1,).
        spline: Largest distance from the cubic spline to the path [m], (n - 1,).
        missed: Largest distance from the path to the farther of both motions [m], (n - 1,).
    """

    interval: float
    t: FloatArray
    lines: FloatArray
    spline: FloatArray
    missed: FloatArray

    @property
    def max(self) -> float:
        """Largest distance from a motion to the path [m]."""
        return float(self._from_motions.max())

    @property
    def t_max(self) -> float:
        """Time of the point after which this distance is largest [s]."""
        return float(self.t[int(self._from_motions.argmax())])

    @property
    def _from_motions(self) -> FloatArray:
        """Distance from the farther of both motions to the path [m], (n - 1,)."""
        return np.maximum(self.lines, self.spline)

    @property
    def largest(self) -> float:
        """Largest distance in both directions [m]."""
        return max(self.max, float(self.missed.max()))

    def largest_within(self, start: float, end: float) -> float:
        """Return the largest distance in both directions between two times of the plan [m]."""
        first = int(np.searchsorted(self.t, start, side="right")) - 1
        last = int(np.searchsorted(self.t, end))
        within = np.maximum(self._from_motions, self.missed)[max(first, 0) : last]
        return float(within.max(initial=0.0))

    def __str__(self) -> str:
        """Write both distances as a sentence without its end."""
        lines = number(float(self.lines.max()), "m")
        spline = number(float(self.spline.max()), "m")
        return (
            f"between the points, straight lines in joint space leave the path by up to {lines}, "
            f"a spline by up to {spline}"
        )

    __repr__ = short_repr


def measure_between_points(plan: Trajectory, interval: float) -> BetweenPoints:
    """Measure how far a controller may leave the path of a plan between the points of a program.

    The robot rests at waits for inputs, where the spline ends and begins again.

    Args:
        plan: The plan, with its arm.
        interval: Time between two points [s].

    Raises:
        InvalidInput: The plan has no arm.
    """
    arm = arm_of(plan)
    samples = plan.sample(interval)
    motions = _Motions(
        plan=plan,
        arm=arm,
        t=samples.t,
        q=samples.q,
        splines=_splines(samples.t, samples.q, _rests(plan, samples.t, interval)),
    )
    count = len(samples.t) - 1
    distances = [
        _measure(motions, first, min(first + INTERVALS_AT_ONCE, count))
        for first in range(0, count, INTERVALS_AT_ONCE)
    ]
    lines, spline, missed = np.concatenate(distances, axis=1)
    return BetweenPoints(interval=interval, t=samples.t, lines=lines, spline=spline, missed=missed)


class _Motions(NamedTuple):
    """The plan, and the motions through its points."""

    plan: Trajectory
    arm: Arm
    t: FloatArray  # Times of the points [s], (n,)
    q: FloatArray  # Joint positions of the points [rad], (n, dof)
    splines: list[tuple[float, JointPath]]  # Start [s] of each spline, and the spline over time


def _measure(motions: _Motions, first: int, last: int) -> FloatArray:
    """Return the distances `lines`, `spline` and `missed` of some intervals, (3, last - first)."""
    t = motions.t
    q = motions.q
    # The nearest point may be in an interval before or after.
    begin = max(first - NEARBY, 0)
    end = min(last + NEARBY, len(t) - 1)
    fine_t = _divide(t[begin : end + 1])
    planned = _tool_points(motions.arm, motions.plan(fine_t))
    lines = _tool_points(motions.arm, interpolate(fine_t, t[begin : end + 1], q[begin : end + 1]))
    spline = _tool_points(motions.arm, _follow_splines(motions.splines, fine_t))
    missed = np.maximum(_largest_distances(planned, lines), _largest_distances(planned, spline))
    found = [_largest_distances(lines, planned), _largest_distances(spline, planned), missed]
    return np.stack(found)[:, first - begin : last - begin]


def _divide(t: FloatArray) -> FloatArray:
    """Return the times that divide each interval into `PARTS` parts, with the last time."""
    fractions = np.arange(PARTS) / PARTS
    inner = t[:-1, None] + fractions * np.diff(t)[:, None]
    return np.append(inner.ravel(), t[-1])


def _rests(plan: Trajectory, t: FloatArray, interval: float) -> IntArray:
    """Return the indices of points at which a spline ends: waits, and the last point."""
    waits = np.array([x.t for x in plan.waits]) - SAME_TIME * interval
    last = len(t) - 1
    found = np.unique(np.append(np.searchsorted(t, waits), last))
    return np.asarray(found[found > 0])


def _splines(t: FloatArray, q: FloatArray, ends: IntArray) -> list[tuple[float, JointPath]]:
    """Return the splines through points, at rest at the indices `ends`, with their start times."""
    splines = []
    first = 0
    for last in ends.tolist():
        part = slice(first, last + 1)
        start = float(t[first])
        splines.append((start, JointPath.spline(q[part], t[part] - start, ends="clamped")))
        first = last
    return splines


def _follow_splines(splines: Sequence[tuple[float, JointPath]], t: FloatArray) -> FloatArray:
    """Return the joint positions of consecutive splines at times [s], (n, dof)."""
    starts = [start for start, _ in splines]
    cuts = np.searchsorted(t, starts[1:])
    parts = []
    for (start, spline), times in zip(splines, np.split(t, cuts), strict=True):
        parts.append(spline(np.minimum(times - start, spline.length)))
    return np.concatenate(parts)


def _tool_points(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the tool points of joint positions in space [m], (n, 3)."""
    return kernel_array(pad_to_space(arm.tool_position(q)))


def _largest_distances(points: FloatArray, line: FloatArray) -> FloatArray:
    """Return the largest distance from points to a motion in each interval [m], (n - 1,).

    - `points`, `line`: positions of both motions at the same times [m], (n, 3) each.
    """
    distance = nearby_distances(points, line)
    # Both motions meet at the points of the program, so the first of each interval suffices.
    return np.asarray(distance[:-1].reshape(-1, PARTS).max(axis=1))


@compiled()
def nearby_distances(points: FloatArray, line: FloatArray) -> FloatArray:
    """Return the distances of points from the part of a polyline near them in time [m], (n,).

    - `points`, `line`: positions at the same times [m], (n, 3) each.
    """
    n = len(points)
    window = NEARBY * PARTS
    distance = np.empty(n)
    for i in range(n):
        best = np.inf
        for k in range(max(i - window, 0), min(i + window, n - 1)):
            # The foot point on the chord from k to k + 1.
            along = 0.0
            size2 = 0.0
            for axis in range(3):
                chord = line[k + 1, axis] - line[k, axis]
                along += (points[i, axis] - line[k, axis]) * chord
                size2 += chord * chord
            fraction = min(max(along / size2, 0.0), 1.0) if size2 > 0.0 else 0.0
            total = 0.0
            for axis in range(3):
                chord = line[k + 1, axis] - line[k, axis]
                gap = points[i, axis] - line[k, axis] - fraction * chord
                total += gap * gap
            best = min(best, total)
        distance[i] = np.sqrt(best)
    return distance
