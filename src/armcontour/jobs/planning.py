"""`plan_one`: the only pipeline from the program of a run to its plan."""

from __future__ import annotations

import dataclasses
from copy import copy
from functools import partial
from itertools import tee
from typing import Any

from armcontour._progress import Progress, Step, under
from armcontour.clearance import Clearance
from armcontour.errors import InvalidInput, Unreachable, locate_errors
from armcontour.jobs import reachability
from armcontour.jobs.alternatives import alternatives, clearance_of, refuse_collision
from armcontour.jobs.job import Job, Run
from armcontour.jobs.programs import round_program, trace_run
from armcontour.jobs.results import Planned
from armcontour.jobs.reuse import Reuse, comparable
from armcontour.jobs.single_corners import refuse_missing
from armcontour.motion import Method, Trajectory
from armcontour.program import Program, prepare
from armcontour.timing import Explanation, Optimal, Tracing, explain, plan

# The first step of a run; the other where corners have the shape free.
ROUNDING, SHAPING = "rounding", "shaping"


def plan_one(
    job: Job,
    this: Run,
    reuse: Reuse | None = None,
    progress: Progress | None = None,
    *,
    objective: Program | None = None,
    clear: bool = True,
    brief: bool = False,
) -> Planned:
    """Plan a run: prepare, round and trace its program, and time it along a clear joint path.

    Args:
        job: The job.
        this: The run; it need not be one of the job's.
        reuse: Results of earlier plans, such as those of other runs of the job. Runs with the same
            path and limits share one tracing.
        progress: Called with the steps of the run, and the share that is done.
        objective: The prepared program; by default that of the job.
        clear: Whether to check the clearance and to try other joint paths until one keeps clear.
        brief: Whether `Unreachable` may name the first point that is out of reach, which is faster
            than a search for the farthest one.

    Raises:
        ArmContourError: The run cannot be planned.
    """
    reuse, tell = Reuse() if reuse is None else reuse, under(progress)
    objective, traced = trace_one(
        job, this, reuse, progress, objective=objective, clear=clear, brief=brief
    )
    traced, trajectory, clearance, notes = reuse.get(
        "timing",
        (traced, comparable(this.limits), this.timing, clear),
        lambda: _time(job, this, traced, reuse, tell, clear),
    )
    return Planned(
        run=this,
        objective=objective,
        path=traced.program,
        trajectory=trajectory,
        traced=traced,
        clearance=clearance,
        avoided=notes,
    )


def trace_one(
    job: Job,
    this: Run,
    reuse: Reuse | None = None,
    progress: Progress | None = None,
    *,
    objective: Program | None = None,
    clear: bool = True,
    brief: bool = False,
) -> tuple[Program, Tracing]:
    """The prepared program of a run, and the tracing of the rounded one, as `plan_one` plans it.

    Args:
        job: As in `plan_one`.
        this: As in `plan_one`.
        reuse: As in `plan_one`.
        progress: As in `plan_one`.
        objective: As in `plan_one`.
        clear: As in `plan_one`.
        brief: As in `plan_one`.

    Raises:
        ArmContourError: The program cannot be prepared, rounded or traced.
    """
    reuse, tell = Reuse() if reuse is None else reuse, under(progress)
    # A plan that need not be clear may keep a start for all limits but joint ranges.
    ranged = not clear and job.start is not None
    ranges = [x.tobytes() for x in this.limits.joint_range(job.arm.dof)]
    limits = ranges if ranged else comparable(this.limits)
    inputs = path_inputs(job, this)

    def shape() -> tuple[Program, Program]:
        tell(Step((SHAPING if _is_free(this) else ROUNDING,)))
        if objective is not None:
            return objective, round_program(job, this, objective, tell)
        shared = inputs if job.process.automatic else inputs[:2]
        known = reuse.get("preparing", shared, lambda: prepare_program(job, this))
        return programs_of(job, this, tell, known)

    def trace() -> Tracing:
        tell(Step(("tracing",)))
        return trace_run(job, this, path, tell)

    try:
        given, path = reuse.get(ROUNDING, (objective, *inputs), shape)
        traced = reuse.get(
            "tracing",
            (path, *_arm_inputs(job), limits, job.scene, job.ignore_collisions),
            trace,
        )
    except Unreachable as error:
        raise error if brief else reachability.explain(error, job) from None
    return given, traced


def programs_of(
    job: Job, this: Run, progress: Progress | None = None, known: Program | None = None
) -> tuple[Program, Program]:
    """The program of a run, prepared, before and after its corners are rounded or shaped.

    Args:
        job: The job.
        this: The run.
        progress: Called with the step "shaping" and the share that is done.
        known: The prepared program, if it is known.

    Raises:
        ArmContourError: The process does not fit the program, or an automatic lead has no length.
    """
    objective = prepare_program(job, this) if known is None else known
    this.refuse_until(objective)
    if this.rounding is not None and this.rounding.at:
        refuse_missing(job.program.path, objective, list(this.rounding.at))
    return objective, round_program(job, this, objective, progress)


def prepare_program(job: Job, this: Run) -> Program:
    """The program of a job with leads, overlaps and events of the process, and sharp corners.

    Args:
        job: The job.
        this: The run, whose plans decide how long leads of automatic length are.

    Raises:
        ArmContourError: As `programs_of`.
    """
    leads = None
    if job.process.automatic:
        if not isinstance(this.timing, Optimal):
            raise InvalidInput(
                f"Run {this.name}: leads of automatic length need the timing optimal, not "
                f"{this.timing.method}: give their lengths."
            )
        from armcontour.jobs.leads import automatic_leads

        leads = automatic_leads(job, this, partial(plan_one, clear=False, brief=True))
    with locate_errors("process"):
        return prepare(job.program, job.process, leads)


def path_inputs(job: Job, this: Run) -> tuple[Any, ...]:
    """All that the path of a run depends on, comparable."""
    program, timing = job.program, this.timing
    moves = [[getattr(x, y.name) for y in dataclasses.fields(x)] for x in program.moves]
    by_limits = job.process.automatic or _is_free(this)
    if by_limits and isinstance(timing, Optimal):
        timing = dataclasses.replace(timing, duration=None)
    return (
        (moves, program.source, program.notes, program.remarks, program.rapid_speed),
        comparable(job.process),
        *(this.rounding, this.continuity, this.transition_tolerance, this.until),
        this.limits.centripetal_acceleration,
        (*_arm_inputs(job), comparable(this.limits), timing) if by_limits else None,
    )


def explain_plan(job: Job, trajectory: Trajectory, reuse: Reuse) -> Explanation | None:
    """Which limit binds where on a plan; None for methods that have no such limits."""
    if trajectory.method is not Method.OPTIMAL:
        return None
    return reuse.get("explanation", trajectory, lambda: explain(trajectory, job.arm))


def _is_free(this: Run) -> bool:
    return this.rounding is not None and this.rounding.free


def _arm_inputs(job: Job) -> tuple[Any, ...]:
    """The arm and its configuration."""
    return job.arm, job.branch, None if job.start is None else job.start.tobytes()


def _time(
    job: Job, this: Run, traced: Tracing, reuse: Reuse, progress: Progress, clear: bool
) -> tuple[Tracing, Trajectory, Clearance | None, tuple[str, ...]]:
    """Plan along the first of several joint paths that keep clear.

    Raises:
        Collision: The arm comes too near to something along all of them, and the job does not
            ignore this.
        InvalidInput: The job has a scene, but the shapes of the arm are not known.
    """

    def timed(traced: Tracing) -> Trajectory:
        progress(Step(("timing",)))
        return plan(traced, job.arm, this.limits, this.timing, progress=progress)

    if not clear:
        return traced, timed(traced), None, ()
    # A copy of an iterator of `tee` begins anew, and shares what others have searched.
    known = reuse.get(
        "alternatives",
        (traced, comparable(this.limits)),
        lambda: tee(alternatives(job, this, traced, progress), 1)[0],
    )
    for way in copy(known):
        traced, notes = way
        trajectory = timed(traced)
        progress(Step(("clearance",)))
        clearance = clearance_of(job, trajectory)
        if clearance is None or clearance.kept or job.ignore_collisions:
            break
    else:
        refuse_collision(job, traced.program, trajectory)
    return traced, trajectory, clearance, notes
