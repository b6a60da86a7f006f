"""Joint positions of a serial arm along a path, one solution for each start configuration."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import Unreachable
from armcontour.core.pool import map_in_threads, split_evenly
from armcontour.geometry import Path
from armcontour.planning.tracing.knots import Knots
from armcontour.planning.tracing.poses import OUT_OF_REACH, poses_at, row_of_poses, what_helps
from armcontour.planning.tracing.ranges import out_of_range
from armcontour.planning.tracing.redundancy import null_space, smooth
from armcontour.robot import SerialArm, newton
from armcontour.robot.arm import unit_hint
from armcontour.robot.inverse import (
    REACH_SEEDS,
    configurations,
    out_of_reach,
    seeds,
    shift_by_turns,
)
from armcontour.robot.limit_use import use_of

T = TypeVar("T")
R = TypeVar("R")

# Work on so many poses is shared by threads: starting them takes as long as that of a hundred. Ways
# are followed in so many parts, as some end early.
MANY, PARTS = 2000, 16
# Joint paths are smoothed in so many parts: NumPy works on the ways of a part at once.
SMOOTHED_PARTS = 4
# Poses are followed until a correction is below this [rad]. Ways that cost the same are told apart
# by the last digit; with a given start there is one way, of which the solver makes the last
# correction: about the square of this times the condition number of the Jacobian.
EXACTLY, NEARLY = 1e-9, 1e-7
# Largest number of start configurations that are followed along the path.
MOST_STARTS = 48
# With redundant degrees of freedom, largest number of different solutions that are kept.
MOST_SOLUTIONS = 8
# Two solutions count as one if they differ by less than this outside the null space [rad].
SAME_SOLUTION = 0.05
# Different solutions are mostly told apart at this number of knots.
FEW_KNOTS = 16
# Redundant solutions are ranked by their cost after this many iterations of smoothing, on at most
# this number of knots.
ROUGH_ROUNDS = 3
ROUGH_KNOTS = 70
# This many of the best redundant solutions are smoothed to the end; more only if none succeeds.
MOST_SMOOTHED = 16
# Solutions are followed along chords of the path, which turns by at most this over a chord [rad].
CHORD_TURN = 0.1
# For a joint out of its range, shifts by up to this number of whole turns are compared.
MOST_TURNS = 5
# To find poses out of reach, seed joint positions are tried at a few poses of the path, and one
# seed at more poses.
SOME_POSES = 10
MANY_POSES = 300
# Bisection steps for the arc length at which the reach ends.
BISECTIONS = 30


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Joint positions along a path in one configuration.

    Args:
        q: Joint positions at the start of every knot interval and the end of the last [rad],
            (n + 1, dof).
        cost: Length of the joint path; ranks the solutions before they are timed.
    """

    q: FloatArray
    cost: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Failure:
    """Knot at which a solution ends, and the joint that leaves its range there, if any.

    Args:
        reached: Index of the first knot that is not reached.
        q: Joint positions at the knot before, or at the knot out of range [rad], (dof,).
        joint: Index of the joint that leaves its range; -1 if the pose has no solution.
        value: Position of that joint [rad].
        limit: End of its range [rad].
    """

    reached: int
    q: FloatArray
    joint: int = -1
    value: float = 0.0
    limit: float = 0.0


def find_solutions(
    path: Path,
    arm: SerialArm,
    knots: Knots,
    knot_poses: FloatArray,
    task: int,
    start: FloatArray | None,
) -> list[Solution]:
    """All solutions that complete the path inside the joint ranges, the shortest first.

    Args:
        path: The path.
        arm: The arm.
        knots: Knot intervals of the path.
        knot_poses: Poses of the tool at their starts and at the end of the last, (n + 1, 3, 4).
        task: Task dimension.
        start: Joint positions near those at the start of the path [rad], (dof,); None for all
            configurations.

    Raises:
        Unreachable: There is no solution; gives the reason for the one that comes farthest.
    """
    fine, at = subdivide(path, knots, knot_poses)
    poses = knot_poses if len(fine) == len(knots) else row_of_poses(path, fine)
    starts = configurations(arm, poses[0], task, start)
    if len(starts) == 0:
        _refuse_start(path, arm, poses, task, start)
    enough = EXACTLY if start is None else NEARLY
    followed, failures = _follow(arm, poses, task, starts[:MOST_STARTS], enough)
    followed = [q[at] for q in followed]
    s = np.append(fine.s0, path.length)[at]
    redundant = task < arm.dof
    if redundant:
        followed = _rank(arm, s, knot_poses, task, followed, start)
    found: list[Solution] = []
    different = _Different(arm, knot_poses, task)
    candidates = _with_costs(arm, s, knot_poses, task, followed, start)
    for count, (q, cost) in enumerate(candidates, start=1):
        in_range = _turn_into_range(arm, q, start)
        if isinstance(in_range, _Failure):
            failures.append(dataclasses.replace(in_range, reached=int(at[in_range.reached])))
        elif different.add(in_range):
            found.append(Solution(q=in_range, cost=cost))
        if redundant and found and count >= MOST_SMOOTHED:
            break
    if not found:
        _refuse(path, arm, fine, poses, task, max(failures, key=lambda x: x.reached))
    # Elbow up and down often cost the same: the one whose joints start nearer to 0 comes first.
    found.sort(key=lambda x: (float(f"{x.cost:.9e}"), float(np.abs(x.q[0]).sum())))
    return found[:MOST_SOLUTIONS] if redundant else found


def _with_costs(
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    ways: list[FloatArray],
    start: FloatArray | None,
) -> Iterator[tuple[FloatArray, float]]:
    """Joint paths with their costs; those of a redundant arm are smoothed when they are taken.

    Args:
        arm: The arm.
        s: The knots [m], (n,).
        poses: Poses of the tool at the knots, (n, 3, 4).
        task: Task dimension.
        ways: The joint paths [rad], (n, dof) each.
        start: Joint positions at the start that stay, or None.
    """
    if task == arm.dof:
        yield from ((q, _joint_distance(arm, q)) for q in ways)
        return
    for some in (ways[:MOST_SMOOTHED], *([q] for q in ways[MOST_SMOOTHED:])):
        yield from _smooth(arm, s, poses, task, some, start_stays=start is not None)


def _follow(
    arm: SerialArm, poses: FloatArray, task: int, starts: FloatArray, enough: float
) -> tuple[list[FloatArray], list[_Failure]]:
    """Follow all poses from each start: joint positions that reach the end, and the failures.

    Args:
        arm: The arm.
        poses: Rotations and positions of the tool, (n, 3, 4).
        task: Task dimension.
        starts: Joint positions at the first pose [rad], (starts, dof).
        enough: As in `follow_branches` [rad].
    """
    q, reached = follow_branches(arm, poses, task, starts, enough)
    whole = reached == len(poses)
    failures = [
        _Failure(reached=int(k), q=way[k - 1])
        for way, k in zip(q[~whole], reached[~whole], strict=True)
    ]
    return [q[k] for k in np.flatnonzero(whole)], failures


def follow_branches(
    arm: SerialArm,
    poses: FloatArray,
    task: int,
    starts: FloatArray,
    enough: float = EXACTLY,
) -> tuple[FloatArray, IntArray]:
    """Follow poses from each start, several ways at the same time.

    Args:
        arm: The arm.
        poses: Rotations and positions of the tool, (n, 3, 4).
        task: Task dimension.
        starts: Joint positions at the first pose [rad], (starts, dof).
        enough: A pose is reached with a correction of every joint below this [rad].

    Returns:
        Joint positions [rad], (starts, n, dof), as far as poses are reached; and how many are, the
        first one included, (starts,).
    """
    q, reached = np.empty((len(starts), len(poses), arm.dof)), np.empty(len(starts), np.intp)
    q[:, 0] = starts

    def follow(ways: slice) -> None:
        newton.follow(arm.link_table, task, poses, q[ways], reached[ways], enough)

    _in_threads(follow, split_evenly(len(starts), PARTS), len(starts) * len(poses))
    return q, reached


def _in_threads(work: Callable[[T], R], items: Sequence[T], poses: int) -> list[R]:
    """Do compiled work on several items, in threads if all of them have many poses."""
    return map_in_threads(work, items) if poses >= MANY else [work(x) for x in items]


def _rank(
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    followed: list[FloatArray],
    start: FloatArray | None,
) -> list[FloatArray]:
    """The solutions, sorted by their cost after a few iterations of smoothing on some knots.

    Solutions that are the same as an earlier one come last.
    """
    if len(followed) == 1 and len(s) > ROUGH_KNOTS:
        return [shift_by_turns(arm, followed[0])[0]]
    few = np.unique(np.linspace(0, len(s) - 1, min(len(s), ROUGH_KNOTS)).astype(np.intp))

    shifted = [shift_by_turns(arm, q)[0] for q in followed]
    options = {"start_stays": start is not None, "rounds": ROUGH_ROUNDS}
    rough = _smooth(arm, s[few], poses[few], task, [q[few] for q in shifted], **options)
    both = zip(shifted, rough, strict=True)
    ranked = [(cost, q if len(few) < len(s) else short) for q, (short, cost) in both]
    ranked.sort(key=lambda x: x[0])
    first: list[FloatArray] = []
    again: list[FloatArray] = []
    different = _Different(arm, poses, task)
    for _, q in ranked:
        (first if different.add(q) else again).append(q)
    return first + again


def _smooth(
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    ways: list[FloatArray],
    **options: Any,
) -> list[tuple[FloatArray, float]]:
    """Smoothed joint paths, (n, dof) each, with their costs; in threads if it takes long."""
    if not ways:
        return []

    def work(part: slice) -> tuple[FloatArray, FloatArray]:
        return smooth(arm, s, poses, task, np.array(ways[part]), **options)

    parts = split_evenly(len(ways), SMOOTHED_PARTS)
    done = _in_threads(work, parts, len(ways) * len(s))
    return [(q, float(cost)) for part in done for q, cost in zip(*part, strict=True)]


class _Different:
    """Solutions that all differ by more than null-space motion.

    Args:
        arm: The arm.
        poses: Rotations and positions of the tool, (n, 3, 4).
        task: Task dimension.
    """

    def __init__(self, arm: SerialArm, poses: FloatArray, task: int) -> None:
        self.arm, self.poses, self.task = arm, poses, task
        self._known: list[FloatArray] = []
        # Null spaces of known solutions that others are compared with, at some knots, and along all
        # of them where a difference is looked at closely.
        self._rough: list[FloatArray] = []
        self._spaces: dict[int, FloatArray] = {}

    @cached_property
    def _few(self) -> IntArray:
        """Indices of some knots."""
        return np.unique(np.linspace(0, len(self.poses) - 1, FEW_KNOTS).astype(np.intp))

    def add(self, q: FloatArray) -> bool:
        """Add joint positions, (n, dof), unless they are those of a known solution."""
        if self.task == self.arm.dof:
            if any(np.abs(q - x).max() < SAME_SOLUTION for x in self._known):
                return False
        else:
            few = self._few
            if self._known:
                # At any knot no more may be left than from a difference of half a turn.
                apart = q[few] - np.array([x[few] for x in self._known])
                near = _outside(np.array(self._rough), apart)[0] < SAME_SOLUTION * np.pi
                if any(self._is_known(k, q) for k in np.flatnonzero(near).tolist()):
                    return False
            self._rough.append(null_space(self.arm, self.poses[few], self.task, q[few]))
        self._known.append(q)
        return True

    def _is_known(self, k: int, q: FloatArray) -> bool:
        """Whether joint positions are those of a known solution but for null-space motion."""
        if k not in self._spaces:
            self._spaces[k] = null_space(self.arm, self.poses, self.task, self._known[k])
        rest, size = _outside(self._spaces[k], q - self._known[k])
        return bool(rest < SAME_SOLUTION * max(1.0, float(size)))


def _outside(w: FloatArray, difference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The largest part outside null spaces of differences of joint positions, and their largest.

    Args:
        w: Bases of the null spaces, (..., n, free, dof).
        difference: The differences, up to whole turns [rad], (..., n, dof).
    """
    near = np.pi - np.mod(np.pi - difference, 2 * np.pi)
    rest = near - (np.swapaxes(w, -1, -2) @ (w @ near[..., None]))[..., 0]
    return np.abs(rest).max(axis=(-1, -2)), np.abs(near).max(axis=(-1, -2))


def subdivide(path: Path, knots: Knots, poses: FloatArray) -> tuple[Knots, IntArray]:
    """Subintervals whose chords are close to the path.

    Args:
        path: The path.
        knots: Knot intervals.
        poses: Poses of the tool at their starts and at the end of the last, (n + 1, 3, 4).

    Returns:
        The subintervals, and the indices of the given knots among their starts and last end.
    """
    width = knots.u1 - knots.u0
    turn = width * path.curvatures[knots.segment]
    if path.orientation is not None and not path.orientation.constant:
        axes = poses[:, :, :3]
        turned = np.linalg.norm(axes[1:] - axes[:-1], axis=(1, 2)) / np.sqrt(2)
        turn = np.maximum(turn, turned)
    if turn.max() <= CHORD_TURN:
        return knots, np.arange(len(knots) + 1)
    return knots.cut(np.maximum(1, np.ceil(turn / CHORD_TURN)).astype(np.intp))


def _joint_distance(arm: SerialArm, q: FloatArray) -> float:
    """Length of a joint path: sum of the slowest joint's shortest times between knots [s]."""
    steps = np.diff(q, axis=0)
    if arm.limits.joint_velocity is None:
        return float(np.abs(steps).max(axis=1).sum())
    return float(use_of("joint_velocity", arm.limits, steps).ratio.max(axis=1).sum())


def _turn_into_range(
    arm: SerialArm, q: FloatArray, start: FloatArray | None
) -> FloatArray | _Failure:
    """The positions, shifted by whole turns into the joint ranges; or where they leave a range.

    If a start is given, the shifts nearest to the start are preferred.
    """
    wanted, inside = shift_by_turns(arm, q, start)
    if inside:
        return wanted
    lower, upper = arm.limits.joint_range(arm.dof)
    below, above = wanted < lower, wanted > upper
    # For each joint: the shift that stays in range farthest along the path, and among equal ones
    # that with the least excess at the knot that leaves the range.
    for joint in np.flatnonzero((below | above).any(axis=0)):
        turns = 2 * np.pi * np.arange(-MOST_TURNS, MOST_TURNS + 1)
        tried = wanted[:, joint, None] + turns
        beyond = np.maximum(lower[joint] - tried, tried - upper[joint])
        left = np.argmax(beyond > 0, axis=0)
        best = np.lexsort((beyond[left, np.arange(len(turns))], -left))[0]
        wanted[:, joint] = tried[:, best]
    row = int(np.argmax(((wanted < lower) | (wanted > upper)).any(axis=1)))
    below, above = wanted < lower, wanted > upper
    worst = int(np.argmax((below | above)[row]))
    limit = float(lower[worst] if below[row, worst] else upper[worst])
    value = float(wanted[row, worst])
    return _Failure(reached=row, q=wanted[row], joint=worst, value=value, limit=limit)


def _refuse_start(
    path: Path, arm: SerialArm, poses: FloatArray, task: int, start: FloatArray | None
) -> None:
    """Raise Unreachable with the reason why the first pose of the path has no solution."""
    if start is not None:
        _refuse_given_start(arm, poses[0], task, start)
    point = poses[0, :, 3]
    gap = _reach_gap(arm, poses[0], task, seeds(arm)[:REACH_SEEDS])
    some = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), SOME_POSES)).astype(np.intp))
    gaps = out_of_reach(arm, poses[some], task, seeds(arm)[:REACH_SEEDS])
    worst = int(some[np.argmax(gaps)])
    more = ""
    if worst > 0 and gaps.max() > gap:
        worst_point = tuple(np.round(poses[worst, :, 3], 6).tolist())
        more = f" (at most {gaps.max():.3g} m on the path, at {worst_point} m)"
    raise Unreachable(
        f"At 0 m along the path the arm {arm.name} cannot reach the position "
        f"{tuple(np.round(point, 6).tolist())} m with the required tool orientation: the tool "
        f"stays {gap:.3g} m away{more}; {what_helps(path)}{unit_hint(gap)}.",
        point=point.tolist(),
        s=0.0,
        limit="reach",
        needed=gap,
        allowed=0.0,
    )


def _refuse_given_start(arm: SerialArm, pose: FloatArray, task: int, start: FloatArray) -> None:
    """Refuse a start from which the first pose is not reached, though the pose has solutions.

    Raises:
        Unreachable: The pose has solutions; names the nearest one.
    """
    known = configurations(arm, pose, task)
    if len(known) == 0:
        return
    difference = start - known
    turns = np.round(difference / (2 * np.pi))
    difference = np.abs(difference - 2 * np.pi * turns).max(axis=1)
    nearest = known[np.argmin(difference)]
    point = pose[:, 3]
    raise Unreachable(
        f"From the given start the arm {arm.name} does not reach the pose of the tool at the start "
        f"of the path, {tuple(np.round(point, 6).tolist())} m; give a start nearer to joint "
        f"positions that reach it, such as {tuple(np.round(nearest, 4).tolist())} rad.",
        point=point.tolist(),
        s=0.0,
        limit="start",
        needed=float(difference.min()),
    )


def _reach_gap(arm: SerialArm, pose: FloatArray, task: int, q: FloatArray) -> float:
    """Least distance of the tool from a pose [m], by Newton's method from joint positions q."""
    return float(out_of_reach(arm, pose[None], task, q)[0])


def _largest_reach_gap(
    arm: SerialArm, poses: FloatArray, task: int, q: FloatArray
) -> tuple[float, int]:
    """Distance of the tool from the pose farthest out of reach [m], and the index of that pose.

    Both are 0 if all poses are in reach.
    """
    some = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MANY_POSES)).astype(np.intp))
    gaps = out_of_reach(arm, poses[some], task, q)
    more_seeds = np.concatenate([q, seeds(arm)[:REACH_SEEDS]])
    for i in np.argsort(-gaps)[:SOME_POSES]:
        # Another configuration may come nearer.
        gap = 0.0 if gaps[i] <= OUT_OF_REACH else _reach_gap(arm, poses[some[i]], task, more_seeds)
        if gap > OUT_OF_REACH:
            return gap, int(some[i])
    return 0.0, 0


def _refuse(
    path: Path,
    arm: SerialArm,
    knots: Knots,
    poses: FloatArray,
    task: int,
    failure: _Failure,
) -> None:
    """Raise Unreachable: where the solution that comes farthest ends, and for what reason."""
    s = np.append(knots.s0, path.length)
    i = failure.reached
    if failure.joint >= 0:
        also = f", and no other configuration of the arm {arm.name} comes farther"
        raise out_of_range(path, float(s[i]), failure.joint, failure.value, failure.limit, also)
    q = failure.q[None]
    gap, farthest = _largest_reach_gap(arm, poses[i:], task, q)
    if gap > OUT_OF_REACH:
        first = _find_end_of_reach(path, arm, knots, i - 1, task, q)
        worst = poses[i + farthest, :, 3]
        raise Unreachable(
            f"From {first:.6g} m of {path.length:.6g} m along the path it is out of reach of the "
            f"arm {arm.name}: at {tuple(np.round(worst, 6).tolist())} m, {s[i + farthest]:.6g} m "
            f"along it, the tool stays {gap:.3g} m away; {what_helps(path)}{unit_hint(gap)}.",
            s=first,
            point=worst.tolist(),
            limit="reach",
            needed=gap,
            allowed=0.0,
        )
    _refuse_singularity(path, arm, float(s[i - 1]), poses[i - 1], task, failure.q)


def _refuse_singularity(
    path: Path, arm: SerialArm, s: float, pose: FloatArray, task: int, q: FloatArray
) -> None:
    """Raise Unreachable for a singularity at arc length s, with the joint that moves most."""
    jacobian = arm.jacobian(q)
    angular = jacobian[3:] if task == 6 else pose[:, : task - 3].T @ jacobian[3:]
    _, sizes, motions = np.linalg.svd(np.concatenate([jacobian[:3], angular]))
    joint = int(np.argmax(np.abs(motions[task - 1])))
    raise Unreachable(
        f"After {s:.6g} m of {path.length:.6g} m along the path the arm {arm.name} comes "
        f"to a singularity, where joint {joint + 1} would have to move without bound (smallest "
        f"singular value {sizes[task - 1]:.2g}): {what_helps(path)}.",
        s=s,
        point=pose[:, 3].tolist(),
        joint=joint,
        limit="singularity",
    )


def _find_end_of_reach(
    path: Path, arm: SerialArm, knots: Knots, interval: int, task: int, q: FloatArray
) -> float:
    """Arc length at which the path leaves the reach of the arm, by bisection in an interval [m]."""
    one = knots.part(np.array([interval]))
    low, high = float(one.u0[0]), float(one.u1[0])
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        pose = poses_at(path, one, np.array([middle]))
        if out_of_reach(arm, pose, task, q)[0] > OUT_OF_REACH:
            high = middle
        else:
            low = middle
    return float(one.at(np.array([high]))[0])
