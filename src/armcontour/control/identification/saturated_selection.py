"""Selection of the model of a joint that saturates in parts of its logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armcontour.control.identification.candidate_models import KP, LIMIT, Model, Search
from armcontour.control.identification.cross_validation import GAIN, Selected, predict_parts
from armcontour.control.identification.estimate import UNITS, Estimate, allowed_deviation
from armcontour.control.identification.initial_state import predict
from armcontour.control.identification.joint_fit import ROUNDING, Problem, fit
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
# Saturation is reported only if the error of the best linear model at the saturated samples exceeds
# this multiple of the error of the model of the other samples.
SATURATED_ERROR = 2.0


def find_supported_saturation(
    segments: Sequence[LogSegment], search: Search
) -> tuple[Saturation | None, Selected | None]:
    """Saturation that models support, and the model of the unsaturated samples; None if none.

    A linear joint can also have plateaus, on which the commanded acceleration is inaccurate. A
    model without saturation then predicts the plateaus as well as the other samples.
    """
    saturation = find_saturation(segments)
    if saturation is None:
        return None, None
    selected = select_unsaturated(segments, saturation, search)
    linear = select_model(segments, search, limited=False)
    if linear is None:
        return saturation, selected
    order = linear.fit.problem.model.order
    every = []
    for s, clipped in zip(segments, saturation.clipped, strict=True):
        every.append((s.y - predict(s, linear.servo, order, search.drive_cycle))[clipped & s.use])
    errors = np.concatenate(every)
    error = float(np.sqrt(np.mean(errors**2))) if len(errors) else 0.0
    usual = linear.fit.noise if selected is None else max(selected.rms, selected.fit.noise)
    if error <= SATURATED_ERROR * max(usual, ROUNDING):
        return None, None
    return saturation, selected


def select_unsaturated(
    segments: Sequence[LogSegment], saturation: Saturation, search: Search
) -> Selected | None:
    """Select the model of a joint from its unsaturated samples; None if they are too few."""
    # Each interval between saturated samples is a segment with a free initial state. A fit of all
    # samples with an acceleration limit is preferred if its error in these segments is not
    # significantly larger and its K_p has a smaller standard deviation.
    # None is also returned if there are too many segments. At a velocity limit, only the longest
    # segments are used.
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
    order, names = free.fit.problem.model
    problem = Problem(Model(order, (*names, LIMIT)), segments, search)
    start = {**free.fit.servo._asdict(), LIMIT: saturation.limit}
    whole = fit(problem, [problem.guess(start, free.fit.servo.dead_time)])
    squares = _error(between, whole.servo._replace(acceleration_limit=np.inf), search.drive_cycle)
    rms = (squares / sum(float(np.sum(s.weight)) for s in between)) ** 0.5
    certain = [estimate_parameters(x)[KP].sd for x in (whole, free.fit)]
    if not is_implausible(whole) and rms * GAIN < free.rms and certain[0] < certain[1]:
        return replace(predict_parts(whole), rivals=free.rivals)
    measured = saturation.limit
    servo = free.fit.servo
    # Smoothing reduces the height of short plateaus, so larger limits are also tried.
    value = min(
        (measured, *measured * np.linspace(*LIMIT_MULTIPLES)),
        key=lambda x: _error(segments, servo._replace(acceleration_limit=x), search.drive_cycle),
    )
    sd = max(saturation.sd, abs(value - measured) / 2)
    limit = Estimate(
        name=LIMIT, unit=UNITS[LIMIT], value=float(value), sd=sd, low=value - HALF_INTERVAL * sd,
        high=value + HALF_INTERVAL * sd, determined=bool(sd <= allowed_deviation(value)),
    )  # fmt: skip
    return replace(predict_parts(free.fit, segments, limit), rivals=free.rivals)


def _cut_unsaturated(segments: Sequence[LogSegment], saturation: Saturation) -> list[LogSegment]:
    """Cut segments into their parts between saturated samples, without parts that are too short."""
    parts = []
    for segment, clipped in zip(segments, saturation.clipped, strict=True):
        for begin, end in find_spans(~clipped):
            if np.sum(segment.use[begin:end]) >= FEWEST_UNSATURATED:
                parts.append(segment.cut(begin, end))
    return parts


def _error(segments: Sequence[LogSegment], servo: JointServo, drive_cycle: float) -> float:
    """Sum of the squared errors of a servo of second order, weighted by motion [rad²]."""
    errors = [s.y - predict(s, servo, "second", drive_cycle) for s in segments]
    return sum(float(s.weight @ x**2) for s, x in zip(segments, errors, strict=True))
