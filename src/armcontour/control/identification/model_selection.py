"""Selection of a joint's servo model by cross-validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

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
from armcontour.control.identification.initial_parameters import initial_parameters
from armcontour.control.identification.joint_fit import Fit, Problem, finish, fit
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
# A richer model is discarded if its error on the fitted data exceeds this fraction of the best
# model's error.
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
# Largest number of evaluations in the fit of a model, and of a cascade.
EVALUATIONS = 60
CASCADE_EVALUATIONS = 30


def select_model(
    segments: Sequence[LogSegment], search: Search, *, limited: bool = True
) -> Selected | None:
    """Select the model of a joint.

    The candidates are fitted from simple to rich. A richer model is selected if it is significantly
    better on parts to which it was not fitted. Then parameters that do not improve it are removed.

    - `limited`: whether models with an acceleration limit are allowed.

    Returns:
        The selected model; None if less than two parts move or all fits are implausible.
    """
    thinned = thin_segments(segments)
    # Cross-validation requires at least two parts.
    if len(moving_parts(thinned)) < 2:
        return None
    trials = _Trials(thinned, search)
    trials.add_candidates(limited=limited)
    if trials.best is None:
        return None
    trials.refine()
    best = trials.best
    selected = replace(best, twin=trials.find_twin(), rivals=trials.find_rivals())
    if thinned is segments:
        return selected
    # The model is refitted to all samples.
    problem = Problem(best.fit.problem.model, segments, search)
    return replace(selected, fit=fit(problem, [best.fit.x], REFIT_EVALUATIONS))


def find_continuous(result: Fit) -> JointServo | None:
    """Find the servo that fits the logs if the drive differentiates the command continuously.

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
        with_cycle = Problem(problem.model, problem.segments, search)
        fits.append(fit(with_cycle, [result.x]))
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

    def add_candidates(self, *, limited: bool) -> None:
        """Fit the candidate models until the best one explains all but the noise.

        - `limited`: whether models with an acceleration limit are allowed.
        """
        for model in CANDIDATES:
            if not self._is_allowed(model, limited=limited):
                continue
            self.add(model)
            if self.best is not None and self.best.explains_all:
                return

    def add(self, model: Model) -> None:
        """Fit a model; it becomes the best model if it is significantly better."""
        best = self.best
        result = self._fit(model)
        hopeless = best is not None and result.cost > RICHER_SHARE**2 * best.fit.cost
        if KI in model.free and not hopeless:
            result = min(result, self._fit_exchanged(result), key=lambda x: x.cost)
        self.fits[model] = result
        if hopeless or is_implausible(result):
            return
        self.tried.append(predict_parts(result))
        if best is None or self.tried[-1].is_better(best):
            self.best = self.tried[-1]

    def refine(self) -> None:
        """Remove parameters that do not improve the best model, or add friction that does."""
        assert self.best is not None
        order, free = self.best.fit.problem.model
        if KI in free:
            self._prune()
        elif order != "delay" and not self.best.explains_all:
            self.add(Model(order, (*free, FRICTION)))
        self._drop_open_dead_time()
        self._finish()

    def find_rivals(self) -> list[JointServo]:
        """Return servos of the other models with nearly the same error as the best model."""
        best = self.best
        assert best is not None
        others = [x for x in self.tried if x is not best]
        return [x.fit.servo for x in others if x.rms * GAIN < best.rms]

    def find_twin(self) -> JointServo | None:
        """Find a servo with exchanged K_p and k_i that fits nearly as well as the best one.

        The poles of both servos are the same. Feed-forward of about 1 also makes their zeros equal.

        Returns:
            The servo; None if there is none.
        """
        assert self.best is not None
        best = self.best.fit
        if KI not in best.problem.model.free:
            return None
        twin = self._fit_exchanged(best)
        factor = twin.servo.kp / best.servo.kp
        differs = max(factor, 1 / factor) > TWIN_FACTOR
        if is_implausible(twin) or twin.cost * GAIN**2 > best.cost or not differs:
            return None
        return twin.servo

    def _is_allowed(self, model: Model, *, limited: bool) -> bool:
        """Return whether a candidate model can be fitted to the segments."""
        if model.order not in self.search.orders:
            return False
        if LIMIT in model.free and not limited:
            return False
        if ACCELERATION in model.free and not self.segments[0].command.linear:
            return False
        return KI not in model.free or self._may_be_cascade(model)

    def _fit(self, model: Model) -> Fit:
        """Fit a model from several starts."""
        problem = Problem(model, self.segments, self.search)
        values = initial_parameters(model, self.lag, self.fits, self.segments)
        starts = [problem.guess(x, self.lag) for x in values]
        return fit(problem, starts, CASCADE_EVALUATIONS if KI in model.free else EVALUATIONS)

    def _fit_exchanged(self, result: Fit) -> Fit:
        """Fit a cascade from the start with exchanged K_p and k_i, which has the same poles."""
        servo = result.servo
        exchanged = servo._replace(kp=servo.ki, ki=servo.kp)._asdict()
        problem = Problem(result.problem.model, self.segments, self.search)
        start = problem.guess(exchanged, servo.dead_time)
        return fit(problem, [start], CASCADE_EVALUATIONS)

    def _may_be_cascade(self, model: Model) -> bool:
        """Return whether the best model explains enough of the tracking error to try a cascade."""
        if self.best is None:
            return False
        lag = np.concatenate([(s.y - s.command.u)[s.use] for s in self.best.segments])
        supported = {KI, ACCELERATION} & set(self.best.fit.problem.model.free)
        explains = self.best.rms < CASCADE_SHARE * np.std(lag)
        return bool(explains and (ACCELERATION not in model.free or supported))

    def _prune(self) -> None:
        """Remove OPTIONAL parameters without which the best model is not significantly worse."""
        for name in OPTIONAL:
            assert self.best is not None
            free = self.best.fit.problem.model.free
            # Acceleration feed-forward requires velocity feed-forward.
            if name in free and not (name == FEED and ACCELERATION in free):
                self._drop(name)

    def _drop_open_dead_time(self) -> None:
        """Remove an undetermined dead time if the best model is not significantly worse."""
        assert self.best is not None
        loop = self.best.fit.problem.model.order != "delay"
        if loop and not estimate_parameters(self.best.fit, self.best.without)[DELAY].determined:
            self._drop(DELAY)

    def _finish(self) -> None:
        """Search on from the fit of the best model, and predict its parts again if it improves."""
        assert self.best is not None
        best = self.best
        finished = finish(best.fit)
        if finished is not best.fit:
            self.best = predict_parts(finished)
            # The unfinished fit is no rival of the finished one.
            self.tried = [x for x in self.tried if x is not best]

    def _drop(self, name: str) -> None:
        """Remove a parameter unless the best model is significantly worse without it."""
        assert self.best is not None
        best = self.best.fit
        order, free = best.problem.model
        model = Model(order, tuple(x for x in free if x != name))
        problem = Problem(model, self.segments, self.search)
        start = best.servo._replace(**{name: 0.0})
        result = fit(problem, [problem.guess(start._asdict(), best.servo.dead_time)])
        if is_implausible(result) or result.cost > POORER_RATIO * best.cost:
            return
        simpler = predict_parts(result)
        if not self.best.is_better(simpler):
            self.best = simpler


def is_implausible(result: Fit) -> bool:
    """Return whether a fitted loop has parameters at their bounds, or too little damping.

    The damping ratio of `s² + kv s + kv kp` is `sqrt(kv / kp) / 2`.
    """
    servo = result.servo
    if np.isfinite(servo.kv) and 0.5 * np.sqrt(servo.kv / servo.kp) < LEAST_DAMPING:
        return True
    low, high = result.at_bounds()
    # Acceleration feed-forward requires velocity feed-forward.
    required = {FEED} if ACCELERATION in result.problem.model.free else set()
    at_low = low & ({KP, KV, KI, LIMIT} | required)
    at_high = high & {KP, KV, KI, FEED, ACCELERATION, LIMIT}
    return bool(at_low or at_high)
