"""Inverse kinematics of serial arms: all the ways to hold the tool in one pose."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import _newton
from armcontour.arms.serial import SerialArm

# Joint positions that the search starts from; with these every one of the eight configurations of
# a common six-joint arm is found in thousands of random poses.
SEEDS = 400
# A metre counts like this many radians in the search, and for how far out of reach a pose is.
SEARCH_WEIGHT = 0.5
REACH_WEIGHT = 10.0
MOST_STEPS = 200
# Poses nearer than this are met [m, rad].
MET = 1e-8
# Solutions farther apart than this are two [rad]; of joints to spare there are many solutions.
APART = 1e-3
APART_REDUNDANT = 0.5


def configurations(
    arm: SerialArm, pose: FloatArray, task: int, near: FloatArray | None = None
) -> FloatArray:
    """Joint positions that hold the tool in a pose; whole turns do not count as another.

    Where the arm has joints to spare, a sample of its infinitely many.

    Args:
        arm: The arm.
        pose: Rotation and position of the tool, (3, 4).
        task: 6 for all of it, 5 without turning about the tool axis, 3 for the point alone.
        near: Joint positions to start from instead of everywhere, (dof,).

    Returns:
        (k, dof), k is 0 where there are none.
    """
    q = seeds(arm) if near is None else np.array(near, dtype=np.float64).reshape(1, -1)
    left = _newton.approach(
        *arm.arrays, np.ascontiguousarray(pose), task, q, SEARCH_WEIGHT, MOST_STEPS
    )
    good = q[(left < MET).all(axis=1)]
    good = np.pi - np.mod(np.pi - good, 2 * np.pi) if near is None else good
    kept = _newton.distinct(good, APART if task == arm.dof else APART_REDUNDANT)
    return np.asarray(good[kept])


def seeds(arm: SerialArm) -> FloatArray:
    """Joint positions all over the arm's range, the same ones every time, (SEEDS, dof).

    Of a joint that can turn by a whole turn or more, in one turn.
    """
    lower, upper = arm.limits.joint_range(arm.dof)
    narrow = upper - lower < 2 * np.pi
    lower, upper = np.where(narrow, lower, -np.pi), np.where(narrow, upper, np.pi)
    random = np.random.default_rng(0)
    return lower + random.uniform(size=(SEEDS, arm.dof)) * (upper - lower)


def out_of_reach(arm: SerialArm, poses: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """How far the tool stays from each pose with its orientation kept [m], (n,).

    Args:
        arm: The arm.
        poses: (n, 3, 4).
        task: As in `configurations`.
        q: Joint positions to start from, (k, dof).
    """
    found = np.empty(len(poses))
    for i, pose in enumerate(poses):
        tried = q.copy()
        left = _newton.approach(
            *arm.arrays, np.ascontiguousarray(pose), task, tried, REACH_WEIGHT, MOST_STEPS
        )
        found[i] = left[:, 0].min()
    return found
