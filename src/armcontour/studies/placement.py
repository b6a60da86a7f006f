"""`place`: plans of a job with its part, or the base of its arm, at all places of a grid."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

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
from armcontour.jobs.run_plan import plan_one, round_anywhere
from armcontour.planning import Optimal
from armcontour.program import Program
from armcontour.robot import SerialArm
from armcontour.robot.scene import BASE, PART, Obstacle

__all__ = ["Place", "Placement", "place"]

# Axes of a grid and their units. The last axis changes fastest. Arms in the plane have no z.
AXES = {"x": "m", "y": "m", "z": "m", "yaw": "rad"}
# Number of points per contour for the middle of a program.
CONTOUR_SAMPLES = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A place of the part or the base, and the plan there.

    Args:
        values: Displacement along the axes of the grid [m, rad].
        duration: Duration of the plan [s]; None if the place is refused.
        clearance: Smallest distance of the arm from itself and from obstacles [m], as `run` reports
            it; None if it is not known.
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement(Result):
    """Plans of a job at all places of a grid.

    Args:
        job: The job, with part and base where it defines them (its own place).
        run: The planned run.
        axes: Values on the grid's axes [m, rad], (n,) each.
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
    def placed(self, place: Place | None = None) -> Job:
        """Return the job with its part or base at a place.

        Args:
            place: A place; by default the best one.

        Raises:
            NotRealizable: No place is feasible.
        """
        chosen = place or self.best
        if chosen is None:
            raise NotRealizable("No position of the grid is feasible. Use a larger grid.")
        return place_job(self.job, displacement(chosen.values, self.about), self.moved)

    @checked
    def to_data(self) -> Data:
        """Return data of the best place and the job's own place, and the numbers of refusals."""
        best = self.best
        rows = list[Row]()
        compared = {"best": ("best place", best), "own_place": ("the job's own place", self.own)}
        for key, (label, x) in compared.items():
            if x is not None:
                rows += [
                    Row(f"{key}.duration", x.duration, "s", f"motion, {label}", str(x)),
                    Row(f"{key}.clearance", x.clearance, "m", f"clearance, {label}"),
                    Row(f"{key}.why_not", x.why_not or None, "", f"why not, {label}"),
                    *(Row(f"{key}.place.{y}", z, AXES[y]) for y, z in x.values.items()),
                ]
        if best is not None and best.duration and self.own.duration:
            rows.append(Row("gain", 1 - best.duration / self.own.duration, "1", "time saved"))
        refused = ", ".join(f"{n} refused by {kind}" for kind, n in self.refusals.items())
        rows += [
            Row("places", len(self.places), "", "places", refused),
            Row("refused", self.refusals),
            Row("job", self.job.name),
            Row("run", self.run.name),
            Row("moved", self.moved),
            *(Row(f"axes.{name}", x, AXES[name]) for name, x in self.axes.items()),
        ]
        notes = ("No position of the grid is feasible.",) * (best is None)
        title = f"Places of the {self.moved}: {self.job.title}, run {self.run.name}"
        return Data(title, tuple(replace(x, level=VERDICT) for x in rows), notes=notes)

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
            its path; or the "base" of the arm, with its rail, about its origin. A positioner stays.
        run: Name of the run; by default the only one, or the only one with the timing optimal.
        processes: Number of processes; by default one per processor if there are many places.
        executor: Your own executor; then `processes` is ignored.
        progress: Called with the completed share.

    Raises:
        InvalidInput: The run or an axis does not exist, or the grid is empty.
        ExecutionError: A process ended before its work was done.
    """
    checks.check_choice("move", move, (PART, BASE))
    axes = _read_grid(grid, job.arm.dimension)
    optimal = [x for x in job.runs if isinstance(x.timing, Optimal)]
    chosen = choose_run(job, run, "placed", optimal)
    report = subprogress(progress, "placing")
    planner = _Planner(
        replace(job, runs=(chosen,)), move, _center(job, move), _programs_anywhere(job, chosen)
    )
    # Arms at other places copy the shapes that are known, so files are read once.
    _ = job.arm.knows_shapes
    # The first plan, at the job's own place, compiles functions for all processes.
    own = planner({})
    names = list(axes)
    values = product(*(x.tolist() for x in axes.values()))
    grid_values = [dict(zip(names, x, strict=True)) for x in values]

    def report_count(count: int) -> None:
        report(Step((f"{count} of {len(grid_values)}",), count / len(grid_values)))

    places = map_in_processes(
        planner, grid_values, processes=processes, executor=executor, done=report_count
    )
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
    # The prepared and the rounded program, if they are the same at all places.
    programs: tuple[Program, Program] | None

    def __call__(self, values: Mapping[str, float]) -> Place:
        """Plan the job at displacements by axis [m, rad]; return the place with the result."""
        try:
            job = place_job(self.job, displacement(values, self.about), self.moved)
            objective, path = self.programs or (None, None)
            planned = plan_one(job, job.runs[0], objective=objective, path=path)
        except ArmContourError as error:
            kind = (error.limit or "other").replace("_", " ")
            return Place(values=values, refusal=kind, why_not=str(error))
        clearance = None if planned.clearance is None else planned.clearance.low
        duration = float(planned.trajectory.duration)
        return Place(values=values, duration=duration, clearance=clearance)


def _programs_anywhere(job: Job, run: Run) -> tuple[Program, Program] | None:
    """Return the prepared and the rounded program, if they are the same at all places."""
    if not isinstance(job.arm, SerialArm):
        # The path of an arm in the plane is moved itself.
        return None
    try:
        return round_anywhere(job, run)
    except ArmContourError:
        # Every place is refused with this error.
        return None


def _read_grid(grid: Mapping[str, Any], dimension: int) -> dict[str, FloatArray]:
    """Read the axes of a grid, in the order of AXES."""
    names = [x for x in AXES if x != "z" or dimension == 3]
    axes = {}
    if unknown := [x for x in grid if x not in names]:
        raise InvalidInput(f"The grid has no axis {unknown[0]!r}. Its axes are {', '.join(names)}.")
    for name in (x for x in names if x in grid):
        values = checks.check_numbers(f"axis {name} of the grid", grid[name], AXES[name])
        if values.ndim != 1:
            raise InvalidInput(f"The axis {name} of the grid must be a list, such as [-0.1, 0.1].")
        axes[name] = checks.frozen_array(values)
    if not axes or not all(map(len, axes.values())):
        raise InvalidInput(f"The grid has no positions. Specify values of {', '.join(names)}.")
    return axes


def _center(job: Job, moved: str) -> FloatArray:
    """Return the centre of yaw [m], (3,): the base's origin, or the middle of the contours."""
    middle = np.zeros(3)
    if moved == BASE:
        return job.arm.chain.base.position if isinstance(job.arm, SerialArm) else middle
    paths = [x.path for x in job.program.contours]
    # Vertices, because samples can miss them.
    sampled = [x(np.linspace(0, x.length, CONTOUR_SAMPLES)) for x in paths]
    points = np.concatenate([*sampled, *(x.vertices for x in paths)])
    middle[: points.shape[1]] = (points.min(axis=0) + points.max(axis=0)) / 2
    return checks.frozen_array(middle)


def displacement(values: Mapping[str, float], about: FloatArray) -> Frame:
    """Return the displacement along axes [m, rad], with yaw about a point [m], (3,)."""
    rotation = exp(np.array([0.0, 0.0, values.get("yaw", 0.0)]))
    shift = np.array([values.get(x, 0.0) for x in ("x", "y", "z")])
    return Frame(position=about + shift - rotation @ about, rotation=rotation)


def place_job(job: Job, frame: Frame, moved: str = PART) -> Job:
    """Copy a job, with its part or the base of its arm moved.

    For an arm in space, the work frame is moved; for an arm in the plane, the path is moved.

    Args:
        job: The job.
        frame: Displacement of the part or base, in the coordinates of the path.
        moved: "part" or "base". Obstacles that are fixed to the part move with the part; other
            obstacles are fixed in the cell.
    """
    arm = job.arm
    scene = job.scene
    part_frame = frame if moved == PART else frame.inverse
    if scene is not None:
        obstacles = (_place_obstacle(x, job, frame, moved) for x in scene.obstacles)
        scene = replace(scene, obstacles=tuple(obstacles))
    if isinstance(arm, SerialArm):
        if moved == BASE:
            return replace(job, arm=arm.with_base_moved(frame), scene=scene)
        return replace(job, arm=arm.with_work(arm.chain.base.inverse @ part_frame), scene=scene)
    program = Program.from_path(job.path).placed(part_frame)
    path = program.single_path or program
    return replace(job, path=path, scene=scene, part=part_frame @ job.part)


def _place_obstacle(obstacle: Obstacle, job: Job, frame: Frame, moved: str) -> Obstacle:
    """Place an obstacle in the frame of the base, after a displacement of part or base.

    - `frame`, `moved`: as for `place_job`.
    """
    if obstacle.fixed_to == PART:
        # The obstacle is defined in the work frame, which is moved with the part.
        if isinstance(job.arm, SerialArm):
            return obstacle
        part_frame = frame if moved == PART else frame.inverse
        return replace(obstacle, place=part_frame @ obstacle.place)
    if moved == PART:
        return obstacle
    base = job.arm.chain.base
    return replace(obstacle, place=(frame @ base).inverse @ base @ obstacle.place)
