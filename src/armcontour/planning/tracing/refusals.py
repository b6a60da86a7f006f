"""Messages that say why an arm cannot follow a path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import Unreachable
from armcontour.core.render import number
from armcontour.core.sampled_data import spread_indices
from armcontour.core.text import capitalise
from armcontour.geometry import Path
from armcontour.planning.tracing.causes import (
    SINGULAR,
    Findings,
    Relaxation,
    Singularity,
    smallest_singular_value,
)
from armcontour.planning.tracing.joint_ranges import called, out_of_range
from armcontour.planning.tracing.knots import OUT_OF_REACH, Knots, poses_at, suggest_remedy
from armcontour.planning.tracing.positioner_tilt import tilt_of
from armcontour.planning.tracing.strained_postures import targets_at
from armcontour.robot import SerialArm
from armcontour.robot.arm import unit_hint
from armcontour.robot.inverse_kinematics import (
    REACH_SEEDS,
    configurations,
    out_of_reach,
    seeds,
    smallest_angle,
)

# Number of poses, those farthest out of reach with one seed, that are searched with several seeds.
SOME_POSES = 10
# Number of poses of the path that are searched with one seed for poses out of reach.
MANY_POSES = 300
# Bisections for the arc length at which the reach ends.
REACH_BISECTIONS = 30
# Angle from which the orientation of the tool is missed [rad].
MISSED_ANGLE = 1e-6
# Room that a recommended range has beyond what the path needs: as a fraction of the excess, and in
# degrees or centimetres.
ROOM = 0.05
ROOM_STEPS = 1.0
# The same room as a fraction of the recommended range, if the tilt of a positioner is limited.
# Tracing keeps joints away from the ends of their ranges (`INNER_RANGE`), and would exceed the tilt
# instead.
TILT_ROOM = 0.04
# Largest number of remedies in a message.
MOST_REMEDIES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Knot at which a solution ends, and the joint that leaves its range there, if any."""

    reached: int  # Index of the first knot that is not reached
    # Joint positions at the knot out of range; if the pose has no solution, at the previous knot
    # [rad], (dof,)
    q: FloatArray
    joint: int = -1  # Index of the joint that leaves its range; -1 if the pose has no solution
    value: float = 0.0  # Position of the joint that leaves its range [rad]
    limit: float = 0.0  # End of the range that this joint exceeds [rad]


def refuse_first_pose(
    path: Path, arm: SerialArm, poses: FloatArray, task: int, seed: FloatArray | None
) -> None:
    """Raise Unreachable with the reason why the first pose of the path has no solution."""
    if seed is not None:
        _refuse_seed(arm, poses[0], task, seed)
    point = poses[0, :, 3]
    gap = _reach_gap(arm, poses[0], task, seeds(arm)[:REACH_SEEDS])
    indices = spread_indices(len(poses), SOME_POSES)
    gaps = out_of_reach(arm, poses[indices], task, seeds(arm)[:REACH_SEEDS])
    worst = int(indices[np.argmax(gaps)])
    farthest = ""
    if worst > 0 and gaps.max() > gap:
        worst_point = tuple(np.round(poses[worst, :, 3], 6).tolist())
        farthest = f" (at most {gaps.max():.3g} m on the path, at {worst_point} m)"
    if gaps.max() <= OUT_OF_REACH and gap <= OUT_OF_REACH:
        _refuse_posture(path, arm, poses[0], task)
    raise Unreachable(
        f"At 0 m along the path the arm {arm.name} cannot reach the position "
        f"{tuple(np.round(point, 6).tolist())} m with the required tool orientation. The tool "
        f"stays {gap:.3g} m away{farthest}. {suggest_remedy(path)}{unit_hint(gap)}.",
        point=point.tolist(),
        s=0.0,
        limit="reach",
        needed=gap,
        allowed=0.0,
    )


def _refuse_posture(path: Path, arm: SerialArm, pose: FloatArray, task: int) -> NoReturn:
    """Raise Unreachable for a first pose whose position is in reach, but which has no posture."""
    angle = smallest_angle(arm, pose, task, seeds(arm)[:REACH_SEEDS])
    place = f"At 0 m along the path, at {tuple(np.round(pose[:, 3], 6).tolist())} m,"
    words = f"no posture of the arm {arm.name} keeps the ranges of its joints"
    if angle > MISSED_ANGLE:
        turned = "axis" if task == 5 else "orientation"
        words = (
            f"the arm {arm.name} reaches the position, but the tool's {turned} stays "
            f"{number(angle, 'rad')} away from the required one"
        )
    raise Unreachable(
        f"{place} {words}. {suggest_remedy(path)}.",
        point=pose[:, 3].tolist(),
        s=0.0,
        limit="orientation" if angle > MISSED_ANGLE else "range",
        needed=angle,
        allowed=0.0,
    )


def _refuse_seed(arm: SerialArm, pose: FloatArray, task: int, seed: FloatArray) -> None:
    """Raise Unreachable with the solution nearest to the seed, if the first pose has solutions."""
    solutions = configurations(arm, pose, task)
    if len(solutions) == 0:
        return
    difference = seed - solutions
    turns = np.where(arm.chain.slides, 0.0, np.round(difference / (2 * np.pi)))
    difference = np.abs(difference - 2 * np.pi * turns).max(axis=1)
    nearest = solutions[np.argmin(difference)]
    point = pose[:, 3]
    raise Unreachable(
        f"From the given seed, the arm {arm.name} does not reach the tool pose at the start of "
        f"the path, {tuple(np.round(point, 6).tolist())} m. Specify a seed closer to joint "
        f"positions that reach this pose, such as {tuple(np.round(nearest, 4).tolist())} "
        f"{arm.chain.unit('rad')}.",
        point=point.tolist(),
        s=0.0,
        limit="seed",
        needed=float(difference.min()),
    )


def _reach_gap(arm: SerialArm, pose: FloatArray, task: int, q: FloatArray) -> float:
    """Return the tool's smallest distance from a pose [m], by damped steps from positions q."""
    return float(out_of_reach(arm, pose[None], task, q)[0])


def _largest_reach_gap(
    arm: SerialArm, poses: FloatArray, task: int, q: FloatArray
) -> tuple[float, int]:
    """Return distance from the tool [m] and index of the pose farthest out of reach, or 0, 0."""
    indices = spread_indices(len(poses), MANY_POSES)
    gaps = out_of_reach(arm, poses[indices], task, q)
    more_seeds = np.concatenate([q, seeds(arm)[:REACH_SEEDS]])
    for i in np.argsort(-gaps)[:SOME_POSES]:
        # Another configuration may be closer to the pose.
        gap = (
            0.0 if gaps[i] <= OUT_OF_REACH else _reach_gap(arm, poses[indices[i]], task, more_seeds)
        )
        if gap > OUT_OF_REACH:
            return gap, int(indices[i])
    return 0.0, 0


def refuse_path(
    path: Path, arm: SerialArm, knots: Knots, poses: FloatArray, task: int, failure: Failure
) -> None:
    """Raise Unreachable with the cause that ends the solution that follows the path farthest."""
    s = np.append(knots.s0, path.length)
    i = failure.reached
    if failure.joint >= 0:
        also = f", and no other configuration of the arm {arm.name} reaches farther"
        outside = failure.joint, failure.value, failure.limit
        raise out_of_range(path, arm, float(s[i]), *outside, also)
    q = failure.q[None]
    gap, farthest = _largest_reach_gap(arm, poses[i:], task, q)
    if gap > OUT_OF_REACH:
        first = _find_end_of_reach(path, arm, knots, i - 1, task, q)
        worst = poses[i + farthest, :, 3]
        raise Unreachable(
            f"From {first:.6g} m of {path.length:.6g} m along the path, the path is out of reach "
            f"of the arm {arm.name}. At {tuple(np.round(worst, 6).tolist())} m, "
            f"{s[i + farthest]:.6g} m along the path, the tool stays {gap:.3g} m away. "
            f"{suggest_remedy(path)}{unit_hint(gap)}.",
            s=first,
            point=worst.tolist(),
            limit="reach",
            needed=gap,
            allowed=0.0,
        )
    refuse_stop(path, arm, float(s[i - 1]), task, [failure.q])


def refuse_stop(
    path: Path, arm: SerialArm, s: float, task: int, postures: Sequence[FloatArray]
) -> NoReturn:
    """Raise Unreachable for a path in reach that a joint path does not follow on.

    - `s`: arc length [m] at which the joint path ends.
    - `postures`: joint positions near this place [rad], (dof,) each.
    """
    pose = targets_at(path, np.array([s]))[0]
    value, joint = min(smallest_singular_value(arm, pose, task, q) for q in postures)
    if value <= SINGULAR:
        place = Singularity(s=s, joint=joint, value=value)
        raise singular(path, arm, place, suggest_remedy(path))
    raise Unreachable(
        f"At {s:.6g} m of {path.length:.6g} m along the path, no continuous motion of the arm "
        f"{arm.name} was found, though each pose is within reach and the arm is not singular "
        f"(smallest singular value {value:.2g}). {suggest_remedy(path)}.",
        s=s,
        point=pose[:, 3].tolist(),
        limit="continuity",
    )


def singular(path: Path, arm: SerialArm, place: Singularity, remedy: str) -> Unreachable:
    """Make the error for a singularity on the path, with a remedy without a period."""
    return Unreachable(
        f"At {place.s:.6g} m of {path.length:.6g} m along the path the arm {arm.name} reaches a "
        f"singularity, at which {_named(arm, place.joint)} would need an unlimited velocity "
        f"(smallest singular value {place.value:.2g}). {remedy}.",
        s=place.s,
        point=path(place.s).tolist(),
        joint=place.joint,
        limit="singularity",
    )


@contextmanager
def numbered_as(arm: SerialArm) -> Iterator[None]:
    """Number joints as in the whole arm in errors about the arm without its held joints."""
    try:
        yield
    except Unreachable as error:
        moving = np.setdiff1d(np.arange(arm.dof), list(arm.chain.held))
        if error.joint is None or len(moving) == arm.dof:
            raise
        joint = int(moving[error.joint])
        name = arm.joint_names[joint]
        message = str(error).replace(called(error.joint, name), called(joint, name))
        numbered = Unreachable(message)
        vars(numbered).update(vars(error) | {"joint": joint})
        raise numbered from None


def has_other_cause(error: Unreachable, arm: SerialArm) -> bool:
    """Test whether a range, a held axis, the tilt or a singularity may be the cause of an error."""
    # The search for a pose out of reach ignores ranges.
    return bool(arm.chain.held) or not _is_far(error)


def _is_far(error: Unreachable) -> bool:
    """Test whether an error states that a position is out of reach."""
    return error.limit == "reach" and (error.needed or 0.0) > OUT_OF_REACH


def name_cause(error: Unreachable, findings: Findings, path: Path, arm: SerialArm) -> Unreachable:
    """Return the error with the true cause, if one was found, by which a path is refused.

    - `arm`: the arm with its held joints.
    """
    if findings.singularity is not None:
        if not findings.relaxations:
            return singular(path, arm, findings.singularity, suggest_remedy(path))
        return singular(path, arm, findings.singularity, _remedies(arm, findings.relaxations))
    if findings.relaxations and findings.relaxations[0].kind != "rotation":
        return needs_one(path, arm, findings.relaxations)
    if _is_far(error) or not findings.strained:
        return error
    return needs_all(path, arm, findings.strained)


def needs_one(path: Path, arm: SerialArm, relaxations: Sequence[Relaxation]) -> Unreachable:
    """Make the error for a path that any one of the relaxations makes feasible."""
    return _refusal(path, arm, relaxations, _remedies(arm, relaxations))


def needs_all(path: Path, arm: SerialArm, strained: Sequence[Relaxation]) -> Unreachable:
    """Make the error for a path that needs all of several relaxations."""
    remedy = "Move the path or the arm"
    if len(strained) > 1:
        also = _excesses(arm, strained[1 : MOST_REMEDIES + 1])
        remedy = f"Others exceed their limits as well: {also}. {remedy}"
    return _refusal(path, arm, strained, remedy)


def _remedies(arm: SerialArm, relaxations: Sequence[Relaxation]) -> str:
    """Return what makes the path feasible, as a sentence without a period."""
    tried = list(dict.fromkeys(_remedy(arm, x) for x in relaxations))[:MOST_REMEDIES]
    return f"{capitalise(', or '.join(tried))}, or move the path or the arm"


def _excesses(arm: SerialArm, causes: Sequence[Relaxation]) -> str:
    """Return by how much several ranges, or the tilt, are exceeded."""
    parts = []
    for cause in causes:
        name = "the tilt" if cause.kind == "tilt" else _named(arm, cause.joint)
        unit = "rad" if cause.kind == "tilt" else arm.chain.unit("rad", cause.joint)
        excess = number(abs(cause.needed - cause.allowed), unit)
        parts.append(f"{name} by {excess}")
    return ", ".join(parts)


def _refusal(
    path: Path, arm: SerialArm, relaxations: Sequence[Relaxation], remedy: str
) -> Unreachable:
    """Make the error for the first of several relaxations, with a remedy without a period."""
    first = relaxations[0]
    limit = first.kind
    if first.kind == "range":
        limit = "joint_upper" if first.needed > first.allowed else "joint_lower"
    return Unreachable(
        f"{_describe(path, arm, relaxations)}. {remedy}.",
        s=first.s,
        point=path(first.s).tolist(),
        joint=first.joint if first.joint >= 0 else None,
        limit=limit,
        needed=first.needed,
        allowed=first.allowed,
    )


def _named(arm: SerialArm, joint: int) -> str:
    """Return number and name of a joint for messages."""
    return called(joint, arm.joint_names[joint])


def _describe(path: Path, arm: SerialArm, relaxations: Sequence[Relaxation]) -> str:
    """Describe the first of several relaxations in a sentence without a period."""
    cause = relaxations[0]
    place = f"At {cause.s:.6g} m of {path.length:.6g} m along the path"
    if cause.kind == "tilt":
        return (
            f"{place} the tool axis would be at least {number(cause.needed, 'rad')} from gravity, "
            f"but the tilt of the positioner allows at most {number(cause.allowed, 'rad')}"
        )
    unit = arm.chain.unit("rad", cause.joint)
    name = _named(arm, cause.joint)
    if cause.kind == "hold":
        words = (
            f"{place} {name} would have to be at {number(cause.needed, unit)}, but the preference "
            f"`hold` keeps it at {number(cause.allowed, unit)}"
        )
        for tilt in relaxations:
            if tilt.kind == "tilt":
                words += (
                    f", where the tool axis is up to {number(tilt.needed, 'rad')} from gravity "
                    f"(the tilt of the positioner allows {number(tilt.allowed, 'rad')})"
                )
        return words
    end = "upper" if cause.needed > cause.allowed else "lower"
    words = (
        f"{place} {name} would have to be at {number(cause.needed, unit)}, "
        f"{number(abs(cause.needed - cause.allowed), unit)} beyond its {end} limit of "
        f"{number(cause.allowed, unit)}"
    )
    if cause.allowed in arm.chain.ranges.get(cause.joint, ()):
        words += " (preference `range`)"
    if cause.travel > cause.width:
        words += (
            f", because it moves over {number(cause.travel, unit)} and its range is only "
            f"{number(cause.width, unit)} wide"
        )
    elif cause.s_first < cause.s:
        words += f"; it leaves its range at {cause.s_first:.6g} m"
    return words


def _remedy(arm: SerialArm, cause: Relaxation) -> str:
    """Return the instruction that applies a relaxation, in lower case."""
    if cause.kind == "rotation":
        return "leave the rotation about the tool axis free"
    if cause.kind == "tilt":
        largest = _above(cause.needed - cause.allowed, cause.allowed, "rad")
        return f"specify a tilt of at least {largest}"
    name = _named(arm, cause.joint)
    if cause.kind == "hold":
        return f"do not hold {' and '.join(_named(arm, k) for k in cause.together)}"
    unit = arm.chain.unit("rad", cause.joint)
    least = min(cause.least, cause.lower)
    most = max(cause.most, cause.upper)
    room = 0.0 if tilt_of(arm.chain) is None else TILT_ROOM * (most - least)
    ends = []
    if least < cause.lower:
        ends.append(_above(least - cause.lower, cause.lower, unit, room))
    if most > cause.upper:
        ends.append(_above(most - cause.upper, cause.upper, unit, room))
    return f"let {name} move to {' and to '.join(ends)}"


def _above(excess: float, end: float, unit: str, room: float = 0.0) -> str:
    """Write the end of a range [rad] that allows an excess with some room, in whole units.

    - `room`: least room [rad].
    """
    step, scale, shown = (np.pi / 180, 180 / np.pi, "deg") if unit == "rad" else (0.01, 1e3, "mm")
    room = max(room, ROOM * abs(excess) + ROOM_STEPS * step)
    value = end + np.copysign(abs(excess) + room, excess)
    rounded = np.copysign(np.ceil(abs(value) / step), value)
    if value * excess < 0:
        rounded = np.copysign(np.floor(abs(value) / step), value)
    return f"{rounded * step * scale:.10g} {shown}"


def _find_end_of_reach(
    path: Path, arm: SerialArm, knots: Knots, interval: int, task: int, q: FloatArray
) -> float:
    """Find the arc length at which the path leaves the arm's reach, by bisection [m]."""
    one = knots.part(np.array([interval]))
    low, high = float(one.u0[0]), float(one.u1[0])
    for _ in range(REACH_BISECTIONS):
        middle = (low + high) / 2
        pose = poses_at(path, one, np.array([middle]))
        if out_of_reach(arm, pose, task, q)[0] > OUT_OF_REACH:
            high = middle
        else:
            low = middle
    return float(one.arc_lengths(np.array([high]))[0])
