"""`plan_one`: all steps from the program of a run to its plan."""

from __future__ import annotations

import dataclasses
from copy import copy
from functools import partial
from itertools import tee
from typing import Any

from armcontour.core.errors import InvalidInput, Unreachable, error_context
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.jobs.alternatives import (
    alternatives,
    check_collision,
    clearance_of,
    first_contour_clear,
)
from armcontour.jobs.job import TANGENT, Job, Run
from armcontour.jobs.planned_run import Planned
from armcontour.jobs.reuse import Reuse, comparable
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

# Names of the first step of a run: rounding of corners, or shaping for corners of shape free.
ROUNDING, SHAPING = "rounding", "shaping"


def plan_one(
    job: Job,
    run: Run,
    reuse: Reuse | None = None,
    progress: Progress | None = None,
    *,
    objective: Program | None = None,
    clear: bool = True,
    first_only: bool = False,
) -> Planned:
    """Plan a run: prepare, round and trace its program, and time it on a collision-free joint path.

    Raises:
        ArmContourError: The run cannot be planned.
    """
    reuse, report = Reuse() if reuse is None else reuse, subprogress(progress)
    objective, traced = trace_one(
        job, run, reuse, progress, objective=objective, clear=clear, first_only=first_only
    )
    traced, trajectory, clearance, notes = reuse.get(
        "timing",
        (traced, comparable(run.limits), run.timing, clear),
        lambda: _time(job, run, traced, reuse, report, clear),
    )
    return Planned(
        run=run,
        objective=objective,
        path=traced.program,
        trajectory=trajectory,
        traced=traced,
        clearance=clearance,
        avoided=notes,
    )


def trace_one(
    job: Job,
    run: Run,
    reuse: Reuse,
    progress: Progress | None = None,
    *,
    objective: Program | None = None,
    clear: bool = True,
    first_only: bool = False,
) -> tuple[Program, Tracing]:
    """Prepared program of a run (with sharp corners), and joint paths of the rounded program."""
    report = subprogress(progress)
    try:
        prepared, path = prepare_and_round(job, run, reuse, progress, objective)
        limits = comparable(run.limits)
        if job.seed is not None and not clear:
            limits = comparable(run.limits.joint_range(job.arm.dof))
        made_of = path, _arm_inputs(job), limits
        return prepared, reuse.get("tracing", made_of, lambda: trace_run(job, run, path, report))
    except Unreachable as error:
        if first_only:
            raise
        from armcontour.jobs import reachability

        raise reachability.explain(error, job) from None


def prepare_and_round(
    job: Job,
    run: Run,
    reuse: Reuse | None = None,
    progress: Progress | None = None,
    objective: Program | None = None,
) -> tuple[Program, Program]:
    """Prepared program of a run, before and after its corners are rounded or shaped.

    Raises:
        ArmContourError: The process does not fit the program, or an automatic lead has no length.
    """
    cache, report = Reuse() if reuse is None else reuse, subprogress(progress)
    inputs = path_inputs(job, run)

    def make() -> tuple[Program, Program]:
        report(Step((SHAPING if run.is_shaped else ROUNDING,)))
        prepared = objective
        if prepared is None:
            shared = inputs if job.process.automatic else inputs[:2]
            prepared = cache.get("preparing", shared, lambda: _prepare(job, run))
            run.check_end_time(prepared)
        return prepared, round_program(job, run, prepared, report)

    return cache.get(ROUNDING, (objective, *inputs), make)


def path_inputs(job: Job, run: Run) -> tuple[Any, ...]:
    """All inputs on which the path of a run depends, in a comparable form."""
    program, timing = job.program, run.timing
    moves = [[getattr(x, y.name) for y in dataclasses.fields(x)] for x in program.moves]
    by_limits = job.process.automatic or run.is_shaped
    if by_limits and isinstance(timing, Optimal):
        timing = dataclasses.replace(timing, duration=None)
    return (
        (moves, program.source, program.notes, program.remarks, program.rapid_speed),
        comparable(job.process),
        *(run.rounding, run.continuity, run.transition_tolerance, run.end_time),
        run.limits.centripetal_acceleration,
        (_arm_inputs(job), comparable(run.limits), timing) if by_limits else None,
    )


def explain_plan(job: Job, trajectory: Trajectory, reuse: Reuse) -> Explanation | None:
    """Active limits along a plan; None if its timing method is not optimal."""
    if trajectory.method is not Method.OPTIMAL:
        return None
    return reuse.get("explanation", trajectory, lambda: explain(trajectory, job.arm))


def _arm_inputs(job: Job) -> tuple[Any, ...]:
    """Inputs of arm and cell on which joint paths depend, in a comparable form."""
    return job.arm, job.configuration, comparable(job.seed), job.scene


def _prepare(job: Job, run: Run) -> Program:
    """Program of a job with leads, overlaps and events of the process, and with sharp corners."""
    leads = None
    if job.process.automatic:
        if not isinstance(run.timing, Optimal):
            raise InvalidInput(
                f"Run {run.name}: leads of automatic length require the timing method optimal, but "
                f"the method is {run.timing.method}. Specify the lengths of the leads."
            )
        from armcontour.jobs.automatic_leads import automatic_leads

        leads = automatic_leads(job, run, partial(plan_one, clear=False, first_only=True))
    with error_context("process"):
        return prepare(job.program, job.process, leads)


def round_program(
    job: Job, run: Run, program: Program, progress: Progress | None = None
) -> Program:
    """Round or shape the corners of a program as the run specifies; they can stay sharp."""
    rounding = run.rounding
    if rounding is None:
        return program
    if rounding.free:
        from armcontour.planning import shape

        with error_context("corners"):
            assert isinstance(run.timing, Optimal)
            options = dataclasses.replace(
                rounding.options,
                reserve=run.timing.reserve,
                configuration=job.configuration,
                seed=job.seed,
                intervals=run.timing.intervals or intervals_of(program),
            )
            return shape(program, job.arm, run.limits, options, progress=progress)
    acceleration = rounding.acceleration
    if acceleration is None:
        acceleration = run.limits.centripetal_acceleration
    rounded = round_corners(
        _join_smoothly(program, run, rounded=False),
        tolerance=rounding.tolerance,
        speed=rounding.speed,
        acceleration=acceleration,
        angular_tolerance=rounding.angular_tolerance,
        continuity=run.continuity or TANGENT,
    )
    return _join_smoothly(rounded, run, rounded=True)


def trace_run(job: Job, run: Run, program: Program, progress: Progress) -> Tracing:
    """Trace the joint paths of all moves of a program within the limits of a run."""
    # A shaped program is traced in the configuration with which it was shaped, other programs in
    # the fastest configuration that is collision-free and above the base.
    progress(Step(("tracing",)))
    return trace_program(
        program,
        job.arm,
        run.limits,
        configuration=job.configuration,
        seed=job.seed,
        accept=first_contour_clear(job),
        progress=progress,
    )


def _join_smoothly(program: Program, run: Run, *, rounded: bool) -> Program:
    """Add transitions where lines and arcs meet, if this step (before or after rounding) adds them.

    `rounded`: True after corners were rounded.
    """
    # If the orientation follows the tangent, transitions are added before corners are rounded,
    # because rounding also rounds the orientation. If the orientation is fixed, they are added
    # afterwards. Other orientations get no transitions.
    orientations = [x.path.orientation for x in program.contours]
    follow = all(x is not None and x.follows for x in orientations)
    due = all(x is None or x.fixed for x in orientations) if rounded else follow
    allowed = run.transition_tolerance
    return smooth_curvature(program, tolerance=allowed) if due and allowed > 0 else program


def _time(
    job: Job, run: Run, traced: Tracing, reuse: Reuse, progress: Progress, clear: bool
) -> tuple[Tracing, Trajectory, Clearance | None, tuple[str, ...]]:
    """Plan along the first of several alternative joint paths that is collision-free.

    Returns joint paths, plan, clearance, and notes on the alternative.
    """

    def timed(traced: Tracing) -> Trajectory:
        progress(Step(("timing",)))
        return plan(traced, job.arm, run.limits, run.timing, progress=progress)

    if not clear:
        return traced, timed(traced), None, ()
    # The cache contains a `tee` iterator. A copy of it starts from the first alternative, and
    # alternatives that were already computed are not computed again.
    cached = reuse.get(
        "alternatives",
        (traced, comparable(run.limits)),
        lambda: tee(alternatives(job, run, traced, progress), 1)[0],
    )
    for candidate in copy(cached):
        traced, notes = candidate
        trajectory = timed(traced)
        progress(Step(("clearance",)))
        clearance = clearance_of(job, trajectory)
        if clearance is None or clearance.satisfied:
            break
    else:
        check_collision(job, traced.program, trajectory)
    return traced, trajectory, clearance, notes
