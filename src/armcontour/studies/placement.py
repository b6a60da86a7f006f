"""`place`: plans of a job with its part, or the base of its arm, at all places of a grid."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, InvalidInput, NotRealizable
from armcontour.core.fields import checked
from armcontour.core.frames import Frame, exp
from armcontour.core.pool import map_in_processes
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import Workers
from armcontour.core.render import Result, number
from armcontour.core.result import VERDICT, Data, Row
from armcontour.core.text import short_repr
from armcontour.jobs.job import Job, Run, choose_run
from armcontour.jobs.reuse import Reuse
from armcontour.jobs.run_plan import plan_one
from armcontour.planning import Optimal
from armcontour.program import Program
from armcontour.robot import SerialArm
from armcontour.robot.scene import BASE, PART, Obstacle
from armcontour.verification.clearance import Clearance

__all__ = ["Place", "Placement", "place"]

# Axes of a grid and their units. The last axis changes fastest. Arms in the plane have no z.
AXES = {"x": "m", "y": "m", "z": "m", "yaw": "rad"}
# Largest number of places; each is planned, which takes 0.1 s or more.
MAX_PLACES = 100_000
# Largest amount of a coordinate [m, rad]; a larger one is a mistake in a unit.
FARTHEST = 1e4
# Reasons of refused places in maps, by the limit of the error.
KINDS = {
    "reach": "reach",
    "joint_lower": "joint range",
    "joint_upper": "joint range",
    "singularity": "singularity",
    "clearance": "clearance",
}
LIMITS, OTHER = "limits", "other"
# Number of points per contour for the middle of a program.
SAMPLES = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A place of the part or the base, and the plan there.

    Args:
        values: Displacement along the axes of the grid [m, rad].
        duration: Duration of the plan [s]; None if the place is refused.
        clearance: Smallest distance of the arm from obstacles, or from itself if there are no
            obstacles [m]; None if it is not known.
        refusal: Kind of the refusal, such as "reach"; empty for a feasible place.
        why_not: Message of the refusal.
    """

    values: Mapping[str, float]
    duration: float | None = None
    clearance: float | None = None
    refusal: str = ""
    why_not: str = ""

    def __str__(self) -> str:
        """Displacement along the axes, in mm and degrees."""
        return ", ".join(f"{name} {number(x, AXES[name])}" for name, x in self.values.items())

    def to_data(self) -> Data:
        """Duration, clearance, and reason of the refusal."""
        rows = (
            Row("duration", self.duration, "s", "motion"),
            Row("clearance", self.clearance, "m", "clearance"),
            Row("why_not", self.why_not or None, "", "why not"),
        )
        return Data(str(self), rows)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement(Result):
    """Plans of a job at all places of a grid.

    Args:
        job: The job, with part and base where it defines them (its own place).
        run: The planned run.
        axes: Values of the axes of the grid [m, rad], (n,) each.
        moved: "part" or "base".
        about: Centre of yaw, in the coordinates of the path [m], (3,).
        places: All places; the last axis changes fastest.
        own: The job's own place.
    """

    job: Job
    run: Run
    axes: Mapping[str, FloatArray]
    moved: str
    about: FloatArray
    places: tuple[Place, ...] = field(repr=False)
    own: Place

    @property
    def best(self) -> Place | None:
        """The place with the shortest duration; None if no place is feasible."""
        feasible = [x for x in self.places if x.duration is not None]
        return min(feasible, key=lambda x: x.duration or 0.0, default=None)

    @property
    def refusals(self) -> dict[str, int]:
        """Number of refused places by kind of refusal, the most frequent first."""
        return dict(Counter(x.refusal for x in self.places if x.refusal).most_common())

    @property
    def durations(self) -> FloatArray:
        """Durations of all places in the shape of the grid [s]; NaN for refused places."""
        shape = [len(x) for x in self.axes.values()]
        return np.array([x.duration for x in self.places], dtype=float).reshape(shape)

    @checked
    def frame(self, place: Place | None = None) -> Frame:
        """Displacement of the part or base, in the coordinates of the path.

        Args:
            place: A place; by default the best one.

        Raises:
            NotRealizable: No place is feasible.
        """
        chosen = place or self.best
        if chosen is None:
            raise NotRealizable("No place of the grid is feasible. Use a larger grid.")
        return displacement(chosen.values, self.about)

    @checked
    def placed(self, place: Place | None = None) -> Job:
        """The job with its part or base at a place.

        Args:
            place: A place; by default the best one.

        Raises:
            NotRealizable: No place is feasible.
        """
        return place_job(self.job, self.frame(place), self.moved)

    @checked
    def to_data(self, files: Sequence[str] = ()) -> Data:
        """Data of the best place and the job's own place, and the numbers of refusals.

        Args:
            files: Files of the result, relative to its folder.
        """
        best, rows = self.best, list[Row]()
        for key, label, x in (
            ("best", "best place", best),
            ("own_place", "the job's own place", self.own),
        ):
            if x is not None:
                values = [y for y in x.to_data().rows if y.value is not None]
                note = str(x)
                rows += [
                    replace(y, name=f"{key}.{y.name}", label=f"{y.label}, {label}", note=note)
                    for y in values
                ]
                rows += [Row(f"{key}.place.{y}", z, AXES[y]) for y, z in x.values.items()]
        if best is not None and best.duration and self.own.duration:
            rows.append(Row("gain", 1 - best.duration / self.own.duration, "1", "time saved"))
        refused = ", ".join(f"{n} refused by {kind}" for kind, n in self.refusals.items())
        rows += [
            Row("places", len(self.places), "", "places", refused),
            Row("refused", self.refusals),
            Row("armcontour", __version__),
            Row("job", self.job.name),
            Row("run", self.run.name),
            Row("moved", self.moved),
            Row("about", self.about, "m"),
            *(Row(f"axes.{name}", x, AXES[name]) for name, x in self.axes.items()),
            Row("files", list(files)),
        ]
        title = f"Places of the {self.moved}: {self.job.title}, run {self.run.name}"
        return Data(title, tuple(replace(x, level=VERDICT) for x in rows), notes=self._notes)

    @property
    def _notes(self) -> tuple[str, ...]:
        """Sentence that names the axes with the best place at an end of their range."""
        if self.best is None:
            return ("No place of the grid is feasible.",)
        values = self.best.values
        # The last value of a whole turn is next to the first one.
        names = [
            k
            for k, x in self.axes.items()
            if len(x) > 1 and values[k] in (x[0], x[-1])
            if k != "yaw" or 2 * x[-1] - x[0] - x[-2] < 2 * np.pi - 1e-9
        ]
        if not names:
            return ()
        ends = " and ".join(names)
        return (
            f"The best place is at the end of the range of {ends}. A wider range may be better.",
        )

    __repr__ = short_repr


@checked
def place(
    job: Job,
    grid: Mapping[str, Any],
    *,
    move: str = PART,
    run: str | None = None,
    processes: Workers | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Placement:
    """Plan a job at every place of a grid of its part, or of the base of its arm.

    A place is feasible if the run has a plan there, as `run` makes it. The best place has the
    shortest duration.

    >>> placement = ac.place(ac.read_job("job.yaml"), {"x": [-0.005, 0.0, 0.005]}, processes=1)
    >>> placement.best.values
    {'x': -0.005}

    Args:
        job: The job.
        grid: Displacements of the part or base along "x", "y" and "z" [m] and "yaw" about z [rad],
            in the coordinates of the path, (n,) each.
        move: Moved object: the "part", with the obstacles that are fixed to it, about the middle of
            its path; or the "base" of the arm, about its origin.
        run: Name of the run; by default the only one, or the only one with the timing optimal.
        processes: Number of processes; by default one per processor if there are many places.
        executor: Your own executor instead of processes.
        progress: Called with the completed share.

    Raises:
        InvalidInput: The run or an axis does not exist, or the grid is empty.
        ExecutionError: The executor accepts no work, or has lost a worker.
    """
    if processes is not None and executor is not None:
        raise InvalidInput("An executor has its own workers. Remove processes.")
    checks.check_choice("move", move, (PART, BASE))
    axes = _read_grid(grid, job.arm.dimension)
    optimal = [x for x in job.runs if isinstance(x.timing, Optimal)]
    chosen, report = choose_run(job, run, "placed", optimal), subprogress(progress, "placing")
    planner = _Planner(replace(job, runs=(chosen,)), move, _center(job, move))
    # The first plan, at the job's own place, compiles functions for all processes.
    own = planner({})
    names, values = list(axes), product(*(x.tolist() for x in axes.values()))
    grid_values = [dict(zip(names, x, strict=True)) for x in values]

    def done(count: int) -> None:
        report(Step((f"{count} of {len(grid_values)}",), count / len(grid_values)))

    places = map_in_processes(
        planner, grid_values, processes=processes, executor=executor, done=done
    )
    report(Step((f"{len(places)} of {len(places)}",), 1.0))
    return Placement(
        job=job,
        run=chosen,
        axes=axes,
        moved=move,
        about=planner.about,
        places=tuple(places),
        own=own,
    )


@dataclass(frozen=True, slots=True)
class _Planner:
    """Function that plans a job at a place; picklable for other processes."""

    job: Job
    moved: str
    about: FloatArray
    # The rounded path of an arm in space is the same at all places.
    reuse: Reuse = field(default_factory=lambda: Reuse(1))

    def __call__(self, values: Mapping[str, float]) -> Place:
        try:
            job = place_job(self.job, displacement(values, self.about), self.moved)
            planned = plan_one(job, job.runs[0], self.reuse, first_only=True)
        except ArmContourError as error:
            kind = KINDS.get(error.limit or "")
            kind = kind or (LIMITS if isinstance(error, NotRealizable) else OTHER)
            return Place(values=values, refusal=kind, why_not=str(error))
        clearance = _least_distance(planned.clearance, job)
        return Place(
            values=values, duration=float(planned.trajectory.duration), clearance=clearance
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Without the cache, because other processes have their own."""
        return _Planner, (self.job, self.moved, self.about)


def _read_grid(grid: Mapping[str, Any], dimension: int) -> dict[str, FloatArray]:
    """Read the axes of a grid, in the order of AXES."""
    names = [x for x in AXES if x != "z" or dimension == 3]
    if unknown := [x for x in grid if x not in names]:
        raise InvalidInput(f"The grid has no axis {unknown[0]!r}. Its axes are {', '.join(names)}.")
    axes = {}
    for name in (x for x in names if x in grid):
        values = checks.check_numbers(f"axis {name} of the grid", grid[name], AXES[name])
        if values.ndim != 1 or not len(values) or np.abs(values).max() > FARTHEST:
            raise InvalidInput(
                f"The axis {name} of the grid must be a list of displacements of at most "
                f"{FARTHEST:g} {AXES[name]}, such as [-0.1, 0.0, 0.1]."
            )
        axes[name] = checks.frozen_array(values)
    count = math.prod(map(len, axes.values())) if axes else 0
    if not 0 < count <= MAX_PLACES:
        raise InvalidInput(
            f"The grid has {count} places, but must have 1 to {MAX_PLACES}. Specify at least one "
            f"axis of {', '.join(names)}, or fewer values."
        )
    return axes


def _center(job: Job, moved: str) -> FloatArray:
    """Centre of yaw [m], (3,): the origin of the base, or the middle of the part's contours."""
    middle = np.zeros(3)
    if moved == BASE:
        return job.arm.chain.base.position if isinstance(job.arm, SerialArm) else middle
    paths = [x.path for x in job.program.contours]
    # Vertices, because samples can miss them.
    sampled = [x(np.linspace(0, x.length, SAMPLES)) for x in paths]
    points = np.concatenate([*sampled, *(x.vertices for x in paths)])
    middle[: points.shape[1]] = (points.min(axis=0) + points.max(axis=0)) / 2
    return checks.frozen_array(middle)


def displacement(values: Mapping[str, float], about: FloatArray) -> Frame:
    """Displacement along axes [m, rad], with yaw about a point [m], (3,)."""
    turned = exp(np.array([0.0, 0.0, values.get("yaw", 0.0)]))
    shift = np.array([values.get(x, 0.0) for x in ("x", "y", "z")])
    return Frame(position=about + shift - turned @ about, rotation=turned)


def place_job(job: Job, frame: Frame, moved: str = PART) -> Job:
    """Copy of a job with its part, or the base of its arm, moved.

    For an arm in space, the work frame is moved; for an arm in the plane, the path is moved.

    Args:
        job: The job.
        frame: Displacement of the part or base, in the coordinates of the path.
        moved: "part" or "base". Obstacles that are fixed to the part move with the part; other
            obstacles are fixed in the cell.
    """
    arm, scene = job.arm, job.scene
    part_frame = frame if moved == PART else frame.inverse
    if scene is not None:
        obstacles = (_place_obstacle(x, job, frame, moved) for x in scene.obstacles)
        scene = replace(scene, obstacles=tuple(obstacles))
    if isinstance(arm, SerialArm):
        return replace(job, arm=arm.with_work(arm.chain.base.inverse @ part_frame), scene=scene)
    program = Program.from_path(job.path).placed(part_frame)
    path = program.single_path or program
    return replace(job, path=path, scene=scene, part=part_frame @ job.part)


def _place_obstacle(obstacle: Obstacle, job: Job, frame: Frame, moved: str) -> Obstacle:
    """The obstacle in the frame of the base, after a displacement of part or base."""
    if obstacle.fixed_to == PART:
        # The obstacle is defined in the work frame, which is moved with the part.
        if isinstance(job.arm, SerialArm):
            return obstacle
        part_frame = frame if moved == PART else frame.inverse
        return replace(obstacle, place=part_frame @ obstacle.place)
    if moved == PART:
        return obstacle
    base = Frame() if job.arm.chain is None else job.arm.chain.base
    return replace(obstacle, place=(frame @ base).inverse @ base @ obstacle.place)


def _least_distance(clearance: Clearance | None, job: Job) -> float | None:
    """Smallest distance to obstacles (to the arm itself if there are none) [m]; None if unknown."""
    if clearance is None:
        return None
    names = set() if job.scene is None else {x.name for x in job.scene.obstacles}
    pairs = [x for x in clearance.pairs if not names or {x.first, x.second} & names]
    return min((float(x.low) for x in pairs), default=None)
