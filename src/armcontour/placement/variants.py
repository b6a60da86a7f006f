"""A job with another arm, or another tool: which one is enough?"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from armcontour.arms import Arm, SerialArm, resolve_limits
from armcontour.arms.limits import JOINT_VALUES
from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.jobs.job import Job, Run
from armcontour.servo import ServoModel


def with_arm(job: Job, arm: Arm) -> Job:
    """The job with another arm: limits of joints are that arm's own, those of the tool stay.

    Args:
        job: The job.
        arm: The other arm, with its tool and work frame.

    Raises:
        InvalidInput: The arm does not move as the job's does, or the job has values per joint that
            differ and another number of joints.
    """
    if arm.dimension != job.arm.dimension:
        raise InvalidInput(
            f"The arm {arm.name} moves its tool in {arm.dimension} coordinates, but the arm of the "
            f"job in {job.arm.dimension}."
        )
    return replace(
        job,
        arm=arm,
        start=None,
        branch=None,
        servo=_servo(job.servo, arm),
        plant_servo=_servo(job.plant_servo, arm),
        runs=tuple(_run(x, arm) for x in job.runs),
    )


def with_tool(job: Job, tool: Frame) -> Job:
    """The job with another tool frame of its arm in space.

    Args:
        job: The job.
        tool: The tool frame in the frame of the tip.

    Raises:
        InvalidInput: The arm moves in the plane, and has no tool frame.
    """
    if not isinstance(job.arm, SerialArm):
        raise InvalidInput(f"The arm {job.arm.name} moves in the plane, and has no tool frame.")
    return replace(job, arm=job.arm.with_tool(tool))


def _run(run: Run, arm: Arm) -> Run:
    """A run under the limits of another arm; drives that an experiment assumes are left out."""
    of_tool = run.limits.replace(**dict.fromkeys(JOINT_VALUES))
    return replace(run, limits=resolve_limits("A run", arm, of_tool), experiment=None)


def _servo(servo: ServoModel, arm: Arm) -> ServoModel:
    """A servo for the joints of another arm.

    Raises:
        InvalidInput: Values of joints differ, and there is another number of joints.
    """
    changes = {}
    for x in fields(servo):
        value = getattr(servo, x.name)
        if isinstance(value, np.ndarray) and value.size != arm.dof:
            if (value != value.flat[0]).any():
                raise InvalidInput(
                    f"The servo has {value.size} values of {x.name}, but the arm {arm.name} has "
                    f"{arm.dof} joints: give the servo one value for all."
                )
            changes[x.name] = float(value.flat[0])
    return servo.replace(**changes).for_joints(arm.dof) if changes else servo
