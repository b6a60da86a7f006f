"""Validation of an identified servo by its contour error on motion that was not fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.identification.identification_result import (
    JointIdentification,
    Judgement,
    round_digits,
    write_servo,
)
from armcontour.control.identification.joint_fit import split_logs
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.sampled_data import interpolate
from armcontour.motion.log import Log
from armcontour.robot import Arm
from armcontour.robot.servo.model import TRUSTED
from armcontour.robot.servo.simulation import JointServo

# Remedy for a weak or missing model.
RECORD = (
    "Check the unit, sign and order of the columns. Record the program also at half its speed, and "
    "motions of this joint alone, to see whether gravity, friction or other joints cause the error."
)
# Spacing of the samples from which contour errors are computed [s].
SPACING = 4e-3
# Two logs are of the same program if their commands differ by at most this fraction of their range.
SAME_PROGRAM = 0.02
# Without an arm, errors of a joint are divided by its RMS tracking error, or by this share of the
# largest tracking error if that is larger. Then the noise of a joint that hardly moves is not
# amplified.
LEAST_WEIGHT = 0.1
# NEWTON_STEPS: number of Newton steps for a delay. DELAY_MARGIN: the delay of the contour is
# searched from minus this value to the longest delay of a joint plus this value [s].
NEWTON_STEPS, DELAY_MARGIN = 3, 0.1
# A model or delay is rejected if its error exceeds this fraction of the tracking error.
MAX_WEAK = 0.8
# A contour error of at most this multiple of the encoder noise is small enough to be trusted.
NOISE_MULTIPLE = 3.0
# Smallest fraction of a mean square that counts as signal, because the noise of a finite number of
# samples correlates.
LEAST_SIGNAL = 0.01
# If all models are good, a joint is weak if compensation leaves more than the share TRUSTED of its
# deviation from the contour in a log, and this deviation is more than MAIN_SHARE of the contour
# error that remains in this log.
MAIN_SHARE = 0.5
# Lower bound of divisors.
TINY = 1e-30


@dataclass(frozen=True, slots=True, eq=False)
class _LogSamples:
    """Samples of a log: times [s], commands [rad], mask of used samples, and residuals [rad]."""

    # rest: residuals for each choice of the written model ("none", "delay", "model"), (n, dof).

    t: FloatArray
    command: FloatArray
    use: BoolArray
    rest: dict[str, FloatArray]

    def deviate(
        self, choice: Sequence[str], longest: float, weight: FloatArray, arm: Arm | None
    ) -> tuple[float, FloatArray]:
        """RMS contour error (see `Judgement.errors`), and RMS deviations of the joints [rad].

        - `choice`: key of `rest` for each joint.
        - `longest`: longest delay of a joint [s].
        """
        residual = np.stack([self.rest[c][:, j] for j, c in enumerate(choice)], axis=1)
        moved, times = self.command + residual, self.t
        if arm is not None:
            reach = (longest + DELAY_MARGIN) / float(np.median(np.diff(self.t)))
            path, tool = arm.tool_position(self.command), arm.tool_position(moved)
            rows = np.arange(len(path), dtype=np.float64)
            positions = find_nearest(path, tool, int(np.ceil(reach)))
            times = np.interp(positions, rows, self.t)
        elif len(weight) > 1:
            both = self.command * weight, moved * weight
            times = times - find_delay([(times, *both)], -DELAY_MARGIN, longest + DELAY_MARGIN)
        deviations = moved - interpolate(times, self.t, self.command)
        errors = deviations * weight if arm is None else tool - interpolate(positions, rows, path)
        each = np.sqrt(np.mean(deviations[self.use] ** 2, axis=0))
        square = float(np.mean(np.sum(errors[self.use] ** 2, axis=1)))
        if set(choice) != {"none"}:
            # The small errors that remain are separated from the white noise of the encoders, which
            # does not correlate in neighbouring samples.
            pairs = np.sum(errors[1:] * errors[:-1], axis=1)[self.use[1:] & self.use[:-1]]
            square = max(float(np.mean(pairs)), LEAST_SIGNAL * square)
        return math.sqrt(square), each


def choose_and_judge(
    logs: Sequence[Log],
    joints: Sequence[JointIdentification],
    interpolation: str,
    longest: float,
    arm: Arm | None,
) -> tuple[tuple[JointIdentification, ...], Judgement]:
    """Choose by the contour error which model of each joint is written, and judge the result.

    Good models are written. For the other joints, the weak model, the delay or nothing is written,
    whichever has the smallest contour error. Without an arm, the contour is a curve in joint space.

    `longest` is the longest dead time of the search [s].
    """
    delays = _joint_delays(logs, longest)
    motions = [_sample_log(logs, i, joints, longest) for i in range(len(logs))]
    every = [np.concatenate([x.rest[y] for x in motions]) for y in ("none", "delay")]
    lags, delayed = (np.sqrt(np.mean(x**2, axis=0)) for x in every)
    weight = 1 / np.maximum(lags, max(LEAST_WEIGHT * float(lags.max()), TINY))

    def deviations(choice: Sequence[str]) -> list[tuple[float, FloatArray]]:
        return [x.deviate(choice, float(delays.max()), weight, arm) for x in motions]

    none = deviations(["none"] * len(joints))

    def cost(choice: Sequence[str]) -> float:
        pairs = zip(deviations(choice), none, strict=True)
        return sum((x[0] / max(y[0], TINY)) ** 2 for x, y in pairs)

    choice = ["model" if x.written else "none" for x in joints]
    for j, joint in enumerate(joints):
        if joint.note:
            others = ("none", "delay") if delayed[j] <= MAX_WEAK * lags[j] else ("none",)
            choice = min((choice, *([*choice[:j], y, *choice[j + 1 :]] for y in others)), key=cost)
    done = deviations(choice)
    errors = np.array([(y[0], x[0]) for x, y in zip(done, none, strict=True)])
    before, after = errors.T
    ratio = after / np.maximum(before, TINY)
    shares = [x[1] / np.maximum(y[1], TINY) for x, y in zip(done, none, strict=True)]
    noises = np.nan_to_num(np.array([x.noise for x in joints]))
    if arm is None:
        noise = float(np.linalg.norm(noises * weight))
    else:
        moves = arm.tool_jacobian(motions[0].command) * noises
        noise = float(np.sqrt(np.mean(np.sum(moves**2, axis=(1, 2)))))
    judgement = Judgement(
        programs=count_programs(logs),
        ratio=float(
            np.max(np.where(after > NOISE_MULTIPLE * noise, ratio, np.minimum(ratio, TRUSTED)))
        ),
        errors=errors,
    )
    written = []
    are_good = not any(x.note for x in joints)
    for j, (joint, c) in enumerate(zip(joints, choice, strict=True)):
        i = int(np.argmax([x[j] for x in shares]))
        left = done[i][1][j]
        remaining = float(np.linalg.norm(done[i][1] * weight))
        if (
            are_good
            and shares[i][j] > TRUSTED
            and left > NOISE_MULTIPLE * noises[j]
            and left * weight[j] > MAIN_SHARE * remaining
        ):
            note = (
                f"The model of {joint.name} is weak: {shares[i][j]:.0%} of its deviation from the "
                f"contour of {logs[i].source} remains with compensation ({left * 1e3:.3g} of "
                f"{none[i][1][j] * 1e3:.3g} mrad RMS), which is most of the remaining contour "
                f"error of this log. {RECORD}"
            )
            joint = replace(joint, note=note)
        if c != "model":
            delay = round_digits(delays[j] * (c == "delay"))
            servo = JointServo(np.inf, dead_time=delay)
            joint = write_servo(joint, split_logs(logs, j, interpolation, delay), servo)
        written.append(replace(joint, contour_ratio=float(shares[i][j])))
    return tuple(written), judgement


def _sample_log(
    logs: Sequence[Log], i: int, joints: Sequence[JointIdentification], longest: float
) -> _LogSamples:
    """Samples of log i; residuals without models, with delays from other logs, with models."""
    log = logs[i]
    every = max(int(SPACING / log.interval * (1 + 1e-6)), 1)
    delays = _joint_delays([x for k, x in enumerate(logs) if k != i] or logs, longest)
    model = np.stack([x.rests[i] if x.rests else np.full(len(log.t), np.nan) for x in joints], 1)
    predicted = np.isfinite(model)
    use = (predicted | ~predicted.any(axis=0)).all(axis=1)
    use = use if use.any() else np.full(len(use), True)
    delayed = [interpolate(log.t - x, log.t, log.command[:, [j]]) for j, x in enumerate(delays)]
    late = log.measured - np.concatenate(delayed, axis=1)
    # An offset is no error of the model. A mean lag is one, so the mean is not subtracted.
    means = late[use].mean(axis=0)
    offsets = [x.offsets.get(i, y) if x.written else y for x, y in zip(joints, means, strict=True)]
    residuals = {
        "none": log.measured - log.command - offsets,
        "delay": late - offsets,
        "model": np.where(predicted, model, 0.0),
    }
    some = slice(None, None, every)
    rest = {name: x[some] for name, x in residuals.items()}
    return _LogSamples(log.t[some] - log.t[0], log.command[some], use[some], rest)


def _joint_delays(logs: Sequence[Log], longest: float) -> FloatArray:
    """Delay of each joint with the smallest tracking error, at most `longest` [s], (dof,)."""
    delays = []
    for j in range(logs[0].dof):
        motions = [(x.t, x.command[:, [j]], x.measured[:, [j]]) for x in logs]
        delays.append(find_delay(motions, 0.0, longest))
    return np.array(delays)


def find_delay(
    motions: Sequence[tuple[FloatArray, FloatArray, FloatArray]], low: float, high: float
) -> float:
    """Delay from `low` to `high` with the smallest tracking error, by Newton's method [s].

    `motions` are times (n,) [s], commands (n, k) and positions (n, k) of each log.
    """
    delay = 0.0
    for _ in range(NEWTON_STEPS):
        above = below = 0.0
        for t, command, q in motions:
            errors = q - interpolate(t - delay, t, command)
            rate = interpolate(t - delay, t, np.gradient(command, t, axis=0))
            above -= float(np.sum((errors - errors.mean(axis=0)) * rate))
            below += float(np.sum(rate**2))
        delay = float(np.clip(delay + above / max(below, TINY), low, high))
    return delay


def count_programs(logs: Sequence[Log]) -> int:
    """Number of different programs: logs whose commands differ from those of all earlier logs."""

    def is_same(one: Log, other: Log) -> bool:
        difference = one.command - interpolate(
            one.t - one.t[0], other.t - other.t[0], other.command
        )
        ranges = np.maximum(np.ptp(one.command, axis=0), np.ptp(other.command, axis=0))
        return bool((np.ptp(difference, axis=0) <= SAME_PROGRAM * ranges).all())

    programs: list[Log] = []
    for log in logs:
        programs += [] if any(is_same(log, y) for y in programs) else [log]
    return len(programs)


def find_nearest(curve: FloatArray, points: FloatArray, reach: int) -> FloatArray:
    """Fractional indices of the points of a polyline that are nearest to points, (n,).

    Rows of curve and points, (n, m), are at the same times. The search for the nearest point covers
    `reach` samples before and after.
    """
    n = len(curve)
    nearest, positions, rows = np.full(n, np.inf), np.zeros(n), np.arange(n)
    edges = np.diff(curve, axis=0)
    lengths = np.maximum(np.sum(edges**2, axis=1), TINY)
    for k in range(-reach, reach + 1):
        start = np.clip(rows + k, 0, n - 2)
        edge, offset = edges[start], points - curve[start]
        share = np.clip(np.sum(offset * edge, axis=1) / lengths[start], 0.0, 1.0)
        squares = np.sum((offset - share[:, None] * edge) ** 2, axis=1)
        positions = np.where(squares < nearest, start + share, positions)
        nearest = np.minimum(squares, nearest)
    return positions
