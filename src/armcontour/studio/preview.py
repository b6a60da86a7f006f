"""Plans and executions while a person edits: those steps of `run` that are not done yet.

A preview differs from a run where waiting for it would take too long, and its notes say so:
its run is coarser (`coarser_run`), and an arm in space keeps the configuration of the last plan.
Nothing is checked for collisions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path as FilePath
from typing import Any

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, Unreachable, error_context
from armcontour.core.progress import Progress
from armcontour.files.job_arm import arm_of, arm_with_tool
from armcontour.files.job_file import assemble_job, model_of
from armcontour.files.job_model import JobModel
from armcontour.files.job_path import part_of, placed_path, unplaced_path
from armcontour.files.scene_file import scene_of
from armcontour.geometry import Path
from armcontour.jobs import Experiment, Job, Run
from armcontour.jobs.alternatives import below_base
from armcontour.jobs.experiment import build_plant
from armcontour.jobs.planned_run import Planned
from armcontour.jobs.reuse import LARGE_RESULTS, Reuse, comparable
from armcontour.jobs.run_plan import explain_plan, plan_one
from armcontour.jobs.study import compute_set_points, simulate_run
from armcontour.motion import Execution, SetPoints
from armcontour.planning import Optimal, intervals_of
from armcontour.program import Program
from armcontour.robot import Arm, SerialArm
from armcontour.robot.scene import Scene
from armcontour.verification import ErrorProfile
from armcontour.verification.contour_execution import ContourExecution, pieces_of, settling_time

# Most set-points of an exact preview.
MAX_SET_POINTS = 200_000
# Longest motion that is simulated for a preview, times the number of joints [s]; it takes seconds,
# and 150 MB.
MAX_SIMULATED = 2400.0
# A program of more segments is drawn without a plan first.
LONG_PROGRAM = 5_000
# Smallest cycle of a preview [s].
DEFAULT_CYCLE = 4e-3
# Grid intervals of each contour while a handle moves; in a run they are 4000 or more. Durations
# differ by less than a thousandth, and nothing needs half as long.
MOVING_INTERVALS = 600
# Samples of an execution while a handle moves, at least.
MOVING_SAMPLES = 1500
# Cycle of the drives of simulated bodies while a handle moves, at least [s].
MOVING_STEP = 1e-3
ARCS = (
    "corners of the shape free are drawn with arcs of the same tolerance: their shape is searched "
    "at rest."
)
CONFIGURATION = (
    "previews keep the configuration of the arm; exact figures are of the fastest configuration."
)


class Tier(StrEnum):
    """Accuracy of a picture, fastest first."""

    OUTLINE = "outline"
    # While a handle moves, the next plan is wanted soon.
    MOVING = "moving"
    PREVIEW = "preview"
    # As a full run has it.
    EXACT = "exact"


@dataclass(frozen=True, kw_only=True, eq=False)
class Preview(Planned):
    """Plan of one run of a document."""

    job: Job
    # Joint positions at the start of the motion [rad], (dof,).
    start: FloatArray
    tier: Tier = Tier.PREVIEW
    differs: tuple[str, ...] = ()
    # A sentence on links that come below the base; None if none does.
    below_base: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreviewExecution:
    """Simulated execution of a plan."""

    planned: Preview
    set_points: SetPoints
    execution: Execution
    pieces: tuple[ContourExecution, ...]
    errors: ErrorProfile
    # Time after which the tool is at rest [s].
    settled: float


class CoarsePlanner:
    """Planner of a changing document, for one thread; data that it has seen must not change."""

    def __init__(self, folder: FilePath | None = None, *, trust_xacro: bool = False) -> None:
        self.folder = folder or FilePath()
        self.trust_xacro = trust_xacro
        self._reuse = Reuse()
        # The configuration of the last plan, and the arm it is of.
        self._arm: Arm | None = None
        self._start: FloatArray | None = None

    def forget(self) -> None:
        """Clear the cache, because files of the job may have changed."""
        self._reuse = Reuse()
        self._arm = self._start = None

    def may_be_exact(self, planned: Preview) -> bool:
        """True if a full run differs and takes about a second, without a search."""
        job = planned.job
        (own,) = job.runs
        searches = isinstance(job.arm, SerialArm) and job.seed is None
        few = planned.trajectory.duration <= MAX_SET_POINTS * own.cycle
        return bool(planned.differs) and not searches and few and self.may_execute(planned)

    def may_execute(self, planned: Preview) -> bool:
        """True if the simulation of the motion takes seconds at most."""
        return planned.trajectory.duration * planned.job.arm.dof <= MAX_SIMULATED

    def keep_start(self, job: Job, start: FloatArray) -> None:
        """Keep the configuration of a start [rad], (dof,), from now on."""
        self._arm, self._start = job.arm, start

    def job(self, data: Mapping[str, Any], run: str | None = None) -> Job:
        """The job with only one of its runs, by default the first."""
        return self._reuse.get("job", (data, run), lambda: self._make_job(data, run))

    def path_program(self, data: Mapping[str, Any]) -> Program:
        """The path of a job as a program; reads only the keys of arm and path."""
        _, path = self._arm_and_path(self._model(data), data)
        return self._reuse.get("program", path, lambda: Program.from_path(path))

    def is_long(self, data: Mapping[str, Any]) -> bool:
        """True if the program is too long to be planned at every edit."""
        program = self.path_program(data)
        count = self._reuse.get(
            "segments", program, lambda: sum(len(x.path) for x in program.contours)
        )
        return count > LONG_PROGRAM

    def plan(
        self,
        data: Mapping[str, Any],
        run: str | None = None,
        *,
        tier: Tier = Tier.PREVIEW,
        progress: Progress | None = None,
    ) -> Preview:
        """Plan a run, by default the first; EXACT equals the plan of `run`."""
        job = self.job(data, run)
        (own,) = job.runs
        with error_context(f"Run {own.name}"):
            this, differs = (own, ()) if tier == Tier.EXACT else coarser_run(job, own, tier)
            found, kept = self._plan(job, this, tier, progress)
            explanation = explain_plan(job, found.trajectory, self._reuse)
        return Preview.of(
            found,
            job=job,
            explanation=explanation,
            below_base=below_base(job, found.trajectory),
            start=found.trajectory(0.0),
            tier=tier,
            differs=(*differs, *kept),
        )

    def execute(self, planned: Preview) -> PreviewExecution:
        """Compensate and simulate a plan, and compute its contour errors."""
        job, this, get = planned.job, planned.run, self._reuse.get
        moving = planned.tier == Tier.MOVING
        servos = [comparable(x) for x in (job.servo, job.plant_servo)]
        with error_context(f"Run {this.name}"):
            how = (comparable(this.compensation), this.cycle, servos[0])
            set_points = get(
                "compensation",
                (planned.trajectory, *how),
                lambda: compute_set_points(job, this, planned.trajectory),
                samples=lambda x: len(x.q),
            )
            bodies = _experiment_of(this, moving)
            execution = get(
                "execution",
                (set_points, servos[1], comparable(this.limits), comparable(bodies)),
                lambda: _execute_judged(job, this, set_points, bodies),
                maximum=LARGE_RESULTS,
                samples=lambda x: len(x.t),
            )
            if moving and planned.path.single_path is not None:
                execution = _with_fewer_samples(execution)
            pieces, errors, settled = get(
                "evaluation",
                (execution, planned.path, this.end_time),
                lambda: _contour_errors(execution, planned.path, this.end_time),
                maximum=LARGE_RESULTS,
                samples=lambda x: len(x[1].t),
            )
        return PreviewExecution(
            planned=planned,
            set_points=set_points,
            execution=execution,
            pieces=pieces,
            errors=errors,
            settled=settled,
        )

    def _make_job(self, data: Mapping[str, Any], run: str | None) -> Job:
        model = _with_one_run(self._model(data), run)
        arm, path = self._arm_and_path(model, data)
        scene: Scene | None = None
        if model.scene is not None:
            given, part = model.scene, part_of(model.path)
            made_of = data["scene"], _part(data)
            scene = self._reuse.get("scene", made_of, lambda: scene_of(given, self.folder, part))
        return assemble_job(model, arm, path, scene)

    def _model(self, data: Mapping[str, Any]) -> JobModel:
        return self._reuse.get("keys", data, lambda: _model_of(data))

    def _arm_and_path(self, model: JobModel, data: Mapping[str, Any]) -> tuple[Arm, Path | Program]:
        arm = self._reuse.get(
            "arm",
            data["arm"],
            lambda: arm_of(model.arm, self.folder, trust_xacro=self.trust_xacro),
        )
        # A drawing is not read again where its frame moves.
        here = {key: x for key, x in data["path"].items() if key != "frame"}
        drawn = self._reuse.get(
            "drawing",
            (here, arm.dimension),
            lambda: unplaced_path(model.path, self.folder, arm.dimension),
        )
        path = self._reuse.get(
            "path", (drawn, _part(data)), lambda: placed_path(model.path, drawn, arm.dimension)
        )
        used = arm_with_tool(model, path)
        if used is not model.arm:
            arm = self._reuse.get(
                "equipped",
                (data["arm"], data["tools"], path),
                lambda: arm_of(used, self.folder, trust_xacro=self.trust_xacro),
            )
        return arm, path

    def _plan(
        self, job: Job, this: Run, tier: Tier, progress: Progress | None
    ) -> tuple[Planned, tuple[str, ...]]:
        """Plan in the configuration of the last plan (then with a note), else in the fastest."""
        searches = tier != Tier.EXACT and job.seed is None
        if searches and isinstance(job.arm, SerialArm) and self._arm is job.arm:
            here = dataclasses.replace(job, seed=self._start)
            try:
                found = plan_one(here, this, self._reuse, progress, clear=False, first_only=True)
                return found, (CONFIGURATION,)
            except Unreachable:
                # Another configuration may reach it; else its error is the one to tell.
                pass
        # While a handle moves, the first place that is out of reach is enough.
        found = plan_one(
            job, this, self._reuse, progress, clear=False, first_only=tier == Tier.MOVING
        )
        if searches:
            self.keep_start(job, found.trajectory(0.0))
        return found, ()


def _model_of(data: Mapping[str, Any]) -> JobModel:
    if not isinstance(data, Mapping):
        raise InvalidInput("A job must be a mapping of keys such as name, arm, path and runs.")
    return model_of(JobModel, data, "job")


def _contour_errors(
    execution: Execution, path: Program, end_time: float | None
) -> tuple[tuple[ContourExecution, ...], ErrorProfile, float]:
    """Execution along each contour, contour error, and time at which the tool is at rest [s]."""
    settled = settling_time(execution, execution.tool_speed)
    pieces = tuple(pieces_of(execution, path, None, end_time))
    return pieces, ErrorProfile.join([x.contour_error for x in pieces]), settled


def _part(data: Mapping[str, Any]) -> Any:
    """Frame of the part as written; scenes may be placed with it."""
    return data["path"].get("frame")


def _with_one_run(model: JobModel, run: str | None) -> JobModel:
    """Keys with one run, by default the first, and without keys that may name others."""
    name = next(iter(model.runs)) if run is None else run
    if name not in model.runs:
        raise InvalidInput(f"The job has no run {name}: it has {', '.join(model.runs)}.")
    asked, experiment = model.placement, model.experiment
    # The set-points depend on the experiment of the run.
    if experiment is not None:
        judged = name in (experiment.runs or [name])
        experiment = dataclasses.replace(experiment, runs=None) if judged else None
    return dataclasses.replace(
        model,
        runs={name: model.runs[name]},
        certificate=None,
        placement=None if asked is None else dataclasses.replace(asked, run=None),
        experiment=experiment,
    )


def coarser_run(job: Job, own: Run, tier: Tier) -> tuple[Run, tuple[str, ...]]:
    """Run of a preview, and sentences on its differences from the run of the job."""
    this, differs, cycle = own, [], max(own.cycle, DEFAULT_CYCLE)
    try:
        for x in (job.servo, job.plant_servo):
            x.check_gains(cycle)
    except InvalidInput:
        # Gains as large as these need short intervals.
        cycle = own.cycle
    if cycle != own.cycle:
        this = dataclasses.replace(this, cycle=cycle)
        differs.append(
            f"set-points come every {cycle * 1e3:g} ms, and in a run every {own.cycle * 1e3:g} ms."
        )
    if this.rounding is not None and this.rounding.free:
        this = dataclasses.replace(this, rounding=this.rounding.with_arcs)
        differs.append(ARCS)
    if tier == Tier.MOVING and isinstance(this.timing, Optimal) and this.timing.intervals is None:
        few = min(MOVING_INTERVALS, intervals_of(job.program) or MOVING_INTERVALS)
        timing = dataclasses.replace(this.timing, intervals=few)
        this = dataclasses.replace(this, timing=timing)
        differs.append(f"while it moves, the timing is found on a grid of {few} intervals.")
    return this, tuple(differs)


def _experiment_of(this: Run, moving: bool) -> Experiment | None:
    """Experiment that judges a run, if any; with a longer drive cycle while a handle moves."""
    found = this.judge
    if found is None or not moving:
        return found
    return dataclasses.replace(found, step=max(found.step, MOVING_STEP))


def _execute_judged(
    job: Job, this: Run, set_points: SetPoints, bodies: Experiment | None
) -> Execution:
    """Execution on the rigid bodies of the experiment, or on the servo model."""
    plant = None if bodies is None else build_plant(bodies, job.arm, job.plant_servo, this.limits)
    return simulate_run(job, set_points, plant)


def _with_fewer_samples(execution: Execution) -> Execution:
    """Every k-th sample of an execution, at least MOVING_SAMPLES; maxima stay."""
    step = len(execution.t) // MOVING_SAMPLES
    if step < 2:
        return execution
    names = ("t", "q", "dq", "ddq", "demand", "torque", "torque_demand", "motor_q")
    known = {x: getattr(execution, x) for x in names}
    fewer = {name: x[::step] for name, x in known.items() if x is not None}
    return dataclasses.replace(execution, **fewer, plant=None)
