"""Select the model of a joint: initial state, saturation, order."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armcontour._checks import FloatArray
from armcontour.identification._joint import UNREACHED
from armcontour.identification.covariance import covariance, inflation, is_white
from armcontour.identification.fitting import (
    GAINS,
    STARTS,
    Data,
    Fit,
    State,
    best,
    fit,
    simulated,
)
from armcontour.identification.starting import first_states, initial, known_from, liveliest

# Twice the logarithm of the likelihood that a parameter at the end of its 95 % interval loses.
LOSS = 3.84
# Twice the logarithm of the likelihood that a limit or an offset must gain: one log of ten thousand
# gains it by chance. A false saturation limit is worse than a missed one.
GAIN = 15.1
# The same, of what a wrong belief about the begin costs: never by chance.
START_COST = 25.0
# Parts of the begin whose means are looked at, and the sum of their squares that is not chance.
BLOCKS = 4
BLOCK_COST = 20.0
# Leaving out the begin must not make anything less known than by this factor.
WASTE = 1.1
# Limits that are tried, in parts of the largest demand without one.
TRIED = (0.97, 0.8, 0.6)
# Dead times that are tried beside the best one of held commands, in sample intervals.
HOPS = (-2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0)
# Residuals with more than this variance of the noise are not noise alone.
MISFIT = 1.5
# A velocity loop whose time constant is less than this part of the position loop's is fast.
FAST = 0.05
# A joint that follows its commands at all does so to this part of the variance.
FOLLOWS = 0.5
# One that does so to less than this part may be misread: slow loops that resonate turn any sign.
EXPLAINS = 0.99
# A fit of this part of the samples is not upset by the others.
LARGE_PART = 0.95
# Errors of predictions below this do not matter [rad].
ROUNDED = 1e-8
# Feed-forward that leaves at most this share of the squared errors explains them.
FED = 0.5
# Parts of a log, of which every second one is predicted from the others.
PARTS = 8
# Where gains are at the edge of the search, a drive that only delays is enough if it leaves this
# share of the variance of the tracking error.
SMALL = 1.6e-3
# A drive that only delays: as dq = kp (u - q) + du, whatever kp is [1/s].
DELAYS_ONLY = 50.0
# Samples that are left out at the begin of a joint in motion, more than the dead time [s].
MARGIN = 10e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice:
    """The fits of one joint.

    Args:
        chosen: The one its log speaks for.
        second: The velocity loop in a position loop, if it was asked for.
        first: The first-order lag, on the same samples, if it was asked for.
    """

    chosen: Fit
    second: Fit | None
    first: Fit | None

    @property
    def states(self) -> dict[str, State]:
        """The state of each order: that of the model that is chosen, else of the other one."""
        fits = {"second": self.second, "first": self.first, self.chosen.state.order: self.chosen}
        return {order: x.state for order, x in fits.items() if x is not None}


def choose(data: Data, model: str, doubt: Callable[[], None]) -> Choice:
    """The fits of one joint.

    Args:
        data: The joint.
        model: "auto", "second" or "first".
        doubt: Called where no model explains the motion well, before more is tried.
    """
    order = "first" if model == "first" else "second"
    moving = best(data, _different(first_states(data, order, "moving")))
    if not data.linear:
        moving = best(data, [moving.state, *_beside(data, moving.state)])
    # From where it stands, an offset costs one more fit.
    shifted = replace(data, offset=0.0)
    again = fit(shifted, replace(moving.state, offset=0.0))
    if max(moving.r_squared, again.r_squared) < EXPLAINS:
        doubt()
    if moving.r_squared < FOLLOWS:
        shifted = replace(data, offset=float(np.mean(data.y) - np.mean(data.u)))
        again = best(shifted, _different(first_states(shifted, order, "moving")))
    if loss(moving, again) <= GAIN:
        return _choose(data, model, moving)
    shifted = replace(shifted, offset=again.state.offset)
    choice = _choose(shifted, model, again)
    # What looked like an offset may have been the limit, which is estimated only now.
    without = fit(data, replace(choice.chosen.state, offset=None))
    real = loss(without, choice.chosen) > GAIN
    if real and not is_white(choice.chosen):
        # Correlated noise has a mean without meaning anything by it.
        k = choice.chosen.state.free.index("offset")
        variance = float(covariance(choice.chosen, white=False)[0][k, k])
        real = bool((choice.chosen.state.offset or 0.0) ** 2 > GAIN * variance)
    return choice if real else _choose(data, model, moving)


def _beside(data: Data, state: State) -> list[State]:
    """States with other dead times, and the same lag of velocity loop and dead time together.

    Between samples, what held commands shake comes at any time: the likelihood has a valley for
    every few parts of an interval.
    """
    found, whole = [], state.delay + 1 / state.kv
    for shift in HOPS:
        delay = min(max(state.delay + shift * data.interval, data.delays[0]), data.delays[1])
        kv = state.kv if state.order == "first" else 1 / max(whole - delay, 1 / GAINS[1])
        found.append(replace(state, delay=delay, kv=kv))
    return _different(found)


def _choose(data: Data, model: str, moving: Fit) -> Choice:
    """The same, from a fit that knows nothing of the begin."""
    if is_white(moving):
        return _without_feed(data, model, moving)
    # Feed-forward makes up for any lag, so that a command that is logged late would do as well.
    longest = max(float(data.t[moving.state.first] - data.t[0]), data.interval)
    prompt = replace(data, delays=(0.0, longest))
    order = "first" if model == "first" else "second"
    fed = best(prompt, _different(first_states(prompt, order, "moving", feed=1.0)))
    # What feed-forward explains needs no acceleration limit.
    choice = _without_feed(data, model, moving, limited=fed.sse > FED * moving.sse)
    if is_white(choice.chosen):
        return choice
    return replace(choice, chosen=_predicting(data, model, choice.chosen, fed.state))


def _predicting(data: Data, model: str, plain: Fit, fed: State) -> Fit:
    """The simplest model that predicts what it was not fitted to about as well as the best one.

    Beside the one without velocity feed-forward, that is one with it; and where gains are beyond
    what the log can tell, a drive that only delays.

    Args:
        data: The joint.
        model: "auto", "second" or "first".
        plain: The fit without feed-forward.
        fed: The parameters with feed-forward.
    """
    data = _as_used(data, plain)
    data = replace(data, delays=(0.0, max(data.delays[1], data.interval)))
    if plain.state.delay < 0 and plain.at_edge:
        plain = fit(data, replace(plain.state, delay=0.0))
    s = plain.state
    models = [plain]
    # A loop that swings is not how drives are tuned: it stands for a delay.
    if model == "auto" and (plain.at_edge or s.kv < s.kp):
        delayed = replace(s, order="first", kp=DELAYS_ONLY, kv=math.inf, limit=math.inf, dq0=0.0)
        models.insert(0, fit(data, replace(delayed, feed=1.0, fixed=("kp", "feed"))))
    fed = replace(fed, start=s.start, first=s.first, q0=s.q0, dq0=s.dq0)
    models.append(fit(data, fed))
    errors = [np.array([np.mean(x**2) for x in unseen_errors(data, x)]) for x in models]
    mean = [float(x.mean()) for x in errors]
    k = int(np.argmin(mean))
    enough = max(mean[k] + float(errors[k].std() / math.sqrt(len(errors[k]))), ROUNDED**2)
    if "feed" in models[0].state.fixed:
        lag = data.u[s.first : data.last] - data.y[s.first : data.last]
        enough = max(enough, SMALL * float(np.var(lag)))
    return next(x for x, m in zip(models, mean, strict=True) if m <= enough)


def unseen_errors(data: Data, found: Fit) -> list[FloatArray]:
    """Errors of predictions: of every second part of a log, fitted to the other parts [rad].

    Args:
        data: The joint.
        found: A fit to all of it, with which the fits begin.
    """
    first, last = found.state.first, data.last
    number = np.zeros(len(data.t), dtype=np.intp)
    number[first:last] = np.arange(last - first) * PARTS // max(last - first, 1)
    every = np.full(len(data.t), True) if data.used is None else data.used
    errors: dict[int, FloatArray] = {}
    for fold in (0, 1):
        seen = every & (number % 2 == fold)
        # Where the log begins need not be in what is seen.
        fixed = (*found.state.fixed, "q0", "dq0")
        s = fit(replace(data, used=seen), replace(found.state, fixed=fixed)).state
        off = data.y[first:last] - simulated(data, s)[0][0] - (s.offset or 0.0)
        for part in range(1 - fold, PARTS, 2):
            here = (every & (number == part))[first:last]
            if here.any():
                errors[part] = off[here]
    return [errors[k] for k in sorted(errors)]


def _without_feed(data: Data, model: str, moving: Fit, *, limited: bool = True) -> Choice:
    """The fits without velocity feed-forward, and with an acceleration limit if that may be."""
    if model == "first":
        lag = _best_start(data, "first", moving)
        return Choice(chosen=lag, second=None, first=lag)
    loop = _best_start(data, "second", moving, limited)
    if model == "second":
        return Choice(chosen=loop, second=loop, first=None)
    lag = _lag_beside(data, loop)
    if lag.sse < loop.sse:
        # A lag is a loop with an infinite K_v, so there is a better valley near that.
        near = replace(loop.state, kp=lag.state.kp, delay=lag.state.delay, kv=GAINS[1] / 2)
        loop = best(_as_used(data, loop), [loop.state, near, replace(near, kv=40 * near.kp)])
    plain = lag.bic < loop.bic and _is_fast(data, loop)
    return Choice(chosen=lag if plain else loop, second=loop, first=lag)


def largest_demand(data: Data, state: State) -> float:
    """Largest acceleration that the velocity loop asks for, reached or not [rad/s²]."""
    limit = state.limit if math.isfinite(state.limit) else UNREACHED
    return float(simulated(data, replace(state, limit=limit))[1][0])


def loss(found: Fit, other: Fit) -> float:
    """Twice the logarithm of the likelihood that a fit loses against another one.

    Samples count less where residuals are correlated.
    """
    lost = found.count * math.log(max(found.sse, 1e-300) / max(other.sse, 1e-300))
    return lost / inflation(other) if lost > 0 else lost


def _is_fast(data: Data, loop: Fit) -> bool:
    """Whether the velocity loop is surely so fast that it does not matter.

    A lag that only fits as well would give its gain and dead time with a precision that they do not
    have: what the log cannot tell of the velocity loop, it cannot tell of them.
    """
    slow = loop.state.kp / FAST
    if loop.state.kv <= slow:
        return False
    return loss(fit(data, replace(loop.state, kv=slow, fixed=("kv",))), loop) > LOSS


def _best_start(data: Data, order: str, moving: Fit, limited: bool = True) -> Fit:
    """The fit with nothing believed about the begin, unless that would waste what the log tells.

    What came before the log is not known, so what it still moves is left out. That is little of a
    long log; but where the joint is told to go at once, it is much.
    """
    if order == "second" and limited:
        moving = _with_limit(data, moving)
    short = _shorter(data, moving)
    for how in STARTS[:2]:
        found = _with_start(data, order, how, moving, limited)
        if _tells_more(found, short) and _agrees(found, moving):
            return found
    return short


def _tells_more(found: Fit, moving: Fit) -> bool:
    """Whether a belief about the begin makes a parameter known much better."""
    for name in ("kp", "kv", "delay", "limit"):
        if name in found.state.free:
            if name not in moving.state.free or name in moving.at_edge:
                return True
            if _error(moving, name) > WASTE * _error(found, name):
                return True
    return False


def _error(found: Fit, name: str) -> float:
    k = found.state.free.index(name)
    variance = float(covariance(found, white=True)[0][k, k])
    return math.sqrt(variance) if variance >= 0 else math.inf


def _with_start(data: Data, order: str, how: str, known: Fit, limited: bool) -> Fit:
    """The best fit with one belief about the begin, with a limit where the log speaks for it."""
    s, begin = known.state, initial(data, order, how)
    states = [replace(begin, kp=s.kp, kv=s.kv, delay=s.delay, limit=s.limit, offset=s.offset)]
    # Of a long log the begin is a small part, which changes nothing but the begin.
    settled = known.count > LARGE_PART * len(data.t) and is_white(known)
    if not settled and liveliest(data)[0] == 0:
        states += first_states(data, order, how)
    found = best(data, _different(states))
    if order == "first" or settled or not limited:
        return found
    if math.isfinite(found.state.limit):
        return _better(_unlimited(data, found), found)
    return _with_limit(data, found)


def _different(states: list[State]) -> list[State]:
    """States without those that the same valley holds."""
    kept: list[State] = []
    for x in states:
        same = [
            abs(math.log(x.kp / y.kp)) < 0.02
            and (x.kv == y.kv or abs(math.log(x.kv / y.kv)) < 0.05)
            and abs(x.delay - y.delay) < 1e-3
            and math.isfinite(x.limit) == math.isfinite(y.limit)
            for y in kept
        ]
        if not any(same):
            kept.append(x)
    return kept


def _unlimited(data: Data, found: Fit) -> Fit:
    return fit(data, replace(found.state, limit=math.inf))


def _with_limit(data: Data, found: Fit) -> Fit:
    """The fit, or the one with a limit if that gains enough."""
    peak = largest_demand(data, found.state)
    states = [replace(found.state, limit=x * peak) for x in TRIED]
    noise = data.noise**2
    if found.variance > MISFIT * noise and not is_white(found):
        # Gains that had to make up for a limit are no place to start from.
        begin = found.state
        states += [
            replace(begin, kp=x.kp, kv=x.kv, delay=x.delay, limit=x.limit, offset=x.offset)
            for x in first_states(data, begin.order, begin.start, limited=True)
        ]
    return _better(found, best(data, states))


def _better(free: Fit, limited: Fit) -> Fit:
    gain = limited.count * math.log(max(free.sse, 1e-300) / max(limited.sse, 1e-300))
    if limited.saturated_time <= 0 or gain <= GAIN:
        return free
    return limited if gain > GAIN * inflation(limited) else free


def _agrees(found: Fit, moving: Fit) -> bool:
    """Whether a belief about the begin costs nothing against knowing nothing of it."""
    early = moving.state.first
    common, begin = found.residuals[early:], found.residuals[:early]
    sse, power = float(common @ common), float(begin @ begin) / max(early, 1)
    if not is_white(moving):
        # A model that is not quite true errs as much at the begin as later.
        return bool(sse <= 1.1 * moving.sse and power <= 4 * sse / max(len(common), 1))
    cost = moving.count * math.log(max(sse, 1e-300) / max(moving.sse, 1e-300))
    # Noise averages out over a part of the begin; an error of the model does not.
    means = [float(np.sum(x)) / math.sqrt(max(len(x), 1)) for x in np.array_split(begin, BLOCKS)]
    return bool(
        cost <= START_COST
        and power <= moving.variance * (1 + 3 * math.sqrt(2 / max(early, 1)))
        and sum(x * x for x in means) <= BLOCK_COST * moving.variance
    )


def _shorter(data: Data, found: Fit) -> Fit:
    """The fit with only as much left out at the begin as the dead time asks for."""
    s = found.state
    wanted = s.delay + max(MARGIN, 5 * data.interval)
    first = known_from(data, wanted)
    if first >= s.first:
        return found
    narrow = replace(data, delays=(data.delays[0], float(data.t[first] - data.t[0])))
    begin = initial(narrow, s.order, "moving", first)
    new = fit(
        narrow, replace(begin, kp=s.kp, kv=s.kv, delay=s.delay, limit=s.limit, offset=s.offset)
    )
    return found if "delay" in new.at_edge else new


def _lag_beside(data: Data, loop: Fit) -> Fit:
    """The first-order lag on the same samples as the other model, so that the two compare."""
    s = loop.state
    states = [
        replace(x, first=s.first, q0=s.q0, dq0=0.0) for x in first_states(data, "first", s.start)
    ]
    # What the velocity loop adds to the lag looks like dead time.
    delay = min(max(s.delay + 1 / s.kv, data.delays[0]), data.delays[1])
    states.append(replace(s, order="first", kv=math.inf, limit=math.inf, dq0=0.0, delay=delay))
    data = _as_used(data, loop)
    states = [replace(x, delay=min(x.delay, data.delays[1])) for x in states]
    return best(data, _different(states))


def _as_used(data: Data, found: Fit) -> Data:
    """The log with the dead times that the begin of a fit allows."""
    if found.state.start != "moving":
        return data
    longest = float(data.t[found.state.first] - data.t[0])
    return replace(data, delays=(data.delays[0], longest))
