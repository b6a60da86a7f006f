"""Contour errors of logs with and without compensation, from the residuals of the models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from armcontour.control.identification.identification_result import JointIdentification
from armcontour.control.identification.residual_tests import FEWEST_LINES, is_white
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.sampled_data import interpolate
from armcontour.motion.log import Log
from armcontour.robot import Arm

# Spacing of the samples from which contour errors are computed [s].
SPACING = 4e-3
# Without an arm, errors of a joint are divided by its RMS tracking error, or by this fraction of
# the largest tracking error if that is larger. Then the noise of a joint that hardly moves is not
# amplified.
LEAST_WEIGHT = 0.1
# Number of Newton steps in the search for a delay.
NEWTON_STEPS = 3
# The delay of the contour is searched from minus this value to the longest delay of a joint plus
# this value [s].
DELAY_MARGIN = 0.1
# Fewer contour errors than this cannot be tested for whiteness.
FEWEST_TESTED = 4 * FEWEST_LINES
# Lower bound of divisors.
TINY = 1e-30
# What is written of a joint: no model, only its delay, or its model. PROGRAM is the model, judged
# on the program by fits of the program's other parts.
NONE = "none"
DELAY_ONLY = "delay"
MODEL = "model"
PROGRAM = "program"


class Deviations(NamedTuple):
    """RMS deviations of the motion in one log from its commands."""

    contour: float  # RMS contour error, see `Judgement.errors`
    joints: FloatArray  # RMS deviation of each joint from the contour [rad], (dof,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogSamples:
    """Samples of a log, and what remains of the tracking error with each written model."""

    t: FloatArray  # Times since the start of the log [s], (n,)
    command: FloatArray  # Commands [rad], (n, dof)
    use: BoolArray  # Mask of the samples that count, (n,)
    # Residuals with NONE, DELAY_ONLY, MODEL and, for a program, PROGRAM [rad], (n, dof) each.
    residuals: dict[str, FloatArray]

    @classmethod
    def of(
        cls, logs: Sequence[Log], i: int, joints: Sequence[JointIdentification], longest: float
    ) -> LogSamples:
        """Sample log i; the delays of the joints are those in the other logs, at most `longest`."""
        log = logs[i]
        others = [x for k, x in enumerate(logs) if k != i]
        delays = find_joint_delays(others or logs, longest)
        columns = [x.rests[i] if x.rests else np.full(len(log.t), np.nan) for x in joints]
        model = np.stack(columns, axis=1)
        predicted = np.isfinite(model)
        use = (predicted | ~predicted.any(axis=0)).all(axis=1)
        use = use if use.any() else np.full(len(use), True)
        delayed = [interpolate(log.t - x, log.t, log.command[:, [j]]) for j, x in enumerate(delays)]
        late = log.measured - np.concatenate(delayed, axis=1)
        # An offset is no error of the model. A mean lag is one, so the mean is not subtracted.
        means = late[use].mean(axis=0)
        offsets = [
            x.offsets.get(i, mean) if x.written else mean
            for x, mean in zip(joints, means, strict=True)
        ]
        residuals = {
            NONE: log.measured - log.command - offsets,
            DELAY_ONLY: late - offsets,
            MODEL: np.where(predicted, model, 0.0),
        }
        if all(len(x.program_rest) == len(log.t) for x in joints if x.rests):
            rests = [x.program_rest if x.rests else np.zeros(len(log.t)) for x in joints]
            residuals[PROGRAM] = np.nan_to_num(np.stack(rests, axis=1))
        stride = max(int(SPACING / log.interval * (1 + 1e-6)), 1)
        return cls(
            t=log.t[::stride] - log.t[0],
            command=log.command[::stride],
            use=use[::stride],
            residuals={name: x[::stride] for name, x in residuals.items()},
        )

    def move(self, choice: Sequence[str]) -> FloatArray:
        """Return the motion that compensation would leave [rad], (n, dof).

        - `choice`: what is written of each joint, a key of `residuals`.
        """
        columns = [self.residuals[name][:, j] for j, name in enumerate(choice)]
        return self.command + np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContourComparison:
    """Contour errors in all logs, for any choice of the models that are written."""

    samples: list[LogSamples]
    arm: Arm | None
    delays: FloatArray  # Delay of each joint with the smallest tracking error [s], (dof,)
    weight: FloatArray  # Weight of the deviations of each joint without an arm [1/rad], (dof,)
    least_signal: float  # See `_remove_noise`
    # Deviations in each log if nothing is written
    none: list[Deviations] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        logs: Sequence[Log],
        joints: Sequence[JointIdentification],
        longest: float,
        arm: Arm | None,
    ) -> ContourComparison:
        """Compare the logs; `longest` is the longest dead time of the search [s]."""
        samples = [LogSamples.of(logs, i, joints, longest) for i in range(len(logs))]
        tracking = residual_rms(samples, NONE)
        comparison = cls(
            samples=samples,
            arm=arm,
            delays=find_joint_delays(logs, longest),
            weight=1 / np.maximum(tracking, max(LEAST_WEIGHT * float(tracking.max()), TINY)),
            least_signal=_parameters_per_sample(joints, logs),
        )
        return replace(comparison, none=comparison.deviate([NONE] * len(joints)))

    def deviate(self, choice: Sequence[str]) -> list[Deviations]:
        """Return the deviations in each log; `choice` as in `LogSamples.move`."""
        return [self.deviate_in(x, choice) for x in self.samples]

    def deviate_in(self, samples: LogSamples, choice: Sequence[str]) -> Deviations:
        """Return the deviations in one log; `choice` as in `LogSamples.move`."""
        motion = samples.move(choice)
        if self.arm is None:
            times = samples.t - self._find_common_delay(samples, motion)
            deviations = motion - interpolate(times, samples.t, samples.command)
            errors = deviations * self.weight
        else:
            path = self.arm.tool_position(samples.command)
            tool = self.arm.tool_position(motion)
            reach = (self._longest_delay + DELAY_MARGIN) / float(np.median(np.diff(samples.t)))
            rows = np.arange(len(path), dtype=np.float64)
            window = int(np.ceil(reach))
            positions = find_nearest_rows(path, tool, window)
            errors = tool - interpolate(positions, rows, path)
            # A joint that hardly moves the tool, such as the last one, has no distance from the
            # tool's path. The deviations are those from the path of all joints.
            curve = samples.command * self.weight
            along = find_nearest_rows(curve, motion * self.weight, window)
            times = np.interp(along, rows, samples.t)
            deviations = motion - interpolate(times, samples.t, samples.command)
        if set(choice) == {NONE}:
            square = float(np.mean(np.sum(errors[samples.use] ** 2, axis=1)))
        else:
            square = _remove_noise(errors, samples.use, self.least_signal)
        joint_rms = np.sqrt(np.mean(deviations[samples.use] ** 2, axis=0))
        return Deviations(contour=math.sqrt(square), joints=joint_rms)

    def noise(self, noises: FloatArray) -> float:
        """Return the RMS contour error that the noise of the encoders alone causes.

        - `noises`: standard deviation of each joint's noise [rad], (dof,).
        """
        if self.arm is None:
            return float(np.linalg.norm(noises * self.weight))
        moves = self.arm.tool_jacobian(self.samples[0].command) * noises
        return float(np.sqrt(np.mean(np.sum(moves**2, axis=(1, 2)))))

    @property
    def _longest_delay(self) -> float:
        """Longest delay of a joint [s]."""
        return float(self.delays.max())

    def _find_common_delay(self, samples: LogSamples, motion: FloatArray) -> float:
        """Return the common delay of all joints, which causes no contour error [s].

        - `motion`: motion of the joints [rad], (n, dof).

        A single joint has no contour, so each delay counts as an error.
        """
        if len(self.weight) == 1:
            return 0.0
        weighted = (samples.t, samples.command * self.weight, motion * self.weight)
        return find_delay([weighted], -DELAY_MARGIN, self._longest_delay + DELAY_MARGIN)


def residual_rms(samples: Sequence[LogSamples], written: str) -> FloatArray:
    """Return the RMS residual of each joint [rad], (dof,), with one key of `residuals`."""
    residuals = np.concatenate([x.residuals[written] for x in samples])
    return np.asarray(np.sqrt(np.mean(residuals**2, axis=0)))


def _remove_noise(errors: FloatArray, use: BoolArray, least_signal: float) -> float:
    """Return the mean square of contour errors, (n, k), without the encoders' noise.

    The noise is white, so it does not correlate in neighbouring samples, and the mean product of
    neighbours is the mean square of the other errors. If the errors are white, the log contains no
    motion that the models do not explain. The errors of the models are then those of their
    parameters, because p parameters were fitted to n samples with noise. Their mean square is the
    fraction p / n of the noise's (L. Ljung, System Identification, 2nd ed., section 16.4).

    - `use`: mask of the samples that count, (n,).
    - `least_signal`: p / n.
    """
    used = errors[use]
    least = least_signal * float(np.mean(np.sum(used**2, axis=1)))
    moving = [x for x in used.T if np.ptp(x) > 0]
    if len(used) >= FEWEST_TESTED and all(is_white(x, step=0.0) for x in moving):
        return least
    pairs = np.sum(errors[1:] * errors[:-1], axis=1)[use[1:] & use[:-1]]
    return max(float(np.mean(pairs)), least)


def _parameters_per_sample(joints: Sequence[JointIdentification], logs: Sequence[Log]) -> float:
    """Return the largest number of a joint's parameters, divided by the number of samples."""
    samples = sum(len(x.t) for x in logs)
    return max(len(x.parameters) for x in joints) / samples


def find_joint_delays(logs: Sequence[Log], longest: float) -> FloatArray:
    """Return the delay of each joint with the smallest tracking error [s], (dof,).

    - `longest`: largest delay [s].
    """
    delays = []
    for j in range(logs[0].dof):
        motions = [(x.t, x.command[:, [j]], x.measured[:, [j]]) for x in logs]
        delays.append(find_delay(motions, 0.0, longest))
    return np.array(delays)


def find_delay(
    motions: Sequence[tuple[FloatArray, FloatArray, FloatArray]], low: float, high: float
) -> float:
    """Return the delay d from `low` to `high` with the smallest tracking error [s].

    Newton's method minimizes the sum of (q(t) - u(t - d))², about the mean, with the positions q
    and the commands u. The step is `sum((q - u) du) / sum(du²)` with the rate du of the command.

    - `motions`: times [s], (n,), commands and positions, (n, k) each, of each log.
    """
    delay = 0.0
    for _ in range(NEWTON_STEPS):
        numerator = denominator = 0.0
        for t, command, q in motions:
            errors = q - interpolate(t - delay, t, command)
            rate = interpolate(t - delay, t, np.gradient(command, t, axis=0))
            numerator -= float(np.sum((errors - errors.mean(axis=0)) * rate))
            denominator += float(np.sum(rate**2))
        delay = float(np.clip(delay + numerator / max(denominator, TINY), low, high))
    return delay


def find_nearest_rows(curve: FloatArray, points: FloatArray, reach: int) -> FloatArray:
    """Return fractional indices of the curve's points that are nearest to each point, (n,).

    - `curve`, `points`: corners of a polyline and points at the same times, (n, m).
    - `reach`: number of edges before and after the same time that are searched.
    """
    n = len(curve)
    nearest = np.full(n, np.inf)
    positions = np.zeros(n)
    rows = np.arange(n)
    edges = np.diff(curve, axis=0)
    squared_lengths = np.maximum(np.sum(edges**2, axis=1), TINY)
    for k in range(-reach, reach + 1):
        start = np.clip(rows + k, 0, n - 2)
        edge = edges[start]
        offset = points - curve[start]
        fraction = np.clip(np.sum(offset * edge, axis=1) / squared_lengths[start], 0.0, 1.0)
        squares = np.sum((offset - fraction[:, None] * edge) ** 2, axis=1)
        positions = np.where(squares < nearest, start + fraction, positions)
        nearest = np.minimum(squares, nearest)
    return positions
