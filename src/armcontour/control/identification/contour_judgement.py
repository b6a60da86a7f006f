"""Choice of the written models by the contour error, and its judgement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.identification.command_rates import fastest_motion
from armcontour.control.identification.identification_result import (
    JointIdentification,
    Judgement,
    round_digits,
    write_servo,
)
from armcontour.control.identification.joint_identification import MAX_WEAK, NOISE_MULTIPLE, RECORD
from armcontour.control.identification.log_segments import split_logs
from armcontour.control.identification.residual_tests import FEWEST_LINES, is_white
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.sampled_data import interpolate
from armcontour.motion.log import (
    Log,
)
from armcontour.robot import Arm
from armcontour.robot.servo.model import TRUSTED
from armcontour.robot.servo.simulation import JointServo

# Spacing of the samples from which contour errors are computed [s].
SPACING = 4e-3
# Two logs are of the same program if their commands differ by at most this fraction of their range.
SAME_PROGRAM = 0.02
# Without an arm, errors of a joint are divided by its RMS tracking error, or by this fraction of
# the largest tracking error if that is larger. Then the noise of a joint that hardly moves is not
# amplified.
LEAST_WEIGHT = 0.1
# Number of Newton steps in the search for a delay.
NEWTON_STEPS = 3
# The delay of the contour is searched from minus this value to the longest delay of a joint plus
# this value [s].
DELAY_MARGIN = 0.1
# Smallest number of samples of contour errors whose whiteness can be tested.
FEWEST_TESTED = 4 * FEWEST_LINES
# If all models are good, a joint is weak if compensation leaves more than the fraction TRUSTED of
# its deviation from the contour in a log, and this deviation is more than MAIN_SHARE of the contour
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
        self,
        choice: Sequence[str],
        longest: float,
        weight: FloatArray,
        arm: Arm | None,
        least_signal: float,
    ) -> tuple[float, FloatArray]:
        """RMS contour error (see `Judgement.errors`), and RMS deviations of the joints [rad].

        - `choice`: key of `rest` for each joint.
        - `longest`: longest delay of a joint [s].
        - `least_signal`: see `_remove_noise`.
        """
        residual = np.stack([self.rest[c][:, j] for j, c in enumerate(choice)], axis=1)
        moved = self.command + residual
        times = self.t
        if arm is not None:
            reach = (longest + DELAY_MARGIN) / float(np.median(np.diff(self.t)))
            path = arm.tool_position(self.command)
            tool = arm.tool_position(moved)
            rows = np.arange(len(path), dtype=np.float64)
            positions = find_nearest(path, tool, int(np.ceil(reach)))
            times = np.interp(positions, rows, self.t)
        elif len(weight) > 1:
            both = self.command * weight, moved * weight
            times = times - find_delay([(times, *both)], -DELAY_MARGIN, longest + DELAY_MARGIN)
        deviations = moved - interpolate(times, self.t, self.command)
        errors = deviations * weight if arm is None else tool - interpolate(positions, rows, path)
        each = np.sqrt(np.mean(deviations[self.use] ** 2, axis=0))
        if set(choice) == {"none"}:
            square = float(np.mean(np.sum(errors[self.use] ** 2, axis=1)))
        else:
            square = _remove_noise(errors, self.use, least_signal)
        return math.sqrt(square), each


def _remove_noise(errors: FloatArray, use: BoolArray, least_signal: float) -> float:
    """Mean square of contour errors, (n, k), at the samples in `use`, without the encoders' noise.

    The noise is white, so it does not correlate in neighbouring samples, and the mean product of
    neighbours is the mean square of the other errors. If the errors are white, the log contains no
    motion that the models do not explain. The errors of the models are then those of their
    parameters, because p parameters were fitted to n samples with noise. Their mean square is the
    fraction p / n of the noise's (L. Ljung, System Identification, 2nd ed., section 16.4).

    `least_signal` is p / n.
    """
    used = errors[use]
    least = least_signal * float(np.mean(np.sum(used**2, axis=1)))
    moving = [x for x in used.T if np.ptp(x) > 0]
    if len(used) >= FEWEST_TESTED and all(is_white(x, step=0.0) for x in moving):
        return least
    pairs = np.sum(errors[1:] * errors[:-1], axis=1)[use[1:] & use[:-1]]
    return max(float(np.mean(pairs)), least)


def _parameters_per_sample(joints: Sequence[JointIdentification], logs: Sequence[Log]) -> float:
    """Return the largest number of parameters of a joint, divided by the number of samples."""
    samples = sum(len(x.t) for x in logs)
    return max(len(x.parameters) for x in joints) / samples


def choose_and_judge(
    logs: Sequence[Log],
    joints: Sequence[JointIdentification],
    interpolation: str,
    longest: float,
    arm: Arm | None,
    program: int | None = None,
) -> tuple[tuple[JointIdentification, ...], Judgement]:
    """Choose by the contour error which model of each joint is written, and judge the result.

    Good models are written. For the other joints, the weak model, the delay or nothing is written,
    whichever has the smallest contour error. Without an arm, the contour is a curve in joint space.

    `longest` is the longest dead time of the search [s]. `program` is the index of the only log of
    a program if the other logs are multisines.
    """
    delays = _joint_delays(logs, longest)
    motions = [_sample_log(logs, i, joints, longest) for i in range(len(logs))]
    lags = _residual_rms(motions, "none")
    delayed = _residual_rms(motions, "delay")
    weight = 1 / np.maximum(lags, max(LEAST_WEIGHT * float(lags.max()), TINY))

    least_signal = _parameters_per_sample(joints, logs)

    def deviations(choice: Sequence[str]) -> list[tuple[float, FloatArray]]:
        return [x.deviate(choice, float(delays.max()), weight, arm, least_signal) for x in motions]

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
    slow = fastest_motion(logs).slow_logs
    program_ratio = float(ratio[slow].max())
    if program is not None:
        names = ["program" if x == "model" else x for x in choice]
        left = motions[program].deviate(names, float(delays.max()), weight, arm, least_signal)[0]
        program_ratio = left / max(float(before[program]), TINY)
    judgement = Judgement(
        programs=count_programs(logs),
        ratios=np.where(after > NOISE_MULTIPLE * noise, ratio, np.minimum(ratio, TRUSTED)),
        program_ratio=program_ratio,
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
                f"{none[i][1][j] * 1e3:.3g} {'mm' if joint.prismatic else 'mrad'} RMS), which is "
                f"most of the remaining contour error of this log. {RECORD}"
            )
            joint = replace(joint, note=note)
        if c != "model":
            delay = round_digits(delays[j] * (c == "delay"))
            servo = JointServo(np.inf, dead_time=delay)
            joint = write_servo(joint, split_logs(logs, j, interpolation, delay), servo)
        written.append(replace(joint, contour_ratio=float(shares[i][j])))
    return tuple(written), judgement


def _residual_rms(motions: Sequence[_LogSamples], choice: str) -> FloatArray:
    """Return the RMS residual of each joint [rad], (dof,); `choice` is a key of `rest`."""
    residuals = np.concatenate([x.rest[choice] for x in motions])
    return np.asarray(np.sqrt(np.mean(residuals**2, axis=0)))


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
    if all(len(x.program_rest) == len(log.t) for x in joints if x.rests):
        rows = [x.program_rest if x.rests else np.zeros(len(log.t)) for x in joints]
        residuals["program"] = np.nan_to_num(np.stack(rows, axis=1))
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
    nearest = np.full(n, np.inf)
    positions = np.zeros(n)
    rows = np.arange(n)
    edges = np.diff(curve, axis=0)
    lengths = np.maximum(np.sum(edges**2, axis=1), TINY)
    for k in range(-reach, reach + 1):
        start = np.clip(rows + k, 0, n - 2)
        edge = edges[start]
        offset = points - curve[start]
        share = np.clip(np.sum(offset * edge, axis=1) / lengths[start], 0.0, 1.0)
        squares = np.sum((offset - share[:, None] * edge) ** 2, axis=1)
        positions = np.where(squares < nearest, start + share, positions)
        nearest = np.minimum(squares, nearest)
    return positions
