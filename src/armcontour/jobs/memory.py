"""Estimated memory of the runs of a job; refuses a run that needs more than the job allows."""

from __future__ import annotations

from collections.abc import Iterable

from armcontour import _memory
from armcontour.compensation import set_point_count
from armcontour.execution import ServoPlant
from armcontour.execution.rigid_body_plant import bytes_of
from armcontour.jobs.job import Job, Run

# Largest time between two results of an execution [s], unless the drives on bodies are slower.
RESOLUTION = 1e-3
# Memory of one set-point per joint, from its computation to the written files [bytes], measured.
SET_POINT = 230.0
# Memory of one path segment per joint [bytes], measured on programs of 150,000 lines: while it is
# planned, also under limits of torque with viscous friction, and afterwards.
SEGMENT, SEGMENT_WITH_DRAG, SEGMENT_STAYS = 1500.0, 2600.0, 400.0
# Share of a run's memory that its results keep after the run is done.
STAYS = 0.5


def refuse_too_large(
    job: Job,
    this: Run,
    duration: float,
    earlier: Iterable[tuple[Run, float]],
    simulated: bool,
    *,
    planned: bool = True,
) -> None:
    """Refuse a run that takes more memory than its job may.

    Args:
        job: The job.
        this: The run.
        duration: Duration of the motion [s].
        earlier: Runs that are done, and the durations of their motions [s].
        simulated: Whether the execution is simulated.
        planned: Whether the duration is that of the plan, not a lower bound of it.

    Raises:
        InvalidInput: The run needs more memory than the job allows.
    """
    kept = sum(STAYS * needed_bytes(job, x, time, simulated) for x, time in earlier)
    count = _count(job, this, duration)
    words = (
        f"{'' if planned else 'At least '}{duration:.4g} s of motion at a command interval of "
        f"{this.period:g} s, {count:.3g} set-points{' and their simulation' if simulated else ''},"
    )
    mend = "take a longer command interval or a higher speed"
    if simulated:
        mend += ", leave the simulation out (--no-simulation)"
    needed = kept + needed_bytes(job, this, duration, simulated)
    _memory.refuse_above(job.memory, needed, words, mend)


def needed_bytes(job: Job, this: Run, duration: float, simulated: bool) -> float:
    """Estimate the memory of a run [bytes].

    Args:
        job: The job.
        this: The run.
        duration: Duration of the motion [s].
        simulated: Whether the execution is simulated.
    """
    count, dof = _count(job, this, duration), job.arm.dof
    segments = sum(len(x.path) for x in job.program.contours)
    chain = job.arm.chain
    viscous = None if chain is None or this.limits.joint_torque is None else chain.viscous
    drag = viscous is not None and bool(viscous.any())
    planned = segments * (SEGMENT_WITH_DRAG if drag else SEGMENT) * dof
    # Set-points come when the plan is made.
    found = (count * SET_POINT + segments * SEGMENT_STAYS) * dof
    if not simulated:
        return max(planned, found)
    span = count * this.period
    plant = ServoPlant(job.arm, job.plant_servo, this.limits)
    found += plant.memory(span, this.period, RESOLUTION)
    if this.experiment is not None:
        step = this.experiment.step
        found += bytes_of(plant.servo, step, span, this.period, max(RESOLUTION, step))
    return max(planned, found)


def _count(job: Job, this: Run, duration: float) -> float:
    """Number of set-points of a run."""
    poles = this.compensation_options.get("poles")
    servo = job.servo.for_joints(job.arm.dof)
    return set_point_count(duration, servo, this.period, this.compensation, poles)
