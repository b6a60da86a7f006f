"""Plans and executions while a person edits: those steps of `run` that are not done yet.

A preview differs from a run where waiting for it would take too long, and its notes say so:
its run is coarser (`coarser_run`), and an arm in space keeps the configuration of the last plan.
Nothing is checked for collisions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any

from armcontour._checks import FloatArray
from armcontour._progress import Progress
from armcontour.arms import Arm, SerialArm
from armcontour.errors import InvalidInput, Unreachable, locate_errors
from armcontour.evaluation import ErrorProfile
from armcontour.evaluation.pieces import Piece, pieces_of, settling_time
from armcontour.geometry import Path
from armcontour.io.job_arm import arm_of, equipped
from armcontour.io.job_file import job_on, model_of
from armcontour.io.job_model import JobModel
from armcontour.io.job_path import part_of, placed_path, unplaced_path
from armcontour.io.scene import scene_of
from armcontour.jobs import Job, Run
from armcontour.jobs.alternatives import below_base
from armcontour.jobs.planning import explain_plan, plan_one
from armcontour.jobs.results import Planned
from armcontour.jobs.reuse import LARGE_RESULTS, Reuse, comparable
from armcontour.jobs.study import teach_run
from armcontour.motion import Execution
from armcontour.program import Program
from armcontour.scene import Scene
from armcontour.studio.preview_run import (
    coarser_run,
    execute_judged,
    experiment_of,
    with_fewer_samples,
    with_one_run,
)
from armcontour.studio.previewed import Executed, Preview

# Most set-points of an exact preview.
MOST_SET_POINTS = 200_000
# Longest motion that is simulated for a preview, times the number of joints [s]; it takes seconds,
# and 150 MB.
LONGEST = 2400.0
# A program of more segments is drawn without a plan first.
LONG = 5_000
CONFIGURATION = (
    "previews keep the configuration of the arm; exact figures are of the fastest configuration."
)


class Previewer:
    """Plans and executes runs of a document that changes; one per document, used by one thread.

    The data that it gets must not be changed afterwards: it knows by them what is done already.

    Args:
        folder: Folder of relative file names.
        trust_xacro: Whether the arm may be a .xacro file.
    """

    def __init__(self, folder: FilePath | None = None, *, trust_xacro: bool = False) -> None:
        self.folder = folder or FilePath()
        self.trust_xacro = trust_xacro
        self._reuse = Reuse()
        # The configuration of the last plan, and the arm it is of.
        self._arm: Arm | None = None
        self._start: FloatArray | None = None

    def forget(self) -> None:
        """Forget all results, as files of the job may have changed."""
        self._reuse = Reuse()
        self._arm = self._start = None

    def may_be_exact(self, planned: Preview) -> bool:
        """Whether a plan differs from that of a full run, which can be had in about a second.

        An arm in space without a start searches all its configurations in a full run, and many
        set-points take long.
        """
        job = planned.job
        (own,) = job.runs
        searches = isinstance(job.arm, SerialArm) and job.start is None
        if searches or CONFIGURATION in planned.differs:
            return False
        few = planned.trajectory.duration <= MOST_SET_POINTS * own.period
        return bool(planned.differs) and few

    def keep_start(self, job: Job, start: FloatArray) -> None:
        """Stay in a configuration from now on.

        Args:
            job: A job of this document.
            start: Joint positions at the start of its motion [rad], (dof,).
        """
        self._arm, self._start = job.arm, start

    def job(self, data: Mapping[str, Any], run: str | None = None) -> Job:
        """The job with one of its runs only.

        Args:
            data: The job file as parsed.
            run: Name of the run; by default the first one.

        Raises:
            InvalidInput: Values that do not make a job.
        """
        return self._reuse.get("job", (data, run), lambda: self._make_job(data, run))

    def drawn(self, data: Mapping[str, Any]) -> Program:
        """The path of a job as a program, before it is prepared; without the other keys' values.

        Raises:
            InvalidInput: Values that do not make an arm and a path.
        """
        _, path = self._arm_and_path(self._model(data), data)
        return self._reuse.get("program", path, lambda: Program.of(path))

    def is_long(self, data: Mapping[str, Any]) -> bool:
        """Whether the program is too long to be planned at every move."""
        program = self.drawn(data)
        count = self._reuse.get(
            "segments", program, lambda: sum(len(x.path) for x in program.contours)
        )
        return count > LONG

    def plan(
        self,
        data: Mapping[str, Any],
        run: str | None = None,
        *,
        moving: bool = False,
        exact: bool = False,
        progress: Progress | None = None,
    ) -> Preview:
        """Plan a run.

        Args:
            data: The job file as parsed.
            run: Name of the run; by default the first one.
            moving: Whether the next plan is wanted soon, so that a coarser grid is enough.
            exact: Whether to plan as `run` does, in whatever time that takes.
            progress: As of `run`.

        Raises:
            ArmContourError: As `run`.
        """
        with self._reuse.timed() as seconds:
            job = self.job(data, run)
            (own,) = job.runs
            with locate_errors(f"Run {own.name}"):
                this, differs = (own, ()) if exact else coarser_run(job, own, moving)
                found, kept = self._plan(job, this, exact, moving, progress)
                explanation = explain_plan(job, found.trajectory, self._reuse)
        return Preview.of(
            found,
            job=job,
            explanation=explanation,
            below_base=below_base(job, found.trajectory),
            start=found.trajectory(0.0),
            seconds=seconds,
            differs=(*differs, *kept),
        )

    def execute(self, planned: Preview, *, moving: bool = False) -> Executed:
        """Compensate and execute a plan, and find its contour errors.

        Args:
            planned: The plan.
            moving: Whether the next one is wanted soon, so that some of the samples are enough.

        Raises:
            ArmContourError: As `run`.
        """
        job, this, get = planned.job, planned.run, self._reuse.get
        _refuse_too_long(planned)
        servos = [comparable(x) for x in (job.servo, job.plant_servo)]
        with self._reuse.timed() as seconds, locate_errors(f"Run {this.name}"):
            how = (comparable(this.compensation), this.period, servos[0])
            taught = get(
                "compensation",
                (planned.trajectory, *how),
                lambda: teach_run(job, this, planned.trajectory),
                samples=lambda x: len(x.q),
            )
            bodies = experiment_of(this, moving)
            execution = get(
                "execution",
                (taught, servos[1], comparable(this.limits), comparable(bodies)),
                lambda: execute_judged(job, this, taught, bodies),
                most=LARGE_RESULTS,
                samples=lambda x: len(x.t),
            )
            if moving and planned.path.single_path is not None:
                execution = with_fewer_samples(execution)
            pieces, errors, settled = get(
                "evaluation",
                (execution, planned.path, this.until),
                lambda: _contour_errors(execution, planned.path, this.until),
                most=LARGE_RESULTS,
                samples=lambda x: len(x[1].t),
            )
        return Executed(
            planned=planned,
            taught=taught,
            execution=execution,
            pieces=pieces,
            errors=errors,
            settled=settled,
            seconds=seconds,
        )

    def _make_job(self, data: Mapping[str, Any], run: str | None) -> Job:
        model = with_one_run(self._model(data), run)
        arm, path = self._arm_and_path(model, data)
        scene: Scene | None = None
        if model.scene is not None:
            given, part = model.scene, part_of(model.path)
            made_of = data["scene"], _part(data)
            scene = self._reuse.get("scene", made_of, lambda: scene_of(given, self.folder, part))
        return job_on(model, arm, path, scene)

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
        used = equipped(model, path)
        if used is not model.arm:
            arm = self._reuse.get(
                "equipped",
                (data["arm"], data["tools"], path),
                lambda: arm_of(used, self.folder, trust_xacro=self.trust_xacro),
            )
        return arm, path

    def _plan(
        self, job: Job, this: Run, exact: bool, moving: bool, progress: Progress | None
    ) -> tuple[Planned, tuple[str, ...]]:
        """Plan in the configuration of the last plan if there is one, else in the fastest.

        Returns:
            The plan, and a sentence if it is in the configuration of the last plan.
        """
        searches = not exact and job.start is None
        if searches and isinstance(job.arm, SerialArm) and self._arm is job.arm:
            here = dataclasses.replace(job, start=self._start)
            try:
                found = plan_one(here, this, self._reuse, progress, clear=False, brief=True)
                return found, (CONFIGURATION,)
            except Unreachable:
                # Another configuration may reach it; else its error is the one to tell.
                pass
        # While a handle moves, the first place that is out of reach is enough.
        found = plan_one(job, this, self._reuse, progress, clear=False, brief=moving)
        if searches:
            self.keep_start(job, found.trajectory(0.0))
        return found, ()


def _model_of(data: Mapping[str, Any]) -> JobModel:
    """The keys of a job."""
    if not isinstance(data, Mapping):
        raise InvalidInput("A job must be a mapping of keys such as name, arm, path and runs.")
    return model_of(JobModel, data, "job")


def _refuse_too_long(planned: Preview) -> None:
    """Refuse to simulate what takes minutes, in which nothing else would be shown.

    Raises:
        InvalidInput: The motion is too long.
    """
    duration, joints = planned.trajectory.duration, planned.job.arm.dof
    longest = LONGEST / joints
    if duration > longest:
        raise InvalidInput(
            f"Run {planned.run.name}: the motion of {duration:.4g} s is not simulated here, as it "
            f"is longer than {longest:.4g} s with {joints} joints: take a higher speed, or run the "
            "job on the command line.",
            limit="duration",
            needed=duration,
            allowed=longest,
        )


def _contour_errors(
    execution: Execution, path: Program, until: float | None
) -> tuple[tuple[Piece, ...], ErrorProfile, float]:
    """The execution along each contour, the contour error, and when the tool is at rest [s]."""
    settled = settling_time(execution, execution.tool_speed)
    pieces = tuple(pieces_of(execution, path, None, until))
    return pieces, ErrorProfile.join([x.contour_error for x in pieces]), settled


def _part(data: Mapping[str, Any]) -> Any:
    """Where the part is, as written; scenes may be placed with it."""
    return data["path"].get("frame")
