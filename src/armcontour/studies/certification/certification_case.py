"""The case of a certificate: a run with its robot, traced program and goal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armcontour.control.compensation import PolePlacement
from armcontour.control.compensation.compensator import unchecked_set_points
from armcontour.core.checks import FloatArray
from armcontour.core.progress import Progress
from armcontour.jobs.goal import CertificateGoal, Uncertainty
from armcontour.jobs.job import Job, Run
from armcontour.jobs.planned_run import Planned
from armcontour.motion import SetPoints, Trajectory
from armcontour.planning.program_tracing import Tracing
from armcontour.program import Program
from armcontour.robot import Arm, Limits
from armcontour.robot.servo import ServoModel
from armcontour.simulation import ServoPlant
from armcontour.verification.contour_errors import unexplained_errors

# Time between two results of the execution that proves a plan [s].
RESOLUTION = 1e-4
# Number of time constants of the slowest servo after which a response has decayed to 2e-9.
MEMORY_TIME_CONSTANTS = 20.0
# Largest number of points, in addition to breaks, at which the errors that the servo model does not
# explain are bounded.
MAX_POINTS = 1000


@dataclass(frozen=True, eq=False)
class Case:
    """A run to certify: its robot, its fastest plan, and the goal for all contours."""

    job: Job
    planned: Planned  # The plan of the run without derating
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
    def model(self) -> ServoModel:
        """The nominal servo, for which the compensation is computed."""
        return self.job.servo.for_joints(self.arm.dof)

    @cached_property
    def servo(self) -> ServoModel:
        """The servo of the plant, which executes the set-points."""
        return self.job.plant_servo.for_joints(self.arm.dof)

    @property
    def program(self) -> Program:
        """The program to plan."""
        return self.traced.program

    @property
    def box(self) -> Uncertainty | None:
        """Uncertainty of the robot; None without a box."""
        return self.goal.box

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
                s = np.union1d(path.breaks, np.linspace(0.0, path.tool_path.length, MAX_POINTS))
                tangent = path.tool_path(s, 1)
                _, across = unexplained_errors(self.arm, path(s), tangent, model_error)
                largest = max(largest, float(across.max()))
        return largest

    def plant(self, servo: ServoModel | None = None, *, ideal: bool = False) -> ServoPlant:
        """The plant with a servo, by default that of the case; if `ideal`, without saturation."""
        saturation = "none" if ideal else None
        return ServoPlant(self.arm, servo or self.servo, self.limits, saturation=saturation)

    @cached_property
    def demand_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Acceleration bounds of saturation [rad/s²], (dof,) each; infinite without saturation."""
        return self.servo.saturate(*self.limits.acceleration_bounds(self.arm.dof))

    def demand_ratio(self, commanded_acceleration: FloatArray) -> FloatArray:
        """Commanded accelerations divided by the bound of saturation in their direction."""
        low, high = self.demand_bounds
        return np.asarray(np.maximum(commanded_acceleration / low, commanded_acceleration / high))

    def compute_set_points(self, plan: Trajectory, cycle: float | None = None) -> SetPoints:
        """Set-points of a plan, by default with the cycle of the run [s]."""
        cycle = self.run.cycle if cycle is None else cycle
        return unchecked_set_points(
            plan, self.model, self.run.compensation, cycle=cycle, arm=self.arm
        )

    def move_set_points(
        self, set_points: SetPoints, t: tuple[float, float], plan: Trajectory
    ) -> SetPoints:
        """Set-points of the move from `t[0]` to `t[1]` in the program [s], in times of the move.

        They begin with the earlier set-points that affect the servo during the move.
        """
        begin, cycle, first = t[0] - self.memory, set_points.cycle, 0
        if begin > 0:
            rests = set_points.trajectory.starts
            rest = float(rests[np.searchsorted(rests, begin, side="right") - 1])
            rest -= float(self.servo.dead_time.max())
            first = max(int(np.floor((rest - set_points.start_time) / cycle)), 0)
        last = int(np.ceil((t[1] - set_points.start_time) / cycle)) + 1
        return SetPoints(
            cycle=cycle,
            q=set_points.q[first : max(last, first + 2)],
            trajectory=plan,
            method=set_points.method,
            start_time=min(set_points.start_time + first * cycle - t[0], 0.0),
        )

    @cached_property
    def memory(self) -> float:
        """Time after which a motion no longer affects servo or compensator [s]."""
        box, servo, dof = self.box, self.servo, self.arm.dof
        *gains, late = np.zeros((3, dof)) if box is None else box.half_widths(servo, dof)
        slow = servo.replace(
            kp=servo.kp * (1 - gains[0]), kv=None if servo.kv is None else servo.kv * (1 - gains[1])
        )
        rates = [slow.slowest]
        if servo.has_feedforward:
            # The compensation of feed-forward has a transient with these time constants.
            rates.append(1 / float(servo.lead[0].max()))
        options = self.run.compensation
        if isinstance(options, PolePlacement) and options.poles is not None:
            poles = np.asarray(options.poles, dtype=np.complex128)
            rates.append(float(np.abs(np.real(poles)).min()))
        return MEMORY_TIME_CONSTANTS / min(rates) + float((servo.dead_time + late).max())
