"""`plan_one`: all steps from the program of a run to its plan, with leads of automatic length."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from contextlib import contextmanager
from operator import or_
from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, InvalidInput, Unreachable, error_context
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.text import capitalise
from armcontour.geometry.rounding.rounded_orientation import turns_smoothly
from armcontour.jobs.alternatives import (
    alternatives,
    check_collision,
    clearance_of,
    first_clear,
    first_contour_clear,
)
from armcontour.jobs.command_velocity import exceeded_command_velocity
from armcontour.jobs.job import TANGENT, Job, Run
from armcontour.jobs.resumed_configuration import (
    ResumedPlace,
    Resumption,
    marked_places,
    shaped_places,
    with_marks,
)
from armcontour.jobs.run_result import RunResult
from armcontour.motion import Method, Trajectory
from armcontour.planning import (
    Explanation,
    Optimal,
    PlanOptions,
    Tracing,
    at_speed,
    intervals_of,
    plan,
    trace_program,
)
from armcontour.planning.constraints import CommandVelocity
from armcontour.planning.explanation import explain_all
from armcontour.program import (
    Contour,
    Event,
    Leads,
    Process,
    Program,
    Rapid,
    arrange_contours,
    prepare,
    round_corners,
    smooth_curvature,
)

if TYPE_CHECKING:
    from armcontour.planning import Shaped

# If the arm does not reach a lead of this length, it reaches none [m].
SHORTEST_LEAD = 1e-3
# A lead is longer than the tool needs to accelerate along the contour by this factor, because the
# arm may accelerate less in other positions.
LEAD_FACTOR = 1.25
# The speed along a contour is known at this number of points.
LEAD_SPEED_SAMPLES = 401
# Keys of the process that are ignored while automatic leads are determined.
KEYS_WITHOUT_LEADS = ("lead_in", "lead_out", "pierce", "kerf")
# Name of a run's first step, in which corners are rounded.
ROUNDING_STEP = "rounding"
# Name of the first step if corners have shape free: contours are shaped.
SHAPING_STEP = "shaping"


def plan_one(
    job: Job,
    run: Run,
    progress: Progress | None = None,
    *,
    objective: Program | None = None,
    path: Program | None = None,
    clear: bool = True,
    resumption: Resumption | None = None,
    unchecked: RunResult | None = None,
) -> RunResult:
    """Plan a run: prepare, round and trace its program, and time it on a collision-free joint path.

    - `objective`: the prepared program, if known.
    - `path`: the objective with rounded corners, if known.
    - `clear`: whether to avoid collisions.
    - `resumption`: configuration of a resumed `objective`.
    - `unchecked`: the plan without `clear`, if known; not for a resumed job.

    Raises:
        ArmContourError: The run cannot be planned.
    """
    report = subprogress(progress)
    if unchecked is not None and unchecked.traced is not None:
        return time_clear(
            job, run, unchecked.objective, unchecked.traced, report, fastest=unchecked
        )
    if objective is None:
        resumption = find_resumption(job, run, report, clear=clear)
        objective = prepare_program(job, run, report, resumption)
    if path is None:
        path = round_program(job, run, objective, report, resumption)
    traced = trace_run(job, run, path, report, resumption)
    if clear:
        return time_clear(job, run, objective, traced, report, resumption)
    planned = time_run(job, run, objective, traced, report)
    return dataclasses.replace(planned, resumption=resumption)


def round_anywhere(job: Job, run: Run) -> tuple[Program, Program] | None:
    """Return the prepared and the rounded program if they are the same wherever the arm stands.

    None if they depend on the motion of the arm: shaped corners, automatic leads, and the rest of a
    program that is resumed.

    Raises:
        ArmContourError: The process does not fit the program.
    """
    if run.is_shaped or job.process.automatic or job.process.is_partial:
        return None
    objective = prepare_program(job, run)
    return objective, round_program(job, run, objective)


def find_resumption(
    job: Job, run: Run, progress: Progress | None = None, *, clear: bool = True
) -> Resumption | None:
    """Find the configuration in which the whole job executes the part that is left of it.

    None if the job is neither resumed nor has `process.only`. The whole job is traced, but not
    timed. The program itself is cut by `prepare`, which `prepare_program` calls.

    `clear`: whether the joint paths of the whole job must avoid collisions.
    """
    if not job.process.is_partial:
        return None
    resume_at = job.process.resume_at
    only = job.process.only
    process = dataclasses.replace(job.process, resume_at=0.0, only=())
    whole_job = dataclasses.replace(job, process=process)
    report = subprogress(progress)
    try:
        objective = prepare_program(whole_job, run, report)
        place = ResumedPlace.find(objective, job.process)
        if place is None:
            # `prepare_program` refuses the arc length, or that no contour is left.
            return None
        path = round_program(whole_job, run, objective, report)
        (s,) = places_on_path(whole_job, run, objective, path, place.number, np.array([place.s]))
        traced = trace_run(whole_job, run, path, report)
        notes: tuple[str, ...] = ()
        if clear:
            traced, notes = first_clear(whole_job, run, traced, report)
    except ArmContourError as error:
        return Resumption(resume_at=resume_at, only=only, reason=capitalise(str(error)))
    return Resumption(
        resume_at=resume_at,
        only=only,
        begin=place.begin,
        whole=place.traced(traced, float(s)),
        notes=notes,
    )


@contextmanager
def explained_reach(job: Job) -> Iterator[None]:
    """Replace an error of reach in this context by one about the farthest point of the job."""
    try:
        yield
    except Unreachable as error:
        from armcontour.jobs.unreachable_point import explain_reach

        raise explain_reach(error, job) from None


def explain_plan(
    job: Job, planned: RunResult, progress: Progress | None = None
) -> Explanation | None:
    """Find the active limits along a plan; None if it is not optimal, or was stretched."""
    trajectory = planned.trajectory
    if trajectory.method is not Method.OPTIMAL or trajectory.speed_factor != 1.0:
        return None
    command = planned.command_velocity
    constraints = () if command is None else (command,)
    return explain_all(trajectory, job.arm, constraints=constraints, progress=progress)


def prepare_program(
    job: Job, run: Run, progress: Progress | None = None, resumption: Resumption | None = None
) -> Program:
    """Add the process's leads, overlaps and events to a job's program; corners stay sharp.

    A motion that begins at a taught position begins with a rapid.

    `resumption`: see `find_resumption`; automatic leads depend on it.

    Raises:
        ArmContourError: The process does not fit the program, or an automatic lead has no length.
    """
    subprogress(progress)(Step((SHAPING_STEP if run.is_shaped else ROUNDING_STEP,)))
    leads = None
    if job.process.automatic:
        if not run.timing.automatic_leads:
            raise InvalidInput(
                f"Run {run.name}: leads of automatic length require the timing method optimal, but "
                f"the method is {run.timing.method}. Specify the lengths of the leads."
            )
        leads = find_leads(job, run, resumption)
    with error_context("process"):
        prepared = prepare(job.program, job.process, leads)
    if job.start_from is not None:
        # A rapid without a path, which begins at the taught position.
        prepared = dataclasses.replace(prepared, moves=(Rapid(), *prepared.moves))
    run.check_end_time(prepared)
    return prepared


def find_leads(job: Job, run: Run, resumption: Resumption | None = None) -> list[Leads]:
    """Find leads with which each contour has full speed where the process switches on and off.

    The tool is assumed to accelerate as along the contour itself. Full speed is the assigned
    velocity; without one, the largest speed along the contour. Leads that the arm does not reach
    are halved. Lengths of leads that are not automatic are 0.
    """
    job = job.at_path
    # Corners of shape free are replaced by arcs here, because shaping takes long.
    rounding = None if run.rounding is None else run.rounding.with_arcs
    timing = run.timing.without_duration()
    run = dataclasses.replace(run, rounding=rounding, timing=timing, speed_factor=None)
    process = job.process
    # The contours are arranged first, so they have their direction already.
    changes: dict[str, Any] = {
        **dict.fromkeys(KEYS_WITHOUT_LEADS),
        "direction": "drawn",
        "wait": (),
    }
    without_leads = dataclasses.replace(
        process,
        **changes,
        approach=0.0,
        retract=0.0,
        order="drawn",
        by_layer={x: {**keys, **changes} for x, keys in process.by_layer.items()},
        by_contour={x: {**keys, **changes} for x, keys in process.by_contour.items()},
    )
    moves = prepare(arrange_contours(job.program, process), without_leads).moves
    # Events may be due before the motion without leads begins.
    without_events = [
        dataclasses.replace(x, events=()) if isinstance(x, Contour) else x
        for x in moves
        if not isinstance(x, Event)
    ]
    program = Program(moves=tuple(without_events))
    planned = plan_one(job, run, objective=program, clear=False, resumption=resumption)
    with error_context("leads"):
        return [
            _leads_of_contour(job, run, x, span.trajectory)
            for x, span in zip(program.contours, planned.trajectory.contour_spans, strict=True)
        ]


def _leads_of_contour(job: Job, run: Run, contour: Contour, motion: Trajectory | None) -> Leads:
    """Find a contour's automatic leads from its motion without leads.

    The tool must reach the speed v in the lead, with its acceleration along the contour. There, it
    reaches the speed v_i after the distance d_i, so the lead is v² / max(v_i² / d_i) long.
    """
    assert motion is not None
    process = job.process.of_contour(contour)
    leads = Leads()
    contour = dataclasses.replace(contour, work=None)
    path = contour.path
    length_of_motion = float(motion.s(motion.duration))
    distances = np.linspace(0.0, length_of_motion, LEAD_SPEED_SAMPLES)[1:]
    for key, name, s, side in (
        ("lead_in", "before", 0.0, "right"),
        ("lead_out", "after", path.length, "left"),
    ):
        lead = getattr(process, key)
        if lead is None or lead.length is not None:
            continue
        speeds = motion.speed_at(distances if name == "before" else length_of_motion - distances)
        speed = float(path.assigned_speeds(run.limits.speed, s, side=side))
        speed = speed if math.isfinite(speed) else float(speeds.max())
        needed = speed**2 / float((speeds**2 / distances).max())
        if lead.shape == "arc" and run.limits.centripetal_acceleration is not None:
            # A shorter quarter of a circle is too tight for the speed.
            needed = max(needed, math.pi / 2 * speed**2 / run.limits.centripetal_acceleration)
        length = needed = LEAD_FACTOR * needed
        ends = Process(begin="drawn", up=process.up, **{key: lead})
        while True:
            tried = Leads(**{name: length})
            try:
                with_lead = prepare(Program(moves=(contour,)), ends, [tried])
                planned = plan_one(job, run, objective=with_lead, clear=False)
                break
            except ArmContourError:
                if length <= SHORTEST_LEAD:
                    raise
                length /= 2
        # Limits of the contour may not allow the full speed.
        reached = planned.trajectory.speed_at(planned.path.contours[0].at_work[name == "after"])
        length = min(length, LEAD_FACTOR * needed * (float(reached) / speed) ** 2)
        leads = dataclasses.replace(leads, **{name: length})
    return leads


def round_program(
    job: Job,
    run: Run,
    program: Program,
    progress: Progress | None = None,
    resumption: Resumption | None = None,
) -> Program:
    """Round or shape the corners of a program as the run specifies; they can stay sharp.

    `resumption`: see `find_resumption`; shapes depend on the configuration.
    """
    shaping = run.shaping
    if shaping is not None:
        with error_context("corners"):
            return _shape(job, run, shaping, program, progress, resumption)
    rounding = run.rounding
    if rounding is None:
        return program
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


def _shape(
    job: Job,
    run: Run,
    shaping: Shaped,
    program: Program,
    progress: Progress | None,
    resumption: Resumption | None,
) -> Program:
    """Shape a program from the configuration of the job, or of the job that is resumed."""
    from armcontour.planning import shape

    at_path = job.at_path
    configuration = at_path.configuration
    seed = at_path.seed
    if resumption is not None and resumption.whole is not None:
        configuration, seed = resumption.whole.start_of(program.contours[0], job.arm)
    options = dataclasses.replace(
        shaping,
        configuration=configuration,
        seed=seed,
        intervals=shaping.intervals or intervals_of(program),
    )
    return shape(program, job.arm, run.limits, options, progress=progress)


def places_on_path(
    job: Job, run: Run, objective: Program, path: Program, number: int, s: FloatArray
) -> FloatArray:
    """Find places of a drawn contour on the path; return their arc lengths [m], (n,).

    - `objective`: the program with sharp corners.
    - `path`: the program with rounded or shaped corners.
    - `number`: index of the contour.
    - `s`: increasing arc lengths on the contour with sharp corners [m], (n,).
    """
    if run.is_shaped:
        return shaped_places(objective, path, number, s)
    marked = round_program(job, run, with_marks(objective, number, s))
    return marked_places(marked.contours[number])


def trace_run(
    job: Job,
    run: Run,
    program: Program,
    progress: Progress,
    resumption: Resumption | None = None,
) -> Tracing:
    """Trace the joint paths of all moves in a program within the run's limits.

    `resumption`: see `find_resumption`.
    """
    # A shaped program is traced in the configuration with which it was shaped, other programs in
    # the fastest configuration that is collision-free and above the base.
    progress(Step(("tracing",)))
    return trace_program(
        program,
        job.arm,
        run.limits,
        configuration=job.configuration,
        seed=job.seed,
        start=job.start_from,
        accept=first_contour_clear(job),
        progress=progress,
        whole=None if resumption is None else resumption.whole,
    )


def _join_smoothly(program: Program, run: Run, *, rounded: bool) -> Program:
    """Add transitions where lines and arcs meet, if this step (before or after rounding) adds them.

    `rounded`: True after corners were rounded.
    """
    # If the orientation follows the tangent, transitions are added before corners are rounded,
    # because rounding also rounds the orientation. If the orientation is fixed, they are added
    # afterwards. If it turns smoothly over pieces of its own on some contours, they are added
    # before, as well. Other orientations get no transitions.
    paths = [x.path for x in program.contours]
    fixed = [x.orientation is None or x.orientation.fixed for x in paths]
    follow = all(x.orientation is not None and x.orientation.follows for x in paths)
    smooth = all(map(or_, fixed, map(turns_smoothly, paths)))
    due = all(fixed) if rounded else follow or (smooth and not all(fixed))
    allowed = run.transition_tolerance
    return smooth_curvature(program, tolerance=allowed) if due and allowed > 0 else program


def time_run(
    job: Job, run: Run, objective: Program, traced: Tracing, progress: Progress
) -> RunResult:
    """Plan along joint paths, at the speed of the run, without a check of collisions."""
    planned = time_freely(job, run, objective, traced, progress)
    command = exceeded_command_velocity(job, run, planned.trajectory)
    return planned if command is None else time_within(job, planned, command, progress)


def time_freely(
    job: Job, run: Run, objective: Program, traced: Tracing, progress: Progress
) -> RunResult:
    """Plan as `time_run`, without the constraint of the set-point velocity."""
    return RunResult(
        run=run,
        objective=objective,
        path=traced.program,
        trajectory=_time(job, run, traced, run.timing, progress),
        traced=traced,
    )


def time_within(
    job: Job, planned: RunResult, command: CommandVelocity, progress: Progress
) -> RunResult:
    """Plan again, with the constraint of the set-point velocity.

    - `planned`: the plan of `time_freely`.
    """
    run = planned.run
    assert planned.traced is not None and isinstance(run.timing, Optimal)
    timing = dataclasses.replace(run.timing, constraints=(*run.timing.constraints, command))
    trajectory = _time(job, run, planned.traced, timing, progress)
    return dataclasses.replace(planned, trajectory=trajectory, command_velocity=command)


def _time(
    job: Job, run: Run, traced: Tracing, timing: PlanOptions, progress: Progress
) -> Trajectory:
    """Time the moves of a run by the options `timing`, at the speed of the run."""
    progress(Step(("timing",)))
    fastest = plan(traced, job.arm, run.limits, timing, progress=progress)
    return at_speed(fastest, 1.0 if run.speed_factor is None else run.speed_factor)


def time_clear(
    job: Job,
    run: Run,
    objective: Program,
    traced: Tracing,
    progress: Progress,
    resumption: Resumption | None = None,
    fastest: RunResult | None = None,
) -> RunResult:
    """Plan along the first of several alternative joint paths that is collision-free.

    `fastest`: the plan along `traced`, if known.
    """
    for candidate, notes in alternatives(job, run, traced, progress, resumption):
        if fastest is not None and candidate is traced:
            planned = fastest
        else:
            planned = time_run(job, run, objective, candidate, progress)
        progress(Step(("clearance",)))
        clearance = clearance_of(job, planned.trajectory)
        planned = dataclasses.replace(
            planned, clearance=clearance, avoided=notes, resumption=resumption
        )
        if clearance is None or clearance.satisfied:
            return planned
    is_kept = resumption is not None and resumption.whole is not None
    with error_context("in the configuration of the whole job" if is_kept else ""):
        check_collision(job, planned.path, planned.trajectory)
    return planned
