"""The run of a preview: the only one of its job, and coarser than in a full run.

Set-points are not closer than `PERIOD`, corners of the shape free have arcs, and while a handle
moves the timing is found on a coarser grid, and errors at fewer samples.
"""

from __future__ import annotations

import dataclasses

from armcontour.errors import InvalidInput
from armcontour.io.job_model import ExperimentModel, JobModel
from armcontour.jobs import Experiment, Job, Run
from armcontour.jobs.experiment import build_plant
from armcontour.jobs.study import execute_run
from armcontour.motion import Execution, TaughtData
from armcontour.timing import Optimal, intervals_of

# Smallest command interval of a preview [s].
PERIOD = 4e-3
# Grid intervals of each contour while a handle moves; in a run they are 4000 or more. Durations
# differ by less than a thousandth, and nothing needs half as long.
MOVING_INTERVALS = 600
# Samples of an execution while a handle moves, at least.
MOVING_SAMPLES = 1500
# Cycle of the drives of simulated bodies while a handle moves, at least [s].
MOVING_STEP = 1e-3
ARCS = (
    "corners of the shape free are drawn with arcs of the same tolerance: their shape is searched "
    "at rest."
)


def with_one_run(model: JobModel, run: str | None) -> JobModel:
    """The keys with one run only, and without what may name others.

    Args:
        model: The keys of the job.
        run: Name of the run; None for the first one.

    Raises:
        InvalidInput: The job has no such run.
    """
    name = next(iter(model.runs)) if run is None else run
    if name not in model.runs:
        raise InvalidInput(f"The job has no run {name}: it has {', '.join(model.runs)}.")
    asked = model.placement
    return dataclasses.replace(
        model,
        runs={name: model.runs[name]},
        certificate=None,
        placement=None if asked is None else dataclasses.replace(asked, run=None),
        experiment=_experiment_of(model, name),
    )


def _experiment_of(model: JobModel, run: str) -> ExperimentModel | None:
    """The experiment of a run: the set-points depend on it."""
    found = model.experiment
    if found is None or run not in (found.runs or [run]):
        return None
    return dataclasses.replace(found, runs=None)


def coarser_run(job: Job, own: Run, moving: bool) -> tuple[Run, tuple[str, ...]]:
    """The run of a preview, and sentences on what is different in it.

    Args:
        job: The job.
        own: The run as the job has it.
        moving: Whether the next plan is wanted soon.
    """
    this, differs, period = own, [], max(own.period, PERIOD)
    try:
        for x in (job.servo, job.plant_servo):
            x.refuse_too_fast(period)
    except InvalidInput:
        # Gains as large as these need short intervals.
        period = own.period
    if period != own.period:
        this = dataclasses.replace(this, period=period)
        differs.append(
            f"set-points come every {period * 1e3:g} ms, and in a run every "
            f"{own.period * 1e3:g} ms."
        )
    if this.rounding is not None and this.rounding.free:
        this = dataclasses.replace(this, rounding=this.rounding.with_arcs)
        differs.append(ARCS)
    if moving and isinstance(this.timing, Optimal) and this.timing.intervals is None:
        few = min(MOVING_INTERVALS, intervals_of(job.program) or MOVING_INTERVALS)
        timing = dataclasses.replace(this.timing, intervals=few)
        this = dataclasses.replace(this, timing=timing)
        differs.append(f"while it moves, the timing is found on a grid of {few} intervals.")
    return this, tuple(differs)


def experiment_of(this: Run, moving: bool) -> Experiment | None:
    """The experiment that judges a run; None where the servo model does.

    Args:
        this: The run.
        moving: Whether the next one is wanted soon, so that longer cycles of drives are enough.
    """
    found = this.judge
    if found is None or not moving:
        return found
    return dataclasses.replace(found, step=max(found.step, MOVING_STEP))


def execute_judged(job: Job, this: Run, taught: TaughtData, bodies: Experiment | None) -> Execution:
    """The execution that judges a run: on rigid bodies, or on the servo model.

    Args:
        job: The job.
        this: The run.
        taught: Its set-points.
        bodies: As `experiment_of` gives it.
    """
    plant = None if bodies is None else build_plant(bodies, job.arm, job.plant_servo, this.limits)
    return execute_run(job, taught, plant)


def with_fewer_samples(execution: Execution) -> Execution:
    """The execution at every second of its samples, or third and so on; largest demands stay.

    Intermediate samples are discarded.
    """
    step = len(execution.t) // MOVING_SAMPLES
    if step < 2:
        return execution
    names = ("t", "q", "dq", "ddq", "demand", "torque", "torque_demand", "motor_q")
    known = {x: getattr(execution, x) for x in names}
    fewer = {name: x[::step] for name, x in known.items() if x is not None}
    return dataclasses.replace(execution, **fewer, plant=None)
