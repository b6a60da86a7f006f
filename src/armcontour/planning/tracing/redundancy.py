"""Redundancy resolution: a smooth null-space reference that makes the joint path unique.

If the arm has more joints than the task dimension, the rows `w(s) (q - g(s)) = 0` are added to the
equations of the tool pose. g is a spline through joint positions of a short joint path away from
the ends of the joint ranges; the rows of w span the null space. Both are C² between stops, so that
dq_ds and d2q_ds2 are exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.quintics import solve_banded
from armcontour.motion import quintic
from armcontour.planning.tracing.positioner_tilt import INNER_TILT, chord_of, tilt_of, turn_down
from armcontour.robot import SerialArm, pose_solver

# Largest deviation of a spline from a chord, as a fraction of the largest neighbouring step, in
# addition to SWING_FLOOR.
SWING = 0.1
# Deviation of a spline from a chord that is always allowed [rad].
SWING_FLOOR = 0.01
# Fractions of an interval at which this deviation is computed, (3, 1, 1).
QUARTERS = np.array([0.25, 0.5, 0.75])[:, None, None]
# Joint positions beyond this fraction of half the range, from its middle, have a cost.
INNER_RANGE = 0.7
# Weight of this cost relative to the length of the joint path.
RANGE_WEIGHT = 30.0
# Approximate largest change of a joint position in one iteration of smoothing [rad].
LARGEST_CHANGE = 0.3
# Largest change of a joint position at which smoothing ends [rad].
SETTLED = 1e-4
# Regularization of the diagonal of an iteration's matrix, relative to its largest entry; the matrix
# is singular if no cost depends on a null-space motion.
SMOOTHING_DAMPING = 1e-6
# Fractions of a step that are tried with costs that are not quadratic.
SHARES = (1.0, 0.3, 0.1, 0.03)
# Smallest singular value of the Jacobian of an arm with external axes, with lengths relative to
# those of the arm, below which a posture has a cost.
NEARLY_SINGULAR = 0.04
# Largest number of iterations of smoothing.
MAX_SMOOTHINGS = 25


@dataclass(frozen=True, slots=True, kw_only=True)
class Guide:
    """Splines of the reference g and the null-space rows w, one per section between stops."""

    s: FloatArray  # Arc lengths of the knots [m], (n,)
    # Coefficients of g and then of the rows of w in powers of the distance from the previous knot,
    # from 1 to u⁵, (n - 1, 6, values)
    coefficients: FloatArray
    dof: int

    @classmethod
    def through(cls, s: FloatArray, q: FloatArray, w: FloatArray, stops: FloatArray) -> Guide:
        """Make the guide through given joint positions.

        The splines are cubic, or quintics where a cubic spline overshoots because the tool turns
        much faster on a short part of the path than next to it.

        - `s`: arc lengths [m], (n,).
        - `q`: joint positions [rad], (n, dof).
        - `w`: bases of the null space, (n, free, dof).
        - `stops`: those arc lengths in `s` at which the tool stops [m].
        """
        n, free, dof = w.shape
        turned = [np.eye(free)]
        for turn in _basis_rotations(w):
            turned.append(turned[-1] @ turn)
        values = np.concatenate([q, (np.array(turned) @ w).reshape(n, free * dof)], axis=1)
        cuts = [0, *np.searchsorted(s, stops).tolist(), n - 1]
        # Sections of one interval are lines.
        coefficients = np.zeros((n - 1, 6, values.shape[1]))
        coefficients[:, 0] = values[:-1]
        coefficients[:, 1] = np.diff(values, axis=0) / np.diff(s)[:, None]
        for i, last in zip(cuts[:-1], cuts[1:], strict=True):
            if last > i + 1:
                coefficients[i:last] = _spline(s[i : last + 1], values[i : last + 1])
        return cls(s=s, coefficients=coefficients, dof=dof)

    def evaluate(self, s: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return w and g with two derivatives along s, (n, 3, free, dof) and (n, 3, dof).

        - `s`: arc lengths [m], (n,).
        - `middle`: arc lengths inside the intervals that `s` belong to [m], (n,); at a knot they
          select the interval.
        """
        interval = np.searchsorted(self.s, middle) - 1
        k = np.arange(6)
        x = (s - self.s[interval])[:, None]
        one = k * x ** np.maximum(k - 1, 0)
        two = k * (k - 1) * x ** np.maximum(k - 2, 0)
        values = np.stack([x**k, one, two], axis=1) @ self.coefficients[interval]
        g, w = (np.ascontiguousarray(x) for x in np.split(values, [self.dof], axis=2))
        return w.reshape(len(s), 3, -1, self.dof), g


def _basis_rotations(w: FloatArray) -> FloatArray:
    """Return the smallest rotations between neighbouring null-space bases, (n - 1, free, free)."""
    along = np.einsum("nik,njk->nij", w[:-1], w[1:])
    if w.shape[1] == 1:
        return np.where(along < 0, -1.0, 1.0)
    u, _, v = np.linalg.svd(along)
    return np.asarray(u @ v)


def _spline(s: FloatArray, values: FloatArray) -> FloatArray:
    """Return coefficients of a cubic spline, or quintics if it overshoots, (n - 1, 6, values)."""
    width = np.diff(s)[:, None]
    steps = np.diff(values, axis=0)
    slopes = _slopes(s, values)
    chord = steps / width
    curvature = (slopes[:-1] + slopes[1:] - 2 * chord) / width
    c = np.zeros((len(steps), 6, values.shape[1]))
    c[:, 0] = values[:-1]
    c[:, 1] = slopes[:-1]
    c[:, 3] = curvature / width
    c[:, 2] = (chord - slopes[:-1]) / width - curvature
    largest = np.pad(np.abs(steps).max(axis=1), 1)
    largest = np.maximum(np.maximum(largest[:-2], largest[2:]), largest[1:-1])
    u = QUARTERS * width
    deviation = np.abs(u * (c[:, 1] + u * (c[:, 2] + u * c[:, 3])) - QUARTERS * steps).max(
        axis=(0, 2)
    )
    return _pchip_quintics(s, values) if (deviation > SWING * largest + SWING_FLOOR).any() else c


def _slopes(s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the slopes of the cubic spline through values at its knots, (n, values)."""
    # The third derivative is continuous at the second and last but one knot ("not a knot"). Through
    # three points the spline is a parabola.
    h = np.diff(s)[:, None]
    chord = np.diff(values, axis=0) / h
    first = h[0] + h[1]
    last = h[-1] + h[-2]
    if len(s) == 3:
        curvature = (chord[1] - chord[0]) / first
        return np.stack(
            [chord[0] - curvature * h[0], chord[0] + curvature * h[0], chord[1] + curvature * h[1]]
        )
    # Rows are scaled so that the matrix is symmetric.
    bands = np.zeros((len(s), 2))
    right = np.empty_like(values)
    bands[1:-1, 0] = 2 / h[:-1, 0] + 2 / h[1:, 0]
    bands[[0, -1], 0] = np.concatenate([h[1] / (first * h[0]), h[-2] / (last * h[-1])])
    bands[:-1, 1] = 1 / h[:, 0]
    right[1:-1] = 3 * (chord[:-1] / h[:-1] + chord[1:] / h[1:])
    right[0] = ((1 / first + 2 / h[0]) * h[1] * chord[0] + h[0] / first * chord[1]) / first
    right[-1] = (h[-1] / last * chord[-2] + (2 / h[-1] + 1 / last) * h[-2] * chord[-1]) / last
    solve_banded(bands, right)
    return right


def _pchip_quintics(s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the quintics through values, with PCHIP slopes and no second derivative at knots."""
    # Returns coefficients of powers of the distance from the previous knot, (n - 1, 6, values).
    from scipy.interpolate import PchipInterpolator

    slopes = PchipInterpolator(s, values)(s, 1)
    width = np.diff(s)
    zero = np.zeros_like(slopes[1:])
    start = (values[:-1], slopes[:-1], zero)
    end = (values[1:], slopes[1:], zero)
    return np.asarray(quintic(width, start, end) / width[:, None, None] ** np.arange(6)[:, None])


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
) -> tuple[FloatArray, FloatArray]:
    """Shorten joint paths by null-space motion, with unchanged tool poses.

    Gauss-Newton iterations reduce `_Cost`: the sum of squares of the joint steps, weighted by the
    largest joint velocities, of the distances of joint positions outside the inner part of their
    ranges, and of the angle between tool axis and gravity outside that of its range.

    Returns the joint positions [rad], (paths, n, dof), and their costs, (paths,).
    """
    cost = _Cost(arm, s, q, poses[:, :, 2])
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


class _Cost:
    """Cost of a joint path: squares of weighted joint steps, and of excesses over inner ranges."""

    # The weight of a step decreases with its fraction of the tool path and of the initial joint
    # path, because at a tight corner the joints move far on a short path, which must not outweigh
    # all other steps.

    def __init__(self, arm: SerialArm, s: FloatArray, q: FloatArray, axes: FloatArray) -> None:
        # `s`: arc lengths [m], (n,); `q`: joint positions in several configurations [rad], (paths,
        # n, dof); `axes`: tool axes, (n, 3).
        lower, upper = arm.limits.joint_range(arm.dof)
        both = np.isfinite(lower) & np.isfinite(upper)
        low = np.where(both, lower, 0.0)
        high = np.where(both, upper, 0.0)
        self.middle = (high + low) / 2
        self.half = np.where(both, (high - low) / 2, np.inf)
        self.outside = RANGE_WEIGHT / np.sqrt(len(s))
        self.arm = arm
        self.axes = axes
        tilt = tilt_of(arm.chain)
        self.chord = None if tilt is None else chord_of(tilt)
        # Joints of the arm on its external axes, which stay away from singularities; only six or
        # more joints can.
        arm_joints = np.setdiff1d(np.arange(arm.dof), arm.chain.external)
        stays_away = len(arm.chain.external) and len(arm_joints) >= 6
        self.arm_joints = arm_joints if stays_away else arm_joints[:0]
        # Fractions of a step that are tried. A step may leave the inner range of the tilt, whose
        # cost the linearized cost does not include.
        self.shares = (1.0,) if tilt is None and not len(self.arm_joints) else SHARES
        pace = np.ones(arm.dof)
        if arm.limits.joint_velocity is not None:
            slowest = np.minimum(*np.abs(arm.limits.velocity_bounds(arm.dof)))
            # A joint without a limit counts as the fastest one.
            slowest = np.minimum(slowest, slowest[np.isfinite(slowest)].max())
            pace = np.min(slowest) / slowest
        # A joint with a larger weight moves less.
        pace = pace * np.asarray(arm.chain.weights)
        steps = np.linalg.norm((q[:, 1:] - q[:, :-1]) * pace, axis=2)
        whole = steps.sum(axis=1, keepdims=True)
        path_share = np.diff(s) / (s[-1] - s[0])
        mean_share = path_share / 2 + steps / np.where(whole > 0.0, whole, 1.0) / 2
        share = np.where(whole > 0.0, mean_share, path_share)
        self.weights = pace / np.sqrt(share)[..., None]

    def select(self, mask: BoolArray) -> _Cost:
        """Return the cost of the masked joint paths, (paths,)."""
        cost = copy(self)
        cost.weights = self.weights[mask]
        return cost

    def values(self, q: FloatArray) -> FloatArray:
        """Return the cost, (paths,), of joint paths with positions q [rad], (paths, n, dof)."""
        steps = (q[:, 1:] - q[:, :-1]) * self.weights
        excess = self.outside * np.maximum(np.abs((q - self.middle) / self.half) - INNER_RANGE, 0.0)
        # NumPy sums pairwise, so rounding errors are small. Joint positions that differ by a free
        # rotation of the tool have equal cost, and rounding errors decide between them.
        total = (steps**2).sum(axis=(1, 2)) + (excess**2).sum(axis=(1, 2))
        for excess, _ in self._excesses(q):
            total += (excess**2).sum(axis=1)
        return np.asarray(total)

    def _excesses(self, q: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield excesses, (paths, n), and their derivatives by the joints, (paths, n, dof)."""
        if self.chord is not None:
            yield self._tilt(q)
        if len(self.arm_joints):
            yield self._singularity(q)

    def _tilt(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the excess of the tilt, (paths, n), and its joint derivatives, (paths, n, dof)."""
        assert self.chord is not None
        down, by_joint = turn_down(self.arm.chain, q.reshape(-1, q.shape[2]))
        axes = np.tile(self.axes, (len(q), 1))
        chord = np.linalg.norm(axes - down, axis=1)
        excess = np.maximum(chord / self.chord - INNER_TILT, 0.0) * self.outside
        scale = np.where(excess > 0.0, self.outside / self.chord / np.maximum(chord, 1e-9), 0.0)
        slopes = np.zeros((len(axes), q.shape[2]))
        slopes[:, : by_joint.shape[1]] = -scale[:, None] * (by_joint @ axes[..., None])[..., 0]
        return excess.reshape(q.shape[:2]), slopes.reshape(q.shape)

    def _singularity(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the cost of postures near a singularity and its joint derivatives, as `_tilt`."""
        arm_joints = self.arm_joints
        chain = self.arm.chain
        scale = np.linalg.norm(np.asarray(chain.positions)[arm_joints[1:]], axis=1).sum()
        jacobian = self.arm.jacobian(q)[..., arm_joints]
        turning = jacobian[..., 3:, :]
        moving = jacobian[..., :3, :] / scale
        scaled = np.concatenate([moving, turning], axis=-2)
        slopes = np.zeros(q.shape)
        excess = np.zeros(q.shape[:2])
        near = np.linalg.svd(scaled, compute_uv=False)[..., 5] < NEARLY_SINGULAR
        left, values, right = np.linalg.svd(scaled[near])
        u = left[..., -1]
        v = right[..., 5, :]
        # A joint turns the axes of itself and of the joints after it, and moves their tool points;
        # the joints before it keep their axes, and their tool point moves.
        axes, points = (np.swapaxes(x[near], -1, -2) for x in (turning, moving))
        by_joint = np.zeros((len(u), q.shape[2]))
        for k, joint in enumerate(arm_joints):
            shifted, rotated = (np.cross(axes[:, k, None], x) for x in (points, axes))
            shifted[:, :k] = np.cross(axes[:, :k], points[:, k, None])
            rotated[:, :k] = 0.0
            change = np.concatenate([shifted, rotated], axis=-1) @ u[..., None]
            by_joint[:, joint] = (v * change[..., 0]).sum(axis=-1)
        # A heavy axis must not outweigh the cost.
        cost = self.outside * max(1.0, float(np.asarray(chain.weights).max()))
        excess[near] = (1.0 - values[:, 5] / NEARLY_SINGULAR) * cost
        slopes[near] = -by_joint * (cost / NEARLY_SINGULAR)
        return excess, slopes

    def equations(self, q: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the equations whose solution is the null-space motion of least linearized cost.

        They are matrices in the form of `solve_banded`, (paths, n free, 2 free), and half the
        negative gradients, (paths, n free).

        - `w`: null-space bases, (paths, n, free, dof).
        """
        count, n, free, _ = w.shape
        share = (q - self.middle) / self.half
        beyond = np.maximum(np.abs(share) - INNER_RANGE, 0.0)
        slope = np.where(beyond > 0.0, self.outside / self.half, 0.0)
        gradient = slope * self.outside * np.copysign(beyond, share)
        weight = slope**2
        ahead = self.weights**2
        pull = ahead * (q[:, 1:] - q[:, :-1])
        gradient[:, :-1] -= pull
        gradient[:, 1:] += pull
        weight[:, :-1] += ahead
        weight[:, 1:] += ahead
        turned = np.swapaxes(w, 2, 3)
        same = (w * weight[:, :, None]) @ turned
        following = (w[:, :-1] * ahead[:, :, None]) @ turned[:, 1:]
        for beyond, slopes in self._excesses(q):
            gradient += beyond[..., None] * slopes
            along = w @ slopes[..., None]
            same += along @ np.swapaxes(along, 2, 3)
        bands = np.zeros((count, n, free, 2 * free))
        for a in range(free):
            bands[:, :, a, : free - a] = same[:, :, a, a:]
            bands[:, :-1, a, free - a : 2 * free - a] = -following[:, :, a]
        bands[..., 0] += SMOOTHING_DAMPING * (1.0 + bands[..., 0].max(axis=(1, 2), keepdims=True))
        right = -(w @ gradient[..., None])
        return bands.reshape(count, n * free, 2 * free), right.reshape(count, n * free)
