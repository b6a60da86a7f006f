"""Judgement of an identified servo by the contour error on motion that was not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.identification.joint_fit import split_logs
from armcontour.control.identification.servo_identification import (
    JointIdentification,
    Judgement,
    rounded,
    write_servo,
)
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.sampling import interpolate
from armcontour.motion.log import Log
from armcontour.robot import Arm
from armcontour.robot.servo.simulation import JointServo

# Contour errors are computed from samples with this spacing [s].
STEP = 4e-3
# Commands that differ by less than this share of their range are the same program.
SAME = 0.02
# Without an arm a joint counts in proportion to its tracking error, but to no less than this share
# of the largest one: the noise of a joint that hardly moves is no contour error.
FLOOR = 0.1
# Newton steps to a delay, and the largest difference of contour and joint delays [s].
STEPS, BEYOND = 3, 0.1
# A model or delay is rejected if it leaves more than this share of the tracking error.
WEAK = 0.8
# Contour errors up to this multiple of the encoder noise count as noise.
NOISES = 3.0
# Smallest divisor.
TINY = 1e-30


@dataclass(frozen=True, slots=True, eq=False)
class _LogSamples:
    """Samples of a log: times, commands, used samples, and residuals of each choice."""

    t: FloatArray
    command: FloatArray
    use: BoolArray
    rest: dict[str, FloatArray]

    def deviate(
        self, choice: Sequence[str], longest: float, weight: FloatArray, arm: Arm | None
    ) -> tuple[float, FloatArray]:
        """RMS contour error, and RMS deviation of each joint from the contour [rad]."""
        residual = np.stack([self.rest[c][:, j] for j, c in enumerate(choice)], axis=1)
        moved, times = self.command + residual, self.t
        if arm is not None:
            reach = (longest + BEYOND) / float(np.median(np.diff(self.t)))
            both = arm.tool_position(self.command), arm.tool_position(moved)
            squares, positions = find_nearest(*both, int(np.ceil(reach)))
            times = np.interp(positions, np.arange(len(positions)), self.t)
        elif len(weight) > 1:
            both = self.command * weight, moved * weight
            times = times - find_delay([(times, *both)], -BEYOND, longest + BEYOND)
        deviations = moved - interpolate(times, self.t, self.command)
        if arm is None:
            squares = np.sum((deviations * weight) ** 2, axis=1)
        each = np.sqrt(np.mean(deviations[self.use] ** 2, axis=0))
        return float(np.sqrt(np.mean(squares[self.use]))), each


def judge(
    logs: Sequence[Log],
    joints: Sequence[JointIdentification],
    interpolation: str,
    longest: float,
    arm: Arm | None,
) -> tuple[tuple[JointIdentification, ...], Judgement]:
    """Choose the written model of each joint by the contour error, and judge the result."""
    # Good models are written. For the other joints, the weak model, the delay or nothing is
    # written, depending on which has the smallest contour error. Without an arm the contour is in
    # joint space.
    delays = _joint_delays(logs, longest)
    motions = [_prepare(logs, i, joints, longest) for i in range(len(logs))]
    every = [np.concatenate([x.rest[y] for x in motions]) for y in ("none", "delay")]
    lags, delayed = (np.sqrt(np.mean(x**2, axis=0)) for x in every)
    weight = 1 / np.maximum(lags, max(FLOOR * float(lags.max()), TINY))

    def deviations(choice: Sequence[str]) -> list[tuple[float, FloatArray]]:
        return [x.deviate(choice, float(delays.max()), weight, arm) for x in motions]

    none = deviations(["none"] * len(joints))

    def cost(choice: Sequence[str]) -> float:
        pairs = zip(deviations(choice), none, strict=True)
        return sum((x[0] / max(y[0], TINY)) ** 2 for x, y in pairs)

    choice = ["model" if x.written else "none" for x in joints]
    for j, joint in enumerate(joints):
        if joint.note:
            others = ("none", "delay") if delayed[j] <= WEAK * lags[j] else ("none",)
            choice = min((choice, *([*choice[:j], y, *choice[j + 1 :]] for y in others)), key=cost)
    done = deviations(choice)
    errors = np.array([(y[0], x[0]) for x, y in zip(done, none, strict=True)])
    before, after = errors.T
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
            np.max(np.where(after > NOISES * noise, after / np.maximum(before, TINY), 0.0))
        ),
        errors=errors,
    )
    written = []
    for j, (joint, c) in enumerate(zip(joints, choice, strict=True)):
        if c != "model":
            delay = rounded(delays[j] * (c == "delay"))
            servo = JointServo(np.inf, dead_time=delay)
            joint = write_servo(joint, split_logs(logs, j, interpolation, delay), servo)
        written.append(replace(joint, contour_ratio=float(max(y[j] for y in shares))))
    return tuple(written), judgement


def _prepare(
    logs: Sequence[Log], i: int, joints: Sequence[JointIdentification], longest: float
) -> _LogSamples:
    """The samples of log i, with the residuals of predictions."""
    log = logs[i]
    every = max(int(STEP / log.interval * (1 + 1e-6)), 1)
    delays = _joint_delays([x for k, x in enumerate(logs) if k != i] or logs, longest)
    model = np.stack([x.rests[i] if x.rests else np.full(len(log.t), np.nan) for x in joints], 1)
    predicted = np.isfinite(model)
    use = (predicted | ~predicted.any(axis=0)).all(axis=1)
    use = use if use.any() else np.full(len(use), True)
    delayed = [interpolate(log.t - x, log.t, log.command[:, [j]]) for j, x in enumerate(delays)]
    residuals = {
        "none": log.measured - log.command,
        "delay": log.measured - np.concatenate(delayed, axis=1),
        "model": np.where(predicted, model, 0.0),
    }
    some = slice(None, None, every)
    centred = {name: (x - x[use].mean(axis=0))[some] for name, x in residuals.items()}
    return _LogSamples(log.t[some] - log.t[0], log.command[some], use[some], centred)


def _joint_delays(logs: Sequence[Log], longest: float) -> FloatArray:
    """Delay of each joint with the smallest tracking error [s], (dof,)."""
    delays = []
    for j in range(logs[0].dof):
        motions = [(x.t, x.command[:, [j]], x.measured[:, [j]]) for x in logs]
        delays.append(find_delay(motions, 0.0, longest))
    return np.array(delays)


def find_delay(
    motions: Sequence[tuple[FloatArray, FloatArray, FloatArray]], low: float, high: float
) -> float:
    """Delay of commands with the smallest sum of squared tracking errors (Newton's method) [s]."""
    # motions: times (n,) [s], commands (n, k) and positions (n, k).
    delay = 0.0
    for _ in range(STEPS):
        above = below = 0.0
        for t, command, q in motions:
            errors = q - interpolate(t - delay, t, command)
            rate = interpolate(t - delay, t, np.gradient(command, t, axis=0))
            above -= float(np.sum((errors - errors.mean(axis=0)) * rate))
            below += float(np.sum(rate**2))
        delay = float(np.clip(delay + above / max(below, TINY), low, high))
    return delay


def count_programs(logs: Sequence[Log]) -> int:
    """Number of logs whose commands differ from those of all earlier logs."""

    def is_same(one: Log, other: Log) -> bool:
        difference = one.command - interpolate(
            one.t - one.t[0], other.t - other.t[0], other.command
        )
        ranges = np.maximum(np.ptp(one.command, axis=0), np.ptp(other.command, axis=0))
        return bool((np.ptp(difference, axis=0) <= SAME * ranges).all())

    programs: list[Log] = []
    for log in logs:
        programs += [] if any(is_same(log, y) for y in programs) else [log]
    return len(programs)


def find_nearest(
    curve: FloatArray, points: FloatArray, reach: int
) -> tuple[FloatArray, FloatArray]:
    """Squared distances of points to a curve, and nearest positions on it in samples, (n,)."""
    # curve and points (n, m) are at the same times; the search covers `reach` samples before and
    # after.
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
    return nearest, positions
