"""Selection of a joint's servo model by cross-validation over parts of the logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.identification.joint_fit import (
    ROUNDING,
    Fit,
    LogSegment,
    Model,
    Problem,
    Search,
    estimate_parameters,
    fit,
    predict,
)
from armcontour.control.identification.least_squares import Estimate
from armcontour.core.checks import FloatArray, IntArray
from armcontour.motion.log import FEWEST
from armcontour.robot.servo.simulation import JointServo

KP, KV, KI = "kp", "kv", "ki"
FEED, ACCELERATION = "velocity_feedforward", "acceleration_feedforward"
DELAY, LIMIT, FRICTION = "dead_time", "acceleration_limit", "friction"
# Candidate models, from simple to rich.
CANDIDATES = (
    Model("delay", (DELAY,)),
    Model("first", (KP, DELAY)),
    Model("first", (KP, FEED, DELAY)),
    Model("second", (KP, KV, DELAY)),
    Model("second", (KP, KV, FEED, DELAY)),
    Model("first", (KP, FEED, ACCELERATION, DELAY)),
    Model("second", (KP, KV, FEED, ACCELERATION, DELAY)),
    Model("second", (KP, KV, KI, FEED, DELAY, FRICTION)),
    Model("second", (KP, KV, KI, FEED, ACCELERATION, DELAY, FRICTION)),
    Model("second", (KP, KV, FEED, DELAY, LIMIT)),
)
# Parameters that are removed from a P-PI cascade (model with k_i) if it is not significantly worse
# without them.
OPTIONAL = (ACCELERATION, FEED, FRICTION)
# A richer model is selected under two conditions. The median over the parts of its error divided by
# the error of the poorer model is below GAIN, or LIMIT_GAIN for a model with an acceleration limit.
# Its error is smaller on at least the share MAX_PARTS of the parts.
GAIN, LIMIT_GAIN, MAX_PARTS = 0.9, 0.5, 0.6
# A richer model is discarded if its error on the fitted data exceeds this share of the error of the
# best model.
RICHER_SHARE = 0.97
# A poorer model is discarded if its cost on the fitted data exceeds this multiple of the best cost.
POORER_RATIO = 2.0
# A cascade is fitted if the error of the best model so far is below this fraction of the tracking
# error.
CASCADE_SHARE = 0.5
# Smallest damping ratio of a fitted loop; no drive is tuned with less damping.
LEAST_DAMPING = 0.2
# Largest number of evaluations of a cross-validation fit, which starts from the fit of all parts.
REFIT_EVALUATIONS = 10
# Selection uses samples with the spacing COARSE_SPACING [s] if linear interpolation of their
# set-points reproduces the command with an RMS error below the share THINNING_ERROR of the noise of
# the positions.
COARSE_SPACING = 4e-3
THINNING_ERROR = 0.3
# Upper bound of the initial dead time in the fit of a saturating joint [s].
USUAL_DELAY = 0.01
# ACCELERATION_TIMES: times over which accelerations are measured [s], a short time for fast motion
# and a long time for small motion in noise. ACCELERATION_PERCENTILE: percentile that counts as the
# largest acceleration.
ACCELERATION_TIMES, ACCELERATION_PERCENTILE = (8e-3, 40e-3), 99
# Initial values of loops: a, b, K_v [1/s], k_i [1/s], velocity feed-forward, and dead time divided
# by the lag. The initial K_p is a + b / lag. Feed-forward matters only in loops that saturate.
STARTS = (
    (10.0, 0.0, 20.0, 5.0, 1.0, 0.8), (1.0, 0.0, 100.0, 5.0, 1.0, 1.0),
    (40.0, 0.0, 150.0, 5.0, 0.6, 0.5), (30.0, 0.0, 100.0, 5.0, 0.0, 0.3),
    (150.0, 0.0, 60.0, 5.0, 0.6, 0.9), (0.0, 0.8, 60.0, 5.0, 0.0, 0.1),
    (0.0, 1.5, 150.0, 12.0, 0.0, 0.3), (0.0, 4.0, 100.0, 5.0, 0.0, 0.7),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selected:
    """A fitted model and its predictions of the parts to which it was not fitted."""

    fit: Fit  # The fit to all samples
    segments: Sequence[LogSegment]  # The segments that are predicted
    # unseen: predicted positions of each segment [rad]; each part by a fit of the other parts.
    unseen: list[FloatArray]
    errors: FloatArray  # Mean squared errors of the parts, weighted by motion [rad²], (parts,)
    motions: FloatArray  # Weights of the parts (sums of the sample weights), (parts,)
    limit: Estimate | None = None  # Acceleration limit if it is estimated separately from the fit
    without: Sequence[JointServo] = ()  # Servos, each fitted without one part
    rivals: Sequence[JointServo] = ()  # Servos of other models with nearly the same error

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
        """Return whether this model is significantly better than a poorer one, see GAIN."""
        limited = LIMIT in self.fit.problem.model.free
        ratio = float(np.median(self.errors / np.maximum(other.errors, 1e-300))) ** 0.5
        some = float(np.mean(self.errors < other.errors))
        return ratio < (LIMIT_GAIN if limited else GAIN) and some >= MAX_PARTS


def find_lag(segments: Sequence[LogSegment], longest: float) -> float:
    """Delay of the command with the smallest tracking error [s], on a grid of about 1 ms."""

    def remaining_error(lag: float) -> float:
        errors = [s.y - s.command.evaluate(s.command.t - lag) for s in segments]
        return sum(
            float(np.var(x[s.use]) * s.use.sum()) for x, s in zip(errors, segments, strict=True)
        )

    return float(min(np.linspace(0.0, longest, int(longest / 1e-3) + 2), key=remaining_error))


def select_model(
    segments: Sequence[LogSegment], search: Search, *, limited: bool = True
) -> Selected | None:
    """Select the model of a joint; None if less than two parts move or all fits are implausible."""
    some = _thin_segments(segments)
    # Cross-validation requires at least two parts.
    if len(_moving_parts(some)) < 2:
        return None
    trials = _Trials(some, search)
    for model in CANDIDATES:
        bent = ACCELERATION in model.free and not some[0].command.linear
        excluded = bent or (LIMIT in model.free and not limited) or model.order not in search.orders
        if excluded or (KI in model.free and not trials.may_be_cascade(model)):
            continue
        trials.add(model)
        if trials.best and trials.best.explains_all:
            break
    if trials.best is None:
        return None
    order, free = trials.best.fit.problem.model
    if KI in free:
        trials.prune()
    elif order != "delay" and not trials.best.explains_all:
        trials.add(Model(order, (*free, FRICTION)))
    trials.drop_open_dead_time()
    best = trials.best
    rivals = [x.fit.servo for x in trials.tried if x.rms * GAIN < best.rms and x is not best]
    if some is segments:
        return replace(best, rivals=rivals)
    whole = Problem(best.fit.problem.model, segments, search)
    return replace(best, rivals=rivals, fit=fit(whole, [best.fit.x], REFIT_EVALUATIONS))


class _Trials:
    """Models that were fitted to a joint, and the best of them."""

    def __init__(self, segments: Sequence[LogSegment], search: Search) -> None:
        self.segments, self.search = segments, search
        self.lag = find_lag(segments, search.longest)
        self.fits: dict[Model, Fit] = {}
        self.tried: list[Selected] = []
        self.best: Selected | None = None

    def add(self, model: Model) -> None:
        """Fit a model; it becomes the best model if it is significantly better."""
        problem, best = Problem(model, self.segments, self.search), self.best
        starts = [problem.guess(x, self.lag) for x in self._starts(model)]
        result = fit(problem, starts, 30 if KI in model.free else 60)
        hopeless = best and result.cost > RICHER_SHARE**2 * best.fit.cost
        if KI in model.free and not hopeless:
            # Loops with exchanged K_p and k_i have the same poles.
            servo = result.servo
            other = servo._replace(kp=servo.ki, ki=servo.kp)._asdict()
            exchanged = fit(problem, [problem.guess(other, servo.dead_time)], 30)
            result = min(result, exchanged, key=lambda x: x.cost)
        self.fits[model] = result
        if hopeless or is_implausible(result):
            return
        self.tried.append(predict_parts(result))
        if best is None or self.tried[-1].is_better(best):
            self.best = self.tried[-1]

    def may_be_cascade(self, model: Model) -> bool:
        """Return whether the best model explains enough of the tracking error to try a cascade."""
        if self.best is None:
            return False
        lag = np.concatenate([(s.y - s.command.u)[s.use] for s in self.best.segments])
        supported = {KI, ACCELERATION} & set(self.best.fit.problem.model.free)
        explains = self.best.rms < CASCADE_SHARE * np.std(lag)
        return bool(explains and (ACCELERATION not in model.free or supported))

    def prune(self) -> None:
        """Remove OPTIONAL parameters without which the best model is not significantly worse."""
        for name in OPTIONAL:
            assert self.best is not None
            free = self.best.fit.problem.model.free
            # Acceleration feed-forward requires velocity feed-forward.
            if name in free and not (name == FEED and ACCELERATION in free):
                self._drop(name)

    def drop_open_dead_time(self) -> None:
        """Remove an undetermined dead time if the best model is not significantly worse."""
        assert self.best is not None
        loop = self.best.fit.problem.model.order != "delay"
        if loop and not estimate_parameters(self.best.fit, self.best.without)[DELAY].determined:
            self._drop(DELAY)

    def _drop(self, name: str) -> None:
        """Remove a parameter unless the best model is significantly worse without it."""
        assert self.best is not None
        best = self.best.fit
        order, free = best.problem.model
        model = Model(order, tuple(y for y in free if y != name))
        problem = Problem(model, self.segments, self.search)
        start = best.servo._replace(**{name: 0.0})
        result = fit(problem, [problem.guess(start._asdict(), best.servo.dead_time)])
        if is_implausible(result) or result.cost > POORER_RATIO * best.cost:
            return
        poorer = predict_parts(result)
        if not self.best.is_better(poorer):
            self.best = poorer

    def _starts(self, model: Model) -> list[dict[str, float]]:
        """Initial parameters of a fit: generic loops (STARTS), or the fit of a poorer model."""
        (order, free), lag = model, self.lag
        if order == "delay":
            return [{DELAY: x} for x in (lag, max(lag - 4e-3, 0.0))]
        gain = max(1 / (lag + 1e-4), 0.5)
        loops: list[dict[str, float]] = [
            {KP: a + b * gain, KV: kv, KI: ki, FEED: f, DELAY: d * lag}
            for a, b, kv, ki, f, d in STARTS
        ]
        new = {FRICTION} if FRICTION in free else {ACCELERATION, LIMIT} & set(free)
        if KI in free or not new:
            return loops
        poorer = self.fits[Model(order, tuple(x for x in free if x not in new))]
        initial = poorer.servo._asdict()
        if LIMIT not in new:
            return [initial]
        # If a joint often saturates, the fit without a limit is a useless start. Therefore generic
        # loops are also tried.
        tops = [max(_largest_acceleration(s, x) for s in self.segments) for x in ACCELERATION_TIMES]
        loops = [{**x, DELAY: min(x[DELAY], USUAL_DELAY)} for x in loops[2:4]]
        return [{**x, LIMIT: a} for x in (initial, *loops) for a in (*tops, 3 * max(tops))]


def is_implausible(result: Fit) -> bool:
    """Return whether a fitted loop has parameters at their bounds, or too little damping."""
    low, high = result.at_bounds()
    servo = result.servo
    ringing = np.isfinite(servo.kv) and 0.5 * np.sqrt(servo.kv / servo.kp) < LEAST_DAMPING
    lead = {FEED} if ACCELERATION in result.problem.model.free else set()
    bounded = high & {KP, KV, KI, FEED, ACCELERATION, LIMIT} or low & ({KP, KV, KI, LIMIT} | lead)
    return bool(ringing or bounded)


def _thin_segments(segments: Sequence[LogSegment]) -> Sequence[LogSegment]:
    """Segments with samples at COARSE_SPACING; unchanged if this would change the command."""
    interval = float(np.median(np.diff(segments[0].command.t)))
    every = int(COARSE_SPACING / interval * (1 + 1e-6))
    if every < 2 or not segments[0].command.linear:
        return segments
    thinned = [x.cut(0, len(x.y), every) for x in segments]
    for one, full in zip(thinned, segments, strict=True):
        difference = one.command.evaluate(full.command.t) - full.command.u
        rough = np.sqrt(np.mean(np.diff(full.y, n=3) ** 2) / 20)
        if np.sqrt(np.mean(difference**2)) > THINNING_ERROR * rough or len(one.y) < FEWEST:
            return segments
    return thinned


def _moving_parts(segments: Sequence[LogSegment]) -> IntArray:
    """Indices of the parts in which the command of some used samples moves."""
    every = [s.part[s.use & (s.weight > 0)] for s in segments]
    return np.unique(np.concatenate(every))


def _largest_acceleration(s: LogSegment, time: float) -> float:
    """Largest acceleration from positions `time` apart [rad/s²], see ACCELERATION_PERCENTILE."""
    t = s.command.t
    interval = float(np.median(np.diff(t)))
    k = min(max(int(round(time / interval)), 1), (len(t) - 1) // 2)
    second = s.y[2 * k :] - 2 * s.y[k:-k] + s.y[: -2 * k]
    return float(np.percentile(np.abs(second), ACCELERATION_PERCENTILE)) / (k * interval) ** 2


def limited_servo(servo: JointServo, limit: Estimate | None) -> JointServo:
    """The servo with the acceleration limit; unchanged if the limit is None."""
    return servo if limit is None else servo._replace(acceleration_limit=limit.value)


def predict_parts(
    result: Fit, judged: Sequence[LogSegment] | None = None, limit: Estimate | None = None
) -> Selected:
    """Predict each moving part by a fit of the other parts (cross-validation).

    `judged` are the segments that are predicted, by default those of the fit.
    """
    p, segments = result.problem, judged or result.problem.segments

    def predict_by(servo: JointServo, s: LogSegment) -> FloatArray:
        return predict(s, limited_servo(servo, limit), p.model.order, p.search.drive_cycle)

    # Parts without motion are predicted by the fit of all parts.
    unseen = [predict_by(result.servo, s) for s in segments]
    errors, motions, without = [], [], []
    for k in _moving_parts(segments):
        others = [replace(s, use=s.use & (s.part != k)) for s in p.segments]
        indices = [i for i, s in enumerate(others) if s.use.any()]
        other = Problem(p.model, [others[i] for i in indices], p.search)
        servo = fit(other, [p.select(result.x, indices)], REFIT_EVALUATIONS).servo
        without.append(servo)
        squares = motion = 0.0
        for i, s in enumerate(segments):
            mask = s.part == k
            if mask.any():
                q = predict_by(servo, s)
                unseen[i][mask] = q[mask]
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
