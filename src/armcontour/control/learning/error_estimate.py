"""Estimates from several runs: noise, repeating error, and error of the model's response."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from armcontour.control.learning.learning_result import LearningRun
from armcontour.control.learning.lifted_model import Lifted
from armcontour.core.checks import FloatArray

# Relative error of the linearized response of an exact model, from tests of `Response`.
MODEL_ERROR = 1e-3
# Smallest assumed relative error of the response to a change of the set-points, because friction is
# not linear for small changes.
RESPONSE_ERROR = 0.3
# Relative accuracy of errors that are interpolated or extrapolated from runs, because friction is
# not linear.
COMBINATION_ERROR = 0.3
# Factor of the penalty per setback, which makes changes ten times slower.
SETBACK_FACTOR = 100.0
# Another run is useful if it can reduce the error by more than this factor.
USEFUL_FACTOR = 1.05


def unexplained_variance(noise: FloatArray, error: FloatArray) -> FloatArray:
    """Variance of the part of an error that the model does not explain [rad²], (dof,)."""
    # noise: standard deviation [rad], (dof,). error [rad], (n, dof).
    return np.asarray(noise**2 + MODEL_ERROR**2 * (error**2).mean(axis=0))


def smooth_error(
    lifted: Lifted, error: FloatArray, noise: FloatArray, moved: FloatArray | float = 0.0
) -> FloatArray:
    """Part of an error that a disturbance of the drives explains [rad], (n, dof)."""
    # moved: response to all changes of set-points since the first run [rad], (n, dof). The model, a
    # random walk, applies to the error without this response: the remainder after learning has
    # peaks at reversals and corners. error [rad], (n, dof). noise [rad], (dof,).
    remaining = error - moved
    variance = float(np.mean(unexplained_variance(noise, remaining)))
    return np.asarray(lifted.smooth(remaining, lifted.choose_penalty(remaining, variance)) + moved)


class ErrorEstimate:
    """Estimate of the repeating and the non-repeating errors from all runs."""

    # spread: standard deviation of the errors that differ between runs [rad], (dof,).
    # best: index of the run whose set-points have the smallest repeating error.
    # q: set-points with the smallest repeating error, combined from all runs [rad], (count, dof).
    # error: repeating error of these set-points [rad], (n, dof).
    # removed: part of `error` that a change of the set-points removes [rad], (n, dof).
    # repeats: RMS of the repeating error of the best run [m].
    # differs: RMS of the errors that differ between runs, without white noise [m].
    # noise: RMS error that does not repeat, including noise of the measurement and the loops [m].
    # response_error: relative error of the model's response to changes of the set-points.
    # independent: number of independent values of the noise in a run.
    # step: fraction of the computed change with the smallest predicted error, by `response_error`.
    # expected: predicted RMS error of another run of the best set-points [m].
    # resolution: standard deviation of this RMS error due to noise [m].

    def __init__(self, lifted: Lifted, runs: tuple[LearningRun, ...]) -> None:
        self.lifted, self.runs = lifted, runs
        self._moves = np.array([lifted.respond(x.q - runs[0].q) for x in runs])
        self._errors = np.array([x.error for x in runs])
        self._white = np.array([x.noise**2 for x in runs])
        duration = float(lifted.t[-1] - lifted.t[0])
        self.independent = max(duration * float(lifted.nominal.servo.kp.min()), 1.0)
        self.spread = self._find_spread()
        self.differs = self._judge_spread()
        alone = []
        for moved in self._moves:
            mean, weights = self._mean_at(moved)
            white = np.sqrt((weights**2 * self._white).sum(axis=0))
            alone.append(lifted.judge(smooth_error(lifted, mean, white, moved)).rms)
        self.best = int(np.argmin(alone))
        self.repeats = alone[self.best]
        # Measurement noise in the drive loops moves a joint in the same way as noise of its
        # command.
        loops = np.random.default_rng(1).normal(size=lifted.planned.shape) * runs[-1].loop_noise
        self._in_loops = lifted.judge(lifted.respond_to(loops))
        self.response_error = self._compare()
        self.q, self.error, variance = self._combine()
        moved = lifted.respond(self.q - runs[0].q)
        self._penalty = lifted.choose_penalty(self.error - moved, variance)
        self._change, response = lifted.correct(self.error - moved, self._penalty)
        self.removed = moved - response
        measured = lifted.judge(self._unknown(np.sqrt(variance))).rms
        self.noise = float(np.hypot(measured, max(self._in_loops.rms, self.differs)))
        self.step = 1 / (1 + self.response_error**2)
        self.expected = float(np.hypot(self.repeats, self.noise if self.differs > 0 else 0.0))
        self.resolution = float(self.noise / np.sqrt(self.independent))

    def _find_spread(self) -> FloatArray:
        """Standard deviation of the errors that differ between runs [rad], (dof,)."""
        # The squared difference of the errors of two runs is twice the variance of the error that
        # does not repeat, plus a share (at least RESPONSE_ERROR**2) of the squared response to the
        # difference of the set-points. Two runs with different set-points do not determine both
        # parts, so the result is 0.
        pairs = list(combinations(range(len(self.runs)), 2))
        spread = np.zeros(self.lifted.dof)
        if len(pairs) == 1 and np.any(self._moves[1]):
            return spread
        if pairs:
            a, b = np.transpose(pairs)
            rests = self._errors - self._moves
            rests, moves = (((x[a] - x[b]) ** 2).mean(axis=1) for x in (rests, self._moves))
            floor = RESPONSE_ERROR**2 * moves
            observed = np.maximum(rests - self._white[a] - self._white[b] - floor, 0.0)
            scale = np.maximum(rests + floor, 1e-300)
            for j in range(len(spread)):
                rows = np.column_stack([np.full(len(pairs), 2.0), moves[:, j]])
                spread[j] = np.sqrt(nnls(rows / scale[:, [j]], observed[:, j] / scale[:, j])[0][0])
        # A spread below the white noise of one value cannot be distinguished from model errors.
        return np.where(spread > self.runs[-1].noise, spread, 0.0)

    def _judge_spread(self) -> float:
        """RMS tool error that differs between runs [m]; also reduces `independent`."""
        if not self.spread.any():
            return 0.0
        rests, squares = self._errors - self._moves, []
        for deviation in rests - rests.mean(axis=0):
            smooth = smooth_error(self.lifted, deviation, self.runs[-1].noise)
            size = np.sqrt((smooth**2).mean(axis=0))
            smooth *= self.spread / np.where(size > 0, size, 1.0)
            squares.append(self.lifted.judge(smooth).rms ** 2)
            power = np.abs(np.fft.rfft(smooth, axis=0)) ** 2
            free = 2 * power.sum() ** 2 / max(float((power**2).sum()), 1e-300)
            self.independent = min(self.independent, max(free, 1.0))
        return float(np.sqrt(np.mean(squares)))

    def _unknown(self, deviation: float) -> FloatArray:
        """Random sample of the error of `Lifted.smooth` that noise causes [rad], (n, dof)."""
        # deviation: standard deviation of the white noise [rad].
        random, shape = np.random.default_rng(0), self.runs[0].q.shape
        walk = random.normal(size=shape).cumsum(axis=0) * deviation / np.sqrt(self._penalty)
        error = self.lifted.respond(walk)
        white = random.normal(size=error.shape) * deviation
        return self.lifted.smooth(error + white, self._penalty) - error

    def correct(self, setbacks: int) -> FloatArray:
        """Set-points that remove the repeating error [rad], (count, dof); slower after setbacks."""
        if not setbacks:
            return np.asarray(self.runs[0].q + self._change)
        slow = self.lifted.correct(self.removed, self._penalty * SETBACK_FACTOR**setbacks)[0]
        return np.asarray(self.q + slow)

    def _mean_at(self, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Repeating error of set-points with the response `moved` [rad], and weights of runs."""
        # The weights, (runs, dof), are inverse variances of noise and model error.
        variance = RESPONSE_ERROR**2 * ((moved - self._moves) ** 2).mean(axis=1)
        weights = 1 / np.maximum(self.spread**2 + self._white + variance, 1e-300)
        weights /= weights.sum(axis=0)
        mean = np.einsum("kj,knj->nj", weights, self._errors - self._moves + moved)
        return mean, weights

    def _compare(self) -> float:
        """Relative error of the model's response, by the newest run that differs from the best."""
        # White noise, the error that does not repeat, and noise in the loops are subtracted.
        # RESPONSE_ERROR is returned if all runs have the same set-points.
        lifted, best = self.lifted, self.best
        for k in reversed(range(len(self.runs))):
            moved = self._moves[k] - self._moves[best]
            size = lifted.judge(moved).tool_rms if np.any(moved) else 0.0
            if size == 0.0:
                continue
            miss = self._errors[k] - self._errors[best] - moved
            white = self._white[k] + self._white[best] + MODEL_ERROR**2 * miss.var(axis=0)
            smooth = lifted.smooth(miss, lifted.choose_penalty(miss, float(np.mean(white))))
            share = 2 * float(np.mean(self.spread**2)) / max(float(np.mean(smooth**2)), 1e-300)
            square = lifted.judge(smooth).tool_rms ** 2 * max(1 - share, 0.0)
            return float(np.sqrt(max(square - 2 * self._in_loops.tool_rms**2, 0.0))) / size
        return RESPONSE_ERROR

    def _combine(self) -> tuple[FloatArray, FloatArray, float]:
        """Set-points that combine all runs [rad], their error [rad], and noise variance [rad²]."""
        # The error of a linear robot is an affine function of the set-points, so a weighted mean of
        # runs (weights may be negative) has the weighted mean of their errors. The weights of each
        # joint minimise the error, its noise and its nonlinear part. The model adds the coupling of
        # the joints. Then the result is averaged with the mean error of all runs.
        best, errors, spread = self.best, self._errors, self.spread**2
        moved = self._moves - self._moves[best]
        # gain: share of the differences between runs that is an effect of their set-points.
        power, unmoved = (moved**2).sum(axis=1), 2 * len(moved[0]) * spread
        gain = np.where(unmoved > 0, power / np.maximum(power + unmoved, 1e-300), 1.0)
        apart = gain[:, None] * (errors - errors[best])
        squares, count = (apart**2).sum(axis=1), len(errors[0])
        noise = np.array([unexplained_variance(x.noise, x.error) for x in self.runs])
        weights = np.zeros_like(noise)
        others = np.arange(len(noise)) != best
        for j in range(self.lifted.dof if others.any() else 0):
            # Least squares of the mean error, regularized by its noise and nonlinear part.
            columns = apart[others, :, j]
            variance = COMBINATION_ERROR**2 * squares[others, j] + count * (
                noise[others, j] + spread[j]
            )
            square = columns @ columns.T + np.diag(variance)
            right = -columns @ errors[best, :, j]
            weights[others, j] = np.linalg.lstsq(square, right, rcond=None)[0]
        weights[best] = 1 - weights.sum(axis=0)
        q = np.einsum("kj,knj->nj", weights, [x.q for x in self.runs])
        change = self.lifted.respond(q - self.runs[best].q)
        error = errors[best] + np.einsum("kj,knj->nj", weights, apart - moved) + change
        # The mean of all runs has less noise. Therefore it is averaged with the combination, with
        # inverse variances as weights.
        variance = (weights**2 * (noise + spread + COMBINATION_ERROR**2 * squares / count)).sum(
            axis=0
        )
        mean, each = self._mean_at(change + self._moves[best])
        share = variance / np.maximum(variance + (each**2 * (noise + spread)).sum(axis=0), 1e-300)
        error += share * (mean - error)
        weights += share * (each - weights)
        return q, error, float(np.mean((weights**2 * noise).sum(axis=0)))

    @property
    def is_noise(self) -> bool:
        """True if another run cannot reduce the error by more than the factor USEFUL_FACTOR."""
        after = np.sqrt(1 + 1 / len(self.runs))
        return bool(np.hypot(self.repeats, self.noise) <= USEFUL_FACTOR * after * self.noise)
