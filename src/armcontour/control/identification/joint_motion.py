"""Commands and measured positions of one joint, and errors of its model in each log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.control.identification.identification_result import JointIdentification
from armcontour.control.identification.log_segments import LogSegment, find_lag, split_logs
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampled_data import interpolate, white_noise
from armcontour.motion.log import FEWEST, Log

# A joint is at rest if the standard deviation of its measured positions is at most this multiple of
# the noise's standard deviation. Its velocity is uniform if the same holds for deviations from a
# line.
REST_SIGMAS = 1.5
# A joint is also at rest if the range of its measured positions is at most this [rad]; a 32-bit
# encoder has a resolution of 1.5e-9 rad.
LEAST_MOTION = 1e-9
# Lower bound of a tracking error that is used as a divisor [rad].
LEAST_LAG = 1e-12
# Deviations from uniform velocity below this value are rounding errors, because logs have at most
# nine digits [rad].
LEAST_BEND = 1e-8


class NoModel(Exception):
    """No model of a joint is accepted; the text is the note for the user.

    `saturates` is True if the note describes the saturation of the joint.
    """

    def __init__(self, note: str, *, saturates: bool = False) -> None:
        super().__init__(note)
        self.saturates = saturates


class LogError(NamedTuple):
    """RMS error of a model, and RMS tracking error, of one joint in one log [rad]."""

    rms: float
    tracking: float

    @property
    def share(self) -> float:
        """The error relative to the tracking error."""
        return self.rms / self.tracking


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoggedJoint:
    """Commands and measured positions of one joint in all logs."""

    logs: Sequence[Log]
    index: int  # Index of the joint, from 0
    lag: float  # Delay of the command with the smallest tracking error [s]
    segments: list[LogSegment]  # Parts of the logs without a long gap

    @classmethod
    def read(
        cls, logs: Sequence[Log], index: int, interpolation: str, longest: float
    ) -> LoggedJoint:
        """Read joint `index` from logs; `longest` is the longest dead time of the search [s]."""
        segments = split_logs(logs, index, interpolation)
        lag = find_lag(segments, longest)
        after = [x.after(lag) for x in segments]
        return cls(logs=logs, index=index, lag=lag, segments=after)

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.logs[0].joint_names[self.index]

    @property
    def prismatic(self) -> bool:
        """True for a prismatic joint."""
        return self.logs[0].prismatic[self.index]

    @property
    def joint(self) -> JointIdentification:
        """The joint without a model."""
        return JointIdentification(
            name=self.name,
            prismatic=self.prismatic,
            moves=not self.segments or is_commanded(self.segments),
        )

    def require_motion(self) -> None:
        """Raise NoModel if the joint does not move, or only at uniform velocity."""
        if reason := explain_missing_motion(self.segments):
            raise NoModel(f"{self.name} has no model, because {reason}")

    def check_columns(self) -> None:
        """Check that the joint follows its own commands, with the same sign.

        Raises:
            InvalidInput: The joint follows those of another joint, or with the opposite sign.
        """
        for log in self.logs:
            _check_columns(log, self.index, self.lag)


def _check_columns(log: Log, j: int, lag: float) -> None:
    """Raise InvalidInput if joint j follows other commands, or its own with the opposite sign."""
    commands = interpolate(log.t - lag, log.t, log.command - log.command.mean(axis=0))
    products = (log.measured[:, j] - log.measured[:, j].mean()) @ commands
    similar = products / np.maximum(np.linalg.norm(commands, axis=0), LEAST_LAG)
    if similar[j] < np.abs(similar).max():
        raise InvalidInput(
            f"{log.source}: {log.joint_names[j]} does not follow its commands. Correct the order "
            "and the signs of the columns.",
            joint=j,
        )


def explain_missing_motion(segments: Sequence[LogSegment]) -> str:
    """Return the reason why the motion determines no model; empty if it may determine one."""
    if not segments:
        return f"the log has fewer than {FEWEST} samples without a gap. Record a longer motion."
    if not is_commanded(segments):
        return "no motion is commanded. Record a program that moves this joint."
    if all(_is_at_rest(s) for s in segments):
        change = max(float(np.ptp(s.command.u)) for s in segments)
        reason = f"its measured motion is only noise, although its commands span {change:.3g} rad"
        return f"{reason}. Record more motion."
    if all(_is_uniform(s) for s in segments):
        return "the velocity is uniform, which determines a lag, but no gains. Record a multisine."
    return ""


def is_commanded(segments: Sequence[LogSegment]) -> bool:
    """Return whether the command moves in any of the samples that count."""
    return any(bool((s.weight * s.use).any()) for s in segments)


def _is_at_rest(segment: LogSegment) -> bool:
    """Return whether the measured positions of a segment are only noise."""
    y = segment.y
    return bool(np.ptp(y) <= LEAST_MOTION or np.std(y) <= REST_SIGMAS * white_noise(y))


def _is_uniform(segment: LogSegment) -> bool:
    """Return whether both the commanded and the measured velocity of a segment are uniform."""
    t = segment.command.t
    return not _changes_velocity(t, segment.command.u) and not _changes_velocity(t, segment.y)


def _changes_velocity(t: FloatArray, positions: FloatArray) -> bool:
    """Return whether positions [rad] at times t [s], (n,), deviate from a line beyond the noise."""
    errors = positions - np.polyval(np.polyfit(t, positions, 1), t)
    return bool(
        np.std(errors) > REST_SIGMAS * white_noise(positions) and np.ptp(errors) > LEAST_BEND
    )


def find_worst_log(errors: Sequence[FloatArray], segments: Sequence[LogSegment]) -> LogError:
    """Return the errors of the log in which a model leaves most of the tracking error.

    - `errors`: measured less predicted positions of each segment [rad].

    The errors of a single log are weighted by motion, because the joint may rest in parts of it.
    """
    logs = sorted({s.log for s in segments if s.weight.any()})
    single = len(logs) == 1
    tracking = tracking_errors(segments)
    of_logs = []
    for k in logs:
        indices = [i for i, s in enumerate(segments) if s.log == k]
        own_segments = [segments[i] for i in indices]
        own_errors = [errors[i] for i in indices]
        own_tracking = [tracking[i] for i in indices]
        of_logs.append(
            LogError(
                rms=rms_of(own_errors, own_segments, centred=False, weighted=single),
                tracking=max(rms_of(own_tracking, own_segments, weighted=single), LEAST_LAG),
            )
        )
    return max(of_logs, key=lambda x: x.share)


def tracking_errors(segments: Sequence[LogSegment]) -> list[FloatArray]:
    """Return measured positions less commands of each segment [rad]."""
    return [s.y - s.command.u for s in segments]


def rms_of(
    values: Sequence[FloatArray],
    segments: Sequence[LogSegment],
    *,
    centred: bool = True,
    weighted: bool = False,
) -> float:
    """Return the RMS of values over the used samples of segments.

    - `values`: one array per segment.
    - `centred`: subtract the mean of each segment.
    - `weighted`: weight the squares by the commanded motion.
    """
    total = 0.0
    weights = 0.0
    for row, s in zip(values, segments, strict=True):
        square = (row - (np.mean(row[s.use]) if centred else 0.0)) ** 2
        weight = s.weight * s.use if weighted else s.use
        total += square @ weight
        weights += weight.sum()
    return float(np.sqrt(total / max(weights, 1e-300)))
