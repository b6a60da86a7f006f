"""Sharing of a tolerance between the shape of a path and its execution, for one shape of a run.

The servo gets a share of the tolerance, the shape gets the rest; what the servo does not need is
given back to the shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from armcontour._describing import count_kinds
from armcontour._progress import Progress, Step
from armcontour.certification._bodies import rest_at_start
from armcontour.certification._uses import Robot, work_on
from armcontour.certification._whole import Assembly, Whole
from armcontour.errors import InvalidInput, NotRealizable
from armcontour.evaluation.pieces import unexplained_errors
from armcontour.geometry import Path, RoundedPath, ShapedPath
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import Job, Rounding, Run
from armcontour.jobs.planning import programs_of, round_program, trace_run
from armcontour.motion import Trajectory
from armcontour.program import Contour, Dwell, Event, Program, Rapid
from armcontour.robustness.box import Box
from armcontour.robustness.unknowns import Unknowns
from armcontour.timing import intervals_of
from armcontour.timing.options import Optimal
from armcontour.timing.program_timing import Timing, time_program
from armcontour.timing.program_tracing import Tracing

# Shares of a total tolerance that the servo gets if the goal has no budget for the servo. They are
# tried in order until a plan is certified, and further while the error uses NEAR of its budget and
# the plan gets faster. The unused part goes to the shape.
SERVO_SHARES = (0.02, 0.06, 0.2, 0.6)
NEAR = 0.9
# When the unused part goes to the shape, the servo keeps this many times the part that it needed,
# because the plan changes a little; more if no faster plan is found with the first of them.
KEPT_FOR_SERVO = (1.5, 6.0)
# Paths are not rounded or shaped again for less than this share of the tolerance.
LEAST_GAIN = 1e-3
# Places at which errors that the servo model does not explain are bounded, beside the breaks.
MOST_PLACES = 1000


@dataclass(frozen=True, slots=True)
class Found:
    """A program that keeps the goal, with its run and its budget for the servo [m].

    `unexplained` is the part of the budget that the servo model does not explain [m].
    """

    this: Run
    budget: float
    unexplained: float
    whole: Whole

    @property
    def duration(self) -> float:
        """Duration of the plan [s]."""
        return self.whole.trajectory.duration


class Slower(Exception):
    """No plan of a program is faster than a known one.

    Args:
        least: Duration of its fastest plan, with nothing derated [s].
    """

    def __init__(self, least: float) -> None:
        super().__init__()
        self.least = least


@dataclass(slots=True, kw_only=True)
class Sharing:
    """Finds the fastest plan of a run that keeps a goal, whatever its path's part of the tolerance.

    Args:
        job: The job.
        this: The run.
        goal: The goal.
        progress: Called with a step before each trial.
        executor: What executes robots of a box as rigid bodies; None is processes of this machine.
        deadline: Duration of a plan that is known [s]: slower programs are not searched.

    Attributes:
        trials: Number of plans of contours that were made.
        shares: Whether the path takes a part of the tolerance; if not, the servo gets all of it.
        uncertified: The fastest plan with nothing derated and the whole tolerance for the shape;
            there once `fastest` has begun.
    """

    job: Job
    this: Run
    goal: Goal
    progress: Progress
    executor: Executor | None = None
    deadline: float = np.inf
    trials: int = 0
    shares: bool = field(init=False)
    uncertified: Trajectory = field(init=False)
    _programs: tuple[Program, Program] | None = field(init=False, default=None)
    _traced: Tracing = field(init=False)

    def __post_init__(self) -> None:
        if self.goal.plant == "rigid_body":
            self._refuse_other_jobs()
        self._programs = self._shape(self.with_shape_of(0.0))
        rounding = self.this.rounding
        free = rounding is not None and rounding.free
        bent = free or any(shape_part(x.path) > 0 for x in self.largest.contours)
        self.shares = self.goal.tolerance is not None and bent

    @property
    def largest(self) -> Program:
        """The program whose shape has all of the tolerance."""
        assert self._programs is not None
        return self._programs[1]

    def fastest(self) -> Found:
        """Find the fastest plan.

        Raises:
            NotRealizable: No plan keeps the goal.
            Slower: All plans are slower than the deadline.
        """
        goal = self.goal
        robot = robot_of(self.job, self.this, goal)
        # The certificate says what it costs compared to this plan. It comes first, since what
        # refuses it, such as an event before the start, would refuse the certificate at its end.
        self.progress(Step(("uncertified plan",)))
        self._traced = trace_run(self.job, self.this, self.largest, self.progress)
        self.uncertified = plan_fastest(robot, self.largest, self._traced)
        if robot.bodies:
            self._refuse_start(robot)
        if not self.shares:
            budget = goal.servo if goal.tolerance is None else goal.servo or goal.tolerance
            assert budget is not None
            self._refuse_slower(())
            return self._search(budget, self.this)
        shares = [x * self._tightest for x in SERVO_SHARES]
        budgets = shares if goal.servo is None else [goal.servo]
        self._refuse_slower(budgets)
        return self._give_rest_to_shape(self._best_of(budgets))

    def _best_of(self, budgets: Sequence[float]) -> Found:
        """The fastest plan over budgets of the servo [m], from the first until plans get slower.

        Raises:
            NotRealizable: There is no plan for any of them.
        """
        best: Found | None = None
        for budget in budgets:
            last = budget == budgets[-1] and best is None
            found = self._search(budget) if last else self._try(budget)
            if best is not None and (found is None or found.duration >= best.duration):
                break
            best = found
            if best is not None and best.whole.worst + best.unexplained < NEAR * budget:
                break
        assert best is not None  # the search with the last share raises if it fails
        return best

    def _refuse_other_jobs(self) -> None:
        """Refuse a job that certificates on rigid bodies are not made for.

        Raises:
            InvalidInput: The program has several contours, rapids or events between, or the arm or
                the servo has no rigid bodies.
        """
        this, rounding = self.this, self.this.rounding
        if rounding is not None and rounding.free:
            # The moves are the same, and need no shape.
            this = replace(this, rounding=rounding.with_arcs)
        program, robot = programs_of(self.job, this)[0], robot_of(self.job, this, self.goal)
        others = [x for x in program.moves if not isinstance(x, Contour | Dwell)]
        if len(program.contours) > 1 or others:
            raise InvalidInput(
                "A certificate on rigid bodies is for one contour, with or without dwells, but "
                f"this program has {_list_moves(program)}, or certify with plant: servo."
            )
        Unknowns.of(robot.box or Box(), robot.arm, robot.servo)
        robot.plant()

    def _refuse_start(self, robot: Robot) -> None:
        """Refuse rigid bodies that do not rest where the contour starts.

        Raises:
            ExecutionError: Their drives cannot hold them there, or do not settle.
            NotRealizable: They rest too far from it.
        """
        (contour,) = self.largest.contours
        off = rest_at_start(robot, contour.path, robot.teach(self.uncertified))
        goal = self.goal
        allowed = goal.tolerance if goal.servo is None else goal.servo
        assert allowed is not None
        work = work_on(self.largest, contour)
        if (work is None or work[0] <= 0) and off > allowed:
            raise NotRealizable(
                f"At rest at the start of its path the tool is {off * 1e3:.4g} mm from it, since "
                f"gravity is not fed forward, and {allowed * 1e3:.4g} mm is allowed: feed gravity "
                "forward (gravity_feedforward: true), raise kp, or allow more.",
                limit="contour error",
                needed=off,
                allowed=allowed,
            )

    def _refuse_slower(self, budgets: Sequence[float]) -> None:
        """Refuse a run whose fastest plans are slower than the deadline, whatever the budget [m].

        Raises:
            Slower: They are.
        """
        if not np.isfinite(self.deadline):
            return
        robot = robot_of(self.job, self.this, self.goal)
        least = self.uncertified.duration
        for program in (self._shape(self.with_shape_of(x))[1] for x in budgets):
            traced = trace_run(self.job, self.this, program, self.progress)
            least = min(least, plan_fastest(robot, program, traced).duration)
        if least >= self.deadline:
            raise Slower(least)

    def _give_rest_to_shape(self, found: Found) -> Found:
        """Give the unused tolerance of the servo to the shape, if the plan gets faster."""
        for kept in KEPT_FOR_SERVO:
            needed = kept * found.whole.worst + found.unexplained
            if needed > found.budget - LEAST_GAIN * self._tightest:
                break
            better = self._try(needed)
            if better is not None and better.duration < found.duration:
                return better
        return found

    def _try(self, budget: float) -> Found | None:
        """Find the fastest plan as `_search` does; None if no plan keeps the goal."""
        try:
            return self._search(budget)
        except NotRealizable:
            return None

    def _search(self, budget: float, this: Run | None = None) -> Found:
        """Find the fastest plan with a budget for the servo [m].

        Args:
            budget: The budget.
            this: The run with the tolerance of its shape; by default the shape gets the rest.

        Raises:
            NotRealizable: No plan keeps the goal.
        """
        if this is None:
            this = self.with_shape_of(budget)
            objective, program = self._shape(this)
            traced = trace_run(self.job, this, program, self.progress)
        else:
            assert self._programs is not None
            (objective, program), traced = self._programs, self._traced
        robot = robot_of(self.job, this, self.goal)
        unexplained = unexplained_part(robot, traced)
        if unexplained >= budget:
            raise NotRealizable(
                f"The servo model does not explain errors of up to {unexplained * 1e3:.4g} mm "
                f"across the path, and {budget * 1e3:.4g} mm is allowed: allow more, or give the "
                "servo a model with a smaller `unexplained`.",
                limit="contour error",
                needed=unexplained,
                allowed=budget,
            )
        assembly = Assembly(
            job=self.job,
            robot=robot,
            goal=self.goal,
            budget=budget - unexplained,
            objective=objective,
            program=program,
            progress=self.progress,
            executor=self.executor,
            traced=traced,
        )
        try:
            return Found(this, budget, unexplained, assembly.whole())
        finally:
            self.trials += assembly.trials

    def _shape(self, this: Run) -> tuple[Program, Program]:
        """The program of a run before and after rounding or shaping.

        A certified plan derates what it has to: it leaves no reserve.
        """
        rounding = this.rounding
        if rounding is None or not rounding.free:
            return programs_of(self.job, this)
        same = rounding == self.with_shape_of(0.0).rounding
        if same and self._programs is not None:
            return self._programs
        objective, _ = programs_of(self.job, replace(this, rounding=rounding.with_arcs))
        free = replace(this, timing=replace(this.timing, reserve=0.0))
        return objective, round_program(self.job, free, objective, self.progress)

    @property
    def _tightest(self) -> float:
        """The smallest tolerance that the shape and the servo share [m]."""
        assert self.goal.tolerance is not None
        rounding = self.this.rounding
        line = None if rounding is None else rounding.line_tolerance
        return self.goal.tolerance if line is None else min(line, self.goal.tolerance)

    def with_shape_of(self, servo: float) -> Run:
        """The run with the tolerances that are left for the shape beside the servo's part [m]."""
        rounding, tolerance = self.this.rounding, self.goal.tolerance
        if rounding is None or tolerance is None:
            return self.this
        line, most = rounding.line_tolerance, tolerance - servo
        left: Rounding = replace(
            rounding,
            tolerance=most,
            at={k: min(x, most) for k, x in (rounding.at or {}).items()} or None,
            line_tolerance=None if line is None else self._tightest - servo,
        )
        return replace(self.this, rounding=left)


def robot_of(job: Job, this: Run, goal: Goal) -> Robot:
    """The robot on which plans of a run are searched for."""
    dof = job.arm.dof
    return Robot(
        arm=job.arm,
        limits=this.limits.for_joints(dof),
        model=job.servo.for_joints(dof),
        servo=job.plant_servo.for_joints(dof),
        saturated=goal.saturation == "report",
        box=goal.box,
        run=this,
        bodies=goal.plant == "rigid_body",
    )


def plan_fastest(robot: Robot, program: Program, traced: Tracing) -> Trajectory:
    """Plan a program with nothing derated.

    Args:
        robot: The robot.
        program: The program.
        traced: The traced program.
    """
    timing = Timing(robot.arm, robot.limits, Optimal(intervals=intervals_of(program)))
    return time_program(traced, timing).limited(robot.limits)


def unexplained_part(robot: Robot, traced: Tracing) -> float:
    """Largest tool error across the contours that the servo model does not explain [m]."""
    unexplained, moves = robot.servo.unexplained, traced.program.moves
    found = [0.0]
    for x in traced.steps:
        if unexplained is None or x.joint_path is None or x.move is None:
            continue
        path = x.joint_path.tool_path
        if path is not None and isinstance(moves[x.move], Contour):
            s = np.union1d(x.joint_path.breaks, np.linspace(0.0, path.length, MOST_PLACES))
            own = unexplained_errors(robot.arm, x.joint_path(s), path(s, 1), unexplained)
            found.append(float(own[1].max()))
    return max(found)


def shape_part(path: Path) -> float:
    """Bound of the distance of a path from its objective path, in either direction [m]."""
    if isinstance(path, ShapedPath):
        pairs = ((x.vertices, x.curvatures) for x in (path, path.objective))
        same = all(np.array_equal(a, b) for a, b in zip(*pairs, strict=True))
        return 0.0 if same else path.tolerance
    if not isinstance(path, RoundedPath) or not len(path.corners):
        return 0.0
    return float(path.corners.error.max())


def _list_moves(program: Program) -> str:
    """List the moves of a program, and state which to remove so that one contour remains."""
    kinds = {"contour": Contour, "rapid": Rapid, "dwell": Dwell, "event": Event}
    counts = {word: sum(isinstance(x, kind) for x in program.moves) for word, kind in kinds.items()}
    leave = []
    if counts["rapid"]:
        leave.append("process.approach and process.retract")
    mend = f"leave out {' and '.join(leave)}" if leave else ""
    if counts["contour"] > 1 or not leave:
        mend = "make a job of each contour" + (f", {mend}" if mend else "")
    return f"{count_kinds(counts)}: {mend}"
