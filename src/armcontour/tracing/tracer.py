"""Tracing: a tool path becomes a joint path, by exact inverse kinematics at knots."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits, PlanarTwoLink, SerialArm
from armcontour.errors import InvalidInput, Unreachable
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.tracing.closed_form import ClosedForm
from armcontour.tracing.configurations import find_solutions
from armcontour.tracing.knots import first_knots
from armcontour.tracing.numeric import Numeric
from armcontour.tracing.poses import task_dimension
from armcontour.tracing.ranges import refuse_out_of_range, turn_into_range
from armcontour.tracing.refinement import refine

# Joints to spare are guided from knot to knot: these lie closer by this factor then.
FINER = 3


def trace(
    path: Path,
    arm: Arm,
    *,
    limits: Limits | None = None,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    tolerance: float = 1e-10,
) -> JointPath:
    """The joint path that carries the arm's tool along `path`.

    q, dq_ds and d2q_ds2 at the knots are exact, by (28) and (27) or what they are in space. Between
    knots a quintic; knots are added until the tool is within `tolerance` of the path, and its
    orientation within 1e-9 rad.

    Args:
        path: Tool path.
        arm: The arm.
        limits: Their joint ranges hold, and their joint velocities tell long ways from short ones;
            by default the arm's own.
        branch: For an arm in the plane, one of `arm.branches`; the first by default.
        start: For an arm in space, joint positions near to those to start in [rad]; by default the
            configuration whose way is the shortest. `plan` chooses the fastest instead.
        tolerance: Largest distance between the tool and its place on the path [m].

    Raises:
        Unreachable: A place out of reach, out of a joint's range or singular, with its arc length.
        InvalidInput: A path that does not fit the arm.
    """
    found = trace_all(
        path, arm, limits=limits, branch=branch, start=start, tolerance=tolerance, most=1
    )
    return found[0]


def trace_all(
    path: Path,
    arm: Arm,
    *,
    limits: Limits | None = None,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    tolerance: float = 1e-10,
    most: int | None = None,
) -> list[JointPath]:
    """The joint paths of the configurations that complete the path, the shortest way first.

    Of an arm in the plane, that of its branch. Of an arm in space all; with joints to spare, of
    which there are infinitely many, a sample: 48 starts are followed, and 8 ways are kept at most.

    Args:
        path: Tool path.
        arm: The arm.
        limits: As in `trace`.
        branch: As in `trace`.
        start: As in `trace`.
        tolerance: As in `trace`.
        most: How many at most; all that there are by default.

    Raises:
        Unreachable: As in `trace`.
        InvalidInput: As in `trace`.
    """
    if not isinstance(path, Path):
        raise InvalidInput(
            f"trace takes a Path, not a {type(path).__name__}: plan takes programs, and traces "
            "their contours itself."
        )
    _checks.positive("tracing tolerance", tolerance, "m")
    if limits is not None:
        arm = arm.with_limits(limits)
    if isinstance(arm, PlanarTwoLink):
        if start is not None:
            raise InvalidInput(f"The arm {arm.name} takes a branch to start in, not a start.")
        only = refine(ClosedForm(path, arm, branch, tolerance), first_knots(path))
        only = turn_into_range(only, arm.limits)
        refuse_out_of_range(only, arm.limits)
        return [only]
    if not isinstance(arm, SerialArm):
        raise InvalidInput(f"There is no inverse kinematics for {type(arm).__name__}.")
    if branch is not None:
        raise InvalidInput(
            f"The arm {arm.name} has no named branches: give start, joint positions near to those "
            "to start in."
        )
    near = None if start is None else _start(arm, start)
    task = task_dimension(path, arm)
    knots = first_knots(path, FINER if task < arm.dof else 1)
    found: list[JointPath] = []
    refusals: list[Unreachable] = []
    for way in find_solutions(path, arm, knots, task, near):
        if most is not None and len(found) == most:
            break
        try:
            joint_path = refine(Numeric(path, arm, task, knots, way, tolerance), knots)
            refuse_out_of_range(joint_path, arm.limits)
            found.append(joint_path)
        except Unreachable as error:
            # Between two knots it is singular or leaves a joint's range; another may not.
            refusals.append(error)
    if not found:
        raise refusals[0]
    return found


def _start(arm: SerialArm, start: npt.ArrayLike) -> FloatArray:
    """Joint positions to start near to.

    Raises:
        InvalidInput: A wrong number of them, or a joint beyond its range.
    """
    near = _checks.per_joint("start", start, arm.dof, "rad")
    lower, upper = arm.limits.joint_range(arm.dof)
    outside = (near < lower) | (near > upper)
    if outside.any():
        j = int(np.argmax(outside))
        raise InvalidInput(
            f"start has joint {j + 1} at {near[j]:.6g} rad, outside its range from {lower[j]:.6g} "
            f"to {upper[j]:.6g} rad: give angles in rad, or with their unit.",
            joint=j + 1,
            needed=float(near[j]),
            allowed=float(lower[j] if near[j] < lower[j] else upper[j]),
        )
    return near
