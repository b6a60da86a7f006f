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

from armcontour._checks import FloatArray, IntArray
from armcontour.arms import SerialArm, _newton

# Beyond this share of half its range a joint is drawn back, with this weight against the way.
INNER_RANGE = 0.7
RANGE_WEIGHT = 30.0
# One round of smoothing moves no joint by more than about this [rad]; this many rounds at most.
LARGEST_CHANGE = 0.3
ROUNDS = 25
SETTLED = 1e-4


@dataclass(frozen=True, slots=True)
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
        from scipy.interpolate import CubicSpline

        aligned = _aligned(w)
        values = np.concatenate([q, aligned.reshape(len(s), -1)], axis=1)
        bounds = np.concatenate([s[:1], stops, s[-1:]])
        cuts = np.searchsorted(s, bounds)
        splines = tuple(
            CubicSpline(s[i : k + 1], values[i : k + 1])
            for i, k in zip(cuts[:-1], cuts[1:], strict=True)
        )
        return cls(bounds, splines, q.shape[1])

    def at(self, s: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """W and g with two derivatives, (n, 3, free, dof) and (n, 3, dof).

        Args:
            s: Arc lengths, (n,).
            middle: Arc lengths inside the same stretches, which tell sides apart at stops, (n,).
        """
        which: IntArray = np.clip(
            np.searchsorted(self.bounds, middle, side="right") - 1, 0, len(self.splines) - 1
        )
        width = self.splines[0].c.shape[2]
        values = np.empty((len(s), 3, width))
        for k in np.unique(which):
            on = which == k
            for order in range(3):
                values[on, order] = self.splines[k](s[on], order)
        free = width // self.dof - 1
        return values[:, :, self.dof :].reshape(len(s), 3, free, self.dof), values[:, :, : self.dof]


def free_motions(arm: SerialArm, poses: FloatArray, asked: int, q: FloatArray) -> FloatArray:
    """Joint motions that leave alone what is asked of the tool, (n, dof - asked, dof)."""
    rows = arm.twist_jacobian(q)[:, :3]
    turning = arm.twist_jacobian(q)[:, 3:]
    if asked == 6:
        rows = np.concatenate([rows, turning], axis=1)
    elif asked == 5:
        rows = np.concatenate([rows, np.swapaxes(poses[:, :, :2], 1, 2) @ turning], axis=1)
    return np.asarray(np.linalg.svd(rows)[2][:, asked:])


def smoothed(
    arm: SerialArm, s: FloatArray, poses: FloatArray, asked: int, q: FloatArray
) -> tuple[FloatArray, float]:
    """Joint positions at the same poses with a shorter way, inside the joints' ranges.

    The squares of the joints' steps, in times that they take at the joints' largest velocities, and
    of what they take of the outer part of their ranges, are made small together.

    Args:
        arm: The arm.
        s: Arc lengths, (n,).
        poses: (n, 3, 4).
        asked: What of them, as in `configurations`.
        q: Joint positions at the poses, (n, dof).

    Returns:
        The joint positions, (n, dof), and the cost of their way.
    """
    velocity = arm.limits.joint_velocity
    pace = np.ones(arm.dof) if velocity is None else np.min(velocity) / velocity
    steps = np.sqrt((s[-1] - s[0]) / np.diff(s))
    cost = np.inf
    for _ in range(ROUNDS):
        w = free_motions(arm, poses, asked, q)
        change = _change(arm, q, w, pace, steps, s)
        size = float(np.abs(change).max())
        trial = q + min(1.0, LARGEST_CHANGE / max(size, 1e-12)) * change
        goal = trial.copy()
        found, _ = _newton.newton(*arm.arrays, trial, poses, asked, w, goal)
        if not found.all():
            break
        fresh = _cost(arm, trial, pace, steps, s)
        if not fresh < cost:
            break
        q, cost = trial, fresh
        if size < SETTLED:
            break
    return q, cost if np.isfinite(cost) else _cost(arm, q, pace, steps, s)


def _change(
    arm: SerialArm,
    q: FloatArray,
    w: FloatArray,
    pace: FloatArray,
    steps: FloatArray,
    s: FloatArray,
) -> FloatArray:
    """The step of the free motions that makes the cost least, to first order, (n, dof)."""
    from scipy.sparse import block_diag, csc_matrix, diags, eye, identity, kron
    from scipy.sparse.linalg import spsolve

    n, dof = q.shape
    free = w.shape[1]
    along = block_diag(list(np.swapaxes(w, 1, 2)), format="csc")  # (n dof, n free)
    ahead = eye(n - 1, n, k=1) - eye(n - 1, n)
    way = kron(diags(steps) @ ahead, diags(pace), format="csc")
    excess, slope = _outside(arm, q, s)
    bound = diags(slope.ravel())
    rows = csc_matrix(way @ along), csc_matrix(bound @ along)
    right = way @ q.ravel(), excess.ravel()
    normal = rows[0].T @ rows[0] + rows[1].T @ rows[1]
    normal = normal + 1e-6 * (1 + normal.diagonal().max()) * identity(n * free, format="csc")
    found = spsolve(csc_matrix(normal), -(rows[0].T @ right[0] + rows[1].T @ right[1]))
    return np.asarray((along @ found).reshape(n, dof))


def _outside(arm: SerialArm, q: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far joints are in the outer part of their ranges, weighted, and its slope."""
    lower, upper = arm.limits.joint_range(arm.dof)
    ranged = np.isfinite(lower) & np.isfinite(upper)
    half = np.where(ranged, (upper - lower) / 2, 1.0)
    middle = np.where(ranged, (upper + lower) / 2, 0.0)
    share = np.where(ranged, (q - middle) / half, 0.0)
    beyond = np.sign(share) * np.maximum(np.abs(share) - INNER_RANGE, 0.0)
    weight = RANGE_WEIGHT / np.sqrt(len(s))
    return weight * beyond, np.where(beyond != 0, weight / half, 0.0)


def _cost(
    arm: SerialArm, q: FloatArray, pace: FloatArray, steps: FloatArray, s: FloatArray
) -> float:
    way = np.sum((np.diff(q, axis=0) * pace * steps[:, None]) ** 2)
    return float(way + np.sum(_outside(arm, q, s)[0] ** 2))


def _aligned(w: FloatArray) -> FloatArray:
    """The same spaces with bases that turn as little as they can from knot to knot."""
    found = w.copy()
    for k in range(1, len(w)):
        u, _, v = np.linalg.svd(found[k - 1] @ w[k].T)
        found[k] = u @ v @ w[k]
    return found
