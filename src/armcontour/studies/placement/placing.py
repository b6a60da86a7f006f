"""Entry point `place`: where on the table a part, or the base of an arm, lies best."""

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
from armcontour.jobs.place_search import (
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
from armcontour.studies.placement.judging import Judge, Verdict
from armcontour.studies.placement.moving import Moves, check_upright_base
from armcontour.studies.placement.placement import Place, Placement, all_places
from armcontour.studies.placement.refining import refine
from armcontour.studies.placement.screening import RANGE, REACH, SINGULAR_ARM
from armcontour.studies.placement.searching import best_of, search_grid
from armcontour.verification.clearance.distances import can_measure

# Places of each contour at which the extent of a path is looked at.
SAMPLES = 200
# So many refused places are looked at for the one that is the least out of reach.
MOST_EXPLAINED = 40


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
    """Find where a job's part lies best: the best place of a grid, and a better one beside it.

    A place is feasible if a run of the job goes there: within reach in one configuration, within
    all limits and, if the shapes of the arm are known, clear of its cell and of itself. Places that
    a lower bound on the duration rules out are not planned, so the best of the grid is that of
    planning all of it. In a job with corners of the shape free, arcs stand for them.

    >>> found = ac.place(ac.read_job("job.yaml"), processes=1)
    >>> found.best.values
    {'x': -0.005}

    Args:
        job: The job.
        search: Where to look and what is best, such as PlaceSearch(over={"x": (-0.1, 0.1, 11)}); by
            default the job's `placement`.
        run: Name of the run; by default that of the search.
        processes: Number of processes; by default that of processors for 100 places or more. The
            results are the same whoever works.
        executor: An executor that looks for the best of the grid in place of these processes, such
            as a `concurrent.futures.ProcessPoolExecutor` or `Client.get_executor()` of Dask.
        progress: Called with the share that is done.

    Raises:
        InvalidInput: No such run, axis or objective, or an empty range.
        Unreachable: No place is within reach, or none in one configuration.
        NotRealizable: No place has a plan that keeps limits and margins.
        ExecutionError: The executor takes no work, has lost a worker, or its workers cannot work.
    """
    if processes is not None and executor is not None:
        raise InvalidInput("An executor has its own workers: leave processes out.")
    asked = search or job.placement or PlaceSearch()
    this, notes = _run_of(job, run or asked.run, asked.objective)
    axes = read_axes(asked.over, job.arm.dimension)
    off = read_uncertainty(asked.uncertainty, job.arm.dimension)
    check_upright_base((*(x.name for x in axes), *off), asked.what)
    with error_context(f"Run {this.name}"):
        program = prepare_and_round(job, this)[1]
    # The corners of this program are rounded.
    plain = dataclasses.replace(this, rounding=None)
    judge = Judge(
        job=dataclasses.replace(job, path=program, process=Process(), runs=(plain,)),
        moves=_moves(job, program, axes, asked),
        what=asked.what,
        objective=asked.objective,
        uncertainty=off,
    )
    _refuse_objective(judge)
    if job.process.automatic:
        notes.append("Leads of automatic length are those of the job's own place.")
    tell = subprogress(progress, "placing")
    places = all_places(axes)
    verdicts = search_grid(
        judge,
        places,
        every=asked.every,
        processes=processes,
        executor=executor,
        progress=tell,
    )
    k = best_of(verdicts, asked.objective)
    if k is None:
        _refuse_all(judge, places, verdicts)
    best = better = Place(values=places[k], verdict=verdicts[k])
    if asked.refined:
        values, verdict = refine(judge, axes, places[k], verdicts[k], tell)
        better = Place(values=values, verdict=verdict)
    notes += _at_ends(axes, better)
    if better.verdict.below_base:
        notes.append(f"In the best place {better.verdict.below_base}")
    return Placement(
        job=job,
        run=this,
        axes=axes,
        moves=judge.moves,
        what=asked.what,
        objective=asked.objective,
        uncertainty=judge.uncertainty,
        verdicts=tuple(verdicts),
        best=best,
        refined=better,
        own=judge.judge(_own_place(judge.moves, axes)),
        notes=tuple(notes),
    )


def _at_ends(axes: Sequence[Axis], place: Place) -> list[str]:
    """A sentence on axes whose range ends at a place, beyond which there may be a better one."""
    names = [
        x.name
        for x in axes
        if len(x.values) > 1 and not x.whole_turn and place.values[x.name] in _ends_of(x)
    ]
    if not names:
        return []
    plural = "s" if len(names) > 1 else ""
    return [
        f"The best place is at the end of the range{plural} of {' and '.join(names)}: a wider "
        "range may have a better one."
    ]


def _ends_of(axis: Axis) -> tuple[float, ...]:
    """The ends of the range of an axis, beyond which it goes on: no tilt is below 0."""
    first, last = float(axis.values[0]), float(axis.values[-1])
    return (last,) if axis.name == "tilt" and first == 0 else (first, last)


def _run_of(job: Job, name: str | None, objective: str) -> tuple[Run, list[str]]:
    """The run of a name, with arcs in the place of corners of the shape free, and notes.

    Raises:
        InvalidInput: No such run, or one of a given duration.
    """
    able = [x for x in job.runs if isinstance(x.timing, Optimal)]
    this = choose_run(job, name, "placed", able)
    if this.duration is not None and objective == DURATION:
        raise InvalidInput(
            f"The run {this.name} has a given duration of {this.duration:g} s, which is the same "
            "in every place: leave duration out, or take another objective."
        )
    if this.rounding is None or not this.rounding.free:
        return this, []
    arcs = dataclasses.replace(this, rounding=this.rounding.with_arcs)
    return arcs, ["Places are compared with arcs in place of corners of the shape free."]


def _refuse_objective(judge: Judge) -> None:
    """Refuse an objective that the job has no figures for, and a scene that is not one.

    Raises:
        InvalidInput: No shapes for the clearance, or no masses or limits for torques.
    """
    arm, scene = judge.job.arm, judge.job.scene
    measured = judge.objective == CLEARANCE or can_measure()
    if scene is not None or (arm.shapes is not None and measured):
        # Refuses a scene without shapes of the arm, and what is wrong in it.
        _ = judge.job.cell
    if judge.objective == CLEARANCE and arm.shapes is None:
        raise InvalidInput(
            f"The shapes of the arm {arm.name} are not known, so no place has the largest "
            "clearance: give a description (URDF) with collision geometry, or arm.shapes of a job "
            "(arm.with_shapes in Python)."
        )
    if judge.objective == TORQUE and (judge.run.limits.joint_torque is None or not arm.has_bodies):
        raise InvalidInput(
            f"The arm {arm.name} has no masses or no limits of torque, so no place leaves the "
            "largest share of them: take another objective."
        )


def _moves(job: Job, program: Program, axes: Sequence[Axis], asked: PlaceSearch) -> Moves:
    """What coordinates of a place mean.

    Raises:
        InvalidInput: A point is given for a base.
    """
    about = asked.about
    if asked.what == BASE:
        if not (isinstance(about, str) and about == MIDDLE):
            raise InvalidInput("A base turns about its own origin: leave about out.")
        arm = job.arm
        anchor = arm.chain.base.position if isinstance(arm, SerialArm) else np.zeros(3)
    elif isinstance(about, str):
        anchor = _middle(program) if about == MIDDLE else np.zeros(3)
    else:
        anchor = np.array(about, dtype=np.float64)
    lengths = tuple(x.name for x in axes if x.name in LENGTHS)
    return Moves(anchor=checks.frozen_array(anchor), absolute=lengths if asked.absolute else ())


def _middle(program: Program) -> FloatArray:
    """The middle of the box around all contours [m], (3,)."""
    points = np.concatenate(
        [x.path(np.linspace(0, x.path.length, SAMPLES)) for x in program.contours]
        + [x.path.vertices for x in program.contours]
    )
    found = np.zeros(3)
    found[: points.shape[1]] = (points.min(axis=0) + points.max(axis=0)) / 2
    return found


def _own_place(moves: Moves, axes: Sequence[Axis]) -> dict[str, float]:
    """The values of the axes in the job's own place."""
    return {
        x.name: float(moves.anchor[LENGTHS.index(x.name)]) if x.name in moves.absolute else 0.0
        for x in axes
    }


def _refuse_all(
    judge: Judge, places: Sequence[Mapping[str, float]], verdicts: Sequence[Verdict]
) -> NoReturn:
    """Raise an error for a grid in which every place is refused, with what is nearest to one.

    Raises:
        Unreachable: Most places are out of reach, or cannot be traced in one configuration.
        NotRealizable: Most places have no plan, or none that keeps its margins.
    """
    counts = Counter(x.refusal for x in verdicts)
    # Others than those out of reach are nearer to a feasible place.
    kind = next((x for x, _ in counts.most_common() if x != REACH), REACH)
    which = [k for k, x in enumerate(verdicts) if x.refusal == kind]
    few = np.unique(np.linspace(0, len(which) - 1, min(len(which), MOST_EXPLAINED)).astype(int))
    found = [Place(values=places[which[i]], verdict=judge.plan(places[which[i]])) for i in few]
    near = min(found, key=lambda x: np.nan_to_num(x.verdict.beyond, nan=np.inf))
    reason = near.verdict.reason or f"a corner of its uncertainty is refused by {kind}."
    if len(places) == 1:
        what = f"The place {near} is refused"
    else:
        kinds = ", ".join(f"{n} by {name}" for name, n in counts.most_common())
        where = f"{near} is the least far of those looked at" if kind == REACH else f"at {near}"
        what = f"None of {len(places)} places is feasible ({kinds}); {where}"
    error = Unreachable if kind in (REACH, RANGE, SINGULAR_ARM) else NotRealizable
    needed = None if np.isnan(near.verdict.beyond) else near.verdict.beyond
    raise error(f"{what}: {reason}", limit=kind, needed=needed)
