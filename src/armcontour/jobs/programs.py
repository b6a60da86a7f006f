"""The program of a run: prepared, with leads of automatic length, and with rounded corners."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy.typing as npt

from armcontour._progress import Progress
from armcontour.arms import PlanarTwoLink
from armcontour.errors import ArmContourError, InvalidInput, NotRealizable, locate_errors
from armcontour.geometry import Path
from armcontour.jobs.job import TANGENT, Job, Rounding, Run
from armcontour.jobs.single_corners import corner_tolerances, refuse_missing
from armcontour.jobs.warnings import SAME_SPEED, assigned_speed
from armcontour.jobs.ways import first_contour_clear
from armcontour.motion import Method
from armcontour.program import (
    Contour,
    Leads,
    Process,
    Program,
    arrange,
    prepare,
    round_corners,
    smooth_curvature,
)
from armcontour.timing import (
    Tracing,
    intervals_of,
    plan,
    trace_program,
)
from armcontour.timing.program_tracing import ends_of

# Automatic leads: the first length that is tried [m], and how often the length is doubled.
FIRST_LEAD = 2e-3
MOST_DOUBLINGS = 12
# Under limits of jerk the speed goes on growing a little, the flatter the lead's arc gets: twice a
# lead that gives less than this share more is not worth its length.
LEAST_GAIN = 0.05
# Resolution of the search for the shortest lead: a share of its length, and a length [m].
LEAD_RESOLUTION = 0.05
FINEST_LEAD = 1e-4
# Values of the process without which automatic leads are found.
UNLED = ("lead_in", "lead_out", "pierce", "kerf")


def programs_of(
    job: Job, this: Run, progress: Progress | None = None, known: Program | None = None
) -> tuple[Program, Program]:
    """The program of a run, prepared, before and after its corners are rounded or shaped.

    Args:
        job: The job.
        this: The run.
        progress: Called with the step "shaping" and the share that is done.
        known: The prepared program, if another run has it already.

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
        if this.timing != Method.OPTIMAL:
            raise InvalidInput(
                f"Run {this.name}: leads of automatic length need the timing optimal, not "
                f"{this.timing}: give their lengths."
            )
        leads = automatic_leads(job, this)
    with locate_errors("process"):
        return prepare(job.program, job.process, leads)


def round_program(
    job: Job, this: Run, program: Program, progress: Progress | None = None
) -> Program:
    """Round or shape the corners of a program as a run does; a run may keep them sharp."""
    rounding = this.rounding
    if rounding is None:
        return program
    if rounding.free:
        from armcontour.timing import shape

        with locate_errors("corners"):
            return shape(
                program,
                job.arm,
                this.limits,
                reserve=this.reserve,
                branch=job.branch,
                start=job.start,
                intervals=this.timing_options.get("intervals", intervals_of(program)),
                progress=progress,
                **rounding.wishes,
            )
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


def automatic_leads(job: Job, this: Run) -> list[Leads]:
    """The shortest leads with which the tool has full speed where the process goes on and off.

    Full speed is the assigned velocity. If no lead within the arm's reach gives the assigned
    velocity, full speed is the largest speed that a lead gives. Corners of the shape free count as
    arcs here: dozens of leads are tried, and shaping takes long.

    Returns:
        The lengths of lead-in and lead-out per contour [m]; 0 where the length is not automatic.
    """
    rounding = None if this.rounding is None else this.rounding.with_arcs
    this = dataclasses.replace(this, rounding=rounding, duration=None)
    process = job.process
    layers = {
        layer: {key: x for key, x in given.items() if key not in UNLED}
        for layer, given in process.by_layer.items()
    }
    plain = dataclasses.replace(
        process,
        lead_in=None,
        lead_out=None,
        pierce=None,
        approach=0.0,
        retract=0.0,
        order="drawn",
        kerf=None,
        by_layer=layers,
    )
    gain = LEAST_GAIN if this.limits.jerk_limits else SAME_SPEED
    found = []
    contours = prepare(arrange(job.program, process), plain).contours
    if isinstance(job.arm, PlanarTwoLink) and job.branch is None:
        # The first contour chooses the branch for all of them.
        first = round_program(job, this, Program(moves=contours[:1]))
        begin, _ = ends_of(trace_run(job, this, first).joint_paths[0])
        job = dataclasses.replace(job, branch=job.arm.branch_of(begin))
    for x in contours:
        contour = dataclasses.replace(x, events=(), work=None)

        def end_speeds(before: float, after: float, x: Contour = contour) -> tuple[float, float]:
            return _end_speeds(job, this, x, Leads(before=before, after=after))

        own = process.of_layer(x.layer)
        lengths = []
        with locate_errors("leads"):
            for lead, s, side, speed in (
                (own.lead_in, 0.0, "right", lambda x: end_speeds(x, 0.0)[0]),
                (own.lead_out, x.path.length, "left", lambda x: end_speeds(0.0, x)[1]),
            ):
                automatic = lead is not None and lead.length is None
                assigned = assigned_speed(x, s, side, this)
                lengths.append(_shortest_lead(speed, assigned, gain) if automatic else 0.0)
        found.append(Leads(before=lengths[0], after=lengths[1]))
    return found


def _end_speeds(job: Job, this: Run, contour: Contour, leads: Leads) -> tuple[float, float]:
    """Speeds where the process goes on and off [m/s], of one contour that is planned alone."""
    own = job.process.of_layer(contour.layer)
    ends = Process(
        begin="drawn",
        lead_in=own.lead_in if leads.before else None,
        lead_out=own.lead_out if leads.after else None,
        up=own.up,
    )
    alone = round_program(job, this, prepare(Program(moves=(contour,)), ends, [leads]))
    (only,) = alone.contours
    assert only.work is not None
    traced = trace_run(job, this, alone)
    on, off = plan(traced, job.arm, this.limits, **this.plan_options).speed_at(only.work)
    return float(on), float(off)


def _shortest_lead(speed: Callable[[float], float], assigned: float, gain: float) -> float:
    """The shortest lead [m] with the assigned velocity, or with the largest speed of any lead.

    The length is doubled until the speed suffices, does not grow or the arm does not reach; then
    the length is bisected.

    Args:
        speed: Gives the speed at the contour's end [m/s] with a lead of a length [m].
        assigned: The assigned velocity [m/s].
        gain: Twice the length must give the assigned velocity, or more speed by this share at
            least, or it is not taken.

    Raises:
        NotRealizable: The speed still grows at the longest lead.
    """
    # Half of the tolerance of `slow_ends`, so that no warning is given for the result.
    enough = assigned * (1 - SAME_SPEED / 2)
    short, length, now = 0.0, FIRST_LEAD, speed(FIRST_LEAD)
    found: float | None = None
    for _ in range(MOST_DOUBLINGS):
        if now >= enough:
            found = length
            break
        try:
            longer = speed(2 * length)
        except ArmContourError:
            # The arm does not reach the end of this lead, but may reach that of a shorter one.
            short, length = length, 2 * length
            break
        if longer < enough and longer <= now * (1 + gain):
            enough, found = now * (1 - SAME_SPEED / 2), length
            break
        short, length, now = length, 2 * length, longer
    else:
        raise NotRealizable(
            f"with {length:.3g} m the tool still gets faster, {now:.3g} m/s now: give the lead a "
            "length, or the contour a lower speed.",
            limit="speed",
            needed=length,
        )
    while length - short > max(LEAD_RESOLUTION * length, FINEST_LEAD):
        middle = (short + length) / 2
        try:
            suffices = speed(middle) >= enough
        except ArmContourError:
            length = middle
            continue
        if suffices:
            length = found = middle
        else:
            short = middle
    return short if found is None else found


def trace_run(
    job: Job,
    this: Run,
    program: Program,
    progress: Progress | None = None,
) -> Tracing:
    """Trace the joint paths of all moves of a program, under the limits of a run.

    A shaped program is traced in the configuration that it was shaped for, others in the fastest
    one that keeps clear and above the base.
    """
    return trace_program(
        program,
        job.arm,
        this.limits,
        branch=job.branch,
        start=job.start,
        fits=first_contour_clear(job),
        progress=progress,
    )
