"""Wholes that are cut into several parts each, in tables of one row per part."""

from __future__ import annotations

import numpy as np

from armcontour._checks import IntArray


def number_parts(count: IntArray) -> tuple[IntArray, IntArray]:
    """The whole that each part belongs to, and the number of the part in it, both from 0.

    Args:
        count: Number of parts of each whole, (n,).
    """
    whole = np.repeat(np.arange(len(count)), count)
    return whole, np.arange(len(whole)) - np.repeat(np.cumsum(count) - count, count)
