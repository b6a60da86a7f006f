"""Previews: fast plans and executions of an edited document, without collision checks.

A preview differs from `run` where this saves much time, see `coarser_run`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import Any

from armcontour.core.checks import FloatArray, comparable
from armcontour.core.errors import InvalidInput, Unreachable, error_context
from armcontour.core.frames import Frame
from armcontour.core.memory import Memory, remembering
from armcontour.core.progress import Progress, subprogress
from armcontour.files.file_keys import read_keys
from armcontour.files.job_arm import arm_of
from armcontour.files.job_file import assemble_job, job_scene
from armcontour.files.job_model import ArmModel, JobModel, PathModel
from armcontour.files.job_path import (
    is_model,
    limited_path,
    part_of,
    placed_path,
    read_drawing,
    tool_axis_of,
    unplaced_path,
)
from armcontour.files.model.edge_rules import EdgeRule
from armcontour.files.model.tool_axis import Bisector
from armcontour.geometry import Path
from armcontour.jobs import Job, Run
from armcontour.jobs.alternatives import below_base
from armcontour.jobs.command_velocity import exceeded_command_velocity
from armcontour.jobs.run_job import compute_set_points, simulate_experiment
from armcontour.jobs.run_plan import (
    explain_plan,
    explained_reach,
    find_resumption,
    prepare_program,
    round_program,
    time_freely,
    time_within,
    trace_run,
)
from armcontour.jobs.run_result import RunResult
from armcontour.jobs.verdict import BODIES, SERVO, Errors, judging, judging_executions
from armcontour.motion import Execution
from armcontour.planning import Optimal, intervals_of
from armcontour.program import Program
from armcontour.robot import Arm, SerialArm
from armcontour.studio.handles import has_no_edges
from armcontour.studio.plan_frames import Preview, Tier
from armcontour.studio.step_cache import LARGE_RESULTS, StepCache
from armcontour.verification import ErrorProfile
from armcontour.verification.contour_errors import ContourExecution, settling_time, split_by_contour

# Maximum duration of a simulated motion times the number of joints [s], so that the simulation
# takes seconds and 150 MB.
MAX_SIMULATED = 2400.0
# If a program has more segments than this, its outline is shown before its plan.
LONG_PROGRAM = 5_000
# A contour counts as at least so many segments, because each contour is planned separately.
CONTOUR_SEGMENTS = 50
# Minimum cycle of a preview [s].
MIN_CYCLE = 4e-3
# Number of grid intervals per contour in a preview (4000 or more in a full run). The coarser grid
# changes the duration by less than 0.1 %.
INTERVALS = 600
# Minimum number of samples in a preview's execution.
MIN_SAMPLES = 1500
# Minimum drive cycle in a preview's rigid-body simulation [s].
MIN_STEP = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreviewExecution:
    """Simulated execution of a plan; the worst one if several judge the run.

    Args:
        planned: The simulated plan.
        execution: The execution.
        pieces: Execution along each contour.
        errors: Contour error over time.
        settled: Time at which the tool comes to rest [s].
        judged_errors: Largest errors in all executions that judge the run, by name of the
            execution.
    """

    planned: Preview
    execution: Execution
    pieces: tuple[ContourExecution, ...]
    errors: ErrorProfile
    settled: float
    judged_errors: Mapping[str, Errors]

    @classmethod
    def from_execution(
        cls, planned: Preview, execution: Execution, judged_errors: Mapping[str, Errors]
    ) -> PreviewExecution:
        """Compute the contour errors of an execution over time."""
        pieces = tuple(
            split_by_contour(execution, planned.path, planned.objective, planned.run.end_time)
        )
        return cls(
            planned=planned,
            execution=execution,
            pieces=pieces,
            errors=ErrorProfile.join([x.contour_error for x in pieces]),
            settled=settling_time(execution, execution.tool_speed),
            judged_errors=judged_errors,
        )


class CoarsePlanner:
    """Planner with a cache for the states of a document; not thread-safe.

    The caller must not modify data after passing them.

    Args:
        folder: Folder to which file names in the job are relative; None for the current folder.
    """

    def __init__(self, folder: FilePath | None = None) -> None:
        self.folder = folder or FilePath()
        self.forget()

    def forget(self) -> None:
        """Clear the cache, because files of the job may have changed."""
        self._cache = StepCache()
        # Results for each contour, which the next plan uses for unchanged contours.
        self._memory = Memory()
        # Arm of the last plan, as written in the job.
        self._arm: Any = None
        # Start configuration of the last plan.
        self._start: FloatArray | None = None

    def remembering(self) -> AbstractContextManager[None]:
        """Let a plan in this context use the results for contours that have not changed."""
        return remembering(self._memory)

    def may_execute(self, planned: Preview) -> bool:
        """Return whether a servo executes the motion, and it is simulated within seconds."""
        if planned.job.only_programs:
            return False
        return planned.trajectory.duration * planned.job.arm.dof <= MAX_SIMULATED

    def job(self, data: Mapping[str, Any], run: str | None = None) -> Job:
        """Make the job with only one run, by default the first."""
        return self._cache.get("job", (data, run), lambda: self._make_job(data, run))

    def path_program(self, data: Mapping[str, Any]) -> Program:
        """Read the path as a program; keys other than those of arm and path may be invalid."""
        try:
            model = self._model(data)
        except InvalidInput:
            data = path_only(data)
            model = self._model(data)
        _, path = self._read_arm_and_path(model, data)
        return self._cache.get("program", path, lambda: Program.from_path(path))

    def edge_rules(self, data: Mapping[str, Any]) -> tuple[EdgeRule, ...] | None:
        """Return the rules that select edges of a CAD model; None if the job selects none."""
        if has_no_edges(data["path"]):
            return None
        return self._model(data).path.rules

    def tool_axis(self, data: Mapping[str, Any]) -> Bisector | None:
        """Return the tool axis along the edges of a CAD model; None if it has another form."""
        path = {key: x for key, x in data["path"].items() if key != "edges"}
        return tool_axis_of(self._model({**data, "path": path}).path)

    def is_long(self, data: Mapping[str, Any]) -> bool:
        """Return whether the program is too long to be planned at every edit."""
        program = self.path_program(data)
        return self._cache.get("length", program, lambda: is_long_program(program))

    def long_drawing(self, data: Mapping[str, Any]) -> tuple[Program, Frame, int] | None:
        """Read a long drawing in its own coordinates, its part frame and the arm's dimension.

        The tool orientations of many contours take longer than reading them.
        """
        model = self._model(data)
        arm = self._read_arm(model, data)
        drawing = self._read_drawing(model.path, _unplaced(data))
        if drawing is None or not is_long_program(drawing):
            return None
        flat = dataclasses.replace(model.path, orientation=None)
        program = unplaced_path(flat, self.folder, drawing.dimension, drawing=drawing)
        return Program.from_path(program), part_of(flat), arm.dimension

    def plan(
        self,
        data: Mapping[str, Any],
        run: str | None = None,
        progress: Progress | None = None,
        *,
        explain: bool = False,
    ) -> Preview:
        """Plan a run, by default the first, on a coarse grid and without a check of collisions.

        The plan has the configuration of the last plan if possible, else the fastest. With
        `explain`, an error of reach names the farthest point, which takes up to seconds.
        """
        job = self.job(data, run)
        (job_run,) = job.runs
        with error_context(f"Run {job_run.name}"), self.remembering():
            coarse = coarser_run(job, job_run)
            planned = None
            if not job.has_start and isinstance(job.arm, SerialArm) and self._arm == data["arm"]:
                seeded_job = dataclasses.replace(job, seed=self._start)
                try:
                    planned = self._plan_steps(seeded_job, coarse, progress)
                except Unreachable:
                    # Another configuration may reach the path. If no configuration does, the
                    # search below raises the error.
                    pass
            with explained_reach(job) if explain else nullcontext():
                planned = planned or self._plan_steps(job, coarse, progress)
            trajectory = planned.trajectory
            explanation = self._cache.get(
                "explanation", trajectory, lambda: explain_plan(job, planned)
            )
        below = below_base(job, trajectory)
        preview = Preview.from_plan(
            planned, run=coarse, job=job, explanation=explanation, below_base=below
        )
        self._arm = data["arm"]
        self._start = preview.start
        return preview

    def shown(self, job: Job, planned: RunResult, tier: Tier) -> Preview:
        """Return the plan of a full run as a preview."""
        below = None if planned.clearance else below_base(job, planned.trajectory)
        return Preview.from_plan(planned, job=job, tier=tier, below_base=below)

    def follow(self, data: Mapping[str, Any], start: FloatArray) -> None:
        """Begin the next plans at the start of a full run, in its configuration.

        `start`: joint positions [rad], (dof,).
        """
        self._arm = data["arm"]
        self._start = start

    def is_full(self, data: Mapping[str, Any], run: str | None = None) -> bool:
        """Return whether a preview takes as long as the plan of the full run.

        With many contours, the full run has no finer grid.
        """
        job = self.job(data, run)
        (job_run,) = job.runs
        if job.process.is_partial or job_run.is_shaped:
            return False
        few = intervals_of(job.program)
        return isinstance(job_run.timing, Optimal) and (
            job_run.timing.intervals is not None or (few is not None and few <= INTERVALS)
        )

    def execute(self, planned: Preview) -> PreviewExecution:
        """Simulate a plan, and compute its contour errors; full runs are already simulated."""
        if planned.execution is not None:
            executions = {SERVO: planned.execution}
            errors = planned.errors
            if planned.experiment is not None:
                executions[BODIES] = planned.experiment.execution
            judges = judging(planned.run, planned.evaluations)
            worst_name = max(judges, key=lambda x: judges[x].contour_error.max)
            assert errors is not None
            return PreviewExecution.from_execution(planned, executions[worst_name], errors)
        executed = [
            PreviewExecution.from_execution(planned, x, {})
            for x in self._simulate(planned).values()
        ]
        errors = {
            name: Errors.of_pieces(each.pieces)
            for name, each in zip(judging_executions(planned.run), executed, strict=True)
        }
        worst = max(executed, key=lambda x: x.errors.max)
        return dataclasses.replace(worst, judged_errors=errors)

    def _simulate(self, planned: Preview) -> dict[str, Execution]:
        """Simulate the set-points of a plan in each way that judges the run."""
        job = planned.job
        run = planned.run
        get = self._cache.get
        # Where a servo comes from changes no result.
        servos = [comparable(x.replace(source="")) for x in (job.servo, job.plant_servo)]
        with error_context(f"Run {run.name}"):
            set_points = get(
                "compensation",
                (planned.trajectory, comparable(run.compensation), run.cycle, servos[0]),
                lambda: compute_set_points(job, run, planned.trajectory),
                samples=lambda x: len(x.q),
            )
            executions = {}
            for name, experiment in judging_executions(run).items():
                if experiment is not None:
                    step = max(experiment.step, MIN_STEP)
                    experiment = dataclasses.replace(experiment, step=step)
                execution = get(
                    f"execution, {name}",
                    (set_points, servos[1], comparable(run.limits), comparable(experiment)),
                    partial(simulate_experiment, job, run, set_points, experiment),
                    maximum=LARGE_RESULTS,
                    samples=lambda x: len(x.t),
                )
                if planned.path.single_path is not None:
                    execution = _with_fewer_samples(execution)
                executions[name] = execution
        return executions

    def _make_job(self, data: Mapping[str, Any], run: str | None) -> Job:
        """Make the job with one run from job data; unchanged parts come from the cache."""
        model = _with_one_run(self._model(data), run)
        arm, objective = self._read_arm_and_path(model, data)
        # Rules that select edges do not change the parts.
        path = model.path
        parts = (path.file, path.units, path.scale) if is_model(path) else None
        made_of = data.get("scene"), _part(data), parts, arm.knows_shapes
        scene = self._cache.get("scene", made_of, lambda: job_scene(model, self.folder, arm))
        return assemble_job(model, arm, objective, scene)

    def _model(self, data: Mapping[str, Any]) -> JobModel:
        """Return the checked keys of job data, from the cache if the data are unchanged."""
        return self._cache.get("keys", data, lambda: _model_of(data))

    def _read_arm_and_path(
        self, model: JobModel, data: Mapping[str, Any]
    ) -> tuple[Arm, Path | Program]:
        """Return the arm and the placed path of a job; unchanged parts come from the cache."""
        arm = self._read_arm(model, data)
        unplaced = _unplaced(data)
        drawn = self._cache.get(
            "drawing",
            (unplaced, arm.dimension),
            lambda: unplaced_path(
                model.path,
                self.folder,
                arm.dimension,
                drawing=self._read_drawing(model.path, unplaced),
            ),
        )
        placed = self._cache.get(
            "placing",
            (drawn, _part(data)),
            lambda: placed_path(model.path, drawn, arm.dimension),
        )
        path = self._cache.get(
            "path",
            (placed, data["path"].get("contours")),
            lambda: limited_path(model.path, placed),
        )
        return arm, path

    def _read_arm(self, model: JobModel, data: Mapping[str, Any]) -> Arm:
        """Return the arm of a job, from the cache if its keys are unchanged."""
        # The load of a positioner is fixed to the part.
        has_positioner = isinstance(model.arm, ArmModel) and model.arm.positioner is not None
        made_of = data["arm"], _part(data) if has_positioner else None
        part = part_of(model.path)
        return self._cache.get("arm", made_of, lambda: arm_of(model.arm, self.folder, part))

    def _read_drawing(self, model: PathModel, unplaced: Mapping[str, Any]) -> Program | None:
        """Return the program of a drawing, from the cache if its keys are unchanged.

        None for a path without a drawing. `unplaced`: keys of the path without frame and contours.
        """
        if model.file is None:
            return None
        read = partial(read_drawing, model, model.file, self.folder)
        return self._cache.get("reading", unplaced, read, maximum=1)

    def _plan_steps(self, job: Job, run: Run, progress: Progress | None) -> RunResult:
        """Plan as `plan_one` does, but without a check of collisions and with cached steps."""
        get = self._cache.get
        report = subprogress(progress)
        limits = comparable(run.limits)
        arm_inputs = _arm_inputs(job)
        program = job.program
        moves = [[getattr(x, y.name) for y in dataclasses.fields(x)] for x in program.moves]
        drawn = moves, program.source, program.notes, program.remarks, program.rapid_speed
        corners = (
            *(run.rounding, run.continuity, run.transition_tolerance),
            run.limits.centripetal_acceleration,
        )
        leads = (corners, arm_inputs, limits, run.timing) if job.process.automatic else ()
        made_of = drawn, comparable(job.process), run.end_time, leads
        resumption = None
        if job.process.is_partial:
            # The configuration of a part of the job depends on the whole plan.
            resumption = get(
                "resuming",
                (made_of, corners, arm_inputs, limits, run.timing),
                lambda: find_resumption(job, run, report, clear=False),
            )
        objective = get(
            "preparing",
            (made_of, resumption, job.start_from is not None),
            lambda: prepare_program(job, run, report, resumption),
        )
        path = get(
            "rounding",
            (objective, corners, resumption),
            lambda: round_program(job, run, objective, report, resumption),
        )
        ranges = limits if not job.has_start else comparable(run.limits.joint_range(job.arm.dof))
        traced = get(
            "tracing",
            (path, arm_inputs, ranges, resumption),
            lambda: trace_run(job, run, path, report, resumption),
        )
        planned = get(
            "timing",
            (traced, limits, run.timing),
            lambda: dataclasses.replace(
                time_freely(job, run, objective, traced, report), resumption=resumption
            ),
        )
        command = exceeded_command_velocity(job, run, planned.trajectory)
        if command is None:
            return planned
        return get(
            "timing within command velocity",
            (planned, command),
            lambda: time_within(job, planned, command, report),
        )


def is_long_program(program: Program) -> bool:
    """Return whether a program is too long to be planned at every edit."""
    return sum(max(len(x.path), CONTOUR_SEGMENTS) for x in program.contours) > LONG_PROGRAM


def path_only(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return job data with only arm and path of `data`, whose other keys may be invalid."""
    used = {key: data[key] for key in ("arm", "path") if key in data}
    return {"name": "path", **used, "servo": {"kp": 1.0, "kv": 1.0}, "runs": {"path": {}}}


def _arm_inputs(job: Job) -> tuple[Any, ...]:
    """Return the inputs on arm and cell that joint paths depend on, in a comparable form."""
    start = comparable(job.start_from)
    return job.arm, job.configuration, comparable(job.seed), start, job.scene


def _model_of(data: Mapping[str, Any]) -> JobModel:
    """Check the keys of job data, and return them as a model."""
    if not isinstance(data, Mapping):
        raise InvalidInput("A job must be a mapping of keys such as name, arm, path and runs.")
    with error_context("job"):
        model: JobModel = read_keys(JobModel, data)
    return model


def _unplaced(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the path's keys without part frame and contours, which need no new reading."""
    return {x: y for x, y in data["path"].items() if x not in ("frame", "contours")}


def _part(data: Mapping[str, Any]) -> Any:
    """Return the part frame as written; obstacles of the scene can be fixed to the part."""
    return data["path"].get("frame")


def _with_one_run(model: JobModel, run: str | None) -> JobModel:
    """Return the job with one run (by default the first) and no references to other runs."""
    name = next(iter(model.runs)) if run is None else run
    if name not in model.runs:
        raise InvalidInput(f"The job has no run {name}. Its runs are {', '.join(model.runs)}.")
    return dataclasses.replace(model, runs={name: model.runs[name]}, certificate=None)


def coarser_run(job: Job, run: Run) -> Run:
    """Return the run of a preview: a cycle from MIN_CYCLE on, arcs at corners, a coarse grid."""
    cycle = max(run.cycle, MIN_CYCLE)
    try:
        for servo in (job.servo, job.plant_servo):
            servo.check_gains(cycle)
    except InvalidInput:
        # Because the gains are large, the servo requires the shorter cycle of the run.
        cycle = run.cycle
    rounding = run.rounding and run.rounding.with_arcs
    timing = run.timing
    if isinstance(timing, Optimal) and timing.intervals is None:
        few = min(INTERVALS, intervals_of(job.program) or INTERVALS)
        timing = dataclasses.replace(timing, intervals=few)
    return dataclasses.replace(run, cycle=cycle, rounding=rounding, timing=timing)


def _with_fewer_samples(execution: Execution) -> Execution:
    """Reduce an execution to every k-th sample, but at least MIN_SAMPLES samples."""
    step = len(execution.t) // MIN_SAMPLES
    if step < 2:
        return execution
    names = ("t", "q", "dq", "ddq", "demand", "torque", "torque_demand")
    columns = {x: getattr(execution, x) for x in names}
    fewer = {name: x[::step] for name, x in columns.items() if x is not None}
    return dataclasses.replace(execution, **fewer, plant=None)
