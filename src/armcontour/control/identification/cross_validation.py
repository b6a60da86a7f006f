"""Cross-validation: each part of the logs is predicted by a fit of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.identification.candidate_models import LIMIT
from armcontour.control.identification.estimate import Estimate
from armcontour.control.identification.initial_state import predict
from armcontour.control.identification.joint_fit import ROUNDING, Fit, Problem, fit
from armcontour.control.identification.log_segments import LogSegment, divide_log, moving_parts
from armcontour.core.checks import FloatArray
from armcontour.robot.servo.simulation import JointServo

# A richer model is selected only if the median over the parts of its error divided by the error of
# the simpler model is below this. Errors with a ratio above this are nearly the same.
GAIN = 0.9
# The same for models with an acceleration limit, instead of GAIN.
LIMIT_GAIN = 0.5
# A richer model is selected only if its error is smaller on at least this fraction of the parts.
MIN_BETTER_PARTS = 0.6
# Largest number of evaluations in cross-validation, where fits start from the fit of all parts.
REFIT_EVALUATIONS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selected:
    """A fitted model and its predictions of the parts to which it was not fitted."""

    fit: Fit  # The fit to all samples
    segments: Sequence[LogSegment]  # The segments that are predicted
    # Predicted positions of each segment [rad]; each part is predicted by a fit of the other parts.
    unseen: list[FloatArray]
    errors: FloatArray  # Mean squared errors of the parts, weighted by motion [rad²], (parts,)
    motions: FloatArray  # Weights of the parts (sums of the sample weights), (parts,)
    limit: Estimate | None = None  # Acceleration limit if it is estimated separately from the fit
    without: Sequence[JointServo] = ()  # Servos, each fitted without one part
    rivals: Sequence[JointServo] = ()  # Servos of other models with nearly the same error
    # The solution with exchanged K_p and k_i if its error is nearly the same.
    twin: JointServo | None = None

    @property
    def servo(self) -> JointServo:
        """The fitted servo, with the separately estimated limit if there is one."""
        return limited_servo(self.fit.servo, self.limit)

    @property
    def rms(self) -> float:
        """RMS error on parts that were not fitted, weighted by motion [rad]."""
        return float(np.sqrt(np.average(self.errors, weights=self.motions)))

    @property
    def explains_all(self) -> bool:
        """True if the error is noise or rounding. Then no richer model can be better."""
        return self.rms * GAIN < max(self.fit.noise, ROUNDING)

    def is_better(self, other: Selected) -> bool:
        """Return whether this model is significantly better than the simpler `other`, see GAIN."""
        limited = LIMIT in self.fit.problem.model.free
        ratio = float(np.median(self.errors / np.maximum(other.errors, 1e-300))) ** 0.5
        better = float(np.mean(self.errors < other.errors))
        return ratio < (LIMIT_GAIN if limited else GAIN) and better >= MIN_BETTER_PARTS


def limited_servo(servo: JointServo, limit: Estimate | None) -> JointServo:
    """Return the servo with the acceleration limit; unchanged if the limit is None."""
    return servo if limit is None else servo._replace(acceleration_limit=limit.value)


def predict_program(selected: Selected, log: int) -> list[FloatArray]:
    """Predict each part of one log by a fit of its other parts and all other logs.

    Returns:
        Predicted positions of each segment [rad].
    """
    result = selected.fit
    problem = result.problem
    # The segments on which the model was selected can have fewer samples than those of the fit.
    fitted = selected.segments if selected.limit is None else problem.segments
    parts = divide_log(fitted, log)
    divided = replace(result, problem=Problem(problem.model, parts, problem.search))
    judged = divide_log(selected.segments, log)
    return predict_parts(divided, judged, selected.limit).unseen


def predict_parts(
    result: Fit, judged: Sequence[LogSegment] | None = None, limit: Estimate | None = None
) -> Selected:
    """Predict each moving part by a fit of the other parts (cross-validation).

    Parts without motion are predicted by the fit of all parts.

    - `judged`: segments that are predicted, by default those of the fit. Part -1 is always fitted.
    - `limit`: acceleration limit that is estimated separately from the fit.
    """
    problem = result.problem
    segments = judged or problem.segments

    def predict_by(servo: JointServo, s: LogSegment) -> FloatArray:
        """Return the positions that a servo predicts in a segment [rad], (n,)."""
        limited = limited_servo(servo, limit)
        return predict(s, limited, problem.model.order, problem.search.drive_cycle)

    unseen = [predict_by(result.servo, s) for s in segments]
    errors = []
    motions = []
    without = []
    for part in moving_parts(segments):
        servo = _fit_without(result, part)
        without.append(servo)
        squares = 0.0
        motion = 0.0
        for s, positions in zip(segments, unseen, strict=True):
            mask = s.part == part
            if mask.any():
                q = predict_by(servo, s)
                positions[mask] = q[mask]
                weight = s.weight[mask] * s.use[mask]
                squares += float(np.sum(weight * (q - s.y)[mask] ** 2))
                motion += float(np.sum(weight))
        errors.append(squares / motion)
        motions.append(motion)
    return Selected(
        fit=result,
        segments=segments,
        unseen=unseen,
        errors=np.array(errors),
        motions=np.array(motions),
        limit=limit,
        without=without,
    )


def _fit_without(result: Fit, part: int) -> JointServo:
    """Return the servo that fits all samples except for those of one part."""
    problem = result.problem
    segments = [replace(s, use=s.use & (s.part != part)) for s in problem.segments]
    indices = [i for i, s in enumerate(segments) if s.use.any()]
    reduced = Problem(problem.model, [segments[i] for i in indices], problem.search)
    return fit(reduced, [problem.unknowns_of_segments(result.x, indices)], REFIT_EVALUATIONS).servo
