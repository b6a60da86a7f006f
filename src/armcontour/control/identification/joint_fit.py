"""Bounded least-squares fits of one joint's servo to log segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour.control.identification.candidate_models import Model, Search
from armcontour.control.identification.estimate import LOGARITHMIC
from armcontour.control.identification.least_squares import invert, normalize, solve
from armcontour.control.identification.log_segments import LogSegment
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.sampled_data import white_noise
from armcontour.robot.servo.simulation import JointServo, follow

# Typical changes of the parameters in a fit: of the logarithm for LOGARITHMIC, else in SI units.
SCALES = JointServo(0.5, 0.5, 0.2, 0.05, 3e-3, 0.5, 1e-3, 0.5)
# Parameters in which the simulated motion is linear unless an acceleration limit is fitted.
LINEAR = ("velocity_feedforward", "acceleration_feedforward", "friction")
# Typical changes of the initial values of a log: measurement offset [rad], position [rad],
# velocity [rad/s], acceleration [rad/s²] (only with an integrator).
INITIAL_SCALES = np.array([1e-3, 1e-3, 0.05, 1.0])
# Step of numerical derivatives, as a fraction of these typical changes.
DERIVATIVE_STEP = 1e-5
# Fitted parameters up to this value are rounding errors at the bound 0.
ROUNDING = 1e-9
# Residuals are in mrad: number of mrad per rad.
MRAD = 1e3
# Residuals are clipped to this magnitude [mrad], because trials can diverge.
MAX_RESIDUAL = 1e4
# A linear unknown has no effect if its typical change changes the residuals by at most this norm
# [mrad].
LEAST_EFFECT = 1e-4
# Number of fitted initial values (offset, position, velocity) of a log segment, by model order.
INITIAL_VALUES = {"unknown": 1, "delay": 1, "first": 2, "second": 3}


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
