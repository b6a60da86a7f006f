"""The ways an arm in space can take along a path: one for each configuration that it starts in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm, _newton
from armcontour.arms.inverse import configurations, out_of_reach, seeds
from armcontour.errors import Unreachable
from armcontour.geometry import Path
from armcontour.tracing.cells import Knots
from armcontour.tracing.guide import smoothed
from armcontour.tracing.poses import poses_at

# With joints to spare, so many starts are followed, and so many different ways are kept.
MOST_STARTS = 48
MOST_WAYS = 6
# Ways with joints to spare that nowhere differ by more than this are one [rad].
SAME_WAY = 0.05
# A pose that stays farther away than this is out of reach [m].
OUT_OF_REACH = 1e-7
# Bisections for the place where the reach ends.
BISECTIONS = 30


@dataclass(frozen=True, slots=True)
class Way:
    """Joint positions along a path.

    Args:
        q: At the starts of all knot intervals and the end of the last, (n + 1, dof).
        cost: How long the way is; ways are compared by it until they are timed.
    """

    q: FloatArray
    cost: float


@dataclass(frozen=True, slots=True)
class _Failure:
    """Why a way ends: where, and of which joint a range, if it was one."""

    reached: int
    q: FloatArray
    joint: int = -1
    value: float = 0.0
    limit: float = 0.0


def ways(
    path: Path, arm: SerialArm, knots: Knots, asked: int, start: FloatArray | None
) -> list[Way]:
    """All ways that complete the path inside the joints' ranges, the shortest first.

    Args:
        path: The path.
        arm: The arm.
        knots: Intervals of the path.
        asked: How much of each pose counts.
        start: Joint positions near to those to start in; None for all that there are.

    Raises:
        Unreachable: There is none; says why for the one that comes farthest.
    """
    poses = _row_of_poses(path, knots)
    s = np.append(knots.s0, path.length)
    starts = configurations(arm, poses[0], asked, start)
    if len(starts) == 0:
        _refuse_start(path, arm, poses, asked)
    found: list[Way] = []
    failures: list[_Failure] = []
    for q0 in starts[:MOST_STARTS]:
        q = np.empty((len(poses), arm.dof))
        q[0] = q0
        reached = _newton.follow(*arm.arrays, poses, asked, q)
        if reached < len(poses):
            failures.append(_Failure(reached, q[reached - 1]))
            continue
        if asked < arm.dof:
            q, cost = smoothed(arm, s, poses, asked, _shifted(arm, q))
        else:
            cost = _way(arm, q)
        fitted = _in_range(arm, q, start)
        if isinstance(fitted, _Failure):
            failures.append(fitted)
        elif not any(np.abs(fitted - x.q).max() < SAME_WAY for x in found):
            found.append(Way(fitted, cost))
    if not found:
        _refuse(path, arm, knots, poses, asked, max(failures, key=lambda x: x.reached))
    found.sort(key=lambda x: x.cost)
    return found[:MOST_WAYS] if asked < arm.dof else found


def _row_of_poses(path: Path, knots: Knots) -> FloatArray:
    last = knots.part(np.array([len(knots) - 1]))
    return np.concatenate([poses_at(path, knots, knots.u0), poses_at(path, last, last.u1)])


def _way(arm: SerialArm, q: FloatArray) -> float:
    """Time that the slowest joint takes at its largest velocity, without anything else [s]."""
    velocity = arm.limits.joint_velocity
    steps = np.abs(np.diff(q, axis=0)) / (1.0 if velocity is None else velocity)
    return float(steps.max(axis=1).sum())


def _shifted(arm: SerialArm, q: FloatArray) -> FloatArray:
    """The same positions, by whole turns as near to the middle of the joints' ranges as can be."""
    lower, upper = arm.limits.joint_range(arm.dof)
    ranged = np.isfinite(lower) & np.isfinite(upper)
    middle = np.where(ranged, lower / 2 + upper / 2, 0.0)
    own = (q.min(axis=0) + q.max(axis=0)) / 2
    return np.asarray(q + 2 * np.pi * np.round((middle - own) / (2 * np.pi)))


def _in_range(arm: SerialArm, q: FloatArray, start: FloatArray | None) -> FloatArray | _Failure:
    """The same positions, by whole turns inside the joints' ranges, or where they leave them.

    With a start given, the positions next to it are the first choice.
    """
    lower, upper = arm.limits.joint_range(arm.dof)
    wanted = _shifted(arm, q)
    if start is not None:
        near = q + 2 * np.pi * np.round((start - q[0]) / (2 * np.pi))
        fits = (near.min(axis=0) >= lower) & (near.max(axis=0) <= upper)
        wanted = np.where(fits, near, wanted)
    below, above = wanted < lower, wanted > upper
    outside = (below | above).any(axis=1)
    if not outside.any():
        return wanted
    # Of all whole turns, the one with which the joint comes farthest along the path.
    row = int(np.argmax(outside))
    joint = int(np.argmax((below | above)[row]))
    for turn in (-2 * np.pi, 2 * np.pi):
        other = wanted.copy()
        other[:, joint] += turn
        off = ((other < lower) | (other > upper)).any(axis=1)
        if off.any() and int(np.argmax(off)) > row:
            row, wanted = int(np.argmax(off)), other
    below, above = wanted < lower, wanted > upper
    joint = int(np.argmax((below | above)[row]))
    limit = float(lower[joint] if below[row, joint] else upper[joint])
    return _Failure(row, wanted[row], joint, float(wanted[row, joint]), limit)


def _refuse_start(path: Path, arm: SerialArm, poses: FloatArray, asked: int) -> None:
    lack, where = _worst_lack(arm, poses, asked, seeds(arm)[:60])
    point = poses[0, :, 3]
    more = ""
    if where > 0:
        place = tuple(np.round(poses[where, :, 3], 6).tolist())
        more = f" (the path's worst place, {place} m, by {lack:.3g} m)"
    gap = float(out_of_reach(arm, poses[:1], asked, seeds(arm)[:60])[0])
    raise Unreachable(
        f"At 0 m along the path the tool of the arm {arm.name} cannot be held as asked at "
        f"{tuple(np.round(point, 6).tolist())} m: it stays {gap:.3g} m away{more}; move the path "
        "or the arm, or leave turning about the tool axis free.",
        point=point.tolist(),
        s=0.0,
        limit="reach",
        needed=gap,
        allowed=0.0,
    )


def _worst_lack(arm: SerialArm, poses: FloatArray, asked: int, q: FloatArray) -> tuple[float, int]:
    lacks = out_of_reach(arm, poses, asked, q)
    return float(lacks.max()), int(lacks.argmax())


def _refuse(
    path: Path,
    arm: SerialArm,
    knots: Knots,
    poses: FloatArray,
    asked: int,
    failure: _Failure,
) -> None:
    """Say where the way that comes farthest ends, and why.

    Raises:
        Unreachable: Always.
    """
    s = np.append(knots.s0, path.length)
    i = failure.reached
    if failure.joint >= 0:
        point = poses[i, :, 3].tolist()
        beyond = abs(failure.value - failure.limit)
        raise Unreachable(
            f"At {s[i]:.6g} m of {path.length:.6g} m along the path joint {failure.joint + 1} of "
            f"the arm {arm.name} would be at {failure.value:.4g} rad, {beyond:.3g} rad beyond the "
            f"end of its range at {failure.limit:.4g} rad, and no other configuration comes "
            "farther: move the path or the arm, or leave turning about the tool axis free.",
            s=float(s[i]),
            point=point,
            joint=failure.joint + 1,
            limit="joint range",
            needed=failure.value,
            allowed=failure.limit,
        )
    q = failure.q[None]
    lack, where = _worst_lack(arm, poses[i:], asked, q)
    if lack > OUT_OF_REACH:
        first = _end_of_reach(path, arm, knots, i - 1, asked, q)
        worst = poses[i + where, :, 3]
        raise Unreachable(
            f"From {first:.6g} m of {path.length:.6g} m along the path it is out of reach of the "
            f"arm {arm.name}: at {tuple(np.round(worst, 6).tolist())} m, {s[i + where]:.6g} m "
            f"along it, the tool stays {lack:.3g} m away; move the path or the arm.",
            s=first,
            point=worst.tolist(),
            limit="reach",
            needed=lack,
            allowed=0.0,
        )
    weak = np.linalg.svd(arm.twist_jacobian(failure.q))
    joint = int(np.argmax(np.abs(weak[2][min(asked, arm.dof) - 1])))
    raise Unreachable(
        f"Behind {s[i - 1]:.6g} m of {path.length:.6g} m along the path the arm {arm.name} comes "
        f"to a singularity, where joint {joint + 1} would have to move without bound (smallest "
        f"singular value {weak[1][min(asked, arm.dof) - 1]:.2g}): move the path or the arm, or "
        "leave turning about the tool axis free.",
        s=float(s[i - 1]),
        point=poses[i - 1, :, 3].tolist(),
        joint=joint + 1,
        limit="singularity",
    )


def _end_of_reach(
    path: Path, arm: SerialArm, knots: Knots, interval: int, asked: int, q: FloatArray
) -> float:
    """Arc length at which an interval leaves the reach."""
    one = knots.part(np.array([interval]))
    low, high = float(one.u0[0]), float(one.u1[0])
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        pose = poses_at(path, one, np.array([middle]))
        if out_of_reach(arm, pose, asked, q)[0] > OUT_OF_REACH:
            high = middle
        else:
            low = middle
    return float(one.at(np.array([high]))[0])
