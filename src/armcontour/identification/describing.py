"""From the fits of a joint to its estimates, with what the log cannot tell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armcontour.identification.advice import better_motion, larger_step
from armcontour.identification.choosing import FOLLOWS, Choice, largest_demand
from armcontour.identification.fitting import Data, Fit, noise_of, whiteness
from armcontour.identification.intervals import Ends
from armcontour.identification.log import Log
from armcontour.identification.profile import lowest_limit
from armcontour.identification.results import Estimate, JointIdentification

# A standard deviation of more than this part of a value leaves it undetermined.
DETERMINED = 0.10
# Of a dead time also this [s] is enough: two standard deviations are a millisecond.
DETERMINED_DELAY = 0.5e-3
# Less motion than this, in standard deviations of the noise, is none.
STILL = 1.5
# Nor is this [rad]: an encoder of 32 bits has steps of 1.5e-9 rad.
LEAST_MOTION = 1e-9


def why_still(data: Data) -> str:
    """Why nothing can be said of a joint that does not move; empty if it does."""
    noise = noise_of(data.y)
    if np.std(data.y) > STILL * noise and np.ptp(data.y) > LEAST_MOTION:
        return ""
    told = float(np.ptp(data.u))
    if told <= max(6 * noise, LEAST_MOTION):
        return f"The joint is not told to move: its commands stay within {told:.2g} rad."
    return (
        f"The joint does not move, though its commands go over {told:.3g} rad: is its brake "
        "on, or is it another joint's column?"
    )


def nothing(data: Data, log: Log, name: str, why: str) -> JointIdentification:
    """What is said of a joint that does not move."""

    def unknown(what: str, unit: str) -> Estimate:
        return Estimate(
            name=what,
            unit=unit,
            value=math.nan,
            sd=math.nan,
            low=-math.inf if what == "dead_time" else 0.0,
            high=math.inf,
            determined=False,
            advice=f"{why} A multisine around the bandwidth of its position loop would tell it.",
        )

    residuals = data.y - data.y.mean()
    rms = float(np.sqrt(np.mean(residuals**2)))
    return JointIdentification(
        name=name,
        order="second",
        kp=unknown("kp", "1/s"),
        kv=unknown("kv", "1/s"),
        dead_time=unknown("dead_time", "s"),
        acceleration=unknown("acceleration", "rad/s²"),
        start="rest",
        t=log.t,
        simulated=np.full_like(data.y, data.y.mean()),
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
    state = found.state
    probability = whiteness(found.residuals)
    ends = Ends(data, found)
    used = slice(state.first, data.last)
    measured = data.y[used]
    fits = {"second": choice.second, "first": choice.first}
    demand = largest_demand(data, state) if state.order == "second" else math.nan
    joint = JointIdentification(
        name=name,
        order=state.order,
        kp=_gain(data, found, "kp", ends),
        kv=_gain(data, found, "kv", ends) if state.order == "second" else _no_loop(data, choice),
        dead_time=_delay(data, found, ends),
        acceleration=_limit(data, found, ends, demand),
        start=state.start,
        t=log.t[used],
        simulated=measured - found.residuals,
        residuals=found.residuals,
        noise=math.sqrt(found.variance),
        rms=math.sqrt(found.sse / found.count),
        r_squared=found.r_squared,
        whiteness=probability,
        bic={k: v.bic for k, v in fits.items() if v is not None},
        rms_of={k: math.sqrt(v.sse / v.count) for k, v in fits.items() if v is not None},
        largest_demand=demand,
        saturated_time=found.saturated_time,
    )
    if found.r_squared < FOLLOWS:
        joint = _distrusted(joint)
    return replace(joint, notes=_notes(data, joint, choice))


def _distrusted(joint: JointIdentification) -> JointIdentification:
    """The same with nothing determined: the model does not describe the joint."""
    advice = "The model does not explain the motion, so its parameters say nothing."
    return replace(
        joint,
        kp=replace(joint.kp, determined=False, advice=advice),
        kv=replace(joint.kv, determined=False, advice=advice),
        dead_time=replace(
            joint.dead_time, determined=False, advice=joint.dead_time.advice or advice
        ),
        acceleration=replace(joint.acceleration, determined=False, advice=advice),
    )


def _gain(data: Data, found: Fit, name: str, ends: Ends) -> Estimate:
    value, relative = float(getattr(found.state, name)), ends.relative(name)
    determined = relative <= DETERMINED and name not in found.at_edge
    low, high = ends.interval(name)
    advice = ""
    if not determined:
        symbol = {"kp": "K_p", "kv": "K_v"}[name]
        why = (
            f"This log fits any {symbol} from {low:.3g} 1/s on."
            if high == math.inf
            else f"This log tells {symbol} to {relative * 100:.2g} % only, and 10 % are needed."
        )
        noise = math.sqrt(found.variance)
        advice = f"{why} {better_motion(data, found.state, name, noise, DETERMINED)}"
    return Estimate(
        name=name,
        unit="1/s",
        value=value,
        sd=value * relative,
        low=low,
        high=high,
        determined=determined,
        advice=advice,
    )


def _no_loop(data: Data, choice: Choice) -> Estimate:
    """K_v of a first-order lag, which has none."""
    reason = "The model is a lag, which has no K_v."
    if choice.second is not None:
        lag, loop = choice.chosen, choice.second
        noise = math.sqrt(loop.variance)
        reason = (
            "The velocity loop is too fast to matter: a first-order lag fits this log as well (BIC "
            f"{lag.bic:.1f} against {loop.bic:.1f}). "
            f"{better_motion(data, loop.state, 'kv', noise, DETERMINED)}"
        )
    return Estimate(
        name="kv",
        unit="1/s",
        value=math.nan,
        sd=math.nan,
        low=0.0,
        high=math.inf,
        determined=False,
        advice=reason,
    )


def _delay(data: Data, found: Fit, ends: Ends) -> Estimate:
    value, sd = found.state.delay, ends.sd("delay")
    allowed = max(DETERMINED * abs(value), DETERMINED_DELAY)
    determined = sd <= allowed and "delay" not in found.at_edge
    advice = ""
    if not determined:
        why = (
            f"The best dead time is at the edge of those looked for, {value * 1e3:.3g} ms: look "
            "for longer ones if it may be longer."
            if "delay" in found.at_edge
            else f"This log tells the dead time to {sd * 1e3:.2g} ms only, and "
            f"{allowed * 1e3:.2g} ms are needed."
        )
        noise = math.sqrt(found.variance)
        advice = f"{why} {better_motion(data, found.state, 'delay', noise, allowed)}"
    low, high = ends.interval("delay")
    return Estimate(
        name="dead_time",
        unit="s",
        value=value,
        sd=sd,
        low=low,
        high=high,
        determined=determined,
        advice=advice,
    )


def _limit(data: Data, found: Fit, ends: Ends, demand: float) -> Estimate:
    state = found.state
    value, sd, low, high = math.nan, math.nan, 0.0, math.inf
    determined = False
    if state.order == "first":
        advice = "The model is a lag, which has no acceleration limit."
    elif "limit" in state.free:
        relative = ends.relative("limit")
        value, sd = state.limit, state.limit * relative
        low, high = ends.interval("limit")
        determined = relative <= DETERMINED and "limit" not in found.at_edge
        step = larger_step(data, state, 2 * value)
        advice = "" if determined else (
            f"The joint is at its limit for {found.saturated_time * 1e3:.3g} ms only, which "
            f"tells it to {relative * 100:.2g} %, and 10 % are needed. A step of more than "
            f"{step:.2g} rad in one command interval asks for twice the limit."
        )  # fmt: skip
    else:
        low = lowest_limit(data, found, demand)
        step = larger_step(data, state, 2 * low)
        advice = (
            f"The log does not show the limit: it is above {low:.4g} rad/s². A step of more than "
            f"{step:.2g} rad in one command interval asks for twice that."
        )
    return Estimate(
        name="acceleration",
        unit="rad/s²",
        value=value,
        sd=sd,
        low=low,
        high=high,
        determined=determined,
        advice=advice,
    )


def _notes(data: Data, joint: JointIdentification, choice: Choice) -> tuple[str, ...]:
    notes = []
    if not joint.white and joint.noise > 1e-12:
        notes.append(
            "The residuals are not white: the joint does something that the model does not. The "
            "standard deviations allow for their correlation, not for what is missing."
        )
    if joint.r_squared < FOLLOWS:
        notes.append(
            f"The model explains {max(joint.r_squared, 0.0) * 100:.0f} % of the motion only: "
            "do the columns belong together?"
        )
    offset = choice.chosen.state.offset
    if offset is not None:
        notes.append(
            f"The measured position stands off the commands by {offset:.4g} rad, as under a load "
            "or of an encoder with another zero; that is estimated too."
        )
    dead = joint.dead_time
    if dead.high < 0:
        notes.append(
            f"The dead time is below zero, {dead.value * 1e3:.3g} ms: are commands logged late, or "
            "are set-points held that were taken for interpolated?"
        )
    elif dead.determined and dead.low <= 0:
        notes.append("No dead time is seen.")
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
