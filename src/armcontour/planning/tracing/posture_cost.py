"""Cost of the postures of a redundant arm along a path."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.planning.tracing.positioner_tilt import INNER_TILT, chord_of, tilt_of, turn_down
from armcontour.robot import SerialArm

# Joint positions beyond this fraction of half the range, from its middle, have a cost.
INNER_RANGE = 0.7
# Angles between tool axis and required axis beyond this fraction of the cone have a cost.
INNER_CONE = 0.95
# Weight of this angle as a fraction of the cone, so that the tool leans only where it helps.
LEANING_WEIGHT = 0.7
# Weight of this cost relative to the length of the joint path.
RANGE_WEIGHT = 30.0
# Joint positions of a cell, and angles to gravity, beyond this fraction have an additional cost, by
# this factor, because neither weights nor the rest of the path may push them out of their ranges.
OUTER_RANGE = 0.95
OUTER_FACTOR = 20.0
# Approximate largest change of a joint position in one iteration of smoothing [rad].
LARGEST_CHANGE = 0.3
# Fractions of a step that are tried with costs that are not quadratic.
SHARES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003)
# Smallest singular value of the Jacobian of an arm with external axes, with lengths relative to
# those of the arm, below which a posture has a cost.
NEARLY_SINGULAR = 0.04
# Regularization of the diagonal of an iteration's matrix, relative to its largest entry; the matrix
# is singular if no cost depends on a null-space motion.
SMOOTHING_DAMPING = 1e-6


def middle_and_half(arm: SerialArm) -> tuple[FloatArray, FloatArray]:
    """Return the middle of each joint range and half its length [rad], (dof,) each.

    Without two ends, they are 0 and infinite.
    """
    lower, upper = arm.limits.joint_range(arm.dof)
    both = np.isfinite(lower) & np.isfinite(upper)
    low = np.where(both, lower, 0.0)
    high = np.where(both, upper, 0.0)
    return (high + low) / 2, np.where(both, (high - low) / 2, np.inf)


def paces(arm: SerialArm) -> FloatArray:
    """Return the weights of joint moves: larger for slow and for heavy joints, (dof,)."""
    pace = np.ones(arm.dof)
    if arm.limits.joint_velocity is not None:
        slowest = np.minimum(*np.abs(arm.limits.velocity_bounds(arm.dof)))
        # A joint without a limit counts as the fastest one.
        slowest = np.minimum(slowest, slowest[np.isfinite(slowest)].max())
        pace = np.min(slowest) / slowest
    # A joint with a larger weight moves less.
    return np.asarray(pace * np.asarray(arm.chain.weights))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Joints:
    """Ranges and weights of an arm's joints, which are the same for all its joint paths."""

    middle: FloatArray  # Middle of each range [rad], (dof,)
    half: FloatArray  # Half of its length [rad], (dof,)
    pace: FloatArray  # Weights of joint moves, (dof,)
    # Joints of the arm on its external axes, which stay away from singularities, (k,); only six or
    # more joints can
    kept_regular: IntArray
    # The largest weight, at least 1: a heavy axis must not outweigh the costs of a tilt or a
    # singular posture.
    heaviest: float
    outer: float  # Factor of the additional cost beyond OUTER_RANGE


@lru_cache(maxsize=8)
def _joints_of(arm: SerialArm) -> _Joints:
    """Return the ranges and weights of an arm's joints, from a cache."""
    middle, half = middle_and_half(arm)
    external = arm.chain.external
    arm_joints = np.setdiff1d(np.arange(arm.dof), external)
    stays_away = len(external) and len(arm_joints) >= 6
    heaviest = max(1.0, float(np.asarray(arm.chain.weights).max()))
    return _Joints(
        middle=middle,
        half=half,
        pace=paces(arm),
        kept_regular=arm_joints if stays_away else arm_joints[:0],
        heaviest=heaviest,
        outer=OUTER_FACTOR * heaviest if len(external) else 0.0,
    )


class PostureCost:
    """Cost of a joint path: squares of weighted joint steps, and of excesses over inner ranges."""

    largest_change = LARGEST_CHANGE

    # The weight of a step decreases with its fraction of the tool path and of the initial joint
    # path, because at a tight corner the joints move far on a short path, which must not outweigh
    # all other steps.

    def __init__(
        self, arm: SerialArm, s: FloatArray, q: FloatArray, axes: FloatArray, cone: float = 0.0
    ) -> None:
        # `s`: arc lengths [m], (n,); `q`: joint positions in several configurations [rad], (paths,
        # n, dof); `axes`: required tool axes, (n, 3); `cone`: largest angle from them [rad]; 0 if
        # the tool axis does not change.
        joints = _joints_of(arm)
        self.middle = joints.middle
        self.half = joints.half
        self.arm_joints = joints.kept_regular
        self.heaviest = joints.heaviest
        self.outer = joints.outer
        self.outside = RANGE_WEIGHT / np.sqrt(len(s))
        self.leaning = LEANING_WEIGHT / np.sqrt(len(s))
        self.arm = arm
        self.axes = axes
        tilt = tilt_of(arm.chain)
        self.chord = None if tilt is None else chord_of(tilt)
        self.cone_chord = None if cone == 0.0 else chord_of(cone)
        # Fractions of a step that are tried. A step may leave the inner range of the tilt, whose
        # cost the linearized cost does not include.
        is_quadratic = tilt is None and not len(self.arm_joints) and cone == 0.0
        self.shares = (1.0,) if is_quadratic else SHARES
        pace = joints.pace
        steps = np.linalg.norm((q[:, 1:] - q[:, :-1]) * pace, axis=2)
        whole = steps.sum(axis=1, keepdims=True)
        path_share = np.diff(s) / (s[-1] - s[0])
        mean_share = path_share / 2 + steps / np.where(whole > 0.0, whole, 1.0) / 2
        share = np.where(whole > 0.0, mean_share, path_share)
        self.weights = pace / np.sqrt(share)[..., None]

    def select(self, mask: BoolArray) -> PostureCost:
        """Return the cost of the masked joint paths, (paths,)."""
        cost = copy(self)
        cost.weights = self.weights[mask]
        return cost

    def values(self, q: FloatArray) -> FloatArray:
        """Return the cost, (paths,), of joint paths with positions q [rad], (paths, n, dof)."""
        steps = (q[:, 1:] - q[:, :-1]) * self.weights
        excess = self._range_excess(self._range_share(q))
        # NumPy sums pairwise, so rounding errors are small. Joint positions that differ by a free
        # rotation of the tool have equal cost, and rounding errors decide between them.
        total = (steps**2).sum(axis=(1, 2)) + (excess**2).sum(axis=(1, 2))
        for excess, _ in self._excesses(q):
            total += (excess**2).sum(axis=1)
        return np.asarray(total)

    def _range_share(self, q: FloatArray) -> FloatArray:
        """Return positions in the joint ranges, from -1 to 1 in a range, (paths, n, dof)."""
        return np.asarray((q - self.middle) / self.half)

    def _range_excess(self, share: FloatArray) -> FloatArray:
        """Return the excesses over the inner ranges, (paths, n, dof).

        - `share`: positions in the joint ranges, as from `_range_share`.
        """
        size = np.abs(share)
        inner = np.maximum(size - INNER_RANGE, 0.0)
        outer = np.maximum(size - OUTER_RANGE, 0.0)
        return np.asarray(self.outside * (inner + self.outer * outer))

    def _range_slope(self, share: FloatArray) -> FloatArray:
        """Return the derivatives of `_range_excess` by the joint positions, (paths, n, dof)."""
        size = np.abs(share)
        inner = np.where(size > INNER_RANGE, 1.0, 0.0)
        outer = np.where(size > OUTER_RANGE, self.outer, 0.0)
        return np.asarray(np.copysign(self.outside * (inner + outer) / self.half, share))

    def _excesses(self, q: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield excesses, (paths, n), and their derivatives by the joints, (paths, n, dof)."""
        if self.chord is not None:
            yield self._tilt(q)
        if self.cone_chord is not None:
            yield from self._lean(q)
        if len(self.arm_joints):
            yield self._singularity(q)

    def _lean(self, q: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield costs of the angle between tool axis and required axis, as `_excesses`."""
        assert self.cone_chord is not None
        positions = q.reshape(-1, q.shape[2])
        axis = self.arm.poses(positions)[:, :, 2]
        apart = axis - np.tile(self.axes, (len(q), 1))
        chord = np.linalg.norm(apart, axis=1)
        turned = np.cross(np.swapaxes(self.arm.jacobian(positions)[:, 3:], 1, 2), axis[:, None])
        share = chord / self.cone_chord
        slopes = (turned @ apart[..., None])[..., 0] / self.cone_chord
        slopes /= np.maximum(chord, 1e-9)[:, None]
        outside = self.outside * self.heaviest
        for weight, inner in ((outside, INNER_CONE), (self.leaning, 0.0)):
            beyond = np.maximum(share - inner, 0.0)
            by_joint = np.where(beyond > 0.0, weight, 0.0)[:, None] * slopes
            yield (weight * beyond).reshape(q.shape[:2]), by_joint.reshape(q.shape)

    def _tilt(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the excess of the tilt, (paths, n), and its joint derivatives, (paths, n, dof)."""
        assert self.chord is not None
        positions = q.reshape(-1, q.shape[2])
        down, by_joint = turn_down(self.arm.chain, positions)
        axes = np.tile(self.axes, (len(q), 1))
        if self.cone_chord is not None:
            axes = self.arm.poses(positions)[:, :, 2]
        chord = np.linalg.norm(axes - down, axis=1)
        inner = np.maximum(chord / self.chord - INNER_TILT, 0.0)
        outer = np.maximum(chord / self.chord - OUTER_RANGE, 0.0)
        outside = self.outside * self.heaviest
        excess = outside * (inner + OUTER_FACTOR * outer)
        steepness = (inner > 0.0) + OUTER_FACTOR * (outer > 0.0)
        scale = outside * steepness / self.chord / np.maximum(chord, 1e-9)
        slopes = np.zeros((len(axes), q.shape[2]))
        slopes[:, : by_joint.shape[1]] = -scale[:, None] * (by_joint @ axes[..., None])[..., 0]
        if self.cone_chord is not None:
            # A tool that leans moves its axis, too.
            turned = np.cross(np.swapaxes(self.arm.jacobian(positions)[:, 3:], 1, 2), axes[:, None])
            slopes += scale[:, None] * (turned @ (axes - down)[..., None])[..., 0]
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
        cost = self.outside * self.heaviest
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
        share = self._range_share(q)
        slope = self._range_slope(share)
        gradient = slope * self._range_excess(share)
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
