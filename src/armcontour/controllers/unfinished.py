"""`unfinished_place`: where to resume a job from the record of a command that did not end.

The record has no time of the plan, because the override may have changed. `match_plan` finds it
from the measured joints.
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

# Time between two compared samples, and between two times of the plan [s].
STEP = 4e-3
# The measured motion may advance by up to so many steps of the plan in one step: more than 1, so
# that it can make up for a lag.
ADVANCES = 3
# Times of the plan that are compared at once [s]; the most probable one is in the middle.
WINDOW = 2.0
# The plan's time of so many last samples is refined, at so many times around it.
REFINED_SAMPLES = 50
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
    t, measured = match_plan(planned.trajectory, record.t[begin:], record.measured[begin:])
    return find_stopped_place(played_job, planned, float(t[-1]), t, measured)


def match_plan(
    plan: Trajectory, t: FloatArray, measured: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Match measured positions with a plan by dynamic time warping.

    The sum of the squared distances between the positions and the plan is least, where the plan's
    time never decreases and increases by less than ADVANCES steps per step. Therefore places at
    which the path crosses itself, or turns back, are not confused.

    Args:
        plan: The plan, which begins at the first sample.
        t: Times by the controller's clock [s], (n,).
        measured: Measured positions [rad], (n, dof).

    Returns:
        Times of the plan [s], (m,), and measured positions [rad], (m, dof), in steps until the last
        sample.
    """
    times = np.append(np.arange(0.0, plan.duration, STEP), plan.duration)
    planned = plan(times)
    clock = t[-1] - STEP * np.arange(int((t[-1] - t[0]) / STEP), -1, -1)
    q = np.column_stack([np.interp(clock, t, x) for x in measured.T])
    width = min(round(WINDOW / STEP), len(times))
    # Least sums up to each time of the window, which begins at the index `first`.
    sums = np.full(width, np.inf)
    sums[0] = 0.0
    first = 0
    firsts: IntArray = np.zeros(len(q), dtype=int)
    advances: IntArray = np.zeros((len(q), width), dtype=np.int8)
    for k, position in enumerate(q):
        shift = int(np.argmin(sums)) - width // 2
        shift = min(max(shift, 0), len(times) - width - first)
        sums = np.append(sums[shift:], np.full(shift, np.inf))
        # `sums` of the step before, each for a number of steps by which the plan has advanced.
        before = np.full((ADVANCES, width), np.inf)
        for steps in range(ADVANCES):
            before[steps, steps:] = sums[: width - steps]
        first += shift
        firsts[k] = first
        advances[k] = before.argmin(axis=0)
        distances = planned[first : first + width] - position
        sums = before.min(axis=0) + np.einsum("nj,nj->n", distances, distances)
    i = first + int(np.argmin(sums))
    indices: IntArray = np.zeros(len(q), dtype=int)
    for k in range(len(q) - 1, -1, -1):
        indices[k] = i
        i -= int(advances[k, i - firsts[k]])
    found = times[indices]
    around = np.linspace(-STEP, STEP, REFINED_TIMES)
    for k in range(max(len(q) - REFINED_SAMPLES, 0), len(q)):
        near = np.clip(found[k] + around, 0.0, plan.duration)
        distances = np.abs(plan(near) - q[k])
        found[k] = near[int(distances.max(axis=1).argmin())]
    return np.asarray(found), q
