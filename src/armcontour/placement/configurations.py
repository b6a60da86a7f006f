"""All configurations of a pose, found sooner for arms of which their largest number is known."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm, _newton
from armcontour.arms.inverse import (
    APART,
    MET,
    MOST_STEPS,
    SEARCH_WEIGHT,
    configurations,
    seeds,
)
from armcontour.arms.serial import Arrays

# The largest number of configurations of an arm with a wrist (Pieper, 1968), or with three parallel
# axes before two that meet, as the arms of Universal Robots have them.
MOST = 8
# So many seeds are tried at a time.
AT_ONCE = 40
# Near a singularity one configuration may count as two. They are different ones for sure if they
# are so far apart [rad].
FAR_APART = 0.05
# Axes meet or are parallel within this [m, rad].
EXACT = 1e-9


class Configurations:
    """Finds all configurations of poses, as `configurations` does.

    For arms that have no more than 8 of them the search ends when there are 8.

    Args:
        arm: The arm, which may stand anywhere.
        task: Task dimension, as in `configurations`.
    """

    def __init__(self, arm: SerialArm, task: int) -> None:
        self.task = task
        self._seeds = seeds(arm) if task == 6 and has_most_eight(arm) else None

    def find(self, arm: SerialArm, pose: FloatArray, near: FloatArray | None) -> FloatArray:
        """All joint positions that put the tool in a pose [rad], (k, dof).

        Args:
            arm: The arm in another place.
            pose: Rotation and position of the tool, (3, 4).
            near: As in `configurations`.
        """
        if near is not None or self._seeds is None:
            return configurations(arm, pose, self.task, near)
        found = np.empty((0, arm.dof))
        for first in range(0, len(self._seeds), AT_ONCE):
            q = self._seeds[first : first + AT_ONCE].copy()
            residuals = _newton.approach(*arm.arrays, pose, self.task, q, SEARCH_WEIGHT, MOST_STEPS)
            solutions = q[(residuals < MET).all(axis=1)]
            solutions = np.pi - np.mod(np.pi - solutions, 2 * np.pi)
            found = np.concatenate([found, solutions])
            found = found[_newton.distinct(found, APART)]
            if len(found) == MOST and len(_newton.distinct(found, FAR_APART)) == MOST:
                break
        return found


def has_most_eight(arm: SerialArm) -> bool:
    """Whether an arm surely has no more than 8 configurations of any pose.

    Args:
        arm: The arm.
    """
    if arm.dof != 6:
        return False
    points, axes = _lines(arm.arrays)
    wrist = _meeting(points[3:5], axes[3:5]), _meeting(points[4:6], axes[4:6])
    if wrist[1] is None:
        return False
    if wrist[0] is not None and np.abs(wrist[0] - wrist[1]).max() < EXACT:
        return True
    parallel = [np.linalg.norm(np.cross(axes[k], axes[k + 1])) < EXACT for k in range(1, 3)]
    return all(parallel)


def _lines(arrays: Arrays) -> tuple[FloatArray, FloatArray]:
    """Points on the axes and their directions, where all joints are at 0, (dof, 3) each."""
    rotations, positions, own, _, _ = arrays
    turned, point = np.eye(3), np.zeros(3)
    points, axes = [], []
    for rotation, position, axis in zip(rotations, positions, own, strict=True):
        point = point + turned @ position
        turned = turned @ rotation
        points.append(point)
        axes.append(turned @ axis)
    return np.array(points), np.array(axes)


def _meeting(points: FloatArray, axes: FloatArray) -> FloatArray | None:
    """The point at which two lines meet [m], (3,); None if they do not, or are parallel."""
    across = np.cross(axes[0], axes[1])
    size = float(across @ across)
    gap = points[1] - points[0]
    if size < EXACT or abs(float(gap @ across)) > EXACT * np.sqrt(size):
        return None
    along = float(np.cross(gap, axes[1]) @ across) / size
    return np.asarray(points[0] + along * axes[0])
