"""Samples of one joint in logs, divided into segments and parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.motion.log import FEWEST, Log
from armcontour.robot.servo.simulation import LoggedCommand

# A gap of more sample intervals than this splits a log, because the command in it is unknown.
SHORT_GAP = 20.0
# Duration at the start of a log that fits ignore, because the motion in it depends on commands
# before the log [s].
SKIPPED_TIME = 0.04
# Time over which the speed of the command is averaged [s], about the settling time of a servo.
SPEED_WINDOW = 0.1
# Number of samples from which the initial velocity is estimated.
START_SAMPLES = 20
# A command slower than this fraction of the typical speed counts as rest.
REST_SHARE = 0.02
# The typical speed is this percentile of the command speeds. Weights are command speeds, but at
# most the typical speed.
TYPICAL_PERCENTILE = 95
# Number of contiguous parts with equal motion into which a single log is divided.
PARTS = 5
# Spacing of the delays among which the lag is searched [s].
LAG_STEP = 1e-3
# Selection uses samples with this spacing [s] if linear interpolation of their set-points
# reproduces the command.
COARSE_SPACING = 4e-3
# Coarse samples reproduce the command if interpolation changes it by at most this fraction of the
# noise in the positions (RMS).
THINNING_ERROR = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogSegment:
    """Samples of one joint in one log without a long gap; arrays are (n,)."""

    log: int  # Index of the log
    start: int  # Index of its first sample in the log
    command: LoggedCommand  # Command with times and set-points
    y: FloatArray  # Measured positions [rad]
    use: BoolArray  # Mask of the samples that are fitted
    weight: FloatArray  # Weight of each sample: limited speed of the command [rad/s], 0 at rest
    part: IntArray  # Index of the cross-validation part of each sample

    def after(self, lag: float) -> LogSegment:
        """Return the segment without its start in `use`: SKIPPED_TIME, or a longer `lag` [s]."""
        t = self.command.t
        return replace(self, use=t >= min(max(SKIPPED_TIME, lag, t[5]), t[-1] / 4))

    @property
    def velocity(self) -> float:
        """Measured velocity at the start of the segment [rad/s]."""
        n = min(START_SAMPLES, len(self.y))
        return float(np.polyfit(self.command.t[:n], self.y[:n], 1)[0])

    def cut(self, a: int, b: int, stride: int = 1) -> LogSegment:
        """Return every `stride`-th sample from index a to b (exclusive).

        The segment keeps all set-points before b, because they reach the joint after dead time.
        """
        c = self.command
        before = len(self.command.knots) - len(self.command.t)
        a += -(before + a) % stride
        knots = slice(0, before + b, stride)
        samples = slice(a, b, stride)
        kind = "linear" if c.linear else "step"
        return replace(
            self,
            start=self.start + a,
            command=LoggedCommand(c.knots[knots], c.every[knots], kind, (before + a) // stride),
            **{x: getattr(self, x)[samples] for x in ("y", "use", "weight", "part")},
        )


def split_logs(
    logs: Sequence[Log], j: int, interpolation: str, lag: float = 0.0
) -> list[LogSegment]:
    """Split the motion of joint j into segments between the long gaps of the logs.

    Several logs are one part each, and a single log is divided into PARTS parts of equal motion.

    - `interpolation`: interpolation of set-points, "linear" or "step".
    - `lag`: see `LogSegment.after` [s].
    """
    spans = []
    for i, log in enumerate(logs):
        spans += [(i, a, b) for a, b in _spans_between_gaps(log)]
    speeds = [_command_speed(logs[i].t[a:b], logs[i].command[a:b, j]) for i, a, b in spans]
    weights = _motion_weights(speeds)
    moving = {i for (i, _, _), x in zip(spans, weights, strict=True) if x.any()}
    parts = _equal_parts(weights)
    segments = []
    for (i, a, b), weight, part in zip(spans, weights, parts, strict=True):
        t = logs[i].t[a:b] - logs[i].t[a]
        segments.append(
            LogSegment(
                log=i,
                start=a,
                command=LoggedCommand(t, logs[i].command[a:b, j], interpolation),
                y=logs[i].measured[a:b, j].copy(),
                use=np.full(b - a, True),
                weight=weight,
                part=part if len(moving) == 1 else np.full(b - a, i),
            ).after(lag)
        )
    return segments


def _spans_between_gaps(log: Log) -> list[tuple[int, int]]:
    """Return the first and last index (exclusive) of each span between long gaps of a log."""
    long = np.diff(log.t)[log.gaps] > SHORT_GAP * log.interval
    ends = log.gaps[long] + 1
    return [(a, b) for a, b in pairwise([0, *ends, len(log.t)]) if b - a >= FEWEST]


def _command_speed(t: FloatArray, u: FloatArray) -> FloatArray:
    """Return the mean speed of a command u over the last SPEED_WINDOW [rad/s], (n,)."""
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(u)))])
    return np.asarray((travel - np.interp(t - SPEED_WINDOW, t, travel)) / SPEED_WINDOW)


def _motion_weights(speeds: Sequence[FloatArray]) -> list[FloatArray]:
    """Return weights of samples: speeds up to the typical speed, 0 at rest [rad/s]."""
    joined = np.concatenate(speeds) if speeds else np.zeros(1)
    typical = 1.0
    if joined.any():
        typical = float(np.percentile(joined[joined > 0], TYPICAL_PERCENTILE))
    return [np.where(x > REST_SHARE * typical, np.minimum(x, typical), 0.0) for x in speeds]


def _equal_parts(weights: Sequence[FloatArray]) -> list[IntArray]:
    """Divide samples into PARTS parts with equal sums of weights; returns indices of the parts."""
    total = max(sum(float(x.sum()) for x in weights), 1e-300)
    sum_before = 0.0
    parts = []
    for weight in weights:
        fraction = (sum_before + np.cumsum(weight)) / total
        sum_before += float(weight.sum())
        parts.append(np.minimum((fraction * PARTS).astype(np.intp), PARTS - 1))
    return parts


def divide_log(segments: Sequence[LogSegment], log: int) -> list[LogSegment]:
    """Divide one of several logs into PARTS parts of equal motion; other logs become part -1."""
    parts = iter(_equal_parts([s.weight for s in segments if s.log == log]))
    divided = []
    for s in segments:
        part = next(parts) if s.log == log else np.full(len(s.y), -1)
        divided.append(replace(s, part=part))
    return divided


def find_lag(segments: Sequence[LogSegment], longest: float) -> float:
    """Return the delay of the command with the smallest tracking error [s].

    - `longest`: largest delay [s]. Delays are multiples of about 1 ms.
    """

    def remaining_error(lag: float) -> float:
        """Return the squared tracking error with a delay of the command, about its mean [rad²]."""
        total = 0.0
        for s in segments:
            error = s.y - s.command.evaluate(s.command.t - lag)
            total += float(np.var(error[s.use]) * s.use.sum())
        return total

    delays = np.linspace(0.0, longest, int(longest / LAG_STEP) + 2)
    return float(min(delays, key=remaining_error))


def thin_segments(segments: Sequence[LogSegment]) -> Sequence[LogSegment]:
    """Return segments with samples at COARSE_SPACING; unchanged if this changes the command."""
    interval = float(np.median(np.diff(segments[0].command.t)))
    stride = int(COARSE_SPACING / interval * (1 + 1e-6))
    if stride < 2 or not segments[0].command.linear:
        return segments
    thinned = [x.cut(0, len(x.y), stride) for x in segments]
    for coarse, full in zip(thinned, segments, strict=True):
        difference = coarse.command.evaluate(full.command.t) - full.command.u
        # The variance of third differences is 20 times that of white noise.
        noise = np.sqrt(np.mean(np.diff(full.y, n=3) ** 2) / 20)
        if np.sqrt(np.mean(difference**2)) > THINNING_ERROR * noise or len(coarse.y) < FEWEST:
            return segments
    return thinned


def moving_parts(segments: Sequence[LogSegment]) -> IntArray:
    """Return the indices of the parts in which the command of some used samples moves."""
    moving = [s.part[s.use & (s.weight > 0) & (s.part >= 0)] for s in segments]
    return np.unique(np.concatenate(moving))
