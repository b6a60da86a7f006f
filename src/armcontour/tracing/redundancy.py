"""Redundancy resolution: a smooth null-space reference that makes the joint path unique.

If the arm has more joints than the task dimension, the rows `w(s) (q - g(s)) = 0` are added to the
equations of the tool pose. g is a spline through joint positions that were chosen for a short joint
path away from the ends of the joint ranges; the rows of w span the null space. Both are C² between
stops, so that dq_ds and d2q_ds2 are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm, _newton
from armcontour.motion import quintic
from armcontour.tracing import _guide, _smoothing

# Largest number of iterations of smoothing.
ROUNDS = 25


@dataclass(frozen=True, slots=True, kw_only=True)
class Guide:
    """Splines of the reference g and the null-space rows w, one per section between stops.

    Args:
        s: Arc lengths of the knots [m], (n,).
        coefficients: Coefficients of powers of the distance from the knot before, from 1 to u⁵, of
            g and then of the rows of w, (n - 1, 6, values).
        dof: Number of joints.
    """

    s: FloatArray
    coefficients: FloatArray
    dof: int

    @classmethod
    def through(cls, s: FloatArray, q: FloatArray, w: FloatArray, stops: FloatArray) -> Guide:
        """The guide through given joint positions.

        The splines are cubic, or quintics where a cubic spline overshoots: it does if the tool
        turns much faster on a short part of the path than next to it.

        Args:
            s: Arc lengths [m], (n,).
            q: Joint positions [rad], (n, dof).
            w: Bases of the null space, (n, free, dof).
            stops: Arc lengths, out of s, at which the tool stops [m].
        """
        values = _guide.turn_bases(w, _turns(w), q)
        cuts = np.concatenate([[0], np.searchsorted(s, stops), [len(s) - 1]])
        coefficients, swings = _guide.fit_splines(s, values, cuts)
        for k in np.flatnonzero(swings):
            i, last = cuts[k], cuts[k + 1]
            coefficients[i:last] = _without_swing(s[i : last + 1], values[i : last + 1])
        return cls(s=s, coefficients=coefficients, dof=q.shape[1])

    def at(self, s: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """W and g with two derivatives along s, (n, 3, free, dof) and (n, 3, dof).

        Args:
            s: Arc lengths [m], (n,).
            middle: Arc lengths inside the intervals that `s` belong to [m], (n,); at a knot they
                tell the interval before from the interval after.
        """
        at = np.searchsorted(self.s, middle) - 1
        found: tuple[FloatArray, FloatArray] = _guide.guide_at(
            self.coefficients, at, s - self.s[at], self.dof
        )
        return found


def _turns(w: FloatArray) -> FloatArray:
    """How bases turn as little as possible from knot to knot, (n - 1, free, free).

    Args:
        w: Bases of the null space, (n, free, dof).
    """
    along = np.einsum("nik,njk->nij", w[:-1], w[1:])
    if w.shape[1] == 1:
        return np.where(along < 0, -1.0, 1.0)
    u, _, v = np.linalg.svd(along)
    return np.asarray(u @ v)


def _without_swing(s: FloatArray, values: FloatArray) -> FloatArray:
    """Quintics through values with no second derivative at the knots, and with PCHIP's slopes.

    Args:
        s: The knots [m], (n,).
        values: The values, (n, values).

    Returns:
        Coefficients of powers of the distance from the knot before, (n - 1, 6, values).
    """
    from scipy.interpolate import PchipInterpolator

    slopes, width = PchipInterpolator(s, values)(s, 1), np.diff(s)
    zero = np.zeros_like(slopes[1:])
    start, end = (values[:-1], slopes[:-1], zero), (values[1:], slopes[1:], zero)
    return np.asarray(quintic(width, start, end) / width[:, None, None] ** np.arange(6)[:, None])


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
    found: tuple[FloatArray, float] = _smoothing.smooth(
        *arm.arrays, *arm.limits.joint_range(arm.dof), pace, s, poses, task, q, start_stays, rounds
    )
    return found
