"""Identification of one joint's servo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.identification.candidate_models import Search
from armcontour.control.identification.cross_validation import Selected, predict_program
from armcontour.control.identification.estimate import Estimate
from armcontour.control.identification.identification_result import (
    JointIdentification,
    round_digits,
    with_servo,
)
from armcontour.control.identification.initial_state import predict
from armcontour.control.identification.joint_fit import MRAD
from armcontour.control.identification.joint_motion import (
    LogError,
    LoggedJoint,
    NoModel,
    find_worst_log,
    rms_of,
    tracking_errors,
)
from armcontour.control.identification.log_segments import LogSegment
from armcontour.control.identification.model_selection import find_continuous, select_model
from armcontour.control.identification.parameter_estimates import estimate_parameters
from armcontour.control.identification.residual_tests import encoder_resolution, is_white
from armcontour.control.identification.saturated_selection import find_supported_saturation
from armcontour.control.identification.saturation import Saturation
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
    logs: Sequence[Log], index: int, interpolation: str, search: Search, program: int | None = None
) -> JointIdentification:
    """Identify the servo of joint `index` (from 0); order "unknown" if no model is accepted.

    - `program`: index of the only program if the other logs are multisines.
    """
    motion = LoggedJoint.read(logs, index, interpolation, search.longest)
    joint = motion.joint
    segments = motion.segments
    try:
        motion.require_motion()
        fitted = FittedJoint.find(motion, search)
        segments = fitted.segments
        joint = fitted.describe(program)
        fitted.require_determined(joint)
        return fitted.write(replace(joint, note=fitted.judge()))
    except NoModel as reason:
        if reason.saturates:
            joint = replace(joint, saturation="")
        unknown = with_servo(joint, segments, JointServo(np.inf))
        # Without a model, the error is the tracking error.
        return replace(unknown, note=str(reason), tracking_rms=unknown.rms)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedJoint:
    """The model that was selected for a joint."""

    motion: LoggedJoint
    search: Search
    segments: list[LogSegment]  # The segments that a model can predict
    saturation: Saturation | None
    selected: Selected

    @classmethod
    def find(cls, motion: LoggedJoint, search: Search) -> FittedJoint:
        """Select a model of the unsaturated samples, or of all samples.

        Raises:
            NoModel: No plausible model was found.
            InvalidInput: The joint does not follow its own commands.
        """
        segments = motion.segments
        saturation, selected = find_supported_saturation(segments, search)
        if saturation is not None:
            if selected is None and not saturation.determines_servo:
                raise NoModel(saturation.explain_no_model(motion.name, prismatic=motion.prismatic))
            # Models have no velocity limit, so samples at this limit are neither fitted nor
            # predicted.
            if selected is not None and saturation.kind == "velocity":
                segments = list(selected.segments)
        if selected is None or _may_need_saturated_samples(selected, saturation):
            selected = _select_better(segments, selected, select_model(segments, search))
        travel = rms_of([s.y for s in segments], segments)
        if selected is None or selected.rms > MISREAD_SHARE * travel:
            motion.check_columns()
        if selected is None:
            raise NoModel(
                f"{motion.name} has no model, because fitted gains (at most {search.fastest:g} "
                f"1/s) or feed-forward are at the bounds of their ranges. {RECORD}"
            )
        return cls(
            motion=motion,
            search=search,
            segments=segments,
            saturation=saturation,
            selected=selected,
        )

    @property
    def servo(self) -> JointServo:
        """The servo with the digits of the servo file."""
        return JointServo(*(round_digits(x) for x in self.selected.servo))

    @property
    def order(self) -> str:
        """Order of the model."""
        return self.selected.fit.problem.model.order

    @property
    def unseen_errors(self) -> list[FloatArray]:
        """Measured less predicted positions of each segment [rad], predicted without fitting it."""
        pairs = zip(self.selected.segments, self.selected.unseen, strict=True)
        return [s.y - q for s, q in pairs]

    def describe(self, program: int | None) -> JointIdentification:
        """Return the joint with its parameters and prediction errors, without a servo yet.

        Each part of the logs is predicted by a fit of the other parts.

        - `program`: as in `identify_joint`.
        """
        motion = self.motion
        effective = self._is_effective()
        unseen = find_worst_log(self.unseen_errors, self.selected.segments)
        return replace(
            motion.joint,
            parameters=self._estimate_parameters(effective),
            effective=effective,
            twin=self._describe_twin(),
            saturation=self._describe_saturation(),
            unseen_rms=unseen.rms,
            share=unseen.share,
            noise=self.selected.fit.noise,
            rests=tuple(self._at_samples(self.unseen_errors)),
            program_rest=self._predict_program(program),
        )

    def require_determined(self, joint: JointIdentification) -> None:
        """Raise NoModel if the joint saturates most of the time and `kp` is not determined."""
        saturation = self.saturation
        if saturation is not None and saturation.hides and not joint.kp.determined:
            name = self.motion.name
            note = saturation.explain_no_model(name, prismatic=self.motion.prismatic)
            raise NoModel(note, saturates=True)

    def judge(self) -> str:
        """Return the note on a weak model; empty for a good model.

        Raises:
            NoModel: The error is too large for a weak model.
        """
        name = self.motion.name
        error = self._find_worst_error()
        if error.rms <= max(GOOD_SHARE * error.tracking, NOISE_MULTIPLE * self.selected.fit.noise):
            return ""
        unit = "mm" if self.motion.prismatic else "mrad"
        remains = (
            f"on motion that was not fitted, {error.share:.0%} of the tracking error remains "
            f"({error.rms * 1e3:.3g} of {error.tracking * 1e3:.3g} {unit} RMS), which exceeds"
        )
        travel = rms_of([s.y for s in self.segments], self.segments)
        if error.share > MAX_WEAK:
            raise NoModel(f"{name} has no model, because {remains} {MAX_WEAK:.0%}. {RECORD}")
        if self.selected.rms > GOOD_SHARE * travel:
            allowed = f"{GOOD_SHARE:.0%} of the motion"
            raise NoModel(f"{name} has no model, because {remains} {allowed}. {RECORD}")
        return f"The model of {name} is weak: {remains} {GOOD_SHARE:.0%}. {RECORD}"

    def write(self, joint: JointIdentification) -> JointIdentification:
        """Return the joint with the servo for the file and its errors on all logs."""
        segments = self.segments
        joint = replace(joint, tracking_rms=rms_of(tracking_errors(segments), segments))
        pairs = zip(self.unseen_errors, self.selected.segments, strict=True)
        used = np.concatenate([x[s.use] for x, s in pairs])
        largest = float(np.abs(used).max())
        return with_servo(joint, segments, self.servo, self.order, self.search.drive_cycle, largest)

    def _find_worst_error(self) -> LogError:
        """Return the larger error: that on parts that were not fitted, or that of the file."""
        unseen = find_worst_log(self.unseen_errors, self.selected.segments)
        file_errors = _errors_of(self.segments, self.servo, self.order, self.search.drive_cycle)
        return max(unseen, find_worst_log(file_errors, self.segments), key=lambda x: x.share)

    def _is_effective(self) -> bool:
        """Return whether the residuals are not white, so that an effect is not modelled."""
        fit = self.selected.fit
        resolution = max(encoder_resolution(s.y) for s in self.segments)
        return not is_white(fit.problem.residuals(fit.x) / MRAD, resolution)

    def _estimate_parameters(self, effective: bool) -> dict[str, Estimate]:
        """Return the estimates of all parameters by name.

        - `effective`: whether the logs contain an effect that is not modelled.
        """
        selected = self.selected
        interval = max(float(np.median(np.diff(s.command.t))) for s in self.segments)
        unknown_cycle = 0.0 if self.search.drive_cycle else max(interval, USUAL_CYCLE)
        rivals = selected.rivals if effective else ()
        estimates = estimate_parameters(selected.fit, selected.without, unknown_cycle, rivals)
        if selected.limit is not None:
            estimates[selected.limit.name] = selected.limit
        for servo in filter(None, (selected.twin, find_continuous(selected.fit))):
            estimates = {name: x.including(getattr(servo, name)) for name, x in estimates.items()}
        repairs = {x.repair for log in self.motion.logs for x in log.findings}
        if effective or repairs & {"rebuilt", "left out"}:
            # An effect that is not modelled, or an error of the repair, biases them.
            estimates = {name: x.without_interval() for name, x in estimates.items()}
        if self.motion.prismatic:
            for name, x in estimates.items():
                estimates[name] = replace(x, unit=linear_unit(x.unit))
        return estimates

    def _predict_program(self, program: int | None) -> FloatArray:
        """Return the errors of the program's parts, see `JointIdentification.program_rest`."""
        if program is None:
            return np.zeros(0)
        selected = self.selected
        predicted = predict_program(selected, program)
        errors = [s.y - q for s, q in zip(selected.segments, predicted, strict=True)]
        return self._at_samples(errors)[program]

    def _at_samples(self, errors: Sequence[FloatArray]) -> list[FloatArray]:
        """Return errors of `selected.segments` at the samples of each log [rad], (n,).

        Samples that do not count have the error nan.
        """
        logs = self.motion.logs
        rests = [np.full(len(x.t), np.nan) for x in logs]
        for s, error in zip(self.selected.segments, errors, strict=True):
            t = logs[s.log].t - logs[s.log].t[s.start]
            counts = (t >= s.command.t[s.use][0]) & (t <= s.command.t[-1])
            rests[s.log][counts] = np.interp(t[counts], s.command.t, error)
        return rests

    def _describe_twin(self) -> str:
        """Return a sentence about a second servo with exchanged K_p and k_i; empty if none."""
        twin = self.selected.twin
        if twin is None:
            return ""
        servo = self.selected.servo
        return (
            f"The log of {self.motion.name} agrees with two servos: kp {servo.kp:.3g} 1/s and ki "
            f"{servo.ki:.3g} 1/s, or kp {twin.kp:.3g} 1/s and ki {twin.ki:.3g} 1/s. Their motion "
            "is nearly the same, and the file has the first one."
        )

    def _describe_saturation(self) -> str:
        """Return a sentence about saturation that the fit allows for; empty if none."""
        if self.saturation is None:
            return ""
        described = self.saturation.describe(self.motion.name, prismatic=self.motion.prismatic)
        return f"{described}, which the fit allows for."


def _may_need_saturated_samples(selected: Selected, saturation: Saturation | None) -> bool:
    """Return whether a joint that saturates in acceleration has a poor model.

    Its unsaturated samples can be insufficient for the servo. Then all samples are fitted.
    """
    poor = selected.rms > NOISE_MULTIPLE * selected.fit.noise
    return poor and saturation is not None and saturation.kind == "acceleration"


def _select_better(
    segments: Sequence[LogSegment], one: Selected | None, other: Selected | None
) -> Selected | None:
    """Return the model with the smaller error on all segments; None if there is none."""
    models = [x for x in (one, other) if x is not None]
    if not models:
        return None

    def error(selected: Selected) -> float:
        """Return the RMS error of a model on all segments [rad]."""
        problem = selected.fit.problem
        order = problem.model.order
        errors = _errors_of(segments, selected.servo, order, problem.search.drive_cycle)
        return rms_of(errors, segments)

    return min(models, key=error)


def _errors_of(
    segments: Sequence[LogSegment], servo: JointServo, order: str, drive_cycle: float
) -> list[FloatArray]:
    """Return measured positions less those of a servo, for each segment [rad]."""
    return [s.y - predict(s, servo, order, drive_cycle) for s in segments]
