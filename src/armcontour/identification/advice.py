"""Motions that would determine a parameter, chosen by their Cramér-Rao bound."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from armcontour._checks import FloatArray
from armcontour._describing import digits
from armcontour.identification.choosing import largest_demand
from armcontour.identification.fitting import NAMES, Data, State, simulated

# Proposed motions: multisines of this duration [s], from LOWEST to one of these frequencies [Hz].
SECONDS = 20.0
LOWEST = 0.5
HIGHEST = (5.0, 10.0, 25.0, 50.0)
# How its phases are found: from which, and how often it is clipped at which multiple of its rms.
SEED = 0
CLIPPINGS = 30
PEAK = 1.7
# Share of the largest acceleration known to be reached that a proposed motion may need.
SHARE = 0.85
# The first motion that determines the parameter this many times better than needed is proposed.
RESERVE = 2.0
# Motions with less acceleration than this [rad/s²] are not proposed: no encoder shows them.
LEAST_DEMAND = 1e-6
# Nor are commands larger than this [rad rms], or such that would tell a gain no better than by this
# share, and a dead time by this [s].
LARGEST = 1.0
OF_USE_TO_GAINS, OF_USE = 1.0, {"delay": 0.1}
# Largest number of samples of a motion.
MOST_SAMPLES = 20_000


def better_motion(data: Data, state: State, name: str, noise: float, allowed: float) -> str:
    """A sentence with the first motion that determines a parameter, or with the best motion.

    Args:
        data: The log of the joint.
        state: Known parameters of the joint; unknown gains get usual values.
        name: "kp", "kv" or "delay".
        noise: Standard deviation of the measurement [rad].
        allowed: Standard deviation at which the parameter counts as determined: as a share of a
            gain, in s for the dead time.
    """
    state = _guessed(state)
    interval = max(data.interval, SECONDS / MOST_SAMPLES)
    top = SHARE * (state.limit if math.isfinite(state.limit) else largest_demand(data, state))
    state = replace(state, limit=math.inf, start="rest", first=0, q0=0.0, dq0=0.0)
    sentence, least = "", math.inf
    for highest in HIGHEST:
        if highest > 0.2 / interval or top <= LEAST_DEMAND:
            break
        trial, scale = multisine(data, state, interval, highest, top)
        sd = _bound(trial, state, name, noise)
        if scale > LARGEST or not sd < min(least, OF_USE.get(name, OF_USE_TO_GAINS)):
            continue
        least = sd
        sentence = (
            f"A multisine of {SECONDS:g} s from {LOWEST:g} to {highest:g} Hz with commands of "
            f"{digits(scale, 2)} rad rms, which asks for {top:.3g} rad/s², would tell it to "
            f"{_precision(name, sd)}."
        )
        if sd * RESERVE <= allowed:
            return sentence
    return sentence or (
        "A multisine of commands up to a few times K_p / 2π Hz, sampled five times faster than "
        "that, would tell it."
    )


def larger_step(data: Data, state: State, demand: float) -> float:
    """The step in one command interval [rad] that needs a given acceleration [rad/s²]."""
    interval = data.interval
    t: FloatArray = np.float64(interval) * np.arange(2 + int(math.ceil(5 / (state.kp * interval))))
    u = np.ones_like(t)
    u[0] = 0.0
    guessed = _guessed(state)
    unit = replace(guessed, start="rest", first=0, q0=0.0, dq0=0.0, delay=0.0, limit=math.inf)
    trial = Data(t=t, u=u, y=u, linear=data.linear, delays=(0.0, 0.0))
    return demand / largest_demand(trial, unit)


def multisine(
    data: Data, state: State, interval: float, highest: float, top: float
) -> tuple[Data, float]:
    """Make a multisine with equal lines up to `highest` [Hz] that needs the acceleration `top`.

    Returns:
        The commands as a log, and their root mean square [rad].
    """
    t: FloatArray = np.float64(interval) * np.arange(int(SECONDS / interval))
    u = _waves(len(t), interval, highest).copy()
    u -= u[0]
    trial = Data(t=t, u=u, y=u, linear=data.linear, delays=(0.0, 0.0))
    scale = top / largest_demand(trial, state)
    return replace(trial, u=u * scale), float(np.std(u * scale))


@cache
def _waves(n: int, interval: float, highest: float) -> FloatArray:
    """Equal lines up to `highest` [Hz] with low peaks, of any size, (n,).

    The lines are one per duration apart, so that neither the motion nor the error of an encoder
    repeats. Clipping the sum again and again keeps its peaks low (Van der Ouderaa and others, IEEE
    Trans. Instrum. Meas. 1988). A sweep has low peaks too, but the error of an encoder follows each
    of its slow cycles.
    """
    lines = np.fft.rfftfreq(n, interval)
    band = (lines >= LOWEST) & (lines <= highest)
    spectrum = band * np.exp(2j * math.pi * np.random.default_rng(SEED).uniform(size=len(lines)))
    for _ in range(CLIPPINGS):
        u = np.fft.irfft(spectrum, n)
        top = PEAK * np.std(u)
        spectrum = band * np.exp(1j * np.angle(np.fft.rfft(np.clip(u, -top, top))))
    return np.asarray(np.fft.irfft(spectrum, n))


def _bound(data: Data, state: State, name: str, noise: float) -> float:
    """Cramér-Rao bound of the standard deviation of a parameter: share of a gain, or s."""
    names = ("kp", "kv", "delay") if state.order == "second" else ("kp", "delay")
    out, _ = simulated(data, state, 1 + len(NAMES))
    jacobian = out[[1 + NAMES.index(x) for x in names]]
    # No damping is needed: these motions determine all parameters, if poorly.
    covariance = np.linalg.pinv(jacobian @ jacobian.T, rcond=1e-18, hermitian=True)
    sd = noise * math.sqrt(abs(covariance[names.index(name), names.index(name)]))
    return sd if name == "delay" else sd / float(getattr(state, name))


def _guessed(state: State) -> State:
    """The state with usual values for unknown gains."""
    kp = min(max(state.kp, 1.0), 200.0)
    if state.order == "first":
        return replace(state, kp=kp)
    return replace(state, kp=kp, kv=min(max(state.kv, kp), 10 * kp))


def _precision(name: str, sd: float) -> str:
    return f"{digits(sd * 1e3, 2)} ms" if name == "delay" else f"{digits(sd * 100, 2)} %"
