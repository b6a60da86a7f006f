"""Function `place`: the best position of a part, or of the base of an arm."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import NoReturn

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, NotRealizable, Unreachable, error_context
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, subprogress
from armcontour.core.quantities import Workers
from armcontour.jobs.job import Job, Run, choose_run
from armcontour.jobs.placement_options import (
    CLEARANCE,
    DURATION,
    LENGTHS,
    MIDDLE,
    TORQUE,
    Axis,
    PlaceSearch,
    read_axes,
    read_uncertainty,
)
from armcontour.jobs.run_plan import prepare_and_round
from armcontour.planning import Optimal
from armcontour.program import Process, Program
from armcontour.robot import SerialArm
from armcontour.robot.scene import BASE
from armcontour.studies.placement.grid_search import index_of_best, refine, search_grid
from armcontour.studies.placement.place_evaluation import PlaceEvaluator, Verdict
from armcontour.studies.placement.placed_job import Moves, check_upright_base
from armcontour.studies.placement.placement import Place, Placement, all_places
from armcontour.studies.placement.screen import RANGE, REACH, SINGULAR_ARM
from armcontour.verification.clearance.distances import can_measure

# Number of points per contour from which the bounding box of a program is computed.
EXTENT_SAMPLES = 200
# Largest number of refused places that are planned to explain a failed search.
MAX_EXPLAINED = 40


@checked
def place(
    job: Job,
    search: PlaceSearch | None = None,
    *,
    run: str | None = None,
    processes: Workers | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Placement:
    """Find the best position of a job's part or base, first on a grid, then between its points.

    A candidate position (place) is feasible if the run has a plan there: within reach in one
    configuration, within all limits and, if the shapes of the arm are known, without collisions.
    Places that a lower bound of the duration excludes are not planned. The result is the same as if
    all places were planned. Corners with the shape "free" are replaced by arcs.

    >>> placement = ac.place(ac.read_job("job.yaml"), processes=1)
    >>> placement.best.values
    {'x': -0.005}

    Args:
        job: The job.
        search: Axes and objective, such as PlaceSearch(over={"x": (-0.1, 0.1, 11)}); by default
            the job's `placement`.
        run: Name of the run; by default that of the search.
        processes: Number of processes; by default one per processor for 100 places or more,
            otherwise one. The number does not change the result.
        executor: Executor for the search of the grid, such as a
            `concurrent.futures.ProcessPoolExecutor` or `Client.get_executor()` of Dask; by default
            processes of this machine are used.
        progress: Called with the completed share.

    Raises:
        InvalidInput: The run, an axis or the objective does not exist, or a range is empty.
        Unreachable: No place is within reach, or none in one configuration.
        NotRealizable: No place has a plan within limits and margins.
        ExecutionError: The executor accepts no tasks, has lost a worker, or its workers fail.
    """
    if processes is not None and executor is not None:
        raise InvalidInput(
            "processes and executor exclude each other, because an executor has its own workers. "
            "Remove processes."
        )
    options = search or job.placement or PlaceSearch()
    chosen, notes = _choose_run(job, run or options.run, options.objective)
    axes = read_axes(options.over, job.arm.dimension)
    uncertainty = read_uncertainty(options.uncertainty, job.arm.dimension)
    check_upright_base((*(x.name for x in axes), *uncertainty), options.what)
    with error_context(f"Run {chosen.name}"):
        program = prepare_and_round(job, chosen)[1]
    # The corners of the program are already rounded.
    unrounded = dataclasses.replace(chosen, rounding=None)
    evaluator = PlaceEvaluator(
        job=dataclasses.replace(job, path=program, process=Process(), runs=(unrounded,)),
        moves=_make_moves(job, program, axes, options),
        moved=options.what,
        objective=options.objective,
        uncertainty=uncertainty,
    )
    _check_objective(evaluator)
    if job.process.automatic:
        notes.append("The lengths of automatic leads are those of the job's own place.")
    report = subprogress(progress, "placing")
    places = all_places(axes)
    verdicts = search_grid(
        evaluator,
        places,
        every=options.every,
        processes=processes,
        executor=executor,
        progress=report,
    )
    k = index_of_best(verdicts, options.objective)
    if k is None:
        _refuse_all(evaluator, places, verdicts)
    best = better = Place(values=places[k], verdict=verdicts[k])
    if options.refined:
        values, verdict = refine(evaluator, axes, places[k], verdicts[k], report)
        better = Place(values=values, verdict=verdict)
    notes += _list_range_ends(axes, better)
    if better.verdict.below_base:
        notes.append(f"In the best place {better.verdict.below_base}")
    lengths = dict(zip(LENGTHS, evaluator.moves.anchor.tolist(), strict=True))
    absolute = evaluator.moves.absolute
    own_place = {x.name: lengths[x.name] if x.name in absolute else 0.0 for x in axes}
    return Placement(
        job=job,
        run=chosen,
        axes=axes,
        moves=evaluator.moves,
        moved=options.what,
        objective=options.objective,
        uncertainty=evaluator.uncertainty,
        verdicts=tuple(verdicts),
        best=best,
        refined=better,
        own=evaluator.evaluate(own_place).last,
        notes=tuple(notes),
    )


def _list_range_ends(axes: Sequence[Axis], place: Place) -> list[str]:
    """Sentence that names the axes with the place at an end of their range; no sentence if none."""
    names = [
        x.name
        for x in axes
        if len(x.values) > 1 and not x.whole_turn and place.values[x.name] in _extensible_ends(x)
    ]
    if not names:
        return []
    plural = "s" if len(names) > 1 else ""
    return [
        f"The best place is at the end of the range{plural} of {' and '.join(names)}. A wider "
        "range may contain a better place."
    ]


def _extensible_ends(axis: Axis) -> tuple[float, ...]:
    """Ends of an axis at which a wider range is possible; a tilt cannot be negative."""
    first, last = float(axis.values[0]), float(axis.values[-1])
    return (last,) if axis.name == "tilt" and first == 0 else (first, last)


def _choose_run(job: Job, name: str | None, objective: str) -> tuple[Run, list[str]]:
    """The compared run, in which arcs replace corners with the shape "free", and notes."""
    optimal = [x for x in job.runs if isinstance(x.timing, Optimal)]
    chosen = choose_run(job, name, "placed", optimal)
    if chosen.duration is not None and objective == DURATION:
        raise InvalidInput(
            f"The objective duration cannot compare places of the run {chosen.name}, because its "
            f"specified duration of {chosen.duration:g} s is the same at every place. Remove "
            "duration, or use another objective."
        )
    if chosen.rounding is None or not chosen.rounding.free:
        return chosen, []
    arcs = dataclasses.replace(chosen, rounding=chosen.rounding.with_arcs)
    return arcs, ["Places are compared with arcs instead of corners with the shape free."]


def _check_objective(evaluator: PlaceEvaluator) -> None:
    """Raise an error for an invalid scene, or for an objective without data in the job."""
    arm, scene = evaluator.job.arm, evaluator.job.scene
    measured = evaluator.objective == CLEARANCE or can_measure()
    if scene is not None or (arm.shapes is not None and measured):
        # This property raises an error for an invalid scene, or if the arm has no shapes.
        _ = evaluator.job.cell
    if evaluator.objective == CLEARANCE and arm.shapes is None:
        raise InvalidInput(
            f"The objective clearance requires the shapes of the arm, but those of {arm.name} are "
            "not known. Use a description (URDF) with collision geometry, or specify arm.shapes in "
            "the job (arm.with_shapes in Python)."
        )
    if evaluator.objective == TORQUE and (
        evaluator.run.limits.joint_torque is None or not arm.has_bodies
    ):
        raise InvalidInput(
            f"The objective torque requires masses and torque limits, but the arm {arm.name} lacks "
            "one of them. Use another objective."
        )


def _make_moves(job: Job, program: Program, axes: Sequence[Axis], search: PlaceSearch) -> Moves:
    """Displacement of part or base for values of the axes, with its anchor."""
    about = search.about
    if search.what == BASE:
        if not (isinstance(about, str) and about == MIDDLE):
            raise InvalidInput("A base can turn only about its own origin. Remove about.")
        arm = job.arm
        anchor = arm.chain.base.position if isinstance(arm, SerialArm) else np.zeros(3)
    elif isinstance(about, str):
        anchor = _program_center(program) if about == MIDDLE else np.zeros(3)
    else:
        anchor = np.array(about, dtype=np.float64)
    lengths = tuple(x.name for x in axes if x.name in LENGTHS)
    return Moves(anchor=checks.frozen_array(anchor), absolute=lengths if search.absolute else ())


def _program_center(program: Program) -> FloatArray:
    """Centre of the bounding box of all contours [m], (3,)."""
    points = np.concatenate(
        [x.path(np.linspace(0, x.path.length, EXTENT_SAMPLES)) for x in program.contours]
        + [x.path.vertices for x in program.contours]
    )
    middle = np.zeros(3)
    middle[: points.shape[1]] = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle


def _refuse_all(
    evaluator: PlaceEvaluator, places: Sequence[Mapping[str, float]], verdicts: Sequence[Verdict]
) -> NoReturn:
    """Raise the error of the place that is closest to a feasible place."""
    counts = Counter(x.refusal for x in verdicts)
    # A place out of reach is farther from a feasible place than a place that is refused for another
    # reason.
    kind = next((x for x, _ in counts.most_common() if x != REACH), REACH)
    indices = [k for k, x in enumerate(verdicts) if x.refusal == kind]
    few = np.unique(np.linspace(0, len(indices) - 1, min(len(indices), MAX_EXPLAINED)).astype(int))
    refused = [
        Place(values=places[indices[i]], verdict=evaluator.plan(places[indices[i]])) for i in few
    ]
    nearest = min(refused, key=lambda x: np.nan_to_num(x.verdict.beyond, nan=np.inf))
    reason = nearest.verdict.reason or f"a corner of its uncertainty is refused by {kind}."
    if len(places) == 1:
        text = f"The place {nearest} is not feasible"
    else:
        kinds = ", ".join(f"{n} by {name}" for name, n in counts.most_common())
        example = "The place closest to the reach is" if kind == REACH else "One of them is"
        text = f"None of {len(places)} places is feasible (refused: {kinds}). {example} {nearest}"
    error = Unreachable if kind in (REACH, RANGE, SINGULAR_ARM) else NotRealizable
    needed = None if np.isnan(nearest.verdict.beyond) else nearest.verdict.beyond
    raise error(f"{text}: {reason}", limit=kind, needed=needed)
