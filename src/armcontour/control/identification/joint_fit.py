"""Bounded least-squares fits of one joint's servo to log segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from armcontour.control.identification.candidate_models import (
    ACCELERATION,
    FEED,
    FRICTION,
    KI,
    KP,
    LIMIT,
    Model,
    Search,
)
from armcontour.control.identification.estimate import LOGARITHMIC
from armcontour.control.identification.least_squares import invert, normalize, solve
from armcontour.control.identification.log_segments import LogSegment
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.sampled_data import white_noise
from armcontour.robot.servo.simulation import JointServo, follow

# Typical changes of the parameters in a fit: of the logarithm for LOGARITHMIC, else in SI units.
SCALES = JointServo(0.5, 0.5, 0.2, 0.05, 3e-3, 0.5, 1e-3, 0.5)
# Parameters in which the simulated motion is linear unless an acceleration limit is fitted.
LINEAR = (FEED, ACCELERATION, FRICTION)
# Typical changes of a segment's initial values: measurement offset [rad], position [rad], velocity
# [rad/s], acceleration [rad/s²] (only with an integrator).
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
# A parameter is at a bound if it differs from the bound by less than this fraction of its typical
# change.
BOUND_SHARE = 1e-2
# Number of starts that are solved, and the same for models with an acceleration limit.
SOLVED_STARTS = 2
LIMITED_STARTS = 4
# Largest number of evaluations from each of several starts.
FEW_EVALUATIONS = 12
# A fit is finished if the cost can be reduced by less than this fraction.
LEAST_GAIN = 1e-8
# Status in scipy: the solver ended because it used all evaluations.
EVALUATIONS_USED = 0


class Problem:
    """Least-squares problem of a model and log segments, solved by variable projection.

    The unknowns are the parameters of the model, then the initial values of each segment: the
    offset of the measurement, and the position, velocity and acceleration that the model requires.
    The search varies only the nonlinear unknowns, and each of its steps solves for the linear ones
    (G. Golub and V. Pereyra, Separable nonlinear least squares, Inverse Problems 19, 2003).

    Args:
        model: The model.
        segments: Segments of the logs, whose used samples are fitted.
        search: Range of the parameters.
    """

    def __init__(self, model: Model, segments: Sequence[LogSegment], search: Search) -> None:
        self.model = model
        self.segments = segments
        self.search = search
        self.parameter_count = len(model.free)
        # Number of initial values per segment.
        self.initial_count = INITIAL_VALUES[model.order] + (KI in model.free)
        self.logarithmic = np.array([x in LOGARITHMIC for x in model.free], dtype=bool)
        scales = [getattr(SCALES, x) for x in model.free]
        count = len(segments)
        initial_scales = np.tile(INITIAL_SCALES[: self.initial_count], count)
        self.scale = np.concatenate([scales, initial_scales])
        self.used = [np.flatnonzero(s.use) for s in segments]
        unbounded = np.full(self.initial_count * count, np.inf)
        low, high = search.bounds(model)
        self.low = np.concatenate([low, -unbounded])
        self.high = np.concatenate([high, unbounded])
        # With an acceleration limit, the motion is linear only in the offset.
        limited = LIMIT in model.free
        initial = [not limited or k == 0 for k in range(self.initial_count)]
        parameters = [not limited and x in LINEAR for x in model.free]
        self.linear: BoolArray = np.concatenate([parameters, np.tile(initial, count)]).astype(bool)
        # Steps of the numerical derivatives.
        self.steps = np.where(self.linear, 1.0, DERIVATIVE_STEP) * self.scale

    def servo(self, unknowns: FloatArray) -> JointServo:
        """Return the servo with parameters (..., m), which are logarithms for LOGARITHMIC."""
        values = np.where(
            self.logarithmic, np.exp(np.where(self.logarithmic, unknowns, 0.0)), unknowns
        )
        parameters = {name: values[..., k] for k, name in enumerate(self.model.free)}
        return JointServo(**{KP: np.inf, **parameters})

    def guess(self, values: dict[str, float], lag: float) -> FloatArray:
        """Return unknowns with parameters by name, and initial values of a delay of `lag` [s]."""
        parameters = np.array([values.get(x, 0.0) for x in self.model.free])
        parameters = np.where(self.logarithmic, np.log(np.maximum(parameters, 1e-9)), parameters)
        initial = []
        for s in self.segments:
            c = s.command
            offset = float(np.median((s.y - c.evaluate(c.t - lag))[s.use]))
            initial += [offset, float(s.y[0] - offset), s.velocity, 0.0][: self.initial_count]
        return np.asarray(np.clip(np.concatenate([parameters, initial]), self.low, self.high))

    def unknowns_of_segments(self, unknowns: FloatArray, indices: Sequence[int]) -> FloatArray:
        """Return the unknowns of a problem that has only the segments with these indices."""
        initial = unknowns[self.parameter_count :].reshape(-1, self.initial_count)[list(indices)]
        return np.concatenate([unknowns[: self.parameter_count], initial.ravel()])

    def linearize(
        self, unknowns: FloatArray, only: BoolArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return residuals [mrad], (samples,), and their derivatives, (samples, unknowns).

        - `only`: mask of the unknowns by which residuals are derived; by default all.

        Residuals are simulated less measured positions of the used samples. Derivatives are
        differences over `steps`, for all segments at once: the first simulated servo has the
        unknowns, and each of the others differs from it by one step.
        """
        only = np.full(len(unknowns), True) if only is None else only
        m = self.parameter_count
        searched = np.flatnonzero(only[:m])
        # Initial values except for the offset, whose derivative is 1.
        states = np.flatnonzero(only[m + 1 : m + self.initial_count]) + 1
        first_state = 1 + len(searched)
        rows = first_state + len(states)
        values = np.tile(unknowns[:m], (rows, 1))
        values[np.arange(1, first_state), searched] += self.steps[searched]
        servo = self.servo(values)
        # Row of each unknown's derivative in the result; row 0 has the residuals.
        row_of = np.cumsum(only)
        rows_of_result = np.zeros((1 + int(row_of[-1]), sum(len(k) for k in self.used)))
        end = 0
        for i, (s, used) in enumerate(zip(self.segments, self.used, strict=True)):
            offset_index = m + i * self.initial_count
            initial = np.zeros((rows, len(INITIAL_SCALES)))
            own_unknowns = unknowns[offset_index : offset_index + self.initial_count]
            initial[:, : self.initial_count] = own_unknowns
            initial[np.arange(first_state, rows), states] += self.steps[m + states]
            _, q0, dq0, ddq0 = initial.T
            q = follow(s.command, servo, q0, dq0, self.search.drive_cycle, ddq0).take(used, axis=1)
            block = rows_of_result[:, end : end + len(used)]
            end = end + len(used)
            block[row_of[searched]] = (q[1:first_state] - q[0]) / self.steps[searched, None]
            state_steps = self.steps[m + states, None]
            block[row_of[offset_index + states]] = (q[first_state:] - q[0]) / state_steps
            if only[offset_index]:
                block[row_of[offset_index]] = 1.0
            block[0] = q[0] + unknowns[offset_index] - s.y[used]
        rows_of_result *= MRAD
        if not np.isfinite(rows_of_result.sum()):
            rows_of_result = np.nan_to_num(rows_of_result, nan=MAX_RESIDUAL)
        return np.clip(rows_of_result[0], -MAX_RESIDUAL, MAX_RESIDUAL), rows_of_result[1:].T

    def residuals(self, unknowns: FloatArray) -> FloatArray:
        """Return simulated less measured positions of the used samples [mrad], (samples,)."""
        return self.linearize(unknowns, np.full(len(unknowns), False))[0]

    def project(self, unknowns: FloatArray) -> LinearSolution:
        """Solve for the linear unknowns; the others keep their values."""
        linear = np.flatnonzero(self.linear)
        start, slopes = self.linearize(unknowns, self.linear)
        if np.abs(start).max() >= MAX_RESIDUAL:
            # The simulation diverged; an offset must not hide this.
            return LinearSolution(unknowns, start, slopes[:, :0])
        slopes, size = normalize(slopes * self.scale[linear], LEAST_EFFECT)
        size /= self.scale[linear]
        low, high = ((y[linear] - unknowns[linear]) * size for y in (self.low, self.high))
        step, within = _solve_bounded(start, slopes, low, high)
        best = unknowns.copy()
        best[linear] = np.clip(unknowns[linear] + step / size, self.low[linear], self.high[linear])
        residuals = start + np.einsum("ki,i->k", slopes, step)
        return LinearSolution(best, residuals, slopes[:, within])

    def cost(self, unknowns: FloatArray) -> float:
        """Return half of the squared residuals' sum with the best linear unknowns [mrad²]."""
        projection = self.project(np.clip(unknowns, self.low, self.high))
        return float(np.sum(projection.residuals**2)) / 2

    def solve(
        self, start: FloatArray, evaluations: int, method: Literal["trf", "dogbox"] = "trf"
    ) -> Any:
        """Solve from a start with at most `evaluations` evaluations; returns scipy's solution.

        With the residuals' derivatives J by the nonlinear unknowns and L by the linear ones, those
        of the projected residuals are `J - L (LᵀL)⁻¹ Lᵀ J` (L. Kaufman, A variable projection
        method for solving separable nonlinear least squares problems, BIT 15, 1975).
        """
        searched = np.flatnonzero(~self.linear)
        begin = np.clip(start, self.low, self.high)
        latest = LinearSolution(begin, np.empty(0), np.empty((0, 0)))

        def residuals(z: FloatArray) -> FloatArray:
            """Return the residuals with nonlinear unknowns z, and the best linear ones [mrad]."""
            nonlocal latest
            trial = begin.copy()
            trial[searched] = z
            latest = self.project(trial)
            return latest.residuals

        def slopes(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            """Return the residuals and their derivatives by z, without the span of L."""
            if (latest.unknowns[searched] != z).any():
                residuals(z)
            columns = np.column_stack(self.linearize(latest.unknowns, ~self.linear))
            linear = latest.slopes
            inverse = invert(np.einsum("ki,kj->ij", linear, linear))[0]
            # The second iteration removes the rounding errors of the first iteration.
            for _ in range(2):
                projection = inverse @ np.einsum("ki,kj->ij", linear, columns)
                columns -= np.einsum("ki,ij->kj", linear, projection)
            return columns[:, 0], columns[:, 1:]

        bounds = self.low[searched], self.high[searched]
        solution = solve(residuals, slopes, begin[searched], bounds, evaluations, method)
        residuals(solution.x)
        solution.x = latest.unknowns
        return solution


class LinearSolution(NamedTuple):
    """Unknowns of a problem with the best linear unknowns."""

    unknowns: FloatArray  # (n,)
    residuals: FloatArray  # Simulated less measured positions of the used samples [mrad]
    # Derivatives of the residuals by the linear unknowns that are not at their bounds, with unit
    # norm, (samples, k).
    slopes: FloatArray


def _solve_bounded(
    start: FloatArray, slopes: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Minimize `‖start + slopes @ step‖` with bounds of the step.

    - `start`: residuals, (samples,).
    - `slopes`: derivatives with unit norm, (samples, n).
    - `low`, `high`: bounds, (n,) each.

    Components of the step beyond a bound are set to it, and the others are computed again. Returns
    the step and the mask of its components that are not at a bound, (n,) each.
    """
    square = np.einsum("ki,kj->ij", slopes, slopes)
    within = np.full(len(low), True)
    step = np.zeros(len(low))
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
    return step, within


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """A solved problem, its unknowns x, and half of the squared residuals' sum [mrad²]."""

    problem: Problem
    x: FloatArray
    cost: float

    @property
    def servo(self) -> JointServo:
        """The fitted servo, with floats as values."""
        values = self.problem.servo(self.x[: self.problem.parameter_count])
        return JointServo(*(float(x) if x > ROUNDING else 0.0 for x in values))

    @property
    def rms(self) -> float:
        """RMS error at the fitted samples [rad]."""
        samples = sum(len(k) for k in self.problem.used)
        return math.sqrt(2 * self.cost / samples) / MRAD

    @property
    def noise(self) -> float:
        """Standard deviation of the residuals' white noise [rad]."""
        return float(white_noise(self.problem.residuals(self.x))) / MRAD

    def at_bounds(self) -> tuple[set[str], set[str]]:
        """Return names of the parameters at their lower bounds, and at their upper bounds."""
        p = self.problem
        m = p.parameter_count
        tolerance = BOUND_SHARE * p.scale[:m]
        names = np.array(p.model.free)
        low = self.x[:m] - p.low[:m] < tolerance
        high = p.high[:m] - self.x[:m] < tolerance
        return set(names[low].tolist()), set(names[high].tolist())


def fit(problem: Problem, starts: Sequence[FloatArray], evaluations: int = 60) -> Fit:
    """Solve a problem from several starts, and return the best fit.

    The starts with the smallest errors are solved with few evaluations, and only the best of these
    solutions is refined.

    - `starts`: unknowns of the problem.
    - `evaluations`: largest number of evaluations for a solution.
    """
    few = evaluations
    if len(starts) > 1:
        few = min(FEW_EVALUATIONS, evaluations // 4)
        count = LIMITED_STARTS if LIMIT in problem.model.free else SOLVED_STARTS
        starts = sorted(starts, key=problem.cost)[:count]
    solutions = [problem.solve(x, few) for x in starts]
    solution = min(solutions, key=lambda x: float(x.cost))
    if few < evaluations and solution.status == EVALUATIONS_USED:
        solution = problem.solve(solution.x, evaluations)
    return Fit(problem=problem, x=solution.x, cost=float(solution.cost))


def finish(start: Fit, evaluations: int = 60) -> Fit:
    """Search on from a fit until it does not improve any more.

    Where parameters nearly replace each other, or the best value of one is next to its bound, the
    interior solver creeps, and rounding errors decide where its evaluations end. The solver
    "dogbox" reaches the end within few evaluations.

    - `evaluations`: largest number of evaluations.
    """
    solution = start.problem.solve(start.x, evaluations, "dogbox")
    cost = float(solution.cost)
    if cost >= (1 - LEAST_GAIN) * start.cost:
        return start
    return Fit(problem=start.problem, x=solution.x, cost=cost)
