"""Smoothing of the joint paths of a redundant arm by null-space motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.pchip import interpolate_monotone
from armcontour.core.quintics import solve_banded
from armcontour.planning.tracing.guide import Guide
from armcontour.planning.tracing.path_samples import PathSamples
from armcontour.planning.tracing.posture_cost import PostureCost
from armcontour.planning.tracing.stations import Stations
from armcontour.robot import SerialArm, pose_solver

# Largest change of a joint position at which smoothing ends [rad].
SETTLED = 1e-4
# Largest number of iterations of smoothing.
MAX_SMOOTHINGS = 25
# Largest change of a joint position that brings an interpolated position back to the tool pose
# [rad]; a larger one may end in another configuration.
LARGEST_CORRECTION = 0.5


def null_space(arm: SerialArm, poses: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Return orthonormal bases of joint motions at fixed tool poses, (n, dof - task, dof)."""
    return np.asarray(pose_solver.free_motions(arm.link_table, task, q, poses))


def guide_rows(arm: SerialArm, w: FloatArray) -> FloatArray:
    """Return rows that keep a null-space position while a heavy joint moves less, as `w`.

    The rows are an orthonormal basis of those of `w M`, with the squared joint weights on the
    diagonal of M: a correction dq with `w M dq = 0` has the smallest weighted norm.

    - `w`: null-space bases, (n, free, dof).
    """
    weights = np.asarray(arm.chain.weights)
    if (weights == weights[0]).all():
        return w
    columns = np.swapaxes(w * weights**2, 1, 2)
    return np.ascontiguousarray(np.swapaxes(np.linalg.qr(columns)[0], 1, 2))


def guide_at_stations(samples: PathSamples, arm: SerialArm, task: int, q: FloatArray) -> Guide:
    """Make the guide through joint positions at the stations among the knots of a path.

    - `q`: joint positions at the knots [rad], (n + 1, dof).
    """
    index = samples.stations.index
    rows = null_space(arm, np.ascontiguousarray(samples.poses[index]), task, q[index])
    return Guide.through(samples.s[index], q[index], rows, samples.path.stops)


def move_to_poses(
    arm: SerialArm, poses: FloatArray, task: int, q: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Move joint positions to the nearest ones at which the tool has its poses.

    Returns the joint positions [rad], (paths, n, dof), and whether all poses of a path are met
    without a jump to another configuration, (paths,).

    - `poses`: rotations and positions of the tool, (n, 3, 4).
    - `q`: joint positions near the poses [rad], (paths, n, dof).
    """
    paths, n, dof = q.shape
    targets = np.tile(poses, (paths, 1, 1))
    guesses = q.reshape(-1, dof)
    w = null_space(arm, targets, task, guesses)
    moved = np.empty_like(q)
    fits = np.zeros(paths, dtype=np.bool_)
    # Where the arm alone does not reach the poses, a heavy joint must move as well.
    for rows in (guide_rows(arm, w), w):
        tried = guesses.copy()
        solved = pose_solver.solve_poses(
            arm.link_table, task, tried, targets, rows[:, None].copy(), guesses[:, None].copy()
        )
        near = np.abs(tried - guesses).max(axis=1) < LARGEST_CORRECTION
        better = (solved & near).reshape(paths, n).all(axis=1) & ~fits
        moved[better] = tried.reshape(q.shape)[better]
        fits |= better
        if fits.all():
            break
    return moved, fits


def smooth_in_levels(
    arm: SerialArm,
    s: FloatArray,  # Arc lengths of the stations [m], (n,)
    poses: FloatArray,  # Rotations and positions of the tool at the stations, (n, 3, 4)
    task: int,
    # Joint positions at the stations, one path per configuration [rad], (paths, n, dof)
    q: FloatArray,
    stations: Stations,
    *,
    start_stays: bool = False,  # True if the first joint position is fixed
) -> tuple[FloatArray, FloatArray]:
    """Smooth joint paths with few stations first, as `smooth`; returns the same values.

    A level with few stations moves the whole path in few iterations. Its changes are interpolated
    between its stations. An arm without external axes has little room to move, and only has the
    last level.
    """
    *coarse, every = stations.levels()
    if not arm.chain.external:
        coarse = []
    place = stations.place
    for level in coarse:
        smoothed, _ = smooth(
            arm, s[level], poses[level], task, q[:, level], start_stays=start_stays
        )
        changed, fits = move_to_poses(
            arm, poses, task, interpolate_paths(place[level], smoothed, place)
        )
        q = np.where(fits[:, None, None], changed, q)
    return smooth(arm, s[every], poses[every], task, q, start_stays=start_stays)


def interpolate_paths(x: FloatArray, q: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate joint paths, (paths, n, dof), at places `x`, (n,), by PCHIP at others, (k,)."""
    return np.swapaxes(interpolate_monotone(x, np.swapaxes(q, 0, 1), at), 0, 1)


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
    return reduce_cost(arm, poses, task, q, cost, rounds, guide_rows, start_stays=start_stays)


class JointPathCost(Protocol):
    """Cost of joint paths that null-space motion reduces."""

    @property
    def shares(self) -> tuple[float, ...]:
        """Fractions of a step that are tried."""

    @property
    def largest_change(self) -> float:
        """Approximate largest change of a joint position in one iteration [rad]."""

    def values(self, q: FloatArray) -> FloatArray:
        """Return the cost, (paths,), of joint paths with positions q [rad], (paths, n, dof)."""

    def equations(self, q: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the equations of the step of least linearized cost, as `PostureCost`."""

    def select(self, mask: BoolArray, /) -> JointPathCost:
        """Return the cost of the masked joint paths, (paths,)."""


def reduce_cost(
    arm: SerialArm,
    poses: FloatArray,
    task: int,
    q: FloatArray,
    cost: JointPathCost,
    rounds: int,
    rows_of: Callable[[SerialArm, FloatArray], FloatArray],
    *,
    start_stays: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Reduce a cost of joint paths by Gauss-Newton iterations, with unchanged tool poses.

    Returns the joint positions [rad], (paths, n, dof), and their costs, (paths,).

    - `rows_of`: returns the rows that keep a null-space position, as `guide_rows`.
    - other arguments: as of `smooth`.
    """
    n = len(poses)
    free = arm.dof - task
    smoothed = q.copy()
    costs = cost.values(q)
    active = np.arange(len(q))
    for _ in range(rounds):
        q = smoothed[active]
        count = len(active)
        targets = np.tile(poses, (count, 1, 1))
        w = null_space(arm, targets, task, q.reshape(-1, arm.dof)).reshape(count, n, free, arm.dof)
        kept = rows_of(arm, w.reshape(-1, free, arm.dof))
        bands, right = cost.equations(q, w)
        if start_stays:
            right[:, :free] = 0.0
            bands[:, :free] = np.eye(1, 2 * free)
        solve_banded(bands.reshape(-1, 2 * free), right.reshape(-1, 1))
        change = (right.reshape(count, n, 1, free) @ w)[:, :, 0]
        size = np.abs(change).max(axis=(1, 2))
        change *= np.minimum(1.0, cost.largest_change / np.maximum(size, 1e-12))[:, None, None]
        better = np.zeros(count, dtype=np.bool_)
        for share in cost.shares:
            trial = q + share * change
            rows = kept.reshape(-1, 1, free, arm.dof)
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
