"""Bounded least-squares fits of one joint's servo to parts of logs, and its parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from armcontour.control.identification.least_squares import (
    LOGARITHMIC,
    Estimate,
    correlation_length,
    invert,
    normalize,
    solve,
    standard_deviations,
)
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.sampled_data import white_noise
from armcontour.motion.log import FEWEST, Log
from armcontour.robot.servo.simulation import JointServo, LoggedCommand, follow

# A gap of more sample intervals than this splits a log, because the command in it is unknown.
SHORT_GAP = 20.0
# Duration at the start of a log that fits ignore, because the motion in it depends on commands
# before the log [s].
SKIPPED_TIME = 0.04
# Time over which the speed of the command is averaged [s], about the settling time of a servo.
SPEED_WINDOW = 0.1
# Number of samples from which the initial velocity is estimated.
START_SAMPLES = 20
# A command slower than this fraction of the typical speed counts as rest.
REST_SHARE = 0.02
# The typical speed is this percentile of the command speeds. Weights are command speeds, but at
# most the typical speed.
TYPICAL_PERCENTILE = 95
# Number of contiguous parts with equal motion into which a single log is divided.
PARTS = 5
# Typical changes of the parameters in a fit: of the logarithm for LOGARITHMIC, else in SI units.
SCALES = JointServo(0.5, 0.5, 0.2, 0.05, 3e-3, 0.5, 1e-3, 0.5)
# Parameters in which the simulated motion is linear unless an acceleration limit is fitted.
LINEAR = ("velocity_feedforward", "acceleration_feedforward", "friction")
# Typical changes of the initial values of a log: measurement offset [rad], position [rad],
# velocity [rad/s], acceleration [rad/s²] (only with an integrator).
INITIAL_SCALES = np.array([1e-3, 1e-3, 0.05, 1.0])
# Step of numerical derivatives, as a fraction of these typical changes.
DERIVATIVE_STEP = 1e-5
# Search of the initial state of a segment with saturation: largest number of steps.
MAX_STATE_STEPS = 8
# Search of the initial state: fractions of a step that are tried, until one reduces the error.
STEP_FRACTIONS = (1.0, 0.3, 0.1, 0.01)
# Search of the initial state: singular values below this fraction of the largest one count as zero.
NULL_RATIO = 1e-14
# Fitted parameters up to this value are rounding errors at the bound 0.
ROUNDING = 1e-9
# Residuals are in mrad: number of mrad per rad.
MRAD = 1e3
# Residuals are clipped to this magnitude [mrad], because trials can diverge.
MAX_RESIDUAL = 1e4
# Lower bound of K_p and k_i in the search [1/s].
MIN_GAIN = 0.1
# Upper bound of K_p and K_v in the search [1/s], because velocity loops of drives have bandwidths
# below 160 Hz. The upper bound of k_i is a tenth of it.
MAX_GAIN = 1000.0
# A linear unknown has no effect if its typical change changes the residuals by at most this norm
# [mrad].
LEAST_EFFECT = 1e-4
# Half-width of a 95 % interval of a normal distribution [standard deviations].
HALF_INTERVAL = 1.96
# Parameters with at most this standard deviation are determined, however small their value is.
SUFFICIENT_SD = {
    "dead_time": 0.5e-3,
    "velocity_feedforward": 0.05,
    "acceleration_feedforward": 0.05,
}
# Largest ratio of the effect of a drive cycle to its first-order approximation.
CYCLE_EFFECT = 1.2
# Number of fitted initial values (offset, position, velocity) of a log segment, by model order.
INITIAL_VALUES = {"unknown": 1, "delay": 1, "first": 2, "second": 3}


class Model(NamedTuple):
    """A model of a servo: its order, and the parameters of `JointServo` that it has."""

    order: str
    free: tuple[str, ...]


class Search(NamedTuple):
    """Search range: longest dead time [s], drive cycle [s] (0: continuous loop), allowed orders."""

    longest: float
    drive_cycle: float
    orders: tuple[str, ...] = ()

    @property
    def fastest(self) -> float:
        """Largest gain of the search [1/s]."""
        return min(MAX_GAIN, 2 / self.drive_cycle) if self.drive_cycle else MAX_GAIN

    def bounds(self, model: Model) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of a model's parameters, (m,) each; logarithms for LOGARITHMIC."""
        fastest = self.fastest
        lead = 3.0 if model.order == "second" else 0.3
        ranges = JointServo(
            (MIN_GAIN, fastest), (0.5, fastest), (0.0, 3.0), (0.0, lead), (0.0, self.longest),
            (0.01, 1e5), (0.0, 0.1), (MIN_GAIN, MAX_GAIN / 10),
        )  # fmt: skip
        bounds = np.array([getattr(ranges, x) for x in model.free]).reshape(-1, 2).T
        logarithmic = np.array([x in LOGARITHMIC for x in model.free], dtype=bool)
        bounds[:, logarithmic] = np.log(bounds[:, logarithmic])
        return bounds[0], bounds[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogSegment:
    """Samples of one joint in one log without a long gap; arrays are (n,)."""

    log: int  # Index of the log
    start: int  # Index of its first sample in the log
    command: LoggedCommand  # Command with times and set-points
    y: FloatArray  # Measured positions [rad]
    use: BoolArray  # Mask of the samples that are fitted
    weight: FloatArray  # Weight of each sample: limited speed of the command [rad/s], 0 at rest
    part: IntArray  # Index of the cross-validation part of each sample

    def after(self, lag: float) -> LogSegment:
        """The segment with its start excluded from `use`: SKIPPED_TIME, or `lag` if longer [s]."""
        t = self.command.t
        return replace(self, use=t >= min(max(SKIPPED_TIME, lag, t[5]), t[-1] / 4))

    @property
    def velocity(self) -> float:
        """Measured velocity at the start of the segment [rad/s]."""
        n = min(START_SAMPLES, len(self.y))
        return float(np.polyfit(self.command.t[:n], self.y[:n], 1)[0])

    def cut(self, a: int, b: int, every: int = 1) -> LogSegment:
        """Every `every`-th sample from index a to b (exclusive), and the set-points before b."""
        c = self.command
        before = len(self.command.knots) - len(self.command.t)
        a += -(before + a) % every
        knots = slice(0, before + b, every)
        samples = slice(a, b, every)
        kind = "linear" if c.linear else "step"
        return replace(
            self,
            start=self.start + a,
            command=LoggedCommand(c.knots[knots], c.every[knots], kind, (before + a) // every),
            **{x: getattr(self, x)[samples] for x in ("y", "use", "weight", "part")},
        )


def split_logs(
    logs: Sequence[Log], j: int, interpolation: str, lag: float = 0.0
) -> list[LogSegment]:
    """Segments of joint j between long gaps of the logs, weighted by motion, with parts."""
    # `use` excludes the start of each segment, see `LogSegment.after`.
    spans = []
    for i, log in enumerate(logs):
        t = log.t
        ends = log.gaps[np.diff(t)[log.gaps] > SHORT_GAP * log.interval] + 1
        spans += [(i, a, b) for a, b in pairwise([0, *ends, len(t)]) if b - a >= FEWEST]
    speeds = []
    for i, a, b in spans:
        t = logs[i].t[a:b]
        u = logs[i].command[a:b, j]
        travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(u)))])
        speeds.append((travel - np.interp(t - SPEED_WINDOW, t, travel)) / SPEED_WINDOW)
    every = np.concatenate(speeds) if speeds else np.zeros(1)
    usual = float(np.percentile(every[every > 0], TYPICAL_PERCENTILE)) if every.any() else 1.0
    weights = [np.where(x > REST_SHARE * usual, np.minimum(x, usual), 0.0) for x in speeds]
    total = max(sum(float(x.sum()) for x in weights), 1e-300)
    done = 0.0
    moving = {i for (i, _, _), x in zip(spans, weights, strict=True) if x.any()}
    segments = []
    for (i, a, b), weight in zip(spans, weights, strict=True):
        t = logs[i].t[a:b] - logs[i].t[a]
        share = (done + np.cumsum(weight)) / total
        done += float(weight.sum())
        part = np.minimum((share * PARTS).astype(np.intp), PARTS - 1)
        segments.append(
            LogSegment(
                log=i,
                start=a,
                command=LoggedCommand(t, logs[i].command[a:b, j], interpolation),
                y=logs[i].measured[a:b, j].copy(),
                use=np.full(b - a, True),
                weight=weight,
                part=part if len(moving) == 1 else np.full(b - a, i),
            ).after(lag)
        )
    return segments


class Problem:
    """Least-squares problem of a model and log segments, solved by variable projection."""

    # Unknowns are the `m` parameters of the model, then `b` initial values of each segment: the
    # measurement offset and the position, velocity and acceleration that the model requires. The
    # search varies the nonlinear unknowns only; each step solves for the linear unknowns.

    def __init__(self, model: Model, segments: Sequence[LogSegment], search: Search) -> None:
        self.model = model
        self.segments = segments
        self.search = search
        self.m = len(model.free)
        self.b = INITIAL_VALUES[model.order] + ("ki" in model.free)
        self.logarithmic = np.array([x in LOGARITHMIC for x in model.free], dtype=bool)
        scales = [getattr(SCALES, x) for x in model.free]
        count = len(segments)
        self.scale = np.concatenate([scales, np.tile(INITIAL_SCALES[: self.b], count)])
        self.used = [np.flatnonzero(s.use) for s in segments]
        free = np.full(self.b * count, np.inf)
        low, high = search.bounds(model)
        self.low = np.concatenate([low, -free])
        self.high = np.concatenate([high, free])
        limited = "acceleration_limit" in model.free
        begin = [not limited or k == 0 for k in range(self.b)]
        parameters = [not limited and x in LINEAR for x in model.free]
        self.linear: BoolArray = np.concatenate([parameters, np.tile(begin, count)]).astype(bool)
        self.steps = np.where(self.linear, 1.0, DERIVATIVE_STEP) * self.scale

    def servo(self, unknowns: FloatArray) -> JointServo:
        """The servo with parameters (..., m), which are logarithms for LOGARITHMIC."""
        values = np.where(
            self.logarithmic, np.exp(np.where(self.logarithmic, unknowns, 0.0)), unknowns
        )
        parameters = {name: values[..., k] for k, name in enumerate(self.model.free)}
        return JointServo(**{"kp": np.inf, **parameters})

    def guess(self, values: dict[str, float], lag: float) -> FloatArray:
        """Unknowns from parameter values; initial values are those of a pure delay of `lag` [s]."""
        parameters = np.array([values.get(x, 0.0) for x in self.model.free])
        parameters = np.where(self.logarithmic, np.log(np.maximum(parameters, 1e-9)), parameters)
        begins = []
        for s in self.segments:
            c = s.command
            offset = float(np.median((s.y - c.evaluate(c.t - lag))[s.use]))
            begins += [offset, float(s.y[0] - offset), s.velocity, 0.0][: self.b]
        return np.asarray(np.clip(np.concatenate([parameters, begins]), self.low, self.high))

    def select(self, unknowns: FloatArray, indices: Sequence[int]) -> FloatArray:
        """The unknowns that belong to a problem with only the segments of these indices."""
        begins = unknowns[self.m :].reshape(-1, self.b)[list(indices)]
        return np.concatenate([unknowns[: self.m], begins.ravel()])

    def linearize(
        self, unknowns: FloatArray, only: BoolArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals [mrad], and their derivatives by all unknowns or by the unknowns of a mask."""
        m = self.m
        b = self.b
        only = np.full(len(unknowns), True) if only is None else only
        searched = np.flatnonzero(only[:m])
        later = np.flatnonzero(only[m + 1 : m + b]) + 1
        after = 1 + len(searched)
        rows = after + len(later)
        values = np.tile(unknowns[:m], (rows, 1))
        values[np.arange(1, after), searched] += self.steps[searched]
        servo = self.servo(values)
        column = np.cumsum(only)
        end = 0
        every = np.zeros((1 + int(column[-1]), sum(len(k) for k in self.used)))
        for i, (s, used) in enumerate(zip(self.segments, self.used, strict=True)):
            begin = np.zeros((rows, len(INITIAL_SCALES)))
            first = m + i * b
            begin[:, :b] = unknowns[first : first + b]
            begin[np.arange(after, rows), later] += self.steps[m + later]
            _, q0, dq0, ddq0 = begin.T
            q = follow(s.command, servo, q0, dq0, self.search.drive_cycle, ddq0).take(used, axis=1)
            block = every[:, end : end + len(used)]
            end = end + len(used)
            block[column[searched]] = (q[1:after] - q[0]) / self.steps[searched, None]
            block[column[first + later]] = (q[after:] - q[0]) / self.steps[m + later, None]
            if only[first]:
                block[column[first]] = 1.0
            # Residuals are simulated less measured positions of the used samples.
            block[0] = q[0] + unknowns[first] - s.y[used]
        every *= MRAD
        if not np.isfinite(every.sum()):
            every = np.nan_to_num(every, nan=MAX_RESIDUAL)
        return np.clip(every[0], -MAX_RESIDUAL, MAX_RESIDUAL), every[1:].T

    def residuals(self, unknowns: FloatArray) -> FloatArray:
        """Simulated less measured positions of the used samples [mrad]."""
        return self.linearize(unknowns, np.full(len(unknowns), False))[0]

    def project(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Solve for the linear unknowns; returns unknowns, residuals [mrad], and derivatives."""
        # The returned derivatives are by the linear unknowns that are not at their bounds, and they
        # are normalized.
        linear = np.flatnonzero(self.linear)
        start, slopes = self.linearize(unknowns, self.linear)
        if np.abs(start).max() >= MAX_RESIDUAL:
            # The simulation diverged; an offset must not hide this.
            return unknowns, start, slopes[:, :0]
        slopes, size = normalize(slopes * self.scale[linear], LEAST_EFFECT)
        size /= self.scale[linear]
        square = np.einsum("ki,kj->ij", slopes, slopes)
        low, high = ((y[linear] - unknowns[linear]) * size for y in (self.low, self.high))
        within = np.full(len(linear), True)
        step = np.zeros(len(linear))
        for _ in range(len(LINEAR) + 1):
            inverse = invert(square[np.ix_(within, within)])[0]
            # The second iteration removes the rounding errors of the first iteration.
            for _ in range(2):
                errors = start + np.einsum("ki,i->k", slopes, step)
                step[within] -= inverse @ np.einsum("ki,k->i", slopes[:, within], errors)
            beyond = (step < low) | (step > high)
            if not beyond.any():
                break
            step = np.clip(step, low, high)
            within = within & ~beyond
        best = unknowns.copy()
        best[linear] = np.clip(unknowns[linear] + step / size, self.low[linear], self.high[linear])
        return best, start + np.einsum("ki,i->k", slopes, step), slopes[:, within]

    def cost(self, unknowns: FloatArray) -> float:
        """Half of the sum of squared residuals after solving for the linear unknowns [mrad²]."""
        return float(np.sum(self.project(np.clip(unknowns, self.low, self.high))[1] ** 2)) / 2

    def solve(self, start: FloatArray, evaluations: int) -> Any:
        """Solution by `scipy.optimize` from a start with at most `evaluations` evaluations."""
        searched = np.flatnonzero(~self.linear)
        begin = np.clip(start, self.low, self.high)
        unknowns = begin
        linear = np.empty((0, 0))

        def residuals(z: FloatArray) -> FloatArray:
            nonlocal unknowns, linear
            trial = begin.copy()
            trial[searched] = z
            unknowns, errors, linear = self.project(trial)
            return errors

        def slopes(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            if (unknowns[searched] != z).any():
                residuals(z)
            every = np.column_stack(self.linearize(unknowns, ~self.linear))
            inverse = invert(np.einsum("ki,kj->ij", linear, linear))[0]
            for _ in range(2):
                shares = inverse @ np.einsum("ki,kj->ij", linear, every)
                every -= np.einsum("ki,ij->kj", linear, shares)
            return every[:, 0], every[:, 1:]

        bounds = self.low[searched], self.high[searched]
        solution = solve(residuals, slopes, begin[searched], bounds, evaluations)
        residuals(solution.x)
        solution.x = unknowns
        return solution


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """A solved problem, its unknowns, and half of the sum of squared residuals [mrad²]."""

    problem: Problem
    x: FloatArray
    cost: float

    @property
    def servo(self) -> JointServo:
        """The fitted servo, with floats as values."""
        values = self.problem.servo(self.x[: self.problem.m])
        return JointServo(*(float(x) if x > ROUNDING else 0.0 for x in values))

    @property
    def rms(self) -> float:
        """RMS error at the fitted samples [rad]."""
        samples = sum(len(k) for k in self.problem.used)
        return math.sqrt(2 * self.cost / samples) / MRAD

    @property
    def noise(self) -> float:
        """Standard deviation of the white noise of the residuals [rad]."""
        return float(white_noise(self.problem.residuals(self.x))) / MRAD

    def at_bounds(self) -> tuple[set[str], set[str]]:
        """Names of the parameters at their lower bounds, and at their upper bounds."""
        p = self.problem
        m = self.problem.m
        near = 1e-2 * p.scale[:m]
        names = np.array(p.model.free)
        low = self.x[:m] - p.low[:m] < near
        high = p.high[:m] - self.x[:m] < near
        return set(names[low].tolist()), set(names[high].tolist())


def fit(problem: Problem, starts: Sequence[FloatArray], evaluations: int = 60) -> Fit:
    """Solve a problem from its best starts with few evaluations, then refine the best solution."""
    few = evaluations
    if len(starts) > 1:
        few = min(12, evaluations // 4)
        count = 4 if "acceleration_limit" in problem.model.free else 2
        starts = sorted(starts, key=problem.cost)[:count]
    solution = min((problem.solve(x, few) for x in starts), key=lambda x: float(x.cost))
    if few < evaluations and solution.status == 0:
        solution = problem.solve(solution.x, evaluations)
    return Fit(problem=problem, x=solution.x, cost=float(solution.cost))


def predict(segment: LogSegment, servo: JointServo, order: str, drive_cycle: float) -> FloatArray:
    """Predicted positions in a log segment [rad], (n,); offset and initial state are fitted."""
    return fit_initial_state(segment, servo, order, drive_cycle)[0]


def fit_initial_state(
    segment: LogSegment, servo: JointServo, order: str, drive_cycle: float
) -> tuple[FloatArray, float]:
    """Fit the initial state of a log segment; positions [rad], (n,), and encoder offset [rad]."""
    count = INITIAL_VALUES[order] + int(servo.ki > 0)
    free = np.isinf(servo.acceleration_limit)
    scale = INITIAL_SCALES[:count]
    used = segment.use
    y = segment.y
    steps = np.diag(INITIAL_SCALES)[:count] * (1.0 if free else DERIVATIVE_STEP)
    steps[0] = 0.0

    def simulate(begins: FloatArray) -> FloatArray:
        offset, q0, dq0, ddq0 = begins.T
        q = follow(segment.command, servo, q0, dq0, drive_cycle, ddq0)
        return np.asarray(q + offset[:, None])

    x = np.array([0.0, y[0], segment.velocity, 0.0])
    q = simulate(x + steps)
    # Without saturation the motion is linear in its initial state, so one iteration is sufficient.
    for _ in range(1 if free else MAX_STATE_STEPS):
        slopes = (q - q[0]) / np.maximum(steps.sum(axis=1), 1e-300)[:, None]
        slopes[0] = 1.0
        rows = np.concatenate([slopes[:, used] * scale[:, None], (y - q[0])[None, used]])
        gram = np.einsum("ik,jk->ij", rows, rows)
        inverse = np.linalg.pinv(gram[:count, :count], NULL_RATIO, hermitian=True)
        step = np.zeros(len(x))
        step[:count] = inverse @ gram[:count, count] * scale
        for fraction in STEP_FRACTIONS:
            trial = simulate(x + fraction * step + steps)
            if np.sum((y - trial[0])[used] ** 2) <= gram[count, count]:
                x = x + fraction * step
                q = trial
                break
        else:
            break
    return np.asarray(q[0]), float(x[0])


def estimate_parameters(
    fit: Fit,
    without: Sequence[JointServo] = (),
    longest_cycle: float = 0.0,
    rivals: Sequence[JointServo] = (),
) -> dict[str, Estimate]:
    """Estimates of the parameters of a fit by name; parameters at a bound have no interval.

    - `without`: servos, each fitted without one part of the logs. Their scatter includes the
      effects that are not modelled, such as other joints.
    - `rivals`: servos of other models with nearly the same error, if the residuals of the best
      model are not white.
    - `longest_cycle`: longest possible drive cycle [s]; 0 if the drive cycle is known.
    """
    p = fit.problem
    names = fit.problem.model.free
    bounds = set().union(*fit.at_bounds())
    free = np.full(len(fit.x), True)
    free[: p.m] = [x not in bounds for x in names]
    residuals, jacobian = p.linearize(fit.x)
    freedom = max(len(residuals) - int(np.sum(free)), 1)
    variance = float(np.sum(residuals**2)) / freedom * correlation_length(residuals)
    deviations = np.where(free, standard_deviations(jacobian, variance, free), math.nan)
    servo = fit.servo
    estimates = {}
    cycled = add_drive_cycle(servo, longest_cycle)
    for name, sd in zip(names, deviations.tolist(), strict=False):
        value = getattr(servo, name)
        other = getattr(cycled, name)
        every = np.array([getattr(x, name) for x in without])
        others = np.array([getattr(x, name) for x in rivals])
        others = np.append(others[np.isfinite(others)], value)
        shift = other - value
        if name in LOGARITHMIC:
            every, others = (np.log(np.maximum(y, 1e-9)) for y in (every, others))
            shift = math.log(other / value)
        if math.isfinite(sd):
            jackknife = float(np.std(every) * math.sqrt(len(every) - 1)) if len(every) else 0.0
            sd = max(sd, jackknife, float(np.std(others)))
        low = min(shift, 0.0) - HALF_INTERVAL * sd
        high = max(shift, 0.0) + HALF_INTERVAL * sd
        if name not in LOGARITHMIC:
            low = max(low, -value)
        options: dict[str, Any] = {"also": SUFFICIENT_SD.get(name, 0.0)}
        if name == "acceleration_feedforward" and p.model.order == "first":
            options = {"unit": "s"}
        estimates[name] = Estimate.from_interval(name, value, sd, (low, high), **options)
    return estimates


def add_drive_cycle(servo: JointServo, drive_cycle: float) -> JointServo:
    """The servo with a drive cycle [s] that is equivalent, to first order, to the given servo."""
    # Held values and differences over a drive cycle are delayed by half a drive cycle.
    half = CYCLE_EFFECT * drive_cycle / 2
    kp = servo.kp / (1 + servo.kp * half)
    ki = servo.ki / (1 + servo.ki * half)
    slow = 1 - (kp + ki) * half
    return servo._replace(
        kp=kp,
        ki=ki,
        kv=servo.kv / (slow + servo.kv * half) if math.isfinite(servo.kv) else servo.kv,
        velocity_feedforward=servo.velocity_feedforward * slow / (1 + kp * half),
        dead_time=max(servo.dead_time - half * (1 + servo.velocity_feedforward), 0.0),
    )
