"""Inverse kinematics of serial arms: closed form for most six-joint arms, otherwise a search."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, Unreachable
from armcontour.core.frames import IDENTITY, Pose, read_poses
from armcontour.core.pool import map_in_threads, split_evenly
from armcontour.robot import newton
from armcontour.robot.arm import unit_hint
from armcontour.robot.planar import PlanarTwoLink
from armcontour.robot.serial import ChainArm, SerialArm

# Task dimensions, as in `newton.py`: of the whole pose, and of the tool point only.
WHOLE, POINT = 6, 3
# Number of initial joint positions of the search. With this number the search found all eight
# configurations of a common six-joint arm in each of thousands of random poses.
SEEDS = 400
# Weight of a radian relative to a metre [m/rad]: in the search for solutions, and in the search for
# the reachable tool point nearest to a pose.
SEARCH_WEIGHT = 0.5
REACH_WEIGHT = 10.0
MAX_STEPS = 200
# Number of initial joint positions of the search for the nearest reachable tool point.
REACH_SEEDS = 60
# Number of parts of the search, each in its own thread.
PARTS = 8
# A pose is reached if position and orientation are closer than this [m, rad].
MET = 1e-8
# Two solutions are distinct if they differ by more than this [rad]. The second value is for
# redundant arms. It is large, because they have infinitely many solutions.
APART = 1e-3
APART_REDUNDANT = 0.5


def solve(arm: ChainArm, pose: Pose, near: npt.ArrayLike | None, *, every: bool) -> FloatArray:
    """Solve the inverse kinematics of `ChainArm.inverse`; `every` is its argument `all`."""
    points, axes = read_poses("pose", pose)
    if every and points.ndim > 1:
        raise InvalidInput(f"all=True requires one pose, but there are {len(points)}.")
    rows = points.reshape(-1, points.shape[-1])
    start = None if near is None else checks.per_joint("near", near, arm.dof, "rad")
    if isinstance(arm, PlanarTwoLink):
        if rows[:, 2:].any():
            raise InvalidInput(f"z of a pose must be 0, because the arm {arm.name} is planar.")
        closed = np.stack([arm.joint_position(rows[:, :2], x) for x in arm.branches], axis=1)
    elif rows.shape[1] != 3:
        raise InvalidInput(f"A position of the arm {arm.name} must have x, y and z.")
    turned = np.broadcast_to(
        IDENTITY if axes is None else axes.reshape(-1, 3, 3), (len(rows), 3, 3)
    )
    solutions: list[FloatArray] = []
    for i, point in enumerate(rows):
        gap = 0.0
        if isinstance(arm, PlanarTwoLink):
            candidates = closed[i]
        else:
            assert isinstance(arm, SerialArm)
            target, task = np.column_stack([turned[i], point]), POINT if axes is None else WHOLE
            candidates = configurations(arm, target, task)
            if start is not None and task < arm.dof:
                # The sample of infinitely many solutions may include none near the start.
                candidates = np.concatenate([configurations(arm, target, task, start), candidates])
            if not len(candidates):
                gap = float(out_of_reach(arm, target[None], task, seeds(arm)[:REACH_SEEDS])[0])
        inside = _within_ranges(arm, candidates, start)
        if not len(inside):
            _raise_unreachable(arm, i, point, candidates, gap)
        if every:
            return inside
        start = inside[0]
        solutions.append(start)
    return np.reshape(solutions, (*points.shape[:-1], arm.dof))


def _within_ranges(arm: ChainArm, candidates: FloatArray, near: FloatArray | None) -> FloatArray:
    """Solutions in the joint ranges, (k, dof), by distance from `near`, or from the middle."""
    turned = [shift_by_turns(arm, q[None], near) for q in candidates]
    inside = np.array([q[0] for q, fits in turned if fits]).reshape(-1, arm.dof)
    away = np.abs(inside - (_range_middle(arm) if near is None else near)).max(axis=1)
    return np.asarray(inside[np.argsort(away, kind="stable")])


def _raise_unreachable(
    arm: ChainArm, index: int, point: FloatArray, candidates: FloatArray, gap: float
) -> None:
    """Raise Unreachable for a pose without a solution, or without one within the joint ranges."""
    if len(candidates):
        example = np.round(candidates[0], 4).tolist()
        reason = f"within its joint ranges. A solution outside of the ranges is {example} rad"
    elif gap > MET:
        reason = f"because the tool remains {gap:.3g} m away"
    else:
        reason = "with this orientation"
    raise Unreachable(
        f"The arm {arm.name} does not reach the pose at {tuple(np.round(point, 6).tolist())} m "
        f"{reason}. Move or rotate the pose{unit_hint(gap)}.",
        point=point.tolist(),
        index=index,
        limit="range" if len(candidates) else "reach",
        needed=gap,
        allowed=0.0,
    )


def _range_middle(arm: ChainArm) -> FloatArray:
    """Middle of each joint range [rad], 0 if a range is unbounded on any side, (dof,)."""
    lower, upper = arm.limits.joint_range(arm.dof)
    both = np.isfinite(lower) & np.isfinite(upper)
    return np.where(both, lower, 0.0) / 2 + np.where(both, upper, 0.0) / 2


def shift_by_turns(
    arm: ChainArm, q: FloatArray, start: FloatArray | None = None
) -> tuple[FloatArray, bool]:
    """Joint positions shifted by whole turns into the ranges; True if all of them are inside."""
    # The shift brings the positions as near as possible to the start, or to the middle of the
    # ranges. A joint whose range has only one end is shifted into its range.
    lower, upper = arm.limits.joint_range(arm.dof)
    low, high, turn = q.min(axis=0), q.max(axis=0), 2 * np.pi
    both = np.isfinite(lower) & np.isfinite(upper)
    middle = _range_middle(arm)
    lowest = np.where(both, -np.inf, np.ceil((lower - low) / turn))
    highest = np.where(both, np.inf, np.floor((upper - high) / turn))
    turns = np.rint((middle - (low + high) / 2) / turn)
    shift = turn * np.minimum(np.maximum(turns, lowest), highest)
    if start is not None:
        nearest = turn * np.rint((start - q[0]) / turn)
        shift = np.where((low + nearest >= lower) & (high + nearest <= upper), nearest, shift)
    return q + shift, bool(((low + shift >= lower) & (high + shift <= upper)).all())


def configurations(
    arm: SerialArm, pose: FloatArray, task: int, near: FloatArray | None = None
) -> FloatArray:
    """All joint positions for a tool pose (3, 4), up to whole turns of a joint [rad], (k, dof)."""
    # For a redundant arm, with infinitely many solutions, a sample is returned. With `near` (dof,)
    # the search starts there; otherwise all solutions are searched. The task dimension is 6 for the
    # whole pose, 5 if rotation about the tool axis is free, 3 for the tool point alone.
    if near is None and task == WHOLE and arm.closed_form is not None:
        solutions = arm.closed_form.solve(arm.chain.base.matrix, pose)
        if solutions is not None:
            return solutions
    return search(arm, pose, task, near)


def search(
    arm: SerialArm, pose: FloatArray, task: int, near: FloatArray | None = None
) -> FloatArray:
    """Find `configurations` by damped least squares from `near` or from random positions."""
    q = seeds(arm) if near is None else np.array(near, dtype=np.float64).reshape(1, -1)
    target = np.ascontiguousarray(pose)

    def approach(part: slice) -> FloatArray:
        parameters = q[part], SEARCH_WEIGHT, MAX_STEPS
        return np.asarray(newton.approach(arm.link_table, task, target, *parameters))

    if near is None:
        residuals = np.concatenate(map_in_threads(approach, split_evenly(len(q), PARTS)))
    else:
        residuals = approach(slice(1))
    solutions = q[(residuals < MET).all(axis=1)]
    solutions = np.pi - np.mod(np.pi - solutions, 2 * np.pi) if near is None else solutions
    apart = np.cos(APART if task == arm.dof else APART_REDUNDANT)
    distinct, remaining, turns = [], np.arange(len(solutions)), np.exp(1j * solutions)
    while len(remaining):
        distinct.append(remaining[0])
        remaining = remaining[
            (turns[remaining] * turns[remaining[0]].conj()).real.min(axis=1) < apart
        ]
    return np.asarray(solutions[distinct].reshape(-1, arm.dof))


def seeds(arm: SerialArm) -> FloatArray:
    """Random joint positions [rad] within the ranges, the same in every call, (SEEDS, dof)."""
    # A joint range of a whole turn or more is replaced by -pi to pi.
    lower, upper = arm.limits.joint_range(arm.dof)
    narrow = upper - lower < 2 * np.pi
    lower, upper = np.where(narrow, lower, -np.pi), np.where(narrow, upper, np.pi)
    random = np.random.default_rng(0)
    return lower + random.uniform(size=(SEEDS, arm.dof)) * (upper - lower)


def out_of_reach(arm: SerialArm, poses: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Distance from each pose to the nearest reachable tool point [m], (n,)."""
    # The search gives the tool orientation priority over the position. poses: (n, 3, 4). q: initial
    # joint positions [rad], (k, dof).
    return np.array([_approach(arm, x, task, q)[1].min() for x in poses])


def nearest_reached(arm: SerialArm, pose: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Joint positions with the smallest distance from the tool to a pose [rad], (dof,)."""
    # The search is that of `out_of_reach`. pose: (3, 4).
    tried, distances = _approach(arm, pose, task, q)
    return np.asarray(tried[np.argmin(distances)])


def _approach(
    arm: SerialArm, pose: FloatArray, task: int, q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Final joint positions of the searches [rad], (k, dof); tool distances from the pose [m]."""
    tried = q.copy()
    parameters = tried, REACH_WEIGHT, MAX_STEPS
    residuals = newton.approach(arm.link_table, task, np.ascontiguousarray(pose), *parameters)
    return tried, np.asarray(residuals[:, 0])
