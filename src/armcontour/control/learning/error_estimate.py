"""`ErrorEstimate`: the best run, its repeating error, noise, and error of the model's response."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from armcontour.control.learning.learning_result import LearningRun
from armcontour.control.learning.lifted_model import REST_TIME, Lifted, rms
from armcontour.core.checks import FloatArray

# Relative error of the linearized response of an exact model, from tests of `Response`.
MODEL_ERROR = 1e-3
# The response error counts CAUTION times in the next step, because the errors that remain have
# higher frequencies, at which the response of the servo model is less certain.
CAUTION = 2.0
# The mean square of white noise over REST_TIME stays below this multiple of its variance.
NOISE_MARGIN = 1.5
# A change of the set-points is useful if it reduces the error by more than this factor.
USEFUL_FACTOR = 1.05


def smooth_error(lifted: Lifted, error: FloatArray, noise: FloatArray) -> FloatArray:
    """Error without white noise [rad], (n, dof)."""
    # The error is the part that a disturbance of the drives explains, and the remainder where it
    # exceeds the noise (a Wiener filter). noise: standard deviation of the white noise [rad],
    # (dof,).
    smooth = lifted.smooth(error, lifted.choose_penalty(error, float(np.mean(noise**2))))
    remainder = error - smooth
    power = uniform_filter1d(remainder**2, round(REST_TIME / lifted.step), axis=0)
    gain = 1 - NOISE_MARGIN * noise**2 / np.maximum(power, 1e-300)
    return np.asarray(smooth + np.maximum(gain, 0.0) * remainder)


class ErrorEstimate:
    """The best run, its repeating error, and the set-points that remove this error."""

    # best: index of the run with the smallest measured error.
    # count: number of runs with the set-points of the best run.
    # error: repeating error of these runs, their mean without white noise [rad], (n, dof).
    # repeats: RMS of the repeating error at the tool [m].
    # noise: RMS difference of runs with equal set-points from their mean [m]; None if there are no
    # such runs.
    # q: set-points that remove the repeating error [rad], (count, dof).
    # response_error: relative error of the model's response to the newest change of the set-points;
    # 0 if all runs have the same set-points.
    # steps: fraction of the change that each joint makes, according to the error of its response,
    # (dof,).

    def __init__(self, lifted: Lifted, runs: tuple[LearningRun, ...]) -> None:
        self._lifted, self._runs = lifted, runs
        self.best = int(np.argmin([x.rms for x in runs]))
        best = runs[self.best]
        equal = [x for x in runs if np.array_equal(x.q, best.q)]
        self.count = len(equal)
        # The model of the correction, a random walk, applies to the change since the first run. It
        # does not apply to the remaining error, which has peaks at reversals and corners.
        moved = lifted.respond(best.q - runs[0].q)
        remaining = np.mean([x.error for x in equal], axis=0) - moved
        noise = best.noise**2 / self.count + MODEL_ERROR**2 * (remaining**2).mean(axis=0)
        penalty = lifted.choose_penalty(remaining, float(np.mean(noise)))
        change, response = lifted.correct(remaining, penalty)
        self.q = np.asarray(runs[0].q + change)
        self.error = moved - response
        self.repeats = lifted.judge(self.error).rms
        self.noise = self._find_noise()
        self.response_error, self.steps = self._compare()

    def _find_noise(self) -> float | None:
        """RMS tool error that differs between runs of equal set-points [m]; None if unknown."""
        groups: dict[bytes, list[LearningRun]] = {}
        for run in self._runs:
            groups.setdefault(run.q.tobytes(), []).append(run)
        squares, freedom = 0.0, len(self._runs) - len(groups)
        for group in groups.values():
            mean = np.mean([x.error for x in group], axis=0)
            for run in group if len(group) > 1 else ():
                deviation = smooth_error(self._lifted, run.error - mean, run.noise)
                squares += self._lifted.judge(deviation).rms ** 2
        return float(np.sqrt(squares / freedom)) if freedom else None

    def _compare(self) -> tuple[float, FloatArray]:
        """Relative error of the response to the newest change of the set-points, and the steps."""
        best = self._runs[self.best]
        for run in reversed(self._runs):
            if not np.array_equal(run.q, best.q):
                moved = self._lifted.respond(run.q - best.q)
                miss = run.error - best.error - moved
                miss = smooth_error(self._lifted, miss, np.hypot(run.noise, best.noise))
                ratios = np.mean(miss**2, axis=0) / np.maximum(np.mean(moved**2, axis=0), 1e-300)
                return rms(miss) / rms(moved), 1 / (1 + CAUTION**2 * ratios)
        return 0.0, np.ones(self._lifted.dof)

    @property
    def is_noise(self) -> bool:
        """True if runs of equal set-points differ by more than the repeating error."""
        return self.noise is not None and self.count > 1 and self.repeats <= self.noise
