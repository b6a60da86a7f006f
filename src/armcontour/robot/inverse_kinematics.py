"""Inverse kinematics of serial arms: closed form for most six-joint arms, otherwise a search."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.pool import map_in_threads, split_evenly
from armcontour.robot import pose_solver
from armcontour.robot.arm import MET, Arm
from armcontour.robot.tool_turning import REACHED_ANGLE

# Task dimensions, as in `pose_solver.py`:
WHOLE = 6  # The whole tool pose.
AXIS = 5  # The tool point and the tool axis.
TURNED = 4  # The tool point and the rotation about the direction of parallel joints.
POINT = 3  # The tool point only.
# Number of joint positions at which the search starts. With this number it found all eight
# configurations of a common six-joint arm for every one among thousands of random poses.
SEEDS = 400
# Weight of a radian relative to a metre in the search for solutions [m/rad].
SEARCH_WEIGHT = 0.5
# Weight of a radian relative to a metre in the search for the reachable tool point nearest to a
# pose [m/rad].
REACH_WEIGHT = 10.0
# The same weight in the search for the smallest angle at a position [m/rad], and the distance at
# which the position is reached [m].
ANGLE_WEIGHT = 1e-3
SAME_POSITION = 1e-4
# Largest number of steps in each search.
MAX_SEARCH_STEPS = 200
# Number of joint positions at which the search for the nearest reachable tool point starts.
REACH_SEEDS = 60
# Number of parts into which the search is divided, each in its own thread.
SEARCH_THREADS = 8
# Two solutions are distinct if they differ by more than this [rad or m].
DISTINCT_SOLUTIONS = 1e-3
# Two solutions of a redundant arm are distinct if they differ by more than this [rad or m]. It is
# large, because redundant arms have infinitely many solutions.
APART_REDUNDANT = 0.5


def configurations(
    arm: Arm, pose: FloatArray, task: int, near: FloatArray | None = None
) -> FloatArray:
    """Return the joint positions [rad], (k, dof), at which the tool has a pose, (3, 4).

    Solutions that differ by whole turns of a joint are one solution. A redundant arm has infinitely
    many solutions, of which a sample is returned.

    Args:
        arm: The arm.
        pose: Tool pose in the work frame, (3, 4).
        task: Task dimension: 6 for the whole pose, 5 if the rotation about the tool axis is free, 4
            for the tool point and the rotation about the direction of parallel joints, 3 for the
            tool point alone.
        near: Joint positions at which the search starts [rad], (dof,); by default it starts from
            many positions, to find all solutions.
    """
    if near is None and task == WHOLE and arm.closed_form is not None:
        solutions = arm.closed_form.solve(arm.chain.base.matrix, pose)
        if solutions is not None:
            return solutions
    turning = arm.tool_turning if task == WHOLE else None
    if turning is not None:
        if turning.missed(pose[None, :, :3], axis_only=False)[0] > REACHED_ANGLE:
            return np.empty((0, arm.dof))
        task = TURNED if turning.turns else POINT
    return search(arm, pose, task, near)


def search(arm: Arm, pose: FloatArray, task: int, near: FloatArray | None = None) -> FloatArray:
    """Find `configurations` by damped least squares from `near` or from random positions.

    Args:
        arm: The arm.
        pose: Tool pose in the work frame, (3, 4).
        task: Task dimension, as in `configurations`.
        near: Joint positions at which the search starts [rad], (dof,), or None.
    """
    q = seeds(arm) if near is None else np.array(near, dtype=np.float64).reshape(1, -1)
    target = np.ascontiguousarray(pose)

    def approach(part: slice) -> FloatArray:
        parameters = q[part], SEARCH_WEIGHT, MAX_SEARCH_STEPS
        return np.asarray(pose_solver.approach(arm.link_table, task, target, *parameters))

    if near is None:
        residuals = np.concatenate(map_in_threads(approach, split_evenly(len(q), SEARCH_THREADS)))
    else:
        residuals = approach(slice(1))
    solutions = q[(residuals < MET).all(axis=1)]
    slides = arm.chain.slides
    if near is None:
        turned = np.pi - np.mod(np.pi - solutions, 2 * np.pi)
        solutions = np.where(slides, solutions, turned)
    apart = DISTINCT_SOLUTIONS if task == arm.dof else APART_REDUNDANT
    distinct = []
    remaining = np.arange(len(solutions))
    turns = np.exp(1j * solutions * ~slides)
    while len(remaining):
        first = remaining[0]
        distinct.append(first)
        differs = (turns[remaining] * turns[first].conj()).real.min(axis=1) < np.cos(apart)
        slid = np.abs(solutions[remaining] - solutions[first])[:, slides]
        remaining = remaining[differs | (slid > apart).any(axis=1)]
    return np.asarray(solutions[distinct].reshape(-1, arm.dof))


def seeds(arm: Arm) -> FloatArray:
    """Return random joint positions within the ranges of `arm`, always the same, (SEEDS, dof)."""
    # A joint range of a whole turn or more is replaced by -pi to pi, and the range of a prismatic
    # joint without ends by the span of the arm.
    lower, upper = arm.limits.joint_range(arm.dof)
    slides = arm.chain.slides
    narrow = np.where(slides, np.isfinite(upper - lower), upper - lower < 2 * np.pi)
    far = np.where(slides, arm.span, np.pi)
    lower = np.where(narrow, lower, -far)
    upper = np.where(narrow, upper, far)
    random = np.random.default_rng(0)
    return lower + random.uniform(size=(SEEDS, arm.dof)) * (upper - lower)


def out_of_reach(arm: Arm, poses: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Return the distance from each pose to the nearest reachable tool point [m], (n,).

    The search gives the tool orientation priority over the position.

    Args:
        arm: The arm.
        poses: Tool poses in the work frame, (n, 3, 4).
        task: Task dimension, as in `configurations`.
        q: Joint positions at which the search starts [rad], (k, dof).
    """
    return np.array([_approach(arm, x, task, q)[1].min() for x in poses])


def smallest_angle(arm: Arm, pose: FloatArray, task: int, q: FloatArray) -> float:
    """Return the tool's smallest angle to a required orientation [rad], at the required position.

    Infinite if no search reaches the position.

    Args:
        arm: The arm.
        pose: Tool pose in the work frame, (3, 4).
        task: Task dimension, as in `configurations`.
        q: Joint positions at which the search starts [rad], (k, dof).
    """
    target = np.ascontiguousarray(pose)
    errors = pose_solver.approach(
        arm.link_table, task, target, q.copy(), ANGLE_WEIGHT, MAX_SEARCH_STEPS
    )
    angles = errors[errors[:, 0] < SAME_POSITION, 1]
    return float(angles.min(initial=np.inf))


def nearest_reached(arm: Arm, pose: FloatArray, task: int, q: FloatArray) -> FloatArray:
    """Return the joint positions [rad], (dof,), that bring the tool nearest to a pose.

    The search is that of `out_of_reach`.

    Args:
        arm: The arm.
        pose: Tool pose in the work frame, (3, 4).
        task: Task dimension, as in `configurations`.
        q: Joint positions at which the search starts [rad], (k, dof).
    """
    tried, distances = _approach(arm, pose, task, q)
    return np.asarray(tried[np.argmin(distances)])


def _approach(
    arm: Arm, pose: FloatArray, task: int, q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the joint positions that the searches end at, (k, dof), and tool distances [m]."""
    tried = q.copy()
    parameters = tried, REACH_WEIGHT, MAX_SEARCH_STEPS
    residuals = pose_solver.approach(arm.link_table, task, np.ascontiguousarray(pose), *parameters)
    return tried, np.asarray(residuals[:, 0])
