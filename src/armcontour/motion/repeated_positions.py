"""`renew_positions`: positions of a log that is sampled faster than its positions are renewed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.motion.log import Log

# A longer sequence of equal positions is a rest of the joint [samples].
LONGEST_REPEAT = 10
# Smallest fraction of repeated positions in motion.
LEAST_REPEATED = 0.1
# A joint that repeats positions because of a coarse encoder or of sticking friction is slow: the
# next position differs by less than RESOLUTIONS times the smallest difference of the log, or by
# less than SLOW times the difference of two positions without repeats (medians).
RESOLUTIONS, SLOW = 4.0, 0.5
# Differences of positions up to this fraction of their range are rounding errors.
ROUNDING = 1e-9


def renew_positions(log: Log) -> tuple[Log, tuple[str, ...]]:
    """Replace measured positions that repeat previous ones, and describe them.

    Args:
        log: A log.

    Returns:
        The log with interpolated positions and without rows that only repeat the previous row, and
        a sentence if positions were repeated.
    """
    q = log.measured
    repeated = np.stack([_find_repeats(x) for x in q.T], axis=1)
    joints = np.flatnonzero(repeated.any(axis=0))
    if not len(joints):
        return log, ()
    rows = np.concatenate([log.command, q], axis=1)
    same = np.append(False, (np.diff(rows, axis=0) == 0).all(axis=1))
    kept = ~(same & repeated.any(axis=1))
    filled = q.copy()
    for j in joints:
        new = ~repeated[:, j]
        filled[:, j] = CubicSpline(log.t[new], q[new, j])(log.t)
    names = ", ".join(log.joint_names[j] for j in joints)
    return replace(log, t=log.t[kept], command=log.command[kept], measured=filled[kept]), (
        f"{log.source} repeats {repeated[:, joints].mean():.0%} of the measured positions of "
        f"{names}. Interpolation between the new positions replaces them.",
    )


def _find_repeats(q: FloatArray) -> BoolArray:
    """Mask of the positions of a moving joint that were not renewed, (n,)."""
    repeated, steps = np.full(len(q), False), np.abs(np.diff(q))
    changes = np.flatnonzero(steps > ROUNDING * np.ptp(q))
    lengths = np.diff(changes)
    jumps = steps[changes[1:]]
    moving = lengths <= LONGEST_REPEAT
    held, single = moving & (lengths > 1), lengths == 1
    if held.sum() <= LEAST_REPEATED * moving.sum():
        return repeated
    jump = float(np.median(jumps[held]))
    ordinary = float(np.median(jumps[single])) if single.any() else 0.0
    if jump < RESOLUTIONS * jumps.min() or jump < SLOW * ordinary:
        return repeated
    starts, ends = changes[:-1][held] + 1, changes[1:][held] + 1
    # The log may end before the next new position.
    if held[-1] and len(q) - 1 - changes[-1] <= lengths[-1]:
        starts, ends = np.append(starts, changes[-1] + 1), np.append(ends, len(q))
    for start, end in zip(starts, ends, strict=True):
        repeated[start + 1 : end] = True
    return repeated
