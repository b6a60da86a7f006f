"""Jerk of executed motion and of set-points.

A servo whose command has corners has steps of jerk, or of acceleration, whose size between two
results says more about their spacing than about the robot. So jerk is taken as its mean over one
command interval: what a controller can ask for, and never above the largest one.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.motion import Execution, TaughtData


def executed_jerk(executed: Execution) -> FloatArray:
    """Largest mean jerk of each joint over any command interval [rad/s³], (dof,)."""
    return np.asarray(np.abs(mean_jerk(executed)).max(axis=0))


def mean_jerk(executed: Execution) -> FloatArray:
    """Mean jerk over the command interval that ends at each time [rad/s³], (n, dof)."""
    t, ddq = executed.t, executed.ddq
    if len(t) < 2:
        return np.zeros_like(ddq)
    step = float(t[-1] - t[0]) / (len(t) - 1)
    k = max(1, round(executed.taught.period / step))
    # The arm stands still before the first result.
    before = np.concatenate([np.zeros((k, ddq.shape[1])), ddq])[: len(ddq)]
    return np.asarray((ddq - before) / (k * step))


def commanded_jerk(taught: TaughtData) -> FloatArray:
    """Largest third difference of the set-points over time, of each joint [rad/s³], (dof,).

    Before the first and after the last set-point the command is constant.
    """
    third = np.diff(np.pad(taught.q, ((3, 3), (0, 0)), mode="edge"), n=3, axis=0)
    return np.asarray(np.abs(third).max(axis=0) / taught.period**3)
