"""The tool speed as a share of the velocity that is assigned where the tool is."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.evaluation.following import Followed
from armcontour.geometry import Path


def measure_shares(
    path: Path, found: Followed, speed: FloatArray, limit: float | None, *, between: bool = False
) -> FloatArray:
    """Measure the tool speed over the velocity assigned at the place of the tool, (n,).

    The place of a tool off the path is known to within its distance from the path. So next to a
    joint between segments, as near as that, the larger of both velocities is the assigned one.
    Where it falls or rises between two samples, the speed at that place counts, which is
    interpolated linearly.

    Args:
        path: The path, whose segments may have speeds of their own.
        found: Places of the tool on it.
        speed: Tool speed at the samples [m/s], (n,).
        limit: Assigned velocity of the whole path [m/s]; None without one.
        between: Whether the shares bound those between samples too, taking the speed for no more
            bent there than it is at the samples around, with one kink at most.

    Returns:
        The shares; 0 where no velocity is assigned.
    """
    assigned = np.fmin(path.speeds, np.inf if limit is None else limit)
    assigned = np.where(np.isnan(assigned), np.inf, assigned)
    if not np.isfinite(assigned).any():
        return np.zeros(len(speed))
    high = speed + _bound_between(speed) if between else speed
    s, off = np.maximum.accumulate(found.s), found.distance
    first, last = s - off, s + off
    here = np.maximum(_at(path, assigned, first, "left"), _at(path, assigned, last, "right"))
    share = high / here
    before, after = assigned[:-1], assigned[1:]
    # Where the assigned velocity falls, the first sample past the joint has passed it before.
    falls = np.flatnonzero(after < before)
    _raise_at_joints(share, high, first, path.breaks[1:-1][falls], after[falls], past=1)
    # Where it rises, the last sample before the joint goes on until there.
    rises = np.flatnonzero(after > before)
    _raise_at_joints(share, high, last, path.breaks[1:-1][rises], before[rises], past=0)
    return share


def _at(path: Path, assigned: FloatArray, s: FloatArray, side: str) -> FloatArray:
    """Assigned velocities at places, which may be beyond the ends of the path [m/s], (n,)."""
    inside = np.clip(s, 0.0, path.length)
    return assigned[path.locate(inside, side="left" if side == "left" else "right")]


def _raise_at_joints(
    share: FloatArray,
    speed: FloatArray,
    place: FloatArray,
    joints: FloatArray,
    assigned: FloatArray,
    *,
    past: int,
) -> None:
    """Raise shares to those at the time at which the tool passes joints between segments.

    Args:
        share: The shares, (n,); changed.
        speed: Tool speed at the samples [m/s], (n,).
        place: Places of the samples [m], (n,).
        joints: Places of the joints [m], (joints,).
        assigned: Velocity assigned on the slow side of each joint [m/s], (joints,).
        past: 1 to raise the share of the sample after the joint, 0 that of the one before.
    """
    place = np.maximum.accumulate(place)
    i = np.searchsorted(place, joints, side="right")
    inside = (i > 0) & (i < len(place))
    i, joints, assigned = i[inside], joints[inside], assigned[inside]
    size = place[i] - place[i - 1]
    part = (joints - place[i - 1]) / np.where(size > 0, size, 1.0)
    passing = speed[i - 1] + part * (speed[i] - speed[i - 1])
    np.maximum.at(share, i - 1 + past, passing / assigned)


def _bound_between(speed: FloatArray) -> FloatArray:
    """How much higher than at a sample the speed may be between it and the next ones, (n,)."""
    if len(speed) < 3:
        return np.zeros(len(speed))
    bent = np.pad(np.abs(np.diff(speed, 2)), 1, mode="edge")
    # A parabola is above both ends by at most an eighth of its second difference, a kink by at most
    # a quarter of the sum of those around it.
    pairs = (bent[1:] + bent[:-1]) / 4
    return np.asarray(np.maximum(np.append(pairs, 0.0), np.append(0.0, pairs)))
