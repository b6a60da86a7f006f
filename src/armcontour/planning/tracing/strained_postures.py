"""Postures along a path that exceed ranges as little as possible, to find why a path is refused.

The ranges of joints and the tilt of the positioner are not limits here, but have a cost. One of
them at a time is relaxed, so the excess that remains tells whether this one is the cause.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.planning.tracing.positioner_tilt import chord_of, tilt_of, turn_down
from armcontour.planning.tracing.smoothing import reduce_cost
from armcontour.robot import SerialArm, pose_solver
from armcontour.robot.arm import shift_by_turns
from armcontour.robot.inverse_kinematics import configurations

# Number of points of the path at which its length and the rotation of the tool are measured.
MEASURED = 1000
# Number of poses along a path: at least, and at most.
FEWEST_POSES = 25
MOST_POSES = 110
# Largest rotation of the tool from one pose to the next [rad].
POSE_TURN = 0.3
# Weight of the excess over a range relative to the length of the joint path.
EXCESS_WEIGHT = 1000.0
# Distance from the end of a range at which its cost begins [rad or m]; a soft cost lets the joint
# move a little farther.
MARGIN = 0.02
# The same distance for the chord of the tilt.
TILT_MARGIN = 0.003
# Excess that counts as none [rad or m].
NO_EXCESS = 1e-6
# Difference of a joint from which two first postures are followed separately [rad or m].
APART = 0.3
# Fractions of a step that are tried.
SHARES = (1.0, 0.3, 0.1)
# Number of steps that improve the first postures, the next posture, and whole paths.
FIRST_ROUNDS = 12
NEXT_ROUNDS = 2
PATH_ROUNDS = 15
# Largest change of a joint in a step [rad or m].
LARGEST_CHANGE = 0.4
# Regularization of the diagonal of the equations, relative to their largest entry.
DAMPING = 1e-6
# Correction of joint positions at which a followed pose is reached [rad].
REACHED = 1e-7


@dataclass(frozen=True, slots=True, kw_only=True)
class Poses:
    """Tool poses along a path, and the arm that must reach them."""

    arm: SerialArm  # The arm, without the joints that are held
    task: int  # Task dimension, see `task_dimension`
    s: FloatArray  # Arc lengths [m], (n,)
    targets: FloatArray  # Rotations and positions of the tool, (n, 3, 4)

    @classmethod
    def along(cls, path: Path, arm: SerialArm, task: int) -> Poses:
        """Choose poses along a path, evenly by its length and the rotation of the tool."""
        s = np.union1d(np.linspace(0.0, path.length, MEASURED), path.breaks)
        targets = targets_at(path, s)
        turned = np.linalg.norm(np.diff(targets[:, :, :3], axis=0), axis=(1, 2)) / np.sqrt(2)
        rotation = float(turned.sum())
        count = int(np.clip(np.ceil(rotation / POSE_TURN), FEWEST_POSES, MOST_POSES))
        done = np.append(0.0, np.cumsum(np.diff(s) / path.length + turned / max(rotation, 1.0)))
        chosen = np.interp(np.linspace(0.0, done[-1], count), done, s)
        if len(path.breaks) < count:
            # Joints often turn back at corners.
            chosen = np.union1d(chosen, path.breaks)
        return cls(arm=arm, task=task, s=chosen, targets=targets_at(path, chosen))

    @property
    def free(self) -> int:
        """Number of joint motions that do not move the tool."""
        return self.arm.dof - self.task

    def part(self, selection: slice | IntArray) -> Poses:
        """Select some of the poses."""
        return replace(self, s=self.s[selection], targets=self.targets[selection])


def targets_at(path: Path, s: FloatArray) -> FloatArray:
    """Return tool poses at arc lengths [m], (n, 3, 4)."""
    poses = np.tile(np.eye(3, 4), (len(s), 1, 1))
    poses[:, :, 3] = path(s)
    if path.orientation is not None:
        poses[:, :, :3] = path.orientation(s)
    return poses


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranges:
    """Ranges of joints and tilt that several joint paths should keep; infinite if relaxed."""

    lower: FloatArray  # [rad], (paths, dof)
    upper: FloatArray  # [rad], (paths, dof)
    chord: FloatArray  # Largest distance of tool axis and gravity as unit vectors, (paths,)

    @classmethod
    def of(cls, arm: SerialArm, count: int) -> Ranges:
        """Repeat the ranges of an arm for a number of joint paths."""
        lower, upper = arm.limits.joint_range(arm.dof)
        tilt = tilt_of(arm.chain)
        return cls(
            lower=np.tile(lower, (count, 1)),
            upper=np.tile(upper, (count, 1)),
            chord=np.full(count, np.inf if tilt is None else chord_of(tilt)),
        )

    def select(self, paths: BoolArray | IntArray) -> Ranges:
        """Select some of the joint paths."""
        return Ranges(lower=self.lower[paths], upper=self.upper[paths], chord=self.chord[paths])

    def relaxed(self, path: int, joint: int, lower: float, upper: float) -> None:
        """Replace the range of a joint [rad], or if the index is that after the last, the tilt."""
        if joint == self.lower.shape[1]:
            self.chord[path] = upper
        else:
            self.lower[path, joint] = lower
            self.upper[path, joint] = upper

    def excess(self, q: FloatArray) -> FloatArray:
        """Return the excess of joints over their ranges [rad], (paths, n, dof); negative below."""
        above = np.maximum(q - self.upper[:, None], 0.0)
        return above - np.maximum(self.lower[:, None] - q, 0.0)


class Strain:
    """Cost of joint paths: squares of joint steps and of excesses over ranges and tilt."""

    shares = SHARES
    largest_change = LARGEST_CHANGE

    def __init__(self, poses: Poses, ranges: Ranges) -> None:
        self.poses = poses
        self.ranges = ranges
        # A range that is narrower than both margins has its cost from its middle.
        room = np.minimum(MARGIN, (ranges.upper - ranges.lower) / 2)
        self.lower = (ranges.lower + room)[:, None]
        self.upper = (ranges.upper - room)[:, None]
        self.chord = (ranges.chord - TILT_MARGIN)[:, None]
        count = len(poses.s)
        self.weight = EXCESS_WEIGHT**2 / count
        self.step_weight = float(count)

    def select(self, paths: BoolArray) -> Strain:
        """Return the cost of some of the joint paths."""
        return Strain(self.poses, self.ranges.select(paths))

    def values(self, q: FloatArray) -> FloatArray:
        """Return the cost, (paths,), of joint paths [rad], (paths, n, dof)."""
        steps = (np.diff(q, axis=1) ** 2).sum(axis=(1, 2))
        excess = (self._beyond(q) ** 2).sum(axis=(1, 2))
        if self._is_tilted:
            excess = excess + (self._tilt(q)[0] ** 2).sum(axis=1)
        return np.asarray(self.step_weight * steps + self.weight * excess)

    @property
    def _is_tilted(self) -> bool:
        """True if the tilt of some joint path has a limit."""
        return bool(np.isfinite(self.ranges.chord).any())

    def _beyond(self, q: FloatArray) -> FloatArray:
        """Return the signed excess of joint positions over the inner ranges, (paths, n, dof)."""
        return np.maximum(q - self.upper, 0.0) - np.maximum(self.lower - q, 0.0)

    def _tilt(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the excess of the tilt, (paths, n), and its derivatives, (paths, n, dof)."""
        axes = np.tile(self.poses.targets[:, :, 2], (len(q), 1))
        down, by_joint = turn_down(self.poses.arm.chain, q.reshape(-1, q.shape[2]))
        chord = np.linalg.norm(axes - down, axis=1)
        excess = np.maximum(chord.reshape(q.shape[:2]) - self.chord, 0.0)
        scale = np.where(excess.ravel() > 0.0, 1.0 / np.maximum(chord, 1e-9), 0.0)
        slopes = np.zeros((len(axes), q.shape[2]))
        slopes[:, : by_joint.shape[1]] = -scale[:, None] * (by_joint @ axes[..., None])[..., 0]
        return excess, slopes.reshape(q.shape)

    def equations(self, q: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the equations of a Gauss-Newton step, as `PostureCost.equations`."""
        count, n, free, _ = w.shape
        beyond = self._beyond(q)
        gradient = self.weight * beyond
        diagonal = np.where(beyond != 0.0, self.weight, 0.0)
        pull = self.step_weight * np.diff(q, axis=1)
        gradient[:, :-1] -= pull
        gradient[:, 1:] += pull
        diagonal[:, :-1] += self.step_weight
        diagonal[:, 1:] += self.step_weight
        turned = np.swapaxes(w, 2, 3)
        same = (w * diagonal[:, :, None]) @ turned
        following = self.step_weight * w[:, :-1] @ turned[:, 1:]
        if self._is_tilted:
            excess, slopes = self._tilt(q)
            gradient += self.weight * excess[..., None] * slopes
            along = w @ slopes[..., None]
            same += self.weight * along @ np.swapaxes(along, 2, 3)
        bands = np.zeros((count, n, free, 2 * free))
        for a in range(free):
            bands[:, :, a, : free - a] = same[:, :, a, a:]
            bands[:, :-1, a, free - a : 2 * free - a] = -following[:, :, a]
        bands[..., 0] += DAMPING * (1.0 + bands[..., 0].max(axis=(1, 2), keepdims=True))
        right = -(w @ gradient[..., None])
        return bands.reshape(count, n * free, 2 * free), right.reshape(count, n * free)


def improve(
    poses: Poses, ranges: Ranges, q: FloatArray, rounds: int, *, start_stays: bool = False
) -> FloatArray:
    """Reduce the strain of joint paths, (paths, n, dof), by motions that do not move the tool."""
    if poses.free == 0 or not len(q):
        return q.copy()
    strain = Strain(poses, ranges)
    return reduce_cost(
        poses.arm,
        poses.targets,
        poses.task,
        q,
        strain,
        rounds,
        lambda _, w: w,
        start_stays=start_stays,
    )[0]


def first_postures(poses: Poses) -> FloatArray:
    """Return different postures at the first pose, that with the least strain first, (k, dof)."""
    arm = poses.arm
    q = configurations(arm, poses.targets[0], poses.task)
    return settle(poses, Ranges.of(arm, len(q)), q)


def settle(poses: Poses, ranges: Ranges, q: FloatArray) -> FloatArray:
    """Reduce the strain of postures at the first pose; return different ones in its order."""
    arm = poses.arm
    first = poses.part(slice(1))
    settled = improve(first, ranges, q[:, None], FIRST_ROUNDS)[:, 0]
    for k in range(len(settled)):
        settled[k] = shift_by_turns(arm, settled[k : k + 1])[0][0]
    order = np.argsort(Strain(first, ranges).values(settled[:, None]), kind="stable")
    if poses.free == 0:
        return settled[order]
    chosen: list[FloatArray] = []
    for posture in settled[order]:
        if all(np.abs(posture - x).max() > APART for x in chosen):
            chosen.append(posture)
    return np.array(chosen).reshape(-1, arm.dof)


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """Postures followed along a path without regard to ranges."""

    q: FloatArray  # Joint positions at the reached poses [rad], (starts, n, dof)
    reached: IntArray  # Number of poses that are reached, with the first, (starts,)

    @property
    def complete(self) -> BoolArray:
        """Mask of the starts that reach the end of the path, (starts,)."""
        return np.asarray(self.reached == self.q.shape[1])


def walk(poses: Poses, ranges: Ranges, starts: FloatArray) -> Walk:
    """Follow postures, (starts, dof), along a path; ranges have a cost, but are no limits."""
    arm = poses.arm
    n = len(poses.s)
    q = np.empty((len(starts), n, arm.dof))
    q[:, 0] = starts
    reached = np.full(len(starts), n)
    active = np.arange(len(starts))
    for i in range(1, n):
        if not len(active):
            break
        pair = poses.part(slice(i - 1, i + 1))
        positions = np.ascontiguousarray(q[active, i - 1 : i + 1])
        positions[:, 1] = positions[:, 0]
        arrived = np.empty(len(active), np.intp)
        pose_solver.follow(arm.link_table, poses.task, pair.targets, positions, arrived, REACHED)
        reached[active[arrived < 2]] = i
        positions = positions[arrived == 2]
        active = active[arrived == 2]
        kept = ranges.select(active)
        q[active, i] = improve(pair, kept, positions, NEXT_ROUNDS, start_stays=True)[:, 1]
    for k in np.flatnonzero(reached == n):
        q[k] = shift_by_turns(arm, q[k])[0]
    return Walk(q=q, reached=reached)
