"""Entry point `shape`: shape and timing of paths are optimized together, contour by contour."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, cast, overload

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, NotRealizable
from armcontour.core.fields import checked, declared
from armcontour.core.progress import Progress, Step
from armcontour.core.quantities import AngularDistance, AtLeast, Distance
from armcontour.core.text import capitalise
from armcontour.geometry import Path, ShapedPath, ShapingOutcome, Tube
from armcontour.geometry.shaped_path import ARCS, SHAPED, STOPS, describe_unfinished
from armcontour.motion import JointPath, Method, Trajectory
from armcontour.planning.optimal_timing import Optimal, plan_optimal
from armcontour.planning.program_timing import Timing, time_program
from armcontour.planning.program_tracing import SAME_JOINT_POSITION, Tracing, ends_of, trace_program
from armcontour.planning.shaping.shape_search import ShapeSearch, explain_unshaped, make_searches
from armcontour.planning.shaping.shape_starts import Candidate, Timer, Tolerances, make_starts
from armcontour.planning.timing_options import (
    DEFAULT_ITERATIONS,
    MAX_SHAPES,
    WITHOUT_JERK,
    IntervalCount,
    PlanOptions,
)
from armcontour.program import Contour, Move, Program, contour_called, draw_with_arcs
from armcontour.program.move_errors import move_context
from armcontour.program.moves import put_on_path
from armcontour.robot import Arm, Limits, PlanarTwoLink, resolve_limits
from armcontour.robot.limits import reduce_limits

# Smallest turn of a sharp corner [rad]. Vertices with a smaller turn may be points on a curve,
# which can be arbitrarily close to each other.
SHARP = np.radians(30)
# Once this fraction of the duration is saved, the search is not repeated from another start.
ENOUGH_SAVED = 0.01
# From this number of contours on, other processes shape them; processes start in a few seconds.
MANY_CONTOURS = 24
# Largest number of joint values of the control points, summed over all iterations, for each corner
# or rest. Tolerances of about 1 µm (six joints) and 0.1 µm (two joints) need more.
WORK = 30_000
# Decimals to which durations of initial paths are compared [s].
DURATION_DECIMALS = 9
# Note of a contour for which arcs are faster than all shapes that were found
ARCS_ARE_FASTER = "no shape that was found is faster than arcs"


@declared(eq=False)
class Shaped(PlanOptions):
    """Options of the method "shaped", in addition to those of `PlanOptions`.

    The method finds the fastest path within a tolerance of the given path.

    >>> options = ac.Shaped(tolerance=1e-3, iterations=1)
    >>> ac.plan(objective, arm, limits, options).duration < planned.duration
    True

    Args:
        tolerance: Largest distance of the path from the objective, and of the vertices of the
            objective from the path [m]; 0 stops at every vertex. Tolerances of the path's own
            segments cap it, and so does half of a stretch between two sharp corners.
        angular_tolerance: Largest angle between the tool and its required orientation [rad], as in
            `round_corners`.
        iterations: Largest number of iterations. The path satisfies all limits after each one.
        intervals: Approximate number of grid intervals of the plans that are compared.

    Raises:
        InvalidInput: A value of the wrong type or out of range.
    """

    method = Method.SHAPED
    changes_path = True
    tolerance: Distance
    angular_tolerance: AngularDistance | None = None
    iterations: Annotated[int, AtLeast(0, MAX_SHAPES)] = DEFAULT_ITERATIONS
    intervals: IntervalCount | None = None

    @property
    def tolerances(self) -> Tolerances:
        """Tolerances of the shaped path."""
        return Tolerances(self.tolerance, self.angular_tolerance)

    def reshape(
        self, program: Program, arm: Arm, limits: Limits, progress: Progress | None, *, named: bool
    ) -> Program:
        """Return the program with its contours shaped, by the work of `shape`."""
        return Shaping(arm, limits, self).shape(program, progress, named=named)

    def time(self, joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
        """Plan the fastest motion along a contour that is shaped already."""
        fastest = plan_optimal(joint_path, arm, limits, Optimal(intervals=self.intervals))
        return replace(fastest, method=Method.SHAPED)

    def check_jerk(self, limits: Limits) -> None:
        """Refuse limits of jerk, because accelerations jump along a shaped path."""
        if limits.limits_jerk:
            raise NotRealizable(
                "Accelerations jump along a shaped path, where joint_jerk would stop the tool. "
                'Round corners with continuity="curvature" and plan by the method optimal (in a '
                "job, corners: {shape: arc}, whose curvature is continuous if jerk is limited), or "
                f"{WITHOUT_JERK}.",
                limit="joint_jerk",
            )


@overload
def shape(
    path: Path, arm: Arm, limits: Limits | None, options: Shaped, *, progress: Progress | None = ...
) -> ShapedPath: ...
@overload
def shape(
    path: Program,
    arm: Arm,
    limits: Limits | None,
    options: Shaped,
    *,
    progress: Progress | None = ...,
) -> Program: ...
@checked
def shape(
    path: Path | Program,
    arm: Arm,
    limits: Limits | None,
    options: Shaped,
    *,
    progress: Progress | None = None,
) -> Path | Program:
    """Find the path within a tolerance of an objective along which an arm moves the fastest.

    Every point of the path is within the tolerance of its matching point on the objective, and
    every vertex of the objective is within the tolerance of the path. The fastest motion along the
    path is at most as long as along arcs or parabolas at the corners, or with a stop at every
    vertex.

    >>> shaped = ac.shape(objective, arm, limits, ac.Shaped(tolerance=1e-3, iterations=1))
    >>> ac.plan(shaped, arm, limits).duration < planned.duration
    True

    Args:
        path: The objective path, or a program, whose contours are shaped one by one.
        arm: The arm.
        limits: Limits that replace those of the arm, as in `plan`; None for those of the arm.
        options: Tolerances, search, and reserve.
        progress: Called with the step "shaping" and the fraction done.

    Raises:
        InvalidInput: Limits that do not fit the arm.
        Unreachable: The arm cannot follow the objective.
        NotRealizable: No motion along the objective satisfies the limits, or limits of jerk are
            given, which would stop the tool where the curvature of a shaped path jumps.

    Warns:
        UserWarning: The search along a path ended early, because the tolerance is tiny.
    """
    bounds = resolve_limits("shape", arm, limits)
    options.check_jerk(bounds)
    program = Program.from_path(path)
    shaped = options.reshape(program, arm, bounds, progress, named=program is path)
    if program is path:
        return shaped
    for doubt in describe_unfinished([shaped.path]):
        warnings.warn(capitalise(doubt), stacklevel=3)
    return shaped.path


@dataclass(frozen=True, slots=True)
class Shaping:
    """Shaping of the contours of a program."""

    arm: Arm
    limits: Limits
    options: Shaped

    def shape(self, program: Program, progress: Progress | None, *, named: bool) -> Program:
        """Shape the contours of a program.

        Args:
            program: The program.
            progress: Called after every iteration, or after every contour if they are many.
            named: Whether error messages start with the name of the contour.

        Raises:
            ArmContourError: As `shape`.
        """
        seed = self.options.seed
        moves = list(program.moves)
        for i, x in enumerate(moves):
            if isinstance(x, Contour):
                contour = draw_with_arcs(x)
                moves[i] = replace(
                    contour, path=_cap_tolerances(contour.path, self.options.tolerance)
                )
        program = replace(program, moves=tuple(moves))
        arcs, traced = self._trace_with_arcs(program)
        tasks: list[tuple[int, Contour, _Task]] = []
        for step in traced.steps:
            move = None if step.move is None else moves[step.move]
            if isinstance(move, Contour) and step.move is not None and step.joint_path is not None:
                task = _Task(move.path, self._timer(step.joint_path, seed), self.options)
                tasks.append((step.move, move, task))
        shaped_path = _shape_all([x[2] for x in tasks], progress)
        for done, (i, move, _) in enumerate(tasks):
            called = contour_called(move, done) if named else ""
            with move_context(called, move.path, move.entities):
                path = shaped_path(done)
                moves[i] = put_on_path(move, path, path.place)
        shaped = replace(program, moves=tuple(moves))
        if arcs is None or seed is not None or self.arm.dimension == 2:
            return shaped
        return self._choose_faster(program, arcs, shaped, ends_of(traced.joint_paths[0])[0])

    def _choose_faster(
        self, program: Program, arcs: Tracing, shaped: Program, first: FloatArray
    ) -> Program:
        """Return the shaped program with its faster start, or that with arcs if it is faster.

        Shapes were compared from the start `first` [rad], (dof,). A redundant arm can be slightly
        slower from this start than from a free start, and the plan along arcs has a free start.
        """
        seed = tuple(first.tolist())
        plans: list[tuple[Program, tuple[float, ...] | None, Trajectory]] = []
        with suppress(ArmContourError):
            plans.append((arcs.program, None, self._time(arcs)))
        along_arcs = plans[0][2].contour_spans if plans else None
        for start in (None, seed):
            with suppress(ArmContourError):
                plans.append((shaped, start, self._time(self._trace_from(shaped, start))))
        if not plans:
            # `plan` raises the error.
            return shaped
        fastest, joints, planned = min(plans, key=lambda x: x[2].duration)
        moves = list(fastest.moves)
        for i, span in enumerate(planned.contour_spans):
            assert span.move is not None and span.trajectory is not None
            outcome = _path_of(shaped.moves[span.move]).outcome
            durations = dict(outcome.durations) | {SHAPED: span.trajectory.duration}
            if along_arcs is not None and ARCS in durations:
                durations[ARCS] = cast(Trajectory, along_arcs[i].trajectory).duration
            outcome = replace(
                outcome,
                start=_fastest_start(durations),
                durations=durations,
                note=outcome.note or (None if fastest is shaped else ARCS_ARE_FASTER),
                joints=joints,
            )
            move = moves[span.move]
            path = replace(_path_of(move), outcome=outcome)
            moves[span.move] = replace(cast(Contour, move), path=path)
        return replace(fastest, moves=tuple(moves))

    def _time(self, traced: Tracing) -> Trajectory:
        """Time a traced program with the reserve of the options."""
        limits = reduce_limits(self.limits, self.options.reserve)
        timing = Timing(self.arm, limits, Optimal(intervals=self.options.intervals))
        return time_program(traced, timing)

    def _trace_from(self, program: Program, seed: npt.ArrayLike | None) -> Tracing:
        """Trace a program from a start [rad], (dof,); from the fastest one if `seed` is None."""
        configuration = self.options.configuration
        return trace_program(program, self.arm, self.limits, configuration=configuration, seed=seed)

    def _trace_with_arcs(self, program: Program) -> tuple[Tracing | None, Tracing]:
        """Trace the program with arcs at its corners, and with sharp corners if that is faster.

        Returns two tracings. The first is that of the program with arcs; None if the arm cannot
        follow it. The configurations of the second are used for all starts and shapes.
        """
        seed = self.options.seed
        try:
            arcs = self._trace_from(self._with_arcs(program), seed)
        except ArmContourError:
            return None, self._trace_from(program, seed)
        if seed is not None or program.single_path is None or self.arm.dimension == 2:
            return arcs, arcs
        try:
            sharp = self._trace_from(program, None)
        except ArmContourError:
            return arcs, arcs
        first, other = (ends_of(x.joint_paths[0])[0] for x in (arcs, sharp))
        if np.abs(first - other).max() <= SAME_JOINT_POSITION:
            return arcs, arcs

        def least_duration(traced: Tracing) -> float:
            """Return the duration along the fastest initial path in a tracing's configuration."""
            tube = Tube.around(program.path, self.options.tolerance)
            timer = self._timer(traced.joint_paths[0])
            candidates = _time_starts(program.path, tube, timer, self.options)
            return min((x.duration for x in candidates), default=np.inf)

        return arcs, min(arcs, sharp, key=least_duration)

    def _with_arcs(self, program: Program) -> Program:
        """Return the program with arcs at its corners, or with stops if arcs leave the tube."""
        moves = list(program.moves)
        for i, move in enumerate(moves):
            if isinstance(move, Contour):
                tube = Tube.around(move.path, self.options.tolerance)
                starts = make_starts(move.path, tube, self.options.tolerances)
                name = ARCS if ARCS in starts else STOPS
                path, matches = starts[name]
                outcome = ShapingOutcome(start=name, durations={})
                shaped = _shaped_path(move.path, path, matches, self.options, outcome)
                moves[i] = put_on_path(move, shaped, shaped.place)
        return replace(program, moves=tuple(moves))

    def _timer(self, joint_path: JointPath, seed: FloatArray | None = None) -> Timer:
        """Make the timer for the configuration of a joint path; `seed` replaces an equal start.

        The knots of a redundant arm depend on the rounding of the start, so `seed` itself is used.
        """
        start = ends_of(joint_path)[0]
        intervals = self.options.intervals
        limits = reduce_limits(self.limits, self.options.reserve)
        if isinstance(self.arm, PlanarTwoLink):
            return Timer(self.arm, limits, self.arm.configuration_of(start), None, intervals)
        if seed is not None and np.abs(seed - start).max() <= SAME_JOINT_POSITION:
            start = seed
        return Timer(self.arm, limits, None, start, intervals)


def _cap_tolerances(path: Path, tolerance: float) -> Path:
    """Limit the tolerances of a path to half the length of each stretch between sharp corners."""
    # For example, the end of a line that is drawn twice, a micrometre apart, is such a stretch.
    sharp = np.flatnonzero(path.turns > SHARP) + 1
    ends = np.concatenate([[0], sharp, [len(path)]])
    half = np.repeat(np.diff(path.breaks[ends]) / 2, np.diff(ends))
    if (half >= tolerance).all():
        return path
    tolerances = np.where(half < tolerance, np.fmin(path.tolerances, half), path.tolerances)
    return replace(path, segments=path.segments.replace(tolerances=tolerances, checked=True))


def _fastest_start(durations: dict[str, float]) -> str:
    """Return the name of the initial path with the shortest duration [s].

    Of initial paths with equal durations, the simplest one comes first.
    """
    starts = {name: x for name, x in durations.items() if name != SHAPED}
    return min(starts, key=lambda name: round(starts[name], DURATION_DECIMALS))


def _path_of(move: Move) -> ShapedPath:
    """Return the shaped path of a contour."""
    assert isinstance(move, Contour) and isinstance(move.path, ShapedPath)
    return move.path


@dataclass(frozen=True, slots=True)
class _Task:
    """A contour to be shaped, as sent to other processes."""

    objective: Path
    timer: Timer
    options: Shaped


def _shape_all(tasks: list[_Task], progress: Progress | None) -> Callable[[int], ShapedPath]:
    """Return a function from the number of a task to its shaped path.

    Many contours are shaped in other processes.
    """
    count = len(tasks)

    def report(done: float) -> None:
        if progress is not None:
            progress(Step(("shaping",), done / count))

    if count < MANY_CONTOURS:
        return lambda i: _shape(tasks[i], lambda share: report(i + share))
    from armcontour.core.pool import map_in_processes

    shaped_paths = map_in_processes(_shape_or_error, tasks, done=report)
    report(count)

    def shaped_path(i: int) -> ShapedPath:
        """Return the shaped path of task i, or raise its error."""
        shaped = shaped_paths[i]
        if isinstance(shaped, ArmContourError):
            raise shaped
        return shaped

    return shaped_path


def _shape_or_error(task: _Task) -> ShapedPath | ArmContourError:
    """Shape one contour in another process; return the error instead of raising it."""
    try:
        return _shape(task, lambda share: None)
    except ArmContourError as error:
        return error


def _shape(task: _Task, report: Callable[[float], None]) -> ShapedPath:
    """Shape one contour; `report` is called with the fraction done."""
    objective = task.objective
    timer = task.timer
    options = task.options
    tube = Tube.around(objective, options.tolerance)
    candidates = _time_starts(objective, tube, timer, options)
    if not candidates:
        # Planning along the objective raises its error.
        timer.time(timer.trace(objective))
    durations = {x.name: x.duration for x in candidates}
    first = min(candidates, key=lambda x: x.duration)
    best = first
    history = [first.duration]
    note = explain_unshaped(objective, tube)
    searches: Iterator[ShapeSearch | None] = iter(())
    if note is None:
        searches = make_searches(objective, tube, timer, options.tolerances)
    unfinished = False
    remaining_work = float(WORK)
    for search in searches:
        if search is None:
            unfinished = True
            continue
        remaining = options.iterations - len(history) + 1
        allowed = min(remaining, int(remaining_work / search.size))
        candidate = search.run(allowed, report)
        if candidate is not None:
            best = min(best, candidate, key=lambda x: x.duration)
        for duration in search.durations:
            history.append(min(history[-1], duration))
        done = len(search.durations)
        remaining_work -= done * search.size
        unfinished |= done == allowed < remaining
        # Another start usually leads to the same shape.
        if best.duration < (1 - ENOUGH_SAVED) * first.duration:
            break
    durations[SHAPED] = best.duration
    outcome = ShapingOutcome(
        start=first.name,
        durations=durations,
        history=tuple(history),
        note=note,
        unfinished=unfinished,
    )
    report(1.0)
    return _shaped_path(objective, best.path, best.places, options, outcome)


def _time_starts(objective: Path, tube: Tube, timer: Timer, options: Shaped) -> list[Candidate]:
    """Time all initial paths of the search that the arm can follow."""
    candidates = [
        timer.candidate(name, path, places)
        for name, (path, places) in make_starts(objective, tube, options.tolerances).items()
    ]
    return [x for x in candidates if x is not None]


def _shaped_path(
    objective: Path, path: Path, matches: FloatArray, options: Shaped, outcome: ShapingOutcome
) -> ShapedPath:
    """Make the shaped path from a path and its matching arc lengths on the objective."""
    return ShapedPath(
        segments=path.segments,
        merged=path.merged,
        orientation=path.orientation,
        objective=objective,
        places=matches,
        tolerance=options.tolerance,
        outcome=outcome,
        curve=path.curve if isinstance(path, ShapedPath) else None,
    )
