"""Steps of planning: rounding of the corners of a program, and its joint paths."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy.typing as npt

from armcontour._progress import Progress
from armcontour.errors import locate_errors
from armcontour.geometry import Path
from armcontour.jobs.alternatives import first_contour_clear
from armcontour.jobs.job import TANGENT, Job, Rounding, Run
from armcontour.jobs.single_corners import corner_tolerances
from armcontour.program import Program, round_corners, smooth_curvature
from armcontour.timing import Optimal, Tracing, intervals_of, trace_program


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
