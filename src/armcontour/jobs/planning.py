"""`plan_one`: the only pipeline from the program of a run to its plan."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from copy import copy
from functools import partial
from itertools import tee
from typing import Any

import numpy.typing as npt

from armcontour.core.errors import InvalidInput, Unreachable, error_context
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.geometry import Path
from armcontour.jobs.alternatives import (
    alternatives,
    check_collision,
    clearance_of,
    first_contour_clear,
)
from armcontour.jobs.job import TANGENT, Job, Rounding, Run
from armcontour.jobs.planned import Planned
from armcontour.jobs.reuse import Reuse, comparable
from armcontour.jobs.single_corners import check_found, corner_tolerances
from armcontour.motion import Method, Trajectory
from armcontour.planning import (
    Explanation,
    Optimal,
    Tracing,
    explain,
    intervals_of,
    plan,
    trace_program,
)
from armcontour.program import Program, prepare, round_corners, smooth_curvature
from armcontour.verification.clearance import Clearance

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
    first_only: bool = False,
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
        first_only: Whether `Unreachable` names the first point that is out of reach, not the
            farthest one. This is faster.

    Raises:
        ArmContourError: The run cannot be planned.
    """
    reuse, tell = Reuse() if reuse is None else reuse, subprogress(progress)
    objective, traced = trace_one(
        job, this, reuse, progress, objective=objective, clear=clear, first_only=first_only
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
    reuse: Reuse,
    progress: Progress | None = None,
    *,
    objective: Program | None = None,
    clear: bool = True,
    first_only: bool = False,
) -> tuple[Program, Tracing]:
    """The prepared program of a run, and the joint paths of the rounded one.

    Args:
        job: As in `plan_one`.
        this: As in `plan_one`.
        reuse: As in `plan_one`.
        progress: As in `plan_one`.
        objective: As in `plan_one`.
        clear: Whether the plan must be clear; if not, joint paths with a given start stay the same
            for all limits but joint ranges.
        first_only: As in `plan_one`.

    Raises:
        ArmContourError: The program cannot be prepared, rounded or traced.
    """
    tell = subprogress(progress)
    try:
        prepared, path = prepare_and_round(job, this, reuse, progress, objective)
        limits = comparable(this.limits)
        if job.start is not None and not clear:
            limits = comparable(this.limits.joint_range(job.arm.dof))
        made_of = path, _arm_inputs(job), limits
        return prepared, reuse.get("tracing", made_of, lambda: trace_run(job, this, path, tell))
    except Unreachable as error:
        if first_only:
            raise
        from armcontour.jobs import reachability

        raise reachability.explain(error, job) from None


def prepare_and_round(
    job: Job,
    this: Run,
    reuse: Reuse | None = None,
    progress: Progress | None = None,
    objective: Program | None = None,
) -> tuple[Program, Program]:
    """The program of a run, prepared, before and after its corners are rounded or shaped.

    Args:
        job: The job.
        this: The run.
        reuse: As in `plan_one`.
        progress: As in `plan_one`.
        objective: As in `plan_one`.

    Raises:
        ArmContourError: The process does not fit the program, or an automatic lead has no length.
    """
    cache, tell = Reuse() if reuse is None else reuse, subprogress(progress)
    inputs = path_inputs(job, this)

    def make() -> tuple[Program, Program]:
        tell(Step((SHAPING if this.is_shaped else ROUNDING,)))
        prepared = objective
        if prepared is None:
            shared = inputs if job.process.automatic else inputs[:2]
            prepared = cache.get("preparing", shared, lambda: _prepare(job, this))
            this.check_end_time(prepared)
            if this.rounding is not None and this.rounding.at:
                check_found(job.program.path, prepared, list(this.rounding.at))
        return prepared, round_program(job, this, prepared, tell)

    return cache.get(ROUNDING, (objective, *inputs), make)


def path_inputs(job: Job, this: Run) -> tuple[Any, ...]:
    """All that the path of a run depends on, comparable."""
    program, timing = job.program, this.timing
    moves = [[getattr(x, y.name) for y in dataclasses.fields(x)] for x in program.moves]
    by_limits = job.process.automatic or this.is_shaped
    if by_limits and isinstance(timing, Optimal):
        timing = dataclasses.replace(timing, duration=None)
    return (
        (moves, program.source, program.notes, program.remarks, program.rapid_speed),
        comparable(job.process),
        *(this.rounding, this.continuity, this.transition_tolerance, this.until),
        this.limits.centripetal_acceleration,
        (_arm_inputs(job), comparable(this.limits), timing) if by_limits else None,
    )


def explain_plan(job: Job, trajectory: Trajectory, reuse: Reuse) -> Explanation | None:
    """Which limit binds where on a plan; None for methods that have no such limits."""
    if trajectory.method is not Method.OPTIMAL:
        return None
    return reuse.get("explanation", trajectory, lambda: explain(trajectory, job.arm))


def _arm_inputs(job: Job) -> tuple[Any, ...]:
    """All of the arm and its cell that joint paths depend on, comparable."""
    return job.arm, job.configuration, comparable(job.start), job.scene, job.ignore_collisions


def _prepare(job: Job, this: Run) -> Program:
    """The program of a job with leads, overlaps and events of the process, and sharp corners."""
    leads = None
    if job.process.automatic:
        if not isinstance(this.timing, Optimal):
            raise InvalidInput(
                f"Run {this.name}: leads of automatic length need the timing optimal, not "
                f"{this.timing.method}: give their lengths."
            )
        from armcontour.jobs.leads import automatic_leads

        leads = automatic_leads(job, this, partial(plan_one, clear=False, first_only=True))
    with error_context("process"):
        return prepare(job.program, job.process, leads)


def round_program(
    job: Job, this: Run, program: Program, progress: Progress | None = None
) -> Program:
    """Round or shape the corners of a program as a run does; a run may keep them sharp."""
    rounding = this.rounding
    if rounding is None:
        return program
    if rounding.free:
        from armcontour.planning import shape

        with error_context("corners"):
            assert isinstance(this.timing, Optimal)
            options = dataclasses.replace(
                rounding.options,
                reserve=this.timing.reserve,
                configuration=job.configuration,
                start=job.start,
                intervals=this.timing.intervals or intervals_of(program),
            )
            return shape(program, job.arm, this.limits, options, progress=progress)
    acceleration = rounding.acceleration
    if acceleration is None:
        acceleration = this.limits.centripetal_acceleration
    rounded = round_corners(
        _join_smoothly(program, this, rounded=False),
        tolerance=_tolerance(job, rounding),
        speed=rounding.speed,
        acceleration=acceleration,
        angular_tolerance=rounding.angular_tolerance,
        continuity=this.continuity or TANGENT,
    )
    return _join_smoothly(rounded, this, rounded=True)


def _tolerance(job: Job, rounding: Rounding) -> float | None | Callable[[Path], npt.ArrayLike]:
    """The largest corner error [m], which single corners may have of their own."""
    single, tolerance = rounding.at, rounding.tolerance
    if not single or tolerance is None:
        return tolerance
    given = job.program.path
    return lambda path: corner_tolerances(given, path, tolerance, single)


def trace_run(job: Job, this: Run, program: Program, progress: Progress) -> Tracing:
    """Trace the joint paths of all moves of a program, under the limits of a run.

    A shaped program is traced in the configuration that it was shaped for, others in the fastest
    one that keeps clear and above the base.
    """
    progress(Step(("tracing",)))
    return trace_program(
        program,
        job.arm,
        this.limits,
        configuration=job.configuration,
        start=job.start,
        fits=first_contour_clear(job),
        progress=progress,
    )


def _join_smoothly(program: Program, this: Run, *, rounded: bool) -> Program:
    """The program with transitions where lines and arcs meet, if it is their turn.

    An orientation that follows the tangent is rounded with the corners, so that transitions come
    before that; otherwise they come afterwards. One that turns by itself gets none.

    Args:
        program: The program.
        this: The run, which may want none.
        rounded: Whether the corners are rounded already.
    """
    own = [x.path.orientation for x in program.contours]
    follow = all(x is not None and x.follows for x in own)
    due = all(x is None or x.fixed for x in own) if rounded else follow
    allowed = this.transition_tolerance
    return smooth_curvature(program, tolerance=allowed) if due and allowed > 0 else program


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
        if clearance is None or clearance.satisfied or job.ignore_collisions:
            break
    else:
        check_collision(job, traced.program, trajectory)
    return traced, trajectory, clearance, notes
