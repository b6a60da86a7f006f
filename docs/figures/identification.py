"""What logs tell of a servo: a fit, and how well three motions tell each parameter."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from matplotlib.figure import Figure
from soak.joint import move

import armcontour as ac

FILE = "fig_identification"

TRUE = {"kp": 25.0, "kv": 150.0, "dead_time": 12.3e-3}
LIMIT = 20.0  # rad/s²
NOISE = 1e-4  # rad
T = np.arange(0, 4, 2e-3)  # s
NAMES = {"kp": "$K_p$", "kv": "$K_v$", "dead_time": "dead time"}
SHOWN = (1.0, 1.6)  # s


def draw() -> Figure:
    """An excerpt of a log with its fit and residuals; intervals of three logs about the truth."""
    found = {name: _identify(u, k) for k, (name, u) in enumerate(_commands().items())}
    log, joint = found["multisine to 25 Hz"]
    figure = plt.figure(figsize=(8.6, 5.0))
    places = figure.subplot_mosaic([["fit", "told"], ["left", "told"]], height_ratios=(2, 1))
    on = (SHOWN[0] <= log.t) & (log.t <= SHOWN[1])
    fitted = (SHOWN[0] <= joint.t) & (joint.t <= SHOWN[1])
    fit, left, told = places["fit"], places["left"], places["told"]
    fit.plot(log.t[on], 1e3 * log.command[on, 0], color=style.GREY, lw=0.9, label="command")
    fit.plot(log.t[on], 1e3 * log.measured[on, 0], color=style.ORANGE, lw=2.6, label="measured")
    fit.plot(joint.t[fitted], 1e3 * joint.simulated[fitted], color=style.BLUE, lw=1, label="model")
    fit.set(ylabel="position [mrad]")
    fit.set_title("(a) A log and the model that was found")
    fit.legend(loc="upper right", ncols=3)
    left.plot(joint.t[fitted], 1e3 * joint.residuals[fitted], color=style.BLUE, lw=0.6)
    left.set(xlabel="time [s]", ylabel="[mrad]", ylim=(-0.5, 0.5))
    left.set_title("(b) Measured less model: noise")
    left.sharex(fit)
    colours = (style.VERMILLION, style.BLUE, style.GREEN)
    for k, ((name, (_, of)), colour) in enumerate(zip(found.items(), colours, strict=True)):
        for row, key in enumerate(TRUE):
            x = getattr(of, key)
            values = np.array([x.value, x.low, x.high]) / TRUE[key]
            y = -row + 0.2 * (1 - k)
            told.plot(values[1:], [y, y], color=colour, lw=3, label=None if row else name)
            told.plot(values[0], y, "o", color=style.BLACK, ms=3, zorder=3)
    told.axvline(1, color=style.BLACK, lw=0.8, ls="--")
    told.set_yticks([-k for k in range(len(TRUE))], [NAMES[x] for x in TRUE])
    told.set(xlabel="estimate and 95 % interval, over the truth", ylim=(-2.5, 0.9))
    told.set_title("(c) What 4 s of each motion tell")
    told.locator_params(axis="x", nbins=5)
    told.legend(loc="upper left")
    return figure


def _commands() -> dict[str, np.ndarray]:
    """Three motions of a joint [rad]."""
    rng = np.random.default_rng(1)
    lines = np.arange(0.5, 25, 0.25)
    phases = rng.uniform(0, 2 * np.pi, len(lines))
    sum_of_sines = np.cos(2 * np.pi * np.outer(T, lines) + phases).sum(axis=1)
    ramp = 0.3 * np.clip(T - 0.5, 0, 3)
    return {
        "ramp of 0.3 rad/s": ramp,
        "multisine to 25 Hz": 5e-3 * sum_of_sines / np.abs(sum_of_sines).max(),
        "step of 0.5 rad": np.where(T >= 1, 0.5, 0.0),
    }


def _identify(u: np.ndarray, seed: int) -> tuple[ac.Log, object]:
    """A log of a joint, simulated by a program that shares nothing with the estimator; its fit."""
    gains = {"kp": TRUE["kp"], "kv": TRUE["kv"], "delay": TRUE["dead_time"], "limit": LIMIT}
    q = move(T, u, **gains) + NOISE * np.random.default_rng(seed).standard_normal(len(T))
    log = ac.Log(t=T, command=u[:, None], measured=q[:, None])
    return log, ac.identify(log).joints[0]
