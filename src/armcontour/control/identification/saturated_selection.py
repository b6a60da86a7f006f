"""Selection of a model for a joint that saturates in parts of its logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armcontour.control.identification.candidate_models import KP, LIMIT, Model, Search
from armcontour.control.identification.cross_validation import GAIN, Selected, predict_parts
from armcontour.control.identification.estimate import UNITS, Estimate, allowed_deviation
from armcontour.control.identification.initial_state import predict
from armcontour.control.identification.joint_fit import ROUNDING, Fit, Problem, fit
from armcontour.control.identification.log_segments import LogSegment
from armcontour.control.identification.model_selection import is_implausible, select_model
from armcontour.control.identification.parameter_estimates import HALF_INTERVAL, estimate_parameters
from armcontour.control.identification.saturation import Saturation, find_saturation, find_spans
from armcontour.robot.servo.simulation import JointServo

# Multiples of the measured limit that are tried: smallest, largest, and their number.
LIMIT_MULTIPLES = (0.98, 1.06, 9)
# Segments between saturated samples with fewer samples than this are not fitted, because they
# determine no more than their initial state.
FEWEST_UNSATURATED = 20
# Largest number of segments that are fitted; the free initial states of more segments would explain
# most of the motion.
MAX_SEGMENTS = 40
# Number of segments between samples at a velocity limit that are fitted: the longest ones.
LONGEST_SEGMENTS = 10
# Saturation is reported only if the best linear model's error at the saturated samples exceeds this
# multiple of the error with which a model predicts the other samples.
SATURATED_ERROR = 2.0


def find_supported_saturation(
    segments: Sequence[LogSegment], search: Search
) -> tuple[Saturation | None, Selected | None]:
    """Find saturation that models support, and the model of the unsaturated samples.

    A linear joint can also have plateaus, on which the commanded acceleration is inaccurate. A
    model without saturation then predicts the plateaus as well as the other samples.

    Returns:
        The saturation, and the model of the unsaturated samples; None if there is none.
    """
    saturation = find_saturation(segments)
    if saturation is None:
        return None, None
    selected = select_unsaturated(segments, saturation, search)
    linear = select_model(segments, search, limited=False)
    if linear is None:
        return saturation, selected
    error = _error_at_plateaus(segments, saturation, linear)
    error_elsewhere = linear.fit.noise
    if selected is not None:
        error_elsewhere = max(selected.rms, selected.fit.noise)
    if error <= SATURATED_ERROR * max(error_elsewhere, ROUNDING):
        return None, None
    return saturation, selected


def _error_at_plateaus(
    segments: Sequence[LogSegment], saturation: Saturation, linear: Selected
) -> float:
    """Return the RMS error of a model without saturation at the saturated samples [rad]."""
    problem = linear.fit.problem
    errors = []
    for s, clipped in zip(segments, saturation.clipped, strict=True):
        q = predict(s, linear.servo, problem.model.order, problem.search.drive_cycle)
        errors.append((s.y - q)[clipped & s.use])
    joined = np.concatenate(errors)
    return float(np.sqrt(np.mean(joined**2))) if len(joined) else 0.0


def select_unsaturated(
    segments: Sequence[LogSegment], saturation: Saturation, search: Search
) -> Selected | None:
    """Select the model of a joint from its unsaturated samples.

    Each interval between saturated samples is a segment with a free initial state. At a velocity
    limit, only the longest segments are used. A fit of all samples with an acceleration limit is
    preferred if its error in these segments is not significantly larger and its K_p has a smaller
    standard deviation.

    Returns:
        The model; None if there are too few samples, or more than MAX_SEGMENTS segments.
    """
    between = _cut_unsaturated(segments, saturation)
    if saturation.kind == "velocity":
        between = sorted(between, key=lambda x: len(x.y), reverse=True)[:LONGEST_SEGMENTS]
    if not between or len(between) > MAX_SEGMENTS:
        return None
    free = select_model(between, search, limited=False)
    if free is None or saturation.kind == "velocity":
        return free
    if free.fit.problem.model.order != "second":
        return replace(predict_parts(free.fit, segments), rivals=free.rivals)
    limited = _fit_with_limit(segments, saturation.limit, free.fit)
    if _is_preferred(limited, free, between):
        return replace(predict_parts(limited), rivals=free.rivals)
    limit = _estimate_limit(segments, saturation, free.fit)
    return replace(predict_parts(free.fit, segments, limit), rivals=free.rivals)


def _fit_with_limit(segments: Sequence[LogSegment], limit: float, free: Fit) -> Fit:
    """Fit the model of the unsaturated samples, with an acceleration limit, to all samples."""
    order, names = free.problem.model
    problem = Problem(Model(order, (*names, LIMIT)), segments, free.problem.search)
    start = {**free.servo._asdict(), LIMIT: limit}
    return fit(problem, [problem.guess(start, free.servo.dead_time)])


def _is_preferred(limited: Fit, free: Selected, between: Sequence[LogSegment]) -> bool:
    """Return whether the fit of all samples is preferred, see `select_unsaturated`.

    - `limited`: fit of all samples, with an acceleration limit.
    - `free`: model of the unsaturated samples.
    - `between`: segments between saturated samples.
    """
    unlimited = limited.servo._replace(acceleration_limit=np.inf)
    squares = _squared_error(between, unlimited, limited.problem.search.drive_cycle)
    rms = (squares / sum(float(np.sum(s.weight)) for s in between)) ** 0.5
    deviation = estimate_parameters(limited)[KP].sd
    more_certain = deviation < estimate_parameters(free.fit)[KP].sd
    return not is_implausible(limited) and rms * GAIN < free.rms and more_certain


def _estimate_limit(segments: Sequence[LogSegment], saturation: Saturation, free: Fit) -> Estimate:
    """Estimate the acceleration limit with which a servo predicts all samples best.

    Smoothing reduces the height of short plateaus, so larger limits than the measured one are
    tried, too.
    """
    measured = saturation.limit
    drive_cycle = free.problem.search.drive_cycle

    def error(limit: float) -> float:
        limited = free.servo._replace(acceleration_limit=limit)
        return _squared_error(segments, limited, drive_cycle)

    value = min((measured, *measured * np.linspace(*LIMIT_MULTIPLES)), key=error)
    sd = max(saturation.sd, abs(value - measured) / 2)
    return Estimate(
        name=LIMIT,
        unit=UNITS[LIMIT],
        value=float(value),
        sd=sd,
        low=value - HALF_INTERVAL * sd,
        high=value + HALF_INTERVAL * sd,
        determined=bool(sd <= allowed_deviation(value)),
    )


def _cut_unsaturated(segments: Sequence[LogSegment], saturation: Saturation) -> list[LogSegment]:
    """Cut segments into their parts between saturated samples, without parts that are too short."""
    parts = []
    for segment, clipped in zip(segments, saturation.clipped, strict=True):
        for start, end in find_spans(~clipped):
            if np.sum(segment.use[start:end]) >= FEWEST_UNSATURATED:
                parts.append(segment.cut(start, end))
    return parts


def _squared_error(segments: Sequence[LogSegment], servo: JointServo, drive_cycle: float) -> float:
    """Return the squared error of a servo of second order, summed with motion weights [rad²]."""
    errors = [s.y - predict(s, servo, "second", drive_cycle) for s in segments]
    return sum(float(s.weight @ x**2) for s, x in zip(segments, errors, strict=True))
