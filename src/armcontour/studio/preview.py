"""Previews: fast plans and executions of an edited document, without collision checks.

A preview differs from `run` where this saves much time: see `coarser_run` and `Preview.differs`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path as FilePath
from typing import Any

from armcontour.core.checks import FloatArray, comparable
from armcontour.core.errors import InvalidInput, Unreachable, error_context
from armcontour.core.progress import Progress, subprogress
from armcontour.files.job_arm import arm_of
from armcontour.files.job_file import assemble_job
from armcontour.files.job_model import JobModel
from armcontour.files.job_path import part_of, placed_path, unplaced_path
from armcontour.files.keys import read_keys
from armcontour.files.scene_file import scene_of
from armcontour.geometry import Path
from armcontour.jobs import Job, Run
from armcontour.jobs.alternatives import below_base
from armcontour.jobs.rows import EXPECTED, SERVO, Errors, judging_executions
from armcontour.jobs.run_plan import (
    explain_plan,
    explained_reach,
    prepare_program,
    round_program,
    time_run,
    trace_run,
)
from armcontour.jobs.run_result import ExpectedErrors, RunResult
from armcontour.jobs.study import compute_set_points, expect_errors, simulate_experiment
from armcontour.motion import Execution
from armcontour.planning import Optimal, intervals_of
from armcontour.program import Program
from armcontour.robot import Arm, SerialArm
from armcontour.robot.scene import Scene
from armcontour.studio.step_cache import LARGE_RESULTS, StepCache
from armcontour.verification import ErrorProfile, evaluate
from armcontour.verification.contour_errors import ContourExecution, pieces_of, settling_time

# Maximum number of set-points of an exact preview.
MAX_SET_POINTS = 200_000
# Maximum duration of a simulated motion times the number of joints [s], so that the simulation
# takes seconds and 150 MB.
MAX_SIMULATED = 2400.0
# If a program has more segments, its outline is shown before its plan.
LONG_PROGRAM = 5_000
# Minimum cycle of a preview [s].
MIN_CYCLE = 4e-3
# Number of grid intervals per contour while a handle moves (4000 or more in a full run). The
# coarser grid changes the duration by less than 0.1 %.
MOVING_INTERVALS = 600
# Minimum number of samples of an execution while a handle moves.
MOVING_SAMPLES = 1500
# Minimum drive cycle of the rigid-body simulation while a handle moves [s].
MOVING_STEP = 1e-3
ARCS_NOTE = (
    "the preview shows arcs of the same tolerance instead of corners of shape free, because their "
    "shape is computed only after the last edit."
)
CONFIGURATION_NOTE = (
    "the preview uses the arm configuration of the last plan; exact figures are for the fastest "
    "configuration."
)


class Tier(StrEnum):
    """Accuracy of a picture, from fast to exact."""

    # Path without a plan.
    OUTLINE = "outline"
    # Coarse plan while a handle moves.
    MOVING = "moving"
    PREVIEW = "preview"
    # Equal to a full run.
    EXACT = "exact"


@dataclass(frozen=True, kw_only=True, eq=False)
class Preview(RunResult):
    """Plan of one run of a document, with the accuracy `tier`."""

    job: Job
    # Joint positions at the start of the motion [rad], (dof,).
    start: FloatArray
    tier: Tier = Tier.PREVIEW
    # Differences from the plan of a full run.
    differs: tuple[str, ...] = ()
    # Warning if links move below the base; otherwise None.
    below_base: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreviewExecution:
    """Simulated execution of a plan; the worst one if several judge the run."""

    planned: Preview
    execution: Execution
    # Execution along each contour.
    pieces: tuple[ContourExecution, ...]
    # Contour error over time.
    errors: ErrorProfile
    # Time at which the tool comes to rest [s].
    settled: float
    # Largest error of each contour [m] in all executions that judge the run.
    contour_errors: Errors


class CoarsePlanner:
    """Planner with a cache for the states of a document; not thread-safe.

    The caller must not modify data after passing them.
    """

    def __init__(self, folder: FilePath | None = None) -> None:
        self.folder = folder or FilePath()
        self._cache = StepCache()
        # Arm and start configuration of the last plan.
        self._arm: Arm | None = None
        self._start: FloatArray | None = None

    def forget(self) -> None:
        """Clear the cache, because files of the job may have changed."""
        self._cache = StepCache()
        self._arm = self._start = None

    def may_be_exact(self, planned: Preview) -> bool:
        """True if the exact plan differs from a preview but takes only about a second."""
        job = planned.job
        (run,) = job.runs
        searches = isinstance(job.arm, SerialArm) and job.seed is None
        few = planned.trajectory.duration <= MAX_SET_POINTS * run.cycle
        return bool(planned.differs) and not searches and few and self.may_execute(planned)

    def may_execute(self, planned: Preview) -> bool:
        """True if the motion is short enough to be simulated within seconds."""
        return planned.trajectory.duration * planned.job.arm.dof <= MAX_SIMULATED

    def keep_start(self, job: Job, start: FloatArray) -> None:
        """Use the configuration of a start position [rad], (dof,), for the next previews."""
        self._arm, self._start = job.arm, start

    def job(self, data: Mapping[str, Any], run: str | None = None) -> Job:
        """The job with only one run, by default the first."""
        return self._cache.get("job", (data, run), lambda: self._make_job(data, run))

    def path_program(self, data: Mapping[str, Any]) -> Program:
        """The path of a job as a program; other keys than those of arm and path may be invalid."""
        try:
            model = self._model(data)
        except InvalidInput:
            data = path_only(data)
            model = self._model(data)
        _, path = self._arm_and_path(model, data)
        return self._cache.get("program", path, lambda: Program.from_path(path))

    def is_long(self, data: Mapping[str, Any]) -> bool:
        """True if the program is too long to be planned at every edit."""
        program = self.path_program(data)
        count = self._cache.get(
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
        """Plan a run, by default the first; with the tier EXACT, the plan equals that of `run`."""
        job = self.job(data, run)
        (job_run,) = job.runs
        with error_context(f"Run {job_run.name}"):
            run_of_tier, differs = coarser_run(job, job_run, tier)
            plan, notes = self._plan(job, run_of_tier, tier, progress)
            explanation = self._cache.get(
                "explanation", plan.trajectory, lambda: explain_plan(job, plan.trajectory)
            )
        return Preview.of(
            plan,
            run=run_of_tier,
            job=job,
            explanation=explanation,
            below_base=below_base(job, plan.trajectory),
            start=plan.trajectory(0.0),
            tier=tier,
            differs=(*differs, *notes),
        )

    def execute(self, planned: Preview) -> PreviewExecution:
        """Compute set-points of a plan, simulate their execution, and compute contour errors."""
        job, run, get = planned.job, planned.run, self._cache.get
        moving = planned.tier == Tier.MOVING
        servos = [comparable(x) for x in (job.servo, job.plant_servo)]
        with error_context(f"Run {run.name}"):
            inputs = (comparable(run.compensation), run.cycle, servos[0])
            set_points = get(
                "compensation",
                (planned.trajectory, *inputs),
                lambda: compute_set_points(job, run, planned.trajectory),
                samples=lambda x: len(x.q),
            )
            outcomes = {}
            for name, experiment in judging_executions(run).items():
                if moving and experiment is not None:
                    step = max(experiment.step, MOVING_STEP)
                    experiment = dataclasses.replace(experiment, step=step)
                execution = get(
                    f"execution, {name}",
                    (set_points, servos[1], comparable(run.limits), comparable(experiment)),
                    partial(simulate_experiment, job, run, set_points, experiment),
                    maximum=LARGE_RESULTS,
                    samples=lambda x: len(x.t),
                )
                if moving and planned.path.single_path is not None:
                    execution = _with_fewer_samples(execution)
                evaluated = get(
                    f"evaluation, {name}",
                    (execution, planned.path, run.end_time),
                    partial(_contour_errors, execution, planned.path, run.end_time),
                    maximum=LARGE_RESULTS,
                    samples=lambda x: len(x[1].t),
                )
                outcomes[name] = execution, *evaluated
        contour_errors: dict[str, Sequence[float]] = {
            name: [x.contour_error.max for x in each] for name, (_, each, *_) in outcomes.items()
        }
        if not moving and SERVO in outcomes and job.servo.contour_ratio is not None:
            executed = outcomes[SERVO][0]
            expected = get(
                "expected",
                (executed, planned.path, run.end_time, *inputs),
                lambda: _expect_errors(job, run, executed, planned.path),
            )
            if expected is not None:
                contour_errors[EXPECTED] = expected.contours
        execution, pieces, errors, settled = max(outcomes.values(), key=lambda x: x[2].max)
        return PreviewExecution(
            planned=planned,
            execution=execution,
            pieces=pieces,
            errors=errors,
            settled=settled,
            contour_errors=contour_errors,
        )

    def _make_job(self, data: Mapping[str, Any], run: str | None) -> Job:
        model = _with_one_run(self._model(data), run)
        arm, path = self._arm_and_path(model, data)
        scene: Scene | None = None
        if model.scene is not None:
            scene_model, part = model.scene, part_of(model.path)
            made_of = data["scene"], _part(data)
            scene = self._cache.get(
                "scene", made_of, lambda: scene_of(scene_model, self.folder, part)
            )
        return assemble_job(model, arm, path, scene)

    def _model(self, data: Mapping[str, Any]) -> JobModel:
        return self._cache.get("keys", data, lambda: _model_of(data))

    def _arm_and_path(self, model: JobModel, data: Mapping[str, Any]) -> tuple[Arm, Path | Program]:
        arm = self._cache.get(
            "arm",
            data["arm"],
            lambda: arm_of(model.arm, self.folder),
        )
        # The drawing is cached without the part frame, so that moving the part does not read the
        # drawing again.
        unplaced = {key: x for key, x in data["path"].items() if key != "frame"}
        drawn = self._cache.get(
            "drawing",
            (unplaced, arm.dimension),
            lambda: unplaced_path(model.path, self.folder, arm.dimension),
        )
        path = self._cache.get(
            "path", (drawn, _part(data)), lambda: placed_path(model.path, drawn, arm.dimension)
        )
        return arm, path

    def _plan(
        self, job: Job, run: Run, tier: Tier, progress: Progress | None
    ) -> tuple[RunResult, tuple[str, ...]]:
        """Plan and notes; uses the configuration of the last plan if possible, else the fastest."""
        searches = tier != Tier.EXACT and job.seed is None
        if searches and isinstance(job.arm, SerialArm) and self._arm is job.arm:
            seeded_job = dataclasses.replace(job, seed=self._start)
            try:
                return self._plan_steps(seeded_job, run, progress), (CONFIGURATION_NOTE,)
            except Unreachable:
                # Another configuration may reach the path. If no configuration does, the search
                # below raises the error.
                pass
        # While a handle moves, the search ends at the first unreachable point.
        with nullcontext() if tier == Tier.MOVING else explained_reach(job):
            plan = self._plan_steps(job, run, progress)
        if searches:
            self.keep_start(job, plan.trajectory(0.0))
        return plan, ()

    def _plan_steps(self, job: Job, run: Run, progress: Progress | None) -> RunResult:
        """Plan as `plan_one` does, but without a check of collisions and with cached steps."""
        get, report = self._cache.get, subprogress(progress)
        limits, arm_inputs = comparable(run.limits), _arm_inputs(job)
        program = job.program
        moves = [[getattr(x, y.name) for y in dataclasses.fields(x)] for x in program.moves]
        drawn = moves, program.source, program.notes, program.remarks, program.rapid_speed
        corners = (
            *(run.rounding, run.continuity, run.transition_tolerance),
            run.limits.centripetal_acceleration,
        )
        by_limits: Any = None
        if job.process.automatic or run.is_shaped:
            timing = run.timing
            if isinstance(timing, Optimal):
                timing = dataclasses.replace(timing, duration=None)
            by_limits = arm_inputs, limits, timing
        leads = (corners, by_limits) if job.process.automatic else ()
        made_of = drawn, comparable(job.process), run.end_time, leads
        objective = get("preparing", made_of, lambda: prepare_program(job, run, report))
        path = get(
            "rounding",
            (objective, corners, by_limits),
            lambda: round_program(job, run, objective, report),
        )
        ranges = limits if job.seed is None else comparable(run.limits.joint_range(job.arm.dof))
        traced = get(
            "tracing", (path, arm_inputs, ranges), lambda: trace_run(job, run, path, report)
        )
        return get(
            "timing",
            (traced, limits, run.timing),
            lambda: time_run(job, run, objective, traced, report),
        )


def path_only(data: Mapping[str, Any]) -> dict[str, Any]:
    """Data of a job with the arm and the path of another one, whose other keys may be invalid."""
    used = {key: data[key] for key in ("arm", "path") if key in data}
    return {"name": "path", **used, "servo": {"kp": 1.0, "kv": 1.0}, "runs": {"path": {}}}


def _arm_inputs(job: Job) -> tuple[Any, ...]:
    """Inputs of arm and cell on which joint paths depend, in a comparable form."""
    return job.arm, job.configuration, comparable(job.seed), job.scene


def _model_of(data: Mapping[str, Any]) -> JobModel:
    if not isinstance(data, Mapping):
        raise InvalidInput("A job must be a mapping of keys such as name, arm, path and runs.")
    with error_context("job"):
        model: JobModel = read_keys(JobModel, data)
    return model


def _expect_errors(job: Job, run: Run, executed: Execution, path: Program) -> ExpectedErrors | None:
    """Contour errors to expect of a robot with an identified servo."""
    evaluation = evaluate(executed, path, end_time=run.end_time)
    return expect_errors(job, run, executed, path, evaluation)


def _contour_errors(
    execution: Execution, path: Program, end_time: float | None
) -> tuple[tuple[ContourExecution, ...], ErrorProfile, float]:
    """Execution along each contour, contour errors, and time when the tool comes to rest [s]."""
    settled = settling_time(execution, execution.tool_speed)
    pieces = tuple(pieces_of(execution, path, None, end_time))
    return pieces, ErrorProfile.join([x.contour_error for x in pieces]), settled


def _part(data: Mapping[str, Any]) -> Any:
    """Part frame as written in the job; obstacles of the scene can be fixed to the part."""
    return data["path"].get("frame")


def _with_one_run(model: JobModel, run: str | None) -> JobModel:
    """Keys of a job with one run, by default the first, and without references to other runs."""
    name = next(iter(model.runs)) if run is None else run
    if name not in model.runs:
        raise InvalidInput(f"The job has no run {name}. Its runs are {', '.join(model.runs)}.")
    return dataclasses.replace(
        model,
        runs={name: model.runs[name]},
        certificate=None,
    )


def coarser_run(job: Job, job_run: Run, tier: Tier) -> tuple[Run, tuple[str, ...]]:
    """Run of a preview with lower accuracy, and sentences about its differences from `job_run`."""
    if tier == Tier.EXACT:
        return job_run, ()
    run, differs, cycle = job_run, [], max(job_run.cycle, MIN_CYCLE)
    try:
        for servo in (job.servo, job.plant_servo):
            servo.check_gains(cycle)
    except InvalidInput:
        # Because the gains are large, the servo requires the shorter cycle of the run.
        cycle = job_run.cycle
    if cycle != job_run.cycle:
        run = dataclasses.replace(run, cycle=cycle)
        differs.append(
            f"the preview has a cycle of {cycle * 1e3:g} ms; "
            f"the full run has {job_run.cycle * 1e3:g} ms."
        )
    if run.rounding is not None and run.rounding.free:
        run = dataclasses.replace(run, rounding=run.rounding.with_arcs)
        differs.append(ARCS_NOTE)
    if tier == Tier.MOVING and isinstance(run.timing, Optimal) and run.timing.intervals is None:
        few = min(MOVING_INTERVALS, intervals_of(job.program) or MOVING_INTERVALS)
        timing = dataclasses.replace(run.timing, intervals=few)
        run = dataclasses.replace(run, timing=timing)
        differs.append(f"during a drag, the timing uses a grid of {few} intervals.")
    return run, tuple(differs)


def _with_fewer_samples(execution: Execution) -> Execution:
    """Reduce an execution to every k-th sample, but at least MOVING_SAMPLES samples."""
    step = len(execution.t) // MOVING_SAMPLES
    if step < 2:
        return execution
    names = ("t", "q", "dq", "ddq", "demand", "torque", "torque_demand")
    columns = {x: getattr(execution, x) for x in names}
    fewer = {name: x[::step] for name, x in columns.items() if x is not None}
    return dataclasses.replace(execution, **fewer, plant=None)
