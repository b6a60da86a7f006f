"""What runs tell: the noise, the error that repeats, and how far the model is off."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.learning.judging import Judge, ToolError
from armcontour.learning.lesson import LearnedRun, find_best
from armcontour.learning.lifted import Lifted
from armcontour.learning.recording import Recording

# The relative error of the model's response where the model is right, from tests of `Response`.
MODEL = 1e-3
# The response counts as off by this fraction, at least: runs that tell less moved far, and small
# changes meet friction, which is not linear.
UNTESTED = 0.3
# Errors of set-points between or beyond those of runs are off by this fraction, as friction is not
# linear.
LINEAR = 0.3
# The median of absolute values of a normal distribution with standard deviation 1.
MEDIAN = 0.6745
# Usual cycle time of a drive [s], where the recording does not tell.
CYCLE = 2.5e-4
# Differences that hardly see smooth motion.
FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
# Weights of a mean over neighbours.
NO_MEAN, MEAN = np.array([1.0]), np.array([0.25, 0.5, 0.25])


def white_noise(values: FloatArray, kernel: FloatArray = NO_MEAN) -> FloatArray:
    """Standard deviation of the white noise in columns of regular samples, (dof,).

    By fourth differences, which hardly see smooth motion; their median ignores what is not smooth
    for a short time, as friction at a reversal.

    Args:
        values: Samples, (n, dof).
        kernel: Weights of the mean over neighbours that was taken of the noise.
    """
    if len(values) < len(FOURTH):
        return np.zeros(values.shape[1])
    fourth = np.abs(np.diff(values, 4, axis=0))
    size = np.linalg.norm(np.convolve(FOURTH, kernel))
    return np.asarray(np.median(fourth, axis=0) / (MEDIAN * size))


def loop_noise(
    lifted: Lifted, recording: Recording, unexplained: FloatArray, noise: FloatArray
) -> FloatArray:
    """Standard deviation of the noise of measured positions in the joints' loops [rad], (dof,).

    Exact positions show this noise in the command that explains them. In measured positions the
    encoders' noise hides it, but the loops have the same noise in every cycle.

    Args:
        lifted: The model.
        recording: What was measured.
        unexplained: Difference of the joints from what is expected [rad], (n, dof).
        noise: White noise of the measurement [rad], (dof,).
    """
    if recording.exact:
        return white_noise(lifted.equivalent_command(unexplained), MEAN)
    return np.asarray(noise * np.sqrt(min(CYCLE, recording.interval) / lifted.step))


def unexplained(noise: FloatArray, error: FloatArray) -> FloatArray:
    """Variance of what the model need not explain in an error [rad²], (dof,).

    Args:
        noise: Standard deviation of the white noise in the error [rad], (dof,).
        error: Errors of the joints [rad], (n, dof).
    """
    return np.asarray(noise**2 + MODEL**2 * (error**2).mean(axis=0))


def _weigh(apart: FloatArray, error: FloatArray, noise: FloatArray) -> FloatArray:
    """Weights of runs with which the error of the best run, and of their noise, is smallest.

    Args:
        apart: Differences of the runs' errors from the best one's [rad], (n, runs).
        error: The best run's error [rad], (n,).
        noise: Variance of the runs' noise [rad²], (runs,).
    """
    power = (apart**2).sum(axis=0)
    square = apart.T @ apart + np.diag(LINEAR**2 * power + len(error) * noise)
    return np.asarray(np.linalg.lstsq(square, -apart.T @ error, rcond=None)[0])


class Estimate:
    """What runs tell together.

    Args:
        lifted: The model.
        judge: What errors of joints do to the tool.
        runs: The runs, in order.

    Attributes:
        best: Index of the best run.
        q: Set-points that all runs together say have the least error [rad], (count, dof).
        error: Their error [rad], (n, dof).
        noise: RMS error that does not repeat [m].
        penalty: As `choose_penalty` gives it, for the error that repeats.
        off: Relative error of the model's response, by the last run that was predicted.
        independent: Number of independent values of the noise in a run.
    """

    def __init__(self, lifted: Lifted, judge: Judge, runs: tuple[LearnedRun, ...]) -> None:
        self.lifted, self.judge, self.runs = lifted, judge, runs
        self.best = find_best(runs)
        self._moved = [lifted.respond(x.q - runs[self.best].q) for x in runs]
        self.off = self._compare()
        self.q, self.error, variance = self._combine()
        self.penalty = lifted.choose_penalty(self.error, variance)
        self.noise = float(np.hypot(self._measured_noise(), self._noise_in_loops().rms))
        duration = float(lifted.t[-1] - lifted.t[0])
        self.independent = max(duration * float(lifted.nominal.servo.kp.min()), 1.0)

    def _compare(self) -> float:
        """How far the model's response is off, relatively, by the last run but the best one.

        White noise and the noise in the loops of both runs do not count.
        """
        best, off = self.runs[self.best], UNTESTED
        for run, moved in zip(self.runs, self._moved, strict=True):
            size = 0.0 if run is best else self.judge.judge(moved).tool_rms
            if size == 0.0:
                continue
            miss = run.error - best.error - moved
            variance = float(np.mean(run.noise**2 + best.noise**2 + MODEL**2 * miss.var(axis=0)))
            left = self.lifted.smooth(miss, self.lifted.choose_penalty(miss, variance))
            unrepeated = 2 * self._noise_in_loops().tool_rms ** 2
            off = float(np.sqrt(max(self.judge.judge(left).tool_rms ** 2 - unrepeated, 0.0))) / size
        return off

    def _combine(self) -> tuple[FloatArray, FloatArray, float]:
        """Set-points between or beyond those of the runs, with the least error by all runs.

        The error is an affine function of the set-points, whatever the robot is, as far as it is
        linear: a mean of runs, with weights that may be negative, has the mean of their errors.
        Every joint has its own weights, which the model's coupling of joints is added to. Noise
        and what is not linear keep the weights small.

        Returns:
            The set-points [rad], their error [rad], and the variance of its noise [rad²].
        """
        best = self.runs[self.best]
        others = [k for k in range(len(self.runs)) if k != self.best]
        apart = [self.runs[k].error - best.error for k in others]
        weights = np.zeros((len(others), self.lifted.dof))
        noise = np.array([unexplained(x.noise, x.error) for x in self.runs])
        for j in range(self.lifted.dof):
            if others:
                columns = np.stack([x[:, j] for x in apart], axis=1)
                weights[:, j] = _weigh(columns, best.error[:, j], noise[others, j])
        q, error = best.q.copy(), best.error.copy()
        for k, weight, off in zip(others, weights, apart, strict=True):
            q += weight * (self.runs[k].q - best.q)
            error += weight * (off - self._moved[k])
        error += self.lifted.respond(q - best.q)
        shares = np.vstack([weights, 1 - weights.sum(axis=0)])
        variances = np.vstack([noise[others], noise[self.best]])
        return q, error, float(np.mean((shares**2 * variances).sum(axis=0)))

    def _measured_noise(self) -> float:
        """RMS error of the tool that white noise of the measurement leaves in errors [m]."""
        noise = np.random.default_rng(0).normal(size=self.error.shape)
        left = self.lifted.smooth(noise * self.runs[-1].noise, self.penalty)
        return self.judge.judge(left).rms

    def _noise_in_loops(self) -> ToolError:
        """Errors of the tool that noise in the loops makes.

        Noise of a position measurement moves the joint as noise of the command does.
        """
        noise = np.random.default_rng(1).normal(size=self.lifted.planned.shape)
        return self.judge.judge(self.lifted.respond_to(noise * self.runs[-1].loop_noise))

    @property
    def step(self) -> float:
        """The share of a change that leaves least error if its response is off by `off`."""
        return 1 / (1 + self.off**2)

    @property
    def resolution(self) -> float:
        """Standard deviation of a run's RMS error by noise [m]."""
        return float(self.noise / np.sqrt(self.independent))
