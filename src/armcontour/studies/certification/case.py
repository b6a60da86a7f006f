"""The case of a certificate (a run with its robot, traced program and goal), and its attempts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from armcontour.control.compensation.compensator import unchecked_set_points
from armcontour.core.checks import FloatArray
from armcontour.core.progress import Progress
from armcontour.jobs.certificate_goal import CertificateGoal
from armcontour.jobs.job import Job, Run
from armcontour.jobs.run_result import RunResult
from armcontour.motion import JointPath, SetPoints, Trajectory
from armcontour.planning import Optimal, intervals_of
from armcontour.planning.constraints import RapidSpeed
from armcontour.planning.program_timing import RAPID_INTERVALS, JoinedMoves
from armcontour.planning.program_tracing import TracedMove, Tracing
from armcontour.program import Program
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import use_of
from armcontour.robot.servo import ServoModel
from armcontour.simulation import ServoPlant
from armcontour.studies.certification.derating import Derating, largest_squares, plan_derated
from armcontour.verification.contour_errors import unexplained_errors

# Time between two results of the execution that proves a plan [s].
PROOF_RESOLUTION = 1e-4
# Largest number of points, in addition to breaks, at which the errors that the servo model does not
# explain are bounded.
MAX_ERROR_POINTS = 1000


@dataclass(frozen=True, eq=False)
class Case:
    """A run to certify: its robot, its fastest plan, and the goal for all contours."""

    job: Job
    planned: RunResult  # The plan of the run without derating
    goal: CertificateGoal
    servo_allowed: float  # Largest allowed contour error of the execution on all robots [m]
    progress: Progress  # Called with a step before each trial

    @property
    def run(self) -> Run:
        """The run, with the corner tolerance of this case."""
        return self.planned.run

    @property
    def traced(self) -> Tracing:
        """The program with its joint paths."""
        assert self.planned.traced is not None
        return self.planned.traced

    @property
    def arm(self) -> Arm:
        """The nominal arm."""
        return self.job.arm

    @cached_property
    def limits(self) -> Limits:
        """Limits with values per joint."""
        return self.run.limits.for_joints(self.arm.dof)

    @cached_property
    def servo(self) -> ServoModel:
        """The servo of the plant, which executes the set-points."""
        return self.job.plant_servo.for_joints(self.arm.dof)

    @property
    def program(self) -> Program:
        """The program to plan."""
        return self.traced.program

    @property
    def budget(self) -> float:
        """Largest allowed contour error of the simulated robots [m]."""
        return self.servo_allowed - self.model_error

    @cached_property
    def model_error(self) -> float:
        """Bound of the unexplained tool error across the contours, from the servo model [m]."""
        model_error = self.servo.model_error
        if model_error is None:
            return 0.0
        largest = 0.0
        for step in self.traced.steps:
            path = step.joint_path
            if path is not None and path.tool_path is not None and self.traced.is_contour(step):
                s = np.union1d(
                    path.breaks, np.linspace(0.0, path.tool_path.length, MAX_ERROR_POINTS)
                )
                tangent = path.tool_path(s, 1)
                _, across = unexplained_errors(self.arm, path(s), tangent, model_error)
                largest = max(largest, float(across.max()))
        return largest

    def plant(self, servo: ServoModel | None = None, *, ideal: bool = False) -> ServoPlant:
        """Build the plant with a servo, by default that of the case.

        - `ideal`: whether the drives never saturate.
        """
        saturation = "none" if ideal else None
        return ServoPlant(self.arm, servo or self.servo, self.limits, saturation=saturation)

    def with_run(self, **changes: Any) -> Case:
        """Copy with fields of the run replaced that do not change its fastest plan."""
        return replace(self, planned=replace(self.planned, run=replace(self.run, **changes)))

    def demand_ratio(self, commanded_acceleration: FloatArray) -> FloatArray:
        """Return commanded accelerations / the bound of saturation in their direction, (n, dof)."""
        bounds = self.servo.saturate(*self.limits.acceleration_bounds(self.arm.dof))
        return np.asarray(np.max([commanded_acceleration / x for x in bounds], axis=0))

    def command_ratios(self, set_points: SetPoints) -> FloatArray:
        """Return velocity ratios of set-points to limits, (n,); infinite outside joint ranges."""
        q = set_points.q
        lower, upper = self.limits.joint_range(self.arm.dof)
        rate = np.diff(q, axis=0, append=q[-1:]) / set_points.cycle
        ratio = use_of("joint_velocity", self.limits, rate).ratio.max(axis=1)
        return np.where(((q < lower) | (q > upper)).any(axis=1), np.inf, ratio)

    def compute_set_points(
        self, plan: Trajectory, cycle: float | None = None, *, saturates: bool = False
    ) -> SetPoints:
        """Compute the set-points of a plan, by default with the cycle of the run [s].

        - `saturates`: whether joints may saturate. Derating removes saturation where it is caused,
          so set-points of attempts do not bound joint accelerations.
        """
        return unchecked_set_points(
            plan,
            self.job.servo.for_joints(self.arm.dof),
            self.run.compensation,
            cycle=self.run.cycle if cycle is None else cycle,
            arm=self.arm,
            rule=self.job.rule(self.run, plan.limits_for(None)),
            saturates=saturates,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Move:
    """A contour or a rapid of an attempt: its derating and its plan."""

    step: TracedMove
    number: int | None  # Index of the contour; None for a rapid
    joint_path: JointPath
    limits: Limits  # Limits of the arm; those of the joints for a rapid
    options: Optimal
    derating: Derating
    plan: Trajectory  # Its times start at 0 [s]
    fastest: Trajectory  # The plan without derating
    pause: float = 0.0  # Standstill before the move [s]
    trials: int = 1  # Number of plans

    @classmethod
    def without_derating(cls, case: Case, step: TracedMove, number: int | None) -> Self:
        """Plan a move as fast as possible.

        - `number`: index of the contour; None for a rapid.
        """
        path = step.joint_path
        speed = case.program.rapid_speed
        arm = case.arm
        assert path is not None
        limits = case.limits
        options = Optimal(intervals=intervals_of(case.program))
        if number is None:
            limits = limits.of_joints
            options = Optimal(intervals=RAPID_INTERVALS)
            if speed is not None and path.tool_path is None:
                options = replace(options, constraints=(RapidSpeed(speed, arm),))
        derating = Derating.nothing(path, options.intervals)
        plan = plan_derated(path, arm, limits, derating, options)
        return cls(
            step=step,
            number=number,
            joint_path=path,
            limits=limits,
            options=options,
            derating=derating,
            plan=plan,
            fastest=plan,
        )

    def derated(self, arm: Arm, derating: Derating) -> Self:
        """Plan the move again, within derated limits."""
        plan = plan_derated(self.joint_path, arm, self.limits, derating, self.options)
        return replace(self, derating=derating, plan=plan, trials=self.trials + 1)

    def slowed(self, factor: float) -> Self:
        """Slow the fastest plan down evenly, to `factor` times its duration."""
        rate = 1 / factor
        derating = Derating.nothing(self.joint_path, self.options.intervals)
        squares = largest_squares(self.fastest, derating.cells)
        derating = derating.with_cap(squares * rate**2, "even")
        derating = derating.with_share(np.full_like(derating.share, rate**2), "even")
        plan = replace(self.fastest, laws=tuple(x.stretched(rate) for x in self.fastest.laws))
        return replace(self, derating=derating, plan=plan, trials=self.trials + 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Attempt:
    """A plan of the whole program with its set-points."""

    moves: tuple[Move, ...]
    trajectory: Trajectory
    set_points: SetPoints

    @classmethod
    def joined(cls, case: Case, moves: Sequence[Move]) -> Self:
        """Join the plans of all moves, and compensate them."""
        joined = JoinedMoves(case.traced, case.arm)
        following = iter(moves)
        for step in case.traced.steps:
            plan = None
            if step.joint_path is not None:
                move = next(following)
                plan = move.plan
                if move.pause > 0:
                    joined.add_dwell(move.pause)
            joined.add(step, plan)
        trajectory = joined.trajectory().limited(case.limits)
        set_points = case.compute_set_points(trajectory)
        return cls(moves=tuple(moves), trajectory=trajectory, set_points=set_points)

    @property
    def contours(self) -> tuple[Move, ...]:
        """The contours, in program order."""
        return tuple(x for x in self.moves if x.number is not None)
