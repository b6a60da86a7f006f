"""Entry point `plan`: checks the input, traces paths that are not traced yet, and times them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn, cast

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._describing import several
from armcontour._progress import Progress
from armcontour._text import capitalise
from armcontour.arms import Arm, Limits, compare_limits, resolve_limits
from armcontour.errors import InvalidInput, NotRealizable
from armcontour.geometry import Path
from armcontour.geometry.shaped import doubt_search
from armcontour.motion import JointPath, Method, Trajectory
from armcontour.program import Dwell, Program
from armcontour.timing.common import with_reserve
from armcontour.timing.constraints import Constraint
from armcontour.timing.explanation import find_jerk_stops
from armcontour.timing.given_duration import slow_down
from armcontour.timing.grid import DEFAULT_INTERVALS
from armcontour.timing.program_timing import (
    PLANNING_METHODS,
    Timing,
    refuse_unkept_jerk,
    time_contour,
    time_program,
)
from armcontour.timing.program_tracing import TracedMove, Tracing, trace_program
from armcontour.tracing import refuse_out_of_range

SHAPE_OPTIONS = ("tolerance", "line_tolerance", "zone", "angular_tolerance", "iterations")
OPTIONS = {
    "optimal": ("intervals", "grid", "start_speed", "end_speed", "constraints", "iterations"),
    "mac": ("knots", "period"),
    "conventional": (),
    "shaped": (*SHAPE_OPTIONS, "intervals"),
}
# Options that apply to one path only: a program has many paths, and rests between them.
OF_ONE_PATH = ("grid", "start_speed", "end_speed")
# With many contours each contour gets fewer grid intervals: it is shorter, and each costs time.
MOST_BY_DEFAULT = 40_000
FEWEST_INTERVALS = 500
# A motion of more than eleven days is a mistake in a number [s]; its times round to a nanosecond.
LONGEST_MOTION = 1e6


@_checks.checked
def plan(
    path: Path | Program | JointPath | Tracing,
    arm: Arm | Any | None = None,
    limits: Limits | None = None,
    *,
    method: str = "optimal",
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    fits: Callable[[JointPath], bool] | None = None,
    reserve: float = 0.0,
    duration: float | None = None,
    intervals: int | None = None,
    iterations: int | None = None,
    grid: npt.ArrayLike | None = None,
    start_speed: float | None = None,
    end_speed: float | None = None,
    constraints: Sequence[Constraint] | None = None,
    tolerance: float | None = None,
    line_tolerance: float | None = None,
    zone: float | None = None,
    angular_tolerance: float | None = None,
    knots: int | None = None,
    period: float | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Time a path or a program: compute its realizable trajectory.

    Args:
        path: A tool path, or a program of several with rapids between them, which are traced first;
            or a joint path or tracing.
        arm: The arm, or what has the `dof` and `limits` of an arm, to time a joint path. A joint
            path without a tool path needs none if `limits` are given, without those of torque.
        limits: Limits in place of those of the arm. What they do not give is the arm's own,
            infinity lifts a limit.
        method: "optimal", the fastest timing that keeps every limit; "shaped", the fastest path
            within a tolerance of the given one, with that timing; "mac", the paper's method; or
            "conventional", uniform speed along the raw path.
        branch: For an arm in the plane: the branch of its inverse kinematics; by default the one
            that is fastest along the path.
        start: For an arm in space: joint positions near the required start [rad], (dof,); by
            default the configuration that is fastest along the path.
        fits: Whether the arm may follow a joint path, such as `Cell(arm, scene).fits`: the fastest
            configuration that fits is taken, and the fastest of all if none does. By default no
            collisions are considered; `check_clearance` finds those of a plan.
        reserve: Share of the limits of joint acceleration and torque that is left to the servo.
        duration: Time from start to end [s], for the method "optimal": contours are slowed down by
            one factor, rapids and dwells are not. By default the motion is the fastest.
        progress: Called after every contour with the step "timing" and the share that is done.
        intervals: For "optimal" and "shaped": approximate number of grid intervals of each contour;
            by default 4000, fewer for a program of many contours.
        iterations: For "optimal" with limits of jerk and for "shaped": largest number of
            iterations; by default 150 and 60.
        grid: For "optimal" along one path: grid points [m], in place of `intervals`.
        start_speed: For "optimal" along one path: path speed at the start [m/s]; 0 by default.
        end_speed: For "optimal" along one path: path speed at the end [m/s]; 0 by default.
        constraints: For "optimal": further constraints.
        tolerance: For "shaped", as of `shape` [m].
        line_tolerance: For "shaped", as of `shape` [m].
        zone: For "shaped", as of `shape` [m].
        angular_tolerance: For "shaped", as of `shape` [rad].
        knots: For "mac": laps per line, as of `plan_mac`.
        period: For "mac": command interval [s]; 4 ms by default.

    Raises:
        InvalidInput: An unknown method, an option of another method, a limit that the method needs
            is missing, too many intervals, or a speed at which the motion takes too
            long.
        Unreachable: A point of the path is out of reach, out of a joint range or singular.
        NotRealizable: The method cannot keep the limits on this path, or not in so short a
            duration, or it keeps no limits of jerk and there are some.

    Warns:
        UserWarning: A given limit is above the arm's own, or limits of jerk add full stops, as
            accelerations would jump there.
    """
    options: dict[str, Any] = {
        "intervals": intervals,
        "iterations": iterations,
        "grid": grid,
        "start_speed": start_speed,
        "end_speed": end_speed,
        "constraints": constraints,
        "tolerance": tolerance,
        "line_tolerance": line_tolerance,
        "zone": zone,
        "angular_tolerance": angular_tolerance,
        "knots": knots,
        "period": period,
    }
    options = {name: x for name, x in options.items() if x is not None}
    if constraints is not None:
        options["constraints"] = _checks.listed(
            "constraints", constraints, Constraint, "Constraints"
        )
    for name in ("start_speed", "end_speed"):
        if name in options:
            options[name] = _checks.not_negative(name, options[name], "m/s")
    _refuse_options(method, options)
    arm = _arm_of(path, arm, limits)
    bounds = resolve_limits("plan", arm, limits)
    if not isinstance(path, Tracing) and (above := compare_limits(bounds, arm)):
        # Jobs plan tracings, and have warnings of their own.
        warnings.warn(capitalise(above), stacklevel=3)
    refuse_unkept_jerk(method, bounds)
    kept = with_reserve(bounds, reserve)
    if duration is not None:
        duration = _checks.positive("duration", duration, "s")
        _refuse_duration(duration, method, options)

    if method == Method.SHAPED:
        from armcontour.timing.shaping import Shaping, Wishes

        objective = _objective_of(path, options)
        refuse_endless(objective, kept)
        wishes = Wishes(**{name: x for name, x in options.items() if name in SHAPE_OPTIONS})
        options = {name: x for name, x in options.items() if name not in SHAPE_OPTIONS}
        shaping = Shaping(arm, bounds, reserve, wishes, branch, intervals)
        path = shaping.shape(objective, start, progress, named=objective is path)
        for doubt in doubt_search(x.path for x in path.contours):
            warnings.warn(capitalise(doubt), stacklevel=3)
    if isinstance(path, JointPath | Tracing):
        traced = _refuse_foreign(path, arm, bounds, branch, start)
    else:
        program = Program.of(path, "plan needs a Path, a JointPath or a Program")
        refuse_endless(program, bounds)
        traced = trace_program(program, arm, bounds, branch=branch, start=start, fits=fits)

    if isinstance(traced, JointPath):
        timing = Timing(arm, kept, method, options)
        found = time_contour(traced, timing)
    else:
        options = _fit_options(traced.program, method, options)
        timing = Timing(arm, kept, method, options)
        found = time_program(traced, timing, progress)
    if duration is not None:
        found = slow_down(found, duration, traced, timing)
    _refuse_endless_motion(found)
    found = found.limited(bounds, reserve, arm if isinstance(arm, Arm) else None)

    if not isinstance(path, Tracing) and bounds.jerk_limits:
        _warn_of_stops(traced, found)
    return found


def _warn_of_stops(traced: Tracing | JointPath, trajectory: Trajectory) -> None:
    """Warn of full stops that limits of jerk have added inside contours."""
    paths = {} if isinstance(traced, JointPath) else {x.move: x.joint_path for x in traced.steps}
    stops: list[float] = []
    for x in trajectory.contour_spans:
        joint_path = traced if isinstance(traced, JointPath) else paths[x.move]
        if joint_path is not None and x.trajectory is not None:
            stops += (x.s[0] + find_jerk_stops(joint_path, x.trajectory)).tolist()
    if stops:
        warnings.warn(
            f"Limits of jerk add {several(len(stops), 'full stop')}, the first at s = "
            f"{stops[0]:.4g} m, because the curvature of the path or the angular acceleration of "
            'the tool jumps there: round_corners(..., continuity="curvature") and smooth_curvature '
            "make paths whose curvature does not jump; explain(...).jerk_stops lists the stops.",
            stacklevel=4,
        )


def _objective_of(
    path: Path | Program | JointPath | Tracing, options: Mapping[str, Any]
) -> Program:
    """The objective of the method "shaped".

    Raises:
        InvalidInput: A path that is traced already, or no tolerance.
    """
    if isinstance(path, JointPath | Tracing):
        raise InvalidInput(
            "The method shaped changes the tool path, but this path is traced already: give it "
            "the Path or Program."
        )
    if "tolerance" not in options:
        raise InvalidInput(
            "The method shaped needs a tolerance, the largest distance of the path from the "
            "objective [m], such as plan(..., tolerance=1e-3)."
        )
    return Program.of(path, "plan needs a Path or a Program")


@dataclass(frozen=True, slots=True)
class _Joints:
    """What planning asks of an arm along a joint path: how many joints there are."""

    dof: int
    limits: Limits = Limits()
    name: str = "without a name"
    limits_hint: str = ""

    @property
    def dynamics(self) -> NoReturn:
        """Refused, as nothing is known of the masses.

        Raises:
            InvalidInput: Always.
        """
        raise InvalidInput("Limits of torque need an arm with masses: give plan the arm.")


def _arm_of(
    path: Path | Program | JointPath | Tracing, arm: Arm | None, limits: Limits | None
) -> Arm:
    """The arm, or what stands for it along a joint path without a tool path.

    Raises:
        InvalidInput: The arm is missing, or is none.
    """
    alone = isinstance(path, JointPath) and path.tool_path is None and limits is not None
    if arm is None and alone:
        return cast(Arm, _Joints(cast(JointPath, path).dof))
    if arm is None:
        raise InvalidInput(
            "plan needs an Arm, such as load_arm('ur5e'), not None; only a joint path without a "
            "tool path can be planned with limits alone."
        )
    return arm


def _refuse_options(method: str, options: Mapping[str, Any]) -> None:
    """Refuse options that a method does not have.

    Raises:
        InvalidInput: Such an option.
    """
    _checks.choice("method", method, PLANNING_METHODS)
    known = OPTIONS[method]
    unknown = sorted(set(options) - set(known))
    if unknown:
        takes = f"the options {', '.join(known)}" if known else "no options"
        raise InvalidInput(f"The method {method} takes {takes}, not {unknown[0]}.")


def _refuse_duration(duration: float, method: str, options: Mapping[str, Any]) -> None:
    """Refuse a duration that cannot be planned for, whatever the path.

    Raises:
        InvalidInput: It is no time, the method is not "optimal", or the path is entered or left at
            a speed.
    """
    _checks.between("duration", duration, 0, LONGEST_MOTION, "s")
    if method != Method.OPTIMAL:
        raise InvalidInput(f"A duration is planned by the method optimal only, not by {method}.")
    for name in ("start_speed", "end_speed"):
        if options.get(name):
            raise InvalidInput(
                f"A motion of a given duration starts and ends at rest: leave out {name}, or "
                "duration."
            )


def _fit_options(program: Program, method: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Fit the options of a method to all contours of a program.

    Raises:
        InvalidInput: An option that applies to one path only.
    """
    for name in OF_ONE_PATH:
        if name in options and program.single_path is None:
            raise InvalidInput(
                f"{name} is an option for one path: a program rests between its moves."
            )
    fewer = intervals_of(program)
    if method == Method.OPTIMAL and fewer is not None:
        return {"intervals": fewer, **options}
    return dict(options)


def intervals_of(program: Program) -> int | None:
    """Grid intervals for each contour of a program; None for the default of a single path."""
    count = len(program.contours)
    if count <= MOST_BY_DEFAULT // DEFAULT_INTERVALS:
        return None
    return max(FEWEST_INTERVALS, MOST_BY_DEFAULT // count)


def refuse_endless(program: Program, limits: Limits) -> None:
    """Refuse a program that takes longer than LONGEST_MOTION at its assigned velocities.

    Raises:
        InvalidInput: The program takes longer.
    """
    total = assigned_time(program, limits)
    if not total <= LONGEST_MOTION:
        raise InvalidInput(
            f"At its assigned velocities, and with its dwells, the path takes {total:.3g} s, but a "
            f"motion lasts {LONGEST_MOTION:g} s at most: raise speed, or shorten the dwells.",
            limit="speed",
            needed=total,
            allowed=LONGEST_MOTION,
        )


def assigned_time(program: Program, limits: Limits) -> float:
    """Time of a program at its assigned velocities, where given, and of its dwells [s].

    Rounded corners make the motion shorter, limits make it longer.
    """
    dwells = sum(x.duration for x in program.moves if isinstance(x, Dwell))
    return dwells + sum(_assigned_time(x.path, limits) for x in program.contours)


def _assigned_time(path: Path, limits: Limits) -> float:
    """Time of a path at its assigned velocities [s]; segments without one count as zero."""
    speeds = np.fmin(path.speeds, np.inf if limits.speed is None else limits.speed)
    return float((path.lengths / speeds).sum())


def _refuse_endless_motion(trajectory: Trajectory) -> None:
    """Refuse a trajectory that takes longer than LONGEST_MOTION.

    Raises:
        NotRealizable: The trajectory takes longer, or its duration is not a number.
    """
    if not trajectory.duration <= LONGEST_MOTION:
        raise NotRealizable(
            f"The motion would take {trajectory.duration:.3g} s, but lasts {LONGEST_MOTION:g} s at "
            "most: raise the limits that bind.",
            needed=trajectory.duration,
            allowed=LONGEST_MOTION,
        )


def _refuse_foreign(
    path: JointPath | Tracing,
    arm: Arm,
    limits: Limits,
    branch: str | None,
    start: npt.ArrayLike | None,
) -> JointPath | Tracing:
    """What the joints follow: a tracing, or a joint path that has no tool path.

    Raises:
        InvalidInput: A joint path of another arm, or a `branch` or `start` for a traced path.
        Unreachable: A joint path leaves a joint range.
    """
    if not (branch is None and start is None):
        given = "start" if branch is None else "branch"
        raise InvalidInput(f"A joint path is traced already: give {given} to trace instead.")
    steps = (TracedMove(move=None, joint_path=path),) if isinstance(path, JointPath) else path.steps
    for x in steps:
        if x.joint_path is None:
            continue
        if x.joint_path.dof != arm.dof:
            raise InvalidInput(
                f"The joint path has {x.joint_path.dof} joints, but the arm {arm.name} has "
                f"{arm.dof}."
            )
        with x.named():
            refuse_out_of_range(x.joint_path, limits)
    if isinstance(path, JointPath) and path.tool_path is not None:
        return Tracing.along(path, path.tool_path)
    return path
