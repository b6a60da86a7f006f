"""Choice of the configuration in which an arm completes a path in the least time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits, SerialArm
from armcontour.arms.limits import or_unlimited
from armcontour.errors import ArmContourError, Unreachable
from armcontour.geometry import Path
from armcontour.geometry.cutting import cut_path
from armcontour.motion import JointPath
from armcontour.timing._least_duration import least_duration
from armcontour.timing.optimal import plan_optimal
from armcontour.tracing import sketch_all, trace, trace_all

# Configurations are compared by coarse plans with about this many grid intervals.
ROUGHLY = 400
# On paths of more segments than LONG they are compared on parts of about PART_SEGMENTS, one in
# PART_EVERY segments, and at most MOST_PARTS. The shares INNER of each part are counted.
LONG = 20_000
PART_SEGMENTS, PART_EVERY, MOST_PARTS = 100, 200, 100
INNER = (0.1, 0.9)
# After this many parts, configurations that have taken longer by SLOWER are given up.
SOME_PARTS, SLOWER = 10, 0.02
# A configuration is not planned if this share of its lower bound exceeds a plan: the bound keeps
# limits at points, and may miss what happens between them.
SURE = 0.998


def trace_fastest(
    path: Path,
    arm: Arm,
    limits: Limits | None = None,
    *,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
) -> JointPath:
    """Trace a path in the configuration whose optimal plan takes the least time.

    Args:
        path: A tool path.
        arm: The arm.
        limits: Limits, including the joint ranges, without those of jerk; by default the arm's own.
        branch: For an arm in the plane: the branch, as in `trace`, which leaves no choice.
        start: For an arm in space: joint positions near the required start [rad], (dof,).

    Raises:
        Unreachable: No configuration completes the path.
        InvalidInput: The path does not fit the arm.
    """
    bounds = (arm.limits if limits is None else limits).for_joints(arm.dof)
    # Limits of jerk cost much time here, and favour no configuration.
    rough = bounds.without_jerk
    if isinstance(path, Path) and len(path) > LONG and isinstance(arm, SerialArm):
        long = _trace_long(path, arm, bounds) if branch is None and start is None else None
        if long is not None:
            return long
    found = trace_all(path, arm, limits=bounds, branch=branch, start=start)
    if len(found) == 1:
        return found[0]
    at_least = [bound_duration(x, rough) for x in found]
    best, least = 0, float("inf")
    for i in np.argsort(at_least, kind="stable"):
        if SURE * at_least[i] > least:
            break
        try:
            duration = plan_optimal(found[i], arm, rough, intervals=ROUGHLY).duration
        except ArmContourError:
            # If no configuration can be planned, the plan of the first one raises the reason.
            continue
        # Among equals the first one counts, whichever was planned first.
        if duration < least or (duration == least and i < best):
            best, least = int(i), duration
    return found[best]


def _trace_long(path: Path, arm: SerialArm, limits: Limits) -> JointPath | None:
    """Trace a long path in the configuration that is the fastest on some parts of it.

    Args:
        path: The path.
        arm: The arm.
        limits: The limits, with the joint ranges.

    Returns:
        The joint path; None if no configuration is found this way.
    """
    try:
        s, solutions = sketch_all(path, arm, limits=limits)
    except Unreachable:
        # Tracing says why.
        return None
    durations = _estimate(path, arm, limits, s, solutions)
    for k in np.argsort(durations, kind="stable"):
        try:
            return trace(path, arm, limits=limits, start=solutions[k][0])
        except ArmContourError:
            continue
    return None


def _estimate(
    path: Path, arm: SerialArm, limits: Limits, s: FloatArray, solutions: list[FloatArray]
) -> FloatArray:
    """Estimated durations of a long path in each configuration, infinite for slow ones [s].

    Parts of the path stand for all of it, but for their ends: there only the part is at rest. The
    first part's start and the last part's end are the path's own.

    Args:
        path: The path.
        arm: The arm.
        limits: The limits, with the joint ranges.
        s: Arc lengths of some places of the path [m], (n,).
        solutions: Joint positions at these places in each configuration [rad], (n, dof) each.
    """
    parts = min(len(path) // PART_EVERY, MOST_PARTS)
    length = path.length * PART_SEGMENTS / len(path)
    first = np.searchsorted(s, np.linspace(0, path.length - length, parts), side="right") - 1
    last = np.append(s[first[:-1]] + length, path.length)
    more = path.length / (parts * length * (INNER[1] - INNER[0]))
    durations = np.zeros(len(solutions))
    for n, (i, end) in enumerate(zip(first, last, strict=True)):
        part = cut_path(path, s[i], end)
        for k in np.flatnonzero(durations < np.inf):
            try:
                joint_path = trace(part, arm, limits=limits, start=solutions[k][i])
                plan = plan_optimal(joint_path, arm, limits.without_jerk, intervals=ROUGHLY)
            except ArmContourError:
                durations[k] = np.inf
                continue
            begin, rest = plan.time_at(part.length * np.array(INNER))
            durations[k] += more * (rest - begin)
            durations[k] += begin if n == 0 else 0.0
            durations[k] += plan.duration - rest if n == parts - 1 else 0.0
        if n + 1 >= SOME_PARTS:
            durations[durations > (1 + SLOWER) * durations.min()] = np.inf
    return durations


def bound_duration(joint_path: JointPath, limits: Limits) -> float:
    """A duration that no motion from rest to rest along a joint path falls below [s].

    It takes account of the joints' velocities and accelerations, the tool's speed and, on arcs, its
    centripetal acceleration; torques and all other limits are left out.

    Args:
        joint_path: A traced path.
        limits: The limits.
    """
    breaks, dof = joint_path.breaks, joint_path.dof
    rests = np.isin(breaks, joint_path.stops)
    rests[[0, -1]] = True
    ceilings = np.full(len(breaks) - 1, np.inf)
    path = joint_path.tool_path
    if path is not None:
        segment = path.locate((breaks[:-1] + breaks[1:]) / 2)
        speed = np.inf if limits.speed is None else limits.speed
        across = [limits.centripetal_acceleration, limits.tool_acceleration]
        most = min((x for x in across if x is not None), default=np.inf)
        bend = np.where(path.segments.bent, 0.0, path.curvatures)
        with np.errstate(divide="ignore"):
            ceilings = np.minimum(np.fmin(path.speeds, speed) ** 2, most / bend)[segment]
    velocity = or_unlimited(limits.joint_velocity, dof)
    low, high = (np.array(x) for x in limits.acceleration_bounds(dof))
    return float(
        least_duration(breaks, joint_path.coefficients, rests, ceilings, velocity, low, high)
    )
