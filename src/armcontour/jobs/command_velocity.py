"""Constraint that keeps the velocity of compensated set-points, for runs whose plan exceeds it."""

from __future__ import annotations

from armcontour.core.checks import FloatArray
from armcontour.jobs.job import Job, Run
from armcontour.jobs.verdict import VERDICT_ROUNDING
from armcontour.motion import PathLaw, Trajectory
from armcontour.planning import Optimal
from armcontour.planning.constraints import CommandVelocity
from armcontour.planning.explanation import ends_of_law


def exceeded_command_velocity(job: Job, run: Run, trajectory: Trajectory) -> CommandVelocity | None:
    """Return the constraint of the set-point velocity if the contours of a plan exceed it.

    Rapids do not need it: while set-points catch up with a rapid, no tool path is followed.

    - `trajectory`: plan without this constraint.
    """
    command = command_velocity(job, run)
    if command is None:
        return None
    for span in trajectory.contour_spans:
        assert span.trajectory is not None
        for law in span.trajectory.laws:
            if isinstance(law, PathLaw):
                usage = command.usage(ends_of_law(law, job.arm))
                if usage.max() > 1.0 + VERDICT_ROUNDING:
                    return command
    return None


def command_velocity(job: Job, run: Run) -> CommandVelocity | None:
    """Return the constraint of the set-point velocity; None if the set-points have no bounds.

    Of a second-order servo, only the first-order part is considered: set-points also contain the
    jerk, which the planner does not limit.
    """
    if not run.compensation.compensates or not isinstance(run.timing, Optimal):
        return None
    slowest, fastest = job.rule(run, run.limits).bounds[1]
    command = CommandVelocity(set_point_lead(job), slowest, fastest)
    return command if len(command.bounded) else None


def set_point_lead(job: Job) -> FloatArray:
    """Return the time by which the set-points of each joint lead the plan [s], (dof,).

    It is (1 - f) / kp, with the velocity feed-forward f.
    """
    servo = job.servo.for_joints(job.arm.dof)
    advance, _ = servo.lead
    return 1 / servo.kp - advance
