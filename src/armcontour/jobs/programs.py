"""The program of a run: prepared, with leads of automatic length, and with rounded corners."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour._progress import Progress
from armcontour.arms import PlanarTwoLink
from armcontour.errors import ArmContourError, InvalidInput, locate_errors
from armcontour.geometry import Path
from armcontour.jobs.job import TANGENT, Job, Rounding, Run
from armcontour.jobs.single_corners import corner_tolerances, refuse_missing
from armcontour.jobs.warnings import SAME_SPEED, assigned_speed
from armcontour.jobs.ways import first_contour_clear
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
    Optimal,
    Tracing,
    intervals_of,
    plan,
    trace_program,
)
from armcontour.timing.program_tracing import ends_of

# Automatic leads: the first length that is tried [m], and the shortest and longest ones.
FIRST_LEAD, SHORTEST_LEAD, LONGEST_LEAD = 32e-3, 2e-3, 16.0
# Under limits of jerk the speed goes on growing a little, the flatter the lead's arc gets: twice a
# lead that gives less than this share more is not worth its length.
LEAST_GAIN = 0.05
# A lead is short enough if this share of its length does not suffice; the next length that is tried
# is longer than estimated by this factor; and the speed along a lead is known at so many places.
SHORT_ENOUGH, LONGER, PLACES = 0.98, 1.005, 401
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
        if not isinstance(this.timing, Optimal):
            raise InvalidInput(
                f"Run {this.name}: leads of automatic length need the timing optimal, not "
                f"{this.timing.method}: give their lengths."
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
            assert isinstance(this.timing, Optimal)
            options = dataclasses.replace(
                rounding.options,
                reserve=this.timing.reserve,
                branch=job.branch,
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
    arcs here, because several leads are tried, and shaping takes long.

    Returns:
        The lengths of lead-in and lead-out per contour [m]; 0 where the length is not automatic.
    """
    rounding = None if this.rounding is None else this.rounding.with_arcs
    assert isinstance(this.timing, Optimal)
    timing = dataclasses.replace(this.timing, duration=None)
    this = dataclasses.replace(this, rounding=rounding, timing=timing)
    process = job.process
    unled: dict[str, Any] = dict.fromkeys(UNLED)
    plain = dataclasses.replace(
        process,
        **unled,
        approach=0.0,
        retract=0.0,
        order="drawn",
        by_layer={layer: {**given, **unled} for layer, given in process.by_layer.items()},
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
        own = process.of_layer(x.layer)
        lengths = []
        for lead, s, side, name in (
            (own.lead_in, 0.0, "right", "before"),
            (own.lead_out, x.path.length, "left", "after"),
        ):
            automatic = lead is not None and lead.length is None
            speeds = partial(_lead_speeds, job, this, contour, name)
            with locate_errors("leads"):
                assigned = assigned_speed(x, s, side, this)
                lengths.append(_shortest_lead(speeds, assigned, gain) if automatic else 0.0)
        found.append(Leads(before=lengths[0], after=lengths[1]))
    return found


def _lead_speeds(
    job: Job, this: Run, contour: Contour, name: str, length: float
) -> FloatArray | None:
    """Speeds along the lead "before" or "after" a contour that is planned alone [m/s].

    They are at evenly spaced places, from the end where the tool rests to the contour. None if the
    arm does not reach that end, but may reach that of a shorter lead.
    """
    own = job.process.of_layer(contour.layer)
    used = "lead_in" if name == "before" else "lead_out"
    ends = Process(begin="drawn", up=own.up, **{used: getattr(own, used)})
    leads = dataclasses.replace(Leads(before=0.0, after=0.0), **{name: length})
    try:
        alone = round_program(job, this, prepare(Program(moves=(contour,)), ends, [leads]))
        traced = trace_run(job, this, alone)
        motion = plan(traced, job.arm, this.limits, this.timing)
    except ArmContourError:
        if length <= SHORTEST_LEAD:
            raise
        return None
    (only,) = alone.contours
    assert only.work is not None
    rest, work = (0.0, only.work[0]) if name == "before" else (only.path.length, only.work[1])
    return np.asarray(motion.speed_at(np.linspace(rest, work, PLACES)))


def _shortest_lead(
    speeds: Callable[[float], FloatArray | None], assigned: float, gain: float
) -> float:
    """The shortest lead [m] with the assigned velocity, or with the largest speed of any lead.

    A long lead shows in which share of it the tool gets fast enough, which is the next length.

    Args:
        speeds: Gives the speeds along a lead of a length [m], as `_lead_speeds`.
        assigned: The assigned velocity [m/s].
        gain: Twice the length must give the assigned velocity, or more speed by this share at
            least, or it is not taken.
    """
    # Half of the tolerance of `slow_ends`, so that no warning is given for the result.
    enough = assigned * (1 - SAME_SPEED / 2)
    long, beyond = FIRST_LEAD, LONGEST_LEAD
    while (found := speeds(long)) is None:
        long, beyond = long / 2, long
    # A longer lead, until the speed suffices, does not grow or the arm does not reach: `short` has
    # a speed that is too low.
    short, low = 0.0, enough
    while found[-1] < enough and long < SHORT_ENOUGH * beyond:
        length = min(2 * long, (long + beyond) / 2)
        longer = speeds(length)
        if longer is None:
            beyond = length
        elif longer[-1] < min(enough, found[-1] * (1 + gain)) and length == 2 * long:
            break
        else:
            short, low, long, found = long, found[-1], length, longer
    enough = min(enough, found[-1] * (1 - SAME_SPEED / 2))
    # A shorter one: along lines and on arcs, speeds grow with the root of the length. Where they
    # grow less, as at the end of an acceleration with a limit of jerk, steps are doubled.
    step = 0.0
    while True:
        share = np.argmax(found >= enough) / (PLACES - 1)
        length = LONGER * max(short * (enough / low) ** 2, share * long)
        length = max(length, min(short + step, (short + long) / 2))
        if length >= SHORT_ENOUGH * long:
            return long
        tried = speeds(length)
        if tried is not None and tried[-1] >= enough:
            long, found, step = length, tried, 0.0
        else:
            step = 2 * (length - short) if short else 0.0
            short, low = length, enough if tried is None else tried[-1]


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
