"""Messages that say why an arm cannot follow a path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import Unreachable
from armcontour.core.sampled_data import spread_indices
from armcontour.geometry import Path
from armcontour.planning.tracing.joint_ranges import out_of_range
from armcontour.planning.tracing.knots import OUT_OF_REACH, Knots, poses_at, suggest_remedy
from armcontour.robot import SerialArm
from armcontour.robot.arm import unit_hint
from armcontour.robot.inverse_kinematics import REACH_SEEDS, configurations, out_of_reach, seeds

# Number of poses, those farthest out of reach with one seed, that are searched with several seeds.
SOME_POSES = 10
# Number of poses of the path that are searched with one seed for poses out of reach.
MANY_POSES = 300
# Bisections for the arc length at which the reach ends.
REACH_BISECTIONS = 30


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
    _refuse_singularity(path, arm, float(s[i - 1]), poses[i - 1], task, failure.q)


def _refuse_singularity(
    path: Path, arm: SerialArm, s: float, pose: FloatArray, task: int, q: FloatArray
) -> None:
    """Raise Unreachable for the singularity after joint positions q [rad], (dof,), at s [m]."""
    _, sizes, motions = np.linalg.svd(_task_jacobian(arm, pose, task, q))
    joint = int(np.argmax(np.abs(motions[task - 1])))
    raise Unreachable(
        f"After {s:.6g} m of {path.length:.6g} m along the path the arm {arm.name} reaches a "
        f"singularity, at which joint {joint + 1} would need an unlimited velocity (smallest "
        f"singular value {sizes[task - 1]:.2g}). {suggest_remedy(path)}.",
        s=s,
        point=pose[:, 3].tolist(),
        joint=joint,
        limit="singularity",
    )


def _task_jacobian(arm: SerialArm, pose: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Return the derivative of the prescribed tool motion by the joints at q, (task, dof)."""
    jacobian = arm.jacobian(q)
    turning = jacobian[3:]
    if task == 4:
        revolute = np.flatnonzero(~arm.chain.slides)[0]
        turning = turning[:, revolute][None] @ turning
    elif task < 6:
        turning = pose[:, : task - 3].T @ turning
    return np.concatenate([jacobian[:3], turning])


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
