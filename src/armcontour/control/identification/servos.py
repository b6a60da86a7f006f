"""Identification of independent servos: select the model of each joint, and judge it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from armcontour.control.identification.fitting import (
    MRAD,
    LogSegment,
    Search,
    estimate_parameters,
    predict,
    split_logs,
)
from armcontour.control.identification.judgement import WEAK, judge
from armcontour.control.identification.options import (
    MODELS,
    ServoFit,
    choose_interpolation,
    dead_times,
    list_logs,
)
from armcontour.control.identification.residuals import (
    describe_residuals,
    find_residuals,
    is_white,
    resolution,
    scale_residuals,
)
from armcontour.control.identification.results import (
    Identification,
    JointIdentification,
    rounded,
    write_servo,
)
from armcontour.control.identification.saturation import find_saturation, select_between
from armcontour.control.identification.selection import Selected, find_lag, select
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.sampling import white_noise
from armcontour.core.text import show
from armcontour.motion.log import FEWEST, Log
from armcontour.motion.log_checks import check_distance, check_speeds, check_units
from armcontour.robot.servo.simulation import JointServo

SERVO_FIT = ServoFit()
# A model is good if its RMS error is at most this share of the tracking error, or at most so many
# times the noise of the encoder. A weak one is within that share of the motion.
SHARE, NOISES = 0.3, 3.0
# Errors beyond this share of the motion may come from columns in another order, unit or direction.
MISREAD = 0.1
# Less motion than this, in standard deviations of the noise or in rad, is none: an encoder of 32
# bits has steps of 1.5e-9 rad.
STILL, LEAST_MOTION = 1.5, 1e-9
# Smallest tracking error [rad] of which shares are computed.
LEAST_LAG = 1e-12
# Nor is this [rad] a change of velocity: logs have nine digits at most.
LEAST_BEND = 1e-8
# Longest cycle of a drive whose cycle is not given [s], or the cycle, if it is longer.
USUAL_CYCLE = 2e-3


@checked
def identify(
    logs: Log | Sequence[Log],
    options: ServoFit = SERVO_FIT,
    *,
    progress: Progress | None = None,
) -> Identification:
    """Identify the servo of every joint from logs.

    The model of each joint is the simplest one of a dead time, a servo of first and one of second
    order, as in `ServoModel`, that predicts parts of the logs to which it was not fitted. The model
    is simulated exactly from the set-points. With several logs, each one is predicted from the
    others. A model is good if the error is at most 30 % of the tracking error, or 3 times the noise
    of the encoder. A weak model, with at most 80 %, is written if that reduces the contour error
    where it was not fitted; otherwise the delay of the joint is, or nothing.

    Args:
        logs: A log, with set-points and measured positions, or several logs of the same robot.
        options: Options, such as `ServoFit(model="second")`.
        progress: Called with a step, the name of a joint, before each.

    Raises:
        InvalidInput: Samples too far apart, logs of other joints or another arm, or a log in which
            command and measurement cannot belong together.
    """
    every = list_logs(logs)
    first, arm = every[0], options.kinematics
    for x in every[1:]:
        if x.joint_names != first.joint_names:
            raise InvalidInput(
                f"{first.source} and {x.source} do not go together: joint_names is "
                f"{show(str(first.joint_names))} in one and {show(str(x.joint_names))} in the "
                "other."
            )
    if arm is not None and arm.dof != first.dof:
        raise InvalidInput(
            f"{first.source} has {first.dof} joints, but the arm {arm.name} has {arm.dof}: give "
            "the arm of the log."
        )
    interpolation = choose_interpolation(every, options.interpolation)
    for x in every:
        if arm is not None:
            check_distance(x, arm)
        check_speeds(x)
    tell, joints = subprogress(progress), []
    longest, orders = dead_times(every, options.longest_dead_time)[1], MODELS[options.model]
    search = Search(longest, options.drive_cycle or 0.0, orders)
    for j, name in enumerate(first.joint_names):
        tell(Step((name,)))
        joints.append(identify_joint(every, j, interpolation, search))
    found, judgement = judge(every, joints, interpolation, search.longest, arm)
    return Identification(
        logs=every,
        interpolation=interpolation,
        joints=found,
        drive_cycle=search.drive_cycle,
        judgement=judgement,
    )


def identify_joint(
    logs: Sequence[Log], j: int, interpolation: str, search: Search
) -> JointIdentification:
    """Identify the joint j (from 0) of some logs.

    Raises:
        InvalidInput: Command and measurement cannot belong together.
    """
    name = logs[0].joint_names[j]
    stretches = split_logs(logs, j, interpolation)
    lag = find_lag(stretches, search.longest)
    stretches = [x.after(lag) for x in stretches]
    joint = JointIdentification(name=name)
    if why := _why_none(stretches):
        return _without_model(joint, stretches, f"{name} has no model: {why}")
    saturation, found = find_saturation(stretches), None
    if saturation is not None:
        found = select_between(stretches, saturation, search)
    poor = found is not None and found.rms > NOISES * found.fit.noise
    # What is left beside a limit may tell little of the servo; models have no limit of velocity.
    if found is None or (poor and saturation is not None and saturation.kind == "acceleration"):
        whole = select(stretches, search)
        found = min(filter(None, (found, whole)), key=partial(_error, stretches), default=None)
    motion = _rms([s.y for s in stretches], stretches)[0]
    if found is None or found.rms > MISREAD * motion:
        for log in logs:
            check_units(log, search.longest, j)
    if found is None:
        left = [find_residuals(x, j) for x in logs]
        note = (
            f"{name} has no model: gains (up to {search.fastest:g} 1/s) or feed-forward end at the "
            f"bounds of their ranges. {describe_residuals(logs, j, left)}"
        )
        return _without_model(joint, stretches, note)
    servo = JointServo(*(rounded(x) for x in found.servo))
    order, noise = found.fit.problem.model.order, found.fit.noise
    file = [s.y - predict(s, servo, order, search.drive_cycle) for s in stretches]
    unseen = [s.y - q for s, q in zip(found.stretches, found.unseen, strict=True)]
    error, of = _judge(unseen, found.stretches)
    worst = max((error, of), _judge(file, stretches), key=lambda x: x[0] / x[1])
    interval = max(float(np.median(np.diff(s.command.t))) for s in stretches)
    unknown_cycle = 0.0 if search.drive_cycle else max(interval, USUAL_CYCLE)
    limit = {} if found.limit is None else {found.limit.name: found.limit}
    step = max(resolution(s.y) for s in stretches)
    effective = not is_white(found.fit.problem.residuals(found.fit.x) / MRAD, step)
    rivals = found.rivals if effective else ()
    rests = [np.full(len(x.t), np.nan) for x in logs]
    for s, off in zip(found.stretches, unseen, strict=True):
        t = logs[s.log].t - logs[s.log].t[s.start]
        some = (t >= s.command.t[s.use][0]) & (t <= s.command.t[-1])
        rests[s.log][some] = np.interp(t[some], s.command.t, off)
    joint = replace(
        joint,
        parameters=estimate_parameters(found.fit, found.without, unknown_cycle, rivals) | limit,
        effective=effective,
        saturation=f"{saturation.describe(name)}, which the fit allows for." if saturation else "",
        unseen_rms=error,
        share=error / of,
        noise=noise,
        rests=tuple(rests),
        scaling=scale_residuals(logs, j, rests),
    )
    if saturation is not None and saturation.hides and not joint.kp.determined:
        note = (
            f"{name} has no model: {saturation.describe('it')}, and the rest does not determine "
            "its servo: record more motion at lower accelerations."
        )
        return _without_model(replace(joint, saturation=""), stretches, note)
    note, more, share = "", "", worst[0] / worst[1]
    if worst[0] > max(SHARE * worst[1], NOISES * noise):
        note = (
            f"where it was not fitted, {share:.0%} of the tracking error remain "
            f"({worst[0] * 1e3:.3g} of {worst[1] * 1e3:.3g} mrad RMS)"
        )
        more = f" {describe_residuals(logs, j, rests)}"
    if note and (share > WEAK or found.rms > SHARE * motion):
        most = f"{WEAK:.0%}" if share > WEAK else f"{SHARE:.0%} of the motion"
        note = f"{name} has no model: {note}, more than {most}.{more}"
        return _without_model(joint, stretches, note)
    note = f"The model of {name} is weak: {note}, more than {SHARE:.0%}.{more}" if note else ""
    joint = replace(joint, note=note, tracking_rms=_rms(_lags(stretches), stretches)[0])
    used = np.concatenate([x[s.use] for x, s in zip(unseen, found.stretches, strict=True)])
    return write_servo(
        joint, stretches, servo, order, search.drive_cycle, float(np.abs(used).max())
    )


def _without_model(
    joint: JointIdentification, stretches: Sequence[LogSegment], note: str
) -> JointIdentification:
    """The joint of order "unknown", whose error is its tracking error about the mean."""
    found = write_servo(joint, stretches, JointServo(math.inf))
    return replace(found, note=note, tracking_rms=found.rms)


def _error(stretches: Sequence[LogSegment], found: Selected) -> float:
    """RMS error of a model over all samples [rad]."""
    order, drive_cycle = found.fit.problem.model.order, found.fit.problem.search.drive_cycle
    return _rms([s.y - predict(s, found.servo, order, drive_cycle) for s in stretches], stretches)[
        0
    ]


def _judge(off: Sequence[FloatArray], stretches: Sequence[LogSegment]) -> tuple[float, float]:
    """Error and tracking error of the log with the largest share, RMS [rad].

    Those of a single log are weighted by motion, because some of its parts may stand.
    """
    logs = sorted({s.log for s in stretches if s.weight.any()})
    single, found, lags = int(len(logs) == 1), [], _lags(stretches)
    for k in logs:
        own = [i for i, s in enumerate(stretches) if s.log == k]
        some = [stretches[i] for i in own]
        error = _rms([off[i] for i in own], some, centred=False)[single]
        found.append((error, max(_rms([lags[i] for i in own], some)[single], LEAST_LAG)))
    return max(found, key=lambda x: x[0] / x[1])


def _lags(stretches: Sequence[LogSegment]) -> list[FloatArray]:
    """Measured positions less commands [rad]."""
    return [s.y - s.command.u for s in stretches]


def _rms(
    values: Sequence[FloatArray], stretches: Sequence[LogSegment], *, centred: bool = True
) -> tuple[float, float]:
    """RMS of values over the samples that count, about their means, and weighted by motion."""
    sums = np.zeros(4)
    for x, s in zip(values, stretches, strict=True):
        square = (x - (np.mean(x[s.use]) if centred else 0.0)) ** 2
        weight = s.weight * s.use
        sums += [square @ s.use, s.use.sum(), square @ weight, weight.sum()]
    return float(np.sqrt(sums[0] / sums[1])), float(np.sqrt(sums[2] / max(sums[3], 1e-300)))


def _why_none(stretches: Sequence[LogSegment]) -> str:
    """Why nothing can be identified: no motion, or only a uniform velocity; else empty."""
    if not stretches:
        return f"there are no {FEWEST} samples without a gap: record more."
    if not any((s.weight * s.use).any() for s in stretches):
        return "no motion is commanded: record a program in which it moves."
    if all(
        np.ptp(s.y) <= LEAST_MOTION or np.std(s.y) <= STILL * white_noise(s.y) for s in stretches
    ):
        change = max(float(np.ptp(s.command.u)) for s in stretches)
        still = f"it shows no motion beyond noise, though commands change by {change:.3g} rad"
        return f"{still}: record more motion."
    if not any(changes_velocity(s.command.t, x) for s in stretches for x in (s.command.u, s.y)):
        return "the velocity is uniform, which shows a lag, but no gains: record a multisine."
    return ""


def changes_velocity(t: FloatArray, x: FloatArray) -> bool:
    """Whether positions [rad] over times [s] are more than a straight line and noise, (n,) each."""
    off = x - np.polyval(np.polyfit(t, x, 1), t)
    return bool(np.std(off) > STILL * white_noise(x) and np.ptp(off) > LEAST_BEND)
