"""Redundancy resolution: a smooth null-space reference that makes the joint path unique.

If the arm has more joints than the task dimension, the rows `w(s) (q - g(s)) = 0` are added to the
equations of the tool pose. g is a spline through joint positions that were chosen for a short joint
path away from the ends of the joint ranges; the rows of w span the null space. Both are C² between
stops, so that dq_ds and d2q_ds2 are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm, _newton
from armcontour.motion import quintic

# Joint positions cost from this fraction of half the joint range on, with this weight relative to
# the length of the joint path.
INNER_RANGE = 0.7
RANGE_WEIGHT = 30.0
# A spline overshoots if it leaves a chord by more than this fraction of the largest step next to
# it, and by more than the floor [rad].
SWING = 0.1
SWING_FLOOR = 0.01
# Largest change of a joint position in one iteration of smoothing, about [rad].
LARGEST_CHANGE = 0.3
# Largest number of iterations.
ROUNDS = 25
# Smoothing ends if an iteration changes no joint position by more than this [rad].
SETTLED = 1e-4
# Added to the diagonal of an iteration's matrix, relative to its largest entry; without it the
# matrix is singular if no cost depends on a null-space motion.
DAMPING = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Guide:
    """Splines of the reference g and the null-space rows w, one per section between stops.

    Args:
        bounds: Arc lengths of the ends of the sections [m], (sections + 1,).
        splines: One spline per section; its values are g and then the rows of w.
        dof: Number of joints.
    """

    bounds: FloatArray
    splines: tuple[Any, ...]
    dof: int

    @classmethod
    def through(cls, s: FloatArray, q: FloatArray, w: FloatArray, stops: FloatArray) -> Guide:
        """The guide through given joint positions.

        Args:
            s: Arc lengths [m], (n,).
            q: Joint positions [rad], (n, dof).
            w: Bases of the null space, (n, free, dof).
            stops: Arc lengths, out of s, at which the tool stops [m].
        """
        aligned = _align_bases(w)
        values = np.concatenate([q, aligned.reshape(len(s), -1)], axis=1)
        bounds = np.concatenate([s[:1], stops, s[-1:]])
        cuts = np.searchsorted(s, bounds)
        splines = tuple(
            _interpolate(s[i : k + 1], values[i : k + 1])
            for i, k in zip(cuts[:-1], cuts[1:], strict=True)
        )
        return cls(bounds=bounds, splines=splines, dof=q.shape[1])

    def at(self, s: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """W and g with two derivatives along s, (n, 3, free, dof) and (n, 3, dof).

        Args:
            s: Arc lengths [m], (n,).
            middle: Increasing arc lengths inside the sections that `s` belong to [m], (n,); at a
                stop they tell the section before from the section after.
        """
        cuts = np.searchsorted(middle, self.bounds[1:-1])
        first, last = np.append(0, cuts), np.append(cuts, len(s))
        width = self.splines[0].c.shape[2]
        values = np.empty((len(s), 3, width))
        for k in np.flatnonzero(first < last):
            on = slice(first[k], last[k])
            for order in range(3):
                values[on, order] = self.splines[k](s[on], order)
        free = width // self.dof - 1
        return values[:, :, self.dof :].reshape(len(s), 3, free, self.dof), values[:, :, : self.dof]


def _interpolate(s: FloatArray, values: FloatArray) -> Any:
    """A C² curve through values: the cubic spline, or quintics if the cubic spline overshoots.

    The cubic spline overshoots if the tool turns much faster on a short part of the path than next
    to it. The quintics have zero second derivative at the knots, and the slopes of PCHIP there.
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

    spline = CubicSpline(s, values)
    steps, width = np.abs(np.diff(values, axis=0)), np.diff(s)
    if len(s) < 3:
        return spline
    around = steps.copy()
    around[1:] = np.maximum(around[1:], steps[:-1])
    around[:-1] = np.maximum(around[:-1], steps[1:])
    bounds = (SWING * around.max(axis=1) + SWING_FLOOR)[:, None]
    for x in (0.25, 0.5, 0.75):
        chord = values[:-1] + x * (values[1:] - values[:-1])
        if (np.abs(spline(s[:-1] + x * width) - chord) > bounds).any():
            break
    else:
        return spline
    slopes = PchipInterpolator(s, values)(s, 1)
    zero = np.zeros_like(slopes[1:])
    start, end = (values[:-1], slopes[:-1], zero), (values[1:], slopes[1:], zero)
    powers = np.arange(5, -1, -1)[:, None, None]
    c = np.moveaxis(quintic(width, start, end), 1, 0)[::-1] / width[:, None] ** powers
    return PPoly(c, s)


def null_space(arm: SerialArm, poses: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Orthonormal bases of the joint motions that do not move the tool, (n, dof - task, dof)."""
    return np.asarray(_newton.free_motions(*arm.arrays, q, poses, task))


def smooth(
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    q: FloatArray,
    *,
    start_stays: bool = False,
    rounds: int = ROUNDS,
) -> tuple[FloatArray, float]:
    """Joint positions with the same tool poses and a shorter joint path, by null-space motion.

    Gauss-Newton iterations reduce the sum of squares of the joints' steps, weighted by the joints'
    largest velocities, and of their excess over the inner part of their ranges.

    Args:
        arm: The arm.
        s: Arc lengths [m], (n,).
        poses: Rotations and positions of the tool, (n, 3, 4).
        task: Task dimension.
        q: Joint positions at the poses [rad], (n, dof).
        start_stays: Whether the first joint position is kept.
        rounds: Largest number of iterations.

    Returns:
        The joint positions, (n, dof), and their cost.
    """
    velocity = arm.limits.joint_velocity
    pace = np.ones(arm.dof) if velocity is None else np.min(velocity) / velocity
    weights = _step_weights(s, q, pace)
    cost = _cost(arm, q, pace, weights, s)
    for _ in range(rounds):
        w = null_space(arm, poses, task, q)
        change = _gauss_newton_step(arm, q, w, pace, weights, s, start_stays)
        size = float(np.abs(change).max())
        trial = q + min(1.0, LARGEST_CHANGE / max(size, 1e-12)) * change
        goal = trial.copy()
        found, _ = _newton.newton(*arm.arrays, trial, poses, task, w, goal)
        if not found.all():
            break
        trial_cost = _cost(arm, trial, pace, weights, s)
        if not trial_cost < cost:
            break
        q, cost = trial, trial_cost
        if size < SETTLED:
            break
    return q, cost


def _step_weights(s: FloatArray, q: FloatArray, pace: FloatArray) -> FloatArray:
    """Weights of the joint steps in the cost, (n - 1,).

    A step may be as long as its share of the tool path and of the initial joint path: at a tight
    corner the joints move far on a short path, which must not outweigh all other steps.

    Args:
        s: Arc lengths [m], (n,).
        q: Joint positions [rad], (n, dof).
        pace: Smallest of the joints' largest velocities over each joint's own, (dof,).
    """
    distance = np.linalg.norm(np.diff(q, axis=0) * pace, axis=1)
    share = np.diff(s) / (s[-1] - s[0])
    if distance.any():
        share = share / 2 + distance / distance.sum() / 2
    return np.asarray(1 / np.sqrt(share))


def _gauss_newton_step(
    arm: SerialArm,
    q: FloatArray,
    w: FloatArray,
    pace: FloatArray,
    weights: FloatArray,
    s: FloatArray,
    start_stays: bool,
) -> FloatArray:
    """The null-space motion that minimizes the linearized cost [rad], (n, dof).

    Args:
        arm: The arm.
        q: Joint positions [rad], (n, dof).
        w: Bases of the null space, (n, free, dof).
        pace: As in `_step_weights`, (dof,).
        weights: Weights of the joint steps, (n - 1,).
        s: Arc lengths [m], (n,).
        start_stays: Whether the first joint position is kept.
    """
    from scipy.linalg import solveh_banded

    n, free = w.shape[:2]
    excess, slope = _range_excess(arm, q, s)
    square = weights[:, None] ** 2
    # Half the gradient of the cost, and its block tridiagonal matrix.
    gradient = slope * excess
    step = square * pace**2 * np.diff(q, axis=0)
    gradient[:-1] -= step
    gradient[1:] += step
    right = -np.einsum("nik,nk->ni", w, gradient)
    weight = slope**2
    weight[:-1] += square * pace**2
    weight[1:] += square * pace**2
    own = np.einsum("nik,nk,njk->nij", w, weight, w)
    across = -np.einsum("nik,nk,njk->nij", w[:-1], square * pace**2, w[1:])
    diagonal = np.einsum("nii->ni", own)
    diagonal += DAMPING * (1 + diagonal.max())
    if start_stays:
        right[0], own[0], across[0] = 0.0, np.eye(free), 0.0
    bands = np.zeros((2 * free, n, free))
    for i in range(free):
        for j in range(i + 1):
            bands[i - j, :, j] = own[:, i, j]
        for j in range(free):
            bands[free + i - j, :-1, j] = across[:, j, i]
    found = solveh_banded(
        bands.reshape(2 * free, -1), right.ravel(), lower=True, overwrite_ab=True, overwrite_b=True
    )
    return np.asarray(np.einsum("nik,ni->nk", w, found.reshape(n, free)))


def _range_excess(arm: SerialArm, q: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted excess of the joints over the inner part of their ranges, and its derivative.

    Both have the shape of q, (n, dof).
    """
    lower, upper = arm.limits.joint_range(arm.dof)
    ranged = np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(ranged, lower, -1.0), np.where(ranged, upper, 1.0)
    half, middle = (high - low) / 2, (high + low) / 2
    share = np.where(ranged, (q - middle) / half, 0.0)
    beyond = np.sign(share) * np.maximum(np.abs(share) - INNER_RANGE, 0.0)
    weight = RANGE_WEIGHT / np.sqrt(len(s))
    return weight * beyond, np.where(beyond != 0, weight / half, 0.0)


def _cost(
    arm: SerialArm, q: FloatArray, pace: FloatArray, weights: FloatArray, s: FloatArray
) -> float:
    """Sum of squares of the weighted joint steps and of the excess over the inner ranges."""
    length = np.sum((np.diff(q, axis=0) * pace * weights[:, None]) ** 2)
    return float(length + np.sum(_range_excess(arm, q, s)[0] ** 2))


def _align_bases(w: FloatArray) -> FloatArray:
    """Bases of the same null spaces that turn as little as possible from knot to knot."""
    if w.shape[1] == 1:
        against = np.sum(w[:-1] * w[1:], axis=2) < 0
        signs = np.cumprod(np.where(against, -1.0, 1.0), axis=0)
        return np.concatenate([w[:1], signs[:, :, None] * w[1:]])
    found = w.copy()
    for k in range(1, len(w)):
        u, _, v = np.linalg.svd(found[k - 1] @ w[k].T)
        found[k] = u @ v @ w[k]
    return found
