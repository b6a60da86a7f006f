"""Choice of the configuration in which an arm completes a path in the least time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits, SerialArm, choose_limits
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
# PART_EVERY segments, and at most MOST_PARTS. Parts tell durations apart by some thousandths only:
# what is slower there by no more than SLOWER is traced along the whole path.
LONG = 20_000
PART_SEGMENTS, PART_EVERY, MOST_PARTS = 200, 2500, 40
SLOWER = 0.01
# What differs on the parts by less than this share differs by the turn of a wrist only, and is as
# fast on the whole path.
ALIKE = 1e-4
# A configuration is not planned if this share of its lower bound exceeds a plan: the bound keeps
# limits at points, and may miss what happens between them.
SURE = 0.998
# Plans whose durations differ by less than this share are as fast: the planner is no more exact.
AS_FAST = 1e-6


def trace_fastest(
    path: Path,
    arm: Arm,
    limits: Limits | None = None,
    *,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
) -> JointPath:
    """Trace a path in the configuration whose optimal plan takes the least time.

    Among equals it is the one with the shortest joint path.

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
    return next(trace_by_duration(path, arm, limits, branch=branch, start=start))[0]


def trace_by_duration(
    path: Path,
    arm: Arm,
    limits: Limits | None = None,
    *,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
) -> Iterator[list[JointPath]]:
    """Trace a path in all configurations, those with the fastest optimal plans first.

    Args:
        path: As in `trace_fastest`, as the others.
        arm: See above.
        limits: See above.
        branch: See above.
        start: See above.

    Yields:
        Joint paths that are as fast, the shortest one first. Of a long path there is only the
        fastest one.

    Raises:
        Unreachable: No configuration completes the path.
        InvalidInput: The path does not fit the arm.
    """
    bounds = choose_limits("fastest_configurations", arm, limits)
    # Limits of jerk cost much time here, and favour no configuration.
    rough = bounds.without_jerk
    if isinstance(path, Path) and len(path) > LONG and isinstance(arm, SerialArm):
        long = _trace_long(path, arm, bounds) if branch is None and start is None else None
        if long is not None:
            yield [long]
            return
    found = trace_all(path, arm, limits=bounds, branch=branch, start=start)
    if len(found) == 1:
        yield found
        return
    at_least = [bound_duration(x, rough) for x in found]
    order = np.argsort(at_least, kind="stable").tolist()
    # Of those that are planned and did not come yet.
    durations: dict[int, float] = {}
    while order or durations:
        # What takes longer by its bound is not planned yet.
        while order and SURE * at_least[order[0]] <= min(durations.values(), default=np.inf):
            i = order.pop(0)
            durations[i] = np.inf
            # If no configuration can be planned, the plan of the first one raises the reason.
            with suppress(ArmContourError):
                durations[i] = plan_optimal(found[i], arm, rough, intervals=ROUGHLY).duration
        least = min(durations.values())
        as_fast = sorted(i for i, x in durations.items() if x <= least * (1 + AS_FAST))
        yield [found[i] for i in as_fast]
        for i in as_fast:
            del durations[i]


def find_starts(path: Path, arm: SerialArm, limits: Limits | None = None) -> list[FloatArray]:
    """Joint positions in which a path can start, one for each configuration [rad], (dof,) each.

    On a long path a few places are looked at, so that a configuration may not complete the path.

    Args:
        path: A tool path.
        arm: The arm.
        limits: Limits with the joint ranges; by default the arm's own.

    Raises:
        Unreachable: No configuration completes the path.
        InvalidInput: The path does not fit the arm.
    """
    if len(path) > LONG:
        try:
            return [x[0] for x in sketch_all(path, arm, limits=limits)[1]]
        except Unreachable:
            # Tracing says why.
            pass
    return [x(0.0) for x in trace_all(path, arm, limits=limits)]


def _trace_long(path: Path, arm: SerialArm, limits: Limits) -> JointPath | None:
    """Trace a long path in the fastest configuration.

    Some parts of the path tell which configurations may be the fastest. Along the whole path these
    are compared by a lower bound, and by how far plans of the parts are above it.

    Args:
        path: The path.
        arm: The arm.
        limits: The limits, with the joint ranges.

    Returns:
        The joint path; None if no configuration is found this way.
    """
    rough = limits.without_jerk
    try:
        s, solutions = sketch_all(path, arm, limits=limits)
    except Unreachable:
        # Tracing says why.
        return None
    bounds, durations = _compare(path, arm, limits, s, solutions)
    near = durations <= (1 + SLOWER) * durations.min()
    with np.errstate(divide="ignore", invalid="ignore"):
        above = durations / bounds
    slow = np.flatnonzero(~near)
    best, least, done = None, np.inf, list[float]()
    # The shortest joint paths come first; slow ones are traced only if no other can be.
    for k in [*np.flatnonzero(near), *slow[np.argsort(durations[slow], kind="stable")]]:
        if done and not near[k]:
            break
        if any((1 - ALIKE) * x < durations[k] < (1 + ALIKE) * x for x in done):
            continue
        try:
            found = trace(path, arm, limits=limits, start=solutions[k][0])
        except ArmContourError:
            continue
        done.append(float(durations[k]))
        duration = bound_duration(found, rough) * above[k]
        if best is None or duration < least:
            best, least = found, duration
    return best


def _compare(
    path: Path, arm: SerialArm, limits: Limits, s: FloatArray, solutions: list[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Bounds and durations of parts of a long path in each configuration, (solutions,) each [s].

    A configuration without a plan has its bound as its duration, which is too slow then; one that
    does not complete the parts has an infinite one.

    Args:
        path: The path.
        arm: The arm.
        limits: The limits, with the joint ranges.
        s: Arc lengths of some places of the path [m], (n,).
        solutions: Joint positions at these places in each configuration [rad], (n, dof) each.
    """
    rough = limits.without_jerk
    parts = min(max(len(path) // PART_EVERY, 1), MOST_PARTS)
    length = path.length * min(PART_SEGMENTS / len(path), 1.0)
    first = np.searchsorted(s, np.linspace(0, path.length - length, parts), side="right") - 1
    last = np.append(s[first[:-1]] + length, path.length)
    cuts = [cut_path(path, s[i], end) for i, end in zip(first, last, strict=True)]
    bounds, traced = np.full(len(solutions), np.inf), list[list[JointPath]]()
    for k, q in enumerate(solutions):
        try:
            found = [
                trace(part, arm, limits=limits, start=q[i])
                for part, i in zip(cuts, first, strict=True)
            ]
            bounds[k] = sum(bound_duration(x, rough) for x in found)
        except ArmContourError:
            found = []
        traced.append(found)
    durations, least = bounds.copy(), np.inf
    for k in np.argsort(bounds, kind="stable"):
        if SURE * bounds[k] > (1 + SLOWER) * least:
            break
        try:
            durations[k] = sum(
                plan_optimal(x, arm, rough, intervals=ROUGHLY).duration for x in traced[k]
            )
        except ArmContourError:
            durations[k] = np.inf
        least = min(least, float(durations[k]))
    return bounds, durations


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
