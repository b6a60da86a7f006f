"""A program of certified contours, planned contour by contour, and executed and judged as a whole.

Moves are planned in their order. The motion of a servo on a contour depends on earlier motion only.
So the trials of a contour are executed after the moves before it, with set-points at their phase of
the command interval in the program. The whole program is then executed and judged once more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace

import numpy as np

from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step, under
from armcontour.certification._approach import Approach
from armcontour.certification._proving import KEPT
from armcontour.certification._rapids import Derated, plan_fastest_rapid
from armcontour.certification._refusal import refuse
from armcontour.certification._search import (
    POINTS,
    Kept,
    Search,
)
from armcontour.certification._uses import (
    SAME,
    SPEED_SLACK,
    Judged,
    Robot,
    Setting,
    execute_over_box,
    judge_piece,
    run,
    work_on,
)
from armcontour.errors import NotRealizable
from armcontour.evaluation import Check, check
from armcontour.evaluation.pieces import pieces_of
from armcontour.execution import execute
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import Job
from armcontour.motion import Execution, JointPath, Law, Span, TaughtData, Trajectory
from armcontour.program import Program, contour_called
from armcontour.timing import intervals_of
from armcontour.timing.program_timing import JoinedMoves
from armcontour.timing.program_tracing import TracedMove, Tracing

# The error that is left of a rapid at the start of the next contour may take this share of the
# budget.
ENTRY = 0.25
# The whole program is judged at more times than the trials, and set-points next to the end of a
# move have a part of the next one. Moves that are outside their goal there are searched again with
# goals closer by CLOSER, and all moves after the first of them, MOST_ROUNDS times at most.
MOST_ROUNDS = 4
CLOSER = 0.99


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedContour:
    """The certified plan of a contour.

    Args:
        setting: The setting of the search.
        joint_path: The joint path.
        approach: The motion before the contour.
        kept: The plan.
        squares: Largest ds² of the plan with nothing derated, in the cells of the derating
            [m²/s²], (n,).
        trials: Number of plans that were made.
    """

    setting: Setting
    joint_path: JointPath
    approach: Approach
    kept: Kept
    squares: FloatArray
    trials: int

    @property
    def trajectory(self) -> Trajectory:
        """The plan; times from 0 [s]."""
        return self.kept.trial.trajectory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whole:
    """A program all contours of which keep their goal.

    Args:
        robot: The robot.
        objective: The program before its corners were rounded.
        program: The program that was planned.
        trajectory: The plan of the program.
        spans: Times of the contours in the plan, in order.
        taught: Taught data of the plan.
        execution: Execution of the taught data on the robot.
        judged: What the tool does in the execution, contour by contour.
        check: Check of the plan against all limits.
        contours: Certified plans of the contours.
        rapids: Derated plans of the rapids.
        traced: The traced program.
    """

    robot: Robot
    objective: Program
    program: Program
    trajectory: Trajectory
    spans: tuple[Span, ...]
    taught: TaughtData
    execution: Execution
    judged: tuple[Judged, ...]
    check: Check
    contours: tuple[PlannedContour, ...]
    rapids: tuple[Derated, ...]
    traced: Tracing

    @property
    def worst(self) -> float:
        """Largest contour error, over the box if there is one [m]."""
        return max([x.kept.worst for x in self.contours] + [x.largest for x in self.judged])


Planned = PlannedContour | Derated | float


@dataclass(slots=True, kw_only=True)
class Assembly:
    """Plans the moves of a program in order, each after those before it.

    Args:
        job: The job.
        robot: The robot.
        goal: The goal of every contour.
        budget: Largest contour error, over the box if there is one [m].
        objective: The program before its corners were rounded.
        program: The program to plan.
        progress: Called with a step before each trial.
        traced: The traced program. Tracing does not depend on timing: all rounds share it.
        executor: What executes robots of a box as rigid bodies; None is processes of this machine.

    Attributes:
        trials: Number of plans of contours that were made.
    """

    job: Job
    robot: Robot
    goal: Goal
    budget: float
    objective: Program
    program: Program
    progress: Progress
    traced: Tracing
    executor: Executor | None = None
    trials: int = 0
    # Plans in the order in which they are needed, and the number of them that this round has used.
    _done: list[Planned] = field(default_factory=list)
    _used: int = 0
    # Share of their goals at which the trials of a move aim, by its place among the plans above.
    _margins: dict[int, float] = field(default_factory=dict)

    def whole(self) -> Whole:
        """Plan the program so that every contour keeps the goal when all of it is executed.

        Raises:
            NotRealizable: No such plan was found; the message names the contour.
            ArmContourError: Tracing or planning fails.
        """
        for _ in range(MOST_ROUNDS):
            found = self._assemble()
            outside = _find_outside(found, self.goal, self.budget)
            if not outside:
                return found
            where = [k for k, x in enumerate(self._done) if not isinstance(x, float)]
            for k in {where[x.move] for x in outside}:
                self._margins[k] = self._margins.get(k, 1.0) * CLOSER
            first = outside[0]
            number = sum(isinstance(x, PlannedContour) for x in self._done[: where[first.move] + 1])
            # Moves before the first one do not depend on it.
            del self._done[where[first.move] :]
        number = max(number - 1, 0)
        raise NotRealizable(
            f"{contour_called(self.program.contours[number], number)}: in the whole program "
            f"{first.said}, though plans were searched for {MOST_ROUNDS} times with closer goals: "
            "allow more, or give the program a dwell before and after that contour.",
            limit=first.limit,
            needed=first.needed,
            allowed=first.allowed,
        )

    def _assemble(self) -> Whole:
        """Plan all moves that have no plan yet, and execute the whole program."""
        self._used = 0
        joined = JoinedMoves(self.traced, self.robot.arm)
        for step in self.traced.steps:
            with step.named():
                found = self._plan(step, joined)
            joined.add(step, found)
        trajectory = joined.trajectory().limited(self.robot.limits)
        contours = tuple(x for x in self._done if isinstance(x, PlannedContour))
        spans = trajectory.contour_spans
        taught, execution, judged, checked = self._execute(trajectory, contours)
        return Whole(
            robot=self.robot,
            objective=self.objective,
            program=self.program,
            trajectory=trajectory,
            spans=spans,
            taught=taught,
            execution=execution,
            judged=judged,
            check=checked,
            contours=contours,
            rapids=tuple(x for x in self._done if isinstance(x, Derated)),
            traced=self.traced,
        )

    def _execute(
        self, trajectory: Trajectory, contours: Sequence[PlannedContour]
    ) -> tuple[TaughtData, Execution, tuple[Judged, ...], Check]:
        """Teach, execute and check the whole program; also judges the tool."""
        robot = self.robot
        if len(trajectory.spans) < 2:
            # A single contour was executed in its last trial already.
            kept = contours[0].kept
            assert kept.execution is not None
            taught = replace(kept.trial.taught, trajectory=trajectory)
            return taught, replace(kept.execution, taught=taught), (kept.judged,), kept.check
        self.progress(Step(("the whole program",)))
        taught = robot.teach(trajectory)
        executed = execute(taught, robot.plant(), resolution=robot.resolution)
        pieces = pieces_of(executed, self.program, None, None)
        judged = tuple(judge_piece(x, robot.limits.speed) for x in pieces)
        return taught, executed, judged, check(trajectory, robot.arm, robot.limits, points=POINTS)

    def _plan(self, step: TracedMove, joined: JoinedMoves) -> Trajectory | None:
        """Plan the next move, and append the standstill that a contour needs before its start.

        Contours keep the goal; rapids keep all joint limits when they are executed.
        """
        path, before = step.joint_path, joined.laws
        if path is None:
            return None
        found: Planned
        if self.traced.is_contour(step):
            if before:
                entry = ENTRY * self.budget
                pause = self._recall(lambda: _settling_time(before, self.robot, entry))
                assert isinstance(pause, float)
                if pause > 0:
                    joined.stand(pause)
            found = self._recall(lambda: self._search(path, before))
        else:
            margin = self._margins.get(len(self._done), 1.0)
            speed = self.program.rapid_speed
            found = self._recall(
                lambda: plan_fastest_rapid(path, before, self.robot, margin, speed)
            )
        assert not isinstance(found, float)
        return found.trajectory

    def _recall(self, plan: Callable[[], Planned]) -> Planned:
        """Return the plan of an earlier round, or else make a new one."""
        if self._used == len(self._done):
            self._done.append(plan())
        self._used += 1
        return self._done[self._used - 1]

    def _search(self, joint_path: JointPath, before: Sequence[Law]) -> PlannedContour:
        """Search the fastest plan of the next contour that keeps the goal.

        Raises:
            NotRealizable: No plan was found.
        """
        program = self.program
        number = sum(1 for x in self._done if isinstance(x, PlannedContour))
        contour, count = program.contours[number], len(program.contours)
        setting = Setting(
            **{x.name: getattr(self.robot, x.name) for x in fields(Robot)},
            path=contour.path,
            work=work_on(program, contour),
            budget=self.budget,
            rms=self.goal.rms,
        )
        names = (f"contour {number + 1} of {count}",) if count > 1 else ()
        search = Search(
            setting,
            joint_path,
            Approach.of(before, self.robot),
            self.goal,
            under(self.progress, *names),
            executor=self.executor,
            intervals=intervals_of(program),
            margin=self._margins.get(len(self._done), 1.0),
        )
        kept = search.fastest()
        self.trials += search.trials
        if kept is None:
            refuse(search)
        if len(program.moves) > 1:
            # The whole program is executed again: executions of all contours would need memory.
            kept = replace(kept, execution=None)
        return PlannedContour(
            setting=setting,
            joint_path=joint_path,
            approach=search.approach,
            kept=kept,
            squares=search.squares,
            trials=search.trials,
        )


@dataclass(frozen=True, slots=True)
class Outside:
    """A move that does not keep its goal in the whole program.

    Args:
        move: Number of the move among contours and rapids, from 0.
        said: The excess in words.
        limit: Name of the limit that is exceeded.
        needed: Value that would have to be allowed.
        allowed: Largest allowed value.
    """

    move: int
    said: str
    limit: str
    needed: float
    allowed: float


def _find_outside(whole: Whole, goal: Goal, budget: float) -> list[Outside]:
    """Find the moves that do not keep their goal in the whole program, in order."""
    moves = [x for x in whole.trajectory.spans if x.kind != "dwell"] or list(whole.spans)
    contours = [k for k, x in enumerate(moves) if x.kind == "contour"]
    found: list[Outside] = []
    for k, judged in zip(contours, whole.judged, strict=True):
        found += _excesses(k, judged, goal, budget)
    over = [(x.t, x.name, x.ratio) for x in whole.check.uses if x.ratio > 1 + KEPT]
    for t, name, ratio in over + _demands(whole, moves):
        k = max(0, sum(1 for x in moves if x.t[0] <= t) - 1)
        where = "it" if moves[k].kind == "contour" else "the rapid after it"
        said = f"{where} takes {ratio:.9g} times its {name.replace('_', ' ')}"
        found.append(Outside(k, said, name, ratio, 1.0))
    return sorted(found, key=lambda x: x.move)


def _excesses(move: int, judged: Judged, goal: Goal, budget: float) -> Iterator[Outside]:
    """What an executed contour exceeds of its goal: errors and the assigned velocity."""
    for words, value, allowed in (
        ("largest contour error", judged.largest, budget),
        ("RMS contour error", judged.error.rms, goal.rms or np.inf),
    ):
        if value > allowed:
            said = f"its {words} is {value * 1e3:.5g} mm, and {allowed * 1e3:.5g} mm is allowed"
            yield Outside(move, said, "contour error", value, allowed)
    ratio = float(judged.speed.max())
    if ratio > 1 + SPEED_SLACK:
        said = f"its tool takes {ratio:.6g} times the velocity assigned where it is"
        yield Outside(move, said, "speed", ratio, 1 + SPEED_SLACK)


def _demands(whole: Whole, moves: Sequence[Span]) -> list[tuple[float, str, float]]:
    """Time, name and use of the acceleration limit where moves exceed it; empty if allowed."""
    robot, executed = whole.robot, whole.execution
    if robot.saturated or robot.bodies:
        return []
    low, high = robot.saturating()
    least, most = executed.demand_range
    ratio = float(np.maximum(least / low, most / high).max())
    if ratio <= 1 + SAME:
        return []
    share = np.maximum(executed.demand / high, executed.demand / low).max(axis=1)
    # Between results the largest one may be larger than at them.
    found = [(float(executed.t[np.argmax(share)]), "joint_acceleration", ratio)]
    for x in moves:
        first, last = np.searchsorted(executed.t, x.t)
        worst = float(share[first:last].max(initial=0.0))
        if worst > 1 + SAME:
            found.append((x.t[0], "joint_acceleration", worst))
    return found


def _settling_time(before: Sequence[Law], robot: Robot, near: float) -> float:
    """Time after the end of some laws until the tool stays near their end point [s].

    Args:
        before: All laws from the start of the program on.
        robot: The robot; with a box, the slowest of its corners counts.
        near: Largest distance from the end point [m].
    """
    approach = Approach.of(before, robot)
    plan = Trajectory(laws=approach.laws, method="approach")
    taught = robot.teach(plan)
    runs = [run(robot, taught)]
    if robot.box is not None:
        runs += [x for group in execute_over_box(robot, taught) for x in group.runs]
    goal = robot.arm.tool_position(plan(plan.duration, side="left"))
    far = [x.t[np.linalg.norm(x.tool - goal, axis=1) > near] for x in runs]
    return max([0.0, *(float(x[-1]) - plan.duration for x in far if len(x))])
