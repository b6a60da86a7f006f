"""The run of a preview: the only one of its job, and coarser than in a full run.

Set-points are not closer than `PERIOD`, corners of the shape free have arcs, and while a handle
moves the timing is found on a coarser grid, and errors at fewer samples.
"""

from __future__ import annotations

import dataclasses

from armcontour.errors import InvalidInput
from armcontour.io.job_model import JobModel, RunModel
from armcontour.jobs import Job, Run
from armcontour.jobs.weak_points import INVERSE_DYNAMICS
from armcontour.motion import Execution, Method
from armcontour.timing import intervals_of

# Smallest command interval of a preview [s].
PERIOD = 4e-3
# Grid intervals of each contour while a handle moves; in a run they are 4000 or more. Durations
# differ by less than a thousandth, and nothing needs half as long.
MOVING_INTERVALS = 600
# Samples of an execution while a handle moves, at least.
MOVING_SAMPLES = 1500
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
        runs={name: _without_experiment(model, name)},
        published=None,
        certificate=None,
        placement=None if asked is None else dataclasses.replace(asked, run=None),
        experiment=None,
    )


def _without_experiment(model: JobModel, run: str) -> RunModel:
    """The keys of a run, with what an experiment decides of its set-points."""
    found, experiment = model.runs[run], model.experiment
    how = found.compensation
    if how.method != INVERSE_DYNAMICS or how.gravity_feedforward is not None:
        return found
    if experiment is None or run not in (experiment.runs or [run]):
        return found
    fed = dataclasses.replace(how, gravity_feedforward=experiment.gravity_feedforward)
    return dataclasses.replace(found, compensation=fed)


def coarser_run(
    job: Job, own: Run, period: float | None, moving: bool
) -> tuple[Run, tuple[str, ...]]:
    """The run of a preview, and sentences on what is different in it.

    Args:
        job: The job.
        own: The run as the job has it.
        period: Command interval [s]; None for that of a preview.
        moving: Whether the next plan is wanted soon.
    """
    this, differs = own, []
    if period is None:
        period = max(own.period, PERIOD)
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
    if moving and this.timing == Method.OPTIMAL and "intervals" not in this.timing_options:
        few = min(MOVING_INTERVALS, intervals_of(job.program) or MOVING_INTERVALS)
        options = {**this.timing_options, "intervals": few}
        this = dataclasses.replace(this, timing_options=options)
        differs.append(f"while it moves, the timing is found on a grid of {few} intervals.")
    return this, tuple(differs)


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
