"""Ratios of a plan and its executions to limits and error budget, over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Literal

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import Path, ShapedPath
from armcontour.jobs.goal import Uncertainty
from armcontour.motion import (
    Execution,
    JointPath,
    PathLaw,
    SetPoints,
    Span,
    Trajectory,
    largest_shares,
)
from armcontour.motion.laws import chain_rule_motion
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.simulation import ServoSimulation
from armcontour.simulation import ServoPlant, simulate
from armcontour.simulation.plant import count_intervals
from armcontour.studies.certification.certification_case import Case
from armcontour.verification import Check, check
from armcontour.verification.contour_errors import ContourExecution, pieces_of

# Results per cycle in an execution of a trial on the nominal robot, and in corners of the box.
RESULTS_PER_CYCLE = 16
BOX_RESULTS_PER_CYCLE = 4
# Shortest time between two results [s].
SHORTEST_STEP = 1.25e-4
# Share by which the executed tool speed may exceed the assigned velocity.
SPEED_SLACK = 1e-3
# Number of directions perpendicular to a path in space. In each direction, the largest deviations
# over the robots of the box, due to each joint or each uncertain value, are summed.
DIRECTIONS = 16
# Ratio of ds² that is assigned to a command outside the joint range. A lower speed cannot correct
# such a command completely, but with this ratio each trial reduces the speed in its cell.
OUTSIDE_RATIO = 1.1
# Times that differ by less than this share of the cycle are equal.
PHASE_TOLERANCE = 1e-9
Side = Literal["left", "right"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitMargins:
    """Ratios of values to their limits on one contour, over time."""

    t: FloatArray  # Times from the start of the contour [s], (n,)
    s: FloatArray  # Arc lengths of the plan [m], (n,)
    joints: FloatArray  # Joint acceleration, the larger of planned and commanded, (n, dof)
    pace: FloatArray  # Speed of plan and command, as a ratio of ds², (n,)
    tool: FloatArray  # Squared speed of the executed tool, (n,)
    error: FloatArray  # Contour error of the nominal robot, (n,)
    box: FloatArray  # Contour error of the worst robot of the box, (n,); 0 without a box
    # peak: largest commanded acceleration, also between samples, (dof,).
    peak: FloatArray
    rms: float  # RMS contour error; 0 without a limit

    def worst(self) -> dict[str, float]:
        """Largest ratio over the contour, by kind of limit."""
        return {
            "acceleration": max(float(self.joints.max()), float(self.peak.max())),
            "speed": float(self.pace.max()),
            "tool": float(self.tool.max()),
            "error": max(float(self.error.max()), self.rms),
            "box": float(self.box.max()),
        }


# Deviation of the dead time that all joints share [s], and executions with this deviation in
# corners of the box.
Group = tuple[float, list[Execution]]


def execute_trial(case: Case, set_points: SetPoints, resolution: float | None = None) -> Execution:
    """Execute a trial on the nominal robot, without saturation."""
    every = min(set_points.cycle, max(set_points.cycle / RESULTS_PER_CYCLE, SHORTEST_STEP))
    return simulate(set_points, case.plant(ideal=True), resolution=resolution or every)


def execute_on_box(case: Case, set_points: SetPoints) -> list[Group]:
    """Execute in the corners of the box in which all joints have the same ends of their intervals.

    Returns one group per end of a shared dead time. The robots do not saturate, so that their
    commanded accelerations can be compared with the limits.
    """
    box, servo, dof = case.box, case.servo, case.arm.dof
    if box is None:
        return []
    errors = np.broadcast_to(box.dead_time, (dof,))
    shared = box.dead_time_shared and bool(errors.any())
    apart = np.zeros(dof) if box.dead_time_shared else errors
    resolution = max(set_points.cycle / BOX_RESULTS_PER_CYCLE, SHORTEST_STEP)
    groups = []
    for common in (-1.0, 1.0) if shared else (0.0,):
        moved = np.maximum(servo.dead_time + common * errors, 0.0)
        servos = _corner_servos(servo, moved, box, apart)
        plants = [case.plant(x, ideal=True) for x in servos]
        runs = [simulate(set_points, x, resolution=resolution) for x in plants]
        groups.append((float((moved - servo.dead_time)[0]) if shared else 0.0, runs))
    return groups


def contour_errors(piece: ContourExecution) -> FloatArray:
    """Contour error at each result, the larger of both directions [m], (n,)."""
    error = piece.contour_error
    over_time = np.maximum(piece.followed.distance, piece.followed.coverage_error)
    # A peak between two times is assigned to the nearer time.
    peak = int(np.argmin(np.abs(piece.t - error.t_max)))
    over_time[peak] = max(over_time[peak], error.max)
    return over_time


def speed_ratios(case: Case, piece: ContourExecution) -> FloatArray:
    """Ratio of executed tool speed to assigned velocity, (n,)."""
    return piece.speed_ratios(case.limits.speed, between=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class ProgramTrial:
    """A plan of the whole program with its executions on the robot and in corners of the box."""

    case: Case
    trajectory: Trajectory  # The plan of the whole program
    set_points: SetPoints
    executed: Execution  # Execution on the nominal robot
    pieces: Sequence[ContourExecution]  # Parts of this execution, one per contour
    groups: Sequence[Group] = ()  # Executions in corners of the box
    check: Check | None = None  # Check of the plan against all limits; None before the proof

    @property
    def all_runs(self) -> list[Execution]:
        """Executions on the nominal robot and in corners of the box."""
        return [self.executed, *(x for _, runs in self.groups for x in runs)]

    @cached_property
    def corner_pieces(self) -> list[tuple[float, list[Sequence[ContourExecution]]]]:
        """The groups, with each execution divided into one part per contour."""
        program = self.case.program
        return [
            (late, [pieces_of(x, program, None, None) for x in runs]) for late, runs in self.groups
        ]


def compute_margins(case: Case, trial: ProgramTrial, number: int, plan: Trajectory) -> LimitMargins:
    """Ratios to the limits for the plan, the command and the executions of a contour."""
    piece, span = trial.pieces[number], trial.trajectory.contour_spans[number]
    path, executed = piece.path, trial.executed
    now, since = slice(0, len(executed.t)), None
    if case.program.single_path is None:
        # The rating ends with the cycle in which the move ends.
        start, cycle = trial.set_points.start_time, trial.set_points.cycle
        last = start + np.ceil((span.t[1] - start) / cycle - PHASE_TOLERANCE) * cycle
        ends = span.t[0], float(last)
        now, since = slice(*np.searchsorted(executed.t, ends)), ends
    t = executed.t[now] - span.t[0]
    s, joints, pace = _planned_ratios(case, path, plan, t)
    pace = np.maximum(pace, _command_ratio(case, trial.set_points, executed.t[now]))
    peak = np.zeros(case.arm.dof)
    for execution in trial.all_runs:
        part = slice(*np.searchsorted(execution.t, since)) if since else slice(None)
        share = case.demand_ratio(execution.demand[part])
        joints = np.maximum(joints, _larger_neighbour(t + span.t[0], execution.t[part], share))
        peak = np.maximum(peak, peak_demand(case, execution, since))
    tool, speed = np.zeros(len(t)), case.limits.speed
    if speed is not None:
        moved = case.arm.tool_velocity(executed.q[now], executed.dq[now])
        tool = (np.linalg.norm(moved, axis=1) / (speed * (1 + SPEED_SLACK))) ** 2
    counts = slice(piece.which.start - now.start, piece.which.stop - now.start)
    tool[counts] = np.maximum(tool[counts], (speed_ratios(case, piece) / (1 + SPEED_SLACK)) ** 2)
    error, box = np.zeros(len(t)), np.zeros(len(t))
    error[counts] = contour_errors(piece) / case.budget
    if trial.groups:
        box[counts] = _worst_box_error(case, trial, number)[piece.which] / case.budget
    rms = case.goal.rms
    return LimitMargins(
        t=t,
        s=s,
        joints=joints,
        pace=pace,
        tool=tool,
        error=error,
        box=box,
        peak=peak,
        rms=0.0 if rms is None else piece.contour_error.rms / rms,
    )


def response_time(case: Case) -> float:
    """Time for which a command affects the commanded acceleration of the slowest joint [s]."""
    servo = case.servo
    return 2.0 / float((servo.kp if servo.kv is None else servo.kv).min())


def peak_demand(
    case: Case, executed: Execution, span: tuple[float, float] | None = None
) -> FloatArray:
    """Largest ratio of commanded acceleration to its limit, also between samples, (dof,).

    The execution must be without saturation. `span`: start and end time [s], by default the whole
    execution.
    """
    assert isinstance(executed.plant, ServoPlant)
    servo = executed.plant.servo
    every = np.asarray(case.demand_ratio(executed.demand_range).max(axis=0))
    if span is None or every.max() <= 1.0:
        return every
    set_points = executed.set_points
    begin, end = (np.array(span) - set_points.start_time) / set_points.cycle
    first = max(0, int(np.ceil(begin - PHASE_TOLERANCE)))
    last = min(count_intervals(set_points, servo), int(np.ceil(end - PHASE_TOLERANCE)))
    if first >= last:
        return case.demand_ratio(executed.demand[-1])
    row = first * round(set_points.cycle / float(executed.t[1] - executed.t[0]))
    held = executed.dq[row] if servo.kv is None else executed.ddq[row]
    held = np.where(servo.ki > 0, executed.demand[row], held)
    again = ServoSimulation(set_points.q, set_points.cycle, servo).run(
        first, last, executed.q[row], executed.dq[row], held=held
    )
    both = np.stack([again.lowest, again.highest])
    return np.asarray(case.demand_ratio(both).max(axis=0))


def _motion(plan: Trajectory, t: FloatArray, side: Side) -> tuple[FloatArray, FloatArray]:
    """Arc lengths of a plan [m], (n,), and its q, dq and ddq, (3, n, dof), at times t [s]."""
    s, states = np.empty(len(t)), np.empty((3, len(t), plan.dof))
    for k, mask, i, local in plan.locate(t, side):
        law = plan.laws[k]
        assert isinstance(law, PathLaw)
        along = law.path_motion(i, local)
        s[mask] = along[0]
        states[:, mask] = chain_rule_motion(law.joint_path, law.s[i + 1], along, (0, 1, 2))
    return s, states


def _planned_ratios(
    case: Case, path: Path, plan: Trajectory, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Arc lengths of the plan, (n,), ratios of joint acceleration, (n, dof), and of ds², (n,).

    Values on both sides of a vertex of the path are assigned to the nearest time.
    """
    s, joints, pace = _state_ratios(case, path, plan, np.clip(t, 0.0, plan.duration), "right")
    times = _break_times(plan, path.breaks)
    near = np.clip(np.searchsorted(t, times), 0, len(t) - 1)
    sides: tuple[Side, ...] = ("left", "right")
    for side in sides:
        _, ratios, faster = _state_ratios(case, path, plan, times, side)
        np.maximum.at(joints, near, ratios)
        np.maximum.at(pace, near, faster)
    return s, joints, pace


def _state_ratios(
    case: Case, path: Path, plan: Trajectory, t: FloatArray, side: Side
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Arc lengths, and ratios of joint acceleration and ds², at times t on one side of breaks."""
    limits = case.limits
    s, joints = _motion(plan, t, side)
    states = States(case.arm, tuple(joints))
    # ds² is proportional to squared velocities and to accelerations.
    pace = (states.use("joint_velocity", limits).ratio ** 2).max(axis=1)
    assigned = path.assigned_speeds(limits.speed, s, side=side)
    if np.isfinite(assigned).any():
        pace = np.maximum(pace, (states.measure("speed")[0] / assigned) ** 2)
    if limits.centripetal_acceleration is not None:
        pace = np.maximum(pace, states.use("centripetal_acceleration", limits).ratio)
    return s, states.use("joint_acceleration", limits).ratio, pace


def _break_times(plan: Trajectory, places: FloatArray) -> FloatArray:
    """Times at which a plan passes the arc lengths `places` that are breaks of its laws [s]."""
    times = [np.zeros(0)]
    for law, start in zip(plan.laws, plan.starts, strict=False):
        assert isinstance(law, PathLaw)
        k = np.clip(np.searchsorted(law.s, places), 0, len(law.s) - 1)
        times.append(start + law.breaks[k[np.abs(law.s[k] - places) < 1e-9]])
    return np.clip(np.unique(np.concatenate(times)), 0.0, plan.duration)


def _command_ratio(case: Case, set_points: SetPoints, t: FloatArray) -> FloatArray:
    """Ratio of ds² to its limit for the velocities of set-points at the times t, (n,)."""
    dof = case.arm.dof
    rate = np.append(np.diff(set_points.q, axis=0), np.zeros((1, dof)), axis=0) / set_points.cycle
    states = States(case.arm, (set_points.q, rate))
    pace = (states.use("joint_velocity", case.limits).ratio ** 2).max(axis=1)
    lower, upper = case.limits.joint_range(dof)
    outside = ((set_points.q < lower) | (set_points.q > upper)).any(axis=1)
    pace = np.maximum(pace, np.where(outside, OUTSIDE_RATIO, 0.0))
    k = np.clip(np.searchsorted(set_points.t, t, side="right") - 1, 0, len(pace) - 1)
    return np.asarray(pace[k])


def _larger_neighbour(t: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    """Larger of the values before and after each time t, (n, dof); 0 outside of `times`."""
    k = np.clip(np.searchsorted(times, t, side="right"), 1, len(times) - 1)
    larger = np.maximum(values[k - 1], values[k])
    larger[(t < times[0]) | (t > times[-1])] = 0.0
    return np.asarray(larger)


def _worst_box_error(case: Case, trial: ProgramTrial, number: int) -> FloatArray:
    """Approximate contour error of the worst robot of the box at all times of a trial [m], (n,).

    Joints are independent, so the worst deviations of the joints across the path are added.
    """
    t, span = trial.executed.t, trial.trajectory.contour_spans[number]
    largest = np.zeros(len(t))
    for delay, runs in trial.corner_pieces:
        pieces = [x[number] for x in runs]
        largest = np.maximum(largest, np.interp(t, *_sum_deviations(case, delay, pieces, span)))
        for piece in pieces:
            rows = np.clip(np.searchsorted(t, piece.t), 0, len(t) - 1)
            np.maximum.at(largest, rows, piece.followed.coverage_error)
    return largest


def _corner_servos(
    servo: ServoModel, dead_time: FloatArray, box: Uncertainty, apart: FloatArray
) -> list[ServoModel]:
    """Servos in the corners of the box in which all joints have the same ends."""
    # apart: largest deviation of the dead time of each joint [s], (dof,).
    gains = np.broadcast_to(np.asarray(box.gains), (2, len(dead_time)))
    signs = [
        (1.0, -1.0) if (x > 0).any() else (0.0,)
        for x in (gains[0], gains[1] if servo.kv is not None else np.zeros(1), apart)
    ]
    return [
        servo.replace(
            kp=servo.kp * (1 + p * gains[0]),
            kv=None if servo.kv is None else servo.kv * (1 + v * gains[1]),
            dead_time=np.maximum(dead_time + d * apart, 0.0),
        )
        for p, v, d in product(*signs)
    ]


def _sum_deviations(
    case: Case, delay: float, pieces: Sequence[ContourExecution], span: Span
) -> tuple[FloatArray, FloatArray]:
    """Times [s], and the sum of all joints' largest deviations across the path [m], (n,) each."""
    # The largest deviation of a joint is over the runs of `pieces`. delay: deviation of the shared
    # dead time [s].
    arm, path, plan = case.arm, pieces[0].path, span.trajectory
    assert plan is not None
    n = min(len(x.t) for x in pieces)
    t = pieces[0].t[:n]
    # An equal delay of all joints does not change the path of the tool.
    base = plan(np.clip(t - span.t[0] - delay, 0.0, plan.duration))
    if len(pieces) > 1:
        base = np.mean([x.q[:n] for x in pieces], axis=0)
    jacobian, point = arm.tool_jacobian(base), arm.tool_position(base)
    deviations = np.array([x.q[:n] - base for x in pieces])
    # Deviation of the tool due to each joint [m], (runs, n, dimension, dof).
    moved = jacobian[None] * deviations[:, :, None, :]
    s = path.project(point).s
    total = np.zeros(n)
    for direction in across_directions(path(s, 1)):
        # The distance of the mean motion adds to the deviations of the joints.
        distance = np.abs(np.einsum("nd,nd->n", point - path(s), direction))
        side = np.einsum("rndj,nd->rnj", moved, direction)
        total = np.maximum(total, distance + side.max(axis=0).sum(axis=1))
    return t, total


def across_directions(tangent: FloatArray) -> list[FloatArray]:
    """Unit vectors across the path at each tangent, (n, dimension) for each direction."""
    unit = tangent / np.linalg.norm(tangent, axis=1)[:, None]
    if unit.shape[1] == 2:
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        return [normal, -normal]
    flat = np.abs(unit).argmin(axis=1)
    first = np.cross(unit, np.eye(3)[flat])
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(unit, first)
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    return [np.cos(x) * first + np.sin(x) * second for x in angles]


# A limit is exceeded by a ratio above 1 + LIMIT_TOLERANCE, to allow for rounding errors.
LIMIT_TOLERANCE = 1e-9
# Number of points per interval at which a plan is checked against its limits.
CHECK_POINTS = 5


def largest_ratios(plan: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Largest ratio to each limit: the larger of a sampled check and a bound for all times."""
    ratios = bound_ratios(plan, arm, limits)
    for use in check(plan, arm, limits, points=CHECK_POINTS).uses:
        ratios[use.name] = max(ratios.get(use.name, 0.0), use.ratio)
    return ratios


def bound_ratios(plan: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Upper bounds of a plan's ratios to limits of acceleration and speed, valid at all times."""
    joints = np.stack([*limits.acceleration_bounds(arm.dof), *limits.velocity_bounds(arm.dof)])
    shares = np.zeros(6)
    for law in plan.laws:
        assert isinstance(law, PathLaw)
        speeds = _highest_speeds(law.joint_path, limits)
        shares = np.maximum(shares, largest_shares(law, joints, speeds, 1 + LIMIT_TOLERANCE))
    acceleration, velocity = shares[:4].reshape(2, 2).max(axis=1).tolist()
    speed, bent = shares[4:].tolist()
    return {
        "joint_acceleration": acceleration,
        "joint_velocity": velocity,
        "speed": speed,
        "centripetal_acceleration": bent**2,
    }


def _highest_speeds(joint_path: JointPath, limits: Limits) -> FloatArray:
    """Path speeds that the limits of speed and centripetal acceleration allow [m/s], (pieces, 2).

    The second column is infinite for segments with varying curvature, which the check samples.
    """
    breaks, path = joint_path.breaks, joint_path.tool_path
    bounds = np.full((len(breaks) - 1, 2), np.inf)
    if path is None:
        return bounds
    # Breaks of the tool path are breaks of the joint path.
    segment = path.locate((breaks[:-1] + breaks[1:]) / 2)
    bounds[:, 0] = path.assigned_speeds(limits.speed)[segment]
    varies = path.segments.is_transition[segment] | (
        isinstance(path, ShapedPath) and path.curve is not None
    )
    if limits.centripetal_acceleration is not None:
        bent = np.where(varies, 0.0, np.abs(path.curvatures[segment]))
        with np.errstate(divide="ignore"):
            bounds[:, 1] = np.sqrt(limits.centripetal_acceleration / bent)
    return bounds
