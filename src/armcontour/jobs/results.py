"""`Study` and `RunResult`: what the runs of a job give."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from armcontour._describing import (
    brief,
    digits,
    draw,
    line_up,
    milliseconds,
    mm,
    several,
    to_html,
)
from armcontour._text import capitalise
from armcontour.arms import Arm
from armcontour.clearance import Clearance
from armcontour.errors import ExecutionError
from armcontour.evaluation import Evaluation
from armcontour.execution import RigidBodyPlant
from armcontour.geometry import ShapedPath, count_full_stops
from armcontour.geometry.shaped import SHAPED, doubt_search
from armcontour.jobs.job import Job, Run
from armcontour.jobs.warnings import (
    CURVATURE_JUMPS,
    NONE,
    JerkStop,
    Weaving,
    beyond_logs,
    capped,
    cut_off,
    jerk_stops,
    limited_commands,
    missed_speeds,
    not_judged,
    oscillating,
    overloaded,
    slow_ends,
    stopping,
    unsettled,
    weavings,
    worse_than_none,
)
from armcontour.motion import Execution, JointPath, Method, TaughtData, Trajectory
from armcontour.motion.command_limits import describe_excess
from armcontour.program import Program
from armcontour.program.rounding import doubt_tolerance
from armcontour.servo import ServoModel
from armcontour.timing import Explanation, Tracing

# The clearance of the arm from itself is reported where it is below this [m].
NEAR = 10e-3
# Share of the motion above which a command interval is reported as coarse.
COARSE = 0.1
# An assigned velocity above this probably lacks its unit [m/s].
FAST = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shaped:
    """What shaping the contours of a program gained, without rapids and dwells between them.

    Args:
        starts: How many contours each start won, by the names of the starts.
        durations: Sums over all contours of the least durations, of every start that all contours
            have and of the shaped paths as "shaped" [s].
        iterations: Largest number of iterations of a contour.
    """

    starts: Mapping[str, int]
    durations: Mapping[str, float]
    iterations: int

    @staticmethod
    def of(program: Program) -> Shaped | None:
        """What shaping gained in a program; None if it has no shaped contour."""
        found = [x.path.outcome for x in program.contours if isinstance(x.path, ShapedPath)]
        if not found:
            return None
        won = [x.start for x in found]
        common = [name for name in found[0].durations if all(name in x.durations for x in found)]
        return Shaped(
            starts={name: won.count(name) for name in dict.fromkeys(won)},
            durations={name: sum(x.durations[name] for x in found) for name in common},
            iterations=max(max(len(x.history) - 1, 0) for x in found),
        )

    @property
    def gain(self) -> float:
        """Share of the duration of the fastest start that the shapes save."""
        starts = [x for name, x in self.durations.items() if name != SHAPED]
        return 1 - self.durations[SHAPED] / min(starts)

    def __str__(self) -> str:
        """The durations, such as "shaped: 4.74 s (arcs 5.33 s, stops 5.23 s)"."""
        others = sorted(name for name in self.durations if name != SHAPED)
        text = ", ".join(f"{name} {self.durations[name]:.4g} s" for name in others)
        return f"shaped: {self.durations[SHAPED]:.4g} s ({text})"


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


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResult:
    """Result of one run of a job: its plan, its set-points, their execution and its evaluation.

    Args:
        run: The run.
        objective: The program with sharp corners; a path becomes a program.
        path: The program that the tool follows: with rounded or shaped corners, if the run rounds
            corners.
        trajectory: The realizable trajectory.
        traced: Joint paths of all moves, if known. Runs with the same path and limits share them.
        exceeded: Sentences on limits above those of the arm.
        clearance: How far the arm stays from itself and from its cell, as planned; None for an arm
            whose shapes are not known.
        avoided: Sentences on other ways that were taken to keep clear; without a clearance, on why
            there is none.
        explanation: Which limit binds where, for a plan of the method "optimal".
        taught: The taught data; None in a plan of the Studio.
        servo: The servo for which it was made.
        execution: The executed motion; None without a simulation.
        evaluation: Errors of the executed motion; None without a simulation.
        executed_clearance: How far the arm stays from itself and from its cell, as executed.
        experiment: Result on rigid bodies, if the run has an experiment that did not fail.
        failure: The error of a failed experiment.
    """

    run: Run
    objective: Program
    path: Program
    trajectory: Trajectory
    traced: Tracing | None = None
    exceeded: tuple[str, ...] = ()
    clearance: Clearance | None = None
    avoided: tuple[str, ...] = ()
    explanation: Explanation | None = None
    # Of a run that went so far, these are not None.
    taught: TaughtData = None  # type: ignore[assignment]
    servo: ServoModel | None = None
    execution: Execution = None  # type: ignore[assignment]
    evaluation: Evaluation = None  # type: ignore[assignment]
    executed_clearance: Clearance | None = None
    experiment: ExperimentResult | None = None
    failure: ExecutionError | None = None

    def __str__(self) -> str:
        """Method, duration and set-points of the run, and what the execution made of it."""
        near = None if self.clearance is None else self.clearance.least
        rows = [
            ("method", f"{self.trajectory.method}, compensation {self.run.compensation}"),
            (
                "path",
                f"{several(len(self.path.contours), 'contour')}, {digits(self.path.length)} m",
            ),
            (
                "taught",
                f"{several(len(self.taught.q), 'set-point')} every {milliseconds(self.run.period)}",
            ),
            ("command / limit", "" if self.taught is None else self.taught.command_note),
            ("shaped", "" if self.shaped is None else str(self.shaped)),
            ("clearance", "" if near is None else f"{mm(near.low)} at least"),
            ("warnings", f"{len(self.weak_points)}, in .warnings" if self.weak_points else ""),
        ]
        title, e = f"Run {self.run.name}: {self.trajectory.duration:.4f} s", self.evaluation
        if e is None:
            return line_up(title, rows)
        on_bodies = "failed" if self.failure is not None else ""
        if self.experiment is not None:
            on_bodies = _errors(self.experiment.evaluation)
        executed = [
            ("contour error", _errors(e)),
            ("in the experiment", on_bodies),
            (
                "tracking error",
                f"{mm(e.tracking_error.rms)} RMS, {mm(e.undelayed_error.rms)} without the "
                f"delay of {milliseconds(e.common_delay)} that all joints share",
            ),
            ("joint demand / limit", _demand(e)),
        ]
        return line_up(f"{title}, at rest after {e.settled:.4f} s", [*executed, *rows])

    __repr__ = brief

    _repr_html_ = to_html
    figure = draw

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.trajectory.require_arm() if self.execution is None else self.execution.arm

    @cached_property
    def motion(self) -> Execution:
        """The executed motion; without a simulation that of joints that follow the plan exactly."""
        if self.execution is not None:
            return self.execution
        return Execution.of_plan(self.trajectory, self.arm)

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

    @cached_property
    def _stops_of_path(self) -> dict[str, int]:
        """Full stops that the path asks for, whatever the limits, by the reasons."""
        if self.run.timing == Method.CONVENTIONAL:
            # It goes through corners at its uniform speed.
            return {}
        found: Counter[str] = Counter()
        for x in self.path.contours:
            found.update(count_full_stops(x.path))
        return dict(sorted(found.items()))

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
        """Sentences on plan and execution, with the name of the run, which are no warnings."""
        found = [f"Run {self.run.name}: {x}" for x in self.path.remarks]
        found += [f"Run {self.run.name}: {x.sentence}" for x in self.weaves]
        if self.taught is not None and (used := self.taught.command_note):
            found.append(f"Run {self.run.name}: set-points / command limits: {used}.")
        clear = None if self._far_from_itself else self.clearance_note
        found += [x for x in (self.shape_note, self.stops_note, clear) if x is not None]
        e = self.evaluation
        if e is not None and e.unexplained is not None:
            along, across = (mm(x) for x in e.unexplained)
            found.append(
                f"Run {self.run.name}: contour error {mm(e.contour_error.max)}, and at most "
                f"{across} more across the path ({along} along it) that the servo model does not "
                "explain."
            )
        return tuple(found)

    @cached_property
    def weaves(self) -> tuple[Weaving, ...]:
        """Width and frequency of each weave in the plan."""
        return tuple(weavings(self.path, self.trajectory, self.run.limits))

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
    def judge(self) -> RunResult | ExperimentResult:
        """The result whose execution judges the run: that on rigid bodies, or that of the servo."""
        on_bodies = self.run.judge is not None and self.experiment is not None
        return self.experiment if on_bodies else self  # type: ignore[return-value]

    @property
    def judged(self) -> Evaluation:
        """The evaluation that judges the run."""
        return self.judge.evaluation

    @property
    def for_bodies(self) -> bool:
        """Whether the set-points are for the arm's bodies, which the servo model does not have."""
        return self.run.for_bodies

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on weak points of the run, with its name."""
        return warnings_of([self])

    @cached_property
    def weak_points(self) -> tuple[str, ...]:
        """Sentences on weak points of the run, such as a coarse command interval."""
        found = self._weak_points_of_plan()
        if self.servo is not None:
            found += oscillating(self.servo)
        if self.taught is not None:
            found += cut_off(self.taught)
            found += limited_commands(self.taught)
            found += filter(None, [describe_excess(self.taught)])
            if self.servo is not None and self.run.compensation != NONE and self.servo.doubt:
                found.append(self.servo.doubt)
        if self.servo is not None:
            found += filter(None, [beyond_logs(self.servo, self.trajectory)])
        if self.execution is not None:
            found += self._weak_points_of_execution()
        return tuple(found)

    def _weak_points_of_plan(self) -> list[str]:
        """Sentences on weak points of the plan."""
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
            found += doubt_search(x.path for x in self.path.contours)
        found += [*self.path.notes, *capped(self.objective, self.run), *self.exceeded]
        found += stopping(self.jerk_stops, self.run)
        found += [sentence for x in self.weaves for sentence in x.warnings]
        if self.clearance is None:
            found += self.avoided
        elif not self.clearance.kept:
            found.append(f"collisions are ignored: {self.clearance.too_near[0]}.")
        if self.clearance is not None and self.clearance.below_base is not None:
            found.append(self.clearance.below_base)
        # In a given duration contours are slower than assigned on purpose.
        if self.run.duration is None:
            slow = slow_ends(self.path, self.trajectory, self.run)
            found += slow
            if not slow and not self.jerk_stops:
                found += missed_speeds(self.path, self.trajectory, self.run)
        return found

    def _weak_points_of_execution(self) -> list[str]:
        """Sentences on what the execution does worse than the plan."""
        found: list[str] = []
        planned, near = self.clearance, self.executed_clearance
        if planned is not None and planned.kept and near is not None and not near.kept:
            found.append(f"as executed, {near.too_near[0]}, which is within the margin.")
        found += unsettled(self.execution)
        if not self.for_bodies:
            found += overloaded(self.execution, self.evaluation, self.run)
        elif self.run.experiment is None:
            found.append(not_judged(self.evaluation))
        if self.experiment is not None:
            x = self.experiment
            found += worse_than_none(x.evaluation, x.uncompensated, self.run)
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study:
    """A job and the results of its runs.

    Args:
        job: The job.
        runs: The results, by the names of the job's runs; without executions if the job was not
            simulated.
    """

    job: Job
    runs: Mapping[str, RunResult]

    _repr_html_ = to_html
    figure = draw

    @property
    def simulated(self) -> bool:
        """Whether any run was executed."""
        return any(x.execution is not None for x in self.runs.values())

    def to_dict(self) -> dict[str, list[Any]]:
        """A row for every run as columns that `pandas.DataFrame` takes, by name.

            pandas.DataFrame(study.to_dict()).sort_values("largest")

        Returns:
            `run`; `motion`, `settled` [s]; `rms`, `largest` contour error [m]; `demand`, the
            largest share of a limit of acceleration. None where nothing was simulated.
        """
        judged = [x.judged for x in self.runs.values()]
        return {
            "run": list(self.runs),
            "motion": [x.trajectory.duration for x in self.runs.values()],
            "settled": [e and e.settled for e in judged],
            "rms": [e and e.contour_error.rms for e in judged],
            "largest": [e and e.contour_error.max for e in judged],
            "demand": [e and float(e.demand_ratio.max()) for e in judged],
        }

    def __str__(self) -> str:
        """A row for every run."""
        rows = [("run", "motion", "RMS error", "largest", "demand / limit")]
        for name, x in self.runs.items():
            e, errors = x.judged, ("-", "-", "-")
            if e is not None:
                errors = (mm(e.contour_error.rms), mm(e.contour_error.max), _demand(e))
            rows.append((name, f"{x.trajectory.duration:.4f} s", *errors))
        found = len(warnings_of(self.runs.values()))
        more = f", {several(found, 'warning')}" if found else ""
        return line_up(f"Study of {self.job.title}{more}", rows, columns=">")

    __repr__ = brief


def _errors(e: Evaluation) -> str:
    """The contour errors."""
    return f"{mm(e.contour_error.rms)} RMS, {mm(e.contour_error.max)} largest"


def _demand(e: Evaluation) -> str:
    """The largest demand of a joint as a share of its limit."""
    return f"{e.demand_ratio.max():.4f}" if e.demand_ratio.any() else "no limit"


def warnings_of(plans: Iterable[RunResult]) -> tuple[str, ...]:
    """The warnings of several runs; what holds for more than one of them is said once.

    Args:
        plans: Results of runs of one job.
    """
    found: dict[str, list[str]] = {}
    for plan in plans:
        for sentence in plan.weak_points:
            found.setdefault(sentence, []).append(plan.run.name)
    return tuple(
        f"Run{'s' if len(names) > 1 else ''} {', '.join(names)}: {sentence}"
        for sentence, names in found.items()
    )
