"""Entry point `shape`: paths whose shape and timing are found together, contour by contour."""

from __future__ import annotations

import dataclasses
from contextlib import AbstractContextManager, nullcontext
from typing import overload

import numpy.typing as npt

from armcontour._progress import Progress, Step, under
from armcontour.arms import Arm, Limits, PlanarTwoLink
from armcontour.errors import locate_errors
from armcontour.geometry import Outcome, Path, ShapedPath, Tube
from armcontour.program import Contour, Program, contour_called, put_on_path
from armcontour.timing.program_tracing import trace_program
from armcontour.timing.shaping.search import make_search
from armcontour.timing.shaping.starts import Candidate, Timer, make_starts
from armcontour.timing.shaping.wishes import DEFAULT_ITERATIONS, Wishes


@overload
def shape(
    path: Path,
    arm: Arm,
    limits: Limits | None = None,
    *,
    tolerance: float,
    line_tolerance: float | None = None,
    zone: float | None = None,
    angular_tolerance: float | None = None,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    iterations: int = DEFAULT_ITERATIONS,
    intervals: int | None = None,
    progress: Progress | None = None,
) -> ShapedPath: ...
@overload
def shape(
    path: Program,
    arm: Arm,
    limits: Limits | None = None,
    *,
    tolerance: float,
    line_tolerance: float | None = None,
    zone: float | None = None,
    angular_tolerance: float | None = None,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    iterations: int = DEFAULT_ITERATIONS,
    intervals: int | None = None,
    progress: Progress | None = None,
) -> Program: ...
def shape(
    path: Path | Program,
    arm: Arm,
    limits: Limits | None = None,
    *,
    tolerance: float,
    line_tolerance: float | None = None,
    zone: float | None = None,
    angular_tolerance: float | None = None,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    iterations: int = DEFAULT_ITERATIONS,
    intervals: int | None = None,
    progress: Progress | None = None,
) -> Path | Program:
    """Find the path within a tolerance of an objective along which an arm moves the fastest.

    Every point of the path is within the tolerance of its own place on the objective, and every
    vertex of the objective is within the tolerance of the path. The fastest motion along the path
    takes no longer than along arcs or parabolas at the corners, or with a stop at every vertex.

    Args:
        path: The objective path, or a program, whose contours are shaped one by one.
        arm: The arm.
        limits: The limits; by default the arm's own.
        tolerance: Largest distance in either direction [m]; 0 stops at every vertex. Tolerances of
            the path's own segments cap it.
        line_tolerance: The tolerance farther than `zone` from every vertex [m]; by default the same
            as `tolerance`.
        zone: Distance from the vertices, along the objective, from which `line_tolerance` holds
            [m].
        angular_tolerance: As in `round_corners` [rad].
        branch: As in `plan`.
        start: As in `plan`.
        iterations: Largest number of iterations; after each one the path keeps everything.
        intervals: Approximate number of grid intervals of the plans that are compared.
        progress: Called with the step "shaping" and the share that is done.

    Raises:
        InvalidInput: A tolerance is negative, not a number or above half of a stretch between two
            sharp corners, or `line_tolerance` and `zone` are not given together.
        Unreachable: The arm cannot follow the objective.
        NotRealizable: No motion along the objective keeps the limits.
    """
    wishes = Wishes(
        tolerance=tolerance,
        line_tolerance=line_tolerance,
        zone=zone,
        angular_tolerance=angular_tolerance,
        iterations=iterations,
    )
    program = Program.of(path, "shape needs a Path or a Program")
    with_names = program is path
    for i, x in enumerate(program.contours):
        with _named(x, i, with_names):
            wishes.refuse_too_large(x.path)
    bounds = (arm.limits if limits is None else limits).for_joints(arm.dof)
    traced = trace_program(program, arm, bounds, branch=branch, start=start)
    begin = {x.move: x.joint_path for x in traced.steps if x.joint_path is not None}
    moves, done, count = list(program.moves), 0, len(program.contours)
    report = under(progress, "shaping")
    for i, move in enumerate(moves):
        if not isinstance(move, Contour):
            continue
        own = None if isinstance(arm, PlanarTwoLink) else begin[i](begin[i].breaks[0])
        timer = Timer(arm, bounds, branch, own, intervals)
        with _named(move, done, with_names):
            shaped = _shape(move.path, timer, wishes)
        moves[i] = put_on_path(move, shaped)
        done += 1
        report(Step((), done / count))
    found = dataclasses.replace(program, moves=tuple(moves))
    # Whoever gives a path gets a path.
    return found if program is path else found.path


def _named(contour: Contour, number: int, wanted: bool) -> AbstractContextManager[None]:
    """A context in which error messages start with the name of a contour, if wanted."""
    return locate_errors(contour_called(contour, number)) if wanted else nullcontext()


def _shape(objective: Path, timer: Timer, wishes: Wishes) -> ShapedPath:
    """The shaped path of one contour."""
    known = _time_starts(objective, timer, wishes)
    if not known:
        # Raises what is wrong with the objective.
        timer.time(timer.trace(objective))
    durations = {x.name: x.duration for x in known}
    first = min(known, key=lambda x: x.duration)
    best, history = first, [first.duration]
    tube = Tube.of(
        objective, wishes.tolerance, line_tolerance=wishes.line_tolerance, zone=wishes.zone
    )
    search = make_search(objective, tube, timer, wishes)
    if search is not None:
        for _, found in zip(range(wishes.iterations), search.run(), strict=False):
            best = min(best, found, key=lambda x: x.duration)
            history.append(best.duration)
    durations["shaped"] = best.duration
    outcome = Outcome(start=first.name, durations=durations, history=tuple(history))
    return _shaped_path(objective, best, wishes, outcome)


def _time_starts(objective: Path, timer: Timer, wishes: Wishes) -> list[Candidate]:
    """The starts with their timings, without those that the arm cannot follow."""
    found = [
        timer.candidate(name, path, places)
        for name, (path, places) in make_starts(objective, wishes).items()
    ]
    return [x for x in found if x is not None]


def _shaped_path(objective: Path, best: Candidate, wishes: Wishes, outcome: Outcome) -> ShapedPath:
    """A candidate as a shaped path."""
    return ShapedPath(
        segments=best.path.segments,
        merged=best.path.merged,
        orientation=best.path.orientation,
        objective=objective,
        places=best.places,
        tolerance=wishes.tolerance,
        line_tolerance=wishes.line_tolerance,
        zone=wishes.zone,
        outcome=outcome,
        curve=best.path.curve if isinstance(best.path, ShapedPath) else None,
    )
