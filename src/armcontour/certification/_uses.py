"""How far a plan and its execution use what they are given, at every time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.arms.limit_use import States
from armcontour.compensation.compensator import teach
from armcontour.evaluation.error_profile import ErrorProfile, Missed
from armcontour.evaluation.pieces import Piece, evaluated_times
from armcontour.execution import Plant, RigidBodyPlant, ServoPlant, execute
from armcontour.execution.plant import count_intervals
from armcontour.execution.rigid_body_plant import STEP
from armcontour.geometry import Path
from armcontour.jobs.job import Run
from armcontour.motion import (
    Execution,
    PathLaw,
    TaughtData,
    Trajectory,
)
from armcontour.motion.laws import join_path
from armcontour.program import Contour, Program
from armcontour.robustness.box import Box
from armcontour.robustness.deviations import Worst
from armcontour.robustness.monte_carlo import Spread, spread, worst_corner
from armcontour.servo import ServoModel
from armcontour.servo.simulation import Simulation

# Executions are looked at this often per command interval, but not more often than this [s].
PER_INTERVAL = 16
FINEST = 1.25e-4
# The same for executions in the corners of a box.
BOX_PER_INTERVAL = 4
# The tool speed of an execution may exceed the velocity assigned at its place by this share of it.
SPEED_SLACK = 1e-3
# A plan that is kept was judged at this resolution [s].
RESOLUTION = 1e-4
# Keys of an experiment that say how the robot's drives work.
DRIVE_OPTIONS = ("step", "gravity_feedforward", "noise", "seed")
# Directions across the path in which errors over a box are added up, in space.
DIRECTIONS = 16
# Penalty ratio for a command outside the joint range: slowing down cannot correct it completely,
# but each round of the search reduces the speed there.
OUTSIDE = 1.1
# Shares of limits, and phases of a command interval, that differ by less than this are the same.
SAME = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """What is the same for all moves of a program: the robot, and how it is taught.

    Args:
        arm: The arm.
        limits: With values per joint.
        model: The servo that compensation knows.
        servo: The servo that executes.
        saturated: Whether it may saturate.
        box: How far the robot may be from its model.
        run: The run: its method of compensation and command interval.
        bodies: Whether it is rigid bodies that execute, and not servos of single joints.
    """

    arm: Arm
    limits: Limits
    model: ServoModel
    servo: ServoModel
    saturated: bool
    box: Box | None
    run: Run
    bodies: bool = False

    @property
    def drive_options(self) -> dict[str, Any]:
        """Options of rigid bodies that the run's experiment gives, and a box does not."""
        experiment = self.run.experiment
        if experiment is None:
            return {}
        return {name: getattr(experiment, name) for name in DRIVE_OPTIONS}

    @property
    def resolution(self) -> float:
        """Time between two results of an execution that judges [s]: bodies have none between."""
        if not self.bodies:
            return RESOLUTION
        return max(RESOLUTION, float(self.drive_options.get("step", STEP)))

    def plant(self, servo: ServoModel | None = None, *, ideal: bool = False) -> Plant:
        """The robot, or one that never saturates."""
        if self.bodies:
            return RigidBodyPlant(self.arm, servo or self.servo, self.limits, **self.drive_options)
        saturation = "none" if ideal else None
        return ServoPlant(self.arm, servo or self.servo, self.limits, saturation=saturation)

    def saturating(self) -> tuple[FloatArray, FloatArray]:
        """Accelerations at which the drives saturate [rad/s²], (dof,) each; infinite without."""
        return self.servo.saturate(*self.limits.acceleration_bounds(self.arm.dof))

    def teach(self, plan: Trajectory, period: float | None = None) -> TaughtData:
        """Taught data of a plan, every `period` or command interval of the run [s]."""
        period = self.run.period if period is None else period
        return teach(plan, self.model, self.run.compensation, period=period, arm=self.arm)


def work_on(program: Program, contour: Contour) -> tuple[float, float] | None:
    """Between which places of a contour errors count [m]; None is at all times, as in `evaluate`.

    Args:
        program: The program.
        contour: One of its contours.
    """
    return contour.at_work if program.single_path is None else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting(Robot):
    """What is fixed while the plan of one contour is searched for.

    Args:
        path: The tool path, rounded.
        work: Between which places of the path errors count [m]; None is at all times, from the
            first set-point until rest.
        budget: Largest contour error, over the box if there is one [m].
        rms: Its largest root mean square, without the box [m].
    """

    path: Path
    work: tuple[float, float] | None
    budget: float
    rms: float | None

    def window(self, plan: Trajectory) -> tuple[float, float] | None:
        """Between which times of the plan of the contour errors count [s]; None is all times."""
        if self.work is None:
            return None
        begin, end = plan.time_at(self.work).tolist()
        return begin, end

    def judge(self, executed: Execution) -> Judged:
        """Judge the tool of an execution while errors count."""
        which, until, rms_until = self.judged(executed)
        n = len(executed.t)
        work = (0.0, self.path.length) if self.work is None else self.work
        piece = Piece(
            executed=executed,
            path=self.path,
            objective=None,
            which=which,
            until=until,
            rms_until=rms_until,
            beyond=n,
            work=work,
        )
        # Rigid bodies are looked at in every cycle of their drives.
        return judge_piece(piece, self.limits.speed, between=not self.bodies)

    def execute_corners(self, taught: TaughtData) -> Spread:
        """Taught data in the corners of the box."""
        since, until = self.window(taught.trajectory) or (None, None)
        own = taught, self.path, self.arm, self.servo, self.limits
        assert self.box is not None
        return worst_corner(*own, self.box, since=since, until=until)

    def execute_drawn(self, taught: TaughtData, samples: int, seed: int) -> Spread:
        """Taught data on so many robots drawn from the box."""
        since, until = self.window(taught.trajectory) or (None, None)
        own = taught, self.path, self.arm, self.servo, self.limits
        assert self.box is not None
        return spread(
            *own,
            self.box,
            samples=samples,
            seed=seed,
            since=since,
            until=until,
        )

    def judged(self, executed: Execution) -> tuple[slice, float, float]:
        """Samples of an execution whose errors count, and ends of errors and of their RMS [s]."""
        plan = executed.taught.trajectory
        t, window = executed.t, self.window(plan)
        if window is None:
            return slice(0, len(t)), *evaluated_times(executed, None)
        begin, end = (int(x) for x in np.searchsorted(t, window))
        # One result at least, however short the contour is.
        return slice(min(begin, len(t) - 2), max(end, begin + 2)), window[1], window[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judged:
    """What the tool of an execution does on a contour while errors count.

    Args:
        error: Distance from the tool to the path.
        missed: Largest distance from the path to the tool.
        over_time: The larger of both at each of those times [m], (n,).
        missed_over_time: The latter alone [m], (n,); -1 where it cannot be the largest.
        speed: Tool speed over the velocity assigned at its place, bounded between times too, (n,).
    """

    error: ErrorProfile
    missed: Missed
    over_time: FloatArray
    missed_over_time: FloatArray
    speed: FloatArray

    @property
    def largest(self) -> float:
        """The larger one of the largest distances of both directions [m]."""
        return max(self.error.max, self.missed.max)


def judge_piece(piece: Piece, limit: float | None, *, between: bool = True) -> Judged:
    """Judge a piece of an execution.

    Args:
        piece: The piece.
        limit: The assigned velocity of the whole path [m/s]; None without one.
        between: Whether the tool speed is bounded between the times of the execution, too.
    """
    error, over_time = piece.contour_error, np.maximum(piece.found.distance, piece.found.missed)
    # A peak between two times counts for the nearer one.
    peak = int(np.argmin(np.abs(piece.t - error.t_max)))
    over_time[peak] = max(over_time[peak], error.max)
    return Judged(
        error=error,
        missed=piece.missed,
        over_time=over_time,
        missed_over_time=piece.found.missed,
        speed=piece.speed_shares(limit, between=between),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uses:
    """Shares of what is allowed, over time; 1 is all of it.

    Args:
        t: Times [s], (n,).
        s: Where the plan is then [m], (n,).
        joints: Of the joints' acceleration limits, the larger one of plan and demand, (n, dof).
        pace: Of what bounds the speed of the plan and of its command, as a ratio of ds², (n,).
        tool: Of the executed tool's speed, as a ratio of squared speeds, (n,).
        error: Of the budget, (n,).
        box: Of the budget, estimated for the worst robot of the box, (n,); None without a box.
        peak: Largest demands over their limits at any time, (dof,); 0 where saturation is allowed.
        rms: RMS contour error over its largest; 0 without one.
        largest: Largest contour error, of both directions [m].
        linear: What the linear model of rigid bodies says of the box; None of servos.
    """

    t: FloatArray
    s: FloatArray
    joints: FloatArray
    pace: FloatArray
    tool: FloatArray
    error: FloatArray
    box: FloatArray | None
    peak: FloatArray
    rms: float
    largest: float
    linear: Worst | None = None

    def worst(self) -> dict[str, float]:
        """The largest of each."""
        return {
            "acceleration": max(float(self.joints.max()), float(self.peak.max())),
            "speed": float(self.pace.max()),
            "tool": float(self.tool.max()),
            "error": max(float(self.error.max()), self.rms),
            "box": 0.0 if self.box is None else float(self.box.max()),
        }

    def raised(self, t: FloatArray, *, tool: FloatArray, error: FloatArray) -> Uses:
        """The uses, raised to what an execution that was looked at more closely has.

        Args:
            t: Times of that execution [s], (m,).
            tool: Its use of the tool's speed, as a ratio of squared speeds, (m,).
            error: Its use of the budget, (m,).
        """
        after = np.clip(np.searchsorted(self.t, t), 0, len(self.t) - 1)
        found = self.tool.copy(), self.error.copy()
        for own, seen in zip(found, (tool, error), strict=True):
            for near in (after, np.maximum(after - 1, 0)):
                np.maximum.at(own, near, seen)
        return replace(self, tool=found[0], error=found[1])


def run(robot: Robot, taught: TaughtData, resolution: float | None = None) -> Execution:
    """Execute on the robot; on one that never saturates where saturation is refused."""
    every = min(taught.period, max(taught.period / PER_INTERVAL, FINEST))
    plant = robot.plant(ideal=not robot.saturated)
    return execute(taught, plant, resolution=resolution or every)


def uses_of(setting: Setting, taught: TaughtData, executed: Execution) -> Uses:
    """The uses of a plan, its command and its execution.

    Of a contour of a program, from the time on at which the contour starts: what comes before is
    executed, and used by another move.
    """
    plan = taught.trajectory
    t = executed.t
    low, high = setting.saturating()
    s, planned, pace = planned_uses(setting, plan, t)
    groups = [] if setting.box is None else execute_over_box(setting, taught)
    joints, peak = planned, np.zeros(setting.arm.dof)
    if not setting.saturated:
        robots = [(setting.servo, executed)]
        robots += [x for group in groups for x in zip(group.servos, group.runs, strict=True)]
        for servo, x in robots:
            asked = np.maximum(x.demand / high, x.demand / low)
            joints = np.maximum(joints, _at(t, x.t, asked))
            least, most = peak_demands(x, servo, since=0.0 if setting.work else None)
            peak = np.maximum(peak, np.maximum(least / low, most / high))
    pace = np.maximum(pace, command_use(setting, taught, t))
    tool, speed = np.zeros(len(t)), setting.limits.speed
    if speed is not None:
        tool = (executed.tool_speed / (speed * (1 + SPEED_SLACK))) ** 2
    counts, *_ = setting.judged(executed)
    judged = setting.judge(executed)
    tool[counts] = np.maximum(tool[counts], (judged.speed / (1 + SPEED_SLACK)) ** 2)
    now = slice(0 if setting.work is None else int(np.searchsorted(t, 0.0)), len(t))
    error, worst = np.zeros(len(t)), None
    error[counts] = judged.over_time / setting.budget
    if groups:
        worst = np.zeros(len(t))
        worst[counts] = _worst(setting, groups, taught, t)[counts] / setting.budget
        worst = worst[now]
    return Uses(
        t=t[now],
        s=s[now],
        joints=joints[now],
        pace=pace[now],
        tool=tool[now],
        error=error[now],
        box=worst,
        peak=peak,
        rms=0.0 if setting.rms is None else judged.error.rms / setting.rms,
        largest=judged.largest,
    )


def peak_demands(
    executed: Execution, servo: ServoModel, since: float | None
) -> tuple[FloatArray, FloatArray]:
    """The lowest and the highest demand of every joint at any time, (dof,) each [rad/s²].

    Args:
        executed: On a plant that never saturates.
        servo: Its servo.
        since: The demand counts from the first set-point at or after this time on [s]; None is from
            the start.
    """
    taught = executed.taught
    if since is None:
        return executed.demand_range[0], executed.demand_range[1]
    begin = max(0, int(np.ceil((since - taught.start_time) / taught.period - SAME)))
    end = count_intervals(taught, servo)
    if begin >= end:
        return executed.demand[-1], executed.demand[-1]
    row = begin * round(taught.period / float(executed.t[1] - executed.t[0]))
    held = executed.dq[row] if servo.kv is None else executed.ddq[row]
    held = np.where(servo.ki > 0, executed.demand[row], held)
    again = Simulation(taught.q, taught.period, servo).run(
        begin, end, executed.q[row], executed.dq[row], held=held
    )
    return again.lowest, again.highest


def motion(
    plan: Trajectory, t: FloatArray, side: Literal["left", "right"]
) -> tuple[FloatArray, FloatArray]:
    """Where a plan along a joint path is at some times [m], (n,), and q, dq, ddq, (3, n, dof).

    All at once: its way is what takes long to find.
    """
    s, states = np.empty(len(t)), np.empty((3, len(t), plan.dof))
    for k, here, i, local in plan.locate(t, side):
        law = plan.laws[k]
        assert isinstance(law, PathLaw)
        along = law.path_motion(i, local)
        s[here] = along[0]
        states[:, here] = join_path(law.joint_path, law.s[i + 1], along, (0, 1, 2))
    return s, states


def planned_uses(
    setting: Setting, plan: Trajectory, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where the plan is, (n,), shares of acceleration limits, (n, dof), and of ds², (n,).

    What a plan has on either side of a joint between segments counts for the time next to it.
    """
    s, joints, pace = _states(setting, plan, np.clip(t, 0.0, plan.duration), "right")
    at = _passing(plan, setting.path.breaks)
    near = np.clip(np.searchsorted(t, at), 0, len(t) - 1)
    sides: tuple[Literal["left", "right"], ...] = ("left", "right")
    for side in sides:
        _, more, faster = _states(setting, plan, at, side)
        np.maximum.at(joints, near, more)
        np.maximum.at(pace, near, faster)
    return s, joints, pace


def _states(
    setting: Setting, plan: Trajectory, t: FloatArray, side: Literal["left", "right"]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    limits = setting.limits
    s, joints = motion(plan, t, side)
    states = States(setting.arm, tuple(joints))
    # Of ds² a velocity takes the square of its share, an acceleration its share.
    pace = (states.use("joint_velocity", limits).ratio ** 2).max(axis=1)
    here = assigned_speeds(setting, s, side)
    if np.isfinite(here).any():
        pace = np.maximum(pace, (states.bound("speed")[0] / here) ** 2)
    if limits.centripetal_acceleration is not None:
        pace = np.maximum(pace, states.use("centripetal_acceleration", limits).ratio)
    return s, states.use("joint_acceleration", limits).ratio, pace


def assigned_speeds(
    setting: Setting, s: FloatArray, side: Literal["left", "right"] = "right"
) -> FloatArray:
    """Velocities that are assigned at places of the path [m/s], infinite where none is, (n,)."""
    path, most = setting.path, setting.limits.speed
    own = np.fmin(path.speeds, np.inf if most is None else most)
    here = own[path.locate(np.clip(s, 0.0, path.length), side=side)]
    return np.where(np.isnan(here), np.inf, here)


def _passing(plan: Trajectory, places: FloatArray) -> FloatArray:
    """When a plan passes the joints between segments that are breaks of it [s]."""
    times = [np.zeros(0)]
    for law, start in zip(plan.laws, plan.starts, strict=False):
        assert isinstance(law, PathLaw)
        k = np.clip(np.searchsorted(law.s, places), 0, len(law.s) - 1)
        times.append(start + law.breaks[k[np.abs(law.s[k] - places) < 1e-9]])
    return np.clip(np.unique(np.concatenate(times)), 0.0, plan.duration)


def command_use(setting: Setting, taught: TaughtData, t: FloatArray) -> FloatArray:
    """The share of what bounds ds² that set-points take, at the times `t`, (n,)."""
    dof = setting.arm.dof
    rate = np.append(np.diff(taught.q, axis=0), np.zeros((1, dof)), axis=0) / taught.period
    states = States(setting.arm, (taught.q, rate))
    pace = (states.use("joint_velocity", setting.limits).ratio ** 2).max(axis=1)
    lower, upper = setting.limits.joint_range(dof)
    outside = ((taught.q < lower) | (taught.q > upper)).any(axis=1)
    pace = np.maximum(pace, np.where(outside, OUTSIDE, 0.0))
    k = np.clip(np.searchsorted(taught.t, t, side="right") - 1, 0, len(pace) - 1)
    return np.asarray(pace[k])


@dataclass(frozen=True, slots=True)
class _Group:
    """Executions in corners of the box, all joints in the same one, and how late they all are."""

    servos: list[ServoModel]
    runs: list[Execution]
    late: float


def execute_over_box(setting: Robot, taught: TaughtData) -> list[_Group]:
    """Executions in the corners of the box; a group for either end of a shared dead time.

    Where saturation is refused they do not saturate: what they ask for is a use like others.
    """
    box, servo, arm = setting.box, setting.servo.for_joints(setting.arm.dof), setting.arm
    assert box is not None
    late = np.broadcast_to(box.dead_time, (arm.dof,))
    shared = box.dead_time_shared and bool(late.any())
    apart = np.zeros(arm.dof) if box.dead_time_shared else late
    resolution = max(taught.period / BOX_PER_INTERVAL, FINEST)
    found = []
    for common in (-1.0, 1.0) if shared else (0.0,):
        moved = np.maximum(servo.dead_time + common * late, 0.0)
        servos = _variants(servo, moved, box, apart)
        plants = [setting.plant(x, ideal=not setting.saturated) for x in servos]
        runs = [execute(taught, x, resolution=resolution) for x in plants]
        found.append(_Group(servos, runs, float((moved - servo.dead_time)[0]) if shared else 0.0))
    return found


def _at(t: FloatArray, given: FloatArray, values: FloatArray) -> FloatArray:
    """Values at other times: the larger of the two given ones around each, 0 outside, (n, dof)."""
    k = np.clip(np.searchsorted(given, t, side="right"), 1, len(given) - 1)
    found = np.maximum(values[k - 1], values[k])
    found[(t < given[0]) | (t > given[-1])] = 0.0
    return np.asarray(found)


def _worst(setting: Setting, groups: list[_Group], taught: TaughtData, t: FloatArray) -> FloatArray:
    """Contour error of the worst robot of the box, about, at all times [m], (n,).

    Joints are independent of each other: what each does across the path in its own corner of the
    box is added up for the worst, joint by joint. Payload and jitter are not in it.
    """
    found = [np.interp(t, *_across(setting, x, taught)) for x in groups]
    return np.asarray(np.max(found + _left_out(setting, groups, t), axis=0))


def _left_out(setting: Setting, groups: list[_Group], t: FloatArray) -> list[FloatArray]:
    """Distances from the path to the tool of the executions over the box, at times [m], (n,)."""
    found = []
    for x in (run for group in groups for run in group.runs):
        off = np.zeros(len(t))
        counts, *_ = setting.judged(x)
        times = np.clip(np.searchsorted(t, x.t[counts]), 0, len(t) - 1)
        np.maximum.at(off, times, setting.judge(x).missed_over_time)
        found.append(off)
    return found


def _variants(
    servo: ServoModel, dead_time: FloatArray, box: Box, apart: FloatArray
) -> list[ServoModel]:
    """Servos in the corners of the box, all joints in the same."""
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


def _across(setting: Setting, group: _Group, taught: TaughtData) -> tuple[FloatArray, FloatArray]:
    """Times, and the largest sum over the joints of what any of the runs moves them across."""
    arm, plan, runs = setting.arm, taught.trajectory, group.runs
    n = min(len(x.t) for x in runs)
    t = runs[0].t[:n]
    # All joints late by the same leave the path as it is.
    base = plan(np.clip(t - group.late, 0.0, plan.duration))
    if len(runs) > 1:
        base = np.mean([x.q[:n] for x in runs], axis=0)
    jacobian = arm.tool_jacobian(base)
    off = np.array([x.q[:n] - base for x in runs])
    # (runs, n, dimension, dof): what each joint's error does to the tool.
    moved = jacobian[None] * off[:, :, None, :]
    nearest = setting.path.project(arm.tool_position(base))
    tangent = setting.path(nearest.s, 1)
    total = np.zeros(n)
    for direction in _normals(tangent):
        # The centre's own distance adds to what the joints do.
        own = np.abs(
            np.einsum("nd,nd->n", arm.tool_position(base) - setting.path(nearest.s), direction)
        )
        side = np.einsum("rndj,nd->rnj", moved, direction)
        total = np.maximum(total, own + side.max(axis=0).sum(axis=1))
    return t, total


def _normals(tangent: FloatArray) -> list[FloatArray]:
    """Directions across the path at every place, (n, dimension) each."""
    unit = tangent / np.linalg.norm(tangent, axis=1)[:, None]
    if unit.shape[1] == 2:
        left = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        return [left, -left]
    flat = np.abs(unit).argmin(axis=1)
    first = np.cross(unit, np.eye(3)[flat])
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(unit, first)
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    return [np.cos(x) * first + np.sin(x) * second for x in angles]
