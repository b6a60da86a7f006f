"""`run` and `teach`: all steps of every run of a job, from rounding to evaluation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from armcontour import _checks
from armcontour._describing import brief, digits, line_up, milliseconds, mm, several
from armcontour._progress import Progress, Step, under
from armcontour._text import capitalise
from armcontour.arms import Limits
from armcontour.clearance import Clearance
from armcontour.errors import ExecutionError, locate_errors
from armcontour.evaluation import Evaluation, evaluate
from armcontour.execution import RigidBodyPlant, execute
from armcontour.execution.rigid_body_plant import refuse_without_mujoco
from armcontour.geometry import Path, count_full_stops
from armcontour.jobs.avoiding import first_contour_clear, keep_clear
from armcontour.jobs.experiment import build_plant
from armcontour.jobs.job import Job, Run
from armcontour.jobs.programs import (
    RESOLUTION,
    execute_run,
    explain_run,
    programs_of,
    teach_run,
    time_run,
    trace_and_time_run,
)
from armcontour.jobs.reach import reach_told
from armcontour.jobs.shaped import Shaped
from armcontour.jobs.slow_ends import slow_ends
from armcontour.jobs.warnings import (
    CURVATURE_JUMPS,
    INVERSE_DYNAMICS,
    NONE,
    JerkStop,
    capped,
    cut_off,
    jerk_stops,
    missed_speeds,
    not_judged,
    overloaded,
    smoothed_beyond,
    stopping,
    unsettled,
    worse_than_none,
)
from armcontour.jobs.weaving import Weaving, weavings
from armcontour.motion import Execution, JointPath, Method, TaughtData, Trajectory
from armcontour.program import Program
from armcontour.program.rounding import doubt_tolerance
from armcontour.servo import ServoModel
from armcontour.timing import Explanation, Tracing, refuse_unkept_jerk

STEPS = (
    "rounding",
    "tracing",
    "timing",
    "clearance",
    "compensation",
    "execution",
    "evaluation",
)
TEACHING = STEPS[:5]
EXPERIMENT = "experiment"
# Takes the place of rounding where corners have the shape free.
SHAPING = "shaping"
# The clearance of the arm from itself is reported where it is below this [m].
NEAR = 10e-3
# Share of the motion above which a command interval is reported as coarse.
COARSE = 0.1
# An assigned velocity above this probably lacks its unit [m/s].
FAST = 10.0
Result = TypeVar("Result", bound="RunPlan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExperimentResult:
    """Result of a run on the simulated rigid bodies of the arm.

    Args:
        plant: The bodies and drives.
        execution: The executed motion.
        evaluation: Errors of the executed motion.
        uncompensated: Errors of the same plan without compensation; None for a run that has none,
            or if its joints do not come to rest.
    """

    plant: RigidBodyPlant
    execution: Execution
    evaluation: Evaluation
    uncompensated: Evaluation | None = None

    def __str__(self) -> str:
        """The evaluation."""
        return f"Experiment on rigid bodies. {self.evaluation}"

    __repr__ = brief


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedRun:
    """Plan of one run of a job, before it is compensated.

    Args:
        run: The run.
        objective: The program with sharp corners; a path becomes a program.
        path: The program that the tool follows: with rounded or shaped corners, if the run rounds
            corners.
        trajectory: The realizable trajectory.
        traced: Joint paths of all moves, if known. Runs with the same path and limits share them.
        exceeded: Sentences on limits that the smoothed plan exceeds.
        clearance: How far the arm stays from itself and from its cell, as planned; None for an arm
            whose shapes are not known.
        avoided: Sentences on other ways that were taken to keep clear; without a clearance, on why
            there is none.
    """

    run: Run
    objective: Program
    path: Program
    trajectory: Trajectory
    traced: Tracing | None = None
    exceeded: tuple[str, ...] = ()
    clearance: Clearance | None = None
    avoided: tuple[str, ...] = ()
    # What takes long to find in programs of thousands of contours, and is asked for several times.
    _known: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    __repr__ = brief

    @property
    def joint_path(self) -> JointPath | None:
        """The joint path of a single path; None for other programs."""
        if self.traced is None or self.path.single_path is None:
            return None
        return self.traced.joint_paths[0]

    @property
    def jerk_stops(self) -> tuple[JerkStop, ...]:
        """Where limits of jerk make the tool stop inside contours, because the curvature jumps."""
        return tuple(jerk_stops(self.path, self.traced, self.trajectory, self.run))

    @property
    def full_stops(self) -> dict[str, int]:
        """How often the tool comes to a full stop inside contours, by the reasons."""
        by_jerk = len(self.jerk_stops)
        return self._stops_of_path | ({CURVATURE_JUMPS: by_jerk} if by_jerk else {})

    @property
    def _stops_of_path(self) -> dict[str, int]:
        """Full stops that the path asks for, whatever the limits, by the reasons."""
        if self.run.timing == Method.CONVENTIONAL:
            # It goes through corners at its uniform speed.
            return {}
        if "stops" not in self._known:
            found: Counter[str] = Counter()
            for x in self.path.contours:
                found.update(count_full_stops(x.path))
            self._known["stops"] = dict(sorted(found.items()))
        return dict(self._known["stops"])

    @property
    def stops_note(self) -> str | None:
        """A sentence on the full stops inside contours; None without any but those of jerk.

        Of these there is a warning.
        """
        found = self._stops_of_path
        count = sum(found.values())
        if not count:
            return None
        what = "1 full stop" if count == 1 else f"{count} full stops"
        why = ", ".join(f"{n} {reason}" for reason, n in found.items())
        return f"Run {self.run.name}: {what} inside contours ({why})."

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on what the plan is like, with the name of the run, which are no warnings."""
        own = [f"Run {self.run.name}: {x}" for x in self.path.remarks]
        clear = None if self._far_from_itself else self.clearance_note
        found = (self.shape_note, self.stops_note, clear)
        weaves = (f"Run {self.run.name}: {x.sentence}" for x in self.weaves)
        return (*own, *weaves, *(x for x in found if x is not None))

    @property
    def weaves(self) -> tuple[Weaving, ...]:
        """Width and frequency of each weave in the plan."""
        if "weaves" not in self._known:
            self._known["weaves"] = tuple(weavings(self.path, self.trajectory, self.run.limits))
        return tuple(self._known["weaves"])

    @property
    def clearance_note(self) -> str | None:
        """A sentence on the clearance of the plan; None for an arm whose shapes are not known.

        Of margins that are not kept there is a warning.
        """
        if self.clearance is None or not self.clearance.kept:
            return None
        done = "".join(f" {capitalise(x)}." for x in self.avoided)
        return f"Run {self.run.name}: {self.clearance.sentence}{done}"

    @property
    def _far_from_itself(self) -> bool:
        """Whether nothing is near the arm, and only the arm itself was to be looked at."""
        if self.clearance is None or self.avoided:
            return False
        return all(x.kind != "environment" and x.low > NEAR for x in self.clearance.nearest)

    @property
    def shaped(self) -> Shaped | None:
        """How the shape of all contours was found; None if the run shapes none."""
        return Shaped.of(self.path)

    @property
    def shape_note(self) -> str | None:
        """A sentence on what shaping gained; None if the run shapes no contour."""
        found = self.shaped
        return None if found is None else f"Run {self.run.name}: {found}."

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on weak points of the run, with its name."""
        return warnings_of([self])

    @property
    def weak_points(self) -> tuple[str, ...]:
        """Sentences on weak points of the plan, such as a coarse command interval."""
        if "weak points" not in self._known:
            self._known["weak points"] = self._find_weak_points()
        return tuple(self._known["weak points"])

    def _find_weak_points(self) -> tuple[str, ...]:
        """What `weak_points` gives."""
        found: list[str] = []
        period, duration = self.run.period, self.trajectory.duration
        if period > COARSE * duration:
            found.append(
                f"the command interval of {period:g} s is more than a tenth of the motion of "
                f"{duration:.3g} s, so the set-points hardly represent the plan (a number without "
                "a unit is in seconds: for milliseconds write command_interval: 4 ms)."
            )
        speed = self.run.limits.speed
        if speed is not None and speed > FAST:
            found.append(
                f"the assigned velocity of {speed:g} m/s is above {FAST:g} m/s, faster than tools "
                "of robot arms (a number without a unit is in metres per second: for millimetres "
                f"per second write speed: {speed:g} mm/s)."
            )
        if self.run.rounding is not None:
            doubts = (
                doubt_tolerance(x.path, self.run.rounding.tolerance)
                for x in self.objective.contours
            )
            found += next(filter(None, doubts), [])
        found += [*self.path.notes, *capped(self.objective, self.run), *self.exceeded]
        found += stopping(self.jerk_stops, self.run)
        found += [sentence for x in self.weaves for sentence in x.warnings]
        if self.clearance is None:
            found += self.avoided
        elif not self.clearance.kept:
            found.append(f"collisions are ignored: {self.clearance.too_near[0]}.")
        # In a given duration contours are slower than assigned on purpose.
        if self.run.duration is None:
            slow = slow_ends(self.path, self.trajectory, self.run)
            found += slow
            if not slow and not self.jerk_stops:
                found += missed_speeds(self.path, self.trajectory, self.run)
        return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunPlan(TimedRun):
    """Plan and taught data of one run of a job.

    Args:
        taught: The taught data.
        servo: The servo for which it was made.
    """

    taught: TaughtData
    servo: ServoModel | None = None

    def __str__(self) -> str:
        """Method, duration and set-points of the run."""
        return line_up(self._title, self._rows)

    __repr__ = brief

    @property
    def weak_points(self) -> tuple[str, ...]:
        """Sentences on weak points of the plan and of its set-points."""
        # `super` without arguments does not work in a dataclass with slots.
        return super(RunPlan, self).weak_points + tuple(cut_off(self.taught))

    @property
    def _title(self) -> str:
        """The run and its duration."""
        return f"Run {self.run.name}: {self.trajectory.duration:.4f} s"

    @property
    def _rows(self) -> list[tuple[str, str]]:
        """The plan as names and values."""
        near = None if self.clearance is None else self.clearance.least
        points, period = len(self.taught.q), milliseconds(self.run.period)
        return [
            ("method", f"{self.trajectory.method}, compensation {self.run.compensation}"),
            (
                "path",
                f"{several(len(self.path.contours), 'contour')}, {digits(self.path.length)} m",
            ),
            ("taught", f"{several(points, 'set-point')} every {period}"),
            ("shaped", "" if self.shaped is None else str(self.shaped)),
            ("clearance", "" if near is None else f"{mm(near.low)} at least"),
            ("warnings", f"{len(self.weak_points)}, in .warnings" if self.weak_points else ""),
        ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunResult(RunPlan):
    """Result of one run of a job: its plan, the simulated execution and the evaluation.

    Args:
        explanation: Which limit binds where, for a plan of the method "optimal" that is not
            smoothed.
        execution: The executed motion.
        evaluation: Errors of the executed motion.
        executed_clearance: How far the arm stays from itself and from its cell, as executed.
        experiment: Result on rigid bodies, if the run has an experiment that did not fail.
        failure: The error of a failed experiment.
    """

    explanation: Explanation | None
    execution: Execution
    evaluation: Evaluation
    executed_clearance: Clearance | None = None
    experiment: ExperimentResult | None = None
    failure: ExecutionError | None = None

    def __str__(self) -> str:
        """The plan, and what its execution made of it."""
        e, x = self.evaluation, self.experiment
        error, judged = e.contour_error, None if x is None else x.evaluation.contour_error
        return line_up(
            f"{self._title}, at rest after {e.settled:.4f} s",
            [
                ("contour error", f"{mm(error.rms)} RMS, {mm(error.max)} largest"),
                (
                    "in the experiment",
                    ("failed" if self.failure is not None else "")
                    if judged is None
                    else f"{mm(judged.rms)} RMS, {mm(judged.max)} largest",
                ),
                (
                    "tracking error",
                    f"{mm(e.tracking_error.rms)} RMS, {mm(e.undelayed_error.rms)} without the "
                    f"delay of {milliseconds(e.common_delay)} that all joints share",
                ),
                ("joint demand / limit", _demand(e)),
                *self._rows,
            ],
        )

    __repr__ = brief

    @property
    def weak_points(self) -> tuple[str, ...]:
        """Sentences on weak points of the plan, and on joints that are asked for too much."""
        planned = super(RunResult, self).weak_points
        near = self.executed_clearance
        if (
            near is not None
            and not near.kept
            and self.clearance is not None
            and self.clearance.kept
        ):
            planned += (f"as executed, {near.too_near[0]}, which is within the margin.",)
        planned += tuple(unsettled(self.execution))
        if not self.for_bodies:
            planned += tuple(overloaded(self.execution, self.evaluation, self.run))
        elif self.run.experiment is None:
            planned += (not_judged(self.evaluation),)
        if self.experiment is not None:
            x = self.experiment
            planned += tuple(worse_than_none(x.evaluation, x.uncompensated, self.run))
        return planned

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on the plan, and the error that the servo model does not explain."""
        found, e = super(RunResult, self).remarks, self.evaluation
        if e.unexplained is None:
            return found
        along, across = (mm(x) for x in e.unexplained)
        return (
            *found,
            f"Run {self.run.name}: contour error {mm(e.contour_error.max)}, and at most {across} "
            f"more across the path ({along} along it) that the servo model does not explain.",
        )

    @property
    def judged(self) -> Evaluation:
        """What judges the run: its experiment, if its set-points are for the arm's bodies."""
        if self.for_bodies and self.experiment is not None:
            return self.experiment.evaluation
        return self.evaluation

    @property
    def for_bodies(self) -> bool:
        """Whether the set-points are for the arm's bodies, which the servo model does not have."""
        return self.run.compensation == INVERSE_DYNAMICS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study:
    """A job and the results of its runs.

    Args:
        job: The job.
        runs: The results, by the names of the job's runs.
    """

    job: Job
    runs: Mapping[str, RunResult]

    def __str__(self) -> str:
        """A row for every run."""
        header = ("run", "motion", "RMS error", "largest", "demand / limit")
        rows = [header]
        for name, x in self.runs.items():
            e = x.judged
            errors = (mm(e.contour_error.rms), mm(e.contour_error.max))
            rows.append((name, f"{e.duration:.4f} s", *errors, _demand(e)))
        found = len(warnings_of(self.runs.values()))
        more = f", {several(found, 'warning')}" if found else ""
        return line_up(f"Study of {self.job.title}{more}", rows, columns=">")

    __repr__ = brief


def _demand(e: Evaluation) -> str:
    """The largest demand of a joint as a share of its limit."""
    return f"{e.demand_ratio.max():.4f}" if e.demand_ratio.any() else "no limit"


def warnings_of(plans: Iterable[TimedRun]) -> tuple[str, ...]:
    """The warnings of several runs; what holds for more than one of them is said once.

    Args:
        plans: Plans or results of runs of one job.
    """
    found: dict[str, list[str]] = {}
    for plan in plans:
        for sentence in plan.weak_points:
            found.setdefault(sentence, []).append(plan.run.name)
    return tuple(
        f"Run{'s' if len(names) > 1 else ''} {', '.join(names)}: {sentence}"
        for sentence, names in found.items()
    )


def run(job: Job, *, progress: Progress | None = None) -> Study:
    """Do every run of a job, from the objective path to the evaluation.

    Experiments go on beside the runs that follow. An experiment whose joints do not come to rest
    raises no error: it is the `failure` of its run.

    Args:
        job: The job.
        progress: Called before each step with its names, such as ("proposed", "timing"). While a
            program is traced or planned, called again with the share that is done.

    Raises:
        ArmContourError: The error of the first run that fails.
    """
    _checks.refuse_other("run", job, Job, "as read_job gives it")
    plants: dict[str, RigidBodyPlant] = {}
    for x in job.runs:
        if x.experiment is not None:
            # Refused before any work, which can take minutes.
            with locate_errors(f"Run {x.name}"), locate_errors(EXPERIMENT):
                refuse_without_mujoco()
                plants[x.name] = build_plant(x.experiment, job.arm, job.plant_servo, x.limits)

    def do(job: Job, this: Run, progress: Progress, earlier: Iterable[RunResult]) -> RunResult:
        found = _run(job, this, progress, earlier)
        if this.name not in plants:
            return found
        progress(Step((EXPERIMENT,)))
        how = job, this, found.taught, found.path, found.objective
        try:
            with locate_errors(EXPERIMENT):
                return replace(found, experiment=on_bodies(*how, plant=plants[this.name]))
        except ExecutionError as error:
            return replace(found, failure=error)

    return Study(job=job, runs=_do_runs(job, do, progress))


def teach(job: Job, *, progress: Progress | None = None) -> Mapping[str, RunPlan]:
    """Plan and compensate every run of a job, without a simulation of the execution.

    Args:
        job: The job.
        progress: As in `run`.

    Returns:
        The plans, by the names of the runs.

    Raises:
        ArmContourError: The error of the first run that fails.
    """
    return _do_runs(job, _teach, progress)


def _do_runs(
    job: Job,
    do: Callable[[Job, Run, Progress, Iterable[Result]], Result],
    progress: Progress | None,
) -> Mapping[str, Result]:
    """Results of all runs by their names; `do` gets the results of the earlier runs, too."""
    for x in job.runs:
        # Refused before any work, which can take minutes.
        with locate_errors(f"Run {x.name}"):
            free = x.rounding is not None and x.rounding.free
            refuse_unkept_jerk(Method.SHAPED if free else x.timing, x.limits)
    found: dict[str, Result] = {}
    for x in job.runs:
        with locate_errors(f"Run {x.name}"):
            found[x.name] = do(job, x, under(progress, x.name), found.values())
    return MappingProxyType(found)


def steps_of(this: Run, *, simulated: bool = True) -> tuple[str, ...]:
    """Names of the steps of a run, in order."""
    steps = STEPS if simulated else TEACHING
    if this.rounding is not None and this.rounding.free:
        steps = (SHAPING, *steps[1:])
    return steps if this.experiment is None or not simulated else (*steps, EXPERIMENT)


def path_of(job: Job, this: Run) -> Path:
    """The path that the tool follows in a run: with rounded corners, if the run rounds corners.

    Raises:
        InvalidInput: The job is a program of several contours.
    """
    return programs_of(job, this)[1].path


def _run(job: Job, this: Run, progress: Progress, earlier: Iterable[RunResult]) -> RunResult:
    """Do one run, from its objective path to its evaluation, without its experiment."""
    earlier = list(earlier)
    plan = _teach(job, this, progress, earlier, simulated=True)
    progress(Step(("execution",)))
    executed = execute_run(job, this, plan.taught)
    progress(Step(("evaluation",)))
    evaluation = evaluate(
        executed,
        plan.path,
        objective=plan.objective,
        limits=this.limits,
        until=this.until,
        limit_use=True,
    )
    return RunResult(
        **{x.name: getattr(plan, x.name) for x in fields(RunPlan) if x.init},
        explanation=explain_run(job, this, plan.trajectory),
        execution=executed,
        evaluation=evaluation,
        executed_clearance=_executed_clearance(job, plan, executed),
    )


def _executed_clearance(job: Job, plan: RunPlan, executed: Execution) -> Clearance | None:
    """How far the arm stays from itself and from its cell when the servo executes a plan.

    Raises:
        Collision: Bodies touch, and the job does not ignore this. What only comes nearer than its
            margin is a warning, as the plan keeps the margin.
    """
    if plan.clearance is None:
        return None
    found = job.cell.check(executed)
    touching = [x for x in found.too_near if x.high <= 0]
    if touching and not job.ignore_collisions:
        with locate_errors("as executed"):
            found.refuse()
    return found


def _teach(
    job: Job,
    this: Run,
    progress: Progress,
    earlier: Iterable[RunPlan],
    *,
    simulated: bool = False,
) -> RunPlan:
    """Do the steps of one run from its objective path to its taught data."""
    earlier = list(earlier)
    objective, path, traced, trajectory = _plan(job, this, progress, earlier)
    cleared = keep_clear(job, this, traced, trajectory, progress)
    traced, trajectory = cleared.traced, cleared.trajectory
    progress(Step(("compensation",)))
    taught = teach_run(job, this, trajectory)
    beyond = smoothed_beyond(trajectory, job.arm, this) if this.smoothing else ()
    return RunPlan(
        run=this,
        objective=objective,
        path=path,
        trajectory=trajectory,
        taught=taught,
        servo=job.servo,
        traced=traced,
        exceeded=tuple(beyond),
        clearance=cleared.clearance,
        avoided=cleared.notes,
    )


def _plan(
    job: Job, this: Run, progress: Progress, earlier: Iterable[RunPlan]
) -> tuple[Program, Program, Tracing, Trajectory]:
    """The program of a run before and after rounding, the joint paths of its moves, and its plan.

    Runs with the same path and limits share one tracing, because tracing with redundant degrees of
    freedom takes seconds, and shaping too. Leads of automatic length depend on the timing, so that
    such runs share nothing.
    """
    for x in earlier:
        if x.traced is not None and job.objective is not None and traced_alike(x.run, this):
            progress(Step(("timing",)))
            planned = _planned_before(this, x.traced, earlier)
            if planned is None:
                planned = time_run(job, this, x.traced, progress, duration=this.duration)
            return x.objective, x.path, x.traced, planned
    progress(Step((steps_of(this)[0],)))
    with reach_told(job):
        objective, path = programs_of(job, this, progress)
        progress(Step(("tracing",)))
        clear = first_contour_clear(job)
        both = trace_and_time_run(job, this, path, progress, duration=this.duration, fits=clear)
        return objective, path, *both


def _planned_before(this: Run, traced: Tracing, earlier: Iterable[RunPlan]) -> Trajectory | None:
    """The plan of an earlier run that differs only after its plan; None if there is none."""
    asked = {"duration": this.duration, **this.plan_options}
    for x in earlier:
        known = {"duration": x.run.duration, **x.run.plan_options}
        alike = known.keys() == asked.keys() and all(
            np.array_equal(known[name], value) for name, value in asked.items()
        )
        if x.traced is traced and alike:
            return x.trajectory
    return None


def same_plan(first: RunResult, second: RunResult) -> bool:
    """Whether two runs of a study differ only after their plans."""
    plans = first.trajectory, second.trajectory
    return (
        first.traced is second.traced
        and plans[0].method == plans[1].method
        and plans[0].duration == plans[1].duration
        and first.run.smoothing == second.run.smoothing
    )


def traced_alike(first: Run, second: Run) -> bool:
    """Whether two runs have the same path and limits, and so the same joint path."""
    shaped = first.rounding is not None and first.rounding.free
    if shaped and (first.reserve, first.timing_options) != (second.reserve, second.timing_options):
        # The shape depends on what the plan leaves to the servo, and on its grid.
        return False
    return first.rounding == second.rounding and all(
        np.array_equal(getattr(first.limits, x.name), getattr(second.limits, x.name))
        for x in fields(Limits)
    )


def on_bodies(
    job: Job,
    this: Run,
    taught: TaughtData,
    path: Program,
    objective: Program,
    *,
    plant: RigidBodyPlant | None = None,
) -> ExperimentResult:
    """Execute taught data on the simulated rigid bodies of the arm.

    Args:
        job: The job.
        this: A run with an experiment.
        taught: The set-points.
        path: The program that the tool follows.
        objective: The program with sharp corners.
        plant: The bodies, if they are built already.
    """
    if plant is None:
        assert this.experiment is not None
        plant = build_plant(this.experiment, job.arm, job.plant_servo, this.limits)
    # The plant has no results between two cycles of the drives.
    how: dict[str, Any] = {"resolution": max(RESOLUTION, plant.step)}
    executed = execute(taught, plant, **how)
    uncompensated = None
    if this.compensation != NONE:
        plain = teach_run(
            job, replace(this, compensation=NONE, compensation_options={}), taught.trajectory
        )
        with suppress(ExecutionError):
            done = execute(plain, plant, **how)
            uncompensated = evaluate(done, path, until=this.until)
    return ExperimentResult(
        plant=plant,
        execution=executed,
        evaluation=evaluate(
            executed,
            path,
            objective=objective,
            limits=this.limits,
            until=this.until,
            limit_use=True,
        ),
        uncompensated=uncompensated,
    )
