"""Smoothing of the joint paths of a redundant arm by null-space motion."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.quintics import solve_banded
from armcontour.planning.tracing.posture_cost import PostureCost
from armcontour.robot import SerialArm, pose_solver

# Approximate largest change of a joint position in one iteration of smoothing [rad].
LARGEST_CHANGE = 0.3
# Largest change of a joint position at which smoothing ends [rad].
SETTLED = 1e-4
# Largest number of iterations of smoothing.
MAX_SMOOTHINGS = 25


def null_space(arm: SerialArm, poses: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Return orthonormal bases of joint motions at fixed tool poses, (n, dof - task, dof)."""
    return np.asarray(pose_solver.free_motions(arm.link_table, task, q, poses))


def smooth(
    arm: SerialArm,
    s: FloatArray,  # Arc lengths [m], (n,)
    poses: FloatArray,  # Rotations and positions of the tool, (n, 3, 4)
    task: int,
    # Joint positions at the poses, one path per configuration [rad], (paths, n, dof)
    q: FloatArray,
    *,
    start_stays: bool = False,  # True if the first joint position is fixed
    rounds: int = MAX_SMOOTHINGS,
    # Largest angle between tool axis and required axis, for a task without the axis [rad]
    cone: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Shorten joint paths by null-space motion, with unchanged tool poses.

    Gauss-Newton iterations reduce `PostureCost`: the sum of squares of the joint steps, weighted by
    the largest joint velocities, of the distances of joint positions outside the inner part of
    their ranges, and of the angle between tool axis and gravity outside that of its range.

    Returns the joint positions [rad], (paths, n, dof), and their costs, (paths,).
    """
    cost = PostureCost(arm, s, q, poses[:, :, 2], cone)
    n = len(s)
    free = arm.dof - task
    smoothed = q.copy()
    costs = cost.values(q)
    active = np.arange(len(q))
    for _ in range(rounds):
        q = smoothed[active]
        count = len(active)
        targets = np.tile(poses, (count, 1, 1))
        w = null_space(arm, targets, task, q.reshape(-1, arm.dof)).reshape(count, n, free, arm.dof)
        bands, right = cost.equations(q, w)
        if start_stays:
            right[:, :free] = 0.0
            bands[:, :free] = np.eye(1, 2 * free)
        solve_banded(bands.reshape(-1, 2 * free), right.reshape(-1, 1))
        change = (right.reshape(count, n, 1, free) @ w)[:, :, 0]
        size = np.abs(change).max(axis=(1, 2))
        change *= np.minimum(1.0, LARGEST_CHANGE / np.maximum(size, 1e-12))[:, None, None]
        better = np.zeros(count, dtype=np.bool_)
        for share in cost.shares:
            trial = q + share * change
            rows = w.reshape(-1, 1, free, arm.dof)
            goals = trial.reshape(-1, 1, arm.dof).copy()
            # The solver moves the trial, in place, until the tool has its poses again.
            positions = trial.reshape(-1, arm.dof)
            solved = pose_solver.solve_poses(arm.link_table, task, positions, targets, rows, goals)
            is_solved = solved.reshape(count, n).all(axis=1)
            trial_costs = cost.values(trial)
            improved = is_solved & (trial_costs < costs[active]) & ~better
            smoothed[active[improved]] = trial[improved]
            costs[active[improved]] = trial_costs[improved]
            better |= improved
            if better.all():
                break
        better &= size >= SETTLED
        active = active[better]
        if not len(active):
            break
        cost = cost.select(better)
    return smoothed, costs
