"""The ways an arm in space can take along a path: one for each configuration that it starts in."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.arms import SerialArm, _newton
from armcontour.arms.inverse import configurations, out_of_reach, seeds
from armcontour.errors import Unreachable
from armcontour.geometry import Path
from armcontour.tracing.knots import Knots
from armcontour.tracing.poses import poses_at, row_of_poses, what_helps
from armcontour.tracing.ranges import out_of_range
from armcontour.tracing.redundancy import null_space, smooth

# With joints to spare, so many starts are followed, and so many different ways are kept.
MOST_STARTS = 48
MOST_SOLUTIONS = 8
# Ways with joints to spare are one that nowhere differ by more than this [rad], free motions apart.
SAME_WAY = 0.05
# Ways with joints to spare are ranked after this many rounds of smoothing on so many knots.
ROUGH_ROUNDS = 3
ROUGH_KNOTS = 70
# So many of them are then smoothed to the end, or more until one is found.
MOST_SMOOTHED = 16
# Following goes along chords; the path turns by no more than this under one [rad].
CHORD_TURN = 0.1
# Where a joint leaves its range, it is looked at so many whole turns either way.
MOST_TURNS = 5
# A pose that stays farther away than this is out of reach [m].
OUT_OF_REACH = 1e-7
# Looked for from so many joint positions, at so many places of a path; from one, at more.
REACH_SEEDS = 60
SOME_POSES = 10
MANY_POSES = 300
# Bisections for the place where the reach ends.
BISECTIONS = 30


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Joint positions along a path.

    Args:
        q: At the starts of all knot intervals and the end of the last, (n + 1, dof).
        cost: How long the way is; ways are compared by it until they are timed.
    """

    q: FloatArray
    cost: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Failure:
    """Why a way ends: where, and of which joint a range, if it was one."""

    reached: int
    q: FloatArray
    joint: int = -1
    value: float = 0.0
    limit: float = 0.0


def find_solutions(
    path: Path, arm: SerialArm, knots: Knots, task: int, start: FloatArray | None
) -> list[Solution]:
    """All ways that complete the path inside the joints' ranges, the shortest first.

    Args:
        path: The path.
        arm: The arm.
        knots: Intervals of the path.
        task: How much of each pose counts.
        start: Joint positions near to those to start in; None for all that there are.

    Raises:
        Unreachable: There is none; says why for the one that comes farthest.
    """
    fine, at = _finer(path, knots)
    poses, s = row_of_poses(path, fine), np.append(fine.s0, path.length)
    starts = configurations(arm, poses[0], task, start)
    if len(starts) == 0:
        _refuse_start(path, arm, poses, task, start)
    followed, failures = _follow(arm, poses, task, starts[:MOST_STARTS])
    followed = [q[at] for q in followed]
    s, some = s[at], poses[at]
    spare = task < arm.dof
    if spare:
        followed = _most_promising(arm, s, some, task, followed, start)
    found: list[Solution] = []
    for i, q in enumerate(followed):
        if spare and found and i >= MOST_SMOOTHED:
            break
        cost = 0.0 if spare else _joint_distance(arm, q)
        if spare:
            q, cost = smooth(arm, s, some, task, q, start_stays=start is not None)
        fitted = _in_range(arm, q, start)
        if isinstance(fitted, _Failure):
            failures.append(dataclasses.replace(fitted, reached=int(at[fitted.reached])))
        elif not any(_same(arm, some, task, x.q, fitted) for x in found):
            found.append(Solution(q=fitted, cost=cost))
    if not found:
        _refuse(path, arm, fine, poses, task, max(failures, key=lambda x: x.reached))
    found.sort(key=lambda x: x.cost)
    return found[:MOST_SOLUTIONS] if spare else found


def _follow(
    arm: SerialArm, poses: FloatArray, task: int, starts: FloatArray
) -> tuple[list[FloatArray], list[_Failure]]:
    """Joint positions along all poses, from each start that leads to the end; and the others."""
    followed: list[FloatArray] = []
    failures: list[_Failure] = []
    for q0 in starts:
        q = np.empty((len(poses), arm.dof))
        q[0] = q0
        reached = _newton.follow(*arm.arrays, poses, task, q)
        if reached < len(poses):
            failures.append(_Failure(reached=reached, q=q[reached - 1]))
        else:
            followed.append(q)
    return followed, failures


def _most_promising(
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    followed: list[FloatArray],
    start: FloatArray | None,
) -> list[FloatArray]:
    """The same ways by what a few rounds of smoothing on a part of the knots make of their cost."""
    few = np.unique(np.linspace(0, len(s) - 1, min(len(s), ROUGH_KNOTS)).astype(np.intp))
    ranked = []
    for q in followed:
        shifted = _shift_by_turns(arm, q)
        rough, cost = smooth(
            arm,
            s[few],
            poses[few],
            task,
            shifted[few],
            start_stays=start is not None,
            rounds=ROUGH_ROUNDS,
        )
        ranked.append((cost, shifted if len(few) < len(s) else rough))
    ranked.sort(key=lambda x: x[0])
    first: list[FloatArray] = []
    again: list[FloatArray] = []
    for _, q in ranked:
        known = any(_same(arm, poses[: len(q)], task, x, q) for x in first)
        (again if known else first).append(q)
    return first + again


def _same(arm: SerialArm, poses: FloatArray, task: int, a: FloatArray, b: FloatArray) -> bool:
    """Whether two ways differ by nothing, or by a motion that the tool is free to make anyway."""
    apart = b - a
    if task == arm.dof:
        return bool(np.abs(apart).max() < SAME_WAY)
    apart = np.pi - np.mod(np.pi - apart, 2 * np.pi)
    w = null_space(arm, poses, task, a)
    rest = apart - np.einsum("nik,nij,nj->nk", w, w, apart)
    return bool(np.abs(rest).max() < SAME_WAY * max(1.0, float(np.abs(apart).max())))


def _finer(path: Path, knots: Knots) -> tuple[Knots, IntArray]:
    """Intervals on which a chord is near to the path, and where the knots are among their ends."""
    poses = row_of_poses(path, knots)
    width = knots.u1 - knots.u0
    turn = np.maximum(
        width * path.curvatures[knots.segment],
        np.linalg.norm(np.diff(poses[:, :, :3], axis=0), axis=(1, 2)) / np.sqrt(2),
    )
    count = np.maximum(1, np.ceil(turn / CHORD_TURN)).astype(np.intp)
    at = np.concatenate([[0], np.cumsum(count)])
    of = np.repeat(np.arange(len(knots)), count)
    number = np.arange(at[-1]) - at[of]
    ahead = width[of] * (number / count[of])
    after = width[of] * ((number + 1) / count[of])
    u0 = knots.u0[of]
    found = Knots(
        segment=knots.segment[of],
        piece=knots.piece[of],
        u0=u0 + ahead,
        u1=u0 + after,
        s0=knots.s0[of] + ahead,
    )
    return found, at


def _joint_distance(arm: SerialArm, q: FloatArray) -> float:
    """Time that the slowest joint takes at its largest velocity, without anything else [s]."""
    velocity = arm.limits.joint_velocity
    steps = np.abs(np.diff(q, axis=0)) / (1.0 if velocity is None else velocity)
    return float(steps.max(axis=1).sum())


def _shift_by_turns(arm: SerialArm, q: FloatArray) -> FloatArray:
    """The same positions, by whole turns as near to the middle of the joints' ranges as can be.

    Where that leaves a range with one end only, away from that end.
    """
    lower, upper = arm.limits.joint_range(arm.dof)
    ranged = np.isfinite(lower) & np.isfinite(upper)
    middle = np.where(
        ranged, np.where(ranged, lower, 0.0) / 2 + np.where(ranged, upper, 0.0) / 2, 0
    )
    low, high = q.min(axis=0), q.max(axis=0)
    turns = np.round((middle - (low + high) / 2) / (2 * np.pi))
    least = np.ceil((np.where(ranged, -np.inf, lower) - low) / (2 * np.pi))
    most = np.floor((np.where(ranged, np.inf, upper) - high) / (2 * np.pi))
    return np.asarray(q + 2 * np.pi * np.clip(turns, least, most))


def _in_range(arm: SerialArm, q: FloatArray, start: FloatArray | None) -> FloatArray | _Failure:
    """The same positions, by whole turns inside the joints' ranges, or where they leave them.

    With a start given, the positions next to it are the first choice.
    """
    lower, upper = arm.limits.joint_range(arm.dof)
    wanted = _shift_by_turns(arm, q)
    if start is not None:
        near = q + 2 * np.pi * np.round((start - q[0]) / (2 * np.pi))
        fits = (near.min(axis=0) >= lower) & (near.max(axis=0) <= upper)
        wanted = np.where(fits, near, wanted)
    below, above = wanted < lower, wanted > upper
    outside = (below | above).any(axis=1)
    if not outside.any():
        return wanted
    # Of all whole turns, those with which each joint comes farthest along the path, and of these
    # the one with which it is least beyond its range where it ends.
    wanted = wanted.copy()
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
    """Say why the tool cannot be held at the start of the path.

    Raises:
        Unreachable: Always.
    """
    point = poses[0, :, 3]
    place = tuple(np.round(point, 6).tolist())
    known = configurations(arm, poses[0], task)
    if start is not None and len(known):
        off = start - known
        off = np.abs(off - 2 * np.pi * np.round(off / (2 * np.pi))).max(axis=1)
        nearest = known[np.argmin(off)]
        raise Unreachable(
            f"From the given start the arm {arm.name} does not come to hold its tool as asked at "
            f"the beginning of the path, {place} m; give a start nearer to joint positions that "
            f"do, such as {tuple(np.round(nearest, 4).tolist())} rad.",
            point=point.tolist(),
            s=0.0,
            limit="start",
            needed=float(off.min()),
        )
    gap = _lack(arm, poses[0], task, seeds(arm)[:REACH_SEEDS])
    some = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), SOME_POSES)).astype(np.intp))
    lacks = out_of_reach(arm, poses[some], task, seeds(arm)[:REACH_SEEDS])
    worst = int(some[np.argmax(lacks)])
    more = ""
    if worst > 0 and lacks.max() > gap:
        there = tuple(np.round(poses[worst, :, 3], 6).tolist())
        more = f" (the path's worst place, {there} m, by {lacks.max():.3g} m)"
    raise Unreachable(
        f"At 0 m along the path the tool of the arm {arm.name} cannot be held as asked at "
        f"{place} m: it stays {gap:.3g} m away{more}; {what_helps(path)}.",
        point=point.tolist(),
        s=0.0,
        limit="reach",
        needed=gap,
        allowed=0.0,
    )


def _lack(arm: SerialArm, pose: FloatArray, task: int, q: FloatArray) -> float:
    return float(out_of_reach(arm, pose[None], task, q)[0])


def _worst_lack(arm: SerialArm, poses: FloatArray, task: int, q: FloatArray) -> tuple[float, int]:
    """How far the tool stays from the pose that is farthest out of reach, and which it is."""
    some = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MANY_POSES)).astype(np.intp))
    lacks = out_of_reach(arm, poses[some], task, q)
    widely = np.concatenate([q, seeds(arm)[:REACH_SEEDS]])
    for i in np.argsort(-lacks)[:SOME_POSES]:
        # Another configuration may come nearer.
        lack = 0.0 if lacks[i] <= OUT_OF_REACH else _lack(arm, poses[some[i]], task, widely)
        if lack > OUT_OF_REACH:
            return lack, int(some[i])
    return 0.0, 0


def _refuse(
    path: Path,
    arm: SerialArm,
    knots: Knots,
    poses: FloatArray,
    task: int,
    failure: _Failure,
) -> None:
    """Say where the way that comes farthest ends, and why.

    Raises:
        Unreachable: Always.
    """
    s = np.append(knots.s0, path.length)
    i = failure.reached
    if failure.joint >= 0:
        also = f", and no other configuration of the arm {arm.name} comes farther"
        raise out_of_range(path, float(s[i]), failure.joint, failure.value, failure.limit, also)
    q = failure.q[None]
    lack, where = _worst_lack(arm, poses[i:], task, q)
    if lack > OUT_OF_REACH:
        first = _end_of_reach(path, arm, knots, i - 1, task, q)
        worst = poses[i + where, :, 3]
        raise Unreachable(
            f"From {first:.6g} m of {path.length:.6g} m along the path it is out of reach of the "
            f"arm {arm.name}: at {tuple(np.round(worst, 6).tolist())} m, {s[i + where]:.6g} m "
            f"along it, the tool stays {lack:.3g} m away; {what_helps(path)}.",
            s=first,
            point=worst.tolist(),
            limit="reach",
            needed=lack,
            allowed=0.0,
        )
    jacobian = arm.twist_jacobian(failure.q)
    turning = jacobian[3:] if task == 6 else poses[i - 1, :, : task - 3].T @ jacobian[3:]
    _, sizes, motions = np.linalg.svd(np.concatenate([jacobian[:3], turning]))
    joint = int(np.argmax(np.abs(motions[task - 1])))
    raise Unreachable(
        f"After {s[i - 1]:.6g} m of {path.length:.6g} m along the path the arm {arm.name} comes "
        f"to a singularity, where joint {joint + 1} would have to move without bound (smallest "
        f"singular value {sizes[task - 1]:.2g}): {what_helps(path)}.",
        s=float(s[i - 1]),
        point=poses[i - 1, :, 3].tolist(),
        joint=joint + 1,
        limit="singularity",
    )


def _end_of_reach(
    path: Path, arm: SerialArm, knots: Knots, interval: int, task: int, q: FloatArray
) -> float:
    """Arc length at which an interval leaves the reach."""
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
