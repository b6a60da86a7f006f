"""Checking what a motion leaves out of its path: the distance from the path to the tool's way."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.evaluation.following import follow_path
from armcontour.evaluation.tally import Tally

# The way of the tool is looked at so often between two breaks of a law.
PLACES = 4


def judge_missed(motion: Any, tally: Tally, allowed: float) -> None:
    """Offer the distances from the path to the tool to the tally.

    The tool's way is straight between two places that are looked at, less certain by as much as the
    way is bent around them.

    Args:
        motion: A law, or samples with bounds on their errors.
        tally: Where findings go; it has a path.
        allowed: Largest distance [m].
    """
    assert tally.path is not None
    if callable(motion):
        breaks = np.asarray(motion.breaks, dtype=np.float64)
        inner = breaks[:-1, None] + np.arange(PLACES) / PLACES * np.diff(breaks)[:, None]
        t = np.append(inner.ravel(), breaks[-1])
        q = np.asarray(motion(t, 0, side="left"))
        error = np.zeros(q.shape[1])
    else:
        t, q, error = motion.t, motion.q, motion.errors[0]
    points, off = tally.tool(q, error)
    found = follow_path(tally.path, points)
    bent = np.zeros(len(points))
    middle = (points[2:] + points[:-2]) / 2
    bent[1:-1] = np.linalg.norm(points[1:-1] - middle, axis=1)
    around = np.maximum(bent, np.maximum(np.append(bent[1:], 0.0), np.append(0.0, bent[:-1])))
    tally.offer("path_missed", t, found.missed, allowed, q, around + off)
    if tally.deviation is not None:
        # From its own place, where the nearest one may be on another line.
        tally.offer("path_deviation", t, found.distance, tally.deviation, q, off)
