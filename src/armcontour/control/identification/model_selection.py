"""Selection of a joint's servo model by cross-validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from armcontour.control.identification.candidate_models import (
    ACCELERATION,
    CANDIDATES,
    DELAY,
    FEED,
    FRICTION,
    KI,
    KP,
    KV,
    LIMIT,
    Model,
    Search,
)
from armcontour.control.identification.cross_validation import (
    GAIN,
    REFIT_EVALUATIONS,
    Selected,
    predict_parts,
)
from armcontour.control.identification.joint_fit import Fit, Problem, fit
from armcontour.control.identification.log_segments import (
    LogSegment,
    find_lag,
    moving_parts,
    thin_segments,
)
from armcontour.control.identification.parameter_estimates import estimate_parameters
from armcontour.robot.servo.simulation import JointServo

# Parameters that are removed from a P-PI cascade (model with k_i) if it is not significantly worse
# without them.
OPTIONAL = (ACCELERATION, FEED, FRICTION)
# A richer model is discarded if its error on the fitted data exceeds this fraction of the error of
# the best model.
RICHER_SHARE = 0.97
# A simpler model is discarded if its cost on the fitted data exceeds this multiple of the best.
POORER_RATIO = 2.0
# A cascade is fitted if the error of the best model so far is below this fraction of the tracking
# error.
CASCADE_SHARE = 0.5
# Two solutions with exchanged K_p and k_i are different if their K_p differs by more than this
# factor.
TWIN_FACTOR = 1.1
# Shortest drive cycle with which a model with acceleration feed-forward is also fitted [s].
SHORT_CYCLE = 0.5e-3
# Smallest damping ratio of a fitted loop; no drive is tuned with less damping.
LEAST_DAMPING = 0.2
# Upper bound of the initial dead time in the fit of a saturating joint [s].
USUAL_DELAY = 0.01
# Times over which accelerations are measured [s]: a short time for fast motion, and a long time for
# small motion in noise.
ACCELERATION_TIMES = (8e-3, 40e-3)
# This percentile of the magnitudes of the accelerations counts as the largest acceleration.
ACCELERATION_PERCENTILE = 99
# Initial values of loops: a, b, K_v [1/s], k_i [1/s], velocity feed-forward, and dead time divided
# by the lag. The initial K_p is a + b / lag. Feed-forward matters only in loops that saturate.
STARTS = (
    (10.0, 0.0, 20.0, 5.0, 1.0, 0.8), (1.0, 0.0, 100.0, 5.0, 1.0, 1.0),
    (40.0, 0.0, 150.0, 5.0, 0.6, 0.5), (30.0, 0.0, 100.0, 5.0, 0.0, 0.3),
    (150.0, 0.0, 60.0, 5.0, 0.6, 0.9), (0.0, 0.8, 60.0, 5.0, 0.0, 0.1),
    (0.0, 1.5, 150.0, 12.0, 0.0, 0.3), (0.0, 4.0, 100.0, 5.0, 0.0, 0.7),
)  # fmt: skip


def select_model(
    segments: Sequence[LogSegment], search: Search, *, limited: bool = True
) -> Selected | None:
    """Select the model of a joint; None if less than two parts move or all fits are implausible."""
    some = thin_segments(segments)
    # Cross-validation requires at least two parts.
    if len(moving_parts(some)) < 2:
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
    best = replace(trials.best, twin=trials.find_twin())
    rivals = [x.fit.servo for x in trials.tried if x.rms * GAIN < best.rms and x is not trials.best]
    if some is not segments:
        whole = Problem(best.fit.problem.model, segments, search)
        best = replace(best, fit=fit(whole, [best.fit.x], REFIT_EVALUATIONS))
    return replace(best, rivals=rivals, continuous=find_continuous(best.fit))


def find_continuous(result: Fit) -> JointServo | None:
    """Servo that fits the logs if the drive differentiates the command continuously.

    Models without a drive cycle compute the command's acceleration from differences over the
    interval between set-points, which delays it by half of this interval. Drives with a shorter
    cycle differentiate with less delay. Fits with the cycles h and 2 h differ from continuous loops
    by about h and 2 h times a constant, so the result is `2 x(h) - x(2 h)` with the parameters x
    (Richardson's extrapolation), with h = SHORT_CYCLE.

    Returns:
        The servo; None if the model has no acceleration feed-forward, the drive cycle is known, or
        the logs contradict continuous differentiation because the error is larger (see GAIN).
    """
    problem = result.problem
    if ACCELERATION not in problem.model.free or problem.search.drive_cycle:
        return None
    fits = []
    for cycle in (SHORT_CYCLE, 2 * SHORT_CYCLE):
        search = problem.search._replace(drive_cycle=cycle)
        held = Problem(problem.model, problem.segments, search)
        fits.append(fit(held, [result.x]))
    if fits[0].cost * GAIN**2 > result.cost:
        return None
    unknowns = np.clip(2 * fits[0].x - fits[1].x, problem.low, problem.high)
    return replace(result, x=unknowns).servo


class _Trials:
    """Models that were fitted to a joint, and the best of them."""

    def __init__(self, segments: Sequence[LogSegment], search: Search) -> None:
        self.segments = segments
        self.search = search
        self.lag = find_lag(segments, search.longest)
        self.fits: dict[Model, Fit] = {}
        self.tried: list[Selected] = []
        self.best: Selected | None = None

    def add(self, model: Model) -> None:
        """Fit a model; it becomes the best model if it is significantly better."""
        problem = Problem(model, self.segments, self.search)
        best = self.best
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

    def find_twin(self) -> JointServo | None:
        """Servo with exchanged K_p and k_i that fits nearly as well as the best; None if none.

        The poles of both servos are the same. Feed-forward of about 1 also makes their zeros equal.
        """
        assert self.best is not None
        best = self.best.fit
        model = best.problem.model
        if KI not in model.free:
            return None
        servo = best.servo._replace(kp=best.servo.ki, ki=best.servo.kp)
        problem = Problem(model, self.segments, self.search)
        result = fit(problem, [problem.guess(servo._asdict(), servo.dead_time)], 30)
        factor = result.servo.kp / best.servo.kp
        differs = max(factor, 1 / factor) > TWIN_FACTOR
        if is_implausible(result) or result.cost * GAIN**2 > best.cost or not differs:
            return None
        return result.servo

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
        simpler = predict_parts(result)
        if not self.best.is_better(simpler):
            self.best = simpler

    def _starts(self, model: Model) -> list[dict[str, float]]:
        """Initial parameters of a fit: generic loops (STARTS), or the fit of a simpler model."""
        order, free = model
        lag = self.lag
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
        simpler = self.fits[Model(order, tuple(x for x in free if x not in new))]
        initial = simpler.servo._asdict()
        if LIMIT not in new:
            return [initial]
        # If a joint often saturates, the fit without a limit is a useless start. Therefore generic
        # loops are also tried.
        tops = [max(_largest_acceleration(s, x) for s in self.segments) for x in ACCELERATION_TIMES]
        loops = [{**x, DELAY: min(x[DELAY], USUAL_DELAY)} for x in loops[2:4]]
        limits = (*tops, 3 * max(tops))
        return [{**x, LIMIT: limit} for x, limit in product((initial, *loops), limits)]


def is_implausible(result: Fit) -> bool:
    """Return whether a fitted loop has parameters at their bounds, or too little damping."""
    low, high = result.at_bounds()
    servo = result.servo
    ringing = np.isfinite(servo.kv) and 0.5 * np.sqrt(servo.kv / servo.kp) < LEAST_DAMPING
    lead = {FEED} if ACCELERATION in result.problem.model.free else set()
    bounded = high & {KP, KV, KI, FEED, ACCELERATION, LIMIT} or low & ({KP, KV, KI, LIMIT} | lead)
    return bool(ringing or bounded)


def _largest_acceleration(s: LogSegment, time: float) -> float:
    """Largest acceleration from positions `time` apart [rad/s²], see ACCELERATION_PERCENTILE."""
    t = s.command.t
    interval = float(np.median(np.diff(t)))
    k = min(max(int(round(time / interval)), 1), (len(t) - 1) // 2)
    second = s.y[2 * k :] - 2 * s.y[k:-k] + s.y[: -2 * k]
    return float(np.percentile(np.abs(second), ACCELERATION_PERCENTILE)) / (k * interval) ** 2
