"""`unfinished_place`: where to resume a job from the record of a command that did not end.

The record has no time of the plan, because the override may have changed. The plan's time is found
from the measured joints: it never decreases, and goes on at most as fast as the clock.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from armcontour.controllers.controller import (
    START_TOLERANCE,
    START_TOLERANCE_LINEAR,
    Controller,
    per_joint,
)
from armcontour.controllers.player import plan_kept, start_override
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.progress import Progress
from armcontour.core.quantities import Axes, Distance, Quantity
from armcontour.jobs.job import Job, choose_run
from armcontour.jobs.stopped_place import StoppedPlace, find_stopped_place
from armcontour.motion import Trajectory

# The plan is compared with the record at these times [s].
PLAN_STEP = 1e-3
# A measured motion may be so much faster than its plan while it reaches it.
FASTER = 2.0
# Positions that differ by less are equal: the plan may rest there [rad].
SAME_POSITION = 1e-6
# The plan's time of so many last samples is refined, at so many times around it.
REFINED_SAMPLES = 200
REFINED_TIMES = 401


@declared(eq=False)
class UnfinishedMotion(Checked):
    """Record of a motion whose command did not end, such as one that was killed.

    Args:
        job: Name of the job.
        run: Name of its run.
        only: Value of `process.only`.
        resume_at: Value of `process.resume_at` [m].
        rejoin: Value of `process.rejoin` [m].
        t: Times by the controller's clock [s], (n,).
        measured: Measured positions [rad], (n, dof).
        cycle: Cycle of the motion in each sample, negative before and after it, (n,). The motion to
            the start is a motion of its own.
    """

    job: str
    run: str
    only: tuple[str, ...] = ()
    resume_at: Distance = 0.0
    rejoin: Distance = 0.0
    t: Annotated[FloatArray, Quantity("s"), Axes("n")]
    measured: Annotated[FloatArray, Quantity("rad"), Axes("n", "joints")]
    cycle: Annotated[FloatArray, Quantity("1"), Axes("n")]

    @property
    def begin(self) -> int:
        """Index of the first sample of the last motion; the number of samples without a motion."""
        begins = (self.cycle >= 0) & (np.diff(self.cycle, prepend=-1.0) != 0) & (self.cycle == 0)
        found = np.flatnonzero(begins)
        return int(found[-1]) if len(found) else len(self.t)


def unfinished_place(
    job: Job,
    controller: Controller,
    record: UnfinishedMotion,
    *,
    run_name: str | None = None,
    learned: bool = False,
    progress: Progress | None = None,
) -> StoppedPlace:
    """Find where to resume a job whose command did not end; `play` takes the result as `resume`.

    Args:
        job: The job that was played.
        controller: The controller.
        record: The record, as `read_unfinished` returns it.
        run_name: The run; by default that of the record.
        learned: Whether set-points of `learn` were played.
        progress: Called with the steps.

    Raises:
        InvalidInput: The record belongs to another job.
        ArmContourError: The job cannot be planned.
    """
    if job.name != record.job:
        raise InvalidInput(
            f"The motion that did not end belongs to the job {record.job!r}, but this is the job "
            f"{job.name!r}. Specify the job that was played."
        )
    process = replace(
        job.process, resume_at=record.resume_at, only=record.only, rejoin=record.rejoin
    )
    part = replace(job, process=process)
    name = run_name or record.run
    speed = start_override(choose_run(part, name, "played"), learned=learned)
    played_job, planned = plan_kept(part, controller, name, learned, speed, progress)
    begin = record.begin
    first = planned.trajectory(0.0)
    arm = played_job.arm
    allowed = per_joint(arm, START_TOLERANCE, START_TOLERANCE_LINEAR, arm.dof)
    if begin == len(record.t) or (np.abs(record.measured[begin] - first) > 2 * allowed).any():
        return StoppedPlace(
            resume_at=record.resume_at,
            words="before the motion, which has not begun",
            job=record.job,
            run=name,
            only=record.only,
            measured=record.measured[-1],
        )
    measured = record.measured[begin:]
    t = plan_times(planned.trajectory, record.t[begin:], measured)
    return find_stopped_place(played_job, planned, float(t[-1]), t, measured)


def plan_times(plan: Trajectory, t: FloatArray, measured: FloatArray) -> FloatArray:
    """Return the times of the plan at which joints were where they were measured [s], (n,).

    Each time is the nearest one from the time before on, by at most FASTER times the elapsed time.

    Args:
        plan: The plan, which begins at the first sample.
        t: Times by the controller's clock [s], (n,).
        measured: Measured positions [rad], (n, dof).
    """
    times = np.append(np.arange(0.0, plan.duration, PLAN_STEP), plan.duration)
    planned = plan(times)
    indices: IntArray = np.zeros(len(t), dtype=int)
    i = 0
    steps = np.ceil(FASTER * np.diff(t, prepend=t[0]) / PLAN_STEP).astype(int) + 1
    for sample, count in enumerate(steps.tolist()):
        ahead = planned[i : i + count + 1]
        distances = np.abs(ahead - measured[sample]).max(axis=1)
        # If the plan rests, the last of these times.
        i += int(np.flatnonzero(distances <= distances.min() + SAME_POSITION)[-1])
        indices[sample] = i
    found = times[indices]
    around = np.linspace(-PLAN_STEP, PLAN_STEP, REFINED_TIMES)
    for sample in range(max(len(t) - REFINED_SAMPLES, 0), len(t)):
        near = np.clip(found[sample] + around, 0.0, plan.duration)
        distances = np.abs(plan(near) - measured[sample]).max(axis=1)
        found[sample] = near[int(distances.argmin())]
    return np.asarray(found)
