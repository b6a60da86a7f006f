"""Rapids of a certified program: the fastest that keep all joint limits when executed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.certification._approach import Approach
from armcontour.certification._proving import bound_uses
from armcontour.certification._uses import (
    OUTSIDE,
    Robot,
    execute_over_box,
    peak_demands,
    run,
)
from armcontour.errors import NotRealizable
from armcontour.evaluation import check
from armcontour.motion import Execution, JointPath, Law, TaughtData, Trajectory
from armcontour.servo import ServoModel
from armcontour.timing.program_timing import time_rapid

# In so many command intervals accelerations rise to their limits; the fastest rapid is taken.
RISES = (0.0, 0.5)
# Each plan derates the limits that the last one exceeded.
MOST_TRIALS = 12
# Trials aim at this share of each limit: set-points next to the end of a rapid have a part of the
# contour after it.
GOAL = 1 - 1e-3
# They are derated by a little more, so that they arrive.
CLOSE = 1e-5
POINTS = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Derated:
    """A rapid that keeps its limits when it is executed.

    Args:
        factors: Shares that are left of limits along the rapid, by the limits' names.
        trajectory: The plan.
    """

    factors: dict[str, float]
    trajectory: Trajectory


def plan_fastest_rapid(
    joint_path: JointPath,
    before: Sequence[Law],
    robot: Robot,
    margin: float = 1.0,
    speed: float | None = None,
) -> Derated:
    """Plan the fastest rapid that keeps all joint limits on every robot of the box.

    A joint that saturates in a rapid would be late at the start of the contour. So no rapid
    saturates a joint by itself, even if contours may; in that case the rapid starts from rest.

    Args:
        joint_path: The joint path of the rapid.
        before: The laws before it.
        robot: The robot.
        margin: Share of its limits that the rapid may use.
        speed: As of `time_rapid`.

    Raises:
        NotRealizable: No rapid was found that keeps its limits.
    """
    approach = Approach.of(() if robot.saturated else before, robot)
    # Demands are measured without saturation: on a saturated plant they say nothing of the excess.
    robot = replace(robot, saturated=False)
    limits = robot.limits
    steep = limits.jerk_limits or limits.joint_acceleration is None
    plans = [
        _derate(joint_path, approach, robot, GOAL * margin, speed, rise)
        for rise in ((0.0,) if steep else RISES)
    ]
    found = [x for x in plans if x is not None]
    if not found:
        raise NotRealizable(
            f"No rapid keeps its limits when it is executed, after {MOST_TRIALS} plans of it: its "
            f"set-points come every {robot.run.period * 1e3:g} ms; take a shorter command "
            "interval, or linear interpolation.",
            limit="joint_acceleration",
        )
    return min(found, key=lambda x: x.trajectory.duration)


def _derate(
    joint_path: JointPath,
    approach: Approach,
    robot: Robot,
    goal: float,
    speed: float | None,
    rise: float,
) -> Derated | None:
    """Derate a rapid until it keeps its limits; None if MOST_TRIALS plans do not.

    Args:
        joint_path: The joint path of the rapid.
        approach: The motion before it.
        robot: The robot.
        goal: Share of its limits that it may use.
        speed: As of `time_rapid`.
        rise: In how many command intervals accelerations rise from zero to their limits, at least.
    """
    factors: dict[str, float] = {}
    for _ in range(MOST_TRIALS):
        left = {name: getattr(robot.limits, name) * share for name, share in factors.items()}
        if rise:
            low, high = robot.limits.acceleration_bounds(robot.arm.dof)
            left["joint_jerk"] = np.minimum(-low, high) / (rise * robot.run.period)
        plan = time_rapid(joint_path, robot.arm, robot.limits.replace(**left), speed)
        over = {name: x for name, x in _uses(plan, approach, robot).items() if x > goal}
        if not over:
            return Derated(factors=factors, trajectory=plan)
        for name, ratio in over.items():
            factors[name] = factors.get(name, 1.0) * goal / ratio * (1 - CLOSE)
    return None


def _uses(plan: Trajectory, approach: Approach, robot: Robot) -> dict[str, float]:
    """Largest use of each limit by a rapid: by its plan, its set-points and its executions."""
    free = robot.limits.of_joints
    uses = {x.name: x.ratio for x in check(plan, robot.arm, free, points=POINTS).uses}
    for name, ratio in bound_uses(plan, robot.arm, free).items():
        uses[name] = max(uses.get(name, 0.0), ratio)
    # Steps at breaks, and the path's own speeds, are no limits of a rapid.
    uses = {name: x for name, x in uses.items() if getattr(free, name, None) is not None}
    taught = approach.teach(plan, robot)
    robots = [(robot.servo, run(robot, taught))]
    if robot.box is not None:
        groups = execute_over_box(robot, taught)
        robots += [x for group in groups for x in zip(group.servos, group.runs, strict=True)]
    since = 0.0 if approach.laws else None
    demand = max(_demand(robot, x, servo, since) for servo, x in robots)
    if free.joint_acceleration is not None:
        uses["joint_acceleration"] = max(uses.get("joint_acceleration", 0.0), demand)
    if free.joint_velocity is not None:
        uses["joint_velocity"] = max(uses.get("joint_velocity", 0.0), _command(robot, taught))
    return uses


def _demand(robot: Robot, executed: Execution, servo: ServoModel, since: float | None) -> float:
    """Largest demand of any joint over its limit; it counts from the time `since` [s]."""
    low, high = robot.saturating()
    least, most = peak_demands(executed, servo, since)
    return float(np.maximum(least / low, most / high).max())


def _command(robot: Robot, taught: TaughtData) -> float:
    """Largest use of joint velocity limits by set-points; above 1 for a set-point out of range."""
    dof = robot.arm.dof
    now = taught.q[np.searchsorted(taught.t, 0.0) :]
    rate = np.diff(now, axis=0) / taught.period
    low, high = robot.limits.velocity_bounds(dof)
    share = np.maximum(rate / low, rate / high).max(initial=0.0)
    lower, upper = robot.limits.joint_range(dof)
    outside = bool(((now < lower) | (now > upper)).any())
    return max(float(share), OUTSIDE if outside else 0.0)
