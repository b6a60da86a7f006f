"""Public functions of tracing: joint paths along which an arm follows a tool path."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput, Unreachable
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.planning.tracing.knots import (
    Knots,
    first_knots,
    row_of_poses,
    task_dimension,
)
from armcontour.planning.tracing.ranges import check_joint_range, turn_into_range
from armcontour.planning.tracing.solver import AnalyticSolver, refine
from armcontour.robot import Arm, Limits, PlanarTwoLink, SerialArm

if TYPE_CHECKING:
    from armcontour.planning.tracing.configurations import Solution

# Factor of the number of first knots of a redundant arm, because null-space motion is interpolated
# between these knots
FINER = 3
# Distance between the points of a sketch, divided by the span of the arm.
SKETCHED = 0.01


@checks.explained
def trace(
    path: Path,
    arm: Arm,
    *,
    limits: Limits | None = None,
    configuration: str | None = None,
    seed: npt.ArrayLike | None = None,
    tolerance: float = 1e-10,
) -> JointPath:
    """Compute the joint path along which the arm's tool follows `path`.

    q, dq_ds and d2q_ds2 at the knots are exact, by (28) and (27) for an arm in the plane and by
    their counterparts for an arm in space. Between knots the joint path is a quintic. Knots are
    added until the tool is within `tolerance` of the path and within 1e-9 rad of its orientation.

    >>> joint_path = ac.trace(path, arm)
    >>> joint_path(0.01).shape, joint_path.length == path.length
    ((2,), True)

    Args:
        path: Tool path.
        arm: The arm.
        limits: Limits whose joint ranges apply, and whose joint velocities weight the lengths of
            joint paths; by default those of the arm.
        configuration: For an arm in the plane, one of `arm.branches`; by default the first that
            completes the path. `plan` chooses the fastest.
        seed: For an arm in space, joint positions near the start of the joint path [rad], (dof,);
            by default the configuration with the shortest joint path. `plan` chooses the fastest.
        tolerance: Largest distance between the tool and its position on the path [m].

    Raises:
        Unreachable: The path is out of reach, leaves a joint range or meets a singularity; with
            the arc length.
        InvalidInput: The path does not fit the arm.
    """
    joint_paths = trace_all(
        path,
        arm,
        limits=limits,
        configuration=configuration,
        seed=seed,
        tolerance=tolerance,
        max_count=1,
    )
    return joint_paths[0]


def trace_all(
    path: Path,
    arm: Arm,
    *,
    limits: Limits | None = None,
    configuration: str | None = None,
    seed: npt.ArrayLike | None = None,
    tolerance: float = 1e-10,
    max_count: int | None = None,  # Largest number of joint paths; all by default
) -> list[JointPath]:
    """Joint paths of all configurations that complete the path, the shortest first."""
    # An arm in the plane has one joint path per branch, in the order of its branches. An arm in
    # space has one joint path per configuration. A redundant arm has infinitely many:
    # `configurations.MAX_STARTS` sampled starts are followed, and at most
    # `configurations.MAX_SOLUTIONS` joint paths are returned.
    if not isinstance(path, Path):
        raise InvalidInput(
            f"trace takes a Path, not a {type(path).__name__}. Pass a program to plan, which "
            "traces its contours."
        )
    checks.positive("tracing tolerance", tolerance, "m")
    if limits is not None:
        checks.check_type("limits", limits, Limits)
        arm = arm.with_limits(limits)
    if isinstance(arm, PlanarTwoLink):
        if seed is not None:
            raise InvalidInput(
                f"The arm {arm.name} has named branches. Specify a configuration instead of a seed."
            )
        branches = arm.branches if configuration is None else (configuration,)
        return _complete(
            (partial(_trace_planar, path, arm, x, tolerance) for x in branches), max_count
        )
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"Inverse kinematics is not available for {type(arm).__name__}: use a SerialArm or "
            "a PlanarTwoLink."
        )
    if configuration is not None:
        raise InvalidInput(
            f"The arm {arm.name} has no named branches. Instead of a configuration, specify a "
            "seed with approximate joint positions at the start of the path."
        )
    _refuse_flat(arm)
    near = None if seed is None else _check_seed(arm, seed)
    return _trace_serial(path, arm, near, tolerance, max_count)


def _refuse_flat(arm: SerialArm) -> None:
    """Raise InvalidInput for an arm in space whose joints are parallel, because it is singular."""
    if arm.dof > 2 and arm.moves_in_a_plane:
        raise InvalidInput(
            f"The joints of the arm {arm.name} are parallel or slide in one plane, so its tool "
            "stays in a plane. Arms in a plane have two links: describe them by an arm file of the "
            "kind planar_two_link."
        )


def sketch_all(
    path: Path, arm: SerialArm, *, limits: Limits | None = None
) -> tuple[FloatArray, list[FloatArray]]:
    """Joint positions at a few points of a long path, in all configurations that reach them.

    Returns arc lengths of the points from 0 to the path's end [m], (n,), and joint positions there
    [rad], (n, dof) each, the shortest joint path first.

    - `arm`: the arm, which moves in space.
    """
    from armcontour.planning.tracing.configurations import find_solutions

    if limits is not None:
        arm = arm.with_limits(limits)
    _refuse_flat(arm)
    task = task_dimension(path, arm)
    knots = first_knots(path, arm.span)
    few = knots.part(_few_places(path, knots, SKETCHED * arm.span))
    solutions = find_solutions(path, arm, few, row_of_poses(path, few), task, None)
    return np.append(few.s0, path.length), [x.q for x in solutions]


def _few_places(path: Path, knots: Knots, step: float) -> IntArray:
    """Indices of knots at steps of `step` [m] or rotations of CHORD_TURN, and of the last knot."""
    from armcontour.planning.tracing.configurations import CHORD_TURN

    turn = np.linalg.norm(np.diff(row_of_poses(path, knots)[:, :, :3], axis=0), axis=(1, 2))
    done = knots.s0 / step + np.cumsum(turn) / CHORD_TURN
    fresh = np.diff(np.floor(done), prepend=-1.0) > 0
    fresh[-1] = True
    return np.flatnonzero(fresh)


def _trace_planar(
    path: Path, arm: PlanarTwoLink, configuration: str, tolerance: float
) -> JointPath:
    joint_path = refine(
        AnalyticSolver(path, arm, configuration, tolerance), first_knots(path, arm.span)
    )
    joint_path = turn_into_range(joint_path, arm.limits)
    check_joint_range(joint_path, arm.limits, arm)
    return joint_path


def _trace_serial(
    path: Path, arm: SerialArm, seed: FloatArray | None, tolerance: float, max_count: int | None
) -> list[JointPath]:
    """Joint paths of a serial arm in its configurations, the shortest first."""
    from armcontour.planning.tracing.configurations import find_solutions
    from armcontour.planning.tracing.redundancy import Guide, null_space
    from armcontour.planning.tracing.solver import NumericSolver

    task = task_dimension(path, arm)
    knots = first_knots(path, arm.span, FINER if task < arm.dof else 1)
    poses = row_of_poses(path, knots)

    def refine_solution(solution: Solution) -> JointPath:
        q, guide = solution.q, None
        if task < arm.dof:
            w, s = null_space(arm, poses, task, q), np.append(knots.s0, path.length)
            guide = Guide.through(s, q, w, path.stops)
        numeric = NumericSolver(path, arm, task, tolerance, guide)
        joint_path = refine(numeric, knots, np.concatenate([q[:-1], q[1:]]))
        check_joint_range(joint_path, arm.limits, arm)
        return joint_path

    solutions = find_solutions(path, arm, knots, poses, task, seed)
    return _complete((partial(refine_solution, x) for x in solutions), max_count)


def _complete(tries: Iterable[Callable[[], JointPath]], max_count: int | None) -> list[JointPath]:
    """Joint paths of configurations that complete a path; raises the first error if none does."""
    joint_paths: list[JointPath] = []
    refusals: list[Unreachable] = []
    for attempt in tries:
        if max_count is not None and len(joint_paths) == max_count:
            break
        # A configuration that is singular or leaves a joint range between knots does not exclude
        # the others.
        try:
            joint_paths.append(attempt())
        except Unreachable as error:
            refusals.append(error)
    if not joint_paths:
        raise refusals[0]
    return joint_paths


def _check_seed(arm: SerialArm, seed: npt.ArrayLike) -> FloatArray:
    positions = checks.per_joint("seed", seed, arm.dof, "rad")
    lower, upper = arm.limits.joint_range(arm.dof)
    outside = (positions < lower) | (positions > upper)
    if outside.any():
        j = int(np.argmax(outside))
        unit = arm.chain.unit("rad", j)
        raise InvalidInput(
            f"seed has joint {j + 1} at {positions[j]:.6g} {unit}, but its range is from "
            f"{lower[j]:.6g} to {upper[j]:.6g} {unit}. Specify values in {unit}, or with a unit.",
            joint=j,
            needed=float(positions[j]),
            allowed=float(lower[j] if positions[j] < lower[j] else upper[j]),
        )
    return positions
