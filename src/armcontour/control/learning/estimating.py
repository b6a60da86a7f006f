"""What runs tell: the noise, the error that repeats, and how far the model is off."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from armcontour.control.learning.lesson import LearningRun
from armcontour.control.learning.lifted import Lifted
from armcontour.core.checks import FloatArray

# The relative error of the model's response where the model is right, from tests of `Response`.
MODEL = 1e-3
# The response counts as off by this fraction, at least: runs that tell less moved far, and small
# changes meet friction, which is not linear.
UNTESTED = 0.3
# Errors of set-points between or beyond those of runs are off by this fraction, as friction is not
# linear.
LINEAR = 0.3
# Each setback forbids changes that are ten times as slow.
SLOWER = 100.0
# Another run is worth while if it can reduce the error by more than this factor.
WORTH = 1.05


def model_error(noise: FloatArray, error: FloatArray) -> FloatArray:
    """Variance of what the model need not explain in an error [rad²], (dof,).

    Args:
        noise: Standard deviation of the white noise in the error [rad], (dof,).
        error: Errors of the joints [rad], (n, dof).
    """
    return np.asarray(noise**2 + MODEL**2 * (error**2).mean(axis=0))


def smooth_error(
    lifted: Lifted, error: FloatArray, noise: FloatArray, moved: FloatArray | float = 0.0
) -> FloatArray:
    """The part of an error that a disturbance of the drives explains [rad], (n, dof).

    A random walk describes the disturbance, but not what learned set-points leave of it: these are
    peaks, as at reversals and corners.

    Args:
        lifted: The model.
        error: Errors of the joints [rad], (n, dof).
        noise: Standard deviation of the white noise in the error [rad], (dof,).
        moved: Response to the change of the set-points since the first run [rad], (n, dof).
    """
    rest = error - moved
    variance = float(np.mean(model_error(noise, rest)))
    return np.asarray(lifted.smooth(rest, lifted.choose_penalty(rest, variance)) + moved)


class Estimate:
    """What runs tell together.

    Args:
        lifted: The model.
        runs: The runs, in order.

    Attributes:
        spread: Standard deviation of the errors that differ between runs [rad], (dof,).
        best: Index of the run whose set-points have the smallest repeating error.
        q: Set-points that all runs together say have the least error [rad], (count, dof).
        error: Their repeating error [rad], (n, dof).
        repeats: RMS error of the best run that repeats [m].
        differs: RMS error that differs between runs [m].
        noise: RMS error that does not repeat, with noise of the measurement and of the loops [m].
        removed: The part of `error` that a change of the set-points removes [rad], (n, dof).
        off: Relative error of the model's response, by the last run that was predicted.
        independent: Number of independent values of the noise in a run.
        step: The share of a change that leaves least error if its response is off by `off`.
        expected: RMS error of another run of the best set-points [m].
        resolution: Standard deviation of a run's RMS error by noise [m].
    """

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
        # Noise of a position measurement moves the joint as noise of the command does.
        loops = np.random.default_rng(1).normal(size=lifted.planned.shape) * runs[-1].loop_noise
        self._in_loops = lifted.judge(lifted.respond_to(loops))
        self.off = self._compare()
        self.q, self.error, variance = self._combine()
        moved = lifted.respond(self.q - runs[0].q)
        self._penalty = lifted.choose_penalty(self.error - moved, variance)
        self._change, response = lifted.correct(self.error - moved, self._penalty)
        self.removed = moved - response
        measured = lifted.judge(self._unknown(np.sqrt(variance))).rms
        self.noise = float(np.hypot(measured, max(self._in_loops.rms, self.differs)))
        self.step = 1 / (1 + self.off**2)
        self.expected = float(np.hypot(self.repeats, self.noise if self.differs > 0 else 0.0))
        self.resolution = float(self.noise / np.sqrt(self.independent))

    def _find_spread(self) -> FloatArray:
        """The standard deviation of errors that differ between runs [rad], (dof,).

        The squared difference of two runs is twice the variance of what does not repeat, and a
        share of the square of what the model says of their set-points: UNTESTED or more. Two runs
        of different set-points cannot tell these apart.
        """
        pairs = list(combinations(range(len(self.runs)), 2))
        found = np.zeros(self.lifted.dof)
        if len(pairs) == 1 and np.any(self._moves[1]):
            return found
        if pairs:
            a, b = np.transpose(pairs)
            rests = self._errors - self._moves
            rests, moves = (((x[a] - x[b]) ** 2).mean(axis=1) for x in (rests, self._moves))
            floor = UNTESTED**2 * moves
            seen = np.maximum(rests - self._white[a] - self._white[b] - floor, 0.0)
            scale = np.maximum(rests + floor, 1e-300)
            for j in range(len(found)):
                rows = np.column_stack([np.full(len(pairs), 2.0), moves[:, j]])
                found[j] = np.sqrt(nnls(rows / scale[:, [j]], seen[:, j] / scale[:, j])[0][0])
        # Less than the white noise of one value cannot be told from errors of the model.
        return np.where(found > self.runs[-1].noise, found, 0.0)

    def _judge_spread(self) -> float:
        """RMS error of the tool that differs between runs [m]; how many values of it are free."""
        if not self.spread.any():
            return 0.0
        rests, squares = self._errors - self._moves, []
        for rest in rests - rests.mean(axis=0):
            off = smooth_error(self.lifted, rest, self.runs[-1].noise)
            size = np.sqrt((off**2).mean(axis=0))
            off *= self.spread / np.where(size > 0, size, 1.0)
            squares.append(self.lifted.judge(off).rms ** 2)
            power = np.abs(np.fft.rfft(off, axis=0)) ** 2
            free = 2 * power.sum() ** 2 / max(float((power**2).sum()), 1e-300)
            self.independent = min(self.independent, max(free, 1.0))
        return float(np.sqrt(np.mean(squares)))

    def _unknown(self, deviation: float) -> FloatArray:
        """An error as probable as the one that noise leaves unknown [rad], (n, dof).

        Args:
            deviation: Standard deviation of the noise [rad].
        """
        random, shape = np.random.default_rng(0), self.runs[0].q.shape
        walk = random.normal(size=shape).cumsum(axis=0) * deviation / np.sqrt(self._penalty)
        error = self.lifted.respond(walk)
        white = random.normal(size=error.shape) * deviation
        return self.lifted.smooth(error + white, self._penalty) - error

    def correct(self, setbacks: int) -> FloatArray:
        """Set-points without the error that repeats [rad], (count, dof).

        Args:
            setbacks: Number of setbacks; each forbids changes that are ten times as slow.
        """
        if not setbacks:
            return np.asarray(self.runs[0].q + self._change)
        slow = self.lifted.correct(self.removed, self._penalty * SLOWER**setbacks)[0]
        return np.asarray(self.q + slow)

    def _mean_at(self, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The error that repeats for set-points with a response, by all runs [rad], (n, dof).

        Runs count by the inverse variance of their noise and of the error of the model; these
        weights are returned, too, (runs, dof).
        """
        off = UNTESTED**2 * ((moved - self._moves) ** 2).mean(axis=1)
        weights = 1 / np.maximum(self.spread**2 + self._white + off, 1e-300)
        weights /= weights.sum(axis=0)
        found = np.einsum("kj,knj->nj", weights, self._errors - self._moves + moved)
        return found, weights

    def _compare(self) -> float:
        """How far the model's response is off, relatively, by the last run but the best one.

        White noise, what does not repeat and the noise in the loops of both runs do not count.
        """
        lifted, best = self.lifted, self.best
        for k in reversed(range(len(self.runs))):
            moved = self._moves[k] - self._moves[best]
            size = lifted.judge(moved).tool_rms if np.any(moved) else 0.0
            if size == 0.0:
                continue
            miss = self._errors[k] - self._errors[best] - moved
            white = self._white[k] + self._white[best] + MODEL**2 * miss.var(axis=0)
            left = lifted.smooth(miss, lifted.choose_penalty(miss, float(np.mean(white))))
            share = 2 * float(np.mean(self.spread**2)) / max(float(np.mean(left**2)), 1e-300)
            square = lifted.judge(left).tool_rms ** 2 * max(1 - share, 0.0)
            return float(np.sqrt(max(square - 2 * self._in_loops.tool_rms**2, 0.0))) / size
        return UNTESTED

    def _combine(self) -> tuple[FloatArray, FloatArray, float]:
        """Set-points between or beyond those of the runs, with the least error by all runs.

        The error is an affine function of the set-points, whatever the robot is, as far as it is
        linear: a mean of runs, with weights that may be negative, has the mean of their errors.
        Every joint has its own weights, which the model's coupling of joints is added to. Noise
        and what is not linear keep the weights small. What does not repeat is averaged.

        Returns:
            The set-points [rad], their error [rad], and the variance of its noise [rad²].
        """
        best, errors, spread = self.best, self._errors, self.spread**2
        moved = self._moves - self._moves[best]
        # What differs between runs is no effect of set-points.
        power, unmoved = (moved**2).sum(axis=1), 2 * len(moved[0]) * spread
        gain = np.where(unmoved > 0, power / np.maximum(power + unmoved, 1e-300), 1.0)
        apart = gain[:, None] * (errors - errors[best])
        squares, count = (apart**2).sum(axis=1), len(errors[0])
        noise = np.array([model_error(x.noise, x.error) for x in self.runs])
        weights = np.zeros_like(noise)
        others = np.arange(len(noise)) != best
        for j in range(self.lifted.dof if others.any() else 0):
            # The smallest error of the mean, and of its noise.
            columns = apart[others, :, j]
            own = LINEAR**2 * squares[others, j] + count * (noise[others, j] + spread[j])
            square = columns @ columns.T + np.diag(own)
            weights[others, j] = np.linalg.lstsq(square, -columns @ errors[best, :, j])[0]
        weights[best] = 1 - weights.sum(axis=0)
        q = np.einsum("kj,knj->nj", weights, [x.q for x in self.runs])
        change = self.lifted.respond(q - self.runs[best].q)
        error = errors[best] + np.einsum("kj,knj->nj", weights, apart - moved) + change
        # The mean of all runs has less noise; it counts by its share of the variance.
        own = (weights**2 * (noise + spread + LINEAR**2 * squares / count)).sum(axis=0)
        mean, each = self._mean_at(change + self._moves[best])
        share = own / np.maximum(own + (each**2 * (noise + spread)).sum(axis=0), 1e-300)
        error += share * (mean - error)
        weights += share * (each - weights)
        return q, error, float(np.mean((weights**2 * noise).sum(axis=0)))

    @property
    def is_noise(self) -> bool:
        """Whether the error that repeats is so small that one more run hardly helps."""
        after = np.sqrt(1 + 1 / len(self.runs))
        return bool(np.hypot(self.repeats, self.noise) <= WORTH * after * self.noise)
