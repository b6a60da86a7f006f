"""Entry point `plan`: checks its input and calls the timing method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks, _memory
from armcontour.arms import Arm, Limits
from armcontour.errors import InvalidInput, NotRealizable
from armcontour.geometry import Path
from armcontour.motion import JointPath, Law, Method, Trajectory
from armcontour.program import Dwell, Program
from armcontour.timing.conventional import plan_conventional
from armcontour.timing.fastest_configuration import trace_fastest
from armcontour.timing.grid import AT_AN_INTERVAL, DEFAULT_INTERVALS
from armcontour.timing.mac import plan_mac
from armcontour.timing.optimal import plan_optimal
from armcontour.timing.programs import Progress, Ways, plan_program, plan_rapid
from armcontour.tracing import refuse_out_of_range

METHODS = tuple(x.value for x in Method)
# Limits of which a reserve is a share.
RESERVED = ("joint_acceleration", "joint_deceleration", "joint_torque")
# Options that mean one path: a program has many, and rests between them.
OF_ONE_PATH = ("grid", "start_speed", "end_speed")
# Of many contours each has fewer grid intervals: they are shorter, and all of them cost time.
MOST_BY_DEFAULT = 40_000
FEWEST_INTERVALS = 500
# Options that say how many places there are; a lap of a line takes what an interval does.
COUNTS = ("intervals", "knots")
# A motion of more than eleven days is a mistake in a number [s]; its times round to a nanosecond.
LONGEST_MOTION = 1e6
OPTIONS = {
    "optimal": ("intervals", "grid", "start_speed", "end_speed", "constraints"),
    "mac": ("knots", "period"),
    "conventional": (),
}


def plan(
    path: Path | JointPath | Program,
    arm: Arm,
    limits: Limits | None = None,
    *,
    method: str = "optimal",
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    ignore_jerk: bool = False,
    reserve: float = 0.0,
    progress: Progress | None = None,
    memory: float = _memory.DEFAULT,
    **options: Any,
) -> Trajectory:
    """Time a path: the realizable trajectory.

    Args:
        path: A tool path, which is traced first, or a traced one; or a program of several, which
            has rapids between them.
        arm: The arm.
        limits: By default the arm's own.
        method: "optimal", the fastest that keeps every limit; "mac", the paper's; or
            "conventional", uniform speed along the raw path.
        branch: For a tool path and an arm in the plane, the branch of its inverse kinematics.
        start: For a tool path and an arm in space, joint positions near to those to start in [rad];
            by default the configuration that is fastest along the path.
        ignore_jerk: Plan in spite of limits of jerk, which no method keeps yet.
        reserve: Share of the limits of joint acceleration and torque that is left to the servo.
        progress: For a program: called with the number of contours done, and of all.
        memory: What the program may take [bytes].
        options: For "optimal": `intervals` or `grid`, `start_speed`, `end_speed`, `constraints`
            (see `plan_optimal`); a program takes neither grid nor speeds, and `intervals` hold for
            every contour, by default fewer the more contours there are. For "mac": `knots` per
            line, command `period` [s].

    Raises:
        InvalidInput: An unknown method or option, a limit that the method needs is missing, more
            intervals than the memory takes, or a speed at which the path takes for ever.
        Unreachable: A place of the path is out of reach, out of a joint's range or singular.
        NotRealizable: The method cannot keep the limits on this path, or there are limits of jerk.
    """
    _checks.choice("method", method, METHODS)
    if not isinstance(path, Path | JointPath | Program):
        raise InvalidInput(
            f"plan needs a Path, a JointPath or a Program, not {type(path).__name__}."
        )
    # Whatever has joints will do for a joint path, so this looks for no more.
    if not hasattr(arm, "dof"):
        raise InvalidInput(
            f"plan needs an Arm, such as load_arm('ur5e'), not {type(arm).__name__}."
        )
    if limits is not None and not isinstance(limits, Limits):
        raise InvalidInput(
            "plan needs Limits, such as arm.limits.replace(speed=0.1), not "
            f"{type(limits).__name__}."
        )
    bounds = (arm.limits if limits is None else limits).for_joints(arm.dof)
    refuse_jerk(bounds, ignore_jerk)
    known = OPTIONS[method]
    unknown = sorted(set(options) - set(known))
    if unknown:
        takes = f"the options {', '.join(known)}" if known else "no options"
        raise InvalidInput(f"The method {method} takes {takes}, not {unknown[0]}.")
    kept = with_reserve(bounds, reserve)
    if isinstance(path, Path | Program):
        refuse_endless(path, bounds)
    for name in COUNTS:
        if options.get(name) is not None:
            wanted = _checks.number(name, options[name])
            _memory.refuse_above(
                memory,
                wanted * AT_AN_INTERVAL * arm.dof,
                f"A plan of {wanted:g} {name}",
                "take fewer",
            )
    if isinstance(path, Program):
        for name in OF_ONE_PATH:
            if name in options:
                raise InvalidInput(
                    f"{name} is an option for one path: a program rests between its moves."
                )
        if method == "optimal":
            options.setdefault("intervals", intervals_of(path))

    def timed(joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        return _timed(joint_path, arm, kept, method, memory, options)

    def rapid(joint_path: JointPath, before: Sequence[Law]) -> Trajectory:
        return plan_rapid(joint_path, arm, kept)

    if isinstance(path, Program):
        ways = Ways(arm=arm, limits=bounds, branch=branch, start=start, contour=timed, rapid=rapid)
        return _ending(plan_program(path, ways, progress))
    return _ending(timed(_joint_path(path, arm, bounds, branch, start)))


def intervals_of(program: Program) -> int | None:
    """Grid intervals of every contour of a program; None for those of a path by itself."""
    count = len(program.contours)
    if count <= MOST_BY_DEFAULT // DEFAULT_INTERVALS:
        return None
    return max(FEWEST_INTERVALS, MOST_BY_DEFAULT // count)


def refuse_endless(path: Path | Program, limits: Limits) -> None:
    """Refuse assigned velocities and dwells that take longer than LONGEST_MOTION.

    Raises:
        InvalidInput: They do.
    """
    total = assigned_time(path, limits)
    if not total <= LONGEST_MOTION:
        raise InvalidInput(
            f"At its assigned velocities, and with its dwells, the path takes {total:.3g} s, but a "
            f"motion lasts {LONGEST_MOTION:g} s at most: raise speed, or shorten the dwells.",
            limit="speed",
            needed=total,
            allowed=LONGEST_MOTION,
        )


def assigned_time(path: Path | Program, limits: Limits) -> float:
    """Time that a path takes at its assigned velocities, where there are any, and its dwells [s].

    Rounded corners make it shorter, limits longer.
    """
    if isinstance(path, Program):
        dwells = sum(x.duration for x in path.moves if isinstance(x, Dwell))
        return dwells + sum(assigned_time(x.path, limits) for x in path.contours)
    # A segment without a velocity takes a time that is not known yet.
    speeds = np.fmin(path.speeds, np.inf if limits.speed is None else limits.speed)
    return float(np.sum(path.lengths / np.where(np.isnan(speeds), np.inf, speeds)))


def _ending(trajectory: Trajectory) -> Trajectory:
    """A trajectory that takes no longer than LONGEST_MOTION.

    Raises:
        NotRealizable: It takes longer, or its duration is not a number.
    """
    if not trajectory.duration <= LONGEST_MOTION:
        raise NotRealizable(
            f"The motion would take {trajectory.duration:.3g} s, but lasts {LONGEST_MOTION:g} s at "
            "most: raise the limits that hold it back.",
            needed=trajectory.duration,
            allowed=LONGEST_MOTION,
        )
    return trajectory


def with_reserve(limits: Limits, reserve: float) -> Limits:
    """Limits of which a share of joint acceleration and torque is left over.

    Raises:
        InvalidInput: No share below 1.
    """
    if not 0 <= _checks.number("reserve", reserve) < 1:
        raise InvalidInput(f"reserve must be a share from 0 to below 1, but is {reserve:g}.")
    left = {
        name: (1 - reserve) * value
        for name in RESERVED
        if (value := getattr(limits, name)) is not None
    }
    return limits.replace(**left) if reserve and left else limits


def _timed(
    joint_path: JointPath,
    arm: Arm,
    limits: Limits,
    method: str,
    memory: float,
    options: dict[str, Any],
) -> Trajectory:
    """The plan of a joint path by a method."""
    if method == "optimal":
        return plan_optimal(joint_path, arm, limits, memory=memory, **options)
    if method == "mac":
        return plan_mac(joint_path, arm, limits, **options)
    return plan_conventional(joint_path, arm, limits)


def _joint_path(
    path: Path | JointPath,
    arm: Arm,
    limits: Limits,
    branch: str | None,
    start: npt.ArrayLike | None,
) -> JointPath:
    """The path as a joint path inside the joints' ranges.

    Raises:
        InvalidInput: A joint path of another arm, or one with a branch or a start.
        Unreachable: A place of the path is out of reach, out of a joint's range or singular.
    """
    if isinstance(path, Path):
        return trace_fastest(path, arm, limits, branch=branch, start=start)
    if not (branch is None and start is None):
        given = "start" if branch is None else "branch"
        raise InvalidInput(f"A joint path is on its way already: give {given} to trace instead.")
    if path.dof != arm.dof:
        raise InvalidInput(
            f"The joint path has {path.dof} joints, but the arm {arm.name} has {arm.dof}."
        )
    refuse_out_of_range(path, limits)
    return path


def refuse_jerk(limits: Limits, ignored: bool) -> None:
    """Refuse limits of jerk unless they are ignored on purpose.

    Raises:
        NotRealizable: There are such limits.
    """
    if limits.joint_jerk is not None and not ignored:
        raise NotRealizable(
            "No planner keeps limits of jerk yet: pass ignore_jerk=True (in a job, "
            "ignore_jerk: true) to plan without them, or lift them with "
            "limits.replace(joint_jerk=None).",
            limit="joint_jerk",
        )
