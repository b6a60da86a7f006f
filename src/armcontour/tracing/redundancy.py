"""What joints to spare do along a path: a smooth guide that makes the joint positions unique.

Where a path asks for less than the arm has joints, the rows `w(s) (q - g(s)) = 0` are added to
what the tool asks for. g is a spline through joint positions that were chosen for a short way, away
from the ends of the joints' ranges; w spans the motions that leave the tool as it is. Both are C²
between stops, so that dq_ds and d2q_ds2 stay exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm, _newton
from armcontour.motion import quintic

# Beyond this share of half its range a joint is drawn back, with this weight against the way.
INNER_RANGE = 0.7
RANGE_WEIGHT = 30.0
# A spline swings out where it leaves a chord by more than this share of the largest step beside it,
# and by more than the floor [rad].
SWING = 0.1
SWING_FLOOR = 0.01
# One round of smoothing moves no joint by more than about this [rad]; this many rounds at most.
LARGEST_CHANGE = 0.3
ROUNDS = 25
SETTLED = 1e-4
# What is added to the matrix of a round against its largest diagonal, where nothing draws a joint.
DAMPING = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Guide:
    """Splines of g and w over arc length, one per stretch between stops.

    Args:
        bounds: Arc lengths of the stretches' ends, (stretches + 1,).
        splines: One per stretch; its values are g and then the rows of w.
        dof: Number of joints.
    """

    bounds: FloatArray
    splines: tuple[Any, ...]
    dof: int

    @classmethod
    def through(cls, s: FloatArray, q: FloatArray, w: FloatArray, stops: FloatArray) -> Guide:
        """The guide through joint positions.

        Args:
            s: Arc lengths, (n,).
            q: Joint positions, (n, dof).
            w: Free motions, (n, free, dof).
            stops: Those of s at which the tool stops.
        """
        aligned = _align_bases(w)
        values = np.concatenate([q, aligned.reshape(len(s), -1)], axis=1)
        bounds = np.concatenate([s[:1], stops, s[-1:]])
        cuts = np.searchsorted(s, bounds)
        splines = tuple(
            _curve(s[i : k + 1], values[i : k + 1])
            for i, k in zip(cuts[:-1], cuts[1:], strict=True)
        )
        return cls(bounds=bounds, splines=splines, dof=q.shape[1])

    def at(self, s: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """W and g with two derivatives, (n, 3, free, dof) and (n, 3, dof).

        Args:
            s: Arc lengths, (n,).
            middle: Arc lengths inside the same stretches, which tell sides apart at stops, in
                increasing order, (n,).
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


def _curve(s: FloatArray, values: FloatArray) -> Any:
    """A C² curve through values: the cubic spline, or one that cannot swing out as that can.

    Where the tool turns much faster on a short stretch than beside it, the cubic spline swings out.
    Then every interval gets a quintic without curvature at its ends, whose slopes there are no
    larger than beside them.
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
    none = np.zeros_like(slopes[1:])
    begin, end = (values[:-1], slopes[:-1], none), (values[1:], slopes[1:], none)
    powers = np.arange(5, -1, -1)[:, None, None]
    c = np.moveaxis(quintic(width, begin, end), 1, 0)[::-1] / width[:, None] ** powers
    return PPoly(c, s)


def null_space(arm: SerialArm, poses: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Joint motions that leave alone what is asked of the tool, (n, dof - task, dof)."""
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
    """Joint positions at the same poses with a shorter way, inside the joints' ranges.

    The squares of the joints' steps, in times that they take at the joints' largest velocities, and
    of what they take of the outer part of their ranges, are made small together.

    Args:
        arm: The arm.
        s: Arc lengths, (n,).
        poses: (n, 3, 4).
        task: What of them, as in `configurations`.
        q: Joint positions at the poses, (n, dof).
        start_stays: Whether the first joint position is not to be moved.
        rounds: So many at most.

    Returns:
        The joint positions, (n, dof), and the cost of their way.
    """
    velocity = arm.limits.joint_velocity
    pace = np.ones(arm.dof) if velocity is None else np.min(velocity) / velocity
    # A step may be as long as its share of the path and of the way that there was: on a tight
    # corner the joints have to go far on a short path, and that must not outweigh all else.
    way = np.linalg.norm(np.diff(q, axis=0) * pace, axis=1)
    share = np.diff(s) / (s[-1] - s[0])
    if way.any():
        share = share / 2 + way / way.sum() / 2
    steps = 1 / np.sqrt(share)
    cost = _cost(arm, q, pace, steps, s)
    for _ in range(rounds):
        w = null_space(arm, poses, task, q)
        change = _change(arm, q, w, pace, steps, s, start_stays)
        size = float(np.abs(change).max())
        trial = q + min(1.0, LARGEST_CHANGE / max(size, 1e-12)) * change
        goal = trial.copy()
        found, _ = _newton.newton(*arm.arrays, trial, poses, task, w, goal)
        if not found.all():
            break
        fresh = _cost(arm, trial, pace, steps, s)
        if not fresh < cost:
            break
        q, cost = trial, fresh
        if size < SETTLED:
            break
    return q, cost


def _change(
    arm: SerialArm,
    q: FloatArray,
    w: FloatArray,
    pace: FloatArray,
    steps: FloatArray,
    s: FloatArray,
    start_stays: bool,
) -> FloatArray:
    """The step of the free motions that makes the cost least, to first order, (n, dof)."""
    from scipy.linalg import solveh_banded

    n, free = w.shape[:2]
    excess, slope = _outside(arm, q, s)
    square = steps[:, None] ** 2
    # Half the gradient of the cost, and its matrix: blocks on the diagonal and next to it.
    pull = slope * excess
    way = square * pace**2 * np.diff(q, axis=0)
    pull[:-1] -= way
    pull[1:] += way
    right = -np.einsum("nik,nk->ni", w, pull)
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


def _outside(arm: SerialArm, q: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far joints are in the outer part of their ranges, weighted, and its slope."""
    lower, upper = arm.limits.joint_range(arm.dof)
    ranged = np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(ranged, lower, -1.0), np.where(ranged, upper, 1.0)
    half, middle = (high - low) / 2, (high + low) / 2
    share = np.where(ranged, (q - middle) / half, 0.0)
    beyond = np.sign(share) * np.maximum(np.abs(share) - INNER_RANGE, 0.0)
    weight = RANGE_WEIGHT / np.sqrt(len(s))
    return weight * beyond, np.where(beyond != 0, weight / half, 0.0)


def _cost(
    arm: SerialArm, q: FloatArray, pace: FloatArray, steps: FloatArray, s: FloatArray
) -> float:
    way = np.sum((np.diff(q, axis=0) * pace * steps[:, None]) ** 2)
    return float(way + np.sum(_outside(arm, q, s)[0] ** 2))


def _align_bases(w: FloatArray) -> FloatArray:
    """The same spaces with bases that turn as little as they can from knot to knot."""
    if w.shape[1] == 1:
        against = np.sum(w[:-1] * w[1:], axis=2) < 0
        signs = np.cumprod(np.where(against, -1.0, 1.0), axis=0)
        return np.concatenate([w[:1], signs[:, :, None] * w[1:]])
    found = w.copy()
    for k in range(1, len(w)):
        u, _, v = np.linalg.svd(found[k - 1] @ w[k].T)
        found[k] = u @ v @ w[k]
    return found
