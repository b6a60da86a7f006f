"""Entry point `plan`: check the input, trace untraced paths, and time them."""

from __future__ import annotations

import warnings
from functools import cached_property
from typing import Any, NoReturn

import numpy as np

from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress
from armcontour.core.text import capitalise, count_noun
from armcontour.geometry import Path
from armcontour.geometry.rounding.rounded_path import RoundedPath
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.geometry.shaped_path import describe_unfinished
from armcontour.motion import JointPath, Trajectory
from armcontour.planning.optimal_timing import FASTEST, Optimal
from armcontour.planning.program_timing import (
    Timing,
    check_longest,
    slow_down,
    time_program,
)
from armcontour.planning.program_tracing import TracedMove, Tracing, trace_program
from armcontour.planning.timing_options import LONGEST_MOTION, PlanOptions
from armcontour.planning.tracing import check_joint_range
from armcontour.program import Dwell, Program
from armcontour.robot import Arm, Limits, compare_limits, load_named, resolve_limits
from armcontour.robot.limits import reduce_limits


@checked
def plan(
    path: Path | Program | JointPath | Tracing,
    arm: Arm | Any | None = None,
    limits: Limits | None = None,
    options: PlanOptions = FASTEST,
    *,
    progress: Progress | None = None,
) -> Trajectory:
    """Compute the realizable trajectory of a path or a program.

    >>> trajectory = ac.plan(path, arm, limits, ac.Optimal(reserve=0.05))
    >>> trajectory.duration > planned.duration
    True

    Args:
        path: A tool path or a program, which is traced first; or a joint path or a tracing.
        arm: The arm, or what `load_arm` loads: a built-in name such as "ur5e", or a file. To time a
            joint path, any object with the `dof` and `limits` of an arm. A joint path without a
            tool path needs no arm if `limits` are given without torque.
        limits: Limits that replace those of the arm. Limits that are not given are those of the
            arm; infinity removes a limit.
        options: The method and its options: `Optimal`, the fastest timing that satisfies every
            limit; `Shaped`, the fastest path within a tolerance of the given one, with that
            timing; `Paper`, the paper's method; or `Conventional`, uniform speed along the raw
            path.
        progress: Called after every contour with the step "timing" and the fraction done.

    Raises:
        InvalidInput: A limit that the method needs is missing, an option that applies to one path
            for a program of several, too many intervals, or a speed at which the motion takes too
            long.
        Unreachable: A point of the path is out of reach, out of a joint range or singular.
        NotRealizable: The method cannot satisfy the limits on this path or in this duration, or
            does not support the given limits of jerk.

    Warns:
        UserWarning: A given limit exceeds that of the arm, the tool's angular rate jumps where the
            path has no corner, so that the motion stops, or limits of jerk add full stops where
            accelerations would jump.
    """
    arm = _require_arm(path, load_named(arm), limits)
    if limits is not None and getattr(arm, "limits", None) is NO_LIMITS:
        bounds = limits.for_joints(arm.dof)
    else:
        bounds = resolve_limits("plan", arm, limits)
    if not isinstance(arm, Arm):
        arm = _JointSpace(arm.dof, arm.limits)
    is_limited = arm.limits is not NO_LIMITS and not isinstance(path, Tracing)
    if is_limited and (warning := compare_limits(bounds, arm)):
        # Only jobs plan tracings, and they issue their own warnings.
        warnings.warn(capitalise(warning), stacklevel=3)
    options.check_jerk(bounds)
    traced: Tracing | JointPath
    if isinstance(path, JointPath | Tracing):
        traced = _check_traced(path, arm, bounds, options)
    else:
        program = Program.from_path(path)
        check_duration(program, bounds)
        if options.changes_path:
            program = options.reshape(program, arm, bounds, progress, named=program is path)
            for doubt in describe_unfinished(x.path for x in program.contours):
                warnings.warn(capitalise(doubt), stacklevel=3)
        traced = trace_program(
            program,
            arm,
            bounds,
            configuration=options.configuration,
            seed=options.seed,
            accept=options.accept,
        )
    reduced = reduce_limits(bounds, options.reserve, for_play=options.for_play)
    if isinstance(traced, JointPath):
        timing = Timing(arm, reduced, options)
        trajectory = options.time(traced, arm, reduced)
    else:
        timing = Timing(arm, reduced, options.for_program(traced.program))
        trajectory = time_program(traced, timing, progress)
    if isinstance(options, Optimal) and options.duration is not None:
        trajectory = slow_down(trajectory, options.duration, traced, timing)
    check_longest(trajectory.duration, "Raise the active limits")
    trajectory = trajectory.limited(
        bounds, options.reserve, None if isinstance(arm, _JointSpace) else arm
    )

    if isinstance(traced, Tracing) and traced is not path and not options.passes_corners:
        _warn_of_turns(traced.program)
    if not isinstance(path, Tracing) and bounds.limits_jerk:
        _warn_of_stops(trajectory)
    return trajectory


def _warn_of_turns(program: Program) -> None:
    """Warn of full stops because the tool's angular rate jumps where the path has no corner."""
    # Corners are stops that the path shows; the corners of a rounded path state their reasons.
    places = []
    for contour in program.contours:
        path = contour.path
        if path.orientation is not None and not isinstance(path, RoundedPath):
            corners = path.breaks[1:-1][path.turns > TANGENT_TOLERANCE]
            places.append(np.setdiff1d(path.stops, corners))
    stops = [x for x in places if len(x)]
    if stops:
        count = sum(map(len, stops))
        warnings.warn(
            f"The motion has {count_noun(count, 'full stop')} inside the path, the first at s = "
            f"{stops[0][0]:.4g} m, because the tool's orientation or its angular rate jumps there. "
            "round_corners(..., angular_tolerance=...) lets the rate change smoothly; along "
            "Path.spline it does.",
            stacklevel=4,
        )


def _warn_of_stops(trajectory: Trajectory) -> None:
    """Warn of full stops because accelerations with limits of jerk jump."""
    from armcontour.planning.explanation import find_jerk_stops

    stops = find_jerk_stops(trajectory)
    if len(stops):
        warnings.warn(
            f"Limits of jerk add {count_noun(len(stops), 'full stop')}, the first at s = "
            f"{stops[0]:.4g} m, because the curvature of the path or the angular acceleration of "
            'the tool jumps there. round_corners(..., continuity="curvature") and '
            "smooth_curvature make paths whose curvature does not jump. explain(...).jerk_stops "
            "lists the stops.",
            stacklevel=4,
        )


# Limits of an arm that limits nothing.
NO_LIMITS = Limits()


class _JointSpace(Arm):
    """Arm without kinematics and masses, to time a joint path that has no tool path."""

    name = "without a name"
    dimension = 0

    def __init__(self, dof: int, limits: Limits) -> None:
        self._dof = dof
        self.limits = limits

    @property
    def dof(self) -> int:
        """Number of joints."""
        return self._dof

    @property
    def joint_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the joints, by their numbers."""
        return tuple(f"joint {k + 1}" for k in range(self._dof))

    def _refuse(self, *states: Any, **named: Any) -> Any:
        raise InvalidInput(
            "The motion of the tool is unknown without an arm. Pass the arm to plan."
        )

    jacobian = _motion = _frames = _solutions = _refuse

    @cached_property
    def dynamics(self) -> NoReturn:
        """Not available, because the masses are unknown."""
        raise InvalidInput("Limits of torque need the masses of an arm. Pass the arm to plan.")


def _require_arm(
    path: Path | Program | JointPath | Tracing, arm: Arm | None, limits: Limits | None
) -> Arm:
    """Return the arm, or a `_JointSpace` for a joint path without a tool path."""
    if arm is None and limits and isinstance(path, JointPath) and path.tool_path is None:
        return _JointSpace(path.dof, NO_LIMITS)
    if arm is None:
        raise InvalidInput(
            "plan needs an Arm, such as load_arm('ur5e'). Only a joint path without a tool path "
            "can be planned with limits alone."
        )
    return arm


def check_duration(program: Program, limits: Limits) -> None:
    """Check the duration of a program at its assigned velocities against LONGEST_MOTION."""
    total = assigned_time(program, limits)
    if not total <= LONGEST_MOTION:
        raise InvalidInput(
            f"At its assigned velocities, and with its dwells, the path takes {total:.3g} s, but a "
            f"motion may last at most {LONGEST_MOTION:g} s. Raise speed, or shorten the dwells.",
            limit="speed",
            needed=total,
            allowed=LONGEST_MOTION,
        )


def assigned_time(program: Program, limits: Limits) -> float:
    """Return a program's duration at its assigned velocities, if given, plus its dwells [s]."""
    # This is an estimate: rounded corners shorten the motion, and other limits lengthen it.
    dwells = sum(x.duration for x in program.moves if isinstance(x, Dwell))
    paths = [x.path for x in program.contours]
    return dwells + sum(float((x.lengths / x.assigned_speeds(limits.speed)).sum()) for x in paths)


def _check_traced(
    path: JointPath | Tracing, arm: Arm, limits: Limits, options: PlanOptions
) -> JointPath | Tracing:
    """Check that a joint path or tracing fits the arm and the options, and return it."""
    # A joint path with a tool path is returned as a tracing.
    if options.changes_path:
        raise InvalidInput(
            f"The method {options.method} changes the tool path, but this path is already traced. "
            "Pass the Path or Program to plan."
        )
    if not (options.configuration is None and options.seed is None):
        specified = "seed" if options.configuration is None else "configuration"
        raise InvalidInput(
            f"This path is already traced, so {specified} cannot change it. Pass {specified} to "
            "trace instead."
        )
    has_ranges = limits.joint_lower is not None or limits.joint_upper is not None
    steps = (TracedMove(move=None, joint_path=path),) if isinstance(path, JointPath) else path.steps
    for step in steps:
        if step.joint_path is None:
            continue
        if step.joint_path.dof != arm.dof:
            raise ArmMismatch(
                f"The joint path has {step.joint_path.dof} joints, but the arm {arm.name} has "
                f"{arm.dof}. Plan the joint path with its own arm."
            )
        if has_ranges:
            with step.named():
                check_joint_range(step.joint_path, limits, arm)
    if isinstance(path, JointPath) and path.tool_path is not None:
        return Tracing.along(path, path.tool_path)
    return path
