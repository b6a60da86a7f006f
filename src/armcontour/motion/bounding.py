"""Bounds of what a motion along a joint path takes of limits, at all times."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.motion._bounding import bound_motion, path_rates
from armcontour.motion.laws import PathLaw
from armcontour.motion.path_average import SmoothedLaw

# Intervals are halved so often at most. What is not below its limit then counts with its bound.
HALVINGS = 40


def largest_shares(
    law: PathLaw | SmoothedLaw, limits: FloatArray, speeds: FloatArray, allowed: float
) -> FloatArray:
    """The largest shares of limits that a law takes: of joints' limits, and of path speeds.

    A share that is at most `allowed` is proven for all times of the law, but for the rounding of
    numbers: an interval whose bound is above it is halved. A larger one is that of a place, or a
    bound.

    Args:
        law: The law.
        limits: Highest acceleration, deceleration [rad/s²] and velocity [rad/s] of every joint,
            infinite without one, (3, dof).
        speeds: Two highest path speeds on every interval of the joint path [m/s], (m, 2).
        allowed: The share that is to be proven.

    Returns:
        Of acceleration, deceleration, velocity and both path speeds, (5,).
    """
    i = np.arange(len(law.breaks) - 1)
    begin, end = law.breaks[:-1], law.breaks[1:]
    largest = np.zeros(5)
    for _ in range(HALVINGS):
        middle = (begin + end) / 2
        shares = _shares(law, i, (begin, middle, end), limits, speeds)
        here, bound = shares[:, :5], shares[:, 5:]
        largest = np.maximum(largest, here.max(axis=0))
        unknown = ((bound > allowed) & (here <= allowed)).any(axis=1)
        if not unknown.any():
            break
        highest = np.maximum(largest, bound[unknown].max(axis=0))
        i = np.tile(i[unknown], 2)
        begin = np.concatenate([begin[unknown], middle[unknown]])
        end = np.concatenate([middle[unknown], end[unknown]])
    else:
        return np.asarray(highest)
    return np.asarray(largest)


def _shares(
    law: PathLaw | SmoothedLaw,
    i: IntArray,
    t: tuple[FloatArray, FloatArray, FloatArray],
    limits: FloatArray,
    speeds: FloatArray,
) -> FloatArray:
    """What `bound_motion` gives of intervals `i`, from begin, middle and end of a part of each."""
    base, windows = (law.law, law.windows) if isinstance(law, SmoothedLaw) else (law, (0.0, 0.0))
    path, (begin, middle, end) = law.joint_path, t
    half = np.maximum(middle - begin, end - middle)
    s, ds, dds, _ = law.path_motion(i, middle)
    more = path_rates(middle, half, base.breaks, base.rates, windows)
    along = np.concatenate([np.stack([s, ds, dds], axis=1), more], axis=1)
    # No break of the joint path lies within an interval of a law.
    first = path.locate(law.s[i], side="right")
    piece = np.clip(path.locate(s), first, path.locate(law.s[i + 1], side="left"))
    own = path.breaks, path.coefficients
    return np.asarray(bound_motion(half, along, piece, *own, limits, speeds))
