"""Estimates, prediction errors and findings of a joint from its fits."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._describing import digits
from armcontour.identification.choosing import FOLLOWS, Choice, largest_demand, unseen_errors
from armcontour.identification.covariance import is_white
from armcontour.identification.fitting import Data, Fit, noise_of, simulated
from armcontour.identification.friction import Friction, find_friction
from armcontour.identification.intervals import Interval, find_intervals
from armcontour.identification.results import Estimate, JointIdentification
from armcontour.motion.log import Log

# Largest standard deviation of a determined parameter: a share of its value; of velocity
# feed-forward, the value itself; of a dead time also this [s], so that two of them are 1 ms.
DETERMINED = 0.10
DETERMINED_DELAY = 0.5e-3
# Less motion than this, in standard deviations of the noise, is none.
STILL = 1.5
# Nor is this [rad]: an encoder of 32 bits has steps of 1.5e-9 rad.
LEAST_MOTION = 1e-9
# Nor is this [rad] a change of velocity: logs have nine digits at most.
LEAST_BEND = 1e-8
# Residuals below this [rad] are rounding.
ROUNDING = 1e-12
# Units of the parameters, and their names in `State`.
UNITS = {
    "kp": "1/s",
    "kv": "1/s",
    "dead_time": "s",
    "acceleration": "rad/s²",
    "velocity_feedforward": "1",
}
KEYS = {"dead_time": "delay", "acceleration": "limit", "velocity_feedforward": "feed"}


def why_still(data: Data) -> str:
    """Finding on a joint that does not move; empty if it moves."""
    noise = data.noise
    if np.std(data.y) > STILL * noise and np.ptp(data.y) > LEAST_MOTION:
        return ""
    commanded = float(np.ptp(data.u))
    if commanded <= max(6 * noise, LEAST_MOTION):
        return f"No motion is commanded: the commands stay within {digits(commanded, 2)} rad."
    return f"The joint does not move, though its commands change by {commanded:.3g} rad."


def why_steady(data: Data) -> str:
    """Finding on a joint at a uniform velocity; empty if the velocity changes."""
    if any(bends(data.t, x) for x in (data.u, data.y)):
        return ""
    velocity = float(np.polyfit(data.t, data.y, 1)[0])
    lag = float(np.mean(data.u - data.y)) / velocity
    return (
        f"The joint moves at a uniform velocity of {velocity:.3g} rad/s, which shows only its lag "
        f"of {lag * 1e3:.3g} ms."
    )


def bends(t: FloatArray, x: FloatArray) -> bool:
    """Whether positions [rad] over times [s] are more than a straight line and noise, (n,) each."""
    off = x - _line(t, x)
    return bool(np.std(off) > STILL * noise_of(x) and np.ptp(off) > LEAST_BEND)


def _line(t: FloatArray, x: FloatArray) -> FloatArray:
    """The straight line through positions over time."""
    return np.asarray(np.polyval(np.polyfit(t, x, 1), t))


def nothing(data: Data, log: Log, name: str, why: str) -> JointIdentification:
    """Result of a joint that does not move, or moves at a uniform velocity."""
    straight = _line(data.t, data.y)
    residuals = data.y - straight
    return JointIdentification(
        name=name,
        order="second",
        kp=_unknown("kp"),
        kv=_unknown("kv"),
        dead_time=_unknown("dead_time"),
        acceleration=_unknown("acceleration"),
        start="rest",
        t=data.t + log.t[0],
        simulated=straight,
        residuals=residuals,
        rms=float(np.sqrt(np.mean(residuals**2))),
        r_squared=math.nan,
        largest_demand=0.0,
        saturated_time=0.0,
        notes=(why,),
    )


def described(data: Data, log: Log, name: str, choice: Choice) -> JointIdentification:
    """Estimates, prediction error and findings of a joint."""
    found = choice.chosen
    state, data = found.state, replace(data, delays=found.delays)
    intervals = find_intervals(data, found)
    used = slice(state.first, data.last)
    errors = np.concatenate(unseen_errors(data, found))
    rows = np.arange(len(data.t)) if data.rows is None else data.rows
    own = rows[used] >= 0
    estimates = {x: _estimate(found, x, intervals) for x in UNITS}
    joint = JointIdentification(
        name=name,
        order=state.order,
        kp=estimates["kp"],
        kv=estimates["kv"],
        dead_time=estimates["dead_time"],
        acceleration=estimates["acceleration"],
        velocity_feedforward=None if state.feed is None else estimates["velocity_feedforward"],
        start=state.start,
        t=log.t[rows[used][own]],
        simulated=simulated(data, state)[0][0][own] + (state.offset or 0.0),
        residuals=found.residuals[own],
        rms=math.sqrt(found.sse / found.count),
        r_squared=found.r_squared,
        largest_demand=largest_demand(data, state) if state.order == "second" else math.nan,
        saturated_time=found.saturated_time,
        states=choice.states,
        tracking_rms=float(np.std(counting(data, data.u - data.y, found))),
        predicted_rms=float(np.std(errors)),
    )
    notes = _list_findings(joint, found)
    if found.r_squared < FOLLOWS:
        share = max(found.r_squared, 0.0)
        notes.insert(0, f"The model explains {share:.0%} of the motion, so nothing is determined.")
        changed: dict[str, Any] = {x.name: _unknown(x.name) for x in joint.estimates}
        return replace(joint, **changed, notes=tuple(notes))
    friction = find_friction(data, found) if state.order == "second" else None
    if friction is not None:
        notes.append(_describe(friction))
    doubt = _doubt(joint, found)
    if doubt:
        notes.insert(0, doubt)
        changed = {x.name: replace(x, determined=False) for x in joint.estimates}
        joint = replace(joint, **changed)
    elif friction is not None:
        joint = _allow_for(joint, friction)
    return replace(joint, notes=tuple(notes))


def counting(data: Data, values: FloatArray, found: Fit) -> FloatArray:
    """The values, of all samples, that the fit of a joint uses."""
    some = slice(found.state.first, data.last)
    return values[some] if data.used is None else values[some][data.used[some]]


def _unknown(name: str) -> Estimate:
    """A parameter without a value."""
    low = -math.inf if name == "dead_time" else 0.0
    return Estimate(
        name=name, unit=UNITS[name], value=math.nan, sd=math.nan, low=low, high=math.inf,
        determined=False,
    )  # fmt: skip


def _estimate(found: Fit, name: str, intervals: dict[str, Interval]) -> Estimate:
    """The estimate of a parameter; one that is not fitted has no value."""
    key = KEYS.get(name, name)
    if key not in intervals:
        return _unknown(name)
    value, (sd, low, high) = float(getattr(found.state, key)), intervals[key]
    allowed = DETERMINED if key == "feed" else DETERMINED * abs(value)
    if key == "delay":
        allowed = max(allowed, DETERMINED_DELAY)
    determined = sd <= allowed and key not in found.at_edge
    return Estimate(
        name=name, unit=UNITS[name], value=value, sd=sd, low=low, high=high, determined=determined
    )


def _doubt(joint: JointIdentification, found: Fit) -> str:
    """Finding that leaves nothing determined, since it biases all parameters; else empty."""
    names = {v: k for k, v in KEYS.items()}
    edges = " and ".join(names.get(x, x).replace("_", " ") for x in found.at_edge)
    if edges:
        return f"The best {edges} is at the edge of the search, so nothing is determined."
    dead = joint.dead_time
    if dead.high < 0 and dead.value < -DETERMINED_DELAY:
        late = f"The best dead time is below zero, {dead.value * 1e3:.3g} ms"
        return f"{late}, so nothing is determined."
    return ""


def _allow_for(joint: JointIdentification, friction: Friction) -> JointIdentification:
    """Widen estimates by the bias due to friction; a large bias leaves nothing determined."""
    changed: dict[str, Any] = {}
    for x in (joint.kp, joint.kv, joint.dead_time):
        shift = abs(friction.shifts.get(KEYS.get(x.name, x.name), 0.0))
        # The longer side of a logarithm, for gains.
        off = shift if x.name == "dead_time" else x.value * math.expm1(shift)
        changed[x.name] = replace(
            x, sd=math.hypot(x.sd, off), low=x.low - off, high=x.high + off,
            determined=x.determined and not friction.spoils_any,
        )  # fmt: skip
    return replace(joint, **changed)


def _describe(friction: Friction) -> str:
    """Finding on dry friction."""
    biases = [
        f"dead time by {digits(abs(x) * 1e3, 2)} ms"
        if name == "delay"
        else f"{name} by {digits(abs(x) * 100, 2)} %"
        for name, x in friction.shifts.items()
    ]
    return (
        f"Dry friction or stiction of {digits(friction.size, 2)} rad/s² (standard deviation "
        f"{digits(friction.sd, 2)}) biases {', '.join(biases)}."
    )


def _list_findings(joint: JointIdentification, found: Fit) -> list[str]:
    """Findings that leave parameters determined."""
    notes = []
    if joint.rms > ROUNDING and not is_white(found):
        notes.append("The residuals are correlated, and the intervals allow for that.")
    if found.state.offset is not None:
        notes.append(
            f"The measured position is offset from the command by {found.state.offset:.4g} rad."
        )
    if joint.saturated_time > 0:
        notes.append(f"The joint was at its acceleration limit for {joint.saturated_time:.3g} s.")
    return notes
