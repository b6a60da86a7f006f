"""Contour errors of set-points on robots with uncertain parameters: Monte Carlo and corners."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import ExecutionError, InvalidInput
from armcontour.core.fields import Checked, checked
from armcontour.core.quantities import AtLeast, Interval, Seed, Time, Workers
from armcontour.core.render import Result
from armcontour.core.result import VERDICT, Data, Row
from armcontour.core.text import short_repr
from armcontour.geometry import Path, angle_between
from armcontour.geometry.biarcs import draw_arcs
from armcontour.geometry.projection import pack_arcs
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.motion import SetPoints
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.serial import ChainArm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import GAINS
from armcontour.robot.servo.simulation import (
    CUBIC,
    STRAIGHT,
    add_integrator_pieces,
    command_polynomials,
    polynomials,
)
from armcontour.simulation.robustness.kernels import (
    Clock,
    Sample,
    SearchedPath,
    Setting,
    simulate_sample,
)
from armcontour.simulation.robustness.uncertainty import Uncertainty

# Longest time between two samples of the contour error: RESOLUTION [s], but at most TIME_CONSTANTS
# times the shortest time constant of the servos. The RMS error of the paper's job then differs by
# less than 1e-4 from samples every 0.1 ms.
RESOLUTION = 2e-3
TIME_CONSTANTS = 0.5
# Largest number of results per cycle; a servo that requires more is not realistic.
MAX_RESULTS = 1e5
# Largest number of corners that are executed, 2^10.
MAX_CORNERS = 1024
# Largest times by which the tool can be behind and ahead of the plan [lags, see `_longest_lag`].
LAGS_BEHIND = 2.0
LAGS_AHEAD = 1.0
# Number of times at which the planned arc length is computed: PLACES_PER_CYCLE for each cycle, but
# at least FEWEST_PLACES.
PLACES_PER_CYCLE = 2
FEWEST_PLACES = 4000
# Longest time until rest after the last set-point, as in `ServoPlant` [s].
LONGEST_SETTLING = 60.0
# Number of samples per task of a thread.
BATCH_SIZE = 32
# Largest number of parameters of the worst robot in a summary.
MAX_NAMED = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MonteCarloResult(Result, Checked):
    """Contour errors of many executions of the same set-points.

    Args:
        max: Largest contour error of each execution [m], (n,).
        rms: RMS over time of the contour error of each execution [m], (n,).
        end_time: End of the time over which `rms` is computed [s], (n,).
        saturated: Largest share of this time in which a joint is saturated, (n,).
        demand_ratio: Largest ratio of the demanded acceleration of a joint to the limit in its
            direction, (n,).
        kp, kv: Gains [1/s], (n, dof); kv is None for a servo of order "first".
        dead_time: Dead times [s], (n, dof).
        payload: Error of the payload's mass [kg], (n,).
        seed: Seed of the random numbers; None for corners of the box.
        names: Names of the varying parameters, without jitter.
        deviations: Errors of these parameters (relative, in s or in kg), (n, len(names)).
        nominal_max, nominal_rms: Largest and RMS contour error of the nominal robot [m].
    """

    max: FloatArray
    rms: FloatArray
    end_time: FloatArray
    saturated: FloatArray
    demand_ratio: FloatArray
    kp: FloatArray
    kv: FloatArray | None
    dead_time: FloatArray
    payload: FloatArray
    seed: int | None
    names: tuple[str, ...]
    deviations: FloatArray
    nominal_max: float
    nominal_rms: float

    def to_data(self) -> Data:
        """Data of the contour errors of the robots, and of the parameters of the worst robot."""
        drawn = "corners of the box" if self.seed is None else f"drawn robots (seed {self.seed})"
        worst = self.worst_deviations
        largest = sorted(worst, key=lambda x: -abs(worst[x]))[:MAX_NAMED]
        demand = self.demand_ratio.max()
        robot = ", ".join(f"{x} {worst[x]:+.3g}" for x in largest)
        return Data(
            f"{len(self)} {drawn}",
            (
                Row("executions", len(self)),
                Row("seed", self.seed),
                Row("max", self.max.max(), "m", "contour error, largest", robot, VERDICT),
                Row("quantile_95", self.quantile(0.95), "m", "contour error, in 95 % of them"),
                Row("rms", self.rms.max(), "m", "contour error, RMS, largest"),
                Row("saturated", self.saturated.max(), "1", "saturated"),
                Row("demand_ratio", demand, "1", "demand of the limit", level=VERDICT),
                Row("worst", worst),
                Row("nominal.max", self.nominal_max, "m", "nominal robot, largest"),
                Row("nominal.rms", self.nominal_rms, "m", "nominal robot, RMS"),
            ),
        )

    __repr__ = short_repr

    def __len__(self) -> int:
        """Number of executions."""
        return len(self.max)

    @property
    def worst(self) -> int:
        """Index of the execution with the largest contour error."""
        return int(np.argmax(self.max))

    @property
    def worst_deviations(self) -> dict[str, float]:
        """Errors of the parameters in the worst execution, by name."""
        return dict(zip(self.names, self.deviations[self.worst].tolist(), strict=True))

    def servo(self, i: int, like: ServoModel) -> ServoModel:
        """The servo of execution i, with the other parameters of the servo `like`."""
        return like.replace(
            kp=self.kp[i],
            kv=None if self.kv is None else self.kv[i],
            dead_time=self.dead_time[i],
        )

    def quantile(self, fraction: float) -> float:
        """Contour error that this fraction of the executions does not exceed [m]."""
        return float(np.quantile(self.max, fraction, method="higher"))

    def within(self, budget: float) -> float:
        """Fraction of the executions whose largest contour error is at most `budget` [m]."""
        return float(np.mean(self.max <= budget))


@checked
def spread(
    set_points: SetPoints,
    path: Path,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None,
    box: Uncertainty,
    *,
    samples: Annotated[int, AtLeast(1, 10**7)] = 1000,
    seed: Seed = 0,
    since: Time | None = None,
    end_time: Interval | None = None,
    threads: Workers | None = None,
) -> MonteCarloResult:
    """Execute set-points on robots with random errors (Monte Carlo), with independent servos.

    The model is that of `ServoPlant`. The random numbers of sample i do not depend on the number of
    samples or on the varying parameters.

    Args:
        set_points: The set-points.
        path: The path that the tool must follow.
        arm: A planar two-link arm or a serial arm; with masses if the payload varies.
        servo: The nominal servo, in the middle of the box.
        limits: Limits with the joint accelerations at which drives saturate, instead of the limits
            of the plan.
        box: Ranges of the errors of the parameters.
        samples: Number of executions.
        seed: Seed of the random numbers.
        since: Start of the evaluation of contour errors [s]; by default the time of the first
            set-point. Set-points of one contour of a program can begin earlier, with the lead-in.
        end_time: End of the evaluation [s]; by default when the planned motion has ended and the
            tool is at rest.
        threads: Number of threads; by default the number of processors.

    Raises:
        InvalidInput: Box, servo, path or set-points do not fit the arm, or there are too many
            samples for the memory.
        ExecutionError: A joint cannot be simulated with its gains.
    """
    checks.check_count(
        f"The spread over {samples} samples", samples * (3 * arm.dof + 1), "use fewer samples"
    )
    model = _RobotSet(set_points, path, arm, servo, limits, box, (since, end_time))
    unit = np.random.default_rng(seed).uniform(-1, 1, size=(samples, 3 * arm.dof + 1))
    return model.execute(unit, seed, threads or os.cpu_count() or 1)


@checked
def worst_corner(
    set_points: SetPoints,
    path: Path,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None,
    box: Uncertainty,
    *,
    since: Time | None = None,
    end_time: Interval | None = None,
    threads: Workers | None = None,
) -> MonteCarloResult:
    """Execute set-points on robots at the corners of a box, without jitter.

    If k <= 10 parameters vary, all 2^k corners are executed. Otherwise 1024 corners are executed:
    first the corner with the worse sign of each single parameter, then the corners of a search from
    there that changes one sign per step while the error increases, then random corners.

    Arguments and exceptions are those of `spread`.
    """
    model = _RobotSet(set_points, path, arm, servo, limits, box, (since, end_time))
    use = threads or os.cpu_count() or 1
    k = int(model.varies.sum())
    if 2**k <= MAX_CORNERS:
        signs = np.where(np.arange(2**k)[:, None] >> np.arange(k) & 1, -1.0, 1.0)
        return model.execute(model.make_corners(signs), None, use)

    def errors(signs: FloatArray) -> FloatArray:
        return model.execute(model.make_corners(signs), None, use).max

    return model.execute(model.make_corners(_search_corners(errors, k)), None, use)


def jitter_of(seed: int, sample: int, count: int, jitter: float) -> FloatArray:
    """Random delay of each set-point in one sample [s], (count,), from -jitter to jitter."""
    # The delay of the first set-point is 0, because times start at its arrival.
    drawn = np.random.default_rng([seed, sample]).uniform(-jitter, jitter, size=count)
    drawn[0] = 0.0
    return drawn


class _RobotSet:
    """Data of all executions, as arrays for the compiled code."""

    # evaluated: start and end of the evaluation of errors [s], None for the defaults of `spread`.

    def __init__(
        self,
        set_points: SetPoints,
        path: Path,
        arm: Arm,
        servo: ServoModel,
        limits: Limits | None,
        box: Uncertainty,
        evaluated: tuple[float | None, float | None],
    ) -> None:
        dof, (since, end_time) = arm.dof, evaluated
        self.set_points, self.box, self.dof, self.second = (
            set_points,
            box,
            dof,
            servo.kv is not None,
        )
        self.servo = servo.for_joints(dof)
        self.half_widths = half_widths(box, self.servo, arm, set_points.cycle)
        # middle: errors in the middle of the box; not 0 for a payload range that is asymmetric.
        self.middle = np.append(np.zeros(3 * dof), np.mean(box.payload))
        self.varies: BoolArray = self.half_widths > 0.0
        if box.dead_time_shared:
            self.varies[2 * dof + 1 : 3 * dof] = False
        if not self.second:
            self.varies[dof : 2 * dof] = False
        robot, reach = _robot_kinematics(arm, path)
        if set_points.q.shape[1] != dof:
            raise InvalidInput(
                f"The set-points and the arm must have the same joints, but the set-points have "
                f"{set_points.q.shape[1]} joints and the arm {arm.name} has {dof}."
            )
        resolved = resolve_limits("spread", arm, limits, set_points.trajectory.limits)
        lower, upper = self.servo.saturate(*resolved.acceleration_bounds(dof))
        duration = set_points.trajectory.duration
        end = duration if end_time is None else end_time
        steps = self._results_per_cycle()
        last = set_points.start_time + len(set_points.q) * set_points.cycle
        begin = set_points.start_time if since is None else since
        if not begin < end:
            raise InvalidInput(
                f"The evaluation of errors must end after its start at {begin:g} s, but ends at "
                f"{end:g} s."
            )
        fixed, patience = end_time is not None, last + LONGEST_SETTLING
        clock = Clock(set_points.start_time, set_points.cycle, steps, begin, end, fixed, patience)
        kind = CUBIC if servo.interpolation == "cubic" else STRAIGHT
        line = _searched_path(path, set_points, arm, self._longest_lag())
        inertia = _payload_inertia(arm, set_points, box)
        self.setting = Setting(robot, reach, line, clock, kind, inertia, lower, upper)
        plain = self.servo.without_feedforward().for_joints(dof)
        self.commands = add_integrator_pieces(
            plain, lambda x: polynomials(set_points.q, set_points.cycle, x)
        )
        _, *self.rates = command_polynomials(set_points.q, set_points.cycle, servo.interpolation)

    def make_corners(self, signs: FloatArray) -> FloatArray:
        """Corners in units of the box, (n, 3 dof + 1), from signs of the varying parameters."""
        unit = np.zeros((len(signs), len(self.half_widths)))
        unit[:, self.varies] = signs
        return unit

    def execute(self, unit: FloatArray, seed: int | None, threads: int) -> MonteCarloResult:
        """Execute on the nominal robot, and on robots with errors in box units, (n, 3 dof + 1)."""
        rows = np.concatenate([unit, np.zeros((1, unit.shape[1]))])
        if self.box.dead_time_shared:
            rows[:, 2 * self.dof : 3 * self.dof] = rows[:, 2 * self.dof, None]
        errors = rows * self.half_widths + self.middle
        errors[-1] = 0.0
        dof, servo = self.dof, self.servo
        kp = servo.kp * (1 + errors[:, :dof])
        kv = np.zeros_like(kp)
        if servo.kv is not None:
            loop = np.isfinite(servo.kv)
            kv[:, loop] = (servo.kv * (1 + errors[:, dof : 2 * dof]))[:, loop]
        # Values are negative only by rounding errors, because `dead_time_of` checks the range.
        dead_time = np.maximum(servo.dead_time + errors[:, 2 * dof : 3 * dof], 0.0)
        payload = np.ascontiguousarray(errors[:, -1])

        nominal = len(rows) - 1

        def batch(first: int) -> FloatArray:
            results = []
            for i in range(first, min(first + BATCH_SIZE, len(rows))):
                # The last robot is the nominal robot, which has no jitter.
                drawn = None if i == nominal else seed
                robot = self._sample(kp[i], kv[i], dead_time[i], float(payload[i]), drawn, i)
                results.append(simulate_sample(self.setting, robot))
            return np.array(results)

        # The first batch is executed alone, because it compiles the kernels.
        parts = [batch(0)]
        with ThreadPoolExecutor(threads) as pool:
            parts += pool.map(batch, range(BATCH_SIZE, len(rows), BATCH_SIZE))
        rms, largest, end_time, saturated, ratio = np.concatenate(parts).T
        if np.isnan(rms).any():
            i = int(np.argmax(np.isnan(rms)))
            raise ExecutionError(
                f"Execution {i} cannot be simulated with the gains kp {kp[i].tolist()} and kv "
                f"{kv[i].tolist()} 1/s, because they require time steps that are too short. "
                "Reduce the gains."
            )
        return MonteCarloResult(
            rms=rms[:-1],
            max=largest[:-1],
            end_time=end_time[:-1],
            saturated=saturated[:-1],
            demand_ratio=ratio[:-1],
            kp=kp[:-1],
            kv=np.where(kv[:-1] > 0, kv[:-1], np.inf) if self.second else None,
            dead_time=dead_time[:-1],
            payload=payload[:-1],
            seed=seed,
            names=tuple(x for x, on in zip(self._names(), self.varies, strict=True) if on),
            deviations=errors[:-1, self.varies],
            nominal_rms=float(rms[-1]),
            nominal_max=float(largest[-1]),
        )

    def _sample(
        self,
        kp: FloatArray,
        kv: FloatArray,
        dead_time: FloatArray,
        load: float,
        seed: int | None,
        number: int,
    ) -> Sample:
        """Parameters of one robot for the compiled code, with jitter if `seed` is not None."""
        commands, count, cycle = self.commands, len(self.set_points.q), self.set_points.cycle
        starts = np.arange(count) * cycle + dead_time[:, None]
        servo = self.servo
        if servo.has_feedforward:
            velocity_lead = servo.velocity_feedforward / kp
            acceleration_lead = servo.acceleration_feedforward / (kp * np.where(kv > 0, kv, 1.0))
            velocity, acceleration = self.rates
            leads = np.tile(velocity_lead[:, None, None] * velocity, commands.shape[2] // 4)
            leads[:, :, :4] += acceleration_lead[:, None, None] * acceleration
            commands = commands + leads
        if seed is not None and self.box.jitter > 0.0:
            # The controller interpolates between two set-points over the time between their
            # arrivals.
            starts += jitter_of(seed, number, count, self.box.jitter)
            rates = cycle / np.diff(starts, axis=1)
            commands = commands.copy()
            commands[:, 1:count] *= rates[:, :, None] ** (np.arange(commands.shape[2]) % 4)
        return Sample(kp, kv, np.array(servo.ki), load, commands, starts)

    def _names(self) -> list[str]:
        """Names of all parameters, in the order of the columns of `execute`."""
        numbers = range(1, self.dof + 1)
        names = [f"{gain} of joint {j}" for gain in ("kp", "kv") for j in numbers]
        shared = self.box.dead_time_shared
        names += ["dead time" if shared else f"dead time of joint {j}" for j in numbers]
        return [*names, "payload"]

    def _results_per_cycle(self) -> int:
        """Number of results per cycle."""
        span = min(RESOLUTION, TIME_CONSTANTS / self._fastest_rate())
        if not self.set_points.cycle < MAX_RESULTS * span:
            raise ExecutionError(
                "The fastest servo of the box has a time constant of "
                f"{1 / self._fastest_rate():.3g} s, which is too short to simulate cycles of "
                f"{self.set_points.cycle:g} s. Reduce its gains kp and kv [1/s]."
            )
        # A held command causes a ripple with the period of the cycle, which one result per cycle
        # would miss.
        fewest = 2 if self.servo.interpolation == "step" else 1
        return max(fewest, int(np.ceil(self.set_points.cycle / span * (1 - 1e-12))))

    def _fastest_rate(self) -> float:
        """Inverse of the shortest time constant of a servo in the box [1/s]."""
        kp = self.servo.kp * (1 + self.half_widths[: self.dof])
        rates = np.where(np.isfinite(kp), kp, 0.0)
        if self.servo.kv is not None:
            kv = self.servo.kv * (1 + self.half_widths[self.dof : 2 * self.dof])
            loop = np.where(kv >= 4 * kp, kv, np.sqrt(kp) * np.sqrt(kv))
            rates = np.where(np.isfinite(kv), loop, rates)
        # Joints with a pure delay have no time constant.
        return float(max(rates.max(), GAINS[0]))

    def _longest_lag(self) -> float:
        """Largest lag behind the plan: time constants, dead time, jitter and two cycles [s]."""
        spans, servo, dof = self.half_widths, self.servo, self.dof
        lag = 1 / (servo.kp * (1 - spans[:dof]))
        if servo.kv is not None:
            lag = lag + 1 / (servo.kv * (1 - spans[dof : 2 * dof]))
        dead_time = (servo.dead_time + spans[2 * dof : 3 * dof]).max()
        return float(lag.max() + dead_time + self.box.jitter + 2 * self.set_points.cycle)


def _search_corners(errors: Callable[[FloatArray], FloatArray], k: int) -> FloatArray:
    """Signs of the corners to execute if the box has more than MAX_CORNERS, (MAX_CORNERS, k)."""
    # errors: function from signs, (n, k), to contour errors [m], (n,).
    single = np.concatenate([np.eye(k), -np.eye(k)])
    single_errors = errors(single)
    toward = np.where(single_errors[:k] >= single_errors[k:], 1.0, -1.0)
    best, worst = toward, float(errors(toward[None])[0])
    corners = [toward[None], -toward[None]]
    count = 2
    while count + k <= MAX_CORNERS:
        neighbours = np.where(np.eye(k, dtype=np.bool_), -best, best)
        tried = errors(neighbours)
        corners.append(neighbours)
        count += k
        i = int(np.argmax(tried))
        if tried[i] <= worst:
            break
        best, worst = neighbours[i], float(tried[i])
    remaining = MAX_CORNERS - count
    corners.append(np.random.default_rng(0).choice([-1.0, 1.0], size=(remaining, k)))
    return np.concatenate(corners)


def half_widths(box: Uncertainty, servo: ServoModel, arm: Arm, cycle: float) -> FloatArray:
    """Half-widths of the box for kp, kv and dead time of each joint, and payload, (3 dof + 1,)."""
    dof = arm.dof
    gains, dead_time = box.gains_of(dof), box.dead_time_of(servo, dof)
    if box.jitter >= cycle / 2:
        raise InvalidInput(
            f"Jitter must be less than half of the cycle of {cycle:g} s, but is {box.jitter:g} s. "
            "Otherwise set-points could arrive in another order."
        )
    if servo.drive_cycle:
        raise InvalidInput(
            "Robots with uncertain parameters are simulated with continuous loops only. Remove "
            "cycle from the servo, or set it to 0."
        )
    if box.jitter and servo.has_feedforward:
        raise InvalidInput(
            "Jitter of set-points is not supported with velocity_feedforward, because the velocity "
            "of the command would jump. Remove jitter from the box."
        )
    if np.any(box.payload) and servo.order == "first":
        raise InvalidInput(
            "An error of the payload requires a servo of order second, because a payload changes "
            "the gain of its velocity loop. Remove payload from the box, or use a servo of order "
            "second."
        )
    box.check_payload(arm)
    return np.concatenate([gains[0], gains[1], dead_time, [np.ptp(box.payload) / 2]])


def _robot_kinematics(arm: Arm, path: Path) -> tuple[FloatArray, float]:
    """Link table of the arm, and the largest distance of the tool from a joint [m]."""
    if path.dimension != arm.dimension:
        raise InvalidInput(
            f"The path and the arm must have the same dimension, but the path has "
            f"{path.dimension} coordinates and the arm {arm.name} moves in {arm.dimension}."
        )
    if not isinstance(arm, ChainArm):
        raise InvalidInput(
            "Robustness requires the compiled kinematics of a planar two-link arm or a serial arm, "
            f"but the arm is a {type(arm).__name__}."
        )
    return arm.link_table, arm.span


def _searched_path(path: Path, set_points: SetPoints, arm: Arm, lag: float) -> SearchedPath:
    """The path for the compiled code, with the reachable arc lengths in each cycle."""
    # The planned arc length at a time is the length of the planned tool motion up to this time. Its
    # error is at most the difference of the total lengths. The nearest point is searched only near
    # this arc length, because another part of the path can be close to the tool.
    plan = set_points.trajectory
    count = max(FEWEST_PLACES, PLACES_PER_CYCLE * len(set_points.q))
    t = np.union1d(np.linspace(0, plan.duration, count), plan.breaks)
    tool = arm.tool_position(plan(t))
    drawn = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tool, axis=0), axis=1)))
    margin = abs(path.length - drawn[-1]) + 1e-6 * path.length
    begin = set_points.start_time + np.arange(len(set_points.q) + 1) * set_points.cycle
    low = np.interp(begin - LAGS_BEHIND * lag, t, drawn) - margin
    high = np.interp(begin + set_points.cycle + LAGS_AHEAD * lag, t, drawn) + margin
    arcs, starts = draw_arcs(path.segments)
    rows = pack_arcs(arcs, starts)
    # The first angle is the corner at the start of a closed path.
    corners = angle_between(np.roll(arcs.end_tangents, 1, axis=0), arcs.tangents)
    closed = bool(np.linalg.norm(rows[-1, 12:15] - rows[0, :3]) <= REPEATED_POINT)
    return SearchedPath(rows, corners, path.length if closed else 0.0, low, high)


def _payload_inertia(arm: Arm, set_points: SetPoints, box: Uncertainty) -> FloatArray:
    """Inertia of 1 kg at the tool divided by each joint's inertia, at each set-point [1/kg]."""
    # A point mass m at the tool adds `m |dx/dq_j|²` to the inertia M_jj of joint j. The shape is
    # (dof, n); zeros of the shape (dof, 1) are returned if the payload does not vary.
    q = np.asarray(set_points.q)
    if not np.any(box.payload):
        return np.zeros((arm.dof, 1))
    diagonal = np.diagonal(arm.dynamics.mass_matrix(q), axis1=-2, axis2=-1)
    added = (arm.tool_jacobian(q) ** 2).sum(axis=-2)
    return np.ascontiguousarray((added / diagonal).T)
