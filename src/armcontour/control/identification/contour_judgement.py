"""Selects the models for the servo file by predicted contour error, and judges their quality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.identification.command_rates import fastest_motion
from armcontour.control.identification.contour_comparison import (
    DELAY_ONLY,
    MODEL,
    NONE,
    PROGRAM,
    TINY,
    ContourComparison,
    Deviations,
    residual_rms,
)
from armcontour.control.identification.identification_result import (
    JointIdentification,
    Judgement,
    round_digits,
    with_servo,
)
from armcontour.control.identification.joint_identification import MAX_WEAK, NOISE_MULTIPLE, RECORD
from armcontour.control.identification.log_segments import split_logs
from armcontour.core.checks import FloatArray
from armcontour.core.sampled_data import interpolate
from armcontour.motion.log import Log
from armcontour.robot import Arm
from armcontour.robot.servo.model import TRUSTED
from armcontour.robot.servo.simulation import JointServo

# Two logs are of the same program if their commands differ by at most this fraction of their range.
SAME_PROGRAM = 0.02
# If all models are good, a joint is weak if compensation leaves more than the fraction TRUSTED of
# its deviation from the contour in a log, and this deviation is more than MAIN_SHARE of the contour
# error that remains in this log.
MAIN_SHARE = 0.5


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

    - `longest`: longest dead time of the search [s].
    - `program`: index of the only program if the other logs are multisines.
    """
    comparison = ContourComparison.of(logs, joints, longest, arm)
    choice = _choose(comparison, joints)
    chosen = _Choice(comparison=comparison, written=choice, remaining=comparison.deviate(choice))
    are_good = not any(x.note for x in joints if x.moves)
    judged = []
    for j, joint in enumerate(joints):
        if are_good and joint.moves and chosen.is_weak(j, joint.noise):
            joint = replace(joint, note=_describe_weakness(logs, joint, j, chosen))
        if choice[j] != MODEL:
            delay = round_digits(comparison.delays[j] * (choice[j] == DELAY_ONLY))
            segments = split_logs(logs, j, interpolation, delay)
            joint = with_servo(joint, segments, JointServo(np.inf, dead_time=delay))
        share = float(chosen.shares[chosen.worst_log(j), j])
        judged.append(replace(joint, contour_ratio=share))
    return tuple(judged), _judge(logs, joints, chosen, program)


def _choose(comparison: ContourComparison, joints: Sequence[JointIdentification]) -> list[str]:
    """Return what is written of each joint, a key of `LogSamples.residuals`.

    See `choose_and_judge`.
    """
    tracking = residual_rms(comparison.samples, NONE)
    delayed = residual_rms(comparison.samples, DELAY_ONLY)

    def cost(choice: Sequence[str]) -> float:
        """Return the sum of the squared contour errors, relative to those without compensation."""
        pairs = zip(comparison.deviate(choice), comparison.none, strict=True)
        return sum((remaining.contour / max(none.contour, TINY)) ** 2 for remaining, none in pairs)

    choice = [MODEL if x.written else NONE for x in joints]
    for j, joint in enumerate(joints):
        if joint.note:
            trials = [choice, _with(choice, j, NONE)]
            if delayed[j] <= MAX_WEAK * tracking[j]:
                trials.append(_with(choice, j, DELAY_ONLY))
            choice = min(trials, key=cost)
    return choice


def _with(choice: Sequence[str], j: int, written: str) -> list[str]:
    """Return a choice with another value for joint j."""
    return [*choice[:j], written, *choice[j + 1 :]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Choice:
    """What is written of each joint, and the deviations that it leaves in each log."""

    comparison: ContourComparison
    written: list[str]
    remaining: list[Deviations]

    @property
    def shares(self) -> FloatArray:
        """Deviations that are left, relative to those without compensation, (logs, dof)."""
        pairs = zip(self.remaining, self.comparison.none, strict=True)
        return np.array(
            [remaining.joints / np.maximum(none.joints, TINY) for remaining, none in pairs]
        )

    def worst_log(self, j: int) -> int:
        """Return the index of the log in which most of joint j's deviation is left."""
        return int(np.argmax(self.shares[:, j]))

    def is_weak(self, j: int, noise: float) -> bool:
        """Return whether joint j causes most of a large contour error, see MAIN_SHARE.

        - `noise`: standard deviation of the encoder's noise [rad]; nan without a model.
        """
        i = self.worst_log(j)
        weight = self.comparison.weight
        remaining = self.remaining[i].joints
        contour_error = float(np.linalg.norm(remaining * weight))
        return bool(
            self.shares[i, j] > TRUSTED
            and remaining[j] > NOISE_MULTIPLE * np.nan_to_num(noise)
            and remaining[j] * weight[j] > MAIN_SHARE * contour_error
        )


def _describe_weakness(
    logs: Sequence[Log], joint: JointIdentification, j: int, chosen: _Choice
) -> str:
    """Return the note on a joint that is weak, see `_Choice.is_weak`."""
    i = chosen.worst_log(j)
    remaining = chosen.remaining[i].joints[j]
    none = chosen.comparison.none[i].joints[j]
    return (
        f"The model of {joint.name} is weak: {chosen.shares[i, j]:.0%} of its deviation from the "
        f"contour of {logs[i].source} remains with compensation ({remaining * 1e3:.3g} of "
        f"{none * 1e3:.3g} {'mm' if joint.prismatic else 'mrad'} RMS), which is most of the "
        f"remaining contour error of this log. {RECORD}"
    )


def _judge(
    logs: Sequence[Log],
    joints: Sequence[JointIdentification],
    chosen: _Choice,
    program: int | None,
) -> Judgement:
    """Return the contour errors with and without compensation; arguments of `choose_and_judge`."""
    comparison = chosen.comparison
    before = np.array([x.contour for x in comparison.none])
    after = np.array([x.contour for x in chosen.remaining])
    ratio = after / np.maximum(before, TINY)
    noise = comparison.noise(np.nan_to_num(np.array([x.noise for x in joints])))
    if program is None:
        program_ratio = float(ratio[fastest_motion(logs).slow_logs].max())
    else:
        names = [PROGRAM if x == MODEL else x for x in chosen.written]
        remaining = comparison.deviate_in(comparison.samples[program], names).contour
        program_ratio = remaining / max(float(before[program]), TINY)
    return Judgement(
        programs=count_programs(logs),
        ratios=np.where(after > NOISE_MULTIPLE * noise, ratio, np.minimum(ratio, TRUSTED)),
        program_ratio=program_ratio,
        errors=np.stack([before, after], axis=1),
    )


def count_programs(logs: Sequence[Log]) -> int:
    """Return the number of logs whose commands differ from those of all earlier logs."""
    programs: list[Log] = []
    for log in logs:
        if not any(_is_same_program(log, x) for x in programs):
            programs.append(log)
    return len(programs)


def _is_same_program(one: Log, other: Log) -> bool:
    """Return whether two logs have nearly the same commands, see SAME_PROGRAM."""
    times = one.t - one.t[0]
    difference = one.command - interpolate(times, other.t - other.t[0], other.command)
    ranges = np.maximum(np.ptp(one.command, axis=0), np.ptp(other.command, axis=0))
    return bool((np.ptp(difference, axis=0) <= SAME_PROGRAM * ranges).all())
