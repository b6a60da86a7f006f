"""Motions with known formulas."""

import numpy as np

import armcontour as ac
from armcontour.motion import LapLaw


def laps(times, dq, ddq, start=(0.3, -0.2)):
    """A trajectory of laps with given accelerations; velocities jump where `dq` says so."""
    h = np.diff(times)
    dq = np.asarray(dq, float)
    ddq = np.asarray(ddq, float)
    steps = dq * h[:, None] + ddq * h[:, None] ** 2 / 2
    q = np.concatenate([[start], start + np.cumsum(steps, axis=0)])
    law = LapLaw(breaks=np.asarray(times, float), q=q, dq=dq, ddq=ddq)
    return ac.Trajectory(laws=(law,), method="hand")
