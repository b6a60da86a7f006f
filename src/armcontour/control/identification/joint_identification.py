"""Identification of the servo of one joint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from armcontour.control.identification.candidate_models import Search
from armcontour.control.identification.cross_validation import Selected, predict_program
from armcontour.control.identification.identification_result import (
    JointIdentification,
    round_digits,
    write_servo,
)
from armcontour.control.identification.initial_state import predict
from armcontour.control.identification.joint_fit import MRAD
from armcontour.control.identification.joint_motion import (
    check_columns,
    explain_no_model,
    lags_of,
    rms_of,
    worst_log,
)
from armcontour.control.identification.log_segments import LogSegment, find_lag, split_logs
from armcontour.control.identification.model_selection import select_model
from armcontour.control.identification.parameter_estimates import estimate_parameters
from armcontour.control.identification.residual_tests import encoder_resolution, is_white
from armcontour.control.identification.saturated_selection import find_supported_saturation
from armcontour.core.checks import FloatArray
from armcontour.core.quantities import linear_unit
from armcontour.motion.log import Log
from armcontour.robot.servo.simulation import JointServo

# Remedy for a weak or missing model.
RECORD = (
    "Check the unit, sign and order of the columns. Record the program also at half its speed, and "
    "motions of this joint alone, to see whether gravity, friction or other joints cause the error."
)
# A model or delay is rejected if its error exceeds this fraction of the tracking error.
MAX_WEAK = 0.8
# A model is good if its RMS error is at most this fraction of the tracking error. A weak model is
# written only if its RMS error is at most this fraction of the motion.
GOOD_SHARE = 0.3
# A model is also good if its RMS error is at most this multiple of the encoder noise. Deviations
# from the contour up to this multiple of the noise do not show that a model is weak.
NOISE_MULTIPLE = 3.0
# The columns are checked if the error exceeds this fraction of the motion.
MISREAD_SHARE = 0.1
# Longest drive cycle that is assumed if none is given [s]; a longer sample interval replaces it.
USUAL_CYCLE = 2e-3


def identify_joint(
    logs: Sequence[Log], j: int, interpolation: str, search: Search, program: int | None = None
) -> JointIdentification:
    """Identify the servo of joint j (index from 0); order "unknown" if no model is accepted.

    `program` is the index of the only log of a program if the other logs are multisines.
    """
    name = logs[0].joint_names[j]
    segments = split_logs(logs, j, interpolation)
    lag = find_lag(segments, search.longest)
    segments = [x.after(lag) for x in segments]
    slides = logs[0].prismatic[j]
    joint = JointIdentification(name=name, prismatic=slides)
    if reason := explain_no_model(segments):
        return _mark_unknown(joint, segments, f"{name} has no model, because {reason}")
    saturation, selected = find_supported_saturation(segments, search)
    if saturation is not None:
        if selected is None and not saturation.determines_servo:
            note = saturation.explain_no_model(name, prismatic=slides)
            return _mark_unknown(joint, segments, note)
        # Models have no velocity limit, so samples at this limit are neither fitted nor predicted.
        if selected is not None and saturation.kind == "velocity":
            segments = list(selected.segments)
    poor = selected is not None and selected.rms > NOISE_MULTIPLE * selected.fit.noise
    # All samples are fitted if no model is selected. They are also fitted if the selected model is
    # poor and the acceleration saturates, because the unsaturated samples can be insufficient for
    # the servo.
    if selected is None or (poor and saturation is not None and saturation.kind == "acceleration"):
        whole = select_model(segments, search)
        selected = min(
            filter(None, (selected, whole)), key=partial(_rms_error, segments), default=None
        )
    motion = rms_of([s.y for s in segments], segments)[0]
    if selected is None or selected.rms > MISREAD_SHARE * motion:
        for log in logs:
            check_columns(log, j, lag)
    if selected is None:
        note = (
            f"{name} has no model, because fitted gains (at most {search.fastest:g} 1/s) or "
            f"feed-forward are at the bounds of their ranges. {RECORD}"
        )
        return _mark_unknown(joint, segments, note)
    servo = JointServo(*(round_digits(x) for x in selected.servo))
    order = selected.fit.problem.model.order
    noise = selected.fit.noise
    file = [s.y - predict(s, servo, order, search.drive_cycle) for s in segments]
    unseen = [s.y - q for s, q in zip(selected.segments, selected.unseen, strict=True)]
    error, tracking = worst_log(unseen, selected.segments)
    worst = max((error, tracking), worst_log(file, segments), key=lambda x: x[0] / x[1])
    interval = max(float(np.median(np.diff(s.command.t))) for s in segments)
    unknown_cycle = 0.0 if search.drive_cycle else max(interval, USUAL_CYCLE)
    limit = {} if selected.limit is None else {selected.limit.name: selected.limit}
    step = max(encoder_resolution(s.y) for s in segments)
    effective = not is_white(selected.fit.problem.residuals(selected.fit.x) / MRAD, step)
    rivals = selected.rivals if effective else ()
    rests = _at_samples(logs, selected.segments, unseen)
    program_rest = np.zeros(0)
    if program is not None:
        predicted = predict_program(selected, program)
        errors = [s.y - q for s, q in zip(selected.segments, predicted, strict=True)]
        program_rest = _at_samples(logs, selected.segments, errors)[program]
    described = saturation.describe(name, prismatic=slides) if saturation else ""
    estimates = estimate_parameters(selected.fit, selected.without, unknown_cycle, rivals) | limit
    twin = ""
    if selected.twin is not None:
        twin = _describe_twin(name, selected.servo, selected.twin)
        estimates = {x: y.including(getattr(selected.twin, x)) for x, y in estimates.items()}
    if selected.continuous is not None:
        other = selected.continuous
        estimates = {x: y.including(getattr(other, x)) for x, y in estimates.items()}
    if effective and selected.fit.rms > NOISE_MULTIPLE * noise:
        estimates = {x: y.without_interval() for x, y in estimates.items()}
    if slides:
        estimates = {x: replace(y, unit=linear_unit(y.unit)) for x, y in estimates.items()}
    joint = replace(
        joint,
        parameters=estimates,
        effective=effective,
        twin=twin,
        saturation=f"{described}, which the fit allows for." if described else "",
        unseen_rms=error,
        share=error / tracking,
        noise=noise,
        rests=tuple(rests),
        program_rest=program_rest,
    )
    if saturation is not None and saturation.hides and not joint.kp.determined:
        note = saturation.explain_no_model(name, prismatic=slides)
        return _mark_unknown(replace(joint, saturation=""), segments, note)
    note = ""
    advice = ""
    share = worst[0] / worst[1]
    if worst[0] > max(GOOD_SHARE * worst[1], NOISE_MULTIPLE * noise):
        note = (
            f"on motion that was not fitted, {share:.0%} of the tracking error remains "
            f"({worst[0] * 1e3:.3g} of {worst[1] * 1e3:.3g} {'mm' if slides else 'mrad'} RMS)"
        )
        advice = f" {RECORD}"
    if note and (share > MAX_WEAK or selected.rms > GOOD_SHARE * motion):
        allowed = f"{MAX_WEAK:.0%}" if share > MAX_WEAK else f"{GOOD_SHARE:.0%} of the motion"
        note = f"{name} has no model, because {note}, which exceeds {allowed}.{advice}"
        return _mark_unknown(joint, segments, note)
    note = (
        f"The model of {name} is weak: {note}, which exceeds {GOOD_SHARE:.0%}.{advice}"
        if note
        else ""
    )
    joint = replace(joint, note=note, tracking_rms=rms_of(lags_of(segments), segments)[0])
    used = np.concatenate([x[s.use] for x, s in zip(unseen, selected.segments, strict=True)])
    return write_servo(joint, segments, servo, order, search.drive_cycle, float(np.abs(used).max()))


def _at_samples(
    logs: Sequence[Log], segments: Sequence[LogSegment], errors: Sequence[FloatArray]
) -> list[FloatArray]:
    """Errors of segments [rad] at the samples of each log, (n,); nan at unused samples."""
    rests = [np.full(len(x.t), np.nan) for x in logs]
    for s, error in zip(segments, errors, strict=True):
        t = logs[s.log].t - logs[s.log].t[s.start]
        some = (t >= s.command.t[s.use][0]) & (t <= s.command.t[-1])
        rests[s.log][some] = np.interp(t[some], s.command.t, error)
    return rests


def _describe_twin(name: str, servo: JointServo, twin: JointServo) -> str:
    """Sentence about two servos with exchanged K_p and k_i."""
    return (
        f"The log of {name} agrees with two servos: kp {servo.kp:.3g} 1/s and ki {servo.ki:.3g} "
        f"1/s, or kp {twin.kp:.3g} 1/s and ki {twin.ki:.3g} 1/s. Their motion is nearly the same, "
        "and the file has the first one."
    )


def _mark_unknown(
    joint: JointIdentification, segments: Sequence[LogSegment], note: str
) -> JointIdentification:
    """The joint with order "unknown"; its error is the RMS tracking error about the mean."""
    written = write_servo(joint, segments, JointServo(math.inf))
    return replace(written, note=note, tracking_rms=written.rms)


def _rms_error(segments: Sequence[LogSegment], selected: Selected) -> float:
    """RMS error of a model over all used samples [rad]."""
    order = selected.fit.problem.model.order
    drive_cycle = selected.fit.problem.search.drive_cycle
    return rms_of(
        [s.y - predict(s, selected.servo, order, drive_cycle) for s in segments], segments
    )[0]
