"""From the fits of a joint to its estimates, with what the log cannot tell."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._describing import digits
from armcontour.identification.choosing import FOLLOWS, Choice, largest_demand, unseen_errors
from armcontour.identification.correlation import whiteness
from armcontour.identification.fitting import Data, Fit, noise_of, simulated
from armcontour.identification.friction import Friction, find_friction
from armcontour.identification.intervals import Ends
from armcontour.identification.profile import lowest_limit
from armcontour.identification.results import Estimate, JointIdentification
from armcontour.motion.log import Log

# A standard deviation of more than this part of a value leaves it undetermined.
DETERMINED = 0.10
# Of a dead time also this [s] is enough: two standard deviations are a millisecond.
DETERMINED_DELAY = 0.5e-3
# One of more than this many times the value tells nothing at all.
TELLS_NOTHING = 10.0
# Less motion than this, in standard deviations of the noise, is none.
STILL = 1.5
# Nor is this [rad]: an encoder of 32 bits has steps of 1.5e-9 rad.
LEAST_MOTION = 1e-9
# Nor is this [rad] a change of velocity: logs have nine digits at most.
LEAST_BEND = 1e-8
# Motions that would tell more.
MOTION = (
    "A multisine of 20 s from 0.5 Hz to a few times K_p / 2π Hz, sampled five times faster than "
    "that, would tell it."
)
STEP = "A large step, within one command interval, would show it."
# What is said of gains of a drive that only delays.
ONLY_DELAYS = "The drive is too fast for this log: of it only the dead time is seen."
UNITS = {
    "kp": "1/s",
    "kv": "1/s",
    "dead_time": "s",
    "acceleration": "rad/s²",
    "velocity_feedforward": "1",
}


def why_still(data: Data) -> str:
    """Why nothing can be said of a joint that does not move; empty if it does."""
    noise = data.noise
    if np.std(data.y) > STILL * noise and np.ptp(data.y) > LEAST_MOTION:
        return ""
    told = float(np.ptp(data.u))
    if told <= max(6 * noise, LEAST_MOTION):
        return f"The joint is not told to move: its commands stay within {digits(told, 2)} rad."
    return (
        f"The joint does not move, though its commands go over {told:.3g} rad: is its brake "
        "on, or is it another joint's column?"
    )


def why_steady(data: Data) -> str:
    """Why nothing can be said of a joint at a uniform velocity; empty if its velocity changes."""
    if any(bends(data.t, x) for x in (data.u, data.y)):
        return ""
    velocity = float(np.polyfit(data.t, data.y, 1)[0])
    late = float(np.mean(data.u - data.y)) / velocity
    return (
        f"The joint moves at a uniform velocity of {velocity:.3g} rad/s in the whole log, which "
        f"tells only that it is {late * 1e3:.3g} ms late: how much of that its gains and its dead "
        "time make, and its acceleration limit, show where the velocity changes."
    )


def bends(t: FloatArray, x: FloatArray) -> bool:
    """Whether positions [rad] over times [s] are more than a straight line and noise, (n,) each."""
    off = x - _line(t, x)
    return bool(np.std(off) > STILL * noise_of(x) and np.ptp(off) > LEAST_BEND)


def _line(t: FloatArray, x: FloatArray) -> FloatArray:
    """The straight line through positions over time."""
    return np.asarray(np.polyval(np.polyfit(t, x, 1), t))


def nothing(data: Data, log: Log, name: str, why: str) -> JointIdentification:
    """What is said of a joint that does not move, or at a uniform velocity."""
    advice = f"{why} A multisine around the bandwidth of its position loop would tell it."
    straight = _line(data.t, data.y)
    residuals = data.y - straight
    rms = float(np.sqrt(np.mean(residuals**2)))
    return JointIdentification(
        name=name,
        order="second",
        kp=_unknown("kp", advice),
        kv=_unknown("kv", advice),
        dead_time=_unknown("dead_time", advice),
        acceleration=_unknown("acceleration", advice),
        start="rest",
        t=data.t + log.t[0],
        simulated=straight,
        residuals=residuals,
        noise=rms,
        rms=rms,
        r_squared=math.nan,
        whiteness=math.nan,
        bic={},
        rms_of={},
        largest_demand=0.0,
        saturated_time=0.0,
        notes=(why,),
    )


def described(data: Data, log: Log, name: str, choice: Choice) -> JointIdentification:
    """The estimates of a joint, and how good the fit is."""
    found = choice.chosen
    state, data = found.state, replace(data, delays=found.delays)
    probability = whiteness(found.residuals)
    ends = Ends(data, found)
    used = slice(state.first, data.last)
    errors = np.concatenate(unseen_errors(data, found))
    rows = np.arange(len(data.t)) if data.rows is None else data.rows
    own = rows[used] >= 0
    rows = rows[used][own]
    residuals = found.residuals[own]
    fits = {"second": choice.second, "first": choice.first}
    demand = largest_demand(data, state) if state.order == "second" else math.nan
    joint = JointIdentification(
        name=name,
        order=state.order,
        kp=_gain(found, "kp", ends),
        velocity_feedforward=None if state.feed is None else _feed(found, ends),
        kv=_gain(found, "kv", ends) if state.order == "second" else _no_loop(choice),
        dead_time=_delay(found, ends),
        acceleration=_limit(data, found, ends, demand),
        start=state.start,
        t=log.t[rows],
        simulated=simulated(data, state)[0][0][own] + (state.offset or 0.0),
        residuals=residuals,
        noise=math.sqrt(found.variance),
        rms=math.sqrt(found.sse / found.count),
        r_squared=found.r_squared,
        whiteness=probability,
        bic={k: v.bic for k, v in fits.items() if v is not None},
        rms_of={k: math.sqrt(v.sse / v.count) for k, v in fits.items() if v is not None},
        largest_demand=demand,
        saturated_time=found.saturated_time,
        states=choice.states,
        tracking_rms=float(np.std(counting(data, data.u - data.y, found))),
        predicted_rms=float(np.std(errors)),
        predicted_max=float(np.abs(errors - errors.mean()).max()),
    )
    friction = find_friction(data, found) if state.order == "second" else None
    if found.r_squared < FOLLOWS:
        joint = _distrusted(joint, found)
    elif found.at_edge:
        edge = " and ".join(x.replace("feed", "velocity feed-forward") for x in found.at_edge)
        joint = _not_sure(joint, f"The best {edge} is at the edge of the search")
    elif joint.dead_time.high < 0 and joint.dead_time.value < -DETERMINED_DELAY:
        joint = _not_sure(joint, "The best dead time is below zero")
    else:
        if friction is not None:
            joint = _allow_for(joint, friction)
    notes = (*_notes(data, log, joint, choice), *joint.notes)
    return replace(joint, notes=notes if friction is None else (*notes, _describe(friction)))


def _list_shifts(shifts: dict[str, float]) -> str:
    """What puts off which parameter by how much."""
    symbols = {"kp": "K_p", "kv": "K_v"}
    off = [
        f"{symbols[k]} by {digits(abs(x) * 100, 2)} %" for k, x in shifts.items() if k in symbols
    ]
    if "delay" in shifts:
        off.append(f"the dead time by {digits(abs(shifts['delay']) * 1e3, 2)} ms")
    return ", ".join(off)


def _allow_for(joint: JointIdentification, friction: Friction) -> JointIdentification:
    """Widen estimates by what friction puts them off; too much of it leaves none determined."""
    changed: dict[str, Any] = {}
    for x in (joint.kp, joint.kv, joint.dead_time):
        shift = abs(friction.shifts.get("delay" if x.name == "dead_time" else x.name, 0.0))
        # The longer side of a logarithm, for gains.
        off = shift if x.name == "dead_time" else x.value * math.expm1(shift)
        changed[x.name] = replace(x, sd=math.hypot(x.sd, off), low=x.low - off, high=x.high + off)
    if friction.spoils_any:
        advice = (
            f"{_describe(friction)} Drive the joint harder, so that friction is a smaller part of "
            "its acceleration, or have the controller compensate for friction."
        )
        changed = {k: replace(x, determined=False, advice=advice) for k, x in changed.items()}
    return replace(joint, **changed)


def _describe(friction: Friction) -> str:
    """What friction there is, and what leaving it out does."""
    return (
        "The residuals follow the direction of motion, as under dry friction or stiction of "
        f"{digits(friction.size, 2)} rad/s² (standard deviation {digits(friction.sd, 2)}), which "
        f"the model does not have. It puts off {_list_shifts(friction.shifts)}."
    )


def _distrusted(joint: JointIdentification, found: Fit) -> JointIdentification:
    """The same without any values: the model does not describe the joint."""
    advice = "The model does not explain the motion, so its parameters say nothing."
    changed: dict[str, Any] = {x.name: _unknown(x.name, advice) for x in joint.estimates}
    if "delay" in found.at_edge:
        late = f"{advice} {_at_edge(found.state.delay)}"
        changed["dead_time"] = _unknown("dead_time", late)
    return replace(joint, **changed)


def _not_sure(joint: JointIdentification, why: str) -> JointIdentification:
    """The same with nothing determined, as one parameter skews the others."""
    advice = f"{why}, which skews all other parameters."
    changed: dict[str, Any] = {
        x.name: replace(x, determined=False, advice=advice) for x in joint.estimates if x.determined
    }
    return replace(joint, **changed)


def counting(data: Data, values: FloatArray, found: Fit) -> FloatArray:
    """The values, of all samples, that the fit of a joint uses."""
    some = slice(found.state.first, data.last)
    return values[some] if data.used is None else values[some][data.used[some]]


def _at_edge(delay: float) -> str:
    """What is said of a dead time at the edge of the search."""
    return (
        f"The best dead time is at the edge of those looked for, {delay * 1e3:.3g} ms: look for "
        "longer ones if it may be longer."
    )


def _unknown(name: str, advice: str, low: float = 0.0) -> Estimate:
    """A parameter of which at most a lower end is known; of a dead time not even that."""
    low = -math.inf if name == "dead_time" else low
    return _estimate(name, math.nan, math.nan, (low, math.inf), advice)


def _estimate(
    name: str, value: float, sd: float, ends: tuple[float, float], advice: str
) -> Estimate:
    """A parameter; one that is determined needs no advice."""
    low, high = ends
    return Estimate(
        name=name,
        unit=UNITS[name],
        value=value,
        sd=sd,
        low=low,
        high=high,
        determined=not advice,
        advice=advice,
    )


def _gain(found: Fit, name: str, ends: Ends) -> Estimate:
    if name in found.state.fixed:
        return _unknown(name, ONLY_DELAYS)
    value, relative = float(getattr(found.state, name)), ends.relative(name)
    interval = ends.interval(name)
    advice = ""
    if not relative <= DETERMINED or name in found.at_edge:  # it may be nan
        symbol = {"kp": "K_p", "kv": "K_v"}[name]
        why = (
            f"This log fits any {symbol} from {interval[0]:.3g} 1/s on."
            if interval[1] == math.inf
            else f"This log does not tell {symbol}."
            if not relative <= TELLS_NOTHING
            else f"This log tells {symbol} to {digits(relative * 100, 2)} % only, and 10 % are "
            "needed."
        )
        advice = f"{why} {MOTION}"
        if interval[1] < math.inf and not relative <= TELLS_NOTHING:
            return _unknown(name, advice)
    return _estimate(name, value, value * relative, interval, advice)


def _no_loop(choice: Choice) -> Estimate:
    """K_v of a first-order lag, which has none."""
    reason = "The model is a lag, which has no K_v."
    if choice.second is not None:
        why = (
            "The velocity loop is too fast to matter: a first-order lag fits this log as well (BIC "
            f"{choice.chosen.bic:.1f} against {choice.second.bic:.1f})."
        )
        reason = f"{why} {MOTION}"
    return _unknown("kv", reason)


def _feed(found: Fit, ends: Ends) -> Estimate:
    """Velocity feed-forward."""
    value, name = found.state.feed or 0.0, "velocity_feedforward"
    if "feed" in found.state.fixed:
        return _unknown(name, ONLY_DELAYS)
    sd, advice = ends.sd("feed"), ""
    if not sd <= DETERMINED or "feed" in found.at_edge:
        advice = "This log does not tell the velocity feed-forward."
    return _estimate(name, value, sd, ends.interval("feed"), advice)


def _delay(found: Fit, ends: Ends) -> Estimate:
    value, sd = found.state.delay, ends.sd("delay")
    allowed = max(DETERMINED * abs(value), DETERMINED_DELAY)
    advice = ""
    if not sd <= allowed or "delay" in found.at_edge:
        why = (
            _at_edge(value)
            if "delay" in found.at_edge
            else "This log does not tell the dead time."
            if not sd <= TELLS_NOTHING * max(abs(value), DETERMINED_DELAY)
            else f"This log tells the dead time to {digits(sd * 1e3, 2)} ms only, and "
            f"{digits(allowed * 1e3, 2)} ms are needed."
        )
        advice = f"{why} {MOTION}"
        if not sd <= TELLS_NOTHING * max(abs(value), DETERMINED_DELAY):
            return _unknown("dead_time", advice)
    return _estimate("dead_time", value, sd, ends.interval("delay"), advice)


def _limit(data: Data, found: Fit, ends: Ends, demand: float) -> Estimate:
    state, name = found.state, "acceleration"
    if state.order == "first":
        return _unknown(name, "The model is a lag, which has no acceleration limit.")
    if found.at_edge and "limit" not in state.free:
        return _unknown(name, "The log does not show the limit.")
    if "limit" not in state.free:
        low = lowest_limit(data, found, demand)
        why = f"The log does not show the limit: it is above {low:.4g} rad/s²."
        return _unknown(name, f"{why} {STEP}", low)
    relative, advice = ends.relative("limit"), ""
    if not relative <= DETERMINED or "limit" in found.at_edge:
        advice = (
            f"The joint is at its limit for {found.saturated_time * 1e3:.3g} ms only, which "
            f"tells it to {digits(relative * 100, 2)} %, and 10 % are needed. {STEP}"
        )
    return _estimate(name, state.limit, state.limit * relative, ends.interval("limit"), advice)


def _notes(data: Data, log: Log, joint: JointIdentification, choice: Choice) -> tuple[str, ...]:
    notes = _on_the_fit(joint, choice.chosen.state.offset) + _on_the_dead_time(joint.dead_time)
    if choice.chosen.period:
        seconds = choice.chosen.period * log.interval
        notes.append(
            f"The residuals repeat with the commands, every {seconds:.3g} s, as the error of a "
            "coarse encoder does: each repetition tells nothing new, and the standard deviations "
            "allow for it. A motion that does not repeat within the log tells more."
        )
    if (
        choice.first is not None
        and joint.order == "second"
        and joint.bic["first"] < joint.bic["second"]
    ):
        notes.append(
            "A first-order lag fits the log as well, but its gain and dead time would look better "
            "known than they are: choose the model first if a lag will do."
        )
    if joint.order == "first":
        notes.append("The dead time of a lag includes the lag of a velocity loop, 1/K_v.")
    if joint.start == "moving" and joint.t[0] > 0:
        notes.append(
            "What was commanded before the log matters at its begin: "
            f"{len(data.t) - len(joint.t)} samples there were left out."
        )
    if joint.saturated_time > 0:
        notes.append(f"The joint was at its acceleration limit for {joint.saturated_time:.3g} s.")
    return tuple(notes)


def _on_the_fit(joint: JointIdentification, offset: float | None) -> list[str]:
    notes = []
    if not joint.white and joint.noise > 1e-12:
        notes.append(
            "The residuals are not white: the encoder is coarse, or the joint does something that "
            "the model does not. The standard deviations allow for their correlation, not for what "
            "is missing."
        )
    if joint.r_squared < FOLLOWS:
        notes.append(
            f"The model explains {max(joint.r_squared, 0.0) * 100:.0f} % of the motion only: "
            "do the columns belong together?"
        )
    if offset is not None:
        notes.append(
            f"The measured position stands off the commands by {offset:.4g} rad, as under a load "
            "or of an encoder with another zero; that is estimated too."
        )
    return notes


def _on_the_dead_time(dead: Estimate) -> list[str]:
    if dead.high < 0:
        return [
            f"The dead time is below zero, {dead.value * 1e3:.3g} ms: are commands logged late, or "
            "are set-points held that were taken for interpolated?"
        ]
    return ["No dead time is seen."] if dead.determined and dead.low <= 0 else []
